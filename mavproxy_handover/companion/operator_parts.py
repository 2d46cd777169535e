# SPDX-License-Identifier: GPL-3.0-or-later

"""All parts that deal with the operators at the stations, constructed in the order in which they need each other."""

from __future__ import annotations

from dataclasses import dataclass

from mavproxy_handover.companion.autopilot_parts import Autopilot
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.authority.payload import PayloadAuthority
from mavproxy_handover.gate.gate import Gate
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.operator.base.context import Authority, Reports
from mavproxy_handover.operator.briefing import Briefing, BriefingSources
from mavproxy_handover.operator.checks.preflight_warnings import PreflightWarnings
from mavproxy_handover.operator.onboard.delegating import Delegating
from mavproxy_handover.operator.rehearsal.rehearsal import RehearsalManager, Surroundings
from mavproxy_handover.operator.rehearsal.rehearsal_stats import Foreseen
from mavproxy_handover.operator.requests.accepted import AcceptedCommands, CommandParts
from mavproxy_handover.operator.requests.delegations import Delegations
from mavproxy_handover.operator.requests.flight_commands import FlightCommands
from mavproxy_handover.operator.requests.operator_control import OperatorControl
from mavproxy_handover.operator.requests.overrides import Overrides
from mavproxy_handover.operator.requests.payload import PayloadRequests
from mavproxy_handover.operator.requests.services import OperatorServices, Services
from mavproxy_handover.operator.requests.transfer_messages import TransferMessages, TransferServices
from mavproxy_handover.operator.stations.announcer import Announcer
from mavproxy_handover.operator.uploads.package_return import PackageReturn

__all__ = ["OperatorParts", "assemble_operator"]


@dataclass(frozen=True, slots=True)
class OperatorParts:
    """The parts that the companion works with."""

    services: OperatorServices
    rehearsal: RehearsalManager
    control: OperatorControl
    warnings: PreflightWarnings
    briefing: Briefing
    package_return: PackageReturn
    payload: PayloadRequests


def assemble_operator(
    vehicle: int,
    authority: Authority,
    in_force: AuthorityInForce,
    gate: Gate,
    autopilot: Autopilot,
    reports: Reports,
    announcer: Announcer,
    delegating: Delegating,
    payload: PayloadAuthority,
) -> OperatorParts:
    """Construct the parts for vehicle `vehicle` (system id)."""
    arbiter, handle = authority.arbiter, authority.handle
    event_log, message_sender, fault = reports.event_log, reports.message_sender, reports.fault

    def zones() -> str:
        """The names of the zones that hold the aircraft."""
        held = sorted(fact.station for fact in autopilot.zones.facts() if fact.margin_m > 0.0)
        return "+".join(arbiter.name(station) for station in held) or "no zone"

    def where() -> tuple[float, float] | None:
        here = autopilot.aircraft.where
        return None if here is None else here[:2]

    def foreseen() -> tuple[Foreseen, ...]:
        """The handovers that the check of the mission expects."""
        name = arbiter.name
        return tuple(
            Foreseen(name(h.from_station), name(h.to_station), (h.lat_deg, h.lon_deg), h.seq, h.overlap_s)
            for h in autopilot.mission.flown.foreseen
        )

    around = Surroundings(lambda: in_force.view, zones, where, foreseen)
    rehearsal = RehearsalManager(vehicle, arbiter, handle, message_sender, event_log, announcer, around)
    warnings = PreflightWarnings(in_force, autopilot.preflight, message_sender)
    concerned = CommandParts(
        autopilot.aircraft, autopilot.orders, autopilot.command_check, autopilot.read_back, autopilot.mission
    )
    accepted = AcceptedCommands(in_force, concerned, event_log, handle, fault)
    commands = FlightCommands(gate, arbiter, concerned, accepted, warnings, event_log, handle)
    payload_requests = PayloadRequests(
        vehicle, payload, message_sender, event_log, lambda: _commander(arbiter, in_force)
    )
    control = OperatorControl(message_sender, event_log, handle, payload_requests)
    package_return = PackageReturn(message_sender.ports, arbiter.unfit, event_log)
    overrides = Overrides(autopilot.command_check, lambda: in_force.view.commander, vehicle)
    delegations = Delegations(vehicle, delegating.give, delegating.take_back, message_sender.say)
    takers = TransferServices(autopilot.mission, package_return, rehearsal, overrides, delegations, event_log)
    messages = TransferMessages(vehicle, takers, handle, fault)
    sources = BriefingSources(
        autopilot.aircraft, autopilot.route, autopilot.energy, autopilot.command_check, autopilot.return_site
    )
    services = Services(commands, autopilot.return_site.list, control, messages)
    return OperatorParts(
        OperatorServices(gate, services, accepted, rehearsal, event_log),
        rehearsal,
        control,
        warnings,
        Briefing(arbiter, sources, message_sender.ports, fault),
        package_return,
        payload_requests,
    )


def _commander(arbiter: Arbiter, in_force: AuthorityInForce) -> str:
    """The name of the commander; "" if there is none."""
    commander = in_force.view.commander
    return "" if commander is None else arbiter.name(commander)
