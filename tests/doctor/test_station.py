# SPDX-License-Identifier: GPL-3.0-or-later

"""A station's machine: its files, its ports, and the vehicle as it is heard there."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.link.timesync import TIMESYNC, probe_answer
from mavproxy_handover.mission.package import load
from mavproxy_handover.tools.resources import shipped
from mavproxy_handover.wire.frames import FrameSplitter
from mavproxy_handover.wire.ids import DOCTOR_COMPID, LANGUAGE_COMPID
from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer
from tests.doctor.machine import KEYS, Machine, Server, free_port, heartbeat

DIGEST = load(shipped("missions") / "delivery").digest


class Vehicle(Server):
    """What a station hears of a vehicle and its companion, signed: heartbeats, CONNECT, answers to TIMESYNC."""

    def __init__(self, port: int, key: bytes, digest: bytes, *, armed: bool = False, sysid: int = 1) -> None:
        super().__init__()
        self._peer = SignedPeer(key)
        self._own = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=LANGUAGE_COMPID)
        self._heartbeat = heartbeat(sysid, armed=armed)
        self._digest = digest
        self._to = ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.05)
        self._beat_at = 0.0
        #: messages and senders that came in signed with the key
        self.heard: set[tuple[int, int, int]] = set()
        self.start()

    def _once(self) -> None:
        if time.monotonic() >= self._beat_at:
            self._beat_at = time.monotonic() + 0.2
            self._send(self._heartbeat)
            asks = mavlink.MAVLink_connect_message(251, 190, 1, 251, 1, 5, 1, 0, b"drone-1", list(self._digest))
            self._send(bytes(asks.pack(self._own)))
        try:
            data = self._socket.recv(2048)
        except (TimeoutError, ConnectionError):
            return
        for frame in FrameSplitter().feed(data):
            if self._peer.check(frame, time.time(), time.monotonic()) is SignatureVerdict.OK:
                self.heard.add((frame.msgid, frame.sysid, frame.compid))
                answer: Any = probe_answer(frame, time.monotonic_ns())
                if answer is not None:
                    self._send(bytes(answer.pack(self._own)))

    def _send(self, raw: bytes) -> None:
        data = self._peer.sign(raw, 0, time.time(), time.monotonic())
        assert data is not None
        self._socket.sendto(data, self._to)

    def close(self) -> None:
        super().close()
        self._socket.close()


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def machine(tmp_path: Path, port: int) -> Machine:
    text = f"""
        [station]
        name = "GCSA"
        sysid = 251
        vehicle = 1
        key = "keys/GCSA.key"
        mission = "/srv/delivery"
        journal = "/var/lib/handover/GCSA.jsonl"
        [ground]
        listen = "udpin:127.0.0.1:{free_port()}"
        key = "keys/GCSB.key"
        """
    return Machine(tmp_path, "station", text, device=f"udpin:127.0.0.1:{port}")


@pytest.fixture
def vehicles() -> Iterator[list[Vehicle]]:
    made: list[Vehicle] = []
    yield made
    for vehicle in made:
        vehicle.close()


def test_all_is_well(machine: Machine, port: int, vehicles: list[Vehicle], capsys: pytest.CaptureFixture[str]) -> None:
    vehicles.append(Vehicle(port, KEYS["GCSA"], DIGEST))
    found = machine.doctor(capsys)
    assert found.lines("error") == []
    assert found.lines("warning") == []
    assert found.code == 0
    heard, mission = found.of("vehicles")
    assert heard.startswith(f"vehicle 1, udpin:127.0.0.1:{port}: heard, there and back in ")
    assert mission == f"mission of vehicle 1: the vehicle announces the same digest, {DIGEST.hex()[:12]}"
    assert vehicles[0].heard == {(TIMESYNC, 251, DOCTOR_COMPID)}, "a question about the time, and nothing else"


def test_a_vehicle_that_is_armed_is_listened_to_only(
    machine: Machine, port: int, vehicles: list[Vehicle], capsys: pytest.CaptureFixture[str]
) -> None:
    vehicles.append(Vehicle(port, KEYS["GCSA"], DIGEST, armed=True))
    found = machine.doctor(capsys)
    assert found.of("vehicles")[0].endswith("heard, armed: only listened to")
    assert found.code == 0
    assert vehicles[0].heard == set()


def test_another_mission(
    machine: Machine, port: int, vehicles: list[Vehicle], capsys: pytest.CaptureFixture[str]
) -> None:
    vehicles.append(Vehicle(port, KEYS["GCSA"], bytes(range(32))))
    found = machine.doctor(capsys)
    (said,) = found.lines("error")
    assert f"announces digest 000102030405, here lies {DIGEST.hex()[:12]} -> Share one mission" in said
    assert found.code == 1


def test_another_key(machine: Machine, port: int, vehicles: list[Vehicle], capsys: pytest.CaptureFixture[str]) -> None:
    vehicles.append(Vehicle(port, b"C" * 32, DIGEST))
    (said,) = machine.doctor(capsys).lines("error")
    assert "heard, and its frames are not signed with its key: bad signature -> Compare the fingerprints" in said
    assert vehicles[0].heard == set()


def test_another_vehicle(
    machine: Machine, port: int, vehicles: list[Vehicle], capsys: pytest.CaptureFixture[str]
) -> None:
    vehicles.append(Vehicle(port, KEYS["GCSA"], DIGEST, sysid=9))
    (said,) = machine.doctor(capsys).lines("error")
    assert "no frame of system 1, but of 9" in said


def test_a_silent_vehicle(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    found = machine.doctor(capsys)
    (said,) = found.lines("error")
    assert "silent for 3 s" in said
    assert "-> Look whether its companion runs" in said
    assert found.code == 1


def test_a_port_in_use(machine: Machine, port: int, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        found = machine.doctor(capsys)
    (said,) = found.lines("error")
    assert said.startswith(f"ports: link of vehicle 1: udpin:127.0.0.1:{port} is in use by ")
    assert [each for each in found.lines("warning") if "Address already in use -> Free it first." in each]


def test_a_station_that_runs_is_left_alone(machine: Machine, port: int, capsys: pytest.CaptureFixture[str]) -> None:
    holds = "import socket,sys; s = socket.socket(type=2); s.bind(('127.0.0.1', int(sys.argv[1]))); input('bound')"
    words = [sys.executable, "-c", holds, str(port), "--cmd=module load handover_gcs"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as station:
        assert station.stdout is not None
        assert station.stdout.read(5) == b"bound"
        found = machine.doctor(capsys)
        station.communicate(b"\n")
    assert f"link of vehicle 1: udpin:127.0.0.1:{port} is held by the station that runs" in found.of("ports", "ok")
    (said,) = found.of("vehicles")
    assert "held by the station that runs: 'handover status' there" in said
    assert found.code == 0


def test_a_link_by_no_words(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    found = machine.doctor(capsys, "--device", "carrier pigeon")
    assert len([each for each in found.lines("error") if "must be one of udpin:" in each]) >= 1
    assert found.code == 1


ADDRESS = '{"addresses": ["udpout:10.0.0.2:14552"], "from": "GCSB", "mission": "m", "confirmed": "2026-11-27"}'


def without_link(tmp_path: Path, kept: str | None) -> Machine:
    """A station that gets the vehicle's address from another one."""
    text = """
        [station]
        name = "GCSA"
        sysid = 251
        vehicle = 1
        key = "keys/GCSA.key"
        journal = "/var/lib/handover/GCSA.jsonl"
        """
    machine = Machine(tmp_path, "station", text, device=None)
    if kept is not None:
        (machine.root / "etc/handover/GCSA-vehicle-1.address").write_text(kept)
    return machine


def test_an_address_that_the_operator_confirmed_is_told_with_its_origin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = without_link(tmp_path, ADDRESS).doctor(capsys)
    assert found.of("vehicles") == [
        "address of vehicle 1: udpout:10.0.0.2:14552 from GCSB, confirmed 2026-11-27; 'handover status' at the station "
        "says what it hears"
    ]


def test_without_a_link_and_without_an_address_it_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = without_link(tmp_path, None).doctor(capsys)
    (said,) = found.of("vehicles")
    assert said.startswith(
        "vehicle 1: not looked at: no link is named, and no address of another station is confirmed ('handover "
        "connect')"
    )


def test_a_damaged_file_of_the_address_is_an_error_with_the_cure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = without_link(tmp_path, "{").doctor(capsys)
    (said,) = [line for line in found.lines("error") if "address of vehicle 1" in line]
    assert "GCSA-vehicle-1.address: not what this program wrote (JSONDecodeError) -> Delete " in said


def test_an_address_beside_a_link_of_the_stations_own_is_not_used(
    machine: Machine, port: int, vehicles: list[Vehicle], capsys: pytest.CaptureFixture[str]
) -> None:
    (machine.root / "etc/handover/GCSA-vehicle-1.address").write_text(ADDRESS)
    vehicles.append(Vehicle(port, KEYS["GCSA"], DIGEST))
    found = machine.doctor(capsys)
    assert found.of("vehicles")[0].endswith("; not used: this station has its own link")
