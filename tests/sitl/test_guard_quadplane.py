# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard in a QuadPlane: QRTL where it hovers, RTL on its wings, down at the chosen place either way."""

from __future__ import annotations

from collections.abc import Callable

from tests.sitl.guard_cases import (
    SWITCH_SECOND,
    Outcome,
    Pilot,
    cut,
    guard_delay_s,
    guard_did_nothing,
    lose_radio,
    said,
    stays,
)
from tests.sitl.guard_flight import ACCEPTED, RALLY_POINT, WAYPOINT, item, upload
from tests.sitl.guard_log import GCS, RADIO, SCRIPTING
from tests.sitl.guard_wings import (
    ARRIVED_VTOL,
    AUTO,
    COMMAND,
    GUIDED,
    LOITER,
    QLAND,
    QLOITER,
    QRTL,
    QRTL_AT_ONCE,
    RTL,
    VTOL_LANDING,
    VTOL_TAKE_OFF,
    Step,
    WingedCase,
    WingedFlight,
    modes_of,
    no_lease_no_arming,
    on_the_ground,
    winged,
    winged_flights,
)

#: a transmitter that the radio failsafe watches; QLOITER is on the second position of its switch
WITH_RADIO = {"THR_FAILSAFE": 1, "FLTMODE2": QLOITER}
#: it hovers where GUIDED has brought it
HOVER_THERE = {"Q_GUIDED_MODE": 1}
VTOL_ITEM = 3


# ---- what the aircraft is doing ------------------------------------------------------------------------------------


def climbing(flight: WingedFlight) -> None:
    flight.arm_in(GUIDED)
    assert flight.command(22, 0, 0, 0, 0, 0, 0, 20) == ACCEPTED
    flight.until(lambda: flight.altitude_m > 2, 30, "lift-off")


def hovering(flight: WingedFlight) -> None:
    """20 m above home."""
    climbing(flight)
    flight.until(lambda: flight.altitude_m > 18, 60, "climb")
    flight.run(3)


def hovering_far_away(flight: WingedFlight) -> None:
    """Where something was let down: 600 m out, 40 m up."""
    hovering(flight)
    flight.fly_to(600, 40)
    flight.until(lambda: flight.said("VTOL position2") and abs(flight.home_m - 600) < 15, 200, "600 m from home")
    flight.run(8)


def on_wings(flight: WingedFlight) -> None:
    hovering(flight)
    flight.fly_to(2000, 60)
    flight.until(lambda: flight.home_m > 500, 90, "500 m from home")


def vtol_mission(flight: WingedFlight) -> None:
    upload(flight, [item(WAYPOINT), item(VTOL_TAKE_OFF, 0, 20), item(WAYPOINT, 400, 40), item(VTOL_LANDING, 900)], 0)
    flight.arm_in(AUTO)


def taking_off_in_auto(flight: WingedFlight) -> None:
    vtol_mission(flight)
    flight.until(lambda: flight.altitude_m > 4, 60, "lift-off")


def approaching(flight: WingedFlight) -> None:
    vtol_mission(flight)
    flight.until(lambda: flight.waypoint == VTOL_ITEM and flight.home_m > 500, 120, "approach")


def descending(flight: WingedFlight) -> None:
    vtol_mission(flight)
    flight.until(lambda: flight.said("Land descend started"), 200, "landing place of the mission")
    flight.until(lambda: flight.altitude_m < 20, 60, "descent")


def ordered(mode: int, situation: Step) -> Step:
    def fly(flight: WingedFlight) -> None:
        situation(flight)
        flight.order(mode)
        flight.run(2)

    return fly


def with_action(action: int, situation: Step) -> Step:
    def fly(flight: WingedFlight) -> None:
        flight.set_parameter("HNDO_ACTION", action)
        situation(flight)

    return fly


def near_rally_point(situation: Step) -> Step:
    """The companion's chosen place is 300 m to the north of home."""

    def fly(flight: WingedFlight) -> None:
        upload(flight, [item(RALLY_POINT, 300, 30)], 2)
        situation(flight)

    return fly


def by_hand(flight: WingedFlight) -> None:
    """The pilot has taken it by the switch, in QLOITER, throttle in the middle."""
    pilot = Pilot(flight)
    hovering(flight)
    pilot.hold()
    flight.run(1)
    pilot.takes(QLOITER, SWITCH_SECOND)
    flight.run(2)


# ---- how authority goes --------------------------------------------------------------------------------------------


def in_transition(flight: WingedFlight) -> None:
    """Two seconds after the last lease it is sent away, and its wings do not carry it yet when the time is over."""
    flight.cut()
    flight.until(lambda: flight.now_ms - flight.last_lease_ms >= 1800, 3)
    flight.fly_to(2000, 40)


def scripting_ends_and_companion_dies(flight: WingedFlight) -> None:
    flight.set_parameter("SCR_ENABLE", 0)
    flight.companion_dies()


# ---- what must be seen ---------------------------------------------------------------------------------------------


def comes_home(
    mode: int, name: str, away_m: float = 0, then: tuple[tuple[int, int], ...] = ()
) -> Callable[[WingedFlight], Outcome]:
    """The guard chooses the mode in time, the autopilot what follows; down softly, at home or so far away (m)."""

    def seen(flight: WingedFlight) -> Outcome:
        flight.until(lambda: flight.mode in (mode, *(entry[0] for entry in then)), 6, name)
        from_m = flight.altitude_m
        landing = on_the_ground(flight, away_m)
        delay_s = guard_delay_s(flight)
        modes = modes_of(flight)
        wanted = ((mode, SCRIPTING), *then)
        assert tuple(modes[-len(wanted) :]) == wanted, modes
        followed = ", then QRTL" if then else ""
        return f"{name} +{delay_s:.1f} s from {max(from_m, 0):.0f} m{followed}; {landing}"

    return seen


def climbs_first(flight: WingedFlight) -> Outcome:
    """From a low hover far away no transition near the ground: up to the height of QRTL, then home."""
    outcome = comes_home(QRTL, "QRTL")(flight)
    assert flight.highest_m >= 18, f"highest {flight.highest_m:.0f} m"
    return outcome


def comes_home_at_once(flight: WingedFlight) -> Outcome:
    """Q_RTL_MODE 3: the autopilot makes QRTL of every RTL."""
    flight.until(lambda: flight.mode == QRTL, 6, "QRTL")
    landing = on_the_ground(flight)
    delay_s = guard_delay_s(flight)
    assert modes_of(flight)[-1] == (QRTL, QRTL_AT_ONCE)
    return f"RTL +{delay_s:.1f} s, which is QRTL; {landing}"


def left(away_m: float = 0) -> Callable[[WingedFlight], Outcome]:
    """Left alone to its end."""

    def seen(flight: WingedFlight) -> Outcome:
        mode = flight.mode
        stays(flight, mode, 5)
        landing = on_the_ground(flight, away_m)
        guard_did_nothing(flight)
        return f"left to land; {landing}"

    return seen


def left_from_return_to_landing(flight: WingedFlight) -> Outcome:
    """The return that the station has ordered goes on, and over to QRTL by itself."""
    said(flight, "HNDO: lease lost, in RTL", 6)
    landing = on_the_ground(flight)
    guard_did_nothing(flight)
    modes = modes_of(flight)
    assert modes[-2:] == [(RTL, COMMAND), (QRTL, ARRIVED_VTOL)], modes
    return f"left to land by QRTL; {landing}"


def undone(mode: int) -> Callable[[WingedFlight], Outcome]:
    def seen(flight: WingedFlight) -> Outcome:
        flight.until(lambda: flight.mode == QRTL, 6, "QRTL")
        flight.run(1)
        assert flight.set_mode(mode) == ACCEPTED
        said(flight, "HNDO: lease lost, command undone")
        flight.until(lambda: flight.mode in (RTL, QRTL), 1, "the way home again")
        landing = on_the_ground(flight)
        return f"QRTL +{guard_delay_s(flight):.1f} s, a station's order undone; {landing}"

    return seen


def failsafe_returns(flight: WingedFlight) -> Outcome:
    silent_ms = flight.now_ms
    flight.until(lambda: flight.mode in (RTL, QRTL), 14, "GCS failsafe")
    waited_s = (flight.now_ms - silent_ms) / 1000
    landing = on_the_ground(flight)
    guard_did_nothing(flight)
    modes = modes_of(flight)
    assert (RTL, GCS) in modes or (QRTL, GCS) in modes or (QRTL, QRTL_AT_ONCE) in modes, modes
    return f"GCS failsafe +{waited_s:.0f} s; {landing}"


def stands_back_until_the_radio_dies(flight: WingedFlight) -> Outcome:
    """Q_OPTIONS 32: the short failsafe returns out of a VTOL mode, at once."""
    stays(flight, QLOITER, 15)
    said(flight, "HNDO: lease lost, pilot flies")
    lose_radio(flight)
    flight.until(lambda: flight.mode == QRTL, 5, "radio failsafe")
    landing = on_the_ground(flight)
    guard_did_nothing(flight)
    assert modes_of(flight)[-1] == (QRTL, RADIO)
    return f"stands back, 15 s and on; QRTL of the radio failsafe not fought; {landing}"


CASES = (
    WingedCase("QuadPlane: take-off climb", "quadplane", winged(climbing, cut, comes_home(QRTL, "QRTL"))),
    WingedCase(
        "QuadPlane: AUTO, VTOL take-off", "quadplane", winged(taking_off_in_auto, cut, comes_home(QRTL, "QRTL"))
    ),
    WingedCase("QuadPlane: hover", "quadplane", winged(hovering, cut, comes_home(QRTL, "QRTL"))),
    WingedCase(
        "QuadPlane: hover 600 m from home", "quadplane", winged(hovering_far_away, cut, climbs_first), HOVER_THERE
    ),
    WingedCase(
        "QuadPlane: transition",
        "quadplane",
        winged(hovering, in_transition, comes_home(RTL, "RTL", then=((QRTL, ARRIVED_VTOL),))),
    ),
    WingedCase(
        "QuadPlane: on wings", "quadplane", winged(on_wings, cut, comes_home(RTL, "RTL", then=((QRTL, ARRIVED_VTOL),)))
    ),
    WingedCase(
        "QuadPlane: on wings, Q_RTL_MODE 3",
        "quadplane",
        winged(on_wings, cut, comes_home_at_once),
        {"Q_RTL_MODE": 3},
    ),
    WingedCase(
        "QuadPlane: on wings, rally point",
        "quadplane",
        winged(near_rally_point(on_wings), cut, comes_home(RTL, "RTL", 300, then=((QRTL, ARRIVED_VTOL),))),
    ),
    WingedCase(
        "QuadPlane: hover, rally point",
        "quadplane",
        winged(near_rally_point(hovering), cut, comes_home(QRTL, "QRTL", 300)),
    ),
    WingedCase(
        "QuadPlane: AUTO, VTOL landing before its descent",
        "quadplane",
        winged(approaching, cut, comes_home(RTL, "RTL", then=((QRTL, ARRIVED_VTOL),))),
    ),
    WingedCase("QuadPlane: AUTO, VTOL landing in its descent", "quadplane", winged(descending, cut, left(900))),
    WingedCase("QuadPlane: RTL", "quadplane", winged(ordered(RTL, on_wings), cut, left_from_return_to_landing)),
    WingedCase("QuadPlane: QRTL", "quadplane", winged(ordered(QRTL, hovering), cut, left())),
    WingedCase("QuadPlane: QLAND", "quadplane", winged(ordered(QLAND, hovering), cut, left())),
    WingedCase(
        "QuadPlane: hover, HNDO_ACTION 3",
        "quadplane",
        winged(with_action(3, hovering), cut, comes_home(QLAND, "QLAND")),
    ),
    WingedCase(
        "QuadPlane: on wings, HNDO_ACTION 3",
        "quadplane",
        winged(with_action(3, on_wings), cut, comes_home(RTL, "RTL", then=((QRTL, ARRIVED_VTOL),))),
    ),
    WingedCase("QuadPlane: QLAND ordered during the loss", "quadplane", winged(hovering, cut, undone(QLAND))),
    WingedCase("QuadPlane: LOITER ordered during the loss", "quadplane", winged(hovering, cut, undone(LOITER))),
    WingedCase(
        "QuadPlane: hover, SCR_ENABLE 0, companion dead",
        "quadplane",
        winged(hovering, scripting_ends_and_companion_dies, failsafe_returns),
    ),
    WingedCase(
        "QuadPlane: pilot in QLOITER, then the transmitter dies",
        "quadplane",
        winged(by_hand, cut, stands_back_until_the_radio_dies),
        WITH_RADIO,
    ),
    WingedCase(
        "QuadPlane: arming without a lease, and lost on the ground",
        "quadplane",
        no_lease_no_arming(GUIDED, armed_in=GUIDED),
    ),
)
test_quadplane = winged_flights(CASES)
