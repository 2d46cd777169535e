# SPDX-License-Identifier: GPL-3.0-or-later

"""Rules of feeds: which station is the source of data that commands nothing (RTK corrections, ADS-B, terrain, weather).

A feed does not follow authority: a station without authority may be the source, and a handover changes nothing. Rules:

1. The configuration names the stations of each kind in an order. Another station is never the source. Without names,
   the kind follows authority or has no source (`Unnamed`).
2. Each kind has one source at a time. The next station in the order takes over after the source was silent for
   `silence_s`.
3. While the vehicle is armed, a station that comes back does not take over from a source that sends. While it is
   disarmed, an earlier station in the order takes over again after it has sent for `silence_s` without a pause.
4. RTK bases: the place of the source's base counts. Another base farther away than `apart_m` is not taken, nor one
   whose place is not known yet. While the vehicle is armed, that place stays the first one, even if the base of the
   source moves.

5. Terrain is asked for. A request goes to the station with authority first, if it is named, then to the others in their
   order: to the next one after `silence_s` without an answer. A station may answer what it was asked: the parts of the
   last request, each once.

Pure: time is an argument (monotonic seconds). Memory is bounded by the stations, and by `_MOST_REQUESTS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

__all__ = [
    "NAMES",
    "BasePlaces",
    "Ecef",
    "FeedChange",
    "FeedKind",
    "FeedRule",
    "FeedSettings",
    "Source",
    "TerrainRequests",
    "Unnamed",
]

#: terrain requests that are open at once: ArduPilot keeps twelve blocks
_MOST_REQUESTS: Final = 16
#: a request that was not repeated for this long (s) is closed
_FORGOTTEN_S: Final = 30.0
#: latitude and longitude (degrees x 10^7) and spacing (m) of a block of terrain
Block = tuple[int, int, int]
#: a place, in metres from the centre of the Earth
Ecef = tuple[float, float, float]


class FeedKind(Enum):
    """Kinds of feeds, by their keys in `[feeds]`."""

    RTK = "rtk"
    ADSB = "adsb"
    TERRAIN = "terrain"
    WEATHER = "weather"

    #: as in `Access`
    __hash__ = object.__hash__


#: what people call them
NAMES: Final[Mapping[FeedKind, str]] = {
    FeedKind.RTK: "RTK corrections",
    FeedKind.ADSB: "ADS-B",
    FeedKind.TERRAIN: "terrain",
    FeedKind.WEATHER: "weather",
}


class FeedChange(Enum):
    """Kinds of changes of a feed, as the journal has them."""

    SOURCE = "source"
    SILENT = "silent"
    NOT_USED = "not used"
    NO_PLACE = "no place"


class Unnamed(Enum):
    """Which station is the source of a kind that the configuration does not name stations for."""

    COMMANDER = "the station with authority"
    NO_STATION = "no station"


@dataclass(frozen=True, slots=True)
class FeedRule:
    """The stations of one kind (system ids) in their order, and after which silence (s) the next one takes over."""

    silence_s: float
    order: tuple[int, ...] = ()
    #: what holds without a configuration
    unnamed: Unnamed = Unnamed.NO_STATION
    #: whether the configuration names the stations; it may name none
    named: bool = False


_DEFAULTS: Final[Mapping[FeedKind, FeedRule]] = {
    FeedKind.RTK: FeedRule(3.0, unnamed=Unnamed.COMMANDER),
    FeedKind.ADSB: FeedRule(10.0),
    FeedKind.TERRAIN: FeedRule(4.0, unnamed=Unnamed.COMMANDER),
    FeedKind.WEATHER: FeedRule(60.0),
}


@dataclass(frozen=True, slots=True)
class FeedSettings:
    """The rules of all kinds. Without a configuration, they are as before there were feeds: see docs/feeds.md."""

    rules: Mapping[FeedKind, FeedRule] = field(default_factory=lambda: _DEFAULTS)
    #: farthest distance (m) of another RTK base from the first
    rtk_apart_m: float = 1.0
    #: bytes of RTK corrections in a second, of one station
    rtk_bytes_per_s: float = 4000.0


class Source:
    """The source of one kind of feed."""

    def __init__(self, rule: FeedRule) -> None:
        self.rule = rule
        #: the station that is the source; None: none has sent yet
        self.station: int | None = None
        #: whether the source is silent, and no other station can take over
        self.silent = False
        #: station -> since when it sends without a pause, and when it sent last
        self._runs: dict[int, tuple[float, float]] = {}

    def offer(self, station: int, fits: bool, armed: bool, now: float) -> bool:
        """A station sends; whether its frame passes. `fits`: its RTK base may be used."""
        if station not in self.rule.order:
            return False
        if fits:
            since, last = self._runs.get(station, (now, now))
            self._runs[station] = (since if now - last <= self.rule.silence_s else now, now)
        else:
            self._runs.pop(station, None)
        self.decide(armed, now)
        return fits and station == self.station

    def decide(self, armed: bool, now: float) -> None:
        """Time has passed: another station takes over if the source is silent."""
        best = next((station for station in self.rule.order if self.lives(station, now)), None)
        if self.station is None or not self.lives(self.station, now):
            self.silent = self.station is not None and best is None
            self.station = self.station if best is None else best
            return
        self.silent = False
        if not armed and best is not None and now - self._runs[best][0] >= self.rule.silence_s:
            self.station = best

    def lives(self, station: int, now: float) -> bool:
        """Whether a station has sent something that may pass within the silence that counts."""
        run = self._runs.get(station)
        return run is not None and now - run[1] <= self.rule.silence_s


@dataclass(frozen=True, slots=True)
class _Asked:
    """An open request: how many stations were asked, since when the last one, and when the request came last."""

    count: int
    since: float
    at: float
    #: a bit for each part that no station has answered since
    mask: int


class TerrainRequests:
    """The open requests of the autopilot for terrain (rule 5)."""

    def __init__(self, rule: FeedRule) -> None:
        self._rule = rule
        self._open: dict[Block, _Asked] = {}
        self._order: dict[Block, tuple[int, ...]] = {}

    def ask(self, block: Block, commander: int | None, now: float, mask: int) -> tuple[int, ...]:
        """The autopilot asks for parts of a block (`mask`). Returns the stations that are to get it, newest last."""
        asked = self._open.pop(block, None)
        if asked is None or now - asked.at > _FORGOTTEN_S:
            order = self._rule.order
            self._order[block] = tuple(sorted(order, key=lambda station: (station != commander, order.index(station))))
            asked = _Asked(1, now, now, mask)
        elif now - asked.since >= self._rule.silence_s:
            asked = _Asked(asked.count + 1, now, now, mask)
        else:
            asked = _Asked(asked.count, asked.since, now, mask)
        self._open[block] = asked
        while len(self._open) > _MOST_REQUESTS:
            oldest = next(iter(self._open))
            del self._open[oldest]
            del self._order[oldest]
        return self._order[block][: asked.count]

    def answers(self, station: int, block: Block, part: int, now: float) -> bool:
        """A station answers; whether it was asked for this part. The request then waits for the rest of its answer."""
        asked = self._open.get(block)
        if asked is None or now - asked.at > _FORGOTTEN_S or station not in self._order[block][: asked.count]:
            return False
        if not asked.mask >> part & 1:
            return False
        self._open[block] = _Asked(asked.count, now, asked.at, asked.mask & ~(1 << part))
        return True


class BasePlaces:
    """The places of the RTK bases, and which of them may be used (rule 4)."""

    def __init__(self, apart_m: float) -> None:
        self._apart_m = apart_m
        self._places: dict[int, Ecef] = {}
        #: the place that counts, and the station that it is from
        self._first: tuple[int, Ecef] | None = None

    def note(self, station: int, place: Ecef) -> None:
        """A base has said its place."""
        self._places[station] = place

    def known(self, station: int) -> bool:
        """Whether the base of a station has said its place."""
        return station in self._places

    def follow(self, source: int | None, silent: bool, armed: bool) -> None:
        """Take the place of the source as the one that counts; while armed, only if there is none yet."""
        if armed and self._first is not None:
            return
        place = None if source is None or silent else self._places.get(source)
        self._first = None if source is None or place is None else (source, place)

    def fits(self, station: int, source: int | None) -> bool:
        """Whether the base of a station may be used, while `source` is the source."""
        if self._first is None:
            return True
        if station not in self._places:
            return station == source
        return self.apart_m(station) <= self._apart_m

    def apart_m(self, station: int) -> float:
        """The distance of a base from the one that counts; 0 if one of the two is not known."""
        place = self._places.get(station)
        return 0.0 if place is None or self._first is None else math.dist(place, self._first[1])

    @property
    def first(self) -> int | None:
        """The station whose base counts."""
        return None if self._first is None else self._first[0]
