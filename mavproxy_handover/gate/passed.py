# SPDX-License-Identifier: GPL-3.0-or-later

"""The frames that went to the autopilot, and what the gate remembers of them.

Nothing delays a frame that may pass. What it means for the gate (what it asks, what it leaves open at the autopilot) is
noted afterwards: frequent frames of the commander with the next `note`, all others at once. `note` is called in each
tick, before another station's frame, and before authority changes.
"""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

from mavproxy_handover.core.feeds import FeedSettings
from mavproxy_handover.core.remote_id import Operators
from mavproxy_handover.gate.downlink import DownlinkPolicy
from mavproxy_handover.gate.feeds import Feeds
from mavproxy_handover.gate.flush import Closing, FlushTracker
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.judge import GateReason, Verdict
from mavproxy_handover.gate.line_budget import LineBudget
from mavproxy_handover.gate.log_turn import LogTurn
from mavproxy_handover.gate.observers import ObserverLimits, ObserverRates
from mavproxy_handover.gate.operators import OperatorNotes
from mavproxy_handover.gate.own_reads import OwnReads
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.port import Port
from mavproxy_handover.gate.questions import Questions
from mavproxy_handover.gate.stale_streams import StaleStreams
from mavproxy_handover.wire.frames import Frame, parse_one

__all__ = ["GateSettings", "PassedFrames"]

#: constants, because Python 3.11 takes 0.1 us to look up a member of an enumeration
_STREAM: Final = Access.STREAM
_LIVENESS: Final = Access.LIVENESS


@dataclass(frozen=True, slots=True)
class GateSettings:
    """Settings of the gate from the configuration, and the operators as stations say them."""

    observers: ObserverLimits = field(default_factory=ObserverLimits)
    feeds: FeedSettings = field(default_factory=FeedSettings)
    operators: Operators = field(default_factory=lambda: Operators({}))
    #: the components that onboard programs speak as
    onboard: Collection[int] = ()
    #: what feeds, onboard programs and payload stations may send together
    budget: LineBudget = field(default_factory=LineBudget)


class PassedFrames:
    """Of one vehicle. Times are monotonic seconds; not safe for threads."""

    def __init__(
        self,
        vehicle: int,
        ports: Mapping[int, Port],
        settings: GateSettings,
        in_force: AuthorityInForce,
        to_autopilot: Callable[[bytes], None],
        fault: Callable[[str, str], None],
    ) -> None:
        """`vehicle`: its system id. `ports`: every known station by system id. `to_autopilot` takes whole frames.
        `fault` is told what broke, and where."""
        self._in_force = in_force
        self._to_autopilot = to_autopilot
        self._fault = fault
        #: the number of frames of each station, by the reason of their verdict
        self.counts: dict[int, Counter[GateReason]] = {station: Counter() for station in ports}
        self.flusher = FlushTracker(vehicle)
        self.questions = Questions(self.flusher)
        self.stale_streams = StaleStreams(ports)
        self.log_turn = LogTurn()
        self.own_reads = OwnReads()
        self.budget = settings.budget
        names = {station: port.name for station, port in ports.items()}
        self.feeds = Feeds(settings.feeds, names, in_force, self.budget, fault)
        self.operators = OperatorNotes(settings.operators, fault)
        self.rates = ObserverRates(settings.observers)
        self.downlink = DownlinkPolicy((port.identity for port in ports.values()), self.rates, settings.onboard)
        #: the frames that went to the autopilot and wait to be noted: port, frame, verdict, time
        self.unnoted: list[tuple[Port, Frame, Verdict, float]] = []

    def companion_sent(self, raw: bytes, now: float) -> None:
        """The companion itself sends this whole frame to the autopilot."""
        frame = parse_one(raw, proven=True)
        if frame is not None:
            self.own_reads.companion_sent(frame, now)

    def note(self) -> None:
        """Note what the frames mean that went to the autopilot. A frame whose noting breaks is not noted."""
        if self.unnoted:
            self.note_for(self._in_force.view.commander)

    def note_for(self, commander: int | None) -> None:
        """Note the frames that wait. `commander`: the station that had authority when they passed."""
        passed, self.unnoted = self.unnoted, []
        for port, frame, verdict, at in passed:
            try:
                self.counts[port.sysid][verdict.reason] += 1
                if port.sysid == commander:
                    self._commander_sent(port, frame, verdict, at)
                self.downlink.asked(frame, port.sysid, at)
                self.own_reads.station_sent(frame)
                self.flusher.saw(frame, verdict, port.sysid)
            except Exception:
                self._fault("frame that passed", traceback.format_exc(limit=-3))

    def to_manager(self, port: Port, frame: Frame, verdict: Verdict, now: float) -> None:
        """Note a frame that goes to a payload manager on board. It leaves nothing open at the autopilot."""
        self.counts[port.sysid][verdict.reason] += 1
        try:
            self.downlink.asked(frame, port.sysid, now)
        except Exception:
            self._fault("frame that passed", traceback.format_exc(limit=-3))

    def _commander_sent(self, port: Port, frame: Frame, verdict: Verdict, at: float) -> None:
        self.questions.commander_sent(frame, at)
        if verdict.access is _STREAM:
            self.stale_streams.begun(frame)
        elif verdict.access is _LIVENESS:
            self.stale_streams.beat(port.sysid)

    # ---- what is left open at the autopilot -----------------------------------------------------------------------

    @property
    def list_open(self) -> bool:
        """Whether a station is writing the mission or the geofence to the autopilot."""
        self.note()
        return self.flusher.list_open

    def close_mission_files(self) -> list[tuple[int, Closing]]:
        """Discard the mission files that the commander has open at the autopilot. Returns what was closed, and whose it
        was.

        The autopilot applies such a file when it is closed. After a package was written, it would replace its mission.
        """
        self.note()
        commander = self._in_force.view.commander
        return [] if commander is None else self.close(commander, self.flusher.mission_files())

    def close(self, station: int, closings: list[Closing]) -> list[tuple[int, Closing]]:
        """Send what closes these at the autopilot. `station`: the one that left them open."""
        for closing in closings:
            for raw in closing.frames:
                self._to_autopilot(raw)
        return [(station, closing) for closing in closings]
