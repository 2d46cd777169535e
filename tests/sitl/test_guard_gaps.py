# SPDX-License-Identifier: GPL-3.0-or-later

"""A gap that the mission declares: crossed alone past the time of the GCS failsafe, and never longer than allowed."""

from __future__ import annotations

from tests.sitl.guard_cases import (
    Case,
    Outcome,
    came_home,
    chosen,
    flights,
    guard_did_nothing,
    in_auto,
    landed_at_home,
    said,
    stays,
)
from tests.sitl.guard_flight import (
    ACCEPTED,
    ALONE,
    AUTO,
    FAILED,
    HELD,
    LIVE,
    LOST_STATE,
    RTL,
    Flight,
    upload_mission,
)
from tests.sitl.guard_log import GCS, actions_logged, guard_records, records


def on_the_way(flight: Flight, most_s: float) -> None:
    """In AUTO, on a leg of two kilometres."""
    upload_mission(flight)
    flight.set_parameter("HNDO_ALONE_MAX", most_s)
    in_auto(flight)


def into_the_gap(flight: Flight, left_s: int) -> None:
    """The commander cannot be heard any more, and the companion says so."""
    flight.watch_the_station()
    flight.beating.clear()
    flight.lease.update(state=ALONE, commander=0, left_s=left_s)
    said(flight, "HNDO: lease live, nobody commands")


def crossed(flight: Flight) -> Outcome:
    """The far station takes the aircraft; the near one was last heard 40 s ago."""
    on_the_way(flight, 60)
    assert flight.parameter(flight.firmware.gcs_id) == 251
    into_the_gap(flight, 55)
    stays(flight, AUTO, 40)
    assert flight.is_state(LIVE)
    assert flight.parameter(flight.firmware.gcs_id) == 1
    flight.beating = {252}
    flight.lease.update(state=HELD, commander=252, epoch=2, left_s=0)
    said(flight, "HNDO: lease live, 252 commands")
    assert flight.parameter(flight.firmware.gcs_id) == 252
    stays(flight, AUTO, 15)
    assert not flight.said("GCS Failsafe")
    guard_did_nothing(flight)
    return f"AUTO for 40 s, {flight.firmware.gcs_id} 1, then 252 commands"


def companion_dies_in_it(flight: Flight) -> Outcome:
    on_the_way(flight, 60)
    into_the_gap(flight, 55)
    stays(flight, AUTO, 15)
    flight.companion_beats = False
    flight.cut()
    return came_home(flight)


def companion_and_guard_die_in_it(flight: Flight) -> Outcome:
    """What is left is the autopilot's own failsafe, which has watched the companion since the gap began."""
    on_the_way(flight, 60)
    into_the_gap(flight, 55)
    stays(flight, AUTO, 15)
    flight.set_parameter("SCR_ENABLE", 0)
    flight.companion_beats = flight.sending = False
    silent_ms = flight.now_ms
    acted_ms = flight.until(lambda: flight.mode == RTL, 15, "GCS failsafe")
    assert 8_000 <= acted_ms - silent_ms <= 12_000
    landing = landed_at_home(flight)
    guard_did_nothing(flight)
    assert [entry[:2] for entry in chosen(flight)][-1] == (RTL, GCS)
    return f"GCS failsafe RTL +{(acted_ms - silent_ms) / 1000:.0f} s; {landing}"


def over_after_ten_seconds(flight: Flight, most_s: float, left_s: int) -> Outcome:
    """Leases that say so go on and on; behind the limit they count like LOST, and HNDO_LOST_T later it goes home."""
    on_the_way(flight, most_s)
    into_the_gap(flight, left_s)
    flight.until(lambda: flight.is_state(LOST_STATE), 14, "the limit")
    flight.lease["left_s"] = 60
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    said(flight, "HNDO: no authority, RTL")
    landing = landed_at_home(flight)
    assert flight.arm() == FAILED
    flight.close()
    begun = next(text for text in records(flight.directory, "MSG") if "nobody commands" in text.Message)
    over = next(record for record in guard_records(flight.directory) if record.St == LOST_STATE)
    alone_s = (over.TimeUS - begun.TimeUS) / 1e6
    assert 9.8 <= alone_s <= 10.2, alone_s
    ((state, _age_ms, lasted_ms),) = actions_logged(flight.directory)
    assert state == LOST_STATE
    assert 2900 <= lasted_ms <= 3300, lasted_ms  # with the step of a busy machine in which the limit passes
    return f"alone for {alone_s:.1f} s, RTL +{lasted_ms / 1000:.1f} s; {landing}"


def its_own_limit(flight: Flight) -> Outcome:
    return over_after_ten_seconds(flight, 60, 10)


def the_guards_limit(flight: Flight) -> Outcome:
    return over_after_ten_seconds(flight, 10, 600)


def no_take_off(flight: Flight) -> Outcome:
    """It could be armed, and from the first such lease on it cannot."""
    flight.set_parameter("HNDO_ALONE_MAX", 60)
    flight.arm_with_lease()
    assert flight.command(400, 0) == ACCEPTED
    flight.lease.update(state=ALONE, commander=0, left_s=60)
    flight.until(lambda: flight.is_state(LOST_STATE), 3, "no authority on the ground")
    assert flight.arm() == FAILED
    said(flight, "HNDO: no station has authority")
    return "arming refused"


CASES = (
    Case("gap crossed alone", crossed),
    Case("companion dies in a gap", companion_dies_in_it),
    Case("companion dead and SCR_ENABLE 0 in a gap", companion_and_guard_die_in_it),
    Case("gap of 10 s, HNDO_ALONE_MAX 60", its_own_limit),
    Case("gap of 600 s, HNDO_ALONE_MAX 10", the_guards_limit),
    Case("arming while it says ALONE", no_take_off),
)
test_gaps = flights(CASES)
