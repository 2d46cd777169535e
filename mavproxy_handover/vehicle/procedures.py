# SPDX-License-Identifier: GPL-3.0-or-later

"""Procedures of the companion with the autopilot: load a plan, ask for telemetry, and fly as the profile says.

START, hold, return and landing are the profile's (`vehicle/profiles/`). Each procedure is an `Asking`
(`wire/conversation.py`), and each checks that the autopilot did what it acknowledged: a mission counts as loaded when
it was read back equal. Source: mavlink.io "Mission Protocol".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.items import MissionItem, RallyPoint
from mavproxy_handover.mission.plan import FencePart, Route
from mavproxy_handover.vehicle.cruise import held_cruise, write_cruise
from mavproxy_handover.vehicle.mission_protocol import MissionProtocol
from mavproxy_handover.vehicle.profiles import FlightProcedures, Profile
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Asking, AutopilotError, command_long
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID
from mavproxy_handover.wire.own_rates import OWN_RATES

__all__ = ["HeldPlan", "Loaded", "Plan", "Procedures"]


@dataclass(frozen=True, slots=True)
class Plan:
    """All that a mission package has the autopilot hold."""

    #: begins with home, item 0
    items: tuple[MissionItem, ...]
    rally: tuple[RallyPoint, ...] = ()
    fence: tuple[FencePart, ...] = ()
    #: horizontal speed of the mission (m/s); None: the plan names none
    cruise_mps: float | None = None


@dataclass(frozen=True, slots=True)
class Loaded:
    """Geofence and horizontal speed of the mission (m/s) that count after a plan was loaded."""

    fence: tuple[FencePart, ...]
    cruise_mps: float


@dataclass(frozen=True, slots=True)
class HeldPlan:
    """The plan that the autopilot holds: mission, home first, geofence, and speed between waypoints (m/s)."""

    items: tuple[MissionItem, ...]
    fence: tuple[FencePart, ...]
    cruise_mps: float


@dataclass(frozen=True, slots=True)
class Procedures:
    """Procedures with the autopilot of system `sysid`. `aircraft`: its state."""

    sysid: int
    aircraft: VehicleState

    @property
    def profile(self) -> Profile:
        """Of the aircraft as it is known now."""
        return self.aircraft.profile

    @property
    def flight(self) -> FlightProcedures:
        """START, hold, return and landing, as the profile has them."""
        return self.profile.procedures(self.sysid, lambda: self.aircraft.telemetry.text, self.aircraft)

    def stream_requests(self) -> list[Any]:
        """Messages that ask for everything in OWN_RATES."""
        command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        target = self.sysid, AUTOPILOT_COMPID
        return [command_long(target, command, msgid, interval_s * 1e6) for msgid, interval_s in OWN_RATES.items()]

    # ---- the plan -----------------------------------------------------------------------------------------------

    def load(self, plan: Plan) -> Asking:
        """Write mission, geofence, rally points and cruise speed, read all of them back and compare.

        A plan without a geofence clears none: the vehicle's own geofence keeps the aircraft in, also if a file has
        none. A plan without a cruise speed changes no speed. Returns geofence and speed that count now.
        """
        lists = MissionProtocol(self.sysid, self.profile)
        yield from lists.write_mission(plan.items)
        if plan.fence:
            yield from lists.write_fence(plan.fence)
        yield from lists.write_rally(plan.rally)
        yield from lists.compare_mission(plan.items)
        if plan.fence:
            yield from lists.compare_fence(plan.fence)
        yield from lists.compare_rally(plan.rally)
        fence = plan.fence or (yield from lists.held_fence())
        if plan.cruise_mps is None:
            return Loaded(fence, (yield from held_cruise(self.sysid, self.profile)))
        yield from write_cruise(self.sysid, plan.cruise_mps, self.profile)
        return Loaded(fence, plan.cruise_mps)

    def holds(self, route: Route) -> Asking:
        """See that the autopilot holds the mission of a route, and its geofence if it has one. Raises AutopilotError
        where it holds another one."""
        lists = MissionProtocol(self.sysid, self.profile)
        yield from lists.compare_mission(route.upload_items())
        if route.fence:
            yield from lists.compare_fence(route.fence)

    def held_mission(self) -> Asking:
        """Returns the items of the mission that the autopilot holds, its home first. Raises AutopilotError."""
        return (yield from MissionProtocol(self.sysid, self.profile).held_mission())

    def held_plan(self) -> Asking:
        """Returns the `HeldPlan`: what a station wrote. Raises AutopilotError."""
        lists = MissionProtocol(self.sysid, self.profile)
        items = yield from lists.held_mission()
        fence = yield from lists.held_fence()
        return HeldPlan(items, fence, (yield from held_cruise(self.sysid, self.profile)))

    def replace_mission(self, items: tuple[MissionItem, ...]) -> Asking:
        """Write another mission in flight and read it back; `items` begins with home. Raises AutopilotError."""
        lists = MissionProtocol(self.sysid, self.profile)
        yield from lists.write_mission(items)
        yield from lists.compare_mission(items)

    def holds_another(self, items: tuple[MissionItem, ...]) -> Asking:
        """Whether the mission that the autopilot holds is another one than these items; `items` begins with home."""
        try:
            yield from MissionProtocol(self.sysid, self.profile).compare_mission(items)
        except AutopilotError:
            return True
        return False
