# SPDX-License-Identifier: GPL-3.0-or-later

"""Limits for repeated entries, so that no sender can fill the journal. Pure: time is an argument.

A journal keeps the newest entries. So a source of endless entries could push out the entries that matter. Refused
frames at 63 kB a second took nine minutes for it. Therefore the entries of one source have two limits:

* of each kind one entry a second; the next one of the kind says how many were left out since;
* of all kinds together `most` at once, and then one each `interval_s`. Entries above that are counted, and the count is
  requested once a minute (`left_out`). The first limit alone would not help, because the sender chooses the kinds.

Memory is limited too: to `KINDS` kinds. A new kind replaces the oldest one, whose count is added to that of the others.
"""

from __future__ import annotations

from collections.abc import Hashable
from math import inf
from typing import Final

__all__ = ["KINDS", "SAME_S", "TOLD_S", "Sampler"]

SAME_S: Final = 1.0
TOLD_S: Final = 60.0
KINDS: Final = 256


class _Kind:
    __slots__ = ("kept_back", "since")

    def __init__(self, since: float) -> None:
        self.since = since  #: time of the last written entry
        self.kept_back = 0  #: number of entries left out since


class Sampler:
    """The limits for one source. Times in seconds."""

    def __init__(self, most: int, interval_s: float) -> None:
        self._most = most
        self._interval_s = interval_s
        #: number of entries that may be written at `_at`
        self._room = float(most)
        self._at = -inf
        #: by kind, the oldest first
        self._kinds: dict[Hashable, _Kind] = {}
        self._left_out = 0
        self._told_at = -inf

    def admit(self, now: float, kind: Hashable = None) -> int | None:
        """Number of entries left out of this kind since its last written one; None: leave this one out.

        `kind` None: the entry is unlike all others.
        """
        known = None if kind is None else self._kinds.get(kind)
        if known is not None and now - known.since < SAME_S:
            known.kept_back += 1
            return None
        if not self._fits(now):
            self._left_out += 1
            return None
        if kind is not None:
            self._kinds.pop(kind, None)
            if len(self._kinds) >= KINDS:
                self._forget(next(iter(self._kinds)))
            self._kinds[kind] = _Kind(now)
        return 0 if known is None else known.kept_back

    def left_out(self, now: float) -> int:
        """Number of left-out entries that no entry reports. Nonzero at most once a minute."""
        if now - self._told_at < TOLD_S:
            return 0
        for kind, known in list(self._kinds.items()):
            if now - known.since < TOLD_S:
                break
            self._forget(kind)
        count, self._left_out = self._left_out, 0
        if count:
            self._told_at = now
        return count

    def _fits(self, now: float) -> bool:
        if now > self._at:
            if self._at > -inf:
                self._room = min(self._most, self._room + (now - self._at) / self._interval_s)
            self._at = now
        if self._room < 1.0:
            return False
        self._room -= 1.0
        return True

    def _forget(self, kind: Hashable) -> None:
        self._left_out += self._kinds.pop(kind).kept_back
