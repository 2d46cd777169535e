# SPDX-License-Identifier: GPL-3.0-or-later

"""Which mission the autopilot holds to fly, as far as is known, and all that follows from it.

Who has to know: the monitors that compare the aircraft to its mission, the check before flight, the places of a return,
the energy, and what judges commands in flight. They are told here, and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass

from mavproxy_handover.autopilot.authority import Authority
from mavproxy_handover.autopilot.command_desk import CommandDesk
from mavproxy_handover.autopilot.package_loading import Along, MissionLoader
from mavproxy_handover.autopilot.preflight import Preflight
from mavproxy_handover.autopilot.read_back import ReadBack
from mavproxy_handover.autopilot.return_site import ReturnSite
from mavproxy_handover.autopilot.staging import Rerouted
from mavproxy_handover.autopilot.teller import Teller
from mavproxy_handover.core.events import MissionLoaded
from mavproxy_handover.mission.ahead import Ahead
from mavproxy_handover.mission.energy import released_at
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.walk import Handover
from mavproxy_handover.monitors.borders import BorderMonitor
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.monitors.gaps import GapMonitor
from mavproxy_handover.monitors.preflight.own_failsafes import plan_facts
from mavproxy_handover.monitors.preflight.plan_fit import PlanFitMonitor
from mavproxy_handover.monitors.route import RouteMonitor
from mavproxy_handover.monitors.waypoints import WaypointMonitor
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["FlownMission", "MissionMonitors", "MissionUsers"]


@dataclass(frozen=True, slots=True)
class MissionMonitors:
    """The monitors that compare the aircraft to its mission."""

    waypoints: WaypointMonitor
    gaps: GapMonitor
    borders: BorderMonitor
    route: RouteMonitor
    plan_fit: PlanFitMonitor
    energy: EnergyMonitor


@dataclass(frozen=True, slots=True)
class MissionUsers:
    """The parts that need to know the mission for what they do."""

    loader: MissionLoader
    preflight: Preflight
    places: ReturnSite
    desk: CommandDesk
    read_back: ReadBack


class FlownMission:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(
        self, state: VehicleState, authority: Authority, teller: Teller, monitors: MissionMonitors, users: MissionUsers
    ) -> None:
        self._state = state
        self._authority = authority
        self._teller = teller
        self._monitors = monitors
        self._users = users
        #: what the autopilot holds to fly, as far as is known
        self.route: Route | None = None
        #: the commander has changed it in flight: on the ground no package is loaded any more
        self.changed_aloft = False
        #: it is another one than the package's, which a station wrote on the ground
        self._uploaded = False
        #: the handovers that the check of the package has
        self.foreseen: tuple[Handover, ...] = ()
        #: the changes of the parameters (`Parameters.changes`) by which the plan was judged
        self._judged_by = 0

    @property
    def changed(self) -> bool:
        """The mission is not the package's any more: a station has uploaded another one."""
        return self.changed_aloft or self._uploaded

    def by_package(self, package: MissionPackage | None, along: Along, now: float, *, uploaded: bool = False) -> None:
        """The autopilot holds this package, and `along` lies along its route; None: it holds none. `uploaded`: the
        mission is another one, which a station wrote on the ground."""
        monitors, users = self._monitors, self._users
        route = None if package is None else package.route
        self.changed_aloft, self._uploaded = False, uploaded
        self._flies(route, now)
        users.desk.ahead = (
            None if package is None else Ahead(package.route, package.zone_finder(), package.cruise_speed_mps)
        )
        self.lies_along(along)
        monitors.waypoints.adopt(None if package is None else package.belonging, now)
        facts = None if package is None else plan_facts(package.route, package.cruise_speed_mps)
        energy = None if package is None else package.energy
        monitors.plan_fit.planned(facts)
        users.preflight.planned(facts, monitors.gaps.longest_s, energy)
        self.judge(now)
        users.places.adopt(package, now, keeps_rally=uploaded)

    def lies_along(self, along: Along) -> None:
        """What lies along the route of the package."""
        self.foreseen = along.handovers
        self._monitors.gaps.adopt(along.stretches)
        self._monitors.borders.adopt(along.way)
        if self._users.desk.ahead is not None:
            self._users.desk.ahead.gaps = along.stretches

    def reroute(self, rerouted: Rerouted | None, now: float) -> None:
        """The autopilot holds the mission that its commander has sent in flight; None: nobody knows what it holds."""
        monitors, users = self._monitors, self._users
        self.changed_aloft = True
        self.foreseen = ()
        monitors.gaps.adopt(())  # what is declared is a gap of the package
        monitors.waypoints.adopt(None, now)  # and so is a waypoint
        users.loader.delivery.adopt(None)  # and the delivery point
        monitors.borders.adopt(None if rerouted is None else rerouted.way)
        self._flies(None if rerouted is None else rerouted.ahead.route, now)
        users.desk.ahead = None if rerouted is None else rerouted.ahead
        if rerouted is None:
            return
        users.loader.reroute(rerouted.ahead.route)
        users.places.reroute(rerouted.ahead.route)
        monitors.plan_fit.planned(rerouted.facts)
        users.preflight.planned(rerouted.facts)
        self.judge(now)
        digest = self._authority.arbiter.mission_digest
        self._authority.handle(MissionLoaded(digest, rerouted.commanders), now)

    def _flies(self, route: Route | None, now: float) -> None:
        self.route = route
        self._users.read_back.forget(now)
        self._monitors.plan_fit.flies(None if route is None else route.kind)
        self._state.ways_down.adopt(route)
        self._monitors.route.adopt(route)
        self._monitors.energy.released(None if route is None else released_at(route))

    def judge(self, now: float) -> None:
        """Tell the arbiter what START lacks for gaps and heights, for a return that lands, and of the aircraft."""
        self._judged_by = self._state.parameters.changes
        self._teller.tell(self._monitors.gaps.update(self._state, now), now)
        self._teller.tell(self._monitors.plan_fit.update(self._state, now), now)

    @property
    def unjudged(self) -> bool:
        """The parameters have changed since."""
        return self._state.parameters.changes != self._judged_by
