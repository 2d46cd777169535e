# SPDX-License-Identifier: GPL-3.0-or-later

"""The filters of the gate, after the policy: each may change the verdict on a frame of a station.

The policy (`judge.py`) gives the first verdict, by the class of the frame and by who has authority. Then the frame
passes the filters of its class in the order of the table in `Filters`. A filter gets the verdict of the ones before it.
The verdict of the last one is final. The order of the table is the rule:

1. Streams that ran before their station had authority come first: they stay refused, whatever else refuses them.
2. Sticks come before targets, and targets that a filter has dropped cost no check of the situation.
3. Files that the companion serves come before the limits of questions, which go by the class of the request.
4. The check of commands in flight comes before the commands that the companion carries out: a command that leaves
   energy, fence or coverage is refused, even if the companion would carry it out.
5. The limits of questions come last: what is refused anyway costs nothing of a station's share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, Phase
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.intent import TARGET_MESSAGES, Aim, Intent, intent_of
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict, outcome, uploads
from mavproxy_handover.gate.passed import PassedFrames
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.port import Port
from mavproxy_handover.gate.stale_streams import arms
from mavproxy_handover.gate.targets import TargetStreams
from mavproxy_handover.vehicle.profiles import Modes
from mavproxy_handover.wire.frames import Frame

__all__ = ["CompanionMatters", "Filter", "Filters"]

_FTP: Final[int] = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
#: the class of a frame; None: the policy drops it before it looks for one
_Class = Access | None
_CLASSES: Final[tuple[_Class, ...]] = (*Access, None)
_STREAMS: Final[frozenset[_Class]] = frozenset((Access.STREAM,))
_COMMANDS: Final[frozenset[_Class]] = frozenset((Access.COMMAND,))
_ALL: Final[frozenset[_Class]] = frozenset(_CLASSES)


@dataclass(frozen=True, slots=True)
class CompanionMatters:
    """Questions of the gate to the rest of the companion."""

    #: whether a station's guided target may be flown to now
    target_passes: Callable[[Aim, int, float], bool]
    #: whether the commander's command in flight may pass; if not, the operator is told why
    command_passes: Callable[[Intent, int, float], bool]
    #: whether the companion carries out this command in flight, because the autopilot does not know it
    takes_over: Callable[[Frame], bool]
    #: the class of a station's request for a file that the companion serves; None: the file is the autopilot's
    served_file: Callable[[int, Frame], Access | None]
    #: the flight modes of the autopilot's firmware
    modes: Callable[[], Modes]


#: the verdict so far -> the verdict. `commands`: the frame comes from the station that has authority
Limit = Callable[[Port, Frame, Verdict, bool, float], Verdict]


class Filter(NamedTuple):
    """One row of the table."""

    #: what it keeps out, or takes from the autopilot
    what: str
    #: the classes of frames that it sees
    sees: frozenset[_Class]
    limit: Limit
    #: it sees file transfer only
    files: bool = False
    #: it sees frames of stations without authority only
    observers: bool = False

    def concerns(self, access: _Class, *, file: bool, commands: bool) -> bool:
        """Whether it sees frames of this class."""
        return access in self.sees and (file or not self.files) and not (commands and self.observers)


class Filters:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(self, in_force: AuthorityInForce, passed: PassedFrames, matters: CompanionMatters) -> None:
        self._in_force = in_force
        self._passed = passed
        self._matters = matters
        self._targets = TargetStreams(matters.target_passes)
        self.table: tuple[Filter, ...] = (
            Filter("sticks and setpoints that ran before their station had authority", _STREAMS, self._stale),
            Filter("sticks before the vehicle is armed, and in a rehearsal", _STREAMS, self._sticks),
            Filter("guided targets that leave energy, fence or coverage", _STREAMS, self._target),
            Filter("files that the companion serves", _ALL, self._served_file, files=True),
            Filter("commands in flight that leave energy, fence or coverage", _COMMANDS, self._in_flight),
            Filter("commands that the companion carries out", _COMMANDS, self._taken_over),
            Filter("questions of observers while the commander's are open", _ALL, self._question, observers=True),
        )
        #: the filters of a frame, by whether it is file transfer, whether its station has authority, and its class
        self._rows: tuple[tuple[dict[_Class, tuple[Limit, ...]], ...], ...] = tuple(
            tuple(self._limits(file=file, commands=commands) for commands in (False, True)) for file in (False, True)
        )

    def _limits(self, *, file: bool, commands: bool) -> dict[_Class, tuple[Limit, ...]]:
        return {
            access: tuple(row.limit for row in self.table if row.concerns(access, file=file, commands=commands))
            for access in _CLASSES
        }

    def limit(self, port: Port, frame: Frame, verdict: Verdict, commands: bool, now: float) -> Verdict:
        """The final verdict. `verdict`: the policy's; `commands`: the frame comes from the station that has
        authority."""
        for limit in self._rows[frame.msgid == _FTP][commands][verdict.access]:
            verdict = limit(port, frame, verdict, commands, now)
        return verdict

    def _stale(self, port: Port, frame: Frame, verdict: Verdict, _commands: bool, now: float) -> Verdict:
        return self._passed.stale_streams.limit(frame, verdict, port.sysid, now)

    def _sticks(self, _port: Port, frame: Frame, verdict: Verdict, _commands: bool, _now: float) -> Verdict:
        reason = _no_sticks(self._in_force.view)
        if reason is not None and verdict.fate is Fate.FORWARD and arms(frame):
            return verdict._replace(fate=Fate.DROP, reason=reason)
        return verdict

    def _target(self, port: Port, frame: Frame, verdict: Verdict, _commands: bool, now: float) -> Verdict:
        on_ground = self._in_force.view.phase is Phase.ON_LOAD
        if frame.msgid in TARGET_MESSAGES and verdict.fate is Fate.FORWARD and not on_ground:
            return self._targets.limit(frame, verdict, port.sysid, now, self._matters.modes())
        return verdict

    def _served_file(self, port: Port, frame: Frame, verdict: Verdict, commands: bool, _now: float) -> Verdict:
        if verdict.fate is Fate.DROP:
            return verdict
        access = self._matters.served_file(port.sysid, frame)
        if access is None:
            return verdict
        fate, reason = outcome(access, commands, self._in_force.view.armed)
        return Verdict(fate, access, reason, verdict.what)

    def _in_flight(self, port: Port, frame: Frame, verdict: Verdict, commands: bool, now: float) -> Verdict:
        in_flight = self._in_force.view.phase is not Phase.ON_LOAD
        if verdict.fate is not Fate.CONSUME or not commands or not in_flight:
            return verdict
        modes = self._matters.modes()
        intent = None if uploads(frame, modes) else intent_of(frame, modes)
        if intent is None:  # a part of an upload ends at the companion
            return verdict
        if self._matters.command_passes(intent, port.sysid, now):
            return verdict._replace(fate=Fate.FORWARD, reason=GateReason.ALLOWED)
        return verdict._replace(fate=Fate.REFUSE, reason=GateReason.SITUATION)

    def _taken_over(self, _port: Port, frame: Frame, verdict: Verdict, _commands: bool, _now: float) -> Verdict:
        view = self._in_force.view
        in_flight = view.phase is not Phase.ON_LOAD and not view.rehearsal
        if verdict.fate is Fate.FORWARD and in_flight and self._matters.takes_over(frame):
            return verdict._replace(fate=Fate.CONSUME, reason=GateReason.COMPANION)
        return verdict

    def _question(self, port: Port, frame: Frame, verdict: Verdict, _commands: bool, now: float) -> Verdict:
        return self._passed.questions.limit(frame, verdict, port.sysid, self._in_force.view.commander, now)


def _no_sticks(view: AuthorityView) -> GateReason | None:
    """Why no station's sticks pass now; None: the commander's pass."""
    if view.rehearsal:
        return GateReason.REHEARSAL
    return GateReason.NOT_ARMED if view.phase is Phase.ON_LOAD and not view.armed else None
