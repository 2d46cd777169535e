# SPDX-License-Identifier: GPL-3.0-or-later

"""One transfer: the table of its moves, who may say what, and when the vehicle speaks again."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.authority.transfer import MOVES, Cause, End, Step, Transfer, cause_of
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import (
    Connect,
    ConnectAck,
    ConnectHandover,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    HandoverResult,
    Message,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.common.model import Consent, Outcome, Reason

A, B, C = 251, 252, 253
KEY = TransferKey(A, B, 7, 3)

#: What each cause does in each step: the next step, "ABORTED reason" or "COMMITTED reason". Not in here: nothing.
EXPECTED = {
    ("REQUEST", "PARTNER_READY"): "CONSENT",
    ("REQUEST", "PARTNER_ASKS"): "REQUEST",
    ("REQUEST", "PARTNER_REFUSED"): "ABORTED PARTNER_REFUSED",
    ("REQUEST", "CONSENTED"): "CONNECT",
    ("REQUEST", "COMMANDER_ASKS"): "CONSENT",
    ("REQUEST", "DENIED"): "ABORTED COMMANDER_DENIED",
    ("REQUEST", "TIMEOUT"): "ABORTED PARTNER_SILENT",
    ("REQUEST", "UNANSWERED"): "ABORTED PARTNER_UNANSWERED",
    ("REQUEST", "LEFT_REGION"): "ABORTED LEFT_REGION",
    ("REQUEST", "CANCELLED"): "ABORTED CANCELLED",
    ("REQUEST", "COMMANDER_LOST"): "REQUEST",
    ("REQUEST", "COMMANDER_RETURNED"): "ABORTED COMMANDER_RETURNED",
    ("REQUEST", "PARTNER_LOST"): "ABORTED PARTNER_SILENT",
    ("REQUEST", "OUT_OF_COVERAGE"): "ABORTED OUT_OF_COVERAGE",
    ("REQUEST", "PREEMPTED"): "ABORTED PREEMPTED",
    ("CONSENT", "PREEMPTED"): "ABORTED PREEMPTED",
    ("CONSENT", "PARTNER_REFUSED"): "ABORTED PARTNER_REFUSED",
    ("CONSENT", "CONSENTED"): "CONNECT",
    ("CONSENT", "COMMANDER_ASKS"): "CONSENT",
    ("CONSENT", "DENIED"): "ABORTED COMMANDER_DENIED",
    ("CONSENT", "TIMEOUT"): "ABORTED COMMANDER_SILENT",
    ("CONSENT", "UNANSWERED"): "ABORTED COMMANDER_UNANSWERED",
    ("CONSENT", "CANNOT_BE_ASKED"): "ABORTED CANNOT_BE_ASKED",
    ("CONSENT", "CONSENT_REFUSED"): "ABORTED CONSENT_REFUSED",
    ("CONSENT", "LEFT_REGION"): "ABORTED LEFT_REGION",
    ("CONSENT", "CANCELLED"): "ABORTED CANCELLED",
    ("CONSENT", "COMMANDER_LOST"): "CONNECT",
    ("CONSENT", "COMMANDER_RETURNED"): "ABORTED COMMANDER_RETURNED",
    ("CONSENT", "PARTNER_LOST"): "ABORTED PARTNER_SILENT",
    ("CONSENT", "OUT_OF_COVERAGE"): "ABORTED OUT_OF_COVERAGE",
    ("CONNECT", "PARTNER_REFUSED"): "ABORTED PARTNER_REFUSED",
    ("CONNECT", "CONNECTED"): "RELEASE",
    ("CONNECT", "RELEASED"): "CONNECT_FREED",
    ("CONNECT", "TIMEOUT"): "ABORTED PARTNER_SILENT",
    ("CONNECT", "LEFT_REGION"): "ABORTED LEFT_REGION",
    ("CONNECT", "CANCELLED"): "ABORTED CANCELLED",
    ("CONNECT", "COMMANDER_LOST"): "CONNECT_FREED",
    ("CONNECT", "COMMANDER_RETURNED"): "ABORTED COMMANDER_RETURNED",
    ("CONNECT", "PARTNER_LOST"): "ABORTED PARTNER_SILENT",
    ("CONNECT", "OUT_OF_COVERAGE"): "ABORTED OUT_OF_COVERAGE",
    ("CONNECT_FREED", "PARTNER_REFUSED"): "ABORTED PARTNER_REFUSED",
    ("CONNECT_FREED", "CONNECTED"): "COMMITTED NONE",
    ("CONNECT_FREED", "TIMEOUT"): "ABORTED PARTNER_SILENT",
    ("CONNECT_FREED", "LEFT_REGION"): "ABORTED LEFT_REGION",
    ("CONNECT_FREED", "CANCELLED"): "ABORTED CANCELLED",
    ("CONNECT_FREED", "COMMANDER_LOST"): "CONNECT_FREED",
    ("CONNECT_FREED", "COMMANDER_RETURNED"): "ABORTED COMMANDER_RETURNED",
    ("CONNECT_FREED", "PARTNER_LOST"): "ABORTED PARTNER_SILENT",
    ("CONNECT_FREED", "OUT_OF_COVERAGE"): "ABORTED OUT_OF_COVERAGE",
    ("RELEASE", "RELEASED"): "COMMITTED NONE",
    ("RELEASE", "TIMEOUT"): "COMMITTED RELEASE_TIMEOUT",
    ("RELEASE", "COMMANDER_LOST"): "COMMITTED RELEASE_TIMEOUT",
    ("RELEASE", "COMMANDER_RETURNED"): "ABORTED COMMANDER_RETURNED",
    ("RELEASE", "LEFT_REGION"): "ABORTED LEFT_REGION",
    ("RELEASE", "CANCELLED"): "ABORTED CANCELLED",
    ("RELEASE", "PARTNER_LOST"): "ABORTED PARTNER_SILENT",
    ("RELEASE", "OUT_OF_COVERAGE"): "ABORTED OUT_OF_COVERAGE",
}

#: How a transfer gets to each step.
WAY: dict[Step, list[Cause]] = {
    Step.REQUEST: [],
    Step.CONSENT: [Cause.PARTNER_READY],
    Step.CONNECT: [Cause.PARTNER_READY, Cause.CONSENTED],
    Step.CONNECT_FREED: [Cause.PARTNER_READY, Cause.CONSENTED, Cause.RELEASED],
    Step.RELEASE: [Cause.PARTNER_READY, Cause.CONSENTED, Cause.CONNECTED],
}


def transfer_in(step: Step, now: float = 100.0, limits: Limits | None = None) -> Transfer:
    transfer = Transfer(KEY, Reason.ZONE, limits or Limits(), now)
    for cause in WAY[step]:
        assert transfer.move(cause, now) is True
    assert transfer.step is step
    return transfer


def said(transfer: Transfer, until: float, now: float) -> list[tuple[float, int, int, Message]]:
    """Everything the vehicle says of its own accord from `now` on: time, attempt, receiver, message."""
    words: list[tuple[float, int, int, Message]] = []
    while True:
        now = max(now, transfer.retry_at)
        if now > until:
            return words
        due = transfer.due(now)
        assert due
        words += [(round(now, 6), transfer.attempt, *one) for one in due]


class TestMoves:
    @pytest.mark.parametrize("step", Step, ids=lambda step: step.name)
    @pytest.mark.parametrize("cause", Cause, ids=lambda cause: cause.name)
    def test_every_pair_of_step_and_cause(self, step: Step, cause: Cause) -> None:
        expected = EXPECTED.get((step.name, cause.name))
        transfer = transfer_in(step)
        got = transfer.move(cause, 101.0)
        if expected is None:
            assert got is False
            assert transfer.step is step
        elif " " in expected:
            outcome, reason = expected.split()
            assert got == End(Outcome[outcome], Reason[reason])
        else:
            assert transfer.step is Step[expected]
            assert got is (transfer.step is not step)

    def test_the_table_has_no_other_entries(self) -> None:
        assert {(step.name, cause.name) for step, cause in MOVES} == set(EXPECTED)

    @pytest.mark.parametrize("step", Step, ids=lambda step: step.name)
    @pytest.mark.parametrize("cause", Cause, ids=lambda cause: cause.name)
    def test_what_changes_nothing_leaves_the_clocks_alone(self, step: Step, cause: Cause) -> None:
        if (step.name, cause.name) in EXPECTED:
            return
        transfer = transfer_in(step)
        before = (transfer.retry_at, transfer.timeout_at, transfer.attempt, transfer.operator_asked)
        transfer.move(cause, 101.0)
        assert (transfer.retry_at, transfer.timeout_at, transfer.attempt, transfer.operator_asked) == before

    def test_only_the_partners_word_with_the_commanders_consent_or_loss_leads_to_a_commit(self) -> None:
        # walk every path of stations' words and see what was said before each commit
        words = {
            Cause.PARTNER_READY,
            Cause.PARTNER_ASKS,
            Cause.CONSENTED,
            Cause.COMMANDER_ASKS,
            Cause.CONNECTED,
            Cause.RELEASED,
            Cause.TIMEOUT,
            Cause.COMMANDER_LOST,
        }
        todo, seen, commits = [(Step.REQUEST, frozenset[Cause]())], set(), 0
        while todo:
            step, heard = todo.pop()
            if (step, heard) in seen:
                continue
            seen.add((step, heard))
            for cause in words:
                target = MOVES.get((step, cause))
                if isinstance(target, End):
                    if target.outcome is Outcome.COMMITTED:
                        commits += 1
                        assert Cause.CONNECTED in heard | {cause}
                        # consent, or nobody there to give it
                        assert {Cause.CONSENTED, Cause.COMMANDER_LOST} & (heard | {cause})
                elif target is not None:
                    todo.append((target, heard | {cause}))
        assert commits > 0


class TestWhoMaySayWhat:
    @pytest.mark.parametrize(
        ("message", "sender", "cause"),
        [
            (OnHandover(KEY, Consent.GRANTED), B, Cause.PARTNER_READY),
            (OnHandover(KEY, Consent.WAITING), B, Cause.PARTNER_ASKS),
            (OnHandover(KEY, Consent.DENIED), B, Cause.PARTNER_REFUSED),
            (OnHandover(KEY, Consent.GRANTED, relay=True), B, Cause.PARTNER_READY),
            (OkHandover(KEY, Consent.GRANTED), A, Cause.CONSENTED),
            (OkHandover(KEY, Consent.WAITING), A, Cause.COMMANDER_ASKS),
            (OkHandover(KEY, Consent.DENIED), A, Cause.DENIED),
            (DroneConnected(KEY), B, Cause.CONNECTED),
            (DroneConnected(KEY, relay=True), B, Cause.CONNECTED),
            (DisconnectHandover(KEY), A, Cause.RELEASED),
        ],
    )
    def test_each_word_is_one_stations(self, message: Message, sender: int, cause: Cause) -> None:
        for station in (A, B, C, 0, 255):
            assert cause_of(message, station) is (cause if station == sender else None)

    @pytest.mark.parametrize(
        "message",
        [
            HandoverRequest(KEY, Reason.ZONE),
            ConnectHandover(KEY),
            HandoverResult(KEY, B, Outcome.COMMITTED, Reason.ZONE),
            Connect(A, 1, 5, 3, A, "GCSA", b""),
            ConnectAck(A, 1, 5, 3, A, "GCSA", b""),
        ],
    )
    def test_the_vehicles_own_words_mean_nothing_from_a_station(self, message: Message) -> None:
        for station in (A, B, C):
            assert cause_of(message, station) is None


class TestSpeaking:
    def test_the_request_goes_out_at_once_and_again_with_a_growing_pause(self) -> None:
        # pauses: 0.2 s, then half as long again each time, at most 1 s
        request = HandoverRequest(KEY, Reason.ZONE)
        assert said(transfer_in(Step.REQUEST), until=104.0, now=100.0) == [
            (100.0, 1, B, request),
            (100.2, 2, B, request),
            (100.5, 3, B, request),
            (100.95, 4, B, request),
            (101.625, 5, B, request),
            (102.625, 6, B, request),
            (103.625, 7, B, request),
        ]

    def test_connect_goes_out_at_once(self) -> None:
        assert said(transfer_in(Step.CONNECT), until=100.3, now=100.0) == [
            (100.0, 1, B, ConnectHandover(KEY)),
            (100.2, 2, B, ConnectHandover(KEY)),
        ]

    @pytest.mark.parametrize(
        ("step", "receiver", "message"),
        [
            (Step.CONSENT, A, OnHandover(KEY, reason=Reason.ZONE, relayed=True)),
            (Step.CONNECT_FREED, B, ConnectHandover(KEY)),
            (Step.RELEASE, A, DroneConnected(KEY, relayed=True)),
        ],
    )
    def test_what_another_has_said_already_is_only_repeated(self, step: Step, receiver: int, message: Message) -> None:
        assert said(transfer_in(step), until=100.6, now=100.0) == [
            (100.2, 1, receiver, message),
            (100.4, 2, receiver, message),
        ]

    @pytest.mark.parametrize(
        ("step", "cause", "receiver", "message"),
        [
            (Step.REQUEST, Cause.PARTNER_READY, A, OnHandover(KEY, reason=Reason.ZONE, relayed=True)),
            (Step.CONNECT, Cause.CONNECTED, A, DroneConnected(KEY, relayed=True)),
        ],
    )
    def test_without_a_ground_link_the_partners_word_is_passed_on_at_once(
        self, step: Step, cause: Cause, receiver: int, message: Message
    ) -> None:
        transfer = transfer_in(step)
        transfer.move(cause, 101.0, relay=True)
        assert transfer.due(101.0) == [(receiver, message)]
        assert transfer.attempt == 1

    def test_not_before_it_is_time(self) -> None:
        transfer = transfer_in(Step.REQUEST)
        assert len(transfer.due(100.0)) == 1
        assert transfer.due(100.0) == []
        assert transfer.due(100.199) == []
        assert transfer.attempt == 1

    def test_a_caller_that_is_late_gets_one_message_not_all_that_were_missed(self) -> None:
        transfer = transfer_in(Step.REQUEST)
        transfer.due(100.0)
        assert len(transfer.due(103.0)) == 1
        assert transfer.due(103.0) == []
        assert transfer.retry_at == pytest.approx(103.3)

    def test_each_step_counts_its_own_attempts(self) -> None:
        transfer = transfer_in(Step.REQUEST)
        for now in (100.0, 100.2, 100.5):
            transfer.due(now)
        assert transfer.attempt == 3
        transfer.move(Cause.CONSENTED, 101.0)
        assert transfer.due(101.0) == [(B, ConnectHandover(KEY))]
        assert transfer.attempt == 1
        assert transfer.retry_at == pytest.approx(101.2)

    def test_other_numbers_are_obeyed(self) -> None:
        limits = replace(Limits(), retry_first_s=1.0, retry_growth=2.0, retry_max_s=3.0)
        times = [word[0] for word in said(transfer_in(Step.REQUEST, limits=limits), until=110.0, now=100.0)]
        assert times == [100.0, 101.0, 103.0, 106.0, 109.0]


class TestTimeouts:
    @pytest.mark.parametrize(
        ("step", "timeout_at"),
        [
            (Step.REQUEST, 104.0),
            (Step.CONSENT, 104.0),
            (Step.CONNECT, 104.0),
            (Step.CONNECT_FREED, 104.0),
            (Step.RELEASE, 102.0),
        ],
    )
    def test_each_step_has_its_time(self, step: Step, timeout_at: float) -> None:
        assert transfer_in(step).timeout_at == timeout_at

    def test_each_step_starts_anew(self) -> None:
        transfer = transfer_in(Step.REQUEST)
        transfer.move(Cause.PARTNER_READY, 103.0)
        assert transfer.timeout_at == 107.0

    @pytest.mark.parametrize(
        ("step", "cause"),
        [
            (Step.REQUEST, Cause.PARTNER_ASKS),
            (Step.REQUEST, Cause.COMMANDER_ASKS),
            (Step.CONSENT, Cause.COMMANDER_ASKS),
        ],
    )
    def test_an_operator_who_was_asked_has_thirty_seconds(self, step: Step, cause: Cause) -> None:
        transfer = transfer_in(step)
        transfer.move(cause, 101.0)
        assert transfer.operator_asked
        assert transfer.timeout_at == 131.0

    def test_saying_it_again_does_not_win_more_time(self) -> None:
        transfer = transfer_in(Step.CONSENT)
        for now in (101.0, 110.0, 130.0):
            transfer.move(Cause.COMMANDER_ASKS, now)
        assert transfer.timeout_at == 131.0

    def test_the_next_operator_has_thirty_seconds_of_his_own(self) -> None:
        transfer = transfer_in(Step.REQUEST)
        transfer.move(Cause.PARTNER_ASKS, 101.0)
        transfer.move(Cause.PARTNER_READY, 120.0)
        assert not transfer.operator_asked
        assert transfer.timeout_at == 124.0
        transfer.move(Cause.COMMANDER_ASKS, 121.0)
        assert transfer.timeout_at == 151.0

    def test_a_waiting_operator_is_reminded_by_the_same_message(self) -> None:
        transfer = transfer_in(Step.CONSENT)
        transfer.move(Cause.COMMANDER_ASKS, 100.0)
        words = said(transfer, until=110.0, now=100.0)
        assert {word[2:] for word in words} == {(A, OnHandover(KEY, reason=Reason.ZONE, relayed=True))}
        assert [word[0] for word in words[-2:]] == [108.825, 109.825]


class TestUnanswered:
    """An operator who does not answer is no silent station: the reasons tell them apart."""

    @pytest.mark.parametrize(
        ("causes", "reason"),
        [
            ([], Reason.PARTNER_SILENT),
            ([Cause.PARTNER_ASKS], Reason.PARTNER_UNANSWERED),
            ([Cause.PARTNER_READY], Reason.COMMANDER_SILENT),
            ([Cause.PARTNER_ASKS, Cause.PARTNER_READY], Reason.COMMANDER_SILENT),
            ([Cause.PARTNER_READY, Cause.COMMANDER_ASKS], Reason.COMMANDER_UNANSWERED),
            ([Cause.COMMANDER_ASKS], Reason.COMMANDER_UNANSWERED),
            ([Cause.COMMANDER_ASKS, Cause.CONSENTED], Reason.PARTNER_SILENT),
        ],
    )
    def test_the_time_is_up(self, causes: list[Cause], reason: Reason) -> None:
        transfer = Transfer(KEY, Reason.ZONE, Limits(), 100.0)
        for cause in causes:
            transfer.move(cause, 100.0)
        assert transfer.move(Cause.TIMEOUT, 200.0) == End(Outcome.ABORTED, reason)

    @pytest.mark.parametrize("step", list(Step))
    @pytest.mark.parametrize("asked", ["operator_asked", "partner_asks"])
    def test_time_that_is_up_ends_every_step_whoever_is_asked(self, step: Step, asked: str) -> None:
        """It ended no step that has no operator to wait for: such a transfer never ended."""
        transfer = transfer_in(step)
        setattr(transfer, asked, True)
        assert isinstance(transfer.move(Cause.TIMEOUT, 200.0), End)


class TestForced:
    """Without a commander nobody is left to ask; the partner's two words count as ever, and time is short."""

    def test_lost_on_the_way_it_ends_two_seconds_later_whatever_step_it_is_in(self) -> None:
        for step in (Step.REQUEST, Step.CONSENT, Step.CONNECT, Step.CONNECT_FREED):
            transfer = transfer_in(step)
            transfer.move(Cause.COMMANDER_LOST, 101.0)
            assert transfer.forced
            assert transfer.timeout_at == 103.0
            transfer.move(Cause.PARTNER_READY, 102.5)
            transfer.move(Cause.CONSENTED, 102.5)
            assert transfer.timeout_at == 103.0

    def test_forced_from_the_beginning(self) -> None:
        transfer = Transfer(KEY, Reason.COMMANDER_LOST, Limits(), 100.0, forced_until=102.0)
        assert transfer.timeout_at == 102.0
        assert transfer.due(100.0) == [(B, HandoverRequest(KEY, Reason.COMMANDER_LOST))]

    def test_when_operators_are_all_that_is_waited_for_the_hurry_is_over(self) -> None:
        transfer = Transfer(KEY, Reason.COMMANDER_LOST, Limits(), 100.0, forced_until=102.0)
        transfer.move(Cause.PARTNER_ASKS, 100.5)
        assert transfer.hurry_over
        assert transfer.timeout_at == 130.5
        transfer.move(Cause.PARTNER_ASKS, 110.0)  # to say it again wins no time
        assert transfer.timeout_at == 130.5
        assert transfer.move(Cause.TIMEOUT, 130.5) == End(Outcome.ABORTED, Reason.PARTNER_UNANSWERED)

    def test_while_a_station_has_not_answered_the_hurry_lasts(self) -> None:
        transfer = Transfer(KEY, Reason.COMMANDER_LOST, Limits(), 100.0, forced_until=102.0)
        transfer.invite(C, 100.0, ready=False)
        transfer.move(Cause.PARTNER_ASKS, 100.5)
        assert (transfer.hurry_over, transfer.timeout_at) == (False, 102.0)
        transfer.move(Cause.PARTNER_ASKS, 100.6, station=C)
        assert (transfer.hurry_over, transfer.timeout_at) == (True, 130.6)

    def test_a_question_from_before_the_loss_is_asked_anew(self) -> None:
        # it was another question: without an answer to this one the hurry lasts
        transfer = transfer_in(Step.REQUEST)
        transfer.move(Cause.PARTNER_ASKS, 100.5)
        transfer.move(Cause.COMMANDER_LOST, 101.0)
        assert (transfer.hurry_over, transfer.timeout_at, transfer.retry_at) == (False, 103.0, 101.0)
        transfer.move(Cause.PARTNER_ASKS, 101.1)
        assert (transfer.hurry_over, transfer.timeout_at) == (True, 131.1)

    @pytest.mark.parametrize(
        ("step", "implied"),
        [
            (Step.REQUEST, None),
            (Step.CONSENT, Cause.CONSENTED),
            (Step.CONNECT, None),
            (Step.CONNECT_FREED, None),
            (Step.RELEASE, Cause.RELEASED),
        ],
    )
    def test_only_the_commanders_words_come_by_themselves(self, step: Step, implied: Cause | None) -> None:
        transfer = transfer_in(step)
        assert transfer.implied(partner_standard=False, commander_standard=False) is None
        transfer.forced = transfer.consented = True
        assert transfer.implied(partner_standard=False, commander_standard=False) is implied


class TestStandardStations:
    """A station without our module has no words for some steps: they come by themselves."""

    @pytest.mark.parametrize(
        ("step", "of_partner", "of_commander"),
        [
            (Step.REQUEST, Cause.PARTNER_READY, None),
            (Step.CONSENT, None, None),  # it has a word for that
            (Step.CONNECT, Cause.CONNECTED, None),
            (Step.CONNECT_FREED, Cause.CONNECTED, None),
            (Step.RELEASE, None, Cause.RELEASED),
        ],
    )
    def test_what_it_cannot_say(self, step: Step, of_partner: Cause | None, of_commander: Cause | None) -> None:
        transfer = transfer_in(step)
        assert transfer.implied(partner_standard=True, commander_standard=False) is of_partner
        assert transfer.implied(partner_standard=False, commander_standard=True) is of_commander
