# SPDX-License-Identifier: GPL-3.0-or-later

"""Operator control on the wire: MAV_CMD_REQUEST_OPERATOR_CONTROL in its layout of 2026, its traps, its answers.

Which request is granted is decided in `core/authority/control.py`.

The layout of 2024 had other parameters: p1 system id (0 from a ground station), p2 action, p3 takeover, p4 time-out.
Read by the present layout, a request of then (p1 0, p2 1) is a release. A release that comes with p2 set is therefore
refused with a word about it: a misread one would take authority away in flight.

The owner is asked by the same command, again and again until it acknowledges that it has heard.

Another system of a station (a second program, a tracker: its `sysids`) speaks with the station's authority here as in
every other command: its request is the station's, and it gets the answer. Its own system id means the station, which is
what CONTROL_STATUS names. That the owner has heard a question, only the owner itself can say: it was the one asked.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ControlRequested, Event, NotifyOwner, OperatorControlShown
from mavproxy_handover.gate.client_capabilities import Dialect
from mavproxy_handover.gate.judge import StationIdentity
from mavproxy_handover.gate.refusals import OncePerCause
from mavproxy_handover.operator.requests.payload import PayloadRequests
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.wire.conversation import command_long
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import OPERATOR_CONTROL

__all__ = ["OperatorControl", "notification", "read_request"]

#: the longest time-out of a request
_LONGEST_S: Final = 60
#: answers of an owner whose operator is asked
_HEARD: Final = (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS)


def read_request(message: Any, station: StationIdentity) -> ControlRequested | str:
    """The request in a COMMAND_LONG or COMMAND_INT that came by a link of `station`, or why it cannot be one."""
    action, takeover, timeout_s, requester = message.param1, message.param2, message.param3, message.param4
    if not all(math.isfinite(value) for value in (action, takeover, timeout_s, requester)):
        return "parameters must be numbers"
    if action not in (0, 1) or takeover not in (0, 1):
        return "action and takeover must be 0 or 1"
    if action == 0 and takeover == 1:
        return "release with takeover: the request of an old ground station?"
    if requester != int(requester) or not 0 <= requester <= 255:
        return "system id must be 0 to 255"
    for_another = action == 1 and requester and requester not in station.sysids
    return ControlRequested(
        station=station.sysid,
        request=action == 1,
        takeover=takeover == 1,
        timeout_s=timeout_s,
        for_station=int(requester) if for_another else station.sysid,
    )


def _of_today(message: Any, station: StationIdentity) -> bool:
    """Whether a request that was understood is certainly of the layout of 2026.

    A release of 2024 reads like one of today; but what was a time-out then, 60 s at most, names the sender by now.
    """
    return bool(message.param1 == 1 or (message.param4 in station.sysids and message.param4 > _LONGEST_S))


def notification(owner: tuple[int, int], requester: int, timeout_s: float) -> Any:
    """The command by which the manager tells the owner that `requester` asks for control."""
    return command_long(owner, OPERATOR_CONTROL, 1, 0, timeout_s, requester)


class OperatorControl:
    """The programs that asked last, and the stations that are asked. `handle` gives a request to the arbiter."""

    def __init__(
        self,
        message_sender: MessageSender,
        event_log: EventLog,
        handle: Callable[[Event, float], None],
        payload: PayloadRequests,
    ) -> None:
        self._payload = payload
        self._message_sender = message_sender
        self._event_log = event_log
        self._handle = handle
        self._denied = OncePerCause()
        #: of each station, system and component that asked last, and the component that was asked
        self._askers: dict[int, tuple[int, int, int]] = {}
        #: (station, transfer) of the question that the owner was asked last, and of the one that it has acknowledged
        self._question: tuple[int, int] | None = None
        self._acknowledged: tuple[int, int] | None = None

    def handle_message(self, port: StationPort, frame: Frame, message: Any, handover_id: int, now: float) -> None:
        """A request of a station, or the owner's word that it has heard of one; `handover_id`: of the transfer."""
        itself = frame.sysid == port.sysid
        if self._payload.concerns(message):
            self._payload.on_message(port, frame, message, now)
            return
        if message.get_type() == "COMMAND_ACK":
            # a program that does not know the question refuses it or answers "unsupported": its operator was not asked
            if itself and self._question == (port.sysid, handover_id) and message.result in _HEARD:
                self._acknowledged = self._question
                self._handle(OperatorControlShown(port.sysid), now)
            return
        if itself and not port.component:
            port.spoke(frame.compid)
        request = read_request(message, port.identity)
        self._askers[port.sysid] = (frame.sysid, frame.compid, message.target_component)
        if isinstance(request, str):
            self._event_log.request_not_understood(port.name, request, now)
            self.answer(port, mavlink.MAV_RESULT_DENIED, request, now)
            return
        if _of_today(message, port.identity):
            port.capabilities.show((frame.sysid, frame.compid), Dialect.STANDARD, now)
            if itself:
                self._handle(OperatorControlShown(port.sysid), now)
        self._handle(request, now)

    def answer(self, port: StationPort, result: int, text: str, now: float) -> None:
        """COMMAND_ACK of the component that was asked, by default the companion; and why it is denied."""
        sysid, compid, component = self._askers[port.sysid]
        self._message_sender.acknowledge(port, (sysid, compid), OPERATOR_CONTROL, result, component)
        if text and self._denied.allow(port.sysid, text, now):
            self._message_sender.say(port, f"Control denied: {text}")

    def ask_owner(self, port: StationPort, action: NotifyOwner, name: str, handover_id: int) -> None:
        """Ask the owner at `port` whether the station called `name` may have control; not if it has heard already."""
        question = (port.sysid, handover_id)
        if question == self._acknowledged:
            return
        again, self._question = question == self._question, question
        port.send(notification(port.target, action.requester, action.timeout_s), everywhere=True)
        if not again:
            self._event_log.owner_asked(port.name, name)
