# SPDX-License-Identifier: GPL-3.0-or-later

"""The manager of transfers by itself: when one begins, what a message does to it, and what its end changes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.control import Effect
from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.authority.transfer import Cause, Step, Transfer
from mavproxy_handover.core.authority.transfer_manager import TransferManager
from mavproxy_handover.core.common.events import (
    Action,
    Advise,
    AutopilotState,
    BordersSeen,
    ControlRequested,
    NotifyOwner,
    Record,
    Send,
    ViewChanged,
)
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import (
    ConnectHandover,
    DisconnectHandover,
    DroneConnected,
    HandoverAhead,
    HandoverRequest,
    HandoverResult,
    OkHandover,
    OnHandover,
    TransferKey,
    TransferMessage,
)
from mavproxy_handover.core.common.model import (
    BorderFact,
    Consent,
    Outcome,
    Phase,
    Reason,
    StandingConsent,
    Station,
    ZoneFact,
)
from tests.core.test_candidates import NAMES, NOW, A, B, C, candidates

KEY = TransferKey(A, B, 1, 4)
WANTS = ControlRequested(B, True, False, 10.0, B)


class Bench:
    """GCSA commands in flight, in epoch 4. The zones of all three hold the aircraft; those of GCSB and GCSC did before
    it took off, so that they call for no handover."""

    def __init__(self, **standard: StandingConsent | None) -> None:
        """`standard`: stations without our module, by the last letter, and what the vehicle's file answers for them."""
        self.limits = Limits()
        self.flight = Flight(self.limits)
        self.fly()
        self.flight.position_seen(NOW)
        self.authority = Authority([Station(sysid, name) for sysid, name in NAMES.items()], self.flight)
        self.authority.owner, self.authority.epoch, self.authority.phase = A, 4, Phase.ON_MISSION
        self.authority.refresh(Reason.NONE, [])
        self.candidates = candidates()
        self.candidates.zones.forget_entries()
        self.presence = self.candidates._presence
        for letter, consent in standard.items():
            sysid = next(sysid for sysid, name in NAMES.items() if name.endswith(letter))
            there = self.presence[sysid] = Presence(Station(sysid, NAMES[sysid], True, consent), self.limits)
            there.heard_at = NOW
        self.manager = TransferManager(self.authority, self.flight, self.presence, self.candidates, self.limits)
        self.actions: list[Action] = []

    def fly(self, *, flying: bool = True) -> None:
        self.flight.autopilot_said(AutopilotState(flying, flying), NOW)

    def zones(self, *, exit_s: float | None = None, outside: tuple[int, ...] = (), now: float = NOW) -> None:
        """The zones of all but `outside` hold the aircraft; it leaves that of GCSA in `exit_s`."""
        self.candidates.zones.update(
            [ZoneFact(sysid, -100.0 if sysid in outside else 100.0, exit_s if sysid == A else None) for sysid in NAMES],
            now,
        )

    def enter(self, *stations: int) -> None:
        """The aircraft enters the zones of these."""
        self.zones(outside=stations)
        self.zones()

    def begin(self, reason: Reason = Reason.REQUESTED, now: float = NOW, **options: bool) -> Transfer:
        self.manager.begin(B, reason, now, self.actions, **options)  # type: ignore[arg-type]
        assert self.authority.transfer is not None
        return self.authority.transfer

    def says(self, station: int, message: TransferMessage, now: float = NOW) -> str | None:
        return self.manager.on_message(station, message, now, self.actions)

    def move(self, cause: Cause, now: float = NOW) -> None:
        self.manager.move(cause, now, self.actions)

    def seek(self, now: float = NOW) -> Transfer | None:
        self.manager.seek(now, self.actions)
        return self.authority.transfer

    def lose(self, now: float = NOW) -> None:
        self.authority.lose(A, now, [])

    def records(self) -> list[Record]:
        return [each for each in self.actions if isinstance(each, Record)]

    def events(self) -> list[str]:
        return [each.event for each in self.records()]

    def sent(self) -> list[tuple[int, type]]:
        return [(each.station, type(each.message)) for each in self.actions if isinstance(each, Send)]

    def commit(self, now: float = NOW) -> None:
        """The transfer under way goes through all its steps."""
        for station, message in (
            (B, OnHandover(KEY)),
            (A, OkHandover(KEY)),
            (B, DroneConnected(KEY)),
            (A, DisconnectHandover(KEY)),
        ):
            assert self.says(station, message, now) is None

    def step(self) -> Step:
        assert self.authority.transfer is not None
        return self.authority.transfer.step


def at_consent(**standard: StandingConsent | None) -> Bench:
    """A transfer for a request waits for the commander."""
    bench = Bench(**standard)
    bench.begin()
    bench.says(B, OnHandover(KEY))
    assert bench.step() is Step.CONSENT
    bench.actions.clear()
    return bench


class TestSeek:
    def test_a_zone_that_is_entered_calls_for_a_transfer(self) -> None:
        bench = Bench()
        assert bench.seek() is None
        bench.enter(B)
        transfer = bench.seek()
        assert transfer is not None
        assert (transfer.key, transfer.reason, transfer.consented, transfer.forced) == (KEY, Reason.ZONE, False, False)
        assert transfer.crossing == 0

    def test_where_takeover_is_allowed_the_commander_has_agreed(self) -> None:
        bench = Bench()
        bench.authority.takeover_allowed = True
        bench.enter(B)
        transfer = bench.seek()
        assert transfer is not None
        assert transfer.consented

    @pytest.mark.parametrize("phase", Phase)
    def test_without_a_transfer_only_on_a_mission_or_in_an_emergency(self, phase: Phase) -> None:
        bench = Bench()
        bench.authority.phase = phase
        bench.enter(B)
        assert (bench.seek() is not None) is (phase in (Phase.ON_MISSION, Phase.EMERGENCY))

    def test_not_without_an_owner_on_the_ground_or_without_a_position(self) -> None:
        bench = Bench()
        bench.enter(B)
        bench.authority.owner = None
        assert bench.seek() is None
        bench.authority.owner = A
        assert bench.seek(NOW + 2.0) is None
        bench.fly(flying=False)
        assert bench.seek() is None
        assert bench.actions == []
        bench.fly()
        assert bench.seek() is not None

    def test_while_a_transfer_is_under_way_that_nothing_but_a_loss_replaces_no_station_is_looked_at(self) -> None:
        bench = Bench()
        bench.begin(Reason.ZONE_ENDS)
        bench.authority.phase = Phase.ON_HANDOVER
        bench.presence[C].answer = None
        bench.actions.clear()
        bench.zones(exit_s=3.0)
        bench.seek()
        assert bench.actions == []

    def test_a_graver_reason_replaces_the_transfer_under_way(self) -> None:
        bench = Bench()
        bench.begin()
        bench.authority.phase = Phase.ON_HANDOVER
        bench.actions.clear()
        bench.enter(C)
        transfer = bench.seek()
        assert transfer is not None
        assert transfer.key == replace(KEY, to_station=C, handover_id=2)
        assert bench.events() == ["transfer_aborted", "transfer_begun"]

    def test_a_reason_that_is_no_graver_does_not(self) -> None:
        bench = Bench()
        first = bench.begin(Reason.ZONE)
        bench.enter(C)
        assert bench.seek() is first

    def test_the_same_partner_for_a_graver_reason_is_the_same_transfer(self) -> None:
        bench = Bench()
        first = bench.begin()
        bench.actions.clear()
        bench.enter(B)
        bench.manager.seek(NOW + 1.0, bench.actions)
        assert bench.authority.transfer is first
        assert (first.reason, first.retry_at) == (Reason.ZONE, NOW + 1.0)
        assert bench.actions == [
            Record("transfer_raised", "handover 1 is now for zone", Reason.ZONE, B),
            ViewChanged(bench.authority.view, Reason.ZONE),
        ]
        assert bench.authority.view.why is Reason.ZONE


class TestRaised:
    def foreseen(self) -> Bench:
        bench = Bench()
        bench.zones(outside=(B,))
        event = BordersSeen((BorderFact(0, 5.0, frozenset({A, B})),))
        bench.manager.foresight.seen(event, NOW, [])
        return bench

    def test_it_has_the_number_of_the_border_that_was_foreseen(self) -> None:
        bench = self.foreseen()
        assert bench.begin().crossing == 0
        bench.enter(B)
        transfer = bench.seek()
        assert transfer is not None
        assert (transfer.reason, transfer.crossing) == (Reason.ZONE, 1)
        bench.zones(exit_s=3.0)
        bench.manager.foresight._over()
        assert bench.seek() is transfer
        assert (transfer.reason, transfer.crossing) == (Reason.ZONE_ENDS, 1), "it keeps the number that it had"

    def test_so_has_one_that_begins_there_unless_it_is_forced(self) -> None:
        bench = self.foreseen()
        assert bench.begin(Reason.ZONE).crossing == 1
        bench = self.foreseen()
        assert bench.begin(Reason.ZONE, forced=True).crossing == 0

    @pytest.mark.parametrize(("outside", "until"), [((), NOW + 5.0), ((C,), NOW + 31.0)])
    def test_a_partners_operator_has_no_more_time_where_another_station_could_take_it_and_the_zone_ends(
        self, outside: tuple[int, ...], until: float
    ) -> None:
        bench = Bench()
        transfer = bench.begin()
        bench.says(B, OnHandover(KEY, Consent.WAITING), NOW + 1.0)
        assert transfer.timeout_at == NOW + 31.0
        bench.zones(exit_s=3.0, outside=outside)
        bench.manager.seek(NOW + 1.0, bench.actions)
        assert transfer.timeout_at == until

    def test_the_vehicles_file_may_answer_the_graver_reason(self) -> None:
        bench = at_consent(A=StandingConsent.AUTOMATIC)
        bench.enter(B)
        bench.seek()
        assert bench.step() is Step.CONNECT


class TestSuccessor:
    def lost(self, **standard: StandingConsent | None) -> Bench:
        bench = Bench(**standard)
        bench.lose()
        return bench

    def test_all_stations_that_could_take_it_are_asked_the_best_first(self) -> None:
        bench = self.lost()
        transfer = bench.seek()
        assert transfer is not None
        assert (transfer.key, transfer.others, transfer.forced) == (KEY, (C,), True)
        assert [each for each in bench.records() if each.event == "candidate"] == [
            Record("candidate", "handover 1 (forced): GCSC is asked too", Reason.COMMANDER_LOST, C)
        ]
        bench.actions.clear()
        bench.seek(NOW + 1.0)
        assert (transfer.others, bench.actions) == ((C,), [])

    def test_a_standard_station_counts_as_ready(self) -> None:
        transfer = self.lost(C=None).seek()
        assert transfer is not None
        assert transfer.ready == {C}

    def test_none_while_the_owner_of_the_run_before_may_come_back(self) -> None:
        bench = self.lost()
        bench.authority.recover_until = NOW + 1.0
        assert bench.seek() is None

    def test_none_where_no_station_could_take_it(self) -> None:
        bench = self.lost()
        bench.zones(outside=(B, C))
        assert bench.seek() is None

    def test_it_joins_no_transfer_that_has_a_commander(self) -> None:
        bench = Bench()
        transfer = bench.begin()
        bench.lose()
        assert bench.seek() is transfer
        assert transfer.others == ()

    @pytest.mark.parametrize(("after_s", "until"), [(1.9, NOW + 2.0), (2.0, NOW + 4.0)])
    def test_all_attempts_after_one_loss_have_two_seconds_together(self, after_s: float, until: float) -> None:
        bench = self.lost()
        bench.flight.position_seen(NOW + after_s)
        bench.fly()
        transfer = bench.seek(NOW + after_s)
        assert transfer is not None
        assert transfer.forced_until == until


class TestBegin:
    def test_it_is_journalled_shown_and_a_phase_of_its_own(self) -> None:
        bench = Bench()
        bench.begin(Reason.ZONE)
        view = bench.authority.view
        assert bench.actions == [
            ViewChanged(view, Reason.ZONE),
            Record("transfer_begun", "handover 1: GCSA -> GCSB", Reason.ZONE, B),
        ]
        assert (view.phase, view.partner, view.handover_id) == (Phase.ON_HANDOVER, B, 1)

    def test_forced_it_says_so_and_asks_no_commander(self) -> None:
        bench = Bench()
        transfer = bench.begin(Reason.COMMANDER_LOST, forced=True)
        assert bench.records()[0].text == "handover 1 (forced): GCSA -> GCSB"
        assert (transfer.forced, transfer.forced_until) == (True, NOW + 2.0)

    def test_one_to_a_standard_station_that_was_agreed_is_over_at_once(self) -> None:
        bench = Bench(B=None)
        bench.manager.begin(B, Reason.REQUESTED, NOW, bench.actions, consented=True)
        assert bench.events() == ["transfer_begun", "step", "step", "step", "transfer_committed"]
        assert bench.authority.owner == B

    @pytest.mark.parametrize(("after_s", "read_until"), [(1.9, NOW + 3.9), (2.0, None)])
    def test_soon_after_another_an_answer_may_be_meant_for_that_one(
        self, after_s: float, read_until: float | None
    ) -> None:
        bench = Bench()
        bench.begin()
        bench.move(Cause.CANCELLED)
        transfer = bench.begin(now=NOW + after_s)
        assert (transfer.read_until if transfer.read_until > 0.0 else None) == read_until

    def test_the_result_of_the_last_one_is_not_told_any_more(self) -> None:
        bench = Bench()
        bench.begin()
        bench.move(Cause.CANCELLED)
        assert len(bench.manager.results.deadlines()) == 2
        bench.begin()
        assert bench.manager.results.deadlines() == []

    @pytest.mark.parametrize(
        ("reason", "consented", "repeats"),
        [
            (Reason.REQUESTED, True, True),
            (Reason.GIVEN, True, True),
            (Reason.ZONE, True, False),
            (Reason.REQUESTED, False, False),
        ],
    )
    def test_only_a_transfer_by_the_last_request_may_be_asked_for_again(
        self, reason: Reason, consented: bool, repeats: bool
    ) -> None:
        bench = Bench()
        bench.manager.echo.note(WANTS, Effect.TRANSFER_CONSENTED, NOW)
        bench.begin(reason, consented=consented)
        bench.manager.echo.took_effect(NOW)
        assert bench.manager.echo.repeats(WANTS, NOW) is repeats


class TestMessages:
    def test_the_four_answers_move_authority(self) -> None:
        bench = Bench()
        bench.begin()
        bench.commit()
        assert (bench.authority.owner, bench.authority.epoch, bench.authority.transfer) == (B, 5, None)

    def test_without_a_transfer_they_mean_nothing(self) -> None:
        bench = Bench()
        assert bench.says(B, OnHandover(KEY)) == "stale epoch or unknown transfer"
        assert bench.actions == []

    @pytest.mark.parametrize("key", [replace(KEY, epoch=3), replace(KEY, handover_id=2), replace(KEY, to_station=C)])
    def test_nor_does_one_with_another_key(self, key: TransferKey) -> None:
        bench = Bench()
        transfer = bench.begin()
        assert bench.says(key.to_station, OnHandover(key)) == "stale epoch or unknown transfer"
        assert transfer.step is Step.REQUEST

    def test_who_asks_about_the_last_one_is_told_its_result_again(self) -> None:
        bench = Bench()
        bench.begin()
        bench.move(Cause.CANCELLED)
        bench.actions.clear()
        assert bench.says(B, OnHandover(KEY)) == "transfer already over"
        assert bench.sent() == [(B, HandoverResult)]
        assert bench.says(B, OnHandover(replace(KEY, handover_id=9))) == "stale epoch or unknown transfer"
        assert bench.says(C, OnHandover(replace(KEY, to_station=C))) == "stale epoch or unknown transfer"
        assert len(bench.actions) == 1

    def test_what_is_not_the_senders_to_say_is_dropped(self) -> None:
        bench = Bench()
        bench.begin()
        assert bench.says(C, OnHandover(KEY)) == "not the sender's to say"
        assert bench.step() is Step.REQUEST

    def test_a_lost_commander_has_no_say(self) -> None:
        bench = Bench()
        bench.lose()
        transfer = bench.begin(Reason.COMMANDER_LOST, forced=True)
        assert bench.says(A, OkHandover(KEY)) == "the commander is lost"
        assert transfer.step is Step.REQUEST
        assert bench.says(B, OnHandover(KEY)) is None

    def test_a_station_that_speaks_is_not_mute_any_more(self) -> None:
        bench = Bench()
        bench.candidates.pause(B, Reason.REQUESTED, Reason.PARTNER_SILENT, NOW)
        bench.begin()
        bench.says(B, OnHandover(KEY, Consent.WAITING))
        assert not bench.candidates.mute(B)

    @pytest.mark.parametrize(
        ("reason", "outside", "until"),
        [
            (Reason.ZONE_ENDS, (), NOW + 4.0),
            (Reason.ZONE_ENDS, (C,), NOW + 30.0),
            (Reason.ZONE, (), NOW + 30.0),
            (Reason.REQUESTED, (), NOW + 30.0),
        ],
    )
    def test_a_partners_operator_has_time_unless_the_zone_ends_and_another_station_is_there(
        self, reason: Reason, outside: tuple[int, ...], until: float
    ) -> None:
        bench = Bench()
        if reason is Reason.ZONE:
            bench.enter(B, C)
        else:
            bench.zones(exit_s=3.0, outside=outside)
        transfer = bench.begin(reason)
        assert bench.says(B, OnHandover(KEY, Consent.WAITING)) is None
        assert transfer.timeout_at == until
        assert transfer.partner_asks is (until == NOW + 4.0)
        assert transfer.operator_asked is (until != NOW + 4.0)
        assert bench.says(B, OnHandover(KEY)) is None
        assert transfer.step is Step.CONSENT

    def test_another_station_in_a_zone_that_does_not_call_for_this_is_not_there(self) -> None:
        """GCSC has denied a moment ago."""
        bench = Bench()
        bench.zones(exit_s=3.0)
        bench.candidates.pause(C, Reason.ZONE_ENDS, Reason.PARTNER_REFUSED, NOW)
        transfer = bench.begin(Reason.ZONE_ENDS)
        bench.says(B, OnHandover(KEY, Consent.WAITING))
        assert transfer.timeout_at == NOW + 30.0

    def test_in_a_forced_transfer_a_partners_operator_is_asked_without_a_hurry_of_this_kind(self) -> None:
        bench = Bench()
        bench.zones(exit_s=3.0)
        bench.lose()
        transfer = bench.begin(Reason.ZONE_ENDS, forced=True)
        bench.says(B, OnHandover(KEY, Consent.WAITING))
        assert (transfer.operator_asked, transfer.partner_asks) == (True, False)

    @pytest.mark.parametrize("relay", [True, False])
    def test_a_partner_without_a_ground_link_is_passed_on_at_once(self, relay: bool) -> None:
        bench = Bench()
        transfer = bench.begin()
        bench.says(B, OnHandover(KEY, relay=relay), NOW + 1.0)
        assert transfer.retry_at == (NOW + 1.0 if relay else NOW + 1.2)
        bench.says(A, OkHandover(KEY), NOW + 1.0)
        bench.says(B, DroneConnected(KEY, relay=relay), NOW + 2.0)
        assert transfer.retry_at == (NOW + 2.0 if relay else NOW + 2.2)


class TestCancel:
    def test_by_one_of_its_two_stations(self) -> None:
        for station in (A, B):
            bench = Bench()
            bench.begin()
            bench.manager.cancel(station, NOW, bench.actions)
            assert bench.authority.transfer is None
            assert bench.records()[-1].text == "handover 1 aborted (cancelled): GCSA commands"

    def test_not_by_another_and_not_without_one(self) -> None:
        bench = Bench()
        bench.manager.cancel(B, NOW, bench.actions)
        assert bench.actions == []
        transfer = bench.begin()
        bench.manager.cancel(C, NOW, bench.actions)
        assert bench.authority.transfer is transfer

    def test_a_forced_one_goes_on_with_the_others(self) -> None:
        bench = Bench()
        bench.lose()
        bench.seek()
        bench.actions.clear()
        bench.manager.cancel(B, NOW, bench.actions)
        transfer = bench.authority.transfer
        assert transfer is not None
        assert transfer.key.to_station == C
        assert bench.records() == [
            Record("candidate", "handover 1 (forced): GCSB: the partner's operator denied", Reason.PARTNER_REFUSED, B),
            Record("candidate", "handover 1 (forced): GCSC is the partner now", Reason.COMMANDER_LOST, C),
            Record("step", "handover 1: request -> request (partner refused)", duration_s=0.0),
        ]
        assert bench.candidates.paused_s(B, Reason.COMMANDER_LOST, NOW) == 10.0
        assert bench.authority.view.partner == C


class TestJustChanged:
    def test_without_a_transfer_for_two_seconds_after_an_abort_unless_the_commander_denied(self) -> None:
        bench = Bench()
        assert not bench.manager.just_changed(NOW)
        for end, changed in ((Cause.CANCELLED, True), (Cause.DENIED, False)):
            bench = Bench()
            bench.begin()
            bench.move(end)
            assert bench.manager.just_changed(NOW + 1.9) is changed
            assert not bench.manager.just_changed(NOW + 2.0)

    def test_during_the_next_one_until_its_question_has_been_read(self) -> None:
        bench = Bench()
        bench.begin()
        bench.move(Cause.CANCELLED)
        transfer = bench.begin(now=NOW + 1.0)
        assert bench.manager.just_changed(NOW + 2.9)
        assert not bench.manager.just_changed(NOW + 3.0)
        transfer.consent_given()
        assert not bench.manager.just_changed(NOW + 2.9)


class TestConsent:
    def test_by_other_means_it_counts_as_an_answer(self) -> None:
        bench = at_consent()
        bench.manager.consent(NOW, bench.actions)
        assert bench.step() is Step.CONNECT
        bench = Bench()
        bench.manager.consent(NOW, bench.actions)
        assert bench.actions == []

    def test_before_the_partner_has_answered_it_is_kept(self) -> None:
        bench = Bench()
        transfer = bench.begin()
        bench.manager.consent(NOW, bench.actions)
        assert (transfer.step, transfer.consented) == (Step.REQUEST, True)

    @pytest.mark.parametrize(
        ("consent", "reason", "step"),
        [
            (StandingConsent.AUTOMATIC, Reason.ZONE, Step.CONNECT),
            (StandingConsent.AUTOMATIC, Reason.REQUESTED, Step.CONSENT),
            (StandingConsent.AUTOMATIC, Reason.GIVEN, Step.CONSENT),
            (None, Reason.ZONE, Step.CONSENT),
            (StandingConsent.REFUSE, Reason.ZONE, None),
        ],
    )
    def test_the_vehicles_file_answers_for_a_station_that_cannot(
        self, consent: StandingConsent | None, reason: Reason, step: Step | None
    ) -> None:
        bench = Bench(A=consent)
        assert bench.begin(reason).step is Step.REQUEST, "the partner answers first"
        bench.says(B, OnHandover(KEY))
        transfer = bench.authority.transfer
        assert (None if transfer is None else transfer.step) is step
        if transfer is None:
            assert bench.records()[-1].text == "handover 1 aborted (consent refused): GCSA commands"
        else:
            assert transfer.operator_asked is (step is Step.CONSENT)

    def test_a_station_with_our_module_says_itself_that_its_operator_is_asked(self) -> None:
        transfer = at_consent().authority.transfer
        assert transfer is not None
        assert not transfer.operator_asked


class TestMove:
    def test_without_a_transfer_nothing_happens(self) -> None:
        bench = Bench()
        bench.move(Cause.CANCELLED)
        assert bench.actions == []

    def test_a_step_is_journalled_with_its_time(self) -> None:
        bench = Bench()
        bench.begin()
        bench.actions.clear()
        bench.says(B, OnHandover(KEY), NOW + 1.5)
        assert bench.records() == [Record("step", "handover 1: request -> consent (partner ready)", duration_s=1.5)]
        bench.actions.clear()
        bench.says(B, OnHandover(KEY), NOW + 1.6)
        assert bench.actions == []

    @pytest.mark.parametrize(
        ("shows", "reason"),
        [(True, "commander's operator did not answer"), (False, "commander's program cannot ask its operator")],
    )
    def test_a_standard_commander_that_never_showed_a_question_cannot_be_asked(self, shows: bool, reason: str) -> None:
        bench = at_consent(A=None)
        if shows:
            bench.presence[A].control_shown()
        bench.move(Cause.TIMEOUT)
        assert bench.records()[-1].text == f"handover 1 aborted (the {reason}): GCSA commands"

    def test_that_is_said_of_the_step_of_consent_and_of_its_time_alone(self) -> None:
        bench = Bench(A=None)
        bench.begin()
        bench.move(Cause.TIMEOUT)
        assert bench.records()[-1].text == "handover 1 aborted (partner silent): GCSA commands"
        bench = at_consent(A=None)
        bench.move(Cause.CANCELLED)
        assert bench.records()[-1].text == "handover 1 aborted (cancelled): GCSA commands"

    @pytest.mark.parametrize(("phase", "waits"), [(Phase.ON_LOAD, False), (Phase.ON_HANDOVER, True)])
    def test_on_the_ground_no_operator_is_waited_for_in_a_forced_transfer(self, phase: Phase, waits: bool) -> None:
        bench = Bench()
        bench.lose()
        bench.seek()
        bench.says(B, OnHandover(KEY, Consent.WAITING))
        bench.authority.phase = phase
        bench.move(Cause.CONSENT_REFUSED)
        transfer = bench.authority.transfer
        assert transfer is not None
        assert transfer.asking == {B}, "nothing but the time ends that"
        bench.move(Cause.TIMEOUT, NOW + 2.0)
        assert bench.authority.transfer is (transfer if waits else None)
        assert transfer.hurry_over is waits

    @pytest.mark.parametrize(
        ("outside", "flying", "committed"), [((), True, True), ((B,), True, False), ((B,), False, True)]
    )
    def test_it_does_not_commit_to_a_station_that_could_not_take_the_aircraft(
        self, outside: tuple[int, ...], flying: bool, committed: bool
    ) -> None:
        bench = Bench()
        bench.begin()
        bench.zones(outside=outside)
        bench.fly(flying=flying)
        bench.commit()
        end = "committed: GCSB commands, epoch 5" if committed else "aborted (left region): GCSA commands"
        assert bench.records()[-1].text == f"handover 1 {end}"


class TestTakeOff:
    def test_who_could_not_take_the_aircraft_in_the_air_is_out(self) -> None:
        bench = Bench()
        bench.manager.take_off(NOW, bench.actions)
        bench.begin()
        bench.manager.take_off(NOW, bench.actions)
        assert bench.authority.transfer is not None
        bench.zones(outside=(B,))
        bench.manager.take_off(NOW, bench.actions)
        assert bench.authority.transfer is None
        assert bench.records()[-1].text == "handover 1 aborted (left region): GCSA commands"


class TestEnd:
    def test_a_commit(self) -> None:
        bench = Bench()
        bench.begin(Reason.ZONE)
        bench.actions.clear()
        bench.candidates.pause(C, Reason.ZONE, Reason.PARTNER_SILENT, NOW)
        bench.commit(NOW + 1.5)
        text = "handover 1 committed: GCSB commands, epoch 5"
        assert bench.records()[-1] == Record("transfer_committed", text, Reason.ZONE, B, 1.5)
        result = HandoverResult(replace(KEY, epoch=5), B, Outcome.COMMITTED, Reason.ZONE)
        assert bench.actions[-2:] == [Send(A, result), Send(B, result)]
        view = bench.authority.view
        assert (view.commander, view.partner, view.phase) == (B, None, Phase.ON_MISSION)
        assert bench.candidates.paused_s(C, Reason.ZONE, NOW) == 0.0
        assert bench.candidates.mission.at == 1
        assert not bench.manager.just_changed(NOW + 1.5)

    def test_on_the_ground_it_does_not_move_the_route_on(self) -> None:
        bench = Bench()
        bench.begin()
        bench.authority.phase = Phase.ON_LOAD
        bench.commit()
        assert (bench.authority.owner, bench.candidates.mission.at) == (B, 0)

    def test_a_release_that_never_came_is_told_as_the_reason(self) -> None:
        bench = Bench()
        bench.begin(Reason.ZONE)
        for station, message in ((B, OnHandover(KEY)), (A, OkHandover(KEY)), (B, DroneConnected(KEY))):
            bench.says(station, message)
        bench.move(Cause.TIMEOUT)
        assert bench.records()[-1].reason is Reason.RELEASE_TIMEOUT
        assert bench.authority.owner == B

    def test_an_abort(self) -> None:
        bench = Bench()
        bench.begin()
        bench.actions.clear()
        bench.move(Cause.DENIED, NOW + 1.5)
        view = bench.authority.view
        text = "handover 1 aborted (the commander's operator denied): GCSA commands"
        result = HandoverResult(KEY, A, Outcome.ABORTED, Reason.COMMANDER_DENIED)
        assert bench.actions == [
            ViewChanged(view, Reason.COMMANDER_DENIED),
            Record("transfer_aborted", text, Reason.COMMANDER_DENIED, B, 1.5),
            Send(A, result),
            Send(B, result),
        ]
        assert (view.commander, view.partner, view.phase) == (A, None, Phase.ON_MISSION)
        assert bench.candidates.paused_s(B, Reason.REQUESTED, NOW + 1.5) == 10.0

    @pytest.mark.parametrize(
        ("standard", "cause", "told"),
        [
            ({"A": None}, Cause.DENIED, (A,)),
            ({"A": None, "B": None}, Cause.DENIED, (A, B)),
            ({"A": None}, Cause.CANCELLED, None),
            ({}, Cause.DENIED, None),
        ],
    )
    def test_a_standard_station_is_told_an_operators_answer_in_words_and_no_result(
        self, standard: dict[str, None], cause: Cause, told: tuple[int, ...] | None
    ) -> None:
        bench = Bench(**standard)
        bench.begin()
        bench.actions.clear()
        bench.move(cause)
        advice = [each for each in bench.actions if isinstance(each, Advise)]
        expected = [] if told is None else [Advise(told, "No handover: GCSA's operator denied it.")]
        assert advice == expected
        assert [station for station, _kind in bench.sent()] == [
            station for station in (A, B) if NAMES[station][-1] not in standard
        ]

    def test_a_commit_is_no_operators_answer(self) -> None:
        bench = Bench(A=None)
        bench.begin(consented=True)
        bench.says(B, OnHandover(KEY))
        bench.says(B, DroneConnected(KEY))
        assert bench.authority.owner == B
        assert not [each for each in bench.actions if isinstance(each, Advise)]

    @pytest.mark.parametrize("committed", [True, False])
    def test_the_request_that_led_to_it_may_be_repeated_after_a_commit(self, committed: bool) -> None:
        bench = Bench()
        bench.manager.echo.note(WANTS, Effect.TRANSFER_CONSENTED, NOW)
        bench.begin(consented=True)
        bench.says(B, OnHandover(KEY))
        if committed:
            bench.says(B, DroneConnected(KEY))
        else:
            bench.move(Cause.CANCELLED)
        assert bench.authority.transfer is None
        assert bench.manager.echo.repeats(WANTS, NOW) is committed
        bench.manager.echo.took_effect(NOW)
        assert bench.manager.echo.repeats(WANTS, NOW) is committed


class TestSpeak:
    def said(self, bench: Bench, now: float = NOW) -> list[Action]:
        bench.actions.clear()
        bench.manager.speak(now, bench.actions)
        return bench.actions

    def test_the_message_of_the_step(self) -> None:
        bench = Bench()
        assert self.said(bench) == []
        bench.begin()
        assert self.said(bench) == [Send(B, HandoverRequest(KEY, Reason.REQUESTED))]
        assert self.said(bench, NOW + 0.2) == [Send(B, HandoverRequest(KEY, Reason.REQUESTED), 2)]
        bench.says(B, OnHandover(KEY))
        bench.says(A, OkHandover(KEY))
        assert self.said(bench) == [Send(B, ConnectHandover(KEY))]

    def test_a_standard_commander_gets_the_question_by_its_command_with_the_time_that_is_left(self) -> None:
        bench = at_consent(A=None)
        assert self.said(bench, NOW + 1.0) == [NotifyOwner(A, B, 29.0)]

    def test_the_last_result_and_the_border_ahead(self) -> None:
        bench = Bench()
        bench.begin()
        bench.move(Cause.CANCELLED)
        bench.zones(outside=(B,))
        bench.manager.foresight.seen(BordersSeen((BorderFact(0, 5.0, frozenset({A, B})),)), NOW, [])
        self.said(bench, NOW + 0.2)
        assert bench.sent() == [(A, HandoverResult), (B, HandoverResult), (B, HandoverAhead), (A, HandoverAhead)]

    def test_when_there_is_something_to_say(self) -> None:
        bench = Bench()
        assert bench.manager.deadlines() == []
        transfer = bench.begin()
        assert set(bench.manager.deadlines()) == {transfer.retry_at, transfer.timeout_at, bench.presence[B].lost_at()}
        bench.move(Cause.CANCELLED)
        assert bench.manager.deadlines() == bench.manager.results.deadlines() != []
