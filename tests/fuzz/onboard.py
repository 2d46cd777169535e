# SPDX-License-Identifier: GPL-3.0-or-later

"""Links of onboard programs driven by bytes: what they send and hear, and the delegation of guided targets.

Ports, gate and delegation are those that ship; the aircraft is a few values. A plan is a row of instructions: a frame
with any identity and contents, a damaged one, bytes, a flood of one frame or of one from many components and systems, a
frame of the commander, a frame of the vehicle, another fact, a pause. What must hold:

* nothing raises, and no link is closed after a fault;
* what passes was sent, byte for byte, by the program of that link, and its rights contain it (second book-keeping:
  `tests/gate/test_onboard.py`);
* a guided target passes only while its program has the delegation, and a payload frame only while it has the payload;
* what passes of a program is no more than its bytes a second, and of all no more than their share of the line;
* a program gets whole frames of the companion as answers, and few of them;
* a delegation that ends sends a velocity of zero first, and is held unless the aircraft is led elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Final, cast

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config.onboard import OnboardProgram
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, LeaseState, Phase
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.intent import Aim
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.onboard import OnboardMatters, OnboardRights
from mavproxy_handover.gate.policy.onboard import SENSORS, Right
from mavproxy_handover.gate.policy.rows import classify
from mavproxy_handover.gate.rate_limit import RateLimit
from mavproxy_handover.link.base import LinkCounters
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.operator.onboard.delegating import Delegating, DelegationParts
from mavproxy_handover.operator.onboard.landing_targets import LandingTargets
from mavproxy_handover.operator.onboard.port import OnboardPort
from mavproxy_handover.operator.onboard.programs import OnboardPrograms, OnboardSurroundings
from mavproxy_handover.vehicle.profiles import COPTER
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.frames import Frame, FrameSplitter, field_offset, parse_one
from tests.fuzz.reader import Reader
from tests.gate.test_onboard import COMMAND_NAMES, GUIDED, NEVER, PAYLOAD, PAYLOAD_COMMANDS, may_pass

__all__ = ["BYTES", "COMMANDER", "DAMAGED", "FACT", "FLOOD", "FRAME", "HEAR", "PAUSE", "Aboard", "run", "seeds"]

FRAME, DAMAGED, BYTES, FLOOD, COMMANDER, HEAR, FACT, PAUSE = range(8)
VEHICLE, GCSA, GCSB = 1, 251, 252
PROGRAMS: Final = (
    OnboardRights("precland", 195, frozenset((Right.SENSORS, Right.GUIDED)), frozenset(("LANDING_TARGET", "ODOMETRY"))),
    OnboardRights("camera", 100, frozenset((Right.PAYLOAD,)), bytes_per_s=500.0),
    OnboardRights("all", 196, frozenset(Right), frozenset(SENSORS), bytes_per_s=3000.0),
)
_IDS: Final = {cls.msgname: msgid for msgid, cls in mavlink.mavlink_map.items()}
INTERESTING: Final = sorted(
    {"COMMAND_LONG", "COMMAND_INT", "HEARTBEAT", "PARAM_SET", "MISSION_COUNT", "FILE_TRANSFER_PROTOCOL", "TUNNEL"}
    | {"PARAM_REQUEST_READ", "TIMESYNC", "RC_CHANNELS_OVERRIDE", "SET_MODE", "SET_ATTITUDE_TARGET", *GUIDED, *PAYLOAD}
    | {"LANDING_TARGET", "ODOMETRY", "GPS_INPUT", "DISTANCE_SENSOR", "SETUP_SIGNING", "CHANGE_OPERATOR_CONTROL"}
)
ALL: Final = sorted(_IDS)
COMMANDS: Final = sorted(COMMAND_NAMES)
SYSTEMS: Final = (VEHICLE, VEHICLE, VEHICLE, GCSA, 0, 2, 255)
COMPONENTS: Final = (None, None, None, 1, 191, 0, 195, 100)
RTL: Final = 6
#: the share of the line to the autopilot that the programs have together
LINE_BYTES_PER_S: Final = 4000.0
#: answers to a program: at once, and in a second (frames of one kind are answered five times a second)
_ANSWERS: Final = 200
_ANSWERS_PER_S: Final = 200


class Line:
    """A link that a plan fills with bytes. Frames are found as on any stream."""

    device = "udpin:127.0.0.1:14560"

    def __init__(self) -> None:
        self.counters = LinkCounters()
        self.trouble = ""
        self.now = 0.0
        self.sent: list[bytes] = []
        self.waiting = b""
        self.open = True
        self.unfinished = False
        self._splitter = FrameSplitter()

    def read(self, _once: bool = False) -> list[Frame]:
        data, self.waiting = self.waiting, b""
        return self._splitter.feed(data, self.now)

    def write(self, data: bytes) -> bool:
        self.sent.append(data)
        return True

    def accept_sender(self, _frame: Frame) -> bool:
        return True

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        self.open = False


def _landing() -> VehicleState:
    """An aircraft that lands, so that its landing targets are judged."""
    state = VehicleState()
    for message in (
        mavlink.MAVLink_heartbeat_message(2, 3, 129, 9, 4, 3),
        mavlink.MAVLink_global_position_int_message(0, 470_000_000, 80_000_000, 0, 20_000, 0, 0, 50, 0),
    ):
        state.on_message(message, 1000.0)
    return state


class Aboard:
    """Three programs, the gate for them, the delegation, and what must hold."""

    def __init__(self) -> None:
        self.now = self.begun_at = 1000.0
        self.faults: list[str] = []
        #: everything that the autopilot got, and what passed of the programs: name and frame
        self.to_autopilot: list[bytes] = []
        self.passed: list[tuple[str, Frame]] = []
        #: what payload managers told the stations
        self.to_stations: list[Frame] = []
        self.told: list[str] = []
        self.stood = 0
        self.payload = ""
        self.target_passes = True
        self.decision: FlightAction | None = None
        #: of the line to the autopilot, for all programs together
        self.room = RateLimit(LINE_BYTES_PER_S, LINE_BYTES_PER_S)
        self.in_force = AuthorityInForce()
        self.in_force.view = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True)
        self.aircraft = SimpleNamespace(
            profile=COPTER,
            custom_mode=COPTER.guided,
            flying=True,
            telemetry=SimpleNamespace(heartbeat=SimpleNamespace(at=1000.0)),
            ways_down=SimpleNamespace(leads_to=lambda _item: None),
        )
        self.lines = {program.name: Line() for program in PROGRAMS}
        self.ports = {
            program.name: OnboardPort(
                OnboardProgram(program, Line.device), cast(Any, self.lines[program.name]), VEHICLE
            )
            for program in PROGRAMS
        }
        for port in self.ports.values():
            port.link._clock = lambda: self.now
        reports = self._reports()
        guided = {name: port for name, port in self.ports.items() if Right.GUIDED in port.rights.rights}
        parts = DelegationParts(
            self.in_force,
            cast(VehicleState, self.aircraft),
            self._stand,
            lambda: None,
            lambda: self.decision,
            reports,
        )
        self.delegating = Delegating(VEHICLE, guided, parts, self.to_autopilot.append)
        matters = OnboardMatters(
            self.delegating.permits,
            self._passes,
            lambda _kind, name: self.payload == name,
            lambda: COPTER.gate,
            self.room.allow,
            LandingTargets(_landing()).judge,
            lambda: True,
        )
        around = OnboardSurroundings(
            matters,
            self.to_autopilot.append,
            lambda frame, _now: self.to_stations.append(frame),
            self.delegating.target_passed,
            self.delegating.link_closed,
        )
        self.programs = OnboardPrograms(VEHICLE, list(self.ports.values()), around, reports)
        self._sent = {program.name: b"" for program in PROGRAMS}
        self._bytes = dict.fromkeys(self.lines, 0)

    def _reports(self) -> Reports:
        def told(*_values: Any, **_named: Any) -> None:
            """An entry of the journal."""

        def refused(*values: Any) -> None:
            named = next(value for value in values if callable(value))
            self.told.append(named())

        stations = {GCSA: SimpleNamespace(name="GCSA"), GCSB: SimpleNamespace(name="GCSB")}
        sender = SimpleNamespace(ports=stations, say=told, say_to_all=told)
        log = SimpleNamespace(refused=refused, told=told, onboard=told)
        return cast(Reports, SimpleNamespace(event_log=log, message_sender=sender, fault=self._fault))

    def _fault(self, where: str, text: str) -> None:
        self.faults.append(f"{where}: {text}")

    def _stand(self, done: Any, _now: float) -> None:
        self.stood += 1
        done("")

    def _passes(self, _aim: Aim, _name: str, _now: float) -> bool:
        return self.target_passes

    def feed(self, program: OnboardRights, data: bytes) -> None:
        """Bytes arrive on the link of a program."""
        line, port = self.lines[program.name], self.ports[program.name]
        self._sent[program.name] = self._sent[program.name][-600:] + data
        line.waiting, line.now = data, self.now
        before, ended = len(self.to_autopilot), self.delegating.program
        self.programs.serve(port, self.now)
        line.waiting = b""  # a link that floods drops what comes
        for raw in self.to_autopilot[before:]:
            frame = parse_one(raw)
            assert frame is not None
            if frame.compid != mavlink.MAV_COMP_ID_ONBOARD_COMPUTER:
                self._check(program, frame)
        for frame in self.to_stations:
            assert frame.raw in self._sent[program.name]
            assert (frame.sysid, frame.compid, frame.known) == (VEHICLE, program.component, True)
        self.to_stations.clear()
        self.check()
        if ended and not self.delegating.program:
            assert self._stops(before), "a delegation ended without a stop"

    def _stops(self, start: int) -> bool:
        frames = (parse_one(raw) for raw in self.to_autopilot[start:])
        return any(frame is not None and frame.compid == mavlink.MAV_COMP_ID_ONBOARD_COMPUTER for frame in frames)

    def _check(self, program: OnboardRights, frame: Frame) -> None:
        assert frame.raw in self._sent[program.name]
        assert (frame.sysid, frame.compid, frame.known) == (VEHICLE, program.component, True)
        name = mavlink.mavlink_map[frame.msgid].msgname
        command = None
        if name in ("COMMAND_LONG", "COMMAND_INT"):
            command = int.from_bytes(frame.payload[field_offset(frame.msgid, "command") :][:2], "little")
            word = COMMAND_NAMES.get(command, "")
            assert word not in NEVER
            assert word not in PAYLOAD_COMMANDS or self.payload == program.name
        assert may_pass(name, command, program.rights, program.sensors), name
        if name in GUIDED:
            assert self.delegating.program == program.name
            assert self.target_passes or not _is_place(frame)
        if name in PAYLOAD:
            assert self.payload == program.name
        self._bytes[program.name] += len(frame.raw)
        most = max(280.0, program.bytes_per_s) + program.bytes_per_s * (self.now - self.begun_at)
        assert self._bytes[program.name] <= most + 1.0, "more than its bytes a second"
        most = LINE_BYTES_PER_S * (1.0 + self.now - self.begun_at)
        assert sum(self._bytes.values()) <= most + 1.0, "more than the line has room for"
        self.passed.append((program.name, frame))

    def check(self) -> None:
        """What holds at all times."""
        assert not self.faults, self.faults
        for name, line in self.lines.items():
            assert line.open, f"the link of {name} is closed"
            most = _ANSWERS + _ANSWERS_PER_S * (self.now - self.begun_at)
            answers = [frame for raw in line.sent if (frame := parse_one(raw)) is not None and frame.compid == 191]
            assert len(answers) <= most, f"{len(answers)} answers to {name}"
            assert all(frame.sysid == VEHICLE for frame in answers)

    def hear(self, frame: Frame) -> None:
        """The vehicle sends a frame."""
        before = {name: len(line.sent) for name, line in self.lines.items()}
        self.programs.hear(frame, self.now)
        for name, line in self.lines.items():
            assert line.sent[before[name] :] in ([], [frame.raw])
            assert not line.sent[before[name] :] or not 47100 <= frame.msgid <= 47131
            del line.sent[before[name] :]
        self.check()

    def commander(self, frame: Frame, fate: Fate) -> None:
        """The commander sends a frame that was judged."""
        row, had, stood = classify(frame), self.delegating.program, self.stood
        before = len(self.to_autopilot)
        verdict = Verdict(fate, row.access, GateReason.ALLOWED, row.what)
        self.delegating.commander_sends(frame, verdict, self.now)
        if had and not self.delegating.program:
            assert self._stops(before)
        if fate is Fate.REFUSE:
            assert self.delegating.program == had, "a refused command ends nothing"
        assert self.stood <= stood + 1
        self.check()

    def fact(self, number: int, value: int) -> None:
        """Something else is true from now on."""
        view = self.in_force.view
        if number == 0:
            self.in_force.view = replace(view, epoch=view.epoch + 1, commander=(GCSA, GCSB, None)[value % 3])
        elif number == 1:
            self.aircraft.custom_mode = (COPTER.guided, RTL, 3)[value % 3]
        elif number == 2:
            self.aircraft.flying = value % 2 == 0
        elif number == 3:
            self.payload = ("", *self.lines)[value % 4]
        elif number == 4:
            self.target_passes = value % 2 == 0
        elif number == 5:
            self.decision = (None, FlightAction.TRANSFER, FlightAction.RETURN)[value % 3]
        elif number == 6:
            self.delegating.give(
                (GCSA, GCSB)[value % 2], ("precland", "all", "camera", "none")[value // 2 % 4], self.now
            )
        else:
            self.delegating.take_back((GCSA, GCSB)[value % 2], self.now)
        self.check()

    def pause(self, seconds: float) -> None:
        self.now += seconds
        before, had, stood = len(self.to_autopilot), self.delegating.program, self.stood
        self.delegating.tick(self.now)
        if had and not self.delegating.program:
            assert self._stops(before)
            elsewhere = self.decision is not None or self.aircraft.custom_mode != COPTER.guided
            assert self.stood == stood + 1 or elsewhere or not self.aircraft.flying, "the end is not held"
        self.check()


def _is_place(frame: Frame) -> bool:
    """Whether a guided target contains a place: its mask ignores not all three coordinates."""
    mask = int.from_bytes(frame.payload[field_offset(frame.msgid, "type_mask") :][:2], "little")
    return mask & 0b111 != 0b111


def frame_of(name: str, sysid: int, compid: int, seq: int, payload: bytes, form: int = 0) -> bytes:
    """A frame with these contents and a right check sum. `form`: 1 signed with any signature; 0x40 without a target."""
    msgid = _IDS[name]
    cls = mavlink.mavlink_map[msgid]
    body = bytearray(payload.ljust(cls.unpacker.size, b"\0")[: cls.unpacker.size])
    if not form & 0x40 and "target_system" in cls.fieldnames:
        body[field_offset(msgid, "target_system")] = VEHICLE
    head = bytes([len(body), form & 1, 0, seq, sysid, compid]) + msgid.to_bytes(3, "little")
    crc = mavlink.x25crc(head + body + bytes([cls.crc_extra])).crc.to_bytes(2, "little")
    return b"\xfd" + head + bytes(body) + crc + bytes(13 * (form & 1))


class Player:
    """Carries a plan out."""

    def __init__(self, plan: bytes) -> None:
        self.aboard = Aboard()
        self._reader = Reader(plan)
        self._seq = 0

    def play(self) -> Aboard:
        reader, aboard = self._reader, self.aboard
        while reader.more():
            what = reader.byte() % 8
            if what == PAUSE:
                aboard.pause(reader.byte() / 64.0)
            elif what == FACT:
                aboard.fact(reader.byte() % 8, reader.byte())
            elif what == BYTES:
                aboard.feed(PROGRAMS[reader.byte() % len(PROGRAMS)], reader.counted())
            elif what == HEAR:
                self._hear()
            elif what == COMMANDER:
                self._commander()
            else:
                self._frame(what)
        return aboard

    def _frame(self, what: int) -> None:
        """FRAME, DAMAGED, FLOOD."""
        reader, program = self._reader, PROGRAMS[self._reader.byte() % len(PROGRAMS)]
        name, payload = self._message()
        sysid, compid = SYSTEMS[reader.byte() % len(SYSTEMS)], COMPONENTS[reader.byte() % len(COMPONENTS)]
        compid, form = program.component if compid is None else compid, reader.byte()
        if what == FLOOD:
            count, pause_s = reader.byte() * 4, reader.byte() / 10_000.0
            for number in range(count):
                system = number % 256 if form & 4 else sysid
                component = number * 7 % 256 if form & 8 else compid
                self.aboard.feed(program, frame_of(name, system, component, self._number(), payload, form))
                self.aboard.now += pause_s
            return
        raw = bytearray(frame_of(name, sysid, compid, self._number(), payload, form))
        if what == DAMAGED:
            raw[reader.byte() % len(raw)] ^= reader.byte()
        self.aboard.feed(program, bytes(raw))

    def _message(self) -> tuple[str, bytes]:
        """A message and its contents; those of a command begin with its number."""
        choice = self._reader.byte()
        name = INTERESTING[choice % len(INTERESTING)]
        if choice & 0x80:
            name = ALL[(choice << 8 | self._reader.byte()) % len(ALL)]
        payload = self._reader.counted()
        if name in ("COMMAND_LONG", "COMMAND_INT"):
            number = COMMANDS[int.from_bytes(payload[:2], "little") % len(COMMANDS)]
            payload = payload[2:30].ljust(28, b"\0") + number.to_bytes(2, "little")
        return name, payload

    def _hear(self) -> None:
        name, payload = self._message()
        frame = parse_one(frame_of(name, VEHICLE, COMPONENTS[self._reader.byte() % 8] or 1, 0, payload, 0x40))
        if frame is not None:
            self.aboard.hear(frame)

    def _commander(self) -> None:
        name, payload = self._message()
        fate = (Fate.FORWARD, Fate.CONSUME, Fate.REFUSE)[self._reader.byte() % 3]
        frame = parse_one(frame_of(name, GCSA, 190, 0, payload))
        if frame is not None:
            self.aboard.commander(frame, fate)

    def _number(self) -> int:
        self._seq = (self._seq + 1) & 0xFF
        return self._seq


def command(number: int, *values: int) -> bytes:
    """The contents of a COMMAND_LONG in a plan, with their length before them."""
    return bytes([2 + len(values)]) + COMMANDS.index(number).to_bytes(2, "little") + bytes(values)


#: the commander orders GUIDED, and delegates to the first program
_GUIDED: Final = bytes([COMMANDER, INTERESTING.index("COMMAND_LONG")])
DELEGATED: Final = (
    _GUIDED + command(mavlink.MAV_CMD_DO_SET_MODE, 0, 0, 0x80, 0x3F, 0, 0, 0x80, 0x40) + bytes([0, FACT, 6, 0])
)


def seeds() -> Iterator[bytes]:
    """Every interesting message of every program, floods, and delegations that end in each way."""
    for program in range(len(PROGRAMS)):
        for message in range(len(INTERESTING)):
            one = bytes([program, message, 0, 0, 0, 0])
            given = DELEGATED + bytes([FACT, 3, program + 1, FRAME]) + one
            yield given + bytes([DAMAGED]) + one + bytes([12, 1]) + bytes([PAUSE, 200, FRAME]) + one
            yield bytes([FLOOD]) + one + bytes([200, 1, PAUSE, 64, FLOOD]) + one[:-1] + bytes([12, 200, 1])
    for number in (*sorted(COMMANDS)[::9], mavlink.MAV_CMD_IMAGE_START_CAPTURE, mavlink.MAV_CMD_DO_SET_MODE):
        body = bytes([INTERESTING.index("COMMAND_LONG")]) + command(number)
        yield bytes([FACT, 3, 2, FRAME, 1]) + body + bytes([0, 0, 0, HEAR]) + body + bytes([0])
        yield DELEGATED + bytes([COMMANDER]) + body + bytes([0, PAUSE, 9])
    for number in range(8):
        for value in range(3):
            yield DELEGATED + bytes([FACT, number, value, PAUSE, 1, PAUSE, 255])


def run(plan: bytes) -> Aboard:
    """Carry a plan out; any exception is a finding."""
    return Player(plan).play()
