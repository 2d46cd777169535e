# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot last said of the vehicle: telemetry, parameters and where it is, each value with its time.

Rules:

1. Every value is replaced as a whole when the autopilot says it again, and carries the time (monotonic s) at which it
   did. A value that was never said is what MAVLink has for unknown, and its time is -inf.
2. Only this module writes: `VehicleState.take` for what the autopilot says, and its other methods for what another
   part has found out. Every other part reads, and keeps no copy.
3. `telemetry` has the autopilot's own words. `position` is the position that counts, which the box may give instead
   (`monitors/position/source.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Kind, ModeClass
from mavproxy_handover.gate.policy.modes import UNKNOWN, Modes
from mavproxy_handover.vehicle.kinds import COPTER, PLANE, Vehicle, vehicle_of
from mavproxy_handover.vehicle.parameters import Parameters
from mavproxy_handover.vehicle.plane_landing import WaysDown
from mavproxy_handover.wire.codec import AircraftState

__all__ = ["Fix", "Heartbeat", "Landed", "Said", "Telemetry", "VehicleState"]

T = TypeVar("T")

_GEOFENCE: Final = mavlink.MAV_SYS_STATUS_GEOFENCE
_ON_GROUND = mavlink.MAV_LANDED_STATE_ON_GROUND
_HOVERS: Final = (mavlink.MAV_VTOL_STATE_TRANSITION_TO_MC, mavlink.MAV_VTOL_STATE_MC)
#: what a copter never says: it is MC all the time
_ON_WINGS: Final = (
    mavlink.MAV_VTOL_STATE_TRANSITION_TO_FW,
    mavlink.MAV_VTOL_STATE_TRANSITION_TO_MC,
    mavlink.MAV_VTOL_STATE_FW,
)

#: the autopilot is asked for 20 positions a second; they come unevenly, so less than 50 ms is no reason to skip one
_COMPARE_S: Final = 0.03
#: ArduPlane's circle, if it does not tell, or has none (m)
_CIRCLE_M: Final = 60.0
#: to circle takes a moment to be told, and then a circle and a half of room; no wing flies slower (s, m/s)
_REACTION_S: Final = 2.0
_ROOM: Final = 1.5
_SLOWEST_MPS: Final = 5.0
#: parameters that say what an aircraft with wings can do
_HAS_ROTORS, _RADIUS, _RETURN_RADIUS = "Q_ENABLE", "WP_LOITER_RAD", "RTL_RADIUS"


@dataclass(frozen=True, slots=True)
class Said(Generic[T]):
    """What the autopilot said last of one thing, and when (monotonic s)."""

    value: T
    at: float = -math.inf


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """What a HEARTBEAT says. `at`: when it came (monotonic s)."""

    at: float = -math.inf
    armed: bool = False
    custom_mode: int = 0
    #: MAV_STATE
    status: int = mavlink.MAV_STATE_UNINIT
    #: its firmware: ArduCopter until it is known, and where it is none of ours
    vehicle: Vehicle = COPTER
    #: what it is, in words, where that is nothing that is flown here: the numbers of its modes are not known
    foreign: str = ""

    @property
    def critical(self) -> bool:
        """A failsafe has triggered."""
        return bool(self.status == mavlink.MAV_STATE_CRITICAL)

    @property
    def failsafe(self) -> bool:
        """A failsafe acts, or worse."""
        return bool(self.status >= mavlink.MAV_STATE_CRITICAL)


@dataclass(frozen=True, slots=True)
class Landed:
    """What EXTENDED_SYS_STATE says: MAV_LANDED_STATE and MAV_VTOL_STATE. `at`: when it came (monotonic s)."""

    at: float = -math.inf
    state: int = mavlink.MAV_LANDED_STATE_UNDEFINED
    vtol_state: int = mavlink.MAV_VTOL_STATE_UNDEFINED


@dataclass(frozen=True, slots=True)
class Fix:
    """Whether the receiver had a fix, and whether it has one now. `at`: when it said so last (monotonic s)."""

    at: float = -math.inf
    had: bool = False
    has: bool = False


_UNSAID: Final[Said[Any | None]] = Said(None)


class Telemetry:
    """The autopilot's own words, each with its time. Units are MAVLink's where a whole message is kept."""

    def __init__(self) -> None:
        self.heartbeat = Heartbeat()
        self.landed = Landed()
        #: GLOBAL_POSITION_INT
        self.own_position = _UNSAID
        self.fix = Fix()
        #: the item that is flown to, and how far away it is
        self.waypoint: Said[int] = Said(0)
        self.to_waypoint_m: Said[float] = Said(math.nan)
        #: ATTITUDE, SYS_STATUS and FENCE_STATUS
        self.attitude = self.sys_status = self.fence_status = _UNSAID
        #: latitude and longitude (degrees) of its home
        self.home: Said[tuple[float, float] | None] = Said(None)
        #: STATUSTEXT
        self.text = ""

    def take_heartbeat(self, m: Any, now: float, known: Vehicle | None) -> None:
        """HEARTBEAT; `known`: the firmware that it is of, None: nothing that is flown here."""
        self.heartbeat = Heartbeat(
            now,
            bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            m.custom_mode,
            m.system_status,
            COPTER if known is None else known,
            "" if known else f"{_words('MAV_AUTOPILOT', m.autopilot)} {_words('MAV_TYPE', m.type)}",
        )


class VehicleState:
    """One vehicle as its autopilot last described it."""

    def __init__(self) -> None:
        self.telemetry = Telemetry()
        self.parameters = Parameters()
        #: the position that counts, as GLOBAL_POSITION_INT
        self.position = _UNSAID
        #: when that came of the positions that was compared to the zones last (monotonic s)
        self._compared_at = -math.inf
        #: whether the position that counts is the autopilot's own (`monitors/position/source.py`)
        self.trusts_own = True
        #: whether a plane in AUTO flies its mission, or has been sent down
        self.ways_down = WaysDown()
        #: it has been heard disarmed
        self._was_disarmed = False
        #: it was an ArduPlane when it was armed, or has flown on wings since
        self._winged = False
        #: when it said last that it hovers as well as flies on wings
        self._hovers_too_at = -math.inf
        #: what it was stopped in, where that is done by a mode of its own
        self.stopped_in: ModeClass | None = None
        #: when it said last that it is outside its fence
        self.breached_at = -math.inf

    def take(self, m: Any, now: float) -> None:
        """Take in a message of the autopilot."""
        take = _TAKE.get(m.get_type())
        if take is not None:
            take(self, m, now)

    def _take_heartbeat(self, m: Any, now: float) -> None:
        armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self._was_disarmed |= not armed
        # in the air it becomes no other aircraft, whatever it calls itself by then
        self._winged = armed and (self._winged or self.vehicle is PLANE)
        self.telemetry.take_heartbeat(m, now, vehicle_of(m.autopilot, m.type, winged=self._winged))
        self.ways_down.mode(self.vehicle, m.custom_mode, now)

    def _take_position(self, m: Any, now: float) -> None:
        if m.lat == 0 and m.lon == 0:  # no position yet
            return
        self.telemetry.own_position = Said(m, now)
        if self.trusts_own:
            self.placed(m, now)

    def placed(self, position: Any, now: float) -> None:
        """It is here, by the word that counts: a GLOBAL_POSITION_INT, of the autopilot or made of another's word."""
        self.position = Said(position, now)

    def compared(self) -> None:
        """The position that counts is being compared to the zones."""
        self._compared_at = self.position.at

    @property
    def uncompared(self) -> bool:
        """The position that counts is due to be compared to the zones."""
        return self.position.at - self._compared_at >= _COMPARE_S

    def trust_own(self, trusted: bool) -> None:
        """Whether the autopilot's own positions are the ones that count from now on."""
        self.trusts_own = trusted

    def stop_from(self, flown: ModeClass) -> None:
        """It flies this, and is about to be stopped."""
        self.stopped_in = flown

    def has_home(self, lat_deg: float, lon_deg: float, now: float) -> None:
        """Its home, by HOME_POSITION or item 0 of its mission; 0, 0: it has none yet."""
        if (lat_deg, lon_deg) != (0.0, 0.0):
            self.telemetry.home = Said((lat_deg, lon_deg), now)

    def _take_attitude(self, m: Any, now: float) -> None:
        self.telemetry.attitude = Said(m, now)

    def _take_sys_status(self, m: Any, now: float) -> None:
        self.telemetry.sys_status = Said(m, now)
        if m.onboard_control_sensors_enabled & ~m.onboard_control_sensors_health & _GEOFENCE:
            self.breached_at = now

    def _take_landed(self, m: Any, now: float) -> None:
        self.telemetry.landed = Landed(now, m.landed_state, m.vtol_state)
        self._winged = self._winged or (self.armed and m.vtol_state in _ON_WINGS)
        if m.vtol_state != mavlink.MAV_VTOL_STATE_UNDEFINED:
            self._hovers_too_at = now

    def _take_parameter(self, m: Any, now: float) -> None:
        self.parameters.take(m, now)

    def _take_waypoint(self, m: Any, now: float) -> None:
        self.telemetry.waypoint = Said(m.seq, now)
        self.ways_down.waypoint(m.seq, now)

    def _take_distance(self, m: Any, now: float) -> None:
        self.telemetry.to_waypoint_m = Said(float(m.wp_dist), now)

    def _take_fence(self, m: Any, now: float) -> None:
        self.telemetry.fence_status = Said(m, now)
        if m.breach_status:
            self.breached_at = now

    def _take_home(self, m: Any, now: float) -> None:
        self.has_home(m.latitude / 1e7, m.longitude / 1e7, now)

    def _take_text(self, m: Any, _now: float) -> None:
        self.telemetry.text = m.text

    def _take_fix(self, m: Any, now: float) -> None:
        has = m.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX
        self.telemetry.fix = Fix(now, self.telemetry.fix.had or has, has)

    # ---- its heartbeat --------------------------------------------------------------------------------------------

    @property
    def armed(self) -> bool:
        """By its last heartbeat."""
        return self.telemetry.heartbeat.armed

    @property
    def custom_mode(self) -> int:
        """The number of its flight mode."""
        return self.telemetry.heartbeat.custom_mode

    @property
    def vehicle(self) -> Vehicle:
        """Its firmware, ArduCopter until it is known, and where it is none of ours."""
        return self.telemetry.heartbeat.vehicle

    @property
    def foreign(self) -> str:
        """What it is, in words, where that is nothing that is flown here; "" else."""
        return self.telemetry.heartbeat.foreign

    @property
    def waypoint(self) -> int:
        """The item of the mission that is flown to; 0 before it is known."""
        return self.telemetry.waypoint.value

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
    def flown(self) -> ModeClass | None:
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
        return self.kind.winged and self.telemetry.landed.vtol_state in _HOVERS

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
        fix = self.telemetry.fix
        return fix.had and not fix.has

    @property
    def flying(self) -> bool:
        """Armed and off the ground, or armed with the ground contact unknown."""
        return self.armed and self.telemetry.landed.state != _ON_GROUND

    @property
    def comes_down(self) -> bool:
        """It says that it is landing, in whatever mode."""
        return bool(self.telemetry.landed.state == mavlink.MAV_LANDED_STATE_LANDING)

    @property
    def lands(self) -> bool:
        """The same, or its mode lands."""
        return self.comes_down or self.flown is ModeClass.LAND

    @property
    def always_armed(self) -> bool:
        """With wings, on the ground, and never heard disarmed: where ARMING_REQUIRE is 0 it never is."""
        return self.kind.winged and self.telemetry.landed.state == _ON_GROUND and not self._was_disarmed

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
        """Ground speed by the autopilot's own word."""
        position = self.telemetry.own_position.value
        return 0.0 if position is None else math.hypot(*_over_ground(position))

    @property
    def where(self) -> tuple[float, float, float] | None:
        """Latitude and longitude (degrees), height above home (m); None before they are known."""
        position = self.position.value
        return None if position is None else (position.lat / 1e7, position.lon / 1e7, position.relative_alt / 1000.0)

    @property
    def home_alt_m(self) -> float | None:
        """Its home above the sea (m), as its own positions have it; None before they are known."""
        position = self.telemetry.own_position.value
        return None if position is None else (position.alt - position.relative_alt) / 1000.0

    @property
    def _battery(self) -> tuple[int, int]:
        """Voltage (mV) and charge (%), in MAVLink's words for unknown where they are not known."""
        status = self.telemetry.sys_status.value
        return (0xFFFF, -1) if status is None else (status.voltage_battery, status.battery_remaining)

    def state(self) -> AircraftState:
        """What HANDOVER_REQUEST tells."""
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


_TAKE: Final[dict[str, Callable[[VehicleState, Any, float], None]]] = {
    "HEARTBEAT": VehicleState._take_heartbeat,
    "GLOBAL_POSITION_INT": VehicleState._take_position,
    "ATTITUDE": VehicleState._take_attitude,
    "SYS_STATUS": VehicleState._take_sys_status,
    "EXTENDED_SYS_STATE": VehicleState._take_landed,
    "MISSION_CURRENT": VehicleState._take_waypoint,
    "NAV_CONTROLLER_OUTPUT": VehicleState._take_distance,
    "STATUSTEXT": VehicleState._take_text,
    "FENCE_STATUS": VehicleState._take_fence,
    "HOME_POSITION": VehicleState._take_home,
    "GPS_RAW_INT": VehicleState._take_fix,
    "PARAM_VALUE": VehicleState._take_parameter,
}
