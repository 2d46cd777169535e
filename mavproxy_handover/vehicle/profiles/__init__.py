# SPDX-License-Identifier: GPL-3.0-or-later

"""One profile for each kind of aircraft, and the ways to find it.

A profile is found by MAV_TYPE, by its name in a mission, or by a report of the aircraft in flight.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.vehicle.profiles.copter import COPTER
from mavproxy_handover.vehicle.profiles.plane import PLANE
from mavproxy_handover.vehicle.profiles.procedures import FlightProcedures
from mavproxy_handover.vehicle.profiles.profile import SWITCHED, GuardRow, Mode, Modes, Profile, RuleGroup
from mavproxy_handover.vehicle.profiles.quadplane import QUADPLANE

__all__ = [
    "ASSUMED",
    "COPTER",
    "PLANE",
    "PROFILES",
    "QUADPLANE",
    "SWITCHED",
    "UNKNOWN_MODES",
    "FlightProcedures",
    "GuardRow",
    "Mode",
    "Modes",
    "Profile",
    "RuleGroup",
    "named",
    "profile_of",
    "proven",
    "refined",
]

PROFILES: Final = (COPTER, PLANE, QUADPLANE)
#: what counts until the autopilot or the mission has said what it is, and for an autopilot of no profile
ASSUMED: Final = COPTER
#: what the gate judges the modes of an autopilot of no profile by: no number has a name
UNKNOWN_MODES: Final = Modes({}, ASSUMED.gate.auto, ASSUMED.gate.take_off, follow=ASSUMED.gate.follow)

_BY_TYPE: Final = {number: profile for profile in PROFILES if profile.refines is None for number in profile.types}
_BY_NAME: Final = {profile.name: profile for profile in PROFILES}
_BY_STATE: Final = {state: profile for profile in PROFILES if profile.refines is None for state in profile.proven_by}
_REFINED: Final = {profile.refines: profile for profile in PROFILES if profile.refines is not None}


def profile_of(autopilot: int, vehicle_type: int) -> Profile | None:
    """The profile for a HEARTBEAT with this MAV_AUTOPILOT and MAV_TYPE; None: there is none for it."""
    return _BY_TYPE.get(vehicle_type) if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA else None


def named(name: str) -> Profile:
    """The profile that a mission calls by this name. Raises KeyError."""
    return _BY_NAME[name]


def proven(vtol_state: int) -> Profile | None:
    """The profile whose aircraft alone report this MAV_VTOL_STATE; None: it proves nothing."""
    return _BY_STATE.get(vtol_state)


def refined(profile: Profile) -> Profile:
    """The profile that refines this one; the same if there is none."""
    return _REFINED.get(profile, profile)
