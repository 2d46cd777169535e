# SPDX-License-Identifier: GPL-3.0-or-later

"""Every `handover COMMAND --help` has a purpose, examples that the command takes, and its exit codes."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator

import pytest

from mavproxy_handover import cli
from mavproxy_handover.tools.command_line import CommandParser
from reference.parsers import parser_of


def _below(words: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    yield words, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                yield from _below(f"{words} {name}", inner)


PARSERS = {words: parser for word in cli.COMMANDS for words, parser in _below(word, parser_of(word))}


@pytest.mark.parametrize("words", PARSERS)
def test_a_command_has_purpose_examples_and_exit_codes(words: str) -> None:
    parser = PARSERS[words]
    assert isinstance(parser, CommandParser)
    assert parser.description
    assert parser.examples, "no example"
    assert {0, 2} <= parser.codes.keys()
    text = parser.format_help()
    for typed, what in parser.examples:
        assert f"\n  {typed}\n      {what}\n" in text
    for code, what in parser.codes.items():
        assert f"\n  {code}  {what}" in text


@pytest.mark.parametrize("words", PARSERS)
def test_an_example_is_what_the_command_takes(words: str) -> None:
    for typed, _what in PARSERS[words].examples:  # type: ignore[attr-defined]
        line = typed.removeprefix("sudo ").partition(" > ")[0]
        first, word, *rest = shlex.split(line)
        assert (first, word) == ("handover", words.split(maxsplit=1)[0])
        assert " ".join([word, *rest]).startswith(words)
        PARSERS[word].parse_args(rest)  # ends this process if it is wrong


@pytest.mark.parametrize("words", PARSERS)
def test_a_long_list_of_options_is_in_groups(words: str) -> None:
    """At most 12 in a group, which is what fits below its heading without scrolling."""
    groups = PARSERS[words]._action_groups
    assert max(len(group._group_actions) for group in groups) <= 12


def test_handover_help_has_every_command_once_in_a_group(capsys: pytest.CaptureFixture[str]) -> None:
    listed = [word for words in cli.GROUPS.values() for word in words]
    assert sorted(listed) == sorted(cli.COMMANDS)
    assert cli.main(["--help"]) == 0
    told = capsys.readouterr().out
    for word in listed:
        assert f"\n  {word:10} " in told
    for heading in ("examples:", "exit code:"):
        assert f"\n{heading}\n" in told
