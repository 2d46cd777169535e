# SPDX-License-Identifier: GPL-3.0-or-later

"""What the companion itself says to any autopilot that is flown here: the plan, its telemetry, commands and modes.

What depends on the firmware, START, the stop and the way home, is a class for each: `copter.py`, `plane.py`.

Each is an `Asking` (`wire/conversation.py`), and each checks that the autopilot did what it acknowledged: a mission
counts as loaded when it was read back equal, a mode when a heartbeat shows it. Sources: mavlink.io "Mission Protocol"
and "Command Protocol".
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.cruise import held_cruise, write_cruise
from mavproxy_handover.autopilot.mission_protocol import AutopilotError, MissionProtocol, RefusedError
from mavproxy_handover.core.common.model import FlightAction, Kind, ModeClass
from mavproxy_handover.mission.items import MissionItem, RallyPoint
from mavproxy_handover.mission.plan import FencePart, Route
from mavproxy_handover.vehicle.kinds import Vehicle
from mavproxy_handover.wire.conversation import Ask, Asking, NoAnswer, command_long
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID

__all__ = ["STREAMS", "HeldPlan", "Loaded", "Plan", "Procedures", "disobeys", "heartbeat"]

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

_ARMED: Final = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
#: what was acknowledged shows in a heartbeat by then (s)
_SHOWS_S: Final = 3.0


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
class HeldPlan:
    """What the autopilot holds: its mission, home first, its geofence, and its speed between waypoints (m/s)."""

    items: tuple[MissionItem, ...]
    fence: tuple[FencePart, ...]
    cruise_mps: float


@dataclass(frozen=True, slots=True)
class Procedures(ABC):
    """What there is to ask the autopilot of system `sysid`; `heard` returns its last STATUSTEXT, for reasons."""

    sysid: int
    heard: Callable[[], str]

    @property
    @abstractmethod
    def vehicle(self) -> Vehicle:
        """The firmware that these are for."""

    @property
    def kind(self) -> Kind:
        """The kind of aircraft that these are for."""
        return Kind.COPTER

    @abstractmethod
    def start(self) -> Asking:
        """Arm, then fly the mission: what START means."""

    def call_off_start(self) -> Asking:
        """Behind a START that was called off halfway: leave nothing behind that takes off."""
        yield from ()

    @abstractmethod
    def hold(self, pause: bool) -> Asking:
        """Stop, or go on. Returns what it does."""

    def holds_by(self, pause: bool) -> ModeClass | None:
        """What is flown once that is done; None: it is done within the mode that is flown."""
        return None

    @abstractmethod
    def bring_home(self, action: FlightAction) -> Asking:
        """Return, or land. Returns the name of the mode that the autopilot took."""

    @abstractmethod
    def return_anew(self) -> Asking:
        """Leave a return and begin it again: it reads its place when it begins. What `bring_home` returns."""

    # ---- commands and modes -------------------------------------------------------------------------------------

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

    def _do(self, what: str, command: int, *parameters: float) -> Asking:
        """Send a command; ends when it is accepted, raises RefusedError when it is refused."""
        result = yield Ask(what, (self.command(command, *parameters),), _ack_of(command))
        if result != mavlink.MAV_RESULT_ACCEPTED:
            name = mavlink.enums["MAV_RESULT"][result].name if result in mavlink.enums["MAV_RESULT"] else str(result)
            raise RefusedError(f"{what} refused ({name}){self._why}")

    @property
    def _why(self) -> str:
        """What it has said last, behind a colon."""
        reason = self.heard()
        return f": {reason}" if reason else ""

    def _set_mode(self, mode: int) -> Asking:
        """Have it change the mode."""
        flag = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        name = f"mode {self.vehicle.mode_name(mode)}"
        yield from self._do(name, mavlink.MAV_CMD_DO_SET_MODE, flag, mode)
        return name

    def _mode(self, mode: int) -> Asking:
        """Change the mode and see it in a heartbeat."""
        name = yield from self._set_mode(mode)
        yield from self._shows(name, lambda m: bool(m.custom_mode == mode))

    def _arm(self) -> Asking:
        """Arm, and see it in a heartbeat."""
        yield from self._do("arming", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        yield from self._shows("arming", lambda m: bool(m.base_mode & _ARMED))

    def _shows(self, what: str, shows: Callable[[Any], bool]) -> Asking:
        yield Ask(f"{what} to show", (), heartbeat(shows), timeout_s=_SHOWS_S, tries=1)

    def set_speed(self, speed_mps: float) -> Asking:
        """Fly the mission at that speed until it leaves the mode that flies it."""
        what, command = f"speed {speed_mps:g} m/s", mavlink.MAV_CMD_DO_CHANGE_SPEED
        yield from self._do(what, command, self.vehicle.speed_type, speed_mps, -1)

    # ---- the plan -----------------------------------------------------------------------------------------------

    def load(self, plan: Plan) -> Asking:
        """Write mission, geofence, rally points and cruise speed, read all of them back and compare.

        A plan without a geofence clears none: one that the vehicle has of its own is there to keep the aircraft in, and
        that a file says nothing of it is no reason to let it out. Likewise a plan without a cruise speed. Returns what
        holds now, of the plan or not.
        """
        lists = MissionProtocol(self.sysid, self.kind)
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
            return Loaded(fence, (yield from held_cruise(self.sysid, self.vehicle)))
        yield from write_cruise(self.sysid, plan.cruise_mps, self.vehicle)
        return Loaded(fence, plan.cruise_mps)

    def holds(self, route: Route) -> Asking:
        """See that the autopilot holds the mission of a route, and its geofence if it has one. Raises AutopilotError
        where it holds another one."""
        lists = MissionProtocol(self.sysid, self.kind)
        yield from lists.compare_mission(route.upload_items())
        if route.fence:
            yield from lists.compare_fence(route.fence)

    def held_mission(self) -> Asking:
        """Returns the items of the mission that the autopilot holds, its home first. Raises AutopilotError."""
        return (yield from MissionProtocol(self.sysid, self.kind).held_mission())

    def held_plan(self) -> Asking:
        """Returns the `HeldPlan`: what a station wrote. Raises AutopilotError."""
        lists = MissionProtocol(self.sysid, self.kind)
        items = yield from lists.held_mission()
        fence = yield from lists.held_fence()
        return HeldPlan(items, fence, (yield from held_cruise(self.sysid, self.vehicle)))

    def replace_mission(self, items: tuple[MissionItem, ...]) -> Asking:
        """Write another mission in flight and read it back; `items` begins with home. Raises AutopilotError."""
        lists = MissionProtocol(self.sysid, self.kind)
        yield from lists.write_mission(items)
        yield from lists.compare_mission(items)

    def holds_another(self, items: tuple[MissionItem, ...]) -> Asking:
        """Whether the mission that the autopilot holds is another one than these items; `items` begins with home."""
        try:
            yield from MissionProtocol(self.sysid, self.kind).compare_mission(items)
        except AutopilotError:
            return True
        return False


def disobeys(errors: Sequence[NoAnswer]) -> AutopilotError:
    """What is raised where one way after the other has come to nothing: a refusal where each was refused."""
    refused = all(isinstance(error, RefusedError) for error in errors)
    return (RefusedError if refused else AutopilotError)(f"the autopilot does not obey: {errors[-1]}")


def _ack_of(command: int) -> Callable[[Any], Any]:
    def answer(m: Any) -> Any:
        if m.get_type() != "COMMAND_ACK" or m.command != command or m.result == mavlink.MAV_RESULT_IN_PROGRESS:
            return None
        return m.result

    return answer


def heartbeat(shows: Callable[[Any], bool]) -> Callable[[Any], Any]:
    """The answer that is a heartbeat which shows it."""

    def answer(m: Any) -> Any:
        return True if m.get_type() == "HEARTBEAT" and shows(m) else None

    return answer
