# SPDX-License-Identifier: GPL-3.0-or-later

"""Makes the pages of docs/reference from what they tell of: `make reference`.

* `messages.md` from the definition of the dialect, `mavproxy_handover/wire/handover.xml`;
* `commands.md` from the parsers of the `handover` commands themselves: each is run until it parses its arguments.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch
from xml.etree import ElementTree

from mavproxy_handover import cli

ROOT = Path(__file__).resolve().parents[2]
DEFINITION = ROOT / "mavproxy_handover" / "wire" / "handover.xml"
PAGES = {"messages.md": "messages", "commands.md": "commands"}


class _Made(BaseException):
    """A command has made its parser; nothing of it may catch that."""


def parser_of(word: str) -> argparse.ArgumentParser:
    """The parser of one command of `handover`."""
    made: list[argparse.ArgumentParser] = []

    def parse(self: argparse.ArgumentParser, *_args: object, **_more: object) -> None:
        made.append(self)
        raise _Made

    module, function, _text = cli._COMMANDS[word]
    run = getattr(importlib.import_module(module), function)
    with (
        patch.object(argparse.ArgumentParser, "parse_args", parse),
        patch.object(argparse.ArgumentParser, "parse_known_args", parse),
    ):
        try:
            run([])
        except _Made:
            return made[0]
    raise AssertionError(f"handover {word} parses nothing")


def commands() -> str:
    """Every command of the shell with its options, as Markdown."""
    lines = ["# Commands of the shell", "", "What `handover COMMAND --help` says, of every command.", ""]
    lines += ["| command | what it does |", "|---|---|"]
    lines += [f"| [`handover {word}`](#handover-{word}) | {text} |" for word, (_m, _f, text) in cli._COMMANDS.items()]
    for word in cli._COMMANDS:
        lines += ["", *_command(f"handover {word}", parser_of(word), 2)]
    return "\n".join(lines) + "\n"


def _command(name: str, parser: argparse.ArgumentParser, level: int) -> Iterator[str]:
    yield f"{'#' * level} {name}"
    if parser.description:
        yield ""
        yield _text(parser.description)
    rows = [row for action in parser._actions if (row := _row(action)) is not None]
    if rows:
        yield from ("", "| option | what |", "|---|---|", *rows)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            told = {choice.dest: choice.help or "" for choice in action._choices_actions}
            for word, sub in action.choices.items():
                sub.description = sub.description or told.get(word)
                yield ""
                yield from _command(f"{name} {word}", sub, level + 1)


def _row(action: argparse.Action) -> str | None:
    if isinstance(action, (argparse._HelpAction, argparse._SubParsersAction)) or action.help == argparse.SUPPRESS:
        return None
    choices = None if action.choices is None else "{" + ",".join(map(str, action.choices)) + "}"
    value = action.metavar or choices or ("" if action.option_strings else action.dest)
    value = " ".join(value) if isinstance(value, tuple) else value
    shown = value if action.nargs != 0 and action.option_strings else ""
    if action.option_strings and action.nargs != 0 and not shown:
        shown = action.dest.upper()
    name = ", ".join(f"`{option}{' ' + shown if shown else ''}`" for option in action.option_strings) or f"`{value}`"
    return f"| {name} | {_text((action.help or '') % _values(action))} |"


def _values(action: argparse.Action) -> dict[str, object]:
    return {**vars(action), "prog": "handover"}


def _text(words: str) -> str:
    return " ".join(words.split()).replace("|", "\\|").replace("<", "&lt;")


def messages() -> str:
    """The dialect's messages and enumerations, as Markdown."""
    root = ElementTree.parse(DEFINITION).getroot()
    lines = ["# What is exchanged", ""]
    lines += [
        "The messages of this system, in the dialect `handover.xml`. How a handover goes through them, step by step: "
    ]
    lines[-1] += "[Architecture](../architecture.md)."
    lines += ["", "| id | message | what it is |", "|--:|---|---|"]
    found = root.findall("./messages/message")
    for message in found:
        name = message.attrib["name"]
        first = _text(message.findtext("description", "")).split(". ")[0].rstrip(".")
        lines.append(f"| {message.attrib['id']} | [`{name}`](#{name.lower()}) | {first} |")
    for message in found:
        lines += ["", f"## {message.attrib['name']}", "", _text(message.findtext("description", ""))]
        lines += ["", "| field | type | unit | what it is |", "|---|---|---|---|"]
        for field in message.findall("field"):
            of = field.attrib
            enum = of.get("enum")
            unit = of.get("units", f"[{enum}](#{enum.lower()})" if enum and _ours(root, enum) else enum or "")
            lines.append(f"| `{of['name']}` | `{of['type']}` | {unit} | {_text(field.text or '')} |")
    for enum in root.findall("./enums/enum"):
        lines += ["", f"## {enum.attrib['name']}", "", _text(enum.findtext("description", "")), ""]
        lines += ["| value | name | what it is |", "|--:|---|---|"]
        for entry in enum.findall("entry"):
            what = _text(entry.findtext("description", ""))
            lines.append(f"| {entry.attrib['value']} | `{entry.attrib['name']}` | {what} |")
    return "\n".join(lines) + "\n"


def _ours(root: ElementTree.Element, enum: str) -> bool:
    return any(each.attrib["name"] == enum for each in root.findall("./enums/enum"))


def main() -> None:
    """Write the pages."""
    for name, make in PAGES.items():
        path = ROOT / "docs" / "reference" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(globals()[make](), encoding="utf-8")
        print(path.relative_to(ROOT))


if __name__ == "__main__":
    main()
