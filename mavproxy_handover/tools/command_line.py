# SPDX-License-Identifier: GPL-3.0-or-later

"""The parser of every `handover` command: argparse, with examples and exit codes in its help.

The manual pages and the reference have the same examples and codes (`reference/parsers.py`).
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any, Final

__all__ = ["USUAL_CODES", "CommandParser"]

#: exit codes of a command that gives no answer with its code
USUAL_CODES: Final[Mapping[int, str]] = {0: "done", 2: "wrong usage or bad input: nothing was done"}


class CommandParser(argparse.ArgumentParser):
    """The parser of one command.

    `examples`: command lines as they are typed, each with what it does. `codes`: each exit code, with what it says.
    """

    def __init__(
        self,
        *args: Any,
        examples: Sequence[tuple[str, str]] = (),
        codes: Mapping[int, str] = USUAL_CODES,
        **more: Any,
    ) -> None:
        super().__init__(*args, **more)
        self.examples = tuple(examples)
        self.codes = dict(codes)

    def format_help(self) -> str:
        """The text of `--help`."""
        parts = [super().format_help()]
        if self.examples:
            lines = [line for typed, what in self.examples for line in (f"  {typed}", f"      {what}")]
            parts += ["\n".join(["examples:", *lines, ""])]
        parts += ["\n".join(["exit code:", *(f"  {code}  {text}" for code, text in self.codes.items()), ""])]
        return "\n".join(parts)
