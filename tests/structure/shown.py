# SPDX-License-Identifier: GPL-3.0-or-later

"""Texts that people read and that are put together when a program runs: rows of message tables, and `--help`."""

from __future__ import annotations

import re
from collections.abc import Iterator

from gcs_module.notices import NOTICES
from mavproxy_handover.core.common.causes import CAUSES
from reference.parsers import commands
from reference.sentences import GUARD, VEHICLE
from reference.sentences.errors import FAMILIES, SHOWN
from tests.structure.language import Text, blocks

__all__ = ["help_texts", "message_texts"]


def message_texts() -> Iterator[tuple[str, Text]]:
    """The sentences of all message tables, and their meanings and actions: where each is, and the text."""
    rows = [("gcs_module/notices.py", row) for row in NOTICES.values()]
    rows += [(f"reference/sentences, group {group.name}", row) for group in (*VEHICLE, *GUARD) for row in group.rows]
    for where, row in rows:
        for text in (row.template, row.meaning, row.action):
            yield where, Text("message", 1, re.sub(r"\{[^}]*\}", "X", text))
    for family in (*FAMILIES, *SHOWN):
        yield f"reference/sentences/errors.py, {family.title}", Text("message", 1, family.meaning)
        yield f"reference/sentences/errors.py, {family.title}", Text("message", 1, family.action)
    for cause in CAUSES.values():
        for text in (cause.words, cause.meaning):
            yield "core/common/causes.py", Text("message", 1, text)


def help_texts() -> Iterator[tuple[str, Text]]:
    """What `handover COMMAND --help` says of each command, option, example and exit code."""
    for command in commands():
        where = f"handover {command.words} --help"
        for text in (command.text, command.description, command.epilog):
            for part in blocks(text.split("\n"), 1, "message"):
                yield where, part
        for option in command.options:
            yield where, Text("message", 1, option.help)
        for text in (*(meaning for _line, meaning in command.examples), *command.codes.values()):
            yield where, Text("message", 1, text)
