# SPDX-License-Identifier: GPL-3.0-or-later

"""The keys of mission.toml, table by table. `package.py`, `gaps.py` and `payload.py` read them.

[energy] is the same in the vehicle's file (`config/vehicle.py`). Its defaults are those for an aircraft of which only
the battery and the power in hover are known (`core/safety/energy_prior.py`).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Final

from mavproxy_handover.core.authority.payload import AT_HANDOVER, FLIGHT, REQUEST, PayloadKind
from mavproxy_handover.core.safety.energy_prior import START_POLICIES, EnergySettings
from mavproxy_handover.mission.leg import DEFAULT_CRUISE_MPS
from mavproxy_handover.mission.wings import AS_IT_COMES
from mavproxy_handover.tools.key_table import Key, KeyTable, flag, items, number, numbers, text, whole, word
from mavproxy_handover.vehicle.profiles import ASSUMED, PROFILES

__all__ = [
    "DEFAULT_RALLY_REACH_M",
    "ENERGY",
    "GAP",
    "MISSION",
    "MISSION_KEYS",
    "MOST_BATTERIES",
    "PAYLOAD",
    "POLICY",
    "STATIONS",
    "WINGS",
    "payload_keys",
]

#: farther from the route, a rally point is more likely a mistake than a plan
DEFAULT_RALLY_REACH_M: Final = 5000.0
#: monitors that ArduPilot counts for one aircraft
MOST_BATTERIES: Final = 8
_DETECTORS: Final = ("circles", "polygons", "waypoints", "reached")
_AIRCRAFT: Final = tuple(profile.name for profile in PROFILES)


#: an aircraft of which only the battery and the power in hover are known
_KNOWN: Final = EnergySettings(battery_wh=100.0, hover_w=360.0)
_MODEL: Final = _KNOWN.model()
assert _MODEL is not None
_DEFAULTS: Final = SimpleNamespace(
    cruise_mps=_MODEL.cruise_mps,
    headwind_mps=_MODEL.headwind_mps,
    reserve_factor=_MODEL.reserve_factor,
    return_alt_m=_MODEL.return_alt_m,
    climb_factor=_MODEL.climb_w / _MODEL.hover_w,
    descent_factor=_MODEL.descent_w / _MODEL.hover_w,
    lean_deg=_KNOWN.lean_limit_deg,
)
_EXAMPLES: Final = {
    "mass_kg": 3.0,
    "rotor_area_m2": 0.33,
    "payload_kg": 1.0,
    "hover_w": 354.0,
    "cruise_w": 385.0,
    "airspeed_mps": 10.0,
    "reserve_wh": 14.1,
    "drag_per_s": 0.0,
    "drag_per_m": 0.0,
}
ENERGY: Final = KeyTable(
    "energy",
    (
        number(
            "battery_wh",
            1,
            100_000,
            "what all packs give together when full (3300 mAh at 12.6 V: 41); without it the budget is unknown",
            example=41.0,
        ),
        whole("batteries", 1, MOST_BATTERIES, "packs, monitors 0 and up; each gives an equal share", example=1),
        whole("cells", 1, 28, "lithium polymer cells in series: with them the voltage has a say too", example=3),
        *numbers(
            """
            mass_kg         0.1 to 1000   take-off mass, for the power in hover where hover_w is not given
            rotor_area_m2   0.005 to 500  area of all rotor discs together: with mass_kg it gives the power in hover by
                                          momentum theory
            payload_kg      0 to 500      the part of mass_kg that the mission drops; all numbers are with it on board
            hover_w         10 to 200000  power in hover; without it and without mass_kg the budget is unknown
            cruise_w        10 to 200000  power in level flight at cruise_mps; else that of hover and a tenth
            climb_factor    1 to 3        power in climb, as a part of that in hover
            descent_factor  0.5 to 2      power in descent, as a part of that in hover
            cruise_mps      1 to 40       airspeed of cruise_w
            airspeed_mps    1 to 60       the fastest that it flies through the air, at its lean limit; else cruise_mps
            headwind_mps    0 to 30       taken to blow from ahead wherever it flies, where the wind is not known
            reserve_factor  1 to 3        a need is multiplied with this
            reserve_wh      0 to 50000    and this stays in the battery; else a fifth of it and a minute of hover
            return_alt_m    1 to 1000     height above home at which it returns: RTL_ALT; with wings RTL_ALTITUDE, 100
                                          if it is not said
            lean_deg        10 to 60      lean limit (ANGLE_MAX)
            drag_per_s      0 to 5        what leans it in steady flight, for the wind by its lean:
                                          g tan(lean) = drag_per_s v + drag_per_m v^2
            drag_per_m      0 to 5        see drag_per_s
            """,
            _DEFAULTS,
            _EXAMPLES,
        ),
        word("start", START_POLICIES, "what a budget that does not close does to START", START_POLICIES[0]),
    ),
    "What the aircraft draws and holds. Without battery_wh, and hover_w or mass_kg, the energy budget is unknown and "
    "nothing is refused for it. A mission's numbers go before the vehicle's.",
)

STATIONS: Final = KeyTable(
    "stations",
    (
        text("name", "of the station, as in the zones", required=True, rule="1 to 16 letters, digits, - and _"),
        whole("sysid", 1, 255, "its MAVLink id; no two stations share one", required=True),
        items(
            "waypoints",
            "items of the route that it covers, or that belong to it; with detectors waypoints and reached alone, "
            "which need it",
            rule="items of the route",
        ),
        items(
            "place",
            "where its operator is, for Remote ID, if the station's program does not send it: latitude, longitude and "
            "height above the ellipsoid",
            rule="[degrees, degrees, m]",
            example=[52.37, 4.9, 45.0],
        ),
    ),
    many=True,
    required=True,
)
POLICY: Final = KeyTable(
    "policy",
    (
        word(
            "on_out_of_coverage",
            ("return", "land", "warn"),
            "what is done outside every zone: goes before the vehicle's out_of_coverage",
        ),
    ),
)
WINGS: Final = KeyTable(
    "wings",
    numbers(
        """
            bank_deg    10 to 75    how steeply it banks in a turn: ROLL_LIMIT_DEG
            waypoint_m  1 to 1000   how near a waypoint it turns to the next one, at the most: WP_RADIUS
            circle_m    10 to 2550  radius of a circle whose item has none, without its sign: WP_LOITER_RAD
            turn_part   0.4 to 1    how much of a turn without sideslip its turns have: 0.67 is SITL's plane
            """,
        AS_IT_COMES,
    ),
)
GAP: Final = KeyTable(
    "gap",
    (
        text("from", "the station whose zone ends there", required=True, rule="a station"),
        text(
            "to",
            "the station whose zone begins, or the number of the item that is flown to where the gap ends",
            required=True,
            rule="a station, or an item of the route",
        ),
        Key(
            "limit_s",
            float,
            "how long the aircraft may fly without a commander; the guard allows as much",
            required=True,
            limits=(1, 600),
            unit="s",
        ),
        text("note", "for people", rule="1 to 200 characters"),
    ),
    many=True,
)
_KINDS: Final = {
    PayloadKind.GIMBAL: "the same for the gimbal alone",
    PayloadKind.CAMERA: "the same for the camera alone",
    PayloadKind.WINCH: "the same for winch, gripper, sprayer and lights alone",
}


def payload_keys(names: str) -> tuple[Key, ...]:
    """The keys of `[payload]`. `names`: the stations or programs that a key may name, in words."""
    return (
        text(
            "control",
            f"{FLIGHT}: the commander's; {REQUEST}: the commander's until a station asks for it; or the name of "
            f"{names}",
            example=FLIGHT,
        ),
        *(text(kind.value, f"{says}, and goes before control", example=REQUEST) for kind, says in _KINDS.items()),
        word(
            "at_handover",
            AT_HANDOVER,
            f"with {REQUEST}: whether a station that asked for it loses it when the aircraft gets another commander",
        ),
    )


PAYLOAD: Final = KeyTable(
    "payload",
    payload_keys("a station of this mission"),
    f"Payload authority: goes before [payload] of the vehicle's file. Without both, {FLIGHT} and {AT_HANDOVER[0]}.",
)

MISSION: Final = KeyTable(
    "",
    (
        text("name", "of the mission", required=True, rule="1 to 40 characters"),
        text("description", "for people", rule="1 to 400 characters"),
        word(
            "aircraft",
            _AIRCRAFT,
            "what kind flies it: which items the route may have, how its path and its return are judged",
            ASSUMED.name,
        ),
        word("detector", _DETECTORS, "where zones come from", required=True),
        text(
            "route",
            "file of this folder: a QGroundControl .plan, or .waypoints (QGC WPL 110)",
            required=True,
            rule="file name",
        ),
        text(
            "zones",
            "file of this folder, GeoJSON; with detectors circles and polygons alone, which need it",
            rule="file name",
        ),
        text(
            "terrain", "file of this folder with heights of the ground: an Esri ASCII grid in degrees", rule="file name"
        ),
        number(
            "corridor_m",
            5,
            10_000,
            "how far coverage reaches beside the legs; with detectors waypoints and reached alone, which need it",
        ),
        flag(
            "endless_jump",
            "a DO_JUMP of the route may repeat without end: START's energy is one round, and the flight relies on the "
            "point of no return",
            default=False,
        ),
        whole(
            "expected_handovers",
            0,
            1000,
            "the check fails when the route makes another number; without it the number is only told",
        ),
        number(
            "rally_reach_m",
            1,
            1_000_000,
            "a rally point farther than this from the route is an error, unless the mission declares it here",
            DEFAULT_RALLY_REACH_M,
        ),
        number(
            "cruise_speed_mps",
            0.1,
            100,
            "ground speed on the route; the plan's hover speed, where it has one, goes before the default. Of wings "
            "the airspeed, the plan's cruise speed, or 12",
            DEFAULT_CRUISE_MPS,
        ),
        Key(
            "delivery_waypoint",
            int,
            "item of the route where the delivery happens: one that is flown to",
            rule="an item of the route",
        ),
        Key(
            "stations",
            list,
            "one table [[stations]] for each station, the parent, which starts the flight, first",
            required=True,
            rule="1 or more",
        ),
        Key("policy", dict, "the table [policy]"),
        Key("energy", dict, "the table [energy]: as in the vehicle's configuration, and goes before it"),
        Key("wings", dict, "the table [wings]: how an aircraft with wings turns, as its autopilot is set"),
        Key("payload", dict, "the table [payload]: which station has gimbal, camera and winch"),
        Key("gap", list, "one table [[gap]] for each gap in coverage that the mission means to cross"),
    ),
)

#: in the order of the reference
MISSION_KEYS: Final = (MISSION, STATIONS, POLICY, PAYLOAD, WINGS, GAP, ENERGY)
