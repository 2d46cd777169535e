# SPDX-License-Identifier: GPL-3.0-or-later

"""What a station is asked of the border ahead, and what its operator says of it beforehand: `gcs_module/ahead.py`, and
what `gcs_module/core.py` makes of it. Both sides together: tests/core/test_foresight.py."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from gcs_module.ahead import EarlyConsent
from gcs_module.alarms import Level
from gcs_module.core import (
    Action,
    Answer,
    AuthorityHeard,
    FromPeer,
    Notice,
    Role,
    StationCore,
    ToVehicle,
    Wish,
    WishAnswered,
)
from mavproxy_handover.core.common.messages import (
    CrossingKey,
    HandoverAhead,
    HandoverRequest,
    HandoverResult,
    OkAhead,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.common.model import Consent, Outcome, Phase, Reason, Station
from tests.gcs.stations import KEY, NOW, A, B, C, from_vehicle, notices, partner, station, words

#: the first border of epoch 3, from A to B
BORDER = CrossingKey(A, B, 1, 3)
HINT = " Type 'handover accept' or 'handover deny'."
QUESTION = "Handover GCSA -> GCSB of drone in 30 s."
OVER = Notice("aborted", "Question withdrawn: the route does not lead to that border any more.")
GRANTED, DENIED, WAITING = Consent.GRANTED, Consent.DENIED, Consent.WAITING


def tell(core: StationCore, now: float = NOW, **changes: object) -> list[Action]:
    """The vehicle tells of the border ahead, or of one like it."""
    return from_vehicle(core, replace(HandoverAhead(BORDER, 30.0), **changes), now)  # type: ignore[arg-type]


def asked(sysid: int = B) -> StationCore:
    """A station whose operator is asked beforehand."""
    core = station(sysid, asks=True)
    tell(core)
    return core


class TestQuestion:
    @pytest.mark.parametrize(("sysid", "event"), [(A, "asked"), (B, "requested")])
    def test_it_is_asked_once_and_answered_each_time(self, sysid: int, event: str) -> None:
        core = station(sysid, asks=True)
        waits = ToVehicle(OkAhead(BORDER, WAITING))
        assert tell(core) == [waits, Notice(event, QUESTION + HINT)]
        assert tell(core, NOW + 1.0, in_s=29.0) == [waits]
        assert core.asked_ahead == BORDER

    @pytest.mark.parametrize("sysid", [A, B])
    def test_who_needs_no_operator_is_told(self, sysid: int) -> None:
        core = station(sysid)
        assert tell(core) == [ToVehicle(OkAhead(BORDER)), Notice("ahead", QUESTION)]
        assert core.asked_ahead is None

    def test_it_is_the_zone_that_makes_it_automatic(self) -> None:
        core = StationCore(Station(B, "GCSB"), "drone", (Station(A, "GCSA"),), automatic=("request", "link"))
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3), NOW)
        assert words(tell(core)) == [ToVehicle(OkAhead(BORDER, WAITING))]

    def test_nobody_is_asked_of_what_is_not_ahead(self) -> None:
        core = station(B, asks=True)
        assert (core.ahead, core.asked_ahead, core.asked_to_take) == (None, None, None)

    @pytest.mark.parametrize("border", [CrossingKey(A, C, 1, 3), CrossingKey(C, B, 1, 3), CrossingKey(A, B, 1, 4)])
    def test_others_borders_and_other_epochs_are_none_of_its_business(self, border: CrossingKey) -> None:
        core = station(B, asks=True)
        assert tell(core, key=border) == []
        assert core.ahead is None

    def test_in_an_emergency_nobody_is_asked(self) -> None:
        core = station(B, asks=True)
        core.handle(AuthorityHeard(Phase.EMERGENCY, A, None, 3), NOW)
        assert tell(core) == []
        assert core.ahead is None

    @pytest.mark.parametrize(("after_s", "consent"), [(59.9, GRANTED), (60.0, WAITING)])
    def test_who_wished_for_it_a_minute_ago_has_said_so(self, after_s: float, consent: Consent) -> None:
        core = station(B, asks=True)
        core.handle(Wish(B), NOW)
        core.handle(WishAnswered(B, accepted=True), NOW)
        assert words(tell(core, NOW + after_s)) == [ToVehicle(OkAhead(BORDER, consent))]

    def test_a_refused_request_is_no_answer_early_consent(self) -> None:
        core = station(B, asks=True)
        core.handle(Wish(B), NOW)
        assert words(tell(core, NOW)) == [ToVehicle(OkAhead(BORDER, WAITING))]
        core.handle(WishAnswered(B, accepted=False), NOW)
        assert words(tell(core, NOW)) == [ToVehicle(OkAhead(BORDER, WAITING))]

    def test_a_commanders_wish_for_itself_lets_nobody_have_it(self) -> None:
        core = station(A, asks=True)
        core.handle(Wish(A), NOW)
        assert words(tell(core)) == [ToVehicle(OkAhead(BORDER, WAITING))]

    @pytest.mark.parametrize(("sysid", "other", "name"), [(A, "partner", "GCSB"), (B, "commander", "GCSA")])
    def test_that_the_other_one_denies_is_told_once_for_each_border(self, sysid: int, other: str, name: str) -> None:
        core = station(sysid, asks=True)
        denial = Notice("ahead", f"{name} has denied the handover GCSA -> GCSB.", Level.ADVISORY)
        assert denial in tell(core, **{other: DENIED})
        assert words(tell(core, **{other: DENIED})) == tell(core, **{other: DENIED})
        assert notices(tell(core, **{other: GRANTED})) == []
        assert denial in tell(core, **{other: DENIED})
        assert denial in tell(core, key=replace(BORDER, crossing=2), **{other: DENIED})

    @pytest.mark.parametrize(("sysid", "own"), [(A, "commander"), (B, "partner")])
    def test_its_own_answer_it_knows(self, sysid: int, own: str) -> None:
        core = asked(sysid)
        assert notices(tell(core, **{own: DENIED})) == []
        assert core.ahead is not None
        assert core.ahead.other is None


class TestAnswer:
    @pytest.mark.parametrize("sysid", [A, B])
    @pytest.mark.parametrize(
        ("yes", "consent", "text"),
        [
            (True, GRANTED, "GCSA -> GCSB accepted beforehand; 'handover deny' changes that."),
            (False, DENIED, "GCSA -> GCSB denied beforehand; 'handover accept' changes that."),
        ],
    )
    def test_it_is_said_at_once_and_with_every_question(
        self, sysid: int, yes: bool, consent: Consent, text: str
    ) -> None:
        core = asked(sysid)
        answer = ToVehicle(OkAhead(BORDER, consent))
        assert core.handle(Answer(yes), NOW) == [Notice("consent", text), answer]
        assert tell(core, NOW + 1.0) == [answer]
        assert core.asked_ahead is None

    @pytest.mark.parametrize("yes", [True, False])
    def test_it_may_be_changed_and_what_is_said_already_is_no_answer(self, yes: bool) -> None:
        core = asked()
        core.handle(Answer(yes), NOW)
        assert core.handle(Answer(yes), NOW) == [Notice("question", "There is no question to answer.")]
        changed = core.handle(Answer(not yes), NOW)
        assert words(changed) == [ToVehicle(OkAhead(BORDER, DENIED if yes else GRANTED))]
        word, other = ("denied", "accept") if yes else ("accepted", "deny")
        assert notices(changed) == [f"GCSA -> GCSB {word} beforehand; 'handover {other}' changes that."]

    def test_while_a_transfer_is_under_way_it_is_not_changed(self) -> None:
        core = station(B)
        tell(core)
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        assert core.handle(Answer(False), NOW) == [Notice("question", "There is no question to answer.")]

    @pytest.mark.parametrize("sysid", [A, B])
    def test_to_ask_for_it_or_to_give_it_is_to_accept(self, sysid: int) -> None:
        core = asked(sysid)
        assert core.handle(Wish(C), NOW) == []
        assert words(core.handle(Wish(B), NOW)) == [ToVehicle(OkAhead(BORDER, GRANTED))]
        assert core.handle(Wish(B), NOW) == []

    def test_to_accept_it_so_is_no_wish_for_another_transfer(self) -> None:
        core = asked()
        core.handle(Wish(B), NOW)
        request = HandoverRequest(replace(KEY, handover_id=8), Reason.REQUESTED)
        assert words(from_vehicle(core, request)) == [ToVehicle(OnHandover(request.key, WAITING))]

    def test_a_question_about_another_border_is_not_answered_by_a_yes_to_the_last_one(self) -> None:
        core = asked()
        later = replace(BORDER, crossing=2)
        tell(core, NOW + 9.0, key=later)
        text = "Answer not used: a new question came first, GCSA -> GCSB. Read it, then answer."
        assert core.handle(Answer(True), NOW + 9.5) == [Notice("question", text)]
        assert words(core.handle(Answer(True), NOW + 11.0)) == [ToVehicle(OkAhead(later))]


class TestAtTheBorder:
    """What was said counts for that border alone."""

    def hear(self, core: StationCore, crossing: int = 1, reason: Reason = Reason.ZONE, number: int = 7) -> list[Action]:
        """The transfer begins."""
        key = replace(KEY, handover_id=number)
        if core.role is Role.COMMANDER:
            return words(from_vehicle(core, OnHandover(key, reason=reason, relayed=True, crossing=crossing)))
        return words(from_vehicle(core, HandoverRequest(key, reason, crossing)))

    def says(self, core: StationCore, consent: Consent, number: int = 7) -> list[Action]:
        """What a station with this consent answers."""
        key, reason = replace(KEY, handover_id=number), Reason.OPERATOR if consent is DENIED else Reason.NONE
        if core.role is Role.COMMANDER:
            return [ToVehicle(OkHandover(key, consent, reason))]
        return [ToVehicle(OnHandover(key, consent, reason, relay=consent is GRANTED))]

    @pytest.mark.parametrize("sysid", [A, B])
    @pytest.mark.parametrize("yes", [True, False])
    def test_nobody_is_asked_again_there(self, sysid: int, yes: bool) -> None:
        core = asked(sysid)
        core.handle(Answer(yes), NOW)
        assert self.hear(core) == self.says(core, GRANTED if yes else DENIED)

    @pytest.mark.parametrize("sysid", [A, B])
    def test_consent_stays_for_the_next_try_and_a_denial_does_not(self, sysid: int) -> None:
        for yes in (True, False):
            core = asked(sysid)
            core.handle(Answer(yes), NOW)
            self.hear(core)
            assert self.hear(core, number=8) == self.says(core, GRANTED if yes else WAITING, number=8)

    @pytest.mark.parametrize("sysid", [A, B])
    def test_at_another_border_it_does_not_count(self, sysid: int) -> None:
        core = asked(sysid)
        core.handle(Answer(True), NOW)
        for number, crossing in ((7, 0), (8, 2)):
            assert self.hear(core, crossing, number=number) == self.says(core, WAITING, number=number)

    def test_nor_for_a_transfer_whose_border_the_vehicle_has_not_named(self) -> None:
        core = asked(A)
        core.handle(Answer(True), NOW)
        core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7, why=Reason.ZONE), NOW)
        assert words(core.handle(FromPeer(B, OnHandover(KEY, crossing=1)), NOW)) == self.says(core, WAITING)

    def test_over_the_ground_link_it_counts_where_the_vehicle_has_named_it(self) -> None:
        core = asked(A)
        core.handle(Answer(True), NOW)
        core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7, why=Reason.ZONE, crossing=1), NOW)
        assert words(core.handle(FromPeer(B, OnHandover(KEY)), NOW)) == self.says(core, GRANTED)

    @pytest.mark.parametrize("sysid", [A, B])
    def test_who_has_not_answered_goes_on_to_be_asked_the_same(self, sysid: int) -> None:
        """What is typed at that very moment is meant for it."""
        core = asked(sysid)
        self.hear(core)
        assert core.question == KEY
        assert core.asked_ahead is None, "he is asked at the border"
        assert core.asked_at == NOW
        assert words(core.handle(Answer(True), NOW)) == self.says(core, GRANTED)

    def test_what_is_asked_as_the_partner_has_a_name(self) -> None:
        core = asked()
        assert core.asked_to_take == (A, B, 3, 1, -1)
        self.hear(core)
        assert core.asked_to_take == (A, B, 3, 1, -1), "it is the same matter"
        core = partner(asks=True)
        self.hear(core, 0)
        assert core.asked_to_take == (A, B, 3, 0, 7)
        core.handle(Answer(True), NOW)
        assert core.asked_to_take is None

    @pytest.mark.parametrize("yes", [True, False])
    def test_who_has_answered_beforehand_is_asked_nothing(self, yes: bool) -> None:
        core = asked()
        core.handle(Answer(yes), NOW)
        assert core.asked_to_take is None

    def test_nor_is_the_commander_asked_to_take_it(self) -> None:
        core = asked(A)
        assert core.asked_to_take is None
        self.hear(core)
        assert core.asked_to_take is None

    def test_since_when_he_is_asked(self) -> None:
        core = station(B, asks=True)
        assert core.asked_at == -inf
        tell(core, NOW + 3.0)
        tell(core, NOW + 4.0)
        assert core.asked_at == NOW + 3.0
        tell(core, NOW + 9.0, key=replace(BORDER, crossing=2))
        assert core.asked_at == NOW + 9.0

    def test_a_transfer_for_another_reason_is_another_question(self) -> None:
        core = asked(A)
        from_vehicle(core, OnHandover(KEY, reason=Reason.REQUESTED, relayed=True), NOW + 3.0)
        assert core.asked_ahead is None, "one question at a time"
        core.handle(Answer(False), NOW + 6.0)
        assert core.asked_ahead == BORDER
        assert core.asked_at == NOW + 6.0

    def test_a_denial_beforehand_is_told_at_the_commanders_station_as_one(self) -> None:
        core = asked(A)
        core.handle(Answer(False), NOW)
        actions = from_vehicle(core, OnHandover(KEY, reason=Reason.ZONE, relayed=True, crossing=1))
        assert notices(actions) == ["Handover Denied, as answered beforehand."]


class TestTimeLeft:
    def test_beforehand_it_is_the_time_to_the_border(self) -> None:
        core = asked()
        assert core.answer_left_s(NOW + 1.0) == 29.0
        core.handle(Answer(True), NOW)
        assert core.answer_left_s(NOW + 1.0) == inf, "nobody is asked any more"

    def test_at_the_border_it_is_what_the_vehicle_says(self) -> None:
        core = asked()
        core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7, answer_left_s=14.0), NOW)
        assert core.answer_left_s(NOW + 1.0) == 13.0

    @pytest.mark.parametrize("sysid", [A, B])
    def test_who_has_not_answered_is_told_at_ten_and_at_five_seconds(self, sysid: int) -> None:
        core, told = asked(sysid), []
        for second in range(30):
            tell(core, NOW + second, in_s=30.0 - second)
            told += [(second, each) for each in core.tick(NOW + second)]
        text = f"{{}} s left to answer: GCSA -> GCSB. At the border you are asked again.{HINT}"
        assert told == [(20, Notice("countdown", text.format(10))), (25, Notice("countdown", text.format(5)))]

    def test_who_has_answered_is_told_nothing(self) -> None:
        core = asked()
        core.handle(Answer(False), NOW)
        tell(core, NOW + 1.0, in_s=4.0)
        assert core.tick(NOW + 1.0) == []

    @pytest.mark.parametrize(("left_s", "text"), [(4.0, "4"), (3.2, "4"), (0.0, "0"), (-0.5, "0")])
    def test_who_is_asked_late_is_told_once_what_is_left(self, left_s: float, text: str) -> None:
        core = partner(asks=True)
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7, why=Reason.ZONE, answer_left_s=left_s), NOW)
        words = f"{text} s left to answer: GCSA -> GCSB. Without an answer GCSA keeps the aircraft.{HINT}"
        assert core.tick(NOW) == [Notice("countdown", words)]
        assert core.tick(NOW) == []

    def test_where_nobody_commands_silence_leaves_it_so(self) -> None:
        core = station(B, asks=True)
        core.handle(AuthorityHeard(Phase.EMERGENCY, None, None, 3), NOW)
        from_vehicle(core, HandoverRequest(KEY, Reason.COMMANDER_LOST))
        core.handle(AuthorityHeard(Phase.EMERGENCY, None, B, 3, 7, answer_left_s=9.0), NOW)
        text = f"9 s left to answer: GCSA -> GCSB. Without an answer no station commands the aircraft.{HINT}"
        assert core.tick(NOW) == [Notice("countdown", text)]


class TestOver:
    def test_with_another_epoch(self) -> None:
        core = asked()
        core.handle(AuthorityHeard(Phase.ON_MISSION, C, None, 4), NOW)
        assert core.ahead is None

    def test_with_an_emergency_and_that_is_told_whom_was_asked(self) -> None:
        emergency = AuthorityHeard(Phase.EMERGENCY, A, None, 3)
        told = Notice("aborted", "Question withdrawn: there is an emergency.")
        core = asked()
        assert core.handle(emergency, NOW) == [told]
        assert core.handle(emergency, NOW) == []
        assert core.ahead is None
        for core in (station(B, asks=True), asked()):
            core.handle(Answer(True), NOW)
            assert core.handle(emergency, NOW) == []

    def test_not_with_any_other_phase(self) -> None:
        core = asked()
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3), NOW)
        assert core.asked_ahead == BORDER

    def test_who_is_not_asked_again_for_five_seconds_is_told_that_it_is_over(self) -> None:
        core = asked()
        tell(core, NOW + 1.0)
        from_vehicle(core, HandoverResult(replace(KEY, handover_id=5), A, Outcome.ABORTED, Reason.CANCELLED), NOW + 2.0)
        assert core.tick(NOW + 5.9) == []
        assert core.tick(NOW + 6.0) == [OVER]
        assert core.asked_ahead is None
        assert core.tick(NOW + 6.0) == []


class TestBeforehand:
    """The book of one station, by itself."""

    def book(self, crossing: int = 5, own: int = B, *, agrees: bool = False) -> EarlyConsent:
        book = EarlyConsent(own)
        message = HandoverAhead(replace(BORDER, crossing=crossing), 30.0)
        assert book.update(message, NOW, agrees=agrees)
        return book

    @pytest.mark.parametrize(
        ("known", "told", "fits"),
        [
            (5, 5, True),
            (5, 6, True),
            (5, 4, False),
            # the number wraps: up to half of all numbers ahead is newer
            (0xFFFF, 1, True),
            (1, 0xFFFF, False),
            (0x8001, 1, True),
            (0x8000, 1, False),
            (1, 0x8001, True),
            (1, 0x8002, False),
        ],
    )
    def test_an_older_border_does_not_fit(self, known: int, told: int, fits: bool) -> None:
        message = HandoverAhead(replace(BORDER, crossing=told), 30.0)
        assert self.book(known).fits(message, 3, A) is fits

    def test_in_a_new_epoch_numbers_begin_anew(self) -> None:
        message = HandoverAhead(replace(BORDER, crossing=1, epoch=4), 30.0)
        assert self.book(5).fits(message, 4, A)

    def test_who_is_asked_waits_and_who_agrees_does_not(self) -> None:
        assert not EarlyConsent(B).waits
        assert self.book().waits
        assert not self.book(agrees=True).waits

    def test_who_is_asked_and_agrees_by_then_is_asked_no_more(self) -> None:
        book = self.book()
        assert not book.update(HandoverAhead(replace(BORDER, crossing=5), 29.0), NOW + 1.0, agrees=True)
        assert book.ahead is not None
        assert book.ahead.consent is GRANTED

    def test_but_a_denial_stands(self) -> None:
        book = self.book()
        assert book.ahead is not None
        book.ahead.consent = DENIED
        book.update(HandoverAhead(replace(BORDER, crossing=5), 29.0), NOW + 1.0, agrees=True)
        assert book.ahead.consent is DENIED

    def test_each_word_brings_what_is_new(self) -> None:
        book = self.book()
        book.update(HandoverAhead(replace(BORDER, crossing=5), 12.0, commander=GRANTED), NOW + 1.0, agrees=False)
        ahead = book.ahead
        assert ahead is not None
        assert (ahead.at, ahead.heard_at, ahead.other) == (NOW + 13.0, NOW + 1.0, GRANTED)

    def test_what_was_said_is_said_in_its_own_part_of_what_is_foreseen(self) -> None:
        book = self.book(agrees=True)
        assert book.answer_for(KEY, Reason.ZONE_ENDS, 5, as_partner=True) is GRANTED
        assert book.answer_for(KEY, Reason.ZONE_ENDS, 5, as_partner=False) is None
        assert book.answer_for(KEY, Reason.REQUESTED, 5, as_partner=True) is None

    def test_who_has_not_answered_has_said_nothing(self) -> None:
        book = self.book()
        assert book.answer_for(KEY, Reason.ZONE, 5, as_partner=True) is None
        book.on_asked_at_border(KEY, 5)
        assert book.ahead is None, "it is asked at the border"

    @pytest.mark.parametrize("key", [replace(KEY, to_station=C), replace(KEY, epoch=4), TransferKey(C, B, 7, 3)])
    def test_of_another_transfer_nothing_is_used(self, key: TransferKey) -> None:
        book = self.book()
        book.on_asked_at_border(key, 5)
        book.on_asked_at_border(KEY, 6)
        assert book.waits

    def test_it_is_over_for_whom_was_asked(self) -> None:
        for book, waited in ((self.book(), True), (self.book(agrees=True), False), (EarlyConsent(B), False)):
            assert book.end() is waited
            assert book.ahead is None

    def test_a_question_lapses_after_five_seconds_without_a_word(self) -> None:
        book = self.book()
        assert not book.expire(NOW + 4.9)
        assert book.waits
        assert book.expire(NOW + 5.0)
        assert not book.expire(NOW + 5.0)

    def test_what_was_said_stays_until_twenty_seconds_behind_the_border(self) -> None:
        book = self.book(agrees=True)
        assert not book.expire(NOW + 49.9)
        assert book.ahead is not None
        assert not book.expire(NOW + 50.0), "nobody is asked, so nothing is told"
        assert book.ahead is None
