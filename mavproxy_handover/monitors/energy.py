# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot says of its batteries, the wind and its motion, made into one fact about energy each second.

The rules are in `core/safety/`: what is left, what flying costs, what is learned. Here MAVLink's units and its ways to
say "unknown" end. On the ground the way of the loaded mission is counted, and what START lacks becomes an event.
Nothing in here raises: a message that breaks something costs that message, and a second that breaks goes on from what
was known last, on the ground and in flight: by what the batteries say, else by what is drawn at the most once it is
armed. Before anything was known the energy is unknown then. START is refused for a fault, or warned of it.
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
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.core.safety.learning import Learner, Motion, thrust_direction
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["FAULT", "EnergyMonitor", "EnergyNews", "EnergyWarned", "pack_report"]

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


@dataclass(frozen=True, slots=True)
class EnergyNews:
    """What is known of energy, for people. `aloud`: something about it is odd, and that is news; `for_stations`: what
    every station is told, "" if nothing."""

    fact: EnergyFact
    aloud: bool
    for_stations: str = ""


@dataclass(frozen=True, slots=True)
class EnergyWarned:
    """A budget that does not close, where START is not refused for it; "": it closes again."""

    shortfall: str


Output = Event | EnergyNews | EnergyWarned


class _Estimate:
    """What is left and what flying costs. `settings`: the vehicle's own numbers."""

    def __init__(self, settings: EnergySettings) -> None:
        self._own = settings
        self.settings, self.wings = EnergySettings(), False
        self._learner: Learner | None = None
        self._batteries: Batteries | None = None
        #: the last report of each monitor
        self._reports: dict[int, tuple[PackReport, float]] = {}
        #: number of the item that drops the payload in the mission that the autopilot holds
        self.released_at: int | None = None
        #: what is known of energy now
        self.fact = EnergyFact(-inf, missing=settings.missing or _NOT_YET)
        self._use(settings)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def on_message(self, message: Any, now: float, on_ground: bool) -> None:
        """BATTERY_STATUS or WIND of the autopilot. `on_ground`: it is known to be disarmed."""
        kind = message.get_type()
        if kind == "WIND" and self._learner is not None:
            self._learner.wind_seen(message.speed, message.direction, now)
        elif kind == "BATTERY_STATUS":
            self._on_battery(message.id, pack_report(message), now, on_ground)

    def _on_battery(self, number: int, report: PackReport, now: float, on_ground: bool) -> None:
        self._reports[number] = report, now
        if self._batteries is not None:
            self._batteries.take(number, report, now, on_ground)

    def set_settings(self, settings: EnergySettings, now: float, *, wings: bool) -> None:
        """A mission is loaded: its numbers go before the vehicle's. `wings`: it is flown on them."""
        self._use(settings.over(self._own), wings=wings)
        for number, (report, at) in self._reports.items():
            if self._batteries is not None and now - at < _COUNT_S:
                self._batteries.take(number, report, at, True)

    @property
    def memory(self) -> tuple[PackMemory, ...]:
        """What a run after this one needs to know of the batteries; empty on the ground."""
        return () if self._batteries is None else self._batteries.memory

    def resume(self, memory: Sequence[PackMemory], now: float) -> None:
        """The run before has left this behind."""
        if self._batteries is not None:
            self._batteries.resume(memory, now)

    def _use(self, settings: EnergySettings, *, wings: bool = False) -> None:
        if (settings, wings) == (self.settings, self.wings):
            return
        self.settings, self.wings = settings, wings
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

    def weigh(self, state: VehicleState) -> None:
        """With the payload from the ground on, and without it once AUTO is past the item that drops it."""
        learner, released = self._learner, self.released_at
        if learner is None:
            return
        if not state.flying:
            learner.carry(True)
        elif released is not None and state.flies_mission and state.waypoint > released:
            learner.carry(False)

    def learn(self, state: VehicleState, now: float) -> None:
        """From how it moves, and what it draws."""
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
        """Say what is known now; `grounded`: neither armed nor about to be."""
        if self._learner is None or self._batteries is None:
            self.fact = EnergyFact(now, missing=self.settings.missing_for(wings=self.wings))
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
        """It broke: it goes on from what was known."""
        known = self.fact
        if known.model is None:
            self.fact = EnergyFact(now, missing=FAULT)
        else:
            trouble = known.trouble if FAULT in known.trouble else (*known.trouble, FAULT)
            left_wh = self._left_wh(known, known.model, now, grounded=grounded)
            self.fact = replace(known, at=now, left_wh=left_wh, trouble=trouble)

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


class _Start:
    """What START lacks of energy, on the ground, for the loaded mission."""

    def __init__(self) -> None:
        #: of the loaded mission: counts its way, at a height of return
        self._way: Callable[[float], Sequence[Piece]] | None = None
        self._counted: tuple[EnergyModel, float] | None = None
        self._counted_at = -inf
        #: "off", "warn" or "refuse"
        self.policy = ""
        self.shortfall = ""
        #: what the arbiter knows of it
        self._judged = ""
        #: the operator has lifted what START lacks until then
        self.lifted_until = -inf

    def set_way(self, way: Callable[[float], Sequence[Piece]]) -> None:
        """A mission is loaded, with this way."""
        self._way, self._counted = way, None

    def judge(self, fact: EnergyFact, now: float) -> list[Output]:
        """What START lacks, on the ground."""
        if self.policy == "off" or self._way is None or fact.model is None:
            return self.lacks("", now)
        return self.lacks(fact.shortfall(self._need_wh(fact.model, self._way, now)), now)

    def lacks(self, shortfall: str, now: float) -> list[Output]:
        """START lacks that, if nobody has lifted it: an event of what it is refused for, news of what it is warned of
        when that turns."""
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
        """What START is refused for, in words; "" where it is not."""
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
    """What people know of it."""

    def __init__(self) -> None:
        self._began_at: float | None = None
        self._known: tuple[object, ...] = ()
        self._kinds: tuple[str, ...] = ()
        #: kinds told in this flight: each once, since what comes and goes would drown what is new; the journal has all
        self._said: set[str] = set()
        self._at = -inf

    def grounded(self) -> None:
        """No flight is on: what was told in the last one may be told again."""
        self._said.clear()

    def news(self, fact: EnergyFact, flying: bool, now: float) -> list[Output]:
        """At each change of what kind of thing is known, and every few seconds in flight. What is odd is told once a
        flight; on the ground, where no station hears of it, each time that it comes."""
        self._began_at = now if self._began_at is None else self._began_at
        if fact.model is not None and fact.left_wh is None and now - self._began_at < SILENT_S:
            return []  # the streams have only just been asked for
        kinds = tuple(_kind(text) for text in fact.trouble)
        known = (fact.missing, fact.left_wh is None, fact.learned, fact.wind_source, kinds)
        heard = self._said if flying else self._kinds
        odd = any(kind not in heard for kind in kinds)  # what is left of it when a part is over is no news
        late = flying and fact.model is not None and now - self._at >= _JOURNAL_S
        if not odd and known == self._known and not late:
            return []
        self._known, self._kinds, self._at = known, kinds, now
        if not (odd and flying):
            return [EnergyNews(fact, odd)]
        self._said.update(kinds)
        return [EnergyNews(fact, odd, f"energy: {', '.join(fact.trouble)}")]


class EnergyMonitor:
    """The energy of one aircraft. `settings`: the vehicle's own numbers; `fault` is told what broke, and where. Times
    are monotonic seconds."""

    def __init__(self, settings: EnergySettings, fault: Callable[[str, str], None]) -> None:
        self._fault = fault
        self.estimate = _Estimate(settings)
        self._start = _Start()
        self._told = _Told()
        self._follow()

    @property
    def fact(self) -> EnergyFact:
        """What is known of energy now."""
        return self.estimate.fact

    @property
    def memory(self) -> tuple[PackMemory, ...]:
        """What a run after this one needs to know of the batteries; empty on the ground."""
        return self.estimate.memory

    # ---- what comes in --------------------------------------------------------------------------------------------

    def on_message(self, message: Any, now: float, on_ground: bool) -> None:
        """BATTERY_STATUS or WIND of the autopilot. `on_ground`: it is known to be disarmed."""
        try:
            self.estimate.on_message(message, now, on_ground)
        except Exception:
            self._tell_fault()

    def set_mission(
        self, settings: EnergySettings, way: Callable[[float], Sequence[Piece]], now: float, *, wings: bool = False
    ) -> list[Output]:
        """A mission is loaded: its numbers go before the vehicle's. `way`: its pieces, at a height of return; `wings`:
        it is flown on them."""
        self._start.set_way(way)
        try:
            self.estimate.set_settings(settings, now, wings=wings)
            self._follow()
            return self._start.judge(self.estimate.observe(now, grounded=True), now)
        except Exception:
            return self._broke(now, grounded=True)

    def released(self, seq: int | None) -> None:
        """The item that drops the payload in the mission that the autopilot holds; None: there is none."""
        self.estimate.released_at = seq

    def resume(self, memory: Sequence[PackMemory], now: float) -> None:
        """The run before has left this behind. To be called when the mission is known again and nothing was said."""
        self.estimate.resume(memory, now)

    def _follow(self) -> None:
        self._start.policy = self.estimate.settings.start_policy_for(wings=self.estimate.wings)

    # ---- each second ----------------------------------------------------------------------------------------------

    def update(self, state: VehicleState, now: float, *, grounded: bool) -> list[Output]:
        """Learn, and say what is known now. `grounded`: neither armed nor about to be."""
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
        """Keep to what was known before; START is refused for the fault where it is refused for energy."""
        self._tell_fault()
        self._follow()
        try:
            self.estimate.go_on(now, grounded=grounded)
        except Exception:  # what was known stays, with its time
            self._tell_fault()
        return self._start.lacks(FAULT, now) if grounded else []

    def _tell_fault(self) -> None:
        self._fault("energy", traceback.format_exc(limit=-3))

    # ---- START ----------------------------------------------------------------------------------------------------

    @property
    def shortfall(self) -> str:
        """What START is refused for, in words; "" where it is not."""
        return self._start.refused

    @property
    def warned(self) -> str:
        """The same where START is warned of it and not refused."""
        return self._start.shortfall if self._start.policy == "warn" else ""

    @property
    def broken(self) -> bool:
        """What START lacks is an internal fault: sending it again mends nothing."""
        return self._start.shortfall == FAULT

    def lift(self, until: float, now: float) -> list[Output]:
        """The operator has START go on without the energy: so long, and at this moment."""
        self._start.lifted_until = until
        return self._start.lacks("", now)

    def lift_no_more(self) -> None:
        """The station whose operator had START go on without the energy does not command any more."""
        self._start.lifted_until = -inf
