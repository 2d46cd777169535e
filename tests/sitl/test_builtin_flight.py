# SPDX-License-Identifier: GPL-3.0-or-later

"""The built-in vehicle flies: arming, modes, missions, failsafes. No sockets, simulated time only."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.builtin.bench import Bench
from sitl.vehicles.builtin.frame import Location, distance_m, offset_ne_m, shift
from sitl.vehicles.builtin.items import Item
from sitl.vehicles.builtin.mission import MissionState
from sitl.vehicles.builtin.navigator import Limits, Navigator
from sitl.vehicles.builtin.physics import Body

READY_S = 11.0
HOME = (526790000, 59240000)
ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
STABILIZE, AUTO, GUIDED, LOITER, RTL, LAND, BRAKE, SMART_RTL = 0, 3, 4, 5, 6, 9, 17, 21
TAKEOFF_20 = Item(22, 3, z=20.0)
HOME_ITEM = Item(16, 0)
GCS = (255, 190)


def ready(parameters: dict[str, float] | None = None) -> Bench:
    bench = Bench(parameters)
    bench.run(READY_S)
    return bench


def waypoint(lat_e7: int, lon_e7: int, alt_m: float = 20.0, delay_s: float = 0.0) -> Item:
    return Item(16, 3, param1=delay_s, x=lat_e7, y=lon_e7, z=alt_m)


def start_mission(bench: Bench, *items: Item) -> None:
    """What the companion does for START: GUIDED, arm, MISSION_START."""
    assert bench.upload([HOME_ITEM, *items]) == ACCEPTED
    assert [bench.command(176, 1, GUIDED), bench.command(400, 1), bench.command(300)] == [ACCEPTED] * 3


def landed(bench: Bench) -> bool:
    return not bench.vehicle.copter.armed


def heartbeat(bench: Bench) -> None:
    bench.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), source=GCS)


def distance_from(bench: Bench, lat_e7: int, lon_e7: int) -> float:
    return distance_m(bench.vehicle.copter.location(), Location(lat_e7, lon_e7, 0.0))


# -- geometry ---------------------------------------------------------------------------------------------------------


def test_a_hundred_metres_north_are_8983_units_of_latitude() -> None:
    assert shift(Location(526790000, 59240000, 0.0), 100.0, 0.0) == (526798983, 59240000)


def test_east_shrinks_with_the_cosine_of_the_latitude() -> None:
    north, east = offset_ne_m(Location(600000000, 0, 0.0), Location(600000000, 10000, 0.0))
    assert north == 0.0
    assert east == pytest.approx(55.66, abs=0.01)


def test_shifting_across_the_date_line_wraps() -> None:
    lat, lon = shift(Location(0, 1799999990, 0.0), 0.0, 10.0)
    assert (lat, lon) == (0, -1799999112)


# -- airframe ---------------------------------------------------------------------------------------------------------


def test_the_velocity_follows_no_faster_than_the_acceleration_limit() -> None:
    body = Body(position=(0.0, 0.0, 50.0))
    for _ in range(100):
        body.drive((10.0, 0.0, 0.0), 2.5, 1.0, 0.01)
    assert body.velocity[0] == pytest.approx(2.5)
    assert body.position[0] == pytest.approx(1.25, abs=0.02)


def test_the_ground_stops_a_descent() -> None:
    body = Body(position=(0.0, 0.0, 0.4), velocity=(0.0, 0.0, -0.5))
    for _ in range(200):
        body.drive((0.0, 0.0, -0.5), 2.5, 1.0, 0.01)
    assert body.position[2] == 0.0
    assert body.velocity == (0.0, 0.0, 0.0)


def test_heading_turns_the_short_way_at_sixty_degrees_a_second() -> None:
    body = Body(heading_deg=350.0)
    body.turn(40.0, 0.5)
    assert body.heading_deg == pytest.approx(20.0)


def test_a_leg_ends_in_a_stop_at_its_destination() -> None:
    navigator, body = Navigator(), Body(position=(0.0, 0.0, 20.0))
    navigator.begin(Limits(), (0.0, 0.0, 20.0))
    navigator.fly_to((100.0, 0.0, 20.0), 0.0)
    fastest = 0.0
    for _ in range(3000):
        body.drive(navigator.update(body.position, 0.01), 5.0, 2.0, 0.01)
        fastest = max(fastest, body.ground_speed_m_s)
    assert navigator.reached
    assert body.position[0] == pytest.approx(100.0, abs=0.1)
    assert body.ground_speed_m_s < 0.05
    assert fastest == pytest.approx(10.0, abs=0.05)


def test_a_known_next_leg_is_entered_without_stopping_and_near_the_corner() -> None:
    navigator, body = Navigator(), Body(position=(0.0, 0.0, 20.0))
    navigator.begin(Limits(), (0.0, 0.0, 20.0))
    navigator.fly_to((100.0, 0.0, 20.0), 0.0)
    navigator.then((100.0, 100.0, 20.0))
    slowest, nearest, turned = math.inf, math.inf, False
    for _ in range(4000):
        body.drive(navigator.update(body.position, 0.01), 5.0, 2.0, 0.01)
        if navigator.reached and not turned:
            turned = True
            navigator.fly_to((100.0, 100.0, 20.0), body.ground_speed_m_s)
        if body.position[0] > 60.0 and body.position[1] < 40.0:
            slowest = min(slowest, body.ground_speed_m_s)
            nearest = min(nearest, math.hypot(body.position[0] - 100.0, body.position[1]))
    assert slowest > 2.0
    assert nearest < 3.0
    assert body.position[1] == pytest.approx(100.0, abs=0.1)


# -- arming -----------------------------------------------------------------------------------------------------------


def test_arming_in_guided_waits_for_a_position() -> None:
    bench = Bench()
    bench.run(3.0)
    assert bench.command(176, 1, GUIDED) == ACCEPTED
    assert bench.command(400, 1) == FAILED
    assert bench.texts()[-1] == "Arm: Need Position Estimate"
    bench.run(READY_S)
    assert bench.command(400, 1) == ACCEPTED


@pytest.mark.parametrize(("mode", "name"), [(AUTO, "AUTO"), (RTL, "RTL"), (LAND, "LAND"), (SMART_RTL, "SMARTRTL")])
def test_modes_that_fly_by_themselves_cannot_be_armed_in(mode: int, name: str) -> None:
    bench = ready()
    bench.vehicle.copter.smart_rtl.remember_home()
    assert bench.command(176, 1, mode) == ACCEPTED
    assert bench.command(400, 1) == FAILED
    assert bench.texts()[-1] == f"Arm: {name} mode not armable"


def test_a_forced_arm_skips_the_checks_but_not_the_position() -> None:
    bench = Bench({"BATT_ARM_VOLT": 13.0})
    bench.run(3.0)
    bench.command(176, 1, GUIDED)
    assert bench.command(400, 1, 21196) == FAILED
    bench.run(READY_S)
    assert bench.command(400, 1) == FAILED
    assert bench.texts()[-1] == "Arm: Battery 1 below minimum arming voltage"
    assert bench.command(400, 1, 21196) == ACCEPTED


def test_without_radio_control_its_failsafe_forbids_arming() -> None:
    bench = ready({"FS_THR_ENABLE": 1})
    bench.command(176, 1, GUIDED)
    assert bench.command(400, 1) == FAILED
    assert bench.texts()[-1] == "Arm: RC not found"


def test_a_station_cannot_disarm_in_flight_except_by_force() -> None:
    bench = ready()
    bench.fly(10.0)
    assert bench.command(400, 0) == FAILED
    assert bench.vehicle.copter.armed
    assert bench.command(400, 0, 21196) == ACCEPTED
    bench.run(5.0)
    assert bench.vehicle.copter.body.on_ground


def test_armed_and_idle_on_the_ground_disarms_after_ten_seconds() -> None:
    bench = ready()
    bench.command(176, 1, GUIDED)
    bench.command(400, 1)
    start_s = bench.now_s
    assert bench.run(15.0, until=lambda: landed(bench))
    assert bench.now_s - start_s == pytest.approx(10.0, abs=0.1)


# -- modes ------------------------------------------------------------------------------------------------------------


def test_rtl_climbs_returns_waits_lands_and_disarms_at_home() -> None:
    bench = ready()
    bench.fly(10.0)
    bench.command(192, 0)  # COMMAND_LONG cannot carry its place
    bench.send(
        dialect.MAVLink_command_int_message(1, 1, 6, 192, 0, 0, -1.0, 1.0, 0.0, 0.0, HOME[0] + 8983, HOME[1], 10.0)
    )
    bench.run(30.0)
    assert distance_from(bench, HOME[0] + 8983, HOME[1]) < 1.0
    assert bench.command(20) == ACCEPTED
    highest, seconds_over_home = 0.0, 0.0

    def watch() -> None:
        nonlocal highest, seconds_over_home
        highest = max(highest, bench.vehicle.copter.above_home_m())
        if distance_from(bench, *HOME) < 1.0 and bench.vehicle.copter.above_home_m() > 14.5:
            seconds_over_home += 0.2

    assert bench.run(150.0, until=lambda: landed(bench), do=watch)
    assert highest == pytest.approx(15.0, abs=0.3)
    assert seconds_over_home >= 5.0
    assert distance_from(bench, *HOME) < 0.5


def test_rtl_prefers_a_rally_point_that_is_nearer_than_home() -> None:
    bench = ready({"RALLY_LIMIT_KM": 0})
    rally = (HOME[0] + 30000, HOME[1])
    assert bench.upload([Item(5100, 3, x=rally[0], y=rally[1], z=25.0)], kind=2) == ACCEPTED
    bench.fly(10.0)
    bench.vehicle.copter.guided.go_to(Location(HOME[0] + 25000, HOME[1], 20.0))
    bench.run(60.0)
    bench.command(20)
    assert bench.run(200.0, until=lambda: landed(bench))
    assert distance_from(bench, *rally) < 0.5


def test_a_rally_point_beyond_the_limit_is_ignored() -> None:
    bench = ready({"RALLY_LIMIT_KM": 0.3})
    assert bench.upload([Item(5100, 3, x=HOME[0] + 40000, y=HOME[1], z=25.0)], kind=2) == ACCEPTED
    target, _ = bench.vehicle.copter.return_target()
    assert (target.lat_e7, target.lon_e7) == HOME


SQUARE = [(-30000, -30000), (30000, -30000), (30000, 30000), (-30000, 30000)]


def corners(command: int, half: int = 30000) -> list[Item]:
    """A square around home, in 1e-7 degrees."""
    places = [(HOME[0] + north * half // 30000, HOME[1] + east * half // 30000) for north, east in SQUARE]
    return [Item(command, 0, 4.0, x=x, y=y) for x, y in places]


@pytest.mark.parametrize(
    ("fence", "parameters", "north", "taken"),
    [
        (corners(5001), {}, 20000, True),
        (corners(5001), {}, 40000, False),
        (corners(5001), {"FENCE_ENABLE": 0}, 40000, True),
        (corners(5001), {"FENCE_TYPE": 3, "FENCE_RADIUS": 1000}, 40000, True),
        ([*corners(5001), *corners(5002, 10000)], {}, 5000, False),
        ([Item(5003, 0, 300.0, x=HOME[0], y=HOME[1])], {}, 20000, True),
        ([Item(5003, 0, 200.0, x=HOME[0], y=HOME[1])], {}, 20000, False),
        ([Item(5004, 0, 50.0, x=HOME[0] + 20000, y=HOME[1])], {}, 20000, False),
        ([], {"FENCE_TYPE": 7, "FENCE_RADIUS": 300}, 40000, False),
        ([], {"FENCE_TYPE": 7, "FENCE_RADIUS": 300}, 20000, True),
        ([], {"FENCE_TYPE": 1, "FENCE_ALT_MAX": 24}, 20000, False),
    ],
)
def test_a_rally_point_outside_an_enabled_fence_is_passed_over_without_a_word(
    fence: list[Item], parameters: dict[str, float], north: int, taken: bool
) -> None:
    on = {"RALLY_LIMIT_KM": 0, "RALLY_INCL_HOME": 0, "FENCE_ENABLE": 1, "FENCE_TYPE": 4}
    bench = ready({**on, **parameters})
    point = (HOME[0] + north, HOME[1])
    assert bench.upload([Item(5100, 3, x=point[0], y=point[1], z=25.0)], kind=2) == ACCEPTED
    assert not fence or bench.upload(fence, kind=1) == ACCEPTED
    target, _ = bench.vehicle.copter.return_target()
    assert (target.lat_e7, target.lon_e7) == (point if taken else HOME)


def test_with_one_point_in_the_list_and_home_left_out_every_return_goes_there() -> None:
    bench = ready({"RALLY_LIMIT_KM": 0, "RALLY_INCL_HOME": 0})
    assert bench.upload([Item(5100, 3, x=HOME[0] + 90000, y=HOME[1], z=25.0)], kind=2) == ACCEPTED
    target, _ = bench.vehicle.copter.return_target()
    assert target.lat_e7 == HOME[0] + 90000


def test_a_return_under_way_reads_no_list_until_it_is_begun_anew() -> None:
    bench = ready({"RALLY_LIMIT_KM": 0, "RALLY_INCL_HOME": 0})
    near, far = (HOME[0] + 15000, HOME[1]), (HOME[0], HOME[1] + 30000)
    assert bench.upload([Item(5100, 3, x=near[0], y=near[1], z=20.0)], kind=2) == ACCEPTED
    bench.fly(20.0)
    bench.command(20)
    bench.run(3.0)
    assert bench.upload([Item(5100, 3, x=far[0], y=far[1], z=20.0)], kind=2) == ACCEPTED
    bench.command(20)
    assert bench.run(100.0, until=lambda: distance_from(bench, *near) < 0.5)
    bench.command(176, 1, 4)
    bench.command(176, 1, 6)
    assert bench.run(200.0, until=lambda: landed(bench))
    assert distance_from(bench, *far) < 0.5


def test_land_descends_fast_then_slowly_and_disarms() -> None:
    bench = ready()
    bench.fly(20.0)
    bench.command(21)
    rates: dict[str, float] = {}

    def watch() -> None:
        height = bench.vehicle.copter.above_home_m()
        if 12.0 < height < 18.0:
            rates["high"] = bench.vehicle.copter.body.velocity[2]
        elif 2.0 < height < 8.0:
            rates["low"] = bench.vehicle.copter.body.velocity[2]

    assert bench.run(60.0, until=lambda: landed(bench), do=watch)
    assert rates == {"high": pytest.approx(-1.5, abs=0.01), "low": pytest.approx(-0.5, abs=0.01)}
    bench.run(1.5)
    statuses = [h.message.system_status for h in bench.heard if h.message.get_type() == "HEARTBEAT"]
    assert [status for i, status in enumerate(statuses) if status != statuses[i - 1] or i == 0] == [1, 3, 4, 3]


def test_smart_rtl_retraces_the_way_it_came() -> None:
    bench = ready()
    bench.fly(10.0)
    guided = bench.vehicle.copter.guided
    for north, east in ((60.0, 0.0), (60.0, 60.0)):
        lat, lon = shift(Location(*HOME, 0.0), north, east)
        guided.go_to(Location(lat, lon, 20.0))
        bench.run(30.0)
    assert bench.command(176, 1, SMART_RTL) == ACCEPTED
    off_path = 0.0

    def watch() -> None:
        nonlocal off_path
        n, e, _ = bench.vehicle.copter.body.position
        off_path = max(off_path, min(abs(e), abs(n - 60.0)))

    assert bench.run(120.0, until=lambda: landed(bench), do=watch)
    assert off_path < 3.0
    assert distance_from(bench, *HOME) < 1.0


def test_smart_rtl_without_a_path_is_refused() -> None:
    bench = Bench()
    assert bench.command(176, 1, SMART_RTL) == FAILED
    assert bench.texts()[-1] == "Mode change to SMARTRTL failed: init failed"


def test_brake_and_loiter_stop_and_hold() -> None:
    bench = ready()
    bench.fly(10.0)
    bench.vehicle.copter.guided.fly_with((5.0, 0.0, 0.0))
    bench.run(2.5)
    for mode in (BRAKE, LOITER):
        assert bench.command(176, 1, mode) == ACCEPTED
        bench.run(6.0)
        assert bench.vehicle.copter.body.ground_speed_m_s == pytest.approx(0.0, abs=0.01)
        assert bench.vehicle.copter.above_home_m() == pytest.approx(10.0, abs=0.6)


def test_an_unknown_mode_and_stabilize_in_flight_are_refused() -> None:
    bench = ready()
    bench.fly(10.0)
    assert bench.command(176, 1, 99) == FAILED
    assert bench.texts()[-1] == "No such mode 99"
    assert bench.command(176, 1, STABILIZE) == FAILED
    assert bench.command(176, 0, RTL) == DENIED
    assert bench.vehicle.copter.mode.number == GUIDED


def test_guided_velocity_stops_when_nobody_repeats_it() -> None:
    bench = ready()
    bench.fly(10.0)
    message = dialect.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 6, 0b0000110111000111, 0, 0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    )
    bench.run(4.0, do=lambda: bench.send(message))
    assert bench.vehicle.copter.body.velocity[1] == pytest.approx(4.0, abs=0.01)
    bench.run(6.0)
    assert bench.vehicle.copter.body.ground_speed_m_s == pytest.approx(0.0, abs=0.01)


def local_target(frame: int, mask: int, place: tuple[float, ...], velocity: tuple[float, ...]) -> object:
    return dialect.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, *place, *velocity, 0.0, 0.0, 0.0, 0.0, 0.0
    )


@pytest.mark.parametrize(
    ("frame", "heading_deg", "expected"),
    [
        pytest.param(1, 90.0, (20.0, 5.0, 15.0), id="from the origin"),
        pytest.param(7, 90.0, (22.0, 8.0, 25.0), id="from the aircraft"),
        pytest.param(9, 90.0, (-3.0, 23.0, 25.0), id="from the aircraft, turned with it"),
    ],
)
def test_guided_flies_to_a_local_place(frame: int, heading_deg: float, expected: tuple[float, ...]) -> None:
    bench = ready()
    bench.fly(10.0)
    copter = bench.vehicle.copter
    copter.guided.go_to(Location(*shift(copter.start, 2.0, 3.0), copter.start.alt_m + 10.0))
    bench.run(10.0)
    copter.body.heading_deg = heading_deg
    bench.send(local_target(frame, 0b1101_1111_1000, (20.0, 5.0, -15.0), (0.0, 0.0, 0.0)))
    bench.run(20.0)
    assert copter.body.position == pytest.approx(expected, abs=0.7)


@pytest.mark.parametrize(("frame", "expected"), [(1, (4.0, 0.0)), (8, (0.0, 4.0))])
def test_guided_flies_with_a_local_velocity(frame: int, expected: tuple[float, float]) -> None:
    bench = ready()
    bench.fly(10.0)
    bench.vehicle.copter.body.heading_deg = 90.0
    bench.send(local_target(frame, 0b1101_1100_0111, (0.0, 0.0, 0.0), (4.0, 0.0, 0.0)))
    bench.run(2.5)
    assert bench.vehicle.copter.body.velocity[:2] == pytest.approx(expected, abs=0.1)


def test_a_local_target_in_another_frame_stops_the_aircraft() -> None:
    bench = ready()
    bench.fly(10.0)
    bench.vehicle.copter.guided.fly_with((4.0, 0.0, 0.0))
    bench.run(1.0)
    bench.send(local_target(6, 0b1101_1100_0111, (0.0, 0.0, 0.0), (4.0, 0.0, 0.0)))
    bench.run(3.0)
    assert bench.vehicle.copter.body.ground_speed_m_s == pytest.approx(0.0, abs=0.05)


def test_take_off_is_refused_disarmed_and_in_flight() -> None:
    bench = ready()
    bench.command(176, 1, GUIDED)
    assert bench.command(22, 0, 0, 0, 0, 0, 0, 10) == FAILED
    bench.fly(10.0)
    assert bench.command(22, 0, 0, 0, 0, 0, 0, 30) == FAILED


# -- mission ----------------------------------------------------------------------------------------------------------


def test_start_takes_off_flies_the_mission_lands_and_disarms() -> None:
    bench = ready()
    corner = (HOME[0] + 8983, HOME[1])
    start_mission(bench, TAKEOFF_20, waypoint(*corner, delay_s=2), Item(21, 3, x=corner[0], y=corner[1] + 5000))
    assert bench.run(200.0, until=lambda: landed(bench))
    reached = [h.message.seq for h in bench.heard if h.message.get_type() == "MISSION_ITEM_REACHED"]
    assert reached == [1, 2]
    assert distance_from(bench, corner[0], corner[1] + 5000) < 0.5
    said = [t for t in bench.texts() if t.startswith(("Mission", "Reached"))]
    assert said[:2] == ["Mission: 1 Takeoff"] * 2
    assert said[2:5] == ["Mission: 2 WP", "Reached command #2", "Mission: 3 Land"]


def test_mission_start_with_item_numbers_is_denied() -> None:
    bench = ready()
    assert bench.upload([HOME_ITEM, TAKEOFF_20]) == ACCEPTED
    assert bench.command(300, 1, 0) == DENIED


def test_auto_needs_a_take_off_first_when_armed_on_the_ground() -> None:
    bench = ready()
    bench.upload([HOME_ITEM, waypoint(HOME[0] + 1000, HOME[1])])
    bench.command(176, 1, GUIDED)
    bench.command(400, 1)
    assert bench.command(300) == FAILED
    assert bench.texts()[-2:] == ["Auto: Missing Takeoff Cmd", "Mode change to AUTO failed: init failed"]


def test_pause_stops_on_the_track_and_continue_goes_on() -> None:
    bench = ready()
    start_mission(bench, TAKEOFF_20, waypoint(HOME[0] + 20000, HOME[1], delay_s=1), Item(20))
    assert bench.command(193, 0) == FAILED  # not while taking off
    bench.run(60.0, until=lambda: bench.vehicle.copter.body.ground_speed_m_s > 9.0)
    assert bench.command(193, 0) == ACCEPTED
    bench.run(8.0)
    assert bench.vehicle.copter.body.ground_speed_m_s < 0.05
    assert bench.vehicle.copter.mission.current == 2
    assert (
        bench.ask(dialect.MAVLink_command_long_message(1, 1, 512, 0, 42, *[0.0] * 6), "MISSION_CURRENT").mission_state
        == 4
    )
    assert bench.command(193, 1) == ACCEPTED
    assert bench.run(60.0, until=lambda: bench.vehicle.copter.mission.current == 3)


def test_jumps_are_counted_and_speed_changes_apply() -> None:
    bench = ready()
    start_mission(
        bench,
        TAKEOFF_20,
        Item(178, 2, param1=1, param2=4.0),
        waypoint(HOME[0] + 4000, HOME[1], delay_s=1),
        waypoint(HOME[0], HOME[1], delay_s=1),
        Item(177, 2, param1=3, param2=1),
        Item(20, 2),
    )
    fastest = 0.0

    def watch() -> None:
        nonlocal fastest
        if bench.vehicle.copter.mission.current < 6:
            fastest = max(fastest, bench.vehicle.copter.body.ground_speed_m_s)

    assert bench.run(300.0, until=lambda: landed(bench), do=watch)
    assert [t for t in bench.texts() if t.startswith("Reached")] == ["Reached command #3", "Reached command #4"] * 2
    assert bench.texts().count("Mission: 5 Jump 1/1") == 1
    assert fastest == pytest.approx(4.0, abs=0.05)


@pytest.mark.parametrize(("action", "text"), [(0, "Gripper Released"), (1, "Gripper Grabbed")])
def test_a_gripper_is_worked_when_the_waypoint_before_it_is_done(action: int, text: str) -> None:
    """ArduCopter: AP_Mission::start_command_do_gripper. It says so whether or not a gripper is fitted, and it announces
    only the waypoint as reached."""
    bench = ready()
    there = waypoint(HOME[0] + 2000, HOME[1], delay_s=3)
    start_mission(bench, TAKEOFF_20, there, Item(211, 2, param1=1, param2=action), Item(20, 2))
    assert bench.run(200.0, until=lambda: bench.vehicle.copter.mission.current == 4)
    said = [each for each in bench.texts() if each.startswith(("Gripper", "Reached", "Mission: 3"))]
    assert said == ["Reached command #2", "Mission: 3 Gripper", text]
    assert [h.message.seq for h in bench.heard if h.message.get_type() == "MISSION_ITEM_REACHED"] == [1, 2]


def test_leaving_auto_stops_the_mission_and_coming_back_resumes_it() -> None:
    bench = ready()
    start_mission(bench, TAKEOFF_20, waypoint(HOME[0] + 20000, HOME[1]), waypoint(HOME[0] + 20000, HOME[1] + 9000))
    bench.run(60.0, until=lambda: bench.vehicle.copter.body.ground_speed_m_s > 9.0)
    bench.command(176, 1, BRAKE)
    assert bench.vehicle.copter.mission.state is MissionState.STOPPED
    bench.run(5.0)
    bench.command(176, 1, AUTO)
    assert bench.vehicle.copter.mission.current == 2
    assert bench.run(60.0, until=lambda: bench.vehicle.copter.mission.current == 3)


def test_a_mission_that_changes_in_flight_restarts_its_leg() -> None:
    bench = ready()
    start_mission(bench, TAKEOFF_20, waypoint(HOME[0] + 20000, HOME[1], delay_s=1))
    bench.run(60.0, until=lambda: bench.vehicle.copter.body.ground_speed_m_s > 9.0)
    assert bench.upload([HOME_ITEM, TAKEOFF_20, waypoint(HOME[0] + 10000, HOME[1] + 9000, delay_s=1)]) == ACCEPTED
    bench.run(60.0)
    assert "Auto mission changed, restarted command" in bench.texts()
    assert distance_from(bench, HOME[0] + 10000, HOME[1] + 9000) < 0.5


def test_a_mission_that_ends_in_the_air_hovers() -> None:
    bench = ready()
    start_mission(bench, TAKEOFF_20, waypoint(HOME[0] + 4000, HOME[1]))
    bench.run(60.0, until=lambda: bench.vehicle.copter.mission.state is MissionState.COMPLETE)
    bench.run(10.0)
    assert bench.vehicle.copter.armed
    assert bench.vehicle.copter.above_home_m() == pytest.approx(20.0, abs=0.2)
    assert bench.vehicle.copter.body.ground_speed_m_s < 0.05


def test_the_same_flight_twice_is_the_same_flight() -> None:
    positions = []
    for _ in range(2):
        bench = ready()
        start_mission(bench, TAKEOFF_20, waypoint(HOME[0] + 5000, HOME[1] + 3000), Item(20))
        bench.run(40.0)
        positions.append((bench.vehicle.copter.body.position, bench.vehicle.copter.body.heading_deg, len(bench.heard)))
    assert positions[0] == positions[1]


# -- failsafes --------------------------------------------------------------------------------------------------------


def test_the_station_failsafe_needs_a_first_heartbeat_and_then_sends_home() -> None:
    bench = ready({"FS_GCS_ENABLE": 1, "FS_OPTIONS": 0})
    bench.fly(10.0)
    bench.run(20.0)
    assert bench.vehicle.copter.mode.number == GUIDED
    bench.run(4.0, do=lambda: heartbeat(bench), every_s=1.0)
    lost_s = bench.now_s
    assert bench.run(10.0, until=lambda: bench.vehicle.copter.mode.number == RTL)
    assert 4.0 <= bench.now_s - lost_s <= 5.4
    assert bench.vehicle.copter.reason == 5
    assert bench.texts()[-1] == "GCS Failsafe"
    heartbeat(bench)
    bench.run(1.0)
    assert bench.texts()[-1] == "GCS Failsafe Cleared"
    assert bench.vehicle.copter.mode.number == RTL


def test_heartbeats_of_another_station_do_not_feed_the_failsafe() -> None:
    bench = ready({"FS_GCS_ENABLE": 1, "FS_OPTIONS": 0, "MAV_GCS_SYSID": 252})
    bench.fly(10.0)
    bench.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), source=(252, 190))
    assert bench.run(10.0, until=lambda: bench.vehicle.copter.mode.number == RTL, do=lambda: heartbeat(bench))


def test_the_mission_goes_on_without_a_station_when_the_options_say_so() -> None:
    bench = ready({"FS_GCS_ENABLE": 1, "FS_OPTIONS": 2})
    start_mission(bench, TAKEOFF_20, waypoint(HOME[0] + 20000, HOME[1]))
    bench.run(12.0)
    heartbeat(bench)
    bench.run(8.0)
    assert bench.texts()[-1] == "GCS Failsafe - Continuing Auto Mode"
    assert bench.vehicle.copter.mode.number == AUTO


def test_on_the_ground_the_station_failsafe_disarms_and_forbids_arming() -> None:
    bench = ready({"FS_GCS_ENABLE": 1, "FS_OPTIONS": 0, "DISARM_DELAY": 0})
    bench.command(176, 1, GUIDED)
    bench.command(400, 1)
    heartbeat(bench)
    bench.run(7.0)
    assert landed(bench)
    assert "GCS Failsafe - Disarming" in bench.texts()
    assert bench.command(400, 1) == FAILED
    assert bench.texts()[-1] == "Arm: GCS failsafe on"


def test_low_voltage_for_ten_seconds_lands_after_a_pause() -> None:
    bench = ready({"BATT_FS_LOW_ACT": 1})
    bench.fly(10.0)
    bench.send(dialect.MAVLink_param_set_message(1, 1, b"SIM_BATT_VOLTAGE", 10.2, 9))
    start_s = bench.now_s
    assert bench.run(15.0, until=lambda: bench.vehicle.copter.mode.number == LAND)
    assert bench.now_s - start_s == pytest.approx(10.4, abs=0.4)
    assert bench.vehicle.copter.reason == 4
    bench.run(3.5)
    assert bench.vehicle.copter.body.velocity[2] == pytest.approx(0.0, abs=0.01)
    assert bench.run(60.0, until=lambda: landed(bench))
    assert bench.command(176, 1, GUIDED) == ACCEPTED
    assert bench.command(400, 1) == FAILED


def test_a_used_up_capacity_is_critical_at_once() -> None:
    bench = ready({"BATT_CAPACITY": 200, "BATT_CRT_MAH": 50, "BATT_FS_CRT_ACT": 2})
    bench.fly(10.0)
    assert bench.run(30.0, until=lambda: bench.vehicle.copter.mode.number == RTL)
    assert bench.texts()[-2].startswith("Battery 1 is critical 12.60V used 15")
