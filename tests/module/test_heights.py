# SPDX-License-Identifier: GPL-3.0-or-later

"""Heights above the sea and above terrain, and curves: at START, before flight and in uploads in flight. The delivery
mission, whose home is at sea level."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.package import MissionPackage
from tests.module.conftest import Bench
from tests.module.test_commands_in_flight import take_off
from tests.module.test_flight_uploads import HOME_LAT, HOME_LON, INSIDE, Program, held

START = mavlink.MAV_CMD_MISSION_START
ACCEPTED, DENIED, INVALID = 0, 14, 5
ABOVE_SEA, ABOVE_TERRAIN = 0, 10


def changed(package: MissionPackage, change: Callable[[dict[str, Any]], None]) -> MissionPackage:
    """The same mission with another plan."""
    texts = {name: text.decode() for name, text in package.files.items()}
    name = next(name for name in texts if name.endswith(".plan"))
    plan = json.loads(texts[name])
    change(plan["mission"])
    return mission_package.from_texts({**texts, name: json.dumps(plan)}, "test")


def above_sea(home_m: float) -> Callable[[dict[str, Any]], None]:
    """All heights as many metres above the sea as they were above home; home itself at another one."""

    def change(mission: dict[str, Any]) -> None:
        mission["plannedHomePosition"][2] = home_m
        for item in mission["items"]:
            if item["frame"] == 3:
                item["frame"] = ABOVE_SEA
                item["params"][6] += home_m

    return change


def above_terrain(mission: dict[str, Any]) -> None:
    mission["items"][1]["frame"] = ABOVE_TERRAIN


@pytest.fixture
def flown(bench: Bench, delivery: MissionPackage) -> Bench:
    flown = take_off(bench, delivery)
    flown.autopilot.items = {kind: list(items) for kind, items in flown.autopilot.items.items()}
    return flown


def without_takeoff(mission: dict[str, Any]) -> None:
    del mission["items"][0]


# ---- START --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("home_m", [0.0, 589.0, 611.0])
def test_start_is_refused_where_home_is_at_another_height_and_items_are_above_the_sea(
    bench: Bench, delivery: MissionPackage, home_m: float
) -> None:
    bench.connect()
    bench.autopilot.home_alt_m = 600.0
    bench.share(changed(delivery, above_sea(home_m)))
    bench.run(2.0)
    bench.a.command(START)
    bench.run(1.0)
    assert bench.a.acks(START) == [mavlink.MAV_RESULT_TEMPORARILY_REJECTED]
    assert f"above sea: home is at {home_m:.0f} m in the plan and at 600 m in the autopilot" in bench.a.texts()
    assert bench.autopilot.commands() == []


@pytest.mark.parametrize("home_m", [590.5, 609.5])
def test_start_is_granted_where_both_agree(bench: Bench, delivery: MissionPackage, home_m: float) -> None:
    bench.autopilot.home_alt_m = 600.0
    take_off(bench, changed(delivery, above_sea(home_m)))
    assert bench.companion.view.phase is Phase.ON_MISSION


def test_start_is_refused_where_the_mission_does_not_take_off(bench: Bench, delivery: MissionPackage) -> None:
    """ArduCopter would arm, and refuse AUTO."""
    bench.connect()
    bench.share(changed(delivery, without_takeoff))
    bench.run(2.0)
    bench.a.command(START)
    bench.run(1.0)
    assert bench.a.acks(START) == [mavlink.MAV_RESULT_TEMPORARILY_REJECTED]
    assert "the mission has no take-off, it begins with item 1 (NAV_WAYPOINT)" in bench.a.texts()
    assert bench.autopilot.commands() == []


def test_heights_above_home_ask_nothing_of_the_height_of_home(bench: Bench, delivery: MissionPackage) -> None:
    bench.autopilot.home_alt_m = 600.0
    take_off(bench, delivery)
    assert bench.companion.view.phase is Phase.ON_MISSION


@pytest.mark.parametrize(
    ("parameters", "lacks"),
    [
        ({"TERRAIN_ENABLE": 0.0}, True),
        ({"TERRAIN_ENABLE": 1.0}, False),
        ({"TERRAIN_ENABLE": 0.0, "WPNAV_RFND_USE": 1.0, "RNGFND1_TYPE": 8.0}, False),
        ({"TERRAIN_ENABLE": 0.0, "WPNAV_RFND_USE": 1.0, "RNGFND1_TYPE": 0.0}, True),
        ({"FS_OPTIONS": 0.0}, True),
    ],
)
def test_heights_above_terrain_need_an_autopilot_that_knows_the_ground(
    bench: Bench, delivery: MissionPackage, parameters: dict[str, float], lacks: bool
) -> None:
    bench.autopilot.parameters.update(parameters)
    bench.connect()
    bench.share(changed(delivery, above_terrain))
    bench.until(lambda: bench.companion.autopilot.preflight.findings is not None, 60.0)
    bench.run(1.0)
    needs = "; ".join(bench.companion.arbiter.start_needs(251, bench.clock.now))
    assert ("heights: item 2 (NAV_WAYPOINT) above terrain: TERRAIN_ENABLE is not 1 and" in needs) is lacks
    told = [finding.text for finding in bench.companion.autopilot.preflight.findings or ()]
    assert any("above terrain" in text for text in told), "the mission has no heights of the ground either"


@pytest.mark.parametrize(
    ("alt_m", "words"), [(-50.0, "down to 50 m below home"), (0.5, "0.5 m above home, less than 5")]
)
def test_a_way_near_the_height_of_home_is_told_before_start(
    bench: Bench, delivery: MissionPackage, alt_m: float, words: str
) -> None:
    def low(mission: dict[str, Any]) -> None:
        mission["items"][1]["params"][6] = alt_m

    bench.autopilot.parameters["FS_OPTIONS"] = 0.0
    bench.connect()
    bench.share(changed(delivery, low))
    bench.until(lambda: bench.companion.autopilot.preflight.findings is not None, 60.0)
    told = [finding.text for finding in bench.companion.autopilot.preflight.findings or ()]
    assert any(text.startswith(f"item 2 (NAV_WAYPOINT): {words}") for text in told)


# ---- uploads in flight --------------------------------------------------------------------------------------------


def upload(flown: Bench, item: MissionItem) -> int:
    """The way of INSIDE with this as its second item."""
    return Program(flown, (*INSIDE[:2], replace(item, seq=2), INSIDE[3])).send()


def item(
    command: int, params: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0), frame: int = 3, alt_m: float = 40.0
) -> MissionItem:
    return MissionItem(2, command, frame, *params, 52.679, 5.925, alt_m)


def test_an_upload_above_the_sea_needs_home_at_the_same_height(flown: Bench) -> None:
    before = held(flown)
    flown.autopilot.home_alt_m = 600.0
    flown.run(1.0)
    assert upload(flown, item(16, frame=ABOVE_SEA, alt_m=50.0)) == DENIED
    assert "item 2 (NAV_WAYPOINT) above sea: home is at 0 m in the plan and at 600 m in the auto" in flown.a.texts()
    assert held(flown) == before
    flown.autopilot.home_alt_m = 5.0
    flown.wait(3.5)
    assert upload(flown, item(16, frame=ABOVE_SEA, alt_m=50.0)) == ACCEPTED


def test_an_upload_above_terrain_is_refused_where_nothing_is_known_of_the_ground(flown: Bench) -> None:
    assert upload(flown, item(16, frame=ABOVE_TERRAIN)) == DENIED
    assert "item 2 (NAV_WAYPOINT) above terrain" in flown.a.texts()


@pytest.mark.parametrize(
    ("alt_m", "words"), [(-50.0, "down to 50 m below home"), (0.5, "0.5 m above home, less than 5")]
)
def test_an_upload_near_the_height_of_home_is_taken_with_a_warning(flown: Bench, alt_m: float, words: str) -> None:
    assert upload(flown, item(16, alt_m=alt_m)) == ACCEPTED
    flown.run(0.5)
    assert f"mission, warning: item 2 (NAV_WAYPOINT): {words}" in flown.a.texts()


def test_an_upload_of_fifty_turns_of_two_kilometres_is_refused(flown: Bench) -> None:
    before = held(flown)
    assert upload(flown, item(18, (50.0, 0.0, 2000.0, 0.0))) == DENIED
    assert re.search(r"mission refused: 1\d{4}\.\d Wh are needed with the reserve", flown.a.texts())
    assert held(flown) == before


def test_an_upload_of_a_spline_that_leaves_coverage_is_refused(flown: Bench) -> None:
    """The places are in the zone, and the curve between them is not: it swings out north of it, by 63 m."""
    north = MissionItem(2, 82, 3, 0, 0, 0, 0, 52.6820, 5.9250, 40.0)
    west = MissionItem(3, 82, 3, 0, 0, 0, 0, 52.6820, 5.9240, 40.0)
    back = MissionItem(4, 16, 3, 0, 0, 0, 0, HOME_LAT / 1e7, HOME_LON / 1e7, 40.0)
    items = (*INSIDE[:2], north, west, back)
    straight = Program(flown, tuple(replace(each, command=16) for each in items)).send()
    flown.wait(3.5)
    curved = Program(flown, items).send()
    assert (straight, curved) == (ACCEPTED, DENIED)
    assert "mission refused: leaves coverage in" in flown.a.texts()


def test_an_upload_that_waits_until_a_time_of_day_is_refused(flown: Bench) -> None:
    assert upload(flown, item(93, (0.0, 23.0, 59.0, 0.0))) == INVALID
    assert "NAV_DELAY waits until a time of day (hour 23, minute 59, second 0 UTC), up to 24 hours" in flown.a.texts()
