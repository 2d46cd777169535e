# SPDX-License-Identifier: GPL-3.0-or-later

"""Heights of a position box, made comparable with the autopilot's.

Only a height above sea level can be compared directly. ISA pressure altitude differs from it by the day's pressure (8 m
for each hPa). A barometric height above ground counts from the place where the box was set to zero. Only their change
in flight is useful. So they are levelled by the autopilot's height above sea level until the aircraft is armed; after a
restart in flight, once. Later values are compared.

The standard atmosphere has 15 degrees Celsius at sea level. In colder or warmer air a change of barometric height is
up to 12 % larger or smaller than the true one (`slack_m`).
"""

from __future__ import annotations

import math
from typing import Final

from mavproxy_handover.wire.box_layout import BoxRecord

__all__ = ["BoxHeights", "slack_m"]

#: greatest error of a change of barometric height by the temperature: 253 K at -20 degrees instead of 288 K
_AIR: Final = 0.12
#: barometric heights; the pressure altitude first, because it does not restart with the box
_BAROMETRIC: Final = ("baro_m", "agl_m")


class BoxHeights:
    """The heights of one box."""

    def __init__(self) -> None:
        #: offset (m) from a barometric height to the one above sea level, by the record's attribute
        self._level_m: dict[str, float] = {}
        #: the last known height of the autopilot above sea level, and the box's height at that time
        self._then: tuple[float, float] | None = None

    def level(self, record: BoxRecord, own_alt_m: float, *, armed: bool) -> None:
        """Level the heights by the autopilot's height above sea level at the same moment."""
        for name in _BAROMETRIC:
            value = getattr(record, name)
            if not math.isnan(value) and (not armed or name not in self._level_m):
                self._level_m[name] = own_alt_m - value
        self._then = own_alt_m, self.above_sea_m(record)

    def above_sea_m(self, record: BoxRecord) -> float:
        """The box's height above sea level; NaN: it has none, or none that was levelled."""
        if not math.isnan(record.alt_m):
            return record.alt_m
        for name in _BAROMETRIC:
            value = getattr(record, name)
            if not math.isnan(value) and name in self._level_m:
                return float(value + self._level_m[name])
        return math.nan

    def followed_m(self, record: BoxRecord, own_alt_m: float) -> float:
        """The aircraft's height above sea level by this record.

        If the box has no such height, it is the autopilot's last height plus the change of the box's height since.
        `own_alt_m`: the autopilot's height, used if the heights were never compared.
        """
        if not math.isnan(record.alt_m):
            return record.alt_m
        if self._then is None:
            return own_alt_m
        own_m, box_m = self._then
        climbed_m = self.above_sea_m(record) - box_m
        return own_m if math.isnan(climbed_m) else own_m + climbed_m


def slack_m(record: BoxRecord, above_home_m: float) -> float:
    """The tolerated difference (m) from the autopilot's height, at this height above home."""
    return 0.0 if not math.isnan(record.alt_m) else _AIR * abs(above_home_m)
