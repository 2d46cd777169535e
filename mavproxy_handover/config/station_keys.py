# SPDX-License-Identifier: GPL-3.0-or-later

"""The keys of a station's file, table by table. `config/station.py` reads them."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.config.route import ROUTE
from mavproxy_handover.tools.key_table import Key, KeyTable, called, flag, items, sysid, text, word

__all__ = ["ASK", "GROUND", "PEER", "STATION", "STATION_FILE", "VEHICLE"]

#: what is done with an address of the vehicle, or after the commander is lost: the operator is asked
ASK: Final = "ask"
_MISSION: Final = "missions/delivery"

STATION: Final = KeyTable(
    "station",
    (
        called("name", "as in the mission package and in the vehicle's configuration"),
        sysid("sysid", "the station's MAVLink id; MAVProxy runs with --source-system of this value"),
        sysid("vehicle", "the vehicle's MAVLink id; not together with [[vehicle]]", 1),
        text(
            "mission",
            "folder of the mission package; the parent needs it, the others receive it; not with [[vehicle]]",
            example=_MISSION,
        ),
        text(
            "key",
            "file of the key of this station, the same as the vehicle's; MAVProxy signs its links with it; not with "
            "[[vehicle]]",
        ),
        Key(
            "consent",
            object,
            "which planned handovers need no answer: automatic (for a zone or a link), operator (none), or a list of "
            "zone, link, request, give. The others wait for 'handover accept' or 'handover deny'",
            "automatic",
        ),
        word(
            "forced",
            ("automatic", ASK),
            "after the commander is lost: automatic (this station takes the aircraft at once), ask (its operator is "
            "asked; the aircraft returns meanwhile, and after an accept as well)",
            "automatic",
        ),
        flag(
            "require_operator",
            "true: the station takes an aircraft only while an operator is on duty ('handover operator NAME')",
            default=False,
        ),
        text(
            "serve",
            "a program on this computer that flies through this station, QGroundControl for one: udp:127.0.0.1:14550 "
            "(it listens there), udpin:127.0.0.1:14551 or tcpin:127.0.0.1:5770 (it connects). Its heartbeat is then "
            "required",
            example="udp:127.0.0.1:14550",
        ),
        text(
            "journal",
            "file of the journal; without it the name of the station and .jsonl. `handover station` writes it to the "
            "folder of the run (--logs)",
        ),
        word(
            "offered_addresses",
            (ASK, "refuse"),
            "what is done with an address of the vehicle that another station sends with a mission: ask (this "
            "station's operator confirms it, where this station has no link of its own), refuse",
            ASK,
        ),
        flag(
            "offered_addresses_local",
            "true: such an address may be one of this computer, for tests and simulations",
            default=False,
        ),
    ),
    required=True,
)
VEHICLE: Final = KeyTable(
    "vehicle",
    (
        called("name", "what the operator types"),
        sysid("sysid", "its MAVLink id"),
        items("links", "of this vehicle only; one or more, in pymavlink's form: udpin:0.0.0.0:14550", required=True),
        text("key", "file of the key between this station and this vehicle; no two vehicles share one"),
        flag("allow_unsigned", "true: without a key", default=False),
        text("mission", "folder of its mission package", example=_MISSION),
    ),
    "Several vehicles: a table for each, in the place of vehicle, mission and key in [station]. `handover station` "
    "opens their links.",
    many=True,
)
GROUND: Final = KeyTable(
    "ground",
    (
        text("listen", "where this station hears the others: udpin:HOST:PORT", required=True),
        text("key", "file of the key of the ground link, the same at every station; 'handover keys make ground'"),
        flag(
            "allow_unsigned",
            "true: without a key; any program that reaches the port can speak as another station",
            default=False,
        ),
    ),
    "The ground link: how stations reach each other without the vehicle. Without it everything goes through the "
    "vehicle.",
)
PEER: Final = KeyTable(
    "peer",
    (
        called("name", "another station, as it is called in the mission package"),
        sysid("sysid", "its MAVLink id"),
        text("link", "where it listens: udpout:HOST:PORT", required=True),
    ),
    "Each other station on the ground link.",
    many=True,
)

#: in the order in which they stand in the sample and in the reference
STATION_FILE: Final = (STATION, VEHICLE, GROUND, PEER, ROUTE)
