# SPDX-License-Identifier: GPL-3.0-or-later

"""Commands `handover ...` at the companion's MAVProxy. One table holds help, completion and functions."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable

from mavproxy_handover.companion.companion import Companion
from mavproxy_handover.core.common import events
from mavproxy_handover.core.common.model import GuardState
from mavproxy_handover.core.safety.commands import Limit
from mavproxy_handover.link.devices import Device
from mavproxy_handover.operator.requests.overrides import CONSOLE
from mavproxy_handover.operator.stations.missing_heartbeats import without_heartbeat
from mavproxy_handover.operator.stations.port import StationPort

__all__ = ["VehicleCommands"]


class VehicleCommands:
    """Operator commands on the vehicle. They show the state, and never change which station commands."""

    def __init__(self, companion: Companion, show: Callable[[str], None]) -> None:
        self._companion = companion
        self._show = show
        self._table: dict[str, tuple[str, Callable[[], None]]] = {
            "status": ("phase, commander, epoch, lease, guard, mission, energy", self._status),
            "stations": ("every station: link, liveness, what the gate did", self._stations),
            "zones": ("zones of the loaded mission and where the aircraft is", self._zones),
            "rehearsal": ("what was seen in the rehearsal on the ground, or in the last one", self._rehearsal),
            "cancel": ("call the present transfer off; the commander stays", self._cancel),
        }
        #: commands with an argument: its values, help text, function
        self._worded: dict[str, tuple[tuple[str, ...], str, Callable[[str], None]]] = {
            "override": (
                tuple(limit.value for limit in Limit),
                "let commands leave this limit for a minute, as the commander may",
                self._override,
            ),
        }

    def completions(self) -> list[str]:
        """For MAVProxy's tab completion."""
        worded = [f"{name} <{'|'.join(words)}>" for name, (words, _text, _run) in self._worded.items()]
        return ["<" + "|".join([*self._table, *self._worded]) + ">", *worded]

    def listed(self) -> list[tuple[str, str]]:
        """The commands with their help texts."""
        worded = [(f"{name} {'|'.join(words)}", text) for name, (words, text, _run) in self._worded.items()]
        return [*((name, text) for name, (text, _run) in self._table.items()), *worded]

    def run(self, args: list[str]) -> None:
        """Run one command line; anything unknown shows the usage."""
        if len(args) == 1 and args[0] in self._table:
            self._table[args[0]][1]()
            return
        if len(args) == 2 and args[0] in self._worded and args[1] in self._worded[args[0]][0]:
            self._worded[args[0]][2](args[1])
            return
        if args and args[0] != "help":
            self._show(f"handover: unknown command {' '.join(args)!r}")
        self._show("usage: handover <" + "|".join([*self._table, *self._worded]) + ">")
        for name, (text, _run) in self._table.items():
            self._show(f"  {name:9} {text}")
        for name, (words, text, _override) in self._worded.items():
            self._show(f"  {name:9} {'|'.join(words)}: {text}")

    def _status(self) -> None:
        companion, now = self._companion, time.monotonic()
        arbiter, view = companion.arbiter, companion.view
        self._show(
            f"phase     {view.phase.name}{'  (INTERNAL FAULT: no station commands)' if companion.failed else ''}"
        )
        if view.rehearsal:
            self._show("rehearsal the aircraft is carried: nothing arms, and nothing is commanded")
        partner = f", transfer to {arbiter.name(view.partner)}" if view.partner else ""
        self._show(f"commander {arbiter.name(view.commander)}, epoch {view.epoch}, lease {view.lease.name}{partner}")
        guard = arbiter.guard(now)
        status = companion.autopilot.guard.status
        detail = ""
        if status is not None and guard is not GuardState.SILENT:
            detail = f", firmware {status.firmware[0]}.{status.firmware[1]}, {status.rejected} leases refused"
            detail += ", ENFORCING" if status.enforcing else ""
            detail += ", TAMPERING NOTICED" if status.tampered else ""
            detail += ", VEHICLE TYPE NOT SUPPORTED" if status.foreign else ""
        self._show(f"guard     {guard.name}{detail}")
        digest = arbiter.mission_digest
        self._show(f"mission   {'none' if not digest else digest.hex()[:16]}")
        self._show(f"zone      {arbiter.name(arbiter.zone()) if arbiter.zone() else 'none'}")
        box = companion.autopilot.positions.words(companion.autopilot.aircraft, now)
        if box:
            where = companion.config.position
            self._show(f"position  by the {where.source}; {box}; layout {where.layout.name}")
        self._show(f"energy    {companion.autopilot.energy.fact.words()}")
        place = companion.autopilot.return_site.words()
        if place:
            self._show(f"place     {place}")
        route = companion.autopilot.route.words(now)
        if route:
            self._show(f"route     {route}")
        if companion.decision:
            self._show(f"decision  {companion.decision}")
        for limit, left_s in companion.autopilot.command_check.rules.lifted_s(now).items():
            self._show(f"lifted    {limit.value}, {left_s:.0f} s yet")
        if not companion.autopilot.aircraft.armed:
            needs = arbiter.start_needs(view.commander or companion.config.parent, now)
            self._show(f"START     {'ready' if not needs else 'not yet: ' + '; '.join(needs)}")
        findings = companion.autopilot.preflight.findings
        if findings == ():
            self._show("preflight guard, parameters and firmware fit")
        for finding in findings or ():
            self._show(f"preflight WARNING: {finding.text}")
        if companion.gate.in_our_name:
            senders = ", ".join(f"{s}/{c} {count}" for (s, c), count in companion.gate.in_our_name.most_common(8))
            self._show(f"aboard    frames in the companion's name from the vehicle's side, by sender: {senders}")
        if companion.faults:
            faults = ", ".join(f"{where} {count}" for where, count in companion.faults.items())
            self._show(f"faults    {faults} (see {companion.journal.path})")
        if companion.journal.lost:
            self._show(f"journal   {companion.journal.lost} entries lost: is the disk full?")

    def _stations(self) -> None:
        companion, now = self._companion, time.monotonic()
        for port in companion.ports.values():
            heard = companion.arbiter.heard_ago_s(port.sysid, now)
            seen = "never heard" if heard is None else f"heard {heard:.1f} s ago"
            if without_heartbeat(port, now):
                seen = "frames, but no heartbeat"
            state = "connected" if companion.arbiter.connected(port.sysid, now) else "not connected"
            self._show(f"{port.name} ({port.sysid}): {seen}, {state}")
            for link in port.links:
                counted = link.counters
                self._show(
                    f"  {link.device}: {_measured(port, link, now)}, "
                    f"{counted.frames_in} frames in, {counted.frames_out} out, {counted.bad_crc} damaged"
                )
            counts = Counter({reason.value: count for reason, count in companion.gate.counts[port.sysid].items()})
            counts.update({f"signature: {bad.name.lower()}": count for bad, count in port.bad_signatures.items()})
            verdicts = ", ".join(f"{what} {count}" for what, count in counts.most_common())
            self._show(f"  gate: {verdicts or 'nothing yet'}")

    def _zones(self) -> None:
        companion = self._companion
        facts = companion.autopilot.zones.facts()
        if not facts:
            self._show("no mission loaded, or no position yet")
        for fact in facts:
            name = companion.arbiter.name(fact.station)
            ends = "" if fact.exit_s is None else f", ends in {fact.exit_s:.0f} s on this track"
            where = (
                f"inside, {fact.margin_m:.0f} m to its border" if fact.margin_m > 0 else f"{-fact.margin_m:.0f} m away"
            )
            awaits = ", awaits it at a waypoint" if fact.awaits else ""
            self._show(f"{name}: {where}{ends}{awaits}")

    def _rehearsal(self) -> None:
        for line in self._companion.rehearsal.lines(time.monotonic()):
            self._show(line)

    def _override(self, limit: str) -> None:
        self._companion.autopilot.command_check.lift(Limit(limit), CONSOLE, time.monotonic())

    def _cancel(self) -> None:
        companion = self._companion
        if companion.view.partner is None:
            self._show("no transfer is under way")
            return
        companion.handle(events.Cancel(companion.view.partner), time.monotonic())


def _measured(port: StationPort, link: Device, now: float) -> str:
    """Text about a link: its error, if any, and the measurements of the last seconds."""
    quality = port.quality(link, now)
    words = [link.trouble] if link.trouble else []
    if len(port.links) > 1:
        words.append("in use" if port.carries(link) else "in reserve")
    words.append("never heard" if quality.heard_ago_s is None else f"heard {quality.heard_ago_s:.1f} s ago")
    if quality.loss is not None:
        words.append(f"{quality.loss:.0%} lost")
    if quality.downlink_loss is not None:
        words.append(f"{quality.downlink_loss:.0%} of the downlink lost")
    if quality.round_trip_s is not None and quality.jitter_s is not None:
        words.append(f"round trip {quality.round_trip_s * 1000:.0f} ms (jitter {quality.jitter_s * 1000:.0f} ms)")
    counted = {
        "out of order": quality.reordered,
        "twice": quality.duplicates,
        "badly signed": quality.bad_signatures,
        "dropped by a full receive buffer": quality.overflowed,
    }
    return ", ".join([*words, *(f"{number} {what}" for what, number in counted.items() if number)])
