# SPDX-License-Identifier: GPL-3.0-or-later

"""How a flight begins: the steps that most scenarios share, made for the stations that the mission has.

`begin` in a scenario file names how far its opening goes; the scenario's own steps follow it. A station that speaks the
MAVLink standard only answers no CONNECT and takes no mission package, so nothing of that is waited for. Of what has
wings START needs to know how a return ends, and its autopilot takes longer: both is waited for.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from mavproxy_handover.mission.package import MissionPackage
from sitl.report.matching import Match
from sitl.script.steps import Deed, Pause, Type, Wait, WaitReady

__all__ = ["BEGINNINGS", "opening"]

#: stations connected and the parent in command; the mission loaded; on the way
BEGINNINGS = ("connected", "loaded", "start")

#: (what is done or waited for, time limit in simulated seconds, what is told)
Opened = tuple[Deed, float, str]
_CONNECT_S = 40.0
_PACKAGE_S = 60.0
_ZONE_S = 20.0
_READY_S = 120.0
_START_S = 60.0
#: firmware -> how long (simulated s) after its first position it arms: ArduPlane waits until its gyros agree
_SETTLES_S: Final = {"ArduPlane": 15.0}


def opening(
    begin: str,
    package: MissionPackage,
    standard: Collection[str] = (),
    shows: Collection[str] = (),
    *,
    on_board: bool = False,
) -> list[Opened]:
    """The steps. `standard`: stations without our module; `shows`: those of them that show before START that they know
    operator control; `on_board`: the vehicle has the mission already."""
    parent = package.parent.name
    steps: list[Opened] = [
        (
            _vehicle("station_heard" if station.name in standard else "connected", station.name, since="begin"),
            _CONNECT_S,
            "",
        )
        for station in package.stations
    ]
    steps.append((_vehicle("authority", parent, since="begin"), _CONNECT_S, ""))
    settles_s = _SETTLES_S.get(package.profile.firmware, 0.0)
    steps.append((WaitReady(True), _READY_S, ""))
    if settles_s:
        steps.append((Pause(settles_s), _READY_S, ""))
    if begin == "connected":
        return steps
    if not on_board:
        told = "The parent station shares the mission with the vehicle and with its partners."
        steps.append((Type(parent, "handover share"), _PACKAGE_S, told))
    steps.append((_vehicle("mission_loaded", since="begin"), _PACKAGE_S, ""))
    steps.append((_vehicle("zone_entered", parent, since="begin"), _ZONE_S, ""))
    if settles_s:
        steps.append((_vehicle("preflight", since="begin"), _PACKAGE_S, ""))
    if not on_board:
        steps += [
            (Wait("package_received", station.name, "begin"), _PACKAGE_S, "")
            for station in package.stations
            if station != package.parent
        ]
    if begin == "loaded":
        return steps
    for name in shows:  # the commander forbids takeover, which changes nothing; another's release is refused
        steps.append((Type(name, "request" if name == parent else "release"), _ZONE_S, ""))
        steps.append((_vehicle("control", name, since="begin"), _ZONE_S, ""))
    line = "start" if parent in standard else "handover start"
    steps.append((Type(parent, line), _ZONE_S, "START."))
    steps.append((_vehicle("started"), _START_S, ""))
    return steps


def _vehicle(event: str, station: str = "", *, since: str = "typed") -> Wait:
    return Wait(event, "drone-1", since, Match((("station", station),) if station else ()))
