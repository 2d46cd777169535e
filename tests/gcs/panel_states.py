# SPDX-License-Identifier: GPL-3.0-or-later

"""Snapshots of a station in the states that its panel has to show, with all times relative to `NOW`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from gcs_module.panel.snapshot import (
    AircraftSeen,
    AlarmSeen,
    Border,
    LinkSeen,
    PeerSeen,
    Question,
    ReturnSite,
    Stamped,
    StationSeen,
)

NOW = 1000.0

CRAFT = AircraftSeen(
    sysid=1,
    name="drone-1",
    heard_at=NOW - 0.3,
    authority_at=NOW - 0.4,
    phase="on_mission",
    commander="GCSA",
    own=True,
    partner="",
    epoch=3,
    alone=False,
    rehearsal=False,
    zone="GCSA",
    zone_ends_at=None,
    action="",
    decision="",
    question=None,
    border=None,
    answer_until=None,
    mode=Stamped("AUTO", NOW - 0.5),
    armed=Stamped(True, NOW - 0.5),
    position=Stamped((52.679, 5.9245), NOW - 0.2),
    height_m=Stamped(30.2, NOW - 0.2),
    speed_mps=Stamped(5.1, NOW - 0.2),
    heading_deg=Stamped(88.0, NOW - 0.2),
    battery_percent=Stamped(94.0, NOW - 1.0),
    battery_v=Stamped(12.4, NOW - 1.0),
    battery_left_s=None,
    return_site=ReturnSite("home", 52.679, 5.924, 95.0, 0.12),
    payload=(),
    rerouted=False,
    mission="",
    overrides=(),
    briefing_at=None,
    briefing=(),
    alarms=(),
    links=(LinkSeen("udpin:0.0.0.0:14550", True, True, NOW - 0.1),),
    lines=(),
)
STATION = StationSeen(
    station="GCSA",
    at=NOW,
    program="handover_gcs 0.1.0",
    configuration="/etc/handover/station.toml",
    limits=("energy", "fence", "coverage"),
    operator="Jansen",
    required=False,
    next_operator="",
    next_until=None,
    aircraft=(CRAFT,),
    peers=(PeerSeen("GCSB", True, NOW - 0.5, Stamped("Bakker", NOW - 0.5)),),
)
TAKE = Question("252.251.3.7.-1", True, "GCSB", "GCSA", True, NOW + 18.4, NOW + 18.4, NOW - 1.0)
GIVE = Question("251.252.3.7.-1", False, "GCSA", "GCSB", True, NOW + 18.4, NOW + 18.4, NOW - 1.0)
BORDER = Border("251.252.3.7.-1", "GCSA", "GCSB", NOW + 42.2, "granted", "")
LOST = AlarmSeen(
    "commander",
    3,
    "No station commands drone-1. When it is in your zone, type 'handover request' to take over.",
    "The commander is lost or has released the aircraft in flight. By default it comes home.",
    "'handover request', if the aircraft is in your zone. Else watch it.",
    False,
    NOW - 4.0,
)
RETURNS = AlarmSeen("decision", 3, "RETURN to rally 2: GCSB silent 5 s.", "", "", False, NOW - 2.0)


def craft(**changes: Any) -> AircraftSeen:
    """The aircraft of a normal flight, with changes."""
    return replace(CRAFT, **changes)


def station(*aircraft: AircraftSeen, **changes: Any) -> StationSeen:
    """The station, with these aircraft."""
    return replace(STATION, aircraft=aircraft or (CRAFT,), **changes)
