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
from mavproxy_handover.core.common.model import Mission, Reason, Station, ZoneFact

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
    assert list(made.usable(A, Reason.ZONE, NOW + pause_s - 0.1, [])) == []
    for there in made._presence.values():
        there.heard_at = there.answered_at = NOW + pause_s
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
        (0.5, 0.5, True, "hears less than 15 % of the aircraft"),
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
