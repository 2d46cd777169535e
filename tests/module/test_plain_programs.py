# SPDX-License-Identifier: GPL-3.0-or-later

"""Programs that know nothing of this system: what they get, what they have, and what tells them why nothing works."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.store.keys import write_key
from tests.module.conftest import Bench

LAND, ARM, REQUEST = 21, 400, mavlink.MAV_CMD_REQUEST_MESSAGE
NOT_IN_CONTROL, DENIED, ACCEPTED = 10, 2, 0


def more(bench: Bench, line: str) -> None:
    """A line more in the block of GCSB."""
    bench.config.write_text(bench.config.read_text().replace("sysid = 252\n", f"sysid = 252\n            {line}\n"))


# ---- the companion's heartbeat ------------------------------------------------------------------------------------


def test_a_program_that_takes_every_heartbeat_for_the_autopilots_is_spared_the_companions(bench: Bench) -> None:
    """The fault: DroneKit took base_mode 0 of component 191 and never saw the vehicle armed."""
    more(bench, 'module = false\n            companion_heartbeat = false\n            consent = "refuse"')
    bench.connect()
    bench.wait(5.0)
    assert {m.get_srcComponent() for m in bench.b.got("HEARTBEAT")} == {1}
    assert {m.get_srcComponent() for m in bench.a.got("HEARTBEAT")} == {1, 191}


# ---- messages that the installed dialect does not know ------------------------------------------------------------


def deliver(bench: Bench, msgid: int) -> None:
    """A message of the autopilot that is younger than the installed dialect."""
    payload = bytes(range(1, 9))
    raw = bytes([0xFD, len(payload), 0, 0, 7, 1, 1, msgid & 0xFF, msgid >> 8, 0]) + payload + b"\x12\x34"
    bench.mpstate.deliver(stock.MAVLink_unknown(msgid, bytearray(raw)))


@pytest.fixture
def raw_of_b(bench: Bench) -> list[bytes]:
    """What GCSB receives, whole datagrams."""
    heard: list[bytes] = []
    bench.connect()
    write = bench.companion.ports[252].write

    def note(data: bytes) -> None:
        heard.append(data)
        write(data)

    bench.companion.ports[252].write = note
    return heard


def ids(heard: list[bytes]) -> list[int]:
    return [data[7] | data[8] << 8 for data in heard if data[0] == 0xFD]


def test_the_available_modes_reach_the_station_that_asked(bench: Bench, raw_of_b: list[bytes]) -> None:
    """The fault: the request was acknowledged, and no answer came."""
    deliver(bench, 435)
    assert 435 not in ids(raw_of_b), "it has not asked"
    bench.b.command(REQUEST, 435, 0)
    bench.run(0.2)
    for _ in range(25):
        deliver(bench, 435)
    assert ids(raw_of_b).count(435) == 25


def test_every_station_hears_that_the_available_modes_have_changed(bench: Bench, raw_of_b: list[bytes]) -> None:
    deliver(bench, 437)
    assert ids(raw_of_b).count(437) == 1


# ---- components ---------------------------------------------------------------------------------------------------


def as_component(bench: Bench, component: int, message: Any, sysid: int = 251) -> None:
    bench.a.send_bytes(message.pack(mavlink.MAVLink(None, srcSystem=sysid, srcComponent=component)))
    bench.run(0.2)


def land() -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, LAND, 0, *[0.0] * 7)


@pytest.mark.parametrize("component", [25, 240, 100])
def test_another_component_behind_a_stations_id_has_no_authority(bench: Bench, component: int) -> None:
    """The fault: a camera or a tracker with the station's own system id had the commander's authority."""
    bench.connect()
    as_component(bench, component, land())
    assert LAND not in bench.autopilot.commands()
    assert bench.a.acks(LAND) == [DENIED]
    text = "LAND refused: this component has no authority ('components' in [[station]])"
    assert bench.a.told()[-1][1] == text
    as_component(bench, component, mavlink.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1))
    assert [m.get_srcComponent() for m in bench.autopilot.got("PARAM_REQUEST_READ", 251)] == [component], "it may read"


@pytest.mark.parametrize("component", [0, 1, 190, 230])
def test_what_ground_station_programs_send_as_is_the_stations(bench: Bench, component: int) -> None:
    bench.connect()
    as_component(bench, component, land())
    assert LAND in bench.autopilot.commands()


def test_the_configuration_names_the_components_that_are_the_stations(bench: Bench) -> None:
    text = bench.config.read_text().replace("sysid = 251\n", "sysid = 251\n            components = [190, 25]\n")
    bench.config.write_text(text)
    bench.connect()
    as_component(bench, 25, land())
    assert bench.autopilot.commands().count(LAND) == 1
    as_component(bench, 230, land())
    assert bench.autopilot.commands().count(LAND) == 1


def test_a_heartbeat_of_another_component_is_no_sign_of_life_and_does_not_reach_the_autopilot(bench: Bench) -> None:
    bench.connect()
    bench.a.alive = False
    bench.autopilot.received.clear()
    for _ in range(10):
        as_component(bench, 100, mavlink.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3))
        bench.run(0.8)
    assert bench.companion.view.commander is None
    assert bench.autopilot.got("HEARTBEAT", 251) == []


def test_a_word_of_a_transfer_of_another_component_is_dropped(bench: Bench) -> None:
    bench.connect()
    before = len(bench.a.got("HANDOVER_REHEARSAL"))
    as_component(bench, 100, mavlink.MAVLink_handover_rehearse_message(1, 191, 1, 0, 7))
    assert len(bench.a.got("HANDOVER_REHEARSAL")) == before


# ---- why nothing works --------------------------------------------------------------------------------------------


def test_a_program_without_heartbeats_is_told_why_nothing_works(bench: Bench) -> None:
    """The fault: 'no station commands', and 'never heard' in the list of stations."""
    bench.b.alive = False
    bench.connect()
    bench.b._answer = lambda message: None  # type: ignore[method-assign]
    for _ in range(10):
        bench.b.send(mavlink.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1))
        bench.run(1.0)
    texts = [text for _severity, text in bench.b.told() if "heartbeat" in text]
    assert texts == [
        "Handover: GCSB sends no heartbeat, so it cannot command. Send HEARTBEAT each second as system 252."
    ]
    bench.mpstate.console.lines.clear()
    bench.mpstate.type("handover stations")
    assert bench.mpstate.console.said("GCSB (252): frames, but no heartbeat, not connected")


def test_a_program_without_heartbeats_that_asks_once_is_told_too(bench: Bench) -> None:
    """An operator presses arm once, and waits."""
    bench.b.alive = False
    bench.connect()
    bench.b._answer = lambda message: None  # type: ignore[method-assign]
    bench.b.send(mavlink.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1))
    bench.wait(10.0)
    texts = [text for _severity, text in bench.b.told() if "heartbeat" in text]
    assert texts == [
        "Handover: GCSB sends no heartbeat, so it cannot command. Send HEARTBEAT each second as system 252."
    ]


def test_a_station_whose_heartbeats_were_heard_is_not_told_for_one_late_frame(bench: Bench) -> None:
    """Its link may have lost them."""
    bench.connect()
    bench.b.alive = False
    bench.b._answer = lambda message: None  # type: ignore[method-assign]
    bench.wait(6.0)
    bench.b.send(mavlink.MAVLink_param_request_read_message(1, 1, b"WPNAV_SPEED", -1))
    bench.wait(10.0)
    assert [text for _severity, text in bench.b.told() if "sends no heartbeat" in text] == []


def test_a_station_with_heartbeats_and_one_that_says_nothing_are_told_nothing(bench: Bench) -> None:
    bench.b.alive = False
    bench.connect()
    bench.wait(60.0)
    assert [text for station in (bench.a, bench.b) for _s, text in station.told() if "heartbeat" in text] == []


@pytest.fixture
def keyed(bench: Bench, tmp_path: Path) -> Bench:
    """GCSB has a key, and its program does not sign."""
    write_key(tmp_path / "b.key", bytes(range(32)))
    more(bench, 'key = "b.key"')
    bench.load()
    return bench


def test_a_program_without_its_key_is_told_why_nothing_works(keyed: Bench) -> None:
    """The fault: a stock MAVProxy without its key heard nothing at all for forty seconds."""
    keyed.wait(35.0)
    texts = [text for _severity, text in keyed.b.told() if "sign" in text]
    assert texts == ["Handover: frames of GCSB are not signed: give this program the key of GCSB."] * 4
    told = [m for m in keyed.b.got("STATUSTEXT") if "sign" in m.text]
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in told} == {(1, 1)}


def test_a_program_under_another_system_id_is_told_which_one_it_has_to_have(bench: Bench) -> None:
    """A tracker, or a program that nobody set up: its frames were dropped in silence."""
    bench.b.alive = False
    bench.load()
    bench.run(1.0)
    for _ in range(15):
        bench.b.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), sysid=255)
        bench.run(1.0)
    texts = [text for _severity, text in bench.b.told() if "system id" in text]
    assert texts == ["Handover: system id 255 is not one of GCSB: set this program's to 252."] * 2


def test_while_the_station_is_heard_nobody_else_is_answered(bench: Bench) -> None:
    bench.connect()
    bench.b.received.clear()
    for _ in range(15):
        bench.b.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), sysid=255)
        bench.run(1.0)
    assert [text for _severity, text in bench.b.told() if "system id" in text] == []
