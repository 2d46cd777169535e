# SPDX-License-Identifier: GPL-3.0-or-later

"""What the rules of authority are told about a zone: facts, not geometry.

The zone finder (`mission/zones.py`) turns a position into one `ZoneFact` a station; hysteresis, dwell and every
decision belong to the rules.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ZoneFact"]


@dataclass(frozen=True, slots=True)
class ZoneFact:
    """Where the aircraft is with respect to one station's zone."""

    #: system id of the station
    station: int
    #: geodesic distance to the border of its zone in metres, > 0 inside, < 0 outside
    margin_m: float
    #: seconds until the present track at the present speed leaves the zone; None when it does not within the
    #: horizon, when the aircraft is slower than 0.5 m/s, and when it is outside
    exit_s: float | None
