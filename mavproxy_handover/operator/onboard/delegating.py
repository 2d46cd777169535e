# SPDX-License-Identifier: GPL-3.0-or-later

"""Delegates guided targets to an onboard program, and stops the aircraft when that is over.

The rules are in `core/authority/delegation.py`. This part reads the facts, notes which GUIDED the commander has
ordered, and does what follows at the end, in this order:

1. A velocity of zero goes to the autopilot, so that no stream goes on. It goes before the command that ended it.
2. A hold is ordered, and confirmed by the mode; not if a command or a decision leads the aircraft elsewhere.
3. The commander and the program are told that the delegation is over, and why. Later the commander is told whether the
   hold is confirmed.

Each step is for itself: a fault in one costs neither the hold nor the command that ended the delegation.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.authority.delegation import Delegation, End, GuidedFacts, Over
from mavproxy_handover.core.common.model import FlightAction, ModeClass
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.intent import TARGET_MESSAGES
from mavproxy_handover.gate.judge import Fate, Verdict
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.payload import payload_kind
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.operator.onboard.port import OnboardPort
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.vehicle import mode_requests
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID

__all__ = ["Delegating", "DelegationParts"]

#: constants, because Python 3.11 takes 0.1 us to look up a member of an enumeration
_STREAM: Final = Access.STREAM
_PASSES: Final = (Fate.FORWARD, Fate.CONSUME)
#: a mode that was ordered shows within this time (s)
_SHOWS_S: Final = 3.0
#: only the velocity counts: place, acceleration, yaw and yaw rate are ignored
_ONLY_VELOCITY: Final = 0b1101_1100_0111


@dataclass(frozen=True, slots=True)
class DelegationParts:
    """The parts of one vehicle that a delegation needs."""

    in_force: AuthorityInForce
    aircraft: VehicleState
    #: stops the aircraft where it is, and tells why that was not confirmed, "" if it was
    stand: Callable[[Callable[[str], None], float], None]
    #: no longer repeats that
    give_stand_up: Callable[[], None]
    #: the decision in force; None: nothing more than a warning
    decision: Callable[[], FlightAction | None]
    reports: Reports


class Delegating:
    """Of vehicle `vehicle` (system id). Times are monotonic seconds."""

    def __init__(
        self,
        vehicle: int,
        programs: Mapping[str, OnboardPort],
        parts: DelegationParts,
        to_autopilot: Callable[[bytes], None],
    ) -> None:
        """`programs`: those that have the right `guided`, by name. `to_autopilot` takes whole frames."""
        self._vehicle = vehicle
        self._programs = programs
        self._parts = parts
        self._to_autopilot = to_autopilot
        self._rules = Delegation()
        #: the commander that ordered GUIDED, and when
        self._ordered: tuple[int, float] | None = None
        #: whether the first mode that the autopilot has shown was looked at
        self._mode_seen = False
        self._own = mavlink.MAVLink(None, srcSystem=vehicle, srcComponent=mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)

    @property
    def program(self) -> str:
        """The program that targets are delegated to; "" if there is none."""
        return self._rules.program

    @property
    def possible(self) -> bool:
        """Whether any program has the right to guided targets."""
        return bool(self._programs)

    # ---- by the commander's operator ------------------------------------------------------------------------------

    def give(self, station: int, name: str, now: float) -> str:
        """The operator at `station` delegates targets to a program. Returns why not, in words; "" if it is done."""
        if name not in self._programs:
            known = ", ".join(self._programs) or "none"
            return f"no program {name!r} has the right 'guided'; those that have it: {known}"
        again = self.program == name
        lacks = self._rules.give(name, station, self._facts(now), now)
        reports = self._parts.reports
        if not lacks and not again:
            by = reports.message_sender.ports[station].name
            reports.event_log.onboard(name, f"{by} delegates guided targets to {name}", by=by)
            self._programs[name].say(f"{by} delegates guided targets to you", mavlink.MAV_SEVERITY_NOTICE)
        return lacks

    def take_back(self, station: int, now: float) -> str:
        """The operator at `station` takes the targets back. Returns why not, in words; "" if it is done."""
        if self._parts.in_force.view.commander != station:
            return "only the commander takes targets back"
        self._over(self._rules.revoke(), now)
        return ""

    # ---- targets of a program -------------------------------------------------------------------------------------

    def permits(self, name: str, now: float) -> bool:
        """Whether a target of this program may pass now, apart from its place."""
        self.tick(now)
        return self._rules.permits(name)

    def target_passed(self, name: str, now: float) -> None:
        """A target of a program went to the autopilot."""
        self._rules.target_passed(name, now)

    def link_closed(self, name: str, now: float) -> None:
        """The link of a program was closed after a fault."""
        self._over(self._rules.link_closed(name), now)

    # ---- what ends it ---------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Time has passed: end the delegation if a fact ends it. To be called often."""
        if not self._mode_seen and self._parts.aircraft.telemetry.heartbeat.at > -inf:
            self._mode_seen = True
            self._first_mode(now)
        if self._rules.program or self._ordered is not None:
            self._over(self._rules.tick(self._facts(now), now), now)

    def _first_mode(self, now: float) -> None:
        """The autopilot shows its first mode to this companion, which may have started in flight."""
        if self._programs:
            one, *others = self._programs
            self._over(self._rules.restarted("An onboard program" if others else one, self._facts(now)), now)

    def commander_sends(self, frame: Frame, verdict: Verdict, now: float) -> None:
        """A frame of the commander is about to be passed on, or carried out: a command, a target or sticks."""
        streams = verdict.access is _STREAM
        if (streams and not self._rules.program) or verdict.fate not in _PASSES or payload_kind(frame) is not None:
            return
        leads = streams and frame.msgid in TARGET_MESSAGES
        if not streams:
            leads = self._leads_or_faults(frame, now)
        if self._rules.program:
            self._attempt(self._parts.give_stand_up)
            self._over(self._rules.commanded(flies=leads), now)

    def _leads_or_faults(self, frame: Frame, now: float) -> bool:
        """As `_leads`. After a fault a command counts as one that leads: a hold could stop a return."""
        try:
            return self._leads(frame, now)
        except Exception:
            self._ordered = None
            self._parts.reports.fault("delegation", traceback.format_exc(limit=-3))
            return True

    def _leads(self, frame: Frame, now: float) -> bool:
        """Whether a command chooses a mode or a place. An order of GUIDED is noted."""
        aircraft, commander = self._parts.aircraft, self._parts.in_force.view.commander
        source = mode_requests.of_command(frame, aircraft.profile, aircraft.ways_down.leads_to)
        if source is None:
            return False
        guided = source.flown is ModeClass.GUIDED
        self._ordered = (commander, now) if guided and commander is not None else None
        return True

    def _facts(self, now: float) -> GuidedFacts:
        aircraft, view = self._parts.aircraft, self._parts.in_force.view
        guided = aircraft.custom_mode == aircraft.profile.guided
        ordered_by, ordered_at = self._ordered or (None, -inf)
        if not guided and now - ordered_at > _SHOWS_S:
            self._ordered = ordered_by = None
        decision = self._parts.decision()
        decided = decision is not None and decision >= FlightAction.TRANSFER
        return GuidedFacts(view.commander, view.epoch, aircraft.flying, guided, ordered_by, decided)

    def _over(self, over: Over | None, now: float) -> None:
        """What follows from the end of the delegation."""
        if over is None:
            return
        log, commander = self._parts.reports.event_log.onboard, self._parts.in_force.view.commander
        text = f"{over.program} no longer leads the aircraft: {over.end.value}"
        to_program = f"targets are no longer delegated to you: {over.end.value}"
        self._attempt(self._stop_stream)
        self._attempt(partial(log, over.program, text, end=over.end.name.lower()))
        for name, program in self._programs.items():
            if over.end is End.RESTART or name == over.program:
                self._attempt(program.say, to_program)
        self._attempt(self._tell, commander, f"{text}. {'A hold is ordered.' if over.holds else ''}".rstrip())
        if over.holds:
            self._attempt(self._parts.stand, partial(self._stood, over.program), now)

    def _attempt(self, step: Callable[..., None], *arguments: object) -> None:
        attempt(self._parts.reports.fault, "delegation", step, *arguments)

    def _stop_stream(self) -> None:
        if self._parts.aircraft.profile.gate.takes_velocities:
            zeros = [0] * 11
            frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
            to = self._vehicle, AUTOPILOT_COMPID
            stop = mavlink.MAVLink_set_position_target_global_int_message(0, *to, frame, _ONLY_VELOCITY, *zeros)
            self._to_autopilot(bytes(stop.pack(self._own)))

    def _stood(self, program: str, trouble: str) -> None:
        """The hold is confirmed, or it failed (`trouble`: why)."""
        aircraft, reports = self._parts.aircraft, self._parts.reports
        mode = aircraft.profile.mode_name(aircraft.custom_mode)
        text = f"Hold confirmed: {mode}. Order GUIDED to lead it again."
        if trouble:
            text = f"Hold not confirmed: {trouble}. Command the aircraft now."
        reports.event_log.onboard(program, text, confirmed=not trouble)
        severity = mavlink.MAV_SEVERITY_WARNING if trouble else mavlink.MAV_SEVERITY_NOTICE
        self._tell(self._parts.in_force.view.commander, text, severity)

    def _tell(self, station: int | None, text: str, severity: int = mavlink.MAV_SEVERITY_WARNING) -> None:
        sender = self._parts.reports.message_sender
        if station is None:
            sender.say_to_all(text, severity)
        else:
            sender.say(sender.ports[station], text, severity)
