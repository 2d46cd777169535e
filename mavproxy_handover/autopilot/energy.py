# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot says of its batteries, the wind and its motion, made into one fact about energy each second.

The rules are in `core/safety/`: what is left, what flying costs, what is learned. Here MAVLink's units and its ways to
say "unknown" end. On the ground the way of the loaded mission is counted, and the arbiter is told what START lacks.
Nothing in here raises: a message that breaks something costs that message, and a second that breaks goes on from what
was known last, on the ground and in flight: by what the batteries say, else by what is drawn at the most once it is
armed. Before anything was known the energy is unknown then. START is refused for a fault, or warned of it.
"""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from typing import Any, Final

from mavproxy_handover.autopilot.ties import Ties
from mavproxy_handover.core.events import EnergyJudged
from mavproxy_handover.core.safety.battery import SILENT_S, Batteries, Charge, PackMemory, PackReport
from mavproxy_handover.core.safety.energy import EnergyFact, EnergyModel, Piece
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.core.safety.learning import Learner, Motion, thrust_direction
from mavproxy_handover.schedule import attempt
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["FAULT", "EnergyWatch", "pack_report"]

#: journalled this often in flight
_JOURNAL_S: Final = 10.0
#: older attitudes and positions teach nothing
_FRESH_S: Final = 1.5
#: the need of a mission is counted again this often at most
_COUNT_S: Final = 5.0
#: more than the motors can ever draw, in powers of hover
_MOST_HOVER: Final = 10.0
_UNKNOWN_MV: Final = 0xFFFF
_JOULES_A_HECTOJOULE, _JOULES_A_WH = 100.0, 3600.0
#: START is refused for it, and that is not lifted by sending it again
FAULT: Final = "internal fault"
_NOT_YET: Final = "not looked at yet"
#: figures of a text, which change while its kind does not; the number behind the word is the battery's name
_FIGURES: Final = re.compile(r"(battery \d+)|[\d.]+")


def _kind(trouble: str) -> str:
    """What is odd, and of which battery, without its figures."""
    return _FIGURES.sub(r"\1", trouble)


def pack_report(m: Any) -> PackReport:
    """A BATTERY_STATUS in the units of the rules. -1 and 65535 are MAVLink's words for unknown."""
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


class EnergyWatch:
    """The energy of one aircraft. `settings`: the vehicle's own numbers. Times are monotonic seconds."""

    def __init__(self, settings: EnergySettings, ties: Ties) -> None:
        self._own = settings
        self._ties = ties
        self._settings, self._wings = EnergySettings(), False
        self._learner: Learner | None = None
        self._batteries: Batteries | None = None
        #: the last report of each monitor
        self._reports: dict[int, tuple[PackReport, float]] = {}
        #: of the loaded mission: counts its way, at a height of return
        self._way: Callable[[float], Sequence[Piece]] | None = None
        self._counted: tuple[EnergyModel, float] | None = None
        self._counted_at = -inf
        #: number of the item that drops the payload in the mission that the autopilot holds
        self.released_at: int | None = None
        self._shortfall = ""
        #: what the arbiter knows of it
        self._judged = ""
        self._began_at: float | None = None
        self._told: tuple[object, ...] = ()
        self._told_kinds: tuple[str, ...] = ()
        #: kinds told in this flight: each once, since what comes and goes would drown what is new; the journal has all
        self._said: set[str] = set()
        self._told_at = -inf
        #: the operator has lifted what START lacks until then
        self._lifted_until = -inf
        #: what is known of energy now
        self.fact = EnergyFact(-inf, missing=settings.missing or _NOT_YET)
        self._adopt(settings)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def take(self, message: Any, now: float, on_ground: bool) -> None:
        """BATTERY_STATUS or WIND of the autopilot. `on_ground`: it is known to be disarmed."""
        try:
            kind = message.get_type()
            if kind == "WIND" and self._learner is not None:
                self._learner.wind_seen(message.speed, message.direction, now)
            elif kind == "BATTERY_STATUS":
                self._on_battery(message.id, pack_report(message), now, on_ground)
        except Exception:
            self._ties.fault("energy", traceback.format_exc(limit=-3))

    def _on_battery(self, number: int, report: PackReport, now: float, on_ground: bool) -> None:
        self._reports[number] = report, now
        if self._batteries is not None:
            self._batteries.take(number, report, now, on_ground)

    def adopt(
        self, settings: EnergySettings, way: Callable[[float], Sequence[Piece]], now: float, *, wings: bool = False
    ) -> None:
        """A mission is loaded: its numbers go before the vehicle's. `way`: its pieces, at a height of return; `wings`:
        it is flown on them."""
        self._way, self._counted = way, None
        try:
            self._adopt(settings.over(self._own), wings=wings)
            for number, (report, at) in self._reports.items():
                if self._batteries is not None and now - at < _COUNT_S:
                    self._batteries.take(number, report, at, True)
            self._judge(self._observe(now, grounded=True), now)
        except Exception:
            self._broke(now, grounded=True)

    @property
    def memory(self) -> tuple[PackMemory, ...]:
        """What a run after this one needs to know of the batteries; empty on the ground."""
        return () if self._batteries is None else self._batteries.memory

    def resume(self, memory: Sequence[PackMemory], now: float) -> None:
        """The run before has left this behind. To be called when the mission is known again and nothing was said."""
        if self._batteries is not None:
            self._batteries.resume(memory, now)

    def _adopt(self, settings: EnergySettings, *, wings: bool = False) -> None:
        if (settings, wings) == (self._settings, self._wings):
            return
        self._settings, self._wings = settings, wings
        # what was known was by other numbers
        self.fact = EnergyFact(-inf, missing=settings.missing_for(wings=wings) or _NOT_YET)
        prior = settings.model(wings=wings)
        if prior is None:
            self._learner = self._batteries = None
            return
        self._learner = Learner(settings, wings=wings)
        flies_w = max(prior.hover_w, prior.cruise_w)
        most_w = _MOST_HOVER * max(flies_w, prior.climb_w)
        self._batteries = Batteries(prior.battery_wh, int(settings.batteries or 1), settings.cells, most_w, flies_w)

    # ---- each second ----------------------------------------------------------------------------------------------

    def each_second(self, aircraft: VehicleState, grounded: bool, now: float) -> None:
        """Learn, and say what is known now. `grounded`: neither armed nor about to be."""
        if grounded:
            self._said.clear()
        try:
            self._weigh(aircraft)
            self._learn(aircraft, now)
            fact = self._observe(now, grounded=grounded)
            if grounded:
                self._judge(fact, now)
            self._tell(fact, aircraft.flying, now)
        except Exception:
            self._broke(now, grounded=grounded)

    def _broke(self, now: float, *, grounded: bool) -> None:
        """It goes on from what was known; START is told of the fault."""
        self._ties.fault("energy", traceback.format_exc(limit=-3))
        known = self.fact
        if known.model is None:
            self.fact = EnergyFact(now, missing=FAULT)
        else:
            trouble = known.trouble if FAULT in known.trouble else (*known.trouble, FAULT)
            left_wh = self._left_wh(known, known.model, now, grounded=grounded)
            self.fact = replace(known, at=now, left_wh=left_wh, trouble=trouble)
        if grounded:
            attempt(self._ties.fault, "energy", self._lacks, FAULT, now)

    def _left_wh(self, known: EnergyFact, model: EnergyModel, now: float, *, grounded: bool) -> float | None:
        """By the batteries, if these still count; else by what was drawn since, at the most; on the ground nothing."""
        try:
            counted = None if self._batteries is None else self._batteries.charge(now, on_ground=grounded).left_wh
        except Exception:  # it has been told, or the same thing has
            counted = None
        if counted is not None or known.left_wh is None or grounded:
            return known.left_wh if counted is None else counted
        drawn_w = max(model.hover_w, model.cruise_w, known.power_w or 0.0)
        return max(0.0, known.left_wh - drawn_w * max(0.0, now - known.at) / _JOULES_A_WH)

    def _weigh(self, aircraft: VehicleState) -> None:
        """With the payload from the ground on, and without it once AUTO is past the item that drops it."""
        learner, released = self._learner, self.released_at
        if learner is None:
            return
        if not aircraft.flying:
            learner.carry(True)
        elif released is not None and aircraft.flies_mission and aircraft.waypoint > released:
            learner.carry(False)

    def _learn(self, aircraft: VehicleState, now: float) -> None:
        position, attitude = aircraft.telemetry.own_position.value, aircraft.telemetry.attitude
        if self._learner is None or self._batteries is None or position is None:
            return
        message = attitude.value
        if (
            message is None
            or not aircraft.flying
            or now - attitude.at > _FRESH_S
            or now - aircraft.telemetry.own_position.at > _FRESH_S
        ):
            return
        lean, towards = thrust_direction(message.roll, message.pitch, message.yaw)
        speeds = (position.vx / 100.0, position.vy / 100.0, -position.vz / 100.0)
        self._learner.fly(Motion(*speeds, lean, towards, self._batteries.charge(now).power_w), now)

    def _observe(self, now: float, *, grounded: bool) -> EnergyFact:
        if self._learner is None or self._batteries is None:
            self.fact = EnergyFact(now, missing=self._settings.missing_for(wings=self._wings))
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

    # ---- START ----------------------------------------------------------------------------------------------------

    def _judge(self, fact: EnergyFact, now: float) -> None:
        """What START lacks, on the ground."""
        if self._policy == "off" or self._way is None or fact.model is None:
            self._lacks("", now)
        else:
            self._lacks(fact.shortfall(self._need_wh(fact.model, self._way, now)), now)

    def _lacks(self, shortfall: str, now: float) -> None:
        """START lacks that, if nobody has lifted it: the arbiter is told what it refuses, people what it warns of when
        that turns."""
        lifted = self._policy == "off" or now < self._lifted_until
        before, self._shortfall = self._shortfall, "" if lifted else shortfall
        if self._judged != self.shortfall:
            self._judged = self.shortfall
            self._ties.handle(EnergyJudged(self._judged), now)
        if self._policy == "warn" and not lifted and bool(before) != bool(shortfall):
            self._ties.narrator.energy_warning(shortfall)

    @property
    def _policy(self) -> str:
        return self._settings.start_policy_for(wings=self._wings)

    @property
    def shortfall(self) -> str:
        """What START is refused for, in words; "" where it is not."""
        return self._shortfall if self._policy == "refuse" else ""

    @property
    def warned(self) -> str:
        """The same where START is warned of it and not refused."""
        return self._shortfall if self._policy == "warn" else ""

    @property
    def broken(self) -> bool:
        """What START lacks is an internal fault: sending it again mends nothing."""
        return self._shortfall == FAULT

    def lift(self, until: float, now: float) -> None:
        """The operator has START go on without the energy: so long, and at this moment."""
        self._lifted_until = until
        self._lacks("", now)

    def lift_no_more(self) -> None:
        """Whoever has lifted it commands no more."""
        self._lifted_until = -inf

    def _need_wh(self, model: EnergyModel, way: Callable[[float], Sequence[Piece]], now: float) -> float:
        if self._counted is not None:
            counted, need = self._counted
            if model == counted or now - self._counted_at < _COUNT_S:
                return need
        need = model.need_wh(way(model.return_alt_m))
        self._counted, self._counted_at = (model, need), now
        return need

    # ---- what people read -----------------------------------------------------------------------------------------

    def _tell(self, fact: EnergyFact, flying: bool, now: float) -> None:
        """At each change of what kind of thing is known, and every few seconds in flight. What is odd is told once a
        flight; on the ground, where no station hears of it, each time that it comes."""
        self._began_at = now if self._began_at is None else self._began_at
        if fact.model is not None and fact.left_wh is None and now - self._began_at < SILENT_S:
            return  # the streams have only just been asked for
        kinds = tuple(_kind(text) for text in fact.trouble)
        known = (fact.missing, fact.left_wh is None, fact.learned, fact.wind_source, kinds)
        heard = self._said if flying else self._told_kinds
        odd = any(kind not in heard for kind in kinds)  # what is left of it when a part is over is no news
        if odd or known != self._told or (flying and fact.model is not None and now - self._told_at >= _JOURNAL_S):
            self._told, self._told_kinds, self._told_at = known, kinds, now
            self._ties.narrator.energy(fact, aloud=odd)
            if odd and flying:
                self._said.update(kinds)
                self._ties.voice.say_to_all(f"energy: {', '.join(fact.trouble)}")
