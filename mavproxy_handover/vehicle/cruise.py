# SPDX-License-Identifier: GPL-3.0-or-later

"""The mission's cruise speed: the aircraft flies at the speed that `handover check` has used.

On the ground, the cruise speed is written with the mission to the autopilot's parameter for the speed between
waypoints. A DO_CHANGE_SPEED would hold only until the aircraft leaves AUTO. After GUIDED, or after a cancelled return,
the mission would continue at the speed of the parameter. The parameter holds in every mode, and also if every computer
above the autopilot fails. A DO_CHANGE_SPEED item of the mission stays an item. When the aircraft returns to AUTO after
that item, the companion commands its speed again.

A copter has another parameter for the speed of a return. The cruise speed is written there too, because check and
energy rule count a return with that speed. At 0 a return is flown at the speed between waypoints.

For a plane the cruise speed is an airspeed, between the least and the greatest airspeed of its parameters. A plane does
not fly slower than that, so the check would have used a speed that the aircraft does not fly.

Sources: ArduPilot's AC_WPNav (`_check_wp_speed_change`) and ModeAuto::init, which forgets every DO_CHANGE_SPEED;
ArduPlane's Mode::enter, which does too, and `do_change_speed`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.vehicle.profiles import Profile
from mavproxy_handover.wire.conversation import Ask, Asking, AutopilotError, NoAnswer
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID

__all__ = ["held_cruise", "write_cruise"]

#: parameters have 24 bits
_ROUNDED: Final = 1e-4
_ABOVE_ZERO: Final = 5e-324
#: types of a parameter that holds only whole numbers
_WHOLE: Final = frozenset(range(mavlink.MAV_PARAM_TYPE_UINT8, mavlink.MAV_PARAM_TYPE_INT64 + 1))


def held_cruise(sysid: int, profile: Profile) -> Asking:
    """Returns the speed between waypoints (m/s) that the autopilot has. Raises NoAnswer."""
    message = yield from _read(sysid, profile.cruise)
    return message.param_value / profile.cruise[message.param_id]


def write_cruise(sysid: int, cruise_mps: float, profile: Profile) -> Asking:
    """Have the autopilot fly missions and returns at `cruise_mps`, and see that it will. Raises NoAnswer,
    AutopilotError."""
    yield from _within(sysid, cruise_mps, profile)
    yield from _write(sysid, cruise_mps, profile.cruise, "the mission's cruise speed")
    if profile.back_speed:
        yield from _write(sysid, cruise_mps, profile.back_speed, "the speed of a return")


def _write(sysid: int, speed_mps: float, units: Mapping[str, float], what: str) -> Asking:
    """Write one parameter and check it; a firmware has one of these names."""
    message = yield from _read(sysid, units, least=0.0)
    name, wanted = message.param_id, speed_mps * units[message.param_id]
    if message.param_type in _WHOLE:
        wanted = float(round(wanted))
    if _equal(message.param_value, wanted):
        return
    order = mavlink.MAVLink_param_set_message(sysid, AUTOPILOT_COMPID, name.encode("ascii"), wanted, message.param_type)
    try:
        # an answer with another value may belong to an earlier request of another program
        yield Ask(name, (order,), _value_of((name,), lambda value: _equal(value, wanted)))
    except NoAnswer:
        raise AutopilotError(f"the autopilot does not take {name} {wanted:g}, {what}") from None


def _within(sysid: int, cruise_mps: float, profile: Profile) -> Asking:
    for limits, too in ((profile.slowest, "slower"), (profile.fastest, "faster")):
        if not limits:
            continue
        message = yield from _read(sysid, limits)
        limit_mps = message.param_value / limits[message.param_id]
        if (cruise_mps < limit_mps) if too == "slower" else (cruise_mps > limit_mps):
            what = f"the mission's cruise speed, {cruise_mps:g} m/s, is {too} than {message.param_id}"
            raise AutopilotError(f"{what}, {limit_mps:g} m/s")


def _read(sysid: int, names: Mapping[str, float], least: float = _ABOVE_ZERO) -> Asking:
    requests = tuple(
        mavlink.MAVLink_param_request_read_message(sysid, AUTOPILOT_COMPID, name.encode("ascii"), -1) for name in names
    )
    message = yield Ask(" or ".join(names), requests, _value_of(names, lambda value: least <= value < 1e6))
    return message


def _value_of(names: Iterable[str], fits: Callable[[float], bool]) -> Callable[[Any], Any]:
    wanted = tuple(names)

    def answer(m: Any) -> Any:
        known = m.get_type() == "PARAM_VALUE" and m.param_id in wanted
        return m if known and fits(m.param_value) else None

    return answer


def _equal(value: float, wanted: float) -> bool:
    return abs(value - wanted) <= _ROUNDED * wanted
