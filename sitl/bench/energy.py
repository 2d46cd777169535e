# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of safety for the main loop.

Measured are a decision, a second of energy in flight, the ways back, and the route of a mission.

The baseline is one zone check, of two zones with 50 corners, which the companion makes twenty times a second. A second
of energy covers the autopilot's messages of one second and the fact that is made of them; all of it is taken to happen
in one tick. A decision covers all that the rules do if nothing is new, or if a condition begins or ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import ConditionsSeen, Tick
from mavproxy_handover.core.safety.energy import Piece, way_home
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.vehicle.state import VehicleState
from sitl.bench.loop import BenchError
from sitl.bench.numbers import Pair, abba, compare, settled
from sitl.bench.results import Measurement, from_comparison
from sitl.bench.zones import Row, us_per_call

__all__ = ["Judge", "Pilot", "Plan", "measure"]

#: what decision and energy may cost a tick
_MOST_US: Final = 100.0
_SETTINGS: Final = EnergySettings(
    battery_wh=126.0, cells=3.0, hover_w=354.0, cruise_w=385.0, drag_per_s=0.284, drag_per_m=0.028
)
#: items of the longest mission, and return sites
_ITEMS, _PLACES = 700, 12


@dataclass(frozen=True, slots=True)
class Plan:
    """Processor time of one turn, and how many pairs (see `uplink.Plan`)."""

    turn_s: float
    least: int
    most: int
    uncertainty: float = 0.02


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
        self._row.arbiter.handle(Tick(), self._now)

    def news(self, _place: float) -> None:
        """A condition that begins, or ends."""
        self._now += 1e-6
        self._off = not self._off
        self._row.arbiter.handle(ConditionsSeen(off_route=self._off), self._now)


def measure(plan: Plan, say: Callable[[str], None]) -> Iterator[Measurement]:
    """Each job in turns with a zone check."""
    pilot, row = Pilot(), Row(2, 50)
    for place in row.places:  # what it has learned from is full
        pilot.second(place)
    if pilot.faults or pilot.monitor.fact.model is None or pilot.monitor.fact.left_wh is None:
        raise BenchError(f"energy knows nothing: {pilot.faults[:1] or pilot.monitor.fact.words()}")
    long_way = [Piece(length_m=100.0, bearing_deg=float(item % 360), speed_mps=8.0) for item in range(_ITEMS)]
    model = pilot.monitor.fact.model
    judge = Judge()
    jobs: tuple[tuple[str, Callable[[float], None], float | None], ...] = (
        ("a decision, nothing new", judge.nothing_new, _MOST_US),
        ("a decision, news", judge.news, _MOST_US),
        ("a second in flight", pilot.second, _MOST_US),
        (f"margins of {_PLACES} places", pilot.ways_back, _MOST_US),
        (
            f"way of {_ITEMS} items, every 5 s at most, on the ground",
            lambda _place: _count(model.need_wh, long_way),
            None,
        ),
    )
    for what, job, limit in jobs:
        pairs: list[Pair] = []
        for order in abba():
            found = {ours: us_per_call(job if ours else row.check, row.places, plan.turn_s) for ours in order}
            pairs.append(Pair(found[True], found[False]))
            if settled(pairs, plan.least, plan.uncertainty) or len(pairs) >= plan.most:
                break
        comparison = compare(pairs)
        say(f"energy, {what}: {comparison.ours:.0f} us, {comparison.ratio:.2f} of a zone check")
        measurement = from_comparison("energy", "CPU", "us", {"job": what}, comparison, limit=limit)
        yield replace(measurement, judged="ours")
    if pilot.faults:
        raise BenchError(f"energy broke on the way: {pilot.faults[0]}")


def _count(need_wh: Callable[[list[Piece]], float], way: list[Piece]) -> None:
    need_wh(way)
