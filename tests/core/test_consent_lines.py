# SPDX-License-Identifier: GPL-3.0-or-later

"""What the vehicle's file says too little about consent, in words that say what to write where."""

from __future__ import annotations

from mavproxy_handover.core.authority.consent_lines import refused_on_route, without_consent
from mavproxy_handover.core.common.model import StandingConsent, Station

OURS, STANDARD = Station(251, "GCSA"), Station(252, "GCSB", True)
REFUSES = Station(253, "GCSC", True, StandingConsent.REFUSE)
AUTOMATIC = Station(254, "GCSD", True, StandingConsent.AUTOMATIC)
LINE = (
    'GCSB cannot be asked for consent: write consent = "automatic" or consent = "refuse" in its [[station]] of the '
    "vehicle's file"
)


def test_a_standard_station_that_has_not_shown_that_it_can_ask_needs_a_line() -> None:
    assert without_consent((OURS, STANDARD, REFUSES, AUTOMATIC)) == (LINE,)
    assert without_consent((OURS, STANDARD)) == (LINE,)
    assert without_consent((OURS, STANDARD), (252,)) == ()


def test_with_one_station_there_is_nothing_to_consent_to() -> None:
    assert without_consent((STANDARD,)) == ()


def test_each_handover_of_the_route_that_a_refusal_prevents() -> None:
    stations = (OURS, STANDARD, REFUSES)
    assert refused_on_route(stations, (251, 252)) == ()
    assert refused_on_route(stations, (251, 253, 252)) == (
        'GCSC has consent = "refuse", and the route needs GCSA -> GCSC',
        'GCSC has consent = "refuse", and the route needs GCSC -> GCSB',
    )


def test_a_handover_further_on_is_another_one() -> None:
    lines = refused_on_route((OURS, STANDARD, REFUSES), (251, 252, 253))
    assert lines == ('GCSC has consent = "refuse", and the route needs GCSB -> GCSC',)


def test_a_station_of_the_route_that_is_not_known_is_named_by_its_number() -> None:
    assert refused_on_route((REFUSES,), (77, 253)) == (
        'GCSC has consent = "refuse", and the route needs station 77 -> GCSC',
    )
