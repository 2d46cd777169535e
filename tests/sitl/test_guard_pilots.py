# SPDX-License-Identifier: GPL-3.0-or-later

"""Pilots: one with a live transmitter keeps or takes the aircraft, a dead or feigned transmitter is none."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import all as dialect

from tests.sitl.guard_cases import (
    AT_HOME_M,
    SWITCH_LOITER,
    SWITCH_SECOND,
    WITH_RADIO,
    Case,
    Outcome,
    Pilot,
    came_home,
    chosen,
    companion_dies,
    cut,
    ended_by_gcs_failsafe,
    flights,
    guard_delay_s,
    guard_did_nothing,
    in_guided,
    landed_at_home,
    lose_radio,
    loss,
    piloted,
    said,
    stays,
)
from tests.sitl.guard_flight import (
    ACCEPTED,
    AUTOTUNE,
    GUIDED,
    HOME,
    LOITER,
    RALLY_POINT,
    RTL,
    Flight,
    item,
    position,
    upload,
)
from tests.sitl.guard_log import ESCAPE, RADIO, SCRIPTING

#: base file: FS_THR_ENABLE 0, so the autopilot believes any transmitter for ever
WITHOUT_RADIO = {"FS_THR_ENABLE": 0, "FLTMODE1": LOITER}
HIGH_THROTTLE = 1900
SET_HOME, AUX_FUNCTION, AUX_LOITER, SWITCH_HIGH = 179, 218, 56, 2


def steered_by_hand(mode: int = LOITER) -> Callable[[Flight], Pilot]:
    """The pilot has taken it by the switch, by way of LOITER."""

    def fly(flight: Flight) -> Pilot:
        pilot = piloted(flight)
        pilot.takes()
        flight.run(2)
        if mode != LOITER:
            pilot.takes(mode, SWITCH_SECOND)
        return pilot

    return fly


def stands_back(mode: int) -> Callable[[Flight], Outcome]:
    def seen(flight: Flight) -> Outcome:
        stays(flight, mode, 25)
        said(flight, "HNDO: lease lost, pilot flies")
        assert not flight.status[3] & 1, flight.status
        guard_did_nothing(flight)
        return "stands back, 25 s and on"

    return seen


def stood_back_until_the_radio_died(flight: Flight) -> Outcome:
    stays(flight, LOITER, 8)
    said(flight, "HNDO: lease lost, pilot flies")
    lose_radio(flight)
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    landing = landed_at_home(flight)
    modes = chosen(flight)
    assert (RTL, RADIO) in [entry[:2] for entry in modes] or (RTL, SCRIPTING) in [entry[:2] for entry in modes], modes
    return f"stands back, RTL when the radio dies; {landing}"


def feigned_by_override(flight: Flight) -> None:
    """The commander's station moves the flight mode switch."""
    in_guided(flight)
    sticks = [1500, 1500, 1500, 1500, SWITCH_LOITER]
    flight.beside = lambda: flight.station.send(dialect.MAVLink_rc_channels_override_message(1, 1, *sticks, *[0] * 13))
    flight.until(lambda: flight.mode == LOITER, 5, "LOITER by override")
    flight.run(2)


def feigned_by_function(flight: Flight) -> None:
    """The commander's station moves a switch function."""
    pilot = piloted(flight)
    assert flight.command(AUX_FUNCTION, AUX_LOITER, SWITCH_HIGH) == ACCEPTED
    flight.until(lambda: flight.mode == LOITER, 3, "LOITER by function")
    pilot.hold()
    flight.run(2)


def with_dead_radio(flight: Flight) -> None:
    """The pilot chose LOITER, then the transmitter died and no failsafe was there to notice."""
    steered_by_hand()(flight)
    lose_radio(flight)
    flight.run(3)


# ---- taking over after the guard -----------------------------------------------------------------------------------


def rally_point_north(flight: Flight) -> None:
    """LOITER by the station; home is put 1200 m to the south of the rally point, which is 400 m to the north."""
    upload(flight, [item(RALLY_POINT, 400, 30)], 2)
    piloted(flight)
    flight.station.send(
        dialect.MAVLink_command_int_message(1, 1, 0, SET_HOME, 0, 0, 0, 0, 0, 0, *position(-800), HOME[2])
    )
    assert flight.set_mode(LOITER) == ACCEPTED
    flight.run(2)
    assert flight.mode == LOITER


def pilot_takes_over(flight: Flight) -> Outcome:
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.until(lambda: flight.home_m > 60, 60, "on its way to the rally point")
    to_m = _to_target_m(flight)
    assert 250 <= to_m <= 410, f"{to_m:.0f} m to go"
    flight.pilot.takes()
    said(flight, "HNDO: lease lost, pilot flies")
    stays(flight, LOITER, 10)
    assert not flight.status[3] & 1  # it stands back

    # a station is not the pilot
    assert flight.set_mode(GUIDED) == ACCEPTED
    said(flight, "undone")
    flight.until(lambda: flight.mode == RTL, 3, "RTL")
    return f"RTL +{guard_delay_s(flight):.1f} s to the rally point, pilot's LOITER left, a station's GUIDED undone"


def _to_target_m(flight: Flight) -> float:
    flight.answers.clear()
    found = []

    def told() -> bool:
        found.extend(m.wp_dist for m in flight.answers if m.get_type() == "NAV_CONTROLLER_OUTPUT")
        return bool(found)

    flight.until(told, 3, "NAV_CONTROLLER_OUTPUT")
    return float(found[-1])


def throttle_escape(flight: Flight) -> Outcome:
    """The guard's RTL comes down; the pilot pushes the throttle up (PILOT_THR_BHV, high throttle cancels landing)."""
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.until(lambda: flight.altitude_m < 9 and flight.home_m < AT_HOME_M, 90, "last descent")
    flight.pilot.hold(throttle_pwm=HIGH_THROTTLE)
    flight.until(lambda: flight.mode == LOITER, 5, "throttle escape")
    flight.pilot.hold()
    stays(flight, LOITER, 12)
    assert not flight.status[3] & 1, flight.status
    delay_s = guard_delay_s(flight)
    modes = [entry[:2] for entry in chosen(flight)]
    assert modes[-1] == (LOITER, ESCAPE), modes
    return f"RTL +{delay_s:.1f} s, the pilot's escape to LOITER left"


CASES = (
    Case("pilot in LOITER", loss(steered_by_hand(), cut, stands_back(LOITER)), WITH_RADIO),
    Case(
        "pilot in LOITER, companion dead",
        loss(steered_by_hand(), companion_dies, ended_by_gcs_failsafe(LOITER, "stands back")),
        WITH_RADIO,
    ),
    Case(
        "pilot in LOITER, companion dead, FS_OPTIONS 24",
        loss(steered_by_hand(), companion_dies, stands_back(LOITER)),
        {**WITH_RADIO, "FS_OPTIONS": 24},
    ),
    Case(
        "pilot in AUTOTUNE",
        loss(steered_by_hand(AUTOTUNE), cut, stands_back(AUTOTUNE)),
        {**WITH_RADIO, "FLTMODE2": AUTOTUNE},
    ),
    Case(
        "pilot in LOITER, transmitter lost after the loss",
        loss(steered_by_hand(), cut, stood_back_until_the_radio_died),
        WITH_RADIO,
    ),
    Case("pilot in LOITER, FS_THR_ENABLE 0", loss(steered_by_hand(), cut, came_home), WITHOUT_RADIO),
    Case("transmitter dead in LOITER, FS_THR_ENABLE 0", loss(with_dead_radio, cut, came_home), WITHOUT_RADIO),
    Case("LOITER by the commander's RC override, no radio", loss(feigned_by_override, cut, came_home), WITHOUT_RADIO),
    Case(
        "LOITER by the commander's DO_AUX_FUNCTION, no radio", loss(feigned_by_function, cut, came_home), WITHOUT_RADIO
    ),
    Case("LOITER by a station; then the pilot takes over", loss(rally_point_north, cut, pilot_takes_over), WITH_RADIO),
    Case("throttle escape of the pilot", loss(piloted, cut, throttle_escape), {**WITH_RADIO, "PILOT_THR_BHV": 2}),
)
test_pilots = flights(CASES)
