# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of one zone check: the finder's facts about every zone, and the arbiter's judgement of them.

The baseline is shapely's `contains_xy`, one call a zone, on the same polygons at the same places: the least that any
check must do. Ours measures the distance to every border as well. The zones stand in a row and overlap, so the aircraft
is inside one or two of them and far from the others. Two kinds of places: "anywhere" along the row, each far from the
one before, so that no result for one holds for the next; and "in flight", half a metre from one to the next.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import shapely
from shapely.geometry import Polygon

from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common import events
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Connect, ConnectAck
from mavproxy_handover.core.common.model import PROTOCOL_VERSION, Phase, Station
from mavproxy_handover.mission.zones import Zone, ZoneFinder
from sitl.bench.loop import BenchError
from sitl.bench.numbers import Pair, abba, compare, median, settled
from sitl.bench.results import Measurement, from_comparison

__all__ = ["Plan", "Row", "measure", "us_per_call"]

_LAT, _LON = 52.68, 5.92
_RADIUS_M, _STEP_M = 3000.0, 4000.0
_PER_LAT_M = 111_250.0
_PER_LON_M = _PER_LAT_M * math.cos(math.radians(_LAT))
_SPEED_MPS = 10.0
_PARENT = 1
_CHECKS_A_SECOND = 20
#: a tenth of a processor: the companion has other work, and its computer may be a third as fast as this one
_MOST_US = 0.1 / _CHECKS_A_SECOND * 1e6
#: and in flight, whatever zones there are
_MOST_IN_FLIGHT_US = 300.0
#: places of a flight, from the middle of the row on
_FLOWN = 600


@dataclass(frozen=True, slots=True)
class Plan:
    """Zones and corners to combine, processor time of one turn, and how many pairs (see `uplink.Plan`)."""

    zones: tuple[int, ...]
    corners: tuple[int, ...]
    turn_s: float
    least: int
    most: int
    uncertainty: float = 0.02


class Row:
    """A row of zones, the finder and the arbiter of an aircraft that flies along it."""

    def __init__(self, zones: int, corners: int) -> None:
        self.polygons = [_polygon(number, corners) for number in range(zones)]
        for polygon in self.polygons:
            shapely.prepare(polygon)
        stations = tuple(Station(1 + number, f"S{number}") for number in range(zones))
        self.finder = ZoneFinder(
            Zone(station.sysid, station.name, polygon) for station, polygon in zip(stations, self.polygons, strict=True)
        )
        self._now = 0.0
        self.arbiter = self._in_flight(stations)
        length_m = (zones - 1) * _STEP_M
        #: places along the row, longitude only: the row runs east
        self.places = [_LON + part / 97.0 * length_m / _PER_LON_M for part in range(98)]
        step = _SPEED_MPS / _CHECKS_A_SECOND / _PER_LON_M
        self.flight = [self.places[len(self.places) // 2] + number * step for number in range(_FLOWN)]

    def _in_flight(self, stations: tuple[Station, ...]) -> Arbiter:
        """An arbiter whose aircraft is on its mission, the first station in command."""
        arbiter = Arbiter(Identity("bench", stations, _PARENT), Limits(guard_required=False))
        arbiter.handle(events.AutopilotState(armed=False, flying=False), self._now)
        asked = arbiter.handle(events.StationHeard(_PARENT), self._now)
        for action in asked:
            if isinstance(action, events.Send) and action.station == _PARENT and isinstance(action.message, Connect):
                answer = ConnectAck(_PARENT, PROTOCOL_VERSION, action.message.nonce, 0, None, "S0", b"")
                arbiter.handle(events.StationMessage(_PARENT, answer), self._now)
        arbiter.handle(events.AutopilotState(armed=True, flying=True), self._now)
        if arbiter.view.phase is not Phase.ON_MISSION or arbiter.view.commander != _PARENT:
            raise BenchError("the arbiter of the zone check does not get into the air")
        return arbiter

    def check(self, place: float) -> None:
        """One check, as the companion makes it."""
        facts = self.finder.facts(_LAT, place, 90.0, _SPEED_MPS, 50.0)
        self._now += 1e-6  # time hardly moves: nothing runs out, as nothing does between two checks in flight
        self.arbiter.handle(events.PositionSeen(facts), self._now)

    def judge_alone(self, place: float) -> Callable[[float], None]:
        """The arbiter's part of a check, to be repeated."""
        seen = events.PositionSeen(self.finder.facts(_LAT, place, 90.0, _SPEED_MPS, 50.0))

        def judge(_place: float) -> None:
            self._now += 1e-6
            self.arbiter.handle(seen, self._now)

        return judge

    def contains(self, place: float) -> None:
        """The baseline."""
        for polygon in self.polygons:
            shapely.contains_xy(polygon, place, _LAT)


def _polygon(number: int, corners: int) -> Polygon:
    """A wavy outline around a place on the row."""
    centre = _LON + number * _STEP_M / _PER_LON_M
    outline = []
    for corner in range(corners):
        turn = 2.0 * math.pi * corner / corners
        radius = _RADIUS_M * (1.0 + 0.1 * math.sin(7.0 * turn) + 0.02 * math.sin(41.0 * turn + number))
        outline.append((centre + radius * math.sin(turn) / _PER_LON_M, _LAT + radius * math.cos(turn) / _PER_LAT_M))
    return Polygon(outline)


def us_per_call(job: Callable[[float], None], places: list[float], seconds: float) -> float:
    """Processor time of a call, over whole rounds of all places, for at least `seconds`; at least one round."""
    calls = 0
    began = time.thread_time()
    while True:
        for place in places:
            job(place)
        calls += len(places)
        spent = time.thread_time() - began
        if spent >= seconds:
            return spent / calls * 1e6


def measure(plan: Plan, say: Callable[[str], None]) -> Iterator[Measurement]:
    """Every combination of the plan, in turns."""
    for zones in plan.zones:
        for corners in plan.corners:
            row = Row(zones, corners)
            # so many zones that a round of all places would take long: every seventh place
            anywhere = row.places if zones * corners < 5000 else row.places[::7]
            yield _measured(plan, row, "anywhere", anywhere, (zones, corners), say)
            yield _measured(plan, row, "in flight", row.flight, (zones, corners), say)


def _measured(
    plan: Plan, row: Row, where: str, places: list[float], size: tuple[int, int], say: Callable[[str], None]
) -> Measurement:
    """One kind of places, in turns with the baseline."""
    zones, corners = size
    pairs: list[Pair] = []
    for order in abba():
        found = {ours: us_per_call(row.check if ours else row.contains, places, plan.turn_s) for ours in order}
        pairs.append(Pair(found[True], found[False]))
        if settled(pairs, plan.least, plan.uncertainty) or len(pairs) >= plan.most:
            break
    comparison = compare(pairs)
    judge = row.judge_alone(places[len(places) // 2])
    arbiter_us = median([us_per_call(judge, places, plan.turn_s / 5) for _ in range(3)])
    say(f"{zones} zones of {corners} corners, {where}: {comparison.ours:.0f} us a check")
    measurement = from_comparison(
        "zones",
        "CPU per check",
        "us",
        {"zones": zones, "corners": corners, "places": where},
        comparison,
        details={
            "of_which_arbiter_us": arbiter_us,
            "part_of_a_processor_at_20_hz": comparison.ours * _CHECKS_A_SECOND / 1e6,
        },
        limit=_MOST_IN_FLIGHT_US if where == "in flight" else _MOST_US,
    )
    return replace(measurement, judged="ours")
