# SPDX-License-Identifier: GPL-3.0-or-later

"""What bash, zsh and fish complete behind `handover`: scripts that shtab makes from the same parsers.

They are files that know everything: no Python is started at a TAB. What is a file or a folder is told by the type that
an argument has, or by what stands for it in the help.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Final

import shtab

from mavproxy_handover import cli
from reference.parsers import parser_of
from sitl.script.scenario import known_scenarios

__all__ = ["completion"]

#: shell -> name of its script: the names under which shells look for them
SCRIPTS: Final = {"bash": "handover", "zsh": "_handover", "fish": "handover.fish"}
_FOLDERS: Final = {"DIR", "MISSION"}
_FILES: Final = {"FILE", "PATH"}


def completion() -> dict[str, str]:
    """Name and content of each script."""
    parser = _whole()
    return {name: shtab.complete(parser, shell).rstrip("\n") + "\n" for shell, name in SCRIPTS.items()}


def _whole() -> argparse.ArgumentParser:
    """`handover` as one parser: it has none itself, and asks each command's when it is used."""
    parser = argparse.ArgumentParser(prog="handover", description=cli.DESCRIPTION)
    parser.add_argument("-V", "--version", action="version", version="", help="show the version")
    below = parser.add_subparsers(metavar="COMMAND")
    for word, (_module, _function, text) in cli.COMMANDS.items():
        own = parser_of(word)
        _annotate(word, own)
        below.add_parser(word, parents=[own], add_help=False, help=text, description=own.description)
    return parser


def _annotate(word: str, parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for inner in action.choices.values():
                _annotate(word, inner)
        elif word == "sim" and action.dest == "scenario":
            action.choices = sorted(known_scenarios())
        else:
            place = _place(action)
            if place is not None:
                action.complete = place  # type: ignore[attr-defined]


def _place(action: argparse.Action) -> Any:
    if action.choices is not None or action.nargs == 0:
        return None
    if action.metavar in _FOLDERS or action.dest in ("root", "card", "dir"):
        return shtab.DIRECTORY
    if action.type is Path or action.metavar in _FILES or action.dest in ("config", "program"):
        return shtab.FILE
    return None
