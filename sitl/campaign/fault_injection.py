# SPDX-License-Identifier: GPL-3.0-or-later

"""Fault injection: begins each fault of a flight in its world, and ends it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import cos, radians, sin
from typing import Final, Protocol

from mavproxy_handover.core.common import events
from mavproxy_handover.core.common.model import AuthorityView
from mavproxy_handover.core.common.never import assert_never
from sitl.campaign.aircraft import Aircraft, Mode
from sitl.campaign.companion import DIGEST, Companion
from sitl.campaign.failsafes import Failsafes
from sitl.campaign.faults import Fault, Target, TimedFault
from sitl.campaign.guard import Guard
from sitl.campaign.links import WEAK_LOSS, Link
from sitl.campaign.log import FlightLog
from sitl.campaign.pace import LONG_S, Pace
from sitl.campaign.plan import FlightPlan, left_at
from sitl.campaign.plane import Spot, bearing_deg
from sitl.campaign.stations import Ground
from sitl.campaign.times import NEVER, SECOND, in_ticks

__all__ = ["NEXT_TO_NOTHING", "FaultInjector"]

#: a station that hears no more than this part of the downlink does not work: well below the limit of the rules (0.15)
NEXT_TO_NOTHING: Final = 0.06
#: If chance decides what a station hears, it counts as not working only after this time: lucky answers keep one in 740
#: of those that hear 5 % in command for more than 18 s. In 40,000 trials of the rule alone the longest was 22.4 s.
_LUCK: Final = in_ticks(6.0)
#: the companion measures the loss of a downlink of which at most this part arrives, and needs this long
_MEASURED, _MEASURES = 0.5, in_ticks(9.0)
#: a commander that hears nothing for this time is lost
_TOTAL: Final = in_ticks(10.0)
#: the longest that a station has to answer well before it counts again, and a little
_TRUSTED: Final = in_ticks(330.0)

#: a main loop that stands still is killed after this long, and a new one goes round so much later
_SUPERVISED, _FORKED = in_ticks(1.2), in_ticks(0.6)


class InjectionTarget(Protocol):
    """The parts of a world that faults change, and how a fault is told and planned."""

    plan: FlightPlan
    log: FlightLog
    aircraft: Aircraft
    guard: Guard
    failsafes: Failsafes
    pace: Pace
    ground: dict[int, Ground]
    uplinks: dict[int, Link]
    downlinks: dict[int, Link]
    companion: Companion | None
    view: AuthorityView
    now: int
    #: companion and autopilot are connected
    cable: bool

    def plan_at(self, when: int, job: Callable[[int], None]) -> None:
        """Have that done then."""

    def tell(self, event: events.Event, now: int) -> None:
        """The rules hear of it."""

    def flows_changed(self, now: int) -> None:
        """Leases and heartbeats reach the autopilot, or do not any more."""

    def passes(self, sysid: int) -> bool:
        """Whether the gate lets a command of this station through."""


@dataclass(slots=True)
class _Beat:
    """Where a rhythm is: the links are off, and it is over."""

    off: bool = False
    over: bool = False


class FaultInjector:
    """Lets faults strike one world."""

    def __init__(self, world: InjectionTarget) -> None:
        self._world = world
        #: how many faults make a station's links weak, and how many attack it
        self._links_wrong: dict[int, list[int]] = {}
        #: how many faults let a station hear next to nothing, and how many let it hear a part, or did of late
        self._deafened: Counter[int] = Counter()
        self._thinned: Counter[int] = Counter()

    def inject(self, timed: TimedFault, now: int) -> None:
        """A fault strikes; its end is planned with it."""
        self._world.pace.note_event(now, LONG_S)
        targets = self._targets(timed.target)
        names = " ".join(s.name for s in self._world.plan.stations if s.sysid in targets)
        self._world.log.note(now, f"FAULT {timed.words} {names}".rstrip())
        end = self._fault(timed, targets, now)
        if end is not None and timed.lasts < NEVER:
            self._world.plan_at(now + max(1, timed.lasts), partial(self._ends, timed, end))

    def _ends(self, timed: TimedFault, end: Callable[[int], None], now: int) -> None:
        self._world.pace.note_event(now, LONG_S)
        self._world.log.note(now, f"over: {timed.fault.name.lower().replace('_', ' ')}")
        end(now)

    def _targets(self, target: Target) -> list[int]:
        everybody = list(self._world.ground)
        commander = self._world.view.commander
        if target is Target.COMMANDER:
            return everybody[:1] if commander is None else [commander]
        if target is Target.NEXT:
            companion = self._world.companion
            assert companion is not None
            x, y = self._leaves_at(commander)
            others = [s for s in self._world.plan.stations if s.sysid != commander]
            return [max(others, key=lambda s: s.zone.margin_m(x, y)).sysid]
        return everybody if target is Target.ALL else []

    def _leaves_at(self, commander: int | None) -> tuple[float, float]:
        """Where the way ahead leaves the commander's zone; where the aircraft is, if that is not to be said."""
        x, y, _z = self._world.aircraft.at(self._world.now)
        way = self._world.aircraft.way_ahead()
        if commander is None or not way or self._world.plan.zones[commander].margin_m(x, y) <= 0.0:
            return x, y
        left = left_at((Spot(x, y), *way), self._world.plan.zones[commander])
        return (x, y) if left is None else (left[1].x_m, left[1].y_m)

    def _fault(self, timed: TimedFault, targets: list[int], now: int) -> Callable[[int], None] | None:
        """Make it so; returns what ends it."""
        match timed.fault:
            case Fault.DEAD:
                return self._stations_die(targets, now)
            case Fault.DEAF:
                return self._cut([self._world.downlinks[each] for each in targets], targets, now)
            case Fault.MUTE:
                return self._cut([self._world.uplinks[each] for each in targets], targets, now)
            case Fault.THIN:
                return self._thin(timed, targets, now)
            case Fault.RHYTHM:
                return self._in_rhythm(timed, targets, now)
            case Fault.BURST:
                both = [link for each in targets for link in (self._world.uplinks[each], self._world.downlinks[each])]
                return self._cut(both, targets, now)
            case Fault.WEAK:
                return self._weaken(targets, now)
            case Fault.ATTACK:
                return self._judge_links(targets, attacked=True, now=now)
            case Fault.ROGUE:
                self._rogue(now + timed.lasts, now)
                return None
            case Fault.KILLED:
                self._companion_dies(now)
                return self._companion_restarts
            case Fault.GONE:
                self._companion_dies(now)
                return None
            case Fault.STALLED:
                return self._companion_stalls(timed, now)
            case Fault.BLIND:
                return self._cut_cable(now)
            case Fault.NO_GUARD:
                self._world.guard.stop(False)
                return lambda _now: self._world.guard.stop(True)
            case Fault.NO_FIX:
                return self._lose_fix(now)
            case Fault.SAG:
                self._sag(timed, now)
                return None
            case Fault.DRIFT | Fault.BREACH:
                return self._drift(timed, now)
            case Fault.GUST:
                return self._gust(timed, now)
            case Fault.LIFT:
                self._world.aircraft.carried((0.0, 0.0), now, 3.0 + 3.0 * timed.amount)
                return partial(self._world.aircraft.carried, (0.0, 0.0))
            case Fault.PILOT:
                if not self._world.plan.truth.radio:
                    return None
                self._world.aircraft.pilot_takes_over(now)
                return self._pilot_gives_back
            case Fault.DISOBEYS:
                self._world.log.obeys.set(now, False)
                return lambda now: self._world.log.obeys.set(now, True)
            case Fault.STUCK:
                self._world.aircraft.stuck(True, now)
                return partial(self._world.aircraft.stuck, False)
            case _:
                assert_never(timed.fault)

    def _stations_die(self, targets: list[int], now: int) -> Callable[[int], None]:
        for each in targets:
            self._world.ground[each].dies(now)
            self._world.log.working[each].set(now, False)

        def end(now: int) -> None:
            for each in targets:
                self._world.ground[each].starts(now)
            self._log_working(targets, now)

        return end

    def _log_working(self, targets: list[int], now: int) -> None:
        for each in targets:
            cut = self._world.uplinks[each].cut or self._world.downlinks[each].cut or self._deafened[each] > 0
            self._world.log.working[each].set(now, self._world.ground[each].core is not None and not cut)

    def _cut(self, links: list[Link], targets: list[int], now: int) -> Callable[[int], None]:
        for link in links:
            link.cut += 1
        self._log_working(targets, now)

        def end(now: int) -> None:
            for link in links:
                link.cut -= 1
            self._log_working(targets, now)

        return end

    def _weaken(self, targets: list[int], now: int) -> Callable[[int], None]:
        links = [link for each in targets for link in (self._world.uplinks[each], self._world.downlinks[each])]
        for link in links:
            link.loss += WEAK_LOSS
        self._log_weak(targets, now)
        over = self._judge_links(targets, weak=True, now=now + 2 * SECOND)

        def end(now: int) -> None:
            for link in links:
                link.loss = max(0.0, link.loss - WEAK_LOSS)
            self._log_weak(targets, now)
            over(now)

        return end

    def _log_weak(self, targets: list[int], now: int) -> None:
        for each in targets:
            self._world.log.weak[each].set(now, self._world.uplinks[each].loss > 0.0 or self._thinned[each] > 0)

    def _hears_part(self, targets: list[int], heard: float, now: int, *, luck: int = 0) -> Callable[[int], None]:
        """These stations hear only that part of the downlink; returns what ends it.

        `luck`: for this time chance may keep a station working that hears next to nothing. A station that hears next to
        nothing does not work. The vehicle may trust one that was deaf again only after minutes. Until then nothing is
        demanded of its link.
        """
        weak = heard <= _MEASURED
        deaf = self._deafen(targets, now + luck, now) if heard <= NEXT_TO_NOTHING else None
        self._thinned.update(targets)
        self._log_weak(targets, now)
        over = self._judge_links(targets, weak=True, now=now + _MEASURES) if weak else None

        def forgotten(now: int) -> None:
            self._thinned.subtract(targets)
            self._log_weak(targets, now)

        def end(now: int) -> None:
            if deaf is not None:
                deaf(now)
            self._world.plan_at(now + _TRUSTED, forgotten)
            if over is not None:
                over(now)

        return end

    def _deafen(self, targets: list[int], since: int, now: int) -> Callable[[int], None]:
        """These stations hear next to nothing, and do not work from `since` on; returns what ends it."""
        deaf = _Beat()

        def begins(now: int) -> None:
            if not deaf.over:
                deaf.off = True
                self._deafened.update(targets)
                self._log_working(targets, now)

        def end(now: int) -> None:
            deaf.over = True
            if deaf.off:
                self._deafened.subtract(targets)
                self._log_working(targets, now)

        if since > now:
            self._world.plan_at(since, begins)
        else:
            begins(now)
        return end

    def _thin(self, timed: TimedFault, targets: list[int], now: int) -> Callable[[int], None]:
        links = [self._world.downlinks[each] for each in targets]
        for link in links:
            link.loss += timed.amount
        over = self._hears_part(targets, 1.0 - timed.amount, now, luck=_LUCK)

        def end(now: int) -> None:
            for link in links:
                link.loss = max(0.0, link.loss - timed.amount)
            over(now)

        return end

    def _in_rhythm(self, timed: TimedFault, targets: list[int], now: int) -> Callable[[int], None]:
        links = [self._world.downlinks[each] for each in targets]
        hears, hears_not = timed.rhythm
        over = self._hears_part(targets, hears / (hears + hears_not), now)
        beat = _Beat()

        def turn(now: int) -> None:
            if beat.over:
                return
            beat.off = not beat.off
            for link in links:
                link.off += 1 if beat.off else -1
            self._off_long(targets, hears_not, off=beat.off, now=now)
            self._world.plan_at(now + (hears_not if beat.off else hears), turn)

        turn(now)

        def end(now: int) -> None:
            if beat.off:
                turn(now)
            beat.over = True
            over(now)

        return end

    def _off_long(self, targets: list[int], hears_not: int, *, off: bool, now: int) -> None:
        """A pause that is longer than a total loss may be is one: the station does not work in it."""
        if hears_not > _TOTAL:
            (self._deafened.update if off else self._deafened.subtract)(targets)
            self._log_working(targets, now)

    def _judge_links(
        self, targets: list[int], *, weak: bool = False, attacked: bool = False, now: int
    ) -> Callable[[int], None]:
        """Report these links as the companion measures them; returns what ends the report."""
        text = "a third of all messages is lost" if weak else "bad signatures"

        def judged(begins: bool, now: int) -> None:
            for each in targets:
                wrong = self._links_wrong.setdefault(each, [0, 0])
                for number, is_so in enumerate((weak, attacked)):
                    wrong[number] += is_so if begins else -is_so
                self._world.pace.set_weak(wrong[0] > 0, (each,))
                self._world.tell(events.LinkJudged(each, wrong[0] > 0, wrong[1] > 0, text), now)

        self._world.plan_at(now + 1, partial(judged, True))
        return lambda now: self._world.plan_at(now + 3 * SECOND, partial(judged, False))

    def _rogue(self, until: int, now: int) -> None:
        """Stations that do not command send the aircraft home or down, twice a second."""
        for each in self._world.ground:
            if each != self._world.view.commander and self._world.passes(each):
                self._world.log.obeyed.append((now, each, False))
                self._world.aircraft.land(f"station {each}", now)
        if now + SECOND // 2 < until:
            self._world.plan_at(now + SECOND // 2, partial(self._rogue, until))

    def _companion_dies(self, now: int) -> None:
        assert self._world.companion is not None
        self._world.companion.dies(now)
        self._world.flows_changed(now)

    def _companion_restarts(self, now: int) -> None:
        assert self._world.companion is not None
        self._world.pace.note_event(now, LONG_S)
        self._world.companion.restarts(now)
        self._world.flows_changed(now)
        if self._world.aircraft.flying:  # it knows its mission from its state
            return
        self._world.tell(events.MissionLoaded(DIGEST, self._world.plan.route), now)

    def _companion_stalls(self, timed: TimedFault, now: int) -> Callable[[int], None] | None:
        """A short one is over by itself; a longer one is ended by the supervisor."""
        self._companion_dies(now)
        self._world.plan_at(now + min(timed.lasts, _SUPERVISED) + _FORKED, self._companion_restarts)
        return None

    def _cut_cable(self, now: int) -> Callable[[int], None]:
        self._world.cable = False
        self._world.flows_changed(now)

        def end(now: int) -> None:
            self._world.cable = True
            self._world.flows_changed(now)

        return end

    def _lose_fix(self, now: int) -> Callable[[int], None]:
        assert self._world.companion is not None
        companion = self._world.companion
        companion.fix = False
        self._world.log.fix.set(now, False)
        self._world.failsafes.position(there=False, now=now)

        def end(now: int) -> None:
            companion.fix = True
            self._world.failsafes.position(there=True, now=now)
            self._world.log.fix.set(now, True)

        return end

    def _sag(self, timed: TimedFault, now: int) -> None:
        assert self._world.companion is not None
        left_wh = max(self._world.aircraft.home_wh(now) * timed.amount, self._world.aircraft.down_wh(now))
        self._world.aircraft.sag(left_wh / self._world.plan.truth.gauge, now)
        self._world.companion.places.note_event(now)
        self._world.failsafes.recompute()

    def _drift(self, timed: TimedFault, now: int) -> Callable[[int], None] | None:
        """Wind from the side; for a breach it blows away from the middle."""
        aircraft, breach = self._world.aircraft, timed.fault is Fault.BREACH
        if aircraft.mode is not Mode.AUTO:
            return None
        x, y, _z = aircraft.at(now)
        vx, vy, _up = aircraft.velocity
        across = 10.0 + 3.0 * timed.amount if breach else 3.0 + 4.0 * timed.amount
        angle = radians(bearing_deg(x, y) if breach else bearing_deg(vx, vy) + (90.0 if timed.amount > 0.5 else -90.0))
        aircraft.carried((across * sin(angle), across * cos(angle)), now)
        return lambda now: aircraft.carried((0.0, 0.0), now)

    def _gust(self, timed: TimedFault, now: int) -> Callable[[int], None] | None:
        """The aircraft reaches half of its speed, or next to none."""
        aircraft, part = self._world.aircraft, 0.5 + 0.5 * timed.amount
        if aircraft.mode is not Mode.AUTO:
            return None
        vx, vy, _up = aircraft.velocity
        aircraft.carried((-part * vx, -part * vy), now)
        return lambda now: aircraft.carried((0.0, 0.0), now)

    def _pilot_gives_back(self, now: int) -> None:
        if self._world.aircraft.mode is Mode.PILOT:
            self._world.aircraft.resume("pilot", now)
