# SPDX-License-Identifier: GPL-3.0-or-later

"""Authority that moves, ends by word, comes back or is taken up again; the second line of defence; the key."""

from __future__ import annotations

import re
import time
from typing import Any

from mavproxy_handover.core.common.model import LeaseState
from mavproxy_handover.wire.lease import Lease, pack_lease
from tests.sitl.guard_cases import (
    LATEST_S,
    Case,
    Outcome,
    flights,
    in_auto,
    in_guided,
    landed_at_home,
    said,
    stays,
)
from tests.sitl.guard_flight import (
    ACCEPTED,
    AUTO,
    EXPIRED,
    FAILED,
    GCS_TIMEOUT_S,
    GUARD,
    GUIDED,
    HURRY,
    LIVE,
    LOITER,
    LOST,
    LOST_STATE,
    PARAMETERS,
    RTL,
    Flight,
    upload_mission,
)
from tests.sitl.guard_log import SCRIPTING, actions_logged, guard_records, records

KEY = bytes(range(32))
#: rows of the page's table
_MEMORY = ("while it is loaded", "in flight")


def lost_and_back_and_lost_again(flight: Flight) -> Outcome:
    upload_mission(flight)
    in_guided(flight)
    assert flight.status[4] == 0xF00DCAFE
    flight.cut()
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    said(flight, "HNDO: lease lost, RTL")
    # a station wired straight to the autopilot cannot leave RTL
    assert flight.set_mode(LOITER) == ACCEPTED
    said(flight, "undone")
    flight.run(1.5)
    assert flight.mode == RTL

    # authority back: stays in RTL until somebody commands
    flight.sending = True
    said(flight, "HNDO: authority back, staying in RTL")
    flight.pace(4)
    stays(flight, RTL, 3)
    assert flight.set_mode(GUIDED) == ACCEPTED
    flight.until(lambda: flight.mode == GUIDED, 3, "the commander's GUIDED")
    stays(flight, GUIDED, 3)

    # flies its mission, which needs no station, and the lease is lost again
    assert flight.set_mode(AUTO) == ACCEPTED
    flight.until(lambda: flight.mode == AUTO, 3, "AUTO")
    flight.run(3)
    assert flight.mode == AUTO
    flight.texts.clear()
    flight.cut()
    flight.until(lambda: flight.mode == RTL, 6, "RTL out of AUTO")
    said(flight, "HNDO: lease lost, RTL")
    flight.run(2)
    flight.close()
    logged = actions_logged(flight.directory)
    assert [state for state, _, _ in logged] == [EXPIRED, EXPIRED], logged
    delays_s = [age_ms / 1000 for _, age_ms, _ in logged]
    assert all(3.0 <= delay_s <= LATEST_S for delay_s in delays_s), logged
    return f"RTL +{delays_s[0]:.1f} s, stays there when it is back; RTL +{delays_s[1]:.1f} s out of AUTO"


def nobody_commands(flight: Flight) -> Outcome:
    upload_mission(flight)
    in_auto(flight)
    flight.set_parameter("HNDO_TIMEOUT", 3)
    flight.pace(2)
    flight.lease["state"], flight.lease["commander"] = LOST, 0
    flight.until(lambda: flight.is_state(LOST_STATE), 2, "LOST")
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    said(flight, "HNDO: no authority, RTL")

    flight.pace(HURRY)
    flight.until(lambda: flight.altitude_m < 8, 300, "the descent")
    time.sleep(1.2 * GCS_TIMEOUT_S / HURRY)  # this computer has something else to do
    landing = landed_at_home(flight)
    assert flight.mode == RTL, flight.texts[-12:]
    assert flight.arm() == FAILED
    said(flight, "HNDO: no station has authority")
    flight.close()

    told = []
    for record in guard_records(flight.directory):
        if not told or told[-1] != (record.St, record.Ac, record.Cmd, record.Fl & 0b110):
            told.append((record.St, record.Ac, record.Cmd, record.Fl & 0b110))
    told = [entry for entry in told if entry != (4, 1, 0, 2)]  # landed, motors still on: may be too short to see
    # state, action, commander, armed and flying: ready, armed, airborne, nobody commands, RTL, disarmed
    story = [(2, 0, 251, 0), (2, 0, 251, 2), (2, 0, 251, 6), (4, 0, 0, 6), (4, 1, 0, 6), (4, 1, 0, 0)]
    assert told in (story, story[:-1]), told  # the last record may still be on its way to the file
    # HNDO_LOST_T by the autopilot's own clock, while the leases that say so go on
    ((state, age_ms, lasted_ms),) = actions_logged(flight.directory)
    assert (state, age_ms < 1000) == (LOST_STATE, True), (state, age_ms)
    assert 2900 <= lasted_ms <= 3200, lasted_ms
    assert (RTL, SCRIPTING) in [(record.Mode, record.Rsn) for record in records(flight.directory, "MODE")]
    return f"RTL +{lasted_ms / 1000:.1f} s, {landing}; no arming"


def follows_the_commander(flight: Flight) -> Outcome:
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    flight.until(lambda: flight.sequence < 100 and flight.status[5] < 100, 20, "sequence wraps")
    assert flight.status[7] == 0
    flight.lease["commander"], flight.lease["epoch"] = 252, 2
    said(flight, "HNDO: lease live, 252 commands")
    assert flight.parameter(flight.firmware.gcs_id) == 252
    flight.lease["nonce"], flight.lease["epoch"], flight.sequence = 0xFFFFFFFF, 0x80000001, 5
    flight.until(lambda: flight.status[4] == 0xFFFFFFFF, 3, "restarted companion, epoch beyond the sign bit")
    assert flight.status[6] == 0x80000001
    flight.lease["nonce"], flight.lease["epoch"] = 7, 0x80000000
    flight.run(2)
    assert flight.status[4] == 0xFFFFFFFF, "an older epoch was taken"
    return f"{flight.firmware.gcs_id} follows, an older epoch is refused"


def second_line(flight: Flight) -> Outcome:
    """Another commander, a companion that restarts; at last the commander falls silent while the lease goes on."""
    flight.take_off()
    assert flight.parameter(flight.firmware.gcs_id) == 251
    flight.beating = {251, 252}
    flight.run(2)
    flight.lease["commander"], flight.lease["epoch"] = 252, 2
    said(flight, "HNDO: lease live, 252 commands")
    assert flight.parameter(flight.firmware.gcs_id) == 252

    # the companion dies and is back within the time-out: another nonce, the next epoch, the same commander
    flight.pace(4)
    flight.watch_the_station()
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
    stays(flight, GUIDED, 15)
    # the one that commands may not: the autopilot's failsafe acts alone
    flight.beating = {251}
    silent_ms = flight.now_ms
    # a beat that is on its way on a busy machine counts for up to four seconds of this clock
    acted_ms = flight.until(lambda: flight.mode == RTL, 15, "GCS failsafe")
    assert acted_ms - silent_ms >= 9_000
    assert flight.said("GCS Failsafe")
    assert flight.is_state(LIVE)
    assert not flight.said("HNDO: lease lost")
    return f"restart taken up; GCS failsafe RTL +{(acted_ms - silent_ms) / 1000:.0f} s"


def keyed(flight: Flight) -> Outcome:
    def lease(key: bytes | None, vehicle: int = 1) -> Any:
        flight.sequence = (flight.sequence + 1) & 0xFFFFFFFF
        value = Lease(LeaseState.HELD, 251, 0xF00DCAFE, flight.sequence, 1, 5000, guard_nonce=flight.guard_nonce)
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
    said(flight, "HNDO: lease refused, no tag")
    assert flight.arm() == FAILED
    refused(lease(bytes(32)), "another key")
    refused(lease(KEY, vehicle=2), "another vehicle's tag")
    spoilt = lease(KEY)
    spoilt.payload[2] = 252  # another commander
    refused(spoilt, "another content")

    flight.companion.send(lease(KEY))
    flight.until(lambda: flight.is_state(LIVE), 3, "the right tag")
    assert flight.status[5] == flight.sequence
    for _ in range(20):  # a position takes a while, and each lease lives five seconds
        flight.companion.send(lease(KEY))
        if flight.arm() == ACCEPTED:
            return "only the right tag counts"
    raise AssertionError(f"no arming with the right tag, {flight.texts[-5:]}")


def memory_as_stated(flight: Flight) -> Outcome:
    """Given no more memory than the page says it takes, it loads and runs."""
    _, flying_on = stated_memory()
    flight.sending = True
    flight.until(lambda: flight.is_state(LIVE), 90, "lease live")
    flight.run(20)
    found = [re.fullmatch(r"Lua: Time: \d+ Mem: (\d+) \+ -?\d+", text) for text in flight.texts]
    used = [int(match[1]) for match in found if match]
    assert len(used) > 50
    assert 0.8 * flying_on < max(used[5:]) <= flying_on, f"{max(used[5:])} of {flying_on} B"
    return f"{max(used[5:]) / 1000:.0f} kB"


def stated_memory() -> list[int]:
    """Bytes while it is loaded and in flight, from the guard's page."""
    page = GUARD.with_suffix(".md").read_text(encoding="utf-8")
    rows = [re.search(rf"^\| script memory {what} \| (\d+) kB", page, re.MULTILINE) for what in _MEMORY]
    return [1000 * int(row[1]) for row in rows if row is not None]


def parameters_taken(flight: Flight) -> Outcome:
    """The recommended ones where this firmware has them, and the guard's own defaults."""
    lines = [line.split("#")[0].split() for line in PARAMETERS.read_text(encoding="utf-8").splitlines()]
    wanted = {line[0]: float(line[1]) for line in lines if line}
    found = {name: flight.parameter(name) for name in wanted}
    unknown = {name for name, value in found.items() if value is None}
    assert unknown <= {"ARMING_CHECK", "ARMING_SKIPCHK"}, unknown
    assert {name: value for name, value in found.items() if name not in unknown} == {
        name: value for name, value in wanted.items() if name not in unknown
    }
    defaults = {"HNDO_ENABLE": 1, "HNDO_LOST_T": 3, "HNDO_ACTION": 1, "HNDO_CHAN": 1, "HNDO_COMPID": 191}
    assert {name: flight.parameter(name) for name in defaults} == defaults
    return f"{len(wanted) - len(unknown)} taken"


CASES = (
    Case("lease lost, back, and lost again", lost_and_back_and_lost_again),
    Case("lease says for 3 s that no station commands", nobody_commands),
    Case("GCS id and epoch follow the commander", follows_the_commander),
    Case("companion restarts; the commander falls silent while the lease goes on", second_line),
    Case("leases with a key", keyed, beside={"handover.key": KEY.hex() + "\n"}),
    Case("script memory", memory_as_stated, {"SCR_DEBUG_OPTS": 2, "SCR_HEAP_SIZE": stated_memory()[0]}),
    Case("handover.parm", parameters_taken),
)
test_authority = flights(CASES)
