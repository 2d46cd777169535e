# SPDX-License-Identifier: GPL-3.0-or-later

"""The mission protocol: missions, fences and rally points, up and down.

Rules, as in ArduPilot's MissionItemProtocol: one upload per kind at a time, bound to the system and component that
began it; others are denied until it ends or eight seconds pass without an item; that station itself may begin again.
Items are requested with MISSION_REQUEST, again every second. A refused item ends the upload. An upload truncates what
was stored at once. A fence is swapped when it is complete; one that is invalid changes nothing. While an upload runs,
that kind cannot be downloaded.
"""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.autopilot import Autopilot
from sitl.vehicles.builtin.items import Cmd, Item, Result, stored, stored_fence, stored_rally, whole_fence
from sitl.vehicles.builtin.link import Link
from sitl.vehicles.builtin.mission import MAX_ITEMS
from sitl.vehicles.builtin.telemetry import mission_current

__all__ = ["MissionProtocol"]

_UPLOAD_TIMEOUT_S = 8.0
_REQUEST_AGAIN_S = 1.0
_MISSION, _FENCE, _RALLY = 0, 1, 2
_MAX_RALLY, _MAX_FENCE = 85, 250


class _Store:
    """Items of one kind: how they are converted, kept and counted."""

    def __init__(self, kind: int, name: str, limit: int, convert: Callable[[Item], Item | Result]) -> None:
        self.kind, self.name, self.limit, self.convert = kind, name, limit, convert
        self.peer: tuple[int, int] | None = None
        self.link: Link | None = None
        self.next = self.last = 0
        self.received_at_s = self.requested_at_s = 0.0
        self.incoming: list[Item] = []


class MissionProtocol:
    """Handles MISSION_* messages and runs the uploads' timers."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._copter = autopilot.copter
        self._stores = {
            _MISSION: _Store(_MISSION, "Mission", MAX_ITEMS, stored),
            _FENCE: _Store(_FENCE, "Fence", _MAX_FENCE, stored_fence),
            _RALLY: _Store(_RALLY, "Rally", _MAX_RALLY, stored_rally),
        }
        self._warned_request = self._warned_item = False
        self._handlers = {
            "MISSION_COUNT": self._count,
            "MISSION_ITEM_INT": self._item,
            "MISSION_ITEM": self._item,
            "MISSION_REQUEST_LIST": self._request_list,
            "MISSION_REQUEST_INT": self._request,
            "MISSION_REQUEST": self._request,
            "MISSION_CLEAR_ALL": self._clear,
            "MISSION_SET_CURRENT": self._set_current,
            "MISSION_WRITE_PARTIAL_LIST": self._write_partial,
        }

    def handle(self, link: Link, message: dialect.MAVLink_message) -> bool:
        """Handle a message of this protocol; False: it is not one."""
        handler = self._handlers.get(message.get_type())
        if handler is None:
            return False
        handler(link, message)
        return True

    def update(self) -> None:
        """Ask again for items that did not come, give up on uploads that died."""
        now = self._copter.time_s
        for store in self._stores.values():
            if store.link is None or store.peer is None:
                continue
            if now - store.received_at_s > _UPLOAD_TIMEOUT_S:
                self._send_ack(store.link, store.peer, Result.OPERATION_CANCELLED, store.kind)
                self._copter.say(4, f"{store.name} upload timeout")
                self._end(store)
            elif now - store.requested_at_s > _REQUEST_AGAIN_S:
                self._ask(store)

    # -- upload ---------------------------------------------------------------------------------------------------

    def _count(self, link: Link, message: dialect.MAVLink_message) -> None:
        store = self._stores.get(message.mission_type)
        if store is None:
            self._ack(link, message, Result.UNSUPPORTED)
        elif self._free(link, message, store):
            if message.count > store.limit:
                self._ack(link, message, Result.NO_SPACE)
                self._copter.say(4, f"Only {store.limit} items are supported")
                return
            store.incoming = []
            if store.kind != _FENCE:
                self._truncate(store, message.count)
            if message.count == 0:
                self._finish(store, link, message)
            else:
                self._begin(store, link, message, 0, message.count - 1)

    def _write_partial(self, link: Link, message: dialect.MAVLink_message) -> None:
        store = self._stores.get(message.mission_type)
        if store is None:
            self._ack(link, message, Result.UNSUPPORTED)
            return
        if store.link is not None:
            self._ack(link, message, Result.DENIED)
            return
        size, first, last = len(self._items(store)), message.start_index, message.end_index
        if not 0 <= first <= last <= size:
            self._copter.say(4, "Flight plan update rejected")
            self._ack(link, message, Result.ERROR)
            return
        store.incoming = list(self._items(store)) if store.kind == _FENCE else []
        self._begin(store, link, message, first, last)

    def _begin(self, store: _Store, link: Link, message: dialect.MAVLink_message, first: int, last: int) -> None:
        store.peer, store.link = _source(message), link
        store.next, store.last = first, last
        store.received_at_s = self._copter.time_s
        self._warned_item = self._warned_request = False
        self._ask(store)

    def _ask(self, store: _Store) -> None:
        if store.link is not None and store.peer is not None:
            store.requested_at_s = self._copter.time_s
            store.link.send(dialect.MAVLink_mission_request_message(*store.peer, store.next, store.kind))

    def _item(self, link: Link, message: dialect.MAVLink_message) -> None:
        item, fault = _as_item(message)
        if item is None:
            self._ack(link, message, fault)
            return
        if message.mission_type == _MISSION and message.current in (2, 3):
            self._guided_item(link, message, item)
            return
        store = self._stores.get(message.mission_type)
        if store is None:
            self._ack(link, message, Result.UNSUPPORTED)
            return
        if message.get_type() == "MISSION_ITEM" and not self._warned_item:
            self._warned_item = True
            self._copter.say(4, "got MISSION_ITEM; GCS should send MISSION_ITEM_INT")
        if store.link is None or store.peer is None:
            self._ack(link, message, Result.ERROR)
        elif message.seq != store.next:
            self._ack(store.link, message, Result.INVALID_SEQUENCE)
        elif _source(message) != store.peer:
            self._ack(store.link, message, Result.DENIED)
        else:
            self._take(store, store.link, message, item)

    def _take(self, store: _Store, link: Link, message: dialect.MAVLink_message, item: Item) -> None:
        kept = store.convert(item)
        result = kept if isinstance(kept, Result) else self._keep(store, message.seq, kept)
        if result is not Result.ACCEPTED:
            self._ack(link, message, result)
            self._end(store)
            return
        store.received_at_s = self._copter.time_s
        store.next += 1
        if store.next > store.last:
            self._finish(store, link, message)
        else:
            self._ask(store)

    def _keep(self, store: _Store, index: int, item: Item) -> Result:
        copter = self._copter
        if store.kind == _MISSION:
            if item.command == Cmd.DO_JUMP:
                target = int(item.param1)
                if target == 0 or (target >= len(copter.mission) and target > store.last):
                    return Result.ERROR
            before = len(copter.mission)
            if not copter.mission.write(index, item):
                return Result.ERROR
            if len(copter.mission) != before:
                self._copter.listener.stored("MIS_TOTAL")
            return Result.ACCEPTED
        items = store.incoming if store.kind == _FENCE else copter.rally
        if index < len(items):
            items[index] = item
        elif index == len(items):
            items.append(item)
            if store.kind == _RALLY:
                self._copter.listener.stored("RALLY_TOTAL")
        else:
            return Result.ERROR
        return Result.ACCEPTED

    def _finish(self, store: _Store, link: Link, message: dialect.MAVLink_message) -> None:
        if store.kind == _FENCE and not self._swap_fence(store.incoming):
            self._ack(link, message, Result.ERROR)
            self._end(store)
            return
        self._ack(link, message, Result.ACCEPTED)
        if store.kind == _MISSION:
            self._copter.say(6, "Flight plan received")
        self._end(store)

    def _swap_fence(self, items: list[Item]) -> bool:
        """Whole or not at all: one that is no fence leaves the fence of before."""
        if not whole_fence(items):
            return False
        self._copter.fence[:] = items
        self._copter.listener.stored("FENCE_TOTAL")
        return True

    def _end(self, store: _Store) -> None:
        store.link = store.peer = None
        store.incoming = []

    def _free(self, link: Link, message: dialect.MAVLink_message, store: _Store) -> bool:
        """Whether no other station uploads; an upload of the same station is given up."""
        if store.peer is not None and store.peer != _source(message):
            self._ack(link, message, Result.DENIED)
            return False
        self._end(store)
        return True

    def _guided_item(self, link: Link, message: dialect.MAVLink_message, item: Item) -> None:
        """An item marked as guided destination (current 2) or new altitude (3)."""
        kept = stored(item)
        if isinstance(kept, Result):
            self._ack(link, message, kept)
            return
        copter = self._copter
        guided = copter.mode is copter.guided
        result = Result.ACCEPTED
        if message.current == 2:
            accepted = guided and kept.command == Cmd.WAYPOINT
            if accepted:
                copter.guided.go_to(copter.item_location(kept, copter.location()))
            result = Result.ACCEPTED if accepted else Result.ERROR
        self._ack(link, message, result)

    # -- download and the rest ------------------------------------------------------------------------------------

    def _request_list(self, link: Link, message: dialect.MAVLink_message) -> None:
        store = self._stores.get(message.mission_type)
        if store is None:
            self._ack(link, message, Result.UNSUPPORTED)
        elif store.link is not None:
            self._ack(link, message, Result.DENIED)
        else:
            link.send(dialect.MAVLink_mission_count_message(*_source(message), len(self._items(store)), store.kind))

    def _request(self, link: Link, message: dialect.MAVLink_message) -> None:
        store = self._stores.get(message.mission_type)
        if store is None:
            return
        modern = message.get_type() == "MISSION_REQUEST_INT"
        if store.link is not None and modern:
            self._ack(link, message, Result.DENIED)
            return
        items = self._items(store)
        item = self._copter.mission.read(message.seq) if store.kind == _MISSION else None
        if item is None and 0 <= message.seq < len(items):
            item = items[message.seq]
        if item is None:
            if modern:
                link.send(dialect.MAVLink_mission_count_message(*_source(message), len(items), store.kind))
            self._ack(link, message, Result.INVALID_SEQUENCE)
            return
        current = int(store.kind == _MISSION and item.command == self._copter.mission.current)
        head = (*_source(message), message.seq, item.frame, item.command, current, item.autocontinue, *item.params)
        if modern:
            link.send(dialect.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z, store.kind))
            return
        if not self._warned_request:
            self._warned_request = True
            self._copter.say(4, "got MISSION_REQUEST; use MISSION_REQUEST_INT!")
        link.send(dialect.MAVLink_mission_item_message(*head, item.x * 1e-7, item.y * 1e-7, item.z, store.kind))

    def _clear(self, link: Link, message: dialect.MAVLink_message) -> None:
        store = self._stores.get(message.mission_type)
        if store is None:
            self._ack(link, message, Result.UNSUPPORTED)
            return
        if not self._free(link, message, store):
            self._ack(link, message, Result.ERROR)
            return
        copter = self._copter
        done = True
        if store.kind == _MISSION:
            done = copter.mission.clear(copter.armed)
            self._copter.listener.stored("MIS_TOTAL")
        else:
            self._truncate(store, 0)
        self._ack(link, message, Result.ACCEPTED if done else Result.ERROR)

    def _set_current(self, link: Link, message: dialect.MAVLink_message) -> None:
        if self._copter.mission.set_current(message.seq):
            link.send(mission_current(self._autopilot, message.seq))

    def _items(self, store: _Store) -> list[Item]:
        copter = self._copter
        return {_MISSION: copter.mission.items, _FENCE: copter.fence, _RALLY: copter.rally}[store.kind]

    def _truncate(self, store: _Store, count: int) -> None:
        copter = self._copter
        if store.kind == _MISSION:
            if len(copter.mission) > count:
                copter.mission.truncate(count)
                self._copter.listener.stored("MIS_TOTAL")
        elif len(self._items(store)) > count:
            del self._items(store)[count:]
            self._copter.listener.stored("RALLY_TOTAL" if store.kind == _RALLY else "FENCE_TOTAL")

    def _ack(self, link: Link, message: dialect.MAVLink_message, result: Result) -> None:
        self._send_ack(link, _source(message), result, message.mission_type)

    @staticmethod
    def _send_ack(link: Link, peer: tuple[int, int], result: Result, kind: int) -> None:
        link.send(dialect.MAVLink_mission_ack_message(*peer, int(result), kind))


def _source(message: dialect.MAVLink_message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _as_item(message: dialect.MAVLink_message) -> tuple[Item | None, Result]:
    """The item in MISSION_ITEM_INT, or in the older MISSION_ITEM with its places in degrees."""
    m = message
    x, y = m.x, m.y
    if m.get_type() == "MISSION_ITEM":
        if not abs(x) <= 90:
            return None, Result.INVALID_PARAM5_X
        if not abs(y) <= 180:
            return None, Result.INVALID_PARAM6_Y
        x, y = round(x * 1e7), round(y * 1e7)
    return Item(m.command, m.frame, m.param1, m.param2, m.param3, m.param4, x, y, m.z), Result.ACCEPTED
