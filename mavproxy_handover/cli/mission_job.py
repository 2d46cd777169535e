# SPDX-License-Identifier: GPL-3.0-or-later

"""From options, files and answers to all that `handover init mission` writes. All faults are found before anything is
written."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from mavproxy_handover.cli.new_folder import is_free
from mavproxy_handover.cli.questions import Questions
from mavproxy_handover.config.for_mission import FirstVehicle, StationSite, configurations, placeholder
from mavproxy_handover.mission.draft import Draft, DraftStation, file_name, holders_of_home, with_few, written
from mavproxy_handover.mission.drawn.areas import DrawnZone
from mavproxy_handover.mission.drawn.choice import Wanted, choose, name_fault, station_name
from mavproxy_handover.mission.drawn.fence import without_parts
from mavproxy_handover.mission.drawn.files import ENDINGS, read_text, read_zone_file
from mavproxy_handover.mission.errors import Faults, MissionError
from mavproxy_handover.mission.keys import ENERGY, MISSION
from mavproxy_handover.mission.package import MAX_PLAIN_BYTES, MissionPackage
from mavproxy_handover.mission.plan import Route, read_route
from mavproxy_handover.mission.plan_facts import PlanFacts, plan_facts, proposed_speed
from mavproxy_handover.tools.key_table import Key
from mavproxy_handover.vehicle.profiles import PROFILES, Profile, named

__all__ = ["AIRCRAFT", "MISSION_FOLDER", "Job", "Missing", "job_of"]

#: folder of the mission package
MISSION_FOLDER: Final = "mission"
#: kinds of aircraft
AIRCRAFT: Final = tuple(profile.name for profile in PROFILES)
#: system ids of stations, in this order; 255 is that of many ground station programs
_SYSIDS: Final = (*range(251, 255), *range(250, 0, -1))
_HOST: Final = re.compile(r"(?=.{1,253}$)[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?|\[[0-9A-Fa-f:.]+(%\w+)?\]")
#: lines and points of a drawing that a note names
_MOST_TOLD: Final = 10
#: how a plan's fault names the key that the option writes
_IN_MISSION: Final = "'endless_jump = true' in the mission"
_HANDOVERS: Final = MISSION["expected_handovers"]


class Missing(Exception):
    """Options are missing."""

    def __init__(self, options: Sequence[str]) -> None:
        super().__init__(", ".join(options))
        self.options = tuple(options)


@dataclass(frozen=True, slots=True)
class Job:
    """All that is written, and what is told about it."""

    out: Path
    files: Mapping[str, str]
    package: MissionPackage
    sites: tuple[StationSite, ...]
    stations: tuple[DraftStation, ...]
    speed: str
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Sources:
    """The plan and the zones, as they were read."""

    path: Path
    text: str
    facts: PlanFacts
    zones: tuple[DrawnZone, ...]


@dataclass(frozen=True, slots=True)
class _Answers:
    """Values from plan, zones, options and questions, without faults."""

    profile: Profile
    stations: tuple[DraftStation, ...]
    #: cruise speed (m/s), and what names it
    speed: tuple[float, str]
    terrain: str


def job_of(arguments: argparse.Namespace, questions: Questions) -> Job:
    """Raises MissionError with all faults, Missing with all missing options."""
    sources = _sources(arguments, questions)
    out = arguments.out or Path(file_name(sources.path.stem, ""))
    if not is_free(out) and not arguments.force:
        raise MissionError(f"{out} exists already: nothing written. Give another --out, or --force, which keeps it")
    answers = _answers(arguments, sources, questions)
    stations, moved = with_few(answers.stations)
    sites = _sites(arguments, stations, questions)
    route_text, notes = _copied_plan(sources, stations)
    draft = Draft(
        arguments.name or sources.path.stem[:40],
        answers.profile,
        stations,
        file_name(sources.path.stem, sources.path.suffix),
        route_text,
        *answers.speed,
        arguments.out_of_coverage or "return",
        _energy(arguments, questions),
        answers.terrain,
        endless_jump=arguments.endless_jump,
    )
    package, texts = written(draft, arguments.handovers)
    vehicle = FirstVehicle(arguments.vehicle_name or "drone-1", arguments.vehicle_sysid or 1)
    files = {f"{MISSION_FOLDER}/{name}": text for name, text in texts.items()}
    files |= configurations(vehicle, sites, MISSION_FOLDER)
    speed_mps, source = answers.speed
    left = _left_out(sources.zones, stations)
    simpler = (f"{name}: the zone had too many corners: its border moved by up to {m:.1f} m" for name, m in moved)
    return Job(out, files, package, sites, stations, f"{speed_mps:g} m/s, {source}", (*simpler, *notes, *left))


def _answers(arguments: argparse.Namespace, sources: _Sources, questions: Questions) -> _Answers:
    """Raises MissionError with all faults, Missing with all missing options."""
    faults = Faults()
    aircraft, route, terrain = None, None, ""
    stations: tuple[DraftStation, ...] = ()
    with faults.noted():
        terrain = "" if arguments.terrain is None else read_text(arguments.terrain, MAX_PLAIN_BYTES)
    with faults.noted():
        aircraft = arguments.aircraft or sources.facts.aircraft or _asked_aircraft(sources, questions)
        route = None if aircraft is None else _route(sources, aircraft, endless=arguments.endless_jump)
    if questions.ask is not None:  # no question to a person for a plan that cannot be used
        faults.raise_all()
    with faults.noted():
        stations = _stations(arguments, sources, questions)
    speed = _speed(arguments, sources, route, questions, faults)
    with faults.noted():
        _check_options(arguments, stations)
    faults.raise_all()
    if questions.missing:
        raise Missing(questions.missing)
    assert aircraft is not None
    assert speed is not None
    return _Answers(named(aircraft), stations, speed, terrain)


def _sources(arguments: argparse.Namespace, questions: Questions) -> _Sources:
    """The files. Raises MissionError, Missing."""
    path: Path | None = arguments.plan or questions.need(
        "--plan FILE", "file of the route (.plan or .waypoints)", _file
    )
    paths = arguments.zones
    if not paths:
        found = questions.need("--zones FILE", f"file of the zones ({', '.join(ENDINGS)})", _file)
        paths = [] if found is None else [found]
    if path is None or questions.missing:
        raise Missing(questions.missing)
    if path.suffix not in (".plan", ".waypoints"):
        raise MissionError(f"{path}: not a route (allowed: a file named *.plan or *.waypoints). Save the plan as .plan")
    faults, text, facts = Faults(), "", PlanFacts()
    with faults.noted():
        text = read_text(path)
        facts = plan_facts(path.name, text)
    zones: list[DrawnZone] = []
    for each in paths:
        with faults.noted():
            own = each.resolve() == path.resolve()
            read = read_zone_file(each, facts.home)
            zones += read if own else [replace(zone, fence_part=None) for zone in read]
    faults.raise_all()
    zones.sort(key=lambda zone: zone.aside)  # numbers count the areas
    return _Sources(path, text, facts, tuple(zones))


def _route(sources: _Sources, aircraft: str, *, endless: bool) -> Route:
    try:
        return read_route(sources.path.name, sources.text, named(aircraft), endless=endless)
    except MissionError as error:
        faults = [each.replace(_IN_MISSION, "--endless-jump") for each in error.faults]
        raise MissionError(faults[0], grave=error.grave, faults=tuple(faults)) from None


def _file(answer: str) -> Path:
    path = Path(answer).expanduser()
    if not answer or not path.is_file():
        raise ValueError(f"{answer or 'nothing'}: no such file")
    return path


def _asked_aircraft(sources: _Sources, questions: Questions) -> str | None:
    if sources.facts.made_for:
        raise MissionError(
            f"{sources.path.name}: the plan was made for {sources.facts.made_for} (allowed: {', '.join(AIRCRAFT)}). "
            "Make the plan for one of these"
        )
    return questions.need("--aircraft WORD", f"kind of aircraft ({', '.join(AIRCRAFT)})", _aircraft)


def _aircraft(answer: str) -> str:
    if answer not in AIRCRAFT:
        raise ValueError(f"'{answer}' (allowed: {', '.join(AIRCRAFT)})")
    return answer


def _speed(
    arguments: argparse.Namespace, sources: _Sources, route: Route | None, questions: Questions, faults: Faults
) -> tuple[float, str] | None:
    """The cruise speed (m/s), and what names it; None: it is missing, or the plan cannot be read."""
    if arguments.speed is not None:
        with faults.noted():
            return _number("--speed", MISSION["cruise_speed_mps"], arguments.speed), "as given"
        return None
    if route is not None:
        found = proposed_speed(route)
        if found is not None:
            return found
        usual = f"{route.profile.energy.cruise_mps:g}"
    elif sources.path.suffix == ".plan" or sources.facts.aircraft is not None:
        return None
    else:
        usual = ""

    def parse(answer: str) -> float:
        return _number("speed", MISSION["cruise_speed_mps"], _float(answer))

    speed = questions.need("--speed MPS", "cruise speed in m/s, which the plan does not name", parse, usual)
    return None if speed is None else (speed, "as given")


def _float(answer: str) -> float:
    try:
        return float(answer)
    except ValueError:
        raise ValueError(f"'{answer}' (allowed: a number)") from None


def _number(name: str, key: Key, value: float) -> float:
    """Raises MissionError: out of the range of the key."""
    assert key.limits is not None
    low, high = key.limits
    if not low <= value <= high:
        raise MissionError(f"{name} {value:g} (allowed: {key.allowed} {key.unit})".replace(" )", ")"))
    return value


# ---- stations ------------------------------------------------------------------------------------------------------


def _stations(arguments: argparse.Namespace, sources: _Sources, questions: Questions) -> tuple[DraftStation, ...]:
    """The stations in order, the parent first. Raises MissionError. Empty: their names are missing."""
    wanted = [Wanted(*(part.strip() for part in each.partition("=")[::2])) for each in arguments.station]
    choice = choose(sources.zones, wanted)
    if choice.unnamed:
        names = _asked_names(sources.zones, questions)
        if not names:
            return ()
        choice = choose(sources.zones, names)
    if len(choice.stations) > len(_SYSIDS) - 1:
        raise MissionError(f"{len(choice.stations)} zones (allowed: at most {len(_SYSIDS) - 1})")
    sysids = (sysid for sysid in _SYSIDS if sysid != (arguments.vehicle_sysid or 1))
    found = [DraftStation(name, sysid, zone) for (name, zone), sysid in zip(choice.stations, sysids, strict=False)]
    parent = arguments.parent
    if parent is None and not wanted:
        parent = _parent(found, sources, questions)
    if parent is not None and parent not in [each.name for each in found]:
        names_text = ", ".join(each.name for each in found)
        raise MissionError(f"--parent '{parent[:40]}' is no station (allowed: {names_text})")
    found.sort(key=lambda each: each.name != parent if parent is not None else False)
    return _numbered(found)


def _numbered(stations: Sequence[DraftStation]) -> tuple[DraftStation, ...]:
    """The same stations with their system ids in order."""
    sysids = [station.sysid for station in stations]
    ordered = sorted(sysids, key=_SYSIDS.index)
    return tuple(DraftStation(each.name, sysid, each.zone) for each, sysid in zip(stations, ordered, strict=True))


def _asked_names(zones: Sequence[DrawnZone], questions: Questions) -> list[Wanted]:
    """A name for each zone. Empty: they are missing."""
    if questions.ask is None:
        for number, zone in enumerate((zone for zone in zones if not zone.aside), 1):
            name = station_name(zone.name) or "NAME"
            questions.missing.append(f"--station {name}={number}: {zone.place}{'' if zone.name else ' has no name'}")
        return []
    found: list[Wanted] = []
    for number, zone in enumerate((zone for zone in zones if not zone.aside), 1):
        proposal = station_name(zone.name) or f"GCS{chr(ord('A') + number - 1)}" if number <= 26 else f"GCS-{number}"
        name = questions.offer(f"name of the station of zone {number} ({zone.place})", _name, proposal)
        found.append(Wanted(name, str(number)))
    return found


def _name(answer: str) -> str:
    if fault := name_fault(answer):
        raise ValueError(fault)
    return answer


def _left_out(zones: Sequence[DrawnZone], stations: Sequence[DraftStation]) -> tuple[str, ...]:
    """What was drawn and no station has: a line for each zone, and one for all lines and points."""
    used = {station.zone.place for station in stations}
    left = [zone for zone in zones if zone.place not in used]
    told = [f"no station has {zone.place}" for zone in left if not zone.aside]
    aside = [zone.place for zone in left if zone.aside]
    if aside:
        more = f" and {len(aside) - _MOST_TOLD} more" if len(aside) > _MOST_TOLD else ""
        told.append(
            f"left out, because a line or a point is no zone: {', '.join(aside[:_MOST_TOLD])}{more}. Draw it as a "
            "polygon if it is one"
        )
    if told:
        told.append("other zones count if you name all that do: --station NAME=ZONE for each station, the parent first")
    return tuple(told)


def _parent(stations: Sequence[DraftStation], sources: _Sources, questions: Questions) -> str | None:
    """The station that starts the flight. None: the first one, or it is missing."""
    if len(stations) < 2 or sources.facts.home is None:
        return None
    holding = holders_of_home(stations, sources.facts.home)
    if len(holding) == 1:
        return holding[0]
    names = [station.name for station in stations]

    def known(answer: str) -> str:
        if answer not in names:
            raise ValueError(f"'{answer}' (allowed: {', '.join(names)})")
        return answer

    where = f"home is in the zones of {', '.join(holding)}" if holding else "home is in no zone"
    return questions.need("--parent NAME", f"the station that starts the flight; {where}", known, (holding or names)[0])


def _check_options(arguments: argparse.Namespace, stations: Sequence[DraftStation]) -> None:
    """Raise MissionError for options that do not fit, all at once."""
    faults, names = Faults(), [station.name for station in stations]
    for each in arguments.address:
        name, _equals, host = each.partition("=")
        with faults.noted():
            if names and name not in names:
                raise MissionError(f"--address '{name[:40]}' is no station (allowed: {', '.join(names)})")
            try:
                _host(host)
            except ValueError as error:
                raise MissionError(f"--address {name[:40]}: {error}") from None
    with faults.noted():
        if arguments.handovers is not None:
            _number("--handovers", _HANDOVERS, arguments.handovers)
    for key in ("battery_wh", "hover_w"):
        with faults.noted():
            if getattr(arguments, key) is not None:
                _number(f"--{key.replace('_', '-')}", ENERGY[key], getattr(arguments, key))
    with faults.noted():
        if not 1 <= (1 if arguments.vehicle_sysid is None else arguments.vehicle_sysid) <= 255:
            raise MissionError(f"--vehicle-sysid {arguments.vehicle_sysid} (allowed: a MAVLink system id, 1 to 255)")
    with faults.noted():
        if arguments.vehicle_name is not None and not re.fullmatch("[!-~]{1,20}", arguments.vehicle_name):
            raise MissionError(f"--vehicle-name '{arguments.vehicle_name[:40]}' (allowed: 1 to 20 ASCII characters)")
    faults.raise_all()


def _sites(
    arguments: argparse.Namespace, stations: Sequence[DraftStation], questions: Questions
) -> tuple[StationSite, ...]:
    given = dict(each.partition("=")[::2] for each in arguments.address)
    found = []
    for number, station in enumerate(stations):
        host = given.get(station.name)
        if host is None:
            host = questions.offer(f"address of {station.name}, as the aircraft reaches it", _host, placeholder(number))
        found.append(StationSite(station.name, station.sysid, host))
    return tuple(found)


def _host(answer: str) -> str:
    if not _HOST.fullmatch(answer):
        raise ValueError(
            f"'{answer[:40]}' is no address (allowed: a name, an IPv4 address, an IPv6 address in brackets)"
        )
    return answer


def _energy(arguments: argparse.Namespace, questions: Questions) -> dict[str, float]:
    """The keys of [energy] that are known."""
    found: dict[str, float] = {}
    for key, meaning in (("battery_wh", "energy of the full battery in Wh"), ("hover_w", "power in hover in W")):
        value = getattr(arguments, key)
        if value is None and (key == "battery_wh" or found):

            def parse(answer: str, key: str = key) -> float | None:
                return None if answer == "unknown" else _number(key, ENERGY[key], _float(answer))

            value = questions.offer(meaning, parse, "unknown")
        if value is not None:
            found[key] = value
    return found


def _copied_plan(sources: _Sources, stations: Sequence[DraftStation]) -> tuple[str, tuple[str, ...]]:
    """The text of the plan, without the parts of its geofence that are zones now, and a note about them."""
    parts = {each.zone.fence_part for each in stations if each.zone.fence_part is not None}
    if not parts:
        return sources.text, ()
    note = (
        f"{len(parts)} areas of the plan's geofence are zones now, and no fence: the copy of the plan is without them"
    )
    return without_parts(sources.text, parts), (note,)
