# SPDX-License-Identifier: GPL-3.0-or-later

"""Do guard, parameters and firmware of the autopilot fit?

These rules do not refuse a flight; the arbiter decides about START. They find settings that change the end of a flight
after a failure. Examples are a failsafe that is disabled or acts too early, ignored rally points, and a guard that
listens at the wrong port. `own_failsafes.py` has the checks of the autopilot's own failsafes.

The rules are a table of pure functions, which `judge` applies. `operator/checks/preflight.py` reads the parameters and
decides when. Sources: the reasons in `ardupilot_lua/handover.parm`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GuardState
from mavproxy_handover.mission.heights import home_disagrees
from mavproxy_handover.mission.keys import MOST_BATTERIES
from mavproxy_handover.monitors.preflight import own_failsafes
from mavproxy_handover.monitors.preflight.own_failsafes import (
    PlanFacts,
    circles_for_ever,
    no_terrain,
)
from mavproxy_handover.vehicle.profiles import ASSUMED, PROFILES, Profile, RuleGroup
from mavproxy_handover.wire.ids import COMPANION_COMPID

__all__ = [
    "KNOWN",
    "RULES",
    "Finding",
    "Found",
    "heights_lack",
    "judge",
    "names_of",
    "other_type",
]

#: all names that may be read
KNOWN: Final = frozenset(
    (*(name for profile in PROFILES for name in profile.reads), *own_failsafes.further_names(MOST_BATTERIES))
)
OLDEST, NEWEST = (4, 5), (4, 7)

#: time (s) that a forced transfer needs after a recovery before the guard may act; parameters have 24 bits
_FORCED_S, _ROUNDED_S = 0.5, 1e-4
_CONTINUE_AUTO, _CONTINUE_PILOT = 0b10, 0b10000
#: Q_MAV_TYPE: as it comes, and FIXED_WING, which is the same (`QuadPlane::get_mav_type`)
_OWN_TYPES = (0, mavlink.MAV_TYPE_FIXED_WING)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that does not fit. `parameter`: the parameter to change, "" if there is none."""

    parameter: str
    text: str


@dataclass(frozen=True, slots=True)
class Found:
    """The facts known about the autopilot. `parameters` lacks those that it does not have."""

    parameters: Mapping[str, float]
    guard: GuardState
    #: major and minor version that the guard gives; None while it is silent
    firmware: tuple[int, int] | None = None
    #: the kind of vehicle in words, if it is not supported; else ""
    foreign: str = ""
    #: the channel of the leases, by the guard, if it refuses them because of it
    heard_on: int | None = None
    #: facts of the autopilot's mission; None without one
    plan: PlanFacts | None = None
    #: the longest limit of a gap (s); 0 without gaps
    gap_s: float = 0.0
    profile: Profile = ASSUMED
    #: how many it flies by: monitors 0 and up
    batteries: int = 1
    #: its home above the sea (m); None: not known
    home_alt_m: float | None = None
    #: why leases and guard do not fit, in words
    misfit: str = ""


def names_of(profile: Profile, batteries: int = 1) -> tuple[str, ...]:
    """The parameters that are read of an aircraft of this profile, which flies by so many batteries."""
    return (*profile.reads, *own_failsafes.further_names(batteries))


# ---- judging ------------------------------------------------------------------------------------------------------

#: with fewer instructions, ArduPilot removes a script that is slow once
_INSTRUCTIONS = 10000

Rule = Callable[[Mapping[str, float], Found, Limits], "str | None"]


def _guard_there(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    if "HNDO_ENABLE" in p or found.guard is not GuardState.SILENT:
        return None
    if p.get("SCR_ENABLE", 0) < 1:
        return "scripting is off: the guard does not run"
    return "the guard is not loaded; 'handover guard' puts it on the SD card"


def _guard_on(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    return "the guard is switched off" if p.get("HNDO_ENABLE", 1) < 0.5 else None


def _fits(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    return found.misfit or None


def _channel(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    channel = p.get("HNDO_CHAN")
    if channel is None or p.get("HNDO_ENABLE", 0) < 0.5:
        return None
    if channel < 0:
        return "the guard takes leases from any port: any program that reaches one can send them"
    if found.heard_on is not None and found.heard_on != int(channel):
        return f"is {channel:.0f}, but this companion is on channel {found.heard_on}"
    if found.guard is GuardState.SILENT and not found.misfit:
        return f"is {channel:.0f} and the guard is silent here: is that the port of this companion?"
    return None


def _component(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    compid = int(p.get("HNDO_COMPID", COMPANION_COMPID))
    return None if compid == COMPANION_COMPID else f"is {compid}, must be {COMPANION_COMPID}"


def _timeout(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    timeout_s = p.get("HNDO_TIMEOUT", 3.0)
    if timeout_s < 1.0:
        return f"is {timeout_s:g} s: a few lost leases (there are five a second) end the flight"
    enabled, timeout = found.profile.gcs_failsafe, found.profile.gcs_timeout
    if p.get(enabled, 0) and p.get(timeout, math.inf) <= timeout_s:
        return f"is {timeout_s:g} s, not shorter than {timeout}: the guard would not be the first to act"
    return None


def _lost_time(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    lost_s = p.get("HNDO_LOST_T", math.inf)
    if lost_s < limits.forced_timeout_s:
        return f"is {lost_s:g} s: the guard acts while the companion still looks for a partner, {_s(limits)}"
    needed_s = limits.recovery_s + _FORCED_S
    if lost_s < needed_s - _ROUNDED_S:
        return f"is {lost_s:g} s: the guard acts while the companion recovers from a restart ({needed_s:g} s)"
    return None


def _s(limits: Limits) -> str:
    return f"up to {limits.forced_timeout_s:g} s"


def _instructions(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    count = p.get("SCR_VM_I_COUNT", _INSTRUCTIONS)
    return (
        f"is {count:.0f}: below {_INSTRUCTIONS} the guard may be removed in flight" if count < _INSTRUCTIONS else None
    )


def _checksum(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    if found.guard is GuardState.SILENT or p.get("SCR_LD_CHECKSUM", 0) >= 0:
        return None
    return "is -1: an SD card that is gone or changed is not noticed at arming; set SCR_DEBUG_OPTS to 32 once"


def _pilot(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    if p.get(found.profile.radio_failsafe, 1) != 0 or p.get("RC_PROTOCOLS", 1) == 0:
        return None
    return "is 0: the guard believes no pilot then; on a vehicle without radio control set RC_PROTOCOLS 0 as well"


def _follows(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    if p.get("HNDO_SYSID_SW", 1) >= 0.5:
        return None
    return "is 0: the autopilot's GCS failsafe goes on watching one station, also when another commands"


def _alone(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    most_s = p.get("HNDO_ALONE_MAX", 0.0)
    if most_s >= found.gap_s - _ROUNDED_S:
        return None
    return f"is {most_s:g} s: too short for a gap of the mission ({found.gap_s:g} s), START is refused"


def _gcs_failsafe(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    enabled = p.get(found.profile.gcs_failsafe, 1)
    lacks = found.profile.gcs_failsafe_lacks.get(int(enabled))
    if lacks is not None:
        return f"is {enabled:.0f}: {lacks}"
    return None if enabled != 0 else "is 0: nothing brings the aircraft home if companion and guard both fail"


def _gcs_timeout(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    timeout_s = p.get(found.profile.gcs_timeout, math.inf)
    needed_s = limits.heartbeat_lost_s + limits.forced_timeout_s
    if p.get(found.profile.gcs_failsafe, 0) == 0 or timeout_s > needed_s:
        return None
    return f"is {timeout_s:g} s: the autopilot returns before a partner can take over ({needed_s:g} s)"


def _options(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    options = int(p.get("FS_OPTIONS", 0))
    if options & _CONTINUE_AUTO:
        return f"is {options}: bit 1 lets a mission go on without a ground station"
    if options & _CONTINUE_PILOT:
        return f"is {options}: bit 4 is for flights with a safety pilot at hand"
    return None


def _rally(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    limit_km = p.get("RALLY_LIMIT_KM", 0.0)
    return f"is {limit_km:g}: a return goes home if the return site is farther away" if limit_km > 0 else None


def _enforce(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    return "is 1: the autopilot does not answer observers" if p.get("SYSID_ENFORCE", 0) >= 0.5 else None


def _mav_options(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    options = int(p.get("MAV_OPTIONS", 0))
    return f"is {options}: bit 0 makes the autopilot not answer observers" if options & 1 else None


def _arming_check(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    return "is 0: the guard cannot refuse arming, only disarm" if p.get("ARMING_CHECK", 1) == 0 else None


def _arming_skip(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    return "is -1: the guard cannot refuse arming, only disarm" if p.get("ARMING_SKIPCHK", 0) < 0 else None


def _arming_required(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    if p.get("ARMING_REQUIRE", 1) >= 1:
        return None
    return "is 0: it is always armed and takes off by a change of mode; the guard cannot refuse arming"


def _lands(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    lacks = circles_for_ever(p, found.plan, found.profile)
    return f"a return does not land: {lacks}; START is refused" if lacks else None


def _home_height(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    plan = found.plan
    lacks = "" if plan is None else home_disagrees(plan.above_sea, plan.home_alt_m, found.home_alt_m)
    return f"{lacks}; START is refused" if lacks else None


def other_type(p: Mapping[str, float]) -> str:
    """Why an ArduPlane reports another type of vehicle, in words; "" if it does not.

    No copter has this parameter. So a vehicle that has it and reports a copter is not a copter.
    """
    number = int(p.get("Q_MAV_TYPE", 0))
    return "" if number in _OWN_TYPES else f"Q_MAV_TYPE is {number}: its modes are taken for those of another aircraft"


def _type(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    other = other_type(p)
    return f"{other}; START is refused" if other else None


def _firmware(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    if found.firmware is None or found.firmware == (0, 0) or OLDEST <= found.firmware <= NEWEST:
        return None
    major, minor = found.firmware
    what = "older than the oldest" if found.firmware < OLDEST else "newer than the newest"
    edge = OLDEST if found.firmware < OLDEST else NEWEST
    return f"firmware {major}.{minor} is {what} that this was made for, {edge[0]}.{edge[1]}"


#: parameter to change ("" for none; or how the profile calls it), rule, whether it concerns the guard, its group
RULES: Final[tuple[tuple[str | Callable[[Profile], str], Rule, bool, RuleGroup], ...]] = (
    ("Q_MAV_TYPE", _type, False, RuleGroup.EVERY),
    ("", _lands, False, RuleGroup.ARDUPLANE),
    ("", _home_height, False, RuleGroup.EVERY),
    ("ARMING_REQUIRE", _arming_required, False, RuleGroup.ARDUPLANE),
    ("", _guard_there, True, RuleGroup.EVERY),
    ("HNDO_ENABLE", _guard_on, True, RuleGroup.EVERY),
    ("", _fits, True, RuleGroup.EVERY),
    ("HNDO_CHAN", _channel, True, RuleGroup.EVERY),
    ("HNDO_COMPID", _component, True, RuleGroup.EVERY),
    ("HNDO_TIMEOUT", _timeout, True, RuleGroup.EVERY),
    ("HNDO_LOST_T", _lost_time, True, RuleGroup.EVERY),
    ("HNDO_SYSID_SW", _follows, True, RuleGroup.EVERY),
    ("HNDO_ALONE_MAX", _alone, True, RuleGroup.EVERY),
    ("SCR_VM_I_COUNT", _instructions, True, RuleGroup.EVERY),
    ("SCR_LD_CHECKSUM", _checksum, True, RuleGroup.EVERY),
    (lambda profile: profile.radio_failsafe, _pilot, True, RuleGroup.EVERY),
    (lambda profile: profile.gcs_failsafe, _gcs_failsafe, False, RuleGroup.EVERY),
    (lambda profile: profile.gcs_timeout, _gcs_timeout, False, RuleGroup.EVERY),
    ("FS_OPTIONS", _options, False, RuleGroup.ARDUCOPTER),
    ("RALLY_LIMIT_KM", _rally, False, RuleGroup.EVERY),
    ("SYSID_ENFORCE", _enforce, False, RuleGroup.EVERY),
    ("MAV_OPTIONS", _mav_options, False, RuleGroup.EVERY),
    ("ARMING_CHECK", _arming_check, True, RuleGroup.EVERY),
    ("ARMING_SKIPCHK", _arming_skip, True, RuleGroup.EVERY),
    ("", _firmware, True, RuleGroup.EVERY),
)


def judge(found: Found, limits: Limits) -> tuple[Finding, ...]:
    """All findings, the gravest first. An autopilot that does not answer, or is not supported, is a single finding."""
    if found.foreign:
        firmware = dict.fromkeys(profile.firmware for profile in PROFILES)
        what = f"{found.foreign} is neither {' nor '.join(firmware)}"
        return (Finding("", f"{what}: START is refused, and the guard refuses arming"),)
    if not found.parameters:
        return (Finding("", "the autopilot answers no request for parameters: nothing could be checked"),)
    findings = []
    for name, rule, of_guard, group in RULES:
        if group not in found.profile.rules or (of_guard and not limits.guard_required):
            continue
        parameter = name if isinstance(name, str) else name(found.profile)
        text = rule(found.parameters, found, limits)
        if text is not None:
            findings.append(_finding(parameter, text))
    for parameter, check, group in (*own_failsafes.CHECKS, *own_failsafes.further_checks(found.batteries)):
        text = check(found.parameters, found.plan) if group in found.profile.rules else None
        if text is not None:
            findings.append(_finding(parameter, text))
    return tuple(findings)


def _finding(parameter: str, text: str) -> Finding:
    return Finding(parameter, f"{parameter} {text}" if text.startswith("is ") else text)


def heights_lack(p: Mapping[str, float] | None, plan: PlanFacts | None, home_alt_m: float | None) -> str:
    """Why a plan would not be flown at the checked heights, in words; "" if it would.

    `p`: the parameters, None: not read yet; `home_alt_m`: the autopilot's home above the sea, None: not known.
    """
    if plan is None:
        return ""
    lacks = home_disagrees(plan.above_sea, plan.home_alt_m, home_alt_m), no_terrain(p, plan)
    return "; ".join(each for each in lacks if each)
