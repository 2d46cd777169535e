# SPDX-License-Identifier: GPL-3.0-or-later

"""`messages.md`, from the table of the sentences that a station's rules tell."""

from __future__ import annotations

import re

from gcs_module.alarms import LOOKS, Level
from gcs_module.notices import NOTICES, QUESTION
from mavproxy_handover.core.common.causes import CAUSES
from reference.markdown import cell, code, page, table

__all__ = ["messages"]


def messages() -> str:
    """The page."""
    levels = ", ".join(f"{level.name.lower()}{' (spoken)' if LOOKS[level].spoken else ''}" for level in Level)
    rows = [
        (code(_shown(row.template)), row.gravity.name.lower(), cell(row.meaning), cell(row.action))
        for row in NOTICES.values()
    ]
    causes = [(code(row.words), cell(row.meaning), cell(", ".join(row.policies))) for row in CAUSES.values()]
    return page(
        "Messages",
        "The sentences that a station tells its operator by its own rules, in the order of a flight. Values are in "
        f"capitals. The levels are {levels}. The [glossary](../glossary.md) explains the words.",
        "Not on this page yet: lines about addresses, answers to typed commands, texts of the vehicle and refusals of "
        "its gate, errors of files, the doctor, and the texts of the guard. "
        "[Troubleshooting](../troubleshooting.md) has the most frequent ones.",
        "## Of the station",
        f"A line that waits for an answer ends with:{QUESTION}",
        table(("message", "level", "meaning", "what to do"), rows),
        "## Causes of a decision",
        "The vehicle's decision names a cause, in these words or with its figures. The policy that is named first is "
        "the default. [Safety decisions](../safety.md) explains them.",
        table(("cause", "meaning", "policies"), causes),
    )


def _shown(template: str) -> str:
    """A template as people read it: each value by its name in capitals."""
    return re.sub(r"\{(\w+)[^}]*\}", lambda value: value[1].upper().removesuffix("_S"), template)
