# SPDX-License-Identifier: GPL-3.0-or-later

"""What of a station's frames reaches the autopilot through the module, and what of the vehicle's reaches a station."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as stock_all
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.companion import module as vehicle_module
from mavproxy_handover.gate.judge import GateReason
from mavproxy_handover.wire.frames import checked_types
from tests.module.conftest import Bench

RTL = mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
NOT_IN_CONTROL = 10


@pytest.fixture
def flight(bench: Bench) -> Bench:
    """GCSA commands, GCSB is an observer; what came before is forgotten."""
    bench.connect()
    bench.autopilot.received.clear()
    bench.a.received.clear()
    bench.b.received.clear()
    return bench


def foreign(bench: Bench) -> list[Any]:
    """What reached the autopilot and is not the companion's own."""
    return [m for m in bench.autopilot.received if (m.get_srcSystem(), m.get_srcComponent()) != (1, 191)]


def test_the_commanders_command_is_passed_on_byte_for_byte(flight: Bench) -> None:
    message = mavlink.MAVLink_command_long_message(1, 1, RTL, 0, 1, 2, 3, 4, 5, 6, 7)
    raw = message.pack(flight.a.own)
    flight.a.alive = False
    flight.a.send_bytes(raw)
    flight.mpstate.loop()
    assert bytes(raw) in flight.mpstate.mav_master[0].written
    flight.run(0.3)
    assert [entry["what"] for entry in flight.journal("accepted")] == ["COMMAND_LONG/MAV_CMD_NAV_RETURN_TO_LAUNCH"]


def test_an_observers_command_is_refused_and_does_not_reach_the_autopilot(flight: Bench) -> None:
    flight.b.command(RTL)
    flight.run(0.3)
    assert [m for m in foreign(flight) if m.get_type() != "HEARTBEAT"] == []
    (answer,) = flight.b.got("COMMAND_ACK")
    assert (answer.command, answer.result, answer.get_srcSystem(), answer.get_srcComponent()) == (
        RTL,
        NOT_IN_CONTROL,
        1,
        1,
    )
    (entry,) = flight.journal("refused")
    assert (entry["station"], entry["what"], entry["reason"]) == (
        "GCSB",
        "COMMAND_LONG/MAV_CMD_NAV_RETURN_TO_LAUNCH",
        "not in control",
    )


def test_the_journal_names_the_mode_that_was_refused(flight: Bench) -> None:
    flight.b.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 5)
    flight.run(0.3)
    (entry,) = flight.journal("refused")
    assert (entry["what"], entry["named"]) == ("COMMAND_LONG/MAV_CMD_DO_SET_MODE", "mode LOITER")
    assert entry["text"] == "mode LOITER (COMMAND_LONG/MAV_CMD_DO_SET_MODE) of GCSB refused: not in control"


def test_the_journal_names_the_switch_and_the_parameter_that_were_refused(flight: Bench) -> None:
    flight.b.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    flight.b.send(mavlink.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 100.0, 9))
    flight.run(0.3)
    assert [entry["named"] for entry in flight.journal("refused")] == ["disarm", "parameter WPNAV_SPEED"]


def test_the_commanders_heartbeat_alone_reaches_the_autopilot(flight: Bench) -> None:
    flight.run(5.0)
    beats = [m.get_srcSystem() for m in flight.autopilot.got("HEARTBEAT")]
    assert beats.count(251) == 5
    assert beats.count(252) == 0
    assert beats.count(1) == 5, "the companion's own, from component 191"
    assert {m.type for m in flight.autopilot.got("HEARTBEAT", 1)} == {18}


def test_when_the_commander_falls_silent_no_heartbeat_reaches_the_autopilot(flight: Bench) -> None:
    flight.a.alive = False
    flight.run(6.0)
    assert flight.companion.view.commander is None
    flight.autopilot.received.clear()
    flight.run(3.0)
    assert foreign(flight) == []


@pytest.mark.parametrize("claimed", [1, 251, 77])
def test_a_frame_from_b_that_claims_to_be_somebody_else_is_dropped(flight: Bench, claimed: int) -> None:
    reason = GateReason.SPOOFED_VEHICLE if claimed == 1 else GateReason.SPOOFED_STATION
    flight.b.alive = False
    command = mavlink.MAVLink_command_long_message(1, 1, RTL, 0, 0, 0, 0, 0, 0, 0, 0)
    flight.b.send(command, sysid=claimed)
    flight.b.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), sysid=claimed)
    flight.mpstate.loop()
    flight.mpstate.loop()
    written = b"".join(flight.mpstate.mav_master[0].written)
    assert RTL.to_bytes(2, "little") not in written
    assert flight.companion.gate.counts[252][reason] == 2


def test_garbage_from_a_station_costs_nothing(flight: Bench) -> None:
    rng = random.Random(7)
    for size in (1, 10, 263, 280, 1400):
        for _ in range(20):
            flight.b.send_bytes(bytes([0xFD]) + rng.randbytes(size))
    flight.run(1.0)
    assert [m for m in foreign(flight) if m.get_srcSystem() != 251] == []
    assert flight.companion.faults == {}
    assert flight.companion.view.commander == 251


def test_transfer_messages_with_values_outside_every_enum_are_dropped(flight: Bench) -> None:
    flight.b.send(mavlink.MAVLink_on_handover_message(1, 191, 1, 251, 252, 1, 1, 99, 0, 0))
    flight.b.send(mavlink.MAVLink_ok_handover_message(1, 191, 7, 251, 252, 1, 1, 0, 0))
    flight.run(0.2)
    assert [entry["text"] for entry in flight.journal("dropped")] == [
        "ON_HANDOVER of GCSB is not valid",
        "OK_HANDOVER of GCSB is not valid",
    ]
    assert flight.companion.faults == {}


def test_a_flood_of_refused_frames_is_journalled_once_a_second_with_their_number(flight: Bench) -> None:
    for _ in range(30):
        flight.b.command(RTL)
    flight.run(0.5)
    flight.run(0.6)
    flight.b.command(RTL)
    flight.run(0.2)
    first, second = flight.journal("refused")
    assert "also" not in first
    assert second["also"] == 29
    assert 1 <= len(flight.b.got("COMMAND_ACK")) <= 7


def test_an_observer_sees_position_and_authority_and_not_the_attitude(flight: Bench) -> None:
    flight.autopilot.say(mavlink.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    for message in flight.autopilot._out:
        flight.mpstate.deliver(message)
    flight.run(1.0)
    assert len(flight.a.got("ATTITUDE")) == 1
    assert flight.b.got("ATTITUDE") == []
    for kind in ("HEARTBEAT", "GLOBAL_POSITION_INT", "AUTHORITY_STATUS", "CONTROL_STATUS"):
        assert flight.b.got(kind), kind
    assert flight.b.got("TUNNEL") == flight.a.got("TUNNEL") == [], "lease and guard status stay aboard"


class _Foreign:
    """A message as MAVProxy hands it over that runs with another dialect than ours."""

    def __init__(self, raw: bytes) -> None:
        self._raw = raw

    def get_msgbuf(self) -> bytearray:
        return bytearray(self._raw)

    def get_type(self) -> str:
        return "UNKNOWN_30"


def test_what_mavproxy_did_not_check_by_our_definitions_is_checked_here(flight: Bench) -> None:
    raw = bytes(mavlink.MAVLink_attitude_message(0, *[0.5] * 6).pack(mavlink.MAVLink(None, srcSystem=1)))
    wrong = raw[:-1] + bytes([raw[-1] ^ 1])
    flight.mpstate.deliver(_Foreign(wrong))
    flight.run(0.1)
    assert flight.a.got("ATTITUDE") == []
    flight.mpstate.deliver(_Foreign(raw))
    flight.run(0.1)
    assert len(flight.a.got("ATTITUDE")) == 1
    assert flight.companion.faults == {}


def test_what_pymavlink_was_told_not_to_check_is_checked_here() -> None:
    script = (
        "from pymavlink.dialects.v20 import all; from mavproxy_handover.wire.frames import checked_types; "
        "print(len(checked_types(all)))"
    )
    plain = {name: value for name, value in os.environ.items() if name != "MAV_IGNORE_CRC"}
    checked = [
        int(subprocess.run([sys.executable, "-c", script], env=env, check=True, capture_output=True, text=True).stdout)
        for env in (plain, plain | {"MAV_IGNORE_CRC": "1"})
    ]
    assert checked[0] > 250
    assert checked[1] == 0


def test_what_mavproxy_has_checked_by_another_dialect_is_not_checked_again() -> None:
    """The fault: MAVProxy speaks the dialect `all`, and each frame's CRC was computed twice."""
    checked = checked_types(stock_all)
    assert stock_all.MAVLink_attitude_message in checked
    assert stock_all.MAVLink_log_data_message in checked
    assert _Foreign not in checked
    assert all(each.crc_extra == mavlink.mavlink_map[each.id].crc_extra for each in checked), (
        "another extra byte is another check"
    )
    other = type("MAVLink_attitude_message", (), {"id": 30, "crc_extra": 40})
    dialect = SimpleNamespace(mavlink_map={30: other}, MAVLINK_IGNORE_CRC=False)
    assert checked_types(dialect) == frozenset()
    assert checked_types(SimpleNamespace()) == frozenset()


def test_an_observer_gets_the_answer_to_what_it_asked_and_no_other(flight: Bench) -> None:
    def value(name: bytes) -> None:
        flight.autopilot.say(mavlink.MAVLink_param_value_message(name, 1.0, 9, 1, 0))
        for message in flight.autopilot._out:
            flight.mpstate.deliver(message)
        flight.run(0.1)

    value(b"BEFORE")
    flight.b.send(mavlink.MAVLink_param_request_read_message(1, 1, b"ASKED", -1))
    flight.run(0.1)
    assert [m.param_id for m in flight.autopilot.got("PARAM_REQUEST_READ", 252)] == ["ASKED"]
    value(b"ASKED")
    assert [m.param_id for m in flight.b.got("PARAM_VALUE")] == ["ASKED"]
    assert [m.param_id for m in flight.a.got("PARAM_VALUE")] == ["BEFORE", "ASKED"], "the commander hears everything"


def test_authority_status_comes_twice_a_second_and_leases_five_times(flight: Bench) -> None:
    flight.run(10.0)
    assert 19 <= len(flight.b.got("AUTHORITY_STATUS")) <= 21
    assert 9 <= len(flight.b.got("CONTROL_STATUS")) <= 11
    leases = flight.autopilot.leases()
    assert 49 <= len(leases) <= 51
    first = leases[0]
    assert first[:4] == (2, 1, 251, 0)
    assert first[6:9] == (1, 3000, 0)
    assert first[4] != 0
    assert first[9] == flight.autopilot.guard_nonce
    assert [lease[5] for lease in leases] == list(range(first[5], first[5] + len(leases)))


def test_frames_of_the_companion_are_numbered_in_order(flight: Bench) -> None:
    """A gap counts as loss in every ground station program, and signing needs it no less."""
    flight.a.received.clear()
    flight.run(4.0)
    numbers = [m.get_seq() for m in flight.a.received if m.get_srcComponent() == 191]
    assert len(numbers) > 5
    assert numbers == [(numbers[0] + n) & 0xFF for n in range(len(numbers))]


def test_our_own_language_has_a_component_of_its_own(flight: Bench) -> None:
    """A program that does not know a message does not count it: among others of its sender it would look lost."""
    flight.run(3.0)
    speakers: dict[int, set[str]] = {}
    for message in flight.a.received + flight.b.received:
        speakers.setdefault(message.get_srcComponent(), set()).add(message.get_type())
    ours = {cls.msgname for msgid, cls in mavlink.mavlink_map.items() if 47100 <= msgid <= 47131}
    assert speakers[198] <= ours
    assert {"AUTHORITY_STATUS", "HANDOVER_TELEMETRY"} <= speakers[198]
    assert all(not said & ours for component, said in speakers.items() if component != 198)
    assert {"HEARTBEAT", "CONTROL_STATUS"} <= speakers[191]


def test_what_is_left_out_and_put_in_is_no_loss_to_a_station(flight: Bench) -> None:
    """An observer gets a part of the stream, and answers in the autopilot's name between it; the commander gets all."""
    interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    heard = {flight.a: 0, flight.b: 0}
    for _ in range(8):
        flight.b.command(RTL)
        flight.b.send(mavlink.MAVLink_command_long_message(1, 1, interval, 0, 33, 5e5, 0, 0, 0, 0, 0))
        flight.run(1.0)
    for station in heard:
        numbers: dict[tuple[int, int], list[int]] = {}
        for message in station.received:
            sender = message.get_srcSystem(), message.get_srcComponent()
            numbers.setdefault(sender, []).append(message.get_seq())
        assert (1, 1) in numbers
        for sender, found in numbers.items():
            assert found == [(found[0] + n) & 0xFF for n in range(len(found))], (station.name, sender)
        heard[station] = len(numbers[1, 1])
    assert flight.b.got("COMMAND_ACK")
    assert 10 < heard[flight.b] < heard[flight.a] - 10


def test_a_strangers_frame_does_not_draw_the_vehicles_messages_away(bench: Bench) -> None:
    """The link waits for the station; somebody else's program is pointed at it by mistake."""
    bench.a.close()
    bench.a = type(bench.a)("GCSA", 251)
    text = bench.config.read_text()
    start = text.index("udpout:")
    free = type(bench.a)("free", 9)
    port = free.port
    free.close()
    bench.config.write_text(text[:start] + f"udpin:127.0.0.1:{port}" + text[text.index('"', start) :])
    bench.load()
    bench.a.vehicle = ("127.0.0.1", port)
    bench.run(2.0)
    assert bench.companion.view.commander == 251
    stranger = type(bench.a)("stranger", 77)
    stranger.vehicle = ("127.0.0.1", port)
    stranger.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    bench.a.alive = False
    bench.a.received.clear()
    bench.run(0.5)
    stranger.alive = False
    stranger.step(0.0)
    assert stranger.received == []
    assert bench.a.got("AUTHORITY_STATUS")
    stranger.close()


def test_a_position_of_zero_is_no_position(flight: Bench) -> None:
    """An autopilot without a fix goes on sending; the last good position must grow stale."""
    flight.autopilot.position = (0.0, 0.0)
    flight.run(3.0)
    needs = flight.companion.arbiter.start_needs(251, flight.clock.now)
    assert "no position" in needs


def rates(bench: Bench) -> list[tuple[float, float]]:
    """Message ids and intervals (us) that the autopilot has been asked for."""
    return [(m.param1, m.param2) for m in bench.autopilot.got("COMMAND_LONG", 1) if m.command == 511]


def test_rates_are_asked_for_once_although_positions_come_anyway(bench: Bench) -> None:
    """An autopilot that streams positions on its own may still not say whether it has landed."""
    bench.autopilot.position_s = 0.05
    bench.connect()
    bench.run(20.0)
    asked = rates(bench)
    assert (33.0, 50000.0) in asked, "GLOBAL_POSITION_INT at 20 Hz"
    assert (245.0, 500000.0) in asked, "EXTENDED_SYS_STATE at 2 Hz"
    assert len(asked) == len(set(asked)) == 12


def test_rates_are_asked_for_again_while_no_position_comes(bench: Bench) -> None:
    bench.autopilot.position = None
    bench.connect()
    bench.run(12.0)
    assert len(rates(bench)) == 36


def test_positions_that_a_station_has_slowed_down_are_asked_for_again(bench: Bench) -> None:
    bench.connect()
    bench.autopilot.received.clear()
    bench.autopilot.position_s, bench.autopilot.slow = 0.25, True
    bench.run(14.0)
    asked = rates(bench)
    assert len(asked) in (2, 3)
    assert set(asked) == {(33.0, 50000.0)}, "the other rates are the station's business"


def test_sockets_are_read_although_mavproxy_does_not_select_without_a_master(bench: Bench) -> None:
    master = bench.mpstate.mav_master.pop()
    assert bench.load() is not None
    bench.run(3.0)
    assert bench.companion.arbiter.connected(251, bench.clock.now)
    bench.mpstate.mav_master.append(master)
    bench.until(lambda: bench.companion.view.commander == 251)
    assert bench.companion.faults == {}


def test_the_autopilot_of_another_vehicle_is_not_ours(bench: Bench) -> None:
    bench.autopilot._own.srcSystem = 2
    assert bench.mpstate.load("handover", vehicle_module, config=str(bench.config)) is not None
    bench.module = bench.mpstate.modules[-1][0]
    bench.run(3.0)
    assert bench.companion.view.commander is None, "no autopilot, no authority"
    assert "no autopilot" in bench.companion.arbiter.start_needs(251, bench.clock.now)
