# SPDX-License-Identifier: GPL-3.0-or-later

"""The rows of plain values that a browser gets of a scene. Pure: time is an argument, monotonic seconds.

Rules that live here
--------------------
* An aircraft that has not been heard for OLD_S has that age, and a value that is older still has its own. An aircraft
  that has not been heard for SILENT_S is an alarm, unless its companion was ended in order.
* Colours are the missions', so that a station has the same one everywhere; a station that no mission names gets one.
* All rows are values: input from outside is never more than text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from math import inf, isinf
from typing import Any, Final

from gcs_module.alarms import EVENTS, LOOKS, Level
from gcs_module.watch.missions import Mission, coming
from gcs_module.watch.scene import Aircraft, Contact, Said, Scene
from mavproxy_handover.mission.colours import STATION_COLOURS, station_colour

__all__ = ["NOBODY_COLOUR", "OLD_S", "SILENT_S", "Shown", "age", "shown"]

#: a value that should come each second is old after this time (s); for others see `scene.Said`
OLD_S: Final = 3.0
SILENT_S: Final = 5.0
NOBODY_COLOUR: Final = "#8A8A8A"
#: batteries are reported every ten seconds at most
_BATTERY_OLD_S: Final = 15.0
#: lines of the feed, and characters of a name on the map
_LINES, _LABEL = 60, 24
_PHASES: Final = {
    "on_load": "on the ground",
    "on_mission": "on mission",
    "on_handover": "handover",
    "emergency": "emergency",
}


@dataclass(frozen=True, slots=True)
class Shown:
    """All values that a page shows at a moment, as rows for a browser."""

    aircraft: tuple[Mapping[str, Any], ...]
    alarms: tuple[Mapping[str, Any], ...]
    feed: tuple[Mapping[str, Any], ...]
    stations: tuple[Mapping[str, Any], ...]
    #: aircraft on the map
    marks: tuple[Mapping[str, Any], ...]
    #: by mission: the stations that command an aircraft
    commanding: Mapping[str, tuple[str, ...]]
    #: by station; "" if no station commands
    colours: Mapping[str, str]


def age(seconds: float) -> str:
    """An age in words; "" for a value that was never sent."""
    if isinf(seconds):
        return ""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.0f} h"


class _Aged:
    """Adds ages to an aircraft's values that are older than the aircraft's last message."""

    def __init__(self, craft: Aircraft, now: float) -> None:
        self._now = now
        self._silent_s = max(0.0, now - craft.heard_at)

    def __call__(self, said: Said[Any], words: str, old_s: float = OLD_S) -> str:
        """ "" if the value is not known."""
        if not said.known or not words:
            return ""
        seconds = said.age_s(self._now)
        return words if seconds <= self._silent_s + old_s else f"{words} ({age(seconds)} old)"


def shown(scene: Scene, missions: Mapping[str, Mission], now: float) -> Shown:
    """The values to show now. `missions`: by key."""
    colours = _Colours(scene, missions)
    craft = sorted(scene.aircraft.values(), key=lambda each: _by_number(each.name))
    commanding: dict[str, set[str]] = {}
    for each in craft:
        if each.mission and each.commander.value:
            commanding.setdefault(each.mission, set()).add(each.commander.value)
    alarms = sorted(_alarms(craft, now), key=lambda row: (-row["rank"], _by_number(row["aircraft"])))
    worst = dict.fromkeys(scene.aircraft, Level.INFO)
    for row in alarms:
        worst[row["aircraft"]] = max(worst[row["aircraft"]], Level(row["rank"]))
    return Shown(
        tuple(_row(each, missions.get(each.mission), colours, worst[each.name], now) for each in craft),
        tuple(alarms),
        tuple(
            {
                "number": line.number,
                "time": datetime.fromtimestamp(max(0.0, line.utc), timezone.utc).strftime("%H:%M:%S"),
                "who": line.who,
                "level": line.level.name.lower(),
                "text": line.text,
            }
            for line in list(scene.feed)[: -_LINES - 1 : -1]
        ),
        tuple(_stations(scene, colours, now)),
        tuple(_mark(each, colours, worst[each.name], now) for each in craft if each.place.value is not None),
        {key: tuple(sorted(names)) for key, names in sorted(commanding.items())},
        colours.all(),
    )


def _by_number(name: str) -> list[tuple[int, str]]:
    """A sort key that puts drone-10 after drone-9."""
    return [(int(part) if part.isdecimal() else -1, part) for part in re.split(r"(\d+)", name[:40])]


class _Colours:
    """Colours of stations, by name."""

    def __init__(self, scene: Scene, missions: Mapping[str, Mission]) -> None:
        self._found = {name: colour for each in missions.values() for name, colour in each.colours.items()}
        taken = set(self._found.values())
        free = [colour for colour in STATION_COLOURS if colour not in taken]
        for name in scene.stations:
            if name not in self._found:
                self._found[name] = free.pop(0) if free else station_colour(len(self._found))

    def of(self, name: str) -> str:
        return self._found.get(name, NOBODY_COLOUR)

    def all(self) -> dict[str, str]:
        return {**self._found, "": NOBODY_COLOUR}


def _row(craft: Aircraft, mission: Mission | None, colours: _Colours, worst: Level, now: float) -> dict[str, Any]:
    silent_s, aged = now - craft.heard_at, _Aged(craft, now)
    commander = craft.commander.value
    nobody = craft.commander.known and not commander
    percent = craft.battery_percent
    charge = aged(percent, f"{percent.value or 0.0:.0f} %", _BATTERY_OLD_S)
    battery = ", ".join(filter(None, (charge, aged(craft.battery_words, craft.battery_words.value, _BATTERY_OLD_S))))
    return {
        "name": craft.name,
        "level": worst.name.lower(),
        "old": f"{age(silent_s)} old" if silent_s > OLD_S else "",
        "ended": craft.ended,
        "commander": aged(craft.commander, commander or "nobody") if craft.commander.known else "",
        "nobody": nobody,
        "colour": colours.of(commander),
        "epoch": "" if craft.epoch.value is None else f"handover {craft.epoch.value}",
        "phase": _phase(craft, aged),
        "next": _next(craft, mission, now),
        "lease": aged(craft.lease, craft.lease.value),
        "guard": aged(craft.guard, craft.guard.value),
        "guarded": craft.guard.value in ("live", ""),
        "held": craft.lease.value in ("held", "transfer", ""),
        "payload": ", ".join(
            filter(None, (aged(said, f"{kind} {said.value}") for kind, said in craft.payload.items()))
        ),
        "battery": battery,
        "low": percent.value is not None and percent.value < 30.0,
        "links": [_link(name, contact, colours) for name, contact in sorted(craft.contacts.items())],
        "place": _place(craft, aged),
    }


def _phase(craft: Aircraft, aged: _Aged) -> str:
    words = _PHASES.get(craft.phase.value, craft.phase.value)
    if craft.rehearsal.value:
        words = f"rehearsal, {words}"
    mode = aged(craft.mode, craft.mode.value)
    return " · ".join(filter(None, (aged(craft.phase, words), mode)))


def _next(craft: Aircraft, mission: Mission | None, now: float) -> str:
    """The next handover. The vehicle's own message counts before its mission and position."""
    if craft.heard_at < now - SILENT_S:
        return ""
    if craft.partner.value and craft.partner.age_s(now) <= SILENT_S:
        return f"{craft.partner.value} now"
    if craft.phase.value == "emergency":
        return ""
    border = craft.border.value
    if border is not None and craft.border.age_s(now) <= OLD_S:
        return f"{border.to_station} in {max(0.0, border.at - now):.0f} s"
    known = None if mission is None or craft.place.age_s(now) > OLD_S else coming(mission, craft)
    if known is not None and craft.phase.value == "on_mission":
        return f"{known.to_station} in about {known.in_s:.0f} s"
    if known is not None:
        return f"{known.to_station} after {known.in_m:.0f} m"
    ends_s = craft.zone_ends_at.value - now
    if ends_s < inf and craft.zone_ends_at.age_s(now) <= OLD_S:
        return f"zone ends in {max(0.0, ends_s):.0f} s"
    return ""


def _link(name: str, contact: Contact, colours: _Colours) -> dict[str, Any]:
    good, all_links = sum(contact.links.values()), len(contact.links)
    if contact.heard is False:
        state, words = "lost", "silent"
    elif contact.heard is None and not all_links:
        state, words = "unknown", ""
    elif good < all_links:
        state, words = "weak", "weak" if all_links == 1 else f"{all_links - good} of {all_links} weak"
    else:
        state, words = "good", ""
    return {"name": name, "colour": colours.of(name), "state": state, "words": words}


def _place(craft: Aircraft, aged: _Aged) -> str:
    place = craft.place.value
    if place is None:
        return ""
    height = "" if place.alt_m is None else f"{place.alt_m:.0f} m"
    zone = f"in {craft.zone.value}" if craft.zone.value else "outside every zone"
    return aged(craft.place, ", ".join(filter(None, (height, zone))))


def _mark(craft: Aircraft, colours: _Colours, worst: Level, now: float) -> dict[str, Any]:
    place = craft.place.value
    assert place is not None
    old_s = craft.place.age_s(now)
    heading = craft.heading_deg.value if craft.heading_deg.age_s(now) <= OLD_S else None
    return {
        "name": craft.name,
        "label": craft.name[:_LABEL],
        "at": [round(place.lat_deg, 7), round(place.lon_deg, 7)],
        "heading": heading,
        "colour": colours.of(craft.commander.value),
        "old": f"{age(old_s)} old" if old_s > OLD_S else "",
        "level": worst.name.lower(),
    }


def _alarms(craft: list[Aircraft], now: float) -> Iterator[dict[str, Any]]:
    for each in craft:
        standing = [alarm for alarms in (each.alarms, *each.stations_alarms.values()) for alarm in alarms.standing]
        for alarm in standing:
            yield _alarm(each.name, alarm.level, alarm.text, acknowledged=alarm.acknowledged)
        silent_s = now - each.heard_at
        if silent_s > SILENT_S and not each.ended and not isinf(silent_s):
            yield _alarm(each.name, EVENTS["lost"], f"nothing new for {age(silent_s)}", acknowledged=False)


def _alarm(aircraft: str, level: Level, text: str, *, acknowledged: bool) -> dict[str, Any]:
    look = LOOKS[level]
    return {
        "aircraft": aircraft,
        "level": level.name.lower(),
        "rank": int(level),
        "text": text,
        "colour": look.colour,
        "ground": look.ground,
        "acknowledged": acknowledged,
    }


def _stations(scene: Scene, colours: _Colours, now: float) -> Iterator[dict[str, Any]]:
    for station in sorted(scene.stations.values(), key=lambda each: each.name):
        commanded = (each.name for each in scene.aircraft.values() if each.commander.value == station.name)
        commands = sorted(commanded, key=_by_number)
        source = station.source
        quiet_s = inf if source is None else now - source.heard_at
        if source is None:
            state = ""
        elif station.ended:
            state = "ended"
        else:
            state = f"last entry {age(quiet_s)} ago"
        yield {
            "name": station.name,
            "colour": colours.of(station.name),
            "commands": commands,
            "state": state,
        }
