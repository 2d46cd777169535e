# SPDX-License-Identifier: GPL-3.0-or-later

"""How the autopilot flies a return, by its own parameters: height, speed, and the fences around home and above it.

Names and units differ by firmware; a firmware has one name of each kind. A return is flown at the speed of its own, and
where that is 0 at the speed between waypoints. Both are written with the mission (`autopilot/cruise.py`) and read here:
what the autopilot says that it has is what counts. Of wings it is the airspeed.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.safety.energy_prior import RETURN_ALT_M, WINGED_RETURN_ALT_M
from mavproxy_handover.mission.return_paths import FenceLimits
from mavproxy_handover.vehicle.kinds import VEHICLES
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["BELOW_CEILING_M", "NAMES", "fence_limits", "return_alt_m", "return_mps"]

#: how far below a ceiling the companion keeps the return of an ArduPlane (m)
BELOW_CEILING_M: Final = 10.0
#: parameter for the height of a return -> its units in a metre
_RETURN_ALTS: Final = {"RTL_ALT_M": 1.0, "RTL_ALT": 100.0, "RTL_ALTITUDE": 1.0, "ALT_HOLD_RTL": 100.0}
#: parameter for the speed of a return (0: the one behind it), then that of missions -> its units in one m/s
_RETURN_SPEEDS: Final = {
    **{name: units for vehicle in VEHICLES for name, units in vehicle.back_speed.items()},
    **{name: units for vehicle in VEHICLES for name, units in vehicle.cruise.items()},
}
#: the parameters that count here
NAMES: Final = (
    *_RETURN_ALTS, *_RETURN_SPEEDS, "FENCE_ENABLE", "FENCE_AUTOENABLE", "FENCE_TYPE", "FENCE_RADIUS", "FENCE_ALT_MAX",
    "WP_LOITER_RAD",
)  # fmt: skip
#: bits of FENCE_TYPE
_CEILING, _CIRCLE = 1, 2


def return_mps(state: VehicleState, cruise_mps: float) -> float:
    """How fast a return is flown (m/s); `cruise_mps`: the mission's speed, while the autopilot has told none."""
    values = state.parameters.since()
    held = (values[name] / units for name, units in _RETURN_SPEEDS.items() if name in values)
    return next((speed_mps for speed_mps in held if speed_mps > 0.0), cruise_mps)


def return_alt_m(state: VehicleState) -> float:
    """How high a return is flown (m above home)."""
    values = state.parameters.since()
    held = (values[name] / units for name, units in _RETURN_ALTS.items() if name in values)
    if not state.kind.winged:
        return next(held, RETURN_ALT_M)
    alt_m = next(held, WINGED_RETURN_ALT_M)
    return alt_m if alt_m > 0.0 else WINGED_RETURN_ALT_M  # it stays as high as it is


def fence_limits(state: VehicleState) -> FenceLimits:
    """The autopilot's own fences around home and above it, as far as they are known to be on."""
    values = state.parameters.since()
    kinds = int(values.get("FENCE_TYPE", 0))
    if not values.get("FENCE_ENABLE", 0) and not values.get("FENCE_AUTOENABLE", 0):
        kinds = 0
    radius, ceiling = values.get("FENCE_RADIUS"), values.get("FENCE_ALT_MAX")
    return FenceLimits(radius if kinds & _CIRCLE else None, ceiling if kinds & _CEILING else None)
