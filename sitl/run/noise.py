# SPDX-License-Identifier: GPL-3.0-or-later

"""The noise of a bad serial line: flipped bits, and noise between what is sent. One direction, pure.

* Each byte has a flipped bit with probability `damage`. A length byte among them makes a parser wait for a frame that
  never comes.
* Bursts of noise come `bursts_per_s` on average, whether anything is sent or not: bytes of any kind, the beginning of a
  long frame, or a piece of what was sent last.

For one seed and the same bytes at the same times everything is the same on every run. Each effect has its own random
source, as in `sitl.run.impairment`.
"""

from __future__ import annotations

from math import inf, log
from random import Random
from typing import Final

from sitl.script.weather import NoiseLevel

__all__ = ["LineNoise"]

_LONGEST: Final = 24
#: beginnings of frames of both versions, the longest there are
_BEGINNINGS: Final = (
    b"\xfd\xff\x00",
    b"\xfd\xff\x01\x00\x07",
    b"\xfe\xff",
    b"\xfd\xfe\x00\x00\x00\x01\x01\x4c\x00\x00",
)
#: of the last bytes that were sent, so many may come again
_LAST: Final = 64


class LineNoise:
    """One direction of a line. `now` (s) must not go back."""

    def __init__(self, seed: int | str, level: NoiseLevel, now: float) -> None:
        # texts seed the same on every run and every machine
        self._flips, self._bursts = Random(f"{seed}/flips"), Random(f"{seed}/bursts")
        self._level = level
        self._last = b""
        #: bursts, and bytes with a flipped bit, so far
        self.bursts = 0
        self.damaged = 0
        #: when the next burst comes
        self.burst_at = inf
        self._next_burst(now)
        #: bytes up to the next one that is damaged
        self._until_flip = self._next_flip()

    def carry(self, data: bytes, now: float) -> bytes:
        """The bytes that arrive of `data`, which is sent now, after the noise that is due."""
        noise = b""
        while self.burst_at <= now:
            noise += self._burst()
            self._next_burst(self.burst_at)
        if data:
            self._last = data[-_LAST:]
        return noise + self._damaged(data)

    def _damaged(self, data: bytes) -> bytes:
        if self._until_flip >= len(data):
            self._until_flip -= len(data)
            return data
        found = bytearray(data)
        place = int(self._until_flip)
        while place < len(found):
            found[place] ^= 1 << self._flips.randrange(8)
            self.damaged += 1
            place += 1 + int(self._next_flip())
        self._until_flip = place - len(found)
        return bytes(found)

    def _next_flip(self) -> float:
        """How many bytes are left alone: between events that are equally likely at every byte."""
        share = self._level.damage
        if share <= 0.0:
            return inf
        return 0.0 if share >= 1.0 else float(int(log(1.0 - self._flips.random()) / log(1.0 - share)))

    def _next_burst(self, after: float) -> None:
        rate = self._level.bursts_per_s
        self.burst_at = after + self._bursts.expovariate(rate) if rate > 0.0 else inf

    def _burst(self) -> bytes:
        self.bursts += 1
        kind = self._bursts.randrange(3)
        if kind == 0:
            return self._bursts.randbytes(1 + self._bursts.randrange(_LONGEST))
        if kind == 1 or not self._last:
            return self._bursts.choice(_BEGINNINGS)
        start = self._bursts.randrange(len(self._last))
        return self._last[start : start + _LONGEST]
