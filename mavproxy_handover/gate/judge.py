# SPDX-License-Identifier: GPL-3.0-or-later

"""The gate's judgement: one pure, total function from a frame and who commands to what becomes of the frame.

Rules, in this order; the first that applies decides:

1. Identity. A frame from a station's link that claims the vehicle's system id, or any id that is not that
   station's, is dropped.
2. Default deny. A message without a row in the policy is dropped.
3. Target. A frame aimed at another system is not for us: dropped. Target 0 means everybody, so us too.
   A command or file-transfer opcode without a row is then refused.
4. The class of the row (`Access`), whether the sender commands, and for what safeguards rest on and for reads that cost
   the commander its telemetry, whether the vehicle is armed. The whole of authority is one comparison: the station's
   system id with `AuthorityView.commander`. When authority is lost the view has no commander, so nobody commands; no
   phase needs a rule of its own.
5. While the vehicle is ON_LOAD, what starts a flight is the companion's matter: START (MAV_CMD_MISSION_START) from the
   commander it carries out itself, and what else arms or takes off it lets pass only when START may be.
6. What would pass but is aimed at the companion's own component is refused: it has nothing there to command,
   read or set but what it consumes.
7. In flight, the commander's commands that could leave energy, fence or coverage (`intent`) are the companion's matter:
   it has them passed on, or refused, when it has seen what they would leave. So is every upload of a mission or a
   fence (`STAGED`), which ends at the companion.
8. In a rehearsal nobody's START, arming, take-off or motor test passes; that is the reason it is refused for, whoever
   sent it: with control it would not pass either.

Frames of further system ids behind a station (its `sysids`) are judged as the station's own, except heartbeats:
only the station's own may keep the autopilot's GCS failsafe quiet, or a tracker would vouch for a dead operator.

Of the station's own system id only the `components` that the configuration gives it are the station: a camera or a
tracker with that id has no authority, is no sign of life and has no part in a transfer. It may read.

MAVLink 1 frames are judged like MAVLink 2 frames. Whether a link accepts them is a matter of signing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, Phase
from mavproxy_handover.gate.intent import INTENT_MESSAGES, intent_of
from mavproxy_handover.gate.policy.modes import COPTER, Modes
from mavproxy_handover.gate.policy.parts import MISSION_TYPE_MESSAGES
from mavproxy_handover.gate.policy.rows import MESSAGE_ROWS, TAKE_OFF_MESSAGES, Access, Row, classify, moves, takes_off
from mavproxy_handover.wire.frames import Frame, field_int, target, target_places
from mavproxy_handover.wire.ids import COMPANION_COMPID, MISSION_START, STATION_COMPIDS

__all__ = ["Fate", "GateReason", "StationIdentity", "Verdict", "judge", "outcome", "uploads"]


class Fate(Enum):
    """What becomes of a frame."""

    FORWARD = "forward"  #: to the autopilot, byte for byte
    CONSUME = "consume"  #: the companion's own business
    REFUSE = "refuse"  #: not passed on; the sender is told where its protocol has an answer
    DROP = "drop"  #: not passed on, no answer

    #: as in `Access`
    __hash__ = object.__hash__


class GateReason(Enum):
    """Why."""

    ALLOWED = "allowed"
    COMPANION = "companion"  #: consumed: the companion itself deals with it
    NOT_IN_CONTROL = "not in control"  #: only the commander may
    OBSERVER_RATES = "observer rates"  #: consumed: the companion thins what flows anyway
    COMMANDERS_IN_FLIGHT = "the commander's alone in flight"  #: answers to it slow down what the commander hears
    LOCKED_WHILE_ARMED = "locked while armed"  #: what safeguards rest on; on the ground the commander may
    LIVENESS_NOT_COMMANDER = "liveness, not commander"  #: a heartbeat that the autopilot must not count
    MAINTENANCE_ONLY = "maintenance only"  #: over no radio link
    NEVER = "never"  #: no station has a reason to send it
    SPOOFED_VEHICLE = "spoofed vehicle"  #: claims the vehicle's system id
    SPOOFED_STATION = "spoofed station"  #: claims a system id that is not this station's
    UNKNOWN_MESSAGE = "unknown message"
    UNKNOWN_COMMAND = "unknown command"  #: or file-transfer opcode, or mission type
    TOO_MANY = "too many questions"  #: of a station that does not command (`questions`)
    FILE_BUSY = "the commander uses file transfer"  #: and the autopilot has only one open (`questions`)
    COMPONENT = "component without authority"  #: of the station's own id, and none of its components
    OTHER_TARGET = "other target"  #: aimed at another system
    NOT_ARMED = "not armed: sticks could arm"  #: on the ground; to arm needs what START needs
    RAN_BEFORE = "it ran before the station had control"  #: sticks or setpoints that have not paused since (`latent`)
    COMPANION_TARGET = "companion target"  #: aimed at the companion's component, which does not take it
    REHEARSAL = "rehearsal: nothing arms"  #: the aircraft is carried (`core/authority/rehearsal.py`)
    NO_NUMBER = "a number in it is none"  #: a target's NaN or infinity
    SITUATION = "it would leave energy, fence or coverage"  #: in flight, or not to be judged by now

    #: as in `Access`
    __hash__ = object.__hash__


@dataclass(frozen=True, slots=True)
class StationIdentity:
    """Who may speak on a station's links: `sysid`, the station, and `sysids`, all allowed ids, its own among them.

    Raises ValueError for ids outside 1..255 (0 is everybody in MAVLink, never somebody).
    """

    sysid: int
    sysids: frozenset[int] = field(default_factory=frozenset)
    #: the components of `sysid` that are the station
    components: frozenset[int] = STATION_COMPIDS

    def __post_init__(self) -> None:
        everyone = self.sysids | {self.sysid}
        for sysid in everyone:
            if not 1 <= sysid <= 255:
                raise ValueError(f"system id {sysid} of station {self.sysid}: must be 1 to 255")
        object.__setattr__(self, "sysids", everyone)

    def speaks(self, frame: Frame) -> bool:
        """Whether a frame of one of these ids is the station's word: of its own id, by one of its components."""
        return frame.compid in self.components or frame.sysid != self.sysid


class Verdict(NamedTuple):
    """What becomes of a frame and why. `access` is None if the policy has no row for it.

    `what` names the frame for people: "COMMAND_LONG/MAV_CMD_NAV_LAND".
    """

    fate: Fate
    access: Access | None
    reason: GateReason
    what: str


#: Outcome by class for the commander and for any other station, and of an armed vehicle where that differs. Rule 4 as
#: data.
_FOR_COMMANDER = {
    Access.READ: (Fate.FORWARD, GateReason.ALLOWED),
    Access.BULK: (Fate.FORWARD, GateReason.ALLOWED),
    Access.LIVENESS: (Fate.FORWARD, GateReason.ALLOWED),
    Access.COMMAND: (Fate.FORWARD, GateReason.ALLOWED),
    Access.SAFEGUARD: (Fate.FORWARD, GateReason.ALLOWED),
    Access.STREAM: (Fate.FORWARD, GateReason.ALLOWED),
    Access.ANSWERED: (Fate.FORWARD, GateReason.ALLOWED),
    Access.RALLY_READ: (Fate.CONSUME, GateReason.COMPANION),
    Access.RALLY_WRITE: (Fate.CONSUME, GateReason.COMPANION),
    Access.TRANSFER: (Fate.CONSUME, GateReason.COMPANION),
    Access.CONTROL: (Fate.CONSUME, GateReason.COMPANION),
    Access.MAINTENANCE: (Fate.REFUSE, GateReason.MAINTENANCE_ONLY),
    Access.NEVER: (Fate.DROP, GateReason.NEVER),
}
_FOR_COMMANDER_ARMED = {**_FOR_COMMANDER, Access.SAFEGUARD: (Fate.REFUSE, GateReason.LOCKED_WHILE_ARMED)}
_FOR_OTHERS = {
    Access.READ: (Fate.FORWARD, GateReason.ALLOWED),
    Access.BULK: (Fate.FORWARD, GateReason.ALLOWED),
    Access.LIVENESS: (Fate.CONSUME, GateReason.LIVENESS_NOT_COMMANDER),
    Access.COMMAND: (Fate.REFUSE, GateReason.NOT_IN_CONTROL),
    Access.SAFEGUARD: (Fate.REFUSE, GateReason.NOT_IN_CONTROL),
    Access.STREAM: (Fate.DROP, GateReason.NOT_IN_CONTROL),
    Access.ANSWERED: (Fate.CONSUME, GateReason.OBSERVER_RATES),
    Access.RALLY_READ: (Fate.CONSUME, GateReason.COMPANION),
    Access.RALLY_WRITE: (Fate.REFUSE, GateReason.NOT_IN_CONTROL),
    Access.TRANSFER: (Fate.CONSUME, GateReason.COMPANION),
    Access.CONTROL: (Fate.CONSUME, GateReason.COMPANION),
    Access.MAINTENANCE: (Fate.REFUSE, GateReason.MAINTENANCE_ONLY),
    Access.NEVER: (Fate.DROP, GateReason.NEVER),
}
_FOR_OTHERS_ARMED = {**_FOR_OTHERS, Access.BULK: (Fate.REFUSE, GateReason.COMMANDERS_IN_FLIGHT)}


#: what is the station's own word, and no component's beside it; and what has no answer
_STATIONS_OWN: Final = frozenset((Access.TRANSFER, Access.CONTROL, Access.LIVENESS))
_UNANSWERED: Final = frozenset((Access.TRANSFER, Access.LIVENESS, Access.STREAM))


def outcome(access: Access, commands: bool, armed: bool) -> tuple[Fate, GateReason]:
    """What becomes of a class (rule 4), before rules 5 and 6."""
    if commands:
        return _FOR_COMMANDER_ARMED[access] if armed else _FOR_COMMANDER[access]
    return _FOR_OTHERS_ARMED[access] if armed else _FOR_OTHERS[access]


def judge(
    frame: Frame, station: StationIdentity, view: AuthorityView, vehicle_sysid: int, modes: Modes = COPTER
) -> Verdict:
    """Judge one frame that arrived on a link of `station`. Never raises, whatever the frame holds. `modes`: those of
    the aircraft's firmware.

    The caller counts heartbeats of the commander itself: they are forwarded, and they are its sign of life too.
    """
    usual = _USUAL.get(frame.msgid)
    own = frame.sysid in station.sysids and (frame.compid in station.components or frame.sysid != station.sysid)
    if usual is not None and frame.known and own and frame.sysid != vehicle_sysid:
        length, system, component, others, commander = usual
        payload = frame.payload
        if system is None or (
            len(payload) >= length
            and (payload[system] == vehicle_sysid or not payload[system])
            and (component is None or payload[component] != COMPANION_COMPID)
        ):
            return commander if station.sysid == view.commander else others
    row = classify(frame)
    fate, reason = _decide(frame, row, station, view, vehicle_sysid, modes)
    return Verdict(fate, row.access, reason, row.what)


_ACK: Final[int] = mavlink.MAVLINK_MSG_ID_MISSION_ACK
#: MAV_MISSION_TYPEs whose uploads end at the companion in flight, and what may write such a list, or call that off
STAGED: Final = frozenset({mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE})
_WRITERS: Final = frozenset(
    {_ACK, *(msgid for msgid, cls in mavlink.mavlink_map.items() if cls.msgname in MISSION_TYPE_MESSAGES)}
)

_LOOKED_AT: Final = _WRITERS | INTENT_MESSAGES

#: Length of the payload, where target system and component are in it, verdict on others' frames and the commander's.
_Usual = tuple[int, int | None, int | None, Verdict, Verdict]


def _usual(msgid: int, row: Row) -> _Usual:
    assert row.access is not None
    # armed or not is the same here, see below
    found = (outcome(row.access, commands, armed=True) for commands in (False, True))
    others, commander = (Verdict(fate, row.access, reason, row.what) for fate, reason in found)
    return (*target_places(msgid), others, commander)


def _usual_by_id() -> dict[int, _Usual]:
    same = [
        access
        for access in Access
        if all(outcome(access, commands, False) == outcome(access, commands, True) for commands in (False, True))
    ]
    return {
        msgid: _usual(msgid, row)
        for msgid, row in MESSAGE_ROWS.items()
        if row.access in same
        and row.access is not Access.LIVENESS  # there it matters whose heartbeat it is
        and msgid not in TAKE_OFF_MESSAGES
        and msgid not in INTENT_MESSAGES
        and msgid != _ACK
    }


#: What `_decide` finds for most frames, worked out beforehand: for messages whose id alone decides, armed or not. The
#: verdicts are those of rule 4, for frames that rules 1 to 3 and 6 have nothing against.
_USUAL: Final = _usual_by_id()


def _decide(
    frame: Frame, row: Row, station: StationIdentity, view: AuthorityView, vehicle_sysid: int, modes: Modes
) -> tuple[Fate, GateReason]:
    if frame.sysid == vehicle_sysid:
        return Fate.DROP, GateReason.SPOOFED_VEHICLE
    if frame.sysid not in station.sysids:
        return Fate.DROP, GateReason.SPOOFED_STATION
    if not frame.known or (row.access is None and row.part is None):
        return Fate.DROP, GateReason.UNKNOWN_MESSAGE
    aim = target(frame)
    if aim is not None and aim[0] not in (0, vehicle_sysid):
        return Fate.DROP, GateReason.OTHER_TARGET
    if row.access is None:
        return Fate.REFUSE, GateReason.UNKNOWN_COMMAND

    if view.rehearsal and moves(frame, row, modes):
        return Fate.REFUSE, GateReason.REHEARSAL
    speaks = station.speaks(frame)
    commands = station.sysid == view.commander and speaks
    if row.access is Access.LIVENESS and frame.sysid != station.sysid:
        commands = False
    fate, reason = outcome(row.access, commands, view.armed)
    if not speaks and (reason is GateReason.NOT_IN_CONTROL or row.access in _STATIONS_OWN):
        return (Fate.DROP if row.access in _UNANSWERED else Fate.REFUSE), GateReason.COMPONENT
    if fate is not Fate.FORWARD:
        return fate, reason
    on_ground = row.access is Access.COMMAND and view.phase is Phase.ON_LOAD
    if on_ground and row.part == MISSION_START:
        return Fate.CONSUME, GateReason.COMPANION
    if aim is not None and aim[1] == COMPANION_COMPID:
        return Fate.DROP if row.access is Access.STREAM else Fate.REFUSE, GateReason.COMPANION_TARGET
    if on_ground and takes_off(frame, row, modes):
        return Fate.CONSUME, GateReason.COMPANION
    may_be = commands and frame.msgid in _LOOKED_AT and view.phase is not Phase.ON_LOAD
    if may_be and (uploads(frame, modes) or intent_of(frame, modes) is not None):
        return Fate.CONSUME, GateReason.COMPANION
    return fate, reason


def uploads(frame: Frame, modes: Modes = COPTER) -> bool:
    """Whether a frame is a part of an upload that ends at the companion in flight (rule 7)."""
    if frame.msgid not in _WRITERS or field_int(frame, "mission_type") not in STAGED:
        return False
    return frame.msgid not in INTENT_MESSAGES or intent_of(frame, modes) is None
