# SPDX-License-Identifier: GPL-3.0-or-later

"""A return or a landing that was just ordered does not show yet: the autopilot says its mode once a second. In that
time nothing milder may take its place.

The fault, flight 5008 of the campaign: a landing was ordered for a lost commander. A third of a second later another
station had the aircraft, so that cause was gone; the return of a milder cause was still wanted, and replaced the
landing.
"""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import ConditionsSeen, Fly, ModeSeen, ModeSourceSeen, MotionSeen, OrderRefused
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import FlightAction, ModeClass, ModeSource, Phase, Reason
from mavproxy_handover.vehicle.profiles import COPTER, PROFILES, Profile
from tests.core.bench import A, B, Bench, Consent, DroneConnected, OnHandover, TransferKey, inside, outside
from tests.core.safety.test_conditions import ends
from tests.core.safety.test_decision_executor import HOLD, HOMEWARD, LAND, RTL, aloft

RETURN = FlightAction.RETURN
LANDS = Limits(policies={Cause.COMMANDER_LOST: "land"})
OBEY_S = Limits().obey_s


def actions(bench: Bench) -> list[FlightAction]:
    return [fly.action for fly in bench.flights()]


def ordered(bench: Bench, action: FlightAction) -> Bench:
    """The commander falls silent until this is ordered, and the autopilot has not said a mode since."""
    bench.alive -= {A}
    while action not in actions(bench):
        bench.run(0.1)
    return bench


def returned(bench: Bench) -> Bench:
    """The commander is back at once: what was ordered for its loss has no cause any more."""
    bench.back(A)
    assert bench.arbiter.view.commander == A
    return bench


def short_of_energy(*others: int) -> Bench:
    """A return was just ordered for its energy, and its commander is about to be lost; for that it lands."""
    bench = aloft(LANDS)
    bench.alive = {A, *others}
    bench.facts = (inside(A), inside(B))
    bench.run(3.0)
    bench.alive = {*others}
    bench.run(2.5)
    bench.give(ConditionsSeen(energy=True))
    while RETURN not in actions(bench):
        bench.run(0.1)
    assert bench.arbiter.view.commander == A
    return bench


def test_a_landing_is_not_replaced_by_the_return_of_another_cause() -> None:
    bench = returned(ordered(short_of_energy(), FlightAction.LAND))
    assert actions(bench) == [RETURN, FlightAction.LAND]
    bench.mode, bench.motion = LAND, MotionSeen(0.0, -1.0)
    bench.run(60.0)
    assert actions(bench) == [RETURN, FlightAction.LAND]


def taken_from_a_lost_commander(bench: Bench) -> Bench:
    """GCSA is lost, GCSB's operator is asked, so an order is given at once; a moment later GCSB has the aircraft."""
    bench.alive = {B}
    while bench.arbiter.view.commander is not None:
        bench.run(0.1)
    view = bench.arbiter.view
    assert view.partner == B
    key = TransferKey(A, B, view.handover_id, view.epoch)
    for _copy in range(2):  # the first may answer the planned question
        bench.say(B, OnHandover(key, Consent.WAITING))
        bench.run(0.1)
    bench.say(B, OnHandover(key))
    bench.say(B, DroneConnected(key))
    assert bench.arbiter.view.commander == B
    return bench


def test_nor_when_a_forced_transfer_has_just_committed() -> None:
    bench = taken_from_a_lost_commander(short_of_energy(B))
    assert actions(bench) == [RETURN, FlightAction.LAND]
    bench.mode, bench.motion = LAND, MotionSeen(0.0, -1.0)
    bench.run(60.0)
    assert actions(bench) == [RETURN, FlightAction.LAND]


def test_a_landing_that_never_shows_is_replaced_when_its_time_is_over() -> None:
    """The autopilot did not get it, and its cause is gone: what is wrong still asks for a return."""
    bench = returned(ordered(short_of_energy(), FlightAction.LAND))
    bench.mode = ModeSeen(ModeClass.GUIDED, "GUIDED")
    bench.run(OBEY_S - 0.5)
    assert actions(bench) == [RETURN, FlightAction.LAND]
    bench.run(1.0)
    assert actions(bench) == [RETURN, FlightAction.LAND, RETURN]


def test_a_return_is_not_replaced_by_a_hold() -> None:
    bench = returned(ordered(aloft(), RETURN))
    bench.position(ends(4.0, A, B), outside(B))
    assert actions(bench) == [RETURN]
    bench.mode, bench.motion = RTL, HOMEWARD
    bench.run(30.0)
    assert actions(bench) == [RETURN]


def held(kind: Profile) -> Bench:
    """GCSA's zone ends ahead: it is held, and stands, or circles."""
    bench = aloft()
    bench.handling = kind.handling
    bench.run(1.0)
    bench.position(ends(4.0, A, B), outside(B))
    assert bench.flights() == [HOLD]
    if kind.holds_by_circling:
        bench.mode = ModeSeen(ModeClass.STOP, "LOITER")
    else:
        bench.motion = MotionSeen(0.0, 0.0, 300.0)
    bench.facts = (inside(A), inside(B))
    bench.run(3.0)
    return bench


@pytest.mark.parametrize("kind", PROFILES)
def test_a_return_out_of_a_hold_is_not_followed_by_an_order_to_go_on(kind: Profile) -> None:
    """What has wings goes on by AUTO: that would end the return."""
    bench = held(kind)
    bench.alive = {A, B}
    bench.run(1.0)
    taken_from_a_lost_commander(bench)
    assert actions(bench) == [FlightAction.HOLD, RETURN]
    assert bench.arbiter.view.phase is Phase.EMERGENCY
    bench.mode, bench.motion = RTL, HOMEWARD
    bench.run(30.0)
    assert actions(bench) == [FlightAction.HOLD, RETURN]
    assert bench.arbiter.view.phase is Phase.ON_MISSION


def test_what_was_held_and_did_not_return_goes_on_when_that_time_is_over() -> None:
    bench = held(COPTER)
    bench.alive = {A, B}
    bench.run(1.0)
    taken_from_a_lost_commander(bench)
    bench.run(OBEY_S - 0.5)
    assert actions(bench) == [FlightAction.HOLD, RETURN]
    bench.run(0.5)
    assert actions(bench) == [FlightAction.HOLD, RETURN, FlightAction.CONTINUE]


def test_an_emergency_whose_return_never_shows_is_over_when_that_time_is() -> None:
    bench = returned(ordered(aloft(), RETURN))
    at = bench.now
    while bench.arbiter.view.phase is Phase.EMERGENCY:
        bench.run(0.1)
    assert bench.now - at == pytest.approx(OBEY_S, abs=0.2)
    assert actions(bench) == [RETURN]


def test_a_return_that_is_refused_needs_no_more_time() -> None:
    bench = returned(ordered(aloft(), RETURN))
    bench.give(OrderRefused(RETURN))
    bench.run(0.5)
    assert bench.arbiter.view.phase is Phase.ON_MISSION


def test_the_commanders_word_ends_it_at_once() -> None:
    bench = returned(ordered(short_of_energy(), FlightAction.LAND))
    bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.GUIDED))
    bench.mode = ModeSeen(ModeClass.GUIDED, "GUIDED")
    bench.run(2.0)
    assert bench.arbiter._safety.verification.order is None
    bench.run(60.0)
    assert actions(bench) == [RETURN, FlightAction.LAND]


def test_something_as_grave_or_graver_is_ordered_at_once() -> None:
    bench = ordered(aloft(Limits(policies={Cause.GUARD_LOST: "land"}, hold_off_s={Cause.GUARD_LOST: 0.0})), RETURN)
    bench.guard = None
    bench.run(8.0)
    assert Fly(FlightAction.LAND, Reason.GUARD_LOST) in bench.flights()
    assert HOLD not in bench.flights()
