# SPDX-License-Identifier: GPL-3.0-or-later

"""Requests of payload authority, by the operator-control standard: the same command, to a component of the payload.

A program sends MAV_CMD_REQUEST_OPERATOR_CONTROL to a gimbal, a camera or the winch instead of the companion. Each kind
has an authority of its own. The rules are in `core/authority/payload.py`.

CONTROL_STATUS of the first component of each kind says which station has it, unless the whole payload is flight
authority's. It lacks the flag of a system manager, so that no program takes it for flight authority.

Every change is told to all stations. So a station may ask `_REQUESTS` times in `_REQUESTS_S`; further requests are
rejected for now. A copy of a request that was granted counts for nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.authority.payload import PayloadAuthority, PayloadKind
from mavproxy_handover.gate.policy.payload import KIND_OF_COMPONENT
from mavproxy_handover.gate.refusals import OncePerCause, RefusalLimiter, pack_as
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import OPERATOR_CONTROL, PAYLOAD_COMPIDS

__all__ = ["PayloadRequests"]

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
        self._told: dict[PayloadKind, str] = {}
        self._requests = RefusalLimiter(_REQUESTS, _REQUESTS_S)
        self._words = OncePerCause()
        self._own = mavlink.MAVLink(None, srcSystem=vehicle)

    def concerns(self, message: Any) -> bool:
        """Whether a request of control is one of the payload."""
        return message.get_type() != "COMMAND_ACK" and message.target_component in KIND_OF_COMPONENT

    def on_message(self, port: StationPort, frame: Frame, message: Any, now: float) -> None:
        """A request or a release of a station."""
        self._authority.authority_moved(self._commander())
        kind, release = KIND_OF_COMPONENT[message.target_component], message.param1 == 0.0
        lacks = self._asked(port, kind, release, now)
        result = mavlink.MAV_RESULT_DENIED if lacks else mavlink.MAV_RESULT_ACCEPTED
        if lacks == _TOO_OFTEN:
            result = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        ack = mavlink.MAVLink_command_ack_message(OPERATOR_CONTROL, result, 0, 0, frame.sysid, frame.compid)
        port.write(pack_as(ack, self._own, message.target_component))
        if lacks and self._words.allow(port.sysid, lacks, now):
            self._event_log.told(port.name, lacks, now)
            self._message_sender.say(port, f"PAYLOAD refused: {lacks}")
        if self._authority.holder(kind) != self._told.get(kind):
            self.each_second(now)

    def _asked(self, port: StationPort, kind: PayloadKind, release: bool, now: float) -> str:
        """Do what a station asks for. Returns why not, in words; "" if it is done."""
        authority = self._authority
        if not release and port.name == authority.holder(kind):
            return ""
        if not self._requests.allow(port.sysid, kind, now):
            return _TOO_OFTEN
        return (authority.release if release else authority.request)(kind, port.name)

    def each_second(self, _now: float) -> None:
        """Follow flight authority, tell a new holder, and send CONTROL_STATUS of the payload."""
        authority = self._authority
        authority.authority_moved(self._commander())
        if authority.settings.follows_flight:
            return
        holders = {kind: authority.holder(kind) for kind in PayloadKind}
        news = {kind: holder for kind, holder in holders.items() if holder != self._told.get(kind)}
        for holder in dict.fromkeys(news.values()):
            self._tell(holder, [kind for kind in news if news[kind] == holder])
        self._told = holders
        sysids = {port.name: port.sysid for port in self._message_sender.ports.values()}
        for kind, holder in holders.items():
            status = mavlink.MAVLink_control_status_message(0, sysids.get(holder, 0), [0] * 10)
            for port in self._message_sender.ports.values():
                port.write(pack_as(status, self._own, PAYLOAD_COMPIDS[kind.value]))

    def _tell(self, holder: str, kinds: list[PayloadKind]) -> None:
        names = [kind.value for kind in kinds]
        text = f"{holder or 'no station'} has payload authority: {', '.join(names)}"
        self._event_log.payload(holder, names, text)
        self._message_sender.say_to_all(text, mavlink.MAV_SEVERITY_NOTICE)
