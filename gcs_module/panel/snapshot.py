# SPDX-License-Identifier: GPL-3.0-or-later

"""The knowledge of a station at one moment, as frozen values, and its form as one JSON line. Pure.

All times are seconds of the station's monotonic clock; None: never, or not known. `Stamped` is a value with the time
when it was heard. A line with another version, or with other fields, raises SnapshotError.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any, Final, TypeVar

from gcs_module.flight_values import Stamped

__all__ = [
    "VERSION",
    "AircraftSeen",
    "AlarmSeen",
    "Border",
    "LineSeen",
    "LinkSeen",
    "PeerSeen",
    "Question",
    "ReturnSite",
    "SnapshotError",
    "Stamped",
    "StationSeen",
    "from_values",
    "to_line",
]

#: of the form of a line; a panel of another version refuses it
VERSION: Final = 3
T = TypeVar("T")


class SnapshotError(ValueError):
    """A line that is no snapshot of this version."""


@dataclass(frozen=True, slots=True)
class Question:
    """The question that waits for this station's operator.

    `number` names it: an answer carries it. `take`: whether this station takes the aircraft. `early`: it is asked ahead
    of the border, which is reached at `border_at`. `until`: the end of the time to answer.
    """

    number: str
    take: bool
    from_station: str
    to_station: str
    early: bool
    border_at: float | None
    until: float | None
    asked_at: float


@dataclass(frozen=True, slots=True)
class Border:
    """The next border at which this station hands the aircraft over or takes it.

    `number`: as of the question about it; `answer` and `other`: of this station and of the other one, "waiting",
    "granted", "denied", "" not known.
    """

    number: str
    from_station: str
    to_station: str
    at: float
    answer: str
    other: str


@dataclass(frozen=True, slots=True)
class AlarmSeen:
    """A standing alarm. `level`: as `alarms.Level`; `cause` and `remedy`: what it means, and what to do."""

    name: str
    level: int
    text: str
    cause: str
    remedy: str
    acknowledged: bool
    since: float


@dataclass(frozen=True, slots=True)
class LinkSeen:
    """One of the station's links to the aircraft. `heard_at`: when the last frame came by it."""

    name: str
    works: bool
    used: bool
    heard_at: float | None


@dataclass(frozen=True, slots=True)
class ReturnSite:
    """The place a return goes to, in degrees.

    `takes_s`: time (s) until the aircraft is on the ground there; `needs`: the part of the battery that the way needs,
    climb and landing included. None: the vehicle does not know it.
    """

    name: str
    lat_deg: float
    lon_deg: float
    takes_s: float | None = None
    needs: float | None = None


@dataclass(frozen=True, slots=True)
class LineSeen:
    """A line that the operator was told. `number` rises with each line of this aircraft."""

    number: int
    at: float
    level: int
    text: str


@dataclass(frozen=True, slots=True)
class AircraftSeen:
    """The station's knowledge of one aircraft.

    `commander` and `partner`: names of stations, "": none. `authority_at`: when the vehicle last said who commands.
    `phase`: as `model.Phase` in small letters. `mode`: a Stamped text; `armed`: a Stamped bool. `action` and
    `decision`: what the vehicle does about what is wrong, and its sentence. `answer_until`: the end of the time to
    answer, here or at the other station. `zone`: the station whose zone holds the aircraft. `payload`:
    each kind of it, the station that has it, and when the vehicle said so; empty: it is the commander's. `briefing`:
    pairs of label and text. `overrides`: pairs of a lifted limit and the end of that. `mission`: digest of the package
    that is flown. `lines`: the last lines, the newest last.
    """

    sysid: int
    name: str
    heard_at: float | None
    authority_at: float | None
    phase: str
    commander: str
    own: bool
    partner: str
    epoch: int
    alone: bool
    rehearsal: bool
    zone: str
    zone_ends_at: float | None
    action: str
    decision: str
    question: Question | None
    border: Border | None
    answer_until: float | None
    mode: Stamped | None
    armed: Stamped | None
    position: Stamped | None
    height_m: Stamped | None
    speed_mps: Stamped | None
    heading_deg: Stamped | None
    battery_percent: Stamped | None
    battery_v: Stamped | None
    battery_left_s: Stamped | None
    return_site: ReturnSite | None
    payload: tuple[tuple[str, str, float], ...]
    rerouted: bool
    mission: str
    overrides: tuple[tuple[str, float], ...]
    briefing_at: float | None
    briefing: tuple[tuple[str, str], ...]
    alarms: tuple[AlarmSeen, ...]
    links: tuple[LinkSeen, ...]
    lines: tuple[LineSeen, ...]


@dataclass(frozen=True, slots=True)
class PeerSeen:
    """Another station. `up`: the ground link to it works; `operator`: on duty there, as a Stamped text."""

    name: str
    up: bool
    heard_at: float | None
    operator: Stamped | None


@dataclass(frozen=True, slots=True)
class StationSeen:
    """The knowledge of a station. `at`: the time of the snapshot; `limits`: those that an override can lift.

    `operator`: on duty, "" none; `required`: the station takes no aircraft without one; `next_operator`: has to confirm
    the briefing until `next_until`, "": there is none.
    """

    station: str
    at: float
    program: str
    configuration: str
    limits: tuple[str, ...]
    operator: str
    required: bool
    next_operator: str
    next_until: float | None
    aircraft: tuple[AircraftSeen, ...]
    peers: tuple[PeerSeen, ...]


#: class -> its fields that are classes of this module too; a tuple: any number of them
_PARTS: Final[Mapping[type, Mapping[str, Any]]] = {
    PeerSeen: {"operator": Stamped},
    StationSeen: {"aircraft": (AircraftSeen,), "peers": (PeerSeen,), "limits": (str,)},
    AircraftSeen: {
        "question": Question,
        "border": Border,
        "return_site": ReturnSite,
        "alarms": (AlarmSeen,),
        "links": (LinkSeen,),
        "lines": (LineSeen,),
        "briefing": (tuple,),
        "overrides": (tuple,),
        "payload": (tuple,),
        **dict.fromkeys(
            (
                "mode",
                "armed",
                "position",
                "height_m",
                "speed_mps",
                "heading_deg",
                "battery_percent",
                "battery_v",
                "battery_left_s",
            ),
            Stamped,
        ),
    },
}
_NAMES: Final[Mapping[type, tuple[str, ...]]] = {
    kind: tuple(field.name for field in fields(kind))
    for kind in (
        StationSeen,
        AircraftSeen,
        PeerSeen,
        LineSeen,
        ReturnSite,
        LinkSeen,
        AlarmSeen,
        Border,
        Question,
        Stamped,
    )
}


def to_line(snapshot: StationSeen) -> bytes:
    """The snapshot as one line of JSON."""
    given = {"kind": "snapshot", "version": VERSION, "station": snapshot}
    return json.dumps(given, default=_plain, separators=(",", ":"), ensure_ascii=True).encode() + b"\n"


def _plain(part: Any) -> dict[str, Any]:
    return {name: getattr(part, name) for name in _NAMES[type(part)]}


def from_values(values: Mapping[str, Any]) -> StationSeen:
    """The snapshot in the values of a line. Raises SnapshotError."""
    if values.get("version") != VERSION:
        raise SnapshotError(f"it speaks version {values.get('version')!r} to panels, and this panel {VERSION}")
    return _made(StationSeen, values.get("station"))


def _made(kind: type[T], given: Any) -> T:
    names, parts = _NAMES.get(kind), _PARTS.get(kind, {})
    if names is None or not isinstance(given, Mapping) or set(given) != set(names):
        raise SnapshotError(f"{kind.__name__}: not the fields of this version")
    return kind(**{name: _part(parts.get(name), given[name]) for name in names})


def _part(kind: Any, given: Any) -> Any:
    if isinstance(kind, tuple):
        if not isinstance(given, list):
            raise SnapshotError("a list is missing")
        (each_kind,) = kind
        return tuple(_part(each_kind, each) for each in given)
    if given is None:
        return None
    if kind is tuple:
        return tuple(given)
    if kind is None or kind is str:
        return given if not isinstance(given, float) or isfinite(given) else None
    return _made(kind, given)
