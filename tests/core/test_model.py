# SPDX-License-Identifier: GPL-3.0-or-later

"""Words of reasons for people, and the next station of a route."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.model import Mission, Reason, in_words, journal_in_words

A, B, C = 251, 252, 253
ROUTE = Mission(bytes(32), (A, B, A, C))


def test_a_reason_is_told_by_its_name_unless_that_says_too_little() -> None:
    assert in_words(Reason.COMMANDER_LOST) == "commander lost"
    assert in_words(Reason.PARTNER_REFUSED) == "the partner's operator denied"


def test_of_the_journal_a_known_reason_has_its_words_and_another_its_own() -> None:
    assert journal_in_words("commander_denied") == "the commander's operator denied"
    assert journal_in_words("commander_lost") == "commander lost"
    assert journal_in_words("of_another_version") == "of another version"


@pytest.mark.parametrize(("at", "following"), [(0, B), (1, A), (2, C), (3, None)])
def test_the_next_station_of_the_route(at: int, following: int | None) -> None:
    assert Mission(bytes(32), ROUTE.route, at).following == following


def test_without_a_route_no_station_is_next() -> None:
    assert Mission().following is None


@pytest.mark.parametrize(("at", "station", "then"), [(0, A, 0), (0, B, 1), (0, C, 3), (1, A, 2), (2, B, 2), (3, 77, 3)])
def test_a_station_that_commands_moves_the_route_on_if_it_is_ahead(at: int, station: int, then: int) -> None:
    assert Mission(bytes(32), ROUTE.route, at).advanced(station).at == then
