# SPDX-License-Identifier: GPL-3.0-or-later

"""When something can happen: this lets a flight be flown without making every step of it.

Three speeds:

* Restless: every round of the main loop is made. This holds for an eighth of a second after every event that is not
  routine, and before every planned one. It holds around the end of every pause, and of every time after which a station
  counts as silent. It holds where a fact of the way ahead changes: near a border that is about to be crossed, near the
  end of a zone (the rules move authority or hold the aircraft), and where a gap begins and ends. It also holds where
  the aircraft leaves a border at which it was flown on. By every border it holds while wind carries the aircraft off
  its route.
* At rest: a position each second keeps the last one fresh, and the rounds in between are made when the rules have
  something due. Nothing that they ask of a position changes within that second. The route is checked each second, at
  any speed (in the air it is five times).
* Quiet: for longer than any time-out or pause of the rules only routine has happened, and every link lets everything
  through or nothing. The aircraft stands on the ground, or flies straight on with no border ahead, and in no declared
  gap. Then each second is like the one before, and fewer of them give the rules the same result: time is left out, up
  to the next planned event, the end of the piece that is flown, or the next border.

A border counts as near by its geometry: the places where the piece that is flown now crosses the circle, with a margin
on both sides. If the way ahead turns first, the turn comes first, and the check is repeated from there.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot
from typing import Final

from sitl.campaign.aircraft import Aircraft, Mode
from sitl.campaign.gaps import gap_at
from sitl.campaign.links import EDGE_M, FADES_M, Link
from sitl.campaign.plan import FlightPlan
from sitl.campaign.plane import Circle
from sitl.campaign.times import NEVER, ROUND, SECOND, in_ticks

__all__ = ["LONG_S", "STIRRED", "Pace"]

#: longer than what was no routine can matter without any news of it (s)
LONG_S: Final = 8.0
#: this long after an event that is not routine, and around the moment of a time that runs out
STIRRED: Final = in_ticks(0.125)
_BEFORE: Final = in_ticks(0.125)
#: longer than any part waits before a silent station counts as lost (s)
_LINK_S: Final = 6.5
#: and longer than it takes until one that is heard is asked and has answered (s)
_COMES_S: Final = 2.5
#: so far inside its border a zone is entered, and so far outside left (m); and how exact that is on a plane
_BAND_M, _BIT_M = 5.0, 0.1
#: a zone is about to end this time (s) before its end, and the aircraft is to stop: `exit_soon_s`, `hold_lead_s`
_SOON_S, _HOLD_S = 8.0, 5.0
#: this time (s) before its end a zone is not worth a better link: `link_steady_s`. That matters only with weak links,
#: so this window belongs to no station
_WORTH_S, _NOBODY = 30.0, 0
#: and how exact these times are: along the way an end is looked for in steps (s)
_BIT_S, _STEP_S = 0.2, 0.8
#: so far inside its border a zone may be about to end, whichever way the wind carries the aircraft (m)
_NEAR_M: Final = 70.0
#: if other borders are farther than this (m) from the end of a zone, the station beyond it is known
_CLEAR_M: Final = 40.0
#: a round earlier and two later
_EARLIER, _LATER = ROUND + 1, 2 * ROUND + 1


class Pace:
    """The pace of one flight. Times are ticks."""

    def __init__(self, plan: FlightPlan, aircraft: Aircraft) -> None:
        self._aircraft = aircraft
        self._zones = plan.zones
        self._gaps, self._speed_mps = plan.gaps, plan.speed_mps
        self._edge_m = EDGE_M + 1.0 if plan.loss else 1.0
        self._restless_until = 0
        self._quiet_from = in_ticks(6.0)
        self._weak: set[int] = set()
        #: when pauses that began of late are over
        self._moments: list[int] = []
        #: windows of the piece that is flown, and whose zone it is that has to command for it to count, if it matters
        self._crossings: list[tuple[int, int, int | None]] = []
        self._of: tuple[float, ...] = ()
        #: where a border is passed at which the aircraft was flown on: whose zone's, and how far inside (m)
        self._passing: tuple[int, float] | None = None
        #: grows whenever what was said of the time ahead may not hold any more
        self.changes = 0

    def note_event(self, now: int, settle_s: float, pauses: tuple[float, ...] = ()) -> None:
        """An event that is not routine has happened; the time `settle_s` after it is not like before (s).

        `pauses`: of the rules that begin with it and end with the first position after them, and no sooner (s).
        """
        self._restless_until = max(self._restless_until, now + STIRRED)
        self.changes += 1
        self.stay_awake(now, settle_s)
        if pauses:
            self._moments = [at for at in self._moments if at > now - STIRRED]
            self._moments += [now + in_ticks(pause_s) for pause_s in pauses]

    def stay_awake(self, now: int, settle_s: float) -> None:
        """An event that is not routine, after which the rules wait for no position."""
        self._quiet_from = max(self._quiet_from, now + in_ticks(settle_s))

    def passes(self, commander: int | None, at_m: float | None) -> None:
        """The border at which the aircraft was flown on is passed so far inside its commander's zone; None: at none."""
        passing = None if commander is None or at_m is None else (commander, at_m)
        if passing != self._passing:
            self._passing = passing
            self.changes += 1

    def set_weak(self, weak: bool, stations: Iterable[int]) -> None:
        """These links are weak, or are not any more: for how long they have been matters."""
        self.changes += 1
        if weak:
            self._weak.update(stations)
        else:
            self._weak.difference_update(stations)

    def restless(self, at: int, planned: int, commander: int | None, silent: int = NEVER) -> int:
        """From when on, then or later, rounds are to be made whatever is due.

        `planned`: when something is; `silent`: when a station will count as silent that is not heard until then.
        """
        if at <= self._restless_until or planned - at <= _BEFORE:
            return at
        aircraft = self._aircraft
        if not aircraft.flying:
            return planned - _BEFORE
        if aircraft.drift != (0.0, 0.0) and self._by_a_border(at):  # it does not fly where its way leads
            return at
        begins = planned - _BEFORE
        for moment in (*self._moments, silent):
            if at <= moment + STIRRED:
                begins = min(begins, max(at, moment - STIRRED))
        self._update_windows()
        for begun, ended, whose in self._crossings:
            # with a weak link, how long the others' zones last matters too
            if at <= ended and (whose in (None, commander) or self._weak):
                begins = min(begins, max(at, begun))
        return begins

    def _by_a_border(self, now: int) -> bool:
        x, y, _z = self._aircraft.at(now)
        return any(-_BAND_M - _BIT_M < zone.margin_m(x, y) < _NEAR_M for zone in self._zones.values())

    @property
    def _fastest_mps(self) -> float:
        return max(self._speed_mps, self._aircraft.speed_mps)

    def _outside(self, now: int, commander: int | None) -> bool:
        """Whether the zone of who commands does not hold the aircraft, or hardly."""
        if commander is None:
            return False
        x, y, _z = self._aircraft.at(now)
        return self._zones[commander].margin_m(x, y) < _BAND_M + _BIT_M

    def _near(self, now: int, commander: int | None) -> bool:
        self._update_windows()
        return any(begun <= now <= ended and whose in (None, commander) for begun, ended, whose in self._crossings)

    def _update_windows(self) -> None:
        """The crossings of the piece that is flown now."""
        aircraft = self._aircraft
        of = (*aircraft.velocity, float(aircraft.ends), *aircraft.at(aircraft.begun), *(self._passing or ()))
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
            self._window(border[1] - _SOON_S - _BIT_S, border[1] - _SOON_S + _BIT_S, sysid)
            self._window(border[1] - _WORTH_S - _BIT_S, border[1] - _WORTH_S + _BIT_S, _NOBODY)
            self._hold_window(border[1], *_ahead(x, y, vx, vy, border[1]), sysid)
        if self._passing is not None:
            sysid, at_m = self._passing
            passed = self._zones[sysid].crossed(x, y, vx, vy, -at_m)
            if passed is not None:
                self._window(passed[0] - _BIT_S, passed[0] + _BIT_S, sysid)
        for gap in self._gaps:  # where the rules are told of one, and of another part of it
            if aircraft.mode is Mode.AUTO and gap.waypoint == aircraft.waypoint:
                for at_s in gap.changes_s(x, y, vx, vy, self._fastest_mps):
                    self._window(at_s - 0.5, at_s + 0.5)
        if aircraft.ends < NEVER and aircraft.mode is Mode.AUTO:
            self._update_turn(x, y, vx, vy, (aircraft.ends - aircraft.begun) / SECOND)

    def _hold_window(self, ends_s: float, x: float, y: float, whose: int | None = None) -> None:
        """A zone ends there: the aircraft may have to be held, from a time that depends on the station beyond."""
        clear = all(abs(zone.margin_m(x, y)) > _CLEAR_M for sysid, zone in self._zones.items() if sysid != whose)
        begins_s = ends_s - _HOLD_S - _BIT_S
        self._window(begins_s, begins_s + _STEP_S + 2 * _BIT_S if clear else ends_s + _BIT_S, whose)

    def _update_turn(self, x: float, y: float, vx: float, vy: float, turn_s: float) -> None:
        """The way after a turn counts before it: where zones end that hold the aircraft at the turn."""
        x, y = _ahead(x, y, vx, vy, turn_s)
        speed = hypot(vx, vy)
        for sysid, zone in self._zones.items():
            if zone.margin_m(x, y) < -_BAND_M - _BIT_M:
                continue
            end = self._end_behind(zone, x, y, speed * _HOLD_S)
            if end is not None:
                length, there = end
                self._hold_window(turn_s + length / speed, *there, sysid)

    def _end_behind(
        self, zone: Circle, x: float, y: float, within_m: float
    ) -> tuple[float, tuple[float, float]] | None:
        """How far behind the turn at this place the way leaves that zone (m), and where; None: not so soon."""
        flown = 0.0
        for spot in self._aircraft.way_ahead()[1:]:
            length = spot.away_m(x, y)
            if length > 0.0:
                east, north = (spot.x_m - x) / length, (spot.y_m - y) / length
                crossed = zone.crossed(x, y, east, north)
                if crossed is None or crossed[0] > _BAND_M:  # there it is not held at the turn
                    return 0.0, (x, y)
                if crossed[1] <= length:
                    far = max(0.0, crossed[1])
                    return (flown + far, (x + far * east, y + far * north)) if flown + far <= within_m else None
            x, y, flown = spot.x_m, spot.y_m, flown + length
            if flown > within_m:
                break
        return None

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
            if not link.steady(x, y):  # coming closer it is heard or not, going away it is waited for
                self.stay_awake(now, _LINK_S if link.fades(x, y, *aircraft.velocity[:2]) else _COMES_S)
        if now < self._quiet_from or self._weak:
            return False
        if not aircraft.flying:
            return True
        if aircraft.velocity == (0.0, 0.0, 0.0) or aircraft.mode is Mode.PILOT:
            return False  # how long it has stood is counted
        if aircraft.drift != (0.0, 0.0) or aircraft.lifted:
            return False
        if aircraft.mode is Mode.AUTO and gap_at(self._gaps, aircraft.waypoint, x, y, self._fastest_mps) is not None:
            return False  # how long it has been alone there is counted
        return not self._outside(now, commander) and not self._near(now, commander)

    def nothing_until(self, now: int, bound: int, commander: int | None) -> int:
        """Up to when that stays so; `bound`: no longer than that."""
        self._update_windows()
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
