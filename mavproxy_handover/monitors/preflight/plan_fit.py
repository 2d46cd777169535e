# SPDX-License-Identifier: GPL-3.0-or-later

"""Does the mission fit the aircraft, its parameters and its home? If not, START is refused."""

from __future__ import annotations

import math
from typing import Final

from mavproxy_handover.core.common.events import AircraftJudged, Event, HeightsJudged, ReturnJudged
from mavproxy_handover.monitors.preflight.own_failsafes import PlanFacts, circles_for_ever
from mavproxy_handover.monitors.preflight.rules import heights_lack, other_type
from mavproxy_handover.vehicle.profiles import Profile
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["PlanFitMonitor", "not_as_checked"]

#: with these parameters a return of an aircraft with wings ends in a landing
_LANDS: Final = {"Q_RTL_MODE": 1.0, "RTL_AUTOLAND": 1.0}


def not_as_checked(facts: PlanFacts, state: VehicleState) -> str:
    """Why a plan that is uploaded in flight does not fit this aircraft, in words; "" if it fits."""
    parameters = state.parameters.read
    # after a restart in flight they are not read: START has asked for these
    circles = circles_for_ever(_LANDS if parameters is None else parameters, facts, state.profile)
    if circles:
        return f"a return would not land: {circles}"
    return heights_lack(parameters, facts, state.home_alt_m)


class PlanFitMonitor:
    """The fit of mission and aircraft, for one vehicle."""

    def __init__(self) -> None:
        self._facts: PlanFacts | None = None
        #: the profile that the mission was checked with
        self._profile: Profile | None = None
        #: what was found last: of the aircraft, of the heights, of a return that lands
        self._aircraft = self._heights = self._return = ""

    def planned(self, facts: PlanFacts | None) -> None:
        """Set the facts of the autopilot's mission; None: not known."""
        self._facts = facts

    def flies(self, profile: Profile | None) -> None:
        """The mission was checked with this profile; None: it is not known which mission it is."""
        self._profile = profile

    def update(self, state: VehicleState, _now: float) -> list[Event]:
        """Returns what START lacks for aircraft, heights and a return that lands, when that changes."""
        parameters, found = state.parameters.read, list[Event]()
        aircraft = other_type(parameters or {}) or self._other_kind(state) or self._no_takeoff()
        if aircraft != self._aircraft:
            self._aircraft = aircraft
            found.append(AircraftJudged(aircraft))
        heights = heights_lack(parameters, self._facts, state.home_alt_m)
        if heights != self._heights:
            self._heights = heights
            found.append(HeightsJudged(heights))
        lacks = circles_for_ever(parameters, self._facts, state.profile)
        if lacks != self._return:
            self._return = lacks
            found.append(ReturnJudged(lacks))
        return found

    def _no_takeoff(self) -> str:
        """What the mission begins with, in words, if that is no take-off: AUTO does not leave the ground then."""
        begins = "" if self._facts is None else self._facts.begins_with
        return f"the mission has no take-off, it begins with {begins}" if begins else ""

    def _other_kind(self, state: VehicleState) -> str:
        """Which kind of aircraft the mission was checked for, in words; "" if it is this one, or not known."""
        if self._profile is None or state.telemetry.heartbeat.at == -math.inf or self._profile is state.profile:
            return ""
        return f"the mission is for a {self._profile.name}, and this is a {state.profile.name}"
