# SPDX-License-Identifier: GPL-3.0-or-later

"""The energy monitor: makes one energy fact each second from batteries, wind and motion.

The rules are in `core/safety/`: energy left, cost of flight, learning. This module converts MAVLink's units and its
values for unknown. On the ground it counts the need of the loaded mission, and what START lacks becomes an event.

Nothing in here raises. A message that causes a fault is lost. If the work of a second fails, the last fact continues:
from the batteries' reports, or else, once armed, from the greatest power draw. If there was no fact yet, the energy is
unknown. For a fault START is refused, or warned of, as the policy says.
"""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Final

from mavproxy_handover.core.common.events import EnergyJudged, Event
from mavproxy_handover.core.common.snapshot import PackMemory
from mavproxy_handover.core.safety.battery import SILENT_S, Batteries, Charge, PackReport
from mavproxy_handover.core.safety.energy import EnergyFact, EnergyModel, Piece
from mavproxy_handover.core.safety.energy_prior import ON_ROTORS, EnergyPrior, EnergySettings
from mavproxy_handover.core.safety.learning import Learner, Motion, thrust_direction
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["FAULT", "EnergyMonitor", "EnergyNews", "EnergyWarned", "pack_report"]

#: interval of the journal entries in flight (s)
_JOURNAL_S: Final = 10.0
#: the monitor does not learn from older attitudes and positions (s)
_FRESH_S: Final = 1.5
#: least interval between two counts of a mission's need (s)
_COUNT_S: Final = 5.0
#: more than the motors can ever draw, as a multiple of the greatest of hover, cruise and climb power
_MOST_HOVER: Final = 10.0
_UNKNOWN_MV: Final = 0xFFFF
_JOULES_A_HECTOJOULE, _JOULES_A_WH = 100.0, 3600.0
#: a reason to refuse START that is not lifted by sending START again
FAULT: Final = "internal fault"
_NOT_YET: Final = "not looked at yet"
#: figures of a text, which change while its kind stays the same; the number after "battery" is its name
_FIGURES: Final = re.compile(r"(battery \d+)|[\d.]+")


def _kind(trouble: str) -> str:
    """The kind of a trouble: its text without figures, with the battery."""
    return _FIGURES.sub(r"\1", trouble)


def pack_report(m: Any) -> PackReport:
    """A BATTERY_STATUS in the units of the rules. -1 and 65535 are MAVLink's values for unknown."""
    cells_mv = [mv for mv in m.voltages if mv != _UNKNOWN_MV]
    cells_mv += [mv for mv in getattr(m, "voltages_ext", ()) if mv != _UNKNOWN_MV]
    volts = sum(cells_mv) / 1000.0

    def known(value: int, scale: float) -> float | None:
        return value * scale if value >= 0 else None

    return PackReport(
        used_wh=known(m.energy_consumed, _JOULES_A_HECTOJOULE / _JOULES_A_WH),
        used_mah=known(m.current_consumed, 1.0),
        remaining=known(m.battery_remaining, 0.01),
        voltage_v=volts if volts > 0.0 else None,
        current_a=known(m.current_battery, 0.01),
    )


@dataclass(frozen=True, slots=True)
class EnergyNews:
    """The energy fact, for people. `aloud`: it has a new trouble; `for_stations`: text to every station, "" if none."""

    fact: EnergyFact
    aloud: bool
    for_stations: str = ""


@dataclass(frozen=True, slots=True)
class EnergyWarned:
    """The energy is too little for the mission, and START only warns of it; "": it is enough again."""

    shortfall: str


Output = Event | EnergyNews | EnergyWarned


class _Estimate:
    """The estimate of the energy left and of the cost of flight. `settings`: the vehicle's own settings."""

    def __init__(self, settings: EnergySettings) -> None:
        self._own = settings
        self.settings, self.prior = EnergySettings(), ON_ROTORS
        self._learner: Learner | None = None
        self._batteries: Batteries | None = None
        #: the last report of each monitor
        self._reports: dict[int, tuple[PackReport, float]] = {}
        #: number of the item that drops the payload in the mission that the autopilot holds
        self.released_at: int | None = None
        #: the current energy fact
        self.fact = EnergyFact(-inf, missing=settings.missing or _NOT_YET)
        self._use(settings)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def on_message(self, message: Any, now: float, on_ground: bool) -> None:
        """A BATTERY_STATUS or WIND of the autopilot. `on_ground`: it is known to be disarmed."""
        kind = message.get_type()
        if kind == "WIND" and self._learner is not None:
            self._learner.wind_seen(message.speed, message.direction, now)
        elif kind == "BATTERY_STATUS":
            self._on_battery(message.id, pack_report(message), now, on_ground)

    def _on_battery(self, number: int, report: PackReport, now: float, on_ground: bool) -> None:
        self._reports[number] = report, now
        if self._batteries is not None:
            self._batteries.add_report(number, report, now, on_ground)

    def apply_settings(self, settings: EnergySettings, now: float, prior: EnergyPrior) -> None:
        """A mission is loaded: its numbers go before the vehicle's. `prior`: what counts where both say nothing."""
        self._use(settings.over(self._own), prior)
        for number, (report, at) in self._reports.items():
            if self._batteries is not None and now - at < _COUNT_S:
                self._batteries.add_report(number, report, at, True)

    @property
    def memory(self) -> tuple[PackMemory, ...]:
        """The state of the batteries that a restart needs; empty on the ground."""
        return () if self._batteries is None else self._batteries.memory

    def resume(self, memory: Sequence[PackMemory], now: float) -> None:
        """Continue with the batteries' state of the previous run."""
        if self._batteries is not None:
            self._batteries.resume(memory, now)

    def _use(self, settings: EnergySettings, prior: EnergyPrior = ON_ROTORS) -> None:
        if (settings, prior) == (self.settings, self.prior):
            return
        self.settings, self.prior = settings, prior
        # what was known was by other numbers
        self.fact = EnergyFact(-inf, missing=settings.missing_for(prior) or _NOT_YET)
        model = settings.model(prior=prior)
        if model is None:
            self._learner = self._batteries = None
            return
        self._learner = Learner(settings, prior)
        flies_w = max(model.hover_w, model.cruise_w)
        most_w = _MOST_HOVER * max(flies_w, model.climb_w)
        self._batteries = Batteries(model.battery_wh, int(settings.batteries or 1), settings.cells, most_w, flies_w)

    # ---- each second ----------------------------------------------------------------------------------------------

    def weigh(self, state: VehicleState) -> None:
        """Count the payload from the ground on, until AUTO is past the item that drops it."""
        learner, released = self._learner, self.released_at
        if learner is None:
            return
        if not state.flying:
            learner.carry(True)
        elif released is not None and state.flies_mission and state.waypoint > released:
            learner.carry(False)

    def learn(self, state: VehicleState, now: float) -> None:
        """Learn from motion and power draw."""
        position, attitude = state.telemetry.own_position.value, state.telemetry.attitude
        if self._learner is None or self._batteries is None or position is None:
            return
        message = attitude.value
        if (
            message is None
            or not state.flying
            or now - attitude.at > _FRESH_S
            or now - state.telemetry.own_position.at > _FRESH_S
        ):
            return
        lean, towards = thrust_direction(message.roll, message.pitch, message.yaw)
        speeds = (position.vx / 100.0, position.vy / 100.0, -position.vz / 100.0)
        self._learner.fly(Motion(*speeds, lean, towards, self._batteries.charge(now).power_w), now)

    def observe(self, now: float, *, grounded: bool) -> EnergyFact:
        """Make the current fact. `grounded`: neither armed nor about to be."""
        if self._learner is None or self._batteries is None:
            self.fact = EnergyFact(now, missing=self.settings.missing_for(self.prior))
            return self.fact
        charge: Charge = self._batteries.charge(now, on_ground=grounded)
        model, source = self._learner.model(now)
        self.fact = EnergyFact(
            at=now,
            left_wh=charge.left_wh,
            power_w=charge.power_w,
            model=model,
            wind_source=source,
            learned=self._learner.learned,
            trouble=charge.trouble,
        )
        return self.fact

    def go_on(self, now: float, *, grounded: bool) -> None:
        """Continue from the last fact after a fault."""
        known = self.fact
        if known.model is None:
            self.fact = EnergyFact(now, missing=FAULT)
        else:
            trouble = known.trouble if FAULT in known.trouble else (*known.trouble, FAULT)
            left_wh = self._left_wh(known, known.model, now, grounded=grounded)
            self.fact = replace(known, at=now, left_wh=left_wh, trouble=trouble)

    def _left_wh(self, known: EnergyFact, model: EnergyModel, now: float, *, grounded: bool) -> float | None:
        """The energy left (Wh): by the batteries, else the last value less the greatest draw since."""
        try:
            counted = None if self._batteries is None else self._batteries.charge(now, on_ground=grounded).left_wh
        except Exception:  # the fault was reported already
            counted = None
        if counted is not None or known.left_wh is None or grounded:
            return known.left_wh if counted is None else counted
        drawn_w = max(model.hover_w, model.cruise_w, known.power_w or 0.0)
        return max(0.0, known.left_wh - drawn_w * max(0.0, now - known.at) / _JOULES_A_WH)


class _Start:
    """The energy that START lacks on the ground, for the loaded mission."""

    def __init__(self) -> None:
        #: returns the pieces of the loaded mission, for a height of return
        self._way: Callable[[float], Sequence[Piece]] | None = None
        self._counted: tuple[EnergyModel, float] | None = None
        self._counted_at = -inf
        #: "off", "warn" or "refuse"
        self.policy = ""
        self.shortfall = ""
        #: the last shortfall that the arbiter was told
        self._judged = ""
        #: until then the operator has lifted the shortfall
        self.lifted_until = -inf

    def set_way(self, way: Callable[[float], Sequence[Piece]]) -> None:
        """Set the way of the loaded mission."""
        self._way, self._counted = way, None

    def judge(self, fact: EnergyFact, now: float) -> list[Output]:
        """Judge what START lacks, on the ground."""
        if self.policy == "off" or self._way is None or fact.model is None:
            return self.lacks("", now)
        return self.lacks(fact.shortfall(self._need_wh(fact.model, self._way, now)), now)

    def lacks(self, shortfall: str, now: float) -> list[Output]:
        """Set what START lacks, unless an operator has lifted it.

        Returns an event when the reason of a refusal changes, and news when a warning begins or ends.
        """
        found: list[Output] = []
        lifted = self.policy == "off" or now < self.lifted_until
        before, self.shortfall = self.shortfall, "" if lifted else shortfall
        if self._judged != self.refused:
            self._judged = self.refused
            found.append(EnergyJudged(self._judged))
        if self.policy == "warn" and not lifted and bool(before) != bool(shortfall):
            found.append(EnergyWarned(shortfall))
        return found

    @property
    def refused(self) -> str:
        """Why START is refused, in words; "" if it is not."""
        return self.shortfall if self.policy == "refuse" else ""

    def _need_wh(self, model: EnergyModel, way: Callable[[float], Sequence[Piece]], now: float) -> float:
        if self._counted is not None:
            counted, need = self._counted
            if model == counted or now - self._counted_at < _COUNT_S:
                return need
        need = model.need_wh(way(model.return_alt_m))
        self._counted, self._counted_at = (model, need), now
        return need


class _Told:
    """Decides which energy facts people are told."""

    def __init__(self) -> None:
        self._began_at: float | None = None
        self._known: tuple[object, ...] = ()
        self._kinds: tuple[str, ...] = ()
        #: kinds of trouble told in this flight, each once; the journal has all
        self._said: set[str] = set()
        self._at = -inf

    def grounded(self) -> None:
        """The aircraft is on the ground: each kind of trouble may be told again."""
        self._said.clear()

    def news(self, fact: EnergyFact, flying: bool, now: float) -> list[Output]:
        """News at each change of the kind of information, and every `_JOURNAL_S` in flight.

        A trouble is told once a flight. On the ground it is told each time that it comes, but not to the stations.
        """
        self._began_at = now if self._began_at is None else self._began_at
        if fact.model is not None and fact.left_wh is None and now - self._began_at < SILENT_S:
            return []  # the streams were requested just now
        kinds = tuple(_kind(text) for text in fact.trouble)
        known = (fact.missing, fact.left_wh is None, fact.learned, fact.wind_source, kinds)
        heard = self._said if flying else self._kinds
        odd = any(kind not in heard for kind in kinds)  # the end of one trouble is no reason to repeat the others
        late = flying and fact.model is not None and now - self._at >= _JOURNAL_S
        if not odd and known == self._known and not late:
            return []
        self._known, self._kinds, self._at = known, kinds, now
        if not (odd and flying):
            return [EnergyNews(fact, odd)]
        self._said.update(kinds)
        return [EnergyNews(fact, odd, f"energy: {', '.join(fact.trouble)}")]


class EnergyMonitor:
    """The energy of one aircraft. `settings`: the vehicle's own settings; `fault` takes the place and the text of a
    fault. Times are monotonic seconds."""

    def __init__(self, settings: EnergySettings, fault: Callable[[str, str], None]) -> None:
        self._fault = fault
        self.estimate = _Estimate(settings)
        self._start = _Start()
        self._told = _Told()
        self._follow()

    @property
    def fact(self) -> EnergyFact:
        """The current energy fact."""
        return self.estimate.fact

    @property
    def memory(self) -> tuple[PackMemory, ...]:
        """The state of the batteries that a restart needs; empty on the ground."""
        return self.estimate.memory

    # ---- messages and missions ------------------------------------------------------------------------------------

    def on_message(self, message: Any, now: float, on_ground: bool) -> None:
        """A BATTERY_STATUS or WIND of the autopilot. `on_ground`: it is known to be disarmed."""
        try:
            self.estimate.on_message(message, now, on_ground)
        except Exception:
            self._tell_fault()

    def apply_settings(
        self, settings: EnergySettings, way: Callable[[float], Sequence[Piece]], now: float, prior: EnergyPrior
    ) -> list[Output]:
        """A mission is loaded: its numbers go before the vehicle's. `way`: its pieces, at a height of return; `prior`:
        what counts where both say nothing."""
        self._start.set_way(way)
        try:
            self.estimate.apply_settings(settings, now, prior)
            self._follow()
            return self._start.judge(self.estimate.observe(now, grounded=True), now)
        except Exception:
            return self._broke(now, grounded=True)

    def released(self, seq: int | None) -> None:
        """Set the item that drops the payload in the autopilot's mission; None: there is none."""
        self.estimate.released_at = seq

    def resume(self, memory: Sequence[PackMemory], now: float) -> None:
        """Continue with the batteries' state of the previous run.

        To be called when the mission is known again, before the first message.
        """
        self.estimate.resume(memory, now)

    def _follow(self) -> None:
        self._start.policy = self.estimate.settings.start_policy_for(self.estimate.prior)

    # ---- each second ----------------------------------------------------------------------------------------------

    def update(self, state: VehicleState, now: float, *, grounded: bool) -> list[Output]:
        """Learn, and make the current fact. `grounded`: neither armed nor about to be."""
        if grounded:
            self._told.grounded()
        found: list[Output] = []
        try:
            self.estimate.weigh(state)
            self.estimate.learn(state, now)
            fact = self.estimate.observe(now, grounded=grounded)
            if grounded:
                found += self._start.judge(fact, now)
            found += self._told.news(fact, state.flying, now)
        except Exception:
            found += self._broke(now, grounded=grounded)
        return found

    def _broke(self, now: float, *, grounded: bool) -> list[Output]:
        """Continue from the last fact after a fault. START is refused for the fault if it is refused for energy."""
        self._tell_fault()
        self._follow()
        try:
            self.estimate.go_on(now, grounded=grounded)
        except Exception:  # the last fact stays, with its time
            self._tell_fault()
        return self._start.lacks(FAULT, now) if grounded else []

    def _tell_fault(self) -> None:
        self._fault("energy", traceback.format_exc(limit=-3))

    # ---- START ----------------------------------------------------------------------------------------------------

    @property
    def shortfall(self) -> str:
        """Why START is refused, in words; "" if it is not."""
        return self._start.refused

    @property
    def warned(self) -> str:
        """The shortfall, if START only warns of it; else ""."""
        return self._start.shortfall if self._start.policy == "warn" else ""

    @property
    def broken(self) -> bool:
        """START lacks the energy because of an internal fault: sending it again does not help."""
        return self._start.shortfall == FAULT

    def lift(self, until: float, now: float) -> list[Output]:
        """The operator lets START pass without the energy, from now until `until` (monotonic s)."""
        self._start.lifted_until = until
        return self._start.lacks("", now)

    def lift_no_more(self) -> None:
        """The station whose operator has lifted the shortfall no longer commands."""
        self._start.lifted_until = -inf
