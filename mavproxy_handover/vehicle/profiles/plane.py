# SPDX-License-Identifier: GPL-3.0-or-later

"""The profile of a plane without rotors: ArduPlane. `quadplane.py` has the one that also hovers.

What the companion says to ArduPlane for START, hold, return and landing:

* START is the mode AUTO first, and then arming: a plane is armed in the mode that it takes off in, and its mission
  begins with the take-off. A mission that was flown before is at its end still where it ended in AUTO, so it is set to
  its first item. If it does not arm, refused, unanswered or called off, the mode of before is set again: AUTO would
  take off at the next arming. Unless a heartbeat shows it armed, or none comes: it may be in the air.
* There is no DO_PAUSE_CONTINUE. It stops by LOITER, a circle around where it is, and goes on by AUTO, which takes up
  the item that was flown (MIS_RESTART 0); where it was stopped in GUIDED by that, which circles where it begins and
  waits for its commander: the mission was not ordered. While it hovers there is no stop: QLOITER sinks half a metre
  a second without a radio (`get_pilot_desired_climb_rate_cms`), and with one it does what the throttle stick says,
  wherever that was left; LOITER flies off forwards from a take-off or a landing. A return is not stopped either, and
  a mode flown by hand is not.
* To return is RTL. It may show as QRTL (Q_RTL_MODE), as QLAND (during a guided take-off), or, where it goes on to the
  landing at once (RTL_AUTOLAND 2), as AUTO on a way down (`vehicle/plane_landing.py`).
* To land now is QLAND with rotors. Without it is, of what can be had, the mission's nearest way down (DO_LAND_START),
  AUTOLAND (from 4.7, with the direction of the take-off), RTL. One that is on a way down already stays there, be it its
  mission that has led it there: ordered again, it would go around, out of its last metres too, and begin it again.

ArduPlane reports the MAV_TYPE FIXED_WING, hovering or not, unless Q_MAV_TYPE names another type, be it a copter's. But
it also reports when it flies on its wings (EXTENDED_SYS_STATE), which no copter does. Q_MAV_TYPE is read before START.

Sources: ArduPlane's mode.h, events.cpp, system.cpp, ekf_check.cpp, fence.cpp, commands_logic.cpp, quadplane.cpp
(`get_mav_type`), GCS_MAVLink_Plane.cpp, AP_Arming_Plane.cpp, mode_auto.cpp, mode_rtl.cpp, mode_qloiter.cpp and
mode_autoland.cpp; AP_Mission (`jump_to_landing_sequence`).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.handling import CIRCLES, Follow, Handling
from mavproxy_handover.core.common.model import FlightAction, ModeClass
from mavproxy_handover.core.safety.energy_prior import ON_WINGS
from mavproxy_handover.vehicle.profiles.procedures import FlightProcedures
from mavproxy_handover.vehicle.profiles.profile import (
    READ_OF_EVERY,
    SWITCHED,
    GuardRow,
    Modes,
    Profile,
    RuleGroup,
    mode_names,
    modes_of,
)
from mavproxy_handover.wire.conversation import Asking, AutopilotError, NoAnswer, RefusedError

__all__ = ["PLANE", "WAY_DOWN", "PlaneProcedures"]

#: what it flies in AUTO where that is no mission any more, in words
WAY_DOWN: Final = "landing sequence"
_MANUAL: Final = 0
_AUTOLAND: Final = 26
_LOITER: Final = 12
_FIRST: Final = 1
_ENDS: Final = (ModeClass.RETURN, ModeClass.LAND)
#: what is stopped, and goes on
_HELD: Final = (ModeClass.MISSION, ModeClass.GUIDED, ModeClass.STOP)
_AUTO, _TAKEOFF = 10, 13
#: the auxiliary switches of these two (RCn_OPTION)
_AUTO_SWITCH, _TAKEOFF_SWITCH = 16, 77
#: MAV_VTOL_STATEs that a copter never reports: it reports MC all the time
_ON_WINGS: Final = frozenset(
    (
        mavlink.MAV_VTOL_STATE_TRANSITION_TO_FW,
        mavlink.MAV_VTOL_STATE_TRANSITION_TO_MC,
        mavlink.MAV_VTOL_STATE_FW,
    )
)
_BOTH: Final = "it takes an aircraft that hovers and has wings"
#: the landing sequence is flown in this mode, also where RTL goes on to it (RTL_AUTOLAND)
_LANDS_BY: Final = frozenset({_AUTO})
_LANDS_IN: Final = frozenset({ModeClass.LAND, ModeClass.MISSION, ModeClass.RETURN})
_OUTLASTS: Final = "which also applies to a return"


@dataclass(frozen=True, slots=True)
class PlaneProcedures(FlightProcedures):
    """Those of ArduPlane."""

    @property
    def firmware(self) -> Profile:
        """ArduPlane."""
        return PLANE

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
            # the reason comes after the answer; the text before it is about AUTO
            why = self._why if isinstance(error, AutopilotError) else ""
            raise AutopilotError(f"{str(error).partition(':')[0]}{why}") from None

    def call_off_start(self) -> Asking:
        """Leave AUTO, so that the next arming does not take off."""
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
        if pause and self.aircraft.near_ground:
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
        return (yield from self._first_of(ways, _LANDS_BY))

    def return_anew(self) -> Asking:
        """Leave the return by LOITER and begin it again: it reads its place when it begins. What `bring_home` returns.

        If it does not leave, it returns still.
        """
        with suppress(NoAnswer):
            yield from self._mode(_LOITER)
        return (yield from self.bring_home(FlightAction.RETURN))

    def _ways_to_land(self) -> tuple[Callable[[], Asking], ...]:
        return self._way_down, self._autoland, self._return

    def _return(self) -> Asking:
        if self._on_way_down:
            return WAY_DOWN
        name = yield from self._set_mode(PLANE.back)
        yield from self._shows(name, lambda _m: self.aircraft.flown in _ENDS)
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


PLANE: Final = Profile(
    name="plane",
    firmware="ArduPlane",
    types=frozenset(
        {
            mavlink.MAV_TYPE_FIXED_WING,
            *range(mavlink.MAV_TYPE_VTOL_DUOROTOR, mavlink.MAV_TYPE_VTOL_RESERVED5 + 1),
        }
    ),
    modes=modes_of(
        {
            ModeClass.HANDS: {
                _MANUAL: "MANUAL", 2: "STABILIZE", 3: "TRAINING", 4: "ACRO", 5: "FBWA", 6: "FBWB", 7: "CRUISE",
                8: "AUTOTUNE", 17: "QSTABILIZE", 18: "QHOVER", 19: "QLOITER", 22: "QAUTOTUNE", 23: "QACRO",
            },
            ModeClass.MISSION: {_AUTO: "AUTO"},
            ModeClass.GUIDED: {15: "GUIDED"},
            # CIRCLE is what the short radio failsafe chooses: it waits there for the long one
            ModeClass.STOP: {1: "CIRCLE", _LOITER: "LOITER"},
            ModeClass.RETURN: {11: "RTL", 21: "QRTL"},
            ModeClass.LAND: {20: "QLAND", 25: "LOITER_ALT_QLAND", _AUTOLAND: "AUTOLAND"},
            ModeClass.OTHER: {_TAKEOFF: "TAKEOFF", 14: "AVOID_ADSB", 16: "INITIALISING", 24: "THERMAL"},
        }
    ),
    # a dialect may not have the newest mode yet
    gate=Modes(
        {_AUTOLAND: "AUTOLAND", **mode_names("PLANE_MODE")},
        _AUTO,
        (_AUTO, _TAKEOFF),
        (_AUTO_SWITCH, _TAKEOFF_SWITCH),
        takes_heights=True,
        takes_velocities=False,
        speed_type_bits=True,
    ),
    auto=_AUTO,
    guided=15,
    back=11,
    land=20,
    to_place=frozenset({11, 21}),
    # "GCS Failsafe On: RTL", "RC Long Failsafe On: RTL", "RC Short Failsafe: switched to CIRCLE"; up to 4.5 "Failsafe.
    # Long event on: ..."; a battery's is told by what is wrong with it alone; a take-off or transition that fails
    # becomes QLAND
    by_itself=re.compile(
        r"\bFailsafe\b(?!.*([Cc]leared|\b[Oo]ff\b))|\b[Bb]reached$|^Battery \d+ is |^Throttle failsafe on|^EKF variance"
        r"|^Aircraft in auto without|^Failed to complete takeoff|^Transition failed"
    ),
    starts_by="AUTO, arm",
    carried_out={
        FlightAction.HOLD: "circles, in LOITER",
        FlightAction.CONTINUE: "flies on, in AUTO",
        FlightAction.RETURN: "RTL to the return site, and down by the landing sequence there",
        FlightAction.LAND: "the next landing sequence: it cannot come down where it is",
    },
    # its landing sequence is a part of a mission, or waits at the end of a return
    handling=Handling(
        {**CIRCLES.shows, FlightAction.LAND: Follow(_LANDS_IN, "")}, CIRCLES.by_mode, CIRCLES.at_place_m
    ),
    procedures=PlaneProcedures,
    energy=ON_WINGS,
    guard=GuardRow(
        firmware_type=3,
        # MANUAL STABILIZE TRAINING ACRO FBWA FBWB CRUISE AUTOTUNE QSTABILIZE QHOVER QLOITER QAUTOTUNE QACRO
        manual=frozenset({0, 2, 3, 4, 5, 6, 7, 8, 17, 18, 19, 22, 23}),
        # RC switch, RC telemetry, RC auxiliary switch
        pilots=frozenset({1, 42, 53}),
        # as a copter's, and VTOL transition failed, VTOL take-off failed, radio or GCS lost in the mode TAKEOFF
        failsafes=frozenset({3, 4, 5, 6, 7, 10, 11, 14, 17, 19, 23, 24, 25, 50, 51}),
        commands={2: "command", 32: "script", 52: "DDS command"},
        ladder={1: (11, 11), 2: (11, 11), 3: (11, 11)},
        hover={1: (21, 21, 21, 20), 2: (21, 21, 21, 20), 3: (20,)},
        # battery, RTL that has arrived (RTL_AUTOLAND)
        sequences=frozenset({4, 40}),
        # fence, radio
        resumed=frozenset({43, 48}),
        lacks=frozenset({2}),
        guesses=True,
    ),
    restored=re.compile(r"^Flight mode (\w+) restored"),
    # after its last item, and at an item that returns
    by_mission=re.compile(r"^Mission complete, changing mode|^Mission: \d+ RTL$"),
    commands={
        mavlink.MAV_CMD_NAV_LOITER_UNLIM: ModeClass.STOP,
        mavlink.MAV_CMD_DO_LAND_START: ModeClass.LAND,
        mavlink.MAV_CMD_DO_VTOL_TRANSITION: None,
    },
    refined_by="Q_ENABLE",
    proven_by=_ON_WINGS,
    hovers_in=frozenset((mavlink.MAV_VTOL_STATE_TRANSITION_TO_MC, mavlink.MAV_VTOL_STATE_MC)),
    holds_by_circling=True,
    flies_past=True,
    vertical=False,
    lands_by_sequence=True,
    lands_in_auto=True,
    returns_level=True,
    return_takes_speed=False,
    takes_vertical_speed=False,
    guided_passes_ceiling=True,
    may_be_always_armed=True,
    lasting_speeds={mavlink.SPEED_TYPE_GROUNDSPEED: f"it would set MIN_GROUNDSPEED, {_OUTLASTS}"},
    lasting_throttle=f"it would set TRIM_THROTTLE, {_OUTLASTS}",
    takeoff_needs_place=True,
    not_flown={
        mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT: "ArduPlane does not store it",
        mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: _BOTH,
        mavlink.MAV_CMD_NAV_VTOL_LAND: _BOTH,
        mavlink.MAV_CMD_NAV_PAYLOAD_PLACE: "ArduPlane lands there, and need not go on after it",
        mavlink.MAV_CMD_CONDITION_YAW: "ArduPlane passes over it",
        mavlink.MAV_CMD_DO_WINCH: "ArduPlane passes over it",
        mavlink.MAV_CMD_DO_RETURN_PATH_START: "the return that joins its path is not walked",
        mavlink.MAV_CMD_DO_VTOL_TRANSITION: _BOTH,
    },
    # it waits while it is disarmed, and passes over it otherwise
    not_in_air={mavlink.MAV_CMD_NAV_DELAY: "ArduPlane does not wait in flight: take NAV_LOITER_TIME"},
    stores={mavlink.MAV_CMD_NAV_WAYPOINT: "-yy-"},
    item_ranges={
        (mavlink.MAV_CMD_NAV_WAYPOINT, 2): (0, 255, "0 to 255 m"),
        (mavlink.MAV_CMD_NAV_WAYPOINT, 3): (0, 255, "0 to 255 m"),
        (mavlink.MAV_CMD_NAV_DELAY, 1): (0, 65535, "0 to 65535 s"),
        (mavlink.MAV_CMD_NAV_LOITER_TURNS, 1): (1 / 256, 255, "more than 0, up to 255 turns"),
        (mavlink.MAV_CMD_NAV_LOITER_TURNS, 3): (-2550, 2550, "a radius up to 2550 m, below 0 to the left"),
        (mavlink.MAV_CMD_DO_CHANGE_SPEED, 1): (
            0, 0, "0, airspeed. 1 would set MIN_GROUNDSPEED, also for later flights, until the autopilot restarts"
        ),
        (mavlink.MAV_CMD_DO_CHANGE_SPEED, 2): (1, 100, "1 to 100 m/s"),
        (mavlink.MAV_CMD_NAV_VTOL_LAND, 1): (0, 1, "0, or 1 for a circle down before it"),
        (mavlink.MAV_CMD_DO_VTOL_TRANSITION, 1): (3, 4, "3 to hover, 4 to fly on its wings"),
    },
    speed_type=mavlink.SPEED_TYPE_AIRSPEED,
    cruise={"TRIM_ARSPD_CM": 100.0, "AIRSPEED_CRUISE": 1.0},
    slowest={"ARSPD_FBW_MIN": 1.0, "AIRSPEED_MIN": 1.0},
    fastest={"ARSPD_FBW_MAX": 1.0, "AIRSPEED_MAX": 1.0},
    return_alt={"RTL_ALTITUDE": 1.0, "ALT_HOLD_RTL": 100.0},
    radio_failsafe="THR_FAILSAFE",
    gcs_failsafe="FS_GCS_ENABL",
    gcs_timeout="FS_LONG_TIMEOUT",
    gcs_failsafe_lacks={3: "it acts only in AUTO, and nothing brings the aircraft home from LOITER or GUIDED"},
    reads=(
        *READ_OF_EVERY, "FS_GCS_ENABL", "FS_LONG_TIMEOUT", "RALLY_LIMIT_KM",
        "SYSID_ENFORCE", "MAV_OPTIONS", "THR_FAILSAFE", "RC_PROTOCOLS", "SCR_VM_I_COUNT", "SCR_LD_CHECKSUM",
        "ARMING_CHECK", "ARMING_SKIPCHK", "ARMING_REQUIRE", "WP_LOITER_RAD", "RTL_RADIUS",
        *SWITCHED,
        "BATT_MONITOR", "BATT_FS_LOW_ACT", "BATT_FS_CRT_ACT", "BATT_LOW_VOLT", "BATT_LOW_MAH",
        "FENCE_ENABLE", "FENCE_AUTOENABLE", "FENCE_TYPE", "FENCE_ACTION", "FENCE_OPTIONS", "FENCE_RADIUS",
        "FENCE_ALT_MAX",
        "RTL_ALTITUDE", "ALT_HOLD_RTL", "RALLY_INCL_HOME", "HNDO_ACTION", "MIS_RESTART", "GRIP_ENABLE",
        "FS_SHORT_ACTN", "FS_LONG_ACTN", "RTL_AUTOLAND", "RTL_CLIMB_MIN", "FLIGHT_OPTIONS", "TERRAIN_FOLLOW",
        "DID_ENABLE", "DID_MAVPORT", "DID_CANDRIVER", "DID_OPTIONS",
        "Q_ENABLE", "Q_RTL_MODE", "Q_RTL_ALT", "Q_OPTIONS", "TERRAIN_ENABLE", "TRIM_ARSPD_CM", "AIRSPEED_CRUISE",
    ),
    rules=frozenset((RuleGroup.EVERY, RuleGroup.ARDUPLANE)),
    parameter_file="handover_plane.parm",
    parameter_file_for="with wings",
)  # fmt: skip
