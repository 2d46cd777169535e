# SPDX-License-Identifier: GPL-3.0-or-later

"""All parts that deal with onboard programs, in the order in which they need each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mavproxy_handover.companion.autopilot_parts import Autopilot
from mavproxy_handover.core.authority.payload import PayloadAuthority
from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.intent import Aim
from mavproxy_handover.gate.line_budget import LineBudget
from mavproxy_handover.gate.onboard import OnboardMatters
from mavproxy_handover.gate.policy.onboard import SENSORS, Moves, Right
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.operator.onboard.delegating import Delegating, DelegationParts
from mavproxy_handover.operator.onboard.estimate_watch import EstimateWatch
from mavproxy_handover.operator.onboard.landing_targets import LandingTargets
from mavproxy_handover.operator.onboard.port import OnboardPort
from mavproxy_handover.operator.onboard.programs import OnboardPrograms, OnboardSurroundings
from mavproxy_handover.operator.onboard.return_watch import ReturnWatch
from mavproxy_handover.wire.frames import Frame

__all__ = ["OnboardParts", "assemble_onboard"]


@dataclass(frozen=True, slots=True)
class OnboardParts:
    """The parts that the companion works with."""

    programs: OnboardPrograms
    delegating: Delegating
    estimate: EstimateWatch
    returns: ReturnWatch


def assemble_onboard(
    vehicle: int,
    ports: Sequence[OnboardPort],
    autopilot: Autopilot,
    in_force: AuthorityInForce,
    payload: PayloadAuthority,
    reports: Reports,
    decision: Callable[[], FlightAction | None],
    to_autopilot: Callable[[bytes], None],
    budget: LineBudget,
    to_stations: Callable[[Frame, float], None],
) -> OnboardParts:
    """Construct the parts for vehicle `vehicle` (system id). `decision`: the one in force. `to_autopilot` takes whole
    frames, `to_stations` what payload managers say."""
    guided = {port.name: port for port in ports if Right.GUIDED in port.rights.rights}
    orders = autopilot.orders
    parts = DelegationParts(in_force, autopilot.aircraft, orders.stand, orders.give_stand_up, decision, reports)
    delegating = Delegating(vehicle, guided, parts, to_autopilot)

    def target_passes(aim: Aim, name: str, now: float) -> bool:
        commander = in_force.view.commander
        return commander is not None and autopilot.command_check.target(aim, commander, now, name)

    moved = {SENSORS[sensor].moves for port in ports for sensor in port.rights.sensors}
    estimate = EstimateWatch(vehicle, Moves.ESTIMATE in moved, autopilot.aircraft, reports, to_autopilot)
    site, home = autopilot.return_site, autopilot.aircraft.telemetry
    returns = ReturnWatch(
        Moves.AVOIDANCE in moved, autopilot.aircraft, lambda: site.goes_to or home.home.value, reports
    )
    matters = OnboardMatters(
        delegating.permits,
        target_passes,
        lambda kind, name: payload.holder(kind) == name,
        lambda: autopilot.aircraft.judged_by,
        budget.allow,
        LandingTargets(autopilot.aircraft).judge,
        lambda: not estimate.stopped,
    )
    around = OnboardSurroundings(matters, to_autopilot, to_stations, delegating.target_passed, delegating.link_closed)
    return OnboardParts(OnboardPrograms(vehicle, ports, around, reports), delegating, estimate, returns)
