# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether there is room around a part of the path whose exact way is not known before the flight.

Such parts are a leg of wings that is shorter than the turns at its ends need, and a take-off without a place. The
aircraft stays within a known distance of the leg. It does not matter where exactly it flies if the same stations cover
all of that, and the geofence holds all of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.leg import Leg, Place
from mavproxy_handover.mission.zones import ZoneFinder

__all__ = ["has_room", "is_covered"]

#: directions all around a place
_AROUND: Final = [math.radians(15.0 * number) for number in range(24)]
#: rings around a place, as parts of the distance
_RINGS: Final = (0.25, 0.5, 0.75, 1.0)
#: a long leg is looked at in so many places at the most
_MOST_PLACES: Final = 20


def has_room(leg: Leg, reach_m: float, finder: ZoneFinder, fence: Fence) -> bool:
    """True if one and the same coverage, and the geofence, hold all that is within `reach_m` of a leg."""
    held = finder.holding(*leg.start)
    return bool(held) and all(finder.holding(*spot) == held and fence.holds(spot[:2]) for spot in _spots(leg, reach_m))


def is_covered(leg: Leg, reach_m: float, finder: ZoneFinder, fence: Fence) -> bool:
    """True if any coverage, and the geofence, hold all that is within `reach_m` of a leg."""
    return all(finder.holding(*spot) and fence.holds(spot[:2]) for spot in _spots(leg, reach_m))


def _spots(leg: Leg, reach_m: float) -> Iterator[Place]:
    """Places on the leg, and in rings around each."""
    count = min(_MOST_PLACES, max(1, math.ceil(leg.length_m / reach_m * 2.0)))
    for number in range(count + 1):
        lat, lon, alt = leg.at(number / count)
        yield lat, lon, alt
        for ring in _RINGS:
            for angle in _AROUND:
                spot = offset(lat, lon, ring * reach_m * math.cos(angle), ring * reach_m * math.sin(angle))
                yield (*spot, alt)
