# SPDX-License-Identifier: GPL-3.0-or-later

"""The commander is lost in flight and somebody is there to take over: the partner's two words, two seconds, no more.

What leads there from each step of a running transfer is in `test_arbiter_transfer.py`; `watch.py` checks on every event
that nobody gets the aircraft who was not asked and has not confirmed.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import pytest

from mavproxy_handover.core.common.events import (
    Announce,
    Cancel,
    ControlAnswer,
    ControlResult,
    Fly,
    ModeSeen,
    Record,
    Send,
    StationHeard,
    TakeOffPassed,
    Tick,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, LeaseState, ModeClass, ZoneFact
from tests.core.bench import (
    A,
    B,
    Bench,
    C,
    ConnectHandover,
    Consent,
    D,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    HandoverResult,
    OkHandover,
    OnHandover,
    Outcome,
    Phase,
    Reason,
    TransferKey,
    far,
    inside,
    not_records,
    outside,
)

RETURN = Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)
KEY = TransferKey(A, B, 1, 1)
UNDER_WAY = AuthorityView(Phase.ON_HANDOVER, None, B, 1, LeaseState.LOST, True, 1, why=Reason.COMMANDER_LOST)
TAKEN = AuthorityView(Phase.ON_MISSION, B, None, 2, LeaseState.HELD, True, 1)
#: nothing more for two seconds after an attempt, ten after a refusal
PAUSE_S, DENIED_PAUSE_S = 2.0, 10.0


def in_both_zones(
    limits: Limits | None = None,
    route: tuple[int, ...] = (A, B, A, B, A),
    facts: tuple[ZoneFact, ...] = (inside(A), inside(B), outside(C)),
) -> Bench:
    """Flying under GCSA in the zones of GCSA and GCSB; GCSB's was entered on the ground, so no zone calls."""
    bench = Bench(limits, route)
    bench.alive = {A, B, C}
    bench.on_ground()
    bench.position(*facts)
    bench.autopilot_says(armed=True, flying=True)
    bench.run(10.0)
    assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 1, LeaseState.HELD, True, 0)
    bench.log.clear()
    return bench


def lost(limits: Limits | None = None) -> Bench:
    """GCSA has been silent for five seconds just now; HANDOVER_REQUEST to GCSB is out."""
    bench = in_both_zones(limits)
    bench.alive = {B, C}
    bench.run(5.0)
    assert bench.arbiter.view == UNDER_WAY
    return bench


def begun(bench: Bench) -> list[tuple[float, str]]:
    return [(at, a.text) for at, a in bench.log if isinstance(a, Record) and a.event == "transfer_begun"]


class TestTaking:
    def test_at_the_moment_of_the_loss_the_partner_is_asked_and_the_aircraft_flies_on(self) -> None:
        bench = in_both_zones()
        bench.alive = {B, C}
        heard_at = bench.now
        bench.run(4.9)
        bench.log.clear()
        bench.run(0.1)
        assert [(at, action) for at, action in bench.log if isinstance(action, (ViewChanged, Send))][:3] == [
            (heard_at + 5.0, ViewChanged(AuthorityView(Phase.ON_MISSION, None, None, 1, LeaseState.LOST, True, 0),
                                         Reason.COMMANDER_LOST)),
            (heard_at + 5.0, ViewChanged(UNDER_WAY, Reason.COMMANDER_LOST)),
            (heard_at + 5.0, Send(B, HandoverRequest(KEY, Reason.COMMANDER_LOST), 1)),
        ]  # fmt: skip
        assert begun(bench) == [(heard_at + 5.0, "handover 1 (forced): GCSA -> GCSB")]
        assert bench.flights() == []

    def test_the_partners_two_words_are_enough(self) -> None:
        bench = lost()
        assert not_records(bench.say(B, OnHandover(KEY))) == [Send(B, ConnectHandover(KEY), 1)]
        result = HandoverResult(TransferKey(A, B, 1, 2), B, Outcome.COMMITTED, Reason.COMMANDER_LOST)
        assert not_records(bench.say(B, DroneConnected(KEY))) == [
            ViewChanged(TAKEN, Reason.COMMANDER_LOST),
            Send(A, result, 1),
            Send(B, result, 1),
        ]
        assert bench.flights() == []
        assert bench.records("emergency") == []

    def test_a_word_for_the_commander_is_passed_on_to_nobody(self) -> None:
        bench = lost()
        bench.say(B, OnHandover(KEY, relay=True))
        bench.say(B, DroneConnected(KEY, relay=True))
        assert bench.arbiter.view == TAKEN
        assert [m for _at, station, m, _n in bench.sent() if station == A and not isinstance(m, HandoverResult)] == []

    @pytest.mark.parametrize("word", [DroneConnected(KEY), DisconnectHandover(KEY), OkHandover(KEY)])
    def test_one_word_alone_is_not(self, word: object) -> None:
        bench = lost()
        bench.say(B, word)  # type: ignore[arg-type]
        assert bench.arbiter.view == UNDER_WAY
        bench.run(2.0)
        assert bench.arbiter.view.commander is None

    def test_a_third_station_cannot_take_what_was_offered_to_the_partner(self) -> None:
        bench = lost()
        for key in (KEY, TransferKey(A, C, 1, 1)):
            for word in (OnHandover(key), OkHandover(key), DroneConnected(key), DisconnectHandover(key)):
                bench.say(C, word)
        assert bench.arbiter.view == UNDER_WAY

    @pytest.mark.parametrize(
        ("route", "taker"),
        [((A, C, B), C), ((A, B, C), B), ((A,), B), ((), B)],
        ids=["C is next on the route", "B is next on the route", "neither is next: B keeps it longest", "no route"],
    )
    def test_where_two_could_take_it(self, route: tuple[int, ...], taker: int) -> None:
        bench = in_both_zones(route=route, facts=(inside(A), inside(B, exit_s=900.0), inside(C, exit_s=20.0)))
        bench.alive = {B, C}
        bench.run(5.0)
        assert bench.arbiter.view.partner == taker

    def test_the_former_commander_gets_nothing_when_it_is_back_after_the_commit(self) -> None:
        bench = lost()
        bench.say(B, OnHandover(KEY))
        bench.say(B, DroneConnected(KEY))
        bench.alive = {A, B, C}
        bench.run(30.0)
        assert bench.arbiter.view == TAKEN
        bench.say(A, DisconnectHandover(KEY))
        bench.say(A, OkHandover(KEY))
        assert bench.arbiter.view == TAKEN

    def test_the_new_commander_may_be_lost_in_turn(self) -> None:
        bench = in_both_zones()
        bench.position(inside(A), inside(B), inside(C))
        bench.say(C, OnHandover(TransferKey(A, C, 1, 1), Consent.DENIED))
        bench.alive = {B, C}
        bench.run(5.0)
        first = TransferKey(A, B, 2, 1)
        bench.say(B, OnHandover(first))
        bench.say(B, DroneConnected(first))
        assert bench.arbiter.view.commander == B
        bench.alive = {C}
        bench.run(5.0)
        # the refusal was of another commander: it does not count any more
        assert bench.arbiter.view == AuthorityView(
            Phase.ON_HANDOVER, None, C, 2, LeaseState.LOST, True, 3, why=Reason.COMMANDER_LOST
        )
        second = TransferKey(B, C, 3, 2)
        bench.say(C, OnHandover(second))
        bench.say(C, DroneConnected(second))
        assert bench.arbiter.view.commander == C
        assert bench.arbiter.view.epoch == 3


def test_a_loss_says_nothing_to_the_partner_that_it_has_just_been_told() -> None:
    bench = Bench(replace(Limits(), step_timeout_s=20.0)).up_to("CONNECT")
    bench.alive = {B}
    heard_at = bench.now
    bench.run(5.5)
    assert [at - heard_at for at, _station, _message, attempt in bench.sent() if attempt == 1] == [
        pytest.approx(5.2),  # 0.2 s after the loss, in the step that begins there
    ]


class TestBound:
    """Two seconds for all of it, then the aircraft turns home; and it is commanded home once."""

    @pytest.mark.parametrize("heard", ["nothing", "ready"])
    def test_two_seconds_from_the_loss(self, heard: str) -> None:
        bench = lost()
        lost_at = bench.now
        bench.run(1.9)
        if heard == "ready":
            bench.say(B, OnHandover(KEY))  # a step of four seconds of its own begins here
        assert bench.arbiter.view == UNDER_WAY
        assert bench.flights() == []
        bench.run(2.0)
        assert [(at, a) for at, a in bench.log if isinstance(a, Fly)] == [(lost_at + 2.0, RETURN)]
        assert bench.arbiter.view == AuthorityView(Phase.EMERGENCY, None, None, 1, LeaseState.LOST, True, 1)

    def test_where_operators_are_asked_the_return_begins_at_once(self) -> None:
        bench = lost()
        bench.run(0.1)
        bench.say(B, OnHandover(KEY, Consent.WAITING))
        assert bench.flights() == [RETURN]
        # the operator's question stays open while the aircraft flies home
        assert bench.arbiter.view == AuthorityView(
            Phase.EMERGENCY, None, B, 1, LeaseState.LOST, True, 1, why=Reason.COMMANDER_LOST
        )

    def test_an_accept_moves_authority_only_and_the_return_goes_on(self) -> None:
        bench = lost()
        bench.run(0.1)
        bench.say(B, OnHandover(KEY, Consent.WAITING))
        bench.run(10.0)
        bench.say(B, OnHandover(KEY))
        bench.say(B, DroneConnected(KEY))
        assert (bench.arbiter.view.commander, bench.arbiter.view.epoch) == (B, 2)
        bench.run(60.0)
        assert bench.flights() == [RETURN]

    def test_a_station_that_needs_no_operator_takes_the_aircraft_and_nothing_turns_home(self) -> None:
        bench = lost()
        bench.alive = {B, C}
        bench.back(C)
        bench.position(outside(A), inside(B), inside(C))
        bench.run(0.1)
        bench.say(B, OnHandover(KEY, Consent.WAITING))
        other = replace(KEY, to_station=C)
        bench.say(C, OnHandover(other))
        bench.say(C, DroneConnected(other))
        assert bench.arbiter.view.commander == C
        assert bench.flights() == []

    @pytest.mark.parametrize("bound_s", [0.5, 2.0, 3.5])
    def test_the_bound_is_configured(self, bound_s: float) -> None:
        bench = lost(replace(Limits(), forced_timeout_s=bound_s))
        lost_at = bench.now
        bench.run(6.0)
        assert [at for at, a in bench.log if isinstance(a, Fly)] == [lost_at + bound_s]

    def test_the_word_that_comes_at_the_very_end_is_too_late(self) -> None:
        bench = lost()
        bench.say(B, OnHandover(KEY))
        bench.now += 2.0
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view.commander is None
        assert bench.flights() == [RETURN]

    def test_repeated_words_win_no_time(self) -> None:
        bench = lost()
        lost_at = bench.now
        for _ in range(40):
            bench.run(0.1)
            bench.say(B, OnHandover(KEY, Consent.WAITING))
        assert [at for at, a in bench.log if isinstance(a, Fly)] == [lost_at + 0.1]

    def test_the_step_before_the_loss_gives_no_more_time_either(self) -> None:
        # the commander's operator is being asked and has thirty seconds
        bench = Bench().up_to("CONSENT")
        bench.say(A, OkHandover(TransferKey(A, B, 1, 1), Consent.WAITING))
        bench.alive = {B}
        silent_since = bench.now
        bench.run(8.0)
        assert [at for at, a in bench.log if isinstance(a, Fly)] == [silent_since + 7.0]

    def test_it_is_tried_again_and_the_pilot_is_not_fought(self) -> None:
        # a partner that lives and does not answer: each attempt ends after two seconds, the next comes two seconds
        # later; but the way home is commanded once, whatever mode a pilot chooses meanwhile
        bench = lost()
        bench.run(60.0)
        assert bench.flights() == [RETURN]
        assert [text for _at, text in begun(bench)[:3]] == [
            f"handover {number} (forced): GCSA -> GCSB" for number in (1, 2, 3)
        ]
        assert len(begun(bench)) in range(12, 17)
        assert bench.records("emergency_over") == []

    def test_on_the_way_home_there_is_time_to_ask_an_operator(self) -> None:
        bench = lost()
        bench.run(4.5)
        assert bench.arbiter.view == replace(UNDER_WAY, phase=Phase.EMERGENCY, handover_id=2)
        second = TransferKey(A, B, 2, 1)
        bench.say(B, OnHandover(second, Consent.WAITING))
        asked_at = bench.now
        for _ in range(29):
            bench.run(1.0)
            bench.say(B, OnHandover(second, Consent.WAITING))
        assert bench.arbiter.view.handover_id == 2
        bench.say(B, OnHandover(second))
        bench.say(B, DroneConnected(second))
        assert bench.arbiter.view == replace(TAKEN, handover_id=2)
        assert bench.now - asked_at == pytest.approx(29.0)
        assert bench.flights() == [RETURN]

    def test_without_one_to_ask_there_is_no_more_time_than_ever(self) -> None:
        bench = lost()
        bench.run(4.5)
        bench.say(B, OnHandover(TransferKey(A, B, 2, 1)))
        assert bench.arbiter.view.partner == B
        bench.run(2.0)
        assert bench.arbiter.view == AuthorityView(Phase.EMERGENCY, None, None, 1, LeaseState.LOST, True, 2)

    def test_but_not_for_ever(self) -> None:
        bench = lost()
        bench.run(4.5)
        bench.say(B, OnHandover(TransferKey(A, B, 2, 1), Consent.WAITING))
        bench.run(29.9)
        assert bench.arbiter.view.partner == B
        bench.run(0.1)
        assert bench.arbiter.view == AuthorityView(Phase.EMERGENCY, None, None, 1, LeaseState.LOST, True, 2)

    def test_an_attempt_after_that_takes_it(self) -> None:
        bench = lost()
        bench.run(4.5)
        assert bench.arbiter.view == replace(UNDER_WAY, phase=Phase.EMERGENCY, handover_id=2)
        second = TransferKey(A, B, 2, 1)
        bench.say(B, OnHandover(second))
        bench.say(B, DroneConnected(second))
        assert bench.arbiter.view == replace(TAKEN, handover_id=2)
        assert [record.text for record in bench.records("emergency_over")] == ["the cause of the emergency is gone"]
        assert bench.flights() == [RETURN]

    def test_a_refusal_lets_another_try_at_once(self) -> None:
        bench = lost()
        bench.position(inside(A), inside(B), inside(C))
        bench.say(B, OnHandover(KEY, Consent.DENIED))
        assert bench.arbiter.view.partner == C
        assert bench.flights() == []

    def test_and_is_not_asked_again_for_ten_seconds(self) -> None:
        bench = lost()
        refused_at = bench.now
        bench.say(B, OnHandover(KEY, Consent.DENIED))
        bench.run(30.0)
        assert begun(bench)[1][0] == pytest.approx(refused_at + DENIED_PAUSE_S, abs=0.51)

    def test_ticks_at_the_deadlines_alone_are_enough(self) -> None:
        bench = lost()
        bench.alive, bench.facts, bench.autopilot, bench.guard = set(), None, False, None
        ticks = 0
        while bench.flights() == []:
            deadline = bench.arbiter.next_deadline()
            assert deadline is not None
            bench.now = max(bench.now, deadline)
            bench.give(Tick())
            ticks += 1
            assert ticks < 100


class TestReturn:
    """It ends when the commander is heard again: the aircraft was never anybody else's."""

    @pytest.mark.parametrize("step", ["asked", "ready"])
    @pytest.mark.parametrize("how", ["heartbeat", "consent", "denial", "release"])
    def test_in_every_step_and_by_whatever_it_says(self, step: str, how: str) -> None:
        bench = lost()
        if step == "ready":
            bench.say(B, OnHandover(KEY))
        bench.log.clear()
        words = {
            "consent": OkHandover(KEY),
            "denial": OkHandover(KEY, Consent.DENIED),
            "release": DisconnectHandover(KEY),
        }
        bench.alive = {A, B, C}
        if how == "heartbeat":
            bench.give(StationHeard(A))
        else:
            bench.say(A, words[how])
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 2, LeaseState.HELD, True, 1)
        assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.COMMANDER_RETURNED]
        assert bench.flights() == []
        # and what was on its way from the partner comes too late
        bench.say(B, OnHandover(KEY))
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 2

    def test_both_are_told(self) -> None:
        bench = lost()
        bench.log.clear()
        bench.back(A, for_good=False)
        ended = HandoverResult(KEY, None, Outcome.ABORTED, Reason.COMMANDER_RETURNED)
        assert [(station, m) for _at, station, m, _n in bench.sent()] == [(A, ended), (B, ended)]

    def test_back_between_two_attempts(self) -> None:
        bench = lost()
        bench.run(3.0)
        bench.back(A, for_good=False)
        bench.alive = {A, B, C}
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 2, LeaseState.HELD, True, 1)
        bench.run(30.0)
        assert len(begun(bench)) == 1, "nothing is forced any more"

    def test_lost_again_it_begins_again(self) -> None:
        bench = lost()
        bench.back(A, for_good=False)
        bench.run(5.0)
        assert bench.arbiter.view == AuthorityView(
            Phase.ON_HANDOVER, None, B, 2, LeaseState.LOST, True, 2, why=Reason.COMMANDER_LOST
        )
        assert bench.flights() == []


class TestNot:
    """When it is not tried: the aircraft turns home at once."""

    def test_outside_the_partners_zone(self) -> None:
        bench = in_both_zones()
        bench.position(inside(A), outside(B))
        bench.alive = {B}
        silent_since = bench.now
        bench.run(20.0)
        assert begun(bench) == []
        assert [at for at, a in bench.log if isinstance(a, Fly)] == [silent_since + 5.0]

    @pytest.mark.parametrize("case", ["silent", "deaf", "another mission", "another version"])
    def test_to_a_station_that_is_not_fit(self, case: str) -> None:
        bench = in_both_zones()
        if case == "silent":
            bench.alive = set()
        else:
            bench.alive = {B}
        if case == "deaf":
            bench.deaf = {B}
        elif case == "another mission":
            bench.digests[B] = bytes(32)
        elif case == "another version":
            bench.versions[B] = 2
        silent_since = bench.now
        bench.run(20.0)
        assert begun(bench) == []
        assert [at for at, a in bench.log if isinstance(a, Fly)] == [silent_since + 5.0]
        assert len(bench.records("partner_unfit")) == 1

    def test_fit_later_it_is_asked_then(self) -> None:
        bench = in_both_zones()
        bench.deaf = {B}
        bench.alive = {B}
        bench.run(12.0)
        assert begun(bench) == []
        bench.deaf = set()
        bench.run(18.0)  # until it has shown that it hears
        assert bench.arbiter.view.partner == B

    def test_on_the_ground(self) -> None:
        bench = Bench().on_ground()
        bench.position(inside(A), inside(B))
        bench.alive = {B}
        bench.run(30.0)
        assert begun(bench) == []
        assert bench.arbiter.view.commander is None

    def test_armed_but_not_flying(self) -> None:
        bench = Bench().on_ground()
        bench.position(inside(A), inside(B))
        bench.autopilot_says(armed=True, flying=False)
        bench.alive = {B}
        bench.run(30.0)
        assert begun(bench) == []

    def test_on_a_position_that_is_not_fresh(self) -> None:
        # where the aircraft was when it was last seen says nothing about whose zone holds it now
        bench = in_both_zones()
        bench.facts = None
        bench.alive = {B}
        silent_since = bench.now
        bench.run(20.0)
        assert begun(bench) == []
        assert [at for at, a in bench.log if isinstance(a, Fly)] == [silent_since + 5.0]
        bench.position(inside(A), inside(B))
        assert bench.arbiter.view.partner == B

    def test_when_both_are_lost_at_the_same_moment(self) -> None:
        bench = in_both_zones()
        bench.alive = set()
        bench.back(A, for_good=False)
        bench.back(B, for_good=False)
        silent_since = bench.now
        bench.run(20.0)
        assert begun(bench) == []
        assert [at for at, a in bench.log if isinstance(a, Fly)] == [silent_since + 5.0]

    def test_when_the_partner_is_lost_on_the_way(self) -> None:
        bench = in_both_zones(replace(Limits(), forced_timeout_s=6.0, step_timeout_s=20.0))
        bench.alive = {B}
        bench.run(4.5)
        bench.alive = set()
        bench.run(0.5)
        assert bench.arbiter.view == UNDER_WAY
        bench.say(B, OnHandover(KEY))
        heard_at = bench.now
        bench.run(5.5)
        assert [at for at, a in bench.log if isinstance(a, Fly)] == [heard_at + 5.0]
        assert bench.arbiter.view.partner is None

    def test_when_its_zone_is_left_on_the_way(self) -> None:
        bench = lost()
        bench.say(B, OnHandover(KEY))
        bench.position(inside(A), outside(B))
        assert bench.arbiter.view.partner is None
        assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.LEFT_REGION]
        assert bench.flights() == [RETURN]
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view.commander is None

    def test_out_of_every_zone_nobody_gets_it(self) -> None:
        bench = lost()
        bench.position(*far(A, B, C))
        bench.run(5.0)
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.view.partner is None
        assert bench.flights() == [RETURN]

    def test_after_the_landing(self) -> None:
        bench = lost()
        bench.autopilot_says(armed=False, flying=False)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, None, None, 1, LeaseState.LOST, False, 1)
        bench.say(B, OnHandover(KEY))
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view.commander is None


class TestByRequest:
    """A station whose zone holds the aircraft may ask for it."""

    def test_it_is_answered_pending_and_begins_at_once(self) -> None:
        bench = lost()
        bench.run(3.0)  # between two attempts: the request does not wait for the next
        actions = bench.give(bench.request(B))
        assert [a for a in actions if isinstance(a, ControlAnswer)] == [ControlAnswer(B, ControlResult.PENDING)]
        assert bench.arbiter.view.partner == B
        key = TransferKey(A, B, 2, 1)
        bench.say(B, OnHandover(key))
        bench.say(B, DroneConnected(key))
        assert bench.arbiter.view.commander == B

    def test_it_has_no_more_time_than_any_other(self) -> None:
        bench = lost()
        bench.run(3.0)
        bench.give(bench.request(B, timeout_s=60.0))
        bench.run(1.9)
        assert bench.arbiter.view.partner == B
        bench.run(0.1)
        assert bench.arbiter.view.partner is None

    def test_a_request_while_it_runs_is_pending_and_changes_nothing(self) -> None:
        bench = lost()
        before, deadline = bench.arbiter.view, bench.arbiter.next_deadline()
        actions = bench.give(bench.request(B))
        assert [a for a in actions if isinstance(a, ControlAnswer)] == [ControlAnswer(B, ControlResult.PENDING)]
        assert bench.arbiter.view == before
        assert bench.arbiter.next_deadline() == deadline

    def test_another_station_that_is_asked_too_is_waited_for_as_well(self) -> None:
        bench = lost()
        bench.position(inside(A), inside(B), inside(C))
        (answer,) = [a for a in bench.give(bench.request(C)) if isinstance(a, ControlAnswer)]
        assert answer.result is ControlResult.PENDING

    def test_but_one_that_is_not_waits_its_turn(self) -> None:
        bench = lost()
        (answer,) = [a for a in bench.give(bench.request(C)) if isinstance(a, ControlAnswer)]
        assert answer.result is ControlResult.DENIED

    def test_a_takeover_that_the_lost_commander_allowed_changes_nothing(self) -> None:
        bench = in_both_zones()
        bench.give(bench.request(A, takeover=True))
        bench.alive = {B, C}
        bench.run(5.0)
        assert bench.arbiter.view == replace(UNDER_WAY, takeover_allowed=True)
        bench.say(B, OnHandover(KEY))
        assert bench.arbiter.view.commander is None, "the partner must set itself up all the same"
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view == TAKEN


class TestOnTheGround:
    """A transfer that an operator began there goes on without the commander, within the same bound."""

    def test_taken(self) -> None:
        bench = Bench(replace(Limits(), step_timeout_s=20.0)).on_ground()
        bench.give(bench.request(B))
        bench.alive = {B}
        bench.run(5.5)
        assert bench.arbiter.view == AuthorityView(
            Phase.ON_LOAD, None, B, 1, LeaseState.LOST, False, 1, why=Reason.COMMANDER_LOST
        )
        bench.say(B, OnHandover(KEY))
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, B, None, 2, LeaseState.HELD, False, 1)

    def test_not_taken(self) -> None:
        bench = Bench(replace(Limits(), step_timeout_s=20.0)).on_ground()
        bench.give(bench.request(B))
        bench.alive = {B}
        bench.run(8.0)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, None, None, 1, LeaseState.LOST, False, 1)
        assert bench.flights() == []

    def test_taking_off_meanwhile_is_an_emergency_and_the_bound_stays(self) -> None:
        bench = Bench(replace(Limits(), step_timeout_s=20.0)).on_ground()
        bench.position(inside(A), inside(B))
        bench.give(bench.request(B))
        bench.alive = {B}
        silent_since = bench.now
        bench.run(6.0)
        bench.autopilot_says(armed=True, flying=True)
        assert bench.arbiter.view.partner == B
        bench.run(1.5)
        assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.PARTNER_SILENT]
        assert [at for at, a in bench.log if isinstance(a, Fly)] == [silent_since + 7.0]


class TestAskedAtOnce:
    """Everybody who could take the aircraft is asked at the moment of the loss; the first that is ready gets it."""

    @staticmethod
    def lost_by_three(limits: Limits | None = None, standard: Collection[int] = ()) -> Bench:
        """GCSA has just been lost in the zones of B, C and D; B is next on the route."""
        bench = Bench(limits, standard=standard)
        bench.alive = {A, B, C, D}
        bench.on_ground()
        bench.position(inside(A), inside(B), inside(C), inside(D))
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        bench.alive = {B, C, D}
        bench.log.clear()
        bench.run(5.0)
        return bench

    @staticmethod
    def key(station: int) -> TransferKey:
        return TransferKey(A, station, 1, 1)

    def test_all_of_them_in_the_same_instant(self) -> None:
        bench = self.lost_by_three()
        assert [(at, station, message) for at, station, message, _n in bench.sent()] == [
            (bench.now, station, HandoverRequest(self.key(station), Reason.COMMANDER_LOST)) for station in (B, C, D)
        ]
        assert begun(bench) == [(bench.now, "handover 1 (forced): GCSA -> GCSB")]

    def test_to_call_it_off_for_one_calls_it_off_for_nobody_else(self) -> None:
        """The fault: nobody was asked any more for ten seconds, and the aircraft turned home."""
        bench = self.lost_by_three()
        bench.give(Cancel(B))
        assert bench.arbiter.view.partner == C
        bench.say(D, OnHandover(self.key(D)))
        bench.say(D, DroneConnected(self.key(D)))
        assert bench.arbiter.view.commander == D
        assert bench.flights() == []

    def test_where_nobody_else_is_asked_it_is_off(self) -> None:
        bench = self.lost_by_three()
        for station in (B, C, D):
            assert bench.arbiter.view.partner == station
            bench.give(Cancel(station))
        assert bench.arbiter.view.partner is None

    def test_the_first_that_is_ready_gets_connect_and_commands(self) -> None:
        """The fault: RTL was ordered in the instant in which the healthy one took over."""
        bench = self.lost_by_three()
        bench.say(B, OnHandover(self.key(B), Consent.WAITING))
        actions = not_records(bench.say(D, OnHandover(self.key(D))))
        assert Send(D, ConnectHandover(self.key(D)), 1) in actions
        assert bench.arbiter.view.partner == D
        bench.say(D, DroneConnected(self.key(D)))
        assert bench.arbiter.view.commander == D
        assert bench.flights() == []
        told = {station for _at, station, message, _n in bench.sent() if isinstance(message, HandoverResult)}
        assert told == {A, B, C, D}, "who was asked hears how it ended"

    def test_nobody_but_the_one_that_was_told_to_can_confirm(self) -> None:
        bench = self.lost_by_three()
        bench.say(D, OnHandover(self.key(D)))
        for station in (B, C):
            bench.say(station, OnHandover(self.key(station)))
            bench.say(station, DroneConnected(self.key(station)))
            bench.say(station, DroneConnected(self.key(D)))
        assert bench.arbiter.view.commander is None

    def test_one_that_falls_silent_makes_way_for_another_that_is_ready(self) -> None:
        bench = self.lost_by_three()
        lost_at = bench.now
        bench.say(C, OnHandover(self.key(C)))
        bench.say(D, OnHandover(self.key(D)))
        bench.run(0.9)
        assert bench.arbiter.view.partner == D
        bench.say(C, DroneConnected(self.key(C)))
        assert bench.arbiter.view.commander is None, "it is too late for that one"
        bench.say(D, DroneConnected(self.key(D)))
        assert bench.arbiter.view.commander == D
        assert bench.now < lost_at + 2.0
        assert bench.flights() == []

    def test_so_does_one_that_refuses_after_all_or_is_lost_or_left(self) -> None:
        for how in ("refuses", "left"):
            bench = self.lost_by_three()
            bench.say(C, OnHandover(self.key(C)))
            bench.say(D, OnHandover(self.key(D)))
            if how == "refuses":
                bench.say(C, OnHandover(self.key(C), Consent.DENIED))
            else:
                bench.position(inside(A), inside(B), outside(C), inside(D))
            assert bench.arbiter.view.partner == D
            assert (D, ConnectHandover(self.key(D))) in [word[1:3] for word in bench.sent()]

    def test_where_no_other_is_ready_the_rest_is_asked_on(self) -> None:
        bench = self.lost_by_three()
        bench.say(C, OnHandover(self.key(C)))
        bench.say(C, OnHandover(self.key(C), Consent.DENIED))
        assert bench.arbiter.view.partner == B
        bench.log.clear()
        bench.run(0.5)
        assert {(station, type(message)) for _at, station, message, _n in bench.sent()} == {
            (B, HandoverRequest),
            (D, HandoverRequest),
        }
        bench.say(D, OnHandover(self.key(D)))
        bench.say(D, DroneConnected(self.key(D)))
        assert bench.arbiter.view.commander == D

    def test_only_when_all_have_failed_the_aircraft_turns_home(self) -> None:
        bench = self.lost_by_three()
        lost_at = bench.now
        bench.say(B, OnHandover(self.key(B), Consent.DENIED))
        bench.say(C, OnHandover(self.key(C), Consent.DENIED))
        assert bench.flights() == []
        bench.run(1.9)
        assert bench.flights() == []
        bench.run(1.0)
        assert [at for at, action in bench.log if isinstance(action, Fly)] == [lost_at + 2.0]

    def test_and_when_the_last_refuses_at_once(self) -> None:
        bench = self.lost_by_three()
        for station in (B, C, D):
            bench.say(station, OnHandover(self.key(station), Consent.DENIED))
        assert bench.flights() == [RETURN]

    def test_the_operators_questions_stay_open_while_the_aircraft_flies_home(self) -> None:
        bench = self.lost_by_three()
        for station in (C, D):
            bench.say(station, OnHandover(self.key(station), Consent.WAITING))
        bench.run(20.0)
        assert bench.flights() == [RETURN]
        assert bench.arbiter.view.handover_id == 1
        bench.say(D, OnHandover(self.key(D)))
        bench.say(D, DroneConnected(self.key(D)))
        assert bench.arbiter.view.commander == D
        assert bench.arbiter.view.phase is Phase.ON_MISSION

    def test_one_that_comes_into_its_zone_is_asked_too(self) -> None:
        bench = lost()
        bench.position(inside(A), inside(B), inside(C))
        assert bench.sent()[-1][1:3] == (C, HandoverRequest(self.key(C), Reason.COMMANDER_LOST))
        bench.say(C, OnHandover(self.key(C)))
        bench.say(C, DroneConnected(self.key(C)))
        assert bench.arbiter.view.commander == C

    def test_one_that_knows_no_words_for_it_waits_for_those_that_do(self) -> None:
        # it cannot say that it is ready: whoever can comes first
        bench = self.lost_by_three(standard={C})
        assert bench.arbiter.view.partner == B
        bench.run(0.7)
        assert bench.arbiter.view.commander is None
        bench.run(0.2)
        assert bench.arbiter.view.commander == C
        assert bench.flights() == []

    def test_a_transfer_under_way_at_the_loss_is_not_the_only_chance(self) -> None:
        # the partner has been told to set itself up, and does not say that it has
        bench = Bench(replace(Limits(), step_timeout_s=20.0)).up_to("CONNECT")
        bench.alive = {B, C}
        bench.position(inside(A), inside(B), inside(C))
        while bench.arbiter.view.commander == A:
            bench.run(0.1)
        assert bench.arbiter.view.partner == B
        bench.say(C, OnHandover(self.key(C)))
        bench.run(0.9)
        assert bench.arbiter.view.partner == C
        bench.say(C, DroneConnected(self.key(C)))
        assert bench.arbiter.view.commander == C
        assert bench.flights() == []

    def test_falling_away_together_they_leave_nothing_to_a_station_that_is_gone(self) -> None:
        # a standard station commits as soon as it is chosen: it must not be while the others of the same instant fall
        bench = Bench(standard={C})
        bench.alive = {A, B, C}
        bench.on_mission()
        bench.alive = {B, C}
        bench.position(*far(A, B, C, D))
        while bench.arbiter.view.commander is not None:
            bench.run(0.1)
        bench.position(inside(A), inside(B), inside(C), outside(D))
        assert bench.arbiter.view.partner == B
        bench.position(inside(A), outside(B), outside(C), outside(D))
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.view.partner is None

    def test_one_loss_has_one_hurry_however_many_attempts_are_made(self) -> None:
        bench = lost()
        lost_at = bench.now
        for number in range(40):  # each time the zone of the one who is asked ends, and another's begins
            bench.run(0.1)
            bench.position(inside(A), inside(B) if number % 2 else outside(B), outside(C) if number % 2 else inside(C))
        (turned_at,) = [at for at, action in bench.log if isinstance(action, Fly)]
        assert turned_at <= lost_at + 2.0

    def test_a_second_attempt_does_not_delay_the_return_that_a_pilot_has_held_back(self) -> None:
        bench = in_both_zones()
        bench.mode = ModeSeen(ModeClass.HANDS, "LOITER", radio=True)
        bench.alive = {B, C}
        bench.run(5.0)
        lost_at = bench.now
        bench.run(3.5)
        bench.mode = ModeSeen(ModeClass.MISSION, "AUTO", radio=True)  # the pilot gives it back
        bench.run(3.0)
        assert [at - lost_at for at, _text in begun(bench)] == [0.0, 4.0]
        # the second attempt has time until 6 s after the loss
        assert [(at - lost_at, a) for at, a in bench.log if isinstance(a, Fly)] == [(5.0, RETURN)]
        assert [a.text for _at, a in bench.log if isinstance(a, Announce) and a.action is None] == []

    def test_the_step_before_the_loss_throws_nobody_away(self) -> None:
        # GCSB was asked 3.9 s ago, and does not answer; GCSC is asked at the loss and is ready a moment later
        bench = in_both_zones(facts=(inside(A), outside(B), inside(C)))
        bench.alive = {B, C}
        bench.run(1.2)
        bench.position(inside(A), inside(B), inside(C))
        assert bench.arbiter.view.partner == B
        while bench.arbiter.view.commander == A:
            bench.run(0.1)
        bench.run(0.3)
        assert bench.flights() == []
        key = TransferKey(A, C, bench.arbiter.view.handover_id, 1)
        bench.say(C, OnHandover(key))
        bench.say(C, DroneConnected(key))
        assert bench.arbiter.view.commander == C

    def test_a_ready_one_does_not_wait_for_anothers_operator(self) -> None:
        bench = Bench(standard={C})
        bench.alive = {A, B, C}
        bench.on_ground()
        bench.position(inside(A), inside(B), outside(C), outside(D))
        bench.autopilot_says(armed=True, flying=True)
        bench.run(10.0)
        bench.alive = {B, C}
        bench.run(5.0)
        bench.say(B, OnHandover(KEY, Consent.WAITING))
        bench.run(3.0)
        assert bench.arbiter.view.partner == B
        bench.position(inside(A), inside(B), inside(C), outside(D))
        bench.run(1.0)
        assert bench.arbiter.view.commander == C

    def test_a_question_in_reserve_ends_too(self) -> None:
        bench = self.lost_by_three()
        bench.say(B, OnHandover(self.key(B)))
        bench.say(C, OnHandover(self.key(C), Consent.WAITING))
        bench.say(D, OnHandover(self.key(D), Consent.DENIED))
        bench.say(B, OnHandover(self.key(B), Consent.DENIED))
        assert bench.arbiter.view.partner == C
        bench.run(31.0)
        assert bench.arbiter.view.partner is None, "it would have been asked for ever"

    def test_the_partner_is_asked_anew_at_the_moment_of_the_loss(self) -> None:
        bench = Bench(replace(Limits(), step_timeout_s=20.0)).up_to("REQUEST")
        bench.alive = {B}
        while bench.arbiter.view.commander == A:
            bench.run(0.1)
        at, _station, message, _n = bench.sent()[-1]
        assert message == HandoverRequest(KEY, Reason.COMMANDER_LOST)
        assert at == next(when for when, a in bench.log if isinstance(a, Record) and a.event == "authority_lost")


class TestTakeOff:
    """What an operator began on the ground does not follow the aircraft into the air where it could not begin there."""

    def test_a_request_of_a_station_elsewhere_ends(self) -> None:
        bench = Bench().on_ground()
        bench.digests[B] = bytes(32)
        bench.give(bench.request(B, timeout_s=60.0))
        assert bench.arbiter.view.partner == B
        bench.autopilot_says(armed=True, flying=True)
        assert bench.arbiter.view.partner is None
        assert bench.arbiter.view.commander == A

    def test_a_part_of_start_ends_it_as_start_does(self) -> None:
        bench = Bench().on_ground()
        bench.position(inside(A), inside(B))
        bench.give(bench.request(B, timeout_s=60.0))
        assert bench.arbiter.take_off_needs(A, bench.now) == ()
        bench.give(TakeOffPassed(A))
        assert bench.arbiter.view.partner is None

    def test_nothing_commits_to_a_station_that_holds_another_mission_by_now(self) -> None:
        bench = lost()
        bench.say(B, OnHandover(KEY))
        bench.digests[B] = bytes(32)
        bench.run(1.2)
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view.commander is None


@pytest.mark.parametrize("word", [Consent.WAITING, Consent.GRANTED])
def test_a_late_word_of_the_lost_commander_takes_no_time_from_the_partners_operator(word: Consent) -> None:
    """The partner was told to set itself up before its operator had answered, and its operator's time was over."""
    bench = Bench().in_transfer()
    bench.alive = {B}
    while not bench.arbiter._authority.lost:
        bench.say(B, OnHandover(KEY, Consent.WAITING))
        bench.run(0.5)
    # the first may have been said to the question before the loss; the station answers the repeated question once more
    bench.say(B, OnHandover(KEY, Consent.WAITING))
    bench.say(B, OnHandover(KEY, Consent.WAITING))
    bench.say(A, OkHandover(KEY, word))
    bench.run(4.0)
    assert [message for _at, _to, message, _attempt in bench.sent() if isinstance(message, ConnectHandover)] == []
    assert bench.arbiter.view.partner == B
    bench.say(B, OnHandover(KEY, Consent.GRANTED))
    bench.say(B, DroneConnected(KEY))
    assert bench.arbiter.view.commander == B
