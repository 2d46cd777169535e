# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle's side of the mission protocol, for one kind of list (mission, fence, rally points).

It answers in the autopilot's place. An upload of a station is collected here as a whole before any of it goes further.
A station reads the list that is offered here. The gate decides which station may send such messages. The owner of the
server checks the list between `handle` and `conclude`. Rules:

1. One upload at a time. Uploads of other senders are denied meanwhile. The same sender starts again by a new
   MISSION_COUNT.
2. Items are requested one by one. An item that came before, or out of turn, changes nothing and gets no answer: a
   request for each copy would double every copy. A missing item is requested again every `AGAIN_S`, every other time as
   MISSION_REQUEST, for programs that know no other form. After `PATIENCE_S` without a message the upload ends.
3. An item that `check` refuses ends the upload at once, as in ArduPilot. So does MISSION_ACK with OPERATION_CANCELLED
   of its sender.
4. A complete list waits for `conclude`. The protocol has no message for that, and programs wait about a second for the
   last answer (QGroundControl 1.5 s). So the last item is requested again meanwhile, which keeps them waiting. A sender
   that starts again in that time gets no answer; it asks again.
5. The answer to an upload that is over is repeated for `REMEMBERED_S`: for a copy of its last item, or for a copy of
   MISSION_CLEAR_ALL. The first answer may have been lost.
6. Reading is never blocked: it shows what is offered, before, during and after an upload.
7. An upload of a part may extend the list by one item, as in ArduPilot. The part is put into the list that was offered
   when the upload began. If that list has changed by the end, the upload fails.
8. No input raises an exception. Memory is bounded by `most` items.

Time is an argument (monotonic seconds). Sources: mavlink.io, "Mission Protocol"; ArduPilot's MissionItemProtocol.cpp;
QGroundControl's PlanManager.cc; MAVProxy's mission_item_protocol.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.protocol_items import Flaw, filled, flaw, item_message, item_of, older_item_message

__all__ = ["AGAIN_S", "PATIENCE_S", "REMEMBERED_S", "MissionServer", "Sender", "Turn", "Upload"]

AGAIN_S: Final = 0.5
#: as in ArduPilot
PATIENCE_S: Final = 8.0
#: shorter than the `QUIET_S` after which the same upload counts as insisting (`core/safety/commands.py`)
REMEMBERED_S: Final = 2.5

_ALL: Final[int] = mavlink.MAV_MISSION_TYPE_ALL
_ACCEPTED: Final[int] = mavlink.MAV_MISSION_ACCEPTED
_CANCELLED: Final[int] = mavlink.MAV_MISSION_OPERATION_CANCELLED

Sender = tuple[int, int]  #: system, component


@dataclass(frozen=True, slots=True)
class Upload:
    """A list that arrived complete. `items` are numbered from 0; no items: the list is to be cleared.

    `kind`: the MAV_MISSION_TYPE of the request, which is ALL if all lists are to be cleared. `begun_at`: when its first
    message came, if that is known.
    """

    sender: Sender
    kind: int
    items: tuple[MissionItem, ...]
    begun_at: float = -inf


@dataclass(frozen=True, slots=True)
class Turn:
    """The result of a message, or of time.

    `answers`: messages to send, each to its target. `whole`: a complete upload that waits for `conclude`. `words`: why
    something was refused or given up, "" if nothing was."""

    answers: tuple[Any, ...] = ()
    whole: Upload | None = None
    words: str = ""


@dataclass(slots=True)
class _Open:
    """An upload in progress. `first` to `last`: its items; `got`: those that came; `begun_at`: when it began."""

    sender: Sender
    kind: int
    first: int
    last: int
    begun_at: float
    got: list[MissionItem] = field(default_factory=list)
    #: the list that a part is put into
    base: tuple[MissionItem, ...] | None = None
    #: whether the program sends MISSION_ITEM
    older: bool = False
    #: when an item was last requested, how often without result, and when the sender was last heard
    asked_at: float = -inf
    tries: int = 0
    heard_at: float = -inf
    whole: bool = False

    @property
    def wanted(self) -> int:
        """Number of the item that is awaited; of a complete list the last one."""
        return min(self.first + len(self.got), self.last)


@dataclass(frozen=True, slots=True)
class _Over:
    """An upload that is over. `last`: the number of its last item (None: it cleared the list); `result`: the answer."""

    sender: Sender
    kind: int
    last: int | None
    result: int
    at: float


class MissionServer:
    """The vehicle's end of the protocol for lists of MAV_MISSION_TYPE `kind`."""

    def __init__(self, kind: int, most: int, check: Callable[[MissionItem], Flaw | None] = flaw) -> None:
        """`most`: the most items of a list. `check`: what is wrong with a single item."""
        self.kind = kind
        #: the list that stations read; None: it is not known, and the stations are told so
        self.offered: Sequence[MissionItem] | None = None
        #: number of the item that the aircraft flies to, shown to stations that read
        self.current: int | None = None
        self._most = most
        self._check = check
        self._open: _Open | None = None
        self._over: _Over | None = None
        self._handlers: dict[str, Callable[[Any, Sender, float], Turn]] = {
            "MISSION_COUNT": self._on_count,
            "MISSION_WRITE_PARTIAL_LIST": self._on_partial,
            "MISSION_CLEAR_ALL": self._on_clear,
            "MISSION_ITEM": self._on_item,
            "MISSION_ITEM_INT": self._on_item,
            "MISSION_ACK": self._on_ack,
            "MISSION_REQUEST_LIST": self._on_list,
            "MISSION_REQUEST": self._on_request,
            "MISSION_REQUEST_INT": self._on_request,
            "MISSION_REQUEST_PARTIAL_LIST": self._on_part_of_list,
        }

    @property
    def sender(self) -> Sender | None:
        """The sender of the open upload; None: no upload is open."""
        return None if self._open is None else self._open.sender

    def knows(self, message: Any) -> bool:
        """Whether a message belongs to this protocol and to this kind of list."""
        if message.get_type() not in self._handlers:
            return False
        return message.mission_type in (self.kind, _ALL if message.get_type() == "MISSION_CLEAR_ALL" else self.kind)

    def handle(self, message: Any, sender: Sender, now: float) -> Turn:
        """Handle a message of a station's program that `knows` accepts."""
        return self._handlers[message.get_type()](message, sender, now)

    def tick(self, now: float) -> Turn:
        """Request again what is missing. To be called often."""
        opened = self._open
        if opened is None or now < opened.asked_at + AGAIN_S or opened.last < 0:
            return Turn()
        if not opened.whole and now >= opened.heard_at + PATIENCE_S:
            return self.give_up(f"the upload was given up: item {opened.wanted} did not come", now)
        opened.tries += 1
        return Turn((self._ask(opened, now),))

    def conclude(self, result: int, now: float) -> Turn:
        """Answer the sender of the complete upload with this MAV_MISSION_RESULT."""
        opened, self._open = self._open, None
        if opened is None or not opened.whole:
            self._open = opened
            return Turn()
        return self._end(opened, result, now)

    def give_up(self, why: str, now: float) -> Turn:
        """End the open upload in any state, and tell its sender. Without one nothing is done."""
        opened, self._open = self._open, None
        return Turn() if opened is None else replace(self._end(opened, _CANCELLED, now), words=why)

    # ---- writing --------------------------------------------------------------------------------------------------

    def _on_count(self, message: Any, sender: Sender, now: float) -> Turn:
        refused = self._cannot_begin(sender)
        if refused is not None:
            return refused
        if message.count > self._most:
            words = f"{message.count} items (at most {self._most})"
            return self._refuse(sender, self.kind, mavlink.MAV_MISSION_NO_SPACE, words)
        if message.count == 0:
            return self._whole(_Open(sender, self.kind, 0, -1, now), now)
        return self._begin(_Open(sender, self.kind, 0, message.count - 1, now), now)

    def _on_partial(self, message: Any, sender: Sender, now: float) -> Turn:
        refused = self._cannot_begin(sender)
        if refused is not None:
            return refused
        first, last = message.start_index, message.end_index
        if self.offered is None or not 0 <= first <= last <= min(len(self.offered), self._most - 1):
            words = f"items {first} to {last} are none of those that are there"
            return self._refuse(sender, self.kind, mavlink.MAV_MISSION_ERROR, words)
        return self._begin(_Open(sender, self.kind, first, last, now, base=tuple(self.offered)), now)

    def _on_clear(self, message: Any, sender: Sender, now: float) -> Turn:
        over = self._remembered(sender, now)
        if over is not None and over.last is None and over.kind == message.mission_type:
            return Turn((_ack(sender, over.kind, over.result),))
        refused = self._cannot_begin(sender)
        return self._whole(_Open(sender, message.mission_type, 0, -1, now), now) if refused is None else refused

    def _cannot_begin(self, sender: Sender) -> Turn | None:
        opened = self._open
        if opened is None or (opened.sender == sender and not opened.whole):
            return None
        if opened.sender == sender:
            return Turn()
        return self._refuse(sender, self.kind, mavlink.MAV_MISSION_DENIED, "another upload is under way")

    def _begin(self, opened: _Open, now: float) -> Turn:
        opened.heard_at = now
        self._open, self._over = opened, None
        return Turn((self._ask(opened, now),))

    def _on_item(self, message: Any, sender: Sender, now: float) -> Turn:
        opened, over = self._open, self._remembered(sender, now)
        if opened is None and over is not None and over.last == message.seq:
            return Turn((_ack(sender, over.kind, over.result),))
        if opened is None or opened.sender != sender:
            return Turn()
        opened.heard_at = now
        opened.older = message.get_type() == "MISSION_ITEM"
        if opened.whole or message.seq != opened.wanted:
            return Turn()
        item = filled(item_of(message))
        wrong = self._check(item)
        if wrong is not None:
            self._open = None
            return replace(self._end(opened, wrong.result, now), words=wrong.words)
        opened.got.append(item)
        opened.tries = 0
        if opened.first + len(opened.got) > opened.last:
            return self._whole(opened, now)
        return Turn((self._ask(opened, now),))

    def _whole(self, opened: _Open, now: float) -> Turn:
        if opened.base is not None and (self.offered is None or tuple(self.offered) != opened.base):
            self._open = None
            words = "the list has changed meanwhile"
            return replace(self._end(opened, mavlink.MAV_MISSION_ERROR, now), words=words)
        opened.whole, opened.asked_at, opened.heard_at = True, now, now
        self._open, self._over = opened, None
        if opened.last < 0:
            return Turn(whole=Upload(opened.sender, opened.kind, (), opened.begun_at))
        items = list(opened.base or ())
        items[opened.first : opened.last + 1] = opened.got
        return Turn(whole=Upload(opened.sender, opened.kind, tuple(items), opened.begun_at))

    def _on_ack(self, message: Any, sender: Sender, now: float) -> Turn:
        opened = self._open
        cancels = message.type == _CANCELLED and opened is not None and opened.sender == sender
        if not cancels or opened is None or opened.whole:  # a complete list may be on its way to the autopilot already
            return Turn()
        self._open = None
        return Turn(words="the upload was called off by its sender")

    # ---- reading --------------------------------------------------------------------------------------------------

    def _on_list(self, _message: Any, sender: Sender, _now: float) -> Turn:
        if self.offered is None:
            return Turn((_ack(sender, self.kind, mavlink.MAV_MISSION_ERROR),))
        return Turn((mavlink.MAVLink_mission_count_message(*sender, len(self.offered), self.kind),))

    def _on_request(self, message: Any, sender: Sender, _now: float) -> Turn:
        if self.offered is None or message.seq >= len(self.offered):
            return Turn((_ack(sender, self.kind, mavlink.MAV_MISSION_INVALID_SEQUENCE),))
        pack = item_message if message.get_type() == "MISSION_REQUEST_INT" else older_item_message
        item = replace(self.offered[message.seq], seq=message.seq)
        return Turn((pack(item, sender, self.kind, message.seq == self.current),))

    def _on_part_of_list(self, _message: Any, sender: Sender, _now: float) -> Turn:
        return Turn((_ack(sender, self.kind, mavlink.MAV_MISSION_UNSUPPORTED),))

    # ---- answers --------------------------------------------------------------------------------------------------

    def _ask(self, opened: _Open, now: float) -> Any:
        """The request for the item that is awaited."""
        opened.asked_at = now
        older = opened.older or opened.tries % 2 == 1
        pack = mavlink.MAVLink_mission_request_message if older else mavlink.MAVLink_mission_request_int_message
        return pack(*opened.sender, opened.wanted, opened.kind)

    def _refuse(self, sender: Sender, kind: int, result: int, words: str) -> Turn:
        return Turn((_ack(sender, kind, result),), words=words)

    def _end(self, opened: _Open, result: int, now: float) -> Turn:
        last = None if opened.last < 0 else opened.last
        self._over = _Over(opened.sender, opened.kind, last, result, now)
        return Turn((_ack(opened.sender, opened.kind, result),))

    def _remembered(self, sender: Sender, now: float) -> _Over | None:
        over = self._over
        return over if over is not None and over.sender == sender and now - over.at < REMEMBERED_S else None


def _ack(target: Sender, kind: int, result: int) -> Any:
    return mavlink.MAVLink_mission_ack_message(*target, result, kind)
