# SPDX-License-Identifier: GPL-3.0-or-later

"""Missions that were read and walked through the zones, ready to be used.

To walk a route takes time. `prepare` and `way_of` are for a worker thread, not for the main loop.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mavproxy_handover.core.safety.energy import Piece
from mavproxy_handover.mission.ahead import Ahead
from mavproxy_handover.mission.crossings import WayAhead
from mavproxy_handover.mission.energy import PreparedWay
from mavproxy_handover.mission.gaps import Stretch
from mavproxy_handover.mission.jumps import jumps
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import Handover, RouteSimulation
from mavproxy_handover.mission.zones import ZoneFinder
from mavproxy_handover.monitors.preflight.own_failsafes import PlanFacts

__all__ = ["Along", "Prepared", "Rerouted", "Way", "prepare", "way_ahead", "way_of"]


#: the pieces of a route, with the return from its end at that height (m) where it does not land
Way = Callable[[float], Sequence[Piece]]


@dataclass(frozen=True, slots=True)
class Along:
    """Gaps, borders and handovers along the route of a mission."""

    #: the declared gaps in coverage that the route crosses
    stretches: tuple[Stretch, ...] = ()
    #: the borders of zones; None: not known
    way: WayAhead | None = None
    #: the expected changes of commander
    handovers: tuple[Handover, ...] = ()


@dataclass(frozen=True, slots=True)
class Prepared:
    """A package that was read, and the results that take time to compute."""

    package: MissionPackage
    finder: ZoneFinder
    #: system ids of the commanders, in the order in which the route needs them
    commanders: tuple[int, ...]
    #: the pieces of its route, for the energy
    way: Way
    along: Along = Along()


@dataclass(frozen=True, slots=True)
class Rerouted:
    """A mission that replaces the mission of the package in flight."""

    ahead: Ahead
    #: system ids of the commanders from here on, in the order in which the route needs them
    commanders: tuple[int, ...]
    facts: PlanFacts
    #: the borders of zones on the route; None: it leads nowhere
    way: WayAhead | None = None


def prepare(package: MissionPackage) -> Prepared:
    """Walk the route of a package through its zones."""
    simulation = package.simulate()
    along = Along(package.stretches(simulation), way_ahead(simulation, package.route), simulation.handovers)
    return Prepared(package, package.zone_finder(), simulation.commanders, way_of(package), along)


def way_ahead(simulation: RouteSimulation, route: Route) -> WayAhead | None:
    """The borders of zones on a route. In flight the round of a jump is not known, so then there are none."""
    return None if jumps(route.items) else WayAhead.of(simulation, route)


def way_of(package: MissionPackage) -> Way:
    """The pieces of the route of a package, for the energy."""
    route = PreparedWay(package.route, package.cruise_speed_mps)
    return route.pieces
