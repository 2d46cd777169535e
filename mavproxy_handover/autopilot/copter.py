# SPDX-License-Identifier: GPL-3.0-or-later

"""What the companion itself says to ArduCopter: mission and rally points, START, the way home.

Each is an `Asking` (`wire/conversation.py`), and each checks that the autopilot did what it acknowledged: a mission
counts as loaded when it was read back equal, a mode when a heartbeat shows it. Sources: mavlink.io "Mission Protocol"
and "Command Protocol"; ArduCopter's GCS_MAVLink_Copter.cpp for arming and MISSION_START.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.model import FlightAction
from mavproxy_handover.mission.items import MissionItem, RallyPoint, difference
from mavproxy_handover.wire.conversation import Ask, Asking, NoAnswer, command_long
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, MISSION_START

__all__ = [
    "AUTO",
    "COPTER_MODES",
    "GUIDED",
    "LAND",
    "RTL",
    "AutopilotError",
    "Copter",
    "STREAMS",
]

GUIDED, AUTO, RTL, LAND = 4, 3, 6, 9
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
}

_OUT_OF_TURN = mavlink.MAV_MISSION_INVALID_SEQUENCE
#: tries at a mission that the autopilot has no room for, two seconds apart
_PATIENCE = 5
_MISSION, _RALLY = mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_RALLY


class AutopilotError(NoAnswer):
    """The autopilot answered, and the answer is no; the text says what and why."""


class NoRoomError(AutopilotError):
    """The autopilot has no room for a mission of that length, or none yet."""


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

    def hold(self, pause: bool) -> Asking:
        """Stop where it is, or go on. Returns what it does."""
        what = "hold" if pause else "go on"
        yield from self._do(what, mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0 if pause else 1)
        return what

    # ---- mission ------------------------------------------------------------------------------------------------

    def load(self, items: Sequence[MissionItem], rally: Sequence[RallyPoint]) -> Asking:
        """Write mission and rally points, read both back and compare. `items` begins with home, item 0."""
        rally_items = [rally_item(number, point) for number, point in enumerate(rally)]
        yield from self._write_when_ready(items)
        yield from self._write(_RALLY, rally_items)
        yield from self._compare(_MISSION, items)
        yield from self._compare(_RALLY, rally_items)

    def _write_when_ready(self, items: Sequence[MissionItem]) -> Asking:
        """In its first seconds the autopilot has no room for missions and says so: it is asked again a little later."""
        for _ in range(_PATIENCE):
            try:
                yield from self._write(_MISSION, items)
                return
            except NoRoomError:
                with suppress(NoAnswer):
                    yield Ask("time to pass", (), lambda _message: None, timeout_s=2.0, tries=1)
        yield from self._write(_MISSION, items)

    def _write(self, kind: int, items: Sequence[MissionItem]) -> Asking:
        if not items:
            clear = mavlink.MAVLink_mission_clear_all_message(*self._target, kind)
            _accepted((yield Ask("MISSION_CLEAR_ALL", (clear,), _upload_answer(kind))), kind)
            return
        count = mavlink.MAVLink_mission_count_message(*self._target, len(items), kind)
        answer = yield Ask("MISSION_COUNT", (count,), _upload_answer(kind))
        while answer.get_type() != "MISSION_ACK":
            if answer.seq >= len(items):
                raise AutopilotError(f"the autopilot asks for mission item {answer.seq} of {len(items)}")
            message = self._item_message(items[answer.seq], kind)
            answer = yield Ask(f"mission item {answer.seq}", (message,), _upload_answer(kind))
        _accepted(answer, kind)

    def _item_message(self, item: MissionItem, kind: int) -> Any:
        return mavlink.MAVLink_mission_item_int_message(
            *self._target,
            item.seq,
            item.frame,
            item.command,
            0,
            int(item.auto_continue),
            item.param1,
            item.param2,
            item.param3,
            item.param4,
            round(item.lat_deg * 1e7),
            round(item.lon_deg * 1e7),
            item.alt_m,
            kind,
        )

    def _compare(self, kind: int, items: Sequence[MissionItem]) -> Asking:
        request = mavlink.MAVLink_mission_request_list_message(*self._target, kind)
        count = yield Ask("MISSION_REQUEST_LIST", (request,), _of_kind(("MISSION_COUNT",), kind))
        if count.count != len(items):
            raise AutopilotError(f"the autopilot holds {count.count} items of {len(items)} written")
        for item in items:
            ask = mavlink.MAVLink_mission_request_int_message(*self._target, item.seq, kind)
            answer = _of_kind(("MISSION_ITEM_INT",), kind, seq=item.seq)
            held = _held_item((yield Ask(f"mission item {item.seq} back", (ask,), answer)))
            if kind == _MISSION and item.seq == 0:
                continue  # the autopilot keeps its own home
            trouble = _rally_difference(item, held) if kind == _RALLY else difference(item, held)
            if trouble:
                raise AutopilotError(trouble)


def rally_item(number: int, point: RallyPoint) -> MissionItem:
    """A rally point as the mission protocol carries it."""
    return MissionItem(
        number,
        mavlink.MAV_CMD_NAV_RALLY_POINT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        0.0,
        0.0,
        0.0,
        0.0,
        point.lat_deg,
        point.lon_deg,
        point.alt_m,
    )


def _held_item(m: Any) -> MissionItem:
    """A MISSION_ITEM_INT of the autopilot in the units of a plan."""
    frame = _INT_FRAMES.get(m.frame, m.frame)
    lat_deg, lon_deg = m.x / 1e7, m.y / 1e7
    return MissionItem(m.seq, m.command, frame, m.param1, m.param2, m.param3, m.param4, lat_deg, lon_deg, m.z)


def _rally_difference(sent: MissionItem, got: MissionItem) -> str | None:
    """As `mission.items.difference`, for a rally point: ArduPilot keeps its altitude in whole metres."""
    if abs(sent.lat_deg - got.lat_deg) > 1.5e-7 or abs(sent.lon_deg - got.lon_deg) > 1.5e-7:
        return f"rally point {sent.seq} came back at {got.lat_deg:.7f} {got.lon_deg:.7f}"
    if abs(sent.alt_m - got.alt_m) > 1.0:
        return f"rally point {sent.seq}: altitude {sent.alt_m:g} m came back as {got.alt_m:g} m"
    return None


#: frames that differ only in the integer form of their name
_INT_FRAMES = {5: 0, 6: 3, 11: 10}


def _of_kind(types: tuple[str, ...], kind: int, seq: int | None = None) -> Callable[[Any], Any]:
    def answer(m: Any) -> Any:
        if m.get_type() in types and m.mission_type == kind and (seq is None or m.seq == seq):
            return m
        return None

    return answer


def _upload_answer(kind: int) -> Callable[[Any], Any]:
    any_answer = _of_kind(("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"), kind)

    def answer(m: Any) -> Any:
        found = any_answer(m)
        doubled = found is not None and m.get_type() == "MISSION_ACK" and m.type == _OUT_OF_TURN
        return None if doubled else found  # an item that came twice: the upload goes on

    return answer


def _accepted(ack: Any, kind: int) -> None:
    if ack.type != mavlink.MAV_MISSION_ACCEPTED:
        names = mavlink.enums["MAV_MISSION_RESULT"]
        name = names[ack.type].name if ack.type in names else str(ack.type)
        what = "rally points" if kind == _RALLY else "mission"
        error = NoRoomError if ack.type == mavlink.MAV_MISSION_NO_SPACE else AutopilotError
        raise error(f"the autopilot refused the {what}: {name}")


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
