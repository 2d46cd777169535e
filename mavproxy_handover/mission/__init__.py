# SPDX-License-Identifier: GPL-3.0-or-later

"""Mission packages: reading, checking and sending them, and zone facts for a position.

`load` reads a folder and `from_bytes` the data of a link. Both return a `MissionPackage`, whose route (`plan.py`,
`items.py`) and zones (`geojson.py`, `corridor.py`, `zones.py`) have been checked against each other. `ZoneFinder` turns
positions into facts in flight. `route_simulation.py` and `check.py` tell before flight what will happen; `picture.py`
draws it. A fault of a package is a `MissionError` of one line.
"""

from __future__ import annotations

import numpy  # noqa: F401  before shapely, which prints a traceback of its own when numpy is missing or broken

from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.items import MissionItem, RallyPoint, difference
from mavproxy_handover.mission.package import MissionPackage, StationEntry, from_bytes, load
from mavproxy_handover.mission.plan import Home, Route, read_route
from mavproxy_handover.mission.route_simulation import Gap, Handover, RouteSimulation, commanders_along
from mavproxy_handover.mission.zones import Circle, Zone, ZoneFinder, overlap

__all__ = [
    "Circle",
    "Gap",
    "Handover",
    "Home",
    "MissionError",
    "MissionItem",
    "MissionPackage",
    "RallyPoint",
    "Route",
    "StationEntry",
    "RouteSimulation",
    "Zone",
    "ZoneFinder",
    "commanders_along",
    "difference",
    "from_bytes",
    "load",
    "overlap",
    "read_route",
]
