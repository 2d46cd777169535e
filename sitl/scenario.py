# SPDX-License-Identifier: GPL-3.0-or-later

"""Scenarios: what is typed, broken and waited for in a simulation, and what must have come of it. Data, not code.

A scenario is a TOML file of `scenarios/`. Its words are the steps of `steps.py` and the expectations of `expect.py`;
each `[[step]]` and each `[[expect]]` has exactly one of them, plus what any step may have:

    label = "stopped"     a name for the moment at which the step was done (for `mode_within` and the like)
    say = "sentence"      told in the story before the step begins
    timeout_s = 60        simulated seconds the step may take; timeout_wall_s: the same in seconds of the wall clock

Places are metres north and east of home, so that a scenario goes with more than one mission; `{name}` in a typed line
stands for a place's latitude and longitude. Unknown keys, stations and places are refused with file and key.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sitl.expect import EXPECTATIONS, Expectation
from sitl.places import SCENARIOS
from sitl.steps import STEPS, Action
from sitl.tables import Reader, ScenarioError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["Place", "Scenario", "ScenarioError", "Step", "known_scenarios", "load_scenario", "parse_scenario"]

DEFAULT_TIMEOUT_S = 120.0
CONSENTS = ("automatic", "operator")
_KEYS = (
    "name",
    "description",
    "mission",
    "speedup",
    "consent",
    "limits",
    "policy",
    "parameters",
    "places",
    "step",
    "expect",
)
_STEP_KEYS = ("label", "say", "timeout_s", "timeout_wall_s")


@dataclass(frozen=True, slots=True)
class Place:
    """A place relative to home, in metres."""

    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the timeline. Exactly one of the two time limits is set."""

    number: int
    action: Action
    label: str = ""
    say: str = ""
    timeout_s: float | None = DEFAULT_TIMEOUT_S
    timeout_wall_s: float | None = None


@dataclass(frozen=True, slots=True)
class Scenario:
    """A scenario that was read and found sound."""

    name: str
    description: str
    #: name of a mission that ships, or a folder
    mission: str
    steps: tuple[Step, ...]
    expectations: tuple[Expectation, ...]
    #: station -> "automatic" or "operator"; those not named consent automatically
    consent: Mapping[str, str]
    #: [limits] and [policy] of the vehicle's configuration
    limits: Mapping[str, float]
    policy: Mapping[str, str]
    #: parameters of the autopilot
    parameters: Mapping[str, float]
    places: Mapping[str, Place]
    #: what the scenario wants, if it wants one
    speedup: float | None = None


def known_scenarios(folder: Path = SCENARIOS) -> dict[str, Path]:
    """The scenarios of a folder by name."""
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load_scenario(path: Path) -> Scenario:
    """Read a scenario file. Raises ScenarioError with one line that names file and key."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from None
    scenario = parse_scenario(text, path.name)
    if scenario.name != path.stem:
        raise ScenarioError(f"{path.name}: name: {scenario.name!r} must be the file's name, {path.stem!r}")
    return scenario


def parse_scenario(text: str, file: str) -> Scenario:
    """Read a scenario from the text of a file. Raises ScenarioError."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{file}: not valid TOML: {error}") from None
    reader = Reader(file)
    reader.known_keys(data, _KEYS)
    places = {
        name: reader.at(f"places.{name}").build(Place, table)
        for name, table in reader.table(data, "places", {}).items()
    }
    speedup = reader.value(data, "speedup", float, None)
    if speedup is not None and not 0.1 <= speedup <= 12:
        raise reader.error("speedup", f"{speedup:g} must be 0.1 to 12")
    steps = tuple(
        _step(reader.at(f"step {number}"), number, table, places)
        for number, table in enumerate(reader.tables(data, "step"), 1)
    )
    expectations = tuple(
        _expectation(reader.at(f"expect {number}"), table)
        for number, table in enumerate(reader.tables(data, "expect"), 1)
    )
    if not steps or not expectations:
        raise ScenarioError(f"{file}: needs at least one [[step]] and one [[expect]]")
    _check_labels(reader, steps, expectations)
    return Scenario(
        name=reader.value(data, "name", str),
        description=reader.value(data, "description", str),
        mission=reader.value(data, "mission", str),
        steps=steps,
        expectations=expectations,
        consent=_consent(reader, data),
        limits=reader.at("limits").numbers(reader.table(data, "limits", {})),
        policy=reader.at("policy").words(reader.table(data, "policy", {})),
        parameters=reader.at("parameters").numbers(reader.table(data, "parameters", {})),
        places=places,
        speedup=speedup,
    )


def _consent(reader: Reader, data: Mapping[str, Any]) -> dict[str, str]:
    inside = reader.at("consent")
    consent = inside.words(reader.table(data, "consent", {}))
    for name, word in consent.items():
        if word not in CONSENTS:
            raise inside.error(name, f"{word!r} must be one of {', '.join(CONSENTS)}")
    return consent


def _step(reader: Reader, number: int, table: Mapping[str, Any], places: Mapping[str, Place]) -> Step:
    verb, value = reader.one_of(table, STEPS, _STEP_KEYS)
    action = reader.at(verb).build(STEPS[verb], value)
    for name in action.places():
        if name not in places:
            raise reader.error(verb, f"place {name!r} is not among [places]: {', '.join(places) or 'there are none'}")
    simulated = reader.value(table, "timeout_s", float, None)
    wall = reader.value(table, "timeout_wall_s", float, None)
    if simulated is not None and wall is not None:
        raise reader.error("timeout_wall_s", "does not go together with timeout_s")
    for key, limit in (("timeout_s", simulated), ("timeout_wall_s", wall)):
        if limit is not None and not 0 < limit <= 7200:
            raise reader.error(key, f"{limit:g} must be above 0 and at most 7200")
    if simulated is None and wall is None:
        simulated = max(DEFAULT_TIMEOUT_S, action.at_least_s())
    return Step(
        number=number,
        action=action,
        label=reader.value(table, "label", str, ""),
        say=reader.value(table, "say", str, ""),
        timeout_s=simulated,
        timeout_wall_s=wall,
    )


def _expectation(reader: Reader, table: Mapping[str, Any]) -> Expectation:
    word, value = reader.one_of(table, EXPECTATIONS, ())
    return reader.at(word).build(EXPECTATIONS[word], value)


def _check_labels(reader: Reader, steps: tuple[Step, ...], expectations: tuple[Expectation, ...]) -> None:
    labels: list[str] = []
    for step in steps:
        if step.label in labels:
            raise reader.at(f"step {step.number}").error("label", f"{step.label!r} is given twice")
        if step.label:
            if not re.fullmatch(r"[a-z0-9][a-z0-9 _-]*", step.label):
                raise reader.at(f"step {step.number}").error("label", f"{step.label!r} must be lower-case words")
            labels.append(step.label)
    for number, expectation in enumerate(expectations, 1):
        for label in expectation.labels():
            if label not in labels:
                known = ", ".join(labels) or "there are none"
                raise reader.at(f"expect {number}").error("after", f"label {label!r} is no step's: {known}")
