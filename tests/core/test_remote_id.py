# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of Remote ID: the operator's place follows authority, from one sender at a time."""

from __future__ import annotations

from mavproxy_handover.core.remote_id import OperatorPlace, Operators, RemoteIdRule

A, B = 251, 252
HERE, THERE, MOVED = (
    OperatorPlace(52.0, 4.0, 10.0),
    OperatorPlace(53.0, 5.0, 20.0),
    OperatorPlace(53.5, 5.5, 9.0, live=True),
)
PLANNED = {A: HERE, B: THERE}


def rule(**ids: str) -> tuple[RemoteIdRule, Operators]:
    operators = Operators({int(station[1:]): name for station, name in ids.items()})
    return RemoteIdRule(operators), operators


def test_the_planned_place_of_the_commander_is_sent_once_a_second() -> None:
    remote, _operators = rule(_251="FIN-A")
    sent = [remote.due(A, PLANNED, 10.0 + tick / 20) for tick in range(60)]
    found = [each for each in sent if each is not None]
    assert [(each.station, each.place, each.operator_id) for each in found] == [(A, HERE, "FIN-A")] * 3
    assert [each.number for each in found] == [0, 1, 2]
    assert sent[0] is not None


def test_after_a_handover_the_new_place_is_sent_at_once() -> None:
    remote, _operators = rule()
    remote.due(A, PLANNED, 10.0)
    sending = remote.due(B, PLANNED, 10.05)
    assert sending is not None
    assert (sending.station, sending.place, sending.number) == (B, THERE, 0)


def test_what_the_new_commanders_program_said_before_counts_and_is_sent_at_once() -> None:
    remote, operators = rule()
    remote.due(A, PLANNED, 10.0)
    operators.said_place(B, MOVED, 10.0)
    operators.said_id(B, "NLD-B")
    sending = remote.due(B, PLANNED, 10.05)
    assert sending is not None
    assert (sending.place, sending.operator_id) == (MOVED, "NLD-B")
    assert [remote.due(B, PLANNED, 10.1 + tick / 10) for tick in range(25)] == [None] * 25, "its program sends itself"


def test_a_program_that_falls_silent_is_replaced_with_its_last_place_and_then_the_planned_one() -> None:
    remote, operators = rule()
    operators.said_place(A, MOVED, 10.0)
    assert remote.due(A, PLANNED, 10.1) is None
    assert remote.due(A, PLANNED, 13.0) is None
    sending = remote.due(A, PLANNED, 13.1)
    assert sending is not None
    assert sending.place == MOVED
    sending = remote.due(A, PLANNED, 70.1)
    assert sending is not None
    assert sending.place == HERE


def test_without_authority_the_last_operator_stays() -> None:
    remote, _operators = rule()
    remote.due(A, PLANNED, 10.0)
    sending = remote.due(None, PLANNED, 11.0)
    assert sending is not None
    assert sending.station == A


def test_without_any_station_nothing_is_sent_and_without_a_place_it_is_known() -> None:
    remote, operators = rule()
    assert remote.due(None, PLANNED, 10.0) is None
    assert not remote.unknown
    assert remote.due(A, {}, 11.0) is None
    assert remote.unknown
    operators.said_place(A, MOVED, 11.1)
    assert remote.due(A, {}, 11.2) is None
    assert not remote.unknown


def test_the_configured_id_goes_before_the_one_that_a_program_says() -> None:
    _remote, operators = rule(_251="FIN-A")
    operators.said_id(A, "OTHER")
    operators.said_id(B, "SAID")
    assert (operators.operator_id(A), operators.operator_id(B), operators.operator_id(1)) == ("FIN-A", "SAID", "")
