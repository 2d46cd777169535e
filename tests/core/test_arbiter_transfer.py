# SPDX-License-Identifier: GPL-3.0-or-later

"""A transfer as the stations see it: every message with its time, every way it can end, and who is not listened to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf

import pytest

from mavproxy_handover.core.authority.transfer import Step
from mavproxy_handover.core.common.events import Cancel, Fly, PositionSeen, Record, Send, StationHeard, ViewChanged
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, LeaseState
from tests.core.bench import (
    KEY,
    A,
    B,
    Bench,
    C,
    Connect,
    ConnectAck,
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

UNDER_WAY = AuthorityView(Phase.ON_HANDOVER, A, B, 1, LeaseState.TRANSFER, True, 1, why=Reason.ZONE)
STAYS = AuthorityView(Phase.ON_MISSION, A, None, 1, LeaseState.HELD, True, 1)
MOVED = AuthorityView(Phase.ON_MISSION, B, None, 2, LeaseState.HELD, True, 1)
COMMITTED = HandoverResult(TransferKey(A, B, 1, 2), B, Outcome.COMMITTED, Reason.ZONE)
ALL_STEPS = [step.name for step in Step]

#: ways to end it without a commit: what happens, the reason that is given, the steps in which it ends it
WAYS: dict[str, tuple[Callable[[Bench], object], Reason, list[str]]] = {
    "the partner's zone is left": (lambda b: b.position(inside(A), outside(B)), Reason.LEFT_REGION, ALL_STEPS),
    "the commander cancels": (lambda b: b.give(Cancel(A)), Reason.CANCELLED, ALL_STEPS),
    "the partner cancels": (lambda b: b.give(Cancel(B)), Reason.CANCELLED, ALL_STEPS),
    "the partner refuses": (
        lambda b: b.say(B, OnHandover(KEY, Consent.DENIED)),
        Reason.PARTNER_REFUSED,
        ["REQUEST", "CONSENT", "CONNECT", "CONNECT_FREED"],
    ),
    "the commander denies": (
        lambda b: b.say(A, OkHandover(KEY, Consent.DENIED)),
        Reason.COMMANDER_DENIED,
        ["REQUEST", "CONSENT"],
    ),
    "the partner says nothing": (
        lambda b: b.run(4.0),
        Reason.PARTNER_SILENT,
        ["REQUEST", "CONNECT", "CONNECT_FREED"],
    ),
    "the commander says nothing": (lambda b: b.run(4.0), Reason.COMMANDER_SILENT, ["CONSENT"]),
}

OTHER_KEYS = [
    TransferKey(A, B, 1, 0),
    TransferKey(A, B, 1, 2),
    TransferKey(A, B, 1, 0xFFFFFFFF),
    TransferKey(A, B, 0, 1),
    TransferKey(A, B, 2, 1),
    TransferKey(A, B, 65535, 1),
    TransferKey(B, A, 1, 1),
    TransferKey(A, A, 1, 1),
    TransferKey(B, B, 1, 1),
    TransferKey(A, C, 1, 1),
    TransferKey(C, B, 1, 1),
    TransferKey(0, 0, 0, 0),
]

#: what makes GCSB unfit: how, the reason, what the journal says
UNFIT: dict[str, tuple[Callable[[Bench], object], Reason, str]] = {
    "silent": (lambda b: b.alive.discard(B), Reason.PARTNER_SILENT, "GCSB cannot be partner: partner silent"),
    "deaf": (lambda b: b.deaf.add(B), Reason.PARTNER_SILENT, "GCSB cannot be partner: partner silent"),
    "another version": (
        lambda b: b.versions.update({B: 2}),
        Reason.VERSION_DIFFERS,
        "GCSB cannot be partner: version differs",
    ),
    "another mission": (
        lambda b: b.digests.update({B: bytes(31) + b"x"}),
        Reason.MISSION_DIFFERS,
        "GCSB cannot be partner: mission differs",
    ),
    "no mission": (
        lambda b: b.digests.update({B: b""}),
        Reason.MISSION_MISSING,
        "GCSB cannot be partner: mission missing",
    ),
}


def aborted(reason: Reason) -> HandoverResult:
    return HandoverResult(KEY, A, Outcome.ABORTED, reason)


class TestStepByStep:
    def test_entering_the_zone_begins_it(self) -> None:
        bench = Bench().on_mission()
        actions = bench.position(inside(A), inside(B))
        assert not_records(actions) == [
            ViewChanged(UNDER_WAY, Reason.ZONE),
            Send(B, HandoverRequest(KEY, Reason.ZONE), 1),
        ]
        assert [action for action in actions if isinstance(action, Record)] == [
            Record("zone_entered", "zone of GCSB entered", station=B),
            Record("transfer_begun", "handover 1: GCSA -> GCSB", Reason.ZONE, B),
        ]

    def test_the_whole_of_it(self) -> None:
        bench = Bench().in_transfer()
        begun_at = bench.now
        bench.run(0.125)
        assert not_records(bench.say(B, OnHandover(KEY))) == []
        bench.run(0.125)
        assert not_records(bench.say(A, OkHandover(KEY))) == [Send(B, ConnectHandover(KEY), 1)]
        bench.run(0.125)
        assert not_records(bench.say(B, DroneConnected(KEY))) == []
        bench.run(0.125)
        assert bench.arbiter.view == UNDER_WAY
        assert not_records(bench.say(A, DisconnectHandover(KEY))) == [
            ViewChanged(MOVED, Reason.ZONE),
            Send(A, COMMITTED, 1),
            Send(B, COMMITTED, 1),
        ]
        (record,) = bench.records("transfer_committed")
        assert record.text == "handover 1 committed: GCSB commands, epoch 2"
        assert record.duration_s == pytest.approx(0.5)
        assert [(step.text, step.duration_s) for step in bench.records("step")] == [
            ("handover 1: request -> consent (partner ready)", pytest.approx(0.125)),
            ("handover 1: consent -> connect (commander consented)", pytest.approx(0.25)),
            ("handover 1: connect -> release (partner connected)", pytest.approx(0.375)),
        ]
        assert bench.now == pytest.approx(begun_at + 0.5)
        assert bench.arbiter.view == MOVED

    def test_with_a_ground_link_the_vehicle_sends_two_messages_and_the_result(self) -> None:
        bench = Bench().in_transfer()
        for station, message in (
            (B, OnHandover(KEY)),
            (A, OkHandover(KEY)),
            (B, DroneConnected(KEY)),
            (A, DisconnectHandover(KEY)),
        ):
            bench.say(station, message)
        assert [(station, type(message).__name__) for _at, station, message, _attempt in bench.sent()] == [
            (B, "HandoverRequest"),
            (B, "ConnectHandover"),
            (A, "HandoverResult"),
            (B, "HandoverResult"),
        ]

    def test_without_one_it_passes_the_partners_words_on_at_once(self) -> None:
        bench = Bench().in_transfer()
        assert not_records(bench.say(B, OnHandover(KEY, relay=True))) == [
            Send(A, OnHandover(KEY, reason=Reason.ZONE, relayed=True), 1)
        ]
        bench.say(A, OkHandover(KEY))
        assert not_records(bench.say(B, DroneConnected(KEY, relay=True))) == [
            Send(A, DroneConnected(KEY, relayed=True), 1)
        ]

    def test_retransmissions_keep_the_key_and_slow_down(self) -> None:
        bench = Bench().in_transfer()
        begun_at = bench.now
        bench.run(3.9)
        assert [(round(at - begun_at, 6), station, attempt) for at, station, _m, attempt in bench.sent()] == [
            (0.0, B, 1),
            (0.2, B, 2),
            (0.5, B, 3),
            (0.95, B, 4),
            (1.625, B, 5),
            (2.625, B, 6),
            (3.625, B, 7),
        ]
        assert {message for _at, _station, message, _attempt in bench.sent()} == {HandoverRequest(KEY, Reason.ZONE)}

    def test_the_partners_lost_copy_does_not_stop_it(self) -> None:
        # the commander has heard ON_HANDOVER over the ground, the vehicle has not
        bench = Bench().in_transfer()
        assert not_records(bench.say(A, OkHandover(KEY))) == [Send(B, ConnectHandover(KEY), 1)]

    def test_each_transfer_has_a_number_of_its_own(self) -> None:
        bench = Bench().in_transfer()
        bench.say(A, OkHandover(KEY, Consent.DENIED))
        bench.run(11.0)
        assert bench.arbiter.view.handover_id == 2
        assert bench.sent()[-1][2] == HandoverRequest(TransferKey(A, B, 2, 1), Reason.ZONE)

    def test_the_number_wraps_and_is_never_zero(self) -> None:
        bench = Bench().on_mission()
        bench.arbiter._authority.handover_id = 65534
        ids = []
        for _ in range(3):
            bench.position(inside(A), inside(B))
            ids.append(bench.arbiter.view.handover_id)
            bench.give(Cancel(A))
            bench.position(inside(A), outside(B))
            bench.run(11.0)
        assert ids == [65535, 1, 2]

    def test_back_again_in_a_third_epoch(self) -> None:
        bench = Bench().commit()
        bench.position(outside(A), inside(B))
        bench.run(10.0)
        bench.position(inside(A), inside(B))
        key = TransferKey(B, A, 2, 2)
        assert bench.sent()[-1][1:3] == (A, HandoverRequest(key, Reason.ZONE))
        for station, message in (
            (A, OnHandover(key)),
            (B, OkHandover(key)),
            (A, DroneConnected(key)),
            (B, DisconnectHandover(key)),
        ):
            bench.say(station, message)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 3, LeaseState.HELD, True, 2)


class TestRelease:
    def test_a_silent_commander_who_has_consented_is_relieved_after_two_seconds(self) -> None:
        bench = Bench().up_to("RELEASE")
        confirmed_at = bench.now
        bench.run(1.99)
        assert bench.arbiter.view == UNDER_WAY
        bench.run(0.51)
        assert bench.arbiter.view == MOVED
        committed = [(at, action) for at, action in bench.log if isinstance(action, ViewChanged)]
        assert committed == [(confirmed_at + 2.0, ViewChanged(MOVED, Reason.RELEASE_TIMEOUT))]
        result = replace(COMMITTED, reason=Reason.RELEASE_TIMEOUT)
        assert (A, result) in [(station, message) for _at, station, message, _attempt in bench.sent()]

    def test_meanwhile_the_commander_is_told_again(self) -> None:
        bench = Bench().up_to("RELEASE")
        confirmed_at = bench.now
        bench.run(1.9)
        assert [(round(at - confirmed_at, 6), *rest) for at, *rest in bench.sent()] == [
            (0.2, A, DroneConnected(KEY, relayed=True), 1),
            (0.4, A, DroneConnected(KEY, relayed=True), 2),
            (0.7, A, DroneConnected(KEY, relayed=True), 3),
            (1.15, A, DroneConnected(KEY, relayed=True), 4),
            (1.825, A, DroneConnected(KEY, relayed=True), 5),
        ]

    def test_a_release_before_the_partners_word_waits_for_it(self) -> None:
        bench = Bench().up_to("CONNECT")
        bench.say(A, DisconnectHandover(KEY))
        bench.run(3.0)
        assert bench.arbiter.view == UNDER_WAY
        assert {(station, message) for _at, station, message, _attempt in bench.sent()} == {(B, ConnectHandover(KEY))}
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view == MOVED

    def test_a_release_without_the_partners_word_moves_nothing(self) -> None:
        bench = Bench().up_to("CONNECT_FREED")
        bench.run(4.5)
        assert bench.arbiter.view == STAYS

    def test_a_release_without_consent_moves_nothing(self) -> None:
        for step in ("REQUEST", "CONSENT"):
            bench = Bench().up_to(step)
            bench.say(A, DisconnectHandover(KEY))
            bench.say(B, DroneConnected(KEY))
            assert bench.arbiter.view == UNDER_WAY

    def test_a_commander_whose_heartbeat_runs_out_first_has_still_consented(self) -> None:
        # consent at 0 s is the last that is heard of it; the partner confirms at 3.5 s: relieved at 5.5 s, but lost at
        # 5 s. Both have agreed, so authority moves and the aircraft does not turn home.
        bench = Bench().up_to("CONNECT")
        consented_at = bench.now
        bench.alive = {B}
        bench.run(3.5)
        bench.say(B, DroneConnected(KEY))
        bench.run(10.0)
        assert bench.arbiter.view == MOVED
        assert [at for at, action in bench.log if isinstance(action, ViewChanged)] == [consented_at + 5.0]
        assert bench.flights() == []

    def test_never_to_a_partner_that_is_lost_itself(self) -> None:
        bench = Bench(replace(Limits(), release_timeout_s=6.0)).up_to("RELEASE")
        confirmed_at = bench.now
        bench.alive = {A}
        bench.run(10.0)
        assert bench.arbiter.view == STAYS
        assert [(at, action) for at, action in bench.log if isinstance(action, ViewChanged)] == [
            (confirmed_at + 5.0, ViewChanged(STAYS, Reason.PARTNER_SILENT))
        ]

    def test_nor_when_both_are_lost_at_the_same_moment(self) -> None:
        bench = Bench(replace(Limits(), release_timeout_s=6.0)).up_to("RELEASE")
        bench.alive = set()
        bench.give(StationHeard(A))
        bench.give(StationHeard(B))
        bench.run(10.0)
        assert bench.arbiter.view.commander is None
        assert bench.arbiter.view.epoch == 1

    def test_nor_when_the_companion_was_held_up_meanwhile(self) -> None:
        # no tick for 5.1 s, then the commander's release comes first: the partner has been silent too long by then
        bench = Bench(replace(Limits(), release_timeout_s=6.0)).up_to("RELEASE")
        bench.run(0.9)
        bench.give(StationHeard(A))
        bench.alive = set()
        bench.now += 5.0
        bench.say(A, DisconnectHandover(KEY))
        assert bench.arbiter.view.commander != B


class TestEnds:
    """However a transfer ends without a commit, commander and epoch stay."""

    @pytest.mark.parametrize(("way", "step"), [(way, step) for way, (_, _, steps) in WAYS.items() for step in steps])
    def test_the_commander_stays(self, way: str, step: str) -> None:
        happens, reason, _steps = WAYS[way]
        bench = Bench().up_to(step)
        happens(bench)
        assert bench.arbiter.view == STAYS
        assert bench.views() == [ViewChanged(STAYS, reason)]
        assert bench.records("transfer_committed") == []
        assert [record.reason for record in bench.records("transfer_aborted")] == [reason]
        results = [(station, m) for _at, station, m, _attempt in bench.sent() if isinstance(m, HandoverResult)]
        assert results == [(A, aborted(reason)), (B, aborted(reason))]
        assert bench.flights() == []

    @pytest.mark.parametrize("step", ALL_STEPS)
    def test_when_it_lands_nobody_else_gets_the_vehicle(self, step: str) -> None:
        bench = Bench().up_to(step)
        bench.autopilot_says(armed=False, flying=False)
        assert bench.arbiter.view == AuthorityView(Phase.ON_LOAD, A, None, 1, LeaseState.HELD, False, 1)

    @pytest.mark.parametrize("step", ["REQUEST", "CONSENT", "CONNECT", "CONNECT_FREED"])
    def test_when_the_commander_is_lost_nobody_commands_until_the_partner_confirms(self, step: str) -> None:
        limits = replace(Limits(), step_timeout_s=20.0)
        bench = Bench(limits).up_to(step)
        bench.alive = {B}
        bench.run(6.9)  # lost after 5 s, forced for 2 s more
        assert bench.arbiter.view == AuthorityView(
            Phase.ON_HANDOVER, None, B, 1, LeaseState.LOST, True, 1, why=Reason.COMMANDER_LOST
        )
        assert bench.flights() == []
        bench.run(0.1)
        assert bench.arbiter.view == AuthorityView(Phase.EMERGENCY, None, None, 1, LeaseState.LOST, True, 1)
        assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.PARTNER_SILENT]
        assert bench.flights() == [Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)]

    @pytest.mark.parametrize("step", ["REQUEST", "CONSENT", "CONNECT", "CONNECT_FREED"])
    def test_and_when_it_does_it_commands(self, step: str) -> None:
        limits = replace(Limits(), step_timeout_s=20.0)
        bench = Bench(limits).up_to(step)
        bench.alive = {B}
        bench.run(5.5)
        bench.say(B, OnHandover(KEY))
        bench.say(B, DroneConnected(KEY))
        assert bench.arbiter.view == MOVED
        assert bench.flights() == []
        # it began for the zone's sake, but that is not what it was decided by
        assert [record.reason for record in bench.records("transfer_committed")] == [Reason.COMMANDER_LOST]
        results = [m.reason for _at, _station, m, _attempt in bench.sent() if isinstance(m, HandoverResult)]
        assert results == [Reason.COMMANDER_LOST] * 2

    @pytest.mark.parametrize("step", ["REQUEST", "CONSENT", "CONNECT", "CONNECT_FREED"])
    def test_when_the_partner_is_lost_it_ends_there_and_then(self, step: str) -> None:
        limits = replace(Limits(), step_timeout_s=20.0)
        bench = Bench(limits).up_to(step)
        begun_at = bench.now
        bench.alive = {A}
        bench.run(10.0)
        assert [(at, action) for at, action in bench.log if isinstance(action, ViewChanged)] == [
            (begun_at + 5.0, ViewChanged(STAYS, Reason.PARTNER_SILENT))
        ]

    @pytest.mark.parametrize("canceller", [C, D, 0, 99])
    def test_others_cannot_cancel(self, canceller: int) -> None:
        bench = Bench().up_to("CONNECT")
        bench.give(Cancel(canceller))
        assert bench.arbiter.view == UNDER_WAY

    def test_with_nothing_under_way_there_is_nothing_to_cancel(self) -> None:
        bench = Bench().on_mission()
        assert not_records(bench.give(Cancel(A))) == []

    @pytest.mark.parametrize(
        ("end", "pause_s"),
        [
            (lambda b: b.say(A, OkHandover(KEY, Consent.DENIED)), 10.0),
            (lambda b: b.say(B, OnHandover(KEY, Consent.DENIED)), 10.0),
            (lambda b: b.give(Cancel(A)), 10.0),
            (lambda b: b.run(4.0), 2.0),
        ],
    )
    def test_it_is_tried_again_after_a_pause(self, end: Callable[[Bench], object], pause_s: float) -> None:
        bench = Bench().in_transfer()
        end(bench)
        ended_at = bench.now
        assert bench.arbiter.view == STAYS
        bench.run(pause_s + 1.0)
        begun = [at for at, action in bench.log if isinstance(action, Record) and action.event == "transfer_begun"]
        # the first position at or after the end of the pause: they come every half second
        assert begun[1:] == [ended_at + pause_s]

    def test_another_station_need_not_wait_for_that_pause(self) -> None:
        bench = Bench()
        bench.alive = {A, B, C}
        bench.in_transfer()
        bench.say(B, OnHandover(KEY, Consent.DENIED))
        bench.position(inside(A), inside(B), inside(C))
        assert bench.arbiter.view.partner == C

    def test_a_commit_ends_the_pauses(self) -> None:
        # B refused the former commander; that says nothing about what it tells the new one
        bench = Bench()
        bench.alive = {A, B, C}
        bench.in_transfer()
        bench.say(B, OnHandover(KEY, Consent.DENIED))
        key = TransferKey(A, C, 2, 1)
        bench.position(inside(A), inside(B), inside(C))
        for station, word in (
            (C, OnHandover(key)),
            (A, OkHandover(key)),
            (C, DroneConnected(key)),
            (A, DisconnectHandover(key)),
        ):
            bench.say(station, word)
        assert bench.arbiter.view.commander == C
        bench.position(outside(A), outside(B), inside(C))
        bench.position(outside(A), inside(B), inside(C))
        bench.run(5.5)  # the dwell time is 5 s, the pause would be 10 s
        assert bench.arbiter.view.partner == B


class TestOperators:
    @pytest.mark.parametrize(
        ("step", "station", "word"),
        [
            ("REQUEST", B, OnHandover(KEY, Consent.WAITING)),
            ("CONSENT", A, OkHandover(KEY, Consent.WAITING)),
            ("REQUEST", A, OkHandover(KEY, Consent.WAITING)),
        ],
    )
    def test_a_waiting_operator_has_thirty_seconds(self, step: str, station: int, word: Message) -> None:
        bench = Bench().up_to(step)
        assert bench.arbiter.answer_left_s(bench.now) == inf
        for round_ in range(5):  # and not more for being told so again
            bench.say(station, word)
            assert bench.arbiter.answer_left_s(bench.now) == pytest.approx(30.0 - 5.9 * round_, abs=0.01)
            bench.run(5.9)
        assert bench.arbiter.view == UNDER_WAY
        bench.run(1.0)
        assert bench.arbiter.view == STAYS
        assert bench.arbiter.answer_left_s(bench.now) == inf

    def test_how_soon_the_commanders_zone_ends(self) -> None:
        bench = Bench().on_mission()
        assert bench.arbiter.zone_ends_s == inf
        bench.position(replace(inside(A), ends_s=7.5), outside(B))
        assert bench.arbiter.zone_ends_s == 7.5
        bench.position(outside(A), inside(B))
        assert bench.arbiter.zone_ends_s == inf

    def test_a_late_yes_is_a_yes(self) -> None:
        bench = Bench().up_to("CONSENT")
        bench.say(A, OkHandover(KEY, Consent.WAITING))
        bench.run(29.0)
        assert not_records(bench.say(A, OkHandover(KEY))) == [Send(B, ConnectHandover(KEY), 1)]


class TestAgain:
    """Whatever a station repeats is answered again and changes nothing."""

    @pytest.mark.parametrize(
        ("step", "station", "word"),
        [
            ("CONSENT", B, OnHandover(KEY)),
            ("CONNECT", B, OnHandover(KEY)),
            ("CONNECT", A, OkHandover(KEY)),
            ("CONNECT_FREED", A, OkHandover(KEY)),
            ("CONNECT_FREED", A, DisconnectHandover(KEY)),
            ("RELEASE", B, OnHandover(KEY)),
            ("RELEASE", A, OkHandover(KEY)),
            ("RELEASE", B, DroneConnected(KEY)),
        ],
    )
    def test_a_doubled_word_changes_nothing(self, step: str, station: int, word: Message) -> None:
        bench = Bench().up_to(step)
        bench.run(0.1)
        bench.log.clear()
        deadline = bench.arbiter.next_deadline()
        assert bench.say(station, word) == []
        assert bench.arbiter.view == UNDER_WAY
        assert bench.arbiter.next_deadline() == deadline

    @pytest.mark.parametrize(
        ("station", "word"),
        [
            (A, DisconnectHandover(KEY)),
            (A, OkHandover(KEY)),
            (B, DroneConnected(KEY)),
            (B, OnHandover(KEY)),
            (B, OnHandover(KEY, Consent.DENIED)),
            (A, OkHandover(KEY, Consent.DENIED)),
        ],
    )
    def test_after_the_commit_the_answer_is_the_result(self, station: int, word: Message) -> None:
        bench = Bench().commit()
        bench.log.clear()
        assert not_records(bench.say(station, word)) == [Send(station, COMMITTED, 1)]
        assert bench.arbiter.view == MOVED
        assert bench.dropped() == {"transfer already over": 1}

    def test_after_an_abort_too(self) -> None:
        bench = Bench().up_to("RELEASE")
        bench.position(inside(A), outside(B))
        assert not_records(bench.say(A, DisconnectHandover(KEY))) == [Send(A, aborted(Reason.LEFT_REGION), 1)]
        assert not_records(bench.say(B, DroneConnected(KEY))) == [Send(B, aborted(Reason.LEFT_REGION), 1)]
        assert bench.arbiter.view == STAYS

    def test_a_word_of_another_transfer_gets_no_result(self) -> None:
        bench = Bench().commit()
        bench.log.clear()
        assert not_records(bench.say(A, DisconnectHandover(TransferKey(A, B, 2, 1)))) == []
        assert bench.dropped() == {"stale epoch or unknown transfer": 1}

    def test_a_third_station_gets_no_result(self) -> None:
        bench = Bench().commit()
        bench.give(StationHeard(C))
        bench.log.clear()
        assert not_records(bench.say(C, DisconnectHandover(KEY))) == []


class TestNotListenedTo:
    """Another epoch, another number, another station: dropped and counted."""

    @pytest.mark.parametrize("key", OTHER_KEYS)
    @pytest.mark.parametrize("step", ALL_STEPS)
    def test_another_key(self, key: TransferKey, step: str) -> None:
        bench = Bench().up_to(step)
        for station in (A, B):
            for word in (OnHandover(key), OkHandover(key), DroneConnected(key), DisconnectHandover(key)):
                assert bench.say(station, word) == []
        assert bench.arbiter.view == UNDER_WAY
        assert bench.arbiter._authority.transfer is not None
        assert bench.arbiter._authority.transfer.step.name == step
        assert bench.dropped() == {"stale epoch or unknown transfer": 8}

    @pytest.mark.parametrize("step", ALL_STEPS)
    def test_another_station(self, step: str) -> None:
        words: list[Message] = [OnHandover(KEY), OkHandover(KEY), DroneConnected(KEY), DisconnectHandover(KEY)]
        words += [OnHandover(KEY, Consent.DENIED), OkHandover(KEY, Consent.DENIED)]
        partners = (OnHandover, DroneConnected)
        bench = Bench().up_to(step)
        bench.give(StationHeard(C))
        bench.log.clear()
        for word in words:
            assert not_records(bench.say(C, word)) == []
            wrong = A if isinstance(word, partners) else B
            assert not_records(bench.say(wrong, word)) == []
        assert bench.arbiter.view == UNDER_WAY
        assert bench.arbiter._authority.transfer is not None
        assert bench.arbiter._authority.transfer.step.name == step
        assert bench.dropped() == {"not the sender's to say": 12}

    def test_the_vehicles_own_messages_sent_back_to_it(self) -> None:
        bench = Bench().up_to("CONNECT")
        for station in (A, B):
            for word in (HandoverRequest(KEY), ConnectHandover(KEY), COMMITTED, aborted(Reason.ZONE)):
                bench.say(station, word)
        assert bench.arbiter.view == UNDER_WAY

    def test_a_transfer_that_was_never_begun(self) -> None:
        bench = Bench().on_mission()
        for station in (A, B):
            for word in (OnHandover(KEY), OkHandover(KEY), DroneConnected(KEY), DisconnectHandover(KEY)):
                assert not_records(bench.say(station, word)) == []
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, 1, LeaseState.HELD, True, 0)
        assert bench.dropped() == {"stale epoch or unknown transfer": 8}

    def test_the_former_epoch(self) -> None:
        # the release of transfer 1 comes once more, much later, when transfer 2 is under way
        bench = Bench().commit()
        bench.position(outside(A), inside(B))
        bench.run(10.0)
        bench.position(inside(A), inside(B))
        assert bench.arbiter.view.handover_id == 2
        bench.log.clear()
        for station, word in (
            (B, OnHandover(KEY)),
            (A, OkHandover(KEY)),
            (B, DroneConnected(KEY)),
            (A, DisconnectHandover(KEY)),
        ):
            bench.say(station, word)
        assert bench.arbiter.view == AuthorityView(
            Phase.ON_HANDOVER, B, A, 2, LeaseState.TRANSFER, True, 2, why=Reason.ZONE
        )
        assert {message for _at, _station, message, _attempt in bench.sent()} == {COMMITTED}


class TestResult:
    def test_a_commit_is_repeated_until_the_station_shows_the_new_epoch(self) -> None:
        bench = Bench().commit()
        committed_at = bench.now
        bench.log.clear()
        bench.run(0.4)
        bench.say(A, ConnectAck(A, 1, 0, 2, B, "GCSA", b""))
        bench.run(0.4)
        bench.say(B, ConnectAck(B, 1, 0, 2, B, "GCSB", b""))
        bench.run(0.9)
        assert [(round(at - committed_at, 6), station, m, attempt) for at, station, m, attempt in bench.sent()] == [
            (0.2, A, COMMITTED, 2),
            (0.2, B, COMMITTED, 2),
            (0.5, B, COMMITTED, 3),
        ]

    def test_an_answer_to_connect_shows_it_as_well(self) -> None:
        bench = Bench().commit()
        bench.log.clear()
        bench.run(1.1)  # in this time both have answered CONNECT
        assert [attempt for _at, station, _m, attempt in bench.sent() if station == B][-1] <= 4
        bench.log.clear()
        bench.run(8.0)
        assert bench.sent() == []

    def test_an_answer_that_shows_the_old_epoch_acknowledges_nothing(self) -> None:
        bench = Bench().commit()
        bench.log.clear()
        bench.say(A, ConnectAck(A, 1, 0, 1, A, "GCSA", b""))
        bench.run(0.25)
        assert [station for _at, station, _m, _attempt in bench.sent()] == [A, B]

    def test_the_answer_of_one_does_not_stand_for_the_other(self) -> None:
        bench = Bench().commit()
        bench.log.clear()
        bench.say(A, ConnectAck(A, 1, 0, 0xFFFFFFFF, B, "GCSA", b""))
        bench.run(0.25)
        assert [station for _at, station, _m, _attempt in bench.sent()] == [B]

    def test_after_ten_seconds_it_is_given_up_and_said(self) -> None:
        bench = Bench(Limits(deaf_lost_s=60.0)).up_to("RELEASE")
        bench.deaf = {A, B}
        bench.say(A, DisconnectHandover(KEY))
        committed_at = bench.now
        bench.run(30.0)
        told = [(at, r.text) for at, r in bench.log if isinstance(r, Record) and r.event == "result_unacknowledged"]
        assert told == [
            (committed_at + 10.0, "GCSA has not acknowledged how handover 1 ended"),
            (committed_at + 10.0, "GCSB has not acknowledged how handover 1 ended"),
        ]
        assert max(at for at, *_rest in bench.sent()) < committed_at + 10.0
        assert bench.arbiter.view == MOVED

    def test_an_abort_is_repeated_too_until_the_station_says_that_it_knows(self) -> None:
        # its epoch says nothing about an abort, so an ordinary answer to CONNECT does not count
        bench = Bench().up_to("CONSENT")
        bench.say(A, OkHandover(KEY, Consent.DENIED))
        ended_at = bench.now
        bench.log.clear()
        bench.run(0.4)
        bench.say(A, ConnectAck(A, 1, 0, 1, A, "GCSA", b""))
        bench.run(2.4)  # B answers CONNECT twice in this time
        bench.say(B, ConnectAck(B, 1, 0, 1, A, "GCSB", b""))
        bench.run(6.0)
        result = aborted(Reason.COMMANDER_DENIED)
        assert [(round(at - ended_at, 6), station, m, attempt) for at, station, m, attempt in bench.sent()] == [
            (0.2, A, result, 2),
            (0.2, B, result, 2),
            (0.5, B, result, 3),
            (0.95, B, result, 4),
            (1.625, B, result, 5),
            (2.625, B, result, 6),
        ]

    def test_what_acknowledges_it_is_no_answer_that_went_astray(self) -> None:
        bench = Bench().commit()
        bench.say(B, ConnectAck(B, 1, 0, 2, B, "GCSB", b""))
        assert bench.dropped() == {}

    def test_the_next_transfer_supersedes_it(self) -> None:
        bench = Bench().in_transfer()
        bench.run(6.5)  # no answer: aborted at 4 s, and begun again 2 s later
        assert bench.arbiter.view.handover_id == 2
        bench.log.clear()
        bench.run(1.0)
        assert {type(message) for _at, _station, message, _attempt in bench.sent()} == {HandoverRequest}


class TestPartners:
    """Only a station that is connected both ways, of this version, with this mission, is asked."""

    @pytest.mark.parametrize("case", UNFIT)
    def test_unfit_is_told_once_and_nothing_is_asked(self, case: str) -> None:
        spoil, reason, text = UNFIT[case]
        bench = Bench().on_mission()
        spoil(bench)
        bench.run(10.0)
        bench.log.clear()
        bench.position(inside(A), inside(B))
        bench.run(20.0)
        assert bench.sent() == []
        assert bench.records("partner_unfit") == [Record("partner_unfit", text, reason, B)]

    @pytest.mark.parametrize("case", UNFIT)
    def test_fit_again_it_is_asked(self, case: str) -> None:
        spoil, _reason, _text = UNFIT[case]
        bench = Bench().on_mission()
        spoil(bench)
        bench.run(10.0)
        bench.position(inside(A), inside(B))
        bench.run(5.0)
        fresh = Bench()
        bench.alive, bench.deaf, bench.versions, bench.digests = {A, B}, set(), fresh.versions, fresh.digests
        bench.run(18.0 if case == "deaf" else 2.5)
        assert bench.arbiter.view.partner == B

    def test_another_reason_is_told_too(self) -> None:
        bench = Bench().on_mission()
        bench.alive = {A}
        bench.run(10.0)
        bench.position(inside(A), inside(B))
        bench.run(3.0)
        bench.alive, bench.versions[B] = {A, B}, 2
        bench.run(3.0)
        assert [record.reason for record in bench.records("partner_unfit")] == [
            Reason.PARTNER_SILENT,
            Reason.VERSION_DIFFERS,
        ]

    def test_unfit_once_more_is_told_once_more(self) -> None:
        bench = Bench().on_mission()
        bench.digests[B] = b""
        bench.run(3.0)
        bench.position(inside(A), inside(B))
        bench.run(3.0)
        bench.digests[B] = bytes(range(32))
        bench.run(1.5)
        bench.say(B, OnHandover(KEY, Consent.DENIED))
        bench.digests[B] = b""
        bench.run(15.0)
        assert [record.reason for record in bench.records("partner_unfit")] == [Reason.MISSION_MISSING] * 2

    def test_an_unfit_station_does_not_stand_in_the_way_of_a_fit_one(self) -> None:
        bench = Bench()
        bench.alive = {A, B, C}
        bench.on_mission()
        bench.digests[B] = b""
        bench.run(3.0)
        bench.position(inside(A), inside(B), inside(C))
        assert bench.arbiter.view.partner == C

    def test_a_zone_of_a_station_that_is_not_known_calls_nobody(self) -> None:
        bench = Bench().on_mission()
        actions = bench.give(PositionSeen((inside(A), inside(77))))
        assert [action.text for action in actions if isinstance(action, Record)] == ["zone of station 77 entered"]
        bench.run(5.0)
        assert bench.sent() == []

    def test_one_transfer_at_a_time(self) -> None:
        bench = Bench()
        bench.alive = {A, B, C}
        bench.in_transfer()
        bench.position(inside(A), inside(B), inside(C))
        bench.run(1.0)
        assert bench.arbiter.view == UNDER_WAY
        assert {station for _at, station, _m, _attempt in bench.sent()} == {B}

    def test_leaving_a_third_zone_does_not_end_it(self) -> None:
        bench = Bench().in_transfer()
        bench.position(inside(A), inside(B), inside(C))
        bench.position(inside(A), inside(B), outside(C))
        bench.position(*far(A, C, D), inside(B))
        assert bench.arbiter.view == replace(UNDER_WAY, why=Reason.ZONE_ENDS)

    def test_nothing_moves_on_the_ground(self) -> None:
        bench = Bench().on_ground()
        bench.position(outside(A), inside(B))
        bench.autopilot_says(armed=True, flying=False)
        bench.run(10.0)
        assert bench.sent() == []


def test_connect_shows_the_transfer_to_nobody_but_is_current() -> None:
    # CONNECT goes on during a transfer, with the commander that still commands
    bench = Bench().in_transfer()
    bench.log.clear()
    bench.run(1.0)
    asked = [a.message for _at, a in bench.log if isinstance(a, Send) and isinstance(a.message, Connect)]
    assert {(question.commander, question.epoch) for question in asked} == {(A, 1)}


def test_a_late_word_of_the_partners_operator_does_not_keep_a_transfer_open() -> None:
    """The zone ends and two stations are asked. `WAITING` of the partner comes once more after its consent: the time of
    the step was up and nothing ended, for as long as the aircraft flew."""
    bench = Bench()
    bench.alive = {A, B, C}
    bench.on_mission()
    bench.position(outside(A), inside(B), inside(C))
    while bench.arbiter.view.partner is None:
        bench.run(0.1)
    view = bench.arbiter.view
    assert view.partner is not None
    key = TransferKey(A, view.partner, view.handover_id, view.epoch)
    bench.say(view.partner, OnHandover(key, Consent.GRANTED))
    bench.say(A, OkHandover(key, Consent.GRANTED))
    bench.say(view.partner, OnHandover(key, Consent.WAITING))
    bench.run(4.5)
    ends = [action.message for _at, action in bench.log if isinstance(action, Send)]
    results = [message for message in ends if isinstance(message, HandoverResult)]
    assert [(result.key, result.reason) for result in results[:1]] == [(key, Reason.PARTNER_SILENT)]


def test_a_station_that_comes_later_ends_the_long_wait_for_a_partners_operator() -> None:
    """The zone ends, and GCSB alone can be asked: its operator has thirty seconds. Then GCSC is there as well."""
    bench = Bench()
    bench.alive = {A, B, C}
    bench.on_mission()
    bench.position(inside(A, exit_s=6.0), inside(B), outside(C))
    assert bench.arbiter.view.partner == B
    bench.say(B, OnHandover(KEY, Consent.WAITING))
    bench.run(5.0)
    assert bench.arbiter.view.handover_id == 1
    bench.position(inside(A, exit_s=6.0), inside(B), inside(C))
    bench.say(B, OnHandover(KEY, Consent.WAITING))
    bench.run(4.5)
    assert [record.reason for record in bench.records("transfer_aborted")] == [Reason.PARTNER_UNANSWERED]
    assert bench.arbiter.view.partner == C
