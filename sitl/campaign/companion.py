# SPDX-License-Identifier: GPL-3.0-or-later

"""The edge of the vehicle's rules: what happens becomes events, actions become what happens.

Here stands all that has to be added when the rules get an event or an action more: `_perform` is a match that the type
checker closes, `_second` makes what the real edge works out each second. Whatever raises out of the rules is logged as
broken, and ends authority, as in the real companion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from mavproxy_handover.companion.event_queue import EventQueue
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.authority.start import refused
from mavproxy_handover.core.common import events
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Connect, ConnectAck, Message
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, ModeClass, ModeSource, Phase, Station
from mavproxy_handover.core.common.never import assert_never
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.core.safety.commands import CommandRules, Outcome, Ruling
from mavproxy_handover.core.safety.route import RouteCheck, RouteLimits, TrackFact
from mavproxy_handover.mission.zones import Circle as ZoneCircle
from mavproxy_handover.mission.zones import Zone, ZoneFinder
from sitl.campaign.aircraft import BY_MISSION, Aircraft, Mode
from sitl.campaign.commands import Desk
from sitl.campaign.gaps import gap_at, lacking
from sitl.campaign.log import FlightLog
from sitl.campaign.places import Places
from sitl.campaign.plan import FlightPlan
from sitl.campaign.plane import bearing_deg, on_earth
from sitl.campaign.times import NEVER, in_seconds, in_ticks
from sitl.campaign.watch import Watch

__all__ = ["DIGEST", "Companion", "Ties"]

DIGEST: Final = bytes(range(32))
#: what a mode does, and its name
_MODES: Final = {
    Mode.GROUND: (ModeClass.HANDS, "LOITER"),
    Mode.AUTO: (ModeClass.MISSION, "AUTO"),
    Mode.PAUSE: (ModeClass.MISSION, "AUTO"),
    Mode.RTL: (ModeClass.RETURN, "RTL"),
    Mode.LAND: (ModeClass.LAND, "LAND"),
    Mode.PILOT: (ModeClass.HANDS, "LOITER"),
}
#: a station that has not been heard, or has not answered, for this time is no partner
_LOST: Final = in_ticks(Limits().heartbeat_lost_s)
_UNANSWERED: Final = in_ticks(Limits().connect_lost_s)
_DEAF: Final = in_ticks(Limits().deaf_lost_s)
#: a station that answered within this time is asked each second only, and answers
_LATELY: Final = in_ticks(1.9)
#: longer than any hold-off and clearing time of the rules lasts, but those of links and attacks, and pauses
_LONG_S: Final = 8.0
#: the same on the ground, where who is there and what is loaded is all that counts
_ON_GROUND_S: Final = 2.5
#: journal entries after which a longer or shorter time must be waited: how long (s), and the pauses that begin with
#: them
_STIRS: Final[Mapping[str, tuple[float, tuple[float, ...]]]] = {
    **dict.fromkeys(("station_heard", "connected", "zone_entered", "partner_unfit"), (1.5, ())),
    **dict.fromkeys(("start", "started", "zone_left"), (4.0, ())),
    **dict.fromkeys(("transfer_begun", "step", "candidate", "transfer_raised"), (2.5, (1.0,))),
    "transfer_committed": (6.0, (5.0,)),
    "transfer_aborted": (11.0, (2.0, 10.0)),
    "authority": (_LONG_S, (5.0,)),
    **dict.fromkeys(("link_quality", "attack"), (45.0, (3.0, 30.0))),
}


@dataclass(frozen=True, slots=True)
class Ties:
    """Carries out the actions of the rules. `note_event`, `stay_awake`: an event that is not routine (`pace.py`)."""

    to_station: Callable[[int, Message, int], None]
    status: Callable[[AuthorityView, int], None]
    order: Callable[[FlightAction, int], None]
    take_off: Callable[[int], None]
    note_event: Callable[[int, float, tuple[float, ...]], None]
    stay_awake: Callable[[int, float], None]


class Companion:
    """One vehicle's rules, over all its restarts. Times are ticks; `core_s`: the same as the rules count them."""

    def __init__(
        self, plan: FlightPlan, aircraft: Aircraft, log: FlightLog, ties: Ties, core_s: Callable[[int], float]
    ) -> None:
        self._plan, self._aircraft, self._log, self._ties, self._core_s = plan, aircraft, log, ties, core_s
        self._stations = tuple(Station(each.sysid, each.name) for each in plan.stations)
        self._limits = Limits(policies=plan.policies)
        self._zones = tuple(
            Zone(each.sysid, each.name, ZoneCircle(*on_earth(each.zone.x_m, each.zone.y_m), each.zone.radius_m))
            for each in plan.stations
        )
        self._way = tuple(on_earth(spot.x_m, spot.y_m) for spot in plan.way)
        self._finder = ZoneFinder(self._zones)
        self._route = RouteCheck(RouteLimits())
        self._nonce = 1
        self._kept: Snapshot | None = None
        self._signs = events.ConditionsSeen()
        #: causes that were there at once, by phase
        self.pairs: set[tuple[Phase, frozenset[str]]] = set()
        self._seen: tuple[Phase, frozenset[object]] | None = None
        self.handled = 0
        #: when each station is asked again whether it is there (s, as the rules count)
        self._asks: dict[int, float] = {}
        #: when each was heard last, and answered last whether it is (ticks, as the rules count)
        self._heard: dict[int, int] = {}
        self._answered: dict[int, int] = {}
        self._silent_at = NEVER
        self.fix = True
        self.arbiter: Arbiter | None = None
        self._watch: Watch | None = None
        self.view = AuthorityView()
        self._queue: EventQueue[int] = EventQueue(self._dispatch, self._begin_order)
        #: what the aircraft is ordered when all events are handled: a later order replaces an earlier one
        self._ordered: FlightAction | None = None
        #: what was said last of mode and motion, which is said again only where every step is made
        self._told: dict[type, object] = {}
        #: whether it flew at the last heartbeat, and what
        self._flew, self._mode = False, Mode.GROUND
        self._start(0)

    # ---- its life ---------------------------------------------------------------------------------------------------

    def _start(self, now: int) -> None:
        identity = Identity("drone", self._stations, self._stations[0].sysid, self._nonce)
        self._nonce += 100_000
        self.arbiter = Arbiter(identity, self._limits, self._kept)
        try:
            self._watch = Watch(self.arbiter, self._stations[0].sysid, self._limits, restored=self._kept)
        except AssertionError as error:
            self._log.broken.append((now, f"a restart gives what it must not: {error}"))
        self._signs = events.ConditionsSeen()
        self._told.clear()
        self._flew, self._mode = False, Mode.GROUND
        self.desk = Desk(self._plan, self._aircraft, self._zones, CommandRules())
        self.places = Places(self._plan, self._aircraft, self._zones)
        self._route = RouteCheck(RouteLimits())
        self._in_force(self.arbiter.view, now)

    @property
    def runs(self) -> bool:
        """Whether it hears and acts."""
        return self.arbiter is not None

    def dies(self, now: int) -> None:
        """Its process is gone."""
        self.arbiter = self._watch = None
        self._log.companion.set(now, False)
        self._log.transfer.set(now, None)
        self._log.note(now, "the companion is down")

    def restarts(self, now: int) -> None:
        """A new one begins where the old one left off."""
        if self.arbiter is None:
            self._log.companion.set(now, True)
            self._log.note(now, "the companion is up again")
            self._start(now)

    def due(self) -> float:
        """When the rules want to be called at the latest (s, as they count); inf without any."""
        deadline = None if self.arbiter is None else self.arbiter.next_deadline()
        return math.inf if deadline is None else deadline

    @property
    def passed_at_m(self) -> float | None:
        """`Arbiter.passed_at_m`."""
        return None if self.arbiter is None else self.arbiter.passed_at_m

    def silent_at(self, after: int, near: int) -> int:
        """The next time after `after` at which a station counts as silent without news (ticks, as the rules count).

        A station is silent if it is not heard, or does not answer, until then. A result after `near` may be too early.
        """
        if near >= self._silent_at:  # until now later news has only delayed it
            times = (
                *(at + _LOST for at in self._heard.values()),
                *(at + wait for at in self._answered.values() for wait in (_UNANSWERED, _DEAF)),
            )
            self._silent_at = min((at for at in times if at > after), default=NEVER)
        return self._silent_at

    def answers(self, now: int) -> bool:
        """Whether its commander has answered of late, or there is none: how long one does not is counted."""
        commander = self.view.commander
        answered = self._answered.get(commander) if commander is not None else NEVER
        return answered is not None and in_ticks(self._core_s(now)) < answered + _LATELY

    def wavers(self, now: int) -> bool:
        """`Arbiter.wavers`."""
        return self.arbiter is not None and self.arbiter.wavers(self._core_s(now))

    def settled(self, now: int) -> bool:
        """`Arbiter.settled`."""
        return self.arbiter is None or self.arbiter.settled(self._core_s(now))

    def only_asks(self, due: float) -> bool:
        """Whether what is due then is a question to a station, with no transfer under way that could run out."""
        return self.view.partner is None and due in self._asks.values()

    # ---- what happens -----------------------------------------------------------------------------------------------

    def give(self, event: events.Event, now: int) -> None:
        """One event for the rules; it is lost while the companion is down."""
        if self.arbiter is not None:
            self._queue.put(event, now)

    def _dispatch(self, event: events.Event, now: int) -> None:
        arbiter, watch = self.arbiter, self._watch
        if arbiter is None:
            return
        self.handled += 1
        if isinstance(event, events.StationHeard | events.StationMessage):
            self._hears(event, in_ticks(self._core_s(now)))
        try:
            actions = arbiter.handle(event, self._core_s(now))
            if watch is not None:
                watch.saw(event, actions, self._core_s(now))
        except AssertionError as error:
            self._log.broken.append((now, f"{type(event).__name__}: {error or 'books of authority'}"))
            self._watch = None
            return
        if actions:
            for action in actions:
                self._perform(action, now)
        self._count()

    def _hears(self, event: events.StationHeard | events.StationMessage, now: int) -> None:
        self._heard[event.station] = now
        self._silent_at = min(self._silent_at, now + _LOST)
        if isinstance(event, events.StationMessage) and isinstance(event.message, ConnectAck):
            self._answered[event.station] = now
            self._silent_at = min(self._silent_at, now + _UNANSWERED)

    def _count(self) -> None:
        """Which causes are there at once, and in which phase."""
        assert self.arbiter is not None
        causes = self.arbiter.causes
        seen = (self.view.phase, causes)
        if seen != self._seen:
            self._seen = seen
            if len(causes) > 1:
                self.pairs.add((self.view.phase, frozenset(cause.value for cause in causes)))

    def _perform(self, action: events.Action, now: int) -> None:
        ties = self._ties
        match action:
            case events.Send():
                if isinstance(action.message, Connect):
                    self._asks[action.station] = self._core_s(now) + self._limits.connect_interval_s
                elif not isinstance(action.message, ConnectAck):
                    ties.stay_awake(now, 2.5)
                ties.to_station(action.station, action.message, now)
            case events.ViewChanged():
                self._in_force(action.view, now)
                ties.note_event(now, 2.5, ())
            case events.Fly():
                self._log.orders.append((now, action.action.name, action.reason.name))
                self._keep()
                self._log.note(now, f"the companion orders {action.action.name} ({action.reason.name.lower()})")
                if action.action is FlightAction.RETURN:
                    self._before_return(now)
                self._ordered = action.action
                ties.note_event(now, _LONG_S, ())
            case events.BeginStart():
                ties.take_off(now)
            case events.StartRefused():
                self._log.note(now, refused("START", action.needs))
            case events.ControlAnswer() | events.NotifyOwner():  # of stations of the standard: none here
                pass
            case events.RehearsalMoved() | events.RehearsalRefused():  # not requested: the campaign flies
                pass
            case events.Advise():
                self._log.note(now, action.text)
            case events.Announce():
                self._log.note(now, action.text)
            case events.Record():
                self._log.note(now, action.text)
                settle_s, pauses = _STIRS.get(action.event, (_LONG_S, ()))
                ties.note_event(now, settle_s if self._aircraft.flying else _ON_GROUND_S, pauses)
            case _:
                assert_never(action)

    def _begin_order(self, now: int) -> None:
        ordered, self._ordered = self._ordered, None
        if ordered is not None:
            self._ties.order(ordered, now)

    def _keep(self) -> None:
        """Keep the state before any message or order."""
        assert self.arbiter is not None
        self._kept = self.arbiter.snapshot()

    def _in_force(self, view: AuthorityView, now: int) -> None:
        before, self.view = self.view, view
        self._keep()
        self._log.commander.set(now, view.commander)
        self._log.epoch.set(now, view.epoch)
        transfer = None if view.partner is None else (view.partner, view.handover_id, view.why.name)
        self._log.transfer.set(now, transfer)
        if view.commander != before.commander:
            self.desk.rules.authority_moved()
        if view.commander is not None and before.commander not in (None, view.commander):
            assert before.commander is not None
            self._log.moves.append((now, before.commander, view.commander))
        self._ties.status(view, now)

    # ---- position, route, energy ------------------------------------------------------------------------------------

    def position(self, now: int) -> bool:
        """A position of the autopilot comes in, if it has one; whether it has."""
        if self.arbiter is None or not self.fix:
            return False
        aircraft = self._aircraft
        x, y, z = aircraft.at(now)
        vx, vy, _up = aircraft.velocity
        speed = math.hypot(vx, vy)
        way = self._way[aircraft.waypoint :] if aircraft.mode is Mode.AUTO else ()
        track = bearing_deg(vx, vy) if speed > 0.0 else 0.0
        facts = self._finder.facts(*on_earth(x, y), track, speed, z, way)
        gap = None
        if self._plan.gaps and aircraft.mode in (Mode.AUTO, Mode.PAUSE):
            gap = gap_at(self._plan.gaps, aircraft.waypoint, x, y, max(self._plan.speed_mps, speed))
        self.give(events.PositionSeen(facts, gap), now)
        return True

    def heartbeat(self, now: int, *, always: bool) -> None:
        """The autopilot says what it is about. `always`: also what it has said before."""
        aircraft = self._aircraft
        flown, name = _MODES[aircraft.mode]
        mode = events.ModeSeen(flown, name, aircraft.mode is Mode.LAND, self._plan.truth.radio)
        # what flew at the heartbeat before is a part of the rules' result
        key = mode, self._flew
        if aircraft.mode is Mode.RTL and aircraft.by == BY_MISSION and self._mode is not Mode.RTL:
            self.give(events.ModeSourceSeen(ModeSource.MISSION), now)
        self._flew, self._mode = aircraft.flying, aircraft.mode
        if always or self._told.get(events.ModeSeen) != key:
            self._told[events.ModeSeen] = key
            self.give(mode, now)
        self.give(events.AutopilotState(aircraft.armed, aircraft.flying), now)

    def _move(self, now: int, *, always: bool) -> None:
        aircraft = self._aircraft
        motion = events.MotionSeen(aircraft.speed_mps, aircraft.velocity[2], aircraft.away_m(now))
        if always or self._told.get(events.MotionSeen) != motion:
            self._told[events.MotionSeen] = motion
            self.give(motion, now)

    def _track(self, x: float, y: float) -> TrackFact | None:
        """On the leg of the mission, as long as the autopilot says that it flies it."""
        aircraft = self._aircraft
        if self._mode is not Mode.AUTO or not 0 < aircraft.waypoint < len(self._plan.way):
            return None
        start, end = self._plan.way[aircraft.waypoint - 1], self._plan.way[aircraft.waypoint]
        east, north = end.x_m - start.x_m, end.y_m - start.y_m
        length = math.hypot(east, north)
        if length < 1.0:
            return None
        along = ((x - start.x_m) * east + (y - start.y_m) * north) / length
        across = ((x - start.x_m) * north - (y - start.y_m) * east) / length
        return TrackFact(aircraft.waypoint, across, None, along, length)

    def second(self, now: int, *, always: bool) -> None:
        """The edge's computations of each second. `always`: also of what cannot have changed."""
        if self.arbiter is None:
            return
        self._judge_places(now, always=always)
        if self._aircraft.flying and self.fix:
            self._move(now, always=always)
        if self._aircraft.flying and self.fix:
            self._route.update(self._track(*self._aircraft.at(now)[:2]), in_seconds(now))
        signs = events.ConditionsSeen(
            self._aircraft.flying and self.places.short, self._route.deviation is not None, self._aircraft.breached
        )
        if signs != self._signs:
            self._signs = signs
            self._ties.note_event(now, _LONG_S, ())
            self.give(signs, now)

    # ---- commands ---------------------------------------------------------------------------------------------------

    def commanded_on(self, station: int, now: int) -> Ruling | None:
        """The ruling on the commander's AUTO, in flight; None: the companion is down."""
        if self.arbiter is None:
            return None
        ruling = self.desk.go_on(self._usable(now), station, now, in_seconds(now))
        return self._ruled(ruling, "AUTO", now)

    def commanded_start(self, station: int, now: int) -> Ruling | None:
        """START of the commander."""
        if self.arbiter is None:
            return None
        lacks = self.desk.start_lacks(now)
        ruling = self._ruled(self.desk.start(lacks, station, in_seconds(now)), "START", now)
        self.give(events.EnergyJudged("" if ruling.passes else lacks), now)
        self.give(events.GapsJudged(lacking(self._plan.gaps, self._plan.alone_max_s)), now)
        self.give(events.StartRequested(station), now)
        return ruling

    def _ruled(self, ruling: Ruling, what: str, now: int) -> Ruling:
        self._log.note(now, f"{what} {ruling.outcome.value}{': ' if ruling.words else ''}{ruling.words}")
        if ruling.outcome is Outcome.LIFTED:
            self._log.lifted += [(now, limit.value) for limit in ruling.limits]
        return ruling

    # ---- places -----------------------------------------------------------------------------------------------------

    def _usable(self, now: int) -> frozenset[int]:
        return frozenset() if self.arbiter is None else self.arbiter.usable(self._core_s(now))

    def _judge_places(self, now: int, *, always: bool) -> None:
        judged = self.places.judge(now, self._usable(now), self.view, fix=self.fix, always=always)
        if judged is not None:
            self.give(judged, now)

    def _before_return(self, now: int) -> None:
        judged = self.places.before_return(now, self._usable(now), self.view, fix=self.fix)
        if judged is not None:
            self.give(judged, now)
