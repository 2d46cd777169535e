# SPDX-License-Identifier: GPL-3.0-or-later

"""Descriptions of all configuration keys for people, table by table. `docs/reference` is made from them.

Causes have their meaning in `core/common/causes.py`, links their forms in `link/forms.py`. Types, ranges and defaults
are in the modules that read the files; a test compares the keys with theirs. `MISSION` describes mission.toml. A unit
is in the name of its key.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from mavproxy_handover.core.common.causes import CAUSES
from mavproxy_handover.link.forms import FORMS

__all__ = ["MISSION", "STATION", "TABLES", "VEHICLE"]

#: key -> what it means
Meanings = Mapping[str, str]

_ROUTE: Final[Meanings] = {
    "off_route_m": "the aircraft is off its route when it is farther than this beside the leg that it flies",
    "off_heading_deg": "or when its course over ground is so far off that leg; 180 is never exceeded",
    "off_hold_s": "one of the two for this long",
    "off_clear_s": "it ends once both are below two thirds for this long",
}
_ENERGY: Final[Meanings] = {
    "battery_wh": "what all packs give together when full; without it the budget is unknown",
    "batteries": "packs that it comes from, monitors 0 and up; each gives an equal share",
    "cells": "lithium polymer cells in series: with them the voltage has a say too",
    "mass_kg": "take-off mass, for the power in hover where hover_w is not given",
    "rotor_area_m2": "area of all rotor discs together: with mass_kg it gives the power in hover by momentum theory",
    "payload_kg": "the part of mass_kg that the mission drops; all numbers are with it on board",
    "hover_w": "power in hover; without it and without mass_kg the budget is unknown",
    "cruise_w": "power in level flight at cruise_mps; else that of hover and a tenth",
    "climb_factor": "power in climb, as a part of that in hover",
    "descent_factor": "power in descent, as a part of that in hover",
    "cruise_mps": "airspeed of cruise_w",
    "airspeed_mps": "the fastest that it flies through the air, at its lean limit; else cruise_mps",
    "headwind_mps": "taken to blow from ahead wherever it flies, where the wind is not known",
    "reserve_factor": "a need is multiplied with this",
    "reserve_wh": "and this stays in the battery; else a fifth of it and a minute of hover",
    "return_alt_m": "height above home at which it returns: RTL_ALT; with wings RTL_ALTITUDE, 100 if it is not said",
    "lean_deg": "lean limit (ANGLE_MAX)",
    "drag_per_s": "what leans it in steady flight, for the wind by its lean: "
    "g tan(lean) = drag_per_s v + drag_per_m v^2",
    "drag_per_m": "see drag_per_s",
    "start": "what a budget that does not close does to START",
}
_HELD_NOWHERE: Final = '; "hold" comes to "return": it is outside its commander\'s zone then, and held only inside'
_CAUSES: Final[Meanings] = {cause.value: row.meaning for cause, row in CAUSES.items()}

#: purpose of each table, by its name in the file
TABLES: Final[Meanings] = {
    "policy": "What is done at the most about each thing that may be wrong. On the ground, and while a pilot steers, "
    "everything is a warning.",
    "hold_off": "How long each condition must last until it counts as a cause. Shorter ones are ignored.",
    "clear": "How long the condition must be over until the cause ends.",
    "limits": "When something is lost, how long a step may take, margins at the border of a zone.",
    "links": "From when on one link of a station is called bad.",
    "observers": "What one observer may take of the downlink, beyond what every station hears.",
    "position": "Whose word of where the aircraft is counts. See [position-box.md](../position-box.md).",
    "route": "From when on the aircraft is off its route.",
    "commands": "What to do with a command of the commander that would leave one of these: refuse (with the reason; "
    "its operator may send it again after 10 s to insist), warn (it is carried out), off. RTL, LAND, LOITER, BRAKE and "
    "a pause are never refused.",
    "energy": "What the aircraft draws and holds. All may be left out; a mission's numbers go before the vehicle's.",
    "ground": "The ground link: how stations reach each other without the vehicle. Without it everything goes through "
    "the vehicle.",
}

VEHICLE: Final[Mapping[str, Meanings]] = {
    "vehicle": {
        "name": "what the vehicle is called at the stations",
        "sysid": "system id of the autopilot: MAV_SYSID, older SYSID_THISMAV",
        "parent": "name of the station that loads the mission and starts the flight",
        "journal": "file of the journal; `handover companion` writes it to the folder of the run",
        "guard": "false only for a vehicle without handover_guard.lua",
        "listen_only_outputs": "true: MAVProxy may have --out links; they hear and are never heard",
        "state": "folder where authority is kept over a loss of power",
        "mission": "folder of a mission package on board; without it the parent sends one",
        "allow_unsigned": "true: stations may have no key; any program that reaches such a link counts as the station",
        "autopilot_key": "file of the autopilot's own MAVLink 2 key, if its link is signed",
        "guard_key": "file of the key on the guard's card, if it has one",
    },
    "station": {
        "name": "as in the mission package",
        "sysid": "its MAVLink id, as in the mission package",
        "links": f"one or more, side by side: {', '.join(FORMS.values())}. udpout and tcp call the station, udpin and "
        "tcpin wait for it; udpout:HOST:PORT@wwan0 leaves only by that interface; an IPv6 address as HOST stands in "
        "brackets",
        "key": "file of the key that it signs with; needed unless allow_unsigned",
        "module": "false: it runs no handover_gcs, but any program of the operator-control standard",
        "consent": "with module = false, where its operator cannot be asked: automatic (planned handovers need no "
        "answer) or refuse (it is never partner, and keeps the aircraft)",
        "sysids": "further MAVLink ids at this station: a second program, a tracker",
        "not_in_control": "which programs get the result NOT_IN_CONTROL: auto, those that have shown support for it; "
        "always, all; never, none",
        "components": "MAVLink components of the station's own id that have its authority; others may only read",
        "companion_heartbeat": "false: this station gets no heartbeat of component 191; for programs that take every "
        "heartbeat of the vehicle for the autopilot's. With module = false",
    },
    "limits": {
        "heartbeat_lost_s": "a station silent this long is lost",
        "recovery_s": "how long the companion waits for the former commander after a restart in flight; the guard's "
        "HNDO_LOST_T must be half a second longer",
        "connect_interval_s": "how often each station is asked whether it is there; below deaf_lost_s",
        "connect_lost_s": "an answer to that older than this proves nothing",
        "deaf_lost_s": "a commander that is heard and has not answered for this long is lost, because it hears nothing",
        "deaf_share": "a station that answers less than this share of the questions of that time is deaf: it neither "
        "commands nor takes the aircraft nor counts as coverage",
        "deaf_back_share": "it counts again when it has answered this share or more, above deaf_share,",
        "deaf_back_s": "for this long; three times as long after each further loss of command in the flight, to 300 s",
        "retry_first_s": "first retransmission of a transfer message",
        "retry_growth": "growth of the wait from one retransmission to the next",
        "retry_max_s": "the longest wait for one",
        "step_timeout_s": "a step of a transfer that takes longer aborts it: the commander stays",
        "operator_timeout_s": "the same while an operator is asked",
        "release_timeout_s": "commander consented, partner connected, release missing this long: the vehicle commits",
        "forced_timeout_s": "the commander is lost: a forced transfer may take this long",
        "reserve_timeout_s": "and the station that is ready first has this long when another is ready too",
        "retry_pause_s": "pause before a failed transfer is tried again",
        "denied_pause_s": "the same after an operator's denial",
        "result_timeout_s": "how long the result is repeated to a station that does not show it",
        "enter_margin_m": "a zone is entered this far inside its border",
        "leave_margin_m": "and left this far outside",
        "dwell_s": "no transfer for a zone's sake sooner than this after the last one, unless coverage ends",
        "exit_soon_s": "the commander's zone ends within this time along the track: time to move",
        "hold_lead_s": "the last coverage that counts ends within this time along the track: the aircraft is to stop",
        "answer_s": "a station that was asked and has not taken the aircraft after this time does not count as able to",
        "hold_s": "how long the aircraft holds before the end of coverage; then it returns",
        "obey_s": "a commanded mode that does not show for this long is commanded again",
        "stuck_s": "a return that gets no nearer, or a landing that does not come down, for this long has failed",
        "rehearsal_lost_s": "a rehearsal on the ground ends after this time without a commander",
        "link_weak_s": "the commander's links have been weak this long, and",
        "link_steady_s": "a partner's good this long: reason enough to move authority",
        "position_stale_s": "an older position counts as lost",
        "autopilot_lost_s": "an older heartbeat of the autopilot counts as lost",
        "guard_lost_s": "an older status of the guard counts as lost",
    },
    "policy": {**_CAUSES, "no_station": _CAUSES["no_station"] + _HELD_NOWHERE},
    "hold_off": _CAUSES,
    "clear": _CAUSES,
    "links": {
        "silence_s": "nothing genuine heard for this long",
        "loss": "share of frames lost, up or down; 1 is never exceeded",
        "round_trip_s": "median of the probes' round trips",
        "bad_signatures": "in the last 10 s: another sender pretends to be this station",
        "hold_s": "a value must be over its limit, or well below it again, this long",
    },
    "observers": {
        "message_hz": "the fastest that one message is granted",
        "bytes_per_s": "for all that it asked for",
        "silence_s": "an observer silent this long has to ask again",
    },
    "energy": _ENERGY,
    "route": _ROUTE,
    "commands": {
        "energy": "too little for the way there and back to a place, with the reserve",
        "fence": "the geofence of the mission",
        "coverage": "out of the zones of stations that could take the aircraft",
    },
    "position": {
        "source": "whose position counts: the autopilot's own, or that of the box",
        "box": "where the box is, tcp:HOST:PORT; with source autopilot it only checks; needed with source box",
        "layout": "how the box's record is laid out: thesis (listing 5.7 of the thesis), full, or a file that names "
        "its fields (the name ends with .toml and is relative to this file)",
        "check": "when the two are held against each other: always, or while the autopilot is armed",
        "box_age_s": "a record that is later than this is not used",
        "apart_m": "farther apart than this over ground the position is not used",
        "apart_height_m": "limit of the difference in height",
        "apart_mps": "limit of the difference in speed over ground",
        "apart_s": "after this long above a limit a disagreement is reported",
        "agree_s": "after this long within two thirds of all three limits they agree again",
        "unchecked_s": "how long the box counts while the autopilot has no position of its own",
    },
}

STATION: Final[Mapping[str, Meanings]] = {
    "station": {
        "name": "as in the mission package and in the vehicle's configuration",
        "sysid": "the station's MAVLink id",
        "vehicle": "the vehicle's MAVLink id; not together with [[vehicle]]",
        "mission": "folder of the mission package; the parent needs it, the others receive it; not with [[vehicle]]",
        "key": "file of the key of this station, the same as the vehicle's; MAVProxy signs its links with it; not with "
        "[[vehicle]]",
        "consent": "which planned handovers need no answer: automatic (for a zone or a link), operator (none), "
        "or a list of zone, link, request, give",
        "forced": "after the commander is lost: automatic (this station takes the aircraft at once), ask (its operator "
        "is asked, and the aircraft returns meanwhile)",
        "journal": "file of the journal; `handover station` writes it to the folder of the run",
        "offered_addresses": "what is done with an address of the vehicle that another station sends with a mission: "
        "ask (this station's operator confirms it, where this station has no link of its own), refuse",
        "offered_addresses_local": "true: such an address may be one of this computer, for tests and simulations",
    },
    "vehicle": {
        "name": "what the operator types",
        "sysid": "its MAVLink id",
        "links": "of this vehicle only; one or more, in pymavlink's form: udpin:0.0.0.0:14550",
        "key": "file of the key between this station and this vehicle; no two vehicles share one",
        "allow_unsigned": "true: without a key",
        "mission": "folder of its mission package",
    },
    "ground": {
        "listen": "where this station hears the others: udpin:HOST:PORT",
        "key": "file of the key of the ground link, the same at every station",
        "allow_unsigned": "true: without a key; any program that reaches the port can speak as another station",
    },
    "peer": {
        "name": "another station, as it is called in the mission package",
        "sysid": "its MAVLink id",
        "link": "where it listens: udpout:HOST:PORT",
    },
    "route": _ROUTE,
}

MISSION: Final[Mapping[str, Meanings]] = {
    "": {
        "name": "of the mission",
        "description": "for people",
        "aircraft": "what kind flies it: which items the route may have, how its path and its return are judged",
        "detector": "where zones come from",
        "route": "file of this folder: a QGroundControl .plan, or .waypoints (QGC WPL 110)",
        "zones": "file of this folder, GeoJSON; with detectors circles and polygons alone, which need it",
        "terrain": "file of this folder with heights of the ground: an Esri ASCII grid in degrees",
        "corridor_m": "how far coverage reaches beside the legs; with detectors waypoints and reached alone, which "
        "need it",
        "expected_handovers": "the check fails when the route makes another number",
        "cruise_speed_mps": "ground speed on the route; the plan's hover speed, where it has one, goes before the "
        "default. Of wings the airspeed, the plan's cruise speed, or 12",
        "delivery_waypoint": "item of the route where the delivery happens: one that is flown to",
        "stations": "one table [[stations]] for each station, the parent, which starts the flight, first",
        "policy": "the table [policy]",
        "energy": "the table [energy]: as in the vehicle's configuration, and goes before it",
        "wings": "the table [wings]: how an aircraft with wings turns, as its autopilot is set",
        "gap": "one table [[gap]] for each gap in coverage that the mission means to cross",
    },
    "stations": {
        "name": "of the station, as in the zones",
        "sysid": "its MAVLink id; no two stations share one",
        "waypoints": "items of the route that it covers, or that belong to it; with detectors waypoints and reached "
        "alone, which need it",
    },
    "policy": {"on_out_of_coverage": "what is done outside every zone: goes before the vehicle's out_of_coverage"},
    "wings": {
        "bank_deg": "how steeply it banks in a turn: ROLL_LIMIT_DEG",
        "waypoint_m": "how near a waypoint it turns to the next one, at the most: WP_RADIUS",
        "circle_m": "radius of a circle whose item has none, without its sign: WP_LOITER_RAD",
    },
    "gap": {
        "from": "the station whose zone ends there",
        "to": "the station whose zone begins, or the number of the item that is flown to where the gap ends",
        "limit_s": "how long the aircraft may fly without a commander",
        "note": "for people",
    },
    "energy": _ENERGY,
}
