# SPDX-License-Identifier: GPL-3.0-or-later

"""The cross-check: compares the position of the position box with the autopilot's.

Theory of operation
-------------------
The comparison shows that one of two sources is wrong, but not which one. So:

* A pair that differs by more than a limit is never used, from the first pair on: one wrong position would be enough to
  enter a zone.
* Pairs that differ for `apart_s` are a disagreement. It ends when they are within CLOSE of every limit for `agree_s`,
  so a difference near a limit does not make it flicker.
* Alternating pairs, beyond and within a limit, are also a disagreement if they are beyond it for more than a fifth of
  the time. The time beyond counts up, the time within counts down at a quarter of that speed. So a few correct
  positions do not hide a faulty box.
* While there is no pair nothing changes: a disagreement continues if one source falls silent.
* A place without a height (NaN) is compared without it.

It is pure: time is an argument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from mavproxy_handover.config.position import PositionSettings
from mavproxy_handover.mission.geodesy import distance_m

__all__ = ["CLOSE", "UNKNOWN_HEADING", "CrossCheck", "Difference", "Place"]

#: GLOBAL_POSITION_INT: heading not known
UNKNOWN_HEADING: Final = 0xFFFF
#: speed at which the time beyond a limit counts down within it
_FORGETS: Final = 0.25
#: a pause between two pairs counts for at most this (s); accuracy of sums of pauses (s)
_PAUSE_S, _EXACT_S = 0.5, 1e-6
#: fraction of a limit for a good agreement
CLOSE: Final = 2.0 / 3.0
_TEXTS: Final = (
    "{:.0f} m apart (limit {:g} m)",
    "{:.0f} m apart in height (limit {:g} m)",
    "{:.1f} m/s apart in speed (limit {:g} m/s)",
)


@dataclass(frozen=True, slots=True)
class Place:
    """A position of one source: degrees, metres above sea level, metres a second over ground and downwards. NaN: not
    known."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    north_mps: float
    east_mps: float
    down_mps: float = math.nan
    heading_deg: float = math.nan

    @classmethod
    def by_autopilot(cls, message: Any) -> Place:
        """The autopilot's position, from a GLOBAL_POSITION_INT."""
        return cls(
            message.lat / 1e7,
            message.lon / 1e7,
            message.alt / 1000.0,
            message.vx / 100.0,
            message.vy / 100.0,
            message.vz / 100.0,
            math.nan if message.hdg == UNKNOWN_HEADING else message.hdg / 100.0,
        )


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference of two places."""

    over_ground_m: float
    height_m: float
    speed_mps: float

    @classmethod
    def between(cls, one: Place, other: Place, height_slack_m: float = 0.0) -> Difference:
        """The difference of these two. `height_slack_m`: tolerated difference in height."""
        apart_m = abs(one.alt_m - other.alt_m) - height_slack_m
        return cls(
            distance_m(one.lat_deg, one.lon_deg, other.lat_deg, other.lon_deg),
            0.0 if math.isnan(apart_m) else max(0.0, apart_m),
            math.hypot(one.north_mps - other.north_mps, one.east_mps - other.east_mps),
        )


class CrossCheck:
    """The cross-check of one vehicle. Times are monotonic seconds."""

    def __init__(self, settings: PositionSettings) -> None:
        self._limits = (settings.apart_m, settings.apart_height_m, settings.apart_mps)
        self._apart_s = settings.apart_s
        self._agree_s = settings.agree_s
        #: the last pair was beyond a limit
        self.beyond = False
        #: there is a disagreement
        self.apart = False
        self.last: Difference | None = None
        #: time beyond a limit (s), less the count-down
        self._beyond_s = 0.0
        #: since when the pairs agree well again
        self._since: float | None = None
        self._looked_at: float | None = None

    @property
    def sound(self) -> bool:
        """Whether the last pair may be used."""
        return not self.beyond and not self.apart

    @property
    def words(self) -> str:
        """The worst of the last differences, with its limit; "" before the first pair."""
        if self.last is None:
            return ""
        measured = (self.last.over_ground_m, self.last.height_m, self.last.speed_mps)
        worst = max(range(3), key=lambda each: measured[each] / self._limits[each])
        return _TEXTS[worst].format(measured[worst], self._limits[worst])

    def compare(self, difference: Difference, now: float) -> None:
        """Judge a new pair."""
        self.last = difference
        measured = (difference.over_ground_m, difference.height_m, difference.speed_mps)
        part = max(value / limit for value, limit in zip(measured, self._limits, strict=True))
        self.beyond = not part <= 1.0
        passed_s = 0.0 if self._looked_at is None else min(_PAUSE_S, now - self._looked_at)
        self._looked_at = now
        if self.apart:
            self._agrees(part <= CLOSE, now)
            return
        self._beyond_s = max(0.0, self._beyond_s + (passed_s if self.beyond else -_FORGETS * passed_s))
        if self.beyond and self._beyond_s >= self._apart_s - _EXACT_S:
            self.apart, self._beyond_s = True, 0.0

    def _agrees(self, together: bool, now: float) -> None:
        if not together:
            self._since = None
            return
        self._since = now if self._since is None else self._since
        if now - self._since >= self._agree_s:
            self.apart, self._since = False, None
