# SPDX-License-Identifier: GPL-3.0-or-later

"""Which station could take the aircraft: in its zone, fit, and no attempt at it has just failed."""

from __future__ import annotations

from math import inf

import pytest

from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.authority.cures import cure
from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.common.events import Action, Advise, LinkJudged, Record
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import ConnectAck
from mavproxy_handover.core.common.model import Mission, Reason, StandingConsent, Station, ZoneFact

A, B, C = 251, 252, 253
DIGEST = bytes(range(32))
NAMES = {A: "GCSA", B: "GCSB", C: "GCSC"}
NOW = 100.0


def candidates(*facts: ZoneFact, route: tuple[int, ...] = (A, B, C)) -> Candidates:
    """All three are there both ways with the same mission, at `NOW`."""
    presence = {}
    for sysid, name in NAMES.items():
        there = presence[sysid] = Presence(Station(sysid, name), Limits())
        there.heard_at = there.answered_at = NOW
        there.answer = ConnectAck(sysid, 1, 1, 1, A, name, DIGEST)
    made = Candidates(presence, Limits())
    made.hold(Mission(DIGEST, route))
    made.zones.update(facts or (inside(A), inside(B), inside(C)), NOW - 50.0)
    return made


def inside(station: int, exit_s: float | None = None) -> ZoneFact:
    return ZoneFact(station, 100.0, exit_s)


def outside(station: int) -> ZoneFact:
    return ZoneFact(station, -100.0, None)


def test_the_owner_is_no_candidate_and_nobody_outside_its_zone_is_one() -> None:
    made = candidates(inside(A), inside(B), outside(C))
    actions: list[Action] = []
    assert list(made.usable(A, Reason.ZONE, NOW, actions)) == [B]
    assert list(made.usable(None, Reason.ZONE, NOW, actions)) == [A, B]
    assert actions == []


@pytest.mark.parametrize(
    ("why", "text"),
    [
        (Reason.PARTNER_SILENT, "GCSB does not answer. Check its program and its link."),
        (Reason.VERSION_DIFFERS, "GCSB has another version of the handover module. Install the vehicle's version."),
        (Reason.MISSION_DIFFERS, "GCSB has another mission. Send it with 'handover share'."),
        (Reason.MISSION_MISSING, "GCSB has no mission. The vehicle sends it in flight; 'handover share' does as well."),
        (Reason.UNMANNED, "No operator is on duty at GCSB. Its operator signs on with 'handover operator NAME'."),
        (Reason.CONSENT_REFUSED, 'GCSB takes no handover: the vehicle\'s file says consent = "refuse".'),
        (Reason.LEFT_REGION, "GCSB cannot be partner: left region."),
    ],
)
def test_each_reason_has_its_cure(why: Reason, text: str) -> None:
    assert cure("GCSB", why) == text


def test_a_zone_without_a_station_calls_nobody() -> None:
    assert candidates(inside(A), inside(77)).usable(A, Reason.COMMANDER_LOST, NOW, []) == []


def test_why_one_cannot_be_partner_is_told_once_until_it_changes() -> None:
    made = candidates()
    told: list[str] = []
    advice: list[Advise] = []
    for digest in (b"", b"", DIGEST, b"", b""):
        actions: list[Action] = []
        made.hold(Mission(digest or bytes(32), (A, B, C)))
        made.usable(A, Reason.ZONE, NOW, actions)
        told += [f"{action.station}: {action.text}" for action in actions if isinstance(action, Record)]
        advice += [action for action in actions if isinstance(action, Advise)]
    once = ["252: GCSB cannot be partner: mission differs", "253: GCSC cannot be partner: mission differs"]
    assert told == once * 2
    # both operators hear it, with the cure
    assert (
        advice
        == [
            Advise((A, B), "GCSB has another mission. Send it with 'handover share'."),
            Advise((A, C), "GCSC has another mission. Send it with 'handover share'."),
        ]
        * 2
    )


@pytest.mark.parametrize(
    ("reason", "pause_s"),
    [
        (Reason.COMMANDER_DENIED, 10.0),
        (Reason.PARTNER_REFUSED, 10.0),
        (Reason.CANCELLED, 10.0),
        (Reason.PARTNER_SILENT, 2.0),
        (Reason.PARTNER_UNANSWERED, 2.0),
        (Reason.CONSENT_REFUSED, 10.0),
        (Reason.COMMANDER_SILENT, 2.0),
        (Reason.LEFT_REGION, 2.0),
        (Reason.COMMANDER_RETURNED, 2.0),
    ],
)
def test_an_operators_no_pauses_longer_than_silence(reason: Reason, pause_s: float) -> None:
    made = candidates(inside(A), inside(B), outside(C))
    made.pause(B, Reason.ZONE, reason, NOW)
    for there in made._presence.values():
        there.heard_at = there.answered_at = NOW + pause_s - 0.1
    assert list(made.usable(A, Reason.ZONE, NOW + pause_s - 0.1, [])) == []
    assert list(made.usable(A, Reason.ZONE, NOW + pause_s, [])) == [B]


def test_a_pause_is_of_one_station_and_ends_when_authority_moves() -> None:
    made = candidates()
    made.pause(B, Reason.ZONE, Reason.COMMANDER_DENIED, NOW)
    assert list(made.usable(A, Reason.ZONE, NOW, [])) == [C]
    made.moved(C, NOW, flying=True)
    assert list(made.usable(A, Reason.ZONE, NOW, [])) == [B, C]


def test_the_route_advances_in_flight_alone() -> None:
    made = candidates(route=(A, B, A, C))
    made.moved(B, NOW, flying=False)
    assert made.mission.following == B
    made.moved(B, NOW, flying=True)
    assert made.mission.following == A
    made.moved(C, NOW, flying=True)  # it came out of turn: what lies between is not flown any more
    assert made.mission.following is None


def test_the_next_on_the_route_comes_before_the_one_that_keeps_the_aircraft_longest() -> None:
    facts = (inside(A), inside(B, 20.0), inside(C, 500.0))
    assert candidates(*facts).wanted(A, NOW, []) == (B, Reason.ZONE)
    assert candidates(*facts, route=(A, A)).wanted(A, NOW, []) == (C, Reason.ZONE)
    assert candidates(*facts).best((B, C)) == B


def test_of_two_with_good_links_the_next_on_the_route_and_the_reason_is_the_links() -> None:
    made = candidates(route=(A, C))
    made.moved(A, NOW - 40.0, flying=True)  # no zone calls
    assert made.wanted(A, NOW, []) is None
    made.links.judged(LinkJudged(A, True, False, "loss 40%"), "GCSA", NOW - 10.0, [])
    assert made.wanted(A, NOW, []) == (C, Reason.LINK_QUALITY)
    made.pause(C, Reason.LINK_QUALITY, Reason.PARTNER_SILENT, NOW)
    assert made.wanted(A, NOW, []) == (B, Reason.LINK_QUALITY)


@pytest.mark.parametrize(
    ("heard_s", "answered_s", "barred", "words"),
    [
        (0.5, 0.5, False, ""),
        (0.5, 10.4, False, "hears nothing for 10 s"),
        (0.5, inf, False, "hears nothing"),
        (0.5, 0.5, True, "hears less than 15 % of what the aircraft sends"),
        (6.0, 6.0, True, ""),
    ],
)
def test_what_is_said_of_a_station_that_hears_little(
    heard_s: float, answered_s: float, barred: bool, words: str
) -> None:
    presence = Presence(Station(251, "GCSA"), Limits())
    presence.heard_at, presence.answered_at = 100.0 - heard_s, 100.0 - answered_s
    if barred:
        presence.hearing.barred_at = 99.0
    assert Candidates({251: presence}, Limits()).deaf_words(251, 100.0) == words


class TestAtTheMomentOfTheCommit:
    """Why authority must not go to a station in this moment, whatever was agreed."""

    def test_a_station_that_is_there_gets_it(self) -> None:
        assert candidates().unable(B, NOW, True) is None
        assert candidates().unable(B, NOW, False) is None

    @pytest.mark.parametrize("flying", [False, True])
    def test_one_that_is_not_heard_does_not(self, flying: bool) -> None:
        made = candidates()
        made._presence[B].heard_at = NOW - 5.0
        assert made.unable(B, NOW, flying) is Reason.PARTNER_SILENT

    @pytest.mark.parametrize("flying", [False, True])
    def test_nor_one_that_hears_too_little(self, flying: bool) -> None:
        made = candidates()
        made._presence[B].hearing.barred_at = NOW - 1.0
        assert made.unable(B, NOW, flying) is Reason.PARTNER_SILENT

    def test_one_that_has_spoken_in_the_transfer_has_answered(self) -> None:
        made = candidates()
        made._presence[B].answered_at = NOW - 60.0
        assert made.unfit(B, NOW) is Reason.PARTNER_SILENT
        assert made.unable(B, NOW, True) is None

    @pytest.mark.parametrize(("flying", "why"), [(True, Reason.LEFT_REGION), (False, None)])
    def test_in_flight_its_zone_holds_the_aircraft(self, flying: bool, why: Reason | None) -> None:
        assert candidates(inside(A), outside(B)).unable(B, NOW, flying) is why

    def test_without_a_position_no_zone_is_known_to_be_left(self) -> None:
        made = candidates()
        made.zones.update((), NOW)
        assert made.unable(B, NOW, True) is None

    @pytest.mark.parametrize(("flying", "why"), [(True, Reason.MISSION_DIFFERS), (False, None)])
    def test_in_flight_it_holds_the_same_mission(self, flying: bool, why: Reason | None) -> None:
        made = candidates()
        made.hold(Mission(bytes(32), (A, B, C)))
        assert made.unable(B, NOW, flying) is why


def told_of(made: Candidates, owner: int | None) -> tuple[list[str], list[Advise]]:
    actions: list[Action] = []
    assert not made.could_be_partner(B, owner, NOW, actions)
    texts = [action.text for action in actions if isinstance(action, Record)]
    return texts, [action for action in actions if isinstance(action, Advise)]


class TestWhyAStationCannotBePartner:
    @pytest.mark.parametrize(("owner", "told"), [(A, (A, B)), (None, (B,))])
    def test_one_that_answers_no_more_is_told_of_to_both_operators(
        self, owner: int | None, told: tuple[int, ...]
    ) -> None:
        made = candidates()
        made._presence[B].answered_at = NOW - 60.0
        assert told_of(made, owner) == (
            ["GCSB cannot be partner: partner silent"],
            [Advise(told, "GCSB does not answer. Check its program and its link.")],
        )

    def test_one_that_comes_into_range_needs_no_help(self) -> None:
        made = candidates()
        made._presence[B].hearing.share = 0.2
        assert told_of(made, A) == (["GCSB cannot be partner: it has answered too few questions"], [])

    def test_one_that_hears_too_little_does(self) -> None:
        made = candidates()
        made._presence[B].hearing.share, made._presence[B].hearing.barred_at = 0.1, NOW - 1.0
        texts, advice = told_of(made, A)
        assert texts == ["GCSB cannot be partner: it hears less than 15 % of what the aircraft sends"]
        assert [each.stations for each in advice] == [(A, B)]

    def test_another_mission_is_named_though_it_hears_little(self) -> None:
        made = candidates()
        made.hold(Mission(bytes(32), (A, B, C)))
        assert told_of(made, A)[0] == ["GCSB cannot be partner: mission differs"]

    def test_one_that_answers_no_more_is_silent_however_little_it_heard(self) -> None:
        made = candidates()
        made._presence[B].hearing.share, made._presence[B].answered_at = 0.2, NOW - 60.0
        assert told_of(made, A)[0] == ["GCSB cannot be partner: partner silent"]

    def test_what_the_file_refuses_is_named_however_little_it_hears(self) -> None:
        made = candidates()
        there = made._presence[B]
        there.station, there.hearing.share = Station(B, "GCSB", False, StandingConsent.REFUSE), 0.2
        assert told_of(made, A)[0] == ["GCSB cannot be partner: consent refused"]

    def test_one_that_could_be_partner_is_not_spoken_of(self) -> None:
        actions: list[Action] = []
        assert candidates().could_be_partner(B, A, NOW, actions)
        assert actions == []


class TestCommanderThatKeepsTheAircraft:
    """The vehicle's file refuses planned handovers away from this commander."""

    def refusing(self) -> Candidates:
        made = candidates()
        made._presence[A] = Presence(Station(A, "GCSA", True, StandingConsent.REFUSE), Limits())
        return made

    def test_no_zone_calls_another_and_both_operators_hear_it_once(self) -> None:
        made = self.refusing()
        actions: list[Action] = []
        assert made.reasons(A, NOW, actions) == {}
        [record, advice] = actions
        assert made.reasons(A, NOW, actions) == {}
        assert len(actions) == 2
        assert isinstance(record, Record)
        assert (record.event, record.station) == ("handover_refused", A)
        assert isinstance(advice, Advise)
        assert advice.stations == (A, B)

    def test_without_a_call_there_is_nothing_to_tell(self) -> None:
        made = self.refusing()
        made.moved(A, NOW - 10.0, flying=True)
        actions: list[Action] = []
        assert made.reasons(A, NOW, actions) == {}
        assert actions == []

    def test_no_station_counts_as_ready_for_it(self) -> None:
        assert self.refusing().ready((B, C), A, Reason.ZONE, NOW) == []


class TestReadyAhead:
    """Stations that could take the aircraft at a border ahead."""

    def test_all_that_are_fit_but_the_owner(self) -> None:
        made = candidates(inside(A), outside(B), outside(C))
        assert made.ready((A, B, C, 77), A, Reason.ZONE, NOW) == [B, C]

    def test_not_one_that_is_unfit_or_paused(self) -> None:
        made = candidates()
        made._presence[B].answered_at = NOW - 60.0
        made.pause(C, Reason.ZONE, Reason.PARTNER_SILENT, NOW)
        assert made.ready((B, C), A, Reason.ZONE, NOW) == []
        assert made.ready((B, C), A, Reason.ZONE, NOW + 1.99) == []
        made._presence[C].heard_at = made._presence[C].answered_at = NOW + 2.0
        assert made.ready((B, C), A, Reason.ZONE, NOW + 2.0) == [C]


def test_the_name_of_a_station_that_is_not_of_the_mission() -> None:
    made = candidates()
    assert (made._name(B), made._name(77)) == ("GCSB", "station 77")


def test_since_when_a_station_is_silent() -> None:
    made = candidates()
    assert made.silent_s(B, NOW + 3.5) == 3.5


def test_a_graver_reason_comes_before_the_route() -> None:
    # GCSB is the next one on the route, and its zone ends before that of GCSA
    made = candidates(inside(A, 5.0), inside(B, 3.0), inside(C))
    assert made.wanted(A, NOW, []) == (C, Reason.ZONE_ENDS)


@pytest.mark.parametrize(("left_s", "called"), [(0.5, {C}), (0.0, {B, C})])
def test_no_zone_calls_a_station_before_its_pause_is_over(left_s: float, called: set[int]) -> None:
    made = candidates()
    made.pause(B, Reason.ZONE, Reason.PARTNER_SILENT, NOW - 2.0 + left_s)
    assert made.reasons(A, NOW, []).keys() == called


class TestStationsThatLetATransferFail:
    @pytest.mark.parametrize(
        ("why", "best"),
        [
            (Reason.PARTNER_SILENT, C),
            (Reason.PARTNER_UNANSWERED, C),
            (Reason.PARTNER_REFUSED, B),
            (Reason.COMMANDER_DENIED, B),
        ],
    )
    def test_one_that_did_not_answer_comes_after_the_others(self, why: Reason, best: int) -> None:
        made = candidates()
        made.pause(B, Reason.ZONE, why, NOW)
        assert made.best((B, C)) == best

    def test_when_all_have_failed_each_has_another_try(self) -> None:
        made = candidates()
        for station in (B, C):
            made.pause(station, Reason.ZONE, Reason.PARTNER_SILENT, NOW)
        assert made.best((B, C)) == B
        made.pause(B, Reason.ZONE, Reason.PARTNER_SILENT, NOW)
        assert made.best((B, C)) == C

    @pytest.mark.parametrize(
        ("why", "mute"),
        [(Reason.PARTNER_SILENT, True), (Reason.PARTNER_UNANSWERED, True), (Reason.PARTNER_REFUSED, False)],
    )
    def test_it_is_mute_until_it_speaks(self, why: Reason, mute: bool) -> None:
        made = candidates()
        assert not made.mute(B)
        made.pause(B, Reason.ZONE, why, NOW)
        assert made.mute(B) is mute
        made.spoke(B)
        assert not made.mute(B)

    def test_a_standard_station_has_nothing_to_say_in_a_transfer(self) -> None:
        made = candidates()
        made._presence[B] = Presence(Station(B, "GCSB", True), Limits())
        made.pause(B, Reason.ZONE, Reason.PARTNER_SILENT, NOW)
        assert not made.mute(B)

    def test_authority_that_has_moved_gives_all_a_new_beginning(self) -> None:
        made = candidates()
        made.pause(B, Reason.ZONE, Reason.PARTNER_SILENT, NOW)
        made.moved(C, NOW, flying=True)
        assert not made.mute(B)
        assert made.paused_s(B, Reason.ZONE, NOW) == 0.0
        assert made.best((B, C)) == B

    def test_a_pause_is_none_for_a_graver_reason(self) -> None:
        made = candidates()
        made.pause(B, Reason.ZONE, Reason.PARTNER_SILENT, NOW)
        pauses_s = [made.paused_s(B, reason, NOW) for reason in (Reason.REQUESTED, Reason.ZONE, Reason.ZONE_ENDS)]
        assert pauses_s == [2.0, 2.0, 0.0]


def test_a_station_that_takes_the_aircraft_has_shown_that_it_hears() -> None:
    made = candidates()
    made._presence[B].hearing.barred_at = NOW - 1.0
    made.moved(B, NOW, flying=True)
    assert made._presence[B].hearing.enough
