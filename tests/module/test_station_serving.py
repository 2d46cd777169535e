# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover station --serve`: another program is the station, and the module holds identity, signing and consent."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import module as gcs_module
from mavproxy_handover.mission.package import MissionPackage
from sitl.vehicles.ports import PortPicker
from tests.module.conftest import Clock
from tests.module.test_station_module import StationBench
from tests.module.vehicle import frames

HEARTBEAT = "HEARTBEAT"


class Program:
    """A stock program at a port of this computer, with system id 255."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.port: int = self.socket.getsockname()[1]
        self.own = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.station: Any = None

    def received(self) -> list[Any]:
        found = []
        while True:
            try:
                data, self.station = self.socket.recvfrom(65536)
            except BlockingIOError:
                return found
            found += frames(data)

    def send(self, message: Any) -> None:
        self.socket.sendto(message.pack(self.own), self.station)


class ServingBench(StationBench):
    def __init__(self, folder: Path, clock: Clock) -> None:
        super().__init__(folder, clock)
        self.program = Program()
        self.link = f"udp:127.0.0.1:{self.program.port}"

    def beat(self) -> None:
        self.program.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        self.run(0.1)

    def connect(self) -> None:
        """The vehicle's heartbeat reaches the program, which learns from where it comes."""
        self.hear(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3), autopilot=True)
        assert [m.get_type() for m in self.program.received()] == [HEARTBEAT]

    def close(self) -> None:
        super().close()
        self.program.socket.close()


@pytest.fixture
def bench(tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServingBench]:
    monkeypatch.setattr(gcs_module, "time", clock)
    made = ServingBench(tmp_path, clock)
    yield made
    made.close()
    assert made.mpstate.escaped == []


def beats(bench: ServingBench) -> int:
    return sum(m.get_type() == HEARTBEAT for m in bench.sent())


def test_the_program_s_heartbeat_is_the_station_s_and_there_is_no_other(bench: ServingBench) -> None:
    bench.load(serve=bench.link)
    assert bench.mpstate.settings.heartbeat == 0
    assert bench.mpstate.settings.mavfwd is False, "what comes from --out is not passed on"
    assert bench.mpstate.console.said(f"The served program is not heard yet ({bench.link}). Start it")
    bench.connect()
    bench.run(5.0)
    assert beats(bench) == 0
    bench.beat()
    found = [m for m in bench.sent() if m.get_type() == HEARTBEAT]
    assert [(m.get_srcSystem(), m.type, m.autopilot) for m in found] == [(251, 6, 8)]
    assert bench.mpstate.console.said("is heard (")


def test_a_silent_program_is_told_and_the_station_sends_no_heartbeat(bench: ServingBench) -> None:
    bench.load(serve=bench.link)
    bench.connect()
    bench.beat()
    bench.sent()
    bench.run(4.0)
    assert beats(bench) == 0, "so the vehicle loses the station"
    assert bench.mpstate.console.said("The served program is silent for 3 s (")
    assert [entry["event"] for entry in bench.journal("program_lost")] == ["program_lost"]


def test_a_command_leaves_as_the_station_s_and_its_answer_is_the_program_s(bench: ServingBench) -> None:
    bench.load(serve=bench.link)
    bench.connect()
    bench.beat()
    bench.sent()
    bench.program.send(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0))
    bench.run(0.1)
    (sent,) = [m for m in bench.sent() if m.get_type() == "COMMAND_LONG"]
    assert (sent.get_srcSystem(), sent.target_system, sent.command, sent.param2) == (251, 1, 176, 4.0)
    ack = mavlink.MAVLink_command_ack_message(176, 0, 0, 0, sent.get_srcSystem(), sent.get_srcComponent())
    bench.hear(ack, autopilot=True)
    (answer,) = [m for m in bench.program.received() if m.get_type() == "COMMAND_ACK"]
    assert (answer.target_system, answer.target_component) == (255, 190)


def question() -> Any:
    return mavlink.MAVLink_connect_message(251, 190, 1, 1, 1, 7, 1, 251, b"drone-1", list(bytes(32)))


def test_without_the_program_the_module_answers_nothing_in_its_name(bench: ServingBench) -> None:
    bench.load(serve=bench.link)
    bench.connect()
    bench.beat()
    bench.sent()
    bench.hear(question())
    assert [m.get_type() for m in bench.sent()] == ["CONNECT_ACK"]
    bench.run(1.6)
    bench.sent()
    bench.hear(question())
    assert bench.sent() == []
    bench.beat()
    bench.sent()
    bench.hear(question())
    assert [m.get_type() for m in bench.sent()] == ["CONNECT_ACK"]


def test_without_the_program_no_package_is_acknowledged(bench: ServingBench, delivery: MissionPackage) -> None:
    bench.load(serve=bench.link)
    bench.connect()
    bench.beat()
    bench.module.aircraft[0].core.vehicle_digest = delivery.digest
    offer = mavlink.MAVLink_mission_package_message(251, 0, 400, list(delivery.digest), b"delivery", 0, [0] * 176)
    bench.sent()
    bench.hear(offer)
    assert [m.get_type() for m in bench.sent()] == ["MISSION_PACKAGE_ACK"]
    bench.run(1.6)
    bench.sent()
    bench.hear(offer)
    bench.run(1.0)
    assert bench.sent() == []


def test_texts_of_parameters_survive(bench: ServingBench) -> None:
    bench.load(serve=bench.link)
    bench.connect()
    bench.beat()
    bench.sent()
    bench.program.send(mavlink.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 500.0, 9))
    bench.run(0.1)
    (sent,) = [m for m in bench.sent() if m.get_type() == "PARAM_SET"]
    assert (sent.param_id, sent.param_value, sent.get_srcSystem()) == ("WPNAV_SPEED", 500.0, 251)


def test_garbage_and_frames_in_the_vehicle_s_name_go_nowhere(bench: ServingBench) -> None:
    bench.load(serve=bench.link)
    bench.connect()
    bench.beat()
    bench.sent()
    bench.program.socket.sendto(b"\xfd\x00" * 40, bench.program.station)
    bench.program.own.srcSystem = 1
    bench.program.send(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0))
    bench.run(0.2)
    assert [m.get_type() for m in bench.sent()] == []
    assert bench.mpstate.console.said("frames in the name of a vehicle: not passed on")


def test_unload_restores_mavproxy_and_reload_serves_again(bench: ServingBench) -> None:
    bench.load(serve=bench.link)
    bench.mpstate.unload("handover_gcs")
    assert bench.mpstate.settings.heartbeat == 1
    assert bench.mpstate.settings.mavfwd is True
    assert bench.mpstate.load("handover_gcs", gcs_module) is not None
    assert bench.mpstate.settings.heartbeat == 0


def test_the_configuration_can_name_it(bench: ServingBench) -> None:
    bench.config.write_text(bench.config.read_text().replace("vehicle = 1", f'vehicle = 1\nserve = "{bench.link}"'))
    bench.load()
    assert bench.mpstate.console.said(f"The served program is not heard yet ({bench.link})")


@pytest.mark.parametrize("link", ["udpin:0.0.0.0:14551", "nonsense", 5])
def test_a_link_that_cannot_be_served_is_refused_in_one_line(bench: ServingBench, link: Any) -> None:
    assert bench.load(serve=link) is None
    assert bench.mpstate.console.said("handover_gcs is not loaded: ")
    assert bench.mpstate.settings.heartbeat == 1


def test_a_port_in_use_is_told_and_nothing_stays_open(bench: ServingBench) -> None:
    port = PortPicker().udp()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        assert bench.load(serve=f"udpin:127.0.0.1:{port}") is None
    assert bench.mpstate.console.said("Address already in use")
    assert bench.load(serve=f"udpin:127.0.0.1:{port}") is not None


def test_a_fault_while_frames_are_passed_on_does_not_answer_for_a_dead_program(
    bench: ServingBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.load(serve=bench.link)
    bench.hear(question())
    assert bench.sent() == [], "not before the program is heard"
    bench.connect()
    bench.beat()
    monkeypatch.setattr(bench.module._served._program, "read", lambda _now: 1 / 0)
    bench.run(2.0)
    bench.sent()
    bench.hear(question())
    assert bench.sent() == []
    assert bench.module.faults["served program"] > 0
