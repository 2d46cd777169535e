# SPDX-License-Identifier: GPL-3.0-or-later

"""The commander's commands in flight, judged by the situation: what each would leave, what becomes of it, who is told.

The rules are `core/safety/commands.py`, the geometry `mission/ahead.py`; here they meet what is known of the aircraft.

* What is not known is not judged: without a position, a mission package or a model of the energy the command passes.
* An internal fault is not the same: a limit that cannot be judged because of one counts as left. Its policy decides
  then, and the operator can lift it as any other refusal. If the rules themselves break, the command is refused.
* To judge takes milliseconds, and a station may send what it likes: `MOST` at once, then `PER_S` a second. What comes
  faster is refused without a look.
* What wings fly to they circle: by the radius that DO_REPOSITION asks for, which ArduPlane keeps until it leaves
  GUIDED, else by WP_LOITER_RAD or what the mission counts on, and never narrower than a turn (`mission/wings.py`). The
  ceiling of the autopilot's own fence is looked at for them alone: a copter refuses such a target itself.
* A return keeps its speed: DO_CHANGE_SPEED is refused in it, whatever ordered the return. Nor may a command change a
  parameter of a plane's that outlives the mode: its least ground speed, its throttle. In AUTO the rest of the mission
  is judged at the new speed, in GUIDED the way to the target, and each target behind it. Climb and descent are not to
  be slower than the energy rule counts them.
* The operator is told in words how to lift the refusal. The journal says who lifted what.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, inf, radians, sin
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.context import Context
from mavproxy_handover.autopilot.output_dispatcher import OutputDispatcher
from mavproxy_handover.core.common.model import ModeClass
from mavproxy_handover.core.safety.commands import (
    LIFTED_S,
    QUIET_S,
    CommandRules,
    Kind,
    Limit,
    Outcome,
    Ruling,
)
from mavproxy_handover.core.safety.energy import CLIMB_MPS, DESCENT_MPS, EnergyModel
from mavproxy_handover.gate.intent import Aim, Intent
from mavproxy_handover.gate.refusals import CAUSE_S, OncePerCause, RefusalLimiter
from mavproxy_handover.gate.words import how_to_lift
from mavproxy_handover.mission.ahead import Ahead, around, leaves_coverage, leaves_fence, straight, to_height
from mavproxy_handover.mission.energy import Place, pieces_along, released_at, with_ways_down
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.route_simulation import Leg
from mavproxy_handover.mission.wings import AS_IT_COMES
from mavproxy_handover.monitors.energy import FAULT, EnergyMonitor
from mavproxy_handover.monitors.return_site.candidates import Candidates
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.vehicle.return_limits import fence_limits

__all__ = ["MOST", "PER_S", "CommandCheck"]

MOST: Final = 10
PER_S: Final = 5.0
#: entries about one kind of command of a station: not oftener; about a stream as seldom as the station is told
_ENTRY_S = 1.0
#: MAV_FRAMEs that are above the sea, and local frames whose origin is where the aircraft is, turned with it or not
_ABOVE_SEA: Final = (0, 5)
_OFFSETS: Final = (7, 8, 9)
_TURNED: Final = (8, 9)
_UNKNOWN_HEADING: Final = 0xFFFF
#: how fast a guided target is flown to, if no mission says it
_GUIDED_MPS: Final = 10.0
#: of a command that leads where nothing here can tell
_UNKNOWN_WAY: Final = {Limit.COVERAGE: "where it leads is not known"}
#: a copy that comes so long (s) after the one before is not a program's retransmission: it is answered in words again
_BY_HAND_S: Final = 5.0
#: kinds of speed that are level (to ArduCopter both are the ground speed), and what the energy rule counts for others
_LEVEL: Final = (mavlink.SPEED_TYPE_AIRSPEED, mavlink.SPEED_TYPE_GROUNDSPEED)
_VERTICAL: Final = {
    mavlink.SPEED_TYPE_CLIMB_SPEED: CLIMB_MPS,
    mavlink.SPEED_TYPE_DESCENT_SPEED: DESCENT_MPS,
}
_COMES_HOME: Final = (ModeClass.RETURN, ModeClass.LAND)
#: a command is at the autopilot, and its mode here, by then (s)
_ARRIVES_S: Final = 3.0
#: commands of these are done by GUIDED alone
_GUIDED: Final = (Kind.FLY_TO, Kind.TARGET)

#: the words for a limit that cannot be judged
_CANNOT: Final = f"cannot be judged: {FAULT}"
_Place = tuple[float, float, float]
_NOT_JUDGED: Final = Ruling(Outcome.PASSES)


@dataclass(slots=True)
class _Purse:
    """Judgements that may still be made, and when that was counted."""

    left: float = float(MOST)
    counted_at: float = -inf

    def take(self, now: float) -> bool:
        """Whether there is one."""
        self.left = min(float(MOST), self.left + max(0.0, now - self.counted_at) * PER_S)
        self.counted_at = now
        if self.left < 1.0:
            return False
        self.left -= 1.0
        return True


@dataclass(frozen=True, slots=True)
class _Copy:
    """A command as it came: see `CommandRules.rule`."""

    wish: Hashable
    repeats: bool = False
    quiet_s: float = QUIET_S
    begun_at: float | None = None


class CommandCheck:
    """Judges for one vehicle. Times are monotonic seconds."""

    def __init__(
        self,
        policies: Mapping[Limit, str],
        context: Context,
        energy: EnergyMonitor,
        candidates: Candidates,
        dispatcher: OutputDispatcher,
        stale_s: float,
    ) -> None:
        self.rules = CommandRules(policies)
        #: of START: whether it is refused for its energy says the policy of the energy, not of commands in flight
        self._start_rules = CommandRules()
        #: the plan that the autopilot holds; None: nobody knows which one
        self.ahead: Ahead | None = None
        self._aircraft = context.state
        self._energy = energy
        self._candidates = candidates
        self._authority = context.authority
        self._reports = context.reports
        self._dispatcher = dispatcher
        #: an older position (s) is not known any more
        self._stale_s = stale_s
        #: of the circle that GUIDED flies until it is left (m); 0: it has been told none
        self._kept_radius_m = 0.0
        #: the speed that GUIDED was told until it is left (m/s), and the place; None: none
        self._kept_mps: float | None = None
        self._kept_aim: Aim | None = None
        #: when a speed was let pass last
        self._sped_at = -inf
        self._purse = _Purse()
        self._entries = RefusalLimiter(1, _ENTRY_S)
        self._stream_entries = RefusalLimiter(1, CAUSE_S)
        self._words = OncePerCause()

    # ---- commands -------------------------------------------------------------------------------------------------

    def judge(self, port: StationPort, intent: Intent, now: float) -> Ruling:
        """What becomes of a command of the commander in flight; people are told."""
        copy, speeds = _Copy(intent.wish, intent.repeats, intent.quiet_s), intent.kind is Kind.SPEED
        barred = self._bars(intent) if speeds else ""
        if barred:
            return self._bar(port, intent.word, barred, now)
        slow = self._slow(intent) if speeds else ""
        ruling = self._rule(port, intent.kind, intent.word, copy, now, lambda: self._way(intent), slow=slow)
        if ruling.passes:
            self._keep(intent, now)
        return ruling

    def _keep(self, intent: Intent, now: float) -> None:
        """What GUIDED goes on with until it is left."""
        if intent.aim is not None:
            self._kept_aim = intent.aim
            self._kept_radius_m = intent.aim.radius_m or self._kept_radius_m
        if intent.kind is Kind.SPEED:
            self._sped_at = now
            if self._aircraft.flown is ModeClass.GUIDED and intent.speed_type in _LEVEL:
                self._kept_mps = intent.speed_mps

    def sped_lately(self, now: float) -> bool:
        """A speed was let pass so lately that it may have reached the autopilot in another mode by then."""
        return now - self._sped_at < _ARRIVES_S

    def _bars(self, intent: Intent) -> str:
        """Why a speed is refused whatever it costs, in words; "" where it is not."""
        aircraft = self._aircraft
        if aircraft.flown in _COMES_HOME:
            return "a return keeps the speed that its energy is calculated with"
        if not aircraft.kind.winged:
            return ""
        if intent.speed_type == mavlink.SPEED_TYPE_GROUNDSPEED:
            return "it would set MIN_GROUNDSPEED, which also applies to a return"
        if not intent.throttle <= 0.0:
            return "it would set TRIM_THROTTLE, which also applies to a return"
        return ""

    def _slow(self, intent: Intent) -> str:
        """Whether it would climb or come down slower than is counted, in words."""
        counted_mps = _VERTICAL.get(intent.speed_type)
        speed_mps = intent.speed_mps
        if counted_mps is None or speed_mps is None or self._aircraft.kind.winged or not 0.0 < speed_mps < counted_mps:
            return ""
        return f"slower than the {counted_mps:g} m/s that the energy is calculated with"

    def _bar(self, port: StationPort, word: str, why: str, now: float) -> Ruling:
        """It is refused, and nothing lifts that."""
        ruling = Ruling(Outcome.REFUSED, (), why)
        if self._entries.allow(port.sysid, (word, why), now):
            self._reports.event_log.command_refused(port.name, word, ruling)
            if self._words.allow(port.sysid, (word, why), now):
                self._reports.voice.say(port, f"{word} refused: {why}")
        return ruling

    def mode_changed(self) -> None:
        """The autopilot flies another mode than before."""
        if self._aircraft.custom_mode != self._aircraft.vehicle.guided:
            self._kept_radius_m, self._kept_mps, self._kept_aim = 0.0, None, None

    def target(self, aim: Aim, station: int, now: float) -> bool:
        """Whether the commander's stream of targets may lead there."""
        port = self._reports.voice.ports[station]
        passes = self._rule(port, Kind.TARGET, "target", _Copy(aim), now, lambda: self._to(aim)).passes
        if passes:
            self._kept_aim = aim
        return passes

    def route(self, port: StationPort, ahead: Ahead, wish: Hashable, begun_at: float, now: float) -> Ruling:
        """What becomes of another mission; what is known of the situation is looked at in this moment. `begun_at`: when
        its upload began."""
        here = self.here(now)
        legs = () if here is None else ahead.way(self.item_in(ahead), here)
        return self._rule(port, Kind.ROUTE, "mission", _Copy(wish, begun_at=begun_at), now, lambda: legs, ahead)

    def plan(
        self, port: StationPort | None, left: Mapping[Limit, str], wish: Hashable, begun_at: float, now: float
    ) -> Ruling:
        """What becomes of a mission that was uploaded on the ground, by the rules of one in flight. `left`: the limits
        that it would leave, in words; `port`: the station that sent it, None if that is not known any more."""
        station, since = (0, now) if port is None else (port.sysid, port.heard_since(now))
        ruling = self.rules.rule(Kind.ROUTE, wish, left, station, now, heard_since=since, begun_at=begun_at)
        if port is not None and ruling.passes:
            self._tell(port, Kind.ROUTE, "mission", ruling, QUIET_S, now)
        return ruling

    def item_in(self, ahead: Ahead) -> int:
        """The item that the autopilot goes on with when it is given this plan."""
        last = ahead.route.items[-1].seq
        return self._aircraft.waypoint if 1 <= self._aircraft.waypoint <= last else 1

    def start(self, port: StationPort, wish: Hashable, repeats: bool, now: float) -> None:
        """START, or a part of it: sent again to insist it goes on without the energy, but for an internal fault there,
        which `lift` alone lifts. What it is refused for is told elsewhere (`orders.py`)."""
        left = {} if self._energy.broken else {Limit.ENERGY: self._energy.shortfall}
        since = port.heard_since(now)
        ruling = self._start_rules.rule(Kind.START, wish, left, port.sysid, now, heard_since=since, repeats=repeats)
        if ruling.outcome is Outcome.LIFTED:
            self._dispatcher.dispatch(self._energy.lift(now, now), now)
            self._reports.event_log.command_passed(port.name, "START", ruling)
        warned = self._energy.warned
        if warned and self._words.allow(port.sysid, ("START", (Limit.ENERGY,), Kind.START), now):
            self._reports.voice.say(port, f"START, warning: energy: {warned}")

    # ---- what the operator lifts ----------------------------------------------------------------------------------

    def lift(self, limit: Limit, by: str, now: float) -> None:
        """The operator of whoever commands, or of the vehicle itself, lifts a limit; `by`: who, for people."""
        self.rules.lift(limit, now)
        if limit is Limit.ENERGY:
            self._dispatcher.dispatch(self._energy.lift(now + LIFTED_S, now), now)
        self._reports.event_log.override(limit.value, by, LIFTED_S)

    def authority_moved(self) -> None:
        """Somebody else commands, or nobody."""
        self.rules.authority_moved()
        self._start_rules.authority_moved()
        self._energy.lift_no_more()

    # ---- judging --------------------------------------------------------------------------------------------------

    def _rule(
        self,
        port: StationPort,
        kind: Kind,
        word: str,
        copy: _Copy,
        now: float,
        way: Callable[[], Sequence[Leg]],
        ahead: Ahead | None = None,
        slow: str = "",
    ) -> Ruling:
        """`slow`: it is known already what it would leave, the energy."""
        limits = self.rules.looks_at(kind)
        if not limits or (self.here(now) is None and kind is not Kind.UNKNOWN):
            return _NOT_JUDGED
        if not self._purse.take(now):
            self.rules.came(kind, copy.wish, port.sysid, now)
            return Ruling(Outcome.REFUSED, (), "too many commands at once")
        try:
            left: Mapping[Limit, str] = {Limit.ENERGY: slow}
            if not slow:
                left = self._left(kind, way, limits, ahead or self.ahead, now)
            if kind is Kind.UNKNOWN and self.ahead is not None:
                left = _UNKNOWN_WAY
            ruling = self.rules.rule(
                kind,
                copy.wish,
                left,
                port.sysid,
                now,
                heard_since=port.heard_since(now),
                repeats=copy.repeats,
                quiet_s=copy.quiet_s,
                begun_at=copy.begun_at,
            )
        except Exception:
            self._broke()
            return Ruling(Outcome.REFUSED, (), _CANNOT)
        self._tell(port, kind, word, ruling, copy.quiet_s, now)
        return ruling

    def _broke(self) -> None:
        self._reports.fault("judging a command", traceback.format_exc(limit=-3))

    def _left(
        self, kind: Kind, way: Callable[[], Sequence[Leg]], limits: Sequence[Limit], ahead: Ahead | None, now: float
    ) -> dict[Limit, str]:
        """What a way would leave, of these limits, and which of them cannot be judged. If the way itself is not known
        because of a fault, that is one refusal, not one of each limit."""
        try:
            legs = way()
            ceiling_m = (
                fence_limits(self._aircraft).ceiling_m if kind in _GUIDED and self._aircraft.kind.winged else None
            )
        except Exception:
            self._broke()
            strict = [limit for limit in limits if self.rules.policy(limit) == "refuse"] or limits
            return {strict[0]: f"{strict[0].value} {_CANNOT}"}
        if not legs or ahead is None:
            return {}
        look: dict[Limit, Callable[[], str]] = {
            Limit.ENERGY: lambda: self._energy_short(legs, ahead),
            Limit.FENCE: lambda: leaves_fence(legs, ahead.fence, ceiling_m),
            Limit.COVERAGE: lambda: leaves_coverage(legs, ahead.finder, self._usable(now), ahead.gaps),
        }
        left: dict[Limit, str] = {}
        for limit in limits:
            try:
                left[limit] = look[limit]()
            except Exception:
                self._broke()
                left[limit] = f"{limit.value} {_CANNOT}"
        return left

    def _energy_short(self, legs: Sequence[Leg], ahead: Ahead) -> str:
        """What is in reach with the reserve comes before what is covered (`core/safety/return_site.py`): so a way is
        too long where not even the place that costs least from its end is in reach, of those inside the fence."""
        fact, places = self._energy.fact, self._candidates.inside_fence()
        if fact.left_wh is None and FAULT in (fact.missing, *fact.trouble):
            return f"{Limit.ENERGY.value} {_CANNOT}"
        # on the ground START asks for it; in the air it was granted
        if fact.model is None or fact.left_wh is None or places is None:
            return ""
        if not places and legs[-1].end[2] > 0.0:
            return "no return site is inside the fence"
        return fact.shortfall(self._need_wh(legs, places, fact.model, ahead))

    def way_on_wh(self) -> float | None:
        """What the rest of the mission needs from here, to the place that costs least from its end, with the reserve
        (Wh); None: not known, or no mission is flown."""
        fact, places, ahead, here = self._energy.fact, self._candidates.inside_fence(), self.ahead, self._aircraft.where
        if fact.model is None or places is None or ahead is None or here is None:
            return None
        if not self._aircraft.flies_mission:
            return None
        legs = ahead.way(self.item_in(ahead), here)
        if legs and not places and legs[-1].end[2] > 0.0:
            return None
        return fact.model.budget_wh(self._need_wh(legs, places, fact.model, ahead))

    def _need_wh(self, legs: Sequence[Leg], places: Sequence[Place], model: EnergyModel, ahead: Ahead) -> float:
        """Of a way, and the return from its end: a plane comes down by the landing sequences of that plan."""
        down = with_ways_down(places, ahead.route, ahead.speed_mps)
        way = pieces_along(legs, down, model, self._candidates.return_mps, released_at(ahead.route))
        return model.need_wh(way)

    def _usable(self, now: float) -> frozenset[int]:
        """The commander, and whoever could take the aircraft from it now."""
        commands, unfit = self._authority.commands, self._authority.arbiter.unfit
        return frozenset(each for each in self._reports.voice.ports if commands(each) or unfit(each, now) is None)

    def here(self, now: float) -> _Place | None:
        """Where the aircraft is: latitude, longitude, metres above home; None: nobody knows."""
        aircraft = self._aircraft
        return aircraft.where if now - aircraft.position.at < self._stale_s else None

    # ---- ways -----------------------------------------------------------------------------------------------------

    def _way(self, intent: Intent) -> Sequence[Leg]:
        """The way that a command would have the aircraft fly; none where nothing is known of it."""
        aircraft, ahead = self._aircraft, self.ahead
        if intent.kind is Kind.UNKNOWN:
            return ()
        if intent.aim is not None:
            return self._to(intent.aim)
        if intent.kind is Kind.SPEED and not aircraft.flies_mission:
            return self._on_at(intent)
        if ahead is None or aircraft.where is None or (intent.auto_only and not aircraft.flies_mission):
            return ()
        item = aircraft.waypoint if intent.item is None or intent.item < 0 else max(1, intent.item)
        legs = ahead.way(item, aircraft.where)
        speed_mps = intent.speed_mps
        if speed_mps is None:
            return legs
        if intent.speed_type not in _LEVEL:
            return ()
        return tuple(replace(leg, speed_mps=speed_mps) for leg in legs) if 0.0 < speed_mps < inf else ()

    def _on_at(self, intent: Intent) -> Sequence[Leg]:
        """The way to the target that GUIDED flies to, at another speed; none elsewhere: the autopilot refuses it."""
        aim, speed_mps = self._kept_aim, intent.speed_mps
        if aim is None or speed_mps is None or not 0.0 < speed_mps < inf or intent.speed_type not in _LEVEL:
            return ()
        return self._to(aim, speed_mps) if self._aircraft.flown is ModeClass.GUIDED else ()

    def _to(self, aim: Aim, told_mps: float | None = None) -> Sequence[Leg]:
        here = self._aircraft.where
        there = None if here is None or not aim.makes_sense else self._place_of(aim, here)
        if here is None or there is None:
            return ()
        speed_mps = told_mps or self._kept_mps or (_GUIDED_MPS if self.ahead is None else self.ahead.speed_mps)
        if not self._aircraft.kind.winged:
            return straight(here, there, speed_mps)
        if aim.here:
            return to_height(here, there[2], speed_mps)
        return (*straight(here, there, speed_mps), *around(there, self._circle_m(aim.radius_m, speed_mps), speed_mps))

    def _circle_m(self, asked_m: float, speed_mps: float) -> float:
        """The radius of the circle around a guided target, for which so much is asked; 0: nothing."""
        model, wings = self._energy.fact.model, AS_IT_COMES if self.ahead is None else self.ahead.route.wings
        wind_mps = 0.0 if model is None else model.headwind_mps if model.wind is None else model.wind.speed_mps
        told_m = asked_m or self._kept_radius_m or self._aircraft.loiter_radius_m or 0.0
        return wings.circle_radius_m(told_m, speed_mps + wind_mps)

    def _place_of(self, aim: Aim, here: _Place) -> _Place | None:
        """Where a target lies: degrees, metres above home. None: a local frame, and home is not known."""
        position = self._aircraft.position.value
        assert position is not None
        if aim.on_earth:
            home_m = (position.alt - position.relative_alt) / 1000.0 if aim.frame in _ABOVE_SEA else 0.0
            if aim.here or (aim.first == 0.0 and aim.second == 0.0):  # "where it is", to the autopilot
                return *here[:2], aim.third - home_m
            return aim.first, aim.second, aim.third - home_m
        if aim.frame in _OFFSETS:
            turn = radians(position.hdg / 100.0) if aim.frame in _TURNED and position.hdg != _UNKNOWN_HEADING else 0.0
            north, east = aim.first * cos(turn) - aim.second * sin(turn), aim.first * sin(turn) + aim.second * cos(turn)
            return *offset(*here[:2], east, north), here[2] - aim.third
        if self.ahead is None:
            return None
        home = self.ahead.route.home  # the estimator's origin is where the aircraft was switched on
        return *offset(home.lat_deg, home.lon_deg, aim.second, aim.first), -aim.third

    # ---- telling --------------------------------------------------------------------------------------------------

    def _tell(self, port: StationPort, kind: Kind, word: str, ruling: Ruling, quiet_s: float, now: float) -> None:
        if ruling.outcome is Outcome.PASSES:
            return
        entries = self._stream_entries if kind is Kind.TARGET else self._entries
        if not entries.allow(port.sysid, (kind, ruling.outcome, ruling.limits), now):
            return
        event_log, voice = self._reports.event_log, self._reports.voice
        if ruling.passes:
            event_log.command_passed(port.name, word, ruling)
        else:
            event_log.command_refused(port.name, word, ruling)
        by_hand = ruling.copy_after_s is not None and ruling.copy_after_s >= _BY_HAND_S
        cause = word, ruling.limits, kind, by_hand
        if ruling.outcome is Outcome.LIFTED or not self._words.allow(port.sysid, cause, now):
            return
        if ruling.passes:
            voice.say(port, f"{word}, warning: {ruling.words}")
            return
        again_in_s = None if kind is Kind.TARGET else quiet_s
        voice.say(port, f"{word} refused: {ruling.words}. {how_to_lift(ruling.limits[0], again_in_s)}")
