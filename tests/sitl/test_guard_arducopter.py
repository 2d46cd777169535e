# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard in ArduCopter itself: its arming checks, modes, 32-bit Lua and message queue.

Needs an ArduCopter SITL program (`$ARDUCOPTER`, PATH, or ~/ardupilot/build/sitl/bin/arducopter).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from sitl.vehicles import find_arducopter
from tests.sitl.guard_flight import (
    ACCEPTED,
    AUTO,
    DENIED,
    EXPIRED,
    FAILED,
    FORCE,
    GUIDED,
    HELD,
    HURRY,
    LIVE,
    LOITER,
    LOST,
    LOST_STATE,
    RTL,
    WAITING,
    Flight,
    Wire,
    actions_logged,
    flying,
    guard_records,
    records,
    tunnel,
    upload_mission,
)

#: reason of a mode, in the autopilot's log
SCRIPTING = 32

pytestmark = [
    pytest.mark.sitl,
    pytest.mark.skipif(
        find_arducopter() is None,
        reason="no ArduCopter SITL program: set $ARDUCOPTER or build one in ~/ardupilot (waf copter)",
    ),
]


@pytest.fixture
def flight(tmp_path: Path) -> Iterator[Flight]:
    with flying(tmp_path) as flight:
        yield flight


def test_no_lease_no_arming_then_lease_allows_it(flight: Flight) -> None:
    assert flight.status[1] == WAITING
    assert flight.status[8:] == (4, 7)
    flight.run(60)  # everything else has long been ready
    assert flight.set_mode(GUIDED) == ACCEPTED
    assert flight.arm() == FAILED
    flight.until(lambda: flight.said("HNDO: no lease from companion"), 3, "text")

    assert flight.arm(FORCE) == ACCEPTED
    flight.until(lambda: flight.said("HNDO: no lease, disarmed"), 5, "disarm of a forced arming")
    flight.until(lambda: not flight.armed, 5, "disarmed")

    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 5, "lease live")
    assert flight.parameter("MAV_GCS_SYSID") == 251
    flight.until(lambda: flight.arm() == ACCEPTED, 10, "arming with a lease")
    flight.run(0.5)
    flight.sending = False
    flight.until(lambda: flight.said("HNDO: lease lost, disarmed"), 5, "disarm on the ground")
    assert flight.status[2] == 4


def test_lease_lost_in_guided_flight_and_again_in_auto(flight: Flight, tmp_path: Path) -> None:
    upload_mission(flight)
    flight.take_off()
    flight.real_time()
    assert flight.status[4:7][0] == 0xF00DCAFE
    flight.sending = False
    lost_ms = flight.last_lease_ms
    flight.statuses.clear()
    acted_ms = flight.until(lambda: flight.is_state(EXPIRED) and flight.status[2] == 1, 5, "guard acts")
    assert 2800 <= acted_ms - lost_ms <= 4000  # statuses come twice a second, and the machine may be busy
    flight.until(lambda: flight.mode == RTL, 2, "RTL")
    flight.until(lambda: flight.said("HNDO: lease lost, RTL"), 3, "text")

    # a station wired straight to the autopilot cannot leave RTL
    flight.statuses.clear()
    assert flight.set_mode(LOITER) == ACCEPTED
    flight.until(lambda: flight.said("mode change undone"), 2, "undone")
    flight.run(1.5)
    assert flight.mode == RTL

    # authority back: stays in RTL until somebody commands
    flight.sending = True
    flight.until(lambda: flight.said("HNDO: authority back, staying in RTL"), 3, "back")
    flight.run(3)
    assert flight.mode == RTL
    assert flight.set_mode(GUIDED) == ACCEPTED
    flight.run(3)
    assert flight.mode == GUIDED

    # flies its mission, which needs no station, and the lease is lost again
    assert flight.set_mode(AUTO) == ACCEPTED
    flight.run(3)
    assert flight.mode == AUTO
    flight.texts.clear()
    flight.sending = False
    flight.until(lambda: flight.mode == RTL, 5, "RTL out of AUTO")
    flight.until(lambda: flight.said("HNDO: lease lost, RTL"), 3, "text")
    flight.run(2)
    flight.close()

    # by the autopilot's own clock, from the last lease to the mode: the time-out, and 0.2 s at most
    logged = actions_logged(tmp_path)
    assert [state for state, _, _ in logged] == [EXPIRED, EXPIRED]
    assert all(3000 <= age_ms <= 3200 for _, age_ms, _ in logged), logged


def test_authority_lost_in_auto_then_landing_and_no_further_arming(flight: Flight, tmp_path: Path) -> None:
    upload_mission(flight)
    flight.arm_with_lease()
    assert flight.command(300, 0, 0) == ACCEPTED
    flight.until(lambda: flight.mode == AUTO and flight.altitude_m > 15, 60, "mission under way")
    flight.real_time()

    flight.lease["state"], flight.lease["commander"] = LOST, 0
    lost_ms = flight.until(lambda: flight.is_state(LOST_STATE), 2, "LOST")
    acted_ms = flight.until(lambda: flight.status[2] == 1, 5, "guard acts")
    assert 2800 <= acted_ms - lost_ms <= 4000  # statuses come twice a second, and the machine may be busy
    flight.until(lambda: flight.mode == RTL, 2, "RTL")
    flight.until(lambda: flight.said("HNDO: no authority, RTL"), 3, "text")

    flight.pace(HURRY)
    flight.until(lambda: not flight.armed, 200, "landed and disarmed")
    assert flight.mode == RTL, flight.texts[-12:]
    assert flight.arm() == FAILED
    flight.until(lambda: flight.said("HNDO: no station has authority"), 3, "text")
    flight.close()

    told = []
    for record in guard_records(tmp_path):
        if not told or told[-1] != (record.St, record.Ac, record.Cmd, record.Fl & 0b110):
            told.append((record.St, record.Ac, record.Cmd, record.Fl & 0b110))
    told = [entry for entry in told if entry != (4, 1, 0, 2)]  # landed, motors still on: may be too short to see
    # state, action, commander, armed and flying: ready, armed, airborne, nobody commands, RTL, disarmed
    story = [(2, 0, 251, 0), (2, 0, 251, 2), (2, 0, 251, 6), (4, 0, 0, 6), (4, 1, 0, 6), (4, 1, 0, 0)]
    assert told in (story, story[:-1])  # the last record may still be on its way to the file
    # HNDO_LOST_T by the autopilot's own clock, while the leases that say so go on
    ((state, age_ms, lasted_ms),) = actions_logged(tmp_path)
    assert (state, age_ms < 1000) == (LOST_STATE, True)
    assert 2900 <= lasted_ms <= 3200
    modes = [(record.Mode, record.Rsn) for record in records(tmp_path, "MODE")]
    assert (RTL, SCRIPTING) in modes


def test_forged_leases_do_not_keep_it_alive(flight: Flight) -> None:
    flight.take_off()
    flight.real_time()
    recorded = flight.send_lease()
    flight.sending = False
    lost_ms = flight.last_lease_ms
    forger = Wire(flight.vehicle.address(0), 1, 191)
    try:
        rejected = flight.status[7]
        sequence = flight.sequence
        while flight.now_ms < lost_ms + 4000 and flight.mode != RTL:
            sequence += 1
            payload = struct.pack("<BBBBIIIHH", 1, HELD, 251, 0, 0xF00DCAFE, sequence & 0xFFFFFFFF, 1, 5000, 0)
            forger.send(tunnel(payload))  # right in everything but the wire it comes in on
            corrupted = bytearray(tunnel(payload).pack(flight.companion.mav))
            corrupted[-1] ^= 0xFF
            flight.companion.send_raw(bytes(corrupted))  # a known message with a wrong CRC reaches scripts
            flight.companion.send_raw(recorded)
            for _ in range(20):
                flight.pump()
        flight.until(lambda: flight.mode == RTL, 2, "RTL")
        assert flight.status[7] >= rejected + 15
    finally:
        forger.socket.close()


def test_guard_cannot_be_stopped_by_command_and_leaves_no_authorisation(flight: Flight) -> None:
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    assert flight.command(42701, 2) == DENIED  # STOP
    flight.until(lambda: flight.said("HNDO: scripting command of 251/190 denied"), 3, "text")
    flight.statuses.clear()
    flight.run(3)
    assert len(flight.statuses) >= 4
    assert flight.status[3] & 8

    # SCR_ENABLE 0 does stop it: what it allowed once must not stay allowed
    flight.arm_with_lease()
    flight.set_parameter("SCR_ENABLE", 0)
    flight.until(lambda: flight.said("Scripting: stopped"), 5, "scripting stops")
    flight.until(lambda: flight.command(400, 0) == ACCEPTED and not flight.armed, 20, "disarmed")
    assert flight.arm() == FAILED
    flight.until(lambda: flight.said("HNDO: guard stopped while armed"), 3, "text")


def test_gcs_id_and_epoch_follow_the_commander(flight: Flight) -> None:
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    flight.until(lambda: flight.sequence < 100 and flight.status[5] < 100, 20, "sequence wraps")
    assert flight.status[7] == 0
    flight.lease["commander"], flight.lease["epoch"] = 252, 2
    flight.until(lambda: flight.said("HNDO: lease live, 252 commands"), 3, "new commander")
    assert flight.parameter("MAV_GCS_SYSID") == 252
    flight.lease["nonce"], flight.lease["epoch"], flight.sequence = 0xFFFFFFFF, 0x80000001, 5
    flight.until(lambda: flight.status[4] == 0xFFFFFFFF, 3, "restarted companion, epoch beyond the sign bit")
    assert flight.status[6] == 0x80000001
    flight.lease["nonce"], flight.lease["epoch"] = 7, 0x80000000
    flight.run(2)
    assert flight.status[4] == 0xFFFFFFFF


def test_recommended_parameters_are_taken(flight: Flight) -> None:
    wanted = {"RALLY_LIMIT_KM": 0, "FS_GCS_ENABLE": 1, "FS_GCS_TIMEOUT": 10, "FS_OPTIONS": 8, "SCR_ENABLE": 1}
    assert {name: flight.parameter(name) for name in wanted} == wanted
    defaults = {"HNDO_ENABLE": 1, "HNDO_TIMEOUT": 3, "HNDO_LOST_T": 3, "HNDO_ACTION": 1, "HNDO_CHAN": 1}
    defaults |= {"HNDO_COMPID": 191, "HNDO_SYSID_SW": 1}
    assert {name: flight.parameter(name) for name in defaults} == defaults
