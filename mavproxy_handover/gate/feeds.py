# SPDX-License-Identifier: GPL-3.0-or-later

"""Feeds through the gate: a frame of RTK corrections, ADS-B, terrain or weather passes if its station is the source.

The rule is in `core/feeds.py`. Here a frame becomes an offer: its kind by its message, the place of an RTK base by its
contents, and a limit of bytes. The policy leaves every feed to this filter (`Access.FEED`). Rules:

1. The limit counts for each station and kind, before anything else is looked at: a flood costs a comparison.
2. A frame that no sender of its message makes is dropped: lengths and places out of range.
3. A fault here drops the frame. It is reported, and only feeds depend on this module.
4. People are told in words (`FeedNews`): all stations of another source, seldom if it changes often; a station of its
   own frames that do not pass, every `REMIND_S` for each reason. A station that waits as the next source is not told:
   that is its place. A source whose base has not said its place for `PLACE_S` is told once.

Memory is bounded by the stations and kinds. Time is an argument (monotonic seconds).
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from mavproxy_handover.core.feeds import (
    NAMES,
    BasePlaces,
    Block,
    FeedChange,
    FeedKind,
    FeedSettings,
    Source,
    TerrainRequests,
    Unnamed,
)
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.line_budget import LineBudget
from mavproxy_handover.gate.policy.messages import FEED_MESSAGES
from mavproxy_handover.gate.rate_limit import RateLimit
from mavproxy_handover.wire.frames import Frame, field_bytes, field_float, field_int
from mavproxy_handover.wire.message_ids import MESSAGE_IDS
from mavproxy_handover.wire.rtcm import INJECTED_BYTES, RTCM_BYTES, BaseReader

__all__ = ["KINDS", "PLACE_S", "REMIND_S", "FeedNews", "Feeds", "feed_bytes_per_s"]

#: message id -> kind of feed
KINDS: Final[Mapping[int, FeedKind]] = {
    MESSAGE_IDS[name]: FeedKind(kind)
    for kind, names in FEED_MESSAGES.items()
    for name in names.split()
    if name in MESSAGE_IDS
}
#: bytes in a second and reserve of one station, but RTK's (`[feeds] rtk_bytes_per_s`): eighty aircraft once a second,
#: a hundred terrain blocks a second
_BYTES_PER_S: Final[Mapping[FeedKind, float]] = {
    FeedKind.ADSB: 4000.0,
    FeedKind.TERRAIN: 6000.0,
    FeedKind.WEATHER: 200.0,
}
_RESERVE_S: Final = 2.0
#: a station whose frames do not pass is told again after this time (s)
REMIND_S: Final = 60.0
#: texts about the source of one kind: one in this time (s), and so many at once
_NEWS_S: Final = 10.0
_NEWS_AT_ONCE: Final = 5.0
#: a base says its place every ten seconds or more often: after this time (s) it does not say it at all
PLACE_S: Final = 30.0
#: head, check sum and start of a frame
_FRAME_BYTES: Final = 12
_RTCM: Final = MESSAGE_IDS["GPS_RTCM_DATA"]
_INJECT: Final = MESSAGE_IDS["GPS_INJECT_DATA"]
_ADSB: Final = MESSAGE_IDS["ADSB_VEHICLE"]
_TERRAIN: Final = MESSAGE_IDS["TERRAIN_DATA"]
_WIND: Final = MESSAGE_IDS["WIND_COV"]
#: 4 x 4 heights each, of a block of 8 x 7
_BLOCKS: Final = 56
#: the stations are looked at this often (s)
_TICK_S: Final = 0.2

_CONSUME: Final = Fate.CONSUME
_FEED: Final = GateReason.FEED


def feed_bytes_per_s(kind: FeedKind, settings: FeedSettings) -> float:
    """The limit of a feed of one station."""
    return _BYTES_PER_S.get(kind, settings.rtk_bytes_per_s)


class FeedNews(NamedTuple):
    """A text for people. `station`: the one that it is for; None: all. `about`: the station whose feed it is."""

    kind: FeedKind
    text: str
    station: int | None
    about: str
    change: FeedChange


@dataclass(slots=True)
class _Purse:
    left: float
    counted_at: float


class Feeds:
    """Of one vehicle. `names`: every known station, by system id; `fault` is told what broke, and where."""

    def __init__(
        self,
        settings: FeedSettings,
        names: Mapping[int, str],
        in_force: AuthorityInForce,
        budget: LineBudget,
        fault: Callable[[str, str], None],
    ) -> None:
        self.untold: list[FeedNews] = []
        self.sources = {kind: Source(rule) for kind, rule in settings.rules.items()}
        self._settings = settings
        self._names = names
        self._in_force = in_force
        self._budget = budget
        self._fault = fault
        self._terrain = TerrainRequests(settings.rules[FeedKind.TERRAIN])
        self._places = BasePlaces(settings.rtk_apart_m)
        self._readers = {station: BaseReader() for station in names}
        self._purses: dict[tuple[int, FeedKind], _Purse] = {}
        #: by kind: the source that people were told, and whether it is silent; the limit of such texts
        self._told_source: dict[FeedKind, tuple[int | None, bool]] = dict.fromkeys(FeedKind, (None, False))
        self._news_room = {kind: RateLimit(1.0 / _NEWS_S, _NEWS_AT_ONCE) for kind in FeedKind}
        #: when a station was told of frames that do not pass
        self._told_at: dict[tuple[int, FeedKind, GateReason], float] = {}
        #: station -> when its first corrections came, while its base has not said its place
        self._placeless: dict[int, float] = {}
        self._ticked_at = -math.inf

    # ---- frames ---------------------------------------------------------------------------------------------------

    def limit(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        """The final verdict on a feed of a station."""
        if verdict.fate is not _CONSUME or verdict.reason is not _FEED:
            return verdict
        try:
            kind = KINDS[frame.msgid]
            reason = self._reason(frame, kind, station, now)
            if reason is GateReason.ALLOWED and not self._budget.allow(now, len(frame.raw)):
                reason = self._tell(station, kind, GateReason.LINE_FULL, now)
        except Exception:
            self._fault("feeds", traceback.format_exc(limit=-3))
            reason = GateReason.FEED_FAULT
        passes = reason is GateReason.ALLOWED
        return verdict._replace(fate=Fate.FORWARD if passes else Fate.DROP, reason=reason)

    def _reason(self, frame: Frame, kind: FeedKind, station: int, now: float) -> GateReason:
        rule = self.sources[kind].rule
        if rule.named and station not in rule.order:
            return self._tell(station, kind, GateReason.FEED_NOT_NAMED, now)
        if not rule.named and rule.unnamed is Unnamed.NO_STATION:
            return self._tell(station, kind, GateReason.FEED_NOT_NAMED, now)
        if not rule.named and station != self._in_force.view.commander:
            return GateReason.NOT_IN_CONTROL
        if not self._affords(station, kind, _FRAME_BYTES + len(frame.payload), now):
            return self._tell(station, kind, GateReason.FEED_TOO_MUCH, now)
        if not _plausible(frame):
            return self._tell(station, kind, GateReason.FEED_SENSELESS, now)
        if not rule.named:
            return GateReason.ALLOWED
        if kind is FeedKind.TERRAIN:
            asked = self._terrain.answers(station, _block(frame), field_int(frame, "gridbit"), now)
            return GateReason.ALLOWED if asked else GateReason.FEED_STANDBY
        return self._offer(frame, kind, station, now)

    def _offer(self, frame: Frame, kind: FeedKind, station: int, now: float) -> GateReason:
        source, armed = self.sources[kind], self._in_force.view.armed
        fits = kind is not FeedKind.RTK or self._fits(frame, station, now)
        passes = source.offer(station, fits, armed, now)
        self._news(kind, now)
        if passes:
            return GateReason.ALLOWED
        return GateReason.FEED_STANDBY if fits else self._tell(station, kind, GateReason.FEED_PLACE, now)

    def _fits(self, frame: Frame, station: int, now: float) -> bool:
        """Note the place of a base, if the frame completes it; whether the base may be used."""
        reader, data = self._readers[station], field_bytes(frame, "data")[: field_int(frame, "len")]
        place = reader.fragment(field_int(frame, "flags"), data) if frame.msgid == _RTCM else reader.stream(data)
        if place is not None:
            self._places.note(station, place)
        if not self._places.known(station):
            self._tell_placeless(station, now)
        source = self.sources[FeedKind.RTK]
        self._places.follow(source.station, source.silent, self._in_force.view.armed)
        return self._places.fits(station, source.station)

    def _tell_placeless(self, station: int, now: float) -> None:
        """Tell all stations once of a base that does not say its place, though its corrections are used."""
        since = self._placeless.setdefault(station, now)
        if station == self.sources[FeedKind.RTK].station and since <= now - PLACE_S:
            self._placeless[station] = math.inf
            name = self._names[station]
            text = f"The base of {name} does not send its place (RTCM 1005 or 1006): a second base is not checked."
            self.untold.append(FeedNews(FeedKind.RTK, text, None, name, FeedChange.NO_PLACE))

    def _affords(self, station: int, kind: FeedKind, size: int, now: float) -> bool:
        """Whether the limit of a station has `size` bytes left. If so, they are deducted."""
        rate = feed_bytes_per_s(kind, self._settings)
        purse = self._purses.setdefault((station, kind), _Purse(rate * _RESERVE_S, now))
        purse.left = min(rate * _RESERVE_S, purse.left + max(0.0, now - purse.counted_at) * rate)
        purse.counted_at = now
        if purse.left < size:
            return False
        purse.left -= size
        return True

    def terrain_asked(self, frame: Frame, receivers: list[int], now: float) -> list[int]:
        """The stations that get a TERRAIN_REQUEST of the autopilot. `receivers`: those that hear everything now."""
        if not self.sources[FeedKind.TERRAIN].rule.named:
            return receivers
        try:
            mask = field_int(frame, "mask")
            asked = self._terrain.ask(_block(frame), self._in_force.view.commander, now, mask)
        except Exception:
            self._fault("feeds", traceback.format_exc(limit=-3))
            return receivers
        return [*receivers, *(station for station in asked if station not in receivers and station in self._names)]

    # ---- time -----------------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Time has passed: a source that is silent is replaced."""
        if now - self._ticked_at < _TICK_S:
            return
        self._ticked_at = now
        for kind, source in self.sources.items():
            if source.station is not None:
                source.decide(self._in_force.view.armed, now)
                self._news(kind, now)

    # ---- people ---------------------------------------------------------------------------------------------------

    def _news(self, kind: FeedKind, now: float) -> None:
        """Tell all stations of another source, and of RTK corrections that fail.

        Other kinds may be silent without a fault: a receiver without traffic sends nothing. A source that changes again
        and again is told now and then, and at last as it is."""
        source = self.sources[kind]
        before, silent = self._told_source[kind], source.silent and kind is FeedKind.RTK
        if source.station is None or (source.station, silent) == before or not self._news_room[kind].allow(now):
            return
        self._told_source[kind] = source.station, silent
        name, what = self._names[source.station], NAMES[kind]
        if silent:
            text = f"none. {name} is silent for {source.rule.silence_s:g} s"
        elif source.station == before[0]:
            text = f"from {name} again"
        else:
            text = f"from {name}" + ("" if before[0] is None else f" after {self._names[before[0]]}")
        change = FeedChange.SILENT if silent else FeedChange.SOURCE
        self.untold.append(FeedNews(kind, f"{what}: {text}.", None, name, change))

    def _tell(self, station: int, kind: FeedKind, reason: GateReason, now: float) -> GateReason:
        """Tell a station why its frames do not pass, now and then. Returns the reason."""
        if now - self._told_at.get((station, kind, reason), -math.inf) >= REMIND_S:
            self._told_at[station, kind, reason] = now
            name = self._names[station]
            text = f"{NAMES[kind]} of {name} are not used: {self._why(station, kind, reason)}."
            # another base is of interest to the commander, too
            receiver = None if reason is GateReason.FEED_PLACE else station
            self.untold.append(FeedNews(kind, text, receiver, name, FeedChange.NOT_USED))
        return reason

    def _why(self, station: int, kind: FeedKind, reason: GateReason) -> str:
        if reason is GateReason.FEED_PLACE:
            apart_m, first = self._places.apart_m(station), self._places.first
            if first is None or not self._places.known(station):
                return "its base has not sent its place (RTCM 1005 or 1006)"
            away = f"{apart_m:.1f} m" if apart_m < 1000.0 else f"{apart_m / 1000.0:.1f} km"
            return f"its base is {away} from that of {self._names[first]} (rtk_apart_m {self._settings.rtk_apart_m:g})"
        return {
            GateReason.FEED_NOT_NAMED: f"'{kind.value}' in [feeds] does not name it",
            GateReason.FEED_TOO_MUCH: "too many bytes in a second",
            GateReason.LINE_FULL: "the line to the autopilot has no more room",
        }.get(reason, str(reason.value))


def _block(frame: Frame) -> Block:
    lat, lon = (int.from_bytes(field_bytes(frame, name), "little", signed=True) for name in ("lat", "lon"))
    return lat, lon, field_int(frame, "grid_spacing")


def _plausible(frame: Frame) -> bool:
    """Whether lengths and places of a feed are possible."""
    msgid = frame.msgid
    if msgid == _RTCM:
        return field_int(frame, "len") <= RTCM_BYTES
    if msgid == _INJECT:
        return field_int(frame, "len") <= INJECTED_BYTES
    if msgid == _TERRAIN:
        return field_int(frame, "gridbit") < _BLOCKS and _on_earth(frame)
    if msgid == _WIND:
        return all(math.isfinite(field_float(frame, name)) for name in ("wind_x", "wind_y", "wind_z"))
    return _on_earth(frame) if msgid == _ADSB else True


def _on_earth(frame: Frame) -> bool:
    lat, lon = (int.from_bytes(field_bytes(frame, name), "little", signed=True) for name in ("lat", "lon"))
    return abs(lat) <= 90 * 10**7 and abs(lon) <= 180 * 10**7
