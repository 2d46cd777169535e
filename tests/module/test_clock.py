# SPDX-License-Identifier: GPL-3.0-or-later

"""The wall clock is set in flight (GPS time arrives, NTP steps): nothing changes but what the journal says of it."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.operator.stations import event_log
from mavproxy_handover.store import journal
from tests.module.conftest import Bench, Clock
from tests.module.test_handover import IN_BOTH, flight  # noqa: F401  (a fixture)

YEAR_S = 365 * 86400.0


@pytest.fixture
def wall(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock of the bench, asked by those, too, who ask for the time of day themselves."""
    for module in (journal, event_log):
        monkeypatch.setattr(module, "time", clock)
    return clock


@pytest.mark.parametrize("step_s", [YEAR_S, 3600.0, 1.1, -1.1, -3600.0, -YEAR_S])
def test_a_step_in_the_middle_of_a_handover_is_journalled_and_changes_nothing(
    wall: Clock,
    flight: Bench,  # noqa: F811
    step_s: float,
) -> None:
    flight.run(2.0)
    flight.autopilot.position = IN_BOTH
    flight.until(lambda: flight.companion.view.phase is Phase.ON_HANDOVER)
    wall.utc_offset_s += step_s
    flight.run(1.5)
    assert flight.companion.view.commander == 252
    (entry,) = flight.journal("clock_step")
    assert entry["text"] == f"the clock was set by {step_s:+.1f} s"
    (committed,) = flight.journal("transfer_committed")
    assert 0.0 <= committed["duration_s"] < 1.0
    assert flight.journal("authority_lost") == flight.journal("position_stale") == flight.journal("emergency") == []
    times = [entry["t"] for entry in flight.journal()]
    assert times == sorted(times)
    flight.run(10.0)
    assert len(flight.journal("clock_step")) == 1
    assert flight.companion.view.epoch == 2


def test_a_clock_that_is_slewed_is_not_told_of(wall: Clock, flight: Bench) -> None:  # noqa: F811
    for _ in range(10):
        wall.utc_offset_s += 0.5
        flight.run(1.0)
    assert flight.journal("clock_step") == []
