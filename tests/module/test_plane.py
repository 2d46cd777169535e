# SPDX-License-Identifier: GPL-3.0-or-later

"""A vehicle with wings under the whole companion: START, the stations' STOP and CONTINUE, what everybody is told."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import Fly
from mavproxy_handover.core.common.model import FlightAction, ModeClass, ModeSource, Phase, Reason
from mavproxy_handover.mission.package import MissionPackage, load
from mavproxy_handover.vehicle.profiles import QUADPLANE
from tests.module.conftest import Bench
from tests.module.test_commands_in_flight import along_the_dike
from tests.module.test_flight_uploads import Program
from tests.module.vehicle import PlaneAutopilot
from tests.packages import ROUND
from tests.vehicle.test_plane_landing import COMMANDS, route

START, MODE, ARM = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
PAUSE, CURRENT = mavlink.MAV_CMD_DO_PAUSE_CONTINUE, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
ACCEPTED, DENIED, FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED
REJECTED, IN_PROGRESS = mavlink.MAV_RESULT_TEMPORARILY_REJECTED, mavlink.MAV_RESULT_IN_PROGRESS
FBWA, AUTO, RTL, LOITER, GUIDED, QHOVER = 5, 10, 11, 12, 15, 18
#: NAV_LAND and NAV_TAKEOFF of a copter -> the same by rotors
BY_ROTORS = {21: 85, 22: 84}
STOP, CONTINUE = 0.0, 1.0


@pytest.fixture
def ferry(tmp_path: Path) -> MissionPackage:
    """The delivery, by a plane that hovers too."""
    folder = tmp_path / "ferry"
    shutil.copytree(ROUND, folder)
    mission, plan = folder / "mission.toml", folder / "delivery.plan"
    mission.write_text(mission.read_text().replace("\ndetector =", '\naircraft = "quadplane"\ndetector =', 1))
    items = json.loads(plan.read_text())
    items["mission"]["vehicleType"] = 20  # VTOL
    for item in items["mission"]["items"]:
        item["command"] = BY_ROTORS.get(item["command"], item["command"])
        item["params"][0] = 0  # wings wait nowhere
    plan.write_text(json.dumps(items))
    return load(folder)


def stands(bench: Bench, package: MissionPackage, **parameters: float) -> None:
    """A plane that hovers too, at the home of that mission."""
    bench.autopilot = PlaneAutopilot(rotors=True)
    bench.autopilot.position = package.route.home.lat_deg, package.route.home.lon_deg
    usual = {"Q_RTL_MODE": 1.0, "ARMING_REQUIRE": 1.0, "AIRSPEED_MIN": 9.0}  # the mission is one of 10 m/s
    bench.autopilot.parameters |= usual | parameters


@pytest.fixture
def ready(bench: Bench, ferry: MissionPackage) -> Bench:
    """The parent commands, a plane that hovers too holds the mission, the guard answers."""
    stands(bench, ferry)
    bench.connect()
    bench.share(ferry, at_once=True)
    bench.wait(12.0)
    return bench


@pytest.fixture
def flight(ready: Bench) -> Bench:
    """In AUTO, forwards."""
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.autopilot.waypoint = 3
    ready.wait(2.0)
    ready.autopilot.received.clear()
    ready.a.received.clear()
    return ready


def told(bench: Bench) -> list[tuple[int, float, float]]:
    """Commands that the autopilot got, without those for rates."""
    return [(m.command, m.param1, m.param2) for m in bench.autopilot.got("COMMAND_LONG") if m.command != 511]


def hear(bench: Bench, message: mavlink.MAVLink_message) -> None:
    """The autopilot says this now."""
    bench.autopilot.say(message)
    bench.mpstate.deliver(bench.autopilot._out.pop())


def test_it_starts_in_auto(ready: Bench) -> None:
    ready.autopilot.received.clear()
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.run(0.5)
    assert told(ready) == [(CURRENT, 1.0, 0.0), (MODE, 1.0, AUTO), (ARM, 1.0, 0.0)]
    assert ready.a.acks(START) == [IN_PROGRESS, ACCEPTED]
    assert "mode AUTO" in [entry["text"] for entry in ready.journal("mode")]
    assert [entry["text"] for entry in ready.journal("start_sequence")] == ["AUTO, arm"]


@pytest.mark.parametrize("message", [True, False])
def test_a_mission_item_that_leads_down_is_the_commanders_word(flight: Bench, message: bool) -> None:
    """What is flown changes and the mode does not: nobody's command would make it a pilot's."""
    flight.companion.autopilot.aircraft.ways_down.set_route(route(*COMMANDS))
    if message:
        flight.a.send(mavlink.MAVLink_mission_set_current_message(1, 1, 7))
    else:
        flight.a.command(CURRENT, 7)
    flight.autopilot.waypoint = 7
    flight.wait(3.0)
    assert [entry["text"] for entry in flight.journal("helm")] == ["AUTO: chosen by GCSA"]


def test_the_rules_are_told_what_it_is_and_the_room_that_it_needs(flight: Bench) -> None:
    aircraft = flight.companion.autopilot.aircraft
    assert (aircraft.profile, aircraft.foreign, aircraft.flown) == (QUADPLANE, "", ModeClass.MISSION)
    state = flight.companion.autopilot.messages.autopilot_state()
    assert (state.handling, state.circles_s) == (QUADPLANE.handling, 20.0)
    aircraft.on_message(mavlink.MAVLink_param_value_message(b"WP_LOITER_RAD", 30.0, 9, 900, 0), flight.clock.now)
    assert flight.companion.autopilot.messages.autopilot_state().circles_s == 11.0


def test_without_a_landing_at_the_end_of_a_return_it_does_not_start(bench: Bench, ferry: MissionPackage) -> None:
    stands(bench, ferry, Q_RTL_MODE=0.0)
    bench.connect()
    bench.share(ferry)
    bench.wait(12.0)
    bench.a.command(START)
    bench.run(0.5)
    assert bench.a.acks(START) == [REJECTED]
    assert "a return does not land: it would circle for ever" in bench.a.texts()
    bench.autopilot.parameters["Q_RTL_MODE"] = 1.0
    hear(bench, mavlink.MAVLink_param_value_message(b"Q_RTL_MODE", 1.0, 9, 900, 0))
    bench.run(1.5)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)


def always_armed(bench: Bench, landed: int) -> Bench:
    bench.autopilot = PlaneAutopilot(rotors=True)
    bench.autopilot.parameters["ARMING_REQUIRE"] = 0.0
    bench.autopilot.armed, bench.autopilot.landed_state = True, landed
    bench.load()
    bench.wait(30.0)
    return bench


def test_one_that_is_always_armed_is_told_so(bench: Bench) -> None:
    """The fault: what is armed was not asked for its parameters, so ARMING_REQUIRE 0 was never read."""
    always_armed(bench, mavlink.MAV_LANDED_STATE_ON_GROUND)
    findings = bench.companion.autopilot.preflight.findings
    assert findings is not None
    assert "ARMING_REQUIRE" in [finding.parameter for finding in findings]


def test_but_one_that_flies_is_asked_nothing(bench: Bench) -> None:
    always_armed(bench, mavlink.MAV_LANDED_STATE_IN_AIR)
    assert bench.companion.autopilot.preflight.findings is None


# ---- where a return goes --------------------------------------------------------------------------------------------


def heights(bench: Bench) -> list[float]:
    """Of what the autopilot's rally list holds (m)."""
    return [item.z for item in bench.autopilot.items[mavlink.MAV_MISSION_TYPE_RALLY]]


def test_home_is_in_the_list_at_the_height_of_a_return(ready: Bench) -> None:
    """The fault: at 0 m, and what has wings flies to a rally point at the height that it has there: into the ground."""
    assert heights(ready) == [100.0]


@pytest.mark.parametrize(
    ("parameters", "height_m"),
    [
        ({"RTL_ALTITUDE": 60.0}, 60.0),
        ({"ALT_HOLD_RTL": 8000.0}, 80.0),
        ({"RTL_ALTITUDE": -1.0}, 100.0),
        ({"RTL_ALTITUDE": 150.0, "FENCE_ENABLE": 1.0, "FENCE_TYPE": 1.0, "FENCE_ALT_MAX": 120.0}, 110.0),
    ],
)
def test_that_is_the_autopilots(
    bench: Bench, ferry: MissionPackage, parameters: dict[str, float], height_m: float
) -> None:
    stands(bench, ferry, **parameters)
    bench.connect()
    bench.share(ferry)
    bench.wait(20.0)
    assert heights(bench) == [height_m]


def test_a_place_is_judged_at_the_height_at_which_its_way_ends(ready: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """ArduPlane glides down to the place in the list: a ridge before it is met far below the height of now."""
    places, looked = ready.companion.autopilot.return_site, []
    finder = places.candidates.finder
    look = finder.evaluate
    monkeypatch.setattr(type(finder), "evaluate", lambda _self, *way: looked.append(way[2]) or look(*way))
    lat, lon = ready.autopilot.position or (0.0, 0.0)
    ready.autopilot.position = None
    for _ in range(4):
        place = round(lat * 1e7), round(lon * 1e7), 300_000, 300_000
        hear(ready, mavlink.MAVLink_global_position_int_message(1000, *place, 0, 0, 0, 0))
        ready.run(0.9)
    where = ready.companion.autopilot.aircraft.where
    assert where is not None
    assert where[2] == 300.0
    assert set(looked) == {100.0}


def test_a_plane_is_judged_by_the_landing_sequence_of_the_mission_that_is_flown(bench: Bench) -> None:
    """The fault: by a landing of rotors. The one that dike ships with is 4.6 km from home, the new one 1.5 km away."""
    bench.config.write_text(bench.config.read_text() + '[commands]\nenergy = "off"\nfence = "off"\ncoverage = "off"\n')
    flight = along_the_dike(bench)
    watch = flight.companion.autopilot.return_site

    def home_m() -> float:
        place = watch.candidates.places[0]
        assert place.name == "home"
        return sum(piece.length_m for piece in place.down)

    def home_s() -> float:
        return float(watch.views.seen["home"].fact.time_s)

    assert home_m() == pytest.approx(4630.0, abs=60.0)
    long_s = home_s()
    items = list(flight.companion.autopilot.command_check.ahead.route.upload_items())
    (start,) = (number for number, item in enumerate(items) if item.command == mavlink.MAV_CMD_DO_LAND_START)
    items[start : start + 2] = [replace(items[start], lat_deg=52.6765, lon_deg=5.42)]
    items = [replace(item, seq=number) for number, item in enumerate(items)]
    assert Program(flight, items).send() == mavlink.MAV_MISSION_ACCEPTED
    flight.run(2.0)
    assert home_m() == pytest.approx(3005.0, abs=20.0)
    assert home_s() == pytest.approx(long_s - (4630.0 - 3005.0) / 17.0, abs=6.0)


def test_on_its_way_down_a_plane_is_never_sent_back_for_its_energy(bench: Bench) -> None:
    """It would break its landing off, to fly the same landing once more."""
    flight = along_the_dike(bench)
    watch = flight.companion.autopilot.return_site
    flight.autopilot.battery = 0.2
    flight.autopilot.waypoint = 9
    flight.wait(6.0)
    assert watch.short is False
    flight.autopilot.waypoint = 5
    flight.run(1.5)
    assert watch.short is True


# ---- STOP and CONTINUE --------------------------------------------------------------------------------------------


def test_a_stations_stop_is_a_circle_and_its_continue_the_mission(flight: Bench) -> None:
    flight.a.command(PAUSE, STOP)
    flight.run(0.5)
    assert (flight.autopilot.mode, flight.a.acks(PAUSE)) == (LOITER, [ACCEPTED])
    flight.a.command(PAUSE, CONTINUE)
    flight.run(0.5)
    assert (flight.autopilot.mode, flight.a.acks(PAUSE)) == (AUTO, [ACCEPTED, ACCEPTED])
    assert told(flight) == [(MODE, 1.0, LOITER), (MODE, 1.0, AUTO)]
    assert flight.a.texts() == ""


def test_of_whom_the_circle_is_is_known_where_a_pilot_could_steer(flight: Bench) -> None:
    """Without a word of it the mode that changed would be the pilot's."""
    radio = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    hear(flight, mavlink.MAVLink_sys_status_message(radio, radio, radio, 0, 0, 0, -1, 0, 0, 0, 0, 0, 0))
    flight.run(1.0)
    flight.a.command(PAUSE, STOP)
    flight.wait(3.0)
    helm = flight.companion.arbiter._safety.mode
    assert (helm.radio, helm.flown, helm.chosen_by) == (True, ModeClass.STOP, ModeSource.COMMANDER)


def test_a_partner_stops_nothing(flight: Bench) -> None:
    flight.b.command(PAUSE, STOP)
    flight.run(0.5)
    assert (flight.autopilot.mode, flight.b.acks(PAUSE), told(flight)) == (AUTO, [10], [])


def test_what_cannot_be_stopped_is_answered_with_the_reason(flight: Bench) -> None:
    flight.autopilot.vtol_state = mavlink.MAV_VTOL_STATE_MC
    flight.run(1.0)
    flight.a.command(PAUSE, STOP)
    flight.run(0.5)
    assert flight.a.acks(PAUSE) == [FAILED]
    assert flight.a.texts() == "STOP failed: it hovers: there is no stop before it flies forwards"
    assert told(flight) == []


def test_asked_again_while_it_is_on_its_way_it_is_done_once(flight: Bench) -> None:
    flight.autopilot.script[MODE] = None
    flight.a.command(PAUSE, STOP)
    flight.run(0.3)
    flight.a.command(PAUSE, STOP)
    flight.run(0.3)
    del flight.autopilot.script[MODE]
    flight.run(2.0)
    assert flight.a.acks(PAUSE) == [IN_PROGRESS, ACCEPTED]
    assert flight.autopilot.mode == LOITER


def test_the_opposite_takes_its_place(flight: Bench) -> None:
    flight.autopilot.script[MODE] = None
    flight.a.command(PAUSE, STOP)
    flight.run(0.3)
    del flight.autopilot.script[MODE]
    flight.a.command(PAUSE, CONTINUE)
    flight.run(2.0)
    assert flight.a.acks(PAUSE) == [FAILED, ACCEPTED]
    assert flight.autopilot.mode == AUTO


@pytest.mark.parametrize("which", [2.0, -1.0, float("nan")])
def test_neither_stop_nor_continue_is_denied(flight: Bench, which: float) -> None:
    flight.a.command(PAUSE, which)
    flight.run(0.5)
    assert (flight.a.acks(PAUSE), told(flight)) == ([DENIED], [])


def test_a_way_home_ends_a_stop_that_is_under_way(flight: Bench) -> None:
    flight.autopilot.script[MODE] = None
    flight.a.command(PAUSE, STOP)
    flight.run(0.3)
    flight.companion.autopilot.orders.fly(FlightAction.RETURN, flight.clock.now)
    flight.a.command(PAUSE, STOP)
    flight.run(0.3)
    assert flight.a.acks(PAUSE) == [FAILED, REJECTED]
    del flight.autopilot.script[MODE]
    flight.run(2.0)
    assert flight.autopilot.mode == RTL


def test_a_pilot_who_takes_over_ends_a_stop_that_is_under_way(flight: Bench) -> None:
    """The fault: LOITER was sent again each second until its answer came, over the pilot's mode."""
    flight.autopilot.script[MODE] = None
    flight.a.command(PAUSE, STOP)
    flight.run(0.3)
    flight.autopilot.mode = FBWA
    flight.run(1.0)  # until it beats
    assert flight.a.acks(PAUSE) == [FAILED]
    assert flight.a.texts() == "STOP cancelled: the autopilot is in FBWA now"
    del flight.autopilot.script[MODE]
    flight.wait(10.0)
    assert flight.autopilot.mode == FBWA


def test_on_the_ground_it_is_the_autopilots_to_refuse(ready: Bench) -> None:
    ready.a.command(PAUSE, STOP)
    ready.run(0.5)
    assert ready.a.acks(PAUSE) == [mavlink.MAV_RESULT_UNSUPPORTED]


def test_a_copters_stop_is_its_own(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    bench.share(delivery)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.autopilot.received.clear()
    bench.a.command(PAUSE, STOP)
    bench.run(0.5)
    (passed,) = [m for m in bench.autopilot.got("COMMAND_LONG") if m.command == PAUSE]
    assert (passed.get_srcSystem(), passed.param1) == (251, STOP)
    assert bench.a.acks(PAUSE) == [ACCEPTED]


# ---- what the companion orders ------------------------------------------------------------------------------------


def test_a_hold_of_the_companions_own_is_known_to_be_its_own(flight: Bench) -> None:
    flight.companion.autopilot.orders.fly(FlightAction.HOLD, flight.clock.now)
    flight.wait(3.0)
    helm = flight.companion.arbiter._safety.mode
    assert (flight.autopilot.mode, helm.flown, helm.chosen_by) == (LOITER, ModeClass.STOP, ModeSource.COMPANION)


def test_a_hold_and_a_flight_on_that_the_rules_decide_are_known_to_be_the_companions_own(flight: Bench) -> None:
    """Each order has an event for the rules: the mode that follows is the companion's choice."""
    helm = flight.companion.arbiter._safety.mode
    for action, mode, flown in (
        (FlightAction.HOLD, LOITER, ModeClass.STOP),
        (FlightAction.CONTINUE, AUTO, ModeClass.MISSION),
    ):
        flight.decide(Fly(action, Reason.LINK_QUALITY))
        flight.wait(3.0)
        assert (flight.autopilot.mode, helm.flown, helm.chosen_by) == (mode, flown, ModeSource.COMPANION)


def test_a_circle_around_the_place_is_at_the_place(flight: Bench) -> None:
    flight.autopilot.mode = RTL
    seen = []
    monitor = flight.companion.autopilot.rounds._monitors.mode_and_motion
    update = monitor.update

    def note(state: object, now: float) -> list[object]:
        found = update(state, now)
        seen.extend(found)
        return found

    monitor.update = note
    for away_m in (60, 200):
        hear(flight, mavlink.MAVLink_nav_controller_output_message(0, 0, 0, 0, away_m, 0, 0, 0))
        flight.run(1.5)
    left = [event.left_m for event in seen if type(event).__name__ == "MotionSeen"]
    assert {0.0, 140.0} <= set(left)


@pytest.mark.parametrize("told", [True, False], ids=["by a failsafe", "by nobody"])
def test_what_the_estimators_failsafe_hovers_by_is_never_left(flight: Bench, told: bool) -> None:
    """The fault: in QRTL that is QHOVER, and the return was commanded again, out of it."""
    flight.a.alive = flight.b.alive = False
    flight.until(lambda: flight.autopilot.mode == RTL, 40.0)
    flight.wait(3.0)
    if told:
        hear(flight, mavlink.MAVLink_statustext_message(2, b"EKF variance"))
    flight.autopilot.mode = QHOVER
    flight.wait(20.0)
    assert flight.autopilot.mode == (QHOVER if told else RTL)


def test_a_start_that_is_called_off_does_not_leave_it_in_auto(ready: Bench) -> None:
    """The fault: whoever armed it next made it take off."""
    ready.autopilot.script[ARM] = None
    ready.a.command(START)
    ready.until(lambda: ARM in ready.autopilot.commands())
    ready.a.alive = False
    ready.until(lambda: FAILED in ready.a.acks(START))
    ready.wait(5.0)
    assert (ready.autopilot.mode, ready.autopilot.armed) == (0, False)


def beats_each_second_alone(plane: Any) -> None:
    """As ArduPlane: no heartbeat because of a command."""

    def command(message: Any) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(plane, "beat", lambda: None)
            PlaneAutopilot._command(plane, message)

    plane._command = command


@pytest.mark.parametrize("wait_s", [0.05, 0.5, 1.5])
def test_a_start_right_after_one_that_a_disarm_ended_is_flown_in_auto(ready: Bench, wait_s: float) -> None:
    """The fault: the first START's way out of AUTO went on beside the second START, which armed in MANUAL then."""
    beats_each_second_alone(ready.autopilot)
    ready.autopilot.script[ARM] = None
    ready.a.command(START)
    ready.until(lambda: ARM in ready.autopilot.commands())
    ready.a.command(ARM, 0)
    ready.run(0.05)
    del ready.autopilot.script[ARM]
    ready.run(wait_s)
    ready.a.command(START)
    ready.wait(8.0)
    assert (ready.autopilot.mode, ready.autopilot.armed) == (AUTO, True)
    assert ready.a.acks(START) == [IN_PROGRESS, FAILED, IN_PROGRESS, ACCEPTED]
    assert ready.companion.view.phase is Phase.ON_MISSION


def test_an_arm_right_after_a_start_that_a_disarm_ended_does_not_take_it_off(ready: Bench) -> None:
    """The fault: it was still in AUTO."""
    beats_each_second_alone(ready.autopilot)
    ready.autopilot.script[ARM] = None
    ready.a.command(START)
    ready.until(lambda: ARM in ready.autopilot.commands())
    ready.a.command(ARM, 0)
    ready.run(0.05)
    del ready.autopilot.script[ARM]
    ready.a.command(ARM, 1)
    ready.wait(3.0)
    assert (ready.autopilot.mode, ready.autopilot.armed) == (0, False)
    assert ready.a.acks(ARM) == [REJECTED]
    assert "arm refused: the previous START is still being undone: send it again" in ready.a.texts()
    ready.a.command(ARM, 1)
    ready.wait(3.0)
    assert (ready.autopilot.mode, ready.autopilot.armed) == (0, True)
