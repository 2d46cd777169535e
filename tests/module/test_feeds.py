# SPDX-License-Identifier: GPL-3.0-or-later

"""Feeds through the whole companion: what reaches the autopilot, what stations are told, what the journal has."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.feeds import Feeds
from tests.module.conftest import Bench
from tests.module.test_faults import broken, leases_in
from tests.module.vehicle import Station


def corrections(station: Station, number: int = 0) -> None:
    station.send(mavlink.MAVLink_gps_rtcm_data_message(number % 32 << 3, 5, list(b"\xd3\x00\x01ab".ljust(180, b"\0"))))


def of(bench: Bench, kind: str, sysid: int) -> int:
    return len(bench.autopilot.got(kind, sysid))


@pytest.fixture
def fed(bench: Bench) -> Bench:
    """GCSB has base and receiver, GCSA the second base; GCSA commands."""
    with bench.config.open("a") as file:
        file.write('\n[feeds]\nrtk = ["GCSB", "GCSA"]\nadsb = ["GCSB"]\n')
    bench.connect()
    bench.autopilot.received.clear()
    return bench


def test_corrections_and_traffic_of_a_station_without_authority_reach_the_autopilot(fed: Bench) -> None:
    for second in range(5):
        corrections(fed.b, second)
        fed.run(0.1)
        corrections(fed.a, second)
        fed.b.send(mavlink.MAVLink_adsb_vehicle_message(7, 1, 2, 0, 0, 0, 0, 0, b"OTHER", 0, 0, 0, 0))
        fed.a.send(mavlink.MAVLink_adsb_vehicle_message(8, 1, 2, 0, 0, 0, 0, 0, b"FALSE", 0, 0, 0, 0))
        fed.run(1.0)
    assert of(fed, "GPS_RTCM_DATA", 252) == of(fed, "ADSB_VEHICLE", 252) == 5
    assert of(fed, "GPS_RTCM_DATA", 251) == of(fed, "ADSB_VEHICLE", 251) == 0
    sources = {(entry["kind"], entry["station"]) for entry in fed.journal("feed") if entry["change"] == "source"}
    assert sources == {("rtk", "GCSB"), ("adsb", "GCSB")}
    for station in (fed.a, fed.b):
        assert "RTK corrections: from GCSB." in station.texts()
    assert "ADS-B of GCSA are not used: 'adsb' in [feeds] does not name it." in fed.a.texts()
    assert "ADS-B of GCSA" not in fed.b.texts()


def test_heartbeats_of_a_receiver_are_journalled_once(fed: Bench) -> None:
    """An ADS-B receiver is component 156. A command of it is journalled as before."""
    beat = mavlink.MAVLink_heartbeat_message(27, 8, 0, 0, 4, 3)
    arm = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    for message in (beat, beat, beat, beat, arm):
        fed.b.own.srcComponent = 156
        fed.b.send(message)
        fed.b.own.srcComponent = 190
        fed.run(1.0)
    assert [entry["what"] for entry in fed.journal("refused")] == [
        "HEARTBEAT",
        "COMMAND_LONG/MAV_CMD_COMPONENT_ARM_DISARM",
    ]


def test_the_next_station_takes_over_after_the_silence_and_all_are_told(fed: Bench) -> None:
    corrections(fed.b)
    fed.run(0.1)
    for second in range(8):
        corrections(fed.a, second)
        fed.run(1.0)
    assert of(fed, "GPS_RTCM_DATA", 251) >= 4
    for station in (fed.a, fed.b):
        assert "RTK corrections: from GCSA after GCSB." in station.texts()
    assert [entry["text"] for entry in fed.journal("feed")] == [
        "RTK corrections: from GCSB.",
        "RTK corrections: from GCSA after GCSB.",
    ]


def test_every_station_hears_the_aircrafts_traffic_and_threats(fed: Bench) -> None:
    fed.b.received.clear()
    fed.autopilot.say(mavlink.MAVLink_adsb_vehicle_message(9, 1, 2, 0, 0, 0, 0, 0, b"X", 0, 0, 0, 0))
    fed.autopilot.say(mavlink.MAVLink_collision_message(0, 9, 1, 2, 1.0, 2.0, 3.0))
    fed.autopilot.say(mavlink.MAVLink_open_drone_id_arm_status_message(0, b"fine"))
    for message in fed.autopilot._out:
        fed.mpstate.deliver(message)
    fed.run(0.3)
    for kind in ("ADSB_VEHICLE", "COLLISION", "OPEN_DRONE_ID_ARM_STATUS"):
        assert len(fed.b.got(kind)) == 1, kind


def test_a_flood_and_a_fault_of_feeds_leave_leases_and_commands_as_they_are(
    fed: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def flood() -> None:
        for number in range(100):
            corrections(fed.b, number)

    before = leases_in(fed, 2.0)
    fed.each_round = flood
    assert leases_in(fed, 2.0) >= before - 1
    monkeypatch.setattr(Feeds, "_reason", broken)
    monkeypatch.setattr(Feeds, "tick", broken)
    assert leases_in(fed, 2.0) >= before - 1
    fed.each_round = lambda: None
    fed.a.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    fed.run(0.5)
    assert mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH in fed.autopilot.commands()
    assert fed.companion.view.commander == 251


@pytest.mark.parametrize(
    "line", ['rtk = ["GCSX"]', 'rtk = ["GCSA", "GCSA"]', "rtk = 7", "rtk_apart_m = -1", "gps = []"]
)
def test_a_wrong_line_is_named(bench: Bench, line: str) -> None:
    with bench.config.open("a") as file:
        file.write(f"\n[feeds]\n{line}\n")
    assert bench.load() is None
    said: list[Any] = [text for text in bench.mpstate.console.lines if "[feeds]" in text]
    assert said, bench.mpstate.console.lines
