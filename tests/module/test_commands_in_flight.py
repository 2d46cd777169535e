# SPDX-License-Identifier: GPL-3.0-or-later

"""The commander's commands in flight, judged by the situation; the delivery mission, with the aircraft in zone A.

Its fence is a box around both zones; 52.70 N lies north of it, 52.6823 N inside it and outside every zone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.safety.commands import Limit
from mavproxy_handover.core.safety.energy import EnergyFact
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.package import MissionPackage, load
from mavproxy_handover.mission.return_paths import PlaceFinder
from tests.module.conftest import Bench
from tests.module.test_rally_list import clear, result, send, upload
from tests.module.vehicle import AUTO, HOME, PlaneAutopilot
from tests.packages import MISSIONS

START, SET_MODE, PAUSE = (
    mavlink.MAV_CMD_MISSION_START,
    mavlink.MAV_CMD_DO_SET_MODE,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE,
)
REPOSITION, SPEED = mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_CMD_DO_CHANGE_SPEED
ACCEPTED, REJECTED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED
OUT_OF_FENCE, OUT_OF_ZONES = (52.70, 5.924), (52.6823, 5.924)
GUIDED, LOITER, RTL, LAND, BRAKE = 4, 5, 6, 9, 17


def take_off(bench: Bench, package: MissionPackage, commands: str = "") -> Bench:
    bench.config.write_text(bench.config.read_text() + f"\n[commands]\n{commands}\n")
    bench.connect()
    bench.share(package, at_once=True)
    bench.wait(2.0)
    bench.a.command(START)
    bench.autopilot.waypoint = 2
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.wait(2.0)
    bench.autopilot.received.clear()
    bench.a.received.clear()
    return bench


@pytest.fixture
def flown(bench: Bench, delivery: MissionPackage) -> Bench:
    return take_off(bench, delivery)


def fly_to(bench: Bench, place: tuple[float, float], alt_m: float = 40.0) -> None:
    """DO_REPOSITION of the commander."""
    lat, lon = round(place[0] * 1e7), round(place[1] * 1e7)
    message = mavlink.MAVLink_command_int_message(1, 1, 3, REPOSITION, 0, 0, -1, 1, 0, 0, lat, lon, alt_m)
    bench.a.send(message)
    bench.run(0.3)


def passed(bench: Bench, kind: str = "COMMAND_INT") -> int:
    """Messages of the commander that have arrived at the autopilot."""
    return len(bench.autopilot.got(kind, 251))


# ---- what is refused, and how that is lifted ----------------------------------------------------------------------


def test_a_target_in_the_zone_passes(flown: Bench) -> None:
    fly_to(flown, (52.6785, 5.9240))
    assert passed(flown) == 1
    assert flown.a.acks(REPOSITION) == []  # the autopilot of this bench knows no COMMAND_INT: its answer is its own
    assert flown.a.texts() == ""


@pytest.mark.parametrize(
    ("place", "limit", "words"),
    [
        (OUT_OF_FENCE, "fence", "target refused: breaks the geofence within 2337 m"),
        (OUT_OF_ZONES, "coverage", "target refused: leaves coverage in "),
    ],
    ids=["fence", "coverage"],
)
def test_a_target_outside_is_answered_with_the_reason(
    flown: Bench, place: tuple[float, float], limit: str, words: str
) -> None:
    fly_to(flown, place)
    assert passed(flown) == 0
    assert flown.a.acks(REPOSITION) == [REJECTED]
    assert flown.a.texts().startswith(words)
    assert flown.a.texts().endswith(f". To insist, send it again after 10 s, or type 'handover override {limit}'")
    (entry,) = flown.journal("command_refused")
    assert (entry["station"], entry["limits"]) == ("GCSA", [limit])
    (refused,) = flown.journal("refused")
    assert refused["reason"] == "it would leave energy, fence or coverage"


def test_sent_again_after_ten_seconds_it_is_carried_out_and_journalled(flown: Bench) -> None:
    fly_to(flown, OUT_OF_ZONES)
    flown.wait(4.0)
    fly_to(flown, OUT_OF_ZONES)
    assert (passed(flown), flown.a.acks(REPOSITION)) == (0, [REJECTED, REJECTED])
    flown.wait(10.0)
    fly_to(flown, OUT_OF_ZONES)
    assert passed(flown) == 1
    (entry,) = flown.journal("command_passed")
    assert (entry["station"], entry["limits"], entry["outcome"]) == ("GCSA", ["coverage"], "lifted")


@pytest.mark.parametrize("pause_s", [3.05, 3.2, 3.5])
def test_a_program_that_gets_no_answer_lifts_nothing_by_sending_again(flown: Bench, pause_s: float) -> None:
    """The fault: COMMAND_INT has no counter, and the second or third copy was carried out."""
    for _copy in range(6):
        fly_to(flown, OUT_OF_ZONES)
        flown.run(pause_s - 0.3)
    assert passed(flown) == 0
    assert flown.a.acks(REPOSITION) == [REJECTED] * 6


def test_a_repetition_by_its_counter_is_never_carried_out(flown: Bench) -> None:
    place = (0.0, 1.0, 0.0, 0.0, *OUT_OF_ZONES, 40.0)
    for confirmation in range(5):
        flown.a.send(mavlink.MAVLink_command_long_message(1, 1, REPOSITION, confirmation, *place))
        flown.wait(12.0)
    assert passed(flown, "COMMAND_LONG") == 0
    assert flown.a.acks(REPOSITION) == [REJECTED] * 5


def test_the_other_form_of_the_same_command_is_a_copy(flown: Bench) -> None:
    fly_to(flown, OUT_OF_ZONES)
    flown.wait(6.0)
    place = (-1.0, 1.0, 0.0, 0.0, *OUT_OF_ZONES, 40.0)
    flown.a.send(mavlink.MAVLink_command_long_message(1, 1, REPOSITION, 0, *place))
    flown.wait(6.0)
    fly_to(flown, OUT_OF_ZONES)
    assert passed(flown) == 0
    flown.wait(10.0)
    flown.a.send(mavlink.MAVLink_command_long_message(1, 1, REPOSITION, 0, *place))
    flown.run(0.3)
    assert passed(flown, "COMMAND_LONG") == 1


def test_copies_that_an_interruption_of_the_link_has_held_back_insist_on_nothing(flown: Bench) -> None:
    fly_to(flown, OUT_OF_ZONES)
    flown.wait(3.0)
    flown.a.alive = False
    flown.wait(4.5)
    flown.a.alive = True
    flown.wait(3.0)
    fly_to(flown, OUT_OF_ZONES)
    assert passed(flown) == 0
    flown.wait(10.0)
    fly_to(flown, OUT_OF_ZONES)
    assert passed(flown) == 1


def test_an_operator_who_sends_it_again_too_soon_is_told_again(flown: Bench) -> None:
    fly_to(flown, OUT_OF_ZONES)
    flown.run(2.0)
    fly_to(flown, OUT_OF_ZONES)
    assert flown.a.texts().count("target refused") == 1
    flown.wait(6.0)
    fly_to(flown, OUT_OF_ZONES)
    assert flown.a.texts().count("target refused") == 2


def override(bench: Bench, limit: int, station: Any = None, nonce: int = 7) -> int:
    """HANDOVER_OVERRIDE of a station (GCSA); the seconds of the answer."""
    station = station or bench.a
    before = len(station.got("HANDOVER_OVERRIDE"))
    station.send(mavlink.MAVLink_handover_override_message(1, 191, 1, limit, nonce, 0))
    bench.run(0.3)
    (answer,) = station.got("HANDOVER_OVERRIDE")[before:]
    assert (answer.vehicle, answer.limit, answer.nonce) == (1, limit, nonce)
    return int(answer.seconds)


def test_the_commanders_override_lifts_one_limit_for_a_minute(flown: Bench) -> None:
    assert override(flown, mavlink.HANDOVER_LIMIT_COVERAGE) == 60
    fly_to(flown, OUT_OF_ZONES)
    assert passed(flown) == 1
    fly_to(flown, OUT_OF_FENCE)
    assert passed(flown) == 1, "the fence was not lifted"
    (entry,) = flown.journal("override")
    assert (entry["by"], entry["limit"], entry["for_s"]) == ("GCSA", "coverage", 60)
    flown.wait(30.0)
    assert override(flown, mavlink.HANDOVER_LIMIT_COVERAGE) == 29, "a copy lifts nothing anew"
    flown.wait(31.0)
    fly_to(flown, OUT_OF_ZONES)
    assert passed(flown) == 1


def test_another_limit_under_the_same_number_is_no_copy(flown: Bench) -> None:
    assert override(flown, mavlink.HANDOVER_LIMIT_FENCE) == 60
    assert override(flown, mavlink.HANDOVER_LIMIT_COVERAGE) == 60
    assert [entry["limit"] for entry in flown.journal("override")] == ["fence", "coverage"]


@pytest.mark.parametrize("limit", [0, 4, 255])
def test_a_limit_that_is_none_is_refused(flown: Bench, limit: int) -> None:
    assert override(flown, limit) == 0
    assert flown.journal("override") == []


def test_of_who_does_not_command_an_override_is_refused(flown: Bench) -> None:
    assert override(flown, mavlink.HANDOVER_LIMIT_COVERAGE, flown.b) == 0
    fly_to(flown, OUT_OF_ZONES)
    assert passed(flown) == 0


def test_at_the_vehicles_console_too(flown: Bench) -> None:
    flown.mpstate.type("handover override fence")
    assert any("lifted    fence, 60 s yet" in line for line in flown.mpstate.type("handover status"))
    (entry,) = flown.journal("override")
    assert entry["by"] == "the vehicle's console"


def test_what_was_lifted_ends_when_authority_moves(flown: Bench) -> None:
    override(flown, mavlink.HANDOVER_LIMIT_COVERAGE)
    flown.a.alive = False
    flown.until(lambda: flown.companion.view.commander != 251)
    flown.a.alive = True
    flown.until(lambda: flown.companion.view.commander == 251)
    fly_to(flown, OUT_OF_ZONES)
    assert passed(flown) == 0


@pytest.mark.parametrize(
    ("policy", "arrives", "told"), [("warn", 1, "warning"), ("off", 1, ""), ("refuse", 0, "refused")]
)
def test_the_policy_is_the_configurations(
    bench: Bench, delivery: MissionPackage, policy: str, arrives: int, told: str
) -> None:
    take_off(bench, delivery, f'coverage = "{policy}"')
    fly_to(bench, OUT_OF_ZONES)
    assert passed(bench) == arrives
    assert (told in bench.a.texts()) if told else bench.a.texts() == ""


def test_a_warning_is_told_though_another_limit_is_lifted(bench: Bench, delivery: MissionPackage) -> None:
    take_off(bench, delivery, 'coverage = "warn"')
    bench.companion.autopilot.command_check.lift(Limit.FENCE, "GCSA", bench.clock.now)
    fly_to(bench, OUT_OF_FENCE)
    assert passed(bench) == 1
    assert "target, warning: leaves coverage in " in bench.a.texts()
    assert "geofence" not in bench.a.texts(), "the operator has lifted it, and knows"
    (entry,) = bench.journal("command_passed")
    assert (entry["limits"], entry["outcome"]) == (["fence", "coverage"], "lifted")


# ---- never refused ------------------------------------------------------------------------------------------------


def test_what_leads_away_from_danger_is_never_refused(flown: Bench) -> None:
    """Far outside everything, with an empty battery."""
    flown.autopilot.position = (53.5, 5.9)
    flown.autopilot.battery = 0.0
    flown.run(2.0)
    for mode in (GUIDED, LOITER, RTL, LAND, BRAKE, 0, 2, 16, 21):
        flown.a.command(SET_MODE, 1, mode)
        flown.run(0.3)
    for command in (mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_LOITER_UNLIM):
        flown.a.command(command)
        flown.run(0.3)
    flown.a.command(PAUSE, 0)
    flown.run(0.3)
    assert passed(flown, "COMMAND_LONG") == 13
    assert REJECTED not in [m.result for m in flown.a.got("COMMAND_ACK")]


# ---- the mission goes on ------------------------------------------------------------------------------------------


def test_auto_and_continue_pass_where_the_mission_stays_inside(flown: Bench) -> None:
    flown.a.command(SET_MODE, 1, AUTO)
    flown.a.command(PAUSE, 1)
    flown.a.send(mavlink.MAVLink_mission_set_current_message(1, 1, 4))
    flown.run(0.5)
    assert (passed(flown, "COMMAND_LONG"), passed(flown, "MISSION_SET_CURRENT")) == (2, 1)


@pytest.mark.parametrize(
    ("lon", "words", "commands"),
    [
        (5.9270, "AUTO refused: leaves coverage in ", (SET_MODE, PAUSE)),
        # there it is in RTL, where CONTINUE does nothing
        (5.9300, "AUTO refused: leads out of coverage (item 8)", (SET_MODE,)),
    ],
    ids=["about to leave", "outside already"],
)
def test_a_mission_that_goes_on_over_the_zone_of_a_dead_station_is_refused(
    flown: Bench, lon: float, words: str, commands: Sequence[int]
) -> None:
    """GCSB is gone; the way to item 8 lies in its zone, and GCSA's ends at 5.9283."""
    flown.b.alive = False
    flown.wait(8.0)
    flown.autopilot.position = (52.6784, lon)
    flown.autopilot.waypoint = 8
    flown.run(1.5)
    flown.a.received.clear()
    for command in commands:
        flown.autopilot.mode = AUTO
        flown.run(1.5)
        flown.a.command(command, 1, AUTO)
        flown.run(0.5)
        assert flown.a.acks(command) == [REJECTED]
        assert words.replace("AUTO", {SET_MODE: "AUTO", PAUSE: "CONTINUE"}[command]) in flown.a.texts()


def test_the_older_ways_are_answered_in_their_own_protocol(flown: Bench) -> None:
    far = mavlink.MAVLink_mission_item_int_message(1, 1, 0, 3, 16, 2, 1, 0, 0, 0, 0, 527600000, 59000000, 40, 0)
    flown.a.received.clear()
    flown.a.send(far)
    flown.run(0.3)
    (ack,) = flown.a.got("MISSION_ACK")
    assert ack.type == mavlink.MAV_MISSION_DENIED
    assert "target refused" in flown.a.texts()


# ---- streams ------------------------------------------------------------------------------------------------------


def target(place: tuple[float, float]) -> Any:
    lat, lon = round(place[0] * 1e7), round(place[1] * 1e7)
    return mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 6, 0b110111111000, lat, lon, 40.0, 0, 0, 0, 0, 0, 0, 0, 0
    )


def test_a_stream_of_targets_outside_is_dropped_and_told_once_in_a_while(flown: Bench) -> None:
    flown.wait(3.0)  # what ran before the flight would not count
    for _ in range(200):
        flown.a.send(target(OUT_OF_ZONES))
        flown.run(0.05)
    assert passed(flown, "SET_POSITION_TARGET_GLOBAL_INT") == 0
    assert flown.a.texts().count("target refused: leaves coverage") == 1
    assert "insist" not in flown.a.texts(), "a stream lifts nothing"
    assert flown.a.texts().endswith(". To lift it, type 'handover override coverage'")
    flown.a.send(target((52.6785, 5.9240)))
    flown.run(0.3)
    assert passed(flown, "SET_POSITION_TARGET_GLOBAL_INT") == 1


@pytest.mark.parametrize(
    ("frame", "north_m", "arrives"), [(1, 50.0, 1), (1, 3000.0, 0), (7, 50.0, 1), (7, 3000.0, 0), (9, 3000.0, 0)]
)
def test_local_targets_are_places_too(flown: Bench, frame: int, north_m: float, arrives: int) -> None:
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, 0b110111111000, north_m, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    flown.a.send(message)
    flown.run(0.3)
    assert passed(flown, "SET_POSITION_TARGET_LOCAL_NED") == arrives


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e30])
def test_a_target_that_is_no_place_is_the_autopilots_to_refuse(flown: Bench, value: float) -> None:
    fly_to(flown, HOME, value)
    place = (0.0, 1.0, 0.0, 0.0, value, value, value)
    flown.a.send(mavlink.MAVLink_command_long_message(1, 1, REPOSITION, 0, *place))
    flown.run(0.3)
    assert flown.companion.faults == {}


# ---- after another system -----------------------------------------------------------------------------------------


def test_to_follow_another_system_is_refused_for_nobody_knows_where_it_leads(flown: Bench) -> None:
    for send_mode in (
        lambda: flown.a.send(mavlink.MAVLink_set_mode_message(1, 1, 23)),
        lambda: flown.a.command(SET_MODE, 1.0, 23.0),
    ):
        send_mode()
        flown.run(0.3)
    assert passed(flown, "SET_MODE") == passed(flown, "COMMAND_LONG") == 0
    words = (
        "FOLLOW refused: where it leads is not known. "
        "To insist, send it again after 10 s, or type 'handover override coverage'"
    )
    assert flown.a.texts() == words
    flown.wait(10.0)
    flown.a.command(SET_MODE, 1.0, 23.0)
    flown.run(0.3)
    assert passed(flown, "COMMAND_LONG") == 1


def test_the_system_that_is_followed_leads_out_of_no_zone(flown: Bench) -> None:
    flown.wait(3.0)
    zeros = [0.0, 0.0, 0.0]
    for place, arrives in ((OUT_OF_ZONES, 0), ((52.6785, 5.9240), 1)):
        lat, lon = round(place[0] * 1e7), round(place[1] * 1e7)
        flown.a.send(
            mavlink.MAVLink_follow_target_message(0, 1, lat, lon, 40.0, zeros, zeros, [1, 0, 0, 0], zeros, zeros, 0)
        )
        flown.run(0.3)
        assert passed(flown, "FOLLOW_TARGET") == arrives
    assert flown.a.texts().startswith("target refused: leaves coverage in ")


# ---- wings --------------------------------------------------------------------------------------------------------

CHANGE_ALTITUDE, GUIDED_ALTITUDE, GUIDED_HEADING = mavlink.MAV_CMD_DO_CHANGE_ALTITUDE, 43001, 43002
GUIDED_ON_WINGS, LOITER_ON_WINGS = 15, 12
#: the zone of GCSA: its middle, and its radius (m); the mission has no geofence
STRIP, STRIP_M = (52.693595, 5.411108), 3200.0
CEILING = "climbs above the fence's ceiling of 250 m"


def along_the_dike(bench: Bench, **parameters: float) -> Bench:
    """A plane without rotors, WP_LOITER_RAD 90; its mission counts on 80."""
    plane = bench.autopilot = PlaneAutopilot()
    plane.position, plane.way_down = (52.69, 5.42), 9
    plane.parameters |= {"RTL_AUTOLAND": 1.0, "ARMING_REQUIRE": 1.0, "WP_LOITER_RAD": 90.0}
    plane.parameters |= {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 1.0, "FENCE_ALT_MAX": 250.0, **parameters}
    bench.connect()
    bench.share(load(MISSIONS / "dike"), at_once=True)
    bench.wait(12.0)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    plane.waypoint, plane.position = 2, (52.70, 5.42)
    bench.wait(4.0)
    plane.received.clear()
    bench.a.received.clear()
    return bench


@pytest.fixture
def dike(bench: Bench) -> Bench:
    return along_the_dike(bench)


def circles(bench: Bench, inside_m: float, radius_m: float = 0.0, alt_m: float = 100.0) -> bool:
    """DO_REPOSITION to a place so far inside the western border of the zone: whether it passes."""
    lat, lon = offset(*STRIP, inside_m - STRIP_M, 0.0)
    place = round(lat * 1e7), round(lon * 1e7), alt_m
    before = passed(bench)
    bench.a.send(mavlink.MAVLink_command_int_message(1, 1, 3, REPOSITION, 0, 0, -1, 1, radius_m, 0, *place))
    bench.run(0.3)
    return passed(bench) > before


@pytest.mark.parametrize(
    ("inside_m", "radius_m", "words"),
    [
        (115.0, 0.0, ""),
        (85.0, 0.0, "leaves coverage in "),
        (10.0, 0.0, "leaves coverage in "),
        (-50.0, 0.0, "leaves coverage in "),
        (210.0, 200.0, ""),
        (190.0, 200.0, "leaves coverage in "),
        (300.0, 3000.0, "leaves coverage in "),
        (115.0, -3000.0, ""),  # ArduPlane takes no such radius
    ],
)
def test_a_target_of_wings_is_judged_as_the_circle_that_is_flown_there(
    dike: Bench, inside_m: float, radius_m: float, words: str
) -> None:
    """The fault: 10 m inside the border, or anywhere with a radius of 3 km, it passed as a place."""
    assert circles(dike, inside_m, radius_m) is (words == "")
    assert dike.a.texts().startswith(words and f"target refused: {words}")
    assert dike.companion.faults == {}


def test_the_radius_of_before_is_flown_on_in_guided(dike: Bench) -> None:
    """ArduPlane forgets it when it enters GUIDED anew, and not before."""
    assert circles(dike, 1000.0, 800.0)
    dike.autopilot.mode = GUIDED_ON_WINGS
    dike.run(1.5)
    assert not circles(dike, 300.0)
    assert circles(dike, 300.0, 200.0)
    assert circles(dike, 300.0)
    assert not circles(dike, 115.0)
    dike.autopilot.mode = LOITER_ON_WINGS
    dike.run(1.5)
    assert circles(dike, 115.0)


def test_what_hovers_is_judged_by_its_circle_too_for_it_flies_there_on_its_wings(dike: Bench) -> None:
    dike.autopilot.vtol_state = mavlink.MAV_VTOL_STATE_MC
    dike.run(1.5)
    assert not circles(dike, 10.0)


def test_above_the_ceiling_of_the_fence_no_target_of_wings_passes(dike: Bench) -> None:
    assert circles(dike, 1000.0, alt_m=250.0)
    assert not circles(dike, 1000.0, alt_m=251.0)
    assert (
        dike.a.texts()
        == f"target refused: {CEILING}. To insist, send it again after 10 s, or type 'handover override fence'"
    )


@pytest.mark.parametrize("command", [CHANGE_ALTITUDE, GUIDED_ALTITUDE])
@pytest.mark.parametrize(
    ("alt_m", "words"), [(200.0, ""), (600.0, f"altitude refused: {CEILING}"), (5000.0, "altitude refused: ")]
)
def test_a_height_alone_is_judged(dike: Bench, command: int, alt_m: float, words: str) -> None:
    """The fault: nobody looked at it, ArduPlane itself no more than the companion."""
    dike.a.command(command, alt_m, 3.0, 0.0, 0.0, 0.0, 0.0, alt_m)
    dike.run(0.3)
    assert passed(dike, "COMMAND_LONG") == (0 if words else 1)
    assert dike.a.texts().startswith(words)
    assert words or dike.a.texts() == ""


@pytest.mark.parametrize(("alt_m", "words"), [(200.0, ""), (600.0, f"altitude refused: {CEILING}")])
def test_the_height_of_a_mission_item_that_is_a_height_alone_is_judged(dike: Bench, alt_m: float, words: str) -> None:
    """Mission Planner's Change Alt. The fault: it was taken for a part of an upload, and swallowed without a word."""
    place = round(52.70 * 1e7), round(5.42 * 1e7), alt_m
    dike.a.send(mavlink.MAVLink_mission_item_int_message(1, 1, 0, 3, 16, 3, 1, 0, 0, 0, 0, *place, 0))
    dike.run(0.3)
    assert passed(dike, "MISSION_ITEM_INT") == (0 if words else 1)
    assert dike.a.texts().startswith(words)
    assert words or dike.a.texts() == ""


def test_a_height_above_the_sea_is_one_above_home(dike: Bench) -> None:
    """Here the sea is 300 m below home."""
    place = round(52.70 * 1e7), round(5.42 * 1e7), 400_000, 100_000
    dike.autopilot.position = None
    for above_sea_m, arrives in ((500.0, 1), (600.0, 1)):
        dike.autopilot.say(mavlink.MAVLink_global_position_int_message(1000, *place, 0, 0, 0, 0))
        dike.mpstate.deliver(dike.autopilot._out.pop())
        dike.a.command(CHANGE_ALTITUDE, above_sea_m, 0.0)
        dike.run(0.3)
        assert passed(dike, "COMMAND_LONG") == arrives


def test_a_height_without_a_ceiling_is_judged_by_the_energy(bench: Bench) -> None:
    dike = along_the_dike(bench, FENCE_TYPE=4.0)
    for alt_m, arrives in ((600.0, 1), (5000.0, 1)):
        dike.a.command(CHANGE_ALTITUDE, alt_m, 3.0)
        dike.run(0.3)
        assert passed(dike, "COMMAND_LONG") == arrives
    assert "Wh are needed with the reserve" in dike.a.texts()


def test_beside_a_border_another_height_is_no_matter(dike: Bench) -> None:
    """It flies on where it was about to, and no circle of its own for it."""
    dike.autopilot.position = offset(*STRIP, 20.0 - STRIP_M, 0.0)
    dike.run(1.0)
    dike.autopilot.received.clear()
    dike.a.command(CHANGE_ALTITUDE, 120.0, 3.0)
    dike.run(0.3)
    assert CHANGE_ALTITUDE in [m.command for m in dike.autopilot.got("COMMAND_LONG", 251)]


@pytest.mark.parametrize(("alt_m", "arrives"), [(200.0, 1), (5000.0, 0)])
def test_a_height_in_a_stream_is_judged(dike: Bench, alt_m: float, arrives: int) -> None:
    dike.wait(3.0)
    zeros = (0, 0, 0, 0, 0, 0, 0, 0)
    dike.a.send(mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, 6, 0b110111111011, 0, 0, alt_m, *zeros))
    dike.run(0.3)
    assert passed(dike, "SET_POSITION_TARGET_GLOBAL_INT") == arrives


def test_a_heading_passes_as_a_velocity_does(dike: Bench) -> None:
    dike.a.command(GUIDED_HEADING, 0.0, 270.0, 1.0)
    dike.run(0.3)
    assert passed(dike, "COMMAND_LONG") == 1


# ---- energy -------------------------------------------------------------------------------------------------------


def test_the_way_on_is_not_known_where_no_place_is_inside_the_fence(
    flown: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fault: without a place it was the way without any return."""
    flown.autopilot.mode = AUTO
    flown.run(1.5)
    desk = flown.companion.autopilot.command_check
    whole = desk.ahead.route
    ends_aloft = replace(whole, items=whole.items[:-1])
    for inside, route, known in ((True, whole, True), (True, ends_aloft, True), (False, whole, True)):
        monkeypatch.setattr(PlaceFinder, "in_fence", lambda *_, inside=inside: inside)
        desk.ahead.route = route
        assert (desk.way_on_wh() is not None) is known
    desk.ahead.route = ends_aloft
    assert desk.way_on_wh() is None


def test_a_target_beyond_the_point_of_no_return_is_refused(bench: Bench, delivery: MissionPackage) -> None:
    """82 Wh are left, two more than START needs; the mission itself says what is drawn."""
    bench.autopilot.battery = 0.65
    take_off(bench, delivery, 'fence = "off"\ncoverage = "off"')
    fly_to(bench, (52.6880, 5.924))
    assert passed(bench) == 1, "1 km there, and back"
    fly_to(bench, (52.6970, 5.924))
    assert passed(bench) == 1, "2 km"
    assert "target refused: " in bench.a.texts()
    assert "Wh are needed with the reserve" in bench.a.texts()
    assert "handover override energy" in bench.a.texts()


@pytest.mark.parametrize(
    ("points", "passes"),
    [
        (None, True),  # those of the plan: it would come down at rally 2
        ((), False),
        (((526790000, 59350000),), True),
        (((526790000, 59440000),), False),  # nearest of all, and outside the fence: ArduCopter would pass it over
    ],
)
def test_the_way_back_goes_where_a_return_could_be_sent(
    bench: Bench, delivery: MissionPackage, points: tuple[tuple[int, int], ...] | None, passes: bool
) -> None:
    """The fault: it was counted to the nearest place of the plan, whatever had become of the list."""
    bench.autopilot.battery = 0.65
    take_off(bench, delivery, 'fence = "off"\ncoverage = "off"')
    if points == ():
        assert result(send(bench, bench.a, clear())) == mavlink.MAV_MISSION_ACCEPTED
    elif points is not None:
        upload(bench, *points)
    bench.wait(3.0)
    fly_to(bench, (52.679, 5.944))
    assert passed(bench) == (1 if passes else 0)
    assert ("target refused: " in bench.a.texts()) is not passes


@pytest.mark.parametrize(("parameters", "passes"), [({}, True), ({"RTL_SPEED": 100.0}, False)])
def test_the_way_back_is_flown_at_the_speed_of_a_return(
    bench: Bench, delivery: MissionPackage, parameters: dict[str, float], passes: bool
) -> None:
    """1 km and back at 7 m/s against the wind are in reach, the way back at 1 m/s is not."""
    bench.autopilot.battery = 0.65
    take_off(bench, delivery, 'fence = "off"\ncoverage = "off"')
    bench.autopilot.parameters |= parameters
    bench.autopilot.tells += parameters
    bench.run(1.5)
    fly_to(bench, (52.6880, 5.924))
    assert passed(bench) == (1 if passes else 0)
    assert ("Wh are needed with the reserve" in bench.a.texts()) is not passes


def test_another_speed_is_judged_by_the_energy_of_the_way_ahead(bench: Bench, delivery: MissionPackage) -> None:
    bench.autopilot.battery = 0.65
    take_off(bench, delivery)
    bench.autopilot.mode = AUTO
    bench.run(1.5)
    for speed_mps, answers in ((10.0, []), (0.5, [REJECTED])):
        bench.a.received.clear()
        bench.autopilot.script[SPEED] = None
        bench.a.command(SPEED, 1, speed_mps, -1)
        bench.run(0.3)
        assert bench.a.acks(SPEED) == answers
    assert "speed refused: " in bench.a.texts()


@pytest.mark.parametrize("mode", [RTL, LAND, 21, 27], ids=["RTL", "LAND", "SMART_RTL", "AUTO_RTL"])
@pytest.mark.parametrize("kind", [0, 1, 2, 3], ids=["airspeed", "ground speed", "climb", "descent"])
def test_a_return_keeps_its_speed(flown: Bench, mode: int, kind: int) -> None:
    """The fault: DO_CHANGE_SPEED 0.3 in RTL passed, and ArduCopter obeys it there."""
    flown.autopilot.mode = mode
    flown.run(1.5)
    for speed_mps in (0.3, 20.0):
        flown.a.command(SPEED, kind, speed_mps, -1)
        flown.run(0.3)
    assert flown.autopilot.commands().count(SPEED) == 0
    assert flown.a.acks(SPEED) == [REJECTED, REJECTED]
    assert flown.a.texts() == "speed refused: a return keeps the speed that its energy is calculated with"
    flown.wait(12.0)
    flown.a.command(SPEED, kind, 0.3, -1)
    flown.run(0.3)
    assert flown.autopilot.commands().count(SPEED) == 0, "nothing lifts that"


def test_a_speed_that_may_have_met_a_return_is_followed_by_the_returns_own(flown: Bench) -> None:
    """It was let pass in AUTO, and the autopilot had begun to return by then: its heartbeat comes once a second."""
    flown.autopilot.mode = AUTO
    flown.run(1.5)
    flown.a.command(SPEED, 1, 9.0, -1)
    flown.run(0.1)
    flown.autopilot.mode = RTL
    flown.autopilot.script[SPEED] = None  # the first copy gets lost
    flown.run(1.5)
    flown.autopilot.script[SPEED] = 0
    flown.run(2.0)
    said = [(m.get_srcSystem(), m.param2) for m in flown.autopilot.got("COMMAND_LONG") if m.command == SPEED]
    assert said == [(251, 9.0), (1, 10.0), (1, 10.0)]


@pytest.mark.parametrize(("kind", "slow", "enough"), [(2, 1.0, 2.5), (3, 1.0, 1.5)], ids=["climb", "descent"])
def test_it_may_not_climb_or_come_down_slower_than_is_counted(
    flown: Bench, kind: int, slow: float, enough: float
) -> None:
    flown.autopilot.mode = AUTO
    flown.run(1.5)
    flown.a.command(SPEED, kind, slow, -1)
    flown.run(0.3)
    assert flown.a.texts().startswith(
        f"speed refused: slower than the {enough:g} m/s that the energy is calculated with. "
        "To insist, send it again after 10 s"
    )
    flown.a.command(SPEED, kind, enough, -1)
    flown.run(0.3)
    assert flown.autopilot.commands().count(SPEED) == 1


def test_in_guided_a_speed_is_judged_by_the_way_to_the_target(bench: Bench, delivery: MissionPackage) -> None:
    """1 km from home, and what there is is enough for a way there at 10 m/s. The fault: it was let pass at any."""
    bench.autopilot.battery = 0.65
    take_off(bench, delivery, 'fence = "off"\ncoverage = "off"')
    fly_to(bench, (52.6880, 5.924))
    assert passed(bench) == 1
    bench.autopilot.mode = GUIDED
    bench.run(1.5)
    for speed_mps, passes in ((0.5, False), (9.0, True)):
        bench.autopilot.received.clear()
        bench.a.command(SPEED, 1, speed_mps, -1)
        bench.run(0.3)
        assert bench.autopilot.commands().count(SPEED) == (1 if passes else 0)
    assert "speed refused: " in bench.a.texts()


def test_what_guided_was_told_counts_for_the_next_target(bench: Bench, delivery: MissionPackage) -> None:
    bench.autopilot.battery = 0.65
    take_off(bench, delivery, 'fence = "off"\ncoverage = "off"')
    bench.autopilot.mode = GUIDED
    bench.run(1.5)
    bench.a.command(SPEED, 1, 0.5, -1)
    bench.run(0.3)
    fly_to(bench, (52.6880, 5.924))
    assert passed(bench) == 0
    assert "Wh are needed with the reserve" in bench.a.texts()


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (
            mavlink.MAVLink_command_int_message(1, 1, 0, 179, 0, 0, 0, 0, 0, 0, 526790000, 59240000, 300.0),
            "home position refused: locked while armed",
        ),
        (
            mavlink.MAVLink_command_long_message(1, 1, 207, 0, 0, 0, 0, 0, 0, 0, 0),
            "fence off refused: locked while armed",
        ),
        (
            mavlink.MAVLink_command_long_message(1, 1, 218, 0, 11, 0, 0, 0, 0, 0, 0),
            "auxiliary switch fence refused: locked while armed",
        ),
        (
            mavlink.MAVLink_command_long_message(1, 1, 42007, 0, 2, 0, 0, 0, 0, 0, 0),
            "estimator source refused: locked while armed",
        ),
        (
            mavlink.MAVLink_set_gps_global_origin_message(1, 526790000, 59240000, 300000),
            "origin refused: locked while armed",
        ),
        (mavlink.MAVLink_param_set_message(1, 1, b"WPNAV_SPEED", 100.0, 9), "parameter WPNAV_SPEED refused: locked"),
    ],
    ids=["home", "fence", "switch", "estimator", "origin", "speed"],
)
def test_what_shapes_a_return_is_refused_in_words(flown: Bench, message: Any, text: str) -> None:
    flown.autopilot.armed = True
    flown.run(1.5)
    flown.autopilot.received.clear()
    flown.a.send(message)
    flown.run(0.5)
    assert flown.autopilot.got(message.get_type(), 251) == []
    assert flown.a.texts().startswith(text)


def start_short(bench: Bench, package: MissionPackage) -> None:
    bench.autopilot.battery = 0.25
    bench.connect()
    bench.share(package, at_once=True)
    bench.wait(3.0)
    bench.a.received.clear()


def test_start_without_the_energy_is_lifted_by_the_override(bench: Bench, delivery: MissionPackage) -> None:
    start_short(bench, delivery)
    bench.a.command(START)
    bench.run(0.5)
    assert "energy: " in bench.a.texts()
    assert override(bench, mavlink.HANDOVER_LIMIT_ENERGY) == 60
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    (entry,) = bench.journal("override")
    assert (entry["by"], entry["limit"]) == ("GCSA", "energy")


def test_start_without_the_energy_is_lifted_by_the_same_command_sent_again(
    bench: Bench, delivery: MissionPackage
) -> None:
    start_short(bench, delivery)
    bench.a.command(START)
    bench.run(1.5)
    bench.a.command(START)
    bench.run(1.0)
    assert bench.companion.view.phase is Phase.ON_LOAD
    assert bench.a.acks(START) == [REJECTED, REJECTED]
    bench.wait(10.0)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    (entry,) = bench.journal("command_passed")
    assert (entry["station"], entry["limits"]) == ("GCSA", ["energy"])


def test_an_override_of_another_limit_starts_nothing(bench: Bench, delivery: MissionPackage) -> None:
    start_short(bench, delivery)
    override(bench, mavlink.HANDOVER_LIMIT_FENCE)
    bench.a.command(START)
    bench.run(1.0)
    assert bench.a.acks(START) == [REJECTED]


# ---- when something is missing or breaks --------------------------------------------------------------------------


def test_without_a_fresh_position_nothing_is_judged(flown: Bench) -> None:
    flown.autopilot.position = None
    flown.wait(3.0)
    fly_to(flown, OUT_OF_ZONES)
    assert passed(flown) == 1


BROKEN = "mavproxy_handover.operator.checks.command_check"


@pytest.mark.parametrize(
    ("part", "limit"),
    [("leaves_fence", "fence"), ("leaves_coverage", "coverage"), ("straight", "energy")],
    ids=["one limit", "another", "the way"],
)
def test_a_command_that_cannot_be_judged_is_refused(
    flown: Bench, part: str, limit: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fault: it passed, whatever it would have left. The operator can insist, as with any other refusal."""
    monkeypatch.setattr(f"{BROKEN}.{part}", lambda *_anything: 1 / 0)
    fly_to(flown, (52.6785, 5.9240))
    assert passed(flown) == 0
    assert flown.a.acks(REPOSITION) == [REJECTED]
    words = f"target refused: {limit} cannot be judged: internal fault. To insist, send it again after 10 s"
    assert words in flown.a.texts()
    assert flown.companion.faults["judging a command"] == 1
    assert not flown.companion.failed
    flown.wait(10.5)
    fly_to(flown, (52.6785, 5.9240))
    assert passed(flown) == 1


def test_a_fault_in_one_limit_does_not_hide_another(flown: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{BROKEN}.leaves_coverage", lambda *_anything: 1 / 0)
    fly_to(flown, OUT_OF_FENCE)
    assert passed(flown) == 0
    assert "target refused: breaks the geofence within 2337 m." in flown.a.texts()


def test_a_command_is_refused_if_the_rules_themselves_break(flown: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flown.companion.autopilot.command_check.rules, "rule", lambda *_anything, **_more: 1 / 0)
    for _copy in range(2):
        fly_to(flown, (52.6785, 5.9240))
        flown.wait(10.5)
    assert passed(flown) == 0
    assert flown.a.acks(REPOSITION) == [REJECTED, REJECTED]
    assert not flown.companion.failed


def test_a_command_is_refused_if_the_energy_was_never_known_because_of_a_fault(
    flown: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    energy = flown.companion.autopilot.command_check._energy
    monkeypatch.setattr(energy.estimate, "observe", lambda *_anything, **_more: 1 / 0)
    energy.estimate.fact = EnergyFact(-math.inf, missing="not looked at yet")
    flown.run(1.5)
    fly_to(flown, (52.6785, 5.9240))
    assert passed(flown) == 0
    assert "target refused: energy cannot be judged: internal fault." in flown.a.texts()


def test_what_a_limit_is_only_warned_of_passes_though_it_cannot_be_judged(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown = take_off(bench, delivery, 'coverage = "warn"')
    monkeypatch.setattr(f"{BROKEN}.leaves_coverage", lambda *_anything: 1 / 0)
    fly_to(flown, (52.6785, 5.9240))
    assert passed(flown) == 1
    assert "target, warning: coverage cannot be judged: internal fault" in flown.a.texts()


def test_of_commands_that_cannot_be_judged_a_return_is_none(flown: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flown.companion.autopilot.command_check, "_rule", lambda *_anything, **_more: 1 / 0)
    flown.a.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    flown.run(0.3)
    assert flown.autopilot.commands() == [mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH]


def test_a_flood_of_commands_is_refused_without_a_look(flown: Bench) -> None:
    for number in range(200):
        lat = 527000000 + number * 1000
        message = mavlink.MAVLink_command_int_message(1, 1, 3, REPOSITION, 0, 0, -1, 1, 0, 0, lat, 59240000, 40)
        flown.a.send(message)
    flown.run(0.05)
    flown.run(1.0)
    assert passed(flown) == 0
    assert len(flown.journal("command_refused")) <= 3
    flown.wait(3.0)
    fly_to(flown, (52.6785, 5.9240))
    assert passed(flown) == 1


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ((1, 15.0, -1), "speed refused: it would set MIN_GROUNDSPEED, which also applies to a return"),
        ((257, 15.0, -1), "speed refused: it would set MIN_GROUNDSPEED, which also applies to a return"),
        ((0, 99.0, 80), "speed refused: it would set TRIM_THROTTLE, which also applies to a return"),
        ((0, 22.0, -1), ""),
    ],
    ids=["ground speed", "the same as a byte", "throttle", "airspeed"],
)
def test_a_plane_is_told_no_speed_that_outlasts_the_mode(
    dike: Bench, parameters: tuple[float, float, float], text: str
) -> None:
    dike.a.command(SPEED, *parameters)
    dike.run(0.3)
    assert dike.a.texts().startswith(text)
    assert dike.autopilot.commands().count(SPEED) == (0 if text else 1)
