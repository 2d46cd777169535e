# SPDX-License-Identifier: GPL-3.0-or-later

"""Reports of the parts that talk to the autopilot: to the journal, to the stations, and of what breaks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.event_log import EventLog
from mavproxy_handover.gate.mission_server import Turn
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.stations.voice import Voice

__all__ = ["Reports"]


@dataclass(frozen=True, slots=True)
class Reports:
    """Of one vehicle. `fault` is told what broke, and where."""

    event_log: EventLog
    voice: Voice
    fault: Callable[[str, str], None]

    def answer(self, port: StationPort, what: str, turn: Turn, now: float) -> None:
        """What a program hears of its upload of `what`, in the autopilot's name, and people of what is not taken."""
        for answer in turn.answers:
            self.voice.as_autopilot(port, answer)
        if turn.words and self.event_log.upload_refused(port.name, what, turn.words, now):
            self.voice.say(port, f"{what} rejected: {turn.words}")
