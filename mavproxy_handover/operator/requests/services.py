# SPDX-License-Identifier: GPL-3.0-or-later

"""Follow-up of a frame of a station after the verdict of the gate.

A frame that the gate leaves to the companion (CONSUME) goes to the operator service of its class: one table says which.
A class without a service needs none: the gate has done what there is to do. Another system of a station speaks with the
station's authority in commands; messages of a transfer are taken from the station itself only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from mavproxy_handover.core.common.never import assert_never
from mavproxy_handover.gate.gate import Gate
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.refusal_text import thesis_command
from mavproxy_handover.gate.refusals import OncePerCause
from mavproxy_handover.operator.rehearsal.rehearsal import RehearsalManager
from mavproxy_handover.operator.requests.accepted import AcceptedCommands
from mavproxy_handover.operator.requests.flight_commands import FlightCommands
from mavproxy_handover.operator.requests.operator_control import OperatorControl
from mavproxy_handover.operator.requests.transfer_messages import TransferMessages
from mavproxy_handover.operator.return_site.rally_list import RallyList
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.message_ids import MESSAGE_IDS

__all__ = ["OperatorServices", "Services"]

_HEARTBEAT: Final = MESSAGE_IDS["HEARTBEAT"]
#: heartbeats that are refused for the same reason are journalled once in this time (s)
_BEATS_S: Final = 60.0
#: classes that another system of a station may send in the station's name
_OF_ANY_SYSTEM: Final = frozenset((Access.COMMAND, Access.CONTROL, Access.READ, Access.RALLY_READ, Access.RALLY_WRITE))

Service = Callable[[StationPort, Frame, Verdict, float], None]


@dataclass(frozen=True, slots=True)
class Services:
    """The operator services."""

    commands: FlightCommands
    rally: RallyList
    control: OperatorControl
    messages: TransferMessages


class OperatorServices:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(
        self,
        gate: Gate,
        services: Services,
        accepted: AcceptedCommands,
        rehearsal: RehearsalManager,
        event_log: EventLog,
    ) -> None:
        self._gate = gate
        self._services = services
        self._accepted = accepted
        self._rehearsal = rehearsal
        self._event_log = event_log
        self._beats = OncePerCause(_BEATS_S)
        self.table: Mapping[Access, Service] = {
            Access.COMMAND: services.commands.handle_command,
            Access.READ: services.commands.handle_command,
            Access.RALLY_READ: self._rally,
            Access.RALLY_WRITE: self._rally,
            Access.CONTROL: self._control,
            Access.TRANSFER: services.messages.handle_message,
        }

    def follow_up(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        """Do what follows from a verdict."""
        match verdict.fate:
            case Fate.FORWARD:
                self._accepted.forwarded(port, frame, verdict.what, now)
            case Fate.CONSUME:
                service = None if verdict.access is None else self.table.get(verdict.access)
                if service is not None and (frame.sysid == port.sysid or verdict.access in _OF_ANY_SYSTEM):
                    service(port, frame, verdict, now)
            case Fate.REFUSE | Fate.DROP:
                if verdict.reason is not GateReason.FEED_STANDBY:  # its place, and nothing is wrong
                    self._refused(port, frame, verdict, now)
            case _:
                assert_never(verdict.fate)

    def _refused(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        if frame.msgid == _HEARTBEAT and not self._beats.allow(port.sysid, (frame.compid, verdict.reason), now):
            return  # such as those of an ADS-B receiver, for the whole flight
        kind, answered = (frame.msgid, verdict.reason), verdict.fate is Fate.REFUSE
        named, why = partial(self._gate.unsaid, frame), verdict.reason.value
        proven, record = port.proves(frame), thesis_command(frame)
        self._event_log.refused(port.name, kind, verdict.what, named, why, answered, proven, now, record)
        self._rehearsal.turned_away(port.name, verdict.what, verdict.reason.value)

    def _rally(self, port: StationPort, frame: Frame, _verdict: Verdict, now: float) -> None:
        message = codec.decode_bytes(frame.raw)
        if message is not None:
            self._services.rally.on_message(port, message, now)

    def _control(self, port: StationPort, frame: Frame, _verdict: Verdict, now: float) -> None:
        message = codec.decode_bytes(frame.raw)
        if message is not None:
            self._services.control.handle_message(port, frame, message, self._gate.view.handover_id, now)
