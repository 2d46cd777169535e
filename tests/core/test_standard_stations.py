# SPDX-License-Identifier: GPL-3.0-or-later

"""Stations that run no module of ours and speak the operator-control protocol of the MAVLink standard only.

Such a station sends heartbeats and requests of control, and is asked by a command. It never hears or says any of our
messages: each test ends with a look at what was sent to it.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from mavproxy_handover.core.common.events import (
    Action,
    Advise,
    ControlAnswer,
    ControlRequested,
    ControlResult,
    Fly,
    NotifyOwner,
    Send,
    StationHeard,
    ViewChanged,
)
from mavproxy_handover.core.common.model import AuthorityView, LeaseState
from tests.core.bench import (
    KEY,
    NAMES,
    A,
    B,
    Bench,
    C,
    ConnectHandover,
    Consent,
    DisconnectHandover,
    DroneConnected,
    HandoverResult,
    OkHandover,
    OnHandover,
    Outcome,
    Phase,
    Reason,
    TransferKey,
    inside,
    not_records,
    outside,
)

ALL = frozenset(NAMES)
MOVED = AuthorityView(Phase.ON_MISSION, B, None, 2, LeaseState.HELD, True, 1)
UNDER_WAY = AuthorityView(Phase.ON_HANDOVER, A, B, 1, LeaseState.TRANSFER, True, 1, why=Reason.ZONE)
STAYS = AuthorityView(Phase.ON_MISSION, A, None, 1, LeaseState.HELD, True, 1)


class Made:
    """Makes benches and looks at all of them at the end."""

    def __init__(self) -> None:
        self.benches: list[Bench] = []

    def __call__(self, *standard: int) -> Bench:
        bench = Bench(standard=standard)
        self.benches.append(bench)
        return bench

    def on_mission(self, *standard: int) -> Bench:
        bench = self(*standard).on_mission()
        bench.log.clear()
        return bench


@pytest.fixture
def made() -> Iterator[Made]:
    made = Made()
    yield made
    for bench in made.benches:
        heard_ours = {a.station for _at, a in bench.log if isinstance(a, Send)} & bench.standard
        assert heard_ours == set(), "one of our messages was sent to a station that does not know it"
        asked = {a.station for _at, a in bench.log if isinstance(a, NotifyOwner)}
        assert asked <= bench.standard, "a station with our module was asked by the standard's command"


def questions(bench: Bench) -> list[NotifyOwner]:
    return [a for _at, a in bench.log if isinstance(a, NotifyOwner)]


def answers(actions: list[Action]) -> list[ControlAnswer]:
    return [a for a in actions if isinstance(a, ControlAnswer)]


def in_both_zones(made: Made) -> Bench:
    """Two standard stations; both zones were entered on the ground, so none calls."""
    bench = made(*ALL).on_ground()
    bench.position(inside(A), inside(B), outside(C))
    bench.autopilot_says(armed=True, flying=True)
    bench.run(10.0)
    assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 1, LeaseState.HELD, True, 0)
    bench.log.clear()
    return bench


class TestParent:
    def test_takes_up_its_vehicle_by_its_heartbeat(self, made: Made) -> None:
        bench = made(A)
        bench.run(1.0)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, A, None, 1, LeaseState.HELD, False, 0)

    def test_not_while_armed(self, made: Made) -> None:
        bench = made(A)
        bench.armed = bench.flying = True
        bench.run(20.0)
        assert bench.arbiter.view.commander is None

    def test_not_without_a_heartbeat(self, made: Made) -> None:
        bench = made(A)
        bench.alive = {B}
        bench.run(20.0)
        assert bench.arbiter.view.commander is None

    def test_is_never_asked_connect(self, made: Made) -> None:
        bench = made(A, B)
        bench.alive = {A, B, C}
        bench.run(3.0)
        bench.alive = set()
        bench.run(6.0)
        bench.alive = {A, B, C}  # heard again: our stations are asked at once
        bench.run(3.0)
        assert {a.station for _at, a in bench.log if isinstance(a, Send)} == {C, 254}

    def test_is_lost_and_back_like_any_other(self, made: Made) -> None:
        bench = made.on_mission(A)
        bench.alive = set()
        bench.run(5.0)
        assert bench.arbiter.view.commander is None
        bench.give(StationHeard(A))
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 2


class TestFromOursToStandard:
    """The partner's words are taken as said: a heartbeat is all that it can prove."""

    def test_the_commander_is_asked_at_once(self, made: Made) -> None:
        bench = made.on_mission(B)
        actions = bench.position(inside(A), inside(B))
        assert not_records(actions) == [
            ViewChanged(UNDER_WAY, Reason.ZONE),
            Send(A, OnHandover(KEY, reason=Reason.ZONE, relayed=True), 1),
        ]

    def test_it_consents_and_releases(self, made: Made) -> None:
        bench = made.on_mission(B)
        bench.position(inside(A), inside(B))
        assert not_records(bench.say(A, OkHandover(KEY))) == [Send(A, DroneConnected(KEY, relayed=True), 1)]
        assert bench.arbiter.view == UNDER_WAY
        result = HandoverResult(TransferKey(A, B, 1, 2), B, Outcome.COMMITTED, Reason.ZONE)
        assert not_records(bench.say(A, DisconnectHandover(KEY))) == [
            ViewChanged(MOVED, Reason.ZONE),
            Send(A, result, 1),
        ]

    def test_without_its_consent_nothing_moves(self, made: Made) -> None:
        bench = made.on_mission(B)
        bench.position(inside(A), inside(B))
        bench.run(3.9)
        assert bench.arbiter.view == UNDER_WAY
        bench.run(0.1)
        assert bench.arbiter.view == STAYS
        assert bench.records("transfer_aborted")[0].reason is Reason.COMMANDER_SILENT

    def test_its_operator_may_take_his_time(self, made: Made) -> None:
        bench = made.on_mission(B)
        bench.position(inside(A), inside(B))
        bench.say(A, OkHandover(KEY, Consent.WAITING))
        bench.run(29.0)
        assert bench.arbiter.view == UNDER_WAY
        bench.say(A, OkHandover(KEY))
        bench.say(A, DisconnectHandover(KEY))
        assert bench.arbiter.view == MOVED

    def test_falls_silent_after_its_consent(self, made: Made) -> None:
        bench = made.on_mission(B)
        bench.position(inside(A), inside(B))
        bench.say(A, OkHandover(KEY))
        bench.run(2.0)
        assert bench.arbiter.view == MOVED
        assert bench.records("transfer_committed")[0].reason is Reason.RELEASE_TIMEOUT

    def test_given_it_is_there_at_once(self, made: Made) -> None:
        bench = made.on_mission(B)
        bench.position(inside(A), inside(B, margin_m=4.0))
        bench.facts = (inside(A), inside(B))
        bench.give(bench.request(A, give_to=B))
        assert bench.arbiter.view.commander == A, "not in its zone yet"
        bench.position(inside(A), inside(B))
        bench.give(bench.request(A, give_to=B))
        assert bench.arbiter.view == MOVED

    def test_a_silent_one_is_no_partner(self, made: Made) -> None:
        bench = made.on_mission(B)
        bench.alive = {A}
        bench.run(6.0)
        bench.position(inside(A), inside(B))
        bench.run(5.0)
        assert bench.arbiter.view.partner is None
        assert [r.text for r in bench.records("partner_unfit")] == ["GCSB cannot be partner: partner silent"]

    def test_mission_and_version_cannot_differ(self, made: Made) -> None:
        bench = made(B)
        bench.digests[B], bench.versions[B] = b"", 77
        bench.on_mission()
        assert bench.arbiter.unfit(B, bench.now) is None

    def test_lost_on_the_way_it_gets_nothing(self, made: Made) -> None:
        bench = made.on_mission(B)
        bench.position(inside(A), inside(B))
        bench.say(A, OkHandover(KEY, Consent.WAITING))
        bench.alive = {A}
        bench.run(5.0)
        assert bench.arbiter.view == STAYS
        assert bench.records("transfer_aborted")[0].reason is Reason.PARTNER_SILENT


class TestFromStandardToOurs:
    """The question of consent is the standard's command; allowing takeover is the answer, and the release as well."""

    def test_asked_when_the_partner_is_ready(self, made: Made) -> None:
        bench = made.on_mission(A)
        bench.position(inside(A), inside(B))
        assert questions(bench) == []
        actions = bench.say(B, OnHandover(KEY, relay=True))
        assert not_records(actions) == [NotifyOwner(A, B, 30.0)]

    def test_the_partner_has_no_more_time_than_from_any_other(self, made: Made) -> None:
        bench = made.on_mission(A)
        bench.position(inside(A), inside(B))
        bench.run(4.0)
        assert bench.arbiter.view == STAYS
        assert bench.records("transfer_aborted")[0].reason is Reason.PARTNER_SILENT

    def test_its_consent_is_to_allow_takeover(self, made: Made) -> None:
        bench = made.on_mission(A)
        bench.position(inside(A), inside(B))
        bench.say(B, OnHandover(KEY, relay=True))
        actions = bench.give(bench.request(A, takeover=True))
        assert not_records(actions) == [
            ControlAnswer(A, ControlResult.ACCEPTED),
            Send(B, ConnectHandover(KEY), 1),
        ]
        result = HandoverResult(TransferKey(A, B, 1, 2), B, Outcome.COMMITTED, Reason.ZONE)
        assert not_records(bench.say(B, DroneConnected(KEY, relay=True))) == [
            ViewChanged(MOVED, Reason.ZONE),
            Send(B, result, 1),
        ]

    @pytest.mark.parametrize("how", ["releases", "gives"])
    def test_or_to_let_go(self, made: Made, how: str) -> None:
        bench = made.on_mission(A)
        bench.position(inside(A), inside(B))
        bench.say(B, OnHandover(KEY, relay=True))
        if how == "releases":
            bench.give(ControlRequested(A, False, False, 0.0, A))
        else:
            bench.give(bench.request(A, give_to=B))
        assert bench.arbiter.view.commander == A
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view == MOVED

    def test_its_denial_is_to_ask_for_itself(self, made: Made) -> None:
        bench = made.on_mission(A)
        bench.position(inside(A), inside(B))
        bench.say(B, OnHandover(KEY, relay=True))
        denied = HandoverResult(KEY, A, Outcome.ABORTED, Reason.COMMANDER_DENIED)
        assert not_records(bench.give(bench.request(A))) == [
            ControlAnswer(A, ControlResult.ACCEPTED),
            ViewChanged(STAYS, Reason.COMMANDER_DENIED),
            Advise((A,), "No handover: GCSA's operator denied it."),
            Send(B, denied, 1),
        ]
        bench.run(9.5)
        assert questions(bench)[1:] == []

    def test_silence_is_no_consent(self, made: Made) -> None:
        bench = made.on_mission(A)
        bench.position(inside(A), inside(B))
        bench.say(B, OnHandover(KEY, relay=True))
        bench.run(29.9)
        assert bench.arbiter.view == UNDER_WAY
        bench.run(0.1)
        assert bench.arbiter.view == STAYS
        assert bench.records("transfer_aborted")[0].reason is Reason.COMMANDER_UNANSWERED
        assert Advise((A,), "No handover: GCSA's operator did not answer.") in [action for _at, action in bench.log]
        # its countdown ran along with ours
        assert questions(bench)[0].timeout_s == 30.0
        assert [q.timeout_s for q in questions(bench)] == sorted((q.timeout_s for q in questions(bench)), reverse=True)

    def test_takeover_allowed_before_it_is_not_asked(self, made: Made) -> None:
        bench = made.on_mission(A)
        bench.give(bench.request(A, takeover=True))
        bench.position(inside(A), inside(B))
        bench.say(B, OnHandover(KEY, relay=True))
        bench.say(B, DroneConnected(KEY, relay=True))
        assert bench.arbiter.view == MOVED
        assert questions(bench) == []

    def test_lost_before_it_could_answer(self, made: Made) -> None:
        bench = made.on_mission(A)
        bench.position(inside(A), inside(B))
        bench.say(B, OnHandover(KEY, relay=True))
        bench.alive = {B}
        bench.run(5.0)
        assert bench.arbiter.view.commander is None
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view == MOVED
        assert bench.flights() == []


class TestBetweenTwo:
    """Neither says a word of ours: what moves authority is the commander's request alone, or its loss."""

    def test_zone_question_consent_commit(self, made: Made) -> None:
        bench = made.on_mission(*ALL)
        actions = bench.position(inside(A), inside(B))
        assert not_records(actions) == [ViewChanged(UNDER_WAY, Reason.ZONE), NotifyOwner(A, B, 30.0)]
        actions = bench.give(bench.request(A, takeover=True))
        assert not_records(actions) == [
            ControlAnswer(A, ControlResult.ACCEPTED),
            ViewChanged(MOVED, Reason.ZONE),
        ]

    def test_there_and_back_again(self, made: Made) -> None:
        bench = made.on_mission(*ALL)
        for number, (old, new) in enumerate(((A, B), (B, A), (A, B)), start=1):
            bench.position(inside(old), outside(new))
            bench.run(6.0)
            bench.position(inside(old), inside(new))
            assert bench.arbiter.view.partner == new
            bench.give(bench.request(old, takeover=True))
            assert (bench.arbiter.view.commander, bench.arbiter.view.epoch) == (new, number + 1)

    def test_by_request_and_consent(self, made: Made) -> None:
        bench = in_both_zones(made)
        assert answers(bench.give(bench.request(B))) == [ControlAnswer(B, ControlResult.PENDING)]
        assert questions(bench)[-1] == NotifyOwner(A, B, 10.0)
        bench.give(bench.request(A, takeover=True))
        assert bench.arbiter.view.commander == B

    def test_by_request_just_after_the_commander_has_said_no(self, made: Made) -> None:
        bench = made.on_mission(*ALL)
        bench.position(inside(A), inside(B))
        bench.give(bench.request(A))  # not now
        assert bench.arbiter.view.partner is None
        assert answers(bench.give(bench.request(B))) == [
            ControlAnswer(B, ControlResult.DENIED, "too soon: again in 10 s")
        ]

    def test_by_request_where_takeover_is_allowed(self, made: Made) -> None:
        bench = in_both_zones(made)
        bench.give(bench.request(A, takeover=True))
        assert answers(bench.give(bench.request(B))) == [ControlAnswer(B, ControlResult.ACCEPTED)]
        assert bench.arbiter.view == MOVED

    def test_but_not_outside_its_zone(self, made: Made) -> None:
        bench = made.on_mission(*ALL)
        bench.give(bench.request(A, takeover=True))
        (answer,) = answers(bench.give(bench.request(B)))
        assert answer == ControlAnswer(B, ControlResult.DENIED, "the aircraft is outside the zone of GCSB")

    def test_a_zone_that_calls_need_not_ask_either(self, made: Made) -> None:
        bench = made.on_mission(*ALL)
        bench.give(bench.request(A, takeover=True))
        bench.position(inside(A), inside(B))
        assert bench.arbiter.view == MOVED
        assert questions(bench) == []

    def test_released_in_flight_it_goes_to_the_one_whose_zone_holds_the_aircraft(self, made: Made) -> None:
        bench = in_both_zones(made)
        bench.give(ControlRequested(A, False, False, 0.0, A))
        assert bench.arbiter.view == MOVED

    def test_lost_in_flight_the_other_has_it_at_that_moment(self, made: Made) -> None:
        # its own denial, a moment before, is no reason to turn home
        bench = made.on_mission(*ALL)
        bench.position(inside(A), inside(B))
        bench.give(bench.request(A))
        bench.alive = {B}
        bench.run(5.0)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, B, None, 2, LeaseState.HELD, True, 2)
        assert bench.flights() == []

    def test_lost_while_it_is_asked(self, made: Made) -> None:
        bench = made.on_mission(*ALL)
        bench.position(inside(A), inside(B))
        bench.alive = {B}
        bench.run(5.0)
        assert bench.arbiter.view == MOVED
        assert bench.flights() == []
        assert bench.watch.moves[-1][1:] == (A, B, 2)

    def test_both_lost(self, made: Made) -> None:
        bench = made.on_mission(*ALL)
        bench.position(inside(A), inside(B))
        bench.alive = set()
        bench.run(20.0)
        assert bench.arbiter.view.commander is None
        assert [fly.reason for fly in bench.flights()] == [Reason.COMMANDER_LOST]

    def test_on_the_ground(self, made: Made) -> None:
        bench = made(*ALL).on_ground()
        bench.log.clear()
        assert answers(bench.give(bench.request(B))) == [ControlAnswer(B, ControlResult.PENDING)]
        assert questions(bench) == [NotifyOwner(A, B, 10.0)]
        bench.give(bench.request(A, takeover=True))
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, B, None, 2, LeaseState.HELD, False, 1)

    def test_a_third_one_can_neither_consent_nor_deny(self, made: Made) -> None:
        bench = made(*ALL)
        bench.alive = {A, B, C}
        bench.on_mission()
        bench.position(inside(A), inside(B), inside(C))
        partner = bench.arbiter.view.partner
        assert partner == B
        for request in (bench.request(C), bench.request(C, takeover=True), bench.request(C, give_to=B)):
            assert answers(bench.give(request))[0].result is ControlResult.DENIED
        for request in (bench.request(B), bench.request(B, takeover=True)):
            assert answers(bench.give(request))[0].result is ControlResult.PENDING
        assert bench.arbiter.view == UNDER_WAY

    def test_after_a_restart(self, made: Made) -> None:
        bench = made.on_mission(*ALL)
        bench.restart()
        bench.alive = {B}
        bench.run(2.0)
        assert answers(bench.give(bench.request(B)))[0].result is ControlResult.DENIED
        bench.give(StationHeard(A))
        assert bench.arbiter.view.commander == A
        assert bench.arbiter.view.epoch == 2

    def test_the_question_is_not_repeated_more_often_than_our_own_messages(self, made: Made) -> None:
        bench = made.on_mission(*ALL)
        asked_at = bench.now
        bench.position(inside(A), inside(B))
        bench.run(3.0)
        assert [round(at - asked_at, 3) for at, a in bench.log if isinstance(a, NotifyOwner)] == [
            0.0,
            0.2,
            0.5,
            0.95,
            1.625,
            2.625,
        ]


def test_what_calls_itself_standard_and_speaks_our_words_wins_nothing_by_it() -> None:
    bench = Bench(standard={B}).on_mission()
    bench.position(inside(A), inside(B))
    for word in (OnHandover(KEY), DroneConnected(KEY), OkHandover(KEY), DisconnectHandover(KEY)):
        bench.say(B, word)
    assert bench.arbiter.view == UNDER_WAY


def test_no_return_is_commanded_in_a_whole_flight_of_standard_stations() -> None:
    bench = Bench(standard=ALL).on_mission()
    for old, new in ((A, B), (B, A), (A, B), (B, A)):
        bench.position(inside(old), inside(new))
        bench.give(bench.request(old, takeover=True))
        bench.position(outside(old), inside(new))
        bench.run(8.0)
    assert bench.arbiter.view.commander == A
    assert bench.arbiter.view.epoch == 5
    assert [a for _at, a in bench.log if isinstance(a, Fly)] == []
