# SPDX-License-Identifier: GPL-3.0-or-later

"""Findings of `handover check` about `[payload]`: which station has what, and whether it reaches the aircraft."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from mavproxy_handover.core.authority.payload import FLIGHT, REQUEST, PayloadKind
from mavproxy_handover.mission.package import MISSION_FILE, MissionPackage
from mavproxy_handover.mission.route_simulation import RouteSimulation

__all__ = ["far_payloads", "idle_rules", "payload_words"]

#: a part of the route outside the zone that is worth a line
_WORTH: Final = 0.01


def payload_words(package: MissionPackage) -> str:
    """Which station has which kind of payload; "" if the mission does not say it."""
    rules = {kind: package.payload.of(kind) for kind in PayloadKind}
    whose = {FLIGHT: "the commander's", REQUEST: "the commander's until a station asks for it"}
    return "; ".join(
        f"{kind.value}: {whose.get(control, f'that of {control}')}" for kind, control in rules.items() if control
    )


def far_payloads(package: MissionPackage, simulation: RouteSimulation) -> Iterator[str]:
    """Stations that own a payload, and that the route leaves: warnings."""
    sysids = {station.name: station.sysid for station in package.stations}
    for kind in PayloadKind:
        owner = package.payload.of(kind)
        sysid = None if owner is None else sysids.get(owner)
        if sysid is None or not simulation.samples:
            continue
        outside = [sample for sample in simulation.samples if sysid not in sample.holding]
        part = len(outside) / len(simulation.samples)
        if part > _WORTH:
            yield (
                f"payload: the {kind.value} belongs to {owner}. {100.0 * part:.0f} % of the route is outside its zone, "
                f"first on the way to item {outside[0].seq}. No other station can work it there"
            )


def idle_rules(package: MissionPackage) -> Iterator[str]:
    """Rules without effect: warnings."""
    rules = [package.payload.of(kind) for kind in PayloadKind]
    if package.payload.at_handover is not None and None not in rules and REQUEST not in rules:
        yield (
            f"payload: at_handover in {MISSION_FILE} has no effect, because no station may ask for a payload. Remove "
            f"it, or write {REQUEST!r} for a kind"
        )
