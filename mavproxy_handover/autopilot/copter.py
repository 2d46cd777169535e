# SPDX-License-Identifier: GPL-3.0-or-later

"""What the companion itself says to ArduCopter: the plan, START, the way home.

Each is an `Asking` (`wire/conversation.py`), and each checks that the autopilot did what it acknowledged: a mission
counts as loaded when it was read back equal, a mode when a heartbeat shows it. Sources: mavlink.io "Mission Protocol"
and "Command Protocol"; ArduCopter's GCS_MAVLink_Copter.cpp for arming and MISSION_START.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.cruise import held_cruise, write_cruise
from mavproxy_handover.autopilot.mission_protocol import AutopilotError, MissionProtocol
from mavproxy_handover.core.model import FlightAction
from mavproxy_handover.mission.items import MissionItem, RallyPoint
from mavproxy_handover.mission.plan import FencePart
from mavproxy_handover.wire.conversation import Ask, Asking, NoAnswer, command_long
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COPTER_AUTO, MISSION_START

__all__ = [
    "AUTO",
    "COPTER_MODES",
    "GUIDED",
    "LAND",
    "RTL",
    "AutopilotError",
    "Copter",
    "Loaded",
    "Plan",
    "STREAMS",
]

GUIDED, AUTO, RTL, LAND = 4, COPTER_AUTO, 6, 9
COPTER_MODES = {
    0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 7: "CIRCLE", 9: "LAND",
    16: "POSHOLD", 17: "BRAKE", 20: "GUIDED_NOGPS", 21: "SMART_RTL", 27: "AUTO_RTL",
}  # fmt: skip

#: message id -> interval (s) that the companion asks the autopilot for; position at 20 Hz is the zone check's rate
STREAMS: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 0.05,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 0.25,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 0.25,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: 0.5,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 0.5,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 0.5,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_WIND: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 0.5,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_FENCE_STATUS: 1.0,
}

_GROUND_SPEED = 1


@dataclass(frozen=True, slots=True)
class Plan:
    """All that a mission package has the autopilot hold."""

    #: begins with home, item 0
    items: tuple[MissionItem, ...]
    rally: tuple[RallyPoint, ...] = ()
    fence: tuple[FencePart, ...] = ()
    #: horizontal speed of the mission (m/s); None: the plan names none
    cruise_mps: float | None = None


@dataclass(frozen=True, slots=True)
class Loaded:
    """What holds once a plan is loaded: the geofence, and the horizontal speed of the mission (m/s)."""

    fence: tuple[FencePart, ...]
    cruise_mps: float


@dataclass(frozen=True, slots=True)
class Copter:
    """What there is to ask the autopilot of system `sysid`; `heard` returns its last STATUSTEXT, for reasons, `foreign`
    what it is, in words, if that is no ArduCopter."""

    sysid: int
    heard: Callable[[], str]
    foreign: Callable[[], str] = str

    @property
    def _target(self) -> tuple[int, int]:
        return self.sysid, AUTOPILOT_COMPID

    def command(self, command: int, *parameters: float) -> Any:
        """COMMAND_LONG to the autopilot."""
        return command_long(self._target, command, *parameters)

    def stream_requests(self) -> list[Any]:
        """Messages that ask for everything in STREAMS."""
        command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        return [self.command(command, msgid, interval_s * 1e6) for msgid, interval_s in STREAMS.items()]

    # ---- commands and modes -------------------------------------------------------------------------------------

    def _do(self, what: str, command: int, *parameters: float) -> Asking:
        """Send a command; ends when it is accepted, raises AutopilotError when it is refused."""
        result = yield Ask(what, (self.command(command, *parameters),), _ack_of(command))
        if result != mavlink.MAV_RESULT_ACCEPTED:
            name = mavlink.enums["MAV_RESULT"][result].name if result in mavlink.enums["MAV_RESULT"] else str(result)
            reason = self.heard()
            raise AutopilotError(f"{what} refused ({name}){': ' + reason if reason else ''}")

    def _mode(self, mode: int) -> Asking:
        """Change the mode and see it in a heartbeat."""
        name = COPTER_MODES[mode]
        flag = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        yield from self._do(f"mode {name}", mavlink.MAV_CMD_DO_SET_MODE, flag, mode)
        yield Ask(f"mode {name} to show", (), _heartbeat(lambda m: m.custom_mode == mode), timeout_s=3.0, tries=1)

    def start(self) -> Asking:
        """Arm in GUIDED, then fly the mission in AUTO: what START means."""
        yield from self._mode(GUIDED)
        yield from self._do("arming", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        yield Ask("arming to show", (), _heartbeat(lambda m: bool(m.base_mode & armed)), timeout_s=3.0, tries=1)
        yield from self._do("MISSION_START", MISSION_START)
        yield Ask("mode AUTO to show", (), _heartbeat(lambda m: m.custom_mode == AUTO), timeout_s=3.0, tries=1)

    def set_speed(self, speed_mps: float) -> Asking:
        """Fly the mission at that speed over ground until it leaves AUTO."""
        yield from self._do(f"speed {speed_mps:g} m/s", mavlink.MAV_CMD_DO_CHANGE_SPEED, _GROUND_SPEED, speed_mps, -1)

    def bring_home(self, action: FlightAction) -> Asking:
        """RTL, and LAND if that cannot be had. Returns the name of the mode that the autopilot took.

        What is no ArduCopter is never told a number of a mode, which means another one there (6 is FBWB for a plane).
        """
        if self.foreign():
            yield from self._do("return to launch", mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
            return "return to launch"
        wanted = (RTL, LAND) if action is FlightAction.RETURN else (LAND,)
        trouble = ""
        for mode in wanted:
            try:
                yield from self._mode(mode)
                return COPTER_MODES[mode]
            except NoAnswer as error:
                trouble = str(error)
        raise AutopilotError(f"the autopilot does not obey: {trouble}")

    def return_anew(self) -> Asking:
        """Leave RTL and begin it again, at a full stop: it reads its place when it begins. What `bring_home` returns.

        If it does not leave, it is in RTL still.
        """
        with suppress(NoAnswer):
            yield from self._mode(GUIDED)
        return (yield from self.bring_home(FlightAction.RETURN))

    def hold(self, pause: bool) -> Asking:
        """Stop where it is, or go on. Returns what it does."""
        what = "hold" if pause else "go on"
        yield from self._do(what, mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0 if pause else 1)
        return what

    # ---- the plan -----------------------------------------------------------------------------------------------

    def load(self, plan: Plan) -> Asking:
        """Write mission, geofence, rally points and cruise speed, read all of them back and compare.

        A plan without a geofence clears none: one that the vehicle has of its own is there to keep the aircraft in, and
        that a file says nothing of it is no reason to let it out. Likewise a plan without a cruise speed. Returns what
        holds now, of the plan or not.
        """
        lists = MissionProtocol(self.sysid)
        yield from lists.write_mission(plan.items)
        if plan.fence:
            yield from lists.write_fence(plan.fence)
        yield from lists.write_rally(plan.rally)
        yield from lists.compare_mission(plan.items)
        if plan.fence:
            yield from lists.compare_fence(plan.fence)
        yield from lists.compare_rally(plan.rally)
        fence = plan.fence or (yield from lists.held_fence())
        if plan.cruise_mps is None:
            return Loaded(fence, (yield from held_cruise(self.sysid)))
        yield from write_cruise(self.sysid, plan.cruise_mps)
        return Loaded(fence, plan.cruise_mps)

    def replace_mission(self, items: tuple[MissionItem, ...]) -> Asking:
        """Write another mission in flight and read it back; `items` begins with home. Raises AutopilotError."""
        lists = MissionProtocol(self.sysid)
        yield from lists.write_mission(items)
        yield from lists.compare_mission(items)

    def holds_another(self, items: tuple[MissionItem, ...]) -> Asking:
        """Whether the mission that the autopilot holds is another one than these items; `items` begins with home."""
        try:
            yield from MissionProtocol(self.sysid).compare_mission(items)
        except AutopilotError:
            return True
        return False


def _ack_of(command: int) -> Callable[[Any], Any]:
    def answer(m: Any) -> Any:
        if m.get_type() != "COMMAND_ACK" or m.command != command or m.result == mavlink.MAV_RESULT_IN_PROGRESS:
            return None
        return m.result

    return answer


def _heartbeat(shows: Callable[[Any], bool]) -> Callable[[Any], Any]:
    def answer(m: Any) -> Any:
        return True if m.get_type() == "HEARTBEAT" and shows(m) else None

    return answer
