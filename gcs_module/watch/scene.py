# SPDX-License-Identifier: GPL-3.0-or-later

"""All aircraft and stations with their last known values and times. Pure: time is an argument, monotonic seconds.

Rules that live here
--------------------
* A value is as old as the entry or message that brought it. A value that a journal writes only
  at a change is as old as the newest entry of that journal.
* The aircraft's own value, of its journal or its link, has priority over a station's value about it, for HOLDS_S.
* Everything is bounded. Aircraft and stations beyond the limit are left out and counted; those that are shown stay.
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
from mavproxy_handover.wire.ids import PAYLOAD_COMPIDS

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

#: most aircraft, most stations, kept places of a track, kept lines of the feed
MOST_AIRCRAFT, MOST_STATIONS, TRACK, FEED = 64, 32, 4000, 300
#: a station's value counts after the aircraft's own is older than this (s)
HOLDS_S: Final = 10.0
#: a place is added to the track if it is this far (m) from the one before
_APART_M: Final = 2.0
#: most characters of a name, of a text
_NAME, _TEXT = 40, 400

T = TypeVar("T")


class Rank(IntEnum):
    """The origin of a value; a higher one has priority."""

    NOBODY = 0
    STATION = 1
    AIRCRAFT = 2


@dataclass(slots=True)
class Source:
    """A journal or a link, and the time of its last entry or frame. -inf: never."""

    name: str
    heard_at: float = -inf


@dataclass(slots=True)
class Said(Generic[T]):
    """A value with its time and origin. `source`: the value is as fresh as this source; None: it gets old by itself."""

    value: T
    at: float = -inf
    rank: Rank = Rank.NOBODY
    source: Source | None = None

    def hear(self, value: T, at: float, rank: Rank, source: Source | None = None) -> bool:
        """Store the value, unless one with priority still holds; returns whether it was stored."""
        if rank < self.rank and self.age_s(at) < HOLDS_S:
            return False
        self.value, self.at, self.rank, self.source = value, at, rank, source
        return True

    def age_s(self, now: float) -> float:
        """The age of the value (s); inf: it was never sent."""
        at = self.at if self.source is None else max(self.at, self.source.heard_at)
        return max(0.0, now - at)

    @property
    def known(self) -> bool:
        """Whether the value was ever sent."""
        return self.at > -inf


@dataclass(frozen=True, slots=True)
class Place:
    """Degrees; `alt_m` above home, None: not known."""

    lat_deg: float
    lon_deg: float
    alt_m: float | None = None


@dataclass(frozen=True, slots=True)
class Border:
    """The next handover by the vehicle's own message: its two stations, and when the border is reached (monotonic
    s)."""

    from_station: str
    to_station: str
    at: float


@dataclass(slots=True)
class Contact:
    """A station as an aircraft hears it; None: it has not said. `links`: device string, and whether it is good."""

    heard: bool | None = None
    links: dict[str, bool] = field(default_factory=dict)


class Track:
    """The places of an aircraft with its commander there; the last TRACK places. `count`: of all that there were."""

    def __init__(self) -> None:
        self.places: deque[tuple[float, float, str]] = deque(maxlen=TRACK)
        self.count = 0

    def add(self, lat_deg: float, lon_deg: float, commander: str) -> None:
        """`commander` "": no station, or not known."""
        if self.places:
            lat, lon, by = self.places[-1]
            if by == commander and distance_m(lat, lon, lat_deg, lon_deg) < _APART_M:
                return
        self.places.append((lat_deg, lon_deg, commander))
        self.count += 1

    def since(self, count: int) -> Iterator[tuple[float, float, str]]:
        """The places after the first `count`, as far as they are kept."""
        new = min(len(self.places), self.count - count)
        return (self.places[number] for number in range(len(self.places) - new, len(self.places)))


@dataclass(slots=True)
class Aircraft:
    """One aircraft. "" and None mean "not known"; but a known `commander` of "" means that no station commands."""

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
    #: by kind of payload: the station or onboard program that has it
    payload: dict[str, Said[str]] = field(default_factory=lambda: {kind: Said("") for kind in PAYLOAD_COMPIDS})
    #: percent, and other values of the battery: volts or watt-hours
    battery_percent: Said[float | None] = field(default_factory=lambda: Said(None))
    battery_words: Said[str] = field(default_factory=lambda: Said(""))
    border: Said[Border | None] = field(default_factory=lambda: Said(None))
    #: when the commander's zone ends (monotonic s); inf: no end is in sight
    zone_ends_at: Said[float] = field(default_factory=lambda: Said(inf))
    #: whether the package's mission is flown
    own_route: bool = True
    #: the key of its mission
    mission: str = ""
    contacts: dict[str, Contact] = field(default_factory=dict)
    track: Track = field(default_factory=Track)
    #: alarms of the aircraft itself, and of each station about it
    alarms: Alarms = field(default_factory=Alarms)
    stations_alarms: dict[str, Alarms] = field(default_factory=dict)
    #: its own journal or link
    source: Source | None = None
    heard_at: float = -inf
    #: it was ended in order, so its silence is no alarm
    ended: bool = False

    def contact(self, station: str) -> Contact | None:
        """How the aircraft hears that station; None if there are too many."""
        if station not in self.contacts and len(self.contacts) >= MOST_STATIONS:
            return None
        return self.contacts.setdefault(station, Contact())

    def moved(self, place: Place, at: float, rank: Rank) -> None:
        """The aircraft is at this place."""
        if self.place.hear(place, at, rank):
            commander = self.commander.value if self.commander.age_s(at) < HOLDS_S else ""
            self.track.add(place.lat_deg, place.lon_deg, commander)


@dataclass(frozen=True, slots=True)
class Line:
    """One line of the feed. `utc`: seconds since 1970; `number` rises by one with each."""

    number: int
    utc: float
    who: str
    level: Level
    text: str


@dataclass(slots=True)
class Station:
    """A station that writes a followed journal, or that an aircraft names."""

    name: str
    source: Source | None = None
    ended: bool = False


class Scene:
    """All aircraft and stations. Not safe for threads."""

    def __init__(self) -> None:
        self.aircraft: dict[str, Aircraft] = {}
        self.stations: dict[str, Station] = {}
        self.feed: deque[Line] = deque(maxlen=FEED)
        self.told = 0
        #: aircraft and stations beyond the limit
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
        """The station of that name, new if there is none yet; None: there are too many."""
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
