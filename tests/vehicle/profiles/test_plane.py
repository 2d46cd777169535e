# SPDX-License-Identifier: GPL-3.0-or-later

"""What ArduPlane is told: START in AUTO, the stop that is a circle, the return, and the ways to come down."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import FlightAction, ModeClass
from mavproxy_handover.vehicle.cruise import held_cruise, write_cruise
from mavproxy_handover.vehicle.profiles import PLANE, QUADPLANE
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Asking, Conversation, NoAnswer
from tests.module.vehicle import PlaneAutopilot
from tests.vehicle.profiles.test_copter import talk
from tests.vehicle.test_plane_landing import COMMANDS, route

MODE, ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
CURRENT, DOWN = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, mavlink.MAV_CMD_DO_LAND_START
MANUAL, FBWA, AUTO, RTL, LOITER, GUIDED, QLAND, QRTL, AUTOLAND = 0, 5, 10, 11, 12, 15, 20, 21, 26
DENIED = mavlink.MAV_RESULT_DENIED
REFUSED = "refused (MAV_RESULT_FAILED): PreArm: why"


class Cockpit:
    """An ArduPlane, and the companion that is told what it says before it talks to it."""

    def __init__(self, rotors: bool) -> None:
        self.autopilot = PlaneAutopilot(rotors)
        self.autopilot.guard_state = None
        self.aircraft = VehicleState()
        self.plane = (QUADPLANE if rotors else PLANE).procedures(1, lambda: "PreArm: why", self.aircraft)
        step = self.autopilot.step

        def told(written: list[bytes], now: float) -> list[Any]:
            said = step(written, now)
            for message in said:
                self.aircraft.on_message(message, now)
            return said

        self.autopilot.step = told  # type: ignore[method-assign]

    def flies(self, mode: int, item: int = 3) -> None:
        """In the air, in this mode."""
        self.autopilot.armed = self.autopilot.airborne = True
        self.autopilot.mode, self.autopilot.waypoint = mode, item
        self.listen()

    def listen(self) -> None:
        self.autopilot._beat_at = 0.0
        self.autopilot.step([], 99.0)

    def does(self, asking: Asking) -> Conversation:
        self.listen()
        return talk(asking, self.autopilot)

    def told(self) -> list[tuple[int, int]]:
        """Commands that it was given, with the mode or the item of those that name one."""
        orders = self.autopilot.got("COMMAND_LONG")
        return [(m.command, int(m.param2 if m.command == MODE else m.param1)) for m in orders]


@pytest.fixture(params=[False, True], ids=["plane", "quadplane"])
def cockpit(request: pytest.FixtureRequest) -> Cockpit:
    return Cockpit(request.param)


@pytest.fixture
def plane() -> Cockpit:
    return Cockpit(rotors=False)


@pytest.fixture
def quadplane() -> Cockpit:
    return Cockpit(rotors=True)


# ---- START --------------------------------------------------------------------------------------------------------


def test_start_is_auto_at_the_first_item_and_arming_behind_it(cockpit: Cockpit) -> None:
    made = cockpit.does(cockpit.plane.start())
    assert (made.finished, made.failure) == (True, None)
    assert cockpit.told() == [(CURRENT, 1), (MODE, AUTO), (ARM, 1)]
    assert (cockpit.aircraft.armed, cockpit.aircraft.flown) == (True, ModeClass.MISSION)


@pytest.mark.parametrize(("before", "after"), [(FBWA, FBWA), (AUTO, MANUAL)])
def test_refused_arming_leaves_nothing_behind_that_takes_off(cockpit: Cockpit, before: int, after: int) -> None:
    """In AUTO it would take off by whoever arms it next."""
    cockpit.autopilot.mode = before
    cockpit.autopilot.script[ARM] = DENIED
    made = cockpit.does(cockpit.plane.start())
    assert made.failure == "arming refused (MAV_RESULT_DENIED): PreArm: why"
    assert cockpit.told() == [(CURRENT, 1), (MODE, AUTO), (ARM, 1), (MODE, after)]
    assert cockpit.autopilot.mode == after


def test_the_reason_counts_that_the_autopilot_says_behind_its_answer(cockpit: Cockpit) -> None:
    """The fault: "arming refused: Mission: 1 VTOLTakeoff", which it says of the mode; why came a moment later."""
    said = ["Mission: 1 VTOLTakeoff"]
    plane = PLANE.procedures(1, lambda: said[-1], cockpit.aircraft)
    cockpit.autopilot.script[ARM] = DENIED
    asking = plane.start()

    def told() -> Asking:
        answer: Any = None
        while True:
            ask = asking.send(answer)
            if ask.what.startswith("mode MANUAL") and "show" not in ask.what:
                said.append("Arm: Gyros inconsistent")
            answer = yield ask

    cockpit.autopilot.mode = AUTO
    made = cockpit.does(told())
    assert made.failure == "arming refused (MAV_RESULT_DENIED): Arm: Gyros inconsistent"


@pytest.mark.parametrize(("before", "after"), [(FBWA, FBWA), (AUTO, MANUAL)])
def test_arming_that_nobody_answered_leaves_nothing_behind_either(cockpit: Cockpit, before: int, after: int) -> None:
    """The fault: the mode stayed AUTO, and whoever armed it next made it take off."""
    cockpit.autopilot.mode = before
    cockpit.autopilot.script[ARM] = None
    assert cockpit.does(cockpit.plane.start()).failure == "no answer to arming"
    assert (cockpit.autopilot.mode, cockpit.autopilot.armed) == (after, False)


def test_arming_whose_answer_was_lost_is_a_start(cockpit: Cockpit) -> None:
    """It is in the air, or about to be: MANUAL would stop the motor."""
    cockpit.autopilot.script[ARM] = None
    made = talk(_armed_unheard(cockpit), cockpit.autopilot)
    assert (made.finished, made.failure, cockpit.autopilot.mode) == (True, None, AUTO)


def test_an_autopilot_that_is_not_heard_any_more_is_left_alone(cockpit: Cockpit) -> None:
    """For all that is known it flies."""
    cockpit.autopilot.script[ARM] = None
    made = talk(_armed_unheard(cockpit, silent=True), cockpit.autopilot)
    assert made.failure == "no answer to arming"
    assert cockpit.autopilot.mode == AUTO


def _armed_unheard(cockpit: Cockpit, silent: bool = False) -> Asking:
    """It arms and does not say so; `silent`: and says nothing more."""
    cockpit.listen()
    asking = cockpit.plane.start()
    answer: Any = None
    while True:
        try:
            ask = asking.send(answer) if not isinstance(answer, NoAnswer) else asking.throw(answer)
        except StopIteration:
            return
        if ask.what == "arming":
            cockpit.autopilot.armed = True
            answer = NoAnswer("no answer to arming")
            if not silent:
                cockpit.listen()
            continue
        if silent and ask.what.startswith("heartbeat"):
            answer = NoAnswer("no answer to heartbeat to show")
            continue
        try:
            answer = yield ask
        except NoAnswer as error:
            answer = error


def test_a_start_that_is_called_off_leaves_nothing_behind_that_takes_off(cockpit: Cockpit) -> None:
    cockpit.autopilot.mode = AUTO
    cockpit.does(cockpit.plane.call_off_start())
    assert cockpit.autopilot.mode == MANUAL


@pytest.mark.parametrize(("mode", "armed"), [(AUTO, True), (FBWA, False)])
def test_but_touches_nothing_that_flies_or_is_somebody_elses(cockpit: Cockpit, mode: int, armed: bool) -> None:
    cockpit.autopilot.mode, cockpit.autopilot.armed = mode, armed
    cockpit.does(cockpit.plane.call_off_start())
    assert (cockpit.autopilot.mode, cockpit.told()) == (mode, [])


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (CURRENT, "first item refused (MAV_RESULT_DENIED): PreArm: why"),
        (MODE, "mode AUTO refused (MAV_RESULT_DENIED): PreArm: why"),
    ],
)
def test_what_is_refused_before_arming_arms_nothing(cockpit: Cockpit, command: int, text: str) -> None:
    cockpit.autopilot.script[command] = DENIED
    assert cockpit.does(cockpit.plane.start()).failure == text
    assert ARM not in cockpit.autopilot.commands()


def test_arming_that_is_acknowledged_and_not_done_is_not_believed(cockpit: Cockpit) -> None:
    cockpit.autopilot.forgets.add(ARM)
    assert cockpit.does(cockpit.plane.start()).failure == "no answer to arming in AUTO to show"


# ---- the stop -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [AUTO, GUIDED, LOITER])
def test_it_stops_by_a_circle(cockpit: Cockpit, mode: int) -> None:
    cockpit.flies(mode)
    made = cockpit.does(cockpit.plane.hold(True))
    assert (made.result, made.failure, cockpit.aircraft.flown) == ("LOITER", None, ModeClass.STOP)
    assert cockpit.told() == [(MODE, LOITER)]


def test_a_circle_of_the_radio_failsafe_is_not_ended(cockpit: Cockpit) -> None:
    """The fault: it was told AUTO, and the failsafe that waits in CIRCLE for the radio was over."""
    cockpit.flies(1)
    made = cockpit.does(cockpit.plane.hold(False))
    assert made.failure == "it flies CIRCLE, by which a failsafe waits: nothing goes on with it"
    assert cockpit.told() == []


def test_it_goes_on_by_auto(cockpit: Cockpit) -> None:
    cockpit.flies(LOITER)
    made = cockpit.does(cockpit.plane.hold(False))
    assert (made.result, made.failure, cockpit.aircraft.flown) == ("AUTO", None, ModeClass.MISSION)


@pytest.mark.parametrize(("mode", "name"), [(AUTO, "AUTO"), (GUIDED, "GUIDED")])
@pytest.mark.parametrize("twice", [False, True])
def test_it_goes_on_with_what_it_was_stopped_in(cockpit: Cockpit, mode: int, name: str, twice: bool) -> None:
    """Out of GUIDED nobody has ordered the mission."""
    cockpit.flies(mode)
    cockpit.does(cockpit.plane.hold(True))
    if twice:
        cockpit.does(cockpit.plane.hold(True))
    made = cockpit.does(cockpit.plane.hold(False))
    assert (made.result, made.failure) == (name, None)
    assert cockpit.aircraft.flown is cockpit.plane.holds_by(pause=False)


@pytest.mark.parametrize(("mode", "name"), [(AUTO, "AUTO"), (GUIDED, "GUIDED")])
def test_what_nothing_has_stopped_goes_on_as_it_is(cockpit: Cockpit, mode: int, name: str) -> None:
    cockpit.flies(mode)
    made = cockpit.does(cockpit.plane.hold(False))
    assert (made.result, made.failure, cockpit.told()) == (name, None, [])


@pytest.mark.parametrize(("mode", "name"), [(RTL, "RTL"), (FBWA, "FBWA"), (13, "TAKEOFF")])
@pytest.mark.parametrize("pause", [True, False])
def test_a_return_and_a_pilot_are_not_stopped(cockpit: Cockpit, mode: int, name: str, pause: bool) -> None:
    cockpit.flies(mode)
    made = cockpit.does(cockpit.plane.hold(pause))
    assert made.failure == f"it flies {name}, which nothing stops and nothing goes on with"
    assert cockpit.told() == []


@pytest.mark.parametrize("state", [mavlink.MAV_VTOL_STATE_MC, mavlink.MAV_VTOL_STATE_TRANSITION_TO_MC])
def test_what_hovers_has_no_stop(quadplane: Cockpit, state: int) -> None:
    """QLOITER sinks without a radio, and LOITER would fly off forwards from a take-off or a landing."""
    quadplane.autopilot.vtol_state = state
    quadplane.flies(AUTO)
    made = quadplane.does(quadplane.plane.hold(True))
    assert made.failure == "it hovers: there is no stop before it flies forwards"
    assert quadplane.told() == []


@pytest.mark.parametrize("landed", [mavlink.MAV_LANDED_STATE_TAKEOFF, mavlink.MAV_LANDED_STATE_LANDING])
def test_near_the_ground_there_is_no_circle(cockpit: Cockpit, landed: int) -> None:
    cockpit.autopilot.landed_state = landed
    cockpit.flies(AUTO)
    made = cockpit.does(cockpit.plane.hold(True))
    assert made.failure == "it takes off or lands: there is no stop so low"


def test_a_stop_shows_by_another_mode(cockpit: Cockpit) -> None:
    assert (cockpit.plane.holds_by(True), cockpit.plane.holds_by(False)) == (ModeClass.STOP, ModeClass.MISSION)


# ---- the way home -------------------------------------------------------------------------------------------------


def test_the_way_home_is_rtl(cockpit: Cockpit) -> None:
    cockpit.flies(AUTO)
    made = cockpit.does(cockpit.plane.bring_home(FlightAction.RETURN))
    assert (made.result, made.failure, cockpit.told()) == ("RTL", None, [(MODE, RTL)])


@pytest.mark.parametrize(("mode", "name"), [(QRTL, "QRTL"), (QLAND, "QLAND")])
def test_rtl_that_becomes_a_return_by_rotors_is_one(quadplane: Cockpit, mode: int, name: str) -> None:
    """Q_RTL_MODE 3, or during a guided take-off."""
    quadplane.flies(AUTO)
    quadplane.autopilot.instead = {RTL: mode}
    assert quadplane.does(quadplane.plane.bring_home(FlightAction.RETURN)).result == name


def test_rtl_that_goes_on_to_the_landing_at_once_is_one(plane: Cockpit) -> None:
    """RTL_AUTOLAND 2: it shows as AUTO at another item, and AUTO of before is no answer."""
    plane.aircraft.ways_down.set_route(route(*COMMANDS))
    plane.flies(AUTO, item=2)
    command = plane.autopilot._command

    def on_to_the_landing(m: Any) -> None:
        command(m)
        plane.autopilot.mode, plane.autopilot.waypoint = AUTO, 6

    plane.autopilot._command = on_to_the_landing  # type: ignore[method-assign]
    assert plane.does(plane.plane.bring_home(FlightAction.RETURN)).result == "landing sequence"


def test_a_return_that_cannot_be_had_becomes_a_landing_by_rotors(quadplane: Cockpit) -> None:
    quadplane.flies(AUTO)
    quadplane.autopilot.lacks = {RTL}
    made = quadplane.does(quadplane.plane.bring_home(FlightAction.RETURN))
    assert (made.result, quadplane.told()) == ("QLAND", [(MODE, RTL), (MODE, QLAND)])


def test_a_return_that_cannot_be_had_becomes_the_missions_landing(plane: Cockpit) -> None:
    plane.aircraft.ways_down.set_route(route(*COMMANDS))
    plane.flies(AUTO)
    plane.autopilot.lacks, plane.autopilot.way_down = {RTL}, 6
    made = plane.does(plane.plane.bring_home(FlightAction.RETURN))
    assert (made.result, plane.told()) == ("landing sequence", [(MODE, RTL), (DOWN, 0)])
    assert plane.aircraft.flown is ModeClass.LAND


def test_with_rotors_to_land_now_is_to_land_here(quadplane: Cockpit) -> None:
    quadplane.flies(AUTO)
    made = quadplane.does(quadplane.plane.bring_home(FlightAction.LAND))
    assert (made.result, quadplane.told()) == ("QLAND", [(MODE, QLAND)])


def test_without_rotors_to_land_now_is_the_missions_way_down(plane: Cockpit) -> None:
    plane.aircraft.ways_down.set_route(route(*COMMANDS))
    plane.flies(AUTO, item=2)
    plane.autopilot.way_down = 6
    made = plane.does(plane.plane.bring_home(FlightAction.LAND))
    assert (made.result, plane.told(), plane.aircraft.flown) == ("landing sequence", [(DOWN, 0)], ModeClass.LAND)


@pytest.mark.parametrize("item", [6, 8])
def test_what_its_mission_has_led_to_its_landing_goes_on_with_it(plane: Cockpit, item: int) -> None:
    """DO_LAND_START would have it go around from its last metres, whatever the battery says."""
    plane.aircraft.ways_down.set_route(route(*COMMANDS))
    for seq in range(4, item + 1):
        plane.flies(AUTO, item=seq)
    assert plane.aircraft.flown is ModeClass.MISSION
    plane.autopilot.way_down = 6
    made = plane.does(plane.plane.bring_home(FlightAction.LAND))
    assert (made.result, plane.told(), plane.aircraft.flown) == ("landing sequence", [], ModeClass.LAND)


def test_of_a_mission_that_nobody_knows_the_way_down_is_believed(plane: Cockpit) -> None:
    plane.flies(GUIDED)
    plane.autopilot.way_down = 6
    made = plane.does(plane.plane.bring_home(FlightAction.LAND))
    assert (made.result, plane.told(), plane.aircraft.flown) == ("landing sequence", [(DOWN, 0)], ModeClass.LAND)
    plane.autopilot.mode = GUIDED
    plane.listen()
    assert plane.aircraft.flown is ModeClass.GUIDED


def test_on_its_way_down_it_is_not_sent_to_the_beginning_of_it_again(plane: Cockpit) -> None:
    plane.aircraft.ways_down.set_route(route(*COMMANDS))
    plane.flies(RTL)
    plane.flies(AUTO, item=7)
    assert plane.aircraft.flown is ModeClass.RETURN
    made = plane.does(plane.plane.bring_home(FlightAction.LAND))
    assert (made.result, plane.told(), plane.aircraft.flown) == ("landing sequence", [], ModeClass.LAND)
    made = plane.does(plane.plane.bring_home(FlightAction.RETURN))
    assert (made.result, plane.told()) == ("landing sequence", [])


@pytest.mark.parametrize(
    ("lacks", "result", "told"),
    [
        ({QLAND}, "AUTOLAND", [(DOWN, 0), (MODE, AUTOLAND)]),
        ({QLAND, AUTOLAND}, "RTL", [(DOWN, 0), (MODE, AUTOLAND), (MODE, RTL)]),
    ],
)
def test_without_a_way_down_it_lands_as_it_can(
    plane: Cockpit, lacks: set[int], result: str, told: list[tuple[int, int]]
) -> None:
    plane.flies(AUTO)
    plane.autopilot.lacks = lacks
    made = plane.does(plane.plane.bring_home(FlightAction.LAND))
    assert (made.result, plane.told()) == (result, told)


def test_a_way_down_that_does_not_come_to_the_landing_is_followed_by_the_next_way(plane: Cockpit) -> None:
    """DO_LAND_START has set AUTO, which is no choice of a pilot."""
    plane.aircraft.ways_down.set_route(route(*COMMANDS))
    plane.flies(GUIDED, item=2)
    plane.autopilot.way_down = 2  # it stays at this item
    made = plane.does(plane.plane.bring_home(FlightAction.LAND))
    assert (made.result, plane.told()) == ("RTL", [(DOWN, 0), (MODE, AUTOLAND), (MODE, RTL)])


def test_nor_is_a_return_that_goes_on_to_a_landing_which_does_not_show(plane: Cockpit) -> None:
    """RTL_AUTOLAND 2 sets AUTO at once, and MISSION_CURRENT does not come."""
    plane.aircraft.ways_down.set_route(route(*COMMANDS))
    plane.flies(GUIDED, item=2)
    plane.autopilot.instead, plane.autopilot.way_down = {RTL: AUTO}, 6
    made = plane.does(plane.plane.bring_home(FlightAction.RETURN))
    assert (made.result, plane.told()) == ("landing sequence", [(MODE, RTL), (DOWN, 0)])


@pytest.mark.parametrize(("mode", "name"), [(FBWA, "FBWA"), (LOITER, "LOITER"), (GUIDED, "GUIDED")])
@pytest.mark.parametrize("action", [FlightAction.RETURN, FlightAction.LAND])
def test_what_another_chooses_before_an_order_shows_is_left_to_it(
    cockpit: Cockpit, action: FlightAction, mode: int, name: str
) -> None:
    """The fault: the next way down was ordered over a pilot, who had taken over before the first one showed."""
    cockpit.aircraft.ways_down.set_route(route(*COMMANDS))
    cockpit.flies(AUTO, item=2)
    cockpit.autopilot.way_down = 6
    original = cockpit.autopilot._command

    def taken_over(m: Any) -> None:
        cockpit.autopilot.forgets.add(m.command)
        original(m)
        cockpit.autopilot.mode = mode

    cockpit.autopilot._command = taken_over  # type: ignore[method-assign]
    made = cockpit.does(cockpit.plane.bring_home(action))
    assert len(cockpit.told()) == 1
    assert made.failure == f"not commanded again: the autopilot is in {name} now"


def test_an_autopilot_that_does_none_of_it_is_told_of(cockpit: Cockpit) -> None:
    cockpit.flies(AUTO)
    cockpit.autopilot.lacks = {RTL, QLAND, AUTOLAND}
    made = cockpit.does(cockpit.plane.bring_home(FlightAction.RETURN))
    assert made.failure in (
        f"the autopilot does not obey: mode QLAND {REFUSED}",
        f"the autopilot does not obey: mode AUTOLAND {REFUSED}",
    )


def test_a_return_is_begun_anew_by_a_circle(cockpit: Cockpit) -> None:
    cockpit.flies(RTL)
    made = cockpit.does(cockpit.plane.return_anew())
    assert (made.result, cockpit.told()) == ("RTL", [(MODE, LOITER), (MODE, RTL)])


# ---- the mission's speed ------------------------------------------------------------------------------------------


def test_its_speed_is_an_airspeed(cockpit: Cockpit) -> None:
    """The other kind sets the least ground speed, and outlives the mode."""
    cockpit.flies(AUTO)
    assert cockpit.does(cockpit.plane.set_speed(18.0)).failure is None
    (order,) = [m for m in cockpit.autopilot.got("COMMAND_LONG") if m.command == mavlink.MAV_CMD_DO_CHANGE_SPEED]
    assert (order.param1, order.param2, order.param3) == (0.0, 18.0, -1.0)


@pytest.mark.parametrize(("name", "units"), [("AIRSPEED_CRUISE", 1.0), ("TRIM_ARSPD_CM", 100.0)])
def test_its_cruise_speed_is_written_by_the_name_that_its_firmware_has(plane: Cockpit, name: str, units: float) -> None:
    limits = {"AIRSPEED_MIN": 13.0, "AIRSPEED_MAX": 35.0}
    plane.autopilot.parameters = {name: 22.0 * units, **limits}
    assert talk(held_cruise(1, PLANE), plane.autopilot).result == 22.0
    assert talk(write_cruise(1, 18.0, PLANE), plane.autopilot).failure is None
    assert plane.autopilot.parameters == {name: 18.0 * units, **limits}


@pytest.mark.parametrize(
    ("speed", "why"), [(10.0, "slower than AIRSPEED_MIN, 13 m/s"), (40.0, "faster than AIRSPEED_MAX, 35 m/s")]
)
def test_a_speed_that_it_does_not_fly_is_refused(plane: Cockpit, speed: float, why: str) -> None:
    made = talk(write_cruise(1, speed, PLANE), plane.autopilot)
    assert made.failure == f"the mission's cruise speed, {speed:g} m/s, is {why}"
    assert plane.autopilot.got("PARAM_SET") == []
