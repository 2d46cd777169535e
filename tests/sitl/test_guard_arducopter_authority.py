# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard in ArduCopter while authority moves, is contested, or a pilot takes the aircraft.

Needs an ArduCopter SITL program (`$ARDUCOPTER`, PATH, or ~/ardupilot/build/sitl/bin/arducopter).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as dialect

from mavproxy_handover.core.model import LeaseState
from mavproxy_handover.wire.lease import Lease, pack_lease
from sitl.vehicles import find_arducopter
from tests.sitl.guard_flight import (
    ACCEPTED,
    EXPIRED,
    FAILED,
    GUARD,
    GUIDED,
    HELD,
    HOME,
    HURRY,
    LIVE,
    LOITER,
    LOST,
    RTL,
    Flight,
    Transmitter,
    Wire,
    actions_logged,
    flying,
    tunnel,
    upload,
)

pytestmark = [
    pytest.mark.sitl,
    pytest.mark.skipif(
        find_arducopter() is None,
        reason="no ArduCopter SITL program: set $ARDUCOPTER or build one in ~/ardupilot (waf copter)",
    ),
]

KEY = bytes(range(32))
RALLY_POINT, SET_HOME = 5100, 179
#: rows of the page's table
_MEMORY = ("while it is loaded", "in flight")
#: 400 m in degrees of latitude, times 1e7
NORTH_400_M = 35_930


@pytest.fixture
def flight(tmp_path: Path) -> Iterator[Flight]:
    with flying(tmp_path) as flight:
        yield flight


def distance_to_target_m(flight: Flight) -> float:
    flight.answers.clear()
    flight.until(lambda: _last(flight, "NAV_CONTROLLER_OUTPUT"), 3, "NAV_CONTROLLER_OUTPUT")
    return float(_last(flight, "NAV_CONTROLLER_OUTPUT").wp_dist)


def _last(flight: Flight, kind: str) -> Any:
    return next((m for m in reversed(flight.answers) if m.get_type() == kind), None)


def test_lease_lost_in_loiter_goes_to_the_rally_point_and_the_pilot_who_takes_over_is_left_alone(
    flight: Flight, tmp_path: Path
) -> None:
    latitude, longitude = int(HOME[0] * 1e7), int(HOME[1] * 1e7)
    upload(flight, [(RALLY_POINT, latitude + NORTH_400_M, longitude, 30.0)], 2)
    flight.take_off()
    pilot = Transmitter(flight.vehicle)
    try:
        pilot.send(mode_pwm=1800)  # throttle to the middle, the switch stays
        flight.set_parameter("FLTMODE1", LOITER)
        flight.station.send(
            dialect.MAVLink_command_int_message(
                1, 1, 0, SET_HOME, 0, 0, 0, 0, 0, 0, latitude - 2 * NORTH_400_M, longitude, 2.0
            )
        )
        assert flight.set_mode(LOITER) == ACCEPTED
        flight.real_time()
        assert flight.mode == LOITER

        flight.sending = False
        lost_ms = flight.last_lease_ms
        flight.statuses.clear()
        acted_ms = flight.until(lambda: flight.statuses and flight.status[2] == 1, 5, "guard acts")
        assert 2800 <= acted_ms - lost_ms <= 4000
        flight.until(lambda: flight.mode == RTL, 2, "RTL")
        flight.pace(4)
        # home is 800 m away; the rally point at 400 m is beyond the default RALLY_LIMIT_KM of 0.3
        flight.until(lambda: distance_to_target_m(flight) > 100, 30, "climb first, then a target")
        assert 350 <= distance_to_target_m(flight) <= 410

        pilot.send(mode_pwm=1165)
        flight.until(lambda: flight.mode == LOITER, 3, "the pilot's switch")
        flight.until(lambda: flight.said("HNDO: lease lost, pilot flies"), 3, "text")
        flight.run(10)
        assert flight.mode == LOITER
        assert not flight.status[3] & 1  # it stands back

        # a station is not the pilot
        assert flight.set_mode(GUIDED) == ACCEPTED
        flight.until(lambda: flight.said("HNDO: no authority, mode change undone"), 3, "undone")
        flight.until(lambda: flight.mode == RTL, 3, "RTL")
    finally:
        pilot.close()
    flight.close()
    state, age_ms, _ = actions_logged(tmp_path)[0]
    assert state == EXPIRED
    assert 3000 <= age_ms <= 3200  # the autopilot's clock


def test_the_autopilots_own_failsafe_watches_the_new_commander_and_a_restarted_companion_goes_on(
    flight: Flight,
) -> None:
    flight.take_off()
    assert flight.parameter("MAV_GCS_SYSID") == 251
    flight.beating = {251, 252}
    flight.run(2)
    flight.lease["commander"], flight.lease["epoch"] = 252, 2
    flight.until(lambda: flight.said("HNDO: lease live, 252 commands"), 3, "new commander")
    assert flight.parameter("MAV_GCS_SYSID") == 252

    # the companion dies and is back within the time-out: another nonce, the next epoch, the same commander
    flight.pace(4)
    recorded = flight.send_lease()
    flight.sending = False
    flight.run(2)
    flight.restart_companion(0xBEEF)
    flight.sending = True
    flight.until(lambda: flight.status[4] == 0xBEEF and flight.is_state(LIVE), 3, "restarted companion")
    assert flight.status[6] == 3
    rejected = flight.status[7]
    flight.companion.send_raw(recorded)
    flight.until(lambda: flight.status[7] == rejected + 1, 3, "a lease of the run before")
    assert flight.mode == GUIDED

    # the station that no longer commands may fall silent
    flight.beating = {252}
    flight.run(15)
    assert flight.mode == GUIDED
    # the one that commands may not, and the lease goes on: the second line of defence acts alone
    flight.beating = {251}
    silent_ms = flight.now_ms
    acted_ms = flight.until(lambda: flight.mode == RTL, 15, "GCS failsafe")
    assert 9_000 <= acted_ms - silent_ms <= 13_000
    assert flight.said("GCS Failsafe")
    assert flight.is_state(LIVE)
    assert not flight.said("HNDO: lease lost")


def test_leases_from_another_wire_change_nothing_while_real_ones_flow(flight: Flight) -> None:
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    forger = Wire(flight.vehicle.address(0), 1, 191)
    try:
        before = flight.status
        flight.statuses.clear()
        for number in range(60):
            state, commander = ((HELD, 252), (LOST, 0))[number % 2]
            payload = struct.pack("<BBBBIIIHH", 1, state, commander, 0, 0x666, number + 1, 1000 + number, 5000, 0)
            forger.send(tunnel(payload))
            flight.run(0.1)
    finally:
        forger.socket.close()
    assert {status[1] for status in flight.statuses} == {LIVE}
    assert {(status[4], status[6]) for status in flight.statuses} == {(0xF00DCAFE, 1)}
    assert flight.status[7] >= before[7] + 45
    assert flight.status[5] != before[5]
    flight.until(lambda: flight.said("HNDO: strange lease refused, channel 0 not 1"), 3, "text")
    assert flight.parameter("MAV_GCS_SYSID") == 251


def test_damaged_leases_on_the_companions_own_wire_change_nothing_while_real_ones_flow(flight: Flight) -> None:
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    recorded = flight.send_lease()

    def forged(**changes: int) -> Any:
        """A lease that would be the next one, of another commander, with one thing wrong."""
        value = {"version": 1, "state": HELD, "nonce": 0xF00DCAFE, "length": 20, "target": 1, **changes}
        sequence = (flight.sequence + 1) & 0xFFFFFFFF
        fields = (value["version"], value["state"], 252, 0, value["nonce"], sequence, 1, 5000, 0)
        message = tunnel(struct.pack("<BBBBIIIHH", *fields))
        message.payload_length, message.target_component = value["length"], value["target"]
        return message

    damaged = {
        "replayed": lambda: recorded,
        "truncated": lambda: forged(length=19).pack(flight.companion.mav),
        "too long": lambda: forged(length=21).pack(flight.companion.mav),
        "corrupted": lambda: _corrupted(forged().pack(flight.companion.mav)),
        "of another version": lambda: forged(version=2).pack(flight.companion.mav),
        "of no state": lambda: forged(state=9).pack(flight.companion.mav),
        "for another component": lambda: forged(target=0).pack(flight.companion.mav),
        "of another nonce": lambda: forged(nonce=0x666).pack(flight.companion.mav),
        "of no nonce": lambda: forged(nonce=0).pack(flight.companion.mav),
    }
    flight.statuses.clear()
    for name, frame in damaged.items():
        flight.until(lambda: bool(flight.statuses), 3, "status")
        before = flight.status[7]
        flight.companion.send_raw(bytes(frame()))
        flight.until(lambda before=before: flight.status[7] == before + 1, 3, f"a lease {name} is counted as refused")
    # cut off in the middle: the parser takes what follows for the rest of it, and the real ones go on
    sequence = flight.status[5]
    flight.companion.send_raw(bytes(forged().pack(flight.companion.mav))[:20])
    flight.until(lambda: flight.status[5] not in (sequence, sequence + 1), 5, "real leases go on")
    assert {status[1] for status in flight.statuses} == {LIVE}
    assert {(status[4], status[6]) for status in flight.statuses} == {(0xF00DCAFE, 1)}
    assert flight.parameter("MAV_GCS_SYSID") == 251


def _corrupted(frame: bytes | bytearray) -> bytes:
    return bytes(frame[:-1]) + bytes([frame[-1] ^ 0x01])


def test_another_script_that_takes_the_receive_queue_is_noticed_and_the_flight_goes_on(tmp_path: Path) -> None:
    neighbour = tmp_path / "neighbour.lua"
    neighbour.write_text(
        "local function update()\n"
        "  if param:get('SCR_USER1') == 1 then mavlink:init(1, 1) param:set('SCR_USER1', 0) end\n"
        "  if param:get('SCR_USER1') == 2 then\n"
        "    mavlink:init(1, 1) mavlink:register_rx_msgid(33) param:set('SCR_USER1', 0)\n"
        "  end\n"
        "  return update, 100\n"
        "end\n"
        "return update, 100\n"
    )
    with flying(tmp_path / "flight", neighbour) as flight:
        flight.take_off()
        flight.pace(2)
        for number, text in ((1, "HNDO: MAVLink rx was reset by a script"), (2, "HNDO: MAVLink rx taken by another")):
            flight.run(11)  # a text of a kind is said once in ten seconds
            flight.texts.clear()
            flight.set_parameter("SCR_USER1", number)
            flight.until(lambda text=text: flight.said(text), 4, text)
            sequence = flight.status[5]
            flight.until(lambda sequence=sequence: flight.status[5] != sequence, 3, "leases are heard again")
            assert flight.status[3] & 8
        flight.run(5)
        assert flight.mode == GUIDED
        assert flight.is_state(LIVE)


def test_memory_of_the_script_is_what_its_page_says(tmp_path: Path) -> None:
    page = GUARD.with_suffix(".md").read_text(encoding="utf-8")
    rows = [re.search(rf"^\| script memory {what} \| (\d+) kB", page, re.MULTILINE) for what in _MEMORY]
    loading, flying_on = (1000 * int(row[1]) for row in rows if row is not None)
    # no more memory than the page says it takes: it loads and runs
    with flying(tmp_path, parameters={"SCR_DEBUG_OPTS": 2, "SCR_HEAP_SIZE": loading}) as flight:
        flight.sending = True
        flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
        flight.run(20)
        assert flight.parameter("SCR_HEAP_SIZE") == loading
        found = [re.fullmatch(r"Lua: Time: \d+ Mem: (\d+) \+ -?\d+", text) for text in flight.texts]
        used = [int(match[1]) for match in found if match]
    assert len(used) > 50
    assert 0.9 * flying_on < max(used[5:]) <= flying_on
    assert max(used) <= loading <= 204_800


def test_with_a_key_on_the_card_only_leases_with_the_right_tag_count(tmp_path: Path) -> None:
    key_file = tmp_path / "handover.key"
    key_file.write_text(KEY.hex() + "\n")
    with flying(tmp_path / "flight", key_file) as flight:

        def lease(key: bytes | None, vehicle: int = 1) -> Any:
            flight.sequence = (flight.sequence + 1) & 0xFFFFFFFF
            value = Lease(LeaseState.HELD, 251, 0xF00DCAFE, flight.sequence, 1, 5000)
            message = pack_lease(value, vehicle, key)
            message.target_system = 1
            return message

        def refused(message: Any, why: str) -> None:
            before = flight.status[7]
            flight.companion.send(message)
            flight.until(lambda: flight.status[7] == before + 1, 3, why)
            assert not flight.is_state(LIVE)

        flight.pace(HURRY)
        flight.run(45)
        assert flight.set_mode(GUIDED) == ACCEPTED
        refused(lease(None), "no tag")
        flight.until(lambda: flight.said("HNDO: lease refused, no tag"), 3, "text")
        assert flight.arm() == FAILED
        flight.until(lambda: flight.said("HNDO: lease refused, no tag"), 3, "text")
        refused(lease(bytes(32)), "another key")
        refused(lease(KEY, vehicle=2), "another vehicle's tag")
        spoilt = lease(KEY)
        spoilt.payload[2] = 252  # another commander
        refused(spoilt, "another content")

        flight.companion.send(lease(KEY))
        flight.until(lambda: flight.is_state(LIVE), 3, "the right tag")
        assert flight.status[5] == flight.sequence
        flight.companion.send(lease(KEY))
        assert flight.arm() == ACCEPTED
