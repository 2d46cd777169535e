# SPDX-License-Identifier: GPL-3.0-or-later

"""Which of two transfers came first."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.common.messages import TransferKey

A, B = 251, 252


@pytest.mark.parametrize(
    ("earlier", "later"),
    [
        (TransferKey(A, B, 1, 1), TransferKey(A, B, 2, 1)),
        (TransferKey(A, B, 2, 1), TransferKey(B, A, 1, 2)),  # the epoch counts first
        (TransferKey(A, B, 65535, 1), TransferKey(A, B, 1, 1)),  # the number wraps, 0 is left out
        (TransferKey(A, B, 65000, 1), TransferKey(A, B, 200, 1)),
        (TransferKey(A, B, 65535, 0), TransferKey(A, B, 65535, 0xFFFFFFFF)),
        # up to half of all numbers ahead
        (TransferKey(A, B, 1, 1), TransferKey(A, B, 32768, 1)),
        (TransferKey(A, B, 40000, 1), TransferKey(A, B, 7231, 1)),
    ],
)
def test_one_transfer_came_before_the_other(earlier: TransferKey, later: TransferKey) -> None:
    assert earlier.before(later)
    assert not later.before(earlier)


@pytest.mark.parametrize(("one", "other"), [(1, 32769), (40000, 7232)])
def test_of_two_that_are_half_of_all_numbers_apart_neither_came_before(one: int, other: int) -> None:
    assert not TransferKey(A, B, one, 1).before(TransferKey(A, B, other, 1))
    assert not TransferKey(A, B, other, 1).before(TransferKey(A, B, one, 1))


def test_no_transfer_came_before_itself() -> None:
    assert not TransferKey(A, B, 5, 5).before(TransferKey(A, B, 5, 5))
