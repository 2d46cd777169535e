# SPDX-License-Identifier: GPL-3.0-or-later

"""Limits of what may be sent on the line to the autopilot, by the vehicle's file."""

from __future__ import annotations

from mavproxy_handover.config.vehicle import VehicleConfig
from mavproxy_handover.core.authority.payload import FLIGHT
from mavproxy_handover.core.feeds import NAMES
from mavproxy_handover.gate.feeds import feed_bytes_per_s
from mavproxy_handover.gate.filters import PAYLOAD_BYTES_PER_S
from mavproxy_handover.gate.line_budget import budget_finding

__all__ = ["line_claims", "line_finding"]


def line_claims(config: VehicleConfig) -> dict[str, float]:
    """The limits (bytes a second) by the name of their sender. Of a feed, one station is the source at a time."""
    claims = {program.name: program.rights.bytes_per_s for program in config.onboard}
    for kind, rule in config.feeds.rules.items():
        if rule.order:
            claims[NAMES[kind]] = feed_bytes_per_s(kind, config.feeds)
    if config.payload.control != FLIGHT and config.payload.control not in claims:
        claims["payload"] = PAYLOAD_BYTES_PER_S
    return claims


def line_finding(config: VehicleConfig, baud: int) -> str:
    """What does not fit a line of this baud rate; "": all fits."""
    return budget_finding(line_claims(config), baud)
