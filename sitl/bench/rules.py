# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of the rules for the main loop, call by call in this process: zone checks, decisions, energy.

A zone check is the finder's facts about every zone, and the arbiter's judgement of them. Its baseline is shapely's
`contains_xy`, one call a zone, on the same polygons at the same places: the least that any check must do. Ours measures
the distance to every border as well. The zones stand in a row and overlap, so the aircraft is inside one or two of them
and far from the others. Two kinds of places: "anywhere" along the row, each far from the one before, so that no result
for one holds for the next; and "in flight", half a metre from one to the next.

Decisions, a second of energy in flight, the ways back and the route of a mission have another baseline: one zone check,
of two zones with 50 corners, which the companion makes twenty times a second. A second of energy covers the autopilot's
messages of one second and the fact that is made of them; all of it is taken to happen in one tick. A decision covers
all that the rules do if nothing is new, or if a condition begins or ends.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, Final

import shapely
from pymavlink.dialects.v20 import handover as mavlink
from shapely.geometry import Polygon

from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common import events
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Connect, ConnectAck
from mavproxy_handover.core.common.model import PROTOCOL_VERSION, Phase, Station
from mavproxy_handover.core.safety.energy import Piece, way_home
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.mission.zones import Zone, ZoneFinder
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.vehicle.state import VehicleState
from sitl.bench.results import Comparison, Measurement, Pair, Say, compare, from_comparison, in_turns, settled
from sitl.bench.rig import BenchError

__all__ = [
    "ENERGY",
    "ENERGY_QUICK",
    "ZONES",
    "ZONES_QUICK",
    "Calls",
    "Judge",
    "Pilot",
    "Row",
    "ZonesPlan",
    "energy",
    "zones",
]

Job = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Calls:
    """How long calls are made: processor time of one turn, least and most pairs, and the uncertainty that ends it."""

    turn_s: float
    least: int
    most: int
    uncertainty: float = 0.02


def us_per_call(job: Job, places: Sequence[float], seconds: float) -> float:
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


def beside(job: Job, baseline: Job, places: Sequence[float], calls: Calls) -> Comparison:
    """What a call of the job costs, in turns with the baseline, in microseconds."""
    pairs: list[Pair] = []
    for found in in_turns(lambda ours: us_per_call(job if ours else baseline, places, calls.turn_s)):
        pairs.append(Pair(*found))
        if settled(pairs, calls.least, calls.uncertainty) or len(pairs) >= calls.most:
            break
    return compare(pairs)


# ---- zone checks ----------------------------------------------------------------------------------------------------

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


@dataclass(frozen=True, slots=True)
class ZonesPlan:
    """Zones and corners to combine."""

    zones: tuple[int, ...]
    corners: tuple[int, ...]
    calls: Calls


ZONES = ZonesPlan((2, 10, 100), (50, 1000), Calls(0.2, 4, 8))
ZONES_QUICK = ZonesPlan((2, 10), (50,), Calls(0.05, 1, 2))


def zones(plan: ZonesPlan, _folder: Path, say: Say) -> Iterator[Measurement]:
    """Every combination of the plan."""
    for size in ((zones, corners) for zones in plan.zones for corners in plan.corners):
        row = Row(*size)
        # so many zones that a round of all places would take long: every seventh place
        anywhere = row.places if math.prod(size) < 5000 else row.places[::7]
        for where, places, limit in (("anywhere", anywhere, _MOST_US), ("in flight", row.flight, _MOST_IN_FLIGHT_US)):
            comparison = beside(row.check, row.contains, places, plan.calls)
            judge = row.judge_alone(places[len(places) // 2])
            arbiter_us = median(us_per_call(judge, places, plan.calls.turn_s / 5) for _ in range(3))
            say(f"{size[0]} zones of {size[1]} corners, {where}: {comparison.ours:.0f} us a check")
            yield from_comparison(
                "zones",
                "CPU per check",
                "us",
                {"zones": size[0], "corners": size[1], "places": where},
                comparison,
                details={
                    "of_which_arbiter_us": arbiter_us,
                    "part_of_a_processor_at_20_hz": comparison.ours * _CHECKS_A_SECOND / 1e6,
                },
                limit=limit,
                judged="ours",
            )


# ---- decisions and energy -------------------------------------------------------------------------------------------

#: what decision and energy may cost a tick
_MOST_A_TICK_US: Final = 100.0
_SETTINGS: Final = EnergySettings(
    battery_wh=126.0, cells=3.0, hover_w=354.0, cruise_w=385.0, drag_per_s=0.284, drag_per_m=0.028
)
#: items of the longest mission, and return sites
_ITEMS, _PLACES = 700, 12

ENERGY = Calls(0.2, 4, 8)
ENERGY_QUICK = Calls(0.05, 1, 2)


class Pilot:
    """An aircraft in flight, and its energy. Its messages are not read."""

    def __init__(self) -> None:
        self.faults: list[str] = []
        self.monitor = EnergyMonitor(_SETTINGS, lambda _where, text: self.faults.append(text))
        self._aircraft = VehicleState()
        self._now = 1000.0
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        self._aircraft.on_message(mavlink.MAVLink_heartbeat_message(2, 3, armed, 3, 4, 3), self._now)
        self._attitude = mavlink.MAVLink_attitude_message(0, 0.0, -0.4, 1.0, 0.0, 0.0, 0.0)
        self._wind = mavlink.MAVLink_wind_message(100.0, 3.0, 0.0)
        self._batteries = [self._battery(number) for number in range(100)]

    @staticmethod
    def _battery(number: int) -> Any:
        volts = [12_000, *[65535] * 9]
        return mavlink.MAVLink_battery_status_message(
            0, 0, 0, 32767, volts, 3_000, 1_000 + 8 * number, 430 + 4 * number, 90 - number // 20
        )

    def second(self, place: float) -> None:
        """One second of a flight."""
        self._now += 1.0
        number = int(self._now) % 100
        position = mavlink.MAVLink_global_position_int_message(
            0, 526_800_000, round(place * 1e7), 45_000, 30_000, 10, 700 + number % 7, 0, 9_000
        )
        self._aircraft.on_message(position, self._now)
        for _ in range(4):
            self._aircraft.on_message(self._attitude, self._now)
        self.monitor.on_message(self._wind, self._now, False)
        self.monitor.on_message(self._batteries[number], self._now, False)
        self.monitor.update(self._aircraft, self._now, grounded=False)

    def ways_back(self, _place: float) -> None:
        """The margin of each return site."""
        fact = self.monitor.fact
        for number in range(_PLACES):
            fact.margin_wh(way_home(500.0 + 200.0 * number, 30.0 * number, 30.0, 20.0, 15.0))


class Judge:
    """The rules in flight, with ten stations, for which a condition begins and ends."""

    def __init__(self) -> None:
        self._row = Row(10, 50)
        self._now = 0.5
        self._off = False
        self._row.check(self._row.places[0])

    def nothing_new(self, _place: float) -> None:
        """A tick."""
        self._now += 1e-6
        self._row.arbiter.handle(events.Tick(), self._now)

    def news(self, _place: float) -> None:
        """A condition that begins, or ends."""
        self._now += 1e-6
        self._off = not self._off
        self._row.arbiter.handle(events.ConditionsSeen(off_route=self._off), self._now)


def _jobs(pilot: Pilot) -> Iterator[tuple[str, Job, float | None]]:
    """What is measured: its name, the job, and its limit."""
    judge, model = Judge(), pilot.monitor.fact.model
    if pilot.faults or model is None or pilot.monitor.fact.left_wh is None:
        raise BenchError(f"energy knows nothing: {pilot.faults[:1] or pilot.monitor.fact.words()}")
    long_way = [Piece(length_m=100.0, bearing_deg=float(item % 360), speed_mps=8.0) for item in range(_ITEMS)]

    def whole_way(_place: float) -> None:
        model.need_wh(long_way)

    yield "a decision, nothing new", judge.nothing_new, _MOST_A_TICK_US
    yield "a decision, news", judge.news, _MOST_A_TICK_US
    yield "a second in flight", pilot.second, _MOST_A_TICK_US
    yield f"margins of {_PLACES} places", pilot.ways_back, _MOST_A_TICK_US
    yield f"way of {_ITEMS} items, every 5 s at most, on the ground", whole_way, None


def energy(plan: Calls, _folder: Path, say: Say) -> Iterator[Measurement]:
    """Each job in turns with a zone check."""
    pilot, row = Pilot(), Row(2, 50)
    for place in row.places:  # what it has learned from is full
        pilot.second(place)
    for what, job, limit in _jobs(pilot):
        comparison = beside(job, row.check, row.places, plan)
        say(f"energy, {what}: {comparison.ours:.0f} us, {comparison.ratio:.2f} of a zone check")
        yield from_comparison("energy", "CPU", "us", {"job": what}, comparison, limit=limit, judged="ours")
    if pilot.faults:
        raise BenchError(f"energy broke on the way: {pilot.faults[0]}")
