# SPDX-License-Identifier: GPL-3.0-or-later

"""SET_POSITION_TARGET_GLOBAL_INT and SET_POSITION_TARGET_LOCAL_NED: a place or a velocity for GUIDED mode.

The type mask decides, as in ArduCopter: a place alone is flown to, a velocity alone is flown for GUID_TIMEOUT
seconds; with both, the velocity is what counts here (the model has no combined controller); anything unusable
stops the aircraft. Outside GUIDED the message is ignored. Yaw is not simulated: the aircraft keeps its own rule.
"""

from __future__ import annotations

from math import cos, radians, sin

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.copter import Copter
from sitl.vehicles.builtin.frame import Location, Vector, altitude_frame, shift

__all__ = ["handle_position_target"]

_IGNORE_POSITION, _IGNORE_VELOCITY, _IGNORE_ACCELERATION, _FORCE = 0b111, 0b111000, 0b111000000, 1 << 9
_MAX_VELOCITY_M_S = 1000.0
_LOCAL = "SET_POSITION_TARGET_LOCAL_NED"
#: MAV_FRAMEs of a local target: from the origin, from the aircraft; those of them that turn with the aircraft
_FROM_ORIGIN, _FROM_AIRCRAFT, _TURNED = 1, (7, 8, 9), (8, 9)


def handle_position_target(copter: Copter, m: dialect.MAVLink_message) -> None:
    """Apply the message to the GUIDED mode."""
    guided = copter.guided
    if copter.mode is not guided:
        return
    local = m.get_type() == _LOCAL
    known = not local or m.coordinate_frame == _FROM_ORIGIN or m.coordinate_frame in _FROM_AIRCRAFT
    use_place = not m.type_mask & _IGNORE_POSITION
    use_velocity = not m.type_mask & _IGNORE_VELOCITY
    place = (_local_place(copter, m) if local else _place(m)) if known and use_place else None
    north, east = _turned(copter, m, m.vx, m.vy) if local else (m.vx, m.vy)
    velocity = (north, east, -m.vz)
    forced = m.type_mask & _FORCE and not m.type_mask & _IGNORE_ACCELERATION
    sane = all(abs(v) <= _MAX_VELOCITY_M_S for v in velocity)  # NaN is not
    usable = (
        known and (use_place or use_velocity) and (place is not None or not use_place) and (sane or not use_velocity)
    )
    if forced or not usable:
        guided.stop()
    elif use_velocity:
        guided.fly_with(velocity)
    elif place is not None:
        guided.go_to(place)


def _place(m: dialect.MAVLink_message) -> Location | None:
    frame = altitude_frame(m.coordinate_frame)
    if frame is None or abs(m.lat_int) > 900_000_000 or abs(m.lon_int) > 1_800_000_000 or not abs(m.alt) < 83_000:
        return None
    return Location(m.lat_int, m.lon_int, m.alt, frame)


def _local_place(copter: Copter, m: dialect.MAVLink_message) -> Location | None:
    origin = copter.origin
    if origin is None or not all(abs(value) < 1e6 for value in (m.x, m.y, m.z)):
        return None
    north, east = _turned(copter, m, m.x, m.y)
    here: Vector = copter.body.position if m.coordinate_frame in _FROM_AIRCRAFT else (0.0, 0.0, 0.0)
    return Location(*shift(origin, north + here[0], east + here[1]), origin.alt_m + here[2] - m.z)


def _turned(copter: Copter, m: dialect.MAVLink_message, first: float, second: float) -> tuple[float, float]:
    """North and east of a vector in the frame of the message."""
    turn = radians(copter.body.heading_deg) if m.coordinate_frame in _TURNED else 0.0
    return first * cos(turn) - second * sin(turn), first * sin(turn) + second * cos(turn)
