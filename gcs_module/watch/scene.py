# SPDX-License-Identifier: GPL-3.0-or-later

"""All aircraft and stations as they were last said to be, and when. Pure: time is an argument, monotonic seconds.

Rules that live here
--------------------
* A value is as old as the word that it comes from. What a journal writes only when it changes is as old as the newest
  entry of that journal: had it changed, that would stand there.
* The aircraft's own word, of its journal or its link, counts before a station's word about it, for HOLDS_S.
* Everything is bounded. What would be one too many is left out and counted: nobody who is there already is pushed out
  by who comes later.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from math import inf
from typing import Final, Generic, TypeVar

from gcs_module.alarms import Alarms, Level
from mavproxy_handover.mission.geodesy import distance_m

__all__ = [
    "FEED",
    "HOLDS_S",
    "MOST_AIRCRAFT",
    "MOST_STATIONS",
    "TRACK",
    "Aircraft",
    "Border",
    "Contact",
    "Line",
    "Place",
    "Rank",
    "Said",
    "Scene",
    "Source",
    "Track",
]

#: so many of each are shown; places of a track, lines of the feed that are kept
MOST_AIRCRAFT, MOST_STATIONS, TRACK, FEED = 64, 32, 4000, 300
#: a station's word waits until the aircraft's own is older than this (s)
HOLDS_S: Final = 10.0
#: a place counts for the track when it is so far (m) from the one before
_APART_M: Final = 2.0
#: characters of a name, a text
_NAME, _TEXT = 40, 400

T = TypeVar("T")


class Rank(IntEnum):
    """Whose word it is; the higher counts."""

    NOBODY = 0
    STATION = 1
    AIRCRAFT = 2


@dataclass(slots=True)
class Source:
    """A journal or a link: when it said anything at all. -inf: never."""

    name: str
    heard_at: float = -inf


@dataclass(slots=True)
class Said(Generic[T]):
    """A value, and who said it when. `source`: it holds as long as that goes on; None: it grows old by itself."""

    value: T
    at: float = -inf
    rank: Rank = Rank.NOBODY
    source: Source | None = None

    def hear(self, value: T, at: float, rank: Rank, source: Source | None = None) -> bool:
        """Take it in, unless a better word still holds; whether it was taken."""
        if rank < self.rank and self.age_s(at) < HOLDS_S:
            return False
        self.value, self.at, self.rank, self.source = value, at, rank, source
        return True

    def age_s(self, now: float) -> float:
        """How old it is; inf: it was never said."""
        at = self.at if self.source is None else max(self.at, self.source.heard_at)
        return max(0.0, now - at)

    @property
    def known(self) -> bool:
        """Somebody has said it."""
        return self.at > -inf


@dataclass(frozen=True, slots=True)
class Place:
    """Degrees; `alt_m` above home, None: not said."""

    lat_deg: float
    lon_deg: float
    alt_m: float | None = None


@dataclass(frozen=True, slots=True)
class Border:
    """The next handover by the vehicle's own word: between which stations, and when it is reached (monotonic s)."""

    from_station: str
    to_station: str
    at: float


@dataclass(slots=True)
class Contact:
    """A station as an aircraft hears it; None: it has not said so. `links`: device string, and whether it is good."""

    heard: bool | None = None
    links: dict[str, bool] = field(default_factory=dict)


class Track:
    """Where an aircraft was, and who commanded it there; the last TRACK places. `count`: of all that there were."""

    def __init__(self) -> None:
        self.places: deque[tuple[float, float, str]] = deque(maxlen=TRACK)
        self.count = 0

    def add(self, lat_deg: float, lon_deg: float, commander: str) -> None:
        """`commander` "": nobody, or not known."""
        if self.places:
            lat, lon, by = self.places[-1]
            if by == commander and distance_m(lat, lon, lat_deg, lon_deg) < _APART_M:
                return
        self.places.append((lat_deg, lon_deg, commander))
        self.count += 1

    def since(self, count: int) -> Iterator[tuple[float, float, str]]:
        """Those that came after the first `count`, as far as they are kept."""
        new = min(len(self.places), self.count - count)
        return (self.places[number] for number in range(len(self.places) - new, len(self.places)))


@dataclass(slots=True)
class Aircraft:
    """One of them. "" and None are "not said" but for `commander`, where "" is nobody once it is `known`."""

    name: str
    place: Said[Place | None] = field(default_factory=lambda: Said(None))
    heading_deg: Said[float | None] = field(default_factory=lambda: Said(None))
    speed_mps: Said[float | None] = field(default_factory=lambda: Said(None))
    waypoint: Said[int | None] = field(default_factory=lambda: Said(None))
    zone: Said[str] = field(default_factory=lambda: Said(""))
    commander: Said[str] = field(default_factory=lambda: Said(""))
    partner: Said[str] = field(default_factory=lambda: Said(""))
    epoch: Said[int | None] = field(default_factory=lambda: Said(None))
    phase: Said[str] = field(default_factory=lambda: Said(""))
    lease: Said[str] = field(default_factory=lambda: Said(""))
    guard: Said[str] = field(default_factory=lambda: Said(""))
    mode: Said[str] = field(default_factory=lambda: Said(""))
    rehearsal: Said[bool] = field(default_factory=lambda: Said(False))
    #: percent, and what is said of it else: volts or watt-hours
    battery_percent: Said[float | None] = field(default_factory=lambda: Said(None))
    battery_words: Said[str] = field(default_factory=lambda: Said(""))
    border: Said[Border | None] = field(default_factory=lambda: Said(None))
    #: when the commander's zone ends (monotonic s); inf: no end in sight
    zone_ends_at: Said[float] = field(default_factory=lambda: Said(inf))
    #: the mission that is flown is not the package's any more
    own_route: bool = True
    #: number of its mission among those that are shown
    mission: str = ""
    contacts: dict[str, Contact] = field(default_factory=dict)
    track: Track = field(default_factory=Track)
    #: what the aircraft says itself, and what each station says of it
    alarms: Alarms = field(default_factory=Alarms)
    stations_alarms: dict[str, Alarms] = field(default_factory=dict)
    #: its own journal or link
    source: Source | None = None
    heard_at: float = -inf
    #: it was ended in order: its silence is no alarm
    ended: bool = False

    def contact(self, station: str) -> Contact | None:
        """How it hears that station; None where there are too many."""
        if station not in self.contacts and len(self.contacts) >= MOST_STATIONS:
            return None
        return self.contacts.setdefault(station, Contact())

    def moved(self, place: Place, at: float, rank: Rank) -> None:
        """It is there."""
        if self.place.hear(place, at, rank):
            commander = self.commander.value if self.commander.age_s(at) < HOLDS_S else ""
            self.track.add(place.lat_deg, place.lon_deg, commander)


@dataclass(frozen=True, slots=True)
class Line:
    """One of the feed. `utc`: seconds since 1970; `number` rises by one with each."""

    number: int
    utc: float
    who: str
    level: Level
    text: str


@dataclass(slots=True)
class Station:
    """One that writes a journal which is followed, or is named by an aircraft."""

    name: str
    source: Source | None = None
    ended: bool = False


class Scene:
    """All of them. Not safe for threads."""

    def __init__(self) -> None:
        self.aircraft: dict[str, Aircraft] = {}
        self.stations: dict[str, Station] = {}
        self.feed: deque[Line] = deque(maxlen=FEED)
        self.told = 0
        #: aircraft and stations that there was no room for
        self.left_out = 0

    def craft(self, name: str) -> Aircraft | None:
        """The aircraft of that name, new if there is none yet; None: there are too many."""
        name = name[:_NAME]
        found = self.aircraft.get(name)
        if found is None and len(self.aircraft) >= MOST_AIRCRAFT:
            self.left_out += 1
        elif found is None:
            found = self.aircraft[name] = Aircraft(name)
        return found

    def station(self, name: str) -> Station | None:
        """The same for a station."""
        name = name[:_NAME]
        found = self.stations.get(name)
        if found is None and len(self.stations) >= MOST_STATIONS:
            self.left_out += 1
        elif found is None:
            found = self.stations[name] = Station(name)
        return found

    def tell(self, utc: float, who: str, level: Level, text: str) -> None:
        """Add a line to the feed."""
        self.told += 1
        self.feed.append(Line(self.told, utc, who[:_NAME], level, " ".join(text.split())[:_TEXT]))
