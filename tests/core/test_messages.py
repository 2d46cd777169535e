# SPDX-License-Identifier: GPL-3.0-or-later

"""Which of two transfers came first."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.messages import TransferKey

A, B = 251, 252


@pytest.mark.parametrize(
    ("earlier", "later"),
    [
        (TransferKey(A, B, 1, 1), TransferKey(A, B, 2, 1)),
        (TransferKey(A, B, 2, 1), TransferKey(B, A, 1, 2)),  # the epoch counts first
        (TransferKey(A, B, 65535, 1), TransferKey(A, B, 1, 1)),  # the number wraps, 0 is left out
        (TransferKey(A, B, 65000, 1), TransferKey(A, B, 200, 1)),
        (TransferKey(A, B, 65535, 0), TransferKey(A, B, 65535, 0xFFFFFFFF)),
    ],
)
def test_one_transfer_came_before_the_other(earlier: TransferKey, later: TransferKey) -> None:
    assert earlier.before(later)
    assert not later.before(earlier)


def test_no_transfer_came_before_itself() -> None:
    assert not TransferKey(A, B, 5, 5).before(TransferKey(A, B, 5, 5))
