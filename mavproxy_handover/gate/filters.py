# SPDX-License-Identifier: GPL-3.0-or-later

"""The filters of the gate, after the policy: each may change the verdict on a frame of a station.

The policy (`judge.py`) gives the first verdict, by the class of the frame and by who has authority. Then the frame
passes the filters that see it, in the order of the table in `Filters`: a filter sees frames of some classes, or some
messages of them, and perhaps only those of the station with authority, or of the others. A filter gets the verdict of
the ones before it. The verdict of the last one is final. The order of the table is the rule:

0. Payload authority comes first, because it may be another station's than flight authority. What such a station sends
   has a limit, because the lease travels on the same line to the autopilot. Before it, frames for payload managers on
   board: they take few, and the autopilot gets none of them (`policy/managers.py`).
1. Streams that ran before their station had authority come next: they stay refused, whatever else refuses them.
2. Sticks come before targets, and targets that a filter has dropped cost no check of the situation.
3. The check of commands in flight comes before the commands that the companion carries out: a command that leaves
   energy, fence or coverage is refused, even if the companion would carry it out.
4. A log request that another station's download refuses costs nothing of a station's share.
5. What the commander sends ends a delegation of guided targets after it was judged: a refused command ends none.
6. The limits of questions come last: what is refused anyway costs nothing of a station's share.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.authority.payload import PayloadKind
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.gate.downloads import LOG_REQUESTS
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.intent import TARGET_MESSAGES, Aim, Intent, intent_of
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict, uploads
from mavproxy_handover.gate.operators import REMOTE_ID_MESSAGES
from mavproxy_handover.gate.passed import PassedFrames
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.managers import Taken, taken
from mavproxy_handover.gate.policy.payload import KIND_OF_COMPONENT, PAYLOAD_MESSAGES, payload_kind
from mavproxy_handover.gate.questions import ASKED
from mavproxy_handover.gate.rate_limit import RateLimit
from mavproxy_handover.gate.stale_streams import STICKS, releases
from mavproxy_handover.gate.targets import TargetStreams
from mavproxy_handover.vehicle.profiles import Modes
from mavproxy_handover.wire.frames import Frame, target
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES, message_ids

__all__ = ["PAYLOAD_BYTES_PER_S", "CompanionMatters", "Filter", "Filters"]

#: constants, because Python 3.11 takes 0.1 us to look up a member of an enumeration
_FORWARD: Final = Fate.FORWARD
_CONSUME: Final = Fate.CONSUME
_ON_LOAD: Final = Phase.ON_LOAD
#: the class of a frame; None: the policy drops it before it looks for one
_Class = Access | None
_CLASSES: Final[tuple[_Class, ...]] = (*Access, None)
_STREAMS: Final[frozenset[_Class]] = frozenset((Access.STREAM,))
_COMMANDS: Final[frozenset[_Class]] = frozenset((Access.COMMAND,))
_FEEDS: Final[frozenset[_Class]] = frozenset((Access.FEED,))
_LOGS: Final[frozenset[_Class]] = frozenset((Access.LOG, Access.BULK))
_ORDERS: Final[frozenset[_Class]] = frozenset((Access.COMMAND, Access.SAFEGUARD))
_ALL: Final[frozenset[_Class]] = frozenset(_CLASSES)
_PAYLOADS: Final[frozenset[_Class]] = frozenset((Access.STREAM, Access.COMMAND))
_OF_PAYLOAD: Final = message_ids(*(name for each in PAYLOAD_MESSAGES.values() for name in each)) | COMMAND_MESSAGES
#: reasons of verdicts on functions of the autopilot. At a payload manager its own rules apply instead
_AUTOPILOTS: Final = frozenset(
    (
        GateReason.ALLOWED,
        GateReason.COMPANION,
        GateReason.FEED,
        GateReason.NOT_IN_CONTROL,
        GateReason.LOCKED_WHILE_ARMED,
        GateReason.COMMANDERS_IN_FLIGHT,
    )
)
#: classes of frames whose refusal has no answer
_UNANSWERED: Final = frozenset((Access.STREAM, Access.FEED))
#: classes of frames that the companion takes, to whichever component of the vehicle they are addressed
_COMPANIONS: Final = frozenset((Access.TRANSFER, Access.CONTROL, Access.LIVENESS))
#: streams that lead the aircraft
_LEADS: Final = STICKS | TARGET_MESSAGES | {mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET}
_FILES: Final = frozenset((mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,))
#: bytes a second, and at once, of payload frames of a station that has no flight authority: a stream at 50 Hz
PAYLOAD_BYTES_PER_S: Final = 3000.0


@dataclass(frozen=True, slots=True)
class CompanionMatters:
    """Questions of the gate to the rest of the companion."""

    #: whether a station's guided target may be flown to now
    target_passes: Callable[[Aim, int, float], bool]
    #: whether the commander's command in flight may pass; if not, the operator is told why
    command_passes: Callable[[Intent, int, float], bool]
    #: whether the companion carries out this command in flight, because the autopilot does not know it
    takes_over: Callable[[Frame], bool]
    #: the flight modes of the autopilot's firmware
    modes: Callable[[], Modes]
    #: the commander sends a command, a target or sticks: that ends a delegation to an onboard program. None: no program
    #: can have one
    commander_sends: Callable[[Frame, Verdict, float], None] | None
    #: the station (system id) that has this kind of payload; None: no station
    payload: Callable[[PayloadKind], int | None]
    #: the components that payload managers on board speak as
    managers: frozenset[int]
    #: sends a frame to the payload manager that it is addressed to
    to_manager: Callable[[Frame, float], None]


#: frame, verdict so far, system id of the station, time -> the verdict
Limit = Callable[[Frame, Verdict, int, float], Verdict]
#: the filters of a frame, by its class
_ByClass = Mapping[_Class, tuple[Limit, ...]]


class Filter(NamedTuple):
    """One row of the table."""

    #: what it keeps out, or takes from the autopilot
    what: str
    #: the classes of frames that it sees
    classes: frozenset[_Class]
    limit: Limit
    #: the ids of the messages that it sees; None: all of its classes
    messages: frozenset[int] | None = None
    #: True: it sees frames of the station that has authority only; False: of the other stations only; None: of all
    commands: bool | None = None

    def seen_of(self, msgid: int | None, commands: bool) -> frozenset[_Class]:
        """The classes of the frames that it sees of such a message. `msgid` None: a message that no row names."""
        named = self.messages is None or msgid in self.messages
        return self.classes if named and self.commands in (None, commands) else frozenset()


class Filters:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(self, in_force: AuthorityInForce, passed: PassedFrames, matters: CompanionMatters) -> None:
        self._in_force = in_force
        self._passed = passed
        self._matters = matters
        self._targets = TargetStreams(matters.target_passes)
        self._payload_room = RateLimit(PAYLOAD_BYTES_PER_S, PAYLOAD_BYTES_PER_S)
        stale = passed.stale_streams.limit
        managers = (Filter("frames for payload managers on board that none takes", _ALL, self._manager),)
        self.table: tuple[Filter, ...] = (
            *(managers if matters.managers else ()),
            Filter("payload commands without payload authority", _PAYLOADS, self._payload, _OF_PAYLOAD),
            Filter("sticks and setpoints that ran before their station had authority", _STREAMS, stale),
            Filter("sticks before the vehicle is armed, and in a rehearsal", _STREAMS, self._sticks, STICKS),
            Filter("guided targets that leave energy, fence or coverage", _STREAMS, self._target, TARGET_MESSAGES),
            Filter(
                "commands in flight that leave energy, fence or coverage", _COMMANDS, self._in_flight, commands=True
            ),
            Filter("commands that the companion carries out", _COMMANDS, self._taken_over),
            Filter("notes places of operators, keeps out none", _STREAMS, passed.operators.note, REMOTE_ID_MESSAGES),
            Filter("feeds of stations that are not the source", _FEEDS, passed.feeds.limit),
            Filter("log requests while another station reads one", _LOGS, self._log_turn, LOG_REQUESTS | _FILES),
            *self._ends(matters.commander_sends),
            Filter("questions of observers while the commander's are open", ASKED, self._question, commands=False),
            Filter("other requests of observers for files", _ALL - ASKED, self._question, _FILES, commands=False),
        )
        names = frozenset[int]().union(*(row.messages for row in self.table if row.messages is not None))
        #: the rows of the table that see a frame, by whether its station has authority, its message and its class.
        #: Second: of messages that no row names
        self._rows: tuple[tuple[Mapping[int, _ByClass], _ByClass], ...] = tuple(
            ({msgid: self._limits(msgid, commands) for msgid in names}, self._limits(None, commands))
            for commands in (False, True)
        )

    def _limits(self, msgid: int | None, commands: bool) -> _ByClass:
        seen = [(row.limit, row.seen_of(msgid, commands)) for row in self.table]
        return {access: tuple(limit for limit, classes in seen if access in classes) for access in _CLASSES}

    def limit(self, frame: Frame, verdict: Verdict, station: int, commands: bool, now: float) -> Verdict:
        """The final verdict. `verdict`: the policy's; `commands`: the frame comes from the station that has
        authority."""
        by_message, rest = self._rows[commands]
        for limit in by_message.get(frame.msgid, rest)[verdict.access]:
            verdict = limit(frame, verdict, station, now)
        return verdict

    def _sticks(self, frame: Frame, verdict: Verdict, _station: int, _now: float) -> Verdict:
        view = self._in_force.view
        reason = None
        if view.rehearsal:
            reason = GateReason.REHEARSAL
        elif view.phase is _ON_LOAD and not view.armed:
            reason = GateReason.NOT_ARMED
        if reason is not None and verdict.fate is _FORWARD and not releases(frame):
            return verdict._replace(fate=Fate.DROP, reason=reason)
        return verdict

    def _target(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        if verdict.fate is _FORWARD and self._in_force.view.phase is not _ON_LOAD:
            return self._targets.limit(frame, verdict, station, now, self._matters.modes())
        return verdict

    def _in_flight(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        if verdict.fate is not _CONSUME or self._in_force.view.phase is _ON_LOAD:
            return verdict
        modes = self._matters.modes()
        intent = None if uploads(frame, modes) else intent_of(frame, modes)
        if intent is None:  # a part of an upload ends at the companion
            return verdict
        if self._matters.command_passes(intent, station, now):
            return verdict._replace(fate=Fate.FORWARD, reason=GateReason.ALLOWED)
        return verdict._replace(fate=Fate.REFUSE, reason=GateReason.SITUATION)

    def _taken_over(self, frame: Frame, verdict: Verdict, _station: int, _now: float) -> Verdict:
        view = self._in_force.view
        in_flight = view.phase is not _ON_LOAD and not view.rehearsal
        if verdict.fate is _FORWARD and in_flight and self._matters.takes_over(frame):
            return verdict._replace(fate=Fate.CONSUME, reason=GateReason.COMPANION)
        return verdict

    def _log_turn(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        turn = self._passed.log_turn
        if verdict.fate is not _FORWARD:
            return verdict
        if verdict.access is not Access.LOG:  # a file that is being read
            turn.goes_on(station, now)
            return verdict
        if not turn.takes(station, frame.msgid, station == self._in_force.view.commander, now):
            return verdict._replace(fate=Fate.REFUSE, reason=GateReason.LOG_BUSY)
        return verdict

    def to_manager(self, frame: Frame) -> bool:
        """Whether a frame is addressed to a payload manager on board."""
        aim = target(frame) if self._matters.managers else None
        return aim is not None and aim[1] in self._matters.managers

    def _manager(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        if verdict.reason not in _AUTOPILOTS or verdict.access in _COMPANIONS or not self.to_manager(frame):
            return verdict
        takes = taken(frame, verdict.access)
        if isinstance(takes, PayloadKind):
            return self._of_payload(takes, frame, verdict, station, now)
        if takes is Taken.REFUSES:
            refused = Fate.DROP if verdict.access in _UNANSWERED else Fate.REFUSE
            return verdict._replace(fate=refused, reason=GateReason.MANAGER_TARGET)
        if verdict.reason is GateReason.COMMANDERS_IN_FLIGHT and self._has_payload_of(frame, station):
            return verdict._replace(fate=Fate.FORWARD, reason=GateReason.ALLOWED)  # it slows down no autopilot
        return verdict

    def _has_payload_of(self, frame: Frame, station: int) -> bool:
        aim = target(frame)
        return aim is not None and station == self._matters.payload(KIND_OF_COMPONENT[aim[1]])

    def _payload(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        if verdict.fate is not _FORWARD and verdict.reason is not GateReason.NOT_IN_CONTROL:
            return verdict
        kind = payload_kind(frame)
        return verdict if kind is None else self._of_payload(kind, frame, verdict, station, now)

    def _of_payload(self, kind: PayloadKind, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        """A frame that the station with this kind of payload may send, and no other."""
        holds = station == self._matters.payload(kind)
        refused = Fate.DROP if verdict.access is Access.STREAM else Fate.REFUSE
        if holds and verdict.fate is not _FORWARD:
            if verdict.reason is GateReason.NOT_IN_CONTROL and not self._payload_room.allow(now, len(frame.raw)):
                return verdict._replace(fate=refused, reason=GateReason.TOO_OFTEN)
            if not self.to_manager(frame) and not self._passed.budget.allow(now, len(frame.raw)):
                return verdict._replace(fate=refused, reason=GateReason.LINE_FULL)
            return verdict._replace(fate=Fate.FORWARD, reason=GateReason.ALLOWED)
        if not holds and verdict.fate is _FORWARD:
            return verdict._replace(fate=refused, reason=GateReason.NOT_PAYLOADS)
        return verdict

    def _ends(self, commander_sends: Callable[[Frame, Verdict, float], None] | None) -> tuple[Filter, ...]:
        if commander_sends is None:
            return ()

        def ends(frame: Frame, verdict: Verdict, _station: int, now: float) -> Verdict:
            if not self.to_manager(frame):
                commander_sends(frame, verdict, now)
            return verdict

        what = "a delegation that the commander ends by"
        return (
            Filter(f"{what} its sticks and targets", _STREAMS, ends, _LEADS, commands=True),
            Filter(f"{what} its commands", _ORDERS, ends, commands=True),
        )

    def _question(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        return self._passed.questions.limit(frame, verdict, station, self._in_force.view.commander, now)
