# SPDX-License-Identifier: GPL-3.0-or-later

"""The plan of a flight, drawn from one seed: the coverage of stations, the mission, and the truth.

The ground is a plane (`plane.py`); zones are circles. A mission follows a chain of zones there and back until it lasts
ten minutes and has two handovers. In most flights faults are kept for the time after that: they strike when the flight
is ripe, and the mission is so much longer that there are borders left to be crossed by then. In some a gap lies between
two zones, in most of them also after that, and half of these missions declare it; in some stations' operators are
asked. The energy of the battery is enough for the mission with the reserve, and little more. The true cost of flying
and the battery's report differ a little from what is believed.

A flight aims at two causes. From seed `HARD` on, at two or three pairs of them: such flights find faults sooner, and
more than the rules promise (a failsafe of the autopilot that flies home what cannot get there is not overruled), so
they are for finding faults, and no measure of safety. From seed `DOWNLINK` on only the downlinks of stations fail, in a
rhythm or by chance, of one station or of all. No policy excuses anything then.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import cos, hypot, pi, sin
from random import Random
from typing import Final

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.safety.energy import EnergyModel, Piece, Wind, landing
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from sitl.campaign.faults import Insists, TimedFault
from sitl.campaign.gaps import GapPlan, find_gaps
from sitl.campaign.plane import HOME, Circle, Spot, bearing_deg
from sitl.campaign.steering import CELLS, Cell, downlink_faults, faults_for, policies_for

__all__ = ["DOWNLINK", "HARD", "LEAST_HANDOVERS", "FlightPlan", "StationPlan", "Truth", "draw", "left_at"]

#: the first seed of flights in which more than two causes strike
HARD: Final = 1_000_000_000
#: the first seed of flights in which only the downlink fails
DOWNLINK: Final = 2_000_000_000
#: how many pairs of causes more, with their odds
_MORE: Final = (1, 1, 2)
#: system id of the first station, the parent
FIRST: Final = 251
#: a flight is planned to last at least this time (s), with this number of handovers
LEAST_S, LEAST_HANDOVERS = 620.0, 2
#: part of the flights in which faults strike from take-off on
EARLY: Final = 1.0 / 6.0
#: in all others: the earliest time (s), the time after the second handover, and how much longer than that the mission
#: is
_RIPE_S, _BEHIND_S, _GOES_ON_S = (420.0, 560.0), 12.0, (150.0, 400.0)
#: a way has no more of them
_MOST_LEGS: Final = 40
#: of what is reckoned it may take so much more: wind, operators, transfers that fail
_LATER: Final = 1.3
#: zones of stations: radius from, to (m)
_RADII: Final = (1200.0, 3500.0)
#: how near their middles are, as a part of the sum of two radii: overlapping, in late flights so little that there is
#: a border on the way from one to the next, and with a gap between them
_OVERLAP, _LATE_OVERLAP, _GAP = (0.55, 0.85), (0.7, 0.85), (1.03, 1.15)


@dataclass(frozen=True, slots=True)
class StationPlan:
    """A station. `delay`: of its link, one way, in ticks.

    `answer`: the operator's answer to a question, and after how long (ticks); None: no answer. `asked` False: there are
    no questions. `asked_when_lost`: questions about forced handovers, too.
    """

    sysid: int
    name: str
    zone: Circle
    delay: int
    asked: bool = False
    answer: tuple[bool, int] | None = None
    asked_when_lost: bool = False


@dataclass(frozen=True, slots=True)
class Truth:
    """The true values, which may differ from the believed ones.

    `power`: the true cost of flying, as a part of the believed one; `gauge`: the battery's report of what is left, as a
    part of the truth. Only faults change the wind.
    """

    wind: Wind
    power: float
    gauge: float
    #: whether the autopilot acts on a low battery by itself, and whether it tells the wind
    battery_failsafe: bool
    tells_wind: bool
    #: whether it keeps its fence, or only tells of a breach; and whether there is a pilot with a radio
    fence_failsafe: bool = True
    radio: bool = True


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """One flight. Ticks are counted from the moment when the companion starts."""

    seed: int
    stations: tuple[StationPlan, ...]
    #: stations in the order in which the way needs them
    route: tuple[int, ...]
    #: what is flown to, the first straight above home
    way: tuple[Spot, ...]
    #: it lands at the end of the way; else it returns
    lands: bool
    #: where a return may go: home, rally points, and where the mission lands if that is another place
    places: tuple[Spot, ...]
    speed_mps: float
    settings: EnergySettings
    truth: Truth
    #: a circle around all of it that the autopilot keeps
    fence: Circle
    #: and the height that it keeps below (m)
    ceiling_m: float
    policies: Mapping[Cause, str]
    timed_faults: tuple[TimedFault, ...]
    #: how often operators of the commander send the aircraft on that was stopped or turned back, how long after that
    #: (s), and what they do when they are refused
    resumes: int
    resumes_after_s: float
    insists: Insists
    #: without a ground link the vehicle passes on what stations say to each other
    ground_link: bool
    #: part of the messages that is lost near the border of a zone
    loss: float
    cell: Cell
    #: gaps that the mission declares, and how long the guard lets the aircraft be alone (s)
    gaps: tuple[GapPlan, ...] = ()
    alone_max_s: float = 0.0
    #: time after take-off from which late faults may strike (s), after two handovers; and the same without them
    ripe_s: tuple[float, float] = (0.0, 0.0)
    start_at: int = 8 * 64

    @property
    def named_places(self) -> tuple[tuple[str, Spot], ...]:
        """Where a return may go, as the mission calls it."""
        last = len(self.places) - 1
        names = [f"rally {n}" if n else "home" for n in range(len(self.places))]
        if self.lands and last:
            names[last] = "landing"
        return tuple(zip(names, self.places, strict=True))

    @property
    def zones(self) -> dict[int, Circle]:
        """By system id."""
        return {station.sysid: station.zone for station in self.stations}

    def model(self) -> EnergyModel:
        """The believed values of energy."""
        wind = self.truth.wind if self.truth.tells_wind else None
        model = self.settings.model(wind)
        assert model is not None
        return model

    @property
    def words(self) -> str:
        """For people."""
        zones = ", ".join(f"{s.name} {s.zone.radius_m:.0f} m" for s in self.stations)
        wind = self.truth.wind
        return (
            f"flight {self.seed}: {len(self.way)} waypoints at {self.speed_mps:.1f} m/s, zones {zones}, wind "
            f"{wind.speed_mps:.1f} m/s from {wind.from_deg:.0f}, battery {self.settings.battery_wh:.0f} Wh; "
            f"aims at {self.cell.words}"
        )


def draw(seed: int) -> FlightPlan:
    """The flight of this seed, the same wherever it is drawn."""
    chance = Random(0x5EED_0000 + seed)
    cell = Cell.of(seed)
    gap = Cause.OUT_OF_COVERAGE in (cell.first, cell.second)
    late = chance.random() >= EARLY
    stations = _stations(chance, slow=cell.phase is Phase.ON_HANDOVER, silent=cell.at_a_border, gap=gap, late=late)
    speed = chance.uniform(8.0, 12.0)
    route, way, ripe_s = _way(chance, stations, speed, late=late)
    wind = Wind(chance.uniform(0.0, 5.0), chance.uniform(0.0, 360.0))
    truth = Truth(
        wind,
        chance.uniform(0.88, 1.05),
        chance.uniform(0.97, 1.02),
        chance.random() < 0.5,
        chance.random() < 0.5,
        chance.random() < 0.5 and not gap,  # else an aircraft that leaves its coverage is brought back before
        chance.random() < 0.6,
    )
    lands = chance.random() < 0.5
    spots = [HOME]
    for station in stations[1:]:
        if chance.random() < 0.7:
            spots.append(_around(chance, station.zone, 0.4))
    if lands:
        spots.append(Spot(way[-1].x_m, way[-1].y_m))
    settings = _energy(chance, way, speed, truth, lands)
    model = settings.model(wind if truth.tells_wind else None)
    assert model is not None
    gaps = _gaps(chance, stations, way, speed, model)
    longest_s = max((each.limit_s for each in gaps), default=0.0)
    farthest = max(spot.away_m(0.0, 0.0) for spot in (*way, *spots))
    if seed >= DOWNLINK:
        policies: Mapping[Cause, str] = {}
        timed_faults = downlink_faults(Random(0x5EED_D0D0 + seed))
    else:
        policies = policies_for(chance, cell)
        timed_faults = faults_for(chance, cell, late=late, gap=bool(gaps))
        timed_faults += _more(seed, late=late) if seed >= HARD else ()
    return FlightPlan(
        seed,
        stations,
        route,
        way,
        lands,
        tuple(spots),
        speed,
        settings,
        truth,
        Circle(0.0, 0.0, farthest + 60.0),
        max(way[0].alt_m, model.return_alt_m) + 15.0,
        policies,
        timed_faults,
        resumes=chance.choice((1, 2, 4)) if chance.random() < 0.3 else 0,
        resumes_after_s=chance.uniform(4.0, 40.0),
        insists=chance.choice(tuple(Insists)),
        ground_link=chance.random() < 0.7,
        loss=chance.choice((0.05, 0.2)) if chance.random() < 0.15 else 0.0,
        cell=cell,
        gaps=gaps,
        alone_max_s=longest_s if chance.random() < 0.95 else 0.5 * longest_s,
        ripe_s=(ripe_s, _LATER * ripe_s),
    )


def _more(seed: int, *, late: bool) -> tuple[TimedFault, ...]:
    """Faults for further pairs of causes, by chance together with the first ones or not."""
    chance = Random(0x5EED_4A2D + seed)
    found: list[TimedFault] = []
    for _ in range(chance.choice(_MORE)):
        cell = CELLS[chance.randrange(len(CELLS))]
        found += faults_for(chance, cell, late=late and chance.random() < 0.7, gap=False)
    return tuple(found)


def _stations(chance: Random, *, slow: bool, silent: bool, gap: bool, late: bool) -> tuple[StationPlan, ...]:
    """A chain of zones, home in the first. `slow`: operators take their time, and (`silent`) most never answer, so that
    a transfer is under way at a border; `gap`: there is one between two zones; `late`: before it there are two zones at
    least."""
    count = chance.choice((2, 2, 3, 3, 3, 4, 5))
    gap_at = 0
    if gap or chance.random() < 0.06:
        count = max(count, 3) if late else count
        gap_at = chance.randrange(2 if late else 1, count)
    heading = chance.uniform(0.0, 2.0 * pi)
    zones: list[Circle] = []
    for number in range(count):
        radius = chance.uniform(*_RADII)
        if not zones:
            away, turn = 0.4 * radius * chance.random(), chance.uniform(0.0, 2.0 * pi)
            zones.append(Circle(away * cos(turn), away * sin(turn), radius))
            continue
        before = zones[-1]
        overlap = _LATE_OVERLAP if late else _OVERLAP
        apart = (before.radius_m + radius) * chance.uniform(*(_GAP if number == gap_at else overlap))
        heading += chance.uniform(-0.9, 0.9)
        zones.append(Circle(before.x_m + apart * cos(heading), before.y_m + apart * sin(heading), radius))
    found = []
    for number, zone in enumerate(zones):
        asked = chance.random() < (0.8 if slow else 0.1)
        yes, after = chance.random() < 0.85, chance.randrange((10 if slow else 2) * 64, 25 * 64)
        answer = (yes, after) if chance.random() < 0.9 else None
        if slow and silent:
            asked, answer = True, answer if chance.random() < 0.1 else None
        delay, when_lost = chance.choice((1, 2, 4, 10)), asked and after % 3 == 0
        found.append(StationPlan(FIRST + number, f"GCS{'ABCDE'[number]}", zone, delay, asked, answer, when_lost))
    return tuple(found)


def _gaps(
    chance: Random,
    stations: tuple[StationPlan, ...],
    way: tuple[Spot, ...],
    speed_mps: float,
    model: EnergyModel,
) -> tuple[GapPlan, ...]:
    """All gaps of a mission that declares them."""
    spare, declared = chance.uniform(1.1, 1.6), chance.random() < 0.5
    zones = [station.zone for station in stations]
    return tuple(find_gaps(way, zones, model, speed_mps, spare)) if declared else ()


def left_at(way: Sequence[Spot], zone: Circle) -> tuple[float, Spot] | None:
    """How far along a way that begins inside a zone leaves it (m), and where; None: it does not."""
    length = 0.0
    for start, end in pairwise(way):
        away = start.away_m(end.x_m, end.y_m)
        if zone.margin_m(end.x_m, end.y_m) < 0.0:
            times = zone.crossed(start.x_m, start.y_m, end.x_m - start.x_m, end.y_m - start.y_m)
            part = min(1.0, max(0.0, 0.0 if times is None else times[1]))
            spot = Spot(start.x_m + part * (end.x_m - start.x_m), start.y_m + part * (end.y_m - start.y_m))
            return length + part * away, spot
        length += away
    return None


class _Walk:
    """A route as it grows, with the points where authority is to change.

    It changes to a station whose zone the route enters, or from one whose zone it leaves.
    """

    def __init__(self, stations: tuple[StationPlan, ...], alt_m: float) -> None:
        self._zones = [station.zone for station in stations]
        self.way, self.order, self.length_m = [Spot(0.0, 0.0, alt_m)], [0], 0.0
        #: how far along that is (m)
        self.moves_m: list[float] = []
        self._commander = 0

    def go(self, spot: Spot, number: int) -> None:
        """On to this waypoint in the zone of that station."""
        here = self.way[-1]
        away = here.away_m(spot.x_m, spot.y_m)
        borders = []
        for n, zone in enumerate(self._zones):
            times = zone.crossed(here.x_m, here.y_m, spot.x_m - here.x_m, spot.y_m - here.y_m) or ()
            borders += [(at, n, comes) for at, comes in zip(times, (True, False), strict=False) if 0.0 < at < 1.0]
        for at, n, comes in sorted(borders):
            if comes is (n == self._commander):
                continue
            x, y = here.x_m + at * (spot.x_m - here.x_m), here.y_m + at * (spot.y_m - here.y_m)
            others = [other for other in range(len(self._zones)) if other != n]
            self._commander = n if comes else max(others, key=lambda other: self._zones[other].margin_m(x, y))
            self.moves_m.append(self.length_m + at * away)
        self.length_m += away
        self.way.append(spot)
        self.order.append(number)


def _way(
    chance: Random, stations: tuple[StationPlan, ...], speed_mps: float, *, late: bool
) -> tuple[tuple[int, ...], tuple[Spot, ...], float]:
    """There and back along the chain until it is long enough; and when the flight is ripe (s)."""
    walk = _Walk(stations, chance.uniform(25.0, 80.0))
    ripe_s, goes_on_s = chance.uniform(*_RIPE_S), chance.uniform(*_GOES_ON_S)
    number, step, ripe = 0, 1, not late
    near = _before_gap(stations)
    while len(walk.order) < _MOST_LEGS:
        lasts_s, moves_s = walk.length_m / speed_mps, [each / speed_mps for each in walk.moves_m]
        long_enough = lasts_s >= LEAST_S and len(walk.order) > LEAST_HANDOVERS
        if late and len(moves_s) >= LEAST_HANDOVERS:
            ripe_s = max(ripe_s, moves_s[LEAST_HANDOVERS - 1] + _BEHIND_S)
            ripe = lasts_s > ripe_s
            long_enough &= lasts_s >= ripe_s + goes_on_s and moves_s[-1] > ripe_s + 2.0 * _BEHIND_S
            long_enough &= near == len(stations) or max(walk.order) >= near
        if ripe and long_enough:
            break
        number += step
        if not 0 <= number < (len(stations) if ripe else near):
            step = -step
            number += 2 * step
        walk.go(_around(chance, stations[number].zone, 0.35, walk.way[0].alt_m), number)
    route = tuple(stations[each].sysid for each in walk.order)
    return route, tuple(walk.way), min(ripe_s, 0.6 * walk.length_m / speed_mps) if late else 0.0


def _before_gap(stations: tuple[StationPlan, ...]) -> int:
    """How many stations stand before the first gap in the chain; all of them without one."""
    for number, (one, other) in enumerate(pairwise(stations), 1):
        if one.zone.margin_m(other.zone.x_m, other.zone.y_m) + other.zone.radius_m < 0.0:
            return number
    return len(stations)


def _around(chance: Random, zone: Circle, part: float, alt_m: float = 0.0) -> Spot:
    away, turn = part * zone.radius_m * chance.random(), chance.uniform(0.0, 2.0 * pi)
    return Spot(zone.x_m + away * cos(turn), zone.y_m + away * sin(turn), alt_m)


def _energy(chance: Random, way: tuple[Spot, ...], speed_mps: float, truth: Truth, lands: bool) -> EnergySettings:
    """A battery that is enough for the way and the reserve, and little more."""
    hover = chance.uniform(200.0, 500.0)
    cruise, spare = hover * chance.uniform(1.02, 1.2), chance.uniform(2.0, 4.0)

    def settings(battery_wh: float) -> EnergySettings:
        return EnergySettings(
            battery_wh=battery_wh,
            hover_w=hover,
            cruise_w=cruise,
            cruise_mps=speed_mps,
            airspeed_mps=speed_mps + spare,
            headwind_mps=max(3.0, truth.wind.speed_mps),
        )

    model = settings(100.0).model(truth.wind if truth.tells_wind else None)
    assert model is not None
    last = HOME if not lands else way[-1]
    need = model.need_wh([Piece(climb_m=way[0].alt_m), *_pieces((*way, last)), landing(way[0].alt_m)])
    # sometimes it is not enough: START is refused, and some operators order it again
    enough = chance.uniform(0.8, 0.99) if chance.random() < 0.04 else chance.uniform(1.03, 1.5)
    return settings((model.reserve_factor * need + hover / 60.0) / 0.8 * enough)


def _pieces(way: tuple[Spot, ...]) -> list[Piece]:
    pieces = []
    for start, end in pairwise(way):
        east, north = end.x_m - start.x_m, end.y_m - start.y_m
        pieces.append(Piece(length_m=hypot(east, north), bearing_deg=bearing_deg(east, north)))
    return pieces
