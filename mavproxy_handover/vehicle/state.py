# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot last said of the aircraft, and the messages that pass it on."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.model import Flown, Kind
from mavproxy_handover.gate.policy.modes import UNKNOWN, Modes
from mavproxy_handover.vehicle.kinds import COPTER, PLANE, Vehicle, vehicle_of
from mavproxy_handover.vehicle.parameters import Parameters
from mavproxy_handover.vehicle.plane_landing import WaysDown
from mavproxy_handover.wire.codec import AircraftState

__all__ = ["Aircraft"]

_ON_GROUND = mavlink.MAV_LANDED_STATE_ON_GROUND
_HOVERS: Final = (mavlink.MAV_VTOL_STATE_TRANSITION_TO_MC, mavlink.MAV_VTOL_STATE_MC)
#: what a copter never says: it is MC all the time
_ON_WINGS: Final = (
    mavlink.MAV_VTOL_STATE_TRANSITION_TO_FW,
    mavlink.MAV_VTOL_STATE_TRANSITION_TO_MC,
    mavlink.MAV_VTOL_STATE_FW,
)

#: ArduPlane's circle, if it does not tell, or has none (m)
_CIRCLE_M: Final = 60.0
#: to circle takes a moment to be told, and then a circle and a half of room; no wing flies slower (s, m/s)
_REACTION_S: Final = 2.0
_ROOM: Final = 1.5
_SLOWEST_MPS: Final = 5.0
#: parameters that say what an aircraft with wings can do
_HAS_ROTORS, _RADIUS, _RETURN_RADIUS = "Q_ENABLE", "WP_LOITER_RAD", "RTL_RADIUS"


class Aircraft:
    """The last values, in MAVLink's units; a value that was never heard is what MAVLink has for unknown."""

    def __init__(self) -> None:
        self.armed = False
        #: it has been heard disarmed
        self._was_disarmed = False
        self.custom_mode = 0
        #: what it is, in words, where that is nothing that is flown here: the numbers of its modes are not known
        self.foreign = ""
        #: its firmware, ArduCopter until it is known, and where it is none of ours
        self.vehicle: Vehicle = COPTER
        #: whether a plane in AUTO flies its mission, or has been sent down
        self.ways_down = WaysDown()
        #: what it was stopped in, where that is done by a mode of its own
        self.stopped_in: Flown | None = None
        self._vtol_state = mavlink.MAV_VTOL_STATE_UNDEFINED
        #: it was an ArduPlane when it was armed, or has flown on wings since
        self._winged = False
        #: when it said last that it hovers as well as flies on wings
        self._hovers_too_at = -math.inf
        self.parameters = Parameters()
        self.landed_state = mavlink.MAV_LANDED_STATE_UNDEFINED
        self.landed_state_at = -math.inf
        #: the position that counts, and when it came
        self.position: Any | None = None
        self.position_at = -math.inf
        #: the autopilot's own word of it
        self.own_position: Any | None = None
        self.own_position_at = -math.inf
        #: whether that is the one that counts (`position_watch.py`)
        self.trusts_own = True
        self.heartbeat_at = -math.inf
        self.status_text = ""
        self._attitude: Any | None = None
        self._battery_voltage = 0xFFFF
        self._battery_remaining = -1
        self.waypoint = 0
        self.waypoint_at = -math.inf
        self.waypoint_distance_m = math.nan
        self.waypoint_distance_at = -math.inf
        #: a failsafe has triggered, by the heartbeat
        self.critical = False
        #: its receiver had a fix, and whether it has one now
        self._had_fix = self._has_fix = False
        #: SYS_STATUS, FENCE_STATUS and their times
        self.sys_status: Any | None = None
        self.sys_status_at = -math.inf
        self.fence_status: Any | None = None
        self.fence_status_at = -math.inf

    def take(self, m: Any, now: float) -> None:
        """Take in a message of the autopilot."""
        take = _TAKE.get(m.get_type())
        if take is not None:
            take(self, m, now)

    def _take_heartbeat(self, m: Any, now: float) -> None:
        self.heartbeat_at = now
        self.armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self._was_disarmed |= not self.armed
        self.custom_mode = m.custom_mode
        self.critical = m.system_status == mavlink.MAV_STATE_CRITICAL
        # in the air it becomes no other aircraft, whatever it calls itself by then
        self._winged = self.armed and (self._winged or self.vehicle is PLANE)
        known = vehicle_of(m.autopilot, m.type, winged=self._winged)
        self.vehicle = COPTER if known is None else known
        self.foreign = "" if known else f"{_words('MAV_AUTOPILOT', m.autopilot)} {_words('MAV_TYPE', m.type)}"
        self.ways_down.mode(self.vehicle, m.custom_mode, now)

    def _take_position(self, m: Any, now: float) -> None:
        if m.lat == 0 and m.lon == 0:  # no position yet
            return
        self.own_position, self.own_position_at = m, now
        if self.trusts_own:
            self.placed(m, now)

    def placed(self, position: Any, now: float) -> None:
        """It is here, by the word that counts: a GLOBAL_POSITION_INT, of the autopilot or made of another's word."""
        self.position, self.position_at = position, now

    def _take_attitude(self, m: Any, _now: float) -> None:
        self._attitude = m

    def _take_battery(self, m: Any, now: float) -> None:
        self.sys_status, self.sys_status_at = m, now
        self._battery_voltage = m.voltage_battery
        self._battery_remaining = m.battery_remaining

    def _take_landed(self, m: Any, now: float) -> None:
        self.landed_state, self.landed_state_at = m.landed_state, now
        self._vtol_state = m.vtol_state
        self._winged = self._winged or (self.armed and m.vtol_state in _ON_WINGS)
        if m.vtol_state != mavlink.MAV_VTOL_STATE_UNDEFINED:
            self._hovers_too_at = now

    def _take_parameter(self, m: Any, now: float) -> None:
        self.parameters.take(m, now)

    def _take_waypoint(self, m: Any, now: float) -> None:
        self.waypoint, self.waypoint_at = m.seq, now
        self.ways_down.waypoint(m.seq, now)

    def _take_distance(self, m: Any, now: float) -> None:
        self.waypoint_distance_m, self.waypoint_distance_at = float(m.wp_dist), now

    def _take_fence(self, m: Any, now: float) -> None:
        self.fence_status, self.fence_status_at = m, now

    def _take_text(self, m: Any, _now: float) -> None:
        self.status_text = m.text

    # ---- what it is -----------------------------------------------------------------------------------------------

    @property
    def kind(self) -> Kind:
        """What kind of aircraft it is; a copter where it is nothing that is flown here."""
        if self.vehicle is not PLANE:
            return Kind.COPTER
        return Kind.QUADPLANE if self._has_rotors else Kind.PLANE

    @property
    def _has_rotors(self) -> bool:
        """It hovers too: by its own words or by its parameter, the later one."""
        parameter = self.parameters.get(_HAS_ROTORS)
        if parameter is None or parameter.at < self._hovers_too_at:
            return self._hovers_too_at > -math.inf
        return parameter.value > 0.0

    def _radius_m(self, name: str) -> float | None:
        """The radius (m) of a circle that a parameter gives; None: the autopilot has not told it."""
        parameter = self.parameters.get(name)
        return None if parameter is None else abs(parameter.value)

    @property
    def flown(self) -> Flown | None:
        """What it flies; None: nobody knows what its modes are."""
        if self.foreign:
            return None
        return self.ways_down.flown or self.vehicle.flown(self.custom_mode)

    @property
    def judged_by(self) -> Modes:
        """What the gate judges the numbers of its modes by."""
        return UNKNOWN if self.foreign else self.vehicle.judged_by

    @property
    def in_auto(self) -> bool:
        """Its mode is the one that flies missions."""
        return self.custom_mode == self.vehicle.auto

    @property
    def flies_mission(self) -> bool:
        """It flies its mission, and is not on a way down that it was sent on."""
        return self.in_auto and self.ways_down.flown is None

    @property
    def to_place(self) -> bool:
        """It flies to the place that its rally list held when it began to."""
        return self.custom_mode in self.vehicle.to_place

    @property
    def hovers(self) -> bool:
        """It has wings, and is carried by its rotors, or about to be."""
        return self.kind.winged and self._vtol_state in _HOVERS

    @property
    def loiter_radius_m(self) -> float | None:
        """The radius of the circle that wings fly where nothing else is asked for (m); None: it is not known. Up to 1
        it is the firmware's own (`Plane::update_loiter`)."""
        radius_m = self._radius_m(_RADIUS)
        return radius_m if radius_m is None or radius_m > 1.0 else _CIRCLE_M

    @property
    def return_circle_m(self) -> float:
        """How far from the place of a return it stays while it circles there (m); 0 where it does not."""
        if not self.kind.winged or self.hovers:
            return 0.0
        return self._radius_m(_RETURN_RADIUS) or self.loiter_radius_m or _CIRCLE_M

    @property
    def circles_s(self) -> float:
        """So long before a border (s) it has to be told to circle, to stay inside; 0 where it can stand still."""
        if not self.kind.winged or self.hovers:
            return 0.0
        radius_m = self.loiter_radius_m or _CIRCLE_M
        return _REACTION_S + _ROOM * radius_m / max(self.own_speed_mps, _SLOWEST_MPS)

    @property
    def circle_m(self) -> float:
        """Its circle crosses a border that is nearer than this (m); 0 where it can stand still."""
        if not self.kind.winged or self.hovers:
            return 0.0
        return _ROOM * (self.loiter_radius_m or _CIRCLE_M)

    @property
    def dead_reckoning(self) -> bool:
        """The receiver had a fix and has it no more: positions come on, and are the estimator's guess."""
        return self._had_fix and not self._has_fix

    def _take_fix(self, m: Any, _now: float) -> None:
        self._has_fix = m.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX
        self._had_fix = self._had_fix or self._has_fix

    @property
    def flying(self) -> bool:
        """Armed and off the ground, or armed with the ground contact unknown."""
        return self.armed and self.landed_state != _ON_GROUND

    @property
    def always_armed(self) -> bool:
        """With wings, on the ground, and never heard disarmed: where ARMING_REQUIRE is 0 it never is."""
        return self.kind.winged and self.landed_state == _ON_GROUND and not self._was_disarmed

    @property
    def track(self) -> tuple[float, float]:
        """Course over ground (deg) and ground speed (m/s)."""
        if self.position is None:
            return 0.0, 0.0
        north, east = _over_ground(self.position)
        return math.degrees(math.atan2(east, north)) % 360.0, math.hypot(north, east)

    @property
    def own_speed_mps(self) -> float:
        """Ground speed by the autopilot's own word."""
        return 0.0 if self.own_position is None else math.hypot(*_over_ground(self.own_position))

    @property
    def where(self) -> tuple[float, float, float] | None:
        """Latitude and longitude (degrees), height above home (m); None before they are known."""
        position = self.position
        return None if position is None else (position.lat / 1e7, position.lon / 1e7, position.relative_alt / 1000.0)

    @property
    def home_alt_m(self) -> float | None:
        """Its home above the sea (m), as its own positions have it; None before they are known."""
        position = self.own_position
        return None if position is None else (position.alt - position.relative_alt) / 1000.0

    def state(self) -> AircraftState:
        """What HANDOVER_REQUEST tells."""
        position = self.position
        if position is None:
            return AircraftState(waypoint=self.waypoint, custom_mode=self.custom_mode)
        return AircraftState(
            lat=position.lat,
            lon=position.lon,
            relative_alt=position.relative_alt,
            heading=position.hdg,
            groundspeed=self.track[1],
            battery_remaining=self._battery_remaining,
            waypoint=self.waypoint,
            custom_mode=self.custom_mode,
        )

    def telemetry(self, target: tuple[int, int], utc_us: int, zones: tuple[int, int]) -> Any:
        """HANDOVER_TELEMETRY, the telemetry record of the thesis (section 4.3.2). `zones`: as `Arbiter.zones`."""
        position, attitude = self.position, self._attitude
        rates = (0.0, 0.0, 0.0) if attitude is None else (attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed)
        if position is None:
            where = (0, 0, 0, 0, 0)
            velocity = (0.0, 0.0, 0.0)
            heading = 0xFFFF
        else:
            where = (position.time_boot_ms, position.lat, position.lon, position.alt, position.relative_alt)
            velocity = (position.vx / 100.0, position.vy / 100.0, position.vz / 100.0)
            heading = position.hdg
        return mavlink.MAVLink_handover_telemetry_message(
            *target,
            utc_us,
            where[0],
            self._battery_voltage,
            self._battery_remaining,
            *where[1:],
            *rates,
            *velocity,
            heading,
            self.track[1],
            self.waypoint,
            self.waypoint_distance_m,
            zones[0],
            int(self.armed),
            self.custom_mode,
            zones[1],
        )


def _over_ground(position: Any) -> tuple[float, float]:
    """Velocity to the north and to the east (m/s)."""
    return position.vx / 100.0, position.vy / 100.0


def _words(enum: str, value: int) -> str:
    entry = mavlink.enums[enum].get(value)
    return str(value) if entry is None else entry.name.removeprefix(f"{enum}_").lower().replace("_", " ")


_TAKE: Final[dict[str, Callable[[Aircraft, Any, float], None]]] = {
    "HEARTBEAT": Aircraft._take_heartbeat,
    "GLOBAL_POSITION_INT": Aircraft._take_position,
    "ATTITUDE": Aircraft._take_attitude,
    "SYS_STATUS": Aircraft._take_battery,
    "EXTENDED_SYS_STATE": Aircraft._take_landed,
    "MISSION_CURRENT": Aircraft._take_waypoint,
    "NAV_CONTROLLER_OUTPUT": Aircraft._take_distance,
    "STATUSTEXT": Aircraft._take_text,
    "FENCE_STATUS": Aircraft._take_fence,
    "GPS_RAW_INT": Aircraft._take_fix,
    "PARAM_VALUE": Aircraft._take_parameter,
}
