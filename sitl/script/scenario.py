# SPDX-License-Identifier: GPL-3.0-or-later

"""Scenarios: what is typed, broken and waited for in a simulation, and what must have come of it. Data, not code.

A scenario is a TOML file of `scenarios/`. Its words are the steps of `steps.py` and `fault_steps.py` and the
expectations of `expect.py`; each `[[step]]` and each `[[expect]]` has exactly one of them, plus what any step may have:

    label = "stopped"     a name for the moment at which the step was done (for `mode_within` and the like)
    say = "sentence"      told in the story before the step begins
    timeout_s = 60        simulated seconds that the step may take
    timeout_wall_s = 60   the same on the wall clock, where `speedup = 1` measures how quick the programs are

Before the steps stands what the flight is made of, where that differs from the plain one:

    needs = "arducopter"           the built-in vehicle lacks what it shows
    begin = "start"                common opening, so far: "connected", "loaded" or "start"
    consent = {GCSA = "operator"}  its operator is asked; automatic or refuse for a station in `standard`
    forced = {GCSB = "ask"}        its operator is asked as well when the commander is lost
    standard = ["GCSA"]            speaks the MAVLink standard only
    served = ["GCSB"]              another program flies through it; the process is called GCSB-program
    panel = ["GCSA"]               an operator with `handover panel` in a browser; the process is called GCSA-panel
    require_operator = ["GCSB"]    it takes an aircraft only while an operator is on duty
    not_in_control = {GCSA = "never"}  the vehicle's setting for a station
    on_board = true                the mission package is there before the flight
    signed = true                  a key for each station
    guard_key = "same"             the guard's card has a key, and the companion the same one, or "other"
    links = {GCSA = ["wifi", "lte"]}   several links to the vehicle
    address = ["GCSB"]             no link of its own: the vehicle's address comes with the mission, and is confirmed
    impair = {links = ["air", "ground"], seed = 7, loss = 0.2}   through the proxy; any value of Weather
    serial = [{lines = ["GCSA", "autopilot"], baud = 57600, damage = 0.0005, bursts_per_s = 2}]   lines with noise
    rogue = ["GCSB"]               an attacker in this station's link to the vehicle
    payload = {control = "request"}  [payload] of the vehicle
    onboard = {rights = ["guided"]}  a program on the companion (`sitl.run.onboard`): its [[onboard]] without link
    box = {source = "box"}         a position box; [position] of the vehicle's configuration, without where the box is
    feeds = {rtk = ["GCSA"]}       [feeds] of the vehicle's configuration
    listen = ["TERRAIN_DATA"]      messages on the line between companion and autopilot; the process is called listener
    transponder = true             a Remote ID transponder on the autopilot's SERIAL0; the process is called transponder
    fsync_s = 2.0                  each time that the companion waits for its disk takes this long
    fleet = {drone-2 = "linear"}   further vehicles, each with a mission of its own and the same stations

Where there are further vehicles, `vehicle = "drone-2"` in a step or an expectation says that it is about that one.

`world` among the steps sets a parameter of the simulation itself (SIM_*), wind for instance.

Places are metres north and east of home, so that a scenario goes with more than one mission; `{name}` in a typed line
stands for a place's latitude and longitude. Unknown keys, stations and places are refused with file and key.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config.feeds import feed_settings
from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.config.position import position_settings
from mavproxy_handover.gate.client_capabilities import POLICIES
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire.box_layout import LAYOUTS
from sitl.report.matching import Match
from sitl.script.expect import EXPECTATIONS, Expectation, OfVehicle
from sitl.script.fault_steps import FAULT_STEPS, Box
from sitl.script.opening import BEGINNINGS, opening
from sitl.script.places import SCENARIOS
from sitl.script.steps import STEPS, Deed
from sitl.script.tables import Reader, ScenarioError
from sitl.script.weather import NoiseLevel, Weather

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = [
    "AUTOPILOT",
    "Impairments",
    "Place",
    "Scenario",
    "ScenarioError",
    "SerialLines",
    "Step",
    "known_scenarios",
    "load_scenario",
    "parse_scenario",
    "panel_of",
    "program_of",
    "with_opening",
]

DEFAULT_TIMEOUT_S = 120.0
CONSENTS = ("automatic", "operator", "refuse")
FORCED = ("automatic", "ask")
GUARD_KEYS = ("same", "other")
NEEDS = ("arducopter",)
WORDS: Mapping[str, type[Deed]] = {**STEPS, **FAULT_STEPS}
#: the name of the autopilot among serial lines
AUTOPILOT = "autopilot"
#: what goes through the proxy: links of the vehicle, links between stations
IMPAIRED = ("air", "ground")
#: stands for the address of a position box, which the run chooses
_SOMEWHERE = "tcp:127.0.0.1:1"
_KEYS = (
    "name",
    "description",
    "mission",
    "speedup",
    "needs",
    "begin",
    "consent",
    "forced",
    "standard",
    "served",
    "panel",
    "require_operator",
    "not_in_control",
    "on_board",
    "signed",
    "guard_key",
    "links",
    "address",
    "impair",
    "serial",
    "rogue",
    "onboard",
    "payload",
    "box",
    "feeds",
    "listen",
    "transponder",
    "fsync_s",
    "fleet",
    "limits",
    "policy",
    "parameters",
    "places",
    "step",
    "expect",
)
_STEP_KEYS = ("label", "say", "timeout_s", "timeout_wall_s", "vehicle")
#: what is laid for one vehicle only
_NOT_OF_A_FLEET = (
    "standard",
    "served",
    "not_in_control",
    "links",
    "address",
    "serial",
    "rogue",
    "impair",
    "onboard",
    "payload",
    "guard_key",
    "box",
    "listen",
    "transponder",
    "fsync_s",
    "on_board",
)


@dataclass(frozen=True, slots=True)
class Place:
    """A place relative to home, in metres."""

    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the timeline. At most one of the two time limits is set. Number 0: of the common opening."""

    number: int
    deed: Deed
    label: str = ""
    say: str = ""
    timeout_s: float | None = DEFAULT_TIMEOUT_S
    timeout_wall_s: float | None = None
    #: a further vehicle that it is about; empty: the first one
    vehicle: str = ""

    @property
    def title(self) -> str:
        """How to name it to people."""
        return f"step {self.number}" if self.number else "opening"


@dataclass(frozen=True, slots=True)
class Impairments:
    """Which kinds of link go through the proxy, and what they are like from the beginning, both ways."""

    links: tuple[str, ...]
    seed: int = 1
    match: Match = field(default_factory=Match)

    def __post_init__(self) -> None:
        for kind in self.links:
            if kind not in IMPAIRED:
                raise ValueError(f"links: {kind!r} must be one of {', '.join(IMPAIRED)}")
        Weather().changed(**dict(self.match.values))


@dataclass(frozen=True, slots=True)
class SerialLines:
    """Stations, and the autopilot, that the companion reaches by a serial line, and how noisy those are, each way."""

    lines: tuple[str, ...]
    seed: int = 1
    baud: int = 115200
    damage: float = 0.0
    bursts_per_s: float = 0.0

    def __post_init__(self) -> None:
        if not 1200 <= self.baud <= 4_000_000:
            raise ValueError(f"baud: {self.baud} must be 1200 to 4000000")
        NoiseLevel(self.damage, self.bursts_per_s)


@dataclass(frozen=True, slots=True)
class Scenario:
    """A scenario that was read and found sound."""

    name: str
    description: str
    #: name of a mission that ships, or a folder
    mission: str
    steps: tuple[Step, ...]
    expectations: tuple[Expectation, ...]
    #: station -> "automatic", "operator" or "refuse"; those not named consent automatically, and one of the standard
    #: that is not named shows before START that it can be asked
    consent: Mapping[str, str]
    #: station -> "automatic" or "ask", for a forced handover
    forced: Mapping[str, str]
    #: [limits] and [policy] of the vehicle's configuration
    limits: Mapping[str, float]
    policy: Mapping[str, str]
    #: parameters of the autopilot
    parameters: Mapping[str, float]
    places: Mapping[str, Place]
    #: what the scenario wants, if it wants one
    speedup: float | None = None
    #: the only vehicle that can fly it; empty: every one that its mission is for
    needs: str = ""
    #: how far the common opening goes (`sitl.script.opening`); empty: the scenario does that itself
    begin: str = ""
    #: stations that speak the MAVLink standard only
    standard: tuple[str, ...] = ()
    #: stations that take an aircraft only while an operator is on duty
    require_operator: tuple[str, ...] = ()
    #: stations through which another program flies
    served: tuple[str, ...] = ()
    #: stations whose operator has a panel in a browser
    panel: tuple[str, ...] = ()
    #: station -> who gets that result there (`POLICIES` of `gate/client_capabilities.py`); those
    #: not named have the default
    not_in_control: Mapping[str, str] = field(default_factory=dict)
    #: vehicle and stations have the mission package before they start
    on_board: bool = False
    #: every station has a key, and its links are signed
    signed: bool = False
    #: whether the key on the guard's card is the companion's; empty: there is none
    guard_key: str = ""
    #: station -> names of its links to the vehicle; those not named have one
    links: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: stations whose configuration has no link to the vehicle
    address: tuple[str, ...] = ()
    impair: Impairments | None = None
    serial: tuple[SerialLines, ...] = ()
    #: stations in whose links to the vehicle the rogue sits
    rogue: tuple[str, ...] = ()
    #: [[onboard]] of the vehicle's configuration, without name, link and component, where there is a program on board
    onboard: Mapping[str, Any] = field(default_factory=dict)
    #: [payload] of the vehicle's configuration
    payload: Mapping[str, Any] = field(default_factory=dict)
    #: [position] of the vehicle's configuration, without the address, where there is a box
    box: Mapping[str, str | float] = field(default_factory=dict)
    #: [feeds] of the vehicle's configuration
    feeds: Mapping[str, Any] = field(default_factory=dict)
    #: messages that are journalled on the line between companion and autopilot
    listen: tuple[str, ...] = ()
    #: whether a Remote ID transponder is on the autopilot
    transponder: bool = False
    #: how long the companion's disk takes, if it is a slow one
    fsync_s: float = 0.0
    #: further vehicles: name -> mission
    fleet: Mapping[str, str] = field(default_factory=dict)


def _feeds(reader: Reader, data: Mapping[str, Any]) -> Mapping[str, Any]:
    """[feeds], checked as the vehicle's configuration is. Raises ScenarioError."""
    table = reader.table(data, "feeds", {})
    named = {name: 1 for names in table.values() if isinstance(names, list) for name in names}
    try:
        feed_settings({"feeds": table}, Path(reader.file), named)
    except ConfigError as error:
        raise reader.error("feeds", str(error).partition("] ")[2]) from None
    return table


def _listen(reader: Reader, data: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of messages, each a known one. Raises ScenarioError."""
    names: tuple[str, ...] = reader.value(data, "listen", tuple[str, ...], ())
    known = {kind.msgname for kind in mavlink.mavlink_map.values()}
    for name in names:
        if name not in known:
            raise reader.error("listen", f"{name!r} is no message")
    return names


def program_of(station: str) -> str:
    """Name of the process of the program that a station serves."""
    return f"{station}-program"


def panel_of(station: str) -> str:
    """Name of the process of the operator with a panel at a station."""
    return f"{station}-panel"


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
    if speedup is not None and not 0.5 <= speedup <= 20:
        raise reader.error("speedup", f"{speedup:g} must be 0.5 to 20")
    fsync_s = reader.value(data, "fsync_s", float, 0.0)
    if not 0 <= fsync_s <= 30:
        raise reader.error("fsync_s", f"{fsync_s:g} must be 0 to 30")
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
    scenario = Scenario(
        name=reader.value(data, "name", str),
        description=reader.value(data, "description", str),
        mission=reader.value(data, "mission", str),
        steps=steps,
        expectations=expectations,
        consent=_words(reader, data, "consent", CONSENTS),
        forced=_words(reader, data, "forced", FORCED),
        limits=reader.at("limits").numbers(reader.table(data, "limits", {})),
        policy=reader.at("policy").words(reader.table(data, "policy", {})),
        parameters=reader.at("parameters").numbers(reader.table(data, "parameters", {})),
        places=places,
        speedup=speedup,
        needs=_word(reader, data, "needs", NEEDS),
        begin=_word(reader, data, "begin", BEGINNINGS),
        standard=reader.value(data, "standard", tuple[str, ...], ()),
        require_operator=reader.value(data, "require_operator", tuple[str, ...], ()),
        served=reader.value(data, "served", tuple[str, ...], ()),
        panel=reader.value(data, "panel", tuple[str, ...], ()),
        not_in_control=_words(reader, data, "not_in_control", POLICIES),
        on_board=reader.value(data, "on_board", bool, False),
        signed=reader.value(data, "signed", bool, False),
        guard_key=_word(reader, data, "guard_key", GUARD_KEYS),
        links=reader.at("links").lists(reader.table(data, "links", {})),
        address=reader.value(data, "address", tuple[str, ...], ()),
        impair=reader.at("impair").build(Impairments, data["impair"]) if "impair" in data else None,
        serial=tuple(
            reader.at(f"serial {number}").build(SerialLines, table)
            for number, table in enumerate(reader.tables(data, "serial"), 1)
        ),
        feeds=_feeds(reader, data),
        listen=_listen(reader, data),
        transponder=reader.value(data, "transponder", bool, False),
        rogue=reader.value(data, "rogue", tuple[str, ...], ()),
        onboard=reader.table(data, "onboard", {}),
        payload=reader.table(data, "payload", {}),
        box=_box(reader, data),
        fsync_s=fsync_s,
        fleet=reader.at("fleet").words(reader.table(data, "fleet", {})),
    )
    if not scenario.box and any(isinstance(step.deed, Box) for step in steps):
        raise reader.error("box", "a step gives the position box an order, and there is none")
    _check_lines(reader, scenario)
    _check_address(reader, scenario)
    for name in scenario.served:
        if name in scenario.standard:
            raise reader.error("served", f"{name!r} is in standard: it has no module that serves a program")
    for name in scenario.panel:
        if name in scenario.standard:
            raise reader.error("panel", f"{name!r} is in standard: it has no module that a panel can show")
    _check_fleet(reader, scenario)
    return scenario


def _check_lines(reader: Reader, scenario: Scenario) -> None:
    """A serial line is a station's only link, and the rogue is not in it."""
    others = {"links": scenario.links, "standard": scenario.standard, "rogue": scenario.rogue}
    names = [name for lines in scenario.serial for name in lines.lines]
    for name in names:
        for key, taken in others.items():
            if name in taken:
                raise reader.error("serial", f"{name!r} has a serial line, and cannot be in {key}")
        if names.count(name) > 1:
            raise reader.error("serial", f"{name!r} has two lines")
    if AUTOPILOT in names and scenario.listen:
        raise reader.error("listen", "the line to the autopilot is a serial one: nothing listens there")


def _check_address(reader: Reader, scenario: Scenario) -> None:
    """The vehicle listens for a station that gets its address, and nothing stands in that link."""
    others: Mapping[str, Collection[str]] = {
        "links": scenario.links,
        "standard": scenario.standard,
        "rogue": scenario.rogue,
        "serial": [name for lines in scenario.serial for name in lines.lines],
    }
    for name in scenario.address:
        for key, taken in others.items():
            if name in taken:
                raise reader.error("address", f"{name!r} gets the vehicle's address, and cannot be in {key}")


def _check_fleet(reader: Reader, scenario: Scenario) -> None:
    """Further vehicles have plain links, and steps and expectations name no others."""
    for key in _NOT_OF_A_FLEET if scenario.fleet else ():
        if getattr(scenario, key):
            raise reader.error("fleet", f"does not go together with {key}")
    for name in scenario.fleet:
        if not re.fullmatch(r"drone-[2-9]", name):
            raise reader.at("fleet").error(name, "must be drone-2 to drone-9")
    about = [step.vehicle for step in scenario.steps if step.vehicle]
    about += [each.vehicle for each in scenario.expectations if isinstance(each, OfVehicle)]
    for name in about:
        if name not in scenario.fleet:
            raise reader.error("vehicle", f"{name!r} is not in [fleet]: {', '.join(scenario.fleet) or 'there is none'}")


def _box(reader: Reader, data: Mapping[str, Any]) -> Mapping[str, str | float]:
    """[position] of the vehicle's configuration, sound but for where the box is: the run says that."""
    box = reader.table(data, "box", {})
    if "box" in data:
        if "layout" in box and box["layout"] not in tuple(LAYOUTS):
            raise reader.error("box", f"layout: {box['layout']!r} must be one of {', '.join(LAYOUTS)}")
        try:
            position_settings({"position": {"box": _SOMEWHERE, **box}}, Path(reader.file))
        except ConfigError as error:
            raise reader.error("box", str(error).partition("] ")[2]) from None
        if not box or "box" in box:
            raise reader.error("box", 'must say whose position counts, and not where the box is: {source = "box"}')
    return box


def _word(reader: Reader, data: Mapping[str, Any], key: str, words: tuple[str, ...]) -> str:
    """One of these words, or nothing."""
    word: str = reader.value(data, key, str, "")
    if word and word not in words:
        raise reader.error(key, f"{word!r} must be one of {', '.join(words)}")
    return word


def with_opening(scenario: Scenario, package: MissionPackage) -> Scenario:
    """The scenario with the steps of its opening, whose number is 0."""
    if not scenario.begin:
        return scenario
    shows = [name for name in scenario.standard if name not in scenario.consent]
    opened = opening(scenario.begin, package, scenario.standard, shows, on_board=scenario.on_board)
    steps = (Step(0, deed, "", say, limit_s) for deed, limit_s, say in opened)
    return replace(scenario, steps=(*steps, *scenario.steps))


def _words(reader: Reader, data: Mapping[str, Any], key: str, allowed: tuple[str, ...]) -> dict[str, str]:
    """A table of stations, each with one of these words."""
    inside = reader.at(key)
    words = inside.words(reader.table(data, key, {}))
    for name, word in words.items():
        if word not in allowed:
            raise inside.error(name, f"{word!r} must be one of {', '.join(allowed)}")
    return words


def _step(reader: Reader, number: int, table: Mapping[str, Any], places: Mapping[str, Place]) -> Step:
    verb, value = reader.one_of(table, WORDS, _STEP_KEYS)
    deed = reader.at(verb).build(WORDS[verb], value)
    for name in deed.places():
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
        simulated = max(DEFAULT_TIMEOUT_S, deed.at_least_s())
    return Step(
        number=number,
        deed=deed,
        label=reader.value(table, "label", str, ""),
        say=reader.value(table, "say", str, ""),
        timeout_s=simulated,
        timeout_wall_s=wall,
        vehicle=reader.value(table, "vehicle", str, ""),
    )


def _expectation(reader: Reader, table: Mapping[str, Any]) -> Expectation:
    word, value = reader.one_of(table, EXPECTATIONS, ("vehicle",))
    expectation = reader.at(word).build(EXPECTATIONS[word], value)
    vehicle = reader.value(table, "vehicle", str, "")
    return OfVehicle(vehicle, expectation) if vehicle else expectation


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
