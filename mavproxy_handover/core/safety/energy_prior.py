# SPDX-License-Identifier: GPL-3.0-or-later

"""Energy settings of an aircraft before it flies: the table [energy] of a mission and of a vehicle.

Both files have the same keys, all of them optional. The mission's values replace the vehicle's, because the mission
knows the payload. A missing value is derived from the others, or is a default with its source beside it. Without the
energy of the battery, or without anything that tells the power in hover, there is no model: the budget is unknown, and
says what is missing. For an aircraft with wings either power is enough: the one that is missing is taken to be as large
as the other.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import sqrt
from typing import Final

from mavproxy_handover.core.safety.energy import EnergyModel, Wind

__all__ = [
    "ON_ROTORS",
    "ON_WINGS",
    "START_POLICIES",
    "EnergyPrior",
    "EnergySettings",
    "hover_power_w",
]

#: what a budget that does not close does to START
START_POLICIES: Final = ("refuse", "warn", "off")

_GRAVITY_MPSS: Final = 9.80665
_AIR_KG_M3: Final = 1.225
#: of motor and propeller in hover: the lower end of what small multicopters are said to have
_EFFICIENCY: Final = 0.5
#: W/kg: the upper end of what multicopters draw in hover
_WORST_W_PER_KG: Final = 165.0
#: a tenth more than hover is what ArduCopter SITL's quad draws at 10 m/s
_CRUISE_TO_HOVER: Final = 1.1
#: 3DR Solo; descending it drew a tenth less than in hover, which is not counted on
_CLIMB_TO_HOVER: Final = 1.2
#: ArduCopter's lean limit (ANGLE_MAX, degrees)
_ANGLE_MAX_DEG: Final = 30.0
#: a gentle breeze (Beaufort 3): the head wind if the wind is not known
_HEADWIND_MPS: Final = 3.0
#: PX4's rule for its return: a tenth more than was computed
_FACTOR: Final = 1.1
#: and a fixed part: a fifth of the battery, and a minute of hover
_RESERVE_PART, _RESERVE_HOVER_S = 0.2, 60.0


def hover_power_w(mass_kg: float, rotor_area_m2: float) -> float:
    """What hovering takes at sea level, by momentum theory: (m g)^1.5 / (efficiency sqrt(2 rho A)).

    `rotor_area_m2` is the area of all rotor discs together. Source: Leishman, Principles of Helicopter Aerodynamics,
    2.2.
    """
    return float((mass_kg * _GRAVITY_MPSS) ** 1.5 / (_EFFICIENCY * sqrt(2.0 * _AIR_KG_M3 * rotor_area_m2)))


@dataclass(frozen=True, slots=True)
class EnergyPrior:
    """Values that count for an aircraft where [energy] says nothing."""

    #: the speed that its missions are flown at (m/s), and the height above home of its returns (m)
    cruise_mps: float
    return_alt_m: float
    #: it is told an airspeed and holds that, with the power that goes with it (`EnergyModel`)
    holds_airspeed: bool


#: ArduCopter's WPNAV_SPEED and RTL_ALT
ON_ROTORS: Final = EnergyPrior(10.0, 15.0, holds_airspeed=False)
#: ArduPlane's AIRSPEED_CRUISE (before 4.5 TRIM_ARSPD_CM) and RTL_ALTITUDE (before 4.5 ALT_HOLD_RTL)
ON_WINGS: Final = EnergyPrior(12.0, 100.0, holds_airspeed=True)


@dataclass(frozen=True, slots=True)
class EnergySettings:
    """The numbers of [energy], as they are configured; None: not given."""

    #: what the full pack gives, all packs together
    battery_wh: float | None = None
    #: packs that it comes from, monitors 0 and up; each gives an equal share
    batteries: float | None = None
    #: lithium polymer cells in series: with them the voltage has a say too
    cells: float | None = None
    #: take-off mass and area of all rotor discs: what hovering takes, where `hover_w` is not given
    mass_kg: float | None = None
    rotor_area_m2: float | None = None
    #: the part of that mass which the mission drops; all numbers are with it on board
    payload_kg: float | None = None
    hover_w: float | None = None
    #: power at the airspeed `cruise_mps` in level flight
    cruise_w: float | None = None
    #: powers of climb and descent at ArduCopter's default speeds, as parts of that of hovering
    climb_factor: float | None = None
    descent_factor: float | None = None
    cruise_mps: float | None = None
    #: the fastest airspeed that it holds, at its lean limit
    airspeed_mps: float | None = None
    #: taken to blow from ahead, wherever it flies, where the wind is not known
    headwind_mps: float | None = None
    reserve_factor: float | None = None
    reserve_wh: float | None = None
    return_alt_m: float | None = None
    #: the lean limit, and what leans it in steady flight: g tan(lean) = drag_per_s v + drag_per_m v^2
    lean_deg: float | None = None
    drag_per_s: float | None = None
    drag_per_m: float | None = None
    #: one of START_POLICIES
    start: str | None = None

    def over(self, other: EnergySettings) -> EnergySettings:
        """These, and those of `other` where these are silent."""
        chosen = {}
        for entry in fields(self):
            own = getattr(self, entry.name)
            chosen[entry.name] = getattr(other, entry.name) if own is None else own
        return EnergySettings(**chosen)

    @property
    def missing(self) -> str:
        """What an aircraft on rotors has no budget without, in words; "" if nothing is missing."""
        return self.missing_for(ON_ROTORS)

    def missing_for(self, prior: EnergyPrior) -> str:
        """What an aircraft with this prior has no budget without, in words; "" if nothing is missing."""
        power = self._hover_w if self._hover_w is not None or not prior.holds_airspeed else self.cruise_w
        if self.battery_wh is None and power is None:
            return "no [energy] numbers"
        if self.battery_wh is None:
            return "[energy] has no battery_wh"
        if power is not None:
            return ""
        return f"[energy] has neither {'cruise_w nor hover_w' if prior.holds_airspeed else 'hover_w nor mass_kg'}"

    @property
    def unloaded_part(self) -> float:
        """Mass after the payload is dropped, as a part of the mass at take-off; 1 if it is not known."""
        if not self.payload_kg or not self.mass_kg or self.payload_wrong:
            return 1.0
        return 1.0 - self.payload_kg / self.mass_kg

    @property
    def payload_wrong(self) -> str:
        """Why its payload cannot be so heavy, in words; "" where it can."""
        if not self.payload_kg:
            return ""
        if self.mass_kg is None:
            return f"{self.payload_kg:g} says nothing without mass_kg, the mass at take-off with it"
        if self.payload_kg >= self.mass_kg:
            return f"{self.payload_kg:g} must be less than mass_kg, {self.mass_kg:g}"
        return ""

    def start_policy_for(self, prior: EnergyPrior) -> str:
        """What START does: refuse if there is a budget and nothing else is configured."""
        return "off" if self.missing_for(prior) else self.start or "refuse"

    @property
    def lean_limit_deg(self) -> float:
        """The lean at which it is as fast as it gets."""
        return _ANGLE_MAX_DEG if self.lean_deg is None else self.lean_deg

    @property
    def _hover_w(self) -> float | None:
        if self.hover_w is not None or self.mass_kg is None:
            return self.hover_w
        if self.rotor_area_m2 is None:
            return self.mass_kg * _WORST_W_PER_KG
        return hover_power_w(self.mass_kg, self.rotor_area_m2)

    def model(self, wind: Wind | None = None, prior: EnergyPrior = ON_ROTORS) -> EnergyModel | None:
        """The model before anything is learned; None if something is `missing_for` it."""
        battery_wh, hover_w, holds_airspeed = self.battery_wh, self._hover_w, prior.holds_airspeed
        if hover_w is None and holds_airspeed:
            hover_w = self.cruise_w
        if battery_wh is None or hover_w is None:
            return None
        cruise_mps = prior.cruise_mps if self.cruise_mps is None else self.cruise_mps
        usual_w = hover_w if holds_airspeed else hover_w * _CRUISE_TO_HOVER
        cruise_w = usual_w if self.cruise_w is None else self.cruise_w
        reserve_wh = _RESERVE_PART * battery_wh + hover_w * _RESERVE_HOVER_S / 3600.0
        return EnergyModel(
            battery_wh=battery_wh,
            hover_w=hover_w,
            cruise_w=cruise_w if holds_airspeed else max(hover_w, cruise_w),
            climb_w=hover_w * (_CLIMB_TO_HOVER if self.climb_factor is None else self.climb_factor),
            descent_w=hover_w * (1.0 if self.descent_factor is None else self.descent_factor),
            cruise_mps=cruise_mps,
            airspeed_mps=cruise_mps if self.airspeed_mps is None else self.airspeed_mps,
            headwind_mps=_HEADWIND_MPS if self.headwind_mps is None else self.headwind_mps,
            reserve_factor=_FACTOR if self.reserve_factor is None else self.reserve_factor,
            reserve_wh=reserve_wh if self.reserve_wh is None else self.reserve_wh,
            return_alt_m=prior.return_alt_m if self.return_alt_m is None else self.return_alt_m,
            wind=wind,
            unloaded_part=self.unloaded_part,
            holds_airspeed=holds_airspeed,
        )
