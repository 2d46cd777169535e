# SPDX-License-Identifier: GPL-3.0-or-later

"""The mission that the autopilot holds, as far as it is known, and everything that depends on it.

Only this module tells the other parts the mission: the monitors that compare the aircraft with it, the check before
flight, the return site, the energy, and the check of commands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.core.common.events import MissionLoaded
from mavproxy_handover.mission.ahead import Ahead
from mavproxy_handover.mission.energy import released_at
from mavproxy_handover.mission.items import RallyPoint
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import Handover
from mavproxy_handover.monitors.borders import BorderMonitor
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.monitors.gaps import GapMonitor
from mavproxy_handover.monitors.preflight.own_failsafes import plan_facts
from mavproxy_handover.monitors.preflight.plan_fit import PlanFitMonitor
from mavproxy_handover.monitors.route import RouteMonitor
from mavproxy_handover.monitors.waypoints import WaypointMonitor
from mavproxy_handover.monitors.zones import ZoneMonitor
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.base.output_dispatcher import OutputDispatcher
from mavproxy_handover.operator.checks.command_check import CommandCheck
from mavproxy_handover.operator.checks.preflight import Preflight
from mavproxy_handover.operator.checks.read_back import ReadBack
from mavproxy_handover.operator.return_site.return_site import ReturnSite
from mavproxy_handover.operator.uploads.delivery import DeliveryPoint
from mavproxy_handover.operator.uploads.prepared import Along, Prepared, Rerouted

__all__ = ["FlownMission", "MissionMonitors", "MissionUsers"]


@dataclass(frozen=True, slots=True)
class MissionMonitors:
    """The monitors that compare the aircraft with its mission."""

    zones: ZoneMonitor
    waypoints: WaypointMonitor
    gaps: GapMonitor
    borders: BorderMonitor
    route: RouteMonitor
    plan_fit: PlanFitMonitor
    energy: EnergyMonitor


@dataclass(frozen=True, slots=True)
class MissionUsers:
    """The other parts that need to know the mission."""

    preflight: Preflight
    return_site: ReturnSite
    command_check: CommandCheck
    read_back: ReadBack


class FlownMission:
    """The mission of one vehicle. `keep` saves the package that the autopilot holds. Times are monotonic seconds."""

    def __init__(
        self,
        context: Context,
        dispatcher: OutputDispatcher,
        monitors: MissionMonitors,
        users: MissionUsers,
        keep: Callable[[MissionPackage], None],
    ) -> None:
        self._state = context.state
        self._authority = context.authority
        self._dispatcher = dispatcher
        self._monitors = monitors
        self._users = users
        self._keep = keep
        #: the package whose zones and stations count; None: no package is known
        self.package: MissionPackage | None = None
        #: the package that was loaded last, also after another mission has replaced it
        self.latest: MissionPackage | None = None
        #: the route that the autopilot holds; None: it is not known
        self.route: Route | None = None
        #: the commander has replaced the mission in flight: after landing, no package is loaded
        self.changed_aloft = False
        #: a station has written another mission than the package's on the ground
        self._uploaded = False
        self.delivery = DeliveryPoint()
        #: the expected changes of commander
        self.foreseen: tuple[Handover, ...] = ()
        #: `Parameters.changes` when the plan was judged last
        self._judged_by = 0

    @property
    def changed(self) -> bool:
        """The mission is not the package's any more: a station has uploaded another one."""
        return self.changed_aloft or self._uploaded

    def loaded(self, prepared: Prepared, now: float, *, uploaded: bool = False) -> None:
        """The autopilot was loaded with a mission, which was read back: set it, save it and tell the rules.

        `uploaded`: a station wrote it on the ground, and it is another mission than the package's.
        """
        self._keep(prepared.package)
        self.set_mission(prepared, now, uploaded=uploaded)
        package = prepared.package
        policy = package.policies.get("on_out_of_coverage")
        self._authority.handle(MissionLoaded(package.digest, prepared.commanders, policy), now)

    def remember(self, package: MissionPackage) -> None:
        """Remember the package that was loaded last."""
        self.latest = package

    def set_mission(self, prepared: Prepared, now: float, *, uploaded: bool = False) -> None:
        """Tell all parts the mission that the autopilot holds. `uploaded`: as in `loaded`."""
        monitors, users, package = self._monitors, self._users, prepared.package
        self.package = package
        monitors.zones.set_mission(prepared.finder, package.route)
        self.delivery.set_mission(package)
        energy = monitors.energy.apply_settings(package.energy, prepared.way, now, package.profile.energy)
        self._dispatcher.dispatch(energy, now)
        self.changed_aloft, self._uploaded = False, uploaded
        self._flies(package.route, now)
        users.command_check.ahead = Ahead(package.route, package.zone_finder(), package.cruise_speed_mps)
        self.set_along(prepared.along)
        monitors.waypoints.set_owners(package.belonging, now)
        facts = plan_facts(package.route, package.cruise_speed_mps)
        monitors.plan_fit.planned(facts)
        users.preflight.planned(facts, monitors.gaps.longest_s, package.energy)
        self.judge(now)
        users.return_site.set_mission(package, now, keeps_rally=uploaded)

    def drop(self, now: float) -> None:
        """The mission that the autopilot holds is not known any more. The package stays: its zones still count."""
        monitors, users = self._monitors, self._users
        self.changed_aloft, self._uploaded = False, False
        self._flies(None, now)
        users.command_check.ahead = None
        self.set_along(Along())
        monitors.waypoints.set_owners(None, now)
        monitors.plan_fit.planned(None)
        users.preflight.planned(None, monitors.gaps.longest_s)
        self.judge(now)

    def first_point(self, package: MissionPackage) -> RallyPoint:
        """The point that the rally list holds after a package was loaded."""
        return self._users.return_site.candidates.first_point(package)

    def set_along(self, along: Along) -> None:
        """Set what lies along the route of the package."""
        self.foreseen = along.handovers
        self._monitors.gaps.set_gaps(along.stretches)
        self._monitors.borders.set_way(along.way)
        if self._users.command_check.ahead is not None:
            self._users.command_check.ahead.gaps = along.stretches

    def reroute(self, rerouted: Rerouted | None, now: float) -> None:
        """The autopilot holds the mission that its commander has sent in flight; None: which one is not known."""
        monitors, users = self._monitors, self._users
        self.changed_aloft = True
        self.foreseen = ()
        # gaps, waypoints of stations and the delivery point belong to the package
        monitors.gaps.set_gaps(())
        monitors.waypoints.set_owners(None, now)
        self.delivery.set_mission(None)
        monitors.borders.set_way(None if rerouted is None else rerouted.way)
        self._flies(None if rerouted is None else rerouted.ahead.route, now)
        users.command_check.ahead = None if rerouted is None else rerouted.ahead
        if rerouted is None:
            return
        monitors.zones.reroute(rerouted.ahead.route)
        users.return_site.reroute(rerouted.ahead.route)
        monitors.plan_fit.planned(rerouted.facts)
        users.preflight.planned(rerouted.facts)
        self.judge(now)
        digest = self._authority.arbiter.mission_digest
        self._authority.handle(MissionLoaded(digest, rerouted.commanders), now)

    def _flies(self, route: Route | None, now: float) -> None:
        self.route = route
        self._users.read_back.set_route(route, now)
        self._monitors.plan_fit.flies(None if route is None else route.profile)
        self._state.ways_down.set_route(route)
        self._monitors.route.set_route(route)
        self._monitors.energy.released(None if route is None else released_at(route))

    def judge(self, now: float) -> None:
        """Tell the rules what START lacks for gaps, heights, the kind of aircraft, and a return that lands."""
        self._judged_by = self._state.parameters.changes
        self._dispatcher.dispatch(self._monitors.gaps.update(self._state, now), now)
        self._dispatcher.dispatch(self._monitors.plan_fit.update(self._state, now), now)

    @property
    def unjudged(self) -> bool:
        """The parameters have changed since the last judgement."""
        return self._state.parameters.changes != self._judged_by
