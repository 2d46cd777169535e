# SPDX-License-Identifier: GPL-3.0-or-later

"""SET_POSITION_TARGET_GLOBAL_INT: a place or a velocity for GUIDED mode.

The type mask decides, as in ArduCopter: a place alone is flown to, a velocity alone is flown for GUID_TIMEOUT
seconds; with both, the velocity is what counts here (the model has no combined controller); anything unusable
stops the aircraft. Outside GUIDED the message is ignored.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.copter import Copter
from sitl.vehicles.builtin.frame import Location, altitude_frame

__all__ = ["handle_position_target"]

_IGNORE_POSITION, _IGNORE_VELOCITY, _IGNORE_ACCELERATION, _FORCE = 0b111, 0b111000, 0b111000000, 1 << 9
_MAX_VELOCITY_M_S = 1000.0


def handle_position_target(copter: Copter, m: dialect.MAVLink_message) -> None:
    """Apply the message to the GUIDED mode."""
    guided = copter.guided
    if copter.mode is not guided:
        return
    use_place = not m.type_mask & _IGNORE_POSITION
    use_velocity = not m.type_mask & _IGNORE_VELOCITY
    place = _place(m) if use_place else None
    velocity = (m.vx, m.vy, -m.vz)
    forced = m.type_mask & _FORCE and not m.type_mask & _IGNORE_ACCELERATION
    sane = all(abs(v) <= _MAX_VELOCITY_M_S for v in velocity)  # NaN is not
    if forced or (use_place and place is None) or (use_velocity and not sane) or not (use_place or use_velocity):
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
