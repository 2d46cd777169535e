# SPDX-License-Identifier: GPL-3.0-or-later

"""`messages.md`, from the tables of all sentences: a station's notices, and `reference/sentences`."""

from __future__ import annotations

import re
from typing import Final

from gcs_module.alarms import LOOKS
from gcs_module.notices import NOTICES, QUESTION
from mavproxy_handover.core.common.causes import CAUSES
from mavproxy_handover.core.common.levels import Level
from reference.doctor import Found, findings
from reference.markdown import cell, code, page, table
from reference.sentences import GUARD, VEHICLE, Group
from reference.sentences.errors import FAMILIES, SHOWN, Family, texts_of

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
        "## Of a station",
        "The sentences that a station tells its operator by its own rules, in the order of a flight.",
        f"A line that waits for an answer ends with:{QUESTION}",
        table(_HEAD, notices),
        "Other lines are answers to what the operator types, and news of missions and addresses. The watch page and "
        "the report are here too.",
        *(part for family in SHOWN for part in _family(family)),
        "## Of the vehicle",
        "The companion sends texts to stations as STATUSTEXT, whose severity is the level. A program without our "
        "module gets them with 'Handover:' before them. Lines of level info are on the companion's console only, "
        "except where the table says otherwise.",
        *(part for group in VEHICLE for part in _section(group)),
        "## Of the guard",
        "The guard is a script of the autopilot. Programs show its texts as the autopilot's own.",
        *(part for group in GUARD for part in _section(group)),
        "## Of the doctor",
        "`handover doctor` looks at a machine. These are its findings that ask for something to be done.",
        table(("level", "what", "found", "what to do"), [_finding(each) for each in findings() if each.do]),
        "## Errors of files and commands",
        "An error names file, place, value and what is allowed, in one line. All errors of a family mean the "
        "same, and are corrected the same way.",
        *(part for family in FAMILIES for part in _family(family)),
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


def _finding(found: Found) -> tuple[str, ...]:
    return (found.level, code(_shown(found.what)), code(_shown(found.found)), cell(_shown(found.do)))


def _family(family: Family) -> tuple[str, ...]:
    """Heading, meaning, action, and the texts of a family."""
    texts = [(code(_shown(text)),) for text in texts_of(family)]
    return f"### {family.title}", f"{family.meaning} **What to do:** {family.action}", table(("message",), texts)


def _shown(template: str) -> str:
    """A template as people read it: each value by its name in capitals."""
    return re.sub(r"\{(\w+)[^}]*\}", lambda value: value[1].upper().removesuffix("_S"), template)
