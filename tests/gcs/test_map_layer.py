# SPDX-License-Identifier: GPL-3.0-or-later

"""What a station's map shows: of each mission, and in each situation. Places and colours written out."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_module.alarms import Level
from gcs_module.banner import Situation
from gcs_module.core import AuthorityHeard, FromVehicle, StationCore
from gcs_module.map_items import Item, Mark, Paths, Plate, Row, Sign
from gcs_module.map_layer import Border, Now, drawn, now_of, place_of
from gcs_module.mission_map import MissionMap, mission_map
from mavproxy_handover.core.common.messages import CrossingKey, HandoverAhead
from mavproxy_handover.core.common.model import FlightAction, Phase, Station
from mavproxy_handover.core.safety.route import TrackFact
from mavproxy_handover.mission.package import load
from tests.packages import MISSIONS, ROUND

A, B = 251, 252
BLUE, VERMILION, ORANGE, RED, WHITE, BLACK = (
    (0, 114, 178), (213, 94, 0), (255, 165, 0), (200, 0, 0), (255, 255, 255), (0, 0, 0),
)  # fmt: skip


@pytest.fixture(scope="module")
def delivery() -> MissionMap:
    return mission_map(load(ROUND))


@pytest.fixture(scope="module")
def meridian() -> MissionMap:
    return mission_map(load(MISSIONS / "meridian"))


def edited(folder: Path, mission: str, file: str, old: str, new: str) -> MissionMap:
    """The survey of a mission in which something was changed."""
    shutil.copytree(MISSIONS / mission, folder / mission)
    path = folder / mission / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return mission_map(load(folder / mission))


def paths(items: dict[str, Item], name: str) -> Paths:
    found = items[name]
    assert isinstance(found, Paths)
    return found


def sign(items: dict[str, Item], name: str) -> Sign:
    found = items[name]
    assert isinstance(found, Sign)
    return found


def rows(items: dict[str, Item]) -> list[str]:
    plate = items["plate"]
    assert isinstance(plate, Plate)
    return [row.words for row in plate.rows]


# ---- of a mission -------------------------------------------------------------------------------------------------


def test_the_delivery_has_two_zones_an_overlap_a_route_and_four_handovers(delivery: MissionMap) -> None:
    items = drawn(delivery, Now())
    assert set(items) == {
        "zone 251", "zone 252", "name 251", "name 252", "overlaps", "route 251", "route 252",
        "handover 1", "handover 2", "handover 3", "handover 4", "plate",
    }  # fmt: skip
    assert (paths(items, "zone 251").colour, paths(items, "zone 252").colour) == (BLUE, VERMILION)
    assert (paths(items, "route 251").colour, paths(items, "route 252").colour) == (BLUE, VERMILION)
    assert [len(line) for line in paths(items, "zone 251").lines] == [9]
    assert sign(items, "handover 1").words == ("1",)
    assert sign(items, "handover 1").mark is Mark.DIAMOND
    lat, lon = sign(items, "handover 1").place
    assert (round(lat, 4), round(lon, 4)) == (52.6781, 5.9262)


def test_the_route_has_its_corners_and_not_each_of_its_steps(delivery: MissionMap) -> None:
    places = [place for line in delivery.route["route 251"].lines for place in line]
    assert len(places) < 20
    assert (round(places[0][0], 5), round(places[0][1], 5)) == (52.679, 5.924)


def test_names_stand_inside_their_zones_and_outside_the_others(delivery: MissionMap) -> None:
    items = drawn(delivery, Now())
    (a_lat, a_lon), (b_lat, b_lon) = sign(items, "name 251").place, sign(items, "name 252").place
    assert 52.677 < a_lat < 52.681
    assert 52.677 < b_lat < 52.681
    assert a_lon < 5.926
    assert b_lon > 5.928


def test_an_overlap_is_hatched(delivery: MissionMap) -> None:
    edge, *hatches = delivery.overlaps.lines
    assert len(edge) == 7
    assert 8 <= len(hatches) <= 62
    west, east = min(lon for _lat, lon in edge), max(lon for _lat, lon in edge)
    assert all(west - 1e-9 <= lon <= east + 1e-9 for line in hatches for _lat, lon in line)


def test_a_zone_over_the_180th_meridian_is_in_one_piece(meridian: MissionMap) -> None:
    (ring,) = paths(drawn(meridian, Now()), "zone 251").lines
    lons = [lon for _lat, lon in ring]
    assert (min(lons), max(lons)) == pytest.approx((179.992494, 180.001501))


def test_circles_and_holes_and_limits_of_altitude_are_shown(tmp_path: Path) -> None:
    circles = edited(tmp_path / "1", "linear", "zones.geojson", '"radius_m"', '"max_alt_m": 120, "radius_m"')
    assert [len(line) for line in circles.zones[0].outline] == [129]
    assert circles.zones[0].words[-1] == "below 120 m"
    package = load(ROUND)
    area = package.zones[0].area
    assert area.geom_type == "Polygon"  # type: ignore[union-attr]
    holed = replace(package.zones[0], area=area.difference(area.centroid.buffer(0.0001)))  # type: ignore[union-attr]
    ground = mission_map(replace(package, zones=(holed, package.zones[1])))
    assert len(ground.zones[0].outline) == 2


def test_a_gap_that_is_declared_is_black_and_one_that_is_not_is_red(tmp_path: Path) -> None:
    east = drawn(mission_map(_shrunk(load(ROUND))), Now())
    assert paths(east, "uncovered").colour == (230, 0, 0)
    assert "gap" not in east


def _shrunk(package: Any) -> Any:
    """The delivery with a second zone that begins behind the end of the first."""
    from shapely.affinity import translate

    second = package.zones[1]
    return replace(package, zones=(package.zones[0], replace(second, area=translate(second.area, 0.003, 0.0))))


# ---- in a situation -----------------------------------------------------------------------------------------------


def test_the_commanders_zone_is_broad_and_says_so(delivery: MissionMap) -> None:
    items = drawn(delivery, Now(commander=B))
    assert (paths(items, "zone 251").width, paths(items, "zone 252").width) == (2, 5)
    assert paths(items, "zone 252").edged
    assert sign(items, "name 252").words[0] == "GCSB COMMANDS"
    assert sign(items, "name 252").plate == VERMILION
    assert sign(items, "name 251").words[0] == "GCSA"
    assert (sign(items, "name 251").plate, sign(items, "name 251").colour) == (WHITE, BLUE)


def test_a_name_is_read_on_its_plate_whatever_its_stations_colour(delivery: MissionMap) -> None:
    light = replace(delivery, zones=(replace(delivery.zones[0], colour=(230, 159, 0)), *delivery.zones[1:]))
    calm, commands = (sign(drawn(light, Now(commander=commander)), "name 251") for commander in (B, A))
    assert (calm.colour, calm.plate) == (BLACK, WHITE)
    assert (commands.colour, commands.plate) == (BLACK, (230, 159, 0))


def test_nobodys_zone_is_broad_where_nobody_commands(delivery: MissionMap) -> None:
    items = drawn(delivery, Now(commander=None))
    assert [paths(items, f"zone {station}").width for station in (A, B)] == [2, 2]


def test_only_what_changed_is_another_item(delivery: MissionMap) -> None:
    before = drawn(delivery, Now(commander=A, border=Border(A, B, "GCSA -> GCSB", 12), at=(2, 0.0)))
    after = drawn(delivery, Now(commander=A, border=Border(A, B, "GCSA -> GCSB", 11), at=(2, 10.0)))
    assert {name for name in after if after[name] != before[name]} == {"handover 1", "plate"}
    given = drawn(delivery, Now(commander=B))
    assert {name for name in given if given[name] != before[name]} == {
        "zone 251", "zone 252", "name 251", "name 252", "handover 1", "plate",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("at", "border", "shown"),
    [
        ((2, 0.0), Border(A, B, "GCSA -> GCSB", 23), "handover 1"),
        ((9, 0.0), Border(B, A, "GCSB -> GCSA", 3), "handover 4"),
        (None, Border(A, B, "GCSA -> GCSB", 23), None),
        ((99, 0.0), Border(A, B, "GCSA -> GCSB", 23), None),
        ((2, 0.0), Border(B, 253, "GCSB -> GCSC", 23), None),
    ],
)
def test_the_seconds_stand_at_the_next_border_between_the_two(
    delivery: MissionMap, at: tuple[int, float] | None, border: Border, shown: str | None
) -> None:
    items = drawn(delivery, Now(border=border, at=at))
    counted = [name for name, item in items.items() if isinstance(item, Sign) and item.plate == ORANGE]
    assert counted == ([] if shown is None else [shown])
    assert any(f"in {border.in_s} s" in row for row in rows(items)), "the plate has them in any case"


def test_a_border_that_is_reached_is_now(delivery: MissionMap) -> None:
    items = drawn(delivery, Now(border=Border(A, B, "GCSA -> GCSB", 0), at=(2, 0.0)))
    assert sign(items, "handover 1").words == ("GCSA -> GCSB now",)


def test_the_place_of_a_return_is_a_star_and_red_on_the_way_there(delivery: MissionMap) -> None:
    place = ("rally 2", 52.67918, 5.931984)
    calm = sign(drawn(delivery, Now(place=place)), "return")
    assert (calm.words, calm.place, calm.mark, calm.plate) == (("return: rally 2",), place[1:], Mark.STAR, WHITE)
    going = sign(drawn(delivery, Now(place=place, returning=True)), "return")
    assert (going.words, going.plate, going.colour) == (("RETURNS TO rally 2",), RED, WHITE)


def test_the_plate_says_where_it_returns_to_now_whatever_was_decided_first(delivery: MissionMap) -> None:
    now = Now("NO COMMANDER - RTL", Level.EMERGENCY, "RETURN to rally 2", place=("home", 1.0, 2.0), returning=True)
    assert rows(drawn(delivery, now)) == ["NO COMMANDER - RTL", "RETURN to rally 2", "returns to home"]


def test_an_emergency_is_white_on_red_with_its_cause(delivery: MissionMap) -> None:
    wrong = "GCSB silent 5 s: RTL to rally 2, 1.9 km, needs 21 % of 38 %, covered by GCSA"
    items = drawn(delivery, Now("NO COMMANDER - RTL", Level.EMERGENCY, wrong))
    plate = items["plate"]
    assert plate == Plate(
        (
            Row("NO COMMANDER - RTL", WHITE, RED),
            Row("GCSB silent 5 s: RTL to rally 2, 1.9 km, needs 21 % of 38 %,", WHITE, RED),
            Row("covered by GCSA", WHITE, RED),
        )
    )


def test_another_mission_in_flight_leaves_the_zones_alone(delivery: MissionMap) -> None:
    items = drawn(delivery, Now(own_route=False))
    assert set(items) == {"zone 251", "zone 252", "name 251", "name 252", "overlaps", "plate"}


def test_without_a_mission_there_is_the_plate(delivery: MissionMap) -> None:
    items = drawn(None, Now("CONTROL: GCSA", border=Border(A, B, "GCSA -> GCSB", 5), place=("home", 1.0, 2.0)), 1)
    assert set(items) == {"return", "plate"}
    assert rows(items) == ["CONTROL: GCSA", "GCSA -> GCSB in 5 s", "a return goes to home"]
    assert items["plate"].number == 1  # type: ignore[union-attr]


# ---- from what a station knows ------------------------------------------------------------------------------------


def test_what_a_station_knows_becomes_what_is_shown() -> None:
    core = StationCore(Station(A, "GCSA"), "drone-1", (Station(B, "GCSB"),), automatic=())
    core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3), 100.0)
    core.handle(FromVehicle(HandoverAhead(CrossingKey(A, B, 1, 3), 20, None, None)), 100.0)
    situation = Situation("drone-1", Phase.ON_MISSION, "GCSA", True, "", "AUTO", 0.5)
    track = TrackFact(2, 0.0, None, 40.0, 100.0)
    found = now_of(core, situation, "", ("home", 1.0, 2.0), track, 107.5, own_route=True)
    assert found == Now(
        "CONTROL: GCSA (you)",
        Level.INFO,
        "",
        A,
        Border(A, B, "GCSA -> GCSB", 13),
        ("home", 1.0, 2.0),
        False,
        (2, 40.0),
        True,
        old=False,
        seconds=107.0,
    )
    late = now_of(core, situation, "", None, None, 130.0, own_route=False)
    assert (late.border, late.at, late.own_route) == (Border(A, B, "GCSA -> GCSB", 0), None, False)


@pytest.mark.parametrize(
    ("changes", "returning"),
    [
        ({}, False),
        ({"mode": "RTL"}, True),
        ({"action": FlightAction.RETURN}, True),
        ({"action": FlightAction.HOLD}, False),
        ({"action": FlightAction.LAND, "mode": "LAND"}, False),
    ],
)
def test_who_returns(changes: dict[str, Any], returning: bool) -> None:
    core = StationCore(Station(A, "GCSA"), "drone-1", (), automatic=())
    situation = replace(Situation("drone-1", Phase.ON_MISSION, "GCSA", True, "", "AUTO", 0.5), **changes)
    assert now_of(core, situation, "", None, None, 1.0, own_route=True).returning is returning


@pytest.mark.parametrize(
    ("name", "lat", "lon", "found"),
    [
        ("rally 2", 526791800, -59319840, ("rally 2", 52.67918, -5.931984)),
        (b"home", 0, 0, ("home", 0.0, 0.0)),
        ("", 526791800, 59319840, None),
        ("x\x1b[2J", 1, 1, None),
        (b"\xff\x00", 1, 1, None),
        ("home", 900000001, 1, None),
        ("home", 1, -1800000001, None),
    ],
)
def test_where_a_return_goes_as_the_vehicle_says_it(name: str, lat: int, lon: int, found: object) -> None:
    assert place_of(SimpleNamespace(place=name, place_lat=lat, place_lon=lon)) == found


def test_what_was_heard_long_ago_is_not_shown_as_if_it_were_true_now(delivery: MissionMap) -> None:
    now = Now(
        "drone-1: NOT HEARD FOR 12 s",
        Level.WARNING,
        commander=A,
        place=("home", 1.0, 2.0),
        returning=True,
        old=True,
        seconds=77.0,
    )
    items = drawn(delivery, now)
    assert paths(items, "zone 251").width == paths(items, "zone 252").width == 2
    assert sign(items, "name 251").words[0] == "GCSA commanded when heard last"
    assert sign(items, "name 251").plate == WHITE
    assert sign(items, "return").words == ("return: home",)
    plate = items["plate"]
    assert isinstance(plate, Plate)
    assert [row.words for row in plate.rows] == [
        "drone-1: NOT HEARD FOR 12 s",
        "when heard last a return went to home",
    ]
    assert plate.at == 77.0


def test_the_seconds_to_a_border_are_gone_with_the_vehicle() -> None:
    core = StationCore(Station(A, "GCSA"), "drone-1", (Station(B, "GCSB"),), automatic=())
    core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 1), 100.0)
    core.handle(FromVehicle(HandoverAhead(CrossingKey(A, B, 1, 1), 12.0, None, None)), 100.0)
    fresh = Situation("drone-1", Phase.ON_MISSION, "GCSA", heard_s=1.0)
    old = replace(fresh, heard_s=3.5)
    seen = [now_of(core, each, "", None, None, 102.7, own_route=True) for each in (fresh, old)]
    assert [now.border for now in seen] == [Border(A, B, "GCSA -> GCSB", 10), None]
    assert [(now.old, now.seconds) for now in seen] == [(False, 102.0), (True, 102.0)]
