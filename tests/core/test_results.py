# SPDX-License-Identifier: GPL-3.0-or-later

"""How the end of a transfer is told until each of its stations shows that it knows it."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.authority.results import Results
from mavproxy_handover.core.common.events import Action, Record, Send
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import ConnectAck, HandoverResult, TransferKey
from mavproxy_handover.core.common.model import Outcome, Reason

A, B, C = 251, 252, 253
COMMITTED = HandoverResult(TransferKey(A, B, 7, 4), B, Outcome.COMMITTED, Reason.ZONE)
ABORTED = HandoverResult(TransferKey(A, B, 7, 3), A, Outcome.ABORTED, Reason.PARTNER_SILENT)
NOW = 100.0


def announced(result: HandoverResult = COMMITTED) -> Results:
    results, actions = Results(Limits()), list[Action]()
    results.announce(result, (A, B), NOW, actions)
    assert actions == [Send(A, result), Send(B, result)]
    return results


def repeated(results: Results, now: float) -> list[Action]:
    actions: list[Action] = []
    results.repeat(now, {A: "GCSA"}, actions)
    return actions


def test_it_is_repeated_with_a_growing_pause() -> None:
    results = announced()
    assert results.deadlines() == [100.2, 100.2]
    assert repeated(results, 100.19) == []
    assert repeated(results, 100.2) == [Send(A, COMMITTED, 2), Send(B, COMMITTED, 2)]
    assert results.deadlines() == [pytest.approx(100.5)] * 2
    pauses = []
    for attempt in range(3, 9):
        due = results.deadlines()[0]
        assert repeated(results, due) == [Send(A, COMMITTED, attempt), Send(B, COMMITTED, attempt)]
        pauses.append(results.deadlines()[0] - due)
    assert pauses == pytest.approx([0.45, 0.675, 1.0, 1.0, 1.0, 1.0])


def test_after_ten_seconds_it_is_given_up_and_journalled() -> None:
    results = announced()
    results._pending[A].retry_at = results._pending[B].retry_at = 200.0
    assert results.deadlines() == [110.0, 110.0]
    assert repeated(results, 109.9) == []
    assert repeated(results, 110.0) == [
        Record("result_unacknowledged", "GCSA has not acknowledged how handover 7 ended", station=A),
        Record("result_unacknowledged", "station 252 has not acknowledged how handover 7 ended", station=B),
    ]
    assert results.deadlines() == []
    assert repeated(results, 111.0) == []


@pytest.mark.parametrize(
    ("result", "nonce", "epoch", "known"),
    [
        (COMMITTED, 5, 4, True),
        (COMMITTED, 5, 5, True),
        (COMMITTED, 5, 3, False),
        (COMMITTED, 0, 4, True),
        (COMMITTED, 0, 3, False),
        (ABORTED, 0, 3, True),  # it says so of itself
        (ABORTED, 5, 3, False),  # the epoch was the same before
    ],
)
def test_a_station_shows_that_it_knows_it(result: HandoverResult, nonce: int, epoch: int, known: bool) -> None:
    results = announced(result)
    results.acknowledged(B, ConnectAck(B, 1, nonce, epoch, B, "GCSB", b""))
    assert len(results.deadlines()) == (1 if known else 2)
    results.acknowledged(C, ConnectAck(C, 1, nonce, epoch, B, "GCSC", b""))


def test_a_new_transfer_of_a_station_ends_it() -> None:
    results = announced()
    results.forget((B, C))
    assert [type(action) for action in repeated(results, 100.2)] == [Send]
    assert results.told(B) == COMMITTED


def test_only_its_stations_are_told_when_they_ask() -> None:
    results = announced()
    assert [results.told(station) for station in (A, B, C)] == [COMMITTED, COMMITTED, None]
    assert Results(Limits()).told(A) is None
