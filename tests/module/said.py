# SPDX-License-Identifier: GPL-3.0-or-later

"""Collects what the companion says in a test, and compares it with the table of all sentences.

Every STATUSTEXT and every line of the console must have a row in `reference/sentences`. A STATUSTEXT must have the
level of its row.
"""

from __future__ import annotations

from functools import cache, wraps
from typing import Any

import pytest

from gcs_module.texts import SEVERITIES
from mavproxy_handover.core.common.levels import Level
from mavproxy_handover.gate import replies
from mavproxy_handover.operator.stations import port
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.sender import MessageSender
from reference.sentences import COMPANION

#: texts that tests put in place of the companion's own
MADE_UP = frozenset(
    {"First.", "Second.", "first", "hello", "second", "Links of GCSB are weak: weak.", "preflight: the guard is old"}
    | {f"{word}: {what}{end}" for word, end in (("energy", ""), ("Energy", ".")) for what in ("one", "one, two")}
)
#: the beginnings of such texts
MADE_UP_BEGINNINGS = ("RETURN to rally 2. Energy: 99.4 Wh left",)


@cache
def levels(text: str) -> frozenset[Level]:
    """The levels of the rows of a text; empty: it has no row."""
    return frozenset(row.level for row in COMPANION.all(text))


def unknown(said: list[tuple[str, Level | None]]) -> list[str]:
    """The texts without a row, and those with a level that no row of theirs has. `None`: a line of the console."""
    wrong = []
    for text, level in dict.fromkeys(said):
        if text in MADE_UP or text.startswith(MADE_UP_BEGINNINGS):
            continue
        found = levels(text)
        if not found:
            wrong.append(f"no row in reference/sentences: {text!r}")
        elif level is not None and level not in found:
            wrong.append(f"{level.name} in flight, {' or '.join(each.name for each in found)} in its row: {text!r}")
    return wrong


def listen(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Level | None]]:
    """The texts that are said from now on, each with its level."""
    said: list[tuple[str, Level | None]] = []

    def note(owner: Any, name: str, text_at: int, severity_at: int | None) -> None:
        real = getattr(owner, name)

        @wraps(real)
        def noted(*arguments: Any) -> Any:
            level = None if severity_at is None else SEVERITIES.get(arguments[severity_at], Level.INFO)
            said.append((arguments[text_at], level))
            return real(*arguments)

        monkeypatch.setattr(owner, name, noted)

    note(MessageSender, "_say", 2, 3)
    note(EventLog, "tell", 1, None)
    note(replies, "line_of_text", 0, 1)
    note(port, "marked_texts", 0, 1)
    return said
