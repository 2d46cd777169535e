# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover completion SHELL`: print the script that completes `handover` in a shell.

The scripts are data of the package, made from the parsers of all commands when it is built. They start no Python.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Final

from mavproxy_handover.tools.command_line import CommandParser
from mavproxy_handover.tools.resources import shipped

__all__ = ["main"]

#: shell -> its script
_SCRIPTS: Final = {"bash": "handover", "zsh": "_handover", "fish": "handover.fish"}


def main(argv: Sequence[str]) -> int:
    """Run `handover completion`. 0: printed; 2: wrong usage, or not installed."""
    parser = CommandParser(
        prog="handover completion",
        examples=(("handover completion zsh > _handover", "write the script for zsh; put it in a folder of $fpath"),),
        codes={0: "printed", 2: "wrong usage, or not made in this installation"},
        description="Print the script that completes `handover`, its commands and options in a shell.",
        epilog='In bash: eval "$(handover completion bash)", in ~/.bashrc. In zsh: handover completion zsh > _handover '
        "in a folder of $fpath. In fish: handover completion fish > ~/.config/fish/completions/handover.fish.",
    )
    parser.add_argument("shell", choices=list(_SCRIPTS), help="for which shell")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        script = (shipped("completion") / _SCRIPTS[arguments.shell]).read_text(encoding="utf-8")
    except OSError as error:
        print(f"handover completion: {error.filename}: {error.strerror}; 'pip install' makes it", file=sys.stderr)
        return 2
    print(script, end="")
    return 0
