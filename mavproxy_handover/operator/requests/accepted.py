# SPDX-License-Identifier: GPL-3.0-or-later

"""Follow-up of a command of a station that has gone to the autopilot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.core.common.events import Event
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.intent import INTENT_MESSAGES, intent_of
from mavproxy_handover.gate.list_changes import list_change
from mavproxy_handover.gate.refusal_text import thesis_command
from mavproxy_handover.operator.checks.command_check import CommandCheck
from mavproxy_handover.operator.checks.read_back import ReadBack
from mavproxy_handover.operator.orders import Orders, disarms
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.uploads.mission_on_board import MissionOnBoard
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.vehicle import mode_requests
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.frames import Frame

__all__ = ["AcceptedCommands", "CommandParts"]


@dataclass(frozen=True, slots=True)
class CommandParts:
    """The parts of one vehicle, for the services that carry out commands."""

    aircraft: VehicleState
    orders: Orders
    command_check: CommandCheck
    read_back: ReadBack
    mission: MissionOnBoard


class AcceptedCommands:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(
        self,
        in_force: AuthorityInForce,
        parts: CommandParts,
        event_log: EventLog,
        handle: Callable[[Event, float], None],
        fault: Callable[[str, str], None],
    ) -> None:
        """`handle` gives an event to the rules; `fault` is told what broke, and where."""
        self._in_force = in_force
        self._parts = parts
        self._event_log = event_log
        self._handle = handle
        self._fault = fault

    def forwarded(self, port: StationPort, frame: Frame, what: str, now: float) -> None:
        """The gate has passed a command, or a message that changes something; `what`: the frame in words."""
        in_flight = self._in_force.view.phase is not Phase.ON_LOAD
        self.released(port, frame, what, now)
        if in_flight and frame.msgid in INTENT_MESSAGES:
            intent = intent_of(frame, self._parts.aircraft.judged_by)
            if intent is not None:
                self._parts.orders.passed(port, intent, now)
        if disarms(frame):
            self._parts.orders.disarmed(port, frame, self._parts.aircraft.armed, now)
            self._parts.read_back.withdraw(now)

    def released(self, port: StationPort, frame: Frame, what: str, now: float) -> None:
        """The companion has passed a command that it held on the ground."""
        # the frame is at the autopilot: what follows must not depend on the journal
        self.note(port, frame, what)
        change = list_change(frame)
        if change is not None:
            on_ground = self._in_force.view.phase is Phase.ON_LOAD
            self._parts.mission.list_changed(port, change, on_ground, now)
        aircraft = self._parts.aircraft
        source = mode_requests.of_command(frame, aircraft.profile, aircraft.ways_down.leads_to)
        if source is not None:
            self._handle(source, now)

    def note(self, port: StationPort, frame: Frame, what: str) -> None:
        """Write an accepted command to the journal."""
        attempt(self._fault, "journal", lambda: self._event_log.accepted(port.name, what, thesis_command(frame)))
