# SPDX-License-Identifier: GPL-3.0-or-later

"""Rules of Remote ID: whose place and id the aircraft broadcasts as the operator's, and when they are sent.

The operator is the station with authority. Without one, it is the last one that had authority: the aircraft is still
its responsibility. Rules:

1. If the station's own program sends Remote ID (OPEN_DRONE_ID_SYSTEM), its frames pass the gate, and the companion is
   silent: there are never two sources. The program counts as silent after `OWN_S`.
2. Else the companion sends the newest place: the one that the station's program said at most `PLACE_S` ago, also before
   it had authority; else the place of the mission. If there is none, nothing is sent, and people are told.
3. After a change of operator the new place is sent at once, then once a second.

Pure: time is an argument (monotonic seconds). Memory is bounded by the stations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

__all__ = ["EVERY_S", "OWN_S", "PLACE_S", "Operators", "OperatorPlace", "RemoteIdRule", "Sending"]

#: a station's own program that has not sent for this long (s) is silent: it sends once a second
OWN_S: Final = 3.0
#: a place that a program has said counts for this long (s)
PLACE_S: Final = 60.0
#: time (s) between two places that are sent
EVERY_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class OperatorPlace:
    """A place of an operator: degrees, and metres above the ellipsoid. `live`: a program measured it."""

    lat_deg: float
    lon_deg: float
    height_m: float
    live: bool = False


@dataclass(frozen=True, slots=True)
class Sending:
    """An order to send a place. `changed`: the operator is another one; `number`: counts from 0 at each change."""

    station: int
    place: OperatorPlace
    operator_id: str
    number: int


class Operators:
    """The places and ids of operators, as stations and configuration say them."""

    def __init__(self, ids: Mapping[int, str]) -> None:
        """`ids`: the operator ids of the configuration, by system id; they go before what programs say."""
        self._configured = dict(ids)
        self._said_ids: dict[int, str] = {}
        self._places: dict[int, tuple[OperatorPlace, float]] = {}

    def said_place(self, station: int, place: OperatorPlace, now: float) -> None:
        """A station's own program has said where its operator is."""
        self._places[station] = place, now

    def said_id(self, station: int, operator_id: str) -> None:
        """A station's own program has said its operator's id."""
        self._said_ids[station] = operator_id

    def place(self, station: int, now: float) -> OperatorPlace | None:
        """The place that its program said, if it still counts."""
        place, at = self._places.get(station, (None, -math.inf))
        return place if now - at <= PLACE_S else None

    def sends(self, station: int, now: float) -> bool:
        """Whether its own program sends now."""
        return now - self._places.get(station, (None, -math.inf))[1] <= OWN_S

    def operator_id(self, station: int) -> str:
        """The id of its operator; "": not known."""
        return self._configured.get(station) or self._said_ids.get(station, "")


class RemoteIdRule:
    """When the companion sends which place."""

    def __init__(self, operators: Operators) -> None:
        self._operators = operators
        #: the station whose operator counts
        self.station: int | None = None
        #: whether no place of that operator is known
        self.unknown = False
        self._number = 0
        self._sent_at = -math.inf

    def due(self, commander: int | None, planned: Mapping[int, OperatorPlace], now: float) -> Sending | None:
        """What is to be sent now, if anything. `planned`: the places of the mission."""
        operators = self._operators
        if commander is not None and commander != self.station:
            changed = self.station is not None
            self.station, self._number, self._sent_at = commander, 0, -math.inf
            if changed and operators.place(commander, now) is not None:
                return self._send(commander, planned, now)
        station = self.station
        if station is None or now - self._sent_at < EVERY_S:
            return None
        if operators.sends(station, now):
            self.unknown = False
            return None
        return self._send(station, planned, now)

    def _send(self, station: int, planned: Mapping[int, OperatorPlace], now: float) -> Sending | None:
        place = self._operators.place(station, now) or planned.get(station)
        self.unknown = place is None
        if place is None:
            return None
        number, self._number, self._sent_at = self._number, self._number + 1, now
        return Sending(station, place, self._operators.operator_id(station), number)
