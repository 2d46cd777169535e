# SPDX-License-Identifier: GPL-3.0-or-later

"""When something can happen: what lets a flight be flown without making every step of it.

Three speeds:

* Restless: every round of the main loop is made. So it is for an eighth of a second behind everything that is no
  routine, as long before everything that is planned, near every border that the aircraft is about to cross, and
  while its commander's zone does not hold it.
* At rest: a position each second keeps the last one fresh, and the rounds in between are made when the rules have
  something due. Nothing that they ask of a position changes within that second.
  The route is looked at each second, whatever the speed (in the air it is five times).
* Quiet: nothing but routine has happened for longer than any time-out or pause of the rules lasts, every link lets
  everything through or nothing, and the aircraft flies straight on with no border ahead. Then each second is like the
  one before, and the rules are none the wiser if there are fewer of them: time is left out, up to the next thing that
  is planned, the end of the piece that is flown, or the next border.

A border counts as near by its geometry: the places where the piece that is flown now crosses the circle, a little
before and behind. Where the way ahead turns first, the turn comes first, and is looked at again from there.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from sitl.campaign.aircraft import Aircraft, Mode
from sitl.campaign.links import EDGE_M, FADES_M, Link
from sitl.campaign.plan import FlightPlan
from sitl.campaign.plane import Circle
from sitl.campaign.times import NEVER, ROUND, SECOND, in_seconds, in_ticks

__all__ = ["Pace"]

_STIRRED: Final = in_ticks(0.125)
_BEFORE: Final = in_ticks(0.125)
#: longer than anybody waits before who is not heard counts as lost (s)
_LINK_S: Final = 6.5
#: and longer than it takes until one that is heard is asked and has answered (s)
_COMES_S: Final = 2.5
#: so far inside its border a zone is entered, and so far outside left (m); and how exact that is on a plane
_BAND_M, _BIT_M = 5.0, 0.1
#: from so long before its end on the commander's zone is about to end: `exit_soon_s`, and a bit (s)
_ENDS_S: Final = 8.2
#: no turn within this time (s): the way behind it is not looked at; and how fast the aircraft gets at the most
_TURN_S, _FASTEST_MPS = 5.2, 14.0
#: a round earlier and two later
_EARLIER, _LATER = ROUND + 1, 2 * ROUND + 1


class Pace:
    """Of one flight. Times are ticks."""

    def __init__(self, plan: FlightPlan, aircraft: Aircraft) -> None:
        self._aircraft = aircraft
        self._zones = plan.zones
        self._gaps, self._speed_mps = plan.gaps, plan.speed_mps
        self._edge_m = EDGE_M + 1.0 if plan.loss else 1.0
        self._restless_until = 0
        self._quiet_from = in_ticks(20.0)
        self._weak: set[int] = set()
        #: when pauses that began of late are over
        self._moments: list[int] = []
        #: windows of the piece that is flown, and whose zone it is that has to command for it to count, if it matters
        self._crossings: list[tuple[int, int, int | None]] = []
        self._of: tuple[float, ...] = ()
        #: grows whenever what was said of the time ahead may not hold any more
        self.changes = 0

    def stir(self, now: int, settle_s: float, pauses: tuple[float, ...] = ()) -> None:
        """Something happened that is no routine; so long after it nothing is like before (s).

        `pauses`: of the rules that begin with it and end with the first position behind them, and no sooner (s).
        """
        self._restless_until = max(self._restless_until, now + _STIRRED)
        self.changes += 1
        self.settle(now, settle_s)
        if pauses:
            self._moments = [at for at in self._moments if at > now - _STIRRED]
            self._moments += [now + in_ticks(pause_s) for pause_s in pauses]

    def settle(self, now: int, settle_s: float) -> None:
        """The same of something that lets the rules wait for no position."""
        self._quiet_from = max(self._quiet_from, now + in_ticks(settle_s))

    def rush(self, until: int, now: int) -> None:
        """Every round is made until then: the rules count what they do not announce."""
        self._restless_until = max(self._restless_until, until)
        self.stir(now, in_seconds(until - now))

    def worry(self, weak: bool, whom: Iterable[int]) -> None:
        """These links are weak, or are not any more: for how long they have been matters."""
        self.changes += 1
        if weak:
            self._weak.update(whom)
        else:
            self._weak.difference_update(whom)

    def restless(self, at: int, planned: int, commander: int | None) -> int:
        """From when on, then or later, rounds are to be made whatever is due. `planned`: when something is."""
        if at <= self._restless_until or planned - at <= _BEFORE:
            return at
        aircraft = self._aircraft
        if not aircraft.flying:
            return planned - _BEFORE
        if self._weak or self._outside(at, commander):
            return at
        begins = planned - _BEFORE
        for moment in self._moments:
            if at <= moment + _STIRRED:
                begins = min(begins, max(at, moment - _STIRRED))
        self._know()
        for begun, ended, whose in self._crossings:
            if at <= ended and whose in (None, commander):
                begins = min(begins, max(at, begun))
        return begins

    def _outside(self, now: int, commander: int | None) -> bool:
        """Whether the zone of who commands does not hold the aircraft, or hardly."""
        if commander is None:
            return False
        x, y, _z = self._aircraft.at(now)
        return self._zones[commander].margin_m(x, y) < _BAND_M + _BIT_M

    def _near(self, now: int, commander: int | None) -> bool:
        self._know()
        return any(begun <= now <= ended and whose in (None, commander) for begun, ended, whose in self._crossings)

    def _know(self) -> None:
        """The crossings of the piece that is flown now."""
        aircraft = self._aircraft
        of = (*aircraft.velocity, float(aircraft.ends), *aircraft.at(aircraft.begun))
        if of == self._of:
            return
        self._of = of
        self._crossings = []
        vx, vy, _up = aircraft.velocity
        if not aircraft.flying or (vx == 0.0 and vy == 0.0):
            return
        x, y, _z = aircraft.at(aircraft.begun)
        for sysid, zone in self._zones.items():
            outer, inner = (zone.crossed(x, y, vx, vy, off) for off in (_BAND_M + _BIT_M, -_BAND_M - _BIT_M))
            if outer is None:
                continue
            if inner is None:  # it grazes the border
                self._window(outer[0], outer[1])
                continue
            inside, border = (zone.crossed(x, y, vx, vy, off) for off in (_BIT_M - _BAND_M, 0.0))
            assert inside is not None
            assert border is not None
            self._window(inside[0], inner[0])
            self._window(border[1], outer[1])
            self._window(border[1] - _ENDS_S, outer[1], sysid)
        for gap in self._gaps:  # where the rules are told of one, and how long it may still take
            if aircraft.mode is Mode.AUTO and gap.waypoint == aircraft.waypoint:
                begins_s, ends_s = gap.met_s(x, y, vx, vy, max(self._speed_mps, aircraft.speed_mps))
                if begins_s < ends_s:
                    self._window(begins_s - 0.5, ends_s + 0.5)
        if aircraft.ends < NEVER and aircraft.mode is Mode.AUTO:
            # what the way does behind the turn counts before it
            ends_s = (aircraft.ends - aircraft.begun) / SECOND
            if self._leaves_behind(*_ahead(x, y, vx, vy, ends_s), self._holding(x, y)):
                self._window(ends_s - _TURN_S, ends_s + 0.3)

    def _leaves_behind(self, x: float, y: float, holding: list[Circle]) -> bool:
        """Whether the way behind the turn at this place leaves one of these zones soon."""
        left_m = _TURN_S * _FASTEST_MPS
        for spot in self._aircraft.way_ahead()[1:]:
            length = spot.away_m(x, y)
            if length > 0.0:
                part = min(1.0, left_m / length)
                x, y = x + part * (spot.x_m - x), y + part * (spot.y_m - y)
                left_m -= length
            if any(zone.margin_m(x, y) < _BAND_M for zone in holding):
                return True
            if left_m <= 0.0:
                break
        return False

    def _holding(self, x: float, y: float) -> list[Circle]:
        return [zone for zone in self._zones.values() if zone.margin_m(x, y) > -_BAND_M - _BIT_M]

    def _window(self, begun_s: float, ended_s: float, whose: int | None = None) -> None:
        begun = self._aircraft.begun
        if ended_s > 0.0:
            begun_s, ended_s = max(begun_s, -1e6), min(ended_s, 1e6)
            first, last = int(begun_s * SECOND) - _EARLIER, int(ended_s * SECOND) + _LATER
            self._crossings.append((begun + first, begun + last, whose))

    def quiet(self, now: int, links: Iterable[Link], commander: int | None) -> bool:
        """Whether each second is like the one before, with no transfer under way."""
        aircraft = self._aircraft
        x, y, _z = aircraft.at(now)
        for link in links:
            if not link.steady(x, y):  # who comes is heard or not, who goes is waited for
                self.settle(now, _LINK_S if link.fades(x, y, *aircraft.velocity[:2]) else _COMES_S)
        if now < self._quiet_from or self._weak or not aircraft.flying:
            return False
        if aircraft.mode in (Mode.PAUSE, Mode.PILOT) or aircraft.drift != (0.0, 0.0) or aircraft.lifted:
            return False
        return not self._outside(now, commander) and not self._near(now, commander)

    def nothing_until(self, now: int, bound: int, commander: int | None) -> int:
        """Up to when that stays so; `bound`: no longer than that."""
        self._know()
        aircraft = self._aircraft
        until = min(bound, aircraft.ends) - _BEFORE
        x, y, _z = aircraft.at(now)
        vx, vy, _up = aircraft.velocity
        if vx or vy:
            for begun, _ended, whose in self._crossings:
                if begun >= now and whose in (None, commander):
                    until = min(until, begun)
            for zone in self._zones.values():  # links begin to lose, or to let through
                for off in (-self._edge_m, FADES_M + 1.0):
                    for at_s in zone.crossed(x, y, vx, vy, off) or ():
                        if at_s > -2.0:
                            until = min(until, now + int(max(0.0, at_s) * SECOND) - SECOND)
        return until


def _ahead(x: float, y: float, vx: float, vy: float, s: float) -> tuple[float, float]:
    return x + vx * s, y + vy * s
