# SPDX-License-Identifier: GPL-3.0-or-later

"""The commander's commands that the companion handles itself.

On the ground: START, and every other command that arms or takes off. Such a command needs what START needs, so it is
held until the mission was read back. In flight: parts of an upload, and commands that this autopilot does not know.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.authority.start import MIDWAY
from mavproxy_handover.core.common.events import Event, TakeOffPassed
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.gate.gate import Gate
from mavproxy_handover.gate.intent import repeats, wish_of
from mavproxy_handover.gate.judge import Verdict, uploads
from mavproxy_handover.gate.policy.rows import begins_midway, classify
from mavproxy_handover.operator.checks.preflight_warnings import PreflightWarnings
from mavproxy_handover.operator.checks.read_back import WITHDRAWN
from mavproxy_handover.operator.orders import UNDOING, commanded
from mavproxy_handover.operator.requests.accepted import AcceptedCommands, CommandParts
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import MISSION_START

__all__ = ["FlightCommands"]


@dataclass(frozen=True, slots=True)
class FlightCommands:
    """Of one vehicle. `handle` gives an event to the rules. Times are monotonic seconds."""

    gate: Gate
    arbiter: Arbiter
    parts: CommandParts
    accepted: AcceptedCommands
    warnings: PreflightWarnings
    event_log: EventLog
    handle: Callable[[Event, float], None]

    def handle_command(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        """Handle a command of the commander that the gate leaves to the companion."""
        if self.gate.view.phase is Phase.ON_LOAD:
            self._begins_flight(port, frame, verdict, now)
        else:
            self._in_flight(port, frame, verdict, now)

    # ---- on the ground --------------------------------------------------------------------------------------------

    def _begins_flight(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        parts, midway = self.parts, begins_midway(classify(frame))
        if not midway:
            parts.command_check.start(port, wish_of(frame), repeats(frame), now)
        if commanded(frame) == MISSION_START:
            parts.orders.start_asked(port, frame, verdict.what, now)
            return
        needs = MIDWAY if midway else self.arbiter.take_off_needs(port.sysid, now)
        needs = needs or (UNDOING if parts.orders.undoing else ())
        if needs:
            self._refuse_take_off(port, frame, verdict, needs, now)
            return
        command = port.sysid, frame.sysid, frame.compid, frame.msgid, wish_of(frame)
        parts.read_back.ask(command, partial(self._takes_off, port, frame, verdict), now)

    def _takes_off(self, port: StationPort, frame: Frame, verdict: Verdict, trouble: str, now: float) -> None:
        """The mission was read back (`trouble`: why not): pass the command, or refuse it."""
        troubles = (trouble,) if trouble else ()
        needs = troubles if trouble == WITHDRAWN else self.arbiter.take_off_needs(port.sysid, now) or troubles
        if needs:
            self._refuse_take_off(port, frame, verdict, needs, now)
            return
        self.handle(TakeOffPassed(port.sysid), now)
        self.warnings.tell()
        self.accepted.released(port, frame, self.gate.release(port, frame, verdict, now).what, now)

    def _refuse_take_off(
        self, port: StationPort, frame: Frame, verdict: Verdict, needs: tuple[str, ...], now: float
    ) -> None:
        self.parts.orders.refuse_take_off(port, frame, needs, now)
        kind, proven = (frame.msgid, verdict.reason), port.proves(frame)
        named, why = partial(self.gate.unsaid, frame), "; ".join(needs)
        self.event_log.refused(port.name, kind, verdict.what, named, why, True, proven, now)

    # ---- in flight ------------------------------------------------------------------------------------------------

    def _in_flight(self, port: StationPort, frame: Frame, verdict: Verdict, now: float) -> None:
        parts = self.parts
        if uploads(frame, parts.aircraft.judged_by):
            parts.mission.flight_uploads.on_frame(port, frame, now)
        elif parts.orders.takes_over(frame):
            self.accepted.note(port, frame, verdict.what)
            parts.orders.pause_asked(port, frame, now)
