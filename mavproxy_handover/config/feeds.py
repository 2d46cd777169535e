# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads `[feeds]`: which stations may send data that commands nothing, in which order, and its limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.toml import Table, one_table
from mavproxy_handover.core.feeds import FeedKind, FeedRule, FeedSettings
from mavproxy_handover.tools.key_table import Key, KeyTable, items, numbers

__all__ = ["FEEDS", "feed_settings"]

_DEFAULT: Final = FeedSettings()
_RULE: Final = "a list of names of stations, each once"
#: kind -> what it is, and what holds without the key
_KINDS: Final[Mapping[FeedKind, tuple[str, str]]] = {
    FeedKind.RTK: ("RTK corrections (GPS_RTCM_DATA, GPS_INJECT_DATA)", "those of the station with authority pass"),
    FeedKind.ADSB: ("traffic that a receiver on the ground hears (ADSB_VEHICLE)", "no station's pass"),
    FeedKind.TERRAIN: ("heights of the ground (TERRAIN_DATA)", "those of the station with authority pass"),
    FeedKind.WEATHER: ("weather (WIND_COV, HYGROMETER_SENSOR)", "no station's pass"),
}


def _names(kind: FeedKind) -> Key:
    what, without = _KINDS[kind]
    return items(
        kind.value,
        f"stations that may send {what}, the first one first; without the key, {without}",
        rule=_RULE,
        example=["GCSA", "GCSB"],
    )


class _Silences:
    """The defaults of the keys for silence."""

    rtk_silence_s = _DEFAULT.rules[FeedKind.RTK].silence_s
    adsb_silence_s = _DEFAULT.rules[FeedKind.ADSB].silence_s
    terrain_silence_s = _DEFAULT.rules[FeedKind.TERRAIN].silence_s
    weather_silence_s = _DEFAULT.rules[FeedKind.WEATHER].silence_s


#: a base sends each second, so a shorter silence would change the source without need
FEEDS: Final = KeyTable(
    "feeds",
    (
        *(_names(kind) for kind in FeedKind),
        *numbers(
            """
            rtk_silence_s      1.5 to 60   the next station takes over when the source has sent no corrections for this
                                           long
            adsb_silence_s     2 to 300    the same for ADS-B: without traffic, a receiver sends nothing
            terrain_silence_s  2 to 60     a request that the first station has not answered for this long goes to the
                                           next one
            weather_silence_s  2 to 3600   as rtk_silence_s, for weather
            """,
            _Silences,
        ),
        *numbers(
            """
            rtk_apart_m        0.1 to 500000  an RTK base that is farther from the first one than this is not taken. If
                                              stations have bases of their own, surveyed in one frame: farther than
                                              these are apart
            rtk_bytes_per_s    500 to 20000   corrections of one station; more is dropped
            """,
            _DEFAULT,
        ),
    ),
    "Feeds: data that commands nothing (docs/feeds.md). Each kind has one source at a time, whichever station has "
    "authority. While the vehicle is armed, a source that comes back does not take over again.",
)


def feed_settings(data: Mapping[str, Any], path: Path, stations: Mapping[str, int]) -> FeedSettings:
    """Parse `[feeds]`, if it is there. `stations`: system ids by name. Raises ConfigError."""
    table = one_table(data, FEEDS, path)
    rules = {kind: _rule(table, kind, stations) for kind in FeedKind}
    return FeedSettings(rules, table["rtk_apart_m"], table["rtk_bytes_per_s"])


def _rule(table: Table, kind: FeedKind, stations: Mapping[str, int]) -> FeedRule:
    default = _DEFAULT.rules[kind]
    rule = replace(default, silence_s=table[f"{kind.value}_silence_s"])
    names = table[kind.value]
    if names is None:
        return rule
    for number, name in enumerate(names):
        if name not in stations:
            raise table.error(kind.value, f"{name!r} must be one of the stations: {', '.join(stations)}")
        if name in names[:number]:
            raise table.error(kind.value, f"{name!r} is there twice: name each station once, in its order")
    return replace(rule, order=tuple(stations[name] for name in names), named=True)
