# SPDX-License-Identifier: GPL-3.0-or-later

"""Flies files of the corpus (`tests/mission/corpus.py`) on ArduPilot, and holds each flight against its walk.

In calm. A copter's times are those of `pace.py`, which has acceleration and braking; those of wings are the path's.
The count begins when the aircraft is half a metre above the ground, and ends when it is down again.

Needs an ArduCopter and an ArduPlane SITL program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mavproxy_handover.core.safety.energy import Wind
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.mission.energy import budget_of
from mavproxy_handover.mission.geodesy import distance_m, east_north_m
from mavproxy_handover.mission.items import COMMANDS, LANDINGS, RETURN_TO_LAUNCH, VTOL_LAND
from mavproxy_handover.mission.leg import Leg, round_by_round
from mavproxy_handover.mission.pace import Pace
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.path import path_of
from mavproxy_handover.mission.protocol_items import item_message
from sitl.vehicles import VehicleSpec, launch
from tests.mission.corpus import HOME, Case
from tests.mission.corpus_package import package_of
from tests.sitl.energy_flight import GUIDED, Flight

__all__ = ["Outcome", "Place", "fly", "judged"]

#: message id -> times a second, in the autopilot's time
_RATES: Final = {33: 10, 42: 10, 147: 4}
_AUTO_OF_WINGS: Final = 10
_START: Final = 300
CALM: Final = Wind(0.0, 0.0)
#: in the air (m above home)
_UP_M: Final = 0.5
#: positions nearer than this to the last one are no way (m)
_STEP_M: Final = 2.0
_LONGEST_S: Final = 2400.0
#: a quadplane flies so far (m) beyond the place of its landing before it comes to a stop
STOPS_M: Final = 15.0


@dataclass(frozen=True, slots=True)
class Place:
    """Where the aircraft was, when (s), the item that it flew to, and what it had used (Wh)."""

    time_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    seq: int
    used_wh: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """A flight against its walk.

    Fields: the most distance (m) between both, level and in height, each with the item where it was; then length (m),
    time (s) and energy (Wh), flown and walked.
    """

    name: str
    beside_m: float
    beside_seq: int
    above_m: float
    above_seq: int
    length_m: tuple[float, float]
    time_s: tuple[float, float]
    energy_wh: tuple[float, float]

    def row(self) -> str:
        """A line of a table."""
        parts = [f"| {self.name} | {self.beside_m:.1f} ({self.beside_seq}) | {self.above_m:.1f} ({self.above_seq})"]
        for flown, walked in (self.length_m, self.time_s, self.energy_wh):
            parts.append(f" {flown:.2f} | {walked:.2f} | {walked / flown - 1.0:+.1%}")
        return " |".join(parts) + " |"


def fly(case: Case, folder: Path, speedup: float = 15.0) -> tuple[MissionPackage, list[Place]]:
    """Fly a file of the corpus to its end."""
    package = package_of(case)
    kind = "arducopter" if case.kind == "copter" else case.kind
    vehicle = launch(kind, VehicleSpec(home=(*HOME, 0.0), speedup=speedup, parameters=_parameters(case.kind)), folder)
    flight = None
    found: list[Place] = []
    try:
        flight = Flight(vehicle.address(1), EnergySettings())
        flight.until(lambda: flight.now > 0.0 or flight.aircraft.telemetry.heartbeat.at >= 0.0, 60, "the autopilot")
        for message, hertz in _RATES.items():
            flight.command(511, message, 1e6 / hertz)
        flight.until(lambda: flight.now > 15.0, 60, "room for a mission")
        flight.upload([item_message(item, (1, 1), 0) for item in package.route.upload_items()])
        _start(flight, case.kind)
        flight.on_position = lambda: _note(flight, found)
        flight.until(lambda: _over(flight, package, found), _LONGEST_S, "the end of the mission")
    finally:
        if flight is not None:
            flight.wire.socket.close()
        vehicle.stop()
    return package, found


def _parameters(kind: str) -> dict[str, float]:
    return {"SCR_ENABLE": 0.0} if kind == "copter" else {"SCR_ENABLE": 0.0, "Q_RTL_MODE": 1.0}


def _start(flight: Flight, kind: str) -> None:
    """Arm as soon as the autopilot can, and begin."""
    mode = GUIDED if kind == "copter" else _AUTO_OF_WINGS
    for _ in range(90):
        if flight.command(176, 1, mode) and flight.command(400, 1):
            break
        end = flight.now + 2.0
        flight.until(lambda end=end: flight.now >= end, 10, "time to pass")
    else:
        raise AssertionError(f"it does not arm: {flight.texts[-6:]}")
    if kind == "copter":
        assert flight.command(_START)


def _note(flight: Flight, found: list[Place]) -> None:
    aircraft = flight.aircraft
    if aircraft.where is not None and (not found or aircraft.position.at > found[-1].time_s):
        found.append(Place(aircraft.position.at, *aircraft.where, aircraft.waypoint, flight.used_wh))


def _over(flight: Flight, package: MissionPackage, found: Sequence[Place]) -> bool:
    """Whether the flight is over."""
    if not found:
        return False
    up, landed = any(place.alt_m > 5.0 * _UP_M for place in found[::10]), found[-1].alt_m < 0.5 * _UP_M
    last = max(item.seq for item in package.route.items if COMMANDS[item.command].flown)
    return up and (not flight.aircraft.armed or (landed and found[-1].seq >= last and _rests(found)))


def _rests(found: Sequence[Place]) -> bool:
    """Whether the aircraft has not moved for five seconds."""
    last = found[-1]
    return all(
        distance_m(place.lat_deg, place.lon_deg, last.lat_deg, last.lon_deg) < _STEP_M
        for place in found[-50:]
        if place.time_s > last.time_s - 5.0
    )


# --- against the walk ---


def judged(name: str, package: MissionPackage, places: Sequence[Place]) -> Outcome:
    """The flight against the walk of its package."""
    first = next(n for n, place in enumerate(places) if place.alt_m > _UP_M)
    last = next(n for n in range(len(places) - 1, 0, -1) if places[n].alt_m > _UP_M)
    flown, legs = places[first : last + 1], round_by_round(package.legs(CALM))
    model = package.energy.model(CALM, package.profile.energy)
    assert model is not None
    budget = budget_of(package.route, package.cruise_speed_mps, model)
    turned, loose = [legs, *_about(package)], _loose(package)
    known = [place for place in flown if not any(_off(leg, place)[0] < far_m for leg, far_m in loose)]
    beside = max((min(_beside(each, place) for each in turned), place.seq) for place in known)
    above = max((_above(legs, place), place.seq) for place in flown)
    return Outcome(
        name,
        *beside,
        *above,
        (_length_m(flown), sum(leg.length_m for leg in legs)),
        (flown[-1].time_s - flown[0].time_s, _walked_s(package)),
        (flown[-1].used_wh - flown[0].used_wh, budget.need_wh),
    )


def _about(package: MissionPackage) -> list[tuple[Leg, ...]]:
    """Where wings fly that turn about to the other side: to which they do is not known before."""
    if not package.profile.flies_past:
        return []
    return [round_by_round(path_of(package.route, package.air(CALM), about=-1.0).legs)]


def _loose(package: MissionPackage) -> list[tuple[Leg, float]]:
    """Legs, and how far around each the way of wings is not known.

    A quadplane that lands is not known within `STOPS_M` of its place.
    """
    path = package.path(CALM)
    if path is None:
        return []
    landings = {item.seq for item in package.route.items if item.command == VTOL_LAND}
    stops = [(leg, STOPS_M) for leg in path.legs if leg.seq in landings and leg.length_m == 0.0]
    return [*((loose.leg, loose.radius_m) for loose in path.loose), *stops]


def _walked_s(package: MissionPackage) -> float:
    simulation = package.simulate(CALM)
    if package.profile.flies_past:
        return simulation.duration_s
    rests = frozenset(item.seq for item in package.route.items if item.command in (*LANDINGS, RETURN_TO_LAUNCH))
    return Pace(simulation.samples, rests).times_s[-1]


def _length_m(flown: Sequence[Place]) -> float:
    total, before = 0.0, flown[0]
    for place in flown[1:]:
        step = distance_m(before.lat_deg, before.lon_deg, place.lat_deg, place.lon_deg)
        if step >= _STEP_M:
            total, before = total + step, place
    return total


def _off(leg: Leg, place: Place) -> tuple[float, float]:
    """Level distance of a place from a leg, and its height above it there."""
    east, north = east_north_m(*leg.start[:2], *leg.end[:2])
    here_east, here_north = east_north_m(*leg.start[:2], place.lat_deg, place.lon_deg)
    square = east * east + north * north
    part = 0.0 if square == 0.0 else min(1.0, max(0.0, (here_east * east + here_north * north) / square))
    off_east, off_north = here_east - part * east, here_north - part * north
    height = leg.start[2] + part * (leg.end[2] - leg.start[2])
    if square == 0.0:
        height = min(max(leg.start[2], leg.end[2]), max(min(leg.start[2], leg.end[2]), place.alt_m))
    return (off_east**2 + off_north**2) ** 0.5, place.alt_m - height


def _near(legs: Sequence[Leg], place: Place) -> list[Leg]:
    """The legs to the item that is flown to, and those before and after it."""
    order = [leg.seq for leg in legs]
    seqs = {place.seq}
    for number, seq in enumerate(order):
        if seq == place.seq:
            seqs |= {order[max(0, number - 1)], order[min(len(order) - 1, number + 1)]}
    return [leg for leg in legs if leg.seq in seqs] or list(legs)


def _beside(legs: Sequence[Leg], place: Place) -> float:
    return min(_off(leg, place)[0] for leg in _near(legs, place))


def _above(legs: Sequence[Leg], place: Place) -> float:
    """How far its height is from that of the legs beside it."""
    measured = [_off(leg, place) for leg in _near(legs, place)]
    nearest = min(level for level, _height in measured)
    return min(abs(height) for level, height in measured if level <= nearest + 5.0)
