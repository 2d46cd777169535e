# SPDX-License-Identifier: GPL-3.0-or-later

"""Declared gaps in coverage: `[[gap]]` of mission.toml, and their places on the route.

A gap is declared from the station whose zone ends to the station whose zone begins, or to the item at which it ends. An
item is needed for a landing outside every zone, or for one of several gaps between the same stations. The simulation of
the route finds the real gaps; both are matched here. Each declared gap becomes a stretch of the path, whose lines tell
from item and place of the aircraft how far it has come.

The time of a gap counts against the wind of the energy budget, with a stop at each corner; wings do not stop.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Final

from mavproxy_handover.core.safety.energy import ACCELERATION_MPSS, EnergyModel, Wind
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.mission.errors import Where
from mavproxy_handover.mission.geodesy import bearing_deg
from mavproxy_handover.mission.items import COMMANDS
from mavproxy_handover.mission.keys import GAP
from mavproxy_handover.mission.leg import round_by_round
from mavproxy_handover.mission.pieces import Line
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import Gap, Leg, RouteSimulation, Sample

__all__ = ["DeclaredGap", "Stretch", "read_gaps", "stretches", "undeclared"]

#: an aircraft farther from the path than this (m) is not on it
_CORRIDOR_M: Final = 50.0
#: length (m) of the path before and after a gap that belongs to its lines
_AROUND_M: Final = 1000.0


@dataclass(frozen=True, slots=True)
class DeclaredGap:
    """One `[[gap]]`. Stations by system id; of `to_station` and `to_item` one is None. `words`: "GCSA -> GCSB"."""

    from_station: int
    to_station: int | None
    to_item: int | None
    #: time (s) that it may take, from the end of one coverage to the beginning of the next
    limit_s: float
    note: str
    words: str


@dataclass(frozen=True, slots=True)
class _Way:
    """A leg of the path through a gap. Its beginning is counted along the route from the beginning of the gap (m)."""

    seq: int
    begins_m: float
    line: Line


@dataclass(frozen=True, slots=True)
class Stretch:
    """A declared gap on the route. `time_s`: its time against the wind; infinite: it cannot be flown."""

    declared: DeclaredGap
    found: Gap
    time_s: float
    #: ground speed that the route sets there (m/s)
    speed_mps: float
    _ways: tuple[_Way, ...]

    def along_m(self, waypoint: int, lat_deg: float, lon_deg: float) -> float | None:
        """Distance into the gap of an aircraft at this place that flies to this item.

        It is below 0 before the gap, and more than `found.length_m` after it. None: the aircraft is not on this path.
        """
        best_m, along_m = _CORRIDOR_M, None
        for way in self._ways:
            if way.seq == waypoint:
                along, beside, length = way.line.measure((lat_deg, lon_deg))
                if abs(beside) <= best_m:
                    best_m, along_m = abs(beside), way.begins_m + min(max(along, 0.0), length)
        return along_m


# --- reading ---


def read_gaps(where: Where, value: object, stations: Mapping[str, int], route: Route) -> tuple[DeclaredGap, ...]:
    """The `[[gap]]` tables. `stations`: system ids by name. Raises MissionError."""
    found: list[DeclaredGap] = []
    for number, entry in enumerate(where.array(value, "gap"), 1):
        inside = where.at(f"gap {number}")
        table = inside.table(entry, "the gap")
        inside.known_keys(table, GAP.names)
        begins = inside.choice(inside.need(table, "from"), "from", stations)
        ends = inside.need(table, "to")
        if isinstance(ends, str):
            to_station, to_item = stations[inside.choice(ends, "to", stations)], None
        else:
            to_station, to_item = None, _item(inside, ends, route)
        limit_s = inside.of_key(GAP["limit_s"], inside.need(table, "limit_s"))
        note = inside.text(table["note"], "note", 200) if "note" in table else ""
        words = f"{begins} -> {ends if to_item is None else f'item {to_item}'}"
        for other in found:
            if other.words == words:
                raise inside.error(f"the gap {words} is declared twice")
        found.append(DeclaredGap(stations[begins], to_station, to_item, limit_s, note, words))
    return tuple(found)


def _item(inside: Where, value: object, route: Route) -> int:
    seq = inside.whole(value, "to", 1, len(route.items))
    command = COMMANDS[route.items[seq - 1].command]
    if not command.flown:
        raise inside.error(f"to {seq} is {command.name} (allowed: a station's name, or an item that is flown to)")
    return seq


# --- on the route ---


@dataclass(frozen=True, slots=True)
class _Found:
    """A gap of the simulation, and the stations with coverage before and after it."""

    gap: Gap
    before: frozenset[int]
    after: frozenset[int]
    #: item of the leg on which it ends
    seq: int


def _found(simulation: RouteSimulation) -> Iterator[_Found]:
    """The gaps of the simulation, in order: each is a row of samples that no zone holds."""
    gaps = iter(simulation.gaps)
    before = frozenset[int]()
    ahead: tuple[Sample | None, ...] = (*simulation.samples[1:], None)
    for sample, following in zip(simulation.samples, ahead, strict=True):
        if sample.holding:
            before = sample.holding
        elif following is None:
            yield _Found(next(gaps), before, frozenset(), sample.seq)
        elif following.holding:
            yield _Found(next(gaps), before, following.holding, following.seq)


def _fits(declared: DeclaredGap, found: _Found) -> bool:
    if declared.from_station not in found.before:
        return False
    return declared.to_item == found.seq if declared.to_station is None else declared.to_station in found.after


def undeclared(gaps: Sequence[DeclaredGap], simulation: RouteSimulation) -> tuple[Gap, ...]:
    """Gaps of the route that the mission does not declare."""
    return tuple(found.gap for found in _found(simulation) if not any(_fits(declared, found) for declared in gaps))


def stretches(
    gaps: Sequence[DeclaredGap],
    legs: Sequence[Leg],
    simulation: RouteSimulation,
    settings: EnergySettings,
    wind: Wind | None = None,
    *,
    stops: bool = True,
) -> tuple[Stretch, ...]:
    """The declared gaps on the route of these legs, in the order of flight.

    A gap between two stations that occurs twice on the route is listed twice. `stops`: the aircraft stops at each
    corner.
    """
    if not gaps:
        return ()
    # only its speed against the wind is needed
    model = settings.over(EnergySettings(battery_wh=1.0, hover_w=10.0)).model(wind)
    assert model is not None
    made, legs = [], round_by_round(legs)
    for found in _found(simulation):
        # a declaration with an item is for this gap only; one with a station is for all gaps to it
        fitting = sorted((each for each in gaps if _fits(each, found)), key=lambda each: each.to_item is None)
        if fitting:
            made.append(_stretch(fitting[0], found.gap, legs, model, stops=stops))
    return tuple(made)


def _stretch(declared: DeclaredGap, gap: Gap, legs: Sequence[Leg], model: EnergyModel, *, stops: bool) -> Stretch:
    begins, ends = gap.distance_along_m, gap.distance_along_m + gap.length_m
    ways: list[_Way] = []
    time_s, speed_mps, along = 0.0, 0.0, 0.0
    for leg in legs:
        length = leg.length_m
        if along <= ends + _AROUND_M and along + length >= begins - _AROUND_M:
            ways.append(_Way(leg.seq, along - begins, Line(leg.start[:2], leg.end[:2])))
        if _has_part(leg, along, begins, ends):
            time_s += _time_s(leg, along, (begins, ends), model, stops=stops)
            speed_mps = max(speed_mps, leg.speed_mps)
        along += length
    return Stretch(declared, gap, max(time_s, gap.duration_s), speed_mps, tuple(ways))


def _has_part(leg: Leg, along: float, begins: float, ends: float) -> bool:
    return along <= ends and along + leg.length_m >= begins


def _time_s(leg: Leg, along: float, gap: tuple[float, float], model: EnergyModel, *, stops: bool) -> float:
    """Time of the part of a leg within the gap, against the wind.

    A stop at the end of the leg is included, if that is within the gap.
    """
    begins, ends = gap
    length = leg.length_m
    stays = along + length < ends
    hold_s = leg.hold_s if stays else 0.0
    if length <= 0.0:
        return leg.duration_s + hold_s
    made = model.made_good(bearing_deg(*leg.start[:2], *leg.end[:2]), leg.speed_mps)
    if made.speed_mps <= 0.0:
        return inf
    part = max(0.0, min(along + length, ends) - max(along, begins)) / length
    stop_s = made.speed_mps / ACCELERATION_MPSS if stays and stops else 0.0
    return part * max(leg.duration_s, length / made.speed_mps) + stop_s + hold_s
