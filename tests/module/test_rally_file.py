# SPDX-License-Identifier: GPL-3.0-or-later

"""`rally ftp` and `rally ftpload` of MAVProxy: the list of the companion as a file, with pymavlink's own client."""

from __future__ import annotations

import struct
from collections import deque
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink import mavftp
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from tests.gate.frames import ftp_request
from tests.module.conftest import Bench
from tests.module.test_places import RALLY_1, RALLY_2
from tests.module.test_rally_list import NEW, seen, untouched
from tests.module.vehicle import Station

NAME = "@MISSION/rally.dat"
ITEM = mavlink.MAVLink_mission_item_int_message
TERMINATE, RESET, OPEN, READ, CREATE, WRITE, ACK, NAK = 1, 2, 4, 5, 6, 7, 128, 129


class Client(mavftp.MAVFTP):
    """The client at a station: it hears what comes there, and while it waits the bench goes on."""

    def __init__(self, bench: Bench, station: Station) -> None:
        self._heard: deque[Any] = deque()
        self._bench, self._station = bench, station
        mav = SimpleNamespace(file_transfer_protocol_send=self._send)
        ids = {"source_system": station.sysid, "source_component": 190}
        super().__init__(SimpleNamespace(mav=mav, recv_match=self._receive, **ids), 1, 1)

    def _send(self, network: int, system: int, component: int, payload: bytearray) -> None:
        self._station.send(mavlink.MAVLink_file_transfer_protocol_message(network, system, component, list(payload)))

    def _receive(self, **_kwargs: Any) -> Any:
        if not self._heard:
            self._bench.run(0.05)
            self._heard += self._station.got("FILE_TRANSFER_PROTOCOL")
            self._station.received.clear()
        return self._heard.popleft() if self._heard else None


@pytest.fixture
def ready(bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """The client waits in the bench's time. The autopilot acknowledges whatever is asked of its files."""
    monkeypatch.setattr(mavftp, "time", bench.clock)
    take = bench.autopilot._take

    def also_files(message: Any) -> None:
        if message.get_type() != "FILE_TRANSFER_PROTOCOL":
            take(message)
            return
        asked = bytes(message.payload)
        sequence, session, opcode = struct.unpack_from("<HBB", asked)
        answer = struct.pack("<HBBBB", (sequence + 1) & 0xFFFF, session, ACK, 0, opcode).ljust(251, b"\0")
        asker = message.get_srcSystem(), message.get_srcComponent()
        bench.autopilot.say(stock.MAVLink_file_transfer_protocol_message(0, *asker, list(answer)))

    bench.autopilot._take = also_files  # type: ignore[method-assign]
    bench.connect()
    bench.share(delivery, at_once=True)
    bench.wait(6.0)
    return bench


def asked_of_the_autopilot(bench: Bench) -> list[int]:
    """Opcodes of stations' requests that have reached it."""
    return [m.payload[3] for m in bench.autopilot.got("FILE_TRANSFER_PROTOCOL") if m.get_srcSystem() != 1]


def points(data: bytes) -> list[tuple[int, int, float]]:
    magic, kind, _options, _start, number = struct.unpack_from("<5H", data)
    assert (magic, kind, len(data)) == (0x763D, 2, 10 + number * ITEM.unpacker.size)
    items = (ITEM.unpacker.unpack_from(data, 10 + n * ITEM.unpacker.size) for n in range(number))
    return [(lat, lon, alt) for _1, _2, _3, _4, lat, lon, alt, *_others in items]


def listed(*places: tuple[int, int], command: int = 5100) -> bytes:
    items = [ITEM.unpacker.pack(0, 0, 0, 0, *p, 25.0, n, command, 1, 1, 3, 0, 1, 2) for n, p in enumerate(places)]
    return struct.pack("<5H", 0x763D, 2, 0, 0, len(places)) + b"".join(items)


def read(bench: Bench, station: Station) -> list[tuple[int, int, float]]:
    """The list as that station's client gets it."""
    got: list[bytes] = []
    client = Client(bench, station)
    client.cmd_get([NAME], callback=lambda fh: got.append(fh.read() if fh is not None else b""))
    client.process_ftp_reply("get")
    (data,) = got
    return points(data)


def write(bench: Bench, station: Station, data: bytes) -> int:
    client = Client(bench, station)
    client.cmd_put(["rally", NAME], fh=BytesIO(data))
    return int(client.process_ftp_reply("put").error_code)


def request(station: Station, bench: Bench, opcode: int, data: bytes = b"", session: int = 5, sequence: int = 0) -> int:
    """The opcode of the answer."""
    station.received.clear()
    payload = ftp_request(opcode, data, session, sequence)
    station.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
    bench.run(0.2)
    (answer,) = station.got("FILE_TRANSFER_PROTOCOL")
    assert (answer.get_srcSystem(), answer.get_srcComponent()) == (1, 1)
    return int(answer.payload[3])


@pytest.mark.parametrize("armed", [False, True])
def test_everybody_reads_the_candidates(ready: Bench, armed: bool) -> None:
    ready.autopilot.armed = ready.autopilot.airborne = armed
    ready.run(2.0)
    expected = [(*RALLY_1, 30.0), (*RALLY_2, 30.0)]
    assert read(ready, ready.a) == expected
    assert read(ready, ready.b) == expected
    assert set(asked_of_the_autopilot(ready)) <= {RESET}
    assert untouched(ready)


@pytest.mark.parametrize("armed", [False, True])
def test_the_commander_writes_them(ready: Bench, armed: bool) -> None:
    ready.autopilot.armed = ready.autopilot.airborne = armed
    ready.run(2.0)
    assert write(ready, ready.a, listed(NEW, RALLY_2)) == mavftp.FtpError.Success
    ready.run(0.5)
    assert seen(ready, ready.b) == [(*NEW, 25.0), (*RALLY_2, 25.0)]
    assert read(ready, ready.b) == [(*NEW, 25.0), (*RALLY_2, 25.0)]
    (entry,) = ready.journal("rally_list")
    assert entry["text"] == "2 rally points of GCSA replace the mission's for this flight"
    assert set(asked_of_the_autopilot(ready)) <= {RESET}


def test_nobody_else_does(ready: Bench) -> None:
    assert write(ready, ready.b, listed(NEW)) != mavftp.FtpError.Success
    assert request(ready.b, ready, CREATE, NAME.encode()) == NAK
    assert request(ready.b, ready, WRITE, b"x", sequence=1) == NAK
    assert len(seen(ready, ready.b)) == 2
    assert "rally" not in "".join(entry["text"] for entry in ready.journal("rally_list"))


def test_a_list_with_a_flaw_is_not_taken_and_people_are_told(ready: Bench) -> None:
    data = listed(NEW, command=16)
    assert request(ready.a, ready, CREATE, NAME.encode()) == ACK
    assert request(ready.a, ready, WRITE, data, sequence=1) == ACK
    assert request(ready.a, ready, TERMINATE, sequence=2) == NAK
    assert "rally points rejected: item 0: no rally point" in ready.a.texts()
    assert len(seen(ready, ready.a)) == 2
    assert ready.companion.faults == {}


def test_a_list_that_could_not_be_put_in_place_is_not_acknowledged(
    ready: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ready.companion.autopilot.return_site.list, "_replaced", lambda *_list: 1 / 0)
    assert request(ready.a, ready, CREATE, NAME.encode()) == ACK
    assert request(ready.a, ready, WRITE, listed(NEW), sequence=1) == ACK
    ready.a.received.clear()
    again = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, ftp_request(TERMINATE, b"", 5, 2))
    ready.a.send(again)
    ready.a.send(again)
    ready.run(0.2)
    assert [answer.payload[3] for answer in ready.a.got("FILE_TRANSFER_PROTOCOL")] == [NAK]
    assert len(seen(ready, ready.a)) == 2
    assert ready.companion.faults


def test_the_upload_of_a_station_that_commands_no_more_is_given_up(ready: Bench) -> None:
    assert request(ready.a, ready, CREATE, NAME.encode()) == ACK
    assert request(ready.a, ready, WRITE, listed(NEW), sequence=1) == ACK
    ready.a.alive = False
    ready.until(lambda: ready.companion.view.commander is None, 40.0)
    ready.a.alive = True
    ready.until(lambda: ready.companion.view.commander == 251, 40.0)
    assert request(ready.a, ready, TERMINATE, sequence=2) == ACK, "of the autopilot, which knows no such session"
    assert len(seen(ready, ready.a)) == 2


def test_other_files_are_the_autopilots_as_ever(ready: Bench) -> None:
    assert request(ready.a, ready, OPEN, NAME.encode()) == ACK
    assert asked_of_the_autopilot(ready) == []
    assert request(ready.a, ready, OPEN, b"@PARAM/param.pck", sequence=1) == ACK
    assert request(ready.a, ready, READ, sequence=2) == ACK
    assert asked_of_the_autopilot(ready) == [OPEN, READ]


def test_a_program_that_hangs_up_leaves_nothing(ready: Bench, tmp_path: Path) -> None:
    assert request(ready.a, ready, CREATE, NAME.encode()) == ACK
    assert request(ready.a, ready, WRITE, listed(NEW), sequence=1) == ACK
    assert request(ready.a, ready, RESET, sequence=2) == ACK
    assert asked_of_the_autopilot(ready) == [RESET]
    assert len(seen(ready, ready.a)) == 2
