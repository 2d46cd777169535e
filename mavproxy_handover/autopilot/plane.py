# SPDX-License-Identifier: GPL-3.0-or-later

"""What the companion itself says to ArduPlane, hovering or not: START, the stop, the way home.

* START is the mode AUTO first and arming behind it: a plane is armed in the mode that it takes off in, and its mission
  begins with the take-off. A mission that was flown before is at its end still where it ended in AUTO, so it is set to
  its first item. If it does not arm, refused, unanswered or called off, the mode of before is set again: AUTO would
  take off by whoever arms it next. Unless a heartbeat shows it armed, or none comes: it may be in the air.
* There is no DO_PAUSE_CONTINUE. It stops by LOITER, a circle around where it is, and goes on by AUTO, which takes up
  the item that was flown (MIS_RESTART 0); where it was stopped in GUIDED by that, which circles where it begins and
  waits for its commander: nobody has ordered the mission. While it hovers there is no stop: QLOITER sinks half a metre
  a second without a radio (`get_pilot_desired_climb_rate_cms`), and with one it does what the throttle stick says,
  wherever that was left; LOITER flies off forwards from a take-off or a landing. Nor is there one in a return, or by
  hand.
* To return is RTL. It may show as QRTL (Q_RTL_MODE), as QLAND (during a guided take-off), or, where it goes on to the
  landing at once (RTL_AUTOLAND 2), as AUTO on a way down (`vehicle/plane_landing.py`).
* To land now is QLAND with rotors. Without it is, of what can be had, the mission's nearest way down (DO_LAND_START),
  AUTOLAND (from 4.7, with the direction of the take-off), RTL. One that is on a way down already stays there, be it its
  mission that has led it there: ordered again, it would go around, out of its last metres too, and begin it again.

Sources: ArduPlane's GCS_MAVLink_Plane.cpp, AP_Arming_Plane.cpp, mode_auto.cpp, mode_rtl.cpp, mode_qloiter.cpp,
mode_autoland.cpp, quadplane.cpp; AP_Mission (`jump_to_landing_sequence`).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.mission_protocol import AutopilotError, RefusedError
from mavproxy_handover.autopilot.procedures import Procedures, disobeys
from mavproxy_handover.core.common.model import FlightAction, Kind, ModeClass
from mavproxy_handover.vehicle.kinds import PLANE, Vehicle
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Asking, NoAnswer

__all__ = ["WAY_DOWN", "Plane"]

#: what it flies in AUTO where that is no mission any more, in words
WAY_DOWN: Final = "landing sequence"
_MANUAL: Final = 0
_AUTOLAND: Final = 26
_LOITER: Final = 12
_FIRST: Final = 1
_ENDS: Final = (ModeClass.RETURN, ModeClass.LAND)
#: what is stopped, and goes on
_HELD: Final = (ModeClass.MISSION, ModeClass.GUIDED, ModeClass.STOP)
_NEAR_GROUND: Final = (mavlink.MAV_LANDED_STATE_TAKEOFF, mavlink.MAV_LANDED_STATE_LANDING)


@dataclass(frozen=True, slots=True)
class Plane(Procedures):
    """Those of ArduPlane; `aircraft`: what it has said of itself, which is told each message before these are."""

    aircraft: VehicleState

    @property
    def vehicle(self) -> Vehicle:
        """ArduPlane."""
        return PLANE

    @property
    def kind(self) -> Kind:
        """Whether it hovers too."""
        return self.aircraft.kind

    # ---- START --------------------------------------------------------------------------------------------------

    def start(self) -> Asking:
        """AUTO at the mission's first item, then arm: what START means."""
        before = self.aircraft.custom_mode
        yield from self._do("first item", mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, _FIRST)
        yield from self._mode(PLANE.auto)
        try:
            yield from self._do("arming", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            yield from self._shows("arming in AUTO", lambda m: _armed(m) and m.custom_mode == PLANE.auto)
        except NoAnswer as error:
            with suppress(NoAnswer):
                yield from self._leave_auto(_MANUAL if before == PLANE.auto else before)
            if self.aircraft.armed and self.aircraft.in_auto:
                return  # the answer alone was lost
            # why is said behind the answer, and before the answer what is flown in AUTO
            why = self._why if isinstance(error, AutopilotError) else ""
            raise AutopilotError(f"{str(error).partition(':')[0]}{why}") from None

    def call_off_start(self) -> Asking:
        """Leave nothing behind that takes off by whoever arms it next."""
        yield from self._leave_auto(_MANUAL)

    def _leave_auto(self, mode: int) -> Asking:
        """Set that mode in the place of AUTO, where the next heartbeat shows it disarmed."""
        yield from self._shows("heartbeat", lambda _m: True)
        if self.aircraft.in_auto and not self.aircraft.armed:
            yield from self._mode(mode)

    # ---- the stop -----------------------------------------------------------------------------------------------

    def hold(self, pause: bool) -> Asking:
        """Circle where it is, or fly the mission on. Returns what it does."""
        flown, mode = self.aircraft.flown, PLANE.mode_name(self.aircraft.custom_mode)
        if flown not in _HELD:
            raise RefusedError(f"it flies {mode}, which nothing stops and nothing goes on with")
        if pause and self.aircraft.hovers:
            raise RefusedError("it hovers: there is no stop before it flies forwards")
        if pause and self.aircraft.telemetry.landed.state in _NEAR_GROUND:
            raise RefusedError("it takes off or lands: there is no stop so low")
        if pause:
            if flown is not ModeClass.STOP:
                self.aircraft.stop_from(flown)
            yield from self._mode(_LOITER)
        elif flown is ModeClass.STOP:
            if self.aircraft.custom_mode != _LOITER:
                raise RefusedError(f"it flies {mode}, by which a failsafe waits: nothing goes on with it")
            yield from self._mode(PLANE.guided if self.holds_by(pause) is ModeClass.GUIDED else PLANE.auto)
        return PLANE.mode_name(self.aircraft.custom_mode)

    def holds_by(self, pause: bool) -> ModeClass | None:
        """What is flown once that is done."""
        if pause:
            return ModeClass.STOP
        return ModeClass.GUIDED if self.aircraft.stopped_in is ModeClass.GUIDED else ModeClass.MISSION

    # ---- the way home -------------------------------------------------------------------------------------------

    def bring_home(self, action: FlightAction) -> Asking:
        """Return, and land if that cannot be had. Returns the name of what the autopilot flies then."""
        ways = self._ways_to_land()
        if action is FlightAction.RETURN:
            ways = (self._return, *(way for way in ways if way != self._return))
        errors: list[NoAnswer] = []
        for way in ways:
            try:
                return (yield from way())
            except NoAnswer as error:
                errors.append(error)
        raise disobeys(errors)

    def return_anew(self) -> Asking:
        """Leave the return by LOITER and begin it again: it reads its place when it begins. What `bring_home` returns.

        If it does not leave, it returns still.
        """
        with suppress(NoAnswer):
            yield from self._mode(_LOITER)
        return (yield from self.bring_home(FlightAction.RETURN))

    def _ways_to_land(self) -> tuple[Callable[[], Asking], ...]:
        if self.aircraft.kind is Kind.QUADPLANE:
            return (self._land,)
        return self._way_down, self._autoland, self._return

    def _return(self) -> Asking:
        if self._on_way_down:
            return WAY_DOWN
        name = yield from self._set_mode(PLANE.back)
        yield from self._shows(name, lambda _m: self.aircraft.flown in _ENDS)
        return self._flies

    def _land(self) -> Asking:
        yield from self._mode(PLANE.land)
        return self._flies

    def _autoland(self) -> Asking:
        yield from self._mode(_AUTOLAND)
        return self._flies

    def _way_down(self) -> Asking:
        if not self.aircraft.ways_down.is_on:
            yield from self._do(WAY_DOWN, mavlink.MAV_CMD_DO_LAND_START)
            yield from self._shows(WAY_DOWN, lambda _m: self.aircraft.ways_down.may_be)
        self.aircraft.ways_down.lands()
        return WAY_DOWN

    @property
    def _on_way_down(self) -> bool:
        return self.aircraft.in_auto and self.aircraft.flown in _ENDS

    @property
    def _flies(self) -> str:
        return WAY_DOWN if self._on_way_down else PLANE.mode_name(self.aircraft.custom_mode)


def _armed(heartbeat: Any) -> bool:
    return bool(heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
