# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds a second MAVLink route to the autopilot: a program on another of its ports, which no gate judges.

An autopilot passes heartbeats on between its ports. So a program on another port (a ground station, a router, an
onboard program, another vehicle) is heard here, through the autopilot. Parts of the aircraft that only report, such as
a gimbal, a camera or an ADS-B receiver, are no such route.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.doctor.finding import Finding, warning

__all__ = ["BEATS_S", "second_routes"]

#: heartbeats come once a second
BEATS_S: Final = 1.5
_COMMANDS: Final = {
    mavlink.MAV_TYPE_GCS: "a ground station",
    mavlink.MAV_TYPE_ONBOARD_CONTROLLER: "an onboard computer",
}


def second_routes(vehicle: int, beats: Mapping[tuple[int, int], int]) -> Iterator[Finding]:
    """The findings. `beats`: system and component of each foreign heartbeat, with its MAV_TYPE."""
    for (sysid, compid), kind in sorted(beats.items()):
        if sysid == vehicle and kind not in _COMMANDS:
            continue
        what = _COMMANDS.get(kind, "another vehicle or program")
        found = f"a second MAVLink route: {what}, system {sysid}, component {compid}, is heard through the autopilot"
        do = (
            "End that program or router, or close its port (SERIALn_PROTOCOL -1, NET_ENABLE 0): no gate judges what "
            "it sends. The page docs/neighbours.md names the usual ones."
        )
        yield warning("second route", found, do)
