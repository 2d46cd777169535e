# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages of our own language from the stations, each with the part that takes it, in one table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from mavproxy_handover.core.common.events import Event, StationMessage
from mavproxy_handover.core.common.messages import TransferMessage
from mavproxy_handover.gate.client_capabilities import Dialect
from mavproxy_handover.gate.judge import Verdict
from mavproxy_handover.operator.rehearsal.rehearsal import RehearsalManager
from mavproxy_handover.operator.requests.delegations import Delegations
from mavproxy_handover.operator.requests.overrides import Overrides
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.uploads.mission_on_board import MissionOnBoard
from mavproxy_handover.operator.uploads.package_return import PackageReturn
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame

__all__ = ["TransferMessages", "TransferServices"]


@dataclass(frozen=True, slots=True)
class TransferServices:
    """The parts that take messages of a station."""

    mission: MissionOnBoard
    package_return: PackageReturn
    rehearsal: RehearsalManager
    overrides: Overrides
    delegations: Delegations
    event_log: EventLog


class TransferMessages:
    """Of vehicle `vehicle` (system id). Times are monotonic seconds."""

    def __init__(
        self,
        vehicle: int,
        services: TransferServices,
        handle: Callable[[Event, float], None],
        fault: Callable[[str, str], None],
    ) -> None:
        """`handle` gives an event to the rules; `fault` is told what broke, and where."""
        self._vehicle = vehicle
        self._services = services
        self._handle = handle
        self._fault = fault
        #: message -> what takes it; the messages of a transfer itself go to the rules
        self._handlers: Mapping[str, Callable[[StationPort, Any, float], None]] = {
            "MISSION_PACKAGE": services.mission.on_package,
            "MISSION_CHUNK": services.mission.on_package,
            "MISSION_PACKAGE_ACK": services.package_return.on_ack,
            "HANDOVER_REHEARSE": services.rehearsal.handle_request,
            "HANDOVER_OVERRIDE": self._override,
            "HANDOVER_DELEGATE": self._delegate,
        }

    def handle_message(self, port: StationPort, frame: Frame, _verdict: Verdict, now: float) -> None:
        """A message of a station."""
        message = codec.decode_bytes(frame.raw)
        if message is None:
            return
        port.spoke(frame.compid)
        port.capabilities.show((frame.sysid, frame.compid), Dialect.OURS, now)
        self._handlers.get(message.get_type(), self._to_rules)(port, message, now)

    def _override(self, port: StationPort, message: Any, now: float) -> None:
        if message.vehicle == self._vehicle:
            port.send(self._services.overrides.on_message(port, message, now))

    def _delegate(self, port: StationPort, message: Any, now: float) -> None:
        if message.vehicle == self._vehicle:
            port.send(self._services.delegations.on_message(port, message, now))

    def _to_rules(self, port: StationPort, message: Any, now: float) -> None:
        event_log, decoded = self._services.event_log, codec.decode(message)
        if decoded is None or getattr(message, "vehicle", 0) != self._vehicle:
            event_log.senseless(message.get_type(), port.name, now)
            return
        if isinstance(decoded, TransferMessage):
            attempt(self._fault, "journal", event_log.message, "in", port.sysid, decoded, now)
        self._handle(StationMessage(port.sysid, decoded), now)
