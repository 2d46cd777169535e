# SPDX-License-Identifier: GPL-3.0-or-later

"""The rally list is no file for stations: what pymavlink's own client of file transfer hears."""

from __future__ import annotations

import struct
from collections import deque
from io import BytesIO
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink import mavftp
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from tests.module.conftest import Bench
from tests.module.test_places import RALLY_1, RALLY_2
from tests.module.test_rally_list import seen, untouched
from tests.module.vehicle import Station

NAME = "@MISSION/rally.dat"
OPEN, CREATE, ACK = 4, 6, 128


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


@pytest.mark.parametrize("armed", [False, True])
def test_there_is_no_such_file_and_the_mission_protocol_has_the_list(ready: Bench, armed: bool) -> None:
    ready.autopilot.armed = ready.autopilot.airborne = armed
    ready.run(2.0)
    for station in (ready.a, ready.b):
        client = Client(ready, station)
        client.cmd_get([NAME], callback=lambda _file: None)
        assert client.process_ftp_reply("get").error_code == mavftp.FtpError.FileNotFound
        client = Client(ready, station)
        client.cmd_put(["rally", NAME], fh=BytesIO(bytes(10)))
        assert client.process_ftp_reply("put").error_code == mavftp.FtpError.FileNotFound
        assert seen(ready, station) == [(*RALLY_1, 30.0), (*RALLY_2, 30.0)]
    assert {OPEN, CREATE}.isdisjoint(asked_of_the_autopilot(ready))
    assert untouched(ready)
