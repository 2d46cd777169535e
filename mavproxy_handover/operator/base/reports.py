# SPDX-License-Identifier: GPL-3.0-or-later

"""Reports of the parts that talk to the autopilot: to the event log, to the stations, and about faults."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.gate.mission_server import Turn
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.stations.sender import MessageSender

__all__ = ["Reports"]


@dataclass(frozen=True, slots=True)
class Reports:
    """The reports of one vehicle. `fault` takes the place and the text of a fault."""

    event_log: EventLog
    message_sender: MessageSender
    fault: Callable[[str, str], None]

    def answer(self, port: StationPort, what: str, turn: Turn, now: float) -> None:
        """Answer a program about its upload of `what`, in the autopilot's name; tell people if it is rejected."""
        for answer in turn.answers:
            self.message_sender.as_autopilot(port, answer)
        if turn.words and self.event_log.upload_refused(port.name, what, turn.words, now):
            self.message_sender.say(port, f"{what} rejected: {turn.words}")
