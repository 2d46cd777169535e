# SPDX-License-Identifier: GPL-3.0-or-later

"""Flight logs: any station reads them while the vehicle is disarmed, one after the other; armed, no station."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.judge import Fate, GateReason
from mavproxy_handover.gate.log_turn import QUIET_S
from mavproxy_handover.wire.frames import Frame, parse_one
from tests.gate.door import Door
from tests.gate.frames import ftp_request
from tests.gate.ledger import GCSA, GCSB, GCSC, VEHICLE, A, B, C

Make = Callable[..., Frame]
GROUND = AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD, armed=False)
FLYING = replace(GROUND, phase=Phase.ON_MISSION, armed=True)
LOGS = ("LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END")
OPEN, LIST, BURST = 4, 3, 15
BUSY = (Fate.REFUSE, GateReason.LOG_BUSY)
PASSES = (Fate.FORWARD, GateReason.ALLOWED)
IN_FLIGHT = (Fate.REFUSE, GateReason.ON_GROUND)


@pytest.fixture
def door() -> Door:
    door = Door(step_s=0.0)
    door.change(GROUND)
    return door


def file(make: Make, opcode: int, path: bytes = b"", sysid: int = GCSB) -> Frame:
    return make("FILE_TRANSFER_PROTOCOL", sysid=sysid, payload=ftp_request(opcode, path))


def outcome(door: Door, station: Any, frame: Frame) -> tuple[Fate, GateReason]:
    verdict = door.up(station, frame).verdict
    return verdict.fate, verdict.reason


def vehicles(message: mavlink.MAVLink_message) -> Frame:
    frame = parse_one(bytes(message.pack(mavlink.MAVLink(None, srcSystem=VEHICLE, srcComponent=1))))
    assert frame is not None
    return frame


ENTRY = vehicles(mavlink.MAVLink_log_entry_message(7, 1, 7, 0, 900))


def data(begin: int) -> Frame:
    return vehicles(mavlink.MAVLink_log_data_message(7, begin, 90, [1] * 90))


def send(door: Door, seconds: float = 1.0) -> None:
    for _ in range(round(seconds / 0.02)):
        door.now += 0.02
        door.gate.downloads.send(door.now)


@pytest.mark.parametrize("commander", [GCSA, GCSB, None])
@pytest.mark.parametrize("name", LOGS)
def test_any_station_reads_logs_on_the_ground(door: Door, make: Make, name: str, commander: int | None) -> None:
    door.change(replace(GROUND, commander=commander))
    came = door.up(B, make(name, sysid=GCSB))
    assert (came.verdict.fate, came.verdict.reason) == PASSES
    assert len(came.passed) == 1


@pytest.mark.parametrize("station", [A, B])
@pytest.mark.parametrize("name", LOGS)
def test_in_flight_no_station_does_and_it_is_told(make: Make, name: str, station: Any) -> None:
    door = Door(step_s=0.0)
    door.change(FLYING)
    for _ in range(50):
        assert outcome(door, station, make(name, sysid=station.sysid)) == IN_FLIGHT
    (said,) = door.said
    assert said[1].endswith(" refused: only while the vehicle is disarmed")


@pytest.mark.parametrize(("opcode", "path"), [(OPEN, b"APM/LOGS/1.BIN"), (LIST, b"APM/LOGS")])
def test_logs_are_files_too(door: Door, make: Make, opcode: int, path: bytes) -> None:
    assert outcome(door, B, file(make, opcode, path)) == PASSES
    door.change(FLYING)
    assert outcome(door, B, file(make, opcode, path)) == IN_FLIGHT
    assert door.said[-1] == (GCSB, "reading logs refused: only while the vehicle is disarmed")


def test_two_stations_download_in_turn(door: Door, make: Make) -> None:
    ask = {station: make("LOG_REQUEST_DATA", sysid=station, id=7, ofs=0, count=270) for station in (GCSB, GCSC)}
    assert outcome(door, B, ask[GCSB]) == PASSES
    for begin in (0, 90, 180):
        assert outcome(door, C, ask[GCSC]) == BUSY
        door.gate.down(data(begin), door.now)
    send(door)
    assert door.ports[GCSB].heard == [data(begin).raw for begin in (0, 90, 180)]
    assert door.ports[GCSA].heard == [], "nor does the commander get another station's log"
    assert door.said == [(GCSC, "log download refused: GCSB reads a log, try again later")]
    assert outcome(door, B, make("LOG_REQUEST_END", sysid=GCSB)) == PASSES
    assert outcome(door, C, ask[GCSC]) == PASSES
    door.gate.down(data(0), door.now)
    send(door)
    assert door.ports[GCSC].heard[-1] == data(0).raw
    assert len(door.ports[GCSB].heard) == 3


def test_the_second_may_not_end_the_download_of_the_first(door: Door, make: Make) -> None:
    door.up(B, make("LOG_REQUEST_DATA", sysid=GCSB, count=900))
    assert outcome(door, C, make("LOG_REQUEST_END", sysid=GCSC)) == BUSY
    assert outcome(door, A, make("LOG_REQUEST_END", sysid=GCSA)) == BUSY


@pytest.mark.parametrize("name", ["LOG_REQUEST_LIST", "LOG_REQUEST_DATA"])
def test_no_station_keeps_the_commander_from_the_logs(door: Door, make: Make, name: str) -> None:
    door.up(B, make("LOG_REQUEST_LIST", sysid=GCSB))
    assert outcome(door, A, make(name, sysid=GCSA)) == PASSES
    assert door.down(ENTRY) == {GCSA}
    assert outcome(door, B, make("LOG_REQUEST_LIST", sysid=GCSB)) == BUSY
    assert door.said == [(GCSB, "list of logs refused: GCSA reads a log, try again later")]
    door.change(replace(GROUND, commander=GCSC))
    door.up(C, make("LOG_REQUEST_END", sysid=GCSC))
    assert outcome(door, B, make("LOG_REQUEST_LIST", sysid=GCSB)) == PASSES
    assert outcome(door, C, file(make, OPEN, b"APM/LOGS/1.BIN", GCSC)) == PASSES
    assert outcome(door, B, make("LOG_REQUEST_DATA", sysid=GCSB, count=9)) == BUSY


def test_a_station_that_has_gone_keeps_no_one_waiting(door: Door, make: Make) -> None:
    door.up(B, make("LOG_REQUEST_LIST", sysid=GCSB))
    door.now += QUIET_S / 2
    assert door.down(ENTRY) == {GCSB}
    door.now += QUIET_S * 0.9
    assert outcome(door, C, make("LOG_REQUEST_LIST", sysid=GCSC)) == BUSY
    door.now += QUIET_S * 0.2
    assert outcome(door, C, make("LOG_REQUEST_LIST", sysid=GCSC)) == PASSES
    assert door.down(ENTRY) == {GCSC}


def test_entries_that_no_station_has_asked_for_go_the_usual_way(door: Door) -> None:
    assert door.down(ENTRY) == {GCSA}


def test_a_download_by_file_counts_as_one(door: Door, make: Make) -> None:
    assert outcome(door, B, file(make, OPEN, b"APM/LOGS/1.BIN")) == PASSES
    assert outcome(door, C, make("LOG_REQUEST_DATA", sysid=GCSC, count=9)) == BUSY
    assert outcome(door, C, file(make, OPEN, b"APM/LOGS/1.BIN", GCSC)) == BUSY
    assert door.said[-1] == (GCSC, "reading logs refused: GCSB reads a log, try again later")
    for _ in range(10):
        door.now += 4.0
        assert outcome(door, B, file(make, BURST)) == PASSES
        assert outcome(door, C, make("LOG_REQUEST_DATA", sysid=GCSC, count=9)) == BUSY
    door.now += QUIET_S
    assert outcome(door, C, make("LOG_REQUEST_DATA", sysid=GCSC, count=9)) == PASSES


def test_reading_a_log_by_file_is_not_cut_short(door: Door, make: Make) -> None:
    """Other files have a budget, because they slow down the commander's telemetry."""
    assert outcome(door, B, file(make, OPEN, b"APM/LOGS/1.BIN")) == PASSES
    for _ in range(1000):
        door.now += 0.5
        assert outcome(door, B, file(make, BURST)) == PASSES
    door.now += 60.0
    door.up(B, file(make, OPEN, b"@SYS/uarts.txt"))
    assert GateReason.TOO_MANY in {outcome(door, B, file(make, BURST))[1] for _ in range(200)}


def test_arming_ends_a_download_and_its_station_is_told(door: Door, make: Make) -> None:
    door.up(B, make("LOG_REQUEST_DATA", sysid=GCSB, count=90_000))
    for number in range(300):
        door.gate.down(data(90 * number), door.now)
    before = len(door.passed)
    closed = door.change(FLYING)
    assert [(station, closing.what) for station, closing in closed] == [(GCSB, "log download ended")]
    (end,) = [parse_one(raw) for raw in door.passed[before:]]
    assert end is not None
    assert end.msgid == mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END
    assert end.sysid == GCSB
    assert door.said == [(GCSB, "log download ended: the vehicle is armed")]
    heard = len(door.ports[GCSB].heard)
    send(door)
    assert len(door.ports[GCSB].heard) == heard


def test_a_handover_on_the_ground_ends_no_other_stations_download(door: Door, make: Make) -> None:
    door.up(C, make("LOG_REQUEST_DATA", sysid=GCSC, count=90_000))
    door.gate.down(data(0), door.now)
    door.change(replace(GROUND, commander=GCSB, epoch=2))
    send(door)
    assert door.ports[GCSC].heard == [data(0).raw]


def test_parameters_are_read_by_any_station_on_the_ground(door: Door, make: Make) -> None:
    for name in ("PARAM_REQUEST_LIST", "PARAM_REQUEST_READ"):
        assert outcome(door, B, make(name, sysid=GCSB)) == PASSES
