# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover check --fix`: puts right what needs no decision of a planner.

A fix changes the texts of the package, and says what it changed. Each works on any package, also on one that cannot be
loaded. Nothing is lost: the file of before is kept beside the new one, with the ending `.orig`.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.items import TAKEOFFS
from mavproxy_handover.mission.package import MISSION_FILE, from_texts, read_file
from mavproxy_handover.vehicle.profiles import ASSUMED, PROFILES

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["fix"]

#: files of a package by name
_Texts = dict[str, str]


def fix(folder: Path) -> tuple[str, ...]:
    """Mend the mission package in `folder`. Returns what was changed, a line for each.

    What cannot be mended is left as it was, for the check to tell. Raises MissionError if a file cannot be written.
    """
    before = _read(folder)
    texts, told = dict(before), list[str]()
    for mend in _FIXES:
        # a file that is not as people write it is for the check to tell
        with contextlib.suppress(KeyError, TypeError, ValueError, AttributeError, IndexError):
            told += mend(texts)
    for name, text in texts.items():
        if text != before[name]:
            _replace(folder / name, text)
    return tuple(told)


def _read(folder: Path) -> _Texts:
    texts: _Texts = {}
    with contextlib.suppress(MissionError, tomllib.TOMLDecodeError):
        texts[MISSION_FILE] = read_file(folder, MISSION_FILE)
        mission = tomllib.loads(texts[MISSION_FILE])
        for key in ("route", "zones"):
            name = mission.get(key)
            if isinstance(name, str) and name == Path(name).name:
                texts[name] = read_file(folder, name)
    return texts


def _replace(path: Path, text: str) -> None:
    """Write a file, and keep the one of before. Raises MissionError."""
    kept = path.with_name(path.name + ".orig")
    number = 1
    while kept.exists():
        number += 1
        kept = path.with_name(f"{path.name}.orig{number}")
    new = path.with_name(path.name + ".new")
    try:
        new.write_text(text, encoding="utf-8")
        shutil.copy2(path, kept)
        os.replace(new, path)
    except OSError as error:
        raise MissionError(f"{path}: cannot be written: {error.strerror or error}. It is as it was") from None


# --- fixes: each yields what it changed ---


def _kind_of_aircraft(texts: _Texts) -> Iterator[str]:
    """The plan says which kind of aircraft it is for, and the mission does not."""
    mission = tomllib.loads(texts[MISSION_FILE])
    route = mission["route"]
    if "aircraft" in mission or not route.endswith(".plan"):
        return
    made_for = json.loads(texts[route])["mission"]["vehicleType"]
    kind = next((profile for profile in PROFILES if made_for in profile.types), ASSUMED)
    if kind is not ASSUMED and (changed := _with_key(texts[MISSION_FILE], "aircraft", f'"{kind.name}"')):
        texts[MISSION_FILE] = changed
        yield f'{MISSION_FILE}: aircraft = "{kind.name}", as the plan says (vehicleType {made_for})'


def _home(texts: _Texts) -> Iterator[str]:
    """Home was never set: the take-off is where it is."""
    route = tomllib.loads(texts[MISSION_FILE])["route"]
    if route.endswith(".plan"):
        plan = json.loads(texts[route])
        mission = plan["mission"]
        starts = (item["params"][4:6] for item in mission["items"] if item.get("command") in TAKEOFFS)
        place = next(iter(starts), [0, 0])
        if any(mission["plannedHomePosition"][:2]) or not all(place):
            return
        mission["plannedHomePosition"][:2] = place
        texts[route] = json.dumps(plan, indent=4, ensure_ascii=False) + "\n"
    else:
        lines = texts[route].splitlines()
        home = lines[1].split("\t")
        start = next((row for row in (line.split("\t") for line in lines[2:]) if int(row[3]) in TAKEOFFS), home)
        place = [float(value) for value in start[8:10]]
        if any(float(value) for value in home[8:10]) or not all(place):
            return
        lines[1] = "\t".join([*home[:8], *start[8:10], *home[10:]])
        texts[route] = "\n".join(lines) + "\n"
    yield f"{route}: home is at the take-off, latitude {place[0]:.6f}, longitude {place[1]:.6f}. It was at 0, 0"


def _zones(texts: _Texts) -> Iterator[str]:
    """Zones that lack the property `station`, and rings that are not closed."""
    mission = tomllib.loads(texts[MISSION_FILE])
    file = mission["zones"]
    collection = json.loads(texts[file])
    told = list[str]()
    names = {station["name"] for station in mission["stations"]}
    for number, feature in enumerate(collection["features"], 1):
        properties = feature["properties"]
        if "station" not in properties and properties.get("name") in names:
            properties["station"] = properties["name"]
            told.append(f"{file}: feature {number}: station is '{properties['name']}', as its name")
        for ring in _rings(feature["geometry"]):
            if ring[0] != ring[-1]:
                ring.append(ring[0])
                told.append(f"{file}: feature {number}: the ring is closed: the first position stands at its end too")
    if told:
        texts[file] = json.dumps(collection, indent=2, ensure_ascii=False) + "\n"
    yield from told


def _rings(geometry: dict[str, Any]) -> list[Any]:
    coordinates = geometry["coordinates"]
    if geometry["type"] == "Polygon":
        return list(coordinates)
    return [ring for part in coordinates for ring in part] if geometry["type"] == "MultiPolygon" else []


def _expected_handovers(texts: _Texts) -> Iterator[str]:
    """The number of handovers that the route makes."""
    try:
        package = from_texts(texts, MISSION_FILE)
    except MissionError:
        return
    made, expected = len(package.simulate().handovers), package.expected_handovers
    changed = _with_key(texts[MISSION_FILE], "expected_handovers", str(made))
    if made != expected and changed:
        texts[MISSION_FILE] = changed
        yield f"{MISSION_FILE}: expected_handovers = {made}" + ("" if expected is None else f". It was {expected}")


_FIXES: tuple[Callable[[_Texts], Iterator[str]], ...] = (_kind_of_aircraft, _home, _zones, _expected_handovers)


def _with_key(text: str, key: str, value: str) -> str | None:
    """The text of mission.toml with that value of a key, and all else as it was. None: not possible."""
    before = tomllib.loads(text)
    line = rf"(?m)^{key}[ \t]*=[ \t]*[^#\n]*?(?=[ \t]*(#.*)?$)"
    if key in before:
        changed = re.sub(line, f"{key} = {value}", text, count=1)
    else:
        table = re.search(r"(?m)^\s*\[", text)
        at = len(text) if table is None else table.start()
        lead = text[:at].rstrip("\n")
        changed = f"{lead}\n{key} = {value}\n" + ("\n" if table is not None else "") + text[at:].lstrip("\n")
    try:
        after = tomllib.loads(changed)
    except tomllib.TOMLDecodeError:
        return None
    return changed if after == {**before, key: tomllib.loads(f"x = {value}")["x"]} else None
