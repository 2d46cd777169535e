# SPDX-License-Identifier: GPL-3.0-or-later

"""Asks the gate itself for its verdict on a frame, in each situation that it tells apart. For `handover policy`.

Nothing of the gate is described here a second time: each frame goes through a gate of its own, with two stations that
keep nothing. Where the companion would judge energy, fence and coverage, the answer says so.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Final, NamedTuple

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.client_capabilities import ClientCapabilities
from mavproxy_handover.gate.examples import VEHICLE, Example, frame_of
from mavproxy_handover.gate.filters import CompanionMatters
from mavproxy_handover.gate.gate import Gate
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.intent import Aim, Intent
from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity
from mavproxy_handover.gate.passed import GateSettings, PassedFrames
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.refusal_text import reason_in_words
from mavproxy_handover.gate.replies import GateReports
from mavproxy_handover.vehicle.profiles import ASSUMED
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import STATION_COMPIDS

__all__ = ["SITUATIONS", "Answer", "Situation", "answer"]

_ONE, _OTHER = 251, 252
_COMPONENT: Final = min(STATION_COMPIDS)
#: a component without authority
_CAMERA: Final = 100
_NOW: Final = 1000.0


class Situation(NamedTuple):
    """Which station sends, and what is in force then. `who`: for people."""

    who: str
    view: AuthorityView
    station: int = _ONE
    component: int = _COMPONENT


_GROUND = AuthorityView(Phase.ON_LOAD, _ONE, None, 1, LeaseState.HELD, armed=False)
_FLIGHT = AuthorityView(Phase.ON_MISSION, _ONE, None, 1, LeaseState.HELD, armed=True)
_TRANSFER = AuthorityView(Phase.ON_HANDOVER, _ONE, _OTHER, 1, LeaseState.TRANSFER, armed=True)
_LOST = AuthorityView(Phase.EMERGENCY, None, None, 1, LeaseState.LOST, armed=True)
_REHEARSAL = AuthorityView(Phase.ON_MISSION, _ONE, None, 1, LeaseState.HELD, armed=True, rehearsal=True)
_LANDED = AuthorityView(Phase.ON_MISSION, _ONE, None, 1, LeaseState.HELD, armed=False)

SITUATIONS: Final = (
    Situation("commander, before START", _GROUND),
    Situation("commander, armed before START", AuthorityView(Phase.ON_LOAD, _ONE, None, 1, LeaseState.HELD, True)),
    Situation("commander, in flight", _FLIGHT),
    Situation("commander, disarmed in a mission", _LANDED),
    Situation("commander, in a rehearsal", _REHEARSAL),
    Situation("partner, in a handover", _TRANSFER, _OTHER),
    Situation("observer, on the ground", _GROUND, _OTHER),
    Situation("observer, in flight", _FLIGHT, _OTHER),
    Situation("observer, in a rehearsal", _REHEARSAL, _OTHER),
    Situation("any station, no commander in flight", _LOST),
    Situation("camera of the commander's id, in flight", _FLIGHT, _ONE, _CAMERA),
)


class Answer(NamedTuple):
    """The verdict of the gate. `judged`: only if energy, fence and coverage allow it."""

    fate: Fate
    reason: GateReason
    judged: bool = False
    access: Access | None = None

    def __str__(self) -> str:
        if self.access is Access.FEED and self.reason in _BY_CONFIGURATION:
            return "passes if the station is the source ([feeds])"
        if self.judged:
            return "passes if energy, fence and coverage allow it"
        if self.fate is Fate.FORWARD:
            return "passes"
        if self.fate is Fate.CONSUME:
            return _CONSUMED.get(self.reason, "handled by the companion")
        word = "refused" if self.fate is Fate.REFUSE else "dropped"
        return f"{word}: {reason_in_words(self.reason)}"


_CONSUMED: Final = {
    GateReason.LIVENESS_NOT_COMMANDER: "noticed by the companion",
    GateReason.OBSERVER_RATES: "answered by the companion",
}
#: what the gate does with a feed where the configuration names no source
_BY_CONFIGURATION: Final = (GateReason.ALLOWED, GateReason.NOT_IN_CONTROL, GateReason.FEED_NOT_NAMED)
#: of a name that the installed dialect lacks, by the kind of thing that it names
_UNKNOWN: Final = {
    "message": Answer(Fate.DROP, GateReason.UNKNOWN_MESSAGE),
    "command": Answer(Fate.REFUSE, GateReason.UNKNOWN_COMMAND),
}


@dataclass
class _Station:
    """A station that keeps nothing."""

    identity: StationIdentity
    capabilities: ClientCapabilities = field(default_factory=ClientCapabilities)
    heartbeat: bytes = b""
    heartbeat_at: float = -inf
    flow_controlled: bool = False

    @property
    def sysid(self) -> int:
        return self.identity.sysid

    @property
    def name(self) -> str:
        return f"station {self.sysid}"

    def write(self, data: bytes) -> None:
        """Nothing is sent."""

    def write_more(self, data: bytes) -> bool:
        """Nothing is sent."""
        return bool(data)

    def flush(self) -> None:
        """Nothing is kept."""


def answer(kind: str, example: Example | None, situation: Situation) -> Answer:
    """What the gate does with this frame in this situation. `example` None: the dialect has no such name."""
    if example is None:
        return _UNKNOWN.get(kind, _UNKNOWN["command"])
    frame = frame_of(example, situation.station, situation.component)
    return _Trial().ask(frame, situation)


class _Trial:
    """A gate for one question: it remembers nothing of others."""

    def __init__(self) -> None:
        self._judged = False
        self._ports = {sysid: _Station(StationIdentity(sysid)) for sysid in (_ONE, _OTHER)}
        in_force = AuthorityInForce()
        reports = GateReports(self._fault, lambda *_: None, lambda *_: None, lambda *_: None)
        passed = PassedFrames(VEHICLE, self._ports, GateSettings(), in_force, self._to_autopilot, self._fault)
        matters = CompanionMatters(
            self._target,
            self._command,
            lambda _frame: False,
            lambda: ASSUMED.gate,
            None,
            lambda _kind: in_force.view.commander,
            frozenset(),
            lambda *_: None,
        )
        self._gate = Gate(VEHICLE, self._ports, in_force, passed, self._to_autopilot, reports, matters)

    def ask(self, frame: Frame, situation: Situation) -> Answer:
        self._gate.change(situation.view, _NOW)
        verdict = self._gate.up(self._ports[situation.station], frame, _NOW)
        return Answer(verdict.fate, verdict.reason, self._judged, verdict.access)

    def _target(self, _aim: Aim, _station: int, _now: float) -> bool:
        self._judged = True
        return True

    def _command(self, _intent: Intent, _station: int, _now: float) -> bool:
        self._judged = True
        return True

    def _to_autopilot(self, _raw: bytes) -> None:
        """Nothing reaches an autopilot."""

    def _fault(self, where: str, text: str) -> None:
        raise RuntimeError(f"{where}: {text}")
