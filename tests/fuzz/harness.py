# SPDX-License-Identifier: GPL-3.0-or-later

"""A gate driven by bytes: the one thing that both fuzzers feed, and what must hold whatever they feed it.

A *plan* is a string of bytes, and every string of bytes is a plan: instructions to send garbage, frames with any
contents and a right CRC, damaged frames, to cut the stream, to change who commands, to let the vehicle speak. The
gate is the one that ships, `gate.Gate`, behind the splitter of a link. What must hold:

* nothing raises;
* what is forwarded is a frame that was sent, byte for byte, by a system id that may speak on that link;
* what is forwarded is what the second book-keeping (`tests/gate/ledger.py`) lets through, and of those names that it
  does not list, nothing of a safeguard while the vehicle is armed, and nothing in the folder of scripts;
* sticks and setpoints of a station that were refused to it are not forwarded within a second, unless it has let go;
* a station that does not command hears no more than it may, and its flush is empty;
* every answer is a whole frame in the vehicle's name.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import replace

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.downlink import ANSWERS, COMMAND_ANSWERS, FOR_EVERYBODY
from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity, Verdict
from mavproxy_handover.gate.observers import WISHES
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.wire.frames import MAX_FRAME_BYTES, Frame, FrameSplitter, field_offset, parse_one, target
from tests.fuzz.reader import Reader
from tests.gate.door import Door
from tests.gate.frames import ftp_request
from tests.gate.ledger import (
    BULK,
    BULK_COMMANDS,
    BULK_OPCODES,
    CALLED_OFF,
    CONTROL_COMMANDS,
    GCSA,
    GCSB,
    GCSC,
    MAINTENANCE_COMMANDS,
    MAINTENANCE_FILES,
    PASS,
    PASS_COMMANDS,
    PLAIN_FILES,
    RATE_COMMANDS,
    SAFEGUARD_COMMANDS,
    SAFEGUARD_FILES,
    SAFEGUARD_PARAMETERS,
    STICKS,
    TOLD_PARAMETERS,
    TRACKER_OF_A,
    VEHICLE,
    VIEWS,
    A,
    B,
    C,
    expected,
    kind_of_frame,
)

__all__ = [
    "CUT",
    "DAMAGED",
    "FRAME",
    "GARBAGE",
    "SWITCH",
    "VEHICLE_SAYS",
    "Fuzzed",
    "check_forwarded",
    "instruction",
    "run",
    "seeds",
]

GARBAGE, FRAME, DAMAGED, CUT, SWITCH, VEHICLE_SAYS = range(6)

STATIONS = (A, B, C)
SENDERS = (GCSA, GCSB, GCSC, TRACKER_OF_A, VEHICLE, 0, 255, 99)
COMPONENTS = (190, 1, 191, 0)
#: those of them that speak for a station
STATIONS_OWN = (190, 1, 0)

#: Messages whose contents the gate looks at, or that open something: half of all frames are of these.
INTERESTING = [
    "COMMAND_LONG",
    "COMMAND_INT",
    "COMMAND_ACK",
    "FILE_TRANSFER_PROTOCOL",
    "TUNNEL",
    "PARAM_SET",
    "PARAM_EXT_SET",
    "PARAM_MAP_RC",
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_ACK",
    "MISSION_CLEAR_ALL",
    "REQUEST_DATA_STREAM",
    "RC_CHANNELS_OVERRIDE",
    "SET_POSITION_TARGET_LOCAL_NED",
    "HEARTBEAT",
]
_IDS = {cls.msgname: msgid for msgid, cls in mavlink.mavlink_map.items()}
INTERESTING_IDS = [_IDS[name] for name in INTERESTING]
ALL_IDS = sorted(mavlink.mavlink_map)

_OBSERVED = {*FOR_EVERYBODY, *WISHES}
_SAFEGUARDS = (
    *("HNDO_", "SCR_", "FS_", "SYSID_", "MAV_", "ARMING_", "FENCE_", "BRD_", "RC_"),
    *("RALLY_", "RTL_", "SRTL_", "LAND_", "Q_RTL_", "Q_LAND_"),
)


class Fuzzed:
    """The gate that ships (`tests/gate/door.py`), a splitter for each station, and the invariants."""

    def __init__(self) -> None:
        self.forwarded = 0
        self.sent: dict[int, bytes] = {station.sysid: b"" for station in STATIONS}
        #: ids that a station may hear because it asked
        self.asked: dict[int, set[int]] = {station.sysid: set() for station in STATIONS}
        #: by station and family of sticks: when somebody's hand was last refused
        self.refused_at: dict[tuple[int, int], float] = {}
        self.splitters = {station.sysid: FrameSplitter() for station in STATIONS}
        self.door = Door()
        #: the situation forbids: what passes then, passes by the policy alone
        self.door.command_passes = False
        self.door.change(VIEWS[3])

    @property
    def view(self) -> AuthorityView:
        return self.door.gate.view

    def feed(self, station: StationIdentity, data: bytes) -> None:
        """Bytes arrive on a station's link."""
        # Enough to find any frame in: what waits in the splitter, and what comes now.
        self.sent[station.sysid] = self.sent[station.sysid][-2 * MAX_FRAME_BYTES :] + data
        for frame in self.splitters[station.sysid].feed(data):
            assert frame.raw in self.sent[station.sysid]
            self.receive(station, frame)

    def receive(self, station: StationIdentity, frame: Frame) -> None:
        came = self.door.up(station, frame)
        passes = came.verdict.fate is Fate.FORWARD
        if passes and frame.msgid == _IDS["LOG_REQUEST_DATA"]:  # is asked for in pieces, one after the other
            for raw in came.passed:
                piece = parse_one(raw)
                assert piece is not None
                assert (piece.msgid, piece.sysid, piece.compid) == (frame.msgid, frame.sysid, frame.compid)
                assert target(piece) == target(frame)
        else:
            assert came.passed == ([frame.raw] if passes else [])
        if passes:
            self.forwarded += 1
            check_forwarded(frame, station, self.view)
            self.asked[station.sysid] |= may_answer(frame)
        self.check_sticks(station, frame, came.verdict)
        check_answers(came.answers, came.verdict)
        assert not self.door.faults, self.door.faults

    def check_sticks(self, station: StationIdentity, frame: Frame, verdict: Verdict) -> None:
        """What was refused is not live a moment later."""
        families = [n for n, names in enumerate(STICKS) if mavlink.mavlink_map[frame.msgid].msgname in names]
        if not families or not frame.known:
            return
        key = station.sysid, families[0]
        if not holds(frame):
            self.refused_at.pop(key, None)
        elif verdict.reason in (GateReason.NOT_IN_CONTROL, GateReason.RAN_BEFORE):
            self.refused_at[key] = self.door.now
        elif verdict.fate is Fate.FORWARD:
            assert self.door.now - self.refused_at.get(key, -math.inf) >= 1.0, (key, verdict)

    def hear(self, frame: Frame) -> None:
        """The vehicle says something."""
        aim = target(frame)
        name = mavlink.mavlink_map[frame.msgid].msgname
        heard = self.door.down(frame)
        if (frame.sysid == VEHICLE and frame.compid in (191, 198, 240)) or 47100 <= frame.msgid <= 47131:
            assert heard == set(), name
        for sysid in heard:
            addressed = aim is not None and aim[0] in self.door.ports[sysid].identity.sysids
            if sysid not in (self.view.commander, self.view.partner) and not addressed:
                assert name in _OBSERVED or frame.msgid in self.asked[sysid], name

    def switch(self, view: AuthorityView) -> None:
        """Somebody else commands, or another phase begins."""
        before = len(self.door.passed)
        closings = self.door.change(view)
        assert self.door.passed[before:] == [raw for _station, closing in closings for raw in closing.frames]
        for raw in self.door.passed[before:]:
            frame = parse_one(raw)
            assert frame is not None
            assert target(frame) is None or target(frame)[0] == VEHICLE  # type: ignore[index]
        # who does not command has nothing open: if it had commanded until now, nothing would have to be closed
        for station in STATIONS:
            if station.sysid != view.commander:
                self.door.change(replace(view, commander=station.sysid, armed=True))
                assert self.door.change(replace(view, commander=None, armed=True)) == []
        self.door.change(view)


def may_answer(frame: Frame) -> set[int]:
    """Ids of the messages that may answer a question."""
    name = mavlink.mavlink_map[frame.msgid].msgname
    if name not in ("COMMAND_LONG", "COMMAND_INT"):
        return {_IDS[answer] for answer in ANSWERS[name].names if answer in _IDS} if name in ANSWERS else set()
    found = {_IDS["COMMAND_ACK"]}
    command = int.from_bytes(part(frame, "command", 2), "little")
    if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
        (wish,) = struct.unpack("<f", part(frame, "param1", 4))
        found |= {int(wish)} if math.isfinite(wish) else set()
    elif command in mavlink.enums["MAV_CMD"]:
        answers = COMMAND_ANSWERS.get(mavlink.enums["MAV_CMD"][command].name.removeprefix("MAV_CMD_"))
        found |= {_IDS[answer] for answer in answers.names if answer in _IDS} if answers is not None else set()
    return found


def holds(frame: Frame) -> bool:
    """Whether sticks or setpoints hold anything, by pymavlink's own reading of them."""
    message = mavlink.MAVLink(None).decode(bytearray(frame.raw))
    if message.get_type() == "RC_CHANNELS_OVERRIDE":
        low = [getattr(message, f"chan{n}_raw") for n in range(1, 9)]
        high = [getattr(message, f"chan{n}_raw") for n in range(9, 19)]
        return bool(set(low) - {0, 65535} or set(high) - {0, 65534, 65535})
    if message.get_type() == "MANUAL_CONTROL":
        axes = {message.x, message.y, message.z, message.r}
        return axes != {32767} or bool(message.buttons or message.buttons2 or message.enabled_extensions)
    return True


def check_forwarded(frame: Frame, station: StationIdentity, view: AuthorityView) -> None:
    """A frame goes to the autopilot: it is one that the second book-keeping lets through."""
    assert frame.known
    if frame.sysid == station.sysid and frame.compid not in STATIONS_OWN:
        view = replace(
            view, commander=None
        )  # a component that the configuration does not give the station has no authority
    assert frame.sysid in station.sysids
    aim = target(frame)
    assert aim is None or aim[0] in (0, VEHICLE)
    commands = view.commander == station.sysid
    name = mavlink.mavlink_map[frame.msgid].msgname
    fields = {"command": 2, "payload_type": 2, "mission_type": 1}
    values = {field: int.from_bytes(part(frame, field, length), "little") for field, length in fields.items()}
    ftp = part(frame, "payload", 251)
    parameter = part(frame, "param_id", 16).split(b"\0")[0].decode("latin-1")
    kind = kind_of_frame(name, values, ftp, parameter)
    if kind is not None:
        assert expected(kind, station, frame.sysid, None, view)[0] is Fate.FORWARD, (name, values)
    if not commands:
        dear = kind == BULK or (kind is None and name == "FILE_TRANSFER_PROTOCOL" and ftp[3] in BULK_OPCODES)
        assert kind in (PASS, CALLED_OFF) or (dear and not view.armed), name
    if view.armed:
        assert not (name.startswith("PARAM_") and parameter.upper().startswith(_SAFEGUARDS)), parameter
    if name == "FILE_TRANSFER_PROTOCOL" and ftp[3] in (6, 8, 9, 10, 11, 13):
        path = ftp[12:250].split(b"\0")[0].lower()
        assert b"scripts" not in path.replace(b"\\", b"/").split(b"/"), path
        assert not (view.armed and path.lstrip(b"/").startswith((b"@param", b"@mission"))), path


def check_answers(answers: list[bytes], verdict: Verdict) -> None:
    """What goes back is whole frames in the vehicle's name, and nothing at all for what is dropped but sticks."""
    assert not answers or verdict.fate in (Fate.REFUSE, Fate.CONSUME) or verdict.access is Access.STREAM
    for raw in answers:
        frame = parse_one(bytes(raw))
        assert frame is not None
        assert (frame.sysid, frame.known) == (VEHICLE, True)


def part(frame: Frame, field: str, length: int) -> bytes:
    """A field's bytes, zeros if the message has no such field."""
    try:
        offset = field_offset(frame.msgid, field)
    except KeyError:
        return bytes(length)
    return frame.payload[offset : offset + length]


def _frame(reader: Reader, sysid: int | None = None) -> bytes:
    """A frame with a right CRC: message, sender, form, then the payload, at first addressed to the autopilot."""
    choice = reader.byte()
    more = reader.byte()
    msgid = (
        ALL_IDS[(choice << 8 | more) % len(ALL_IDS)] if choice & 0x80 else INTERESTING_IDS[choice % len(INTERESTING)]
    )
    sender = SENDERS[reader.byte() % len(SENDERS)] if sysid is None else sysid
    compid = COMPONENTS[reader.byte() % len(COMPONENTS)]
    form = reader.byte()
    cls = mavlink.mavlink_map[msgid]
    payload = bytearray(reader.take(reader.byte()).ljust(cls.unpacker.size, b"\0")[: cls.unpacker.size])
    if not form & 0x40:
        for name, value in (("target_system", VEHICLE), ("target", VEHICLE), ("target_component", form >> 7)):
            if name in cls.fieldnames:
                payload[field_offset(msgid, name)] = value
    if form & 3 == 3 and msgid <= 255:
        head = bytes([len(payload), 0, sender, compid, msgid])
        magic, signature = b"\xfe", b""
    else:
        signed = form & 3 == 2
        head = bytes([len(payload), int(signed), 0, 0, sender, compid]) + msgid.to_bytes(3, "little")
        magic, signature = b"\xfd", bytes(13) if signed else b""
    crc = mavlink.x25crc(head + bytes(payload) + bytes([cls.crc_extra])).crc
    return magic + head + bytes(payload) + crc.to_bytes(2, "little") + signature


def _instructions(reader: Reader) -> Iterator[int]:
    while reader.more():
        yield reader.byte() % 6


def instruction(number: int, message: str, payload: bytes, sender: int = 0) -> bytes:
    """A plan's instruction to send a message of `INTERESTING`; `sender` is an index of `SENDERS`."""
    return bytes([number, INTERESTING.index(message), 0, sender, 0, 0, len(payload)]) + payload


def seeds() -> Iterator[bytes]:
    """Plans to begin with: a fuzzer does not guess the name of a parameter or a path."""
    files = [*MAINTENANCE_FILES, *SAFEGUARD_FILES, *PLAIN_FILES]
    payloads = [("FILE_TRANSFER_PROTOCOL", bytes(3) + bytes(ftp_request(opcode, path))[:200]) for opcode, path in files]
    names = [*SAFEGUARD_PARAMETERS, *TOLD_PARAMETERS]
    payloads += [("PARAM_SET", bytes(6) + name.encode("latin-1")) for name in names]
    commands = [
        *PASS_COMMANDS,
        *BULK_COMMANDS,
        *RATE_COMMANDS,
        *CONTROL_COMMANDS,
        *MAINTENANCE_COMMANDS,
        *SAFEGUARD_COMMANDS,
        300,
        400,
    ]
    payloads += [(name, bytes(28) + number.to_bytes(2, "little")) for number in commands for name in INTERESTING[:2]]
    payloads += [(name, bytes(20)) for name in INTERESTING]
    for message, payload in payloads:
        switched = bytes([SWITCH, 1 + (3 << 2)])  # to station B, an observer of an armed vehicle
        yield instruction(FRAME, message, payload) + switched + instruction(FRAME, message, payload, 1)
        yield instruction(VEHICLE_SAYS, message, payload) + bytes([CUT, 9])


def run(plan: bytes) -> Fuzzed:
    """Carry a plan out; AssertionError or any other exception is a fault of the gate."""
    reader = Reader(plan)
    gate, station, pending = Fuzzed(), A, b""
    for instruction in _instructions(reader):
        if instruction == GARBAGE:
            pending += reader.take(reader.byte())
        elif instruction == FRAME:
            pending += _frame(reader)
        elif instruction == DAMAGED:
            raw = bytearray(_frame(reader))
            raw[reader.byte() % len(raw)] ^= reader.byte()
            pending += raw
        elif instruction == CUT:
            length = reader.byte() % (len(pending) + 1)
            gate.feed(station, pending[:length])
            pending = pending[length:]
        elif instruction == SWITCH:
            gate.feed(station, pending)
            pending = b""
            choice = reader.byte()
            station = STATIONS[choice % 3]
            gate.switch(VIEWS[(choice >> 2) % len(VIEWS)])
        else:
            frame = parse_one(_frame(reader, VEHICLE))
            if frame is not None:
                gate.hear(frame)
    gate.feed(station, pending)
    gate.switch(AuthorityView(Phase.ON_MISSION, None, None, 9, LeaseState.LOST, True))
    return gate
