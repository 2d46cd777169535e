# SPDX-License-Identifier: GPL-3.0-or-later

"""Limits of what may be sent on the line to the autopilot, by the vehicle's file."""

from __future__ import annotations

from mavproxy_handover.config.vehicle import VehicleConfig
from mavproxy_handover.core.authority.payload import FLIGHT, PayloadKind, PayloadSettings
from mavproxy_handover.core.feeds import NAMES
from mavproxy_handover.gate.feeds import feed_bytes_per_s
from mavproxy_handover.gate.filters import PAYLOAD_BYTES_PER_S
from mavproxy_handover.gate.line_budget import budget_finding
from mavproxy_handover.gate.policy.onboard import Right

__all__ = ["line_claims", "line_finding"]


def line_claims(config: VehicleConfig) -> dict[str, float]:
    """The limits (bytes a second) by the name of their sender. Of a feed, one station is the source at a time."""
    # what a payload manager says goes to the stations
    programs = [program.rights for program in config.onboard if program.rights.rights != {Right.MANAGER}]
    claims = {rights.name: rights.bytes_per_s for rights in programs}
    for kind, rule in config.feeds.rules.items():
        if rule.order:
            claims[NAMES[kind]] = feed_bytes_per_s(kind, config.feeds)
    payload = PayloadSettings(config.payload)
    if {payload.control(kind) for kind in PayloadKind} - {FLIGHT, *claims}:
        claims["payload"] = PAYLOAD_BYTES_PER_S
    return claims


def line_finding(config: VehicleConfig, baud: int) -> str:
    """What does not fit a line of this baud rate; "": all fits."""
    return budget_finding(line_claims(config), baud)
