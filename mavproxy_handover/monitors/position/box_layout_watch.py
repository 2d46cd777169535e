# SPDX-License-Identifier: GPL-3.0-or-later

"""Is the position box's layout the one that is configured? Records of other layouts may have the same size.

Theory of operation
-------------------
Each record is read under the configured layout and under every rival: a known layout of the same size that has time,
place or velocity elsewhere. Each reading gets points for what does not fit:

* values out of their range; a place with a velocity or a height that is not known; a battery that is all but empty; a
  ground speed that is not the length of the velocity; a true track that is not its direction while the aircraft moves
  (`_inner`),
* a velocity or a heading that is not the autopilot's, while the autopilot knows them (`_outer`).

Points are averaged over the newest records, so one bad record, or a pair that was not measured at one time, decides
nothing. A layout is told apart when the others have more points than it has, by `_MARGIN`:

* the configured one fits: RECOGNISED,
* a rival fits, and the configured one does not: OTHER, with the rival's name,
* anything else: UNDECIDED. A box of an aircraft that stands still and points to the north sends little but zeros; while
  the autopilot has no velocity either, they fit every layout.

On the ground a box counts once its layout was recognised, and until another one fits. In flight one that is undecided
counts as well (after a restart there), and is held against the autopilot as ever.

It only recognises: the layout never changes by itself. It is pure; what it keeps is bounded.
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

#: so many records decide at the earliest, and so many of the newest count
_FEWEST, _COUNTED = 5, 10
#: the points that part one layout from the others; and a reading with so many does not fit
_MARGIN, _MISFIT = 0.5, 1.0
#: the points of a value out of its range, the most of a velocity or a relation that is wrong, of a heading, a battery,
#: of a place with an unknown velocity or height. A heading alone makes no misfit: a box may be mounted across, and a
#: compass be wrong
_RANGE_POINTS, _MOST, _HEADING_POINTS, _BATTERY_POINTS, _HALF_POINTS = 4.0, 2.0, 0.6, 1.0, 1.0
#: velocities are the same within this, and within this part of the speed
_SAME_MPS, _SAME_PART = 1.0, 0.2
#: ground speed and velocity of one record are the same within this, and within this part
_LENGTH_MPS, _LENGTH_PART = 0.05, 0.1
#: angles are the same within this; below this speed a track is none
_SAME_DEG, _MOVES_MPS = 20.0, 1.0
#: no aircraft flies with fewer volts
_EMPTY_V: Final = 3.0


class Verdict(Enum):
    """What the records say of the configured layout."""

    UNDECIDED = "undecided"
    RECOGNISED = "recognised"
    OTHER = "other"


def rivals(layout: BoxLayout, known: Mapping[str, BoxLayout] = LAYOUTS) -> tuple[BoxLayout, ...]:
    """Known layouts that a box of this one could be taken for: as long, and with something needed elsewhere."""

    def where(of: BoxLayout) -> set[tuple[object, ...]]:
        needed = (field for field in of.fields if field.meaning in REQUIRED)
        return {(field.meaning, field.type, field.unit, field.offset, of.big_endian) for field in needed}

    return tuple(each for each in known.values() if each.size == layout.size and where(each) != where(layout))


class LayoutWatch:
    """Of one box."""

    def __init__(self, layout: BoxLayout) -> None:
        self._layouts = (layout, *rivals(layout))
        #: of each record: the points of each layout, inner and all
        self._points: deque[tuple[tuple[float, float], ...]] = deque(maxlen=_COUNTED)
        self.verdict = Verdict.UNDECIDED
        #: it was recognised, and no other one fits since
        self.known = False
        #: records of another layout in flight
        self.counted = 0
        #: the layout that fits in place of the configured one; None unless the verdict is OTHER
        self.likely: BoxLayout | None = None
        #: no known layout fits what has come
        self.misfit = False

    @property
    def enough(self) -> bool:
        """As many records have come as count."""
        return len(self._points) == _COUNTED

    @property
    def count_words(self) -> str:
        """How many records of another layout came in flight, for people; "" if none did."""
        return f" ({self.counted} records of another layout in flight)" if self.counted else ""

    @property
    def words(self) -> str:
        """What it says of the box, for people; "" if the layout is the configured one."""
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
        """Judge one more record; `own`: the autopilot's word of the same moment, if it has one."""
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
    """What does not fit in one reading: in the record itself, and in all."""
    values = layout.struct.unpack(raw)
    if layout.wrong(values):
        return _RANGE_POINTS, _RANGE_POINTS
    record = layout.record(values)
    half = record.placed and not layout.locates(record)
    inner = _inner(record) + (_HALF_POINTS if half else 0.0)
    return inner, inner + (0.0 if own is None else _outer(record, own))


def _inner(record: BoxRecord) -> float:
    """What does not fit in a reading by itself."""
    length_mps = math.hypot(record.north_mps, record.east_mps)
    slack_mps = _LENGTH_MPS + _LENGTH_PART * length_mps
    points = _beyond(abs(record.speed_mps - length_mps), slack_mps, _MOST)
    if length_mps > _MOVES_MPS:
        course_deg = math.degrees(math.atan2(record.east_mps, record.north_mps))
        points += _beyond(_turn(record.track_deg - course_deg), _SAME_DEG, _MOST)
    return points + (_BATTERY_POINTS if record.battery_v < _EMPTY_V else 0.0)


def _outer(record: BoxRecord, own: Place) -> float:
    """What is not as the autopilot has it."""
    north, east, down = record.north_mps - own.north_mps, record.east_mps - own.east_mps, record.down_mps - own.down_mps
    slack_mps = _SAME_MPS + _SAME_PART * math.hypot(own.north_mps, own.east_mps, own.down_mps)
    return (
        _beyond(math.hypot(north, east), slack_mps, _MOST)
        + _beyond(abs(down), slack_mps, _MOST)
        + _beyond(_turn(record.heading_deg - own.heading_deg), _SAME_DEG, _HEADING_POINTS)
    )


def _beyond(value: float, limit: float, most: float) -> float:
    """The points of a value: none up to its limit, one at twice the limit; and none if it is not known."""
    return 0.0 if math.isnan(value) else min(most, max(0.0, value / limit - 1.0))


def _turn(difference_deg: float) -> float:
    """How far two directions are apart."""
    return abs(math.remainder(difference_deg, 360.0))
