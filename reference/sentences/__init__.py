# SPDX-License-Identifier: GPL-3.0-or-later

"""Every sentence that a person can meet, with level, meaning and action: `docs/reference/messages.md` is made from it.

A station's own sentences are in `gcs_module/notices.py`. Here are those of the other programs, grouped by the place
where people meet them. A test compares the tables with the sources, and with every text of the companion's tests.
"""

from __future__ import annotations

from typing import Final

from reference.sentences import answers, console, feeds, flight, gate, guard, missions, onboard, preflight, start
from reference.sentences.matching import Matcher
from reference.sentences.row import NOTHING, Group, Sentence
from reference.sentences.words import WORDS

__all__ = ["COMPANION", "GUARD", "NOTHING", "OF_GUARD", "VEHICLE", "Group", "Sentence"]

#: the groups of the vehicle's sentences, in the order of the page
VEHICLE: Final[tuple[Group, ...]] = (
    *flight.GROUPS,
    *start.GROUPS,
    *gate.GROUPS,
    *feeds.GROUPS,
    *onboard.GROUPS,
    *missions.GROUPS,
    *preflight.GROUPS,
    *console.GROUPS,
    *answers.GROUPS,
)
#: the groups of the guard's texts
GUARD: Final[tuple[Group, ...]] = guard.GROUPS
#: finds the row of a text of the guard
OF_GUARD: Final = Matcher(GUARD, guard.WORDS)
#: finds the row of a sentence of the companion
COMPANION: Final = Matcher(VEHICLE, WORDS)
