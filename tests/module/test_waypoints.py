# SPDX-License-Identifier: GPL-3.0-or-later

"""Waypoints that belong to stations, in the companion: what the autopilot says of its mission moves authority.

East along latitude 52.684, then north: items 1, 2, 5 and 6, the return, belong to GCSA, 3 and 4 to GCSB. GCSB's zone
begins 150 m before item 3, GCSA's ends 150 m behind it, and begins again 150 m before item 5.
"""

from __future__ import annotations

import json
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from tests.module.conftest import Bench
from tests.module.test_flight_uploads import Program, waypoint
from tests.module.test_restart import restart, with_rules
from tests.module.vehicle import AUTO, GUIDED, RTL
from tests.packages import MISSIONS

START = mavlink.MAV_CMD_MISSION_START
A, B = 251, 252
LAT, HOME_LON = 52.684, 5.91
#: of items 2 to 5
PLACES = ((LAT, 5.9156), (LAT, 5.9221), (LAT, 5.9280), (52.6890, 5.9280))
#: before GCSB's zone, in both zones on either side of item 3, in GCSB's alone, and in both before item 5
HOME, IN_A, BEFORE, BEHIND = (LAT, HOME_LON), (LAT, 5.9170), (LAT, 5.9208), (LAT, 5.9230)
IN_B, BEFORE_5 = (LAT, 5.9265), (52.6883, 5.9280)
TOML = """\
name = "reached"
detector = "reached"
corridor_m = 150.0
route = "linear.plan"
expected_handovers = 2

[[stations]]
name = "GCSA"
sysid = 251
waypoints = [1, 2, 5, 6]

[[stations]]
name = "GCSB"
sysid = 252
waypoints = [3, 4]
"""


@pytest.fixture(scope="session")
def package(tmp_path_factory: pytest.TempPathFactory) -> MissionPackage:
    folder = tmp_path_factory.mktemp("reached")
    plan = json.loads((MISSIONS / "linear" / "linear.plan").read_text())
    for item, place in zip(plan["mission"]["items"][1:5], PLACES, strict=True):
        item["params"][4:6] = place
    (folder / "linear.plan").write_text(json.dumps(plan))
    (folder / "mission.toml").write_text(TOML)
    return mission_package.load(folder)


@pytest.fixture
def flight(bench: Bench, package: MissionPackage) -> Bench:
    """In AUTO under GCSA, on the way to item 3, in both zones."""
    bench.autopilot.position = HOME
    bench.connect()
    bench.share(package, at_once=True)
    with_rules(bench, package)
    bench.wait(1.5)
    bench.autopilot.waypoint = 1
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    fly(bench, 3, IN_A)
    fly(bench, 3, BEFORE)
    assert bench.companion.arbiter.zone() == A
    assert [entry["station"] for entry in bench.journal("zone_entered")] == ["GCSA", "GCSB"]
    return bench


def fly(bench: Bench, item: int | None, place: tuple[float, float], seconds: float = 8.0) -> None:
    """On the way to this item, at this place, for longer than the dwell time."""
    bench.autopilot.waypoint, bench.autopilot.position = item, place
    if seconds < 2.0:
        bench.run(seconds)
    else:
        bench.wait(seconds)


def reaches(bench: Bench, item: int) -> None:
    bench.autopilot._out = []
    bench.autopilot.say(stock.MAVLink_mission_item_reached_message(item))
    for message in bench.autopilot._out:
        bench.mpstate.deliver(message)


def commander(bench: Bench) -> Any:
    return bench.companion.view.commander


def reasons(bench: Bench) -> list[str]:
    return [entry["reason"] for entry in bench.journal("transfer_begun")]


class TestTrigger:
    def test_in_the_next_zone_nothing_moves_until_its_waypoint_is_reached(self, flight: Bench) -> None:
        flight.wait(60.0)
        assert commander(flight) == A
        assert reasons(flight) == []

    def test_the_word_that_it_is_reached_moves_authority_at_once(self, flight: Bench) -> None:
        """MISSION_CURRENT may come half a second later."""
        reaches(flight, 3)
        flight.run(0.3)
        assert (commander(flight), reasons(flight)) == (B, ["zone"])
        (entry,) = flight.journal("reached")
        assert (entry["number"], entry["station"], entry["text"]) == (3, "GCSB", "waypoint 3 of GCSB reached")

    def test_when_that_word_is_lost_the_next_item_says_the_same(self, flight: Bench) -> None:
        fly(flight, 4, BEFORE, 1.5)
        assert (commander(flight), reasons(flight)) == (B, ["zone"])

    @pytest.mark.parametrize("item", [0, 1, 2, 4, 5, 60000])
    def test_the_word_of_another_item_is_old_or_doubled(self, flight: Bench, item: int) -> None:
        reaches(flight, item)
        flight.wait(10.0)
        assert commander(flight) == A

    def test_a_waypoint_reached_calls_once(self, flight: Bench) -> None:
        reaches(flight, 3)
        flight.wait(10.0)
        flight.b.send(mavlink.MAVLink_command_long_message(1, 191, 32100, 0, 251, 1, 0, 5, 0, 0, 0))
        for _ in range(3):
            fly(flight, 4, BEHIND)
            reaches(flight, 3)
        assert len(flight.journal("transfer_committed")) == 1

    def test_it_comes_back_at_the_first_waypoint_of_the_other_one(self, flight: Bench) -> None:
        reaches(flight, 3)
        fly(flight, 4, IN_B)
        fly(flight, 5, BEFORE_5, 20.0)
        assert commander(flight) == B
        reaches(flight, 5)
        flight.run(0.3)
        assert (commander(flight), reasons(flight)) == (A, ["zone", "zone"])


class TestLeftOutAndTurnedBack:
    def test_waypoints_that_are_left_out_count_as_done_with_where_the_zone_begins(self, flight: Bench) -> None:
        fly(flight, 3, IN_A)
        fly(flight, 4, IN_A, 20.0)
        assert commander(flight) == A
        fly(flight, 4, BEFORE, 1.0)
        assert (commander(flight), reasons(flight)) == (B, ["zone"])

    def test_who_is_sent_back_to_waypoints_of_the_one_before_is_its_again(self, flight: Bench) -> None:
        reaches(flight, 3)
        fly(flight, 4, BEHIND)
        assert commander(flight) == B
        fly(flight, 2, BEHIND)
        assert commander(flight) == A

    def test_and_awaited_once_more(self, flight: Bench) -> None:
        fly(flight, 4, IN_A)
        fly(flight, 3, IN_A)
        fly(flight, 3, BEFORE, 20.0)
        assert commander(flight) == A
        reaches(flight, 3)
        flight.run(0.3)
        assert commander(flight) == B

    def test_an_item_that_was_reached_and_is_flown_to_again_is_not_reached(self, flight: Bench) -> None:
        fly(flight, 3, IN_A)
        reaches(flight, 3)  # left out: it never comes near its zone
        fly(flight, 4, IN_A)
        fly(flight, 3, IN_A)
        fly(flight, 3, BEFORE, 20.0)
        assert commander(flight) == A


class TestCoverageAlone:
    """What no waypoint is waited for."""

    @pytest.mark.parametrize("mode", [RTL, GUIDED])
    def test_in_another_mode_than_auto_authority_moves_where_a_zone_is_entered(self, flight: Bench, mode: int) -> None:
        flight.autopilot.mode = mode
        fly(flight, 3, IN_A)
        fly(flight, 3, BEFORE, 2.0)
        assert (commander(flight), reasons(flight)) == (B, ["zone"])

    @pytest.mark.parametrize("mode", [RTL, GUIDED])
    def test_the_change_of_mode_alone_moves_nothing(self, flight: Bench, mode: int) -> None:
        for _ in range(2):
            for now in (mode, AUTO):
                flight.autopilot.mode = now
                flight.wait(10.0)
        assert reasons(flight) == []

    @pytest.mark.parametrize("mode", [RTL, GUIDED])
    def test_nor_behind_the_waypoint(self, flight: Bench, mode: int) -> None:
        """The zone of the one before holds the aircraft still: it does not get it back for that."""
        reaches(flight, 3)
        fly(flight, 4, BEHIND, 1.0)
        flight.autopilot.mode = mode
        flight.wait(20.0)
        assert (commander(flight), reasons(flight)) == (B, ["zone"])

    def test_and_in_auto_again_it_stays_with_who_has_it(self, flight: Bench) -> None:
        flight.autopilot.mode = GUIDED
        fly(flight, 3, IN_A)
        fly(flight, 3, BEFORE)
        flight.autopilot.mode = AUTO
        flight.wait(20.0)
        assert (commander(flight), len(flight.journal("transfer_committed"))) == (B, 1)

    def test_on_a_way_back_it_moves_where_the_zone_of_the_one_before_is_entered(self, flight: Bench) -> None:
        reaches(flight, 3)
        flight.autopilot.mode = RTL
        fly(flight, 4, IN_B)
        fly(flight, 4, BEHIND, 2.0)
        assert (commander(flight), reasons(flight)) == (A, ["zone", "zone"])

    def test_on_the_way_back_by_the_missions_own_return(self, flight: Bench) -> None:
        reaches(flight, 3)
        fly(flight, 4, IN_B)
        fly(flight, 6, BEFORE_5, 1.5)
        assert commander(flight) == A

    def test_where_mission_current_is_missing(self, flight: Bench) -> None:
        flight.autopilot.waypoint = None
        fly(flight, None, IN_A, 3.0)
        fly(flight, None, BEFORE, 1.0)
        assert commander(flight) == A
        fly(flight, None, IN_A, 6.0)
        fly(flight, None, BEFORE, 2.0)
        assert (commander(flight), reasons(flight)) == (B, ["zone"])

    def test_where_the_commanders_zone_ends(self, flight: Bench) -> None:
        fly(flight, 3, IN_B, 1.0)
        assert (commander(flight), reasons(flight)) == (B, ["zone_ends"])

    def test_where_the_commander_is_lost(self, flight: Bench) -> None:
        flight.a.alive = False
        flight.until(lambda: commander(flight) == B, 10.0)
        assert reasons(flight) == ["commander_lost"]
        assert flight.journal("emergency") == []

    def test_on_a_mission_that_the_commander_has_sent_in_flight(self, flight: Bench) -> None:
        way = [waypoint(0, 526840000, 59100000, 0.0), *(waypoint(n, 526842700, 59221250) for n in (1, 2, 3))]
        way.append(waypoint(4, 526842700, 59221250, 0.0, command=21))
        assert Program(flight, way).send() == 0
        flight.wait(10.0)
        assert commander(flight) == A
        fly(flight, 3, IN_A)
        fly(flight, 3, BEFORE, 2.0)
        assert (commander(flight), reasons(flight)) == (B, ["zone"])


class TestRestart:
    def test_a_waypoint_that_is_still_ahead_is_still_awaited(self, flight: Bench) -> None:
        restart(flight)
        flight.wait(20.0)
        assert commander(flight) == A
        reaches(flight, 3)
        flight.run(0.3)
        assert (commander(flight), reasons(flight)) == (B, ["zone"])

    def test_one_that_was_reached_meanwhile_is_not_lost(self, flight: Bench) -> None:
        flight.autopilot.waypoint, flight.autopilot.position = 4, BEHIND
        restart(flight)
        flight.wait(8.0)
        assert (commander(flight), reasons(flight)) == (B, ["zone"])

    def test_behind_it_authority_stays_where_it_is(self, flight: Bench) -> None:
        reaches(flight, 3)
        fly(flight, 4, BEHIND)
        restart(flight)
        flight.wait(20.0)
        assert (commander(flight), len(flight.journal("transfer_committed"))) == (B, 1)

    def test_without_mission_current_coverage_alone_counts_after_a_while(self, flight: Bench) -> None:
        flight.autopilot.waypoint = None
        restart(flight)
        flight.wait(10.0)
        assert commander(flight) == A
        fly(flight, None, IN_A)
        fly(flight, None, BEFORE, 2.0)
        assert commander(flight) == B


def test_the_list_of_zones_says_who_awaits_the_aircraft(flight: Bench) -> None:
    flight.mpstate.type("handover zones")
    shown = [line for line in flight.mpstate.console.lines if line.startswith("GCS")]
    assert [line.endswith(", awaits it at a waypoint") for line in shown[-2:]] == [False, True]
