# SPDX-License-Identifier: GPL-3.0-or-later

"""Stations whose links are weak or attacked, by the measurements of the edge.

An attack is a warning for people. Weakness is a reason to move authority to a better station, and slow on purpose: the
commander's links have been weak for `link_weak_s`, the other's good for `link_steady_s`. That keeps two stations with
poor links from handing the aircraft back and forth.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf

from mavproxy_handover.core.common.events import Action, LinkJudged, Record
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import Reason

__all__ = ["Links"]


class Links:
    """The last judgement of every station's links. Times are monotonic seconds."""

    __slots__ = ("_attacked", "_limits", "_weak", "_weak_until")

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        #: since when all links of a station are over a limit
        self._weak: dict[int, float] = {}
        #: until when they were last seen so
        self._weak_until: dict[int, float] = {}
        #: stations under whose name bad signatures come in
        self._attacked: set[int] = set()

    def judged(self, event: LinkJudged, name: str, now: float, actions: list[Action]) -> None:
        """Take in a measurement of the station of this name; what it changed is for the journal."""
        station = event.station
        if event.weak is not (station in self._weak):
            if event.weak:
                self._weak[station] = now
            else:
                del self._weak[station]
                self._weak_until[station] = now
            text = f"links of {name} are {'weak' if event.weak else 'good again'}: {event.text}"
            actions.append(Record("link_quality", text, Reason.LINK_QUALITY, station))
        if event.attacked is not (station in self._attacked):
            (self._attacked.add if event.attacked else self._attacked.discard)(station)
            speaks = "speaks" if event.attacked else "no longer speaks"
            text = f"another sender {speaks} in the name of {name}: {event.text}"
            actions.append(Record("attack", text, Reason.AUTHENTICATION, station))

    def weak(self, station: int) -> bool:
        """Whether all links of the station are over a limit."""
        return station in self._weak

    def attacked(self, station: int) -> bool:
        """Whether another sender uses its name."""
        return station in self._attacked

    def worse(self, commander: int, stations: Iterable[int]) -> list[int]:
        """Those of `stations` whose links are weak, while the commander's are good."""
        return [] if commander in self._weak else [station for station in stations if station in self._weak]

    def better(self, commander: int, stations: Iterable[int], now: float) -> list[int]:
        """Those of `stations` whose links have long been good, while the commander's have been weak for a while."""
        if now - self._weak.get(commander, inf) < self._limits.link_weak_s:
            return []
        steady_s = self._limits.link_steady_s
        return [
            station
            for station in stations
            if station not in self._weak and now - self._weak_until.get(station, -inf) >= steady_s
        ]
