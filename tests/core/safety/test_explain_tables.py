# SPDX-License-Identifier: GPL-3.0-or-later

"""What is said of the tables of decisions."""

from __future__ import annotations

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.safety.explain import story, table
from mavproxy_handover.core.safety.strategy import Fact

ALOFT = frozenset({Fact.FLYING, Fact.AUTOPILOT, Fact.PLACE})


def test_a_cause_that_lasts_as_long_as_the_flight_has_no_clearing_time() -> None:
    ends = {row[0]: row[3] for row in table(Limits(clear_s={Cause.ENERGY: 5.0, Cause.FENCE: 5.0}))}
    assert ends[Cause.FENCE.value] == "gone for 5 s"
    assert "5" not in ends[Cause.ENERGY.value]


def test_of_a_cause_that_is_off_nothing_is_said_unless_it_is_asked_for() -> None:
    limits = Limits(policies={Cause.GUARD_LOST: "off"})
    assert story(set(), ALOFT, limits) == ["decision: none, nothing is wrong"]
    assert story({Cause.GUARD_LOST}, ALOFT, limits)[0] == f"{Cause.GUARD_LOST.value}: off, not looked at"
