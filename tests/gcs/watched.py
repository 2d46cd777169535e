# SPDX-License-Identifier: GPL-3.0-or-later

"""Journals of aircraft that fly the missions that ship, written as companions write them, for the page that watches.

`python -m tests.gcs.watched DIR --aircraft 20 --seconds 300` writes them live, to look at the page with; one of the
aircraft loses its commander after a minute, one falls silent.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass
from pathlib import Path

from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.package import MissionPackage, load
from mavproxy_handover.mission.route_simulation import Sample
from mavproxy_handover.store.journal import Journal
from tests.packages import MISSIONS


@dataclass
class Flight:
    """One aircraft that flies its mission's route over and over, at its speed."""

    name: str
    package: MissionPackage
    folder: Path
    ahead_s: float

    def __post_init__(self) -> None:
        self.samples = self.package.simulate().samples
        self.names = {entry.sysid: entry.name for entry in self.package.stations}
        self.journal = Journal(self.folder / "companion.jsonl", self.name)
        files = dict(self.package.files)
        self.journal.lay_beside(f"mission-{self.package.digest.hex()[:8]}", files)
        self.epoch, self.commander, self.left = 0, "", False
        self.journal.write("loaded", "handover 0.1.0, configuration handover.toml", version="0.1.0")
        for name in self.names.values():
            self.journal.write("station_heard", f"{name} is heard", station=name)
        self.journal.write("guard", "guard: silent -> live")
        self.journal.write("mode", "mode AUTO", mode="AUTO")

    def at(self, seconds: float) -> Sample:
        """Where it is so many seconds after the beginning."""
        end_s = self.samples[-1].time_s
        there = (seconds + self.ahead_s) % end_s
        return next(each for each in self.samples if each.time_s >= there)

    def step(self, seconds: float) -> None:
        """Write what a companion writes in a second."""
        here = self.at(seconds)
        commander = self.names.get(here.commander, "")
        if self.left:
            commander = ""
        if commander != self.commander:
            self.epoch += 1
            if self.commander and commander:
                self.journal.write(
                    "transfer_committed",
                    f"handover {self.epoch} committed: {commander} commands, epoch {self.epoch}",
                    station=commander,
                )
            self.view(commander)
        self.journal.write(
            "position",
            lat_deg=here.lat_deg,
            lon_deg=here.lon_deg,
            alt_m=here.alt_m,
            zone=self.names.get(min(here.holding, default=0)),
            commander=commander or None,
            waypoint=here.seq,
        )
        if int(seconds) % 10 == 0:
            left_wh = 126.0 - (seconds + self.ahead_s) % 900 / 10.0
            self.journal.write(
                "energy", f"{left_wh:.1f} Wh of 126.0 Wh left, 385 W", left_wh=round(left_wh, 1), learned=True
            )

    def view(self, commander: str) -> None:
        """The view that is in force from now on."""
        self.commander = commander
        self.journal.write(
            "view",
            phase="on_mission" if commander else "emergency",
            commander=commander or None,
            epoch=self.epoch,
            lease="held" if commander else "lost",
            reason="zone" if commander else "commander_lost",
        )

    def lose(self) -> None:
        """Its commander is lost, and there is no other."""
        self.left = True
        self.journal.write("authority_lost", f"{self.commander} is silent", station=self.commander)
        text = f"RETURN to home: {self.commander} silent 5 s, no station ready; 281 m, needs 7 % of 88 %"
        self.journal.write("decision", text, action="return", reason="commander_lost", place="home")
        self.journal.write("mode", "mode RTL", mode="RTL")

    def speed_mps(self, seconds: float) -> float:
        """How fast it is there, as its places say."""
        one, two = self.at(seconds), self.at(seconds + 1.0)
        return distance_m(one.lat_deg, one.lon_deg, two.lat_deg, two.lon_deg)


def flights(folder: Path, count: int) -> list[Flight]:
    """So many, spread over three missions."""
    packages = [load(MISSIONS / name) for name in ("corridor", "delivery", "linear")]
    return [
        Flight(f"drone-{number}", packages[number % 3], folder / f"drone-{number}", number * 23.0)
        for number in range(1, count + 1)
    ]


def main() -> None:
    """Write until the time is over."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--aircraft", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=math.inf)
    arguments = parser.parse_args()
    fleet, begun = flights(arguments.folder, arguments.aircraft), time.monotonic()
    number = 0
    while number < arguments.seconds:
        for flight in fleet:
            if flight.name == "drone-2" and number == 60:
                flight.lose()
            if not (flight.name == "drone-3" and number > 45):
                flight.step(float(number))
        number += 1
        time.sleep(max(0.0, begun + number - time.monotonic()))
    for flight in fleet:
        flight.journal.close()


if __name__ == "__main__":
    main()
