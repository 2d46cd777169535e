# SPDX-License-Identifier: GPL-3.0-or-later

"""A station's links in the companion: opened all or none, used as one, and looked after inside MAVProxy.

The devices themselves are tested in tests/link.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import module as gcs_module
from mavproxy_handover.config.files import StationLinks
from mavproxy_handover.core.common.model import Station
from mavproxy_handover.link.devices import LinkError, open_device
from mavproxy_handover.operator.stations.port import StationPort, open_ports
from mavproxy_handover.tools.clocks import Clocks
from tests.module.conftest import Bench, Clock
from tests.module.proxy import Master
from tests.module.test_station_module import StationBench
from tests.module.vehicle import frames

HERE = "127.0.0.1"
SYSTEM = Clocks(time.time, time.monotonic)
TIMESYNC = mavlink.MAVLINK_MSG_ID_TIMESYNC


class End:
    """The other end of a UDP link: a station's program with one link of its own."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((HERE, 0))
        self.socket.setblocking(False)
        self.port: int = self.socket.getsockname()[1]
        self.own = mavlink.MAVLink(None, srcSystem=251, srcComponent=190)
        self.vehicle: tuple[str, int] | None = None
        self.alive = True

    def send(self, message: Any, sysid: int = 251) -> None:
        self.own.srcSystem = sysid
        data = message.pack(self.own)
        self.own.seq = (self.own.seq + 1) & 0xFF
        assert self.vehicle is not None
        self.socket.sendto(data, self.vehicle)

    def got(self) -> list[bytes]:
        """What arrived, but for probes, which are answered."""
        found = []
        while True:
            try:
                data, self.vehicle = self.socket.recvfrom(65536)
            except BlockingIOError:
                return found
            if not self.alive:
                continue
            if data[:1] == b"\xfd" and data[7] == TIMESYNC:
                self.send(mavlink.MAVLink_timesync_message(5, int.from_bytes(data[18 : 10 + data[1]], "little")))
            else:
                found.append(data)


@pytest.fixture
def ends() -> Iterator[list[End]]:
    ends = [End() for _ in range(2)]
    yield ends
    for end in ends:
        end.socket.close()


@pytest.fixture
def port(ends: list[End]) -> Iterator[StationPort]:
    links = tuple(f"udpout:{HERE}:{end.port}" for end in ends)
    ports = open_ports((StationLinks(Station(251, "A"), links, frozenset({251, 241})),), 1, SYSTEM)
    yield ports[251]
    ports[251].close()


def run(port: StationPort, ends: list[End], begin: float, seconds: float) -> tuple[list[list[bytes]], list[int]]:
    """Time goes on, with a line of telemetry each 0.1 s. What each end got, and the system ids that were passed on."""
    got: list[list[bytes]] = [[] for _ in ends]
    passed: list[int] = []
    for step in range(round(seconds / 0.05)):
        now = begin + step * 0.05
        port.tick(now)
        if step % 2:
            port.write(b"telemetry")
        for number, end in enumerate(ends):
            got[number] += end.got()
        for link in port.links:
            passed += [frame.sysid for frame in port.read(link, now)]
    return got, passed


def beat() -> Any:
    return mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def test_all_links_are_opened_or_none(ends: list[End]) -> None:
    free = End()
    free.socket.close()
    configs = (
        StationLinks(Station(251, "A"), (f"udpin:{HERE}:{free.port}",), frozenset({251})),
        StationLinks(Station(252, "B"), (f"udpin:{HERE}:{ends[0].port}",), frozenset({252})),
    )
    with pytest.raises(LinkError):
        open_ports(configs, 1, SYSTEM)
    open_device(f"udpin:{HERE}:{free.port}").close()


def test_what_the_station_sends_is_passed_on_but_no_answers_to_probes(port: StationPort, ends: list[End]) -> None:
    run(port, ends, 100.0, 1.0)
    ends[0].send(beat())
    ends[1].send(beat(), sysid=241)
    ends[1].send(mavlink.MAVLink_timesync_message(7, 12345))  # an answer, but to no question of ours
    _got, passed = run(port, ends, 101.0, 0.2)
    assert sorted(passed) == [241, 251, 251]


def test_telemetry_takes_one_link_and_transfer_messages_all(port: StationPort, ends: list[End]) -> None:
    run(port, ends, 100.0, 1.0)
    got, _passed = run(port, ends, 101.0, 2.0)
    assert sorted(len(datagrams) for datagrams in got) == [0, 20]
    for link in port.links:
        assert port.quality(link, 103.0).round_trip_s is not None
    port.write_all(b"transfer")
    assert [end.got() for end in ends] == [[b"transfer"], [b"transfer"]]


def test_telemetry_moves_to_the_other_link_when_one_is_silent(port: StationPort, ends: list[End]) -> None:
    run(port, ends, 100.0, 1.0)
    got, _passed = run(port, ends, 101.0, 1.0)
    used = 0 if got[0] else 1
    ends[used].alive = False
    got, _passed = run(port, ends, 102.0, 1.0)
    assert len(got[1 - used]) >= 2  # the last of ten at the latest a second after the other one died
    got, _passed = run(port, ends, 103.0, 1.0)
    assert len(got[1 - used]) == 10


def test_probes_are_numbered_for_each_link_and_come_from_no_other_component(port: StationPort, ends: list[End]) -> None:
    for step in range(30):
        port.tick(100.0 + step * 0.1)
    for end in ends:
        received = [frames(end.socket.recv(100))[0] for _ in range(30)]
        assert [message.get_seq() for message in received] == list(range(30))
        assert {(m.get_type(), m.get_srcSystem(), m.get_srcComponent(), m.tc1) for m in received} == {
            ("TIMESYNC", 1, 240, 0)
        }


def test_frames_in_other_names_are_passed_on_for_the_gate_and_do_nothing_for_the_link(ends: list[End]) -> None:
    free = End()
    free.socket.close()
    ports = open_ports((StationLinks(Station(251, "A"), (f"udpin:{HERE}:{free.port}",), frozenset({251})),), 1, SYSTEM)
    port = ports[251]
    ends[0].vehicle = ends[1].vehicle = (HERE, free.port)
    ends[0].send(beat(), sysid=252)
    assert [frame.sysid for frame in port.read(port.links[0], 100.0)] == [252]
    assert not port.links[0].open
    assert port.quality(port.links[0], 100.0).heard_ago_s is None
    ends[1].send(beat())
    assert [frame.sysid for frame in port.read(port.links[0], 100.0)] == [251]
    port.write(b"telemetry")
    assert ends[1].got() == [b"telemetry"]
    assert b"telemetry" not in ends[0].got()
    port.close()


# ---- inside MAVProxy ----------------------------------------------------------------------------------------------


def listener() -> socket.socket:
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.bind((HERE, 0))
    sock.listen()
    sock.settimeout(10)
    return sock


def test_mavproxy_waits_for_the_descriptor_that_a_link_has_now(bench: Bench) -> None:
    """A TCP link has none while it connects, and another one after each reconnect."""
    station = listener()
    udp, tcp = f"udpout:{HERE}:{bench.a.port}", f"tcp:{HERE}:{station.getsockname()[1]}"
    text = bench.config.read_text()
    assert udp in text
    bench.config.write_text(text.replace(f'"{udp}"', f'"{udp}", "{tcp}"'))
    bench.load()
    state = bench.mpstate
    first, second = bench.companion.ports[251].links

    def run_until(connected: bool) -> None:
        for _ in range(400):
            bench.run(0.05)
            if second.open is connected:
                return
            second._backoff._at = 0.0  # the device's own clock does not follow the bench's
        raise AssertionError(second.trouble)

    run_until(connected=True)
    accepted = station.accept()[0]
    assert second.fileno() in state.select_extra
    assert len(state.select_extra) == 3
    accepted.close()
    descriptor = second.fileno()
    function, argument = state.select_extra[descriptor]
    assert select.select([descriptor], [], [], 5.0)[0]
    function(argument)  # as MAVProxy does
    assert descriptor not in state.select_extra  # at once: the number may be another file's in the next round
    run_until(connected=False)
    assert len(state.select_extra) == 2
    assert first.fileno() in state.select_extra
    run_until(connected=True)
    again = station.accept()[0]
    again.sendall(bytes(beat().pack(mavlink.MAVLink(None, srcSystem=251, srcComponent=190))))
    for _ in range(100):
        bench.run(0.05)
        if second.counters.frames_in:
            break
    assert second.counters.frames_in == 1
    assert state.unload("handover")
    assert state.select_extra == {}
    assert state.escaped == []
    again.close()
    station.close()


def test_what_happens_to_a_link_is_in_the_journal(bench: Bench) -> None:
    bench.connect()
    bench.b.alive = False
    bench.wait(5.0)
    link = f"udpout:{HERE}:{bench.b.port}"
    told = [entry for entry in bench.journal() if entry["event"] == "link" and entry["link"] == link]
    assert [(entry["station"], entry["change"], entry["measure"]) for entry in told] == [
        ("GCSB", "degraded", "silence")
    ]
    assert told[0]["text"].startswith(f"link {link} degraded: silence 3.")


def test_stations_tells_what_was_measured_on_each_link(bench: Bench) -> None:
    bench.connect()
    port = bench.companion.ports[251]
    assert port.quality(port.links[0], bench.clock.now).frames > 0
    line = bench.mpstate.type("handover stations")[1]
    assert line.startswith(f"  udpout:{HERE}:{bench.a.port}: heard 0.")
    assert " s ago, " in line


# ---- at the station -----------------------------------------------------------------------------------------------


def test_the_station_answers_probes_on_every_link_in_that_links_own_sequence(tmp_path: Path) -> None:
    station = StationBench(tmp_path, Clock())
    station.load()
    first = station.mpstate.mav_master[0]
    second = Master()
    station.mpstate.mav_master.append(second)
    station.run(0.05)
    for master in (first, second):
        master.written.clear()
    second.mav.seq = 40
    station.hear(mavlink.MAVLink_timesync_message(0, 12348), autopilot=True)  # MAVProxy's or nobody's to answer
    station._companion.srcComponent = 240
    station.hear(mavlink.MAVLink_timesync_message(0, 12345))
    station.hear(mavlink.MAVLink_timesync_message(0, 12346))
    station.hear(mavlink.MAVLink_timesync_message(9, 12347))  # an answer, not a question
    for master, begin in ((first, first.mav.seq - 2), (second, 40)):
        answers = [message for data in master.written for message in frames(data)]
        assert [(m.get_srcSystem(), m.get_seq(), m.ts1) for m in answers] == [
            (251, begin, 12345),
            (251, begin + 1, 12346),
        ]
        assert all(m.tc1 > 0 for m in answers)
    assert station.mpstate.unload("handover_gcs")
    assert station.mpstate.escaped == []
    station.peer.socket.close()


def test_the_station_sends_by_the_link_that_lives(tmp_path: Path) -> None:
    clock = Clock()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gcs_module, "time", clock)
        station = StationBench(tmp_path, clock)
        station.load()
        first = station.mpstate.mav_master[0]
        second = Master()
        second.address = "udpin:127.0.0.1:14551"
        station.mpstate.mav_master.append(second)
        for _ in range(20):  # 10 probes a second on each link, and MAVProxy counts them
            first.mav.total_packets_received += 1
            second.mav.total_packets_received += 1
            station.run(0.1)
        assert station.mpstate.settings.link == 1
        for _ in range(8):
            second.mav.total_packets_received += 1
            station.run(0.1)
        assert station.mpstate.settings.link == 2
        for master in (first, second):
            master.written.clear()
        station.mpstate.type("handover start")
        station.run(0.1)
        sent = [message.get_type() for data in second.written for message in frames(data)]
        assert "COMMAND_LONG" in sent
        assert first.written == []
        (entry,) = station.journal("link")
        assert entry["text"] == "link to the vehicle is udpin:127.0.0.1:14551 now"
        assert station.mpstate.unload("handover_gcs")
    assert station.mpstate.escaped == []
    station.peer.socket.close()


@pytest.mark.usefixtures("waited_for_far")
def test_a_link_with_an_unfinished_frame_is_read_in_every_tick(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else noise makes it deaf until something arrives."""
    device = bench.companion.ports[251].links[0]
    bench.a.alive = bench.b.alive = False
    bench.run(0.5)
    reads: list[float] = []
    read = device.read

    def counted(once: bool = False) -> Any:
        reads.append(bench.clock.now)
        return read(once)

    monkeypatch.setattr(device, "read", counted)
    bench.run(2.0)
    seldom = len(reads)
    assert seldom <= 12
    reads.clear()
    monkeypatch.setattr(type(device), "unfinished", property(lambda self: self is device))
    bench.run(2.0)
    assert len(reads) >= 38
