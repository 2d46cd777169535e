# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks each station from the companion: is it heard, signed with its key, and what is the round trip?

It sends only the companion's own probes (`link/timesync.py`) from its own ports: no heartbeat, no message of a
transfer. So no station mistakes this for a running companion.
"""

from __future__ import annotations

import select
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final

from mavproxy_handover.config.files import StationLinks
from mavproxy_handover.config.vehicle import VehicleConfig
from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, badly_signed, error, ok, unseen, warning
from mavproxy_handover.doctor.journal import links_by_journal
from mavproxy_handover.doctor.line import here, line_findings, usable
from mavproxy_handover.link.devices import Device, Kind, LinkError, open_device, parse_device
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.store.keys import KeysError, StationKeys, load_station_keys
from mavproxy_handover.wire.signing import SignatureVerdict

__all__ = ["stations"]

#: heartbeats come once a second, and a single link is probed twice as often
_LISTEN_S: Final = 4.0
_TICK_S: Final = 0.05
_SILENT: Final = "Start 'handover station' there; then look at its address, its firewall and the link between."


@dataclass(slots=True)
class _Asked:
    """A station with its opened links. `findings`: about links that did not open."""

    config: StationLinks
    links: list[Device] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    port: StationPort | None = None


def stations(context: CheckContext) -> Iterator[Finding]:
    """The findings of this check."""
    vehicle = context.vehicle
    if vehicle is None:
        return
    context.find_companion()
    if context.running is not None:
        yield from links_by_journal(context)
        return
    if not context.links:
        return
    if context.clock_wrong or context.aircraft.armed:
        why = "the clock is wrong, and probes are signed by it" if context.clock_wrong else "the vehicle is armed"
        do = "Set the clock first." if context.clock_wrong else "Look again when it is disarmed."
        yield unseen("stations", why, do)
        return
    asked: list[_Asked] = []
    try:
        for config in vehicle.stations:
            asked.append(_opened(context, vehicle, config))
        context.tell(f"probing {len(asked)} stations, {_LISTEN_S:g} s at most")
        _listen(context, [each for each in asked if each.port is not None])
        now = context.clocks.monotonic()
        for each in asked:
            yield from each.findings
            yield from _found(each, now)
    finally:
        for each in asked:
            for link in each.links:
                link.close()


def _opened(context: CheckContext, vehicle: VehicleConfig, config: StationLinks) -> _Asked:
    asked = _Asked(config)
    name = config.station.name
    try:
        keys: StationKeys | None = None
        if config.key is not None:
            keys = load_station_keys(context.at(config.key), context.account.uid)
    except KeysError:  # reported with the keys
        asked.findings.append(unseen(name, "its key cannot be used", "Put the key right first."))
        return asked
    for text in config.links:
        spec = parse_device(text)
        if spec.kind is Kind.SERIAL:
            findings = list(line_findings(context, spec, name))
            asked.findings += findings
            if not usable(findings):
                continue
            spec = here(context, spec)
        try:
            asked.links.append(open_device(spec.text))
        except LinkError as fault:  # the reason is reported with the ports
            asked.findings.append(unseen(f"{name}, {text}", str(fault), "Free it first."))
    if asked.links:
        opened = replace(config, links=tuple(link.device for link in asked.links))
        asked.port = StationPort(opened, tuple(asked.links), vehicle.sysid, keys, context.clocks)
    return asked


def _listen(context: CheckContext, asked: list[_Asked]) -> None:
    end = context.clocks.monotonic() + _LISTEN_S
    while (now := context.clocks.monotonic()) < end and not all(_complete(each, now) for each in asked):
        context.stop_if_companion_runs()
        waiting = select.poll()
        for each in asked:
            assert each.port is not None
            each.port.tick(now)
            for link in each.links:
                if link.fileno() >= 0:
                    waiting.register(link.fileno(), select.POLLIN)
        waiting.poll(_TICK_S * 1000.0)
        now = context.clocks.monotonic()
        for each in asked:
            assert each.port is not None
            for link in each.links:
                each.port.read(link, now)


def _complete(asked: _Asked, now: float) -> bool:
    """True if each link has answered."""
    port = asked.port
    return port is not None and all(port.quality(link, now).round_trip_s is not None for link in asked.links)


def _found(asked: _Asked, now: float) -> Iterator[Finding]:
    port = asked.port
    if port is None:
        return
    bad = [verdict for verdict in port.bad_signatures if verdict is not SignatureVerdict.OK]
    for link in asked.links:
        what, quality = f"{port.name}, {link.device}", port.quality(link, now)
        if quality.round_trip_s is not None:
            yield ok(what, f"there and back in {quality.round_trip_s * 1000:.1f} ms")
        elif quality.heard_ago_s is not None and asked.config.station.standard:
            yield ok(what, "heard; its program answers no probes, which is usual without handover_gcs")
        elif quality.heard_ago_s is not None:
            do = "Load handover_gcs there ('handover station'), or give this station module = false."
            yield warning(what, "heard, and it answers no probes", do)
        elif bad:
            yield badly_signed(what, port.name, bad, port.peer)
        else:
            trouble = f" ({link.trouble})" if link.trouble else ""
            yield error(what, f"silent for {_LISTEN_S:g} s{trouble}", _SILENT)
