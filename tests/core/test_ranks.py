# SPDX-License-Identifier: GPL-3.0-or-later

"""One transfer at a time, and the gravest reason first: nobody's question holds up what the aircraft needs."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import pytest

from mavproxy_handover.core.authority.transfer import Cause, Step, Transfer
from mavproxy_handover.core.common.events import (
    BeginStart,
    ControlAnswer,
    ControlRequested,
    ControlResult,
    LinkJudged,
    StartRefused,
    StartRequested,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import RANKS
from tests.core.bench import (
    A,
    B,
    Bench,
    C,
    ConnectHandover,
    Consent,
    D,
    DroneConnected,
    HandoverRequest,
    HandoverResult,
    OkHandover,
    OnHandover,
    Outcome,
    Phase,
    Reason,
    TransferKey,
    inside,
    outside,
)

#: from the least grave reason to the gravest, as DESIGN has it
ORDER = (
    Reason.REQUESTED,
    Reason.ZONE,
    Reason.GIVEN,
    Reason.LINK_QUALITY,
    Reason.ZONE_ENDS,
    Reason.COMMANDER_LOST,
)
#: the steps before CONNECT_HANDOVER has been sent
EARLY = (Step.REQUEST, Step.CONSENT)


def key(bench: Bench, owner: int = A) -> TransferKey:
    view = bench.arbiter.view
    assert view.partner is not None
    return TransferKey(owner, view.partner, view.handover_id, view.epoch)


def flight() -> Bench:
    """On mission under GCSA in its zone and GCSC's, which calls nobody: it was entered on the ground."""
    bench = Bench()
    bench.alive = {A, B, C}
    bench.on_ground()
    bench.position(inside(A), outside(B), inside(C))
    bench.autopilot_says(armed=True, flying=True)
    bench.run(10.0)
    assert bench.arbiter.view.why is Reason.NONE
    bench.log.clear()
    return bench


def request(bench: Bench) -> None:
    bench.give(bench.request(C, timeout_s=60.0))


def give(bench: Bench) -> None:
    bench.give(bench.request(A, give_to=C))


def zone(bench: Bench) -> None:
    bench.position(inside(A), inside(B), inside(C))


def zone_ends(bench: Bench) -> None:
    bench.position(inside(A, exit_s=7.0), inside(B, exit_s=900.0), inside(C, exit_s=6.0))


def both_outlast_it(bench: Bench) -> None:
    bench.position(inside(A, exit_s=7.0), inside(B, exit_s=900.0), inside(C, exit_s=800.0))


#: reason -> what leads to it; zones and links choose GCSB, operators GCSC
LEADS: dict[Reason, Callable[[Bench], None]] = {
    Reason.REQUESTED: request,
    Reason.ZONE: zone,
    Reason.GIVEN: give,
    Reason.ZONE_ENDS: zone_ends,
}


class TestOrder:
    def test_the_order(self) -> None:
        assert sorted(RANKS, key=RANKS.__getitem__) == list(ORDER)
        assert len(set(RANKS.values())) == len(ORDER)

    @pytest.mark.parametrize("step", Step, ids=lambda step: step.name)
    @pytest.mark.parametrize(("present", "graver"), list(product(ORDER, ORDER)), ids=lambda reason: reason.name)
    def test_every_pair_in_every_step(self, step: Step, present: Reason, graver: Reason) -> None:
        until = 2.0 if present is Reason.COMMANDER_LOST else None
        transfer = Transfer(TransferKey(A, B, 1, 1), present, Limits(), 0.0, forced_until=until)
        transfer.step = step
        expected = step in EARLY and ORDER.index(graver) > ORDER.index(present)
        assert transfer.yields_to(graver) is expected

    @pytest.mark.parametrize("reason", ORDER, ids=lambda reason: reason.name)
    def test_nothing_takes_the_place_of_a_forced_one(self, reason: Reason) -> None:
        transfer = Transfer(TransferKey(A, B, 1, 1), Reason.REQUESTED, Limits(), 0.0)
        transfer.move(Cause.COMMANDER_LOST, 1.0)
        assert not transfer.yields_to(reason)


class TestPreemption:
    @pytest.mark.parametrize(
        ("present", "graver"),
        # to give to the station that asks is to consent: see below
        [
            (p, g)
            for p, g in product(LEADS, LEADS)
            if ORDER.index(g) > ORDER.index(p) and (p, g) != (Reason.REQUESTED, Reason.GIVEN)
        ],
        ids=lambda reason: reason.name,
    )
    @pytest.mark.parametrize("step", EARLY, ids=lambda step: step.name)
    def test_a_graver_reason_takes_the_place_of_a_lesser_one(self, present: Reason, graver: Reason, step: Step) -> None:
        bench = flight()
        LEADS[present](bench)
        first = key(bench)
        assert bench.arbiter.view.why is present
        if step is Step.CONSENT and present is not Reason.GIVEN:  # a gift has been consented to
            bench.say(first.to_station, OnHandover(first))
        bench.log.clear()
        LEADS[graver](bench)
        assert bench.arbiter.view.why is graver
        second = key(bench)
        if second.to_station == first.to_station:
            assert second == first, "the same transfer, for a graver reason"
            return
        over = HandoverResult(first, A, Outcome.ABORTED, Reason.PREEMPTED)
        sent = [(station, message) for _at, station, message, _n in bench.sent()]
        assert sent[:3] == [(A, over), (first.to_station, over), (second.to_station, HandoverRequest(second, graver))]

    @pytest.mark.parametrize(
        ("present", "lesser"),
        [(p, g) for p, g in product(LEADS, LEADS) if ORDER.index(g) <= ORDER.index(p)],
        ids=lambda reason: reason.name,
    )
    def test_a_lesser_one_or_an_equal_takes_no_place(self, present: Reason, lesser: Reason) -> None:
        bench = flight()
        LEADS[present](bench)
        first = key(bench)
        LEADS[lesser](bench)
        assert key(bench) == first
        assert bench.arbiter.view.why is present

    def test_not_once_the_partner_sets_itself_up(self) -> None:
        bench = flight()
        request(bench)
        first = key(bench)
        bench.say(C, OnHandover(first))
        bench.say(A, OkHandover(first))
        assert bench.sent()[-1][2] == ConnectHandover(first)
        zone_ends(bench)
        assert key(bench) == first
        assert bench.arbiter.view.why is Reason.REQUESTED

    def test_an_operator_who_is_asked_does_not_hold_up_the_zone(self) -> None:
        """The fault: one request, answered "waiting", held the only slot for a minute."""
        bench = flight()
        request(bench)
        bench.say(C, OnHandover(key(bench)))
        bench.say(A, OkHandover(key(bench), Consent.WAITING))
        zone(bench)
        assert (bench.arbiter.view.partner, bench.arbiter.view.why) == (B, Reason.ZONE)
        second = key(bench)
        for station, word in ((B, OnHandover(second)), (A, OkHandover(second)), (B, DroneConnected(second))):
            bench.say(station, word)
        bench.run(2.0)
        assert bench.arbiter.view.commander == B

    def test_nor_does_one_of_the_partner_while_the_zone_ends_and_another_could_take_it(self) -> None:
        """The fault: the aircraft left the zone while an operator was asked for half a minute."""
        bench = flight()
        both_outlast_it(bench)
        first = key(bench)
        assert (first.to_station, bench.arbiter.view.why) == (B, Reason.ZONE_ENDS)
        bench.say(B, OnHandover(first, Consent.WAITING))
        bench.run(bench.limits.step_timeout_s)
        both_outlast_it(bench)
        second = key(bench)
        assert (second.to_station, bench.arbiter.view.why) == (C, Reason.ZONE_ENDS)
        for station, word in ((C, OnHandover(second)), (A, OkHandover(second)), (C, DroneConnected(second))):
            bench.say(station, word)
        bench.run(2.0)
        assert bench.arbiter.view.commander == C

    def test_nor_one_who_was_asked_before_the_zone_ended(self) -> None:
        bench = flight()
        zone(bench)
        bench.say(B, OnHandover(key(bench), Consent.WAITING))
        bench.run(6.0)
        both_outlast_it(bench)
        assert (bench.arbiter.view.partner, bench.arbiter.view.why) == (B, Reason.ZONE_ENDS)
        bench.run(bench.limits.step_timeout_s)
        both_outlast_it(bench)
        assert bench.arbiter.view.partner == C

    def test_where_nobody_else_is_there_the_operator_has_the_time(self) -> None:
        bench = flight()
        bench.position(inside(A, exit_s=7.0), inside(B, exit_s=900.0), outside(C))
        first = key(bench)
        bench.say(B, OnHandover(first, Consent.WAITING))
        bench.run(bench.limits.operator_timeout_s - 0.1)
        assert key(bench) == first

    def test_the_commander_may_give_while_another_asks(self) -> None:
        bench = flight()
        bench.position(inside(A), inside(B), inside(C))
        bench.say(B, OnHandover(key(bench), Consent.DENIED))
        request(bench)
        bench.run(9.0)
        answer = [a for a in bench.give(bench.request(A, give_to=B)) if isinstance(a, ControlAnswer)]
        assert answer == [ControlAnswer(A, ControlResult.ACCEPTED)]
        assert (bench.arbiter.view.partner, bench.arbiter.view.why) == (B, Reason.GIVEN)

    def test_a_gift_that_a_zone_takes_over_needs_no_consent_again(self) -> None:
        bench = flight()
        bench.give(bench.request(A, give_to=C))
        first = key(bench)
        bench.say(C, OnHandover(first, Consent.WAITING))
        bench.position(inside(A, exit_s=7.0), outside(B), inside(C))
        assert key(bench) == first
        assert bench.arbiter.view.why is Reason.ZONE_ENDS
        bench.say(C, OnHandover(first))
        assert bench.sent()[-1][1:3] == (C, ConnectHandover(first))

    def test_whom_it_was_taken_from_is_told_until_it_knows(self) -> None:
        bench = flight()
        request(bench)
        first = key(bench)
        zone_ends(bench)
        bench.log.clear()
        bench.run(3.0)
        told = [message for _at, station, message, _n in bench.sent() if station == C]
        assert told
        assert {type(message) for message in told} == {HandoverResult}
        assert all(message.key == first for message in told if isinstance(message, HandoverResult))

    def test_link_quality_comes_before_a_zone_and_after_its_end(self) -> None:
        bench = flight()
        bench.position(inside(A), outside(B), inside(C))
        bench.give(LinkJudged(A, True, False, "loss 40%"))
        bench.run(3.5)
        assert bench.arbiter.view.why is Reason.LINK_QUALITY
        assert bench.arbiter.view.partner == C
        bench.position(inside(A), inside(B), inside(C))
        assert bench.arbiter.view.partner == C
        zone_ends(bench)
        assert (bench.arbiter.view.partner, bench.arbiter.view.why) == (B, Reason.ZONE_ENDS)


class TestPause:
    @staticmethod
    def answer(bench: Bench, asked: ControlRequested) -> ControlAnswer:
        (answer,) = [a for a in bench.give(asked) if isinstance(a, ControlAnswer)]
        return answer

    def test_a_request_that_was_denied_waits_like_any_other(self) -> None:
        bench = flight()
        request(bench)
        bench.say(C, OnHandover(key(bench)))
        bench.say(A, OkHandover(key(bench), Consent.DENIED))
        assert self.answer(bench, bench.request(C)).text == "too soon: again in 10 s"
        bench.run(9.0)
        assert self.answer(bench, bench.request(C)).text == "too soon: again in 1 s"
        bench.run(1.0)
        assert self.answer(bench, bench.request(C)).result is ControlResult.PENDING

    def test_it_keeps_no_graver_reason_away_from_the_station(self) -> None:
        bench = flight()
        bench.position(inside(A), outside(B), inside(C))
        request(bench)
        bench.say(C, OnHandover(key(bench)))
        bench.say(A, OkHandover(key(bench), Consent.DENIED))
        bench.position(inside(A, exit_s=7.0), outside(B), inside(C))
        assert (bench.arbiter.view.partner, bench.arbiter.view.why) == (C, Reason.ZONE_ENDS)

    def test_but_a_zone_that_was_denied_keeps_requests_away(self) -> None:
        bench = flight()
        zone(bench)
        bench.say(B, OnHandover(key(bench)))
        bench.say(A, OkHandover(key(bench), Consent.DENIED))
        assert self.answer(bench, bench.request(B)).result is ControlResult.DENIED


class TestStart:
    def asked(self) -> Bench:
        bench = Bench()
        bench.alive = {A, B}
        bench.on_ground()
        bench.give(bench.request(B, timeout_s=60.0))
        assert bench.arbiter.view.partner == B
        return bench

    def test_another_stations_request_does_not_keep_the_commander_on_the_ground(self) -> None:
        bench = self.asked()
        assert bench.arbiter.start_needs(A, bench.now) == ()
        actions = bench.give(StartRequested(A))
        assert [a for a in actions if isinstance(a, BeginStart)] == [BeginStart(A)]
        assert bench.arbiter.view.partner is None
        assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.PREEMPTED]

    def test_a_start_that_is_refused_ends_nothing(self) -> None:
        bench = self.asked()
        bench.position(outside(A), outside(B))
        actions = bench.give(StartRequested(A))
        assert [a for a in actions if isinstance(a, StartRefused)] != []
        assert bench.arbiter.view.partner == B

    def test_nor_does_one_of_another(self) -> None:
        bench = self.asked()
        bench.give(StartRequested(B))
        assert bench.arbiter.view.partner == B

    def test_what_the_commander_gives_away_itself_it_does_not_start(self) -> None:
        bench = Bench().on_ground()
        bench.give(bench.request(A, give_to=B))
        assert bench.arbiter.start_needs(A, bench.now) == ("a handover is under way",)


def test_nobody_is_asked_on_the_ground_by_zones() -> None:
    bench = Bench().on_ground()
    bench.position(inside(A, exit_s=1.0), inside(B), outside(C), outside(D))
    bench.run(3.0)
    assert bench.sent() == []
    assert bench.arbiter.view.phase is Phase.ON_LOAD


def test_stations_that_never_take_the_aircraft_keep_none_away_that_would() -> None:
    """Two that answer CONNECT and nothing else, and a third whose zone holds the aircraft as well."""
    bench = Bench(route=())
    bench.alive = {A, B, C, D}
    bench.on_ground()
    bench.position(inside(A), outside(B), outside(C), outside(D))
    bench.autopilot_says(armed=True, flying=True)
    bench.run(10.0)
    bench.position(outside(A), inside(B), inside(C), inside(D))
    for _ in range(300):
        bench.run(0.1)
        if bench.arbiter.view.partner == D:
            there = key(bench)
            for station, word in ((D, OnHandover(there)), (A, OkHandover(there)), (D, DroneConnected(there))):
                bench.say(station, word)
    assert bench.arbiter.view.commander == D
