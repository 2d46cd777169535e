# SPDX-License-Identifier: GPL-3.0-or-later

"""The records of a position box, one after the other in a TCP stream. Which field lies where: `wire/box_layout.py`.

A record has no mark at its beginning and no check sum. Rules:

1. Where records begin is known at the beginning of a connection, and only there. TCP neither loses nor reorders bytes,
   so it stays known, wherever the stream is cut. Once there is doubt, nothing can end it: what looks like a record may
   be the end of one and the beginning of the next. So nothing is searched for. The rest of that connection is not
   believed (`BoxStream.broken`), and the next one begins anew.
2. There is doubt as soon as a field has a value that it cannot have, or the time goes back, or goes on by more than
   LEAP_S. The first record of a connection only sets the time, and is not handed out.
3. NaN is a value that the box does not know, in every field but time. Latitude and longitude 0, both, are what
   receivers send before their first fix. Such a record is sound, and no position (`BoxLayout.locates`).
4. The same time again is the same record again: it is not news.
5. How late a record is, compared to the quickest of its connection, shows by its time (`Lateness`): a record that has
   waited in a buffer is old, though it has just arrived.
"""

from __future__ import annotations

import math
from typing import Final

from mavproxy_handover.wire.box_layout import BoxLayout, BoxRecord

__all__ = ["LEAP_S", "BoxStream", "Lateness"]

#: time goes on by no more than this (s) from one record to the next: a box that was silent for so long is connected to
#: anew before (`link/box_line.py`)
LEAP_S: Final = 10.0
#: and by no less, or it is not new: bytes that are no time at all are rarely so close together
_LEAST_S: Final = 1e-4
#: clocks of two computers go apart by no more than this (s in a second)
_DRIFT: Final = 1e-3


class BoxStream:
    """The records of one connection, out of bytes cut anywhere. See the module's rules. It never raises."""

    def __init__(self, layout: BoxLayout) -> None:
        #: why nothing that comes is believed any more; "" while the stream is sound
        self.broken = ""
        #: sound records, news or not
        self.records = 0
        #: those that were the one before once more
        self.repeated = 0
        #: the bytes of the newest whole record of the last `feed`, sound or not: its layout may be another one
        self.last = b""
        self._layout = layout
        self._waiting = b""
        self._time_s: float | None = None

    @property
    def waiting(self) -> int:
        """Bytes of a record that has begun; always fewer than a record has."""
        return len(self._waiting)

    def feed(self, data: bytes) -> list[BoxRecord]:
        """The new records that `data` completes, in order, but for the first; those before a break are among them."""
        self.last = b""
        if self.broken:
            return []
        layout, size = self._layout, self._layout.size
        data = self._waiting + data
        whole = len(data) - len(data) % size
        self._waiting = data[whole:]
        found, at = [], 0
        for values in layout.struct.iter_unpack(memoryview(data)[:whole]):
            at += size
            time_s = layout.time_s(values)
            self.broken = layout.wrong(values) or self._out_of_time(time_s)
            if self.broken:
                self.broken = f"record {self.records + 1}: {self.broken}"
                self._waiting = b""
                break
            self.records += 1
            if self._time_s == time_s:
                self.repeated += 1
                continue
            if self._time_s is not None:
                found.append(layout.record(values))
            self._time_s = time_s
        if at:
            self.last = data[at - size : at]
        return found

    def _out_of_time(self, time_s: float) -> str:
        """What is wrong with a time after the one before, in words; "" if nothing is."""
        if self._time_s is None or time_s == self._time_s:
            return ""
        step_s = time_s - self._time_s
        if step_s < 0.0:
            return f"time {time_s:g} s after {self._time_s:g} s: it runs backwards"
        if not _LEAST_S <= step_s <= LEAP_S:
            return f"time {time_s:g} s after {self._time_s:g} s: must go on by {_LEAST_S:g} to {LEAP_S:g} s"
        return ""


class Lateness:
    """How much longer a record was under way than the quickest of its connection, whose delay nobody knows.

    The two clocks need not agree, and may go apart slowly: what counts is the difference between them. It can only be
    too large, by the delay of a record, so the least that was seen is nearest to the truth.
    """

    def __init__(self) -> None:
        self._least_s = math.inf
        self._time_s = 0.0

    def of(self, time_s: float, now: float) -> float:
        """How late (s, 0 and more) a record of this time is that arrives now."""
        if self._least_s < math.inf:
            self._least_s += _DRIFT * max(0.0, time_s - self._time_s)
        self._time_s = time_s
        self._least_s = min(self._least_s, now - time_s)
        return now - time_s - self._least_s
