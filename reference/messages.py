# SPDX-License-Identifier: GPL-3.0-or-later

"""`messages.md`, from the tables of all sentences: a station's notices, and `reference/sentences`."""

from __future__ import annotations

import re
from typing import Final

from gcs_module.alarms import LOOKS
from gcs_module.notices import NOTICES, QUESTION
from mavproxy_handover.core.common.causes import CAUSES
from mavproxy_handover.core.common.levels import Level
from reference.markdown import cell, code, page, table
from reference.sentences import GUARD, VEHICLE, Group

__all__ = ["messages"]


def messages() -> str:
    """The page."""
    levels = ", ".join(f"{level.name.lower()}{' (spoken)' if LOOKS[level].spoken else ''}" for level in Level)
    notices = [
        (code(_shown(row.template)), row.gravity.name.lower(), cell(row.meaning), cell(row.action))
        for row in NOTICES.values()
    ]
    causes = [(code(row.words), cell(row.meaning), cell(", ".join(row.policies))) for row in CAUSES.values()]
    return page(
        "Messages",
        "The sentences that people meet, with their meaning and what to do, grouped by the place where they appear. "
        f"Values are in capitals. The levels are {levels}. The [glossary](../glossary.md) explains the words.",
        "Search this page for a part of the sentence that you read. A reason inside a sentence has its own row.",
        "Not on this page yet: a station's lines about addresses and its answers to typed commands. Errors of files "
        "and the doctor are missing too. [Troubleshooting](../troubleshooting.md) has the most frequent ones.",
        "## Of a station",
        "The sentences that a station tells its operator by its own rules, in the order of a flight.",
        f"A line that waits for an answer ends with:{QUESTION}",
        table(_HEAD, notices),
        "## Of the vehicle",
        "The companion sends texts to stations as STATUSTEXT, whose severity is the level. A program without our "
        "module gets them with 'Handover:' before them. Lines of level info are on the companion's console only, "
        "except where the table says otherwise.",
        *(part for group in VEHICLE for part in _section(group)),
        "## Of the guard",
        "The guard is a script of the autopilot. Programs show its texts as the autopilot's own.",
        *(part for group in GUARD for part in _section(group)),
        "## Causes of a decision",
        "The vehicle's decision names a cause, in these words or with its figures. The policy that is named first is "
        "the default. [Safety decisions](../safety.md) explains them.",
        table(("cause", "meaning", "policies"), causes),
    )


_HEAD: Final = ("message", "level", "meaning", "what to do")


def _section(group: Group) -> tuple[str, str, str]:
    """Heading, introduction and table of a group."""
    rows = [
        (code(_shown(row.template)), row.level.name.lower(), cell(row.meaning), cell(row.action)) for row in group.rows
    ]
    return f"### {group.title}", group.intro, table(_HEAD, rows)


def _shown(template: str) -> str:
    """A template as people read it: each value by its name in capitals."""
    return re.sub(r"\{(\w+)[^}]*\}", lambda value: value[1].upper().removesuffix("_S"), template)
