# SPDX-License-Identifier: GPL-3.0-or-later

"""The lines and labels that a station shows of one vehicle on a map, their places and colours. Pure.

Theory of operation
-------------------
`mission_map.py` computes once what a mission shows. A `Now` holds what is true at a moment. `drawn` combines both into
items by name. The drawing code draws an item only if it differs from the one before, and removes an item that is
missing.

* A zone has its station's colour. The outline of the commander's zone is broad.
* The label of the border ahead shows the seconds, at its place on the route: the next border between the same two
  stations after the aircraft's position. If that is not known, only the panel shows the seconds.
* The route is the mission package's. If the commander flies another one, neither the route nor its handovers are shown.
* The panel in the corner shows the text of the status row, the border ahead, the return site, and what is wrong.
* Old values are not shown as true now: no seconds to a border, no broad outline of the commander's zone, and words that
  say so. The panel holds the time of its values, so that the map can tell if its station's program has stopped.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from gcs_module.ahead import Ahead
from gcs_module.alarms import LOOKS, Level
from gcs_module.banner import Situation, age, banner
from gcs_module.core import StationCore
from gcs_module.map_items import Colour, Item, Mark, Paths, Place, Plate, Row, Sign
from gcs_module.mission_map import Crossing, MissionMap, ZoneView
from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.core.safety.route import TrackFact

__all__ = ["Border", "Now", "drawn", "now_of", "place_of"]

#: the colours of `alarms.LOOKS`, which MAVProxy's console knows by name
_NAMED: Final[Mapping[str, Colour]] = {
    "black": (0, 0, 0),
    "blue": (0, 60, 200),
    "orange": (255, 165, 0),
    "red": (200, 0, 0),
    "white": (255, 255, 255),
}
_RETURN: Final[Colour] = (0, 105, 40)
_OLD: Final[Colour] = (110, 110, 110)
#: widths of lines, in pixels
_PLAIN, _BROAD = 2, 5
#: modes in which the autopilot flies to the return site
_RETURNS: Final = ("RTL", "SMART_RTL")
#: a border may be up to this far (m) behind the aircraft and still count as ahead: positions are some seconds old
_PASSED_M: Final = 60.0
#: characters of a decision in one line of the panel
_PLATE_LETTERS: Final = 64


@dataclass(frozen=True, slots=True)
class Border:
    """The border ahead: its two stations by system id, in words, and the whole seconds until it is reached."""

    from_station: int
    to_station: int
    words: str
    in_s: int


@dataclass(frozen=True, slots=True)
class Now:
    """Values of a vehicle at a moment.

    `banner`: the text of the status row; `wrong`: what is wrong and what is done, "": nothing; `place`: name, latitude
    and longitude of the return site, None: not known; `returning`: the aircraft flies there; `at`: the number of the
    item that is flown to, and how far along its leg the aircraft is (m), None: not known; `own_route`: the mission
    package's route is flown; `old`: the vehicle has not been heard for a while, so the values are of that time;
    `seconds`: time of the values, in whole seconds of the monotonic clock; `aircraft`: its last position, None: not
    known; `aircraft_s`: the age of that.
    """

    banner: str = ""
    level: Level = Level.INFO
    wrong: str = ""
    commander: int | None = None
    border: Border | None = None
    place: tuple[str, float, float] | None = None
    returning: bool = False
    at: tuple[int, float] | None = None
    own_route: bool = True
    old: bool = False
    seconds: float = 0.0
    aircraft: Place | None = None
    aircraft_s: float = 0.0


def place_of(m: Any) -> tuple[str, float, float] | None:
    """The return site in an AUTHORITY_STATUS: name, latitude and longitude (degrees); None: it has none."""
    raw: bytes | str = m.place
    name = raw.decode("utf-8", "replace") if isinstance(raw, bytes) else raw
    lat_deg, lon_deg = m.place_lat / 1e7, m.place_lon / 1e7
    on_earth = abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0
    return (name, lat_deg, lon_deg) if name and name.isprintable() and on_earth else None


def now_of(
    core: StationCore,
    situation: Situation,
    decision: str,
    place: tuple[str, float, float] | None,
    track: TrackFact | None,
    now: float,
    *,
    own_route: bool,
    aircraft: Place | None = None,
    aircraft_s: float = 0.0,
) -> Now:
    """The `Now` of what a station knows. `decision`: the vehicle's sentence about what is wrong; `track`: where the
    aircraft is on its leg. `now` is monotonic seconds."""
    words, level = banner(situation)
    ahead = core.ahead
    return Now(
        words,
        level,
        decision,
        core.commander,
        None if ahead is None or situation.old else _border(core, ahead, now),
        place,
        situation.mode in _RETURNS or situation.action is FlightAction.RETURN,
        None if track is None else (track.seq, track.along_m),
        own_route,
        situation.old,
        float(math.floor(now)),
        aircraft,
        float(math.floor(aircraft_s)),
    )


def _border(core: StationCore, ahead: Ahead, now: float) -> Border:
    key = ahead.key
    words = f"{core.name(key.from_station)} -> {core.name(key.to_station)}"
    return Border(key.from_station, key.to_station, words, max(0, math.ceil(ahead.at - now)))


def drawn(ground: MissionMap | None, now: Now, number: int = 0) -> dict[str, Item]:
    """All items to show now, by name. `ground` None: there is no mission, or its map is not ready; `number`: of the
    vehicle, for its panel."""
    found: dict[str, Item] = {}
    if ground is not None:
        for zone in ground.zones:
            commanded = zone.station == now.commander
            commands = commanded and not now.old
            outline = Paths(zone.outline, zone.colour, _BROAD if commands else _PLAIN, edged=commands)
            found[f"zone {zone.station}"] = outline
            word = "COMMANDS" if commands else "commanded when heard last"
            words = (f"{zone.words[0]} {word}", *zone.words[1:]) if commanded else zone.words
            found[f"name {zone.station}"] = _name(zone, words, commands=commands)
        found["overlaps"] = ground.overlaps
        if now.own_route:
            found |= ground.route
            found |= _crossings(ground, now)
    if now.place is not None:
        found["return"] = _return(now.place, returning=now.returning and not now.old)
    if now.aircraft is not None:
        found["aircraft"] = _around(now.aircraft, now.aircraft_s)
    found["plate"] = Plate(tuple(_rows(now)), number, now.seconds)
    return found


def _name(zone: ZoneView, words: tuple[str, ...], *, commands: bool) -> Sign:
    on = _on(zone.colour)
    if commands:
        return Sign(zone.name_at, words, on, plate=zone.colour)
    return Sign(zone.name_at, words, zone.colour if on == _NAMED["white"] else on)


def _crossings(ground: MissionMap, now: Now) -> Iterator[tuple[str, Item]]:
    ahead = _ahead(ground, now)
    for each in ground.crossings:
        sign = Sign(each.place, (f"{each.number}",), _on(each.colour), Mark.DIAMOND, each.colour)
        if each is ahead and now.border is not None:
            words = _counted(now.border)
            sign = replace(sign, words=(words,), colour=_NAMED["black"], plate=_NAMED["orange"])
        yield f"handover {each.number}", sign


def _ahead(ground: MissionMap, now: Now) -> Crossing | None:
    border = now.border
    if border is None or now.at is None:
        return None
    seq, along_m = now.at
    begins_m = ground.begins_m.get(seq)
    if begins_m is None:
        return None
    from_m = begins_m + max(0.0, along_m) - _PASSED_M
    pair = border.from_station, border.to_station
    fitting = (each for each in ground.crossings if (each.from_station, each.to_station) == pair)
    return next((each for each in fitting if each.along_m >= from_m), None)


def _around(place: Place, age_s: float) -> Sign:
    """A ring around MAVProxy's icon, which is hard to see on white tiles. A position that is old has its age."""
    old = age(age_s)
    if old:
        return Sign(place, (old,), _OLD, Mark.RING)
    return Sign(place, (), _NAMED["black"], Mark.RING)


def _return(place: tuple[str, float, float], *, returning: bool) -> Sign:
    name, lat_deg, lon_deg = place
    if returning:
        return Sign((lat_deg, lon_deg), (f"RETURNS TO {name}",), _NAMED["white"], Mark.STAR, _NAMED["red"])
    return Sign((lat_deg, lon_deg), (f"return: {name}",), _RETURN, Mark.STAR)


def _rows(now: Now) -> Iterator[Row]:
    look = LOOKS[now.level]
    yield Row(now.banner, _NAMED[look.colour], _NAMED[look.ground])
    for words in _folded(now.wrong):
        yield Row(words, _NAMED[look.colour], _NAMED[look.ground])
    if now.border is not None:
        words = _counted(now.border)
        yield Row(words, _NAMED["black"], _NAMED["orange"])
    if now.place is not None and now.old:
        yield Row(f"when heard last a return went to {now.place[0]}", _NAMED["black"], _NAMED["white"])
    elif now.place is not None and now.returning:  # the return site in the decision's sentence may have changed since
        yield Row(f"returns to {now.place[0]}", _NAMED["white"], _NAMED["red"])
    elif now.place is not None:
        yield Row(f"a return goes to {now.place[0]}", _NAMED["black"], _NAMED["white"])


def _folded(text: str) -> Iterator[str]:
    line = ""
    for word in text.split():
        if line and len(line) + 1 + len(word) > _PLATE_LETTERS:
            yield line
            line = ""
        line = f"{line} {word}".strip()
    if line:
        yield line


def _counted(border: Border) -> str:
    return f"{border.words} {f'in {border.in_s} s' if border.in_s > 0 else 'now'}"


def _on(colour: Colour) -> Colour:
    """Black or white, the one with more contrast on the colour."""
    red, green, blue = colour
    return _NAMED["white"] if 0.299 * red + 0.587 * green + 0.114 * blue < 140.0 else _NAMED["black"]
