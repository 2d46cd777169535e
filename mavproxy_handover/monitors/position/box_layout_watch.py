# SPDX-License-Identifier: GPL-3.0-or-later

"""Does the position box send the configured layout? Records of other layouts may have the same size.

Theory of operation
-------------------
Each record is read under the configured layout and under every rival: a known layout of the same size that has time,
place or velocity elsewhere. Each reading gets points for values that do not fit:

* values out of their range; a place with an unknown velocity or height; a nearly empty battery; a ground speed that
  differs from the length of the velocity; a true track that differs from its direction while the aircraft moves
  (`_inner`),
* a velocity or a heading that differs from the autopilot's, if the autopilot has them (`_outer`).

The points are averaged over the newest records, so one bad record, or a pair of different times, does not decide. A
layout is recognised when the others have more points, by `_MARGIN`:

* the configured layout fits: RECOGNISED,
* a rival fits, and the configured layout does not: OTHER, with the rival's name,
* anything else: UNDECIDED. The box of an aircraft that stands still and points north sends mostly zeros. While the
  autopilot has no velocity either, they fit every layout.

On the ground a box counts after its layout was recognised, until another layout fits. In flight an undecided layout
counts too (after a restart there), and is compared with the autopilot as always.

This module only recognises a layout and never changes it. It is pure, and its memory is bounded.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from enum import Enum
from typing import Final

from mavproxy_handover.monitors.position.cross_check import Place
from mavproxy_handover.wire.box_layout import LAYOUTS, REQUIRED, BoxLayout, BoxRecord

__all__ = ["LayoutWatch", "Verdict", "rivals"]

#: least number of records for a verdict, and number of the newest records that count
_FEWEST, _COUNTED = 5, 10
#: least difference in points between two layouts; and the points of a reading that does not fit
_MARGIN, _MISFIT = 0.5, 1.0
#: points of a value out of its range; greatest points of a wrong velocity or relation; points of a heading, a battery,
#: and a place with an unknown velocity or height. A heading alone is no misfit: a box may be mounted across, and a
#: compass may be wrong
_RANGE_POINTS, _MOST, _HEADING_POINTS, _BATTERY_POINTS, _HALF_POINTS = 4.0, 2.0, 0.6, 1.0, 1.0
#: velocities are equal within this, plus this fraction of the speed
_SAME_MPS, _SAME_PART = 1.0, 0.2
#: ground speed and velocity of one record are equal within this, plus this fraction
_LENGTH_MPS, _LENGTH_PART = 0.05, 0.1
#: angles are equal within this; below this speed a track does not count
_SAME_DEG, _MOVES_MPS = 20.0, 1.0
#: no aircraft flies with fewer volts
_EMPTY_V: Final = 3.0


class Verdict(Enum):
    """The verdict of the records about the configured layout."""

    UNDECIDED = "undecided"
    RECOGNISED = "recognised"
    OTHER = "other"


def rivals(layout: BoxLayout, known: Mapping[str, BoxLayout] = LAYOUTS) -> tuple[BoxLayout, ...]:
    """Known layouts that could be confused with this one: of the same size, with a required field elsewhere."""

    def where(of: BoxLayout) -> set[tuple[object, ...]]:
        needed = (field for field in of.fields if field.meaning in REQUIRED)
        return {(field.meaning, field.type, field.unit, field.offset, of.big_endian) for field in needed}

    return tuple(each for each in known.values() if each.size == layout.size and where(each) != where(layout))


class LayoutWatch:
    """Recognises the layout of one box."""

    def __init__(self, layout: BoxLayout) -> None:
        self._layouts = (layout, *rivals(layout))
        #: for each record: the points of each layout, inner and total
        self._points: deque[tuple[tuple[float, float], ...]] = deque(maxlen=_COUNTED)
        self.verdict = Verdict.UNDECIDED
        #: the layout was recognised, and no other one has fitted since
        self.known = False
        #: number of records of another layout in flight
        self.counted = 0
        #: the layout that fits instead of the configured one; None unless the verdict is OTHER
        self.likely: BoxLayout | None = None
        #: no known layout fits the records
        self.misfit = False

    @property
    def enough(self) -> bool:
        """Enough records have come for a full average."""
        return len(self._points) == _COUNTED

    @property
    def count_words(self) -> str:
        """The number of records of another layout in flight, for people; "" if none."""
        return f" ({self.counted} records of another layout in flight)" if self.counted else ""

    @property
    def words(self) -> str:
        """The verdict, for people; "" if the layout is the configured one."""
        configured = self._layouts[0].name
        if self.likely is not None:
            likely = self.likely.name
            return f'sends layout {likely!r}, not {configured!r} (set layout = "{likely}" in [position])'
        if self.known:
            return ""
        if self.misfit:
            return f"sends neither layout {configured!r} nor another known one (compare with docs/position-box.md)"
        return (
            f"layout {configured!r} not recognised yet (the autopilot needs a position; or turn or move the aircraft)"
        )

    def judge(self, raw: bytes, own: Place | None, *, armed: bool) -> None:
        """Judge one more record. `own`: the autopilot's position at the same moment, if it has one."""
        self._points.append(tuple(_points(layout, raw, own) for layout in self._layouts))
        if len(self._points) < _FEWEST:
            return
        count = len(self._points)
        inner, *_ = (sum(each[at][0] for each in self._points) / count for at in range(len(self._layouts)))
        configured, *others = (sum(each[at][1] for each in self._points) / count for at in range(len(self._layouts)))
        least = min(others, default=math.inf)
        self.likely = None
        self.misfit = min(configured, least) >= _MISFIT
        if configured - least >= _MARGIN and least < _MISFIT:
            self.verdict, self.likely, self.known = Verdict.OTHER, self._layouts[1 + others.index(least)], False
            self.counted += armed
        elif least - configured >= _MARGIN and inner < _MISFIT:
            self.verdict, self.known = Verdict.RECOGNISED, True
        else:
            self.verdict = Verdict.UNDECIDED


def _points(layout: BoxLayout, raw: bytes, own: Place | None) -> tuple[float, float]:
    """The points of one reading: inner and total."""
    values = layout.struct.unpack(raw)
    if layout.wrong(values):
        return _RANGE_POINTS, _RANGE_POINTS
    record = layout.record(values)
    half = record.placed and not layout.locates(record)
    inner = _inner(record) + (_HALF_POINTS if half else 0.0)
    return inner, inner + (0.0 if own is None else _outer(record, own))


def _inner(record: BoxRecord) -> float:
    """The points of a reading by itself."""
    length_mps = math.hypot(record.north_mps, record.east_mps)
    slack_mps = _LENGTH_MPS + _LENGTH_PART * length_mps
    points = _beyond(abs(record.speed_mps - length_mps), slack_mps, _MOST)
    if length_mps > _MOVES_MPS:
        course_deg = math.degrees(math.atan2(record.east_mps, record.north_mps))
        points += _beyond(_turn(record.track_deg - course_deg), _SAME_DEG, _MOST)
    return points + (_BATTERY_POINTS if record.battery_v < _EMPTY_V else 0.0)


def _outer(record: BoxRecord, own: Place) -> float:
    """The points of differences from the autopilot."""
    north, east, down = record.north_mps - own.north_mps, record.east_mps - own.east_mps, record.down_mps - own.down_mps
    slack_mps = _SAME_MPS + _SAME_PART * math.hypot(own.north_mps, own.east_mps, own.down_mps)
    return (
        _beyond(math.hypot(north, east), slack_mps, _MOST)
        + _beyond(abs(down), slack_mps, _MOST)
        + _beyond(_turn(record.heading_deg - own.heading_deg), _SAME_DEG, _HEADING_POINTS)
    )


def _beyond(value: float, limit: float, most: float) -> float:
    """The points of a value: 0 up to its limit or if not known, 1 at twice the limit."""
    return 0.0 if math.isnan(value) else min(most, max(0.0, value / limit - 1.0))


def _turn(difference_deg: float) -> float:
    """The angle between two directions (degrees)."""
    return abs(math.remainder(difference_deg, 360.0))
