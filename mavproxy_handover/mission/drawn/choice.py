# SPDX-License-Identifier: GPL-3.0-or-later

"""Chooses the zones of a mission among those that were drawn, and gives each station its name."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.mission.drawn.areas import DrawnZone
from mavproxy_handover.mission.errors import Faults, MissionError
from mavproxy_handover.mission.package import STATION_NAME

__all__ = ["RESERVED", "Choice", "Wanted", "choose", "name_fault", "station_name"]

#: names of files beside those of the stations, in small letters
RESERVED: Final = ("ground", "guard", "handover", "mission")
_LONGEST: Final = 16


@dataclass(frozen=True, slots=True)
class Wanted:
    """A station that was asked for. `zone`: the name of its zone, or its number from 1; "": its own name."""

    name: str
    zone: str = ""


@dataclass(frozen=True, slots=True)
class Choice:
    """The stations with their zones, in order, and the zones that no station has.

    `unnamed`: zones without a name that can be a station's.
    """

    stations: tuple[tuple[str, DrawnZone], ...] = ()
    left_out: tuple[DrawnZone, ...] = ()
    unnamed: tuple[DrawnZone, ...] = ()


def station_name(drawn: str) -> str:
    """The name of a station after that of its zone: "Nord Süd" becomes "Nord-Sud"; "" if nothing is left of it."""
    plain = unicodedata.normalize("NFKD", drawn).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9_]+", "-", plain).strip("-_")[:_LONGEST].rstrip("-_")


def name_fault(name: str) -> str:
    """What is wrong with the name of a station; "" if nothing is."""
    if not STATION_NAME.fullmatch(name):
        return f"'{name[:40]}' is not a station's name (allowed: 1 to {_LONGEST} letters, digits, - and _)"
    if name.lower() in RESERVED:
        return f"'{name}' is the name of another file (allowed: not {', '.join(RESERVED)})"
    return ""


def choose(zones: Sequence[DrawnZone], wanted: Sequence[Wanted]) -> Choice:
    """The zone of each wanted station; without any, every area and its own name. Raises MissionError, all at once."""
    if not wanted:
        return _every(zones)
    faults, found = Faults(), list[tuple[str, DrawnZone]]()
    areas = [zone for zone in zones if not zone.aside]
    by_order = not any(each.zone for each in wanted) and not any(zone.name for zone in areas)
    if by_order and len(wanted) != len(areas):
        raise MissionError(
            f"{len(areas)} zones without a name, and {len(wanted)} stations: name a station for each, in the order of "
            "the files, or with --station NAME=NUMBER those that count"
        )
    for number, each in enumerate(wanted):
        with faults.noted():
            if fault := name_fault(each.name):
                raise MissionError(f"--station {fault}")
            zone = areas[number] if by_order else _zone_of(zones, each)
            if zone.fault is not None:
                raise zone.fault
            found.append((each.name, zone))
    _check_names(faults, found)
    _check_twice(faults, found)
    faults.raise_all()
    left = tuple(zone for zone in zones if not any(zone is used for _name, used in found))
    return Choice(tuple(found), left)


def _every(zones: Sequence[DrawnZone]) -> Choice:
    faults, found, unnamed = Faults(), list[tuple[str, DrawnZone]](), list[DrawnZone]()
    for zone in zones:
        if zone.aside:
            continue
        with faults.noted():
            if zone.fault is not None:
                raise zone.fault
            name = station_name(zone.name)
            if not name:
                unnamed.append(zone)
            elif fault := name_fault(name):
                raise MissionError(f"{zone.place}: {fault}. Rename it, or use --station NAME={name}")
            else:
                found.append((name, zone))
    _check_names(faults, found)
    faults.raise_all()
    return Choice(tuple(found), tuple(zone for zone in zones if zone.aside), tuple(unnamed))


def _zone_of(zones: Sequence[DrawnZone], wanted: Wanted) -> DrawnZone:
    """The zone of a wanted station. Raises MissionError: there is none, or there are several."""
    key = wanted.zone or wanted.name
    matches = [zone for zone in zones if zone.name == key]
    matches = matches or [zone for zone in zones if zone.name and station_name(zone.name) == key]
    if not matches and key.isdecimal() and 1 <= int(key[:6]) <= len(zones):
        matches = [zones[int(key) - 1]]
    if not matches:
        names = ", ".join(zone.name or f"number {number}" for number, zone in enumerate(zones, 1))
        raise MissionError(f"--station {wanted.name}: no zone '{key[:60]}' (allowed: {names})")
    if len(matches) > 1:
        places = ", ".join(f"{zones.index(zone) + 1} ({zone.place})" for zone in matches)
        raise MissionError(f"--station {wanted.name}: several zones '{key}'. Name it by its number: {places}")
    return matches[0]


def _check_names(faults: Faults, found: Sequence[tuple[str, DrawnZone]]) -> None:
    """Two stations with one name, also where a file system takes capital and small letters for the same."""
    first: dict[str, tuple[str, DrawnZone]] = {}
    for name, zone in found:
        before = first.setdefault(name.lower(), (name, zone))
        with faults.noted():
            if before[1] is not zone or before[0] != name:
                raise MissionError(
                    f"{zone.place}: a second zone with the name '{name}', the first is {before[1].place} (allowed: one "
                    "for each station). Rename one, or give --station NAME=NUMBER for each zone"
                )


def _check_twice(faults: Faults, found: Sequence[tuple[str, DrawnZone]]) -> None:
    for number, (name, zone) in enumerate(found):
        with faults.noted():
            other = next((before for before, used in found[:number] if used is zone), None)
            if other is not None and other.lower() != name.lower():
                raise MissionError(f"--station {name}: {zone.place} is the zone of {other} (allowed: one for each)")
