# SPDX-License-Identifier: GPL-3.0-or-later

"""The objects that the parts that talk to the autopilot share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common.events import Event
from mavproxy_handover.gate.mission_server import Turn
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.vehicle.procedures import Procedures
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Conversations

__all__ = ["Authority", "Context", "Reports"]


@dataclass(frozen=True, slots=True)
class Authority:
    """The authority rules of one vehicle, as these parts use them. Times are monotonic seconds."""

    #: only to be read; events go through `handle`
    arbiter: Arbiter
    #: puts an event into the queue
    handle: Callable[[Event, float], None]
    #: whether a station commands, by the view that is in force
    commands: Callable[[int], bool]


@dataclass(frozen=True, slots=True)
class Reports:
    """Reports of these parts: to the event log, to the stations, and about faults (their place and text)."""

    event_log: EventLog
    message_sender: MessageSender
    fault: Callable[[str, str], None]

    def answer(self, port: StationPort, what: str, turn: Turn, now: float) -> None:
        """Answer a program about its upload of `what`, in the autopilot's name; tell people if it is rejected."""
        for answer in turn.answers:
            self.message_sender.as_autopilot(port, answer)
        if turn.words and self.event_log.upload_refused(port.name, what, turn.words, now):
            self.message_sender.say(port, f"{what} rejected: {turn.words}")


@dataclass(frozen=True, slots=True)
class Context:
    """The shared objects of one vehicle; complete before the parts are constructed, and the same for all of them."""

    state: VehicleState
    #: the conversations with the autopilot that are open
    conversations: Conversations
    #: the procedures of the kind of aircraft that the autopilot last said
    procedures: Callable[[], Procedures]
    authority: Authority
    reports: Reports
