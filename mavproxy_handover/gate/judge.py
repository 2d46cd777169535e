# SPDX-License-Identifier: GPL-3.0-or-later

"""Judges a frame of a station: one pure, total function of the frame and of the authority in force.

Rules, in this order; the first that applies decides:

1. Identity. A frame on a station's link with the vehicle's system id, or with an id that is not that station's, is
   dropped.
2. Default deny. A message without a row in the policy is dropped.
3. Target. A frame for another system is dropped. Target 0 means all systems, and so includes the vehicle. A command or
   file-transfer opcode without a row is then refused.
4. The class of the row (`Access`) and whether the sender commands. For safeguards, and for reads that cost the
   commander telemetry, also whether the vehicle is armed. Authority is one comparison: the station's system id with
   `AuthorityView.commander`. When authority is lost the view has no commander, so no station commands, and no phase
   needs a rule of its own.
5. While the vehicle is ON_LOAD, the companion handles what starts a flight. It carries out START
   (MAV_CMD_MISSION_START) of the commander itself. Other commands that arm or take off pass only when START would be
   accepted.
6. A frame that would pass but is addressed to the companion's own component is refused, unless the companion consumes
   it: there is nothing to command, read or set.
7. In flight, commands of the commander that could leave energy, fence or coverage (`intent`) do not pass by this
   verdict: a filter of the gate lets them pass, or refuses them. Every upload of a mission or a fence (`STAGED`) ends
   at the companion.
8. A feed is left to a filter of the gate, from every station (`feeds.py`).
9. In a rehearsal no START, arming, take-off or motor test passes. That is the reason of the refusal for every station:
   with control such a command would not pass either.

Frames of further system ids of a station (its `sysids`) are judged as the station's own, except heartbeats. Only the
station's own heartbeat may keep the autopilot's GCS failsafe quiet: otherwise a tracker could stand in for a dead
operator.

Of the station's own system id only the `components` of the configuration are the station. A camera or a tracker with
that id has no authority, is no sign of life and takes no part in a transfer. It may read.

MAVLink 1 frames are judged like MAVLink 2 frames. Signing decides whether a link accepts them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, Phase
from mavproxy_handover.gate.intent import INTENT_MESSAGES, intent_of
from mavproxy_handover.gate.policy.parts import MISSION_TYPE_MESSAGES
from mavproxy_handover.gate.policy.rows import MESSAGE_ROWS, TAKE_OFF_MESSAGES, Access, Row, classify, moves, takes_off
from mavproxy_handover.vehicle.profiles import ASSUMED, Modes
from mavproxy_handover.wire.frames import Frame, field_int, target, target_offsets
from mavproxy_handover.wire.ids import COMPANION_COMPID, MISSION_START, STATION_COMPIDS
from mavproxy_handover.wire.message_ids import message_ids

__all__ = ["Fate", "GateReason", "StationIdentity", "Verdict", "decide", "judge", "outcome", "uploads", "usual"]


class Fate(Enum):
    """The fate of a frame."""

    FORWARD = "forward"  #: it goes to the autopilot, byte for byte
    CONSUME = "consume"  #: the companion itself handles it
    REFUSE = "refuse"  #: not passed on; the sender gets an answer if its protocol has one
    DROP = "drop"  #: not passed on, no answer

    #: as in `Access`
    __hash__ = object.__hash__


class GateReason(Enum):
    """The reason of a verdict."""

    ALLOWED = "allowed"
    COMPANION = "companion"  #: consumed: the companion itself handles it
    NOT_IN_CONTROL = "not in control"  #: only the commander may
    FEED = "feed"  #: consumed: a filter passes it on if its station is the source (`gate/feeds.py`)
    FEED_STANDBY = "another station is the source"
    FEED_NOT_NAMED = "no source of this feed"  #: the configuration does not name the station
    FEED_PLACE = "RTK base in another place"
    FEED_TOO_MUCH = "too much of this feed"
    FEED_SENSELESS = "a feed with values that cannot be"
    FEED_FAULT = "fault of the feeds"
    OBSERVER_RATES = "observer rates"  #: consumed: the companion thins the streams that flow already
    ON_GROUND = "on the ground only"  #: while the vehicle is disarmed
    LOG_BUSY = "another station reads a log"  #: one download at a time (`log_turn`)
    COMMANDERS_IN_FLIGHT = "only the commander's in flight"  #: answers to it slow down the commander's telemetry
    LOCKED_WHILE_ARMED = "locked while armed"  #: safeguards rest on it; on the ground the commander may
    LIVENESS_NOT_COMMANDER = "liveness, not commander"  #: a heartbeat that the autopilot must not count
    MAINTENANCE_ONLY = "maintenance only"  #: over no radio link
    ABSENT = "no such file"  #: the vehicle answers as if it did not have it
    NEVER = "never"  #: no station has a reason to send it
    SPOOFED_VEHICLE = "spoofed vehicle"  #: claims the vehicle's system id
    SPOOFED_STATION = "spoofed station"  #: claims a system id that is not this station's
    UNKNOWN_MESSAGE = "unknown message"
    UNKNOWN_COMMAND = "unknown command"  #: or file-transfer opcode, or mission type
    TOO_MANY = "too many questions"  #: of a station that does not command (`questions`)
    FILE_BUSY = "the commander uses file transfer"  #: and the autopilot has only one open (`questions`)
    COMPONENT = "component without authority"  #: it has the station's id, but is none of its components
    OTHER_TARGET = "other target"  #: addressed to another system
    NOT_ARMED = "not armed: sticks could arm"  #: on the ground; arming needs what START needs
    RAN_BEFORE = (
        "it ran before the station had control"  #: sticks or setpoints that have not paused since (`stale_streams`)
    )
    COMPANION_TARGET = "companion target"  #: addressed to the companion's component, which does not accept it
    REHEARSAL = "rehearsal: nothing arms"  #: people carry the aircraft (`core/authority/rehearsal.py`)
    NO_NUMBER = "a number in it is none"  #: a target with NaN or infinity
    SITUATION = "it would leave energy, fence or coverage"  #: in flight, or it cannot be judged now
    NO_RIGHT = "not in the rights of this onboard program"  #: `[[onboard]]` (`onboard`)
    NOT_DELEGATED = "no guided targets are delegated to this onboard program"
    TOO_OFTEN = "more than its limit"  #: of an onboard program, or of a station that has only the payload
    LANDING_AWAY = "it leads the landing away"  #: LANDING_TARGET (`operator/onboard/landing_targets`)
    LANDING_HELD = "the aircraft stands and has not landed"  #: LANDING_TARGET, too
    ESTIMATE = "estimate and GPS receiver disagree"  #: of an onboard program (`operator/onboard/estimate_watch`)
    LINE_FULL = "the line to the autopilot has no more room"  #: the budget of all together (`line_budget`)
    NOT_PAYLOADS = "another has payload authority"  #: `[payload]` (`core/authority/payload.py`)
    MANAGER_TARGET = "no command of a camera, gimbal or winch"  #: to an onboard manager (`policy/managers.py`)

    #: as in `Access`
    __hash__ = object.__hash__


@dataclass(frozen=True, slots=True)
class StationIdentity:
    """The ids that may send on a station's links: its own `sysid`, and all allowed `sysids` (its own included).

    Raises ValueError for ids outside 1..255 (0 means all systems in MAVLink, never one).
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
        """Whether a frame of one of these ids speaks for the station: not another component of the station's id."""
        return frame.compid in self.components or frame.sysid != self.sysid


class Verdict(NamedTuple):
    """The verdict on a frame, with its reason. `access` is None if the policy has no row for the frame.

    `what` names the frame for people: "COMMAND_LONG/MAV_CMD_NAV_LAND".
    """

    fate: Fate
    access: Access | None
    reason: GateReason
    what: str


#: Rule 4 as data: the outcome by class for the commander and for other stations, and with an armed vehicle if that
#: differs.
_FOR_COMMANDER = {
    Access.READ: (Fate.FORWARD, GateReason.ALLOWED),
    Access.BULK: (Fate.FORWARD, GateReason.ALLOWED),
    Access.LIVENESS: (Fate.FORWARD, GateReason.ALLOWED),
    Access.COMMAND: (Fate.FORWARD, GateReason.ALLOWED),
    Access.SAFEGUARD: (Fate.FORWARD, GateReason.ALLOWED),
    Access.LOG: (Fate.FORWARD, GateReason.ALLOWED),
    Access.STREAM: (Fate.FORWARD, GateReason.ALLOWED),
    Access.FEED: (Fate.CONSUME, GateReason.FEED),
    Access.ANSWERED: (Fate.FORWARD, GateReason.ALLOWED),
    Access.RALLY_READ: (Fate.CONSUME, GateReason.COMPANION),
    Access.RALLY_WRITE: (Fate.CONSUME, GateReason.COMPANION),
    Access.TRANSFER: (Fate.CONSUME, GateReason.COMPANION),
    Access.CONTROL: (Fate.CONSUME, GateReason.COMPANION),
    Access.ABSENT: (Fate.REFUSE, GateReason.ABSENT),
    Access.MAINTENANCE: (Fate.REFUSE, GateReason.MAINTENANCE_ONLY),
    Access.NEVER: (Fate.DROP, GateReason.NEVER),
}
_LOG_ARMED = {Access.LOG: (Fate.REFUSE, GateReason.ON_GROUND)}
_FOR_COMMANDER_ARMED = {
    **_FOR_COMMANDER,
    **_LOG_ARMED,
    Access.SAFEGUARD: (Fate.REFUSE, GateReason.LOCKED_WHILE_ARMED),
}
_FOR_OTHERS = {
    Access.READ: (Fate.FORWARD, GateReason.ALLOWED),
    Access.BULK: (Fate.FORWARD, GateReason.ALLOWED),
    Access.LIVENESS: (Fate.CONSUME, GateReason.LIVENESS_NOT_COMMANDER),
    Access.COMMAND: (Fate.REFUSE, GateReason.NOT_IN_CONTROL),
    Access.SAFEGUARD: (Fate.REFUSE, GateReason.NOT_IN_CONTROL),
    Access.LOG: (Fate.FORWARD, GateReason.ALLOWED),
    Access.STREAM: (Fate.DROP, GateReason.NOT_IN_CONTROL),
    Access.FEED: (Fate.CONSUME, GateReason.FEED),
    Access.ANSWERED: (Fate.CONSUME, GateReason.OBSERVER_RATES),
    Access.RALLY_READ: (Fate.CONSUME, GateReason.COMPANION),
    Access.RALLY_WRITE: (Fate.REFUSE, GateReason.NOT_IN_CONTROL),
    Access.TRANSFER: (Fate.CONSUME, GateReason.COMPANION),
    Access.CONTROL: (Fate.CONSUME, GateReason.COMPANION),
    Access.ABSENT: (Fate.REFUSE, GateReason.ABSENT),
    Access.MAINTENANCE: (Fate.REFUSE, GateReason.MAINTENANCE_ONLY),
    Access.NEVER: (Fate.DROP, GateReason.NEVER),
}
_FOR_OTHERS_ARMED = {**_FOR_OTHERS, **_LOG_ARMED, Access.BULK: (Fate.REFUSE, GateReason.COMMANDERS_IN_FLIGHT)}


#: classes that only the station itself may send, no other component of its id; and classes without an answer
_STATIONS_OWN: Final = frozenset((Access.TRANSFER, Access.CONTROL, Access.LIVENESS))
_UNANSWERED: Final = frozenset((Access.TRANSFER, Access.LIVENESS, Access.STREAM))


def outcome(access: Access, commands: bool, armed: bool) -> tuple[Fate, GateReason]:
    """The outcome for a class (rule 4), before rules 5 and 6."""
    if commands:
        return _FOR_COMMANDER_ARMED[access] if armed else _FOR_COMMANDER[access]
    return _FOR_OTHERS_ARMED[access] if armed else _FOR_OTHERS[access]


def judge(
    frame: Frame, station: StationIdentity, view: AuthorityView, vehicle_sysid: int, modes: Modes = ASSUMED.gate
) -> Verdict:
    """Judge one frame that arrived on a link of `station`. Never raises, whatever the frame holds. `modes`: those of
    the aircraft's firmware.

    The caller counts heartbeats of the commander: they are forwarded, and they are also its sign of life.
    """
    verdict = usual(frame, station, view, vehicle_sysid)
    return decide(frame, station, station.speaks(frame), view, vehicle_sysid, modes) if verdict is None else verdict


def usual(frame: Frame, station: StationIdentity, view: AuthorityView, vehicle_sysid: int) -> Verdict | None:
    """The verdict of `judge` on most frames, without a look at the flight modes. None: `decide` has it.

    Such a frame speaks for its station (`StationIdentity.speaks`)."""
    found = _USUAL.get(frame.msgid)
    own = frame.sysid in station.sysids and (frame.compid in station.components or frame.sysid != station.sysid)
    if found is not None and frame.known and own and frame.sysid != vehicle_sysid:
        length, system, component, others, commander = found
        payload = frame.payload
        if system is None or (
            len(payload) >= length
            and (payload[system] == vehicle_sysid or not payload[system])
            and (component is None or payload[component] != COMPANION_COMPID)
        ):
            return commander if station.sysid == view.commander else others
    return None


def decide(
    frame: Frame, station: StationIdentity, speaks: bool, view: AuthorityView, vehicle_sysid: int, modes: Modes
) -> Verdict:
    """The verdict of `judge` on any frame, by all rules. `speaks`: `station.speaks(frame)`."""
    row = classify(frame)
    fate, reason = _decide(frame, row, station, speaks, view, vehicle_sysid, modes)
    return Verdict(fate, row.access, reason, row.what)


_ACK: Final[int] = mavlink.MAVLINK_MSG_ID_MISSION_ACK
#: MAV_MISSION_TYPEs whose uploads end at the companion in flight; the messages that write such a list, or cancel it
STAGED: Final = frozenset({mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE})
_WRITERS: Final = message_ids("MISSION_ACK", *MISSION_TYPE_MESSAGES)

#: constants, because Python 3.11 takes 0.1 us to look up a member of an enumeration
_FORWARD: Final = Fate.FORWARD
_NOT_IN_CONTROL: Final = GateReason.NOT_IN_CONTROL
_FEED: Final = GateReason.FEED
_LIVENESS: Final = Access.LIVENESS
_COMMAND: Final = Access.COMMAND
_ON_LOAD: Final = Phase.ON_LOAD

_LOOKED_AT: Final = _WRITERS | INTENT_MESSAGES

#: Length of the payload, offsets of target system and component, verdict on other stations' frames and the commander's.
_Usual = tuple[int, int | None, int | None, Verdict, Verdict]


def _usual(msgid: int, row: Row) -> _Usual:
    assert row.access is not None
    # armed or not makes no difference here, see below
    found = (outcome(row.access, commands, armed=True) for commands in (False, True))
    others, commander = (Verdict(fate, row.access, reason, row.what) for fate, reason in found)
    return (*target_offsets(msgid), others, commander)


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
        and row.access is not Access.LIVENESS  # its verdict depends on the sender
        and msgid not in TAKE_OFF_MESSAGES
        and msgid not in INTENT_MESSAGES
        and msgid != _ACK
    }


#: What `_decide` finds for most frames, computed beforehand: messages that only their id decides, armed or not. The
#: verdicts are those of rule 4, for frames to which rules 1 to 3 and 6 do not apply.
_USUAL: Final = _usual_by_id()


def _decide(
    frame: Frame,
    row: Row,
    station: StationIdentity,
    speaks: bool,
    view: AuthorityView,
    vehicle_sysid: int,
    modes: Modes,
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
    commands = station.sysid == view.commander and speaks
    if row.access is _LIVENESS and frame.sysid != station.sysid:
        commands = False
    fate, reason = outcome(row.access, commands, view.armed)
    if not speaks and (reason is _NOT_IN_CONTROL or row.access in _STATIONS_OWN):
        return (Fate.DROP if row.access in _UNANSWERED else Fate.REFUSE), GateReason.COMPONENT
    if reason is _FEED and aim is not None and aim[1] == COMPANION_COMPID:
        return Fate.DROP, GateReason.COMPANION_TARGET
    if fate is not _FORWARD:
        return fate, reason
    on_ground = row.access is _COMMAND and view.phase is _ON_LOAD
    if on_ground and row.part == MISSION_START:
        return Fate.CONSUME, GateReason.COMPANION
    if aim is not None and aim[1] == COMPANION_COMPID:
        return Fate.DROP if row.access is Access.STREAM else Fate.REFUSE, GateReason.COMPANION_TARGET
    if on_ground and takes_off(frame, row, modes):
        return Fate.CONSUME, GateReason.COMPANION
    may_be = commands and frame.msgid in _LOOKED_AT and view.phase is not _ON_LOAD
    if may_be and (uploads(frame, modes) or intent_of(frame, modes) is not None):
        return Fate.CONSUME, GateReason.COMPANION
    return fate, reason


def uploads(frame: Frame, modes: Modes = ASSUMED.gate) -> bool:
    """Whether a frame is a part of an upload that ends at the companion in flight (rule 7)."""
    if frame.msgid not in _WRITERS or field_int(frame, "mission_type") not in STAGED:
        return False
    return frame.msgid not in INTENT_MESSAGES or intent_of(frame, modes) is None
