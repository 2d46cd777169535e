# SPDX-License-Identifier: GPL-3.0-or-later

"""Do guard, parameters and firmware of the autopilot fit? Read on the ground, judged, and said before the flight.

Nothing here refuses a flight: what START needs is the arbiter's to say. These are the settings that make a flight end
otherwise than planned when something fails: a failsafe that is off, one that acts before its turn, rally points that
are ignored, a guard that listens at the wrong port.

What concerns the autopilot's own failsafes is in `own_failsafes.py`.

Three parts: `reading` asks (a conversation), `judge` knows (a table of pure rules), `Preflight` decides when.

ArduPilot does not answer a request for a parameter that it does not have, so the names that it lacks cost a time-out;
they are asked for together, and again only those that have not come. Sources of the rules: the reasons in
`ardupilot_lua/handover.parm`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.model import GuardState, Kind
from mavproxy_handover.core.safety.energy_prior import ENERGY_RANGES, EnergySettings
from mavproxy_handover.mission.heights import home_disagrees
from mavproxy_handover.monitors.preflight import own_failsafes
from mavproxy_handover.monitors.preflight.own_failsafes import (
    COPTERS,
    EVERY,
    WINGED,
    PlanFacts,
    circles_for_ever,
    no_terrain,
)
from mavproxy_handover.vehicle.kinds import COPTER, PLANE, Vehicle
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Ask, Asking, Conversation, Conversations, NoAnswer
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID

__all__ = ["NAMES", "PLANE_NAMES", "Finding", "Found", "Preflight", "heights_lack", "judge", "names_of", "reading"]

#: of the guard, of the station that the autopilot obeys, and of what it says that it is
_SHARED: Final = (
    "SCR_ENABLE", "HNDO_ENABLE", "HNDO_CHAN", "HNDO_COMPID", "HNDO_TIMEOUT", "HNDO_LOST_T", "HNDO_SYSID_SW",
    "HNDO_ALONE_MAX", "Q_MAV_TYPE",
)  # fmt: skip
#: what is read of ArduCopter; of two names in a row a firmware has one (up to 4.6, from 4.7)
NAMES = (
    *_SHARED, "FS_GCS_ENABLE", "FS_GCS_TIMEOUT", "FS_OPTIONS", "RALLY_LIMIT_KM",
    "SYSID_ENFORCE", "MAV_OPTIONS", "FS_THR_ENABLE", "RC_PROTOCOLS", "SCR_VM_I_COUNT", "SCR_LD_CHECKSUM",
    "ARMING_CHECK", "ARMING_SKIPCHK", *own_failsafes.NAMES,
)  # fmt: skip
#: what is read of ArduPlane
PLANE_NAMES = (
    *_SHARED, "FS_GCS_ENABL", "FS_LONG_TIMEOUT", "RALLY_LIMIT_KM",
    "SYSID_ENFORCE", "MAV_OPTIONS", "THR_FAILSAFE", "RC_PROTOCOLS", "SCR_VM_I_COUNT", "SCR_LD_CHECKSUM",
    "ARMING_CHECK", "ARMING_SKIPCHK", "ARMING_REQUIRE", "WP_LOITER_RAD", "RTL_RADIUS", *own_failsafes.PLANE_NAMES,
)  # fmt: skip
_NAMES_OF: Final = {COPTER: NAMES, PLANE: PLANE_NAMES}
_MOST_BATTERIES: Final = int(ENERGY_RANGES["batteries"][1])
_KNOWN: Final = frozenset((*NAMES, *PLANE_NAMES, *own_failsafes.further_names(_MOST_BATTERIES)))
OLDEST, NEWEST = (4, 5), (4, 7)

#: ArduPilot keeps 20 requests and drops the rest
_AT_ONCE = 16
_WAIT_S = 0.4
_TRIES = 3
#: scripts start a few seconds after the autopilot's first heartbeat; a guard that speaks has its parameters
_SETTLE_S = 8.0
_AGAIN_S = 30.0
_REBOOT_S = 3.0
#: a forced transfer behind a recovery needs that much of the guard's patience; parameters have 24 bits
_FORCED_S, _ROUNDED_S = 0.5, 1e-4
_CONTINUE_AUTO, _CONTINUE_PILOT = 0b10, 0b10000
#: FS_GCS_ENABL
_IN_AUTO_ONLY = 3
#: Q_MAV_TYPE: as it comes, and FIXED_WING, which is the same (`QuadPlane::get_mav_type`)
_OWN_TYPES = (0, mavlink.MAV_TYPE_FIXED_WING)
_WRONG_CHANNEL = re.compile(r"HNDO: lease refused, channel (\d+) not (-?\d+)")


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that does not fit; `parameter` is what to change ("" if it is none)."""

    parameter: str
    text: str


@dataclass(frozen=True, slots=True)
class Found:
    """What is known of the autopilot. `parameters` lacks those that it does not have."""

    parameters: Mapping[str, float]
    guard: GuardState
    #: major and minor version that the guard gives; None while it is silent
    firmware: tuple[int, int] | None = None
    #: what the vehicle is, in words, if that is nothing that is flown here
    foreign: str = ""
    #: the channel that the guard says leases come in on, when it refuses them for that
    heard_on: int | None = None
    #: of the mission that the autopilot holds; None without one
    plan: PlanFacts | None = None
    #: the longest that it may be alone in a gap (s); 0 without gaps
    gap_s: float = 0.0
    #: what kind of aircraft it is
    kind: Kind = Kind.COPTER
    #: how many it flies by: monitors 0 and up
    batteries: int = 1
    #: its home above the sea (m); None: not known
    home_alt_m: float | None = None
    #: why leases and guard do not fit, in words
    misfit: str = ""

    @property
    def vehicle(self) -> Vehicle:
        """Its firmware."""
        return PLANE if self.kind.winged else COPTER


def names_of(vehicle: Vehicle, batteries: int = 1) -> tuple[str, ...]:
    """The parameters that are read of an autopilot with this firmware, which flies by so many batteries."""
    return (*_NAMES_OF[vehicle], *own_failsafes.further_names(batteries))


# ---- reading ------------------------------------------------------------------------------------------------------


def reading(sysid: int, names: tuple[str, ...] = NAMES) -> Asking:
    """Ask the autopilot of system `sysid` for parameters. Returns name -> value of those that it answered."""
    values: dict[str, float] = {}
    for start in range(0, len(names), _AT_ONCE):
        batch = names[start : start + _AT_ONCE]
        lacking: set[str] = set()
        for _ in range(_TRIES):
            missing = [name for name in batch if name not in values and name not in lacking]
            if not missing:
                break
            requests = tuple(_request(sysid, name) for name in missing)
            try:
                yield Ask("parameters", requests, _collector(missing, values, lacking), timeout_s=_WAIT_S, tries=1)
            except NoAnswer:
                continue
    return values


def _request(sysid: int, name: str) -> Any:
    return mavlink.MAVLink_param_request_read_message(sysid, AUTOPILOT_COMPID, name.encode("ascii"), -1)


def _collector(wanted: list[str], values: dict[str, float], lacking: set[str]) -> Callable[[Any], Any]:
    """Takes the answers in as they come; they are an answer when nothing is missing any more."""

    def answer(m: Any) -> Any:
        kind = m.get_type()
        if kind not in ("PARAM_VALUE", "PARAM_ERROR") or m.param_id not in wanted:
            return None
        if kind == "PARAM_ERROR":
            lacking.add(m.param_id)
        elif math.isfinite(m.param_value):
            values[m.param_id] = float(m.param_value)
        return True if all(name in values or name in lacking for name in wanted) else None

    return answer


# ---- judging ------------------------------------------------------------------------------------------------------

#: fewer, and a script that is slow once is removed
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
    enabled, timeout = found.vehicle.gcs_failsafe, found.vehicle.gcs_timeout
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
    if p.get(found.vehicle.radio_failsafe, 1) != 0 or p.get("RC_PROTOCOLS", 1) == 0:
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
    enabled = p.get(found.vehicle.gcs_failsafe, 1)
    if enabled == _IN_AUTO_ONLY and found.kind.winged:
        return "is 3: it acts in AUTO alone, and nothing brings home what circles or flies to a place"
    return None if enabled != 0 else "is 0: nothing brings the aircraft home if companion and guard both fail"


def _gcs_timeout(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    timeout_s = p.get(found.vehicle.gcs_timeout, math.inf)
    needed_s = limits.heartbeat_lost_s + limits.forced_timeout_s
    if p.get(found.vehicle.gcs_failsafe, 0) == 0 or timeout_s > needed_s:
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
    return f"is {limit_km:g}: a return goes home where the chosen place is farther away" if limit_km > 0 else None


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
    return "is 0: it is always armed, and a mode alone makes it take off; nobody can refuse arming"


def _lands(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    lacks = circles_for_ever(p, found.plan, found.kind)
    return f"a return does not land: {lacks}; START is refused" if lacks else None


def _home_height(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    plan = found.plan
    lacks = "" if plan is None else home_disagrees(plan.above_sea, plan.home_alt_m, found.home_alt_m)
    return f"{lacks}; START is refused" if lacks else None


def _other_type(p: Mapping[str, float]) -> str:
    """What an ArduPlane is set to say of itself, in words, where that is something else; "" where it is not. No copter
    has this parameter, so what has it and says that it is one is none."""
    number = int(p.get("Q_MAV_TYPE", 0))
    return "" if number in _OWN_TYPES else f"Q_MAV_TYPE is {number}: its modes are taken for those of another aircraft"


def _type(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    other = _other_type(p)
    return f"{other}; START is refused" if other else None


def _firmware(p: Mapping[str, float], found: Found, limits: Limits) -> str | None:
    if found.firmware is None or found.firmware == (0, 0) or OLDEST <= found.firmware <= NEWEST:
        return None
    major, minor = found.firmware
    what = "older than the oldest" if found.firmware < OLDEST else "newer than the newest"
    edge = OLDEST if found.firmware < OLDEST else NEWEST
    return f"firmware {major}.{minor} is {what} that this was made for, {edge[0]}.{edge[1]}"


_BY_VEHICLE: Final = ((COPTER, COPTERS), (PLANE, WINGED))
#: parameter to change ("" for none), rule, whether it concerns the guard, kinds of aircraft that it is for
_RULES: tuple[tuple[str, Rule, bool, frozenset[Kind]], ...] = (
    ("Q_MAV_TYPE", _type, False, EVERY),
    ("", _lands, False, WINGED),
    ("", _home_height, False, EVERY),
    ("ARMING_REQUIRE", _arming_required, False, WINGED),
    ("", _guard_there, True, EVERY),
    ("HNDO_ENABLE", _guard_on, True, EVERY),
    ("", _fits, True, EVERY),
    ("HNDO_CHAN", _channel, True, EVERY),
    ("HNDO_COMPID", _component, True, EVERY),
    ("HNDO_TIMEOUT", _timeout, True, EVERY),
    ("HNDO_LOST_T", _lost_time, True, EVERY),
    ("HNDO_SYSID_SW", _follows, True, EVERY),
    ("HNDO_ALONE_MAX", _alone, True, EVERY),
    ("SCR_VM_I_COUNT", _instructions, True, EVERY),
    ("SCR_LD_CHECKSUM", _checksum, True, EVERY),
    *((vehicle.radio_failsafe, _pilot, True, kinds) for vehicle, kinds in _BY_VEHICLE),
    *((vehicle.gcs_failsafe, _gcs_failsafe, False, kinds) for vehicle, kinds in _BY_VEHICLE),
    *((vehicle.gcs_timeout, _gcs_timeout, False, kinds) for vehicle, kinds in _BY_VEHICLE),
    ("FS_OPTIONS", _options, False, COPTERS),
    ("RALLY_LIMIT_KM", _rally, False, EVERY),
    ("SYSID_ENFORCE", _enforce, False, EVERY),
    ("MAV_OPTIONS", _mav_options, False, EVERY),
    ("ARMING_CHECK", _arming_check, True, EVERY),
    ("ARMING_SKIPCHK", _arming_skip, True, EVERY),
    ("", _firmware, True, EVERY),
)


def judge(found: Found, limits: Limits) -> tuple[Finding, ...]:
    """Everything that does not fit, the gravest first. An autopilot that answers nothing is one finding, and so is one
    that is not flown here."""
    if found.foreign:
        what = f"{found.foreign} is neither ArduCopter nor ArduPlane"
        return (Finding("", f"{what}: START is refused, and so is arming by the guard"),)
    if not found.parameters:
        return (Finding("", "the autopilot answers no request for parameters: nothing could be checked"),)
    findings = []
    for parameter, rule, of_guard, kinds in _RULES:
        if found.kind not in kinds or (of_guard and not limits.guard_required):
            continue
        text = rule(found.parameters, found, limits)
        if text is not None:
            findings.append(_finding(parameter, text))
    for parameter, own, kinds in (*own_failsafes.RULES, *own_failsafes.further_rules(found.batteries)):
        text = own(found.parameters, found.plan) if found.kind in kinds else None
        if text is not None:
            findings.append(_finding(parameter, text))
    return tuple(findings)


def _finding(parameter: str, text: str) -> Finding:
    return Finding(parameter, f"{parameter} {text}" if text.startswith("is ") else text)


def heights_lack(p: Mapping[str, float] | None, plan: PlanFacts | None, home_alt_m: float | None) -> str:
    """Why a plan would not be flown at the heights that were checked, in words; "" if it would. `p`: the parameters,
    None: not read yet; `home_alt_m`: the autopilot's home above the sea, None: not known."""
    if plan is None:
        return ""
    lacks = home_disagrees(plan.above_sea, plan.home_alt_m, home_alt_m), no_terrain(p, plan)
    return "; ".join(each for each in lacks if each)


# ---- when ---------------------------------------------------------------------------------------------------------


_UNSAID: Final = EnergySettings()


def _batteries(energy: EnergySettings) -> int:
    return int(energy.batteries or 1)


class Preflight:
    """Reads once the autopilot is up and on the ground; a START meanwhile does not stop it. Again every half minute
    while something does not fit, and after a reboot.

    `report` is told each finding that is new (text, parameter to change, False), and once that all is well (True)."""

    def __init__(
        self,
        sysid: int,
        aircraft: VehicleState,
        limits: Limits,
        conversations: Conversations,
        report: Callable[[str, str, bool], None],
        energy: EnergySettings = _UNSAID,
    ) -> None:
        """`energy`: the vehicle's own, which says how many batteries it flies by where the mission does not."""
        self._sysid = sysid
        self._aircraft = aircraft
        self._limits = limits
        self._conversations = conversations
        self._report = report
        #: None: not read yet
        self.findings: tuple[Finding, ...] | None = None
        self._heard_at = -math.inf
        self._due_at = math.inf
        self._unread = True
        self._heard_on: int | None = None
        self._misfit = ""
        self._plan: PlanFacts | None = None
        self._gap_s = 0.0
        self._own_energy = energy
        self._batteries = _batteries(energy)
        self._replanned = False

    def planned(self, plan: PlanFacts | None, gap_s: float = 0.0, energy: EnergySettings | None = None) -> None:
        """The autopilot holds another mission, or none: once it has been read, it is read again for one.

        `gap_s`: the longest limit of its gaps. `energy`: the mission's, which goes before the vehicle's; None: that
        stays as it was."""
        self._plan, self._replanned = plan, plan is not None
        self._gap_s = gap_s
        if energy is not None:
            self._batteries = _batteries(energy.over(self._own_energy))

    @property
    def parameters(self) -> Mapping[str, float] | None:
        """What the autopilot has told since the last reading began; None before a reading has ended."""
        return self._aircraft.parameters.read

    @property
    def radio_watched(self) -> bool:
        """Losing the radio would be noticed, as far as is known."""
        return (self.parameters or {}).get(self._aircraft.vehicle.radio_failsafe, 1) != 0

    def heights_lack(self, home_alt_m: float | None) -> str:
        """Why the plan would not be flown at the heights that were checked, in words; "" if it would. `home_alt_m`: the
        autopilot's home above the sea, None: not known."""
        return heights_lack(self.parameters, self._plan, home_alt_m)

    @property
    def other_type(self) -> str:
        """What it is set to say of itself that it is not, in words; "" if it is not."""
        return _other_type(self.parameters or {})

    def circles_for_ever(self, kind: Kind) -> str:
        """Why a return does not end in a landing, in words; "" if it does."""
        return circles_for_ever(self.parameters, self._plan, kind)

    def text(self, text: str) -> None:
        """A STATUSTEXT of the autopilot: the guard names the channel that it refuses leases from."""
        match = _WRONG_CHANNEL.fullmatch(text)
        if match is not None:
            self._heard_on = int(match[1])

    def each_second(
        self,
        grounded: bool,
        guard: GuardState,
        firmware: tuple[int, int] | None,
        now: float,
        misfit: str = "",
    ) -> None:
        """Time has passed. `grounded`: neither armed nor flying, or on the ground and always armed. `misfit`: why
        leases and guard do not fit."""
        aircraft, heartbeat_at = self._aircraft, self._aircraft.telemetry.heartbeat.at
        if heartbeat_at - self._heard_at > _REBOOT_S:  # appeared, or came back: another one, for all that is known
            self._due_at = now + _SETTLE_S
            self._heard_on, self._unread = None, True
        self._heard_at = heartbeat_at
        if self._unread and guard is not GuardState.SILENT:
            self._due_at = now
        if misfit != self._misfit:
            self._misfit, self._due_at = misfit, now
        if self._replanned and self.findings is not None and "preflight" not in self._conversations:
            self._replanned, self._due_at = False, now
        if now < self._due_at or not grounded or now - heartbeat_at > _REBOOT_S or "preflight" in self._conversations:
            return
        self._due_at, self._unread = math.inf, False
        batteries, asked_at = self._batteries, now

        def done(_talk: Conversation, now: float) -> None:
            aircraft.parameters.reading_ended(asked_at)
            values = aircraft.parameters.since(asked_at)
            parameters = {name: values[name] for name in _KNOWN if name in values}
            told = aircraft.foreign, self._heard_on, self._plan, self._gap_s, aircraft.kind, batteries
            found = Found(parameters, guard, firmware, *told, aircraft.home_alt_m, self._misfit)
            self._conclude(judge(found, self._limits), now)

        self._conversations.begin("preflight", reading(self._sysid, names_of(aircraft.vehicle, batteries)), done, now)

    def _conclude(self, findings: tuple[Finding, ...], now: float) -> None:
        before, self.findings = self.findings, findings
        if findings:
            self._due_at = now + _AGAIN_S
        for finding in findings:
            if finding not in (before or ()):
                self._report(finding.text, finding.parameter, False)
        if not findings and before != ():
            self._report("guard, parameters and firmware fit", "", True)
