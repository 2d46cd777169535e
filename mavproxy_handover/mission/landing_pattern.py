# SPDX-License-Identifier: GPL-3.0-or-later

"""The landing pattern of a QGroundControl plan, as the items that QGroundControl uploads for it.

QGroundControl stores a landing pattern by its places only: where the approach begins, and where the aircraft lands. It
uploads DO_LAND_START, the commands that stop photos and video, the beginning of the approach, and the landing. The
approach begins with a circle down (NAV_LOITER_TO_ALT), or with a waypoint.

Version 1 has one flag for each height. If they differ, both heights count from home, as QGroundControl reads them.

Source: QGroundControl's `LandingComplexItem`, `FixedWingLandingComplexItem` and `VTOLLandingComplexItem`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from mavproxy_handover.mission.errors import Where
from mavproxy_handover.mission.items import (
    FRAME_ABOVE_HOME,
    FRAME_ABOVE_SEA,
    FRAME_NONE,
    LAND,
    LAND_START,
    LOITER_TO_ALTITUDE,
    VTOL_LAND,
    WAYPOINT,
)

__all__ = ["LANDING_PATTERNS", "landing_items"]

#: type of the complex item -> how it ends
LANDING_PATTERNS: Final[Mapping[str, int]] = {"fwLandingPattern": LAND, "vtolLandingPattern": VTOL_LAND}
_TRIGGER_DISTANCE, _IMAGES_STOP, _VIDEO_STOP = 206, 2001, 2501
#: key of a plan -> the commands that stop what it names
_STOPS: Final = (("stopTakingPhotos", (_TRIGGER_DISTANCE, _IMAGES_STOP)), ("stopVideoPhotos", (_VIDEO_STOP,)))
_ABOVE_HOME = "altitudesAreRelative"
_ABOVE_HOME_OF_1: Final = ("loiterAltitudeRelative", "landingAltitudeRelative")
_LONGEST_RADIUS_M: Final = 10_000.0


def landing_items(where: Where, pattern: Mapping[str, object]) -> list[Mapping[str, object]]:
    """The simple items of a landing pattern, in order. Raises MissionError."""
    frame = FRAME_ABOVE_HOME if _above_home(where, pattern) else FRAME_ABOVE_SEA
    approach = "landingApproachCoordinate" if "landingApproachCoordinate" in pattern else "loiterCoordinate"
    return [
        _item(LAND_START, FRAME_NONE),
        *(_item(command, FRAME_NONE) for key, commands in _STOPS if pattern.get(key) is True for command in commands),
        _approach(where, pattern, frame, _place(where, pattern, approach)),
        _item(LANDING_PATTERNS[str(pattern["complexItemType"])], frame, place=_place(where, pattern, "landCoordinate")),
    ]


def _above_home(where: Where, pattern: Mapping[str, object]) -> bool:
    if _ABOVE_HOME in pattern or pattern.get("version") != 1:
        return where.flag(where.need(pattern, _ABOVE_HOME), _ABOVE_HOME)
    flags = [where.flag(where.need(pattern, key), key) for key in _ABOVE_HOME_OF_1]
    return flags[0] or flags[0] is not flags[1]


def _approach(where: Where, pattern: Mapping[str, object], frame: int, place: list[object]) -> Mapping[str, object]:
    if pattern.get("useLoiterToAlt") is False:
        return _item(WAYPOINT, frame, place=place)
    radius = where.number(where.need(pattern, "loiterRadius"), "loiterRadius", 0.0, _LONGEST_RADIUS_M)
    right = where.flag(where.need(pattern, "loiterClockwise"), "loiterClockwise")
    return _item(LOITER_TO_ALTITUDE, frame, 1.0, radius if right else -radius, 0.0, 1.0, place=place)


def _place(where: Where, pattern: Mapping[str, object], key: str) -> list[object]:
    numbers = where.array(where.need(pattern, key), key)
    if len(numbers) != 3:
        raise where.error(f"{key} has {len(numbers)} numbers (allowed: 3)")
    return numbers


def _item(command: int, frame: int, *params: float, place: list[object] | None = None) -> dict[str, Any]:
    first = [*params, *[0.0] * (4 - len(params))]
    return {"command": command, "frame": frame, "params": [*first, *(place or (0.0, 0.0, 0.0))]}
