# SPDX-License-Identifier: GPL-3.0-or-later

"""The built-in vehicle as a process, started as the simulation starts it, talked to over loopback TCP."""

from __future__ import annotations

import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles import LaunchError, RunningVehicle, VehicleSpec, find_arducopter, launch
from sitl.vehicles.builtin.__main__ import parse
from sitl.vehicles.builtin.framing import FrameSplitter, decode
from sitl.vehicles.builtin.params import ParameterTable
from sitl.vehicles.process import BASE_PARAMETERS

pytestmark = pytest.mark.process

GUARD = Path(__file__).parents[2] / "ardupilot_lua" / "handover_guard.lua"
HOME = (52.679, 5.924, 10.0, 0.0)
SPEEDUP = 20.0
GUIDED, RTL = 4, 6
#: base_mode of a disarmed copter in RTL: custom mode, stabilised, manual input.
DISARMED = 81


class Client:
    """One TCP client of a vehicle's port."""

    def __init__(self, address: str) -> None:
        kind, host, port = address.split(":")
        assert kind == "tcp"
        self.socket = socket.create_connection((host, int(port)), timeout=30)
        self.socket.settimeout(0.005)
        self.splitter = FrameSplitter()
        self.encoder = dialect.MAVLink(None, 1, 191)
        self.sequence = 0
        self.leasing = False
        #: as the guard's status tells it
        self.guard_nonce = 0

    def send(self, message: dialect.MAVLink_message) -> None:
        self.socket.sendall(message.pack(self.encoder))

    def lease(self) -> None:
        """One lease; its life of 15 simulated seconds is 0.75 s of the wall clock here."""
        self.sequence += 1
        payload = struct.pack("<BBBBIIIHHI", 2, 1, 251, 0, 99, self.sequence, 1, 15000, 0, self.guard_nonce)
        self.send(dialect.MAVLink_tunnel_message(1, 1, 47116, 24, list(payload.ljust(128, b"\0"))))

    def wait(self, kind: str, timeout_s: float = 60.0, **fields: Any) -> Any:
        """The next message of a type with these field values; fails after `timeout_s` of the wall clock."""
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s:
            if self.leasing:
                self.lease()
            try:
                data = self.socket.recv(65536)
            except TimeoutError:
                continue
            assert data, "the vehicle closed the connection"
            for frame in self.splitter.push(data):
                message = decode(frame)
                if message is not None and message.get_type() == "TUNNEL" and message.payload_type == 47117:
                    self.guard_nonce = struct.unpack_from("<I", bytes(message.payload), 20)[0]
                if message is None or message.get_type() != kind or message.get_srcSystem() != 1:
                    continue
                if all(getattr(message, name) == value for name, value in fields.items()):
                    return message
        raise AssertionError(f"no {kind} {fields} within {timeout_s} s")

    def command(self, command: int, *params: float) -> int:
        filled = [*params, *([0.0] * (7 - len(params)))]
        self.send(dialect.MAVLink_command_long_message(1, 1, command, 0, *filled))
        return int(self.wait("COMMAND_ACK", command=command).result)

    def close(self) -> None:
        self.socket.close()


def start(directory: Path, **changes: Any) -> RunningVehicle:
    return launch("builtin", VehicleSpec(home=HOME, speedup=SPEEDUP, **changes), directory)


@pytest.fixture
def vehicle(tmp_path: Path) -> Iterator[RunningVehicle]:
    running = start(tmp_path)
    yield running
    running.stop()


def test_companion_gone_in_auto_brings_it_home_and_a_new_client_sees_it(tmp_path: Path) -> None:
    pytest.importorskip("lupa.lua53", reason="the guard runs in Lua 5.3, by lupa")
    parameters = {"HNDO_CHAN": 1, "HNDO_TIMEOUT": 15, "RTL_ALT": 800}
    running = start(tmp_path, scripts=(GUARD,), parameters=parameters)
    try:
        companion, observer = Client(running.companion_master), Client(running.monitor)
        companion.leasing = True
        companion.wait("EKF_STATUS_REPORT", flags=831)
        companion.send(dialect.MAVLink_mission_count_message(1, 1, 3, 0))
        places = [(16, 0, 0, 0, 0.0), (22, 3, 0, 0, 8.0), (16, 3, 526840000, 59240000, 8.0)]
        for index, (command, frame, x, y, z) in enumerate(places):
            companion.wait("MISSION_REQUEST", seq=index)
            item = (1, 1, index, frame, command, 0, 1, 0, 0, 0, 0, x, y, z, 0)
            companion.send(dialect.MAVLink_mission_item_int_message(*item))
        assert companion.wait("MISSION_ACK").type == 0
        assert [companion.command(176, 1, GUIDED), companion.command(400, 1), companion.command(300)] == [0, 0, 0]
        companion.wait("MISSION_CURRENT", seq=2)
        companion.close()  # what its death does to the connection
        observer.wait("HEARTBEAT", custom_mode=RTL)
        again = Client(running.companion_master)
        again.wait("HEARTBEAT", timeout_s=60, custom_mode=RTL, base_mode=DISARMED)
        position = again.wait("GLOBAL_POSITION_INT")
        assert abs(position.lat - 526790000) < 10
        assert position.relative_alt == 0
        observer.close()
        again.close()
    finally:
        running.stop()
    assert not running.alive()
    assert "HNDO: lease lost, RTL" in running.log_path.read_text(encoding="utf-8")


def test_time_runs_at_the_speed_asked_for(vehicle: RunningVehicle) -> None:
    client = Client(vehicle.companion_master)
    seen = []
    for _ in range(10):  # a second in which the machine had something else to do proves nothing
        first, wall_s = client.wait("GLOBAL_POSITION_INT").time_boot_ms, time.monotonic()
        while time.monotonic() - wall_s < 1.0:
            last = client.wait("GLOBAL_POSITION_INT").time_boot_ms
        seen.append((last - first) / 1000 / (time.monotonic() - wall_s))
        if seen[-1] == pytest.approx(SPEEDUP, rel=0.15):
            break
    client.close()
    assert seen[-1] == pytest.approx(SPEEDUP, rel=0.15), seen


def test_a_new_client_takes_the_place_of_the_old_one(vehicle: RunningVehicle) -> None:
    old = Client(vehicle.companion_master)
    old.wait("HEARTBEAT")
    new = Client(vehicle.companion_master)
    new.wait("HEARTBEAT")
    deadline_s = time.monotonic() + 60
    data = b"?"
    while data and time.monotonic() < deadline_s:
        try:
            data = old.socket.recv(65536)
        except TimeoutError:
            continue
    assert data == b""
    old.close()
    new.close()


def test_everything_it_writes_is_in_its_directory(tmp_path: Path) -> None:
    running = start(tmp_path / "flight", scripts=(GUARD,), parameters={"RTL_ALT": 2000})
    running.stop()
    names = sorted(path.name for path in (tmp_path / "flight").iterdir())
    assert names == ["0_copter_base.parm", "1_overrides.parm", "scripts", "vehicle.log"]
    assert (tmp_path / "flight" / "scripts" / "handover_guard.lua").is_file()
    assert (tmp_path / "flight" / "1_overrides.parm").read_text(encoding="utf-8") == "RTL_ALT 2000\n"


def test_a_vehicle_that_cannot_start_says_why(tmp_path: Path) -> None:
    bad = tmp_path / "bad.parm"
    bad.write_text("RTL_ALT high\n", encoding="utf-8")
    with pytest.raises(LaunchError, match=r"bad\.parm:1: expected NAME VALUE, found 'RTL_ALT high'"):
        start(tmp_path / "flight", defaults=(bad,))
    with pytest.raises(LaunchError, match="vehicle kind 'helicopter' is unknown; the kinds are builtin, arducopter"):
        launch("helicopter", VehicleSpec(home=HOME), tmp_path / "flight")


def test_a_named_arducopter_that_is_none_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(LaunchError, match=r"--arducopter: .*nowhere is not a program that can be run"):
        find_arducopter(str(tmp_path / "nowhere"))


def test_the_environment_names_the_arducopter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "arducopter"
    program.write_text("#!/bin/sh\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("ARDUCOPTER", str(program))
    assert find_arducopter() == program.resolve()


SYDNEY = "-33.85000000,151.21000000,0.00000000,0.00000000"


@pytest.mark.parametrize("home", [["--home", SYDNEY], [f"--home={SYDNEY}"]])
def test_a_place_south_of_the_equator_is_no_option(home: list[str]) -> None:
    assert parse([*home, "--serial1", "tcp:0"]).home == (-33.85, 151.21, 0.0, 0.0)
    assert parse(["--serial1", "tcp:0", *home, "--speedup", "2"]).speedup == 2.0


def test_it_flies_south_of_the_equator(tmp_path: Path) -> None:
    running = launch("builtin", VehicleSpec(home=(-33.85, -70.21, 0.0, 0.0), speedup=SPEEDUP), tmp_path)
    try:
        client = Client(running.companion_master)
        client.wait("EKF_STATUS_REPORT", flags=831)
        position = client.wait("GLOBAL_POSITION_INT")
        client.close()
    finally:
        running.stop()
    assert (position.lat, position.lon) == (-338500000, -702100000)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--home", "52,5,0,0"], "give at least one of --serial0 to --serial2"),
        (["--home", "152,5,0,0", "--serial1", "tcp:0"], "'152,5,0,0' is not LAT,LON,ALT,HEADING"),
        (["--serial1", "tcp:0", "--home"], "argument --home: expected one argument"),
        (["--home", "52,5,0,0", "--serial1", "udp:0"], "'udp:0' is not tcp:PORT"),
        (["--home", "52,5,0,0", "--serial1", "tcp:0", "--speedup", "0"], "speed-up 0 is not between 0.1 and 100"),
    ],
)
def test_bad_command_lines_are_explained(arguments: list[str], complaint: str) -> None:
    result = subprocess.run(
        [sys.executable, "-m", "sitl.vehicles.builtin", *arguments],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 2
    assert complaint in result.stderr


def test_the_base_parameters_suit_the_model() -> None:
    table = ParameterTable()
    table.load(BASE_PARAMETERS)
    assert (table["FS_THR_ENABLE"], table["SCR_ENABLE"], table["BATT_MONITOR"]) == (0, 1, 4)
    assert (table["MAV2_POSITION"], table["MAV3_POSITION"]) == (10, 10)
