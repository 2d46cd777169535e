# SPDX-License-Identifier: GPL-3.0-or-later

"""What ties this wing to the rest of the companion: whom it tells what it sees, and by whose voice it speaks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.clocks import Clocks
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.events import Event
from mavproxy_handover.gate.mission_server import Turn
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.narrator import Narrator
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.stations.voice import Voice

__all__ = ["Ties"]


@dataclass(frozen=True, slots=True)
class Ties:
    """Handed to the wing's front, and by it to those of its parts that need them."""

    #: to look at; what it is told goes through `handle`
    arbiter: Arbiter
    #: gives an event to the arbiter and carries out what it asks for
    handle: Callable[[Event, float], None]
    #: is told what broke, and where
    fault: Callable[[str, str], None]
    #: whether a station commands, by the view that is in force
    commands: Callable[[int], bool]
    #: keeps the mission package that the autopilot holds
    keep: Callable[[MissionPackage], None]
    #: throws away the mission files that a station has open for writing at the autopilot
    close_mission_files: Callable[[], None]
    #: whether a station is writing the autopilot's mission or geofence
    list_open: Callable[[], bool]
    #: an older position (s) is not known any more
    stale_s: float
    narrator: Narrator
    voice: Voice
    clocks: Clocks

    def answer(self, port: StationPort, what: str, turn: Turn) -> None:
        """What a program hears of its upload of `what`, in the autopilot's name, and people of what is not taken."""
        for answer in turn.answers:
            self.voice.as_autopilot(port, answer)
        if turn.words and self.narrator.upload_refused(port.name, what, turn.words, self.clocks.monotonic()):
            self.voice.say(port, f"{what} not taken: {turn.words}")
