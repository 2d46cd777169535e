# SPDX-License-Identifier: GPL-3.0-or-later

"""The bench's network as a run needs it (`sitl.run.runner.Network`): sites of the stations, helpers, paths to cut."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from sitl.hosts import weather
from sitl.hosts.namespaces import Namespaces, inside
from sitl.hosts.plan import GROUND_PORT, LTE, MISSION_COMPUTER, PATHS, PORT
from sitl.run.sites import Reach, Site
from sitl.run.wiring import Program
from sitl.script.places import SetupError
from sitl.script.steps import StepFailed

__all__ = ["METER_FILE", "BenchNetwork"]

METER_FILE: Final = "meter.jsonl"
_ECHO_PORT: Final = 7007
_HELPER: Final = "sitl.hosts.meter"


class BenchNetwork:
    """Hosts that are there, with their weather. `lte_says`: the weather of the LTE path in words."""

    def __init__(self, namespaces: Namespaces) -> None:
        """Give the LTE path its weather. Raises SetupError."""
        self.namespaces = namespaces
        self.paths: Sequence[str] = tuple(PATHS)
        self.sites: Mapping[str, Site] = {station: self._site(station) for station in namespaces.plan.stations}
        least_s, most_s = weather.WEATHER.delay_s, weather.WEATHER.delay_s + weather.WEATHER.jitter_s
        figures = f"{least_s * 1000:.0f} to {most_s * 1000:.0f} ms and {weather.WEATHER.loss:.0%} loss each way"
        lacks = weather.netem(namespaces)
        self._netem = not lacks
        if self._netem:
            self.lte_says = f"{figures}, by netem"
        elif weather.can():
            self.lte_says = f"{figures}, by a program of the bench: {lacks}"
        else:
            self.lte_says = f"no delay and no loss: {lacks}, and there is no /dev/net/tun"

    def _site(self, station: str) -> Site:
        plan = self.namespaces.plan
        host = plan.host_of(station)
        links = {path: Reach(*plan.reach(station, path)) for path in PATHS}
        return Site(inside(host), links, PORT, plan.host(host).address("eno1"), GROUND_PORT)

    def programs(self, folder: Path) -> Sequence[Program]:
        """The weather of the LTE path, and where there is a tunnel what measures it."""
        plan = self.namespaces.plan
        found = []
        if not self._netem and weather.can():
            names = [each.name for each in plan.host(LTE).interfaces]
            found.append(weather.program(names, folder / "lte-weather"))
        for station in plan.tunnelled:
            argv = (*inside(plan.host_of(station)), sys.executable, "-m", _HELPER, "echo", str(_ECHO_PORT))
            found.append(Program(f"echo-{station}", argv, folder / "meter"))
        if plan.tunnelled:
            found.append(Program("meter", self._meter(folder / "meter" / METER_FILE), folder / "meter"))
        return found

    def _meter(self, path: Path) -> tuple[str, ...]:
        """Command line of the program that asks: the first station of the tunnel by each path, inside and outside."""
        plan = self.namespaces.plan
        station = plan.tunnelled[0]
        targets = [
            f"{name}/{'tunnel' if through else 'plain'}={plan.reach(station, name, inside=through)[0]}:{_ECHO_PORT}"
            for name in PATHS
            for through in (False, True)
        ]
        see = []
        for end in plan.tunnels:
            if end.host == MISSION_COMPUTER:
                below = plan.reach(station, end.path, inside=False)[1]
                see += ["--see", f"{end.interface}=0", "--see", f"{below}={end.port}"]
        argv = (*inside(MISSION_COMPUTER), sys.executable, "-m", _HELPER, "ask", str(path))
        return (*argv, *targets, *see)

    def change(self, order: str) -> None:
        """Cut or heal a path: its router forwards nothing, and tells no host so. Raises StepFailed."""
        what, _, name = order.partition(" ")
        if what not in ("cut", "heal") or name not in PATHS:
            raise StepFailed(f"{order!r} must be 'cut' or 'heal' and one of {', '.join(PATHS)}")
        try:
            self.namespaces.forward(PATHS[name], what == "heal")
        except SetupError as error:
            raise StepFailed(str(error)) from None
