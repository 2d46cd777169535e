# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion dies in flight and comes back: the same commander once it is heard, one epoch on, nobody else."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.authority.transfer import Step
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import (
    Announce,
    AutopilotState,
    ConditionsSeen,
    ControlAnswer,
    ControlResult,
    Fly,
    MissionLoaded,
    ModeSeen,
    ModeSourceSeen,
    Record,
    Send,
    StationHeard,
    StationMessage,
    Tick,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, LeaseState, ModeClass, ModeSource
from mavproxy_handover.core.common.snapshot import Snapshot
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
    D,
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    Phase,
    Reason,
    TransferKey,
    far,
    inside,
    outside,
)

ROUTE = (A, B, A, B, A)
ALL_STEPS = [step.name for step in Step]
#: GCSA commanded in epoch 4 when the companion died; seven transfers had been tried, the route was at its third part
LEFT = Snapshot(A, 4, 7, Phase.ON_MISSION, 2, DIGEST, ROUTE)
WAITING = AuthorityView(Phase.ON_MISSION, None, None, 5, LeaseState.RECOVERING, True, 7)
RETURN = Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)


def started(snapshot: Snapshot, limits: Limits | None = None) -> Bench:
    """A companion that has just started from a snapshot; flying in the zones of GCSA and GCSB; nobody is heard yet."""
    bench = Bench(limits)
    bench.alive = set()
    bench.armed = bench.flying = True
    bench.facts = (inside(A), inside(B), outside(C), outside(D))
    return bench.restart(0.0, snapshot)


def announced(bench: Bench) -> list[str]:
    return [action.text for _at, action in bench.log if isinstance(action, Announce)]


class TestWaiting:
    def test_at_first_nobody_commands(self) -> None:
        assert started(LEFT).arbiter.view == WAITING

    def test_what_it_knows_of_the_flight_is_kept(self) -> None:
        arbiter = started(LEFT).arbiter
        assert arbiter.mission_digest == DIGEST
        assert arbiter.snapshot() == replace(LEFT, epoch=5, out_of_coverage="return")

    @pytest.mark.parametrize("how", ["heartbeat", "message"])
    def test_the_same_commander_once_it_is_heard(self, how: str) -> None:
        bench = started(LEFT)
        bench.run(0.25)
        bench.log.clear()
        bench.alive = {A}
        if how == "heartbeat":
            bench.give(StationHeard(A))
        else:
            bench.say(A, Connect(A, 1, 5, 4, A, "GCSA", DIGEST))
        held = AuthorityView(Phase.ON_MISSION, A, None, 5, LeaseState.HELD, True, 7)
        assert bench.views() == [ViewChanged(held, Reason.COMMANDER_RETURNED)]
        assert bench.records("authority") == [
            Record("authority", "GCSA commands on after the restart, epoch 5", Reason.COMMANDER_RETURNED, A)
        ]
        assert bench.flights() == []

    def test_what_is_locked_while_armed_stays_locked_until_the_autopilot_has_said_disarmed(self) -> None:
        bench = started(LEFT)
        bench.autopilot = False
        bench.alive = {A}
        bench.run(1.0)
        assert (bench.arbiter.view.commander, bench.arbiter.view.armed) == (A, True)
        bench.autopilot_says(armed=True, flying=True)
        assert bench.arbiter.view.armed
        bench.autopilot_says(armed=False, flying=False)
        assert not bench.arbiter.view.armed

    def test_nobody_else_whatever_it_says(self) -> None:
        bench = started(LEFT)
        bench.alive = {B, C}
        bench.run(1.0)
        keys = (TransferKey(A, B, 7, 4), TransferKey(A, B, 7, 5), TransferKey(A, B, 8, 5), KEY)
        words: list[Message] = [ConnectAck(B, 1, 0, 4, B, "GCSB", DIGEST)]
        words += [kind(key) for kind in (OnHandover, OkHandover, DroneConnected, DisconnectHandover) for key in keys]
        for station in (B, C):
            for word in words:
                bench.say(station, word)
            bench.give(bench.request(station, takeover=True))
            bench.give(bench.request(station, give_to=B))
        assert bench.arbiter.view == WAITING

    def test_a_request_is_answered_with_the_reason(self) -> None:
        # its heartbeat may be on the way: who asks first after the restart must not profit from it
        bench = started(LEFT)
        bench.alive = {B}
        bench.run(1.0)
        (answer,) = [a for a in bench.give(bench.request(B)) if isinstance(a, ControlAnswer)]
        assert answer == ControlAnswer(B, ControlResult.DENIED, "the commander may come back after the restart")

    def test_no_zone_calls(self) -> None:
        bench = started(LEFT)
        bench.alive = {B}
        bench.run(1.0)
        bench.position(outside(A), inside(B))
        bench.run(1.0)
        assert bench.sent() == []

    def test_it_flies_on_meanwhile(self) -> None:
        bench = started(LEFT)
        bench.run(2.4)
        assert bench.flights() == []
        assert bench.records("emergency") == []

    def test_every_station_is_asked_five_times_a_second_until_the_commander_is_there(self) -> None:
        # with a fifth of all frames lost, one heartbeat and one question a second take longer than the guard waits
        bench = started(LEFT)
        begun_at = bench.now
        bench.run(1.0)
        bench.back(A, for_good=False)
        bench.run(3.1)
        asked = [round(at - begun_at, 2) for at, a in bench.log if isinstance(a, Send) and a.station == B]
        assert asked == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 2.0, 3.0, 4.0]

    def test_start_is_refused(self) -> None:
        bench = started(LEFT)
        bench.run(1.0)
        assert "GCSA does not command" in bench.arbiter.start_needs(A, bench.now)

    def test_nor_is_it_one_of_the_ground_before_the_autopilot_has_spoken(self) -> None:
        arbiter = Arbiter(Identity("drone", STATIONS, A), Limits(), LEFT)
        actions = arbiter.handle(StationHeard(A), 1.0)
        sent = {action.station: action.message for action in actions if isinstance(action, Send)}
        asked = sent[A]
        assert isinstance(asked, Connect)
        arbiter.handle(StationMessage(A, Bench().ack(A, asked)), 1.0)
        assert arbiter.start_needs(A, 1.0)[0] == "the vehicle is already flying or starting"

    def test_the_clock_begins_with_the_first_event(self) -> None:
        # whatever MAVProxy did before that is not held against the commander
        bench = started(LEFT)
        bench.now += 60.0
        bench.give(Tick())
        assert bench.arbiter.view == WAITING
        bench.now += 2.4
        bench.give(Tick())
        assert bench.arbiter.view == WAITING
        bench.back(A, for_good=False)
        assert bench.arbiter.view.commander == A


class TestNotHeard:
    """After 2.5 s it is lost: the guard goes home after 3 s of leases that name no commander."""

    def test_nobody_commands_and_the_aircraft_turns_home(self) -> None:
        bench = started(LEFT)
        begun_at = bench.now
        bench.run(30.0)
        lost = AuthorityView(Phase.ON_MISSION, None, None, 5, LeaseState.LOST, True, 7)
        assert [(at, a) for at, a in bench.log if isinstance(a, (ViewChanged, Fly))][-3:] == [
            (begun_at + 2.5, ViewChanged(lost, Reason.COMMANDER_LOST)),
            (begun_at + 2.5, ViewChanged(replace(lost, phase=Phase.EMERGENCY), Reason.COMMANDER_LOST)),
            (begun_at + 2.5, RETURN),
        ]
        assert [record.text for record in bench.records("authority_lost")] == [
            "GCSA has not come back after the restart: no station commands"
        ]

    def test_somebody_who_is_there_is_asked_instead(self) -> None:
        bench = started(LEFT)
        bench.alive = {B}
        bench.run(2.5)
        assert bench.arbiter.view == AuthorityView(
            Phase.ON_HANDOVER, None, B, 5, LeaseState.LOST, True, 8, why=Reason.COMMANDER_LOST
        )
        key = TransferKey(A, B, 8, 5)
        bench.say(B, OnHandover(key))
        bench.say(B, DroneConnected(key))
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, B, None, 6, LeaseState.HELD, True, 8)
        assert bench.flights() == []

    def test_later_it_is_back_like_any_lost_commander(self) -> None:
        bench = started(LEFT)
        bench.run(20.0)
        bench.back(A, for_good=False)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 6, LeaseState.HELD, True, 7)
        assert bench.records("authority")[0].text == "GCSA is back and commands again, epoch 6"

    def test_the_deadline_says_when(self) -> None:
        bench = started(LEFT)
        bench.facts = None
        bench.autopilot, bench.guard = False, None
        bench.give(AutopilotState(True, True))
        begun_at = bench.now
        while bench.arbiter.view.lease is LeaseState.RECOVERING:
            deadline = bench.arbiter.next_deadline()
            assert deadline is not None
            assert deadline <= begun_at + 2.5
            bench.now = max(bench.now, deadline)
            bench.give(Tick())
        assert bench.now == begun_at + 2.5

    @pytest.mark.parametrize("lost_s", [1.0, 9.0])
    def test_the_time_is_a_limit_of_its_own(self, lost_s: float) -> None:
        bench = started(LEFT, replace(Limits(), recovery_s=lost_s))
        begun_at = bench.now
        bench.run(20.0)
        assert [at for at, a in bench.log if isinstance(a, Fly)] == [begun_at + lost_s]


class TestWhoHadIt:
    def test_one_that_was_lost_already_may_still_come_back(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {B}
        bench.run(20.0)
        assert bench.flights() == [RETURN]
        bench.restart()
        assert bench.arbiter.view == AuthorityView(Phase.EMERGENCY, None, None, 2, LeaseState.RECOVERING, True, 0)
        bench.back(A, for_good=False)
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 2

    def test_nobody_in_flight_is_still_nobody(self) -> None:
        bench = started(replace(LEFT, owner=None))
        assert bench.arbiter.view == replace(WAITING, lease=LeaseState.LOST)
        bench.alive = {A, B}
        bench.run(30.0)
        assert bench.arbiter.view.commander is None
        assert bench.flights() == [RETURN]

    @pytest.mark.parametrize("owner", [0, 7, 99, 255])
    def test_a_station_that_is_not_in_the_configuration_any_more_is_nobody(self, owner: int) -> None:
        bench = started(replace(LEFT, owner=owner))
        bench.alive = {A, B}
        bench.back(owner, for_good=False)
        bench.run(30.0)
        assert bench.arbiter.view.commander is None
        assert bench.flights() == [RETURN]

    def test_the_partner_after_the_commit(self) -> None:
        bench = Bench().commit().restart()
        bench.alive = {A}
        bench.run(2.0)
        assert bench.arbiter.view.commander is None, "the former commander gains nothing"
        bench.back(B, for_good=False)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, B, None, 3, LeaseState.HELD, True, 1)

    def test_the_parent_is_nobody_in_particular(self) -> None:
        bench = started(replace(LEFT, owner=B))
        bench.alive = {A}
        bench.run(60.0)
        assert bench.arbiter.view.commander is None
        # asked as a successor like any other, and it has not said a word
        assert {r.text for r in bench.records("transfer_aborted")} == {
            f"handover {number} aborted (partner silent): no station commands" for number in range(8, 8 + 14)
        }

    def test_takeover_that_was_allowed_is_still(self) -> None:
        bench = started(replace(LEFT, takeover_allowed=True))
        bench.alive = {A, B}
        bench.run(2.0)
        (answer,) = [a for a in bench.give(bench.request(B)) if isinstance(a, ControlAnswer)]
        assert answer == ControlAnswer(B, ControlResult.ACCEPTED)


class TestInATransfer:
    """Before the commit nothing has changed, so nothing has to be put right: the commander stays."""

    @pytest.mark.parametrize("step", ALL_STEPS)
    def test_the_commander_stays_whatever_the_step(self, step: str) -> None:
        bench = Bench().up_to(step).restart()
        bench.alive = {B}
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, None, None, 2, LeaseState.RECOVERING, True, 1)
        # what was on its way when the companion died arrives now
        for station, word in (
            (B, OnHandover(KEY)),
            (B, DroneConnected(KEY)),
            (B, OkHandover(KEY)),
            (B, DisconnectHandover(KEY)),
        ):
            bench.say(station, word)
        assert bench.arbiter.view.commander is None
        bench.say(A, OkHandover(KEY))
        bench.say(A, DisconnectHandover(KEY))
        assert bench.arbiter.view.commander is None, "it may hear nothing"
        bench.alive = {A, B}
        bench.run(0.25)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 2, LeaseState.HELD, True, 1)
        assert bench.dropped() == {"stale epoch or unknown transfer": 6}

    @pytest.mark.parametrize("step", ALL_STEPS)
    def test_and_the_next_attempt_has_a_new_number_in_a_new_epoch(self, step: str) -> None:
        # the zone that was entered before has still to be served, so it begins when the commander is heard
        bench = Bench().up_to(step).restart()
        bench.run(3.0)
        key = TransferKey(A, B, 2, 2)
        assert bench.arbiter.view == AuthorityView(
            Phase.ON_HANDOVER, A, B, 2, LeaseState.TRANSFER, True, 2, why=Reason.ZONE
        )
        for station, word in (
            (B, OnHandover(key)),
            (A, OkHandover(key)),
            (B, DroneConnected(key)),
            (A, DisconnectHandover(key)),
        ):
            bench.say(station, word)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, B, None, 3, LeaseState.HELD, True, 2)

    def test_but_without_one_where_the_aircraft_has_been_all_along_is_no_entry(self) -> None:
        # both zones were entered before GCSB handed over to GCSA: to start anew is no reason to hand back
        bench = Bench().commit()
        bench.run(10.0)
        bench.restart()
        bench.run(10.0)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, B, None, 3, LeaseState.HELD, True, 1)
        bench.position(inside(A), inside(B, exit_s=8.0))
        assert bench.arbiter.view.partner == A

    def test_in_a_forced_one_too(self) -> None:
        bench = Bench().up_to("CONNECT")
        bench.alive = {B}
        bench.run(5.5)
        assert bench.arbiter.view.commander is None
        bench.restart()
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view.commander is None
        bench.run(2.0)
        assert bench.arbiter.view.commander is None
        bench.run(0.6)
        assert bench.arbiter.view.partner == B, "asked anew, once its time to come back is over"


class TestAgainAndAgain:
    def test_the_epoch_rises_with_every_start(self) -> None:
        bench = Bench().on_mission()
        epochs = [bench.arbiter.view.epoch]
        for heard in (True, False, False, True, False, True):
            bench.restart(0.5)
            epochs.append(bench.arbiter.view.epoch)
            if heard:
                bench.back(A, for_good=False)
            assert bench.arbiter.view.epoch == epochs[-1]
            assert bench.arbiter.view.commander == (A if heard else None)
        assert epochs == [1, 2, 3, 4, 5, 6, 7]

    def test_transfer_numbers_never_come_twice(self) -> None:
        bench = Bench().in_transfer()
        seen = {(bench.arbiter.view.epoch, bench.arbiter.view.handover_id)}
        for number in range(2, 6):
            bench.restart()
            bench.run(1.5)
            assert bench.arbiter.view.partner == B
            assert bench.arbiter.view.handover_id == number
            seen.add((bench.arbiter.view.epoch, bench.arbiter.view.handover_id))
        assert len(seen) == 5


class TestEmergency:
    """An aircraft that is being brought home: whether the cause is still there is found out anew."""

    LEFT = replace(LEFT, phase=Phase.EMERGENCY)

    def test_it_is_one_until_something_is_known(self) -> None:
        bench = started(self.LEFT)
        bench.run(4.0)
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        assert bench.records("emergency_over") == []

    def test_over_when_the_commander_is_back_and_transfers_go_on(self) -> None:
        bench = started(self.LEFT)
        bench.alive = {A, B}
        bench.run(1.0)
        assert bench.arbiter.view.phase is Phase.ON_MISSION
        assert [record.text for record in bench.records("emergency_over")] == ["the cause of the emergency is gone"]
        assert bench.flights() == []
        bench.position(inside(A), outside(B))
        bench.position(inside(A), inside(B))
        bench.run(6.0)
        assert bench.arbiter.view.partner == B

    def test_commanded_home_again_when_it_is_not_back(self) -> None:
        bench = started(self.LEFT)
        bench.run(60.0)
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        assert bench.flights() == [RETURN]

    def test_and_when_the_aircraft_is_still_out_of_every_zone(self) -> None:
        bench = started(self.LEFT)
        bench.alive = {A}
        bench.position(*far(A, B))
        bench.run(30.0)
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        assert bench.arbiter.view.commander == A
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.OUT_OF_COVERAGE)]


class TestUntilTheFlightIsOver:
    """Less energy does not become more, whatever is known of it behind a restart."""

    BACK = Fly(FlightAction.RETURN, Reason.ENERGY)
    LEFT = replace(LEFT, phase=Phase.EMERGENCY, lasting=(Cause.ENERGY,))

    @staticmethod
    def turned_back(limits: Limits | None = None) -> Bench:
        """It has turned back for its energy, which looks like enough by now."""
        bench = Bench(limits)
        bench.armed = bench.flying = True
        bench.mode = ModeSeen(ModeClass.MISSION, "AUTO")
        bench = bench.restart(0.0, LEFT)
        bench.run(3.0)
        bench.give(ConditionsSeen(energy=True))
        bench.run(3.0)
        bench.mode = ModeSeen(ModeClass.RETURN, "RTL")
        bench.give(ConditionsSeen())
        bench.run(3.0)
        return bench

    def test_it_is_kept(self) -> None:
        bench = self.turned_back()
        assert bench.flights() == [self.BACK]
        assert bench.arbiter.snapshot().lasting == (Cause.ENERGY,)

    def test_who_turned_back_goes_on_and_is_not_told_that_it_is_over(self) -> None:
        """The fault: "ALL CLEAR", and the return was the order of no station any more."""
        bench = self.turned_back().restart()
        bench.run(10.0)
        assert bench.flights() == [], "it returns already"
        assert [text.split(".")[0] for text in announced(bench)] == ["RETURN"]
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        assert bench.arbiter.snapshot().lasting == (Cause.ENERGY,)
        assert {view.view.phase for view in bench.views()} == {Phase.EMERGENCY}

    def test_who_does_not_return_is_sent_back_at_once(self) -> None:
        bench = started(self.LEFT)
        bench.mode = ModeSeen(ModeClass.MISSION, "AUTO")
        bench.alive = {A}
        bench.run(1.0)
        assert bench.flights() == [self.BACK]

    def test_before_it_is_known_to_fly_nothing_is_said_and_it_outlives_another_restart(self) -> None:
        bench = started(self.LEFT)
        bench.autopilot, bench.alive = False, {A}
        bench.run(5.0)
        assert announced(bench) == []
        assert bench.arbiter.view.phase is Phase.EMERGENCY
        bench.restart()
        bench.autopilot = True
        bench.run(1.0)
        assert bench.flights() == [self.BACK]

    def test_found_on_the_ground_it_is_over(self) -> None:
        bench = started(self.LEFT)
        bench.armed = bench.flying = False
        bench.alive = {A}
        bench.run(3.0)
        assert bench.arbiter.snapshot().lasting == ()
        bench.armed = bench.flying = True
        bench.run(5.0)
        assert bench.flights() == []

    def test_what_the_commander_has_overruled_is_not_wrong_again(self) -> None:
        bench = self.turned_back()
        bench.give(ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION))
        bench.mode = ModeSeen(ModeClass.MISSION, "AUTO")
        bench.run(3.0)
        assert bench.arbiter.snapshot().lasting == ()
        bench.restart()
        bench.run(10.0)
        assert bench.flights() == []

    def test_a_warning_is_told_again_and_stays_one(self) -> None:
        bench = self.turned_back(Limits(policies={Cause.ENERGY: "warn"})).restart()
        bench.run(10.0)
        assert [text.split(".")[0] for text in announced(bench)] == ["WARNING"]
        assert bench.flights() == []
        assert bench.arbiter.view.phase is Phase.ON_MISSION

    def test_what_is_not_looked_at_any_more_is_over(self) -> None:
        bench = started(self.LEFT, Limits(policies={Cause.ENERGY: "off"}))
        bench.alive = {A}
        bench.run(5.0)
        assert bench.flights() == []
        assert announced(bench) == ["ALL CLEAR. Over: the emergency before the restart"]


class TestPolicy:
    """What the mission has brought is not forgotten."""

    @pytest.mark.parametrize(
        ("policy", "flown"), [("return", [FlightAction.RETURN]), ("land", [FlightAction.LAND]), ("warn", [])]
    )
    def test_out_of_coverage(self, policy: str, flown: list[FlightAction]) -> None:
        bench = Bench().on_ground()
        bench.give(MissionLoaded(DIGEST, ROUTE, policy))
        bench.autopilot_says(armed=True, flying=True)
        bench.run(1.0)
        bench.restart()
        bench.run(1.0)
        bench.position(*far(A, B, C, D))
        bench.run(5.0)
        assert [fly.action for fly in bench.flights()] == flown

    def test_the_route(self) -> None:
        bench = Bench(route=(A, C, B))
        bench.alive = {A, B, C}
        bench.on_mission()
        bench.restart()
        bench.run(2.0)
        bench.position(inside(A), outside(B), outside(C))
        bench.position(inside(A), inside(B, exit_s=900.0), inside(C))
        bench.run(1.0)
        assert bench.arbiter.view.partner == C


class TestOnTheGround:
    """On the ground everything begins anew, but for the numbers."""

    LEFT = Snapshot(B, 4, 7, Phase.ON_LOAD, 2, DIGEST, ROUTE, takeover_allowed=True)

    def on_ground(self) -> Bench:
        bench = Bench()
        bench.alive = set()
        return bench.restart(0.0, self.LEFT)

    def test_nothing_but_the_numbers(self) -> None:
        bench = self.on_ground()
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, None, None, 5, LeaseState.LOST, True, 7)
        assert bench.arbiter.mission_digest == b""
        assert bench.arbiter.snapshot() == Snapshot(None, 5, 7, Phase.ON_LOAD, 0, b"", (), False, "return")

    def test_the_parent_takes_up_its_vehicle(self) -> None:
        bench = self.on_ground()
        bench.alive = {A, B}
        bench.run(1.0)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, A, None, 6, LeaseState.HELD, False, 7)

    def test_not_in_the_air_whatever_the_file_says(self) -> None:
        # killed between arming and the first word of it: no station commands, so home
        bench = self.on_ground()
        bench.alive = {A, B}
        bench.autopilot_says(armed=True, flying=True)
        bench.run(30.0)
        assert bench.arbiter.view.commander is None
        assert bench.flights() == [RETURN]

    def test_an_old_file_of_a_flight_found_on_the_ground(self) -> None:
        # the battery was changed: the flight it tells of is over
        bench = started(LEFT)
        bench.alive = {B}
        bench.autopilot_says(armed=False, flying=False)
        assert bench.arbiter.view.phase is Phase.ON_LOAD
        assert [record.event for record in bench.records("landed")] == ["landed"]
        (answer,) = [a for a in bench.give(bench.request(B)) if isinstance(a, ControlAnswer)]
        assert answer.result is ControlResult.DENIED
        bench.run(6.0)
        (answer,) = [a for a in bench.give(bench.request(B)) if isinstance(a, ControlAnswer)]
        assert answer.result is ControlResult.ACCEPTED
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, B, None, 6, LeaseState.HELD, False, 7)

    @pytest.mark.parametrize(("back_after_s", "commander"), [(2.0, B), (3.0, A)])
    def test_the_parent_waits_for_the_commander_of_before(self, back_after_s: float, commander: int) -> None:
        bench = started(replace(LEFT, owner=B))
        bench.armed = bench.flying = False
        bench.alive = {A}
        bench.run(back_after_s)
        bench.back(B)
        assert bench.arbiter.view.commander == commander

    def test_the_time_to_come_back_does_not_outlive_the_one_who_was_granted(self) -> None:
        bench = started(replace(LEFT, owner=B))
        bench.alive = {A}
        bench.autopilot_says(armed=False, flying=False)
        bench.run(6.0)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, A, None, 6, LeaseState.HELD, False, 7)
        assert len(bench.records("authority_lost")) == 1


def last_answer(bench: Bench, station: int) -> ConnectAck:
    """The station's honest answer to the last CONNECT that was sent to it."""
    question = next(
        a.message
        for _at, a in reversed(bench.log)
        if isinstance(a, Send) and a.station == station and isinstance(a.message, Connect)
    )
    return bench.ack(station, question)


class TestNumbersLost:
    """The state file is gone and with it the numbers: a station that remembers later ones would believe nothing."""

    @staticmethod
    def answered(epoch: int) -> Bench:
        """GCSA's answer to the first CONNECT of a companion that knows nothing."""
        bench = Bench()
        bench.alive = set()
        bench.autopilot_says(armed=False, flying=False)
        question = next(
            a.message
            for _at, a in bench.log
            if isinstance(a, Send) and a.station == A and isinstance(a.message, Connect)
        )
        bench.say(A, replace(bench.ack(A, question), epoch=epoch))
        return bench

    @pytest.mark.parametrize("epoch", [1, 7, 0x7FFFFFFF])
    def test_the_epoch_goes_on_from_the_memory_of_the_stations(self, epoch: int) -> None:
        bench = self.answered(epoch)
        assert (bench.arbiter.view.commander, bench.arbiter.view.epoch) == (A, epoch + 1)
        assert [record.text for record in bench.records("epoch_learnt")] == [
            f"GCSA remembers epoch {epoch}: the state of an earlier run was lost"
        ]

    @pytest.mark.parametrize("epoch", [0x80000000, 0xFFFFFFFF])
    def test_what_nobody_can_remember_is_not_believed(self, epoch: int) -> None:
        assert self.answered(epoch).arbiter.view.epoch == 1

    def test_the_highest_epoch_that_is_believed_leaves_room_for_every_flight_after_it(self) -> None:
        bench = self.answered(0x7FFFFFFF)
        assert bench.arbiter.view.epoch == 0x80000000
        bench.alive = {A, B}
        for _ in range(3):  # a restart moves it on by one
            bench.restart()
            bench.on_ground()
        assert bench.arbiter.view.epoch < 0x80000010

    def test_not_in_place_of_an_answer_to_a_question(self) -> None:
        bench = Bench()
        bench.alive = set()
        bench.run(1.0)
        for nonce in (0, 1, 0xFFFFFFFF):
            bench.say(B, ConnectAck(B, 1, nonce, 50, B, "GCSB", b""))
        assert bench.arbiter.view.epoch == 0

    @staticmethod
    def late(epoch: int, commander: int | None, *, flying: bool = True) -> Bench:
        """A companion that knows nothing and commands under GCSA; GCSB comes into reach and remembers more."""
        bench = Bench()
        bench.alive = {A}
        bench.on_mission() if flying else bench.on_ground()
        bench.log.clear()
        bench.give(StationHeard(B))
        bench.say(B, replace(last_answer(bench, B), epoch=epoch, commander=commander))
        bench.alive = {A, B}
        return bench

    @pytest.mark.parametrize("flying", [True, False])
    @pytest.mark.parametrize(("epoch", "commander"), [(2, B), (9, C), (9, None), (0x7FFFFFFF, B), (1, B)])
    def test_a_station_that_comes_into_reach_later_is_outdone_once(
        self, epoch: int, commander: int | None, flying: bool
    ) -> None:
        bench = self.late(epoch, commander, flying=flying)
        assert (bench.arbiter.view.commander, bench.arbiter.view.epoch) == (A, epoch + 1)
        assert [record.text for record in bench.records("epoch_learnt")] == [
            f"GCSB remembers epoch {epoch}: the state of an earlier run was lost"
        ]
        # and now that it has heard, no answer of its counts any more
        bench.alive = {A}
        bench.run(2.0)
        bench.say(B, replace(last_answer(bench, B), epoch=epoch + 50))
        assert bench.arbiter.view.epoch == epoch + 1

    @pytest.mark.parametrize(("epoch", "commander"), [(0, None), (1, A), (1, None), (0x80000000, B)])
    def test_who_is_not_ahead_moves_nothing(self, epoch: int, commander: int | None) -> None:
        assert self.late(epoch, commander).arbiter.view.epoch == 1

    @pytest.mark.parametrize(("epoch", "commander"), [(0, None), (1, A), (0, D), (2, B), (2, None)])
    def test_what_is_remembered_of_this_run_moves_nothing(self, epoch: int, commander: int | None) -> None:
        bench = Bench().commit()
        bench.log.clear()
        bench.give(StationHeard(C))
        bench.say(C, replace(last_answer(bench, C), epoch=epoch, commander=commander))
        assert (bench.arbiter.view.commander, bench.arbiter.view.epoch) == (B, 2)
        assert bench.records("epoch_learnt") == []

    def test_a_transfer_ends_in_the_epoch_in_which_it_began(self) -> None:
        bench = Bench()
        bench.in_transfer()
        bench.log.clear()
        bench.give(StationHeard(C))
        bench.say(C, replace(last_answer(bench, C), epoch=9))
        for station, word in ((B, OnHandover(KEY)), (A, OkHandover(KEY)), (B, DroneConnected(KEY))):
            bench.say(station, word)
        bench.say(A, DisconnectHandover(KEY))
        assert (bench.arbiter.view.commander, bench.arbiter.view.epoch) == (B, 2)
        bench.run(1.0)
        bench.say(C, replace(last_answer(bench, C), epoch=9))
        assert (bench.arbiter.view.commander, bench.arbiter.view.epoch) == (B, 10)

    def test_an_old_copy_of_the_state_file_is_outdone_on_the_ground(self) -> None:
        bench = Bench()
        bench.alive = set()
        bench.restart(0.0, Snapshot(None, 4, 7, Phase.ON_LOAD, 0, b"", ()))
        for epoch in (3, 9, 8, 12, 12):  # whoever answers, and as often as he likes
            bench.give(StationHeard(B))
            bench.run(1.0)
            bench.say(B, replace(last_answer(bench, B), epoch=epoch, commander=B))
        assert (bench.arbiter.view.commander, bench.arbiter.view.epoch) == (None, 12)
        assert [record.text.split(":")[0] for record in bench.records("epoch_learnt")] == [
            "GCSB remembers epoch 9",
            "GCSB remembers epoch 12",
        ]

    def test_with_a_state_file_not_even_the_first_answer_counts(self) -> None:
        bench = started(LEFT)
        bench.give(StationHeard(B))
        bench.say(B, replace(last_answer(bench, B), epoch=99))
        assert bench.arbiter.view.epoch == 5

    def test_with_a_state_file_nobodys_memory_counts_while_somebody_has_authority(self) -> None:
        bench = started(LEFT)
        bench.alive = {B}
        bench.run(0.0)
        question = bench.arbiter._presence[B].answer
        assert question is not None
        bench.alive = set()
        bench.run(1.5)
        asked = [
            a.message
            for _at, a in bench.log
            if isinstance(a, Send) and a.station == B and isinstance(a.message, Connect)
        ]
        bench.say(B, replace(bench.ack(B, asked[-1]), epoch=99))
        assert bench.arbiter.view.epoch == 5


def test_every_state_of_a_flight_survives_as_itself() -> None:
    """Killed after any event of a whole transfer: who commanded commands, in a higher epoch, once heard."""
    words: list[tuple[int, Message]] = [
        (B, OnHandover(KEY)),
        (A, OkHandover(KEY)),
        (B, DroneConnected(KEY)),
        (A, DisconnectHandover(KEY)),
    ]
    for count in range(len(words) + 1):
        bench = Bench().in_transfer()
        for station, word in words[:count]:
            bench.say(station, word)
        before = bench.arbiter.view
        bench.restart()
        assert before.commander is not None
        bench.back(before.commander, for_good=False)
        after = bench.arbiter.view
        assert (after.commander, after.epoch) == (before.commander, before.epoch + 1)


def test_a_message_of_before_is_stale_even_where_the_number_fits() -> None:
    arbiter = Arbiter(Identity("drone", STATIONS, A), Limits(), LEFT)
    for key in (TransferKey(A, B, 7, 4), TransferKey(A, B, 8, 4)):
        arbiter.handle(StationMessage(B, DroneConnected(key)), 1.0)
    assert arbiter.dropped["stale epoch or unknown transfer"] == 2
