# SPDX-License-Identifier: GPL-3.0-or-later

"""`[route]`: the limits of the route check, with the same keys in the configurations of vehicle and stations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.toml import Ranges, Table
from mavproxy_handover.core.safety.route import RouteLimits

__all__ = ["ROUTE_RANGES", "route_limits"]

#: the position of a receiver varies by some metres, so less than 5 is meaningless; a course is at most 180 degrees off
ROUTE_RANGES: Final[Ranges] = {
    "off_route_m": (5, 1000),
    "off_heading_deg": (20, 180),
    "off_hold_s": (0.5, 60),
    "off_clear_s": (0.5, 60),
}


def route_limits(data: Mapping[str, Any], path: Path) -> RouteLimits:
    """Parse `[route]`, if it is there. Raises ConfigError."""
    table = Table(data.get("route", {}), "route", path, tuple(ROUTE_RANGES))
    return RouteLimits(**table.numbers(ROUTE_RANGES))
