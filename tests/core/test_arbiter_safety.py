# SPDX-License-Identifier: GPL-3.0-or-later

"""Out of coverage, warnings on the ground that follow the aircraft into the air, stale positions, the guard."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import Fly, GuardSeen, Record, StartFinished, StartRequested, ViewChanged
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, GuardState, LeaseState
from tests.core.bench import (
    A,
    B,
    Bench,
    C,
    ConnectHandover,
    D,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    OkHandover,
    OnHandover,
    Phase,
    Reason,
    TransferKey,
    far,
    inside,
    outside,
)

RETURN = Fly(FlightAction.RETURN, Reason.OUT_OF_COVERAGE)
LOST = Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)


class TestOutOfCoverage:
    def test_out_for_one_second_returns_once(self) -> None:
        bench = Bench().on_mission()
        left_at = bench.now
        bench.log.clear()
        bench.position(*far(A, B, C, D))
        bench.run(60.0)
        assert [(at, action) for at, action in bench.log if isinstance(action, Fly)] == [(left_at + 1.0, RETURN)]
        # the commander still commands: it may fly the aircraft elsewhere
        assert bench.arbiter.view == AuthorityView(Phase.EMERGENCY, A, None, 1, LeaseState.HELD, True, 0)

    def test_back_within_the_hold_time_is_nothing(self) -> None:
        bench = Bench().on_mission()
        for _ in range(5):
            bench.position(*far(A, B))
            bench.run(0.75)
            bench.position(inside(A), outside(B))
            bench.run(3.0)
        assert bench.flights() == []
        assert bench.records("emergency") == []

    def test_back_in_the_zone_the_emergency_is_over(self) -> None:
        bench = Bench().on_mission()
        bench.position(*far(A, B))
        bench.run(5.0)
        bench.log.clear()
        bench.position(inside(A), outside(B))
        assert bench.views() == [
            ViewChanged(AuthorityView(Phase.ON_MISSION, A, None, 1, LeaseState.HELD, True, 0), Reason.NONE)
        ]
        assert bench.flights() == []
        bench.position(*far(A, B))
        bench.run(5.0)
        assert bench.flights() == [RETURN]

    def test_the_way_home_may_lead_through_another_zone(self) -> None:
        bench = Bench().on_mission()
        bench.position(*far(A, B))
        bench.run(5.0)
        bench.position(outside(A), inside(B))
        bench.run(0.5)
        assert bench.arbiter.view.partner == B

    def test_on_the_ground_it_is_a_warning(self) -> None:
        bench = Bench().on_ground()
        bench.log.clear()
        bench.position(*far(A, B))
        bench.run(60.0)
        assert bench.flights() == []
        assert bench.arbiter.view.phase is Phase.ON_LOAD
        assert [record.text for record in bench.records("warning")] == ["out of coverage: warn"]

    def test_it_ends_a_transfer(self) -> None:
        # out of the commander's zone, and the partner's margin is in the band where it is not left yet
        bench = Bench().in_transfer()
        bench.position(outside(A), inside(B, margin_m=-4.0))
        bench.run(0.5)
        assert bench.arbiter.view.partner == B
        bench.position(*far(A, B))
        assert bench.arbiter.view.partner is None
        assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.LEFT_REGION]
        bench.run(2.0)
        assert bench.flights() == [RETURN]

    def test_it_ends_one_to_a_station_whose_zone_was_never_entered_too(self) -> None:
        # given on the ground, where no zone is asked for, and not taken yet when the aircraft takes off
        bench = Bench().on_ground()
        bench.position(*far(A, B))
        bench.run(5.0)
        bench.give(bench.request(A, give_to=B))
        assert bench.arbiter.view.partner == B
        bench.autopilot_says(armed=True, flying=True)
        assert bench.arbiter.view == AuthorityView(Phase.EMERGENCY, A, None, 1, LeaseState.HELD, True, 1)
        assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.LEFT_REGION]
        assert bench.flights() == [RETURN]

    def test_one_that_begins_as_a_zone_is_entered_again_outlives_it(self) -> None:
        # the loss of the commander is no more than a warning here, so what it flies home for is over in the next zone
        bench = Bench(Limits(policies={Cause.COMMANDER_LOST: "warn"})).on_mission()
        bench.alive = {B}
        bench.position(*far(A, B))
        bench.run(6.0)
        assert bench.arbiter.view == AuthorityView(Phase.EMERGENCY, None, None, 1, LeaseState.LOST, True, 0)
        bench.position(outside(A), inside(B))
        assert bench.arbiter.view == AuthorityView(
            Phase.ON_HANDOVER, None, B, 1, LeaseState.LOST, True, 1, why=Reason.COMMANDER_LOST
        )
        assert len(bench.records("emergency_over")) == 1
        bench.say(B, OnHandover(TransferKey(A, B, 1, 1)))
        bench.say(B, DroneConnected(TransferKey(A, B, 1, 1)))
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, B, None, 2, LeaseState.HELD, True, 1)
        assert bench.flights() == [RETURN]

    def test_the_policy_may_be_to_land_or_to_warn(self) -> None:
        for policy, flights in (
            ("land", [Fly(FlightAction.LAND, Reason.OUT_OF_COVERAGE)]),
            ("warn", []),
        ):
            bench = Bench(Limits(policies={Cause.OUT_OF_COVERAGE: policy})).on_mission()
            bench.position(*far(A, B))
            bench.run(20.0)
            assert bench.flights() == flights
            assert bench.arbiter.view.phase is (Phase.EMERGENCY if flights else Phase.ON_MISSION)

    def test_without_any_zone_known_there_is_no_out(self) -> None:
        bench = Bench().on_mission()
        bench.position()
        bench.run(20.0)
        assert bench.flights() == []


class TestWorse:
    """A decision is carried out once for each emergency, and again where it turns worse."""

    def test_a_warning_on_the_ground_takes_off(self) -> None:
        # START was accepted, the vehicle is armed, then the commander dies: no station commands the take-off
        bench = Bench().on_ground()
        bench.give(StartRequested(A))
        bench.autopilot_says(armed=True, flying=False)
        bench.alive = {B}
        bench.run(6.0)
        assert bench.flights() == []
        assert [record.text for record in bench.records("warning")] == ["commander lost: warn"]
        bench.autopilot_says(armed=True, flying=True)
        assert bench.flights() == [LOST]
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        bench.run(30.0)
        assert bench.flights() == [LOST]

    def test_taking_off_outside_every_zone(self) -> None:
        bench = Bench().on_ground()
        bench.position(*far(A, B))
        bench.run(5.0)
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        assert bench.flights() == [RETURN]

    def test_an_emergency_during_start_ends_the_start(self) -> None:
        bench = Bench().on_ground()
        bench.give(StartRequested(A))
        bench.autopilot_says(armed=True, flying=False)
        bench.alive = {B}
        bench.run(6.0)
        bench.autopilot_says(armed=True, flying=True)
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        # the edge has dropped the sequence and reports no end of it; after the landing START is possible again
        bench.autopilot_says(armed=False, flying=False)
        bench.alive = {A, B}
        bench.run(2.0)
        assert bench.arbiter.start_needs(A, bench.now) == ()

    def test_the_end_of_a_start_that_an_emergency_has_overtaken_means_nothing(self) -> None:
        bench = Bench().on_ground()
        bench.give(StartRequested(A))
        bench.autopilot_says(armed=True, flying=True)
        bench.position(*far(A, B))
        bench.run(2.0)
        assert bench.flights() == [RETURN]
        bench.give(StartFinished(ok=True))
        assert bench.arbiter.view.phase is Phase.EMERGENCY

    def test_a_second_flight_in_the_same_emergency_is_brought_home_too(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(10.0)
        bench.autopilot_says(armed=False, flying=False)
        bench.run(10.0)
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        assert bench.flights() == [LOST, LOST]

    def test_a_bump_on_landing_does_not_command_again(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(10.0)
        for flying in (False, True, False, True, False):
            bench.autopilot_says(armed=True, flying=flying)
        assert bench.flights() == [LOST]

    def test_out_of_coverage_lands_after_the_loss_only_warned(self) -> None:
        limits = Limits(policies={Cause.COMMANDER_LOST: "warn", Cause.OUT_OF_COVERAGE: "land"})
        bench = Bench(limits).on_mission()
        bench.alive = {B}
        bench.run(10.0)
        assert bench.flights() == []
        left_at = bench.now
        bench.position(*far(A, B))
        bench.run(0.75)
        assert bench.flights() == []
        bench.run(5.0)
        assert [(at, action) for at, action in bench.log if isinstance(action, Fly)] == [
            (left_at + 1.0, Fly(FlightAction.LAND, Reason.OUT_OF_COVERAGE))
        ]

    def test_loss_of_the_commander_while_out_of_coverage_is_asked_for_too(self) -> None:
        # the commander may have stopped the first return; now there is nobody to decide
        bench = Bench().on_mission()
        bench.position(*far(A, B))
        bench.run(5.0)
        bench.alive = {B}
        bench.run(10.0)
        assert bench.flights() == [RETURN, LOST]


class TestPosition:
    def test_stale_is_said_once(self) -> None:
        bench = Bench().on_mission()
        seen_at = bench.now
        bench.facts = None
        bench.log.clear()
        bench.run(30.0)
        assert [at for at, action in bench.log if getattr(action, "event", "") == "position_stale"] == [seen_at + 2.0]
        bench.position(inside(A), outside(B))
        bench.facts = None
        bench.run(30.0)
        assert len(bench.records("position_stale")) == 2

    def test_on_the_ground_it_is_not_said(self) -> None:
        bench = Bench().on_ground()
        bench.facts = None
        bench.run(30.0)
        assert bench.records("position_stale") == []

    def test_an_autopilot_that_was_not_heard_at_all_is_not_landed_when_it_is_back(self) -> None:
        """Its heartbeat comes through first, its position follows. A flight of the campaign was landed there."""
        bench = Bench(Limits(policies={Cause.POSITION_STALE: "land"})).on_mission()
        bench.autopilot, facts, bench.facts = False, bench.facts, None
        bench.run(20.0)
        bench.autopilot_says(armed=True, flying=True)
        bench.autopilot = True
        bench.run(0.4)
        bench.facts = facts
        bench.run(10.0)
        assert bench.flights() == []
        assert [record.reason for record in bench.records("warning")] == [Reason.AUTOPILOT_LOST]

    @pytest.mark.parametrize("silent_s", [3.2, 4.0, 6.0])
    def test_nor_after_a_short_silence(self, silent_s: float) -> None:
        bench = Bench(Limits(policies={Cause.POSITION_STALE: "land"})).on_mission()
        bench.autopilot, facts, bench.facts = False, bench.facts, None
        bench.run(silent_s)
        bench.autopilot_says(armed=True, flying=True)
        bench.autopilot = True
        bench.run(0.4)
        bench.facts = facts
        bench.run(10.0)
        assert bench.flights() == []

    def test_an_autopilot_that_is_back_without_a_position_is_landed(self) -> None:
        bench = Bench(Limits(policies={Cause.POSITION_STALE: "land"})).on_mission()
        bench.autopilot, bench.facts = False, None
        bench.run(20.0)
        back_at = bench.now
        bench.autopilot_says(armed=True, flying=True)
        bench.autopilot = True
        bench.run(10.0)
        assert [(at, action.action) for at, action in bench.log if isinstance(action, Fly)] == [
            (back_at + 1.0, FlightAction.LAND)
        ]

    def test_no_transfer_without_a_position(self) -> None:
        # B's zone was entered while B was silent; B comes back when there is no position any more
        bench = Bench().on_mission()
        bench.alive = {A}
        bench.run(10.0)
        bench.position(inside(A), inside(B))
        bench.facts = None
        bench.alive = {A, B}
        bench.run(30.0)
        assert bench.arbiter.view.partner is None


class TestRoute:
    def test_of_two_zones_entered_at_once_the_route_decides_after_each_change(self) -> None:
        bench = Bench(route=(A, C, B, C))
        bench.alive = {A, B, C}
        bench.on_mission()
        bench.position(inside(A), inside(B), inside(C))
        assert bench.arbiter.view.partner == C
        key = TransferKey(A, C, 1, 1)
        for station, message in (
            (C, OnHandover(key)),
            (A, OkHandover(key)),
            (C, DroneConnected(key)),
            (A, DisconnectHandover(key)),
        ):
            bench.say(station, message)
        assert bench.arbiter.view.commander == C
        bench.position(*far(A, B), inside(C))
        bench.run(10.0)
        # A and B are entered together; A has the lower number, B is next on the route
        bench.position(inside(A), inside(B), inside(C))
        assert bench.arbiter.view.partner == B

    def test_the_route_starts_again_with_the_next_flight(self) -> None:
        bench = Bench(route=(A, C, A, B))
        bench.alive = {A, B, C}
        bench.on_mission()
        for number, (old, new) in enumerate(((A, C), (C, A)), start=1):
            bench.position(*far(new, B), inside(old))
            bench.position(outside(B), inside(old), inside(new))
            key = TransferKey(old, new, number, number)
            for station, message in (
                (new, OnHandover(key)),
                (old, OkHandover(key)),
                (new, DroneConnected(key)),
                (old, DisconnectHandover(key)),
            ):
                bench.say(station, message)
            bench.run(10.0)
        assert bench.arbiter.view.commander == A
        bench.position(inside(A), *far(B, C))
        bench.autopilot_says(armed=False, flying=False)
        bench.run(5.0)
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        bench.position(inside(A), inside(B), inside(C))
        assert bench.arbiter.view.partner == C


class TestZones:
    def test_entries_on_the_ground_do_not_count(self) -> None:
        bench = Bench().on_ground()
        bench.position(inside(A), inside(B))
        bench.autopilot_says(armed=True, flying=True)
        bench.run(30.0)
        assert bench.sent() == []

    def test_a_first_position_in_the_air_is_no_entry(self) -> None:
        # no fix before take-off: where the aircraft is found then it may have been all along
        bench = Bench()
        bench.facts = None
        bench.on_ground()
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        bench.position(inside(A), inside(B))
        bench.run(10.0)
        assert bench.sent() == []
        bench.position(inside(A), outside(B))
        bench.position(inside(A), inside(B))
        assert bench.arbiter.view.partner == B

    def test_but_the_end_of_the_commanders_zone_does(self) -> None:
        bench = Bench().on_ground()
        bench.position(inside(A), inside(B))
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        bench.position(inside(A, exit_s=7.0), inside(B))
        assert [word[2] for word in bench.sent()] == [HandoverRequest(TransferKey(A, B, 1, 1), Reason.ZONE_ENDS)]

    def test_a_zone_that_was_entered_without_a_commander_calls_by_force(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(6.0)
        assert bench.sent() == []
        bench.position(outside(A), inside(B))
        request = HandoverRequest(TransferKey(A, B, 1, 1), Reason.COMMANDER_LOST)
        assert [word[1:3] for word in bench.sent()] == [(B, request)]
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.view.lease is LeaseState.LOST

    def test_zones_of_a_mission_that_was_replaced_do_not_call(self) -> None:
        # on the ground inside A and B; then a mission with A and C alone is loaded
        bench = Bench().on_ground()
        bench.position(inside(A), inside(B))
        bench.position(inside(A), outside(C))
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        bench.position(inside(A, exit_s=3.0), outside(C))
        bench.run(5.0)
        assert bench.sent() == []
        assert bench.arbiter.view.commander == A

    def test_what_is_entered_and_left_is_journalled(self) -> None:
        bench = Bench().on_mission()
        bench.log.clear()
        bench.position(outside(A), inside(B), outside(C))
        bench.position(outside(A), inside(B), inside(C))
        told = [(a.event, a.text, a.station) for _at, a in bench.log if isinstance(a, Record) and "zone" in a.event]
        assert told == [
            ("zone_entered", "zone of GCSB entered", B),
            ("zone_left", "zone of GCSA left", A),
            ("zone_entered", "zone of GCSC entered", C),
        ]

    def test_the_zone_shown_is_the_commanders_first(self) -> None:
        bench = Bench().on_mission()
        assert bench.arbiter.zone() == A
        bench.position(inside(A), inside(B))
        assert bench.arbiter.zone() == A
        bench.position(outside(A), inside(B))
        assert bench.arbiter.zone() == B
        bench.position(*far(A, B))
        assert bench.arbiter.zone() == 0


class TestGuard:
    def test_what_it_says_counts_for_two_seconds(self) -> None:
        bench = Bench().on_ground()
        bench.guard = None
        bench.give(GuardSeen(GuardState.LIVE, ours=True))
        heard_at = bench.now
        assert bench.arbiter.guard(heard_at + 1.999) is GuardState.LIVE
        assert bench.arbiter.guard(heard_at + 2.0) is GuardState.SILENT

    @pytest.mark.parametrize("state", [GuardState.EXPIRED, GuardState.LOST, GuardState.WAITING, GuardState.DISABLED])
    def test_its_changes_are_told_once(self, state: GuardState) -> None:
        bench = Bench().on_ground()
        bench.log.clear()
        bench.guard = GuardSeen(state, ours=True)
        bench.run(5.0)
        assert [record.text for record in bench.records("guard")] == [f"guard: live -> {state.name.lower()}"]


def test_a_message_for_connect_handover_of_a_station_means_nothing() -> None:
    bench = Bench().in_transfer()
    bench.log.clear()
    bench.say(B, ConnectHandover(TransferKey(A, B, 1, 1)))
    assert bench.sent() == []
    assert bench.dropped() == {"not the sender's to say": 1}
