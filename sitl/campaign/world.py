# SPDX-License-Identifier: GPL-3.0-or-later

"""One flight: everything there is, and how time passes.

Events stand in two queues: what is planned (faults, operators, restarts), and what is routine or a message (heartbeats,
CONNECT, status, the words of a transfer). Beside them stand the times of aircraft, guard and companion. The companion's
main loop goes round 20 times a second: position first, then what the rules have due.

Two ways to let time pass, and the same comes of both (`tests/sitl/test_campaign.py`):

* plain: every round is made, and in it everything is looked at;
* by `pace.py`: only rounds in which something can come of it, and where nothing can for a while, none of the routine
  either: then the clock of the rules stands still, which they cannot tell from a time in which every second is like the
  one before. Nothing of the aircraft stands still: it flies, and uses energy.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from functools import partial
from itertools import count
from math import inf

from gcs_module import core as gcs
from mavproxy_handover.core.common import events
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, LeaseState, ModeClass, ModeSource, Phase
from mavproxy_handover.core.common.never import assert_never
from mavproxy_handover.core.safety.commands import Ruling
from sitl.campaign.aircraft import Aircraft, Mode
from sitl.campaign.commands import AGAIN_S
from sitl.campaign.companion import DIGEST, Companion, Ties
from sitl.campaign.failsafes import Failsafes
from sitl.campaign.fault_injection import FaultInjector
from sitl.campaign.faults import Insists
from sitl.campaign.guard import Guard
from sitl.campaign.links import Link
from sitl.campaign.log import FlightLog, Series
from sitl.campaign.pace import LONG_S, STIRRED, Pace
from sitl.campaign.plan import LEAST_HANDOVERS, FlightPlan
from sitl.campaign.stations import Ground, GroundTies
from sitl.campaign.times import NEVER, ROUND, SECOND, in_seconds, in_ticks, on_round

__all__ = ["World"]

#: a flight is over this time after the landing, or without a START
_AFTER = in_ticks(5.0)
_NOT_STARTED = in_ticks(120.0)
#: the same where the rules hear of it: what they make of it stirs by itself (s)
_HEARD_S = 2.5
#: time until the autopilot answers an order
_ANSWERS = in_ticks(0.1)
#: longer than any of these missions with everything that can delay it
_LONGEST = in_ticks(5400.0)
_START_TAKES = in_ticks(2.0)
#: an operator who thinks no longer than that does not let a border come near
_AGREES = in_ticks(2.0)
#: this time (s) before its border an aircraft is about to leave a zone
_LEAVES_S = 10.0


class World:
    """One flight of a plan. `plain`: everything is stepped."""

    def __init__(self, plan: FlightPlan, *, plain: bool = False, tells: bool = False) -> None:
        self.plan, self.plain = plan, plain
        self.log = log = FlightLog(tells=tells)
        for station in plan.stations:
            log.working[station.sysid], log.weak[station.sysid] = Series(True), Series(False)
            log.believes[station.sysid] = Series(None)
        #: ticks that the clock of the rules has stood still
        self.stood = 0
        self.now = 0
        self._number = count()
        self._planned: list[tuple[int, int, Callable[[int], None]]] = []
        self._routine: list[tuple[int, int, Callable[[int], None]]] = []
        self.aircraft = Aircraft(plan, log)
        self.guard = Guard(self.aircraft, plan.alone_max_s)
        self.pace = Pace(plan, self.aircraft)
        self._lay_links()
        self.cable = True
        self.failsafes = Failsafes(plan, self.aircraft, log, self._failsafe)
        self._round = -SECOND
        self._beaten = False
        #: when the rules have something due, as they count, and after how many events that was
        self._due, self._due_of = NEVER, -1
        #: when the next round is, and of what that was concluded
        self._next = 0
        #: what is due is a question to a station, and nothing else; and when a position is looked at next
        self._only_asks = False
        self._looks_at = 0
        self._next_of: tuple[int, ...] = ()
        #: from when on every round is made, and of what that was concluded
        self._restless = 0
        self._restless_of: tuple[int | None, ...] = ()
        self._over_at = _NOT_STARTED
        #: what operators still want of the aircraft, and how often they still try what was refused
        self._wishes_left, self._tries_left = plan.resumes, 6
        self._wish_waits = False
        self._phases: dict[Phase, int] = {}
        self._phase = Phase.ON_LOAD
        self._border_faults = tuple(timed for timed in plan.timed_faults if timed.border and not timed.late)
        #: from when on late faults strike (`_ripens`), and at the latest
        self._ripe_at = self._ripe_by = NEVER
        self._ripe = False
        self._late_phases: dict[Phase, int] = {}
        ground_ties = GroundTies(self._from_station, self._between, self._plan_answer)
        self.ground = {s.sysid: Ground(plan, s, log, ground_ties, self.core_s) for s in plan.stations}
        ties = Ties(
            self._to_station, self._status, self._order, self._begin_start, self.pace.note_event, self.pace.stay_awake
        )
        self.view = AuthorityView()
        self.companion: Companion | None = None
        self.companion = Companion(plan, self.aircraft, log, ties, self.core_s)
        self._fault_injector = FaultInjector(self)
        self._begin()

    # ---- time ------------------------------------------------------------------------------------------------------

    def core_s(self, now: int) -> float:
        """The time as the rules count it."""
        return in_seconds(now - self.stood)

    def plan_at(self, when: int, job: Callable[[int], None]) -> None:
        heapq.heappush(self._planned, (when, next(self._number), job))

    def _send(self, when: int, job: Callable[[int], None]) -> None:
        heapq.heappush(self._routine, (when, next(self._number), job))

    def _every(self, pause: int, job: Callable[[int], None], first: int) -> None:
        def again(now: int) -> None:
            job(now)
            self._send(now + pause, again)

        self._send(first, again)

    def _begin(self) -> None:
        self._every(SECOND, self._beat, 0)
        self._every(SECOND // 2, lambda _now: self._status(self.view, _now), 2)
        self._every(SECOND // 2, self._guard_speaks, 4)
        for number, station in enumerate(self.plan.stations):
            self._every(SECOND, partial(self._station_beats, station.sysid), 6 + 5 * number)
        self.plan_at(3 * SECOND, lambda now: self.tell(events.MissionLoaded(DIGEST, self.plan.route), now))
        self.plan_at(self.plan.start_at, self._start)
        for timed in self.plan.timed_faults:
            if timed.phase is None and not timed.border and not timed.late:
                take_off = self.plan.start_at + _START_TAKES
                self.plan_at(max(1, take_off + timed.after), partial(self._fault_injector.inject, timed))

    def tell(self, event: events.Event, now: int) -> None:
        if self.companion is not None:
            self.companion.give(event, now)

    def run(self) -> FlightLog:
        """Fly."""
        companion, aircraft, guard, pace = self.companion, self.aircraft, self.guard, self.pace
        failsafes = self.failsafes
        assert companion is not None
        planned, routine = self._planned, self._routine
        while True:
            first = planned[0][0] if planned else NEVER
            second = routine[0][0]
            own = min(aircraft.ends, guard.due, failsafes.due())
            now = min(first, second, own)
            round_at = self._next_round(now, first)
            now = min(now, round_at)
            if now >= self._over_at:
                self.log.ended = self._over_at
                return self.log
            self.now = now
            if aircraft.ends <= now:
                aircraft.turn(now)
                pace.note_event(now, 0.0)
                self._after_piece(now)
            elif own <= now:
                self._of_itself(now)
            elif first <= now:
                _at, _number, job = heapq.heappop(planned)
                job(now)
                if job != self._ripens:  # that only plans events
                    pace.note_event(now, _HEARD_S)
            elif second <= now:
                _at, _number, job = heapq.heappop(routine)
                job(now)
                if self._beaten:
                    self._beaten = False
                    if not self.plain:
                        self._stand_still(now)
            else:
                self._go_round(now)

    def _next_round(self, now: int, planned: int) -> int:
        """When the main loop goes round next with something to come of it."""
        following = on_round(max(self._round + 1, self.now))
        companion = self.companion
        assert companion is not None
        if self.plain or following > now:  # something else comes first
            return following
        of = (self._round, self.pace.changes, planned, companion.handled, self.aircraft.begun, self.stood)
        if of == self._next_of and self._next >= following:
            return self._next
        self._next_of, self._next = of, self._find_next_round(following, planned, companion)
        return self._next

    def _find_next_round(self, following: int, planned: int, companion: Companion) -> int:
        at = following - self.stood
        self.pace.passes(companion.view.commander, companion.passed_at_m)
        silent = companion.silent_at(at - STIRRED - 1, at + STIRRED + ROUND) + self.stood
        of = (self.pace.changes, planned, self.aircraft.begun, self.stood, companion.view.commander, silent)
        restless = self._restless
        if of != self._restless_of or restless <= following or self.aircraft.drift != (0.0, 0.0):
            restless = self.pace.restless(following, planned, companion.view.commander, silent)
            self._restless_of, self._restless = of, restless
        if restless <= following or companion.wavers(following):
            self._looks_at = following
            return following
        if companion.handled != self._due_of:
            self._due_of, due = companion.handled, companion.due()
            self._due = NEVER if due == inf else in_ticks(due)
            self._only_asks = companion.only_asks(due)
        due_at = NEVER if self._due == NEVER else on_round(self._due + self.stood)
        # the next whole second, too: a position each second keeps it fresh
        self._looks_at = max(following, min(on_round(restless), on_round((self._round // SECOND + 1) * SECOND)))
        if not self._only_asks:  # what runs out may let the rules look around
            self._looks_at = min(self._looks_at, max(following, due_at))
        return max(following, min(due_at, self._looks_at))

    def _go_round(self, now: int) -> None:
        self._round = now
        companion = self.companion
        assert companion is not None
        if not companion.runs:
            return
        if self.cable and (self.plain or now >= self._looks_at) and companion.position(now):
            return  # whatever was due is done
        if companion.runs and companion.due() <= self.core_s(now):
            companion.give(events.Tick(), now)

    # ---- each second -----------------------------------------------------------------------------------------------

    def _beat(self, now: int) -> None:
        """The autopilot's heartbeat, and what the companion does each second."""
        companion = self.companion
        assert companion is not None
        if self.cable:
            companion.heartbeat(now, always=self.plain)
            companion.second(now, always=self.plain)
        self._beaten = True
        self._wants_on(now)
        if self._border_faults and self._leaves(now):
            bare = self._leaves_all(now)
            timed_faults = [timed for timed in self._border_faults if bare or not timed.bare]
            self._border_faults = tuple(timed for timed in self._border_faults if timed not in timed_faults)
            for timed in timed_faults:
                self.plan_at(max(now + 1, now + timed.after), partial(self._fault_injector.inject, timed))

    def _leaves(self, now: int) -> bool:
        """Whether the aircraft is about to leave its commander's zone, on its way."""
        commander = self.view.commander
        if commander is None or self.aircraft.mode is not Mode.AUTO:
            return False
        x, y, _z = self.aircraft.at(now)
        vx, vy, _up = self.aircraft.velocity
        zone = self.plan.zones[commander]
        return zone.margin_m(x + _LEAVES_S * vx, y + _LEAVES_S * vy) < 0.0

    def _leaves_all(self, now: int) -> bool:
        """Whether no zone at all holds where it is about to be."""
        x, y, _z = self.aircraft.at(now)
        vx, vy, _up = self.aircraft.velocity
        ahead = x + _LEAVES_S * vx, y + _LEAVES_S * vy
        return all(zone.margin_m(*ahead) < 0.0 for zone in self.plan.zones.values())

    def _stand_still(self, now: int) -> None:
        """Leave out time in which nothing can happen; places are looked at in between when they have to be."""
        companion = self.companion
        assert companion is not None
        while (
            companion.view.partner is None
            and companion.answers(now)
            and companion.settled(now)
            and self.pace.quiet(now, self._links, companion.view.commander)
        ):
            left_out = min(self._nothing_until(now, companion), companion.places.due) - now
            left_out -= left_out % SECOND
            if left_out <= 0:
                return
            self.stood += left_out
            self._routine[:] = [(at + left_out, number, job) for at, number, job in self._routine]
            self._round += left_out
            now += left_out
            self.now = now
            if now < companion.places.due:
                return
            companion.second(now, always=False)

    def _nothing_until(self, now: int, companion: Companion) -> int:
        """The end of the time in which there are only routine and places."""
        bounds = [self._planned[0][0] if self._planned else NEVER, self.aircraft.ends, self.guard.due]
        bounds += [self.failsafes.due(), self._over_at]
        commander = companion.view.commander
        if self._border_faults and commander is not None:  # whether it leaves the zone is looked at each second
            x, y, _z = self.aircraft.at(now)
            away_s = self.plan.zones[commander].margin_m(x, y) / max(1.0, self.aircraft.speed_mps)
            bounds.append(now + int((away_s - _LEAVES_S - 2.0) * SECOND))
        return self.pace.nothing_until(now, min(bounds), commander)

    def _guard_speaks(self, now: int) -> None:
        if self.guard.works and self.cable:
            self.tell(events.GuardSeen(self.guard.state(now), ours=True), now)
            if self.guard.enforcing:
                self.tell(events.ModeSourceSeen(ModeSource.GUARD), now)

    def _station_beats(self, sysid: int, now: int) -> None:
        """Heartbeats of a station, up and over the ground, and of the companion down to it."""
        ground, companion = self.ground[sysid], self.companion
        assert companion is not None
        if ground.core is not None:
            ground.tick(now)
            self._up(sysid, events.StationHeard(sysid), now)
            for other in self.ground:
                link = self._peer_links.get((sysid, other))
                if link is not None and link.arrives(now, 0.0, 0.0) is not None:
                    self.ground[other].give(gcs.PeerHeard(sysid), now)
        if companion.runs:
            self._down(sysid, gcs.VehicleHeard(), now)

    # ---- links -----------------------------------------------------------------------------------------------------

    def _lay_links(self) -> None:
        plan, number = self.plan, 0
        self.uplinks: dict[int, Link] = {}
        self.downlinks: dict[int, Link] = {}
        for station in plan.stations:
            for links in (self.uplinks, self.downlinks):
                links[station.sysid] = Link(plan.seed, number, station.zone, station.delay, plan.loss)
                number += 1
        self._peer_links = {
            (a.sysid, b.sysid): Link(plan.seed, number + 16 * n + m, None, 1, plan.loss)
            for n, a in enumerate(plan.stations)
            for m, b in enumerate(plan.stations)
            if a is not b and plan.ground_link
        }
        self._links = [*self.uplinks.values(), *self.downlinks.values()]

    def _up(self, sysid: int, event: events.Event, now: int) -> None:
        x, y, _z = self.aircraft.at(now)
        at = self.uplinks[sysid].arrives(now, x, y)
        if at is not None:
            self._send(at, partial(self.tell, event))

    def _down(self, sysid: int, event: gcs.Event, now: int) -> None:
        x, y, _z = self.aircraft.at(now)
        at = self.downlinks[sysid].arrives(now, x, y)
        if at is not None:
            self._send(at, partial(self.ground[sysid].give, event))

    def _over_ground(self, sysid: int, peer: int, event: gcs.Event, now: int) -> None:
        link = self._peer_links.get((sysid, peer))
        at = None if link is None else link.arrives(now, 0.0, 0.0)
        if at is not None:
            self._send(at, partial(self.ground[peer].give, event))

    def _to_station(self, sysid: int, message: Message, now: int) -> None:
        self._down(sysid, gcs.FromVehicle(message), now)

    def _from_station(self, sysid: int, message: Message, now: int) -> None:
        self._up(sysid, events.StationMessage(sysid, message), now)

    def _between(self, sysid: int, peer: int, message: Message, now: int) -> None:
        self._over_ground(sysid, peer, gcs.FromPeer(sysid, message), now)

    def _plan_answer(self, sysid: int, question: object, answer: tuple[bool, int] | None, now: int) -> None:
        """An operator is asked. What they do wrong belongs to what goes wrong: before that they say yes, and soon."""
        if not self._ripe:
            answer = True, _AGREES
        if answer is not None:
            self.plan_at(now + answer[1], partial(self.ground[sysid].answer, question, answer[0]))

    def _status(self, view: AuthorityView, now: int) -> None:
        """AUTHORITY_STATUS to all, and the lease to the guard."""
        changed, self.view = view != self.view, view
        companion = self.companion
        if companion is not None and companion.runs:
            recovering = view.lease is LeaseState.RECOVERING
            heard = gcs.AuthorityHeard(
                view.phase, view.commander, view.partner, view.epoch, view.handover_id, recovering, view.why
            )
            for sysid in self.ground:
                self._down(sysid, heard, now)
        if changed:
            self.flows_changed(now)
            self._ripens(now)
            self._phase_changed(view.phase, now)

    # ---- what watches the leases -------------------------------------------------------------------------------------

    def flows_changed(self, now: int) -> None:
        """Leases and heartbeats of the commander reach the autopilot, or do not any more."""
        companion = self.companion
        runs = self.cable and (companion is None or companion.runs)
        held, lease = self.view.commander is not None, self.view.lease
        arbiter = None if companion is None else companion.arbiter
        self.guard.heed(runs, lease, 0.0 if arbiter is None else arbiter.alone_s(self.core_s(now)), now)
        self.log.cable.set(now, self.cable)
        alone = lease is LeaseState.ALONE
        self.failsafes.heartbeats(come=runs, held=held, alone=alone, watched=self.guard.works, now=now)

    def _phase_changed(self, phase: Phase, now: int) -> None:
        if phase is self._phase:
            return
        self._phase = phase
        for late, counted in ((False, self._phases), (True, self._late_phases)):
            if late and not self._ripe:
                continue
            times = counted[phase] = counted.get(phase, 0) + 1
            for timed in self.plan.timed_faults:
                if timed.phase is phase and timed.nth == times and timed.late is late:
                    self.plan_at(max(now + 1, now + timed.after), partial(self._fault_injector.inject, timed))

    def _ripens(self, now: int) -> None:
        """Late faults strike from now on, if it is late enough.

        The handovers must be over by then, or it must be very late.
        """
        if self._ripe or now < self._ripe_at or (len(self.log.moves) < LEAST_HANDOVERS and now < self._ripe_by):
            return
        self._ripe = True
        late = [timed for timed in self.plan.timed_faults if timed.late]
        self._border_faults += tuple(timed for timed in late if timed.border)
        for timed in late:
            if timed.phase is None and not timed.border:
                self.plan_at(max(now + 1, now + timed.after), partial(self._fault_injector.inject, timed))

    # ---- the autopilot -----------------------------------------------------------------------------------------------

    def _start(self, now: int) -> None:
        """The parent's operator sends START."""
        companion, parent = self.companion, self.plan.stations[0].sysid
        assert companion is not None
        self._refused(companion.commanded_start(parent, now), self._start, now)

    def _refused(self, ruling: Ruling | None, again: Callable[[int], None], now: int) -> None:
        """An operator was refused: plan what the operator does next."""
        companion, insists = self.companion, self.plan.insists
        assert companion is not None
        if ruling is None or ruling.passes or insists is Insists.NO or self._tries_left <= 0:
            return
        self._tries_left -= 1
        if insists is Insists.LIFTS:
            companion.desk.lift(ruling, in_seconds(now))
        self.plan_at(now + in_ticks(AGAIN_S), again)

    def _wants_on(self, now: int) -> None:
        """The aircraft was stopped, or turned back: the commander's operator may send it on."""
        if self._wishes_left <= 0 or self._wish_waits or self.aircraft.mode not in (Mode.PAUSE, Mode.RTL):
            return
        self._wishes_left -= 1
        self._wish_waits = True
        self.plan_at(now + in_ticks(self.plan.resumes_after_s), self._sends_on)

    def _sends_on(self, now: int) -> None:
        """The operator of the station that believes to be the commander sends AUTO."""
        self._wish_waits = False
        sysid = self.view.commander
        if sysid is None or self.ground[sysid].core is None:
            return
        x, y, _z = self.aircraft.at(now)
        at = self.uplinks[sysid].arrives(now, x, y)
        if at is not None:
            self.plan_at(at, partial(self._sent_on, sysid))

    def _sent_on(self, sysid: int, now: int) -> None:
        """AUTO of a station has come."""
        companion, aircraft = self.companion, self.aircraft
        assert companion is not None
        if not self.passes(sysid) or aircraft.mode not in (Mode.PAUSE, Mode.RTL):
            return
        ruling = companion.commanded_on(sysid, now)
        if ruling is None or not ruling.passes:
            self._refused(ruling, self._sends_on, now)
            return
        self.log.obeyed.append((now, sysid, True))
        if not self.failsafes.no_position:
            aircraft.resume("commander", now)
        self.tell(events.ModeSourceSeen(ModeSource.COMMANDER, ModeClass.MISSION), now)

    def _begin_start(self, now: int) -> None:
        self.plan_at(now + _START_TAKES, self._take_off)

    def _take_off(self, now: int) -> None:
        if self.companion is None or not self.companion.runs or not self.cable:
            return
        if not self.guard.due < NEVER:
            self.aircraft.take_off(now)
            self._over_at = now + _LONGEST
            self._ripe_at, self._ripe_by = (now + in_ticks(each) for each in self.plan.ripe_s)
            for at in (self._ripe_at, self._ripe_by):
                self.plan_at(at, self._ripens)
            self.tell(events.StartFinished(True), now)

    def _order(self, action: FlightAction, now: int) -> None:
        """An order of the companion."""
        aircraft = self.aircraft
        if not self.cable or not self.log.obeys.values[-1]:
            return
        match action:
            case FlightAction.HOLD if aircraft.mode in (Mode.AUTO, Mode.PAUSE):
                aircraft.pause(now)
            case FlightAction.HOLD:  # ArduCopter pauses in nothing else, and answers so
                self.plan_at(now + _ANSWERS, lambda at: self.tell(events.OrderRefused(FlightAction.HOLD), at))
            case FlightAction.CONTINUE:
                if aircraft.mode is Mode.PAUSE:
                    aircraft.resume("companion", now)
            case FlightAction.RETURN:
                if self.failsafes.no_position:  # RTL is refused, and LAND is what is tried next
                    aircraft.land("companion", now)
                else:
                    aircraft.come_home("companion", now)
            case FlightAction.LAND:
                aircraft.land("companion", now)
            case FlightAction.WARN | FlightAction.TRANSFER:
                pass
            case _:
                assert_never(action)
        self._after_piece(now)

    def _after_piece(self, now: int) -> None:
        if self.aircraft.landed_at is not None and self._over_at > now + _AFTER:
            self._over_at = now + _AFTER

    def _of_itself(self, now: int) -> None:
        """Let autopilot and guard act by themselves."""
        before = self.aircraft.mode
        self.guard.act_if_due(now)
        if self.failsafes.act(now) or self.aircraft.mode is not before:
            self.pace.note_event(now, LONG_S)
        self._after_piece(now)

    def _failsafe(self, now: int) -> None:
        """One of the autopilot's failsafes acts, and it says so."""
        if self.cable:
            self.tell(events.ModeSourceSeen(ModeSource.FAILSAFE), now)

    def passes(self, sysid: int) -> bool:
        """Whether the gate lets a command of this station through."""
        companion = self.companion
        return companion is not None and companion.runs and self.cable and companion.view.commander == sysid
