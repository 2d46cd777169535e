# SPDX-License-Identifier: GPL-3.0-or-later

"""Authority goes while the aircraft is in one mode or another: home where it flies on, left alone where it lands."""

from __future__ import annotations

from collections.abc import Callable

from tests.sitl.guard_cases import (
    Case,
    Outcome,
    Step,
    came_home,
    companion_dies,
    cut,
    ended_by_gcs_failsafe,
    far_out,
    flights,
    guard_delay_s,
    guard_did_nothing,
    in_auto,
    in_guided,
    in_mode,
    landed,
    landed_at_home,
    loss,
    said,
    stays,
)
from tests.sitl.guard_flight import (
    ACCEPTED,
    AUTO_RTL,
    BRAKE,
    CIRCLE,
    GUIDED,
    JUMP,
    LAND,
    LAND_START,
    LANDING,
    RETURN,
    RTL,
    SMART_RTL,
    SPEEDUP,
    WAYPOINT,
    Flight,
    Item,
    item,
    target,
    upload_mission,
)


def climbing(flight: Flight) -> None:
    flight.arm_with_lease()
    flight.pace(SPEEDUP)
    flight.until(lambda: flight.command(22, 0, 0, 0, 0, 0, 0, 20) == ACCEPTED, 5, "take-off, motors turning")
    flight.until(lambda: flight.altitude_m > 2, 20, "lift-off")


def mission(*items: Item) -> Step:
    def fly(flight: Flight) -> None:
        upload_mission(flight, *items)
        in_auto(flight)

    return fly


def descending(flight: Flight, below_m: float) -> None:
    flight.until(lambda: flight.waypoint == 3 and flight.altitude_m < below_m, 120, "last descent")


def final_descent(flight: Flight) -> None:
    """AUTO has come to its own RTL, over home, on the way down."""
    mission(item(WAYPOINT, 40, 20), item(RETURN))(flight)
    descending(flight, 9)


def landing_in_auto(flight: Flight) -> None:
    """A landing place of the mission, 60 m away, 7 m above it."""
    mission(item(WAYPOINT, 60, 20), item(LANDING, 60))(flight)
    descending(flight, 7)


def in_auto_rtl(flight: Flight) -> None:
    mission(item(WAYPOINT, 200, 20), item(LAND_START, 100, 20), item(WAYPOINT, 30, 15), item(LANDING))(flight)
    assert flight.command(LAND_START) == ACCEPTED
    flight.until(lambda: flight.mode == AUTO_RTL, 3, "AUTO_RTL")


def jumped(flight: Flight) -> None:
    """The mission has gone back once to where it was."""
    mission(item(WAYPOINT, 40, 20), item(WAYPOINT, 60, 20), item(JUMP, 0, 0, 2, -1))(flight)
    flight.until(lambda: flight.waypoint == 3, 60, "second waypoint")
    flight.until(lambda: flight.waypoint == 2, 60, "jump")


def targets_go_on(flight: Flight) -> None:
    """The companion's process that steers is not the one that died; and a station asks for GUIDED again."""
    flight.beside = lambda: flight.companion.send(target(300, 25))
    flight.cut()


def targets_ignored(flight: Flight) -> Outcome:
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.run(1)
    assert flight.set_mode(GUIDED) == ACCEPTED
    said(flight, "undone")
    flight.until(lambda: flight.mode == RTL, 1, "RTL again")
    return came_home(flight) + "; GUIDED undone"


def left_to_land_at_home(flight: Flight) -> Outcome:
    """No climb, no other mode, down at home."""
    from_m = flight.mark_altitude()
    mode = flight.mode
    flight.run(4)
    assert flight.mode == mode, f"mode {flight.mode}"
    landing = landed_at_home(flight)
    assert flight.highest_m <= from_m + 0.5, f"climbed from {from_m:.1f} to {flight.highest_m:.1f} m"
    return f"left to land from {from_m:.0f} m; {landing}"


def nothing_but_landing(flight: Flight) -> Outcome:
    outcome = left_to_land_at_home(flight)
    guard_did_nothing(flight)
    return outcome


def landed_where_it_was_told(flight: Flight) -> Outcome:
    from_m = flight.mark_altitude()
    landing = landed(flight)
    assert flight.highest_m <= from_m + 0.5, f"climbed from {from_m:.1f} to {flight.highest_m:.1f} m"
    assert 55 <= flight.home_m <= 65, f"{flight.home_m:.0f} m from home"
    guard_did_nothing(flight)
    return f"left to land from {from_m:.0f} m; {landing}"


def takes_off_without(flight: Flight) -> Outcome:
    """The order to take off comes two seconds after the last lease: a second is enough to spool up, and for no more."""
    flight.mark_altitude()
    flight.until(lambda: flight.now_ms - flight.last_lease_ms >= 1900, 3)
    assert flight.command(22, 0, 0, 0, 0, 0, 0, 20) == ACCEPTED
    flight.until(lambda: flight.mode == RTL or not flight.armed, 3, "RTL, or disarmed")
    assert flight.highest_m < 2, f"lifted off to {flight.highest_m:.1f} m"
    if flight.armed:
        return came_home(flight)
    said(flight, "lease lost, disarmed")
    return "disarmed before lift-off"


def armed_on_the_ground(flight: Flight) -> None:
    flight.arm_with_lease()


def in_smart_rtl(flight: Flight) -> None:
    far_out(flight)
    assert flight.set_mode(SMART_RTL) == ACCEPTED
    flight.until(lambda: flight.mode == SMART_RTL, 3, "SMART_RTL")


def left_in(mode: int, name: str) -> Callable[[Flight], Outcome]:
    """A return of another kind goes on to its end, past the time of the autopilot's own GCS failsafe."""

    def seen(flight: Flight) -> Outcome:
        stays(flight, mode, 15)
        landing = landed_at_home(flight)
        guard_did_nothing(flight)
        return f"left in {name}; {landing}"

    return seen


def ordered(action: int) -> Step:
    """60 m out, with another HNDO_ACTION."""

    def fly(flight: Flight) -> None:
        far_out(flight)
        flight.set_parameter("HNDO_ACTION", action)

    return fly


def smart_return(flight: Flight) -> Outcome:
    flight.until(lambda: flight.mode == SMART_RTL, 6, "SMART_RTL")
    landing = landed_at_home(flight)
    return f"SMART_RTL +{guard_delay_s(flight):.1f} s, {landing}"


def lands_at_once(flight: Flight) -> Outcome:
    flight.until(lambda: flight.mode == LAND, 6, "LAND")
    landing = landed(flight)
    assert flight.home_m > 40, f"{flight.home_m:.0f} m from home"
    return f"LAND +{guard_delay_s(flight):.1f} s, {landing}"


CASES = (
    Case("take-off climb", loss(climbing, cut, came_home)),
    Case("take-off ordered 2 s after the last lease", loss(armed_on_the_ground, cut, takes_off_without)),
    Case("AUTO", loss(mission(item(WAYPOINT, 400, 20)), cut, came_home)),
    Case("AUTO, DO_JUMP loop", loss(jumped, cut, came_home)),
    Case("AUTO, its own RTL in final descent", loss(final_descent, cut, left_to_land_at_home)),
    Case("AUTO, NAV_LAND at 7 m", loss(landing_in_auto, cut, landed_where_it_was_told)),
    Case("AUTO_RTL", loss(in_auto_rtl, cut, left_in(AUTO_RTL, "AUTO_RTL"))),
    Case("AUTO_RTL, companion dead", loss(in_auto_rtl, companion_dies, ended_by_gcs_failsafe(AUTO_RTL, "AUTO_RTL"))),
    Case(
        "AUTO_RTL, companion dead, FS_GCS_ENABLE 6",
        loss(in_auto_rtl, companion_dies, left_in(AUTO_RTL, "AUTO_RTL")),
        {"FS_GCS_ENABLE": 6},
    ),
    Case(
        "SMART_RTL, companion dead", loss(in_smart_rtl, companion_dies, ended_by_gcs_failsafe(SMART_RTL, "SMART_RTL"))
    ),
    Case(
        "SMART_RTL, companion dead, FS_GCS_ENABLE 3",
        loss(in_smart_rtl, companion_dies, left_in(SMART_RTL, "SMART_RTL")),
        {"FS_GCS_ENABLE": 3},
    ),
    Case("BRAKE", loss(in_mode(BRAKE), cut, came_home)),
    Case("CIRCLE", loss(in_mode(CIRCLE), cut, came_home)),
    Case("LAND", loss(in_mode(LAND), cut, nothing_but_landing)),
    Case("GUIDED, the companion's targets go on", loss(in_guided, targets_go_on, targets_ignored)),
    Case("GUIDED, HNDO_ACTION 2", loss(ordered(2), cut, smart_return)),
    Case("GUIDED, HNDO_ACTION 3", loss(ordered(3), cut, lands_at_once)),
)
test_losses = flights(CASES)
