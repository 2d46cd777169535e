# SPDX-License-Identifier: GPL-3.0-or-later

"""Flies a mission on ArduCopter and records where it goes, item by item. It needs an ArduCopter SITL program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.leg import Leg
from mavproxy_handover.mission.pieces import Line
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.protocol_items import item_message
from sitl.vehicles import VehicleSpec, launch
from tests.sitl.energy_flight import Flight, arm
from tests.sitl.guard_flight import HOME

__all__ = ["Flown", "Place", "fly", "hold_against"]

#: message id -> times a second, in the autopilot's time
_RATES = {33: 10, 42: 10}


@dataclass(frozen=True, slots=True)
class Place:
    """Where the aircraft was, when (s), and the item that it flew to."""

    time_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    seq: int


@dataclass(frozen=True, slots=True)
class Flown:
    """What is flown of an item against its legs: how far a place was from them at the most, and a leg's end from every
    place (m); lengths (m) and times (s) of both."""

    beside_m: float
    missed_m: float
    flown_m: float
    walked_m: float
    flown_s: float
    walked_s: float


def fly(folder: Path, route: Route, speedup: float = 10.0) -> list[Place]:
    """All places from take-off until the last item is flown to."""
    spec = VehicleSpec(home=HOME, speedup=speedup, parameters={"SCR_ENABLE": 0.0})
    vehicle = launch("arducopter", spec, folder)
    flight = None
    found: list[Place] = []
    try:
        flight = Flight(vehicle.address(1), EnergySettings())
        flight.until(lambda: flight.now > 0.0 or flight.aircraft.telemetry.heartbeat.at >= 0.0, 60, "the autopilot")
        for message, hertz in _RATES.items():
            flight.command(511, message, 1e6 / hertz)
        flight.until(lambda: flight.now > 15.0, 60, "room for a mission")
        flight.upload([item_message(item, (1, 1), 0) for item in route.upload_items()])
        arm(flight)
        assert flight.command(300)
        last = route.items[-1].seq
        aircraft = flight.aircraft

        def note() -> None:
            if aircraft.where is not None and (not found or aircraft.position.at > found[-1].time_s):
                found.append(Place(aircraft.position.at, *aircraft.where, aircraft.waypoint))

        flight.on_position = note
        flight.until(lambda: aircraft.waypoint >= last or not aircraft.armed, 3000, "the mission")
        assert flight.aircraft.armed, flight.texts
    finally:
        if flight is not None:
            flight.wire.socket.close()
        vehicle.stop()
    return found


def hold_against(legs: Sequence[Leg], places: Sequence[Place], seq: int) -> Flown:
    """What was flown to an item against the legs to it; at its beginning the legs before count as well.

    Positions can be lost on the way. Between two of them the aircraft is taken to fly straight on.
    """
    ours = [leg for leg in legs if leg.seq == seq and leg.length_m > 0.0]
    theirs = [place for place in places if place.seq == seq]
    spots = [(place.lat_deg, place.lon_deg) for place in _to_the_next(places, seq)]
    lines = [Line(leg.start[:2], leg.end[:2]) for leg in legs if leg.seq in (seq - 1, seq) and leg.length_m > 0.0]
    return Flown(
        beside_m=max(min(abs(line.measure((p.lat_deg, p.lon_deg))[1]) for line in lines) for p in theirs),
        missed_m=max(_away_m(leg.end[:2], spots) for leg in ours),
        flown_m=sum(distance_m(a.lat_deg, a.lon_deg, b.lat_deg, b.lon_deg) for a, b in pairwise(theirs)),
        walked_m=sum(leg.times * leg.length_m for leg in ours),
        flown_s=theirs[-1].time_s - theirs[0].time_s,
        walked_s=sum(leg.times * leg.duration_s + leg.hold_s for leg in ours),
    )


def _away_m(spot: tuple[float, float], path: Sequence[tuple[float, float]]) -> float:
    """How far a spot is from a path of straight lines; a line below a metre counts as its ends."""
    lines = (Line(a, b) for a, b in pairwise(path))
    return min(
        *(distance_m(*spot, *each) for each in path),
        *(abs(line.measure(spot)[1]) for line in lines),
    )


def _to_the_next(places: Sequence[Place], seq: int) -> list[Place]:
    """The places on the way to an item, and the first one after it: between the last two it was reached."""
    numbers = [number for number, place in enumerate(places) if place.seq == seq]
    return list(places[numbers[0] : numbers[-1] + 2])
