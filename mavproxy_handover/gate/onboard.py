# SPDX-License-Identifier: GPL-3.0-or-later

"""Judges frames of onboard programs: software on the companion with a link of its own (`[[onboard]]`).

A program speaks as one component of the vehicle. It may send what its rights contain (`policy/onboard.py`), and read.
It never has authority: no right contains arming, modes, parameters, missions, file transfer or a transfer of authority.
Rules, in this order; the first that applies decides:

1. Identity. A frame without the vehicle's system id, or with another component than the program's, is dropped.
2. Default deny. A message that no definition is known of is dropped.
3. Target. A frame for another system is dropped, unless it is the answer of a payload manager to a station. A frame for
   the companion's own component is refused.
4. Right. A message or command in none of the program's rights is refused. Every message of `SENSORS` is named in the
   configuration, one by one.
5. The filters of `OnboardFilters`, in the order of their table: rate and size, guided targets, payload.

Each refusal is answered in its protocol, and told once in words (`replies`). A stream that is refused is not answered
frame by frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.authority.payload import PayloadKind
from mavproxy_handover.gate.intent import Aim
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.managers import MANAGER_SAYS
from mavproxy_handover.gate.policy.onboard import GUIDED, HEARTBEAT_HZ, READ_HZ, READS, SENSORS, Moves, Right
from mavproxy_handover.gate.policy.payload import payload_kind
from mavproxy_handover.gate.policy.rows import Row, classify
from mavproxy_handover.gate.rate_limit import RateLimit
from mavproxy_handover.gate.targets import TargetStreams
from mavproxy_handover.vehicle.profiles import Modes
from mavproxy_handover.wire.frames import Frame, target
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES, message_ids

__all__ = ["OnboardFilters", "OnboardMatters", "OnboardRights", "judge_onboard", "says"]

_HEARTBEAT: Final = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_LANDING_TARGET: Final = mavlink.MAVLINK_MSG_ID_LANDING_TARGET
_SENSORS: Final = message_ids(*SENSORS)
_ESTIMATES: Final = message_ids(*(sensor.name for sensor in SENSORS.values() if sensor.moves is Moves.ESTIMATE))
_GUIDED: Final = message_ids(*GUIDED)
_READS: Final = message_ids(*READS)
_SAYS: Final = message_ids(*MANAGER_SAYS)
#: messages of one kind at once
_BURST: Final = 10.0
#: bytes at once, in seconds of the rate; a longest frame always passes
_BURST_S: Final = 1.0
_LONGEST: Final = 280.0
#: guided targets a second
_TARGET_HZ: Final = 50.0
#: streams are refused without an answer to each frame
_UNANSWERED: Final = _SENSORS | _GUIDED


@dataclass(frozen=True, slots=True)
class OnboardRights:
    """The identity and the rights of one program."""

    name: str
    component: int
    rights: frozenset[Right] = frozenset()
    #: names of the sensor messages that it may send
    sensors: frozenset[str] = frozenset()
    #: bytes a second of all that passes
    bytes_per_s: float = 2500.0
    #: its LANDING_TARGET leads a landing at most so far (m)
    landing_m: float = 10.0
    #: ids of these messages
    sensor_ids: frozenset[int] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "sensor_ids", message_ids(*self.sensors) if Right.SENSORS in self.rights else frozenset()
        )


class _Passing(NamedTuple):
    """The right by which a frame passes, and the class of its verdict."""

    right: Right | None
    access: Access


def _passing(frame: Frame, row: Row, program: OnboardRights) -> _Passing | None:
    """The right by which a frame may pass; None: no right of the program contains it."""
    msgid = frame.msgid
    if msgid == _HEARTBEAT:
        return _Passing(None, Access.LIVENESS)
    if msgid in program.sensor_ids:
        return _Passing(Right.SENSORS, Access.STREAM)
    if msgid in _GUIDED and Right.GUIDED in program.rights:
        return _Passing(Right.GUIDED, Access.STREAM)
    if msgid in _READS or (msgid in COMMAND_MESSAGES and row.access is Access.READ):
        return _Passing(None, Access.READ)
    if says(frame, program):
        return _Passing(Right.MANAGER, Access.STREAM)
    if Right.PAYLOAD in program.rights and payload_kind(frame) is not None:
        return _Passing(Right.PAYLOAD, Access.STREAM if row.access is Access.STREAM else Access.COMMAND)
    return None


def says(frame: Frame, program: OnboardRights) -> bool:
    """Whether a frame is what a payload manager tells the stations."""
    return frame.msgid in _SAYS and Right.MANAGER in program.rights


def judge_onboard(frame: Frame, program: OnboardRights, vehicle: int) -> Verdict:
    """The verdict on a frame of an onboard program by its identity and its rights alone. Total and pure.

    `vehicle`: the vehicle's system id.
    """
    row = classify(frame)
    if frame.sysid != vehicle:
        return Verdict(Fate.DROP, row.access, GateReason.SPOOFED_STATION, row.what)
    if frame.compid != program.component:
        return Verdict(Fate.DROP, row.access, GateReason.COMPONENT, row.what)
    if not frame.known:
        return Verdict(Fate.DROP, row.access, GateReason.UNKNOWN_MESSAGE, row.what)
    aim = target(frame)
    if aim is not None and aim[0] not in (0, vehicle) and not says(frame, program):
        return Verdict(Fate.DROP, row.access, GateReason.OTHER_TARGET, row.what)
    passing = _passing(frame, row, program)
    fate = Fate.DROP if frame.msgid in _UNANSWERED else Fate.REFUSE
    if passing is None:
        return Verdict(fate, row.access, GateReason.NO_RIGHT, row.what)
    if aim is not None and aim[1] == COMPANION_COMPID:
        return Verdict(fate, passing.access, GateReason.COMPANION_TARGET, row.what)
    if passing.right is Right.GUIDED and aim is not None and aim[1] not in (0, AUTOPILOT_COMPID):
        return Verdict(Fate.DROP, passing.access, GateReason.OTHER_TARGET, row.what)
    return Verdict(Fate.FORWARD, passing.access, GateReason.ALLOWED, row.what)


@dataclass(frozen=True, slots=True)
class OnboardMatters:
    """Questions about onboard programs to the rest of the companion."""

    #: whether the commander has delegated guided targets to the program of this name
    delegated: Callable[[str, float], bool]
    #: whether a guided target of the program of this name may be flown to
    target_passes: Callable[[Aim, str, float], bool]
    #: whether the program of this name has this kind of payload
    payload: Callable[[PayloadKind, str], bool]
    #: the flight modes of the autopilot's firmware
    modes: Callable[[], Modes]
    #: whether the line to the autopilot has room for so many bytes at this time; if so, they count
    has_room: Callable[[float, int], bool]
    #: whether a LANDING_TARGET may pass that may lead a landing so far (m), at this time
    landing: Callable[[Frame, float, float], GateReason]
    #: whether programs may move the position estimate now
    may_move_estimate: Callable[[], bool]


#: frame, verdict so far, time -> the verdict
_Limit = Callable[[Frame, Verdict, float], Verdict]


class OnboardFilters:
    """The filters of one program, after its rights. Times are monotonic seconds."""

    def __init__(self, program: OnboardRights, matters: OnboardMatters) -> None:
        self._program = program
        self._matters = matters
        self._rates: dict[int, RateLimit] = {}
        self._bytes = RateLimit(program.bytes_per_s, max(_LONGEST, program.bytes_per_s * _BURST_S))
        self._targets = TargetStreams(lambda aim, _station, now: matters.target_passes(aim, program.name, now))
        #: what each filter keeps out, and the filter
        self.table: tuple[tuple[str, _Limit], ...] = (
            ("messages that come too often", self._rate),
            ("guided targets that are not delegated", self._delegated),
            ("guided targets that leave energy, fence or coverage", self._target),
            ("payload commands without payload authority", self._payload),
            ("landing targets that lead the landing away, or keep it from ending", self._landing),
            ("positions while estimate and GPS receiver disagree", self._estimate),
            ("more bytes than the link to the autopilot has room for", self._size),
        )

    def limit(self, frame: Frame, verdict: Verdict, now: float) -> Verdict:
        """The final verdict. `verdict`: that of `judge_onboard`."""
        for _what, limit in self.table:
            if verdict.fate is not Fate.FORWARD:
                return verdict
            verdict = limit(frame, verdict, now)
        return verdict

    def _rate(self, frame: Frame, verdict: Verdict, now: float) -> Verdict:
        msgid = frame.msgid
        rate = self._rates.get(msgid)
        if rate is None:  # bounded by the messages that pass
            hz = _most_hz(msgid)
            rate = self._rates[msgid] = RateLimit(hz, hz if msgid in _SAYS else _BURST)
        if rate.allow(now):
            return verdict
        fate = Fate.REFUSE if msgid in COMMAND_MESSAGES else Fate.DROP
        return verdict._replace(fate=fate, reason=GateReason.TOO_OFTEN)

    def _delegated(self, frame: Frame, verdict: Verdict, now: float) -> Verdict:
        if frame.msgid in _GUIDED and not self._matters.delegated(self._program.name, now):
            return verdict._replace(fate=Fate.DROP, reason=GateReason.NOT_DELEGATED)
        return verdict

    def _target(self, frame: Frame, verdict: Verdict, now: float) -> Verdict:
        if frame.msgid in _GUIDED:
            return self._targets.limit(frame, verdict, 0, now, self._matters.modes())
        return verdict

    def _payload(self, frame: Frame, verdict: Verdict, _now: float) -> Verdict:
        kind = payload_kind(frame)
        if kind is not None and not self._matters.payload(kind, self._program.name):
            fate = Fate.DROP if verdict.access is Access.STREAM else Fate.REFUSE
            return verdict._replace(fate=fate, reason=GateReason.NOT_PAYLOADS)
        return verdict

    def _landing(self, frame: Frame, verdict: Verdict, now: float) -> Verdict:
        if frame.msgid != _LANDING_TARGET:
            return verdict
        reason = self._matters.landing(frame, self._program.landing_m, now)
        return verdict if reason is GateReason.ALLOWED else verdict._replace(fate=Fate.DROP, reason=reason)

    def _estimate(self, frame: Frame, verdict: Verdict, _now: float) -> Verdict:
        if frame.msgid not in _ESTIMATES or self._matters.may_move_estimate():
            return verdict
        return verdict._replace(fate=Fate.DROP, reason=GateReason.ESTIMATE)

    def _size(self, frame: Frame, verdict: Verdict, now: float) -> Verdict:
        size, reason = len(frame.raw), GateReason.ALLOWED
        if not self._bytes.allow(now, size):
            reason = GateReason.TOO_OFTEN
        elif not says(frame, self._program) and not self._matters.has_room(now, size):
            reason = GateReason.LINE_FULL
        if reason is GateReason.ALLOWED:
            return verdict
        fate = Fate.REFUSE if frame.msgid in COMMAND_MESSAGES else Fate.DROP
        return verdict._replace(fate=fate, reason=reason)


_HZ: Final = {**{sensor.name: sensor.most_hz for sensor in SENSORS.values()}, **MANAGER_SAYS}
_BY_ID: Final = {msgid: hz for name, hz in _HZ.items() for msgid in message_ids(name)}


def _most_hz(msgid: int) -> float:
    """Messages of this kind a second that pass."""
    if msgid == _HEARTBEAT:
        return HEARTBEAT_HZ
    if msgid in _GUIDED:
        return _TARGET_HZ
    return _BY_ID.get(msgid, READ_HZ)
