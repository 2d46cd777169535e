# SPDX-License-Identifier: GPL-3.0-or-later

"""Who gets authority without a transfer, and how it is lost."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    AutopilotState,
    Event,
    Fly,
    MissionLoaded,
    Record,
    Send,
    StationHeard,
    StationMessage,
    Tick,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, LeaseState
from tests.core.bench import (
    DIGEST,
    KEY,
    STATIONS,
    A,
    B,
    Bench,
    C,
    Connect,
    ConnectAck,
    DroneConnected,
    OnHandover,
    Phase,
    Reason,
    TransferKey,
    inside,
    not_records,
    outside,
)


class TestParent:
    """The parent becomes the commander on the ground, disarmed, once it has answered CONNECT."""

    def test_nobody_commands_at_first(self) -> None:
        assert Bench().arbiter.view == AuthorityView(Phase.ON_LOAD, None, None, 0, LeaseState.LOST, True, 0)

    def test_an_autopilot_that_has_said_nothing_counts_as_armed(self) -> None:
        bench = Bench()
        bench.autopilot = False
        bench.run(20.0)
        assert bench.arbiter.view.armed
        bench.autopilot_says(armed=False, flying=False)
        assert not bench.arbiter.view.armed

    def test_the_parent_takes_up_its_vehicle(self) -> None:
        bench = Bench()
        bench.run(0.0)
        view = AuthorityView(Phase.ON_LOAD, A, None, 1, LeaseState.HELD, False, 0)
        assert bench.arbiter.view == view
        nobody = AuthorityView(Phase.ON_LOAD, None, None, 0, LeaseState.LOST, False, 0)
        assert bench.views() == [ViewChanged(nobody, Reason.NONE), ViewChanged(view, Reason.PARENT_CONNECTED)]
        assert bench.records("authority") == [
            Record("authority", "GCSA commands, epoch 1", Reason.PARENT_CONNECTED, A),
        ]

    def test_another_station_does_not(self) -> None:
        bench = Bench()
        bench.alive = {B, C}
        bench.run(20.0)
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.view.epoch == 0

    def test_a_heartbeat_alone_is_not_enough(self) -> None:
        bench = Bench()
        bench.deaf = {A}
        bench.run(20.0)
        assert bench.arbiter.view.commander is None

    def test_not_before_the_autopilot_is_known_to_be_disarmed(self) -> None:
        bench = Bench()
        bench.autopilot = False
        bench.run(20.0)
        assert bench.arbiter.view.commander is None
        bench.autopilot = True
        bench.run(1.0)
        assert bench.arbiter.view.commander == A

    @pytest.mark.parametrize("flying", [False, True])
    def test_never_while_armed(self, flying: bool) -> None:
        bench = Bench()
        bench.armed, bench.flying = True, flying
        bench.run(20.0)
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.view.lease is LeaseState.LOST

    def test_never_on_the_word_of_an_autopilot_that_fell_silent(self) -> None:
        # disarmed when last heard; since then it may have been armed and flown off by RC
        bench = Bench()
        bench.alive = set()
        bench.run(1.0)
        bench.autopilot = False
        bench.run(3.0)
        bench.alive = {A}
        bench.run(10.0)
        assert bench.arbiter.connected(A, bench.now)
        assert bench.arbiter.view.commander is None
        bench.autopilot = True
        bench.run(1.0)
        assert bench.arbiter.view.commander == A

    def test_not_with_another_protocol_version(self) -> None:
        bench = Bench()
        bench.versions[A] = 2
        bench.run(10.0)
        assert bench.arbiter.view.commander is None

    def test_the_mission_package_may_come_later(self) -> None:
        bench = Bench()
        bench.digests[A] = b""
        bench.give(MissionLoaded(DIGEST, (A, B)))
        bench.run(1.0)
        assert bench.arbiter.view.commander == A

    def test_a_parent_that_comes_after_take_off_gets_nothing_until_the_aircraft_is_down(self) -> None:
        bench = Bench()
        bench.alive = {B}
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        bench.alive = {A, B}
        bench.run(60.0)
        assert bench.arbiter.view.commander is None
        bench.autopilot_says(armed=False, flying=False)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, A, None, 1, LeaseState.HELD, False, 0)

    def test_a_parent_that_is_no_station_is_our_own_fault(self) -> None:
        with pytest.raises(ValueError, match="parent 7 is not among the stations"):
            Arbiter(Identity("drone", STATIONS, 7))


class TestConnect:
    def test_stations_are_asked_once_a_second_with_a_new_nonce(self) -> None:
        bench = Bench(nonce=41)
        bench.alive = {A}
        bench.run(2.0)
        asked = [
            (at, action.station, action.message)
            for at, action in bench.log
            if isinstance(action, Send) and action.station == B and isinstance(action.message, Connect)
        ]
        assert [at for at, _station, _message in asked] == [100.0, 101.0, 102.0]
        assert asked[0][2] == Connect(B, 1, asked[0][2].nonce, 0, None, "drone", b"")
        assert asked[2][2] == Connect(B, 1, asked[2][2].nonce, 1, A, "drone", b"")
        assert len({message.nonce for _at, _station, message in asked}) == 3

    def test_nonces_wrap_and_are_never_zero(self) -> None:
        arbiter = Arbiter(Identity("drone", STATIONS, A, nonce=0xFFFFFFFE))
        nonces = [
            action.message.nonce
            for action in arbiter.handle(Tick(), 0.0)
            if isinstance(action, Send) and isinstance(action.message, Connect)
        ]
        assert nonces == [0xFFFFFFFF, 1, 2, 3]

    def test_a_station_that_is_heard_again_is_asked_at_once(self) -> None:
        bench = Bench()
        bench.run(0.25)
        actions = bench.give(StationHeard(C))
        asked = [action.station for action in actions if isinstance(action, Send)]
        assert asked == [C]

    @pytest.mark.parametrize(("version", "accepted"), [(1, True), (0, False), (2, False), (255, False)])
    def test_a_stations_own_connect_is_answered(self, version: int, accepted: bool) -> None:
        bench = Bench().on_ground()
        actions = bench.say(C, Connect(C, version, 77, 12345, C, "x", b""))
        assert not_records(actions)[0] == Send(C, ConnectAck(C, 1, 77, 1, A, "drone", DIGEST, accepted))

    def test_a_stations_own_connect_connects_nobody(self) -> None:
        bench = Bench()
        bench.alive = set()
        bench.run(1.0)
        bench.say(A, Connect(A, 1, 77, 0, None, "GCSA", b""))
        assert bench.arbiter.view.commander is None
        assert not bench.arbiter.connected(A, bench.now)

    @pytest.mark.parametrize("nonce", [0, 1, 998, 0xFFFFFFFF])
    def test_an_answer_to_nothing_connects_nobody(self, nonce: int) -> None:
        bench = Bench()
        bench.deaf = {A}
        bench.run(3.0)
        bench.say(A, ConnectAck(A, 1, nonce, 0, None, "GCSA", b""))
        assert bench.arbiter.view.commander is None

    def test_an_answer_to_another_stations_question_connects_nobody(self) -> None:
        bench = Bench()
        bench.alive, bench.deaf = {A, B}, {A, B}
        bench.run(0.0)
        asked_b = next(
            action.message
            for _at, action in reversed(bench.log)
            if isinstance(action, Send) and action.station == B and isinstance(action.message, Connect)
        )
        bench.say(A, ConnectAck(A, 1, asked_b.nonce, 0, None, "GCSA", b""))
        assert bench.arbiter.view.commander is None
        assert bench.dropped() == {"stale answer to CONNECT": 1}

    @pytest.mark.parametrize("round_trip_s", [0.9, 1.4, 3.0])
    def test_a_slow_link_connects(self, round_trip_s: float) -> None:
        arbiter = Arbiter(Identity("drone", STATIONS, A))
        on_its_way: list[tuple[float, Connect]] = []
        now = 0.0
        while now < 8.0:
            events: list[Event] = [AutopilotState(False, False), StationHeard(A)]
            events += [
                StationMessage(A, ConnectAck(A, 1, question.nonce, 0, None, "GCSA", b""))
                for at, question in on_its_way
                if at == now
            ]
            for event in events:
                for action in arbiter.handle(event, now):
                    if isinstance(action, Send) and isinstance(action.message, Connect) and action.station == A:
                        on_its_way.append((round(now + round_trip_s, 3), action.message))
            now = round(now + 0.1, 3)
        assert arbiter.view.commander == A
        assert arbiter.connected(A, now)

    def test_an_answer_that_comes_twice_over_two_links_is_counted_and_changes_nothing(self) -> None:
        bench = Bench().on_ground()
        bench.alive.remove(A)
        bench.run(1.0)
        answer = bench.ack(A, Connect(A, 1, 0, 1, A, "drone", DIGEST))
        last = bench.arbiter._presence[A].answer
        assert last is not None
        before = bench.arbiter.view
        bench.say(A, replace(answer, nonce=last.nonce))
        assert bench.arbiter.view == before
        assert bench.dropped() == {"doubled answer to CONNECT": 1}

    @pytest.mark.parametrize("epoch", [0, 7, 0xFFFFFFFF])
    def test_no_answer_moves_the_epoch(self, epoch: int) -> None:
        bench = Bench().on_mission()
        for commander in (None, B, C):
            bench.say(B, ConnectAck(B, 1, 0, epoch, commander, "GCSB", DIGEST))
        assert bench.arbiter.view.epoch == 1
        assert bench.arbiter.view.commander == A

    def test_an_unknown_station_is_counted_and_gets_no_answer(self) -> None:
        bench = Bench().on_ground()
        assert bench.give(StationHeard(99)) == []
        assert bench.say(99, Connect(99, 1, 5, 0, None, "x", b"")) == []
        assert bench.dropped() == {"unknown station": 2}


class TestLoss:
    """A silent commander has no authority; only itself can take it up again, with a new epoch."""

    def test_lost_in_flight(self) -> None:
        bench = Bench().on_mission()
        heard_at = bench.now
        bench.alive = {B}
        bench.log.clear()
        bench.run(4.75)
        assert bench.arbiter.view.commander == A
        bench.run(10.0)
        lost = AuthorityView(Phase.ON_MISSION, None, None, 1, LeaseState.LOST, True, 0)
        assert bench.views() == [
            ViewChanged(lost, Reason.COMMANDER_LOST),
            ViewChanged(replace(lost, phase=Phase.EMERGENCY), Reason.COMMANDER_LOST),
        ]
        assert {at for at, action in bench.log if isinstance(action, (ViewChanged, Fly))} == {heard_at + 5.0}
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]

    def test_who_was_lost_is_journalled(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(5.0)
        assert bench.records("authority_lost") == [
            Record("authority_lost", "GCSA is lost: no station commands", Reason.COMMANDER_LOST, A)
        ]

    def test_the_return_is_asked_for_once(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(120.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]

    def test_the_partner_does_not_inherit_without_its_word(self) -> None:
        # it is asked, by force, again and again, and does not answer: nobody commands, and the aircraft is turned home
        # once, not again after every attempt
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(8.0)
        bench.position(outside(A), inside(B))
        bench.run(30.0)
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.view.epoch == 1
        assert len(bench.records("transfer_aborted")) > 3
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]
        assert bench.records("emergency_over") == []

    @pytest.mark.parametrize("how", ["heartbeat", "message"])
    def test_back_with_a_new_epoch(self, how: str) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(20.0)
        bench.log.clear()
        bench.alive = {A, B}
        if how == "heartbeat":
            bench.give(StationHeard(A))
        else:
            bench.say(A, Connect(A, 1, 5, 1, A, "GCSA", DIGEST))
        held = AuthorityView(Phase.EMERGENCY, A, None, 2, LeaseState.HELD, True, 0)
        assert bench.views() == [
            ViewChanged(held, Reason.COMMANDER_RETURNED),
            ViewChanged(replace(held, phase=Phase.ON_MISSION), Reason.NONE),
        ]
        # nothing is commanded: the aircraft flies home until the commander says otherwise
        assert bench.flights() == []

    def test_each_loss_is_an_emergency_of_its_own(self) -> None:
        bench = Bench().on_mission()
        for back_s in (10.0, 45.0, 120.0):  # after each loss but the first it has to answer well for longer
            bench.alive = {B}
            bench.run(10.0)
            bench.alive = {A, B}
            bench.run(back_s)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 4, LeaseState.HELD, True, 0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)] * 3

    def test_a_heartbeat_in_time_is_no_loss(self) -> None:
        bench = Bench(Limits(deaf_lost_s=60.0)).on_mission()
        bench.alive = {B}
        for _ in range(10):
            bench.run(4.75)
            bench.give(StationHeard(A))
        assert bench.arbiter.view.epoch == 1
        assert bench.flights() == []

    def test_lost_even_if_no_tick_said_so_in_time(self) -> None:
        # the companion was held up: what comes first afterwards is a heartbeat, but authority had run out by then
        bench = Bench().on_mission()
        bench.now += 5.0
        bench.log.clear()
        bench.give(StationHeard(A))
        assert [(view.view.commander, view.view.epoch) for view in bench.views()] == [(None, 1), (A, 2)]

    def test_lost_on_the_ground_is_said_and_not_flown(self) -> None:
        bench = Bench().on_ground()
        bench.alive = set()
        bench.log.clear()
        bench.run(30.0)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, None, None, 1, LeaseState.LOST, False, 0)
        assert bench.flights() == []
        assert [record.text for record in bench.records("warning")] == ["commander lost: warn"]

    def test_back_on_the_ground(self) -> None:
        bench = Bench().on_ground()
        bench.alive = {B}
        bench.run(30.0)
        bench.alive = {A, B}
        bench.run(1.0)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, A, None, 2, LeaseState.HELD, False, 0)

    def test_the_policy_may_be_to_land_or_to_warn(self) -> None:
        for policy, flights in (
            ("land", [Fly(FlightAction.LAND, Reason.COMMANDER_LOST)]),
            ("warn", []),
        ):
            bench = Bench(Limits(policies={Cause.COMMANDER_LOST: policy})).on_mission()
            bench.alive = {B}
            bench.run(20.0)
            assert bench.flights() == flights
            assert bench.arbiter.view.commander is None
            assert bench.arbiter.view.lease is LeaseState.LOST

    def test_after_a_commit_the_new_commander_is_the_one_that_is_watched(self) -> None:
        bench = Bench().commit()
        bench.alive = {B}
        bench.run(30.0)
        assert bench.arbiter.view.commander == B
        bench.alive = {A}
        bench.run(5.0)
        assert bench.arbiter.view.commander is None
        bench.run(30.0)  # the former commander is there all the time, and without a word of its own gets nothing
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.view.epoch == 2


class TestSuccessor:
    """The commander is lost in flight: a ready station whose zone holds the aircraft takes it, without asking."""

    @staticmethod
    def take(bench: Bench, key: TransferKey) -> None:
        bench.say(key.to_station, OnHandover(key))
        bench.say(key.to_station, DroneConnected(key))

    def test_in_the_region_the_aircraft_does_not_turn_home(self) -> None:
        bench = Bench().on_mission()
        bench.position(inside(A), inside(B, margin_m=4.0))
        bench.alive = {B}
        bench.run(4.75)
        bench.position(inside(A), inside(B))  # entered just before the loss: the commander is being asked
        bench.say(B, OnHandover(KEY))
        bench.run(0.25)
        assert bench.arbiter.view.commander is None
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, B, None, 2, LeaseState.HELD, True, 1)
        assert [(old, new) for _at, old, new, _epoch in bench.watch.moves] == [(None, A), (A, None), (None, B)]
        assert bench.flights() == []

    def test_on_the_way_home(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(8.0)
        bench.position(outside(A), inside(B))
        self.take(bench, KEY)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, B, None, 2, LeaseState.HELD, True, 1)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]

    def test_the_former_commander_gets_nothing_when_it_comes_back(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(8.0)
        bench.position(outside(A), inside(B))
        self.take(bench, KEY)
        bench.alive = {A, B}
        bench.run(10.0)
        assert bench.arbiter.view.commander == B
        assert bench.arbiter.view.epoch == 2

    def test_a_commander_that_comes_back_in_time_keeps_it(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(8.0)
        bench.position(outside(A), inside(B))
        bench.say(B, OnHandover(KEY))
        bench.back(A)
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 2
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view.commander == A

    def test_not_on_the_ground(self) -> None:
        bench = Bench().on_ground()
        bench.position(inside(A), inside(B))
        bench.alive = {B}
        bench.run(20.0)
        assert bench.sent() == []

    def test_an_unfit_station_is_not_asked(self) -> None:
        bench = Bench().on_mission()
        bench.digests[B] = b""
        bench.alive = {B}
        bench.run(8.0)
        bench.position(outside(A), inside(B))
        bench.run(10.0)
        assert bench.sent() == []

    def test_on_the_ground_the_parent_takes_over_from_a_lost_commander(self) -> None:
        bench = Bench().commit()
        bench.autopilot_says(armed=False, flying=False)
        bench.alive = {A}
        bench.run(20.0)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, A, None, 3, LeaseState.HELD, False, 1)


class TestFlightWithoutCommander:
    def test_the_aircraft_is_brought_home_once(self) -> None:
        bench = Bench()
        bench.alive = set()
        bench.autopilot_says(armed=True, flying=True)
        bench.run(60.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]
        assert bench.arbiter.view.phase is Phase.EMERGENCY

    def test_airborne_without_start_is_a_mission(self) -> None:
        bench = Bench().on_ground()
        bench.autopilot_says(armed=True, flying=False)
        assert bench.arbiter.view.phase is Phase.ON_LOAD
        bench.autopilot_says(armed=True, flying=True)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 1, LeaseState.HELD, True, 0)
        assert bench.flights() == []


class TestLanding:
    def test_disarmed_ends_the_flight(self) -> None:
        bench = Bench().on_mission()
        bench.autopilot_says(armed=True, flying=False)
        assert bench.arbiter.view.phase is Phase.ON_MISSION
        bench.log.clear()
        bench.autopilot_says(armed=False, flying=False)
        assert bench.views() == [
            ViewChanged(AuthorityView(Phase.ON_LOAD, A, None, 1, LeaseState.HELD, False, 0), Reason.LANDED)
        ]

    def test_whoever_commands_at_the_landing_keeps_it(self) -> None:
        bench = Bench().commit()
        bench.autopilot_says(armed=False, flying=False)
        bench.run(30.0)
        assert bench.arbiter.view.commander == B
        assert bench.arbiter.view.epoch == 2

    def test_landed_in_an_emergency(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(10.0)
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        bench.autopilot_says(armed=False, flying=False)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, None, None, 1, LeaseState.LOST, False, 0)
        bench.run(30.0)
        assert len(bench.flights()) == 1
        assert [record.text for record in bench.records("emergency")] == ["commander lost: return"]
        assert bench.records("emergency_over") == []

    def test_what_was_lost_in_the_air_and_comes_back_on_the_ground_is_told_as_over(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(10.0)
        bench.autopilot_says(armed=False, flying=False)
        bench.run(10.0)
        bench.alive = {A, B}
        bench.run(10.0)
        assert [record.text for record in bench.records("emergency")] == ["commander lost: return"]
        assert len(bench.records("emergency_over")) == 1

    def test_the_next_flight_has_its_own_emergencies(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(10.0)
        bench.autopilot_says(armed=False, flying=False)
        bench.alive = {A, B}
        bench.run(2.0)
        bench.autopilot_says(armed=True, flying=True)
        bench.run(2.0)
        bench.alive = {B}
        bench.run(10.0)
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)] * 2


class TestLooking:
    """What consoles and reports ask for: never an error, whoever is asked about."""

    def test_how_long_ago_a_station_was_heard(self) -> None:
        bench = Bench().on_ground()
        bench.alive = set()
        bench.give(StationHeard(A))
        heard_at = bench.now
        bench.run(2.25)
        assert bench.arbiter.heard_ago_s(A, heard_at + 2.25) == 2.25
        assert bench.arbiter.heard_ago_s(C, bench.now) is None

    def test_a_station_that_is_not_known_is_not_connected(self) -> None:
        bench = Bench().on_ground()
        assert bench.arbiter.connected(A, bench.now)
        assert not bench.arbiter.connected(99, bench.now)
        assert not bench.arbiter.connected(0, bench.now)

    def test_everybody_has_a_name(self) -> None:
        names = [Bench().arbiter.name(sysid) for sysid in (A, C, 99, 0, None)]
        assert names == ["GCSA", "GCSC", "station 99", "no station", "no station"]
