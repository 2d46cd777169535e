# SPDX-License-Identifier: GPL-3.0-or-later

"""The real guard script on the built-in vehicle: no lease, no arming; lease lost in flight, home and down."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as dialect

pytest.importorskip("lupa.lua53", reason="the guard runs in Lua 5.3, by lupa")

from sitl.vehicles.builtin.bench import Bench
from sitl.vehicles.builtin.frame import Location, distance_m
from sitl.vehicles.builtin.items import Item

GUARD = Path(__file__).parents[2] / "ardupilot_lua" / "handover_guard.lua"
LEASE, STATUS = 47116, 47117
HELD, LOST = 1, 3
ACCEPTED, FAILED = 0, 4
GUIDED, AUTO, RTL, BRAKE = 4, 3, 6, 17
NONCE = 0x1234ABCD


class Companion:
    """Sends leases as the companion does; stops when it is killed."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.sequence = 0
        self.state = HELD

    def lease(self) -> None:
        self.sequence += 1
        fields = (2, self.state, 251, 0, NONCE, self.sequence, 7, 1500, 0, guard_nonce(self.bench))
        payload = struct.pack("<BBBBIIIHHI", *fields)
        self.bench.send(dialect.MAVLink_tunnel_message(1, 1, LEASE, 24, list(payload.ljust(128, b"\0"))))

    def run(self, seconds: float, **options: object) -> bool:
        return self.bench.run(seconds, do=self.lease, **options)  # type: ignore[arg-type]


def guard_statuses(bench: Bench) -> list[tuple[int, ...]]:
    """The fields of the guard's answers."""
    frames = [h.message for h in bench.heard if h.message.get_type() == "TUNNEL"]
    assert all((frame.payload_type, frame.payload_length) == (STATUS, 24) for frame in frames)
    return [struct.unpack("<BBBBIIIHBBI", bytes(frame.payload[:24])) for frame in frames]


def guard_status(bench: Bench) -> tuple[int, ...]:
    """The newest answer."""
    return guard_statuses(bench)[-1]


def guard_nonce(bench: Bench) -> int:
    """The nonce that leases must carry; 0 before the first answer."""
    return next((status[10] for status in reversed(guard_statuses(bench))), 0)


@pytest.fixture
def bench() -> Bench:
    bench = Bench({"HNDO_CHAN": 1, "HNDO_TIMEOUT": 3, "RALLY_LIMIT_KM": 0}, scripts=[GUARD], channels=(1, 2))
    bench.run(12.0)
    assert not [line for line in bench.records if "script removed" in line]
    return bench


def test_without_a_lease_arming_is_refused_with_the_guards_reason(bench: Bench) -> None:
    assert bench.command(176, 1, GUIDED) == ACCEPTED
    assert bench.command(400, 1) == FAILED
    assert bench.texts()[-1] == "Arm: HNDO: no lease from companion"


def test_a_lease_on_another_channel_does_not_count(bench: Bench) -> None:
    companion = Companion(bench)
    payload = struct.pack("<BBBBIIIHHI", 2, HELD, 251, 0, NONCE, 1, 7, 1500, 0, 0)
    for _ in range(10):
        message = dialect.MAVLink_tunnel_message(1, 1, LEASE, 24, list(payload.ljust(128, b"\0")))
        bench.send(message, channel=2)
        bench.run(0.2)
    assert companion.sequence == 0
    assert bench.command(400, 1) == FAILED


def test_with_a_lease_it_arms_and_the_guard_answers_on_the_companions_channel(bench: Bench) -> None:
    companion = Companion(bench)
    companion.run(2.0)
    bench.command(176, 1, GUIDED)
    assert bench.command(400, 1) == ACCEPTED
    companion.run(1.0)
    version, state, action, flags, nonce, sequence, epoch, *_ = guard_status(bench)
    assert (version, state, action, flags & 0b10, nonce, epoch) == (2, 2, 0, 0b10, NONCE, 7)
    assert companion.sequence - sequence <= 3
    assert {h.channel for h in bench.heard if h.message.get_type() == "TUNNEL"} == {1}


def test_companion_killed_in_auto_returns_to_the_rally_point_lands_and_disarms(bench: Bench) -> None:
    companion = Companion(bench)
    rally = (526815000, 59240000)
    assert bench.upload([Item(5100, 3, x=rally[0], y=rally[1], z=20.0)], kind=2) == ACCEPTED
    mission = [Item(16), Item(22, 3, z=20.0), Item(16, 3, x=526850000, y=59240000, z=20.0), Item(20)]
    assert bench.upload(mission) == ACCEPTED
    companion.run(1.0)
    assert [bench.command(176, 1, GUIDED), bench.command(400, 1), bench.command(300)] == [ACCEPTED] * 3
    companion.run(40.0)
    assert bench.vehicle.copter.mode.number == AUTO
    killed_s = bench.now_s
    assert bench.run(5.0, until=lambda: bench.vehicle.copter.mode.number == RTL)
    assert bench.now_s - killed_s <= 3.2
    assert bench.vehicle.copter.reason == 32  # a script
    assert bench.run(200.0, until=lambda: not bench.vehicle.copter.armed)
    assert distance_m(bench.vehicle.copter.location(), Location(*rally, 0.0)) < 0.5
    assert bench.vehicle.copter.body.on_ground


def test_a_station_cannot_leave_rtl_while_the_loss_lasts(bench: Bench) -> None:
    companion = Companion(bench)
    companion.run(1.0)
    bench.command(176, 1, GUIDED)
    bench.command(400, 1)
    bench.command(22, 0, 0, 0, 0, 0, 0, 30)
    companion.run(25.0)
    bench.run(4.0)
    assert bench.vehicle.copter.mode.number == RTL
    assert bench.command(176, 1, BRAKE, source=(251, 190), channel=2) == ACCEPTED
    bench.run(2.0)
    assert bench.vehicle.copter.mode.number == RTL


def test_scripting_cannot_be_stopped_by_command(bench: Bench) -> None:
    companion = Companion(bench)
    companion.run(1.0)
    ack = bench.command(42701, 2, source=(251, 190), channel=2)
    companion.run(1.0)
    assert ack in (None, 2)
    assert "Scripting: stopped" not in bench.texts()
    assert guard_status(bench)[1] == 2


def test_parameters_of_the_script_are_listed_and_can_be_set(bench: Bench) -> None:
    answer = bench.ask(dialect.MAVLink_param_set_message(1, 1, b"HNDO_TIMEOUT", 5.0, 9), "PARAM_VALUE")
    assert (answer.param_id, answer.param_value) == ("HNDO_TIMEOUT", 5.0)
    assert bench.vehicle.parameters["HNDO_CHAN"] == 1
