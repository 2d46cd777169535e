# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's own failsafes before, with and after the loss: one that lands or returns wins, one that only stops
has ten seconds."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import all as dialect

from tests.sitl.guard_cases import (
    WITH_RADIO,
    Case,
    Outcome,
    Pilot,
    chosen,
    cut,
    flights,
    guard_did_nothing,
    in_guided,
    in_mode,
    landed,
    landed_at_home,
    lose_radio,
    loss,
    piloted,
    stays,
)
from tests.sitl.guard_flight import (
    ALT_HOLD,
    AVOID_ADSB,
    BRAKE,
    GUIDED,
    HOME,
    LAND,
    RTL,
    Flight,
)
from tests.sitl.guard_log import BATTERY, EKF, FENCE, RADIO, SCRIPTING

#: what a failsafe that only stops is given, and how much longer it may take to be noticed (s)
STOPPED_S, NOTICED_S = 10.0, 1.5
LOW_BATTERY = {"BATT_FS_LOW_ACT": 1, "BATT_LOW_VOLT": 10.5, "BATT_LOW_TIMER": 1}
#: far above where these flights are, until a case brings it down
FENCE_BRAKE = {"FENCE_ENABLE": 1, "FENCE_TYPE": 1, "FENCE_ALT_MAX": 100, "FENCE_ACTION": 4}
FENCE_RTL = {**FENCE_BRAKE, "FENCE_ACTION": 1}
#: horizontally out of the way, and back to the mode before
AVOIDANCE = {"AVD_ENABLE": 1, "ADSB_TYPE": 1, "AVD_F_ACTION": 3, "AVD_F_RCVRY": 1, "AVD_W_ACTION": 0}


def gps(flight: Flight, *, works: bool) -> None:
    """By the simulation's parameter of 4.7 and by that of before; the other one is not known, and nobody minds."""
    flight.set_parameter("SIM_GPS1_ENABLE", 1.0 if works else 0.0)
    flight.set_parameter("SIM_GPS_DISABLE", 0.0 if works else 1.0)


def drain_battery(flight: Flight) -> None:
    flight.set_parameter("SIM_BATT_VOLTAGE", 10.0)


def breach_fence(flight: Flight) -> None:
    """The fence comes down below the aircraft: a breach at once, and not for long once it descends."""
    flight.set_parameter("FENCE_ALT_MAX", 17)


def with_cut(deed: Callable[[Flight], object]) -> Callable[[Flight], None]:
    """The deed half a second after the last lease."""

    def goes(flight: Flight) -> None:
        flight.cut()
        deed(flight)

    return goes


def after_return(deed: Callable[[Flight], object]) -> Callable[[Flight], None]:
    """The deed when the guard has acted."""

    def goes(flight: Flight) -> None:
        flight.cut()
        flight.until(lambda: flight.mode == RTL, 6, "RTL")
        deed(flight)

    return goes


# ---- battery -------------------------------------------------------------------------------------------------------


def battery_lands_first(flight: Flight) -> None:
    in_guided(flight)
    drain_battery(flight)
    flight.until(lambda: flight.mode == LAND, 10, "battery LAND")


def battery_wins(flight: Flight) -> Outcome:
    flight.until(lambda: flight.mode == LAND, 10, "battery LAND")
    landing = landed(flight)
    modes = chosen(flight)
    assert modes[-1][:2] == (LAND, BATTERY), modes
    return f"LAND wins; {landing}"


# ---- fence ---------------------------------------------------------------------------------------------------------


def fence_brought_it_home(flight: Flight) -> Outcome:
    flight.until(lambda: flight.mode == RTL, 3, "fence RTL")
    landing = landed_at_home(flight)
    guard_did_nothing(flight)
    modes = chosen(flight)
    assert modes[-1][:2] == (RTL, FENCE), modes
    return f"fence RTL, not fought; {landing}"


def fence_stopped_first(flight: Flight) -> None:
    in_guided(flight)
    breach_fence(flight)
    flight.until(lambda: flight.mode == BRAKE, 3, "fence BRAKE")
    flight.run(15)


def stopped_then_home(mode: int, reason: int) -> Callable[[Flight], Outcome]:
    """The failsafe's mode has its ten seconds, from the loss or from when it began, and the guard goes home."""

    def seen(flight: Flight) -> Outcome:
        lost_s = flight.last_lease_ms / 1000
        flight.until(lambda: flight.mode == mode, 5, "the failsafe stops it")
        flight.until(lambda: flight.mode == RTL, 20, "RTL after the failsafe's ten seconds")
        landing = landed_at_home(flight)
        modes = chosen(flight)
        stopped = next(when for number, why, when in modes if (number, why) == (mode, reason))
        (home,) = [when for number, why, when in modes if (number, why) == (RTL, SCRIPTING)]
        waited_s = home - max(stopped, lost_s)
        assert STOPPED_S <= waited_s <= STOPPED_S + 3.2 + NOTICED_S, f"waited {waited_s:.1f} s"
        return f"left {waited_s:.1f} s in what the failsafe chose, then RTL; {landing}"

    return seen


# ---- EKF and GPS ---------------------------------------------------------------------------------------------------


def held_by_the_ekf_failsafe(flight: Flight) -> None:
    """No GPS: the EKF failsafe has put it into ALT_HOLD, the throttle stick is in the middle."""
    piloted(flight)
    gps(flight, works=False)
    flight.until(lambda: flight.mode == ALT_HOLD, 60, "EKF failsafe")


def home_once_it_can(flight: Flight) -> Outcome:
    stays(flight, ALT_HOLD, 25)
    gps(flight, works=True)
    flight.until(lambda: flight.said("EKF Failsafe Cleared"), 60, "EKF healthy again")
    cleared_s = flight.now_ms / 1000
    flight.until(lambda: flight.mode == RTL, 20, "RTL once the EKF is healthy")
    landing = landed_at_home(flight)
    modes = chosen(flight)
    assert (ALT_HOLD, EKF) in [entry[:2] for entry in modes], modes
    (home_s,) = [when for number, why, when in modes if (number, why) == (RTL, SCRIPTING)]
    return f"left while the EKF is ill, RTL {max(home_s - cleared_s, 0):.0f} s after it is well; {landing}"


def gps_lost_with_the_lease(flight: Flight) -> Outcome:
    flight.until(lambda: flight.mode in (RTL, LAND), 8, "RTL")
    flight.until(lambda: flight.mode == LAND, 60, "EKF failsafe")
    landing = landed(flight)
    modes = chosen(flight)
    assert modes[-1][:2] == (LAND, EKF), modes
    return f"RTL, then EKF LAND; {landing}"


def altitude_hold_without_gps(flight: Flight) -> None:
    pilot = Pilot(flight)
    in_mode(ALT_HOLD)(flight)
    pilot.hold()
    gps(flight, works=False)
    flight.run(20)


def lands_where_it_is(flight: Flight) -> Outcome:
    flight.until(lambda: flight.mode == LAND, 12, "LAND after the refusals")
    refused = sum("RTL refused" in text for text in flight.texts)
    landing = landed(flight)
    modes = chosen(flight)
    assert modes[-1][:2] == (LAND, SCRIPTING), modes
    assert refused >= 1, flight.texts
    return f"RTL refused, LAND; {landing}"


# ---- radio ---------------------------------------------------------------------------------------------------------


def radio_brought_it_home(flight: Flight) -> Outcome:
    flight.until(lambda: flight.mode == RTL, 6, "radio RTL")
    landing = landed_at_home(flight)
    guard_did_nothing(flight)
    modes = chosen(flight)
    assert modes[-1][:2] == (RTL, RADIO), modes
    return f"radio RTL, not fought; {landing}"


# ---- traffic -------------------------------------------------------------------------------------------------------


def another_aircraft(flight: Flight) -> None:
    """Follows it, twenty metres beside and five above."""
    latitude, longitude = flight.place
    altitude_mm = int((HOME[2] + flight.altitude_m + 5) * 1000)
    flight.station.send(
        dialect.MAVLink_adsb_vehicle_message(
            37, latitude + 1800, longitude, 0, altitude_mm, 0, 0, 0, b"another", 1, 1, 0xFFFF, 17
        )
    )


def avoiding(flight: Flight) -> None:
    in_guided(flight)
    flight.beside = lambda: another_aircraft(flight)
    flight.until(lambda: flight.mode == AVOID_ADSB, 20, "avoidance")


def avoids_then_home(flight: Flight) -> Outcome:
    stays(flight, AVOID_ADSB, 20)
    flight.beside = lambda: None
    flight.until(lambda: flight.mode == GUIDED, 60, "the traffic is gone")
    ended_s = flight.now_ms / 1000
    flight.until(lambda: flight.mode == RTL, 15, "RTL")
    landing = landed_at_home(flight)
    modes = chosen(flight)
    (home_s,) = [when for number, why, when in modes if (number, why) == (RTL, SCRIPTING)]
    return f"left while it avoids traffic, RTL {max(home_s - ended_s, 0):.0f} s after; {landing}"


CASES = (
    Case("battery LAND before the loss", loss(battery_lands_first, cut, battery_wins), LOW_BATTERY),
    Case("battery LAND with the loss", loss(in_guided, with_cut(drain_battery), battery_wins), LOW_BATTERY),
    Case("battery LAND after the guard's RTL", loss(in_guided, after_return(drain_battery), battery_wins), LOW_BATTERY),
    Case("fence RTL with the loss", loss(in_guided, with_cut(breach_fence), fence_brought_it_home), FENCE_RTL),
    Case("fence BRAKE before the loss", loss(fence_stopped_first, cut, stopped_then_home(BRAKE, FENCE)), FENCE_BRAKE),
    Case(
        "fence BRAKE with the loss",
        loss(in_guided, with_cut(breach_fence), stopped_then_home(BRAKE, FENCE)),
        FENCE_BRAKE,
    ),
    Case(
        "EKF failsafe ALT_HOLD",
        loss(held_by_the_ekf_failsafe, cut, home_once_it_can),
        {**WITH_RADIO, "FS_EKF_ACTION": 2},
    ),
    Case(
        "GPS lost with the lease",
        loss(in_guided, with_cut(lambda flight: gps(flight, works=False)), gps_lost_with_the_lease),
    ),
    Case("ALT_HOLD without GPS", loss(altitude_hold_without_gps, cut, lands_where_it_is), {"FS_EKF_ACTION": 0}),
    Case("radio failsafe with the loss", loss(piloted, with_cut(lose_radio), radio_brought_it_home), WITH_RADIO),
    Case("traffic avoidance", loss(avoiding, cut, avoids_then_home), AVOIDANCE),
)
test_failsafes = flights(CASES)
