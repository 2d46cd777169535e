# SPDX-License-Identifier: GPL-3.0-or-later

"""What is spoken of a line: the first sentences, in about four seconds."""

from __future__ import annotations

from string import Formatter

import pytest

from gcs_module.notices import NOTICES
from gcs_module.speech import LONGEST_FIRST, spoken

TAKE = "When it is in your zone, type 'handover request' to take over."


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "RETURN to rally 2. GCSB silent for 5 s. 1.9 km away, needs 21 % of the battery (38 % left). " + TAKE,
            "RETURN to rally 2. GCSB silent for 5 seconds.",
        ),
        (
            "HOLD. The zone of GCSA ends in 5 s, and no station is ready beyond it. " + TAKE,
            "HOLD. The zone of GCSA ends in 5 seconds",
        ),
        ("No station commands drone-1. " + TAKE, "No station commands drone-1."),
        ("GCSB has drone-1: GCSB commands now, epoch 4.", "GCSB has drone-1: GCSB commands now."),
        (
            "Handover GCSA -> GCSB of drone-1 in 29 s. Type 'handover accept' or 'handover deny'.",
            "Handover to GCSB in 29 seconds.",
        ),
        (
            "The commander has changed the mission in flight: no route check here until it has landed.",
            "The commander has changed the mission in",
        ),
        ("One sentence that goes on and on without any comma to be cut at, far too long", None),
    ],
)
def test_the_first_sentences_that_fit_are_spoken(line: str, said: str | None) -> None:
    if said is not None:
        assert spoken(line) == said
    else:
        assert spoken(line) == "One sentence that goes on and on without any"


@pytest.mark.parametrize("row", NOTICES)
def test_no_line_of_a_station_is_spoken_for_longer(row: str) -> None:
    template = NOTICES[row].template
    values = {name: 30 if form else "GCSA" for _text, name, form, _how in Formatter().parse(template) if name}
    text = template.format(**values)
    plain = spoken(text)
    for written, words in ((" s", " seconds"), (" m", " metres")):
        plain = plain.replace(words, written)
    assert 0 < len(plain) <= LONGEST_FIRST
