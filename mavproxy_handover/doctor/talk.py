# SPDX-License-Identifier: GPL-3.0-or-later

"""A link that the doctor opens, with the devices and conversations of the companion.

Questions come from the doctor's own component (`DOCTOR_COMPID`), so only the doctor gets the answers. Everything is
sent by one function, `send`, which sends nothing if no question is allowed.
"""

from __future__ import annotations

import select
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.link.devices import Device
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.conversation import Asking, Conversation
from mavproxy_handover.wire.frames import Frame, field_int
from mavproxy_handover.wire.ids import DOCTOR_COMPID
from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer

__all__ = ["Talk"]

_WAIT_S: Final = 0.02
_LINK_ID: Final = 0
_HEARTBEAT: Final[int] = mavlink.MAVLINK_MSG_ID_HEARTBEAT


class Talk:
    """One link.

    `heed` gets each authentic message of `other` (system, component; 0: any). `may_ask`: returns True if sending is
    allowed. `look_out` is called often, and may end everything by an exception.
    """

    def __init__(
        self,
        device: Device,
        own_sysid: int,
        other: tuple[int, int],
        peer: SignedPeer | None,
        clocks: Clocks,
        heed: Callable[[Any, Frame], None],
        may_ask: Callable[[], bool],
        look_out: Callable[[], None] = lambda: None,
    ) -> None:
        self.device = device
        #: number of frames by system id
        self.heard: Counter[int] = Counter()
        #: heartbeats of others than `other`: system and component, with their MAV_TYPE
        self.beats: dict[tuple[int, int], int] = {}
        #: invalid signatures of the other end
        self.bad: Counter[SignatureVerdict] = Counter()
        self._other = other
        self.peer = peer
        self._clocks = clocks
        self._heed = heed
        self._may_ask = may_ask
        self._look_out = look_out
        self._own = mavlink.MAVLink(None, srcSystem=own_sysid, srcComponent=DOCTOR_COMPID)
        self._conversation: Conversation | None = None

    def listen(self, for_s: float, enough: Callable[[], bool] = lambda: False) -> None:
        """Receive for at most `for_s`, or until `enough`."""
        end = self._clocks.monotonic() + for_s
        while self._clocks.monotonic() < end and not enough():
            self._once()

    def ask(self, asking: Asking) -> Conversation:
        """Run a conversation to its end, or until sending is not allowed. Its attempts limit the time."""
        talk = self._conversation = Conversation(asking, self.send, self._clocks.monotonic())
        while not talk.finished:
            if not self._may_ask():
                talk.break_off("the vehicle has been armed")
                break
            self._once()
            talk.tick(self._clocks.monotonic())
        self._conversation = None
        return talk

    def send(self, message: Any) -> None:
        """Send a message, signed if the other end has a key, if sending is allowed."""
        if not self._may_ask():
            return
        data = codec.pack(message, self._own)
        if self.peer is not None:
            data = self.peer.sign(data, _LINK_ID, self._clocks.utc(), self._clocks.monotonic()) or data
        self.device.write(data)

    def close(self) -> None:
        self.device.close()

    def _once(self) -> None:
        self._look_out()
        number = self.device.fileno()
        waiting = select.poll()
        if number >= 0:
            waiting.register(number, select.POLLIN)
        waiting.poll(_WAIT_S * 1000.0)
        for frame in self.device.read():
            self._handle_frame(frame)

    def _handle_frame(self, frame: Frame) -> None:
        self.heard[frame.sysid] += 1
        sysid, compid = self._other
        if frame.sysid != sysid or compid not in (0, frame.compid):
            if frame.msgid == _HEARTBEAT and frame.known and frame.compid != DOCTOR_COMPID:
                self.beats[frame.sysid, frame.compid] = field_int(frame, "type")
            return
        if self.peer is not None:
            verdict = self.peer.check(frame, self._clocks.utc(), self._clocks.monotonic())
            if verdict is not SignatureVerdict.OK:
                self.bad[verdict] += 1
                return
        self.device.accept_sender(frame)
        message = codec.decode_bytes(frame.raw)
        if message is None:
            return
        self._heed(message, frame)
        if self._conversation is not None:
            self._conversation.on_message(message, self._clocks.monotonic())
