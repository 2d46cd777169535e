# SPDX-License-Identifier: GPL-3.0-or-later

"""The route check over whole flights of the embedded vehicle: silent where all is well, not where it is blown away.

In simulated time, seen as the vehicle sees itself (5 times a second) and as a station does (once), with positions that
are noisy and wander.
"""

from __future__ import annotations

import math
import random
import re
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from mavproxy_handover.core.safety.route import RouteCheck, RouteLimits
from mavproxy_handover.mission import load
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.track import Motion, RouteTracker
from tests.depth import first
from tests.sitl.flown_missions import AUTO, GUIDED, SET_MODE, FlownMission, take_off

MISSIONS = Path(__file__).resolve().parents[2] / "missions"
PAUSE, REPOSITION, CHANGE_SPEED, PARAMETER = 193, 192, 178, 180


@dataclass
class Watched(FlownMission):
    """A flight of a mission and what the route check says of it."""

    #: metres: of one position against the next, and how far they wander together
    noise_m: float = 0.0
    wander_m: float = 0.0
    told: list[str] = field(default_factory=list)
    worst_m: float = 0.0
    facts: int = 0

    def __post_init__(self) -> None:
        self._tracker, self._check = RouteTracker(self.package.route), RouteCheck(RouteLimits())
        self._dice = random.Random(7)

    def land(self) -> None:
        """Fly to the end of the mission."""
        super().land()
        assert self.facts > 100

    def look(self) -> None:
        """A position as noisy as it is to be, for the route check."""
        copter, now = self.bench.vehicle.copter, self.bench.now_s
        where, (north, east, _up) = copter.location(), copter.body.velocity
        wave = 2.0 * math.pi * now / 60.0
        off = [
            self.wander_m * turn(wave) + self._dice.uniform(-self.noise_m, self.noise_m)
            for turn in (math.sin, math.cos)
        ]
        lat_deg, lon_deg = offset(where.lat_e7 / 1e7, where.lon_e7 / 1e7, *off)
        on_mission = copter.armed and not copter.land_complete and copter.mode.number == AUTO
        course_deg = math.degrees(math.atan2(east, north)) + self._dice.uniform(-10.0, 10.0)
        motion = Motion(lat_deg, lon_deg, course_deg, math.hypot(north, east), copter.mission.current, on_mission)
        fact = self._tracker.follow(motion, now)
        if fact is not None:
            self.facts += 1
            self.worst_m = max(self.worst_m, abs(fact.cross_track_m))
        news = self._check.update(fact, now)
        self.told += [] if news is None else [news.text]


def begun(mission: str, beside_m: float = 0.0, **parameters: float) -> Watched:
    """In AUTO, at the take-off, so far east of the plan's home."""
    package = load(MISSIONS / mission)
    return Watched(package, take_off(package, beside_m, **parameters))


@pytest.mark.parametrize("mission", ["delivery", "corridor", "meridian"])
@pytest.mark.parametrize(("rate_hz", "noise_m", "wander_m"), first(1, [(5.0, 3.0, 6.0), (1.0, 3.0, 6.0)]))
def test_a_mission_that_is_flown_raises_no_alarm(mission: str, rate_hz: float, noise_m: float, wander_m: float) -> None:
    flight = begun(mission)
    flight.rate_hz, flight.noise_m, flight.wander_m = rate_hz, noise_m, wander_m
    flight.land()
    assert flight.told == []
    assert flight.worst_m < 3.0 + 1.5 * (noise_m + wander_m)


@pytest.mark.parametrize(("speed", "rate_hz"), first(2, [(300.0, 1.0), (2000.0, 5.0), (2000.0, 1.0)]))
def test_nor_does_another_speed_with_wide_corners(speed: float, rate_hz: float) -> None:
    flight = begun("delivery", WPNAV_SPEED=speed, WPNAV_RADIUS=1500.0)
    flight.rate_hz = rate_hz
    flight.land()
    assert flight.told == []


def test_nor_does_a_take_off_beside_the_plan_s_home() -> None:
    flight = begun("corridor", beside_m=45.0)
    flight.land()
    assert flight.told == []


@pytest.mark.parametrize("rate_hz", first(1, [1.0, 5.0]))
def test_nor_does_a_pause_in_the_middle_of_a_leg_nor_one_in_a_turn(rate_hz: float) -> None:
    flight = begun("delivery")
    flight.rate_hz, flight.noise_m = rate_hz, 3.0
    for waypoint, later_s in ((3, 15.0), (6, 0.5)):
        flight.reach(waypoint)
        flight.fly(later_s)
        assert flight.bench.command(PAUSE, 0) == 0
        flight.fly(40.0)
        assert flight.bench.command(PAUSE, 1) == 0
    flight.land()
    assert flight.told == []


@pytest.mark.parametrize("rate_hz", first(1, [1.0, 5.0]))
def test_nor_does_a_commander_who_flies_elsewhere_and_gives_the_mission_back(rate_hz: float) -> None:
    """GUIDED to a place 400 m off the route, then AUTO from there: it flies straight to its waypoint."""
    flight = begun("delivery")
    flight.rate_hz = rate_hz
    flight.reach(3)
    flight.fly(10.0)
    copter, home = flight.bench.vehicle.copter, flight.package.route.home
    assert flight.bench.command(SET_MODE, 1, GUIDED) == 0
    lat_deg, lon_deg = offset(home.lat_deg, home.lon_deg, 200.0, -500.0)
    copter.guided.go_to(_location(lat_deg, lon_deg))
    flight.fly(60.0)
    assert flight.bench.command(SET_MODE, 1, AUTO) == 0
    flight.land()
    assert flight.told == []


@pytest.mark.parametrize("rate_hz", first(1, [1.0, 5.0]))
def test_nor_does_a_waypoint_that_is_skipped(rate_hz: float) -> None:
    flight = begun("delivery")
    flight.rate_hz = rate_hz
    flight.reach(3)
    flight.fly(8.0)
    assert flight.bench.vehicle.copter.mission.set_current(4)
    flight.reach(6)
    assert flight.bench.vehicle.copter.mission.set_current(9)
    flight.land()
    assert flight.told == []


@pytest.mark.parametrize(("wind_m_s", "direction"), first(1, [(8.0, 135.0), (8.0, 270.0), (5.0, 0.0)]))
def test_nor_does_a_wind_that_can_be_made_good(wind_m_s: float, direction: float) -> None:
    flight = begun("delivery", SIM_WIND_SPD=wind_m_s, SIM_WIND_DIR=direction, SIM_WIND_T=1.0)
    flight.land()
    assert flight.told == []


@pytest.mark.parametrize("rate_hz", [5.0, 1.0])
def test_who_is_blown_off_the_route_and_finds_back_is_told_of_twice(rate_hz: float) -> None:
    """Waypoint 3 is east of 2; the wind comes from the north, so it is blown to the right."""
    flight = begun("delivery")
    flight.rate_hz = rate_hz
    flight.reach(3)
    flight.fly(8.0)
    assert flight.told == []
    flight.bench.vehicle.parameters.set("SIM_WIND_DIR", 0.0)
    flight.bench.vehicle.parameters.set("SIM_WIND_SPD", 17.0)
    assert flight.fly(40.0, lambda: bool(flight.told))
    assert re.fullmatch(r"off route: course \d+ deg off the leg to waypoint 3, \d+ m right of it", flight.told[0])
    flight.fly(10.0)
    flight.bench.vehicle.parameters.set("SIM_WIND_SPD", 0.0)
    flight.land()
    assert len(flight.told) == 2
    assert flight.told[1].startswith("on the route again: ")


def test_who_is_blown_backwards_is_told_of_by_the_course() -> None:
    """A head wind of 13 m/s: it stays on the line of the leg and goes the wrong way."""
    flight = begun("corridor", SIM_WIND_T=1.0)
    flight.reach(7)
    flight.fly(15.0)
    flight.bench.vehicle.parameters.set("SIM_WIND_DIR", 58.0)
    flight.bench.vehicle.parameters.set("SIM_WIND_SPD", 13.5)
    assert flight.fly(20.0, lambda: bool(flight.told))
    assert flight.told[0].startswith("off route: course 1")


def _location(lat_deg: float, lon_deg: float):  # type: ignore[no-untyped-def]
    from sitl.vehicles.builtin.frame import AltFrame, Location

    return Location(round(lat_deg * 1e7), round(lon_deg * 1e7), 40.0, AltFrame.ABOVE_HOME)
