# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard in a plane: a return that never lands in place, a landing sequence left alone, a take-off let climb."""

from __future__ import annotations

from collections.abc import Callable

from tests.sitl.guard_cases import (
    SWITCH_LOITER,
    SWITCH_SECOND,
    Outcome,
    Pilot,
    companion_dies,
    cut,
    guard_delay_s,
    guard_did_nothing,
    lose_radio,
    said,
    stays,
)
from tests.sitl.guard_flight import (
    ACCEPTED,
    DENIED,
    LAND_START,
    LANDING,
    LOST,
    PLANE_PARAMETERS,
    RALLY_POINT,
    SPEEDUP,
    TAKE_OFF,
    WAYPOINT,
    Item,
    item,
    upload,
)
from tests.sitl.guard_log import BATTERY, GCS, RADIO, SCRIPTING, actions_logged
from tests.sitl.guard_wings import (
    ARRIVED,
    AUTO,
    CIRCLE,
    COMMAND,
    FBWA,
    GUIDED,
    LANDING_SEQUENCE,
    MANUAL,
    RESUMED,
    RTL,
    SET_CURRENT,
    TAKEOFF,
    Step,
    WingedCase,
    WingedFlight,
    modes_of,
    no_lease_no_arming,
    on_the_ground,
    winged,
    winged_flights,
)

#: out to the north and, from its fourth item on, a landing sequence that comes in from the south
ROUTE: tuple[Item, ...] = (
    item(WAYPOINT),
    item(TAKE_OFF, 0, 50, 12),
    item(WAYPOINT, 1500, 60),
    item(WAYPOINT, 300, 60),
    item(LAND_START, -900, 60),
    item(WAYPOINT, -700, 45),
    item(LANDING),
)
FIRST, LAST_OF_ROUTE, LINED_UP, LAND_ITEM = 2, 3, 5, 6
#: a transmitter that the radio failsafe watches; FBWA is on the second position of its switch
WITH_RADIO = {"THR_FAILSAFE": 1}
RTL_ALTITUDE_M, CIRCLE_M = 60, 130
AUX_FUNCTION, AUX_MANUAL, HIGH = 218, 51, 2


# ---- what the aircraft is doing ------------------------------------------------------------------------------------


def rolling(flight: WingedFlight) -> None:
    """On the runway, before it lifts off."""
    upload(flight, list(ROUTE), 0)
    flight.arm_in(AUTO)
    flight.until(lambda: flight.home_m > 1, 30, "roll")


def on_route(flight: WingedFlight) -> None:
    """In AUTO, 500 m out, with a landing sequence in the mission."""
    rolling(flight)
    flight.until(lambda: flight.home_m > 500 and flight.waypoint == FIRST, 90, "route")


def in_guided(flight: WingedFlight) -> None:
    """500 m out, in GUIDED, without a mission."""
    flight.arm_in(TAKEOFF)
    flight.until(lambda: flight.altitude_m > 40, 60, "climb")
    flight.fly_to(1500, 60)
    flight.until(lambda: flight.home_m > 500, 90, "500 m from home")


def in_guided_with_sequence(flight: WingedFlight) -> None:
    upload(flight, list(ROUTE), 0)
    in_guided(flight)


def in_sequence(flight: WingedFlight) -> None:
    """The station has ordered the landing sequence: AUTO by command."""
    on_route(flight)
    assert flight.command(LANDING_SEQUENCE) == ACCEPTED
    flight.until(lambda: flight.waypoint == LINED_UP, 30, "landing sequence")


def in_final_approach(flight: WingedFlight) -> None:
    in_sequence(flight)
    flight.until(lambda: flight.waypoint == LAND_ITEM and flight.altitude_m < 30, 200, "final approach")


def returning(flight: WingedFlight) -> None:
    """The station has ordered RTL, and it is on its way."""
    on_route(flight)
    flight.order(RTL)
    flight.run(3)


def arrived(flight: WingedFlight) -> None:
    """RTL has come home and gone over to the landing sequence."""
    returning(flight)
    flight.until(lambda: flight.mode == AUTO, 200, "landing sequence by RTL")
    flight.run(3)


def led_back_to_the_route(flight: WingedFlight) -> None:
    """The commander goes on with the mission; the autopilot still calls it RTL's landing sequence."""
    arrived(flight)
    assert flight.command(SET_CURRENT, FIRST) == ACCEPTED
    flight.until(lambda: flight.waypoint == FIRST, 5, "back on the route")
    flight.run(3)


def battery_has_chosen(flight: WingedFlight) -> None:
    """The critical battery failsafe has gone over to the landing sequence."""
    in_guided_with_sequence(flight)
    flight.set_parameter("SIM_BATT_VOLTAGE", 10.0)
    flight.until(lambda: flight.mode == AUTO, 30, "battery failsafe")
    flight.run(3)


def piloted(flight: WingedFlight) -> Pilot:
    """In GUIDED; a pilot with a transmitter stands by, throttle in the middle."""
    pilot = Pilot(flight)
    in_guided(flight)
    pilot.hold()
    flight.run(1)
    assert flight.mode == GUIDED, f"mode {flight.mode}, {flight.texts[-5:]}"
    return pilot


def by_hand(flight: WingedFlight) -> None:
    """The pilot has taken it by the switch, in FBWA."""
    piloted(flight).takes(FBWA, SWITCH_SECOND)
    flight.run(3)


def to_rally_point(flight: WingedFlight) -> None:
    upload(flight, [item(RALLY_POINT, 1000, 70)], 2)
    in_guided(flight)


# ---- how authority goes --------------------------------------------------------------------------------------------


def says_lost(flight: WingedFlight) -> None:
    """Leases go on, and say that nobody commands."""
    flight.cut()
    flight.sending = True
    flight.lease.update(state=LOST, commander=0)


def scripting_ends_and_companion_dies(flight: WingedFlight) -> None:
    flight.set_parameter("SCR_ENABLE", 0)
    flight.companion_dies()


def with_the_radio(flight: WingedFlight) -> None:
    flight.cut()
    lose_radio(flight)


# ---- what must be seen ---------------------------------------------------------------------------------------------


def circles_at_home(flight: WingedFlight) -> Outcome:
    """RTL by the guard in time; above home it stays."""
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    from_m = flight.altitude_m
    circling = _circles(flight)
    return f"RTL +{guard_delay_s(flight):.1f} s from {from_m:.0f} m, {circling}"


def _circles(flight: WingedFlight) -> Outcome:
    flight.hurry()
    flight.until(lambda: flight.home_m < CIRCLE_M and abs(flight.altitude_m - RTL_ALTITUDE_M) < 15, 240, "home")
    _stays_in_circle(flight, lambda: flight.home_m)
    return "circles above home"


def _stays_in_circle(flight: WingedFlight, distance_m: Callable[[], float]) -> None:
    end_ms = flight.now_ms + 60_000
    while flight.now_ms < end_ms:
        flight.pump()
        assert flight.mode == RTL, f"mode {flight.mode}"
        assert distance_m() < CIRCLE_M + 40, f"{distance_m():.0f} m away"


def lands_by_sequence(flight: WingedFlight) -> Outcome:
    """RTL by the guard in time, home, then the mission's landing sequence, to the ground."""
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    from_m = flight.altitude_m
    landing = on_the_ground(flight)
    delay_s = guard_delay_s(flight)
    modes = modes_of(flight)
    assert modes[-2:] == [(RTL, SCRIPTING), (AUTO, ARRIVED)], modes
    return f"RTL +{delay_s:.1f} s from {from_m:.0f} m, landing sequence; {landing}"


def let_climb(flight: WingedFlight) -> Outcome:
    """No turn near the ground: the return begins when the take-off is over, 10 s after the loss at the latest."""
    said(flight, "HNDO: lease lost, taking off", 6)
    from_m = flight.altitude_m
    flight.until(lambda: flight.mode == RTL, 12, "RTL")
    waited_s = (flight.now_ms - flight.last_lease_ms) / 1000
    to_m = flight.altitude_m
    assert waited_s <= 13.5, waited_s
    assert from_m < 35, from_m
    assert to_m > 45, to_m
    said(flight, "HNDO: lease lost, taken off, RTL")
    landing = on_the_ground(flight)
    return f"let climb from {from_m:.0f} m, RTL +{waited_s:.0f} s from {to_m:.0f} m; {landing}"


def left_in_sequence(flight: WingedFlight) -> Outcome:
    """What the autopilot has begun is flown to its end; the guard chooses no mode."""
    landing = on_the_ground(flight)
    guard_did_nothing(flight)
    return f"left to land; {landing}"


def left_from_return_to_landing(flight: WingedFlight) -> Outcome:
    said(flight, "HNDO: lease lost, in RTL", 6)
    flight.hurry()
    flight.until(lambda: flight.mode == AUTO, 200, "landing sequence by RTL")
    said(flight, "HNDO: lease lost, in AUTO, landing")
    outcome = left_in_sequence(flight)
    assert modes_of(flight)[-2:] == [(RTL, COMMAND), (AUTO, ARRIVED)]
    return outcome


def battery_wins(flight: WingedFlight) -> Outcome:
    outcome = left_in_sequence(flight)
    assert modes_of(flight)[-1] == (AUTO, BATTERY)
    return outcome


def led_away_from_it(flight: WingedFlight) -> Outcome:
    """During the loss somebody with a radio of his own leads the landing sequence back to the route: undone."""
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.until(lambda: flight.mode == AUTO, 240, "landing sequence by RTL")
    flight.run(3)
    assert flight.command(SET_CURRENT, FIRST) == ACCEPTED
    said(flight, "HNDO: lease lost, landing left, RTL")
    landing = on_the_ground(flight)
    modes = modes_of(flight)
    assert modes[-4:] == [(RTL, SCRIPTING), (AUTO, ARRIVED)] * 2, modes
    return f"landing sequence left, undone; {landing}"


def undone(mode: int) -> Callable[[WingedFlight], Outcome]:
    """A station that orders another mode during the loss gets nowhere."""

    def seen(flight: WingedFlight) -> Outcome:
        flight.until(lambda: flight.mode == RTL, 6, "RTL")
        flight.run(1)
        assert flight.set_mode(mode) == ACCEPTED
        said(flight, "HNDO: lease lost, command undone")
        flight.until(lambda: flight.mode == RTL, 1, "RTL again")
        circling = _circles(flight)
        return f"RTL +{guard_delay_s(flight):.1f} s, a station's order undone, {circling}"

    return seen


def failsafe_returns(flight: WingedFlight) -> Outcome:
    """The second line: GCS failsafe, FS_LONG_TIMEOUT after the last heartbeat."""
    silent_ms = flight.now_ms
    flight.until(lambda: flight.mode == RTL, 14, "GCS failsafe")
    waited_s = (flight.now_ms - silent_ms) / 1000
    assert waited_s > 6, waited_s
    circling = _circles(flight)
    guard_did_nothing(flight)
    assert modes_of(flight)[-1] == (RTL, GCS)
    return f"GCS failsafe RTL +{waited_s:.0f} s; {circling}"


def stands_back(flight: WingedFlight) -> Outcome:
    stays(flight, FBWA, 20)
    said(flight, "HNDO: lease lost, pilot flies")
    assert not flight.status[3] & 1, flight.status
    guard_did_nothing(flight)
    return "stands back, 20 s and on"


def radio_falters(flight: WingedFlight) -> Outcome:
    """The short failsafe circles; what it gives back is the pilot's again. The long one returns."""
    stays(flight, FBWA, 5)
    said(flight, "HNDO: lease lost, pilot flies")
    lose_radio(flight)
    flight.until(lambda: flight.mode == CIRCLE, 5, "short failsafe")
    flight.run(2)
    flight.set_parameter("SIM_RC_FAIL", 0)
    flight.until(lambda: flight.mode == FBWA, 5, "the radio is back")
    stays(flight, FBWA, 8)
    lose_radio(flight)
    flight.until(lambda: flight.mode == CIRCLE, 5, "short failsafe")
    left_ms = flight.now_ms
    flight.until(lambda: flight.mode == RTL, 14, "long failsafe, or the guard")
    waited_s = (flight.now_ms - left_ms) / 1000
    assert waited_s >= 8, waited_s
    circling = _circles(flight)
    modes = modes_of(flight)
    assert {(FBWA, RESUMED), (CIRCLE, RADIO)} <= set(modes), modes
    return f"pilot again after the short failsafe; RTL {waited_s:.0f} s after the next one, {circling}"


def pilot_takes_over(flight: WingedFlight) -> Outcome:
    """From the return; a station is not the pilot."""
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.run(3)
    flight.pilot.takes(FBWA, SWITCH_SECOND)
    said(flight, "HNDO: lease lost, pilot flies")
    stays(flight, FBWA, 10)
    assert flight.set_mode(GUIDED) == ACCEPTED
    said(flight, "HNDO: lease lost, command undone")
    flight.until(lambda: flight.mode == RTL, 1, "RTL again")
    flight.pilot.hold(SWITCH_LOITER)
    flight.run(1)
    flight.pilot.takes(FBWA, SWITCH_SECOND)
    stays(flight, FBWA, 5)
    return f"RTL +{guard_delay_s(flight):.1f} s, pilot's FBWA left, a station's GUIDED undone"


def aux_function_denied(flight: WingedFlight) -> Outcome:
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.run(1)
    assert flight.command(AUX_FUNCTION, AUX_MANUAL, HIGH) == DENIED
    stays(flight, RTL, 5)
    assert (MANUAL, 53) not in modes_of(flight)
    return f"denied; RTL +{guard_delay_s(flight):.1f} s"


def at_the_rally_point(flight: WingedFlight) -> Outcome:
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.hurry()
    flight.until(lambda: abs(flight.home_m - 1000) < CIRCLE_M, 200, "rally point")
    _stays_in_circle(flight, lambda: abs(flight.home_m - 1000))
    return f"RTL +{guard_delay_s(flight):.1f} s, circles at the rally point"


def nobody_commands(flight: WingedFlight) -> Outcome:
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    said(flight, "HNDO: no authority, RTL")
    circling = _circles(flight)
    flight.close()
    ((_state, _age_ms, lasted_ms),) = actions_logged(flight.directory)
    assert 2900 <= lasted_ms <= 3300, lasted_ms
    return f"RTL +{lasted_ms / 1000:.1f} s, {circling}"


def back_and_lost_again(flight: WingedFlight) -> Outcome:
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    flight.sending = True
    flight.pace(SPEEDUP)  # with patience, lest a hiccup of this computer be another loss
    said(flight, "HNDO: authority back, staying in RTL")
    stays(flight, RTL, 5)
    flight.fly_to(1500, 60)
    stays(flight, GUIDED, 5)
    flight.cut()
    flight.until(lambda: flight.mode == RTL, 6, "RTL again")
    return f"stays in RTL when it is back; RTL out of GUIDED; {_circles(flight)}"


def with_action(action: int) -> Step:
    def fly(flight: WingedFlight) -> None:
        flight.set_parameter("HNDO_ACTION", action)
        in_guided(flight)
        assert flight.said("no SmartRTL here, HNDO_ACTION 2 is RTL") == (action == 2)

    return fly


# ---- on the ground -------------------------------------------------------------------------------------------------


def landed_and_left_armed(flight: WingedFlight) -> Outcome:
    """The autopilot is told not to disarm; the guard's estimate is no proof that the aircraft is on the ground."""
    flight.hurry()
    flight.until(lambda: flight.touch_down_m_s > 0, 400, "touch-down")
    flight.run(60)
    assert flight.armed
    assert not flight.said("disarmed"), flight.texts[-5:]
    assert flight.status[3] & 4 == 0, "still said to fly"
    return "armed a minute after it has landed"


def parameters_taken(flight: WingedFlight) -> Outcome:
    wanted = dict(
        line.split() for line in PLANE_PARAMETERS.read_text(encoding="ascii").splitlines() if line and line[0] != "#"
    )
    skipped = {"ARMING_SKIPCHK"} if flight.parameter("ARMING_CHECK") is not None else {"ARMING_CHECK"}
    taken = 0
    for name, value in wanted.items():
        if name in skipped:
            continue
        assert flight.parameter(name) == float(value), name
        taken += 1
    return f"{taken} taken"


CASES = (
    WingedCase("Plane: take-off", "plane", winged(rolling, cut, let_climb)),
    WingedCase("Plane: AUTO", "plane", winged(on_route, cut, lands_by_sequence)),
    WingedCase("Plane: AUTO, companion dead", "plane", winged(on_route, companion_dies, lands_by_sequence)),
    WingedCase("Plane: GUIDED", "plane", winged(in_guided, cut, circles_at_home)),
    WingedCase("Plane: GUIDED, rally point", "plane", winged(to_rally_point, cut, at_the_rally_point)),
    WingedCase("Plane: RTL", "plane", winged(returning, cut, left_from_return_to_landing)),
    WingedCase("Plane: RTL's own landing sequence", "plane", winged(arrived, cut, left_in_sequence)),
    WingedCase("Plane: landing sequence by command", "plane", winged(in_sequence, cut, lands_by_sequence)),
    WingedCase("Plane: final approach", "plane", winged(in_final_approach, cut, left_in_sequence)),
    WingedCase(
        "Plane: landing sequence led back to the route before",
        "plane",
        winged(led_back_to_the_route, cut, lands_by_sequence),
    ),
    WingedCase(
        "Plane: landing sequence led back to the route during it", "plane", winged(on_route, cut, led_away_from_it)
    ),
    WingedCase(
        "Plane: landing sequence by a critical battery",
        "plane",
        winged(battery_has_chosen, cut, battery_wins),
        {"BATT_CRT_VOLT": 10.5, "BATT_LOW_TIMER": 3},
    ),
    WingedCase("Plane: GUIDED ordered during the loss", "plane", winged(in_guided, cut, undone(GUIDED))),
    WingedCase("Plane: MANUAL ordered during the loss", "plane", winged(in_guided, cut, undone(MANUAL))),
    WingedCase(
        "Plane: DO_AUX_FUNCTION 51, MANUAL, during the loss", "plane", winged(in_guided, cut, aux_function_denied)
    ),
    WingedCase(
        "Plane: lease says for 3 s that no station commands", "plane", winged(in_guided, says_lost, nobody_commands)
    ),
    WingedCase("Plane: lease lost, back, and lost again", "plane", winged(in_guided, cut, back_and_lost_again)),
    WingedCase("Plane: HNDO_ACTION 2", "plane", winged(with_action(2), cut, circles_at_home)),
    WingedCase("Plane: HNDO_ACTION 3", "plane", winged(with_action(3), cut, circles_at_home)),
    WingedCase(
        "Plane: SCR_ENABLE 0, companion dead",
        "plane",
        winged(in_guided, scripting_ends_and_companion_dies, failsafe_returns),
    ),
    WingedCase(
        "Plane: radio failsafe with the loss", "plane", winged(piloted, with_the_radio, circles_at_home), WITH_RADIO
    ),
    WingedCase("Plane: pilot in FBWA", "plane", winged(by_hand, cut, stands_back), WITH_RADIO),
    WingedCase(
        "Plane: pilot in FBWA, companion dead", "plane", winged(by_hand, companion_dies, failsafe_returns), WITH_RADIO
    ),
    WingedCase("Plane: pilot in FBWA, transmitter falters", "plane", winged(by_hand, cut, radio_falters), WITH_RADIO),
    WingedCase("Plane: pilot in FBWA, THR_FAILSAFE 0", "plane", winged(by_hand, cut, circles_at_home)),
    WingedCase("Plane: pilot takes over from the return", "plane", winged(piloted, cut, pilot_takes_over), WITH_RADIO),
    WingedCase(
        "Plane: arming without a lease, and lost on the ground", "plane", no_lease_no_arming(TAKEOFF, armed_in=MANUAL)
    ),
    WingedCase(
        "Plane: landed and not disarmed by the autopilot",
        "plane",
        winged(in_final_approach, cut, landed_and_left_armed),
        {"LAND_DISARMDELAY": 0},
    ),
    WingedCase("Plane: handover_plane.parm", "plane", parameters_taken, {"THR_FAILSAFE": 0}),
)
test_plane = winged_flights(CASES)
