# SPDX-License-Identifier: GPL-3.0-or-later

"""Further vehicles of a run, each with its own companion, mission and folder.

The stations are the same for all. Entries about a vehicle are distinguished by its name: its companion's journal has
it, and observations of the aircraft itself are noted under `seen_of(name)`.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from mavproxy_handover.mission import package as packages
from mavproxy_handover.mission.package import MissionPackage
from sitl.report.evidence import seen_of
from sitl.report.journal_reader import Entry
from sitl.run.observer import Observer
from sitl.script.places import mission_folder
from sitl.script.scenario import Scenario, ScenarioError
from sitl.vehicles import RunningVehicle

__all__ = ["FIRST", "Craft", "Flown", "first_of", "others_of"]

#: the first vehicle: its name in journals, and its system id
FIRST = ("drone-1", 1)


@dataclass(frozen=True, slots=True)
class Craft:
    """A vehicle that is to be flown. `mission` is the package's folder."""

    name: str
    sysid: int
    package: MissionPackage
    mission: Path

    def in_folder(self, folder: Path) -> Craft:
        """The vehicle with a copy of its mission in a run's folder. Raises OSError."""
        copy = folder / self.name / "mission"
        shutil.copytree(self.mission, copy)
        return replace(self, mission=copy)


@dataclass(frozen=True, slots=True)
class Flown:
    """A further vehicle that runs, and who watches it."""

    name: str
    vehicle: RunningVehicle
    observer: Observer

    def poll(self) -> list[Entry]:
        """The new observations of it, under its name."""
        who = seen_of(self.name)
        return [replace(entry, who=who) for entry in self.observer.poll()] if self.observer.connected else []


def first_of(package: MissionPackage, mission: Path) -> Craft:
    """The vehicle that every run has."""
    return Craft(*FIRST, package, mission)


def others_of(scenario: Scenario, package: MissionPackage) -> tuple[Craft, ...]:
    """The vehicles that the scenario names besides. Raises MissionError, SetupError; ScenarioError if one's mission
    has other stations than the first vehicle's."""
    wanted = {station.name: station.sysid for station in package.stations}
    found = []
    for number, (name, mission) in enumerate(scenario.fleet.items(), FIRST[1] + 1):
        folder = mission_folder(mission)
        craft = Craft(name, number, packages.load(folder), folder)
        if {station.name: station.sysid for station in craft.package.stations} != wanted:
            raise ScenarioError(f"{scenario.name}.toml: [fleet] {name}: {mission!r} has other stations than the first")
        found.append(craft)
    return tuple(found)
