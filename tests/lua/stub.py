# SPDX-License-Identifier: GPL-3.0-or-later

"""A vehicle of switches for the guard's tests: every fact the guard asks for is an attribute, every act is recorded.

The bindings themselves are `sitl.vehicles.lua_bindings`, the same that the embedded vehicle flies with. `Bench` puts
guard, vehicle and a companion that sends leases on one clock that only the test moves.
"""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pymavlink.dialects.v20 import all as dialect

from mavproxy_handover.wire.lease_tag import lease_tag
from sitl.vehicles.lua_bindings import LuaScripting
from sitl.vehicles.lua_host import Sensed

#: the shipped script, or one with a fault in it (`plant_faults`)
GUARD = Path(os.environ.get("PLANTED_GUARD") or Path(__file__).parents[2] / "ardupilot_lua" / "handover_guard.lua")

STABILIZE, AUTO, GUIDED, LOITER, RTL, LAND, BRAKE, SMART_RTL, AUTO_RTL = 0, 3, 4, 5, 6, 9, 17, 21, 27
BY_RC, BY_GCS, BY_BATTERY, BY_EKF, BY_FENCE, BY_SCRIPT, BY_AUX = 1, 2, 4, 6, 10, 32, 53
BY_ESCAPE, BY_AVOIDANCE, BY_AVOIDANCE_END = 9, 14, 15
#: FWVersion:type()
ROVER, COPTER, PLANE, TRACKER, SUB, BLIMP, HELI = 1, 2, 3, 4, 7, 12, 13
#: states of the guard's enforcement, field En of its log
CALM, MISSING, ORDERING, RETURNING, LANDING, PILOT, FAILSAFE = range(7)

HELD, TRANSFER, LOST, RECOVERING, ALONE = 1, 2, 3, 4, 5
#: of the guard
LIVE_STATE = 2
LEASE_TYPE, STATUS_TYPE = 47116, 47117
LEASE_LAYOUT, STATUS_LAYOUT = "<BBBBIIIHHI", "<BBBBIIIHBBI"
COMPANION_CHANNEL = 1


def stated(row: str) -> list[int]:
    """The numbers in a row of the table Resources on the guard's page."""
    page = GUARD.with_suffix(".md").read_text(encoding="utf-8")
    text = re.search(rf"^\| {re.escape(row)} \| ([^|]*) \|", page, re.MULTILINE)
    assert text is not None, row
    return [int(number) for number in re.findall(r"\d+", text[1])]


class FakeVehicle:
    """Implements `VehicleHost`."""

    def __init__(self) -> None:
        self.now_ms = 10_000
        self.armed = False
        self.flying = False
        self.mode = STABILIZE
        self.reason = BY_RC
        self.rc = False
        self.landing = False
        #: of an aircraft with wings: it takes off, hovers on lift motors, flies to an item of its mission
        self.taking_off = False
        self.hovering = False
        self.item = 0
        self.aux_functions: list[tuple[int, int]] = []
        self.aux_works = True
        self.ekf_failed = False
        #: MAVLink channels with a port; one that a frame comes from has one
        self.ports = {0, 1, 2}
        self.type = COPTER
        self.refused_modes: set[int] = set()
        self.disarm_works = True
        self.parameters: dict[str, float] = {"SCR_ENABLE": 1.0, "MAV_SYSID": 1.0, "MAV_GCS_SYSID": 255.0}
        self.parameters["FS_THR_ENABLE"] = 1.0
        self.saved: list[str] = []
        self.link_open = True
        self.firmware_version = (4, 7, 0)
        self.texts: list[tuple[int, str]] = []
        self.mode_requests: list[int] = []
        self.disarms = 0
        self.messages: list[tuple[int, int, bytes]] = []
        self.records: list[tuple[str, dict[str, object]]] = []
        self.removed: list[str] = []
        self.breaks: set[str] = set()
        #: what the sensors read
        self.sensors: Callable[[], Sensed] = Sensed

    def _fail(self, name: str) -> None:
        if name in self.breaks:
            raise OSError(f"{name} is broken")

    def millis(self) -> int:
        return self.now_ms & 0xFFFFFFFF

    def is_armed(self) -> bool:
        return self.armed

    def arm(self) -> bool:
        raise AssertionError("the guard never arms")

    def disarm(self) -> bool:
        self.disarms += 1
        if self.disarm_works:
            self.armed = self.flying = False
        return self.disarm_works

    def get_mode(self) -> int:
        return self.mode

    def set_mode(self, mode: int, reason: int) -> bool:
        self.mode_requests.append(mode)
        if mode in self.refused_modes:
            return False
        self.mode, self.reason = mode, reason
        return True

    def get_control_mode_reason(self) -> int:
        return self.reason

    def likely_flying(self) -> bool:
        return self.flying

    def is_landing(self) -> bool:
        return self.landing

    def is_taking_off(self) -> bool:
        return self.taking_off

    def in_vtol_mode(self) -> bool:
        return self.hovering

    def mission_item(self) -> int:
        return self.item

    def has_ekf_failsafed(self) -> bool:
        return self.ekf_failed

    def time_flying_ms(self) -> int:
        return 0

    def rc_valid(self) -> bool:
        return self.rc

    def run_aux_function(self, function: int, position: int) -> bool:
        self.aux_functions.append((function, position))
        return self.aux_works

    def param_get(self, name: str) -> float | None:
        return self.parameters.get(name)

    def param_set(self, name: str, value: float, save: bool) -> bool:
        if name not in self.parameters:
            return False
        self.parameters[name] = value
        if save:
            self.saved.append(name)
        return True

    def param_define(self, name: str, default: float) -> bool:
        self.parameters.setdefault(name, default)
        return True

    def send_text(self, severity: int, text: str) -> None:
        self.texts.append((severity, text))

    def send_message(self, channel: int, msgid: int, payload: bytes) -> bool:
        if self.link_open:
            self.messages.append((channel, msgid, payload))
        return self.link_open

    def has_port(self, channel: int) -> bool:
        return channel in self.ports

    def sensed(self) -> Sensed:
        return self.sensors()

    def gcs_last_seen_ms(self) -> int:
        return 0

    def log_write(self, name: str, labels: str, fmt: str, values: tuple[object, ...]) -> None:
        self.records.append((name, dict(zip(labels.split(","), values, strict=True))))

    def script_removed(self, path: str, error: str) -> None:
        self.removed.append(f"{path}: {error}")

    def firmware(self) -> tuple[int, int, int]:
        return self.firmware_version

    def firmware_type(self) -> int:
        return self.type


@dataclass(frozen=True)
class Status:
    """The guard's answer, payload 47117."""

    version: int
    state: int
    action: int
    flags: int
    nonce: int
    sequence: int
    epoch: int
    rejected: int
    fw_major: int
    fw_minor: int
    #: the nonce of the guard, which leases must carry
    guard_nonce: int


@dataclass
class Companion:
    """Builds leases as the companion sends them; every field can be bent by a test."""

    system: int = 1
    component: int = 191
    nonce: int = 0xC0FFEE01
    sequence: int = 0
    epoch: int = 7
    state: int = HELD
    commander: int = 251
    ttl_ms: int = 5000
    #: seconds that it may fly on alone, in the state ALONE
    left_s: int = 0
    version: int = 2
    #: the nonce of the guard as its last status told it; 0: not heard yet
    guard_nonce: int = 0
    #: 32 bytes of a key file: every lease has a tag
    key: bytes | None = None
    packer: dialect.MAVLink = field(init=False)

    def __post_init__(self) -> None:
        self.packer = dialect.MAVLink(None, srcSystem=self.system, srcComponent=self.component)

    def lease(self, **changes: int) -> bytes:
        """A frame with the next sequence number; `changes` bend fields of it for this frame alone."""
        self.sequence = (self.sequence + 1) & 0xFFFFFFFF
        return self.frame(**changes)

    def frame(self, **changes: int) -> bytes:
        """A frame with the present sequence number."""
        value = {
            name: changes.pop(name, getattr(self, name))
            for name in (
                *("version", "state", "commander", "nonce", "sequence", "epoch", "ttl_ms", "left_s"),
                "guard_nonce",
            )
        }
        flags = changes.pop("flags", 0 if self.key is None else 1)
        payload = struct.pack(
            LEASE_LAYOUT,
            value["version"],
            value["state"],
            value["commander"],
            flags,
            value["nonce"],
            value["sequence"],
            value["epoch"],
            value["ttl_ms"],
            value["left_s"],
            value["guard_nonce"],
        )
        if self.key is not None:
            payload += lease_tag(self.key, LEASE_TYPE, (changes.pop("tag_for", 1), 1), payload)
        return self.tunnel(payload, **changes)

    def tunnel(
        self,
        payload: bytes,
        kind: int = LEASE_TYPE,
        length: int | None = None,
        target_system: int = 1,
        target_component: int = 1,
    ) -> bytes:
        """Any TUNNEL frame of this sender."""
        message = dialect.MAVLink_tunnel_message(
            target_system,
            target_component,
            kind,
            len(payload) if length is None else length,
            list(payload.ljust(128, b"\0")),
        )
        self.packer.srcSystem, self.packer.srcComponent = self.system, self.component
        return bytes(message.pack(self.packer))


def command_frame(
    command: int, *, as_int: bool = False, force_mavlink1: bool = False, values: tuple[float, float] = (2, 0)
) -> bytes:
    """A COMMAND_LONG or COMMAND_INT of station 66, component 190."""
    packer = dialect.MAVLink(None, srcSystem=66, srcComponent=190)
    if as_int:
        message = dialect.MAVLink_command_int_message(1, 1, 0, command, 0, 0, *values, 0, 0, 0, 0, 0)
    else:
        message = dialect.MAVLink_command_long_message(1, 1, command, 0, *values, 0, 0, 0, 0, 0)
    return bytes(message.pack(packer, force_mavlink1=force_mavlink1))


class Bench:
    """Guard, vehicle and companion on one clock. `run` lets time pass; leases go out at 5 Hz while `sending`."""

    def __init__(
        self,
        *,
        absent: Iterable[str] = (),
        parameters: dict[str, float] | None = None,
        without: Iterable[str] = (),
        firmware: tuple[int, int, int] = (4, 7, 0),
        boot_ms: int = 10_000,
        earlier_script: str = "",
        count_instructions: bool = False,
        guard: Path = GUARD,
        heard: bool = True,
        kind: int = COPTER,
    ) -> None:
        """`heard`: something has come in on the companion's channel, so that the guard answers there."""
        self.vehicle = FakeVehicle()
        self.vehicle.type = kind
        if kind == PLANE:
            self.vehicle.parameters["THR_FAILSAFE"] = self.vehicle.parameters.pop("FS_THR_ENABLE")
        self.vehicle.now_ms = boot_ms
        self.vehicle.firmware_version = firmware
        self.vehicle.parameters.update(parameters or {})
        for name in without:  # parameters that this firmware lacks
            del self.vehicle.parameters[name]
        self.companion = Companion()
        self.sending = False
        self.scripting = LuaScripting(self.vehicle, absent=absent, count_instructions=count_instructions)
        if earlier_script:
            self.scripting.load_text(earlier_script, "a_neighbour.lua")
        self.scripting.load(guard)
        self.most_instructions = 0
        self._learnt = 0
        self._lease_due_ms = self.vehicle.now_ms
        self.run(0)
        if heard:
            self.hear()
            self.run(100)
        self.starting_instructions, self.most_instructions = self.most_instructions, 0

    def load_instead(self, text: str) -> None:
        """Stop the guard and load this source in its place."""
        self.scripting.stop()
        self.scripting.enabled = True
        self.scripting.load_text(text, GUARD.name)

    def run(self, duration_ms: int, step_ms: int = 10) -> None:
        """Let time pass in small steps."""
        end_ms = self.vehicle.now_ms + duration_ms
        while True:
            if self.sending and self.vehicle.now_ms >= self._lease_due_ms:
                self.receive(self.companion.lease())
                self._lease_due_ms = self.vehicle.now_ms + 200
            self.scripting.run_due(self.vehicle.now_ms)
            self.most_instructions = max(self.most_instructions, self.scripting.instructions)
            self._learn()
            if self.vehicle.now_ms >= end_ms:
                return
            self.vehicle.now_ms += step_ms

    def _learn(self) -> None:
        """The companion takes the guard's nonce from its newest status; while it sends it answers a new one at once."""
        before = self.companion.guard_nonce
        for _, msgid, payload in self.vehicle.messages[self._learnt :]:
            if msgid == dialect.MAVLINK_MSG_ID_TUNNEL and struct.unpack_from("<H", payload)[0] == STATUS_TYPE:
                self.companion.guard_nonce = Status(*struct.unpack_from(STATUS_LAYOUT, payload, 5)).guard_nonce
        self._learnt = len(self.vehicle.messages)
        if self.sending and self.companion.guard_nonce != before:
            self.receive(self.companion.lease())

    def receive(self, frame: bytes, channel: int = COMPANION_CHANNEL) -> bool:
        self.vehicle.ports.add(channel)
        return self.scripting.deliver(frame, channel)

    def hear(self, channel: int = COMPANION_CHANNEL) -> None:
        """Something of no importance comes in on a channel; the guard answers where it has heard something."""
        self.receive(self.companion.tunnel(b"", kind=0), channel)

    def ask(self, channel: int = COMPANION_CHANNEL) -> None:
        """The companion asks for the nonce of the guard, which answers at once."""
        self.receive(self.companion.lease(guard_nonce=0), channel)
        self.run(100)

    def pilot_chooses(self, mode: int, reason: int = BY_RC) -> None:
        """By the switch of a transmitter that is heard."""
        self.vehicle.rc = True
        self.vehicle.mode, self.vehicle.reason = mode, reason

    def with_lease(self) -> Bench:
        """The companion is up and its lease is live."""
        self.sending = True
        self.run(300)
        return self

    def fly(self, mode: int = AUTO, reason: int = BY_GCS) -> Bench:
        """In the air for a while, with a live lease."""
        self.with_lease()
        self.vehicle.armed = self.vehicle.flying = True
        self.vehicle.mode, self.vehicle.reason = mode, reason
        self.run(1000)
        self.vehicle.texts.clear()
        return self

    def lose_lease(self) -> int:
        """The companion falls silent. Returns the time of its last lease."""
        self.sending = False
        return self._lease_due_ms - 200

    def until(self, condition: Callable[[], bool], limit_ms: int = 10_000) -> int:
        """Let time pass until the condition holds; returns the time then."""
        end_ms = self.vehicle.now_ms + limit_ms
        while not condition():
            assert self.vehicle.now_ms < end_ms, "never happened"
            self.run(10)
        return self.vehicle.now_ms

    @property
    def may_arm(self) -> bool:
        return self.scripting.arming_refusal() is None

    @property
    def refusal(self) -> str | None:
        return self.scripting.arming_refusal()

    @property
    def texts(self) -> list[str]:
        return [text for _, text in self.vehicle.texts]

    def statuses(self, channel: int = COMPANION_CHANNEL) -> list[Status]:
        """The guard's answers so far."""
        return list(_statuses(self.vehicle.messages, channel))

    @property
    def enforcement(self) -> int:
        """The guard's state, as its newest log record has it."""
        name, record = self.vehicle.records[-1]
        assert name == "HNDO"
        return int(str(record["En"]))

    @property
    def status(self) -> Status:
        """The newest one."""
        return next(_statuses(reversed(self.vehicle.messages), COMPANION_CHANNEL))


def _statuses(messages: Iterable[tuple[int, int, bytes]], channel: int) -> Iterator[Status]:
    for chan, msgid, payload in messages:
        kind, system, component, length = struct.unpack_from("<HBBB", payload)
        if chan == channel and msgid == dialect.MAVLINK_MSG_ID_TUNNEL and kind == STATUS_TYPE:
            assert (system, component) == (1, 191)
            assert length == (32 if payload[8] & 32 else 24)
            yield Status(*struct.unpack_from(STATUS_LAYOUT, payload, 5))
