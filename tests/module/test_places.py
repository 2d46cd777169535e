# SPDX-License-Identifier: GPL-3.0-or-later

"""The place of a return: chosen before it is needed, in the autopilot's list at every moment, and told."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import LinkJudged, PlaceJudged
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission.package import MissionPackage, load
from mavproxy_handover.mission.return_paths import PlaceFinder
from mavproxy_handover.operator.return_site.rally_writer import READ_S, WRITE_S
from tests.module.conftest import Bench
from tests.packages import ROUND

START, MODE = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_DO_SET_MODE
GUIDED, AUTO, RTL, LAND = 4, 3, 6, 9
RALLY = mavlink.MAV_MISSION_TYPE_RALLY
#: of the delivery, in 1e-7 degrees: home and rally 1 are in GCSA's zone alone, rally 2 in GCSB's
HOME, RALLY_1, RALLY_2 = (526790000, 59240000), (526796290, 59223740), (526791800, 59319840)
#: places in the air: in both zones, nearer to home; in B's alone, near rally 2
BETWEEN, IN_B = (52.679, 5.9270), (52.6790, 5.9310)


def listed(bench: Bench) -> list[tuple[int, int]]:
    """What the autopilot's own rally list holds."""
    return [(item.x, item.y) for item in bench.autopilot.items[RALLY]]


def counts(bench: Bench) -> int:
    """Uploads of rally points that were begun."""
    return sum(m.mission_type == RALLY for m in bench.autopilot.got("MISSION_COUNT"))


def told(bench: Bench) -> list[str]:
    return [entry["text"] for entry in bench.journal("place")]


@pytest.fixture
def ready(bench: Bench, delivery: MissionPackage) -> Bench:
    """Both stations with the mission, on the ground at home. What is looked at is the place, not why it is needed."""
    bench.config.write_text(bench.config.read_text() + '[policy]\nno_station = "off"\ncoverage_ends = "off"\n')
    bench.connect()
    bench.share(delivery, at_once=True)
    bench.wait(6.0)
    return bench


@pytest.fixture
def flying(ready: Bench) -> Bench:
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.wait(6.0)
    return ready


def fly_to(bench: Bench, place: tuple[float, float], seconds: float = 30.0) -> None:
    bench.autopilot.position = place
    bench.wait(seconds)


def lose(bench: Bench, *stations: Any) -> None:
    for station in stations:
        station.alive = False


# ---- the list -----------------------------------------------------------------------------------------------------


def test_on_the_ground_the_list_holds_home_and_that_alone(ready: Bench) -> None:
    assert listed(ready) == [HOME]
    assert told(ready) == [
        "a return goes to home: 0 m away, needs 3 % of the battery (100 % left), covered by GCSA all the way"
    ]
    assert (
        "place     home: 0 m away, needs 3 % of the battery (100 % left), covered by GCSA all the way"
        in ready.mpstate.type("handover status")
    )
    assert ready.a.texts() == "", "nobody expects anything else"


def test_every_station_hears_twice_a_second_where_a_return_goes(ready: Bench) -> None:
    for station in (ready.a, ready.b):
        heard = station.got("AUTHORITY_STATUS")[-1]
        assert (heard.place, heard.place_lat, heard.place_lon) == ("home", *HOME)
        assert heard.place_needs == 1 + 3, "as 'handover status' says"
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    fly_to(ready, IN_B, 40.0)
    heard = ready.b.got("AUTHORITY_STATUS")[-1]
    assert (heard.place, heard.place_lat, heard.place_lon) == ("rally 2", *RALLY_2)
    assert 20 < heard.place_in < 200
    assert 1 < heard.place_needs < 40


def test_without_a_mission_nobody_touches_it(bench: Bench) -> None:
    bench.connect()
    bench.autopilot.items[RALLY] = []
    bench.wait(30.0)
    assert [m for m in bench.autopilot.received if getattr(m, "mission_type", None) == RALLY] == []


def test_it_follows_the_aircraft_and_is_told_to_everybody(flying: Bench) -> None:
    fly_to(flying, IN_B, 40.0)
    assert listed(flying) == [RALLY_2]
    text = told(flying)[-1]
    assert text.startswith("a return goes to rally 2: 7")
    assert text.endswith(" m away, needs 6 % of the battery (100 % left), covered by GCSB all the way")
    for station in (flying.a, flying.b):
        assert station.texts().count("A return goes to rally 2") == 1


def elsewhere(item: Any) -> Any:
    """What an autopilot makes of a rally point that it does not keep as it was sent."""
    if item.mission_type == RALLY:
        item.x += 3000
    return item


def test_a_place_that_could_not_be_written_is_not_told_as_where_a_return_goes(flying: Bench) -> None:
    flying.autopilot.spoil = elsewhere
    fly_to(flying, IN_B, 60.0)
    for station in (flying.a, flying.b):
        assert {m.place for m in station.got("AUTHORITY_STATUS")[-40:]} == {""}, (
            "what the list holds is no place of ours"
        )
        assert station.texts().count("rally 2 is not in the autopilot's list: a return may go elsewhere") == 1
    (line,) = [each for each in flying.mpstate.type("handover status") if each.startswith("place ")]
    assert line.endswith(", covered by GCSB all the way, NOT IN THE AUTOPILOT'S LIST")
    lose(flying, flying.a, flying.b)
    flying.until(lambda: flying.journal("fly"), 20.0)
    (first, *_more) = (e["text"] for e in flying.journal("decision") if e["text"].startswith("RETURN"))
    assert first.endswith(", covered by GCSB all the way, NOT IN THE AUTOPILOT'S LIST") or first.endswith(
        ", covered by no station, NOT IN THE AUTOPILOT'S LIST"
    )


def test_and_when_it_is_written_it_is_told(flying: Bench) -> None:
    flying.autopilot.spoil = elsewhere
    fly_to(flying, IN_B, 40.0)
    flying.autopilot.spoil = lambda item: item
    flying.wait(20.0)
    assert listed(flying) == [RALLY_2]
    assert flying.b.got("AUTHORITY_STATUS")[-1].place == "rally 2"


NOT_LISTED = "home is not in the autopilot's list: a return may go elsewhere"


def test_a_place_that_could_not_be_written_on_the_ground_is_told_when_it_arms(ready: Bench) -> None:
    """The fault: what was known on the ground, where nobody is told, counted as told in flight."""
    ready.autopilot.spoil = elsewhere
    ready.mpstate.deliver(
        said(stock.MAVLink_home_position_message(526790500, 59240500, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
    )
    ready.until(lambda: len(ready.journal("place_failed")) >= 3, 40.0)
    assert "autopilot's list" not in ready.a.texts()
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.wait(60.0)
    for station in (ready.a, ready.b):
        assert station.texts().count(NOT_LISTED) == 1


def test_and_again_in_the_next_flight(ready: Bench) -> None:
    ready.autopilot.spoil = elsewhere
    for flights in (1, 2):
        ready.autopilot.items[0][0].x += 500  # where it arms
        ready.a.command(START)
        ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
        ready.wait(25.0)
        assert ready.a.texts().count(NOT_LISTED) == flights
        ready.autopilot.armed = ready.autopilot.airborne = False
        ready.autopilot.mode = 0
        ready.wait(20.0)


def test_the_nearest_whose_station_is_dead_is_passed_over_at_once(flying: Bench) -> None:
    fly_to(flying, BETWEEN, 40.0)
    assert listed(flying) == [HOME]
    fly_to(flying, IN_B, 40.0)
    assert listed(flying) == [RALLY_2]
    lose(flying, flying.b)
    flying.wait(8.0)
    assert listed(flying) == [HOME]
    assert told(flying)[-1].startswith("a return goes to home")


def test_home_is_written_anew_when_arming_has_moved_it(ready: Bench) -> None:
    moved = (526790500, 59240900)
    ready.autopilot.items[0][0].x, ready.autopilot.items[0][0].y = moved
    ready.wait(5.0)
    assert listed(ready) == [HOME]
    ready.a.command(START)
    ready.until(lambda: ready.companion.view.phase is Phase.ON_MISSION)
    ready.wait(8.0)
    assert listed(ready) == [moved]


def test_the_autopilots_own_word_of_its_home_counts_too(flying: Bench) -> None:
    flying.mpstate.deliver(
        said(stock.MAVLink_home_position_message(526790700, 59240100, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
    )
    flying.wait(8.0)
    assert listed(flying) == [(526790700, 59240100)]


def test_no_change_comes_oftener_than_every_five_seconds(flying: Bench) -> None:
    before = counts(flying)
    for n in range(40):
        lat = 526790000 + 100 * n
        message = stock.MAVLink_home_position_message(lat, 59240000, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
        flying.mpstate.deliver(said(message))
        flying.run(0.5)
    assert 3 <= counts(flying) - before <= 20.0 / WRITE_S + 1


def test_nothing_is_written_again_while_nothing_changes(flying: Bench) -> None:
    before = counts(flying)
    flying.wait(60.0)
    assert counts(flying) == before
    reads = [m for m in flying.autopilot.got("MISSION_REQUEST_LIST") if m.mission_type == RALLY]
    assert len(reads) >= 60.0 / READ_S - 1


def test_what_somebody_else_has_written_there_is_found_and_written_over(flying: Bench) -> None:
    flying.autopilot.items[RALLY][0].x += 5000
    flying.run(READ_S + 2.0)
    assert listed(flying) == [HOME]
    assert len(flying.journal("rally_overwritten")) == 1


def test_and_at_once_when_the_autopilot_tells_of_another_number_of_points(flying: Bench) -> None:
    flying.run(1.0)
    flying.autopilot.items[RALLY] = []
    flying.mpstate.deliver(said(stock.MAVLink_param_value_message(b"RALLY_TOTAL", 0.0, 2, 900, 65535)))
    flying.run(2.0)
    assert listed(flying) == [HOME]
    assert flying.mpstate.console.said("another program has written the autopilot's rally list")


def test_an_autopilot_that_has_just_started_is_left_alone(ready: Bench) -> None:
    """The fault: in its first seconds it has no list, so it was written, and said 'Only 0 items are supported'."""
    ready.autopilot.silent = True
    ready.run(5.0)
    ready.autopilot.silent = False
    ready.autopilot.items[RALLY] = []
    ready.autopilot.received.clear()
    ready.run(9.0)
    assert [m for m in ready.autopilot.got("MISSION_REQUEST_LIST") if m.mission_type == RALLY] == []
    assert [m for m in ready.autopilot.got("MISSION_COUNT") if m.mission_type == RALLY] == []
    ready.run(5.0)
    assert listed(ready) == [HOME]


def test_who_writes_there_for_ever_is_told_once_a_minute(flying: Bench) -> None:
    """The fault: 27 texts in five minutes. The journal has each time."""

    rounds = itertools.count(1)

    def writes() -> None:
        if next(rounds) % 20 == 0 and flying.autopilot.items[RALLY]:
            flying.autopilot.items[RALLY][0].x = HOME[0] + 5000

    flying.each_round = writes
    flying.wait(130.0)
    for station in (flying.a, flying.b):
        assert 2 <= station.texts().count("Rally list changed by another program") <= 3
    assert len(flying.journal("rally_overwritten")) >= 8


def test_a_refused_upload_is_told_and_tried_again(flying: Bench) -> None:
    flying.autopilot.results[RALLY] = mavlink.MAV_MISSION_DENIED
    fly_to(flying, IN_B, 40.0)
    (entry, *_more) = flying.journal("place_failed")
    assert entry["text"].endswith(
        "the autopilot refused the rally points: MAV_MISSION_DENIED. The companion tries again"
    )
    attempts = len(flying.journal("place_failed"))
    assert attempts <= 40.0 / 8.0 + 1
    flying.autopilot.results = {}
    flying.wait(12.0)
    assert listed(flying) == [RALLY_2]
    assert told(flying)[-1].startswith("a return goes to rally 2")


def test_a_point_that_comes_back_elsewhere_is_not_believed(flying: Bench) -> None:
    flying.autopilot.spoil = elsewhere
    fly_to(flying, IN_B, 30.0)
    assert told(flying)[-1].startswith("a return goes to home")
    assert flying.journal("place_failed")


def test_an_autopilot_that_falls_silent_in_an_upload_is_asked_again(flying: Bench) -> None:
    original = flying.autopilot._take
    flying.autopilot._take = lambda m: None if getattr(m, "mission_type", None) == RALLY else original(m)  # type: ignore
    fly_to(flying, IN_B, 40.0)
    del flying.autopilot._take
    flying.wait(15.0)
    assert listed(flying) == [RALLY_2]


# ---- the return ---------------------------------------------------------------------------------------------------


def orders(bench: Bench) -> list[tuple[str, object]]:
    """What the autopilot was told, in order: modes and rally points."""
    found: list[tuple[str, object]] = []
    for message in bench.autopilot.received:
        if message.get_type() == "COMMAND_LONG" and message.command == MODE:
            found.append(("mode", int(message.param2)))
        elif message.get_type() == "MISSION_ITEM_INT" and message.mission_type == RALLY:
            found.append(("place", (message.x, message.y)))
    return found


def test_the_place_is_written_before_the_return_is_ordered(flying: Bench) -> None:
    """The commander is lost over its own zone, and its places with it."""
    fly_to(flying, BETWEEN, 40.0)
    assert listed(flying) == [HOME]
    flying.autopilot.received.clear()
    lose(flying, flying.a)
    flying.until(lambda: flying.autopilot.mode == RTL, 20.0)
    assert orders(flying) == [("place", RALLY_2), ("mode", RTL)]


def test_a_return_never_waits_longer_than_a_moment_for_its_place(flying: Bench) -> None:
    fly_to(flying, IN_B, 40.0)
    original = flying.autopilot._take
    flying.autopilot._take = lambda m: None if getattr(m, "mission_type", None) == RALLY else original(m)  # type: ignore
    lose(flying, flying.b)
    flying.wait(5.5)  # the place has changed, and cannot be written
    asked_at = flying.clock.now
    flying.companion.autopilot.orders.fly(flying_return(), asked_at)
    flying.until(lambda: flying.autopilot.mode == RTL, 3.0)
    assert 0.9 <= flying.clock.now - asked_at <= 1.5


def test_a_pilot_who_takes_over_in_that_moment_is_not_ordered_home(flying: Bench) -> None:
    """The fault: the rules were in doubt, and the return that had waited for its place was ordered all the same."""
    fly_to(flying, IN_B, 40.0)
    original = flying.autopilot._take
    flying.autopilot._take = lambda m: None if getattr(m, "mission_type", None) == RALLY else original(m)  # type: ignore
    lose(flying, flying.b)
    flying.wait(5.5)
    flying.autopilot.received.clear()
    flying.companion.autopilot.orders.fly(flying_return(), flying.clock.now)
    flying.autopilot.mode, flying.autopilot._beat_at = 5, 0.0
    flying.wait(3.0)
    assert [order for order in orders(flying) if order[0] == "mode"] == []
    assert flying.autopilot.mode == 5


def test_what_is_decided_while_the_place_is_looked_at_is_not_undone(flying: Bench) -> None:
    """The last look before a return finds that no place is in reach any more."""
    fly_to(flying, BETWEEN, 40.0)
    places = flying.companion.autopilot.return_site
    look = places.before_return

    def finds_nothing(now: float, *, returning: bool) -> Callable[[], bool]:
        written = look(now, returning=returning)
        flying.companion.handle(PlaceJudged("home", False, "out of reach"), now)
        return written

    places.before_return = finds_nothing  # type: ignore[method-assign]
    flying.autopilot.received.clear()
    lose(flying, flying.a, flying.b)
    flying.until(lambda: flying.autopilot.mode in (LAND, RTL), 20.0)
    flying.wait(3.0)
    assert [what for kind, what in orders(flying) if kind == "mode"] == [LAND]
    assert flying.autopilot.mode == LAND


def flying_return() -> Any:
    from mavproxy_handover.core.common.model import FlightAction

    return FlightAction.RETURN


def returning(bench: Bench, place: tuple[float, float] = IN_B) -> None:
    """On its way to rally 2 by the companion's word, a hundred metres and more before it."""
    fly_to(bench, place, 40.0)
    assert listed(bench) == [RALLY_2]
    fly_to(bench, (place[0] + 0.002, place[1] - 0.001), 3.0)
    bench.companion.autopilot.orders.fly(flying_return(), bench.clock.now)
    bench.until(lambda: bench.autopilot.mode == RTL, 3.0)
    bench.run(1.0)
    bench.autopilot.received.clear()


def test_a_return_under_way_goes_elsewhere_when_its_place_has_become_worse(flying: Bench) -> None:
    returning(flying)
    lose(flying, flying.b)
    flying.wait(9.0)
    assert orders(flying) == [("place", HOME), ("mode", GUIDED), ("mode", RTL)]
    (entry,) = flying.journal("bounce")
    assert entry["place"] == "home"
    flying.wait(20.0)
    assert len(flying.journal("bounce")) == 1


def test_not_once_a_landing_is_ordered(flying: Bench) -> None:
    """The heartbeat still says RTL: to begin that anew would end the landing."""
    from mavproxy_handover.core.common.model import FlightAction

    returning(flying)
    orders_of_it = flying.companion.autopilot.orders
    assert orders_of_it.returning
    orders_of_it.fly(FlightAction.LAND, flying.clock.now)
    assert not orders_of_it.returning
    lose(flying, flying.b)
    flying.wait(12.0)
    assert flying.autopilot.mode == LAND
    assert flying.journal("bounce") == []


def test_not_without_a_commander(flying: Bench) -> None:
    returning(flying)
    lose(flying, flying.a, flying.b)
    flying.wait(20.0)
    assert [order for order in orders(flying) if order[1] == GUIDED] == []
    assert listed(flying) == [RALLY_2], "the list holds what is flown to"


def test_a_pilot_who_takes_over_while_it_begins_again_is_not_ordered_home(flying: Bench) -> None:
    """The fault: GUIDED was acknowledged, a pilot took over, and RTL was ordered next."""
    returning(flying)
    original = flying.autopilot._command

    def taken_over(m: Any) -> None:
        original(m)
        if m.command == MODE and int(m.param2) == GUIDED:
            flying.autopilot.mode = 5

    flying.autopilot._command = taken_over  # type: ignore[method-assign]
    lose(flying, flying.b)
    flying.wait(12.0)
    assert [order for order in orders(flying) if order[0] == "mode"] == [("mode", GUIDED)]
    assert flying.autopilot.mode == 5


def test_not_outside_the_fence(flying: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    returning(flying)
    monkeypatch.setattr(PlaceFinder, "in_fence", lambda *_: False)
    lose(flying, flying.b)
    flying.wait(12.0)
    assert orders(flying) == []


def test_not_while_the_autopilot_says_that_the_fence_is_broken(flying: Bench) -> None:
    returning(flying)
    fence = mavlink.MAV_SYS_STATUS_GEOFENCE
    lose(flying, flying.b)
    for _ in range(12):
        values = (fence, fence, 0, 0, 12600, 0, 100, 0, 0, 0, 0, 0, 0)
        flying.mpstate.deliver(said(stock.MAVLink_sys_status_message(*values)))
        flying.run(1.0)
    assert orders(flying) == []


def test_not_while_a_failsafe_of_the_autopilot_acts(flying: Bench) -> None:
    returning(flying)
    lose(flying, flying.b)
    for _ in range(24):
        beat = stock.MAVLink_heartbeat_message(2, 3, 0x81, RTL, mavlink.MAV_STATE_CRITICAL, 3)
        flying.mpstate.deliver(said(beat))
        flying.autopilot._beat_at = flying.clock.now + 5.0
        flying.run(0.5)
    assert orders(flying) == []


def test_not_in_a_return_that_somebody_else_has_ordered(flying: Bench) -> None:
    """The pilot's, the autopilot's failsafe's, the commander's."""
    fly_to(flying, IN_B, 40.0)
    flying.autopilot.mode = RTL
    flying.run(2.0)
    flying.autopilot.received.clear()
    lose(flying, flying.b)
    flying.wait(12.0)
    assert orders(flying) == []
    assert listed(flying) == [RALLY_2]
    flying.autopilot.mode = AUTO
    flying.wait(8.0)
    assert listed(flying) == [HOME]


@pytest.mark.parametrize("seconds", [9.0, 13.2, 13.4, 18.0, 30.0])
def test_a_return_that_began_while_the_autopilot_was_not_heard_keeps_the_place_that_it_flies_to(
    flying: Bench, seconds: float
) -> None:
    """The guard orders it, to the place that the list held. Meanwhile another place is better."""
    fly_to(flying, BETWEEN, 20.0)
    assert listed(flying) == [HOME]
    flying.autopilot.silent = True
    flying.autopilot.position, flying.autopilot.mode = BETWEEN, RTL
    lose(flying, flying.a)  # home is covered no more
    flying.run(seconds)
    assert flying.companion.autopilot.return_site.choice.place.name != "home"
    flying.autopilot.silent = False
    flying.autopilot.received.clear()
    flying.run(15.0)
    assert (listed(flying), counts(flying)) == ([HOME], 0)
    assert flying.companion.autopilot.return_site.where[0] == "home"
    assert flying.b.got("AUTHORITY_STATUS")[-1].place == "home"


def test_so_does_one_that_a_pilot_begins_before_the_better_place_could_be_written(flying: Bench) -> None:
    fly_to(flying, IN_B, 40.0)
    assert listed(flying) == [RALLY_2]
    original = flying.autopilot._take
    flying.autopilot._take = lambda m: None if m.get_type() == "MISSION_COUNT" else original(m)  # type: ignore
    lose(flying, flying.b)
    flying.until(lambda: flying.journal("place_failed"), 30.0)
    flying.autopilot.mode = RTL
    flying.run(2.0)
    assert flying.companion.autopilot.return_site.where is None, "a write has failed: the list may hold either"
    del flying.autopilot._take
    flying.wait(15.0)
    assert listed(flying) == [RALLY_2]
    assert flying.companion.autopilot.return_site.where[0] == "rally 2"
    flying.autopilot.mode = AUTO
    flying.wait(8.0)
    assert listed(flying) == [HOME]


def test_an_ordered_return_that_did_not_wait_for_its_place_begins_again_when_the_list_has_it(flying: Bench) -> None:
    fly_to(flying, IN_B, 40.0)
    fly_to(flying, (IN_B[0] + 0.002, IN_B[1] - 0.001), 3.0)
    original = flying.autopilot._take
    flying.autopilot._take = lambda m: None if m.get_type() == "MISSION_COUNT" else original(m)  # type: ignore
    lose(flying, flying.b)
    flying.wait(5.5)
    flying.companion.autopilot.orders.fly(flying_return(), flying.clock.now)
    flying.until(lambda: flying.autopilot.mode == RTL, 3.0)
    flying.run(2.0)
    del flying.autopilot._take
    flying.autopilot.received.clear()
    flying.wait(20.0)
    assert orders(flying) == [("place", HOME), ("mode", GUIDED), ("mode", RTL)]


def test_not_in_a_return_that_a_pilot_has_taken_over_in_between(flying: Bench) -> None:
    returning(flying)
    flying.autopilot.mode = 5
    flying.run(1.5)
    flying.autopilot.mode = RTL
    flying.run(1.5)
    lose(flying, flying.b)
    flying.wait(12.0)
    assert [order for order in orders(flying) if order[0] == "mode"] == []


# ---- energy -------------------------------------------------------------------------------------------------------


def test_the_best_place_and_not_the_nearest_tells_when_to_turn_back(flying: Bench) -> None:
    """GCSB is dead, so RTL goes home from the far end: that is what the energy has to be enough for."""
    fly_to(flying, IN_B, 40.0)
    flying.autopilot.battery = 0.34
    flying.wait(8.0)
    assert flying.journal("emergency") == [], "rally 2 is near"


@pytest.mark.parametrize(
    ("parameters", "made_mps"),
    [
        ({}, 4.0),
        ({"RTL_SPEED": 200.0}, 2.0),
        ({"RTL_SPEED": 0.0, "WPNAV_SPEED": 150.0}, 1.5),
        ({"RTL_SPEED": 0.0, "RTL_SPEED_MS": 2.0}, 2.0),
        ({"RTL_SPEED_MS": 0.0, "RTL_SPEED": 0.0, "WP_SPD": 1.5, "WPNAV_SPEED": 150.0}, 1.5),
    ],
)
def test_the_way_is_judged_at_the_speed_at_which_the_autopilot_returns(
    bench: Bench, tmp_path: Path, parameters: dict[str, float], made_mps: float
) -> None:
    """The faults: at cruise_mps of [energy], 7 m/s against the wind that is not known, whatever the mission's speed;
    and with RTL_SPEED 0 at the mission's speed, whatever the autopilot's is."""
    shutil.copytree(ROUND, tmp_path / "slow")
    text = (tmp_path / "slow" / "mission.toml").read_text(encoding="utf-8")
    assert "cruise_speed_mps = 10.0" in text
    text = text.replace("cruise_speed_mps = 10.0", "cruise_speed_mps = 4.0")
    (tmp_path / "slow" / "mission.toml").write_text(text, encoding="utf-8")
    bench.connect()
    bench.share(load(tmp_path / "slow"))
    bench.wait(3.0)
    bench.autopilot.parameters |= parameters  # by whoever: it says so to everybody
    bench.autopilot.tells += parameters
    fly_to(bench, (52.6790, 5.9270), 12.0)
    places = bench.companion.autopilot.return_site
    assert places.candidates.return_mps == made_mps
    assert places.choice.place.name == "home"
    # up and down 15 m, 5 s above the place
    assert places.choice.place.time_s == pytest.approx(places.choice.place.distance_m / made_mps + 34.33, abs=0.1)


def test_where_no_place_is_inside_the_fence_the_best_of_all_tells_of_the_energy(
    flying: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fault: then no number of energy was one, and it flew on until the battery was empty."""
    look = PlaceFinder.evaluate
    out = {"inside": False, "way_inside": False}
    monkeypatch.setattr(PlaceFinder, "evaluate", lambda *way: replace(look(*way), **out))
    fly_to(flying, IN_B, 5.0)
    assert flying.companion.autopilot.return_site.short is False
    flying.autopilot.battery = 0.2
    flying.until(lambda: flying.autopilot.mode == LAND, 30.0)
    assert flying.journal("emergency")[-1]["text"] == "energy only for the way back: land"


def test_where_no_place_is_in_reach_it_lands(flying: Bench) -> None:
    fly_to(flying, IN_B, 40.0)
    flying.autopilot.battery = 0.002
    flying.until(lambda: flying.autopilot.mode == LAND, 30.0)
    assert flying.journal("emergency")[-1]["text"] == "energy only for the way back: land"
    assert "OUT OF REACH" in flying.companion.autopilot.return_site.words()


# ---- restarts and faults ------------------------------------------------------------------------------------------


def test_after_a_restart_what_the_list_holds_is_read_first_and_stays(flying: Bench) -> None:
    fly_to(flying, IN_B, 40.0)
    flying.mpstate.unload("handover")
    flying.autopilot.received.clear()
    flying.load()
    flying.wait(25.0)
    assert listed(flying) == [RALLY_2]
    about = [m.get_type() for m in flying.autopilot.received if getattr(m, "mission_type", None) == RALLY]
    assert about[:2] == ["MISSION_REQUEST_LIST", "MISSION_REQUEST_INT"]
    assert "MISSION_COUNT" not in about


def test_a_place_that_is_none_of_the_missions_is_kept_after_a_restart(flying: Bench) -> None:
    fly_to(flying, IN_B, 40.0)
    flying.mpstate.unload("handover")
    flying.autopilot.items[RALLY][0].x, flying.autopilot.items[RALLY][0].y = 526790500, 59311000
    flying.load()
    flying.wait(20.0)
    assert listed(flying) == [(526790500, 59311000)]
    assert "place found in the list" in flying.companion.autopilot.return_site.words()


def test_after_a_reboot_of_the_autopilot_it_is_read_again(ready: Bench) -> None:
    ready.autopilot.silent = True
    ready.wait(5.0)
    ready.autopilot.silent = False
    ready.autopilot.items[RALLY] = []
    ready.wait(14.0)
    assert listed(ready) == [HOME]


def test_what_breaks_here_costs_no_authority_and_no_return(flying: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_arguments: Any) -> Any:
        raise RuntimeError("planted")

    monkeypatch.setattr(PlaceFinder, "evaluate", broken)
    flying.wait(3.0)
    assert flying.companion.faults["return sites"] >= 2
    assert not flying.companion.failed
    flying.companion.autopilot.orders.fly(flying_return(), flying.clock.now)
    flying.until(lambda: flying.autopilot.mode == RTL, 3.0)


def said(message: Any) -> Any:
    """A message of the autopilot as MAVProxy hands it over."""
    return stock.MAVLink(None).decode(bytearray(message.pack(stock.MAVLink(None, srcSystem=1, srcComponent=1))))


def test_links_that_are_weak_change_no_place(flying: Bench) -> None:
    fly_to(flying, IN_B, 40.0)
    flying.companion.handle(LinkJudged(252, True, False, "weak"), flying.clock.now)
    flying.wait(10.0)
    assert listed(flying) == [RALLY_2]
