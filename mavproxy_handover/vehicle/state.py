# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle state: telemetry, parameters and position as the autopilot last sent them, each value with its time.

Rules:

1. Each value is replaced as a whole when the autopilot sends it again, and carries the time (monotonic s) of its
   arrival. A value that never arrived is MAVLink's value for unknown, and its time is -inf.
2. Only this module writes. `VehicleState.on_message` takes the autopilot's messages; the other methods take what other
   parts have found out. Every other part reads, and keeps no copy.
3. `telemetry` holds the autopilot's own values. `position` is the position that counts, which may come from the
   position box instead (`monitors/position/source.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import ModeClass
from mavproxy_handover.vehicle.parameters import Parameters
from mavproxy_handover.vehicle.plane_landing import WaysDown
from mavproxy_handover.vehicle.profiles import ASSUMED, UNKNOWN_MODES, Modes, Profile, profile_of, proven, refined
from mavproxy_handover.wire.codec import AircraftState

__all__ = ["Fix", "Heartbeat", "Landed", "Said", "Telemetry", "VehicleState"]

T = TypeVar("T")

_GEOFENCE: Final = mavlink.MAV_SYS_STATUS_GEOFENCE
_ON_GROUND = mavlink.MAV_LANDED_STATE_ON_GROUND
_NEAR_GROUND: Final = (mavlink.MAV_LANDED_STATE_TAKEOFF, mavlink.MAV_LANDED_STATE_LANDING)

#: the autopilot sends 20 positions a second, but unevenly: a position less than 50 ms after the last one still counts
_COMPARE_S: Final = 0.03
#: radius of ArduPlane's circle (m), if it has not told one or has none
_CIRCLE_M: Final = 60.0
#: to circle, a plane needs this reaction time (s), this many radii of room, and at least this speed (m/s)
_REACTION_S: Final = 2.0
_ROOM: Final = 1.5
_SLOWEST_MPS: Final = 5.0
#: default radius of a circle, and radius of the circle at the return site
_RADIUS, _RETURN_RADIUS = "WP_LOITER_RAD", "RTL_RADIUS"


@dataclass(frozen=True, slots=True)
class Said(Generic[T]):
    """The last value of one thing that the autopilot has sent, and its time (monotonic s)."""

    value: T
    at: float = -math.inf


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The content of a HEARTBEAT. `at`: its arrival (monotonic s)."""

    at: float = -math.inf
    armed: bool = False
    custom_mode: int = 0
    #: MAV_STATE
    status: int = mavlink.MAV_STATE_UNINIT
    #: the profile that its MAV_TYPE stands for; `ASSUMED` until it is known, and if there is none
    profile: Profile = ASSUMED
    #: what it is, in words, where that is nothing that is flown here: the numbers of its modes are not known
    foreign: str = ""

    @property
    def critical(self) -> bool:
        """A failsafe has triggered."""
        return bool(self.status == mavlink.MAV_STATE_CRITICAL)

    @property
    def failsafe(self) -> bool:
        """A failsafe acts, or a graver state is reported."""
        return bool(self.status >= mavlink.MAV_STATE_CRITICAL)


@dataclass(frozen=True, slots=True)
class Landed:
    """The content of EXTENDED_SYS_STATE: MAV_LANDED_STATE and MAV_VTOL_STATE. `at`: its arrival (monotonic s)."""

    at: float = -math.inf
    state: int = mavlink.MAV_LANDED_STATE_UNDEFINED
    vtol_state: int = mavlink.MAV_VTOL_STATE_UNDEFINED


@dataclass(frozen=True, slots=True)
class Fix:
    """Whether the GNSS receiver had a fix, and whether it has one now. `at`: the last report (monotonic s)."""

    at: float = -math.inf
    had: bool = False
    has: bool = False


_UNSAID: Final[Said[Any | None]] = Said(None)


class Telemetry:
    """The autopilot's own values, each with its time. A value that is a whole message keeps MAVLink's units."""

    def __init__(self) -> None:
        self.heartbeat = Heartbeat()
        self.landed = Landed()
        #: GLOBAL_POSITION_INT
        self.own_position = _UNSAID
        self.fix = Fix()
        #: latitude and longitude (degrees) by the GNSS receiver itself, while it has a fix
        self.receiver: Said[tuple[float, float] | None] = Said(None)
        #: the item that the aircraft flies to, and the distance to it
        self.waypoint: Said[int] = Said(0)
        self.to_waypoint_m: Said[float] = Said(math.nan)
        #: ATTITUDE, SYS_STATUS and FENCE_STATUS
        self.attitude = self.sys_status = self.fence_status = _UNSAID
        #: latitude and longitude (degrees) of its home
        self.home: Said[tuple[float, float] | None] = Said(None)
        #: STATUSTEXT
        self.text = ""

    def record_heartbeat(self, m: Any, now: float, known: Profile | None) -> None:
        """HEARTBEAT; `known`: the profile that it stands for, None: there is none."""
        self.heartbeat = Heartbeat(
            now,
            bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            m.custom_mode,
            m.system_status,
            ASSUMED if known is None else known,
            "" if known else f"{_words('MAV_AUTOPILOT', m.autopilot)} {_words('MAV_TYPE', m.type)}",
        )


class VehicleState:
    """One vehicle as its autopilot last described it."""

    def __init__(self) -> None:
        self.telemetry = Telemetry()
        self.parameters = Parameters()
        #: the position that counts, as GLOBAL_POSITION_INT
        self.position = _UNSAID
        #: arrival (monotonic s) of the last position that was compared to the zones
        self._compared_at = -math.inf
        #: whether the position that counts is the autopilot's own (`monitors/position/source.py`)
        self.trusts_own = True
        #: whether a plane in AUTO flies its mission, or a landing that was commanded
        self.ways_down = WaysDown()
        #: a heartbeat has said that it is disarmed
        self._was_disarmed = False
        #: the profile that it has until it is disarmed, whatever MAV_TYPE it reports; None: MAV_TYPE counts
        self._stays: Profile | None = None
        #: when it said last that it hovers as well as flies on wings
        self._hovers_too_at = -math.inf
        #: what it flew when it was stopped, if stopping is a change of mode
        self.stopped_in: ModeClass | None = None
        #: when it last reported a breach of its fence
        self.breached_at = -math.inf

    def on_message(self, m: Any, now: float) -> None:
        """A message of the autopilot arrived."""
        handler = _HANDLERS.get(m.get_type())
        if handler is not None:
            handler(self, m, now)

    def _on_heartbeat(self, m: Any, now: float) -> None:
        armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self._was_disarmed |= not armed
        # in the air it becomes no other aircraft, whatever it calls itself by then
        last = self.telemetry.heartbeat.profile
        self._stays = (self._stays or (last if last.proven_by else None)) if armed else None
        known = profile_of(m.autopilot, m.type)
        if self._stays is not None and m.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
            known = self._stays
        self.telemetry.record_heartbeat(m, now, known)
        self.ways_down.mode(self.telemetry.heartbeat.profile, m.custom_mode, now)

    def _on_position(self, m: Any, now: float) -> None:
        if m.lat == 0 and m.lon == 0:  # no position yet
            return
        self.telemetry.own_position = Said(m, now)
        if self.trusts_own:
            self.placed(m, now)

    def placed(self, position: Any, now: float) -> None:
        """Set the position that counts: a GLOBAL_POSITION_INT of the autopilot, or one made from another source."""
        self.position = Said(position, now)

    def compared(self) -> None:
        """Note that the position that counts is compared to the zones."""
        self._compared_at = self.position.at

    @property
    def uncompared(self) -> bool:
        """Whether the position that counts must be compared to the zones."""
        return self.position.at - self._compared_at >= _COMPARE_S

    def trust_own(self, trusted: bool) -> None:
        """Set whether the autopilot's own positions count from now on."""
        self.trusts_own = trusted

    def stop_from(self, flown: ModeClass) -> None:
        """Remember what the aircraft flies before it is stopped."""
        self.stopped_in = flown

    def has_home(self, lat_deg: float, lon_deg: float, now: float) -> None:
        """Set its home, from HOME_POSITION or item 0 of its mission; 0, 0: it has none yet."""
        if (lat_deg, lon_deg) != (0.0, 0.0):
            self.telemetry.home = Said((lat_deg, lon_deg), now)

    def _on_attitude(self, m: Any, now: float) -> None:
        self.telemetry.attitude = Said(m, now)

    def _on_sys_status(self, m: Any, now: float) -> None:
        self.telemetry.sys_status = Said(m, now)
        if m.onboard_control_sensors_enabled & ~m.onboard_control_sensors_health & _GEOFENCE:
            self.breached_at = now

    def _on_landed(self, m: Any, now: float) -> None:
        self.telemetry.landed = Landed(now, m.landed_state, m.vtol_state)
        if self.armed:
            self._stays = self._stays or proven(m.vtol_state)
        if m.vtol_state != mavlink.MAV_VTOL_STATE_UNDEFINED:
            self._hovers_too_at = now

    def _on_parameter(self, m: Any, now: float) -> None:
        self.parameters.on_value(m, now)

    def _on_waypoint(self, m: Any, now: float) -> None:
        self.telemetry.waypoint = Said(m.seq, now)
        self.ways_down.waypoint(m.seq, now)

    def _on_distance(self, m: Any, now: float) -> None:
        self.telemetry.to_waypoint_m = Said(float(m.wp_dist), now)

    def _on_fence(self, m: Any, now: float) -> None:
        self.telemetry.fence_status = Said(m, now)
        if m.breach_status:
            self.breached_at = now

    def _on_home(self, m: Any, now: float) -> None:
        self.has_home(m.latitude / 1e7, m.longitude / 1e7, now)

    def _on_text(self, m: Any, _now: float) -> None:
        self.telemetry.text = m.text

    def _on_fix(self, m: Any, now: float) -> None:
        has = m.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX
        self.telemetry.fix = Fix(now, self.telemetry.fix.had or has, has)
        if has:
            self.telemetry.receiver = Said((m.lat / 1e7, m.lon / 1e7), now)

    # ---- its heartbeat --------------------------------------------------------------------------------------------

    @property
    def armed(self) -> bool:
        """Whether it is armed, by its last heartbeat."""
        return self.telemetry.heartbeat.armed

    @property
    def custom_mode(self) -> int:
        """The number of its flight mode."""
        return self.telemetry.heartbeat.custom_mode

    @property
    def foreign(self) -> str:
        """The kind of vehicle in words, if it is not supported; else ""."""
        return self.telemetry.heartbeat.foreign

    @property
    def waypoint(self) -> int:
        """The mission item that it flies to; 0 before it is known."""
        return self.telemetry.waypoint.value

    # ---- what it is -----------------------------------------------------------------------------------------------

    @property
    def profile(self) -> Profile:
        """Its profile; `ASSUMED` until it is known, and if there is none."""
        profile = self.telemetry.heartbeat.profile
        return refined(profile) if profile.refined_by and self._is_refined(profile.refined_by) else profile

    def _is_refined(self, name: str) -> bool:
        """Whether it hovers too: by its reports or by the parameter of that name, whichever came later."""
        parameter = self.parameters.get(name)
        if parameter is None or parameter.at < self._hovers_too_at:
            return self._hovers_too_at > -math.inf
        return parameter.value > 0.0

    def _radius_m(self, name: str) -> float | None:
        """The radius (m) of a circle that a parameter gives; None: the autopilot has not told it."""
        parameter = self.parameters.get(name)
        return None if parameter is None else abs(parameter.value)

    @property
    def flown(self) -> ModeClass | None:
        """What it flies; None: its modes are not known."""
        if self.foreign:
            return None
        return self.ways_down.flown or self.telemetry.heartbeat.profile.flown(self.custom_mode)

    @property
    def judged_by(self) -> Modes:
        """What the gate judges the numbers of its modes by."""
        return UNKNOWN_MODES if self.foreign else self.telemetry.heartbeat.profile.gate

    @property
    def in_auto(self) -> bool:
        """Its mode is the one that flies missions."""
        return self.custom_mode == self.telemetry.heartbeat.profile.auto

    @property
    def flies_mission(self) -> bool:
        """Whether it flies its mission, and not a landing that was commanded."""
        return self.in_auto and self.ways_down.flown is None

    @property
    def to_place(self) -> bool:
        """Whether it flies to the return site that its rally list held when the return began."""
        return self.custom_mode in self.telemetry.heartbeat.profile.to_place

    @property
    def hovers(self) -> bool:
        """Whether it has wings and hovers, or is about to hover."""
        return self.telemetry.landed.vtol_state in self.telemetry.heartbeat.profile.hovers_in

    @property
    def near_ground(self) -> bool:
        """Whether it takes off or lands."""
        return self.telemetry.landed.state in _NEAR_GROUND

    @property
    def _circles(self) -> bool:
        """Whether it flies and can hold only by circling."""
        return self.telemetry.heartbeat.profile.holds_by_circling and not self.hovers

    @property
    def loiter_radius_m(self) -> float | None:
        """The default radius (m) of the circles of an aircraft with wings; None: not known. Up to 1 m the firmware uses
        its own radius (`Plane::update_loiter`)."""
        radius_m = self._radius_m(_RADIUS)
        return radius_m if radius_m is None or radius_m > 1.0 else _CIRCLE_M

    @property
    def return_circle_m(self) -> float:
        """The radius (m) of its circle at the return site; 0 if it does not circle there."""
        if not self._circles:
            return 0.0
        return self._radius_m(_RETURN_RADIUS) or self.loiter_radius_m or _CIRCLE_M

    @property
    def circles_s(self) -> float:
        """The time (s) before a border when it must be commanded to circle; 0 if it can stand still."""
        if not self._circles:
            return 0.0
        radius_m = self.loiter_radius_m or _CIRCLE_M
        return _REACTION_S + _ROOM * radius_m / max(self.own_speed_mps, _SLOWEST_MPS)

    @property
    def circle_m(self) -> float:
        """Its circle crosses a border that is nearer than this (m); 0 where it can stand still."""
        if not self._circles:
            return 0.0
        return _ROOM * (self.loiter_radius_m or _CIRCLE_M)

    @property
    def dead_reckoning(self) -> bool:
        """Whether the receiver has lost its fix: positions still come, but they are estimates."""
        fix = self.telemetry.fix
        return fix.had and not fix.has

    @property
    def flying(self) -> bool:
        """Armed and off the ground, or armed with the ground contact unknown."""
        return self.armed and self.telemetry.landed.state != _ON_GROUND

    @property
    def comes_down(self) -> bool:
        """Whether it reports that it is landing, in any mode."""
        return bool(self.telemetry.landed.state == mavlink.MAV_LANDED_STATE_LANDING)

    @property
    def lands(self) -> bool:
        """Whether it reports that it is landing, or its mode lands."""
        return self.comes_down or self.flown is ModeClass.LAND

    @property
    def always_armed(self) -> bool:
        """On the ground, and never heard disarmed: with ARMING_REQUIRE 0 it never is."""
        may_be = self.telemetry.heartbeat.profile.may_be_always_armed
        return may_be and self.telemetry.landed.state == _ON_GROUND and not self._was_disarmed

    @property
    def track(self) -> tuple[float, float]:
        """Course over ground (deg) and ground speed (m/s)."""
        position = self.position.value
        if position is None:
            return 0.0, 0.0
        north, east = _over_ground(position)
        return math.degrees(math.atan2(east, north)) % 360.0, math.hypot(north, east)

    @property
    def own_speed_mps(self) -> float:
        """Ground speed by the autopilot's own position."""
        position = self.telemetry.own_position.value
        return 0.0 if position is None else math.hypot(*_over_ground(position))

    @property
    def where(self) -> tuple[float, float, float] | None:
        """Latitude and longitude (degrees), height above home (m); None before they are known."""
        position = self.position.value
        return None if position is None else (position.lat / 1e7, position.lon / 1e7, position.relative_alt / 1000.0)

    @property
    def home_alt_m(self) -> float | None:
        """Its home above the sea (m), by its own positions; None before they are known."""
        position = self.telemetry.own_position.value
        return None if position is None else (position.alt - position.relative_alt) / 1000.0

    @property
    def _battery(self) -> tuple[int, int]:
        """Voltage (mV) and charge (%), as MAVLink's value for unknown if they are not known."""
        status = self.telemetry.sys_status.value
        return (0xFFFF, -1) if status is None else (status.voltage_battery, status.battery_remaining)

    def state(self) -> AircraftState:
        """The state for HANDOVER_REQUEST."""
        position = self.position.value
        if position is None:
            return AircraftState(waypoint=self.waypoint, custom_mode=self.custom_mode)
        return AircraftState(
            lat=position.lat,
            lon=position.lon,
            relative_alt=position.relative_alt,
            heading=position.hdg,
            groundspeed=self.track[1],
            battery_remaining=self._battery[1],
            waypoint=self.waypoint,
            custom_mode=self.custom_mode,
        )

    def record(self, target: tuple[int, int], utc_us: int, zones: tuple[int, int]) -> Any:
        """HANDOVER_TELEMETRY, the telemetry record of the thesis (section 4.3.2). `zones`: as `Arbiter.zones`."""
        position, attitude = self.position.value, self.telemetry.attitude.value
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
            *self._battery,
            *where[1:],
            *rates,
            *velocity,
            heading,
            self.track[1],
            self.waypoint,
            self.telemetry.to_waypoint_m.value,
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


_HANDLERS: Final[dict[str, Callable[[VehicleState, Any, float], None]]] = {
    "HEARTBEAT": VehicleState._on_heartbeat,
    "GLOBAL_POSITION_INT": VehicleState._on_position,
    "ATTITUDE": VehicleState._on_attitude,
    "SYS_STATUS": VehicleState._on_sys_status,
    "EXTENDED_SYS_STATE": VehicleState._on_landed,
    "MISSION_CURRENT": VehicleState._on_waypoint,
    "NAV_CONTROLLER_OUTPUT": VehicleState._on_distance,
    "STATUSTEXT": VehicleState._on_text,
    "FENCE_STATUS": VehicleState._on_fence,
    "HOME_POSITION": VehicleState._on_home,
    "GPS_RAW_INT": VehicleState._on_fix,
    "PARAM_VALUE": VehicleState._on_parameter,
}
