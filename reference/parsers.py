# SPDX-License-Identifier: GPL-3.0-or-later

"""The parsers of `handover` and its commands, as the commands themselves build them.

Each command is called with nothing and stopped where it would parse: what a page says is then what the command takes.
"""

from __future__ import annotations

import argparse
import importlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NoReturn
from unittest import mock

from mavproxy_handover import cli
from mavproxy_handover.tools.command_line import CommandParser

__all__ = ["Command", "Option", "commands", "parser_of"]


class _Stop(BaseException):
    """Carries a parser out of its command; no `except Exception` on the way takes it."""


@dataclass(frozen=True, slots=True)
class Option:
    """One option or word of a command."""

    #: ("--key",); () for a word that has its place
    names: tuple[str, ...]
    #: what stands for the value, "" for none, as `FILE`, `NAME ...`
    value: str
    help: str
    required: bool

    @property
    def typed(self) -> str:
        """As it is typed."""
        return ", ".join(f"{name} {self.value}".strip() for name in self.names) or self.value


@dataclass(frozen=True, slots=True)
class Command:
    """One command. `words`: as typed behind `handover`."""

    words: str
    text: str
    description: str
    epilog: str
    options: tuple[Option, ...]
    #: command lines, and what each does
    examples: tuple[tuple[str, str], ...] = ()
    #: exit code -> what it says
    codes: Mapping[int, str] = field(default_factory=dict)

    @property
    def usage(self) -> str:
        """One line: what must be given, then what may be."""
        parts = [f"handover {self.words}"]
        for option in self.options:
            if option.names == ("-h", "--help"):
                continue
            first = f"{option.names[-1]} {option.value}".strip() if option.names else option.value
            parts.append(first if option.required else f"[{first}]")
        return " ".join(parts)


def parser_of(word: str) -> argparse.ArgumentParser:
    """The parser of one command. Raises AssertionError for one that has none."""

    def stop(self: argparse.ArgumentParser, *_args: Any, **_more: Any) -> NoReturn:
        raise _Stop(self)

    module, function, _text = cli.COMMANDS[word]
    with mock.patch.object(argparse.ArgumentParser, "parse_args", stop):
        try:
            getattr(importlib.import_module(module), function)([])
        except _Stop as stopped:
            parser: argparse.ArgumentParser = stopped.args[0]
            return parser
    raise AssertionError(f"handover {word} has no parser")


def commands() -> tuple[Command, ...]:
    """All of them, in the order of `handover --help`; those below a command behind it."""
    found: list[Command] = []
    for word, (_module, _function, text) in cli.COMMANDS.items():
        found += _commands(word, text, parser_of(word))
    return tuple(found)


def _commands(words: str, text: str, parser: argparse.ArgumentParser) -> Iterator[Command]:
    below = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    shown = [action for action in parser._actions if action not in below and action.help != argparse.SUPPRESS]
    options = tuple(_option(parser, action) for action in shown)
    assert isinstance(parser, CommandParser), f"handover {words}: its help has no examples"
    yield Command(
        words,
        text,
        parser.description or "",
        parser.epilog or "",
        (*options, *map(_word, below)),
        parser.examples,
        parser.codes,
    )
    for action in below:
        for name, inner in action.choices.items():
            yield from _commands(f"{words} {name}", inner.description or "", inner)


def _word(action: Any) -> Option:
    return Option((), "COMMAND", "one of " + ", ".join(action.choices), required=True)


_FEW: Final = 60


def _option(parser: argparse.ArgumentParser, action: argparse.Action) -> Option:
    text = re.sub(r"\s+", " ", parser._get_formatter()._expand_help(action)) if action.help else ""
    listed = "" if action.choices is None else ",".join(map(str, action.choices))
    long = len(listed) > _FEW
    if long:
        text, listed = f"{text}: {', '.join(map(str, action.choices or ()))}", ""
    own = action.metavar if isinstance(action.metavar, str) else ""
    name = action.dest.upper().replace("-", "_")
    one = own or ("WORD" if long else f"{{{listed}}}" if listed else name)
    positional = not action.option_strings
    shapes = {None: one, 0: "", "?": f"[{one}]" if not positional else one, "+": f"{one} ...", "*": f"{one} ..."}
    required = action.required if not positional else action.nargs not in ("?", "*")
    return Option(tuple(action.option_strings), shapes[action.nargs], text, required)  # type: ignore[index]
