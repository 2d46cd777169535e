# SPDX-License-Identifier: GPL-3.0-or-later

"""Whole flights of a mission package by the embedded vehicle, in simulated time, looked at again and again."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.mission import MissionPackage
from mavproxy_handover.mission.geodesy import offset
from sitl.vehicles.builtin.bench import Bench
from sitl.vehicles.builtin.items import Item

__all__ = ["AUTO", "GUIDED", "SET_MODE", "FlownMission", "take_off"]

AUTO, GUIDED = 3, 4
SET_MODE, ARM, START = 176, 400, 300


@dataclass
class FlownMission(ABC):
    """A flight of a mission; `look` is called `rate_hz` times a second."""

    package: MissionPackage
    bench: Bench
    rate_hz: float = 5.0

    @abstractmethod
    def look(self) -> None:
        """See where the aircraft is now."""

    def fly(self, seconds: float, until: Callable[[], bool] | None = None) -> bool:
        """Fly on; whether it came to that."""
        return self.bench.run(seconds, until, every_s=1.0 / self.rate_hz, do=self.look)

    def land(self) -> None:
        """Fly to the end of the mission."""
        assert self.fly(900.0, lambda: not self.bench.vehicle.copter.armed)

    def reach(self, waypoint: int) -> None:
        """Fly until that waypoint is flown to."""
        assert self.fly(300.0, lambda: self.bench.vehicle.copter.mission.current == waypoint)


def take_off(package: MissionPackage, beside_m: float = 0.0, **parameters: float) -> Bench:
    """In AUTO, at the take-off, so far east of the plan's home."""
    home = package.route.home
    lat_deg, lon_deg = offset(home.lat_deg, home.lon_deg, beside_m, 0.0)
    bench = Bench(parameters, home=(lat_deg, lon_deg, home.alt_m, 0.0))
    bench.run(11.0)
    items = [
        Item(i.command, i.frame, *i.params, round(i.lat_deg * 1e7), round(i.lon_deg * 1e7), i.alt_m)
        for i in package.route.upload_items()
    ]
    assert bench.upload(items) == 0
    assert [bench.command(SET_MODE, 1, GUIDED), bench.command(ARM, 1), bench.command(START)] == [0, 0, 0]
    return bench
