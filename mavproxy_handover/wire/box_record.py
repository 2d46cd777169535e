# SPDX-License-Identifier: GPL-3.0-or-later

"""Splits the TCP stream of a position box into records. The layout of a record is in `wire/box_layout.py`.

A record has no start mark and no checksum. Rules:

1. The start of a record is known only at the beginning of a connection. TCP neither loses nor reorders bytes, so it
   stays known, wherever the stream is cut. A doubt cannot be resolved: what looks like a record may be the end of one
   and the beginning of the next. So nothing is searched for. The rest of that connection is invalid
   (`BoxStream.broken`), and the next connection starts again.
2. There is doubt if a field has an impossible value, if the time goes back, or if it goes on by more than LEAP_S. The
   first record of a connection only sets the time, and is not returned.
3. NaN means that the box does not know the value; every field except time may be NaN. Latitude and longitude 0, both,
   are what receivers send before their first fix. Such a record is valid, but no position (`BoxLayout.locates`).
4. A record with the same time as the one before is a repetition and is not returned.
5. The delay of a record relative to the fastest one of its connection shows by its time (`Lateness`). A record that has
   waited in a buffer is old, though it has just arrived.
"""

from __future__ import annotations

import math
from typing import Final

from mavproxy_handover.wire.box_layout import BoxLayout, BoxRecord

__all__ = ["LEAP_S", "BoxStream", "Lateness"]

#: most time (s) between two records: a box that was silent for longer gets a new connection before that
#: (`link/box_line.py`)
LEAP_S: Final = 10.0
#: least time (s) between two new records: arbitrary bytes are rarely times so close together
_LEAST_S: Final = 1e-4
#: most drift between the clocks of two computers (s in a second)
_DRIFT: Final = 1e-3


class BoxStream:
    """The records of one connection, from bytes cut anywhere. See the module's rules. It never raises."""

    def __init__(self, layout: BoxLayout) -> None:
        #: why this connection is invalid; "" while it is valid
        self.broken = ""
        #: valid records, repetitions included
        self.records = 0
        #: repetitions of the record before
        self.repeated = 0
        #: bytes of the newest complete record of the last `feed`, valid or not: the box may use another layout
        self.last = b""
        self._layout = layout
        self._waiting = b""
        self._time_s: float | None = None

    @property
    def waiting(self) -> int:
        """Bytes of an incomplete record; always fewer than a record has."""
        return len(self._waiting)

    def feed(self, data: bytes) -> list[BoxRecord]:
        """The new records that `data` completes, in order, without the first one of the connection. Those before a
        fault count.
        """
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
        """What is wrong with this time after the one before, as text; "" if nothing is."""
        if self._time_s is None or time_s == self._time_s:
            return ""
        step_s = time_s - self._time_s
        if step_s < 0.0:
            return f"its time runs backwards by {-step_s:.3g} s"
        if not _LEAST_S <= step_s <= LEAP_S:
            return f"its time goes on by {step_s:.3g} s: must go on by {_LEAST_S:g} to {LEAP_S:g} s"
        return ""


class Lateness:
    """The delay of a record relative to the fastest one of its connection, whose own delay is unknown.

    The two clocks need not agree, and may drift slowly: only the difference between them counts. The delay of a record
    can only make it too large, so the smallest seen difference is nearest to the truth.
    """

    def __init__(self) -> None:
        self._least_s = math.inf
        self._time_s = 0.0

    def of(self, time_s: float, now: float) -> float:
        """Delay (s, 0 or more) of a record with this time that arrives now."""
        if self._least_s < math.inf:
            self._least_s += _DRIFT * max(0.0, time_s - self._time_s)
        self._time_s = time_s
        self._least_s = min(self._least_s, now - time_s)
        return now - time_s - self._least_s
