# SPDX-License-Identifier: GPL-3.0-or-later

"""All parts that deal with the autopilot, constructed in the order in which they need each other."""

from __future__ import annotations

from dataclasses import dataclass

from mavproxy_handover.config.running import Running
from mavproxy_handover.core.common.model import AuthorityView
from mavproxy_handover.gate.line_budget import LineBudget
from mavproxy_handover.monitors.borders import BorderMonitor
from mavproxy_handover.monitors.conditions import ConditionMonitor
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.monitors.gaps import GapMonitor
from mavproxy_handover.monitors.mode_and_motion import ModeAndMotionMonitor
from mavproxy_handover.monitors.position.source import Box, PositionMonitor
from mavproxy_handover.monitors.preflight.plan_fit import PlanFitMonitor
from mavproxy_handover.monitors.reboots import RebootMonitor
from mavproxy_handover.monitors.route import RouteMonitor
from mavproxy_handover.monitors.waypoints import WaypointMonitor
from mavproxy_handover.monitors.zones import ZoneMonitor
from mavproxy_handover.operator.base.context import Authority, Context, Reports
from mavproxy_handover.operator.base.output_dispatcher import OutputDispatcher
from mavproxy_handover.operator.checks.command_check import CommandCheck
from mavproxy_handover.operator.checks.preflight import Preflight
from mavproxy_handover.operator.checks.read_back import ReadBack
from mavproxy_handover.operator.orders import Orders
from mavproxy_handover.operator.return_site.return_site import ReturnSite
from mavproxy_handover.operator.uploads.flight_uploads import FlightUploads
from mavproxy_handover.operator.uploads.flown_mission import FlownMission, MissionMonitors, MissionUsers
from mavproxy_handover.operator.uploads.ground_uploads import GroundUploads
from mavproxy_handover.operator.uploads.mission_on_board import MissionOnBoard, MissionSources
from mavproxy_handover.operator.uploads.mission_readiness import MissionReadiness
from mavproxy_handover.operator.uploads.package_loading import MissionSurroundings, PackageLoader
from mavproxy_handover.operator.uploads.package_reader import PackageReader
from mavproxy_handover.operator.vehicle.guard import Guard
from mavproxy_handover.operator.vehicle.messages import AutopilotMessages, MessageMonitors, MessageUsers
from mavproxy_handover.operator.vehicle.rounds import RoundMonitors, RoundParts, Rounds
from mavproxy_handover.operator.vehicle.speed_restorer import SpeedRestorer
from mavproxy_handover.operator.vehicle.streams import Streams
from mavproxy_handover.operator.vehicle.telemetry import Telemetry
from mavproxy_handover.operator.vehicle.zone_check import ZoneCheck
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.vehicle.guard_link import GuardLink
from mavproxy_handover.vehicle.procedures import Procedures
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Conversations
from mavproxy_handover.wire.status import LeaseSequence

__all__ = ["Autopilot", "assemble"]


@dataclass(frozen=True, slots=True)
class Autopilot:
    """The parts that the rest of the companion works with."""

    aircraft: VehicleState
    conversations: Conversations
    guard: Guard
    positions: PositionMonitor
    energy: EnergyMonitor
    #: the aircraft against its route
    route: RouteMonitor
    preflight: Preflight
    read_back: ReadBack
    #: where a return goes
    return_site: ReturnSite
    orders: Orders
    #: the check of the commander's commands in flight
    command_check: CommandCheck
    mission: MissionOnBoard
    streams: Streams
    zones: ZoneCheck
    messages: AutopilotMessages
    rounds: Rounds

    def authority_moved(self, before: AuthorityView, now: float) -> None:
        """Another station has authority, or no station; `before`: the view until now."""
        self.command_check.authority_moved()
        self.mission.authority_moved(now)
        if before.commander is not None:
            self.streams.renew()


def assemble(
    running: Running,
    authority: Authority,
    reports: Reports,
    around: MissionSurroundings,
    clocks: Clocks,
    nonce: int,
    budget: LineBudget,
    box: Box | None = None,
) -> Autopilot:
    """Construct the parts for one vehicle. `nonce`: of this run's leases, never 0; `budget`: that of the line to the
    autopilot; `box`: the position box, if there is one."""
    config, key = running.config, running.guard_key
    state = VehicleState()
    conversations = Conversations(reports.message_sender.to_autopilot, reports.fault)
    procedures = Procedures(config.sysid, state)
    context = Context(state, conversations, lambda: procedures, authority, reports)
    dispatcher = OutputDispatcher(authority.handle, reports)

    leases = LeaseSequence(nonce, key)
    guard_link = GuardLink(config.sysid, key, leases)
    guard = Guard(config.sysid, state, leases, guard_link, reports, clocks.monotonic)
    sensors = frozenset(sensor for program in config.onboard for sensor in program.rights.sensors)
    preflight = Preflight(
        config.sysid,
        state,
        config.limits,
        conversations,
        reports.event_log.preflight,
        config.energy,
        sensors if config.onboard else None,
        budget.finding,
    )
    streams = Streams(context.procedures, reports.message_sender.ask_rates)
    telemetry = Telemetry(state, authority.arbiter.zones, reports, clocks.utc, config.limits.position_stale_s)
    read_back = ReadBack(conversations, context.procedures)

    positions = PositionMonitor(config.position, state, box)
    energy = EnergyMonitor(config.energy, reports.fault)
    monitors = MissionMonitors(
        ZoneMonitor(),
        WaypointMonitor(config.limits.leave_margin_m),
        GapMonitor(config.limits),
        BorderMonitor(config.limits.operator_timeout_s),
        RouteMonitor(config.route),
        PlanFitMonitor(),
        energy,
    )
    return_site = ReturnSite(config.sysid, context, lambda: energy.fact)
    orders = Orders(context, read_back, return_site)
    mode_and_motion = ModeAndMotionMonitor(lambda: return_site.goes_to)
    conditions = ConditionMonitor(
        lambda: return_site.energy_words if return_site.short else None, lambda: monitors.route.deviation, reports.fault
    )
    command_check = CommandCheck(
        config.commands, context, energy, return_site.candidates, dispatcher, config.limits.position_stale_s
    )

    flown = FlownMission(
        context, dispatcher, monitors, MissionUsers(preflight, return_site, command_check, read_back), around.keep
    )
    readiness = MissionReadiness(running.mission, authority.handle, reports)
    uploads = GroundUploads(context, command_check, flown, readiness, around.list_open)
    loader = PackageLoader(context, PackageReader(config), flown, readiness, uploads, around.close_files)
    flight_uploads = FlightUploads(context, command_check, flown)
    mission = MissionOnBoard(
        context, flown, MissionSources(loader, uploads, flight_uploads, readiness, read_back), orders.give_start_up
    )

    speeds = SpeedRestorer(context, flown, orders, return_site, command_check)
    messages = AutopilotMessages(
        config.sysid,
        context,
        dispatcher,
        MessageMonitors(mode_and_motion, energy, monitors.waypoints, RebootMonitor()),
        MessageUsers(guard, preflight, streams, orders, return_site, command_check, speeds),
        mission,
    )
    rounds = Rounds(
        context,
        dispatcher,
        RoundMonitors(positions, energy, monitors.borders, mode_and_motion, conditions),
        RoundParts(guard, preflight, streams, telemetry, orders, return_site, mission),
    )
    return Autopilot(
        state,
        conversations,
        guard,
        positions,
        energy,
        monitors.route,
        preflight,
        read_back,
        return_site,
        orders,
        command_check,
        mission,
        streams,
        ZoneCheck(context, monitors, positions, dispatcher),
        messages,
        rounds,
    )
