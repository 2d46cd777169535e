# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks the autopilot: line, heartbeat, firmware, parameters, guard and time.

It listens first. An autopilot that reports that it is armed gets no questions from then on. The rules for parameters
are those of the companion (`monitors/preflight/rules.py`).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.cli.guard import version_of
from mavproxy_handover.config.line_claims import line_finding
from mavproxy_handover.config.vehicle import VehicleConfig
from mavproxy_handover.core.common.model import GuardState
from mavproxy_handover.doctor.advice import SENSORS, advice
from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok, unseen, warning
from mavproxy_handover.doctor.guard_script import card_checksum, shipped_script
from mavproxy_handover.doctor.journal import autopilot_by_journal
from mavproxy_handover.doctor.line import RATES, here, line_findings, usable
from mavproxy_handover.doctor.second_route import BEATS_S, second_routes
from mavproxy_handover.doctor.talk import Talk
from mavproxy_handover.link.devices import DeviceSpec, Kind, LinkError, open_device, parse_device
from mavproxy_handover.link.line_writer import has_rate
from mavproxy_handover.mission.heights import above_sea
from mavproxy_handover.monitors.preflight import rules
from mavproxy_handover.monitors.preflight.onboard_sensors import SENSOR_PARAMETERS, sensor_findings
from mavproxy_handover.monitors.preflight.own_failsafes import plan_facts
from mavproxy_handover.store.keys import KeysError, load_key
from mavproxy_handover.vehicle.guard_link import misfit_of
from mavproxy_handover.vehicle.parameter_reading import reading
from mavproxy_handover.wire.conversation import Ask, Asking, NoAnswer, command_long
from mavproxy_handover.wire.file_transfer import checksum
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, GUARD_STATUS_TUNNEL
from mavproxy_handover.wire.lease import GuardStatus, unpack_guard_status
from mavproxy_handover.wire.signing import SignedPeer

__all__ = ["autopilot"]

#: heartbeats come once a second
_HEARTBEAT_S: Final = 3.0
#: time (s) for each other baud rate
_RATE_S: Final = 1.5
#: the guard sends twice a second, after something has reached it
_GUARD_S: Final = 2.0
#: a signature may differ by a minute; a difference of this (s) means that the clocks were set separately
_OFF_S: Final = 5.0
_GRAVE_S: Final = 30.0
_KINDS: Final = {0: "-dev", 64: "-alpha", 128: "-beta", 192: "-rc"}
_NAME: Final = "autopilot"
_FULL: Final = (
    "Raise the baud rate here and in SERIALn_BAUD, or lower bytes_per_s in [[onboard]] and rtk_bytes_per_s in [feeds]."
)


def autopilot(context: CheckContext) -> Iterator[Finding]:
    """The findings of this check."""
    vehicle, master = context.vehicle, context.master
    if vehicle is None:
        if context.kind == "companion":
            yield unseen(_NAME, "there is no configuration to compare it with", "Put the configuration right first.")
        return
    context.find_companion()
    if context.running is not None:
        yield from autopilot_by_journal(context)
        return
    if master is None:
        yield unseen(_NAME, "its line is not given", "Give --device LINE,BAUD, as for 'handover companion --master'.")
        return
    try:
        spec = parse_device(master)
    except LinkError as fault:
        yield error(_NAME, str(fault), "Name the line in one of these forms.")
        return
    if spec.kind is Kind.SERIAL:
        findings = list(line_findings(context, spec, "the autopilot"))
        yield from findings
        if not usable(findings):
            return
        full = line_finding(vehicle, spec.port) if has_rate(str(context.at(Path(spec.host)))) else ""
        if full:
            yield warning("the autopilot's line", full, _FULL)
        spec = here(context, spec)
    try:
        peer = None if vehicle.autopilot_key is None else SignedPeer(_key(context, vehicle.autopilot_key))
        visit = _Visit(context, vehicle, spec, peer)
    except KeysError:  # reported with the keys
        yield unseen(_NAME, "its key cannot be used", "Put the key right first.")
        return
    except LinkError as fault:
        yield error(_NAME, str(fault), "Free the line, or name another one.")
        return
    try:
        yield from visit.findings()
    finally:
        visit.talk.close()


def _key(context: CheckContext, path: Path) -> bytes:
    return load_key(context.at(path), context.account.uid)


class _Visit:
    """One visit to one autopilot."""

    def __init__(
        self, context: CheckContext, vehicle: VehicleConfig, spec: DeviceSpec, peer: SignedPeer | None
    ) -> None:
        """Raises LinkError."""
        self._context = context
        self._vehicle = vehicle
        self._spec = spec
        self._peer = peer
        self._aircraft = context.aircraft
        self._heartbeat: Any = None
        self._guard: GuardStatus | None = None
        self._channel: int | None = None
        #: lead (s) of the autopilot's time over this computer's, if a receiver sets it
        self._ahead_s: float | None = None
        self.talk = self._open(spec)

    def _open(self, spec: DeviceSpec) -> Talk:
        other = self._vehicle.sysid, AUTOPILOT_COMPID
        device = open_device(spec.text)
        ways = self._heed, self._grounded, self._context.stop_if_companion_runs
        return Talk(device, self._vehicle.sysid, other, self._peer, self._context.clocks, *ways)

    def _heed(self, message: Any, _frame: Frame) -> None:
        """A message of the autopilot."""
        self._aircraft.on_message(message, self._context.clocks.monotonic())
        match message.get_type():
            case "HEARTBEAT":
                self._heartbeat = message
            case "TUNNEL" if message.payload_type == GUARD_STATUS_TUNNEL:
                payload = bytes(message.payload[: message.payload_length])
                self._guard = unpack_guard_status(payload) or self._guard
            case "SYSTEM_TIME" if message.time_unix_usec > 0:
                self._ahead_s = message.time_unix_usec / 1e6 - self._context.clocks.utc()

    def _grounded(self) -> bool:
        return not self._aircraft.armed

    def findings(self) -> Iterator[Finding]:
        """All findings, in the order of the questions."""
        self._context.tell(f"listening to the autopilot on {self._spec.text}, {_HEARTBEAT_S:g} s at most")
        self.talk.listen(_HEARTBEAT_S, lambda: self._heartbeat is not None)
        if self._heartbeat is None:
            yield from self._silent()
            return
        state = "armed" if self._aircraft.armed else "disarmed"
        kind = self._aircraft.foreign or self._aircraft.profile.firmware
        yield ok(_NAME, f"heartbeat of system {self._vehicle.sysid} on {self._spec.text}: {kind}, {state}")
        yield from self._asked() if self._grounded() else [self._is_armed()]
        self.talk.listen(BEATS_S)
        yield from second_routes(self._vehicle.sysid, self.talk.beats)

    def _is_armed(self) -> Finding:
        return unseen(
            "parameters", "the vehicle is armed, so it is listened to only", "Look again when it is disarmed."
        )

    # ---- no heartbeat -----------------------------------------------------------------------------------------------

    def _silent(self) -> Iterator[Finding]:
        counters, heard, bad = self.talk.device.counters, self.talk.heard, self.talk.bad
        if bad:
            found = f"its frames are not signed with autopilot_key: {', '.join(verdict.value for verdict in bad)}"
            yield error(_NAME, found, "Give the autopilot that key again, or name the key that it has.")
        elif heard:
            names = ", ".join(str(sysid) for sysid in sorted(heard))
            found = f"no heartbeat of system {self._vehicle.sysid}, but frames of system {names}"
            do = "Set [vehicle] sysid to that of the autopilot (MAV_SYSID, older SYSID_THISMAV), or name its line."
            yield error(_NAME, found, do)
        elif counters.bytes_in and self._spec.kind is Kind.SERIAL:
            yield self._wrong_rate(counters.bytes_in)
        elif counters.bytes_in:
            found = f"{counters.bytes_in} bytes and no frame of MAVLink in {_HEARTBEAT_S:g} s"
            yield error(_NAME, found, "Name the link that the autopilot's MAVLink is on.")
        else:
            trouble = self.talk.device.trouble
            found = f"no heartbeat: nothing arrives in {_HEARTBEAT_S:g} s{f' ({trouble})' if trouble else ''}"
            do = "Look whether it has power, at RX and TX, and at SERIALn_PROTOCOL (2) of its port."
            yield error(_NAME, found, do)

    def _wrong_rate(self, count: int) -> Finding:
        """Find the baud rate of a line that has bytes but no frames."""
        found = f"{count} bytes and no frame at {self._spec.port} baud"
        for rate in RATES:
            if rate == self._spec.port:
                continue
            self._context.tell(f"trying {rate} baud")
            self.talk.close()
            try:
                self.talk = self._open(here(self._context, self._spec, rate))
            except LinkError:  # a rate that this line does not support
                continue
            self.talk.listen(_RATE_S, lambda: bool(self.talk.heard))
            if self.talk.heard:
                do = f"Change the baud rate to {rate}: handover install companion --device LINE,{rate}."
                return error(_NAME, f"{found}: the baud rate is wrong, {rate} works", do)
        do = "Set SERIALn_PROTOCOL of its port to 2 and SERIALn_BAUD to the rate here, and look at the ground wire."
        return error(_NAME, f"{found}, nor at any other usual rate", do)

    # ---- what it is asked -------------------------------------------------------------------------------------------

    def _asked(self) -> Iterator[Finding]:
        sysid = self._vehicle.sysid
        self._context.tell("asking for the firmware's version and the time")
        version = self.talk.ask(_message(sysid, "AUTOPILOT_VERSION")).result
        if not self._grounded():
            yield self._is_armed()
            return
        firmware = None if version is None else (version.flight_sw_version >> 24, version.flight_sw_version >> 16 & 255)
        if version is not None:
            number = version.flight_sw_version
            kind = _KINDS.get(number & 255, "")
            yield ok("firmware", f"{number >> 24}.{number >> 16 & 255}.{number >> 8 & 255}{kind}")
        else:
            do = "Look at the autopilot's own console or at Mission Planner for its version."
            yield warning("firmware", "it does not tell its version", do)
        if self._ahead_s is None:
            self.talk.ask(_message(sysid, "SYSTEM_TIME"))
        package = self._context.package
        high = package is not None and bool(above_sea(package.route))
        if (high or self._vehicle.position.box) and self._aircraft.telemetry.own_position.value is None:
            self.talk.ask(_message(sysid, "GLOBAL_POSITION_INT"))
        yield self._time()
        names = rules.names_of(self._aircraft.profile, self._batteries)
        names += tuple(name for name in SENSOR_PARAMETERS if self._vehicle.onboard and name not in names)
        self._context.tell(f"reading {len(names)} parameters")
        parameters = self.talk.ask(reading(sysid, names)).result or {}
        self.talk.listen(_GUARD_S, lambda: self._guard is not None or not self._grounded())
        if not self._grounded():
            yield self._is_armed()
            return
        yield from self._judged(parameters, firmware)

    def _time(self) -> Finding:
        ahead_s = self._ahead_s
        if ahead_s is None:
            return ok("autopilot's time", "it has none yet: no fix of its receiver")
        found = f"{abs(ahead_s):.1f} s {'ahead of' if ahead_s > 0 else 'behind'} this computer's"
        do = "Have this computer follow network time or the receiver (chrony, gpsd): signatures rest on its clock."
        if abs(ahead_s) >= _GRAVE_S:
            return error("autopilot's time", found, do)
        return warning("autopilot's time", found, do) if abs(ahead_s) >= _OFF_S else ok("autopilot's time", found)

    def _judged(self, parameters: dict[str, float], firmware: tuple[int, int] | None) -> Iterator[Finding]:
        """Findings by the rules of the companion's own check before flight."""
        package = self._context.package
        guard = self._guard.state if self._guard is not None else GuardState.SILENT
        found = rules.Found(
            parameters,
            guard,
            firmware,
            self._aircraft.foreign,
            plan=None if package is None else plan_facts(package.route, package.cruise_speed_mps),
            gap_s=0.0 if package is None else max((gap.limit_s for gap in package.gaps), default=0.0),
            profile=self._aircraft.profile,
            batteries=self._batteries,
            home_alt_m=self._aircraft.home_alt_m,
        )
        wrong = rules.judge(found, self._vehicle.limits)
        for each in wrong:
            found_text = each.text.removeprefix(f"{each.parameter} ")
            yield error(
                each.parameter or "guard and firmware",
                found_text,
                advice(each.parameter, each.text, profile=self._aircraft.profile),
            )
        yield from self._sensors(parameters)
        if not wrong:
            yield ok("parameters", f"{len(parameters)} read, all of them fit")
        if self._vehicle.limits.guard_required and "HNDO_ENABLE" in parameters:
            yield self._of_guard()
            yield self._script()

    def _sensors(self, parameters: dict[str, float]) -> Iterator[Finding]:
        """Sensors of onboard programs, by the same rules as before a flight."""
        programs = self._vehicle.onboard
        sensors = {sensor for program in programs for sensor in program.rights.sensors}
        for text in sensor_findings(parameters, sensors) if programs and parameters else ():
            yield warning(SENSORS, text, advice("", text))

    @property
    def _batteries(self) -> int:
        """Number of batteries: the mission's number takes precedence over the vehicle's."""
        package, own = self._context.package, self._vehicle.energy
        energy = own if package is None else package.energy.over(own)
        return int(energy.batteries or 1)

    def _of_guard(self) -> Finding:
        status = self._guard
        if status is None:
            do = "Set HNDO_CHAN to the number of this port among the autopilot's MAVLink ports (handover_guard.md)."
            return warning("guard", "it has parameters, and says nothing on this port", do)
        misfit = misfit_of(status, keyed=self._vehicle.guard_key is not None)
        if misfit:
            return error("guard", misfit, advice("", misfit))
        state = f"{status.state.name.lower()}, {status.rejected} leases refused so far"
        if status.tampered:
            return error(
                "guard", f"{state}; it has noticed tampering", "Restart the autopilot, and find out who did it."
            )
        key = "" if self._vehicle.guard_key is None else "; whether its key is guard_key shows with the first lease"
        return ok("guard", f"{state}{key}")

    def _script(self) -> Finding:
        """Check that the guard on the card is the one of this installation."""
        ours = shipped_script()
        version = version_of(ours).removeprefix(", ") or "of no version"
        theirs = self.talk.ask(card_checksum(self._vehicle.sysid)).result
        if theirs is None:
            return ok("guard's script", f"the autopilot does not tell which one it is (here ships {version})")
        if theirs == checksum(ours):
            return ok("guard's script", f"the one that ships here, {version}")
        found = f"is not the one that ships here ({version})"
        do = "Put that on the card: handover guard CARD --force; the companion was tested with it alone."
        return warning("guard's script", found, do)


def _message(sysid: int, kind: str) -> Asking:
    """Ask for one message; returns None if it does not come."""
    wanted = getattr(mavlink, f"MAVLINK_MSG_ID_{kind}")
    request = command_long((sysid, AUTOPILOT_COMPID), mavlink.MAV_CMD_REQUEST_MESSAGE, wanted)

    def answer(message: Any) -> Any:
        return message if message.get_type() == kind else None

    try:
        return (yield Ask(kind, (request,), answer, timeout_s=0.7, tries=3))
    except NoAnswer:
        return None
