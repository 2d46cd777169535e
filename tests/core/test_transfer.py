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

A, B, C, D = 251, 252, 253, 254
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

    def test_after_the_hurry_a_partner_whose_operator_agreed_has_the_time_of_a_step(self) -> None:
        transfer = Transfer(KEY, Reason.COMMANDER_LOST, Limits(), 100.0, forced_until=102.0)
        transfer.move(Cause.PARTNER_ASKS, 100.5)
        transfer.move(Cause.PARTNER_READY, 110.0)
        transfer.move(Cause.CONSENTED, 110.0)
        assert (transfer.step, transfer.timeout_at) == (Step.CONNECT, 114.0)

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


class TestWhichTransferIsMeant:
    """A key names the transfer to the partner or to a station in reserve, and no other transfer."""

    def test_the_partner_and_a_station_in_reserve(self) -> None:
        transfer = Transfer(KEY, Reason.COMMANDER_LOST, Limits(), 100.0, forced_until=102.0)
        transfer.invite(C, 100.0, ready=False)
        assert transfer.concerns(KEY)
        assert transfer.concerns(TransferKey(A, C, 7, 3))

    @pytest.mark.parametrize("station", [B, C])
    @pytest.mark.parametrize(("number", "epoch"), [(6, 3), (8, 3), (7, 2), (7, 4)])
    def test_a_transfer_before_it_or_of_another_epoch_is_not_meant(self, station: int, number: int, epoch: int) -> None:
        transfer = Transfer(KEY, Reason.COMMANDER_LOST, Limits(), 100.0, forced_until=102.0)
        transfer.invite(C, 100.0, ready=False)
        assert not transfer.concerns(TransferKey(A, station, number, epoch))


class TestGraverReason:
    """A transfer for a graver reason may take its place, until the partner is told to set itself up."""

    @pytest.mark.parametrize("step", Step, ids=lambda step: step.name)
    def test_until_the_partner_is_told_to_connect(self, step: Step) -> None:
        assert transfer_in(step).yields_to(Reason.ZONE_ENDS) is (step in (Step.REQUEST, Step.CONSENT))

    def test_the_same_reason_is_not_graver(self) -> None:
        assert not transfer_in(Step.REQUEST).yields_to(Reason.ZONE)

    def test_a_raised_transfer_asks_again_at_once_and_its_time_to_answer_begins_again(self) -> None:
        transfer = transfer_in(Step.REQUEST)
        transfer.due(100.0)
        transfer.raise_to(Reason.ZONE_ENDS, 100.1, crossing=4)
        assert transfer.due(100.1) == [(B, HandoverRequest(KEY, Reason.ZONE_ENDS, 4))]
        assert (transfer.slow(101.0), transfer.slow(101.1)) == (False, True)


class TestAnswersLate:
    """A station that takes longer than a second to answer does not count as one that could take the aircraft."""

    @pytest.mark.parametrize(
        ("step", "now", "unanswered"),
        [
            (Step.REQUEST, 100.9, False),
            (Step.REQUEST, 101.0, True),
            (Step.CONSENT, 109.0, False),  # the commander is asked
            (Step.CONNECT, 100.9, False),
            (Step.CONNECT, 101.0, True),
            (Step.CONNECT_FREED, 101.0, True),
            (Step.RELEASE, 109.0, False),
        ],
    )
    def test_only_in_the_steps_of_the_partner(self, step: Step, now: float, unanswered: bool) -> None:
        assert transfer_in(step).unanswered(now) is unanswered

    def test_a_partner_whose_operator_is_asked_has_answered(self) -> None:
        transfer = transfer_in(Step.REQUEST)
        transfer.move(Cause.PARTNER_ASKS, 100.1)
        assert not transfer.unanswered(109.0)
        transfer.move(Cause.PARTNER_READY, 109.0)
        transfer.move(Cause.CONSENTED, 109.0)
        assert (transfer.unanswered(109.9), transfer.unanswered(110.0)) == (False, True)

    def test_in_reserve_an_operator_that_is_asked_says_nothing_of_the_partner(self) -> None:
        transfer = Transfer(KEY, Reason.COMMANDER_LOST, Limits(), 100.0, forced_until=102.0)
        transfer.invite(C, 100.0, ready=False)
        transfer.move(Cause.PARTNER_ASKS, 100.1, station=C)
        assert transfer.unanswered(101.0)


class TestPartnersOperatorInAHurry:
    """The zone ends and another station is there: the partner's operator has the time of a step."""

    def test_no_answer_of_the_operator_is_named_so(self) -> None:
        transfer = transfer_in(Step.REQUEST)
        transfer.partner_asks_in_a_hurry(101.0)
        assert transfer.timeout_at == 104.0
        assert transfer.move(Cause.TIMEOUT, 104.0) == End(Outcome.ABORTED, Reason.PARTNER_UNANSWERED)

    def test_time_that_the_operator_had_before_is_taken_back(self) -> None:
        transfer = transfer_in(Step.REQUEST)
        transfer.move(Cause.PARTNER_ASKS, 101.0)
        assert transfer.timeout_at == 131.0
        transfer.partner_asks_in_a_hurry(110.0)
        assert transfer.timeout_at == 114.0

    @pytest.mark.parametrize("step", [Step.CONSENT, Step.CONNECT], ids=lambda step: step.name)
    def test_the_same_word_once_more_after_the_consent_changes_nothing(self, step: Step) -> None:
        transfer = transfer_in(step)
        before = transfer.timeout_at
        transfer.partner_asks_in_a_hurry(101.0)
        assert (transfer.partner_asks, transfer.timeout_at) == (False, before)

    def test_without_operators_to_wait_for_it_ends(self) -> None:
        transfer = Transfer(KEY, Reason.COMMANDER_LOST, Limits(), 100.0, forced_until=102.0)
        transfer.invite(C, 100.0, ready=False)
        transfer.move(Cause.PARTNER_ASKS, 100.1)
        transfer.stop_waiting_for_operators()
        assert transfer.move(Cause.TIMEOUT, 102.0) == End(Outcome.ABORTED, Reason.PARTNER_SILENT)


def test_an_answer_just_after_another_question_may_be_meant_for_that_one() -> None:
    transfer = transfer_in(Step.REQUEST)
    assert transfer.read_until < 100.0
    transfer.follows_another(102.0)
    assert transfer.read_until == 102.0


def test_a_step_that_is_slow_is_so_from_the_second_on() -> None:
    transfer = transfer_in(Step.REQUEST)
    assert (transfer.slow(100.9), transfer.slow(101.0)) == (False, True)


def forced_with(*others: int) -> Transfer:
    """A forced transfer to B that asks these stations as well; the time is up at 102."""
    transfer = Transfer(KEY, Reason.COMMANDER_LOST, Limits(), 100.0, forced_until=102.0)
    for station in others:
        transfer.invite(station, 100.0, ready=False)
    return transfer


class TestStationsInReserve:
    """A forced transfer asks several stations; one of them is the partner, the others are in reserve."""

    @pytest.mark.parametrize("cause", [Cause.PARTNER_REFUSED, Cause.PARTNER_LOST, Cause.LEFT_REGION])
    def test_one_in_reserve_that_falls_away_is_told_of_and_asked_no_more(self, cause: Cause) -> None:
        transfer = forced_with(C)
        assert transfer.move(cause, 100.5, station=C) is False
        assert (transfer.key.to_station, transfer.others) == (B, ())
        assert [station for station, _why in transfer.pop_fallen()] == [C]
        assert transfer.pop_fallen() == ()

    def test_the_partner_that_falls_away_is_told_of_and_the_next_takes_its_place(self) -> None:
        transfer = forced_with(C)
        assert transfer.move(Cause.PARTNER_REFUSED, 100.5) is True
        assert (transfer.key.to_station, transfer.others, transfer.step) == (C, (), Step.REQUEST)
        assert transfer.pop_fallen() == ((B, Reason.PARTNER_REFUSED),)

    def test_one_that_is_ready_during_connect_waits_in_reserve(self) -> None:
        transfer = forced_with(C)
        for cause in (Cause.PARTNER_READY, Cause.CONSENTED):
            transfer.move(cause, 100.5)
        assert transfer.move(Cause.PARTNER_READY, 100.5, station=C) is False
        assert (transfer.key.to_station, transfer.step, transfer.timeout_at) == (B, Step.CONNECT, 101.3)

    def test_asked_again_after_it_fell_away_it_has_to_answer_again(self) -> None:
        transfer = forced_with(C)
        for cause in (Cause.PARTNER_READY, Cause.CONSENTED):
            transfer.move(cause, 100.5)
        transfer.move(Cause.PARTNER_READY, 100.6, station=C)
        transfer.move(Cause.PARTNER_LOST, 100.7, station=C)
        transfer.invite(C, 100.8, ready=False)
        assert [station for station, _message in transfer.due(100.8)] == [B, C]

    def test_its_operator_is_to_be_asked_again_too(self) -> None:
        transfer = forced_with(C)
        transfer.move(Cause.PARTNER_ASKS, 100.1, station=C)
        transfer.move(Cause.PARTNER_LOST, 100.2, station=C)
        transfer.invite(C, 100.3, ready=False)
        transfer.move(Cause.PARTNER_ASKS, 100.4)
        assert (transfer.hurry_over, transfer.timeout_at) == (False, 102.0)

    def test_after_the_hurry_an_operator_that_is_asked_later_has_thirty_seconds(self) -> None:
        transfer = forced_with()
        transfer.move(Cause.PARTNER_ASKS, 100.5)
        transfer.invite(C, 110.0, ready=False)
        transfer.move(Cause.PARTNER_ASKS, 111.0, station=C)
        assert transfer.timeout_at == 141.0

    def test_an_operator_that_is_asked_during_connect_ends_no_hurry(self) -> None:
        transfer = forced_with()
        for cause in (Cause.PARTNER_READY, Cause.CONSENTED, Cause.PARTNER_ASKS):
            transfer.move(cause, 100.5)
        assert (transfer.step, transfer.hurry_over, transfer.timeout_at) == (Step.CONNECT, False, 102.0)

    def test_at_the_end_of_the_time_one_that_is_ready_may_still_take_the_aircraft(self) -> None:
        transfer = forced_with()
        transfer.invite(C, 101.9, ready=True)
        assert transfer.timeout_at == 102.0
        assert transfer.move(Cause.TIMEOUT, 102.0) is True
        assert (transfer.key.to_station, transfer.step, transfer.timeout_at) == (C, Step.CONNECT, 104.0)
        assert transfer.pop_fallen() == ((B, Reason.PARTNER_SILENT),)

    def test_at_the_end_of_the_time_stations_that_are_not_ready_are_not_waited_for(self) -> None:
        transfer = forced_with(C)
        assert transfer.move(Cause.TIMEOUT, 102.0) == End(Outcome.ABORTED, Reason.PARTNER_SILENT)

    def test_at_the_end_of_the_time_only_operators_that_are_asked_are_waited_for(self) -> None:
        transfer = forced_with(C, D)
        for station in (C, D):
            transfer.move(Cause.PARTNER_ASKS, 100.5, station=station)
        assert transfer.move(Cause.TIMEOUT, 102.0) is True
        assert (transfer.partners, transfer.hurry_over, transfer.timeout_at) == ((C, D), True, 130.5)
        assert transfer.pop_fallen() == ((B, Reason.PARTNER_SILENT),)
        assert transfer.move(Cause.TIMEOUT, 130.5) is True  # C has not answered, and D no more
        assert transfer.move(Cause.TIMEOUT, 130.5) == End(Outcome.ABORTED, Reason.PARTNER_UNANSWERED)

    def test_the_partners_operator_is_waited_for_and_a_silent_station_is_not(self) -> None:
        transfer = forced_with(C)
        transfer.move(Cause.PARTNER_ASKS, 100.5)
        assert transfer.move(Cause.TIMEOUT, 102.0) is False
        assert (transfer.partners, transfer.hurry_over) == ((B,), True)
        assert transfer.pop_fallen() == ((C, Reason.PARTNER_SILENT),)

    def test_a_partner_that_lets_connect_wait_is_silent_though_its_operator_was_asked(self) -> None:
        transfer = forced_with(C)
        for cause in (Cause.PARTNER_ASKS, Cause.PARTNER_READY, Cause.CONSENTED):
            transfer.move(cause, 100.5)
        assert transfer.step is Step.CONNECT
        assert transfer.move(Cause.TIMEOUT, 102.0) == End(Outcome.ABORTED, Reason.PARTNER_SILENT)

    @pytest.mark.parametrize("ready", [False, True])
    def test_a_step_that_runs_out_before_the_time_leaves_the_rest_of_it_to_the_next(self, ready: bool) -> None:
        transfer = Transfer(KEY, Reason.COMMANDER_LOST, Limits(), 100.0, forced_until=106.0)
        transfer.invite(C, 100.0, ready=False)
        for cause in (Cause.PARTNER_READY, Cause.CONSENTED):
            transfer.move(cause, 101.0)
        if ready:
            transfer.move(Cause.PARTNER_READY, 104.5, station=C)
        assert transfer.timeout_at == 105.0
        assert transfer.move(Cause.TIMEOUT, 105.0) is True
        assert (transfer.key.to_station, transfer.timeout_at) == (C, 106.0)
        assert transfer.step is (Step.CONNECT if ready else Step.REQUEST)


class TestAnswerInFlight:
    """The commander is lost while the partner's answer to a planned handover is on its way."""

    def asked(self) -> Transfer:
        """A planned transfer whose partner asks its operator; the question is out once more."""
        transfer = Transfer(KEY, Reason.ZONE, Limits(), 0.0)
        transfer.due(0.0)
        transfer.move(Cause.PARTNER_ASKS, 0.1)
        return transfer

    def test_that_answer_does_not_say_that_the_operator_is_asked_about_the_loss(self) -> None:
        transfer = self.asked()
        assert transfer.due(4.9)
        transfer.move(Cause.COMMANDER_LOST, 5.0)
        assert transfer.due(5.0)
        transfer.move(Cause.PARTNER_ASKS, 5.05)
        assert (transfer.hurry_over, transfer.asking) == (False, frozenset())
        assert transfer.move(Cause.PARTNER_READY, 5.06)

    def test_the_next_one_does(self) -> None:
        transfer = self.asked()
        transfer.due(4.9)
        transfer.move(Cause.COMMANDER_LOST, 5.0)
        transfer.due(5.0)
        transfer.move(Cause.PARTNER_ASKS, 5.05)
        transfer.move(Cause.PARTNER_ASKS, 5.06)
        assert (transfer.hurry_over, transfer.asking) == (True, frozenset((B,)))

    def test_without_an_open_question_the_first_one_does(self) -> None:
        transfer = self.asked()
        transfer.move(Cause.COMMANDER_LOST, 5.0)
        transfer.due(5.0)
        transfer.move(Cause.PARTNER_ASKS, 5.05)
        assert transfer.hurry_over
