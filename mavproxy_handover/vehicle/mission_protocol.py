# SPDX-License-Identifier: GPL-3.0-or-later

"""Mission, geofence and rally points, written to the autopilot and read back: three lists, one protocol.

A list counts as written when it was read back equal. ArduCopter changes the lists. It keeps its own home as item 0 of
the mission. It keeps altitudes of rally points in whole metres, and neither altitude nor frame of a fence. It replaces
a fence only by a complete and valid one, and stores the other two lists item by item.

Sources: mavlink.io, "Mission Protocol" and "Geofence/Rally"; ArduPilot's MissionItemProtocol*.cpp.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.items import FRAME_ABOVE_SEA, MissionItem, RallyPoint, difference
from mavproxy_handover.mission.plan import FenceCircle, FencePart, FencePolygon
from mavproxy_handover.mission.protocol_items import filled, item_message, item_of
from mavproxy_handover.vehicle.profiles import ASSUMED, Profile
from mavproxy_handover.wire.conversation import Ask, Asking, AutopilotError, NoAnswer
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID

__all__ = [
    "LOADING",
    "MissionProtocol",
    "NoRoomError",
    "fence_items",
    "fence_parts",
    "rally_items",
    "same_fence",
]

#: name of the conversation that writes a whole plan, the three lists
LOADING: Final = "load"
_MISSION, _FENCE, _RALLY = (
    mavlink.MAV_MISSION_TYPE_MISSION,
    mavlink.MAV_MISSION_TYPE_FENCE,
    mavlink.MAV_MISSION_TYPE_RALLY,
)
_WORDS: Final = {_MISSION: "mission", _FENCE: "geofence", _RALLY: "rally points"}
_OUT_OF_TURN = mavlink.MAV_MISSION_INVALID_SEQUENCE
#: tries at a mission that the autopilot has no room for, two seconds apart
_PATIENCE: Final = 5
#: number of items that are requested at once when a list is read
_AT_ONCE: Final = 5
#: tries without a new item before the reading fails
_IN_VAIN: Final = 5


class NoRoomError(AutopilotError):
    """The autopilot has no room for a list of that length, or none yet."""


@dataclass(frozen=True, slots=True)
class MissionProtocol:
    """Conversations with the autopilot of system `sysid` about its lists. All of them raise AutopilotError."""

    sysid: int
    #: of aircraft: what it stores of an item
    profile: Profile = ASSUMED

    def write_mission(self, items: Sequence[MissionItem]) -> Asking:
        """Write a mission; `items` begins with home, item 0.

        In its first seconds the autopilot refuses missions for lack of room; then the write is tried again later.
        """
        for _ in range(_PATIENCE):
            try:
                yield from self._write(_MISSION, items)
                return
            except NoRoomError:
                with suppress(NoAnswer):
                    yield Ask("time to pass", (), lambda _message: None, timeout_s=2.0, tries=1)
        yield from self._write(_MISSION, items)

    def write_fence(self, parts: Sequence[FencePart]) -> Asking:
        """Write a geofence of at least one part."""
        yield from self._write(_FENCE, fence_items(parts))

    def write_rally(self, points: Sequence[RallyPoint]) -> Asking:
        """Write rally points; empty: clear the autopilot's rally points."""
        yield from self._write(_RALLY, rally_items(points))

    def compare_mission(self, items: Sequence[MissionItem]) -> Asking:
        """Read the mission back; raises AutopilotError if it differs."""
        yield from self._compare(_MISSION, items, self._mission_difference)

    def compare_fence(self, parts: Sequence[FencePart]) -> Asking:
        """Read the geofence back; raises AutopilotError if it differs."""
        yield from self._compare(_FENCE, fence_items(parts), _fence_difference)

    def compare_rally(self, points: Sequence[RallyPoint]) -> Asking:
        """Read the rally points back; raises AutopilotError if they differ."""
        yield from self._compare(_RALLY, rally_items(points), _rally_difference)

    def held_fence(self) -> Asking:
        """Returns the parts of the autopilot's geofence; empty if the autopilot has no geofences."""
        count = yield self._list_request(_FENCE, ("MISSION_COUNT", "MISSION_ACK"))
        if count.get_type() == "MISSION_ACK":
            return ()
        return fence_parts((yield from self._items_back(_FENCE, count.count)))

    def held_mission(self) -> Asking:
        """Returns the items of the autopilot's mission, home first; empty if it holds no mission."""
        count = yield self._list_request(_MISSION, ("MISSION_COUNT", "MISSION_ACK"))
        if count.get_type() == "MISSION_ACK":
            raise AutopilotError("the autopilot does not send its mission now")
        items = yield from self._items_back(_MISSION, count.count)
        return tuple(filled(item) for item in items)

    def held_rally(self) -> Asking:
        """Returns the autopilot's rally point; None if it holds none, or more than one."""
        count = yield self._list_request(_RALLY, ("MISSION_COUNT", "MISSION_ACK"))
        if count.get_type() == "MISSION_ACK":
            raise AutopilotError("the autopilot does not send its rally points now")
        if count.count != 1:
            return None
        item = yield from self._item_back(_RALLY, 0)
        return RallyPoint(item.lat_deg, item.lon_deg, item.alt_m)

    def home(self) -> Asking:
        """Returns latitude and longitude of the autopilot's home, which is item 0 of its mission."""
        item = yield from self._item_back(_MISSION, 0)
        return item.lat_deg, item.lon_deg

    # ---- the steps ------------------------------------------------------------------------------------------------

    @property
    def _target(self) -> tuple[int, int]:
        return self.sysid, AUTOPILOT_COMPID

    def _write(self, kind: int, items: Sequence[MissionItem]) -> Asking:
        if not items:
            clear = mavlink.MAVLink_mission_clear_all_message(*self._target, kind)
            _accepted((yield Ask("MISSION_CLEAR_ALL", (clear,), _upload_answer(kind))), kind)
            return
        count = mavlink.MAVLink_mission_count_message(*self._target, len(items), kind)
        answer = yield Ask("MISSION_COUNT", (count,), _upload_answer(kind))
        while answer.get_type() != "MISSION_ACK":
            if answer.seq >= len(items):
                raise AutopilotError(f"the autopilot asks for {_WORDS[kind]} item {answer.seq} of {len(items)}")
            message = item_message(items[answer.seq], self._target, kind)
            answer = yield Ask(f"{_WORDS[kind]} item {answer.seq}", (message,), _upload_answer(kind))
        _accepted(answer, kind)

    def _mission_difference(self, sent: MissionItem, got: MissionItem) -> str | None:
        return None if sent.seq == 0 else difference(sent, got, self.profile)  # the autopilot keeps its own home

    def _compare(
        self, kind: int, items: Sequence[MissionItem], differs: Callable[[MissionItem, MissionItem], str | None]
    ) -> Asking:
        count = yield self._list_request(kind, ("MISSION_COUNT",))
        if count.count != len(items):
            raise AutopilotError(f"the autopilot holds {count.count} {_WORDS[kind]} items of {len(items)} written")
        for sent, got in zip(items, (yield from self._items_back(kind, len(items))), strict=True):
            trouble = differs(sent, got)
            if trouble:
                raise AutopilotError(trouble)

    def _list_request(self, kind: int, answers: tuple[str, ...]) -> Ask:
        request = mavlink.MAVLink_mission_request_list_message(*self._target, kind)
        return Ask(f"MISSION_REQUEST_LIST ({_WORDS[kind]})", (request,), _of_kind(answers, kind))

    def _item_back(self, kind: int, seq: int) -> Asking:
        m = yield Ask(
            _back(kind, seq), (self._item_request(kind, seq),), _of_kind(("MISSION_ITEM_INT",), kind, seq=seq)
        )
        return item_of(m)

    def _item_request(self, kind: int, seq: int) -> Any:
        return mavlink.MAVLink_mission_request_int_message(*self._target, seq, kind)

    def _items_back(self, kind: int, count: int) -> Asking:
        """Returns the first `count` items of a list. It requests several at once, and again only the missing ones."""
        got: dict[int, MissionItem] = {}
        in_vain = 0
        while len(got) < count:
            lacking = [seq for seq in range(count) if seq not in got][:_AT_ONCE]
            known = len(got)
            requests = tuple(self._item_request(kind, seq) for seq in lacking)
            try:
                yield Ask(_back(kind, lacking[0]), requests, _gathers(kind, lacking, got), tries=1)
            except NoAnswer:
                in_vain = in_vain + 1 if len(got) == known else 0
                if in_vain >= _IN_VAIN:
                    raise
        return tuple(got[seq] for seq in range(count))


# ---- the lists as items -------------------------------------------------------------------------------------------


def rally_items(points: Sequence[RallyPoint]) -> tuple[MissionItem, ...]:
    """Rally points as the protocol carries them."""
    command, frame = mavlink.MAV_CMD_NAV_RALLY_POINT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    return tuple(
        MissionItem(number, command, frame, 0.0, 0.0, 0.0, 0.0, point.lat_deg, point.lon_deg, point.alt_m)
        for number, point in enumerate(points)
    )


#: (is a polygon, is an inclusion) -> command; parameter 1 is the number of corners, or the radius in metres
_FENCE_COMMANDS: Final = {
    (True, True): mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    (True, False): mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    (False, True): mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
    (False, False): mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
}
_FENCE_KINDS: Final = {command: kind for kind, command in _FENCE_COMMANDS.items()}


def fence_items(parts: Sequence[FencePart]) -> tuple[MissionItem, ...]:
    """A geofence as the protocol carries it: an item for each corner of a polygon, one for a circle."""
    items: list[MissionItem] = []
    for part in parts:
        polygon = isinstance(part, FencePolygon)
        command = _FENCE_COMMANDS[polygon, part.inclusion]
        corners = part.corners if isinstance(part, FencePolygon) else ((part.lat_deg, part.lon_deg),)
        size = float(len(part.corners)) if isinstance(part, FencePolygon) else part.radius_m
        for lat_deg, lon_deg in corners:
            place = lat_deg, lon_deg, 0.0
            items.append(MissionItem(len(items), command, FRAME_ABOVE_SEA, size, 0.0, 0.0, 0.0, *place))
    return tuple(items)


def fence_parts(items: Sequence[MissionItem]) -> tuple[FencePart, ...]:
    """The parts of a geofence from its items. A fence return point, which copters do not use, is no part of a fence.

    Raises AutopilotError for an incomplete polygon, and for a circle without a radius.
    """
    parts: list[FencePart] = []
    corners: list[tuple[float, float]] = []
    for item in items:
        kind = _FENCE_KINDS.get(item.command)
        if kind is None:
            continue
        polygon, inclusion = kind
        if not polygon:
            if not item.param1 > 0.0:
                raise AutopilotError(f"the autopilot holds a geofence with a circle of {item.param1:g} m")
            parts.append(FenceCircle(inclusion, item.lat_deg, item.lon_deg, item.param1))
            continue
        corners.append((item.lat_deg, item.lon_deg))
        if len(corners) >= item.param1:
            parts.append(FencePolygon(inclusion, tuple(corners)))
            corners = []
    if corners or any(isinstance(part, FencePolygon) and len(part.corners) < 3 for part in parts):
        raise AutopilotError("the autopilot holds a geofence with an incomplete polygon")
    return tuple(parts)


def same_fence(items: Sequence[MissionItem], parts: Sequence[FencePart]) -> bool:
    """Whether items from another source are this geofence."""
    own = fence_items(parts)
    return len(own) == len(items) and all(_fence_difference(*pair) is None for pair in zip(own, items, strict=True))


# ---- what came back -----------------------------------------------------------------------------------------------


def _rally_difference(sent: MissionItem, got: MissionItem) -> str | None:
    if _elsewhere(sent, got):
        return f"rally point {sent.seq} came back at {got.lat_deg:.7f} {got.lon_deg:.7f}"
    if not abs(sent.alt_m - got.alt_m) <= 1.0:
        return f"rally point {sent.seq}: altitude {sent.alt_m:g} m came back as {got.alt_m:g} m"
    return None


def _fence_difference(sent: MissionItem, got: MissionItem) -> str | None:
    if sent.command != got.command:
        return f"geofence item {sent.seq}: command {sent.command} came back as {got.command}"
    if not abs(sent.param1 - got.param1) <= 0.01 + 1e-6 * sent.param1:
        return f"geofence item {sent.seq}: {sent.param1:g} corners or metres came back as {got.param1:g}"
    if _elsewhere(sent, got):
        return f"geofence item {sent.seq} came back at {got.lat_deg:.7f} {got.lon_deg:.7f}"
    return None


def _elsewhere(sent: MissionItem, got: MissionItem) -> bool:
    return abs(sent.lat_deg - got.lat_deg) > 1.5e-7 or abs(sent.lon_deg - got.lon_deg) > 1.5e-7


# ---- what is an answer --------------------------------------------------------------------------------------------


def _of_kind(types: tuple[str, ...], kind: int, seq: int | None = None) -> Callable[[Any], Any]:
    def answer(m: Any) -> Any:
        if m.get_type() in types and m.mission_type == kind and (seq is None or m.seq == seq):
            return m
        return None

    return answer


def _back(kind: int, seq: int) -> str:
    return f"{_WORDS[kind]} item {seq} back"


def _gathers(kind: int, wanted: Sequence[int], got: dict[int, MissionItem]) -> Callable[[Any], Any]:
    """Collects items of a list in `got`; the answer is complete when `got` has all wanted items."""
    is_item = _of_kind(("MISSION_ITEM_INT",), kind)

    def answer(m: Any) -> Any:
        if is_item(m) is not None and m.seq in wanted:
            got[m.seq] = item_of(m)
        return True if all(seq in got for seq in wanted) else None

    return answer


def _upload_answer(kind: int) -> Callable[[Any], Any]:
    any_answer = _of_kind(("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"), kind)

    def answer(m: Any) -> Any:
        found = any_answer(m)
        doubled = found is not None and m.get_type() == "MISSION_ACK" and m.type == _OUT_OF_TURN
        return None if doubled else found  # an item came twice: the upload continues

    return answer


def _accepted(ack: Any, kind: int) -> None:
    if ack.type != mavlink.MAV_MISSION_ACCEPTED:
        names = mavlink.enums["MAV_MISSION_RESULT"]
        name = names[ack.type].name if ack.type in names else str(ack.type)
        error = NoRoomError if ack.type == mavlink.MAV_MISSION_NO_SPACE else AutopilotError
        raise error(f"the autopilot refused the {_WORDS[kind]}: {name}")
