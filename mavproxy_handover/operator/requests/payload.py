# SPDX-License-Identifier: GPL-3.0-or-later

"""Requests of payload authority, by the operator-control standard: the same command, to a component of the payload.

A program sends MAV_CMD_REQUEST_OPERATOR_CONTROL to a gimbal, a camera or the winch instead of the companion. All of
them have one authority here. The rules are in `core/authority/payload.py`.

CONTROL_STATUS of the gimbal's component says which station has it. It lacks the flag of a system manager, so that no
program takes it for flight authority.

Every change is told to all stations. So a station may ask `_REQUESTS` times in `_REQUESTS_S`; further requests are
rejected for now. A copy of a request that was granted counts for nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.authority.payload import FLIGHT, PayloadAuthority
from mavproxy_handover.gate.policy.payload import PAYLOAD_COMPONENTS
from mavproxy_handover.gate.refusals import OncePerCause, RefusalLimiter, pack_as
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, OPERATOR_CONTROL

__all__ = ["PayloadRequests"]

#: components of the payload alone
_OWN: Final = PAYLOAD_COMPONENTS - {0, AUTOPILOT_COMPID}
_REQUESTS: Final = 4
_REQUESTS_S: Final = 10.0
_TOO_OFTEN: Final = "too many requests, wait some seconds"


class PayloadRequests:
    """Of vehicle `vehicle` (system id). `commander` returns the name of the commander, "" for none."""

    def __init__(
        self,
        vehicle: int,
        authority: PayloadAuthority,
        message_sender: MessageSender,
        event_log: EventLog,
        commander: Callable[[], str],
    ) -> None:
        self._authority = authority
        self._message_sender = message_sender
        self._event_log = event_log
        self._commander = commander
        self._told = ""
        self._requests = RefusalLimiter(_REQUESTS, _REQUESTS_S)
        self._words = OncePerCause()
        gimbal = mavlink.MAV_COMP_ID_GIMBAL
        self._own = mavlink.MAVLink(None, srcSystem=vehicle, srcComponent=gimbal)

    def concerns(self, message: Any) -> bool:
        """Whether a request of control is one of the payload."""
        return message.get_type() != "COMMAND_ACK" and message.target_component in _OWN

    def on_message(self, port: StationPort, frame: Frame, message: Any, now: float) -> None:
        """A request or a release of a station."""
        self._authority.authority_moved(self._commander())
        release = message.param1 == 0.0
        lacks = self._asked(port, release, now)
        result = mavlink.MAV_RESULT_DENIED if lacks else mavlink.MAV_RESULT_ACCEPTED
        if lacks == _TOO_OFTEN:
            result = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        ack = mavlink.MAVLink_command_ack_message(OPERATOR_CONTROL, result, 0, 0, frame.sysid, frame.compid)
        port.write(pack_as(ack, self._own, message.target_component))
        if lacks and self._words.allow(port.sysid, lacks, now):
            self._event_log.told(port.name, lacks, now)
            self._message_sender.say(port, f"PAYLOAD refused: {lacks}")
        if self._authority.holder != self._told:
            self.each_second(now)

    def _asked(self, port: StationPort, release: bool, now: float) -> str:
        """Do what a station asks for. Returns why not, in words; "" if it is done."""
        authority = self._authority
        if not release and port.name == authority.holder:
            return ""
        if not self._requests.allow(port.sysid, "payload", now):
            return _TOO_OFTEN
        return (authority.release if release else authority.request)(port.name)

    def each_second(self, _now: float) -> None:
        """Follow flight authority, tell a new holder, and send CONTROL_STATUS of the payload."""
        authority = self._authority
        authority.authority_moved(self._commander())
        if authority.settings.control == FLIGHT:
            return
        holder = authority.holder
        if holder != self._told:
            self._told = holder
            text = f"{holder or 'no station'} has payload authority"
            self._event_log.payload(holder, text)
            self._message_sender.say_to_all(text, mavlink.MAV_SEVERITY_NOTICE)
        sysids = {port.name: port.sysid for port in self._message_sender.ports.values()}
        status = mavlink.MAVLink_control_status_message(0, sysids.get(holder, 0), [0] * 10)
        for port in self._message_sender.ports.values():
            port.write(codec.pack(status, self._own))
