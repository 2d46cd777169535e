# SPDX-License-Identifier: GPL-3.0-or-later

"""Through the module: what a station has open when its authority ends, its rates while it observes, what is locked."""

from __future__ import annotations

import struct

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from tests.gate.frames import ftp_request
from tests.module.conftest import Bench

LOST = 3


@pytest.fixture
def flight(bench: Bench) -> Bench:
    """GCSA commands, GCSB is an observer; what came before is forgotten."""
    bench.connect()
    bench.run(2.0)  # both are known to be there without sticks
    for end in (bench.autopilot, bench.a, bench.b):
        end.received.clear()
    return bench


def test_what_a_lost_commander_had_open_is_closed_before_the_lease_says_so(flight: Bench) -> None:
    """The guard lets the autopilot follow the lease: after it, nobody releases the old commander's sticks."""
    flight.autopilot.armed = True
    flight.run(1.5)
    flight.autopilot.received.clear()
    flight.a.send(mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, *[65535] * 17))
    flight.a.send(mavlink.MAVLink_mission_count_message(1, 1, 3, 0))
    flight.run(0.2)
    flight.a.alive = False
    flight.until(lambda: flight.companion.view.commander is None)
    flight.run(0.5)
    kinds = []
    for message in flight.autopilot.received:
        if message.get_srcSystem() == 251 and message.get_type() != "HEARTBEAT":
            kinds.append((message.get_type(), getattr(message, "count", None)))
        elif message.get_type() == "TUNNEL" and struct.unpack_from("<BB", bytes(message.payload))[1] == LOST:
            kinds.append(("lease", LOST))
    assert kinds[:5] == [
        ("RC_CHANNELS_OVERRIDE", None),
        ("MISSION_COUNT", 3),
        ("RC_CHANNELS_OVERRIDE", None),
        ("MISSION_COUNT", 65535),
        ("lease", LOST),
    ]
    assert flight.autopilot.got("RC_CHANNELS_OVERRIDE", 251)[-1].chan1_raw == 0
    entries = [(entry["text"], entry.get("incomplete")) for entry in flight.journal("flush")]
    assert entries == [("RC override released (GCSA)", None), ("unfinished mission upload ended (GCSA)", True)]


def test_parameters_are_locked_when_the_vehicle_arms_and_an_open_file_of_them_is_thrown_away(flight: Bench) -> None:
    def open_file(path: bytes) -> None:
        payload = ftp_request(6, path, session=2, sequence=7)
        flight.a.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        flight.a.send(mavlink.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 0.0, 9))
        flight.run(0.1)

    open_file(b"@PARAM/param.pck")
    assert len(flight.autopilot.got("PARAM_SET", 251)) == 1
    flight.autopilot.armed = True
    flight.run(1.5)
    assert flight.companion.view.armed
    opcodes = [message.payload[3] for message in flight.autopilot.got("FILE_TRANSFER_PROTOCOL", 251)]
    assert opcodes == [6, 7, 1], "opened by the station; spoiled and closed by the companion"
    open_file(b"@PARAM/param.pck")
    assert len(flight.autopilot.got("FILE_TRANSFER_PROTOCOL", 251)) == 3
    assert len(flight.autopilot.got("PARAM_SET", 251)) == 1
    assert flight.a.got("FILE_TRANSFER_PROTOCOL")[-1].payload[3] == 129
    assert flight.a.got("PARAM_ERROR")[-1].error == 3
    told = [text for _severity, text in flight.a.told() if text.endswith("locked while armed")]
    assert told == [f"{what} refused: locked while armed" for what in ("file upload", "parameter FS_GCS_ENABLE")]
    assert {entry["reason"] for entry in flight.journal("refused")} == {"locked while armed"}


def test_an_observers_rates_are_answered_by_the_companion_and_kept_from_the_autopilot(flight: Bench) -> None:
    def attitudes(count: int) -> int:
        flight.b.received.clear()
        for _ in range(count):
            flight.autopilot.say(mavlink.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
            for message in flight.autopilot._out:
                flight.mpstate.deliver(message)
            flight.run(0.05)
        return len(flight.b.got("ATTITUDE"))

    assert attitudes(20) == 0
    flight.b.received.clear()
    flight.b.command(511, 30, 500_000)
    flight.b.command(510, 30)
    flight.b.send(mavlink.MAVLink_request_data_stream_message(1, 1, 11, 4, 1))
    flight.run(0.2)
    first, second = flight.b.got("COMMAND_ACK")
    assert [(m.command, m.result, m.get_srcSystem(), m.get_srcComponent()) for m in (first, second)] == [
        (511, 0, 1, 1),
        (510, 0, 1, 1),
    ]
    (told,) = flight.b.got("MESSAGE_INTERVAL")
    assert (told.message_id, told.interval_us) == (30, 500_000)
    assert attitudes(40) in (4, 5)
    assert flight.autopilot.got("COMMAND_LONG", 252) == flight.autopilot.got("REQUEST_DATA_STREAM", 252) == []
    flight.a.command(511, 30, 500_000)
    flight.run(0.1)
    assert len(flight.autopilot.got("COMMAND_LONG", 251)) == 1, "the commander's own go to the autopilot"


def test_a_flood_of_rate_requests_is_not_a_flood_of_answers(flight: Bench) -> None:
    for _ in range(40):
        flight.b.command(510, 30)
    flight.run(0.5)
    assert len(flight.b.got("COMMAND_ACK")) == 20
