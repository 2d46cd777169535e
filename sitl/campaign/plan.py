# SPDX-License-Identifier: GPL-3.0-or-later

"""What a flight is about, drawn from one seed: where stations cover, what is flown, and how things really are.

The ground is a plane (`plane.py`); zones are circles. A mission follows a chain of zones there and back until it lasts
ten minutes and has two handovers. In some a gap lies between two zones, and half of these missions declare it; in some
stations' operators are asked. The energy of the battery is enough for the mission with the reserve, and little more;
what flying costs, and what the battery says, is not quite what is believed of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import cos, hypot, pi, sin
from random import Random
from typing import Final

from mavproxy_handover.core.model import Phase
from mavproxy_handover.core.safety.causes import Cause
from mavproxy_handover.core.safety.energy import EnergyModel, Piece, Wind, landing
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from sitl.campaign.faults import Insists, Strike
from sitl.campaign.gaps import GapPlan, find_gaps
from sitl.campaign.plane import HOME, Circle, Spot, bearing_deg
from sitl.campaign.steering import Cell, policies_for, strikes_for

__all__ = ["FlightPlan", "StationPlan", "Truth", "draw"]

#: system id of the first station, the parent
FIRST: Final = 251
#: a flight is planned to last so long at least (s), with so many handovers
LEAST_S, LEAST_HANDOVERS = 620.0, 2
#: zones of stations: radius from, to (m)
_RADII: Final = (1200.0, 3500.0)
#: how near their middles are, as a part of the sum of two radii: overlapping, and with a gap between them
_OVERLAP, _GAP = (0.55, 0.85), (1.03, 1.15)


@dataclass(frozen=True, slots=True)
class StationPlan:
    """A station. `delay`: of its link, one way, in ticks. `answer`: its operator's when he is asked, and after how long
    (ticks); None: he never answers. `asked` False: nobody is."""

    sysid: int
    name: str
    zone: Circle
    delay: int
    asked: bool = False
    answer: tuple[bool, int] | None = None


@dataclass(frozen=True, slots=True)
class Truth:
    """How things are, whatever is believed. `power`: what flying really costs, as a part of what is believed;
    `gauge`: what the battery says is left, likewise. The wind never changes but by faults."""

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
    strikes: tuple[Strike, ...]
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
        """What is believed of energy."""
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
    stations = _stations(chance, slow=cell.phase is Phase.ON_HANDOVER, gap=gap)
    speed = chance.uniform(8.0, 12.0)
    route, way = _way(chance, stations, speed)
    wind = Wind(chance.uniform(0.0, 5.0), chance.uniform(0.0, 360.0))
    truth = Truth(
        wind,
        chance.uniform(0.88, 1.05),
        chance.uniform(0.97, 1.02),
        chance.random() < 0.5,
        chance.random() < 0.5,
        chance.random() < 0.5 and not gap,  # who is to leave its coverage would be brought back before
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
        policies_for(chance, cell),
        strikes_for(chance, cell),
        resumes=chance.choice((1, 2, 4)) if chance.random() < 0.3 else 0,
        resumes_after_s=chance.uniform(4.0, 40.0),
        insists=chance.choice(tuple(Insists)),
        ground_link=chance.random() < 0.7,
        loss=chance.choice((0.05, 0.2)) if chance.random() < 0.15 else 0.0,
        cell=cell,
        gaps=gaps,
        alone_max_s=longest_s if chance.random() < 0.95 else 0.5 * longest_s,
    )


def _stations(chance: Random, *, slow: bool, gap: bool) -> tuple[StationPlan, ...]:
    """A chain of zones, home in the first. `slow`: operators take their time; `gap`: there is one between two zones."""
    count = chance.choice((2, 2, 3, 3, 3, 4, 5))
    gap_at = chance.randrange(1, count) if gap or chance.random() < 0.06 else 0
    heading = chance.uniform(0.0, 2.0 * pi)
    zones: list[Circle] = []
    for number in range(count):
        radius = chance.uniform(*_RADII)
        if not zones:
            away, turn = 0.4 * radius * chance.random(), chance.uniform(0.0, 2.0 * pi)
            zones.append(Circle(away * cos(turn), away * sin(turn), radius))
            continue
        before = zones[-1]
        apart = (before.radius_m + radius) * chance.uniform(*(_GAP if number == gap_at else _OVERLAP))
        heading += chance.uniform(-0.9, 0.9)
        zones.append(Circle(before.x_m + apart * cos(heading), before.y_m + apart * sin(heading), radius))
    found = []
    for number, zone in enumerate(zones):
        asked = chance.random() < (0.8 if slow else 0.1)
        yes, after = chance.random() < 0.85, chance.randrange((10 if slow else 2) * 64, 25 * 64)
        answer = (yes, after) if chance.random() < 0.9 else None
        found.append(
            StationPlan(FIRST + number, f"GCS{'ABCDE'[number]}", zone, chance.choice((1, 2, 4, 10)), asked, answer)
        )
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


def _way(
    chance: Random, stations: tuple[StationPlan, ...], speed_mps: float
) -> tuple[tuple[int, ...], tuple[Spot, ...]]:
    """There and back along the chain until it is long enough."""
    alt = chance.uniform(25.0, 80.0)
    way, order = [Spot(0.0, 0.0, alt)], [0]
    number, step, length = 0, 1, 0.0
    while length < LEAST_S * speed_mps or len(order) <= LEAST_HANDOVERS:
        number += step
        if not 0 <= number < len(stations):
            step = -step
            number += 2 * step
        spot = _around(chance, stations[number].zone, 0.35, alt)
        length += spot.away_m(way[-1].x_m, way[-1].y_m)
        way.append(spot)
        order.append(number)
    return tuple(stations[each].sysid for each in order), tuple(way)


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
    # now and then it is not enough: START is refused, and some operators have it go on all the same
    enough = chance.uniform(0.8, 0.99) if chance.random() < 0.04 else chance.uniform(1.03, 1.5)
    return settings((model.reserve_factor * need + hover / 60.0) / 0.8 * enough)


def _pieces(way: tuple[Spot, ...]) -> list[Piece]:
    pieces = []
    for start, end in pairwise(way):
        east, north = end.x_m - start.x_m, end.y_m - start.y_m
        pieces.append(Piece(length_m=hypot(east, north), bearing_deg=bearing_deg(east, north)))
    return pieces
