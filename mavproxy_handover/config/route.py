# SPDX-License-Identifier: GPL-3.0-or-later

"""`[route]`: the limits of the route check, with the same keys in the configurations of vehicle and stations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.toml import one_table
from mavproxy_handover.core.safety.route import RouteLimits
from mavproxy_handover.tools.key_table import KeyTable, numbers

__all__ = ["ROUTE", "route_limits"]

#: the position of a receiver varies by some metres, so less than 5 is meaningless
ROUTE: Final = KeyTable(
    "route",
    numbers(
        """
            off_route_m      5 to 1000  the aircraft is off its route when it is farther than this beside the leg that
                                        it flies
            off_heading_deg  20 to 180  or when its course over ground is so far off that leg; 180 is never exceeded
            off_hold_s       0.5 to 60  one of the two for this long
            off_clear_s      0.5 to 60  it ends once both are below two thirds for this long
            """,
        RouteLimits(),
    ),
    "From when on the aircraft is off its route.",
)


def route_limits(data: Mapping[str, Any], path: Path) -> RouteLimits:
    """Parse `[route]`, if it is there. Raises ConfigError."""
    return RouteLimits(**one_table(data, ROUTE, path).given())
