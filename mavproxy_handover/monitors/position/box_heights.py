# SPDX-License-Identifier: GPL-3.0-or-later

"""Heights of a position box, made comparable with the autopilot's.

A height above sea level is one. A barometric height is none: ISA pressure altitude is off it by the day's pressure
(8 m for each hPa), and a barometric height above ground counts from the place where the box was set to zero. Their
change in flight tells something. So they are levelled by the autopilot's height above sea level until the aircraft is
armed; after a restart in flight, once. What they say later is compared.

The standard atmosphere has 15 degrees Celsius at sea level. In colder or warmer air a change of barometric height is
up to 12 % larger or smaller than the true one (`slack_m`).
"""

from __future__ import annotations

import math
from typing import Final

from mavproxy_handover.wire.box_layout import BoxRecord

__all__ = ["BoxHeights", "slack_m"]

#: this part of a change of barometric height is the temperature's: 288 K are 253 K at -20 degrees
_AIR: Final = 0.12
#: the pressure altitude first: it does not begin anew when the box does
_BAROMETRIC: Final = ("baro_m", "agl_m")


class BoxHeights:
    """Of one box."""

    def __init__(self) -> None:
        #: what is added to a barometric height for the one above sea level (m), by the record's attribute
        self._level_m: dict[str, float] = {}
        #: the autopilot's height above sea level when it was known last, and the box's then
        self._then: tuple[float, float] | None = None

    def level(self, record: BoxRecord, own_alt_m: float, *, armed: bool) -> None:
        """Level them by the autopilot's height above sea level of the same moment."""
        for name in _BAROMETRIC:
            value = getattr(record, name)
            if not math.isnan(value) and (not armed or name not in self._level_m):
                self._level_m[name] = own_alt_m - value
        self._then = own_alt_m, self.above_sea_m(record)

    def above_sea_m(self, record: BoxRecord) -> float:
        """Its height above sea level; NaN: it says none, or none that was levelled."""
        if not math.isnan(record.alt_m):
            return record.alt_m
        for name in _BAROMETRIC:
            value = getattr(record, name)
            if not math.isnan(value) and name in self._level_m:
                return float(value + self._level_m[name])
        return math.nan

    def followed_m(self, record: BoxRecord, own_alt_m: float) -> float:
        """The aircraft's height above sea level by this record. Where the box has none it is the autopilot's last one,
        and goes on by the change of the box's; `own_alt_m`: the autopilot's where it was never compared."""
        if not math.isnan(record.alt_m):
            return record.alt_m
        if self._then is None:
            return own_alt_m
        own_m, box_m = self._then
        climbed_m = self.above_sea_m(record) - box_m
        return own_m if math.isnan(climbed_m) else own_m + climbed_m


def slack_m(record: BoxRecord, above_home_m: float) -> float:
    """How much of a difference to the autopilot's height is none, at this height above home."""
    return 0.0 if not math.isnan(record.alt_m) else _AIR * abs(above_home_m)
