# SPDX-License-Identifier: GPL-3.0-or-later

"""The true events of a flight: where the aircraft was, which station was obeyed, what worked. The judge knows no
more."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from math import inf
from typing import Generic, TypeVar

from sitl.campaign.plane import Spot
from sitl.campaign.times import SECOND

__all__ = ["FlightLog", "Flown", "Series"]

_Value = TypeVar("_Value")


@dataclass(frozen=True, slots=True)
class Flown:
    """A straight piece that was flown: ticks, mode, and values at its beginning.

    Place and velocity (m, m/s), the true remaining energy of the battery (Wh), and the power drawn (W).
    """

    begun: int
    ended: int
    x_m: float
    y_m: float
    z_m: float
    vx: float
    vy: float
    vz: float
    mode: str
    left_wh: float = inf
    watts: float = 0.0

    def at(self, now: int) -> tuple[float, float, float]:
        """Where it was."""
        s = (now - self.begun) / SECOND
        return self.x_m + self.vx * s, self.y_m + self.vy * s, self.z_m + self.vz * s

    def left_at(self, now: int) -> float:
        """The energy left then (Wh)."""
        return self.left_wh - self.watts * (now - self.begun) / SECOND / 3600.0


class Series(Generic[_Value]):
    """A value that changes now and then."""

    __slots__ = ("times", "values")

    def __init__(self, first: _Value) -> None:
        self.times: list[int] = [0]
        self.values: list[_Value] = [first]

    def set(self, now: int, value: _Value) -> None:
        """From now on."""
        if value != self.values[-1]:
            self.times.append(now)
            self.values.append(value)

    def at(self, now: int) -> _Value:
        """What it was then."""
        return self.values[bisect_right(self.times, now) - 1]

    def since(self, now: int) -> int:
        """Since when it had been what it was then."""
        return self.times[bisect_right(self.times, now) - 1]

    def stays(self, value: _Value, first: int, last: int) -> bool:
        """Whether it was that from the first to the last of these moments."""
        return self.at(last) == value and self.since(last) <= first


@dataclass(slots=True)
class FlightLog:
    """Everything that really was. Times are ticks."""

    flown: list[Flown] = field(default_factory=list)
    #: mode and who set it
    modes: list[tuple[int, str, str]] = field(default_factory=list)
    #: the station whose commands pass the gate, None: no station's
    commander: Series[int | None] = field(default_factory=lambda: Series(None))
    #: the transfer under way: partner, number, and why it was begun; None: none
    transfer: Series[tuple[int, int, str] | None] = field(default_factory=lambda: Series(None))
    #: epoch in force
    epoch: Series[int] = field(default_factory=lambda: Series(0))
    #: the companion runs, and its main loop goes round
    companion: Series[bool] = field(default_factory=lambda: Series(True))
    #: the one point of the autopilot's rally list; None: home, as it was written with the plan
    rally: Series[Spot | None] = field(default_factory=lambda: Series(None))
    #: the autopilot does what it is ordered
    obeys: Series[bool] = field(default_factory=lambda: Series(True))
    #: the autopilot knows where it is
    fix: Series[bool] = field(default_factory=lambda: Series(True))
    #: the aircraft is outside its fence
    breached: Series[bool] = field(default_factory=lambda: Series(False))
    #: companion and autopilot hear each other
    cable: Series[bool] = field(default_factory=lambda: Series(True))
    #: stations that work and are heard and hear, wherever the aircraft is
    working: dict[int, Series[bool]] = field(default_factory=dict)
    #: stations whose links lose a third of everything
    weak: dict[int, Series[bool]] = field(default_factory=dict)
    #: stations that take themselves for the commander, with the epoch
    believes: dict[int, Series[int | None]] = field(default_factory=dict)
    #: what a station ordered that was obeyed: tick, station, whether it had authority
    obeyed: list[tuple[int, int, bool]] = field(default_factory=list)
    #: limits that an operator has lifted: tick, and which one
    lifted: list[tuple[int, str]] = field(default_factory=list)
    #: orders of the companion: tick, action, and the reason that it gives
    orders: list[tuple[int, str, str]] = field(default_factory=list)
    #: authority went from one station to another: tick, from, to
    moves: list[tuple[int, int, int]] = field(default_factory=list)
    #: what broke the books of authority (`watch.py`)
    broken: list[tuple[int, str]] = field(default_factory=list)
    #: when the battery was empty in the air, and when and where the aircraft came down (tick, m, m)
    empty_at: int | None = None
    landed: tuple[int, float, float] | None = None
    #: what was really left (Wh) whenever a mode began
    left: list[tuple[int, float]] = field(default_factory=list)
    #: sentences for people
    story: list[tuple[int, str]] = field(default_factory=list)
    tells: bool = False
    ended: int = 0

    def mode(self, now: int, mode: str, by: str) -> None:
        """Another mode is flown."""
        self.modes.append((now, mode, by))
        self.note(now, f"{mode} ({by})" if by else mode)

    def mode_at(self, at: int) -> tuple[int, str, str]:
        """Since when which mode was flown then, and who had set it."""
        return next((each for each in reversed(self.modes) if each[0] <= at), (0, "", ""))

    def is_sound(self, station: int, first: int, last: int) -> bool:
        """Whether its link lost next to nothing from the first to the last of these moments."""
        weak = self.weak.get(station)
        return weak is None or weak.stays(False, first, last)

    def place_at(self, at: int) -> tuple[float, float, float]:
        """Where the aircraft was then; home before it flew."""
        number = bisect_right(self.flown, at, key=lambda piece: piece.begun) - 1
        return self.flown[number].at(at) if number >= 0 else (0.0, 0.0, 0.0)

    def left_wh_at(self, at: int) -> float:
        """The energy left when the mode of that time began (Wh)."""
        return next((left for begun, left in reversed(self.left) if begun <= at), 0.0)

    def note(self, now: int, text: str) -> None:
        """A sentence of the story, if it is wanted."""
        if self.tells:
            self.story.append((now, text))
