# SPDX-License-Identifier: GPL-3.0-or-later

"""Speeds and payloads that wait for a condition: the worst case is judged, for time, energy and handovers."""

from __future__ import annotations

import json

import pytest

from mavproxy_handover.mission.check import CheckReport, Severity, check
from mavproxy_handover.mission.conditions import speeds_of, waiting
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.package import MissionPackage, from_texts

HOME = (52.0, 5.0)
ENERGY = "[energy]\nbattery_wh = 500\nhover_w = 400\ncruise_w = 400\nheadwind_mps = 0\n"
TAKEOFF, WAYPOINT, RTL, LAND, DELAY, DISTANCE, YAW, SPEED, GRIPPER = 22, 16, 20, 21, 112, 114, 115, 178, 211


def item(command: int, *params: float, east_m: float = 0.0) -> MissionItem:
    place = offset(*HOME, east_m, 0.0) if east_m else (0.0, 0.0)
    one, two, three, four = (*params, *[0.0] * (4 - len(params)))
    return MissionItem(0, command, 3 if east_m else 2, one, two, three, four, *place, 30.0)


def numbered(*items: MissionItem) -> list[MissionItem]:
    return [
        MissionItem(n, each.command, each.frame, *each.params, each.lat_deg, each.lon_deg, each.alt_m)
        for n, each in enumerate(items, 1)
    ]


def package(*middle: MissionItem, overlap_m: float = 60.0, energy: str = "") -> MissionPackage:
    """Out to the east through two zones, 400 m and then as far, with so many metres of both."""
    items = numbered(item(TAKEOFF, east_m=0.01), *middle, item(WAYPOINT, east_m=800.0), item(LAND, east_m=800.0))
    lines = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{HOME[0]}\t{HOME[1]}\t0\t1"]
    lines += [
        f"{each.seq}\t0\t{each.frame}\t{each.command}\t"
        + "\t".join(f"{value:.7f}" for value in (*each.params, each.lat_deg, each.lon_deg, each.alt_m))
        + "\t1"
        for each in items
    ]
    features = [zone("A", -300.0, 400.0 + overlap_m), zone("B", 400.0, 1200.0)]
    toml = (
        'name = "p"\naircraft = "copter"\ndetector = "polygons"\nroute = "r.waypoints"\nzones = "zones.geojson"\n'
        f'cruise_speed_mps = 10\n{energy}\n[[stations]]\nname = "A"\nsysid = 251\n[[stations]]\nname = "B"\n'
        "sysid = 252\n"
    )
    texts = {
        "mission.toml": toml,
        "r.waypoints": "\n".join(lines) + "\n",
        "zones.geojson": json.dumps({"type": "FeatureCollection", "features": features}),
    }
    return from_texts(texts, "p")


def zone(name: str, west_m: float, east_m: float) -> dict[str, object]:
    corners = [(west_m, -300.0), (east_m, -300.0), (east_m, 300.0), (west_m, 300.0), (west_m, -300.0)]
    ring = [list(reversed(offset(*HOME, *corner))) for corner in corners]
    return {
        "type": "Feature",
        "properties": {"station": name},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }


def errors(report: CheckReport) -> list[str]:
    return [finding.text for finding in report.findings if finding.severity is Severity.ERROR]


@pytest.mark.parametrize("condition", [item(DELAY, 20.0), item(DISTANCE, 50.0), item(YAW, 90.0)])
def test_what_follows_a_condition_waits_until_the_next_flown_item(condition: MissionItem) -> None:
    items = numbered(item(SPEED, 1, 5), condition, item(SPEED, 1, 8), item(GRIPPER), item(WAYPOINT), item(SPEED, 1, 4))
    assert {seq: each.command for seq, each in waiting(items).items()} == {3: condition.command, 4: condition.command}


@pytest.mark.parametrize(
    ("fastest", "speeds"), [(False, [10.0, 4.0, 4.0, 4.0, 3.0, 3.0]), (True, [10.0, 10.0, 10.0, 12.0, 12.0, 12.0])]
)
def test_a_speed_that_waits_may_be_the_old_or_the_new_one(fastest: bool, speeds: list[float]) -> None:
    """4 m/s waits, then 12, then 3 m/s: each may be left out."""
    middle = [
        each
        for mps in (4.0, 12.0, 3.0)
        for each in (item(DELAY, 9.0), item(SPEED, 1, mps), item(WAYPOINT, east_m=100.0))
    ]
    items = numbered(item(WAYPOINT, east_m=50.0), *middle)
    found = speeds_of(items, waiting(items), 10.0, 10.0, fastest=fastest)
    flown = [mps for each, mps in found if each.command == WAYPOINT]
    assert flown == [speeds[0], speeds[1], speeds[3], speeds[4]]


def test_a_speed_without_a_condition_ends_the_doubt() -> None:
    items = numbered(item(DELAY, 9.0), item(SPEED, 1, 4), item(WAYPOINT), item(SPEED, 1, 7), item(WAYPOINT), item(RTL))
    for fastest, first in ((False, 4.0), (True, 10.0)):
        found = [mps for each, mps in speeds_of(items, waiting(items), 10.0, 10.0, fastest=fastest)]
        assert found[2:] == [first, 7.0, 7.0, 10.0]


def test_time_and_energy_are_those_of_the_slower_speed() -> None:
    """800 m at 4 m/s instead of 10 m/s take 120 s more, with 400 W: 13.3 Wh, less what slower stops save."""
    always, waits, plain = (
        check(package(*middle, overlap_m=90.0, energy=ENERGY))
        for middle in ([item(SPEED, 1, 4)], [item(DELAY, 30), item(SPEED, 1, 4)], [])
    )
    assert waits.simulation.duration_s == pytest.approx(always.simulation.duration_s)
    assert waits.simulation.duration_s == pytest.approx(plain.simulation.duration_s + 120.0, abs=1.0)
    assert waits.energy is not None
    assert always.energy is not None
    assert plain.energy is not None
    assert waits.energy.need_wh == pytest.approx(always.energy.need_wh)
    assert waits.energy.need_wh == pytest.approx(plain.energy.need_wh + 13.3, abs=1.0)


def test_energy_is_that_of_the_faster_speed_if_that_takes_more() -> None:
    """Drag at 20 m/s costs more than the time that is saved."""
    drags = ENERGY.replace("cruise_w = 400", "cruise_w = 700\nairspeed_mps = 25")
    always, waits = (
        check(package(*middle, overlap_m=200.0, energy=drags)).energy
        for middle in ([item(SPEED, 1, 20)], [item(DELAY, 30), item(SPEED, 1, 20)])
    )
    assert always is not None
    assert waits is not None
    assert waits.need_wh == pytest.approx(always.need_wh)


def test_the_time_of_a_handover_is_that_of_the_faster_speed() -> None:
    """50 m of both zones are 5 s at 10 m/s, which is too little, and 12.5 s at 4 m/s."""
    assert errors(check(package(item(SPEED, 1, 4), overlap_m=50.0))) == []
    (told,) = errors(check(package(item(DELAY, 30), item(SPEED, 1, 4), overlap_m=50.0)))
    assert told.startswith("handover 1 A -> B: 5.0 s inside both zones")


def test_a_payload_whose_release_waits_stays_on_board() -> None:
    drops, waits = (
        check(package(*middle, energy=ENERGY + "mass_kg = 4.0\npayload_kg = 1.0\n"))
        for middle in ([item(GRIPPER, 1, 0)], [item(DISTANCE, 90), item(GRIPPER, 1, 0)])
    )
    assert "energy: after item 2 it is flown without 1 kg of payload" in texts(drops)
    assert "energy: no item of the route drops the payload of 1 kg" in texts(waits)


def texts(report: CheckReport) -> list[str]:
    return [finding.text for finding in report.findings]
