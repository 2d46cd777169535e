# SPDX-License-Identifier: GPL-3.0-or-later

"""The seconds to each border over whole flights: how far they are from the truth, which the flight itself tells.

The embedded vehicle in simulated time, looked at once a second as the companion does; and a recorded flight of
ArduCopter.
"""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import pytest

from mavproxy_handover.mission import load
from mavproxy_handover.mission.crossings import Seen, WayAhead
from tests.depth import first
from tests.packages import MISSIONS, ROUND
from tests.sitl.flown_missions import AUTO, FlownMission, take_off

#: of the package `round`
RECORDED = Path(__file__).resolve().parents[1] / "data" / "flights" / "delivery-arducopter.csv"
PAUSE, CHANGE_SPEED = 193, 178
#: what is held to: over the last seconds before a border the error is no more than this (s)
LAST_S, MOST_S = 15.0, 3.0


@dataclass
class Counted(FlownMission):
    """A flight of a mission, the countdowns that were told in it, and when its borders came."""

    #: by number of the border: (simulated s, seconds told)
    told: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    #: the stations whose zones hold the aircraft, and since when (simulated s)
    held: list[tuple[float, frozenset[int]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        walk = self.package.simulate()
        self._finder = self.package.zone_finder()
        self._way = WayAhead.of(walk, self.package.route)
        self._looks = 0
        #: what holds the way after each border
        self.expected = [b.open for a, b in zip(walk.samples, walk.samples[1:], strict=False) if a.open != b.open]

    def look(self) -> None:
        """The seconds to each border, once a second."""
        copter, now = self.bench.vehicle.copter, self.bench.now_s
        where, (north, east, _up) = copter.location(), copter.body.velocity
        here = (where.lat_e7 / 1e7, where.lon_e7 / 1e7, copter.body.position[2])
        holding = self._finder.holding(*here)
        if not self.held or self.held[-1][1] != holding:
            self.held.append((now, holding))
        self._looks += 1
        if self._looks % 5 or not copter.armed or copter.land_complete or copter.mode.number != AUTO:
            return
        seen = Seen(copter.mission.current, *here, math.hypot(north, east), now)
        for border in self._way.borders(seen, 60.0):
            self.told.setdefault(border.number, []).append((now, border.in_s))

    def errors(self, after_s: float = -math.inf) -> dict[int, list[tuple[float, float]]]:
        """By border: how many seconds before it, and by how much what was told then was wrong."""
        came = [at for at, _holding in self.held[1:]]
        assert [holding for _at, holding in self.held[1:]] == self.expected
        return {
            number: [
                (came[number] - at, told - (came[number] - at)) for at, told in said if after_s <= at < came[number]
            ]
            for number, said in self.told.items()
        }


def begun(mission: str, folder: Path = MISSIONS, **parameters: float) -> Counted:
    """In AUTO, at the take-off."""
    package = load(folder / mission)
    return Counted(package, take_off(package, **parameters))


def hold(errors: dict[int, list[tuple[float, float]]], borders: int) -> None:
    """Every border was counted down to, and right."""
    last = {number: [error for left, error in each if left <= LAST_S] for number, each in errors.items()}
    assert set(last) == set(range(borders))
    assert all(len(each) >= 8 for each in last.values())
    worst = {number: max(each, key=abs) for number, each in last.items()}
    assert all(abs(error) <= MOST_S for error in worst.values()), worst


@pytest.mark.parametrize(("mission", "borders"), first(1, [("delivery", 8), ("linear", 4), ("corridor", 6)]))
def test_a_countdown_is_right_within_three_seconds_for_the_last_fifteen(mission: str, borders: int) -> None:
    flight = begun(mission)
    flight.land()
    hold(flight.errors(), borders)


def test_the_climb_before_the_first_leg_is_counted() -> None:
    """40 s before the first border the aircraft still climbs: a station was told "in 20 s" then."""
    flight = begun("delivery")
    flight.reach(2)
    flight.reach(3)
    flight.fly(30.0)
    came = flight.held[1][0]
    early = [told - (came - at) for at, told in flight.told[0] if 25.0 <= came - at <= 45.0]
    assert len(early) > 10
    assert max(map(abs, early)) <= MOST_S


def test_a_wait_at_a_waypoint_is_counted_and_ends_when_it_ends(tmp_path: Path) -> None:
    """20 s at waypoint 2, 14 s of flight before the first border: 15 s before it the aircraft still waits."""
    shutil.copytree(MISSIONS / "delivery", tmp_path / "delivery")
    plan = tmp_path / "delivery" / "delivery.plan"
    content = json.loads(plan.read_text(encoding="utf-8"))
    item = content["mission"]["items"][1]
    assert item["command"] == 16
    item["params"][0] = 20
    plan.write_text(json.dumps(content), encoding="utf-8")
    flight = begun("delivery", tmp_path)
    flight.reach(3)
    flight.fly(60.0, lambda: len(flight.held) > 2)
    came = flight.held[1][0]
    errors = [told - (came - at) for at, told in flight.told[0] if came - at <= 30.0]
    assert len(errors) >= 25
    assert max(map(abs, errors)) <= MOST_S


def test_after_a_stop_the_time_to_speed_up_is_counted() -> None:
    flight = begun("delivery")
    flight.reach(3)
    flight.fly(2.0)
    assert flight.bench.command(PAUSE, 0) == 0
    flight.fly(40.0)
    assert flight.bench.command(PAUSE, 1) == 0
    on_at = flight.bench.now_s
    flight.land()
    errors = flight.errors(after_s=on_at + 1.0)
    assert max(abs(error) for _left, error in errors[0]) <= MOST_S


@pytest.mark.parametrize("speed_mps", [4.0, 14.0])
def test_another_speed_that_the_commander_orders_is_followed_within_some_seconds(speed_mps: float) -> None:
    flight = begun("delivery")
    flight.reach(3)
    flight.fly(1.0)
    assert flight.bench.command(CHANGE_SPEED, 1, speed_mps) == 0
    ordered_at = flight.bench.now_s
    flight.fly(60.0, lambda: len(flight.held) > 2)
    came = flight.held[1][0]
    said = [(at, told - (came - at)) for at, told in flight.told[0] if at >= ordered_at + 6.0]
    assert said
    assert max(abs(error) for _at, error in said) <= MOST_S


def test_it_is_right_in_a_recorded_flight_of_arducopter_too() -> None:
    """Its positions once a second, so a border comes between two of them."""
    package = load(ROUND)
    finder, way = package.zone_finder(), WayAhead.of(package.simulate(), package.route)
    lines = RECORDED.read_text(encoding="utf-8").splitlines()[2:]
    looks = []
    for line in lines:
        at, waypoint, lat_deg, lon_deg, alt_m, speed_mps = line.split(",")
        seen = Seen(int(waypoint), float(lat_deg), float(lon_deg), float(alt_m), float(speed_mps), float(at))
        looks.append((seen, finder.holding(seen.lat_deg, seen.lon_deg, seen.alt_m)))
    assert len(looks) > 300
    came = [(a.now + b.now) / 2.0 for (a, before), (b, after) in pairwise(looks) if before != after]
    assert len(came) == 8
    errors: dict[int, list[tuple[float, float]]] = {}
    for seen, _holding in looks:
        for border in way.borders(seen, 60.0):
            if seen.now < came[border.number]:
                left = came[border.number] - seen.now
                errors.setdefault(border.number, []).append((left, border.in_s - left))
    hold(errors, 8)
