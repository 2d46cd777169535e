# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's parameters of a return: height, speed, and the fences around home and above it.

Names and units differ by firmware; each firmware has one name of each kind. A return has its own speed parameter; at 0
it is flown at the speed between waypoints. Both are written with the mission (`vehicle/cruise.py`). The values that
the autopilot has sent count here. For aircraft with wings the speed is an airspeed.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.mission.return_paths import FenceLimits
from mavproxy_handover.vehicle.profiles import PROFILES
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["BELOW_CEILING_M", "NAMES", "fence_limits", "return_alt_m", "return_mps"]

#: how far below a ceiling the companion keeps the return of an ArduPlane (m)
BELOW_CEILING_M: Final = 10.0
#: parameter for the height of a return -> its units in a metre
_RETURN_ALTS: Final = {name: units for profile in PROFILES for name, units in profile.return_alt.items()}
#: parameter for the speed of a return (0: the next one counts), then that of missions -> its units in one m/s
_RETURN_SPEEDS: Final = {
    **{name: units for profile in PROFILES for name, units in profile.back_speed.items()},
    **{name: units for profile in PROFILES for name, units in profile.cruise.items()},
}
#: the parameters that count here
NAMES: Final = (
    *_RETURN_ALTS, *_RETURN_SPEEDS, "FENCE_ENABLE", "FENCE_AUTOENABLE", "FENCE_TYPE", "FENCE_RADIUS", "FENCE_ALT_MAX",
    "WP_LOITER_RAD",
)  # fmt: skip
#: bits of FENCE_TYPE
_CEILING, _CIRCLE = 1, 2


def return_mps(state: VehicleState, cruise_mps: float) -> float:
    """The speed of a return (m/s). `cruise_mps`: the mission's speed, used until the autopilot has sent its own."""
    values = state.parameters.since()
    held = (values[name] / units for name, units in _RETURN_SPEEDS.items() if name in values)
    return next((speed_mps for speed_mps in held if speed_mps > 0.0), cruise_mps)


def return_alt_m(state: VehicleState) -> float:
    """The height of a return (m above home)."""
    values = state.parameters.since()
    held = (values[name] / units for name, units in _RETURN_ALTS.items() if name in values)
    profile = state.profile
    usual_m = profile.energy.return_alt_m
    alt_m = next(held, usual_m)
    stays = profile.returns_level and alt_m <= 0.0  # as high as it is
    return usual_m if stays else alt_m


def fence_limits(state: VehicleState) -> FenceLimits:
    """The autopilot's own fences around home and above it, if they are known to be enabled."""
    values = state.parameters.since()
    kinds = int(values.get("FENCE_TYPE", 0))
    if not values.get("FENCE_ENABLE", 0) and not values.get("FENCE_AUTOENABLE", 0):
        kinds = 0
    radius, ceiling = values.get("FENCE_RADIUS"), values.get("FENCE_ALT_MAX")
    return FenceLimits(radius if kinds & _CIRCLE else None, ceiling if kinds & _CEILING else None)
