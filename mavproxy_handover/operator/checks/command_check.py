# SPDX-License-Identifier: GPL-3.0-or-later

"""The check of the commander's commands in flight: would they leave energy, fence or coverage?

The rules are in `core/safety/commands.py`, the geometry in `mission/ahead.py`. This module applies them to the state of
the aircraft.

* A command passes unjudged without a position, a mission package or a model of the energy.
* If an internal fault prevents the judgement of a limit, the limit counts as left. The policy of the limit decides, and
  the operator can lift the refusal like any other. If the rules themselves fail, the command is refused.
* A judgement takes milliseconds, and a station may send at any rate: `MOST` judgements at once, then `PER_S` a second.
  Further commands are refused without a judgement. Targets of onboard programs have a budget of their own, so that no
  program uses up the commander's.
* A fixed-wing aircraft circles at its target. The radius is that of DO_REPOSITION, which ArduPlane keeps until it
  leaves GUIDED; else WP_LOITER_RAD, or the mission's. It is never smaller than a turn (`mission/wings.py`).
* The ceiling of the autopilot's own fence is checked only for wings: a copter refuses such a target itself.
* A return keeps its speed: DO_CHANGE_SPEED is refused in every return. A command must not change a parameter of a plane
  that also applies after the mode: the least ground speed, the throttle.
* In AUTO the rest of the mission is judged at the new speed. In GUIDED the way to the target is judged, and then each
  later target. Climb and descent must not be slower than the energy rule assumes.
* The operator is told how to lift the refusal. The journal names the operator's station and the limit that was lifted.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import cos, inf, radians, sin
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

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
from mavproxy_handover.gate.refusal_text import how_to_lift
from mavproxy_handover.gate.refusals import CAUSE_S, OncePerCause, RefusalLimiter
from mavproxy_handover.mission.ahead import Ahead, around, leaves_coverage, leaves_fence, straight, to_height
from mavproxy_handover.mission.energy import Place, pieces_along, released_at, with_ways_down
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.mission.route_simulation import Leg
from mavproxy_handover.mission.wings import AS_IT_COMES
from mavproxy_handover.monitors.energy import FAULT, EnergyMonitor
from mavproxy_handover.monitors.return_site.candidates import Candidates
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.base.output_dispatcher import OutputDispatcher
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.vehicle.return_limits import fence_limits

__all__ = ["MOST", "PER_S", "CommandCheck"]

MOST: Final = 10
PER_S: Final = 5.0
#: least interval (s) of entries about one kind of command of a station; for a stream it is that of the texts
_ENTRY_S = 1.0
#: MAV_FRAMEs above sea level; local frames with their origin at the aircraft; those of them that turn with it
_ABOVE_SEA: Final = (0, 5)
_OFFSETS: Final = (7, 8, 9)
_TURNED: Final = (8, 9)
_UNKNOWN_HEADING: Final = 0xFFFF
#: speed (m/s) to a guided target, if no mission sets one
_GUIDED_MPS: Final = 10.0
#: for a command whose destination is not known
_UNKNOWN_WAY: Final = {Limit.COVERAGE: "where it leads is not known"}
#: a copy that comes this long (s) after the last one is not a program's retransmission: it is answered in words again
_BY_HAND_S: Final = 5.0
#: kinds of speed that are level (ArduCopter takes both as ground speed); the other kinds, with the energy rule's speed
_LEVEL: Final = (mavlink.SPEED_TYPE_AIRSPEED, mavlink.SPEED_TYPE_GROUNDSPEED)
_VERTICAL: Final = {
    mavlink.SPEED_TYPE_CLIMB_SPEED: CLIMB_MPS,
    mavlink.SPEED_TYPE_DESCENT_SPEED: DESCENT_MPS,
}
_COMES_HOME: Final = (ModeClass.RETURN, ModeClass.LAND)
#: within this time (s) a command reaches the autopilot, and the autopilot's mode reaches the companion
_ARRIVES_S: Final = 3.0
#: kinds of command that only GUIDED carries out
_GUIDED: Final = (Kind.FLY_TO, Kind.TARGET)

#: text for a limit that cannot be judged
_CANNOT: Final = f"cannot be judged: {FAULT}"
_Place = tuple[float, float, float]
_NOT_JUDGED: Final = Ruling(Outcome.PASSES)


@dataclass(slots=True)
class _JudgementBudget:
    """The number of judgements that may still be made, and the time of the last count (monotonic s)."""

    left: float = float(MOST)
    counted_at: float = -inf

    def use_one(self, now: float) -> bool:
        """Use one judgement; False: none is left."""
        self.left = min(float(MOST), self.left + max(0.0, now - self.counted_at) * PER_S)
        self.counted_at = now
        if self.left < 1.0:
            return False
        self.left -= 1.0
        return True


@dataclass(frozen=True, slots=True)
class _Copy:
    """One copy of a command: see `CommandRules.rule`."""

    wish: Hashable
    repeats: bool = False
    quiet_s: float = QUIET_S
    begun_at: float | None = None


class CommandCheck:
    """The check of one vehicle. Times are monotonic seconds."""

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
        #: for START: the policy of the energy decides whether it is refused, not the policy of commands in flight
        self._start_rules = CommandRules()
        #: the plan that the autopilot holds; None: not known
        self.ahead: Ahead | None = None
        self._aircraft = context.state
        self._energy = energy
        self._candidates = candidates
        self._authority = context.authority
        self._reports = context.reports
        self._dispatcher = dispatcher
        #: a position older than this (s) does not count
        self._stale_s = stale_s
        #: radius (m) that GUIDED keeps until the mode ends; 0: none was commanded
        self._kept_radius_m = 0.0
        #: speed (m/s) and target that GUIDED keeps until the mode ends; None: none was commanded
        self._kept_mps: float | None = None
        self._kept_aim: Aim | None = None
        #: when the last change of speed passed
        self._sped_at = -inf
        self._judgements = _JudgementBudget()
        self._of_programs = _JudgementBudget()
        self._entries = RefusalLimiter(1, _ENTRY_S)
        self._stream_entries = RefusalLimiter(1, CAUSE_S)
        self._words = OncePerCause()

    # ---- commands -------------------------------------------------------------------------------------------------

    def judge(self, port: StationPort, intent: Intent, now: float) -> Ruling:
        """Judge a command of the commander in flight, and tell people."""
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
        """Remember what GUIDED keeps until the mode ends."""
        if intent.aim is not None:
            self._kept_aim = intent.aim
            self._kept_radius_m = intent.aim.radius_m or self._kept_radius_m
        if intent.kind is Kind.SPEED:
            self._sped_at = now
            if self._aircraft.flown is ModeClass.GUIDED and intent.speed_type in _LEVEL:
                self._kept_mps = intent.speed_mps

    def sped_lately(self, now: float) -> bool:
        """Whether a change of speed passed just now: it may reach the autopilot in another mode."""
        return now - self._sped_at < _ARRIVES_S

    def _bars(self, intent: Intent) -> str:
        """Why a change of speed is always refused, in words; "" if it is not."""
        aircraft = self._aircraft
        if aircraft.flown in _COMES_HOME:
            return "a return keeps the speed that its energy is calculated with"
        lasting = aircraft.profile.lasting_speeds.get(intent.speed_type, "")
        return lasting or ("" if intent.throttle <= 0.0 else aircraft.profile.lasting_throttle)

    def _slow(self, intent: Intent) -> str:
        """Why a speed of climb or descent is too slow for the energy, in words; "" if it is not."""
        counted_mps = _VERTICAL.get(intent.speed_type)
        speed_mps = intent.speed_mps
        if counted_mps is None or speed_mps is None or not self._aircraft.profile.takes_vertical_speed:
            return ""
        if not 0.0 < speed_mps < counted_mps:
            return ""
        return f"slower than the {counted_mps:g} m/s that the energy is calculated with"

    def _bar(self, port: StationPort, word: str, why: str, now: float) -> Ruling:
        """Refuse a command; no operator can lift this refusal."""
        ruling = Ruling(Outcome.REFUSED, (), why)
        if self._entries.allow(port.sysid, (word, why), now):
            self._reports.event_log.command_refused(port.name, word, ruling)
            if self._words.allow(port.sysid, (word, why), now):
                self._reports.message_sender.say(port, f"{word} refused: {why}")
        return ruling

    def mode_changed(self) -> None:
        """The autopilot flies another mode than before."""
        if self._aircraft.custom_mode != self._aircraft.profile.guided:
            self._kept_radius_m, self._kept_mps, self._kept_aim = 0.0, None, None

    def target(self, aim: Aim, station: int, now: float, program: str = "") -> bool:
        """Whether a stream of targets of the commander may lead there. `program`: the name of one that it is from, by
        its delegation."""
        port = self._reports.message_sender.ports[station]
        word, budget = (f"target of {program}", self._of_programs) if program else ("target", self._judgements)
        passes = self._rule(port, Kind.TARGET, word, _Copy(aim), now, lambda: self._to(aim), budget=budget).passes
        if passes:
            self._kept_aim = aim
        return passes

    def route(self, port: StationPort, ahead: Ahead, wish: Hashable, begun_at: float, now: float) -> Ruling:
        """Judge a mission that is uploaded in flight, from where the aircraft is now. `begun_at`: when its upload
        began."""
        here = self.here(now)
        legs = () if here is None else ahead.way(self.item_in(ahead), here)
        return self._rule(port, Kind.ROUTE, "mission", _Copy(wish, begun_at=begun_at), now, lambda: legs, ahead)

    def plan(
        self, port: StationPort | None, left: Mapping[Limit, str], wish: Hashable, begun_at: float, now: float
    ) -> Ruling:
        """Judge a mission that was uploaded on the ground, by the rules for flight.

        `left`: the limits that it would leave, in words; `port`: the station that sent it, None if not known any more.
        """
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
        """START, or a part of it, was sent. If it is sent again to insist, it passes without the energy.

        Only `lift` passes an internal fault of the energy. `operator/orders.py` tells why START is refused.
        """
        left = {} if self._energy.broken else {Limit.ENERGY: self._energy.shortfall}
        since = port.heard_since(now)
        ruling = self._start_rules.rule(Kind.START, wish, left, port.sysid, now, heard_since=since, repeats=repeats)
        if ruling.outcome is Outcome.LIFTED:
            self._dispatcher.dispatch(self._energy.lift(now, now), now)
            self._reports.event_log.command_passed(port.name, "START", ruling)
        warned = self._energy.warned
        if warned and self._words.allow(port.sysid, ("START", (Limit.ENERGY,), Kind.START), now):
            self._reports.message_sender.say(port, f"START, warning: energy: {warned}")

    # ---- what the operator lifts ----------------------------------------------------------------------------------

    def lift(self, limit: Limit, by: str, now: float) -> None:
        """An operator lifts a limit, at the commander or at the vehicle's console; `by`: the name of either."""
        self.rules.lift(limit, now)
        if limit is Limit.ENERGY:
            self._dispatcher.dispatch(self._energy.lift(now + LIFTED_S, now), now)
        self._reports.event_log.override(limit.value, by, LIFTED_S)

    def authority_moved(self) -> None:
        """Another station commands, or no station."""
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
        budget: _JudgementBudget | None = None,
    ) -> Ruling:
        """Judge a command and tell people. `slow`: why it leaves the energy, if that is known already. `budget`: if it
        is not the commander's."""
        limits = self.rules.looks_at(kind)
        if not limits or (self.here(now) is None and kind is not Kind.UNKNOWN):
            return _NOT_JUDGED
        if not (budget or self._judgements).use_one(now):
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
        """The limits that a way would leave, and those that cannot be judged, in words.

        If a fault prevents that the way is known, there is one refusal, not one for each limit.
        """
        try:
            legs = way()
            passes = kind in _GUIDED and self._aircraft.profile.guided_passes_ceiling
            ceiling_m = fence_limits(self._aircraft).ceiling_m if passes else None
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
        """Why the energy is too little for a way, in words; "" if it is not.

        From the end of the way, the return site inside the fence that costs least must be in reach with the reserve.
        Reach comes before coverage (`core/safety/return_site.py`).
        """
        fact, places = self._energy.fact, self._candidates.inside_fence()
        if fact.left_wh is None and FAULT in (fact.missing, *fact.trouble):
            return f"{Limit.ENERGY.value} {_CANNOT}"
        # START checks that the energy is known
        if fact.model is None or fact.left_wh is None or places is None:
            return ""
        if not places and legs[-1].end[2] > 0.0:
            return "no return site is inside the fence"
        return fact.shortfall(self._need_wh(legs, places, fact.model, ahead))

    def way_on_wh(self) -> float | None:
        """The energy (Wh) that the rest of the mission needs from here, with the reserve.

        It includes the way from the end of the mission to the return site that costs least. None: not known, or no
        mission is flown.
        """
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
        """The energy (Wh) of a way and of the return from its end. A plane lands by the plan's landing sequences."""
        down = with_ways_down(places, ahead.route, ahead.speed_mps)
        way = pieces_along(legs, down, model, self._candidates.return_mps, released_at(ahead.route))
        return model.need_wh(way)

    def _usable(self, now: float) -> frozenset[int]:
        """The commander, and the stations that could take the aircraft from it now."""
        commands, unfit = self._authority.commands, self._authority.arbiter.unfit
        return frozenset(
            each for each in self._reports.message_sender.ports if commands(each) or unfit(each, now) is None
        )

    def here(self, now: float) -> _Place | None:
        """The position of the aircraft: latitude, longitude, metres above home; None: not known."""
        aircraft = self._aircraft
        return aircraft.where if now - aircraft.position.at < self._stale_s else None

    # ---- ways -----------------------------------------------------------------------------------------------------

    def _way(self, intent: Intent) -> Sequence[Leg]:
        """The way that the aircraft would fly by a command; empty: not known."""
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
        """The way to the target of GUIDED, at another speed; empty in other modes: the autopilot refuses the speed."""
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
        if not self._aircraft.profile.holds_by_circling:
            return straight(here, there, speed_mps)
        if aim.here:
            return to_height(here, there[2], speed_mps)
        return (*straight(here, there, speed_mps), *around(there, self._circle_m(aim.radius_m, speed_mps), speed_mps))

    def _circle_m(self, asked_m: float, speed_mps: float) -> float:
        """The radius (m) of the circle around a guided target; `asked_m`: the radius in the command, 0: none."""
        model, wings = self._energy.fact.model, AS_IT_COMES if self.ahead is None else self.ahead.route.wings
        wind_mps = 0.0 if model is None else model.headwind_mps if model.wind is None else model.wind.speed_mps
        told_m = asked_m or self._kept_radius_m or self._aircraft.loiter_radius_m or 0.0
        return wings.circle_radius_m(told_m, speed_mps + wind_mps)

    def _place_of(self, aim: Aim, here: _Place) -> _Place | None:
        """The position of a target: degrees, metres above home. None: a local frame, and home is not known."""
        position = self._aircraft.position.value
        assert position is not None
        if aim.on_earth:
            home_m = (position.alt - position.relative_alt) / 1000.0 if aim.frame in _ABOVE_SEA else 0.0
            if aim.here or (aim.first == 0.0 and aim.second == 0.0):  # the autopilot takes it as "here"
                return *here[:2], aim.third - home_m
            return aim.first, aim.second, aim.third - home_m
        if aim.frame in _OFFSETS:
            turn = radians(position.hdg / 100.0) if aim.frame in _TURNED and position.hdg != _UNKNOWN_HEADING else 0.0
            north, east = aim.first * cos(turn) - aim.second * sin(turn), aim.first * sin(turn) + aim.second * cos(turn)
            return *offset(*here[:2], east, north), here[2] - aim.third
        if self.ahead is None:
            return None
        home = self.ahead.route.home  # the estimator's origin is where the autopilot was switched on
        return *offset(home.lat_deg, home.lon_deg, aim.second, aim.first), -aim.third

    # ---- telling --------------------------------------------------------------------------------------------------

    def _tell(self, port: StationPort, kind: Kind, word: str, ruling: Ruling, quiet_s: float, now: float) -> None:
        if ruling.outcome is Outcome.PASSES:
            return
        entries = self._stream_entries if kind is Kind.TARGET else self._entries
        if not entries.allow(port.sysid, (kind, ruling.outcome, ruling.limits), now):
            return
        event_log, message_sender = self._reports.event_log, self._reports.message_sender
        if ruling.passes:
            event_log.command_passed(port.name, word, ruling)
        else:
            event_log.command_refused(port.name, word, ruling)
        by_hand = ruling.copy_after_s is not None and ruling.copy_after_s >= _BY_HAND_S
        cause = word, ruling.limits, kind, by_hand
        told = ruling.warning if ruling.passes else ruling.words  # the operator knows the limits that were lifted
        if not told or not self._words.allow(port.sysid, cause, now):
            return
        if ruling.passes:
            message_sender.say(port, f"{word}, warning: {told}")
            return
        again_in_s = None if kind is Kind.TARGET else quiet_s
        message_sender.say(port, f"{word} refused: {told}. {how_to_lift(ruling.limits[0], again_in_s)}")
