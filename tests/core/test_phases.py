# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of phases, against a second book-keeping."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.authority.phases import PHASES, PhaseCause
from mavproxy_handover.core.common.model import Phase

#: every move there is; what is not here changes nothing
EXPECTED = {
    ("ON_LOAD", "STARTED"): "ON_MISSION",
    ("ON_MISSION", "TRANSFER_BEGUN"): "ON_HANDOVER",
    ("ON_MISSION", "EMERGENCY"): "EMERGENCY",
    ("ON_MISSION", "DISARMED"): "ON_LOAD",
    ("ON_HANDOVER", "TRANSFER_ENDED"): "ON_MISSION",
    ("ON_HANDOVER", "EMERGENCY"): "EMERGENCY",
    ("ON_HANDOVER", "DISARMED"): "ON_LOAD",
    ("EMERGENCY", "RECOVERED"): "ON_MISSION",
    ("EMERGENCY", "DISARMED"): "ON_LOAD",
    ("ON_LOAD", "REHEARSED"): "ON_MISSION",
    ("ON_MISSION", "REHEARSAL_OVER"): "ON_LOAD",
    ("ON_HANDOVER", "REHEARSAL_OVER"): "ON_LOAD",
    ("EMERGENCY", "REHEARSAL_OVER"): "ON_LOAD",
}


@pytest.mark.parametrize("phase", Phase, ids=lambda phase: phase.name)
@pytest.mark.parametrize("cause", PhaseCause, ids=lambda cause: cause.name)
def test_every_pair_of_phase_and_cause(phase: Phase, cause: PhaseCause) -> None:
    expected = EXPECTED.get((phase.name, cause.name))
    assert PHASES.get((phase, cause)) is (None if expected is None else Phase[expected])


def test_the_table_has_no_other_entries() -> None:
    assert len(PHASES) == len(EXPECTED) == 13


def test_no_emergency_on_the_ground() -> None:
    assert (Phase.ON_LOAD, PhaseCause.EMERGENCY) not in PHASES


@pytest.mark.parametrize("cause", [PhaseCause.DISARMED, PhaseCause.REHEARSAL_OVER], ids=lambda cause: cause.name)
def test_disarmed_ends_every_flight_and_every_rehearsal_has_an_end(cause: PhaseCause) -> None:
    ends = {PHASES[phase, cause] for phase in Phase if phase is not Phase.ON_LOAD}
    assert ends == {Phase.ON_LOAD}
