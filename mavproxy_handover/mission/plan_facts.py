# SPDX-License-Identifier: GPL-3.0-or-later

"""Facts of a plan that `handover init mission` needs before, or beside, its route: kind of aircraft, home, speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mavproxy_handover.mission.errors import Where, parse_json
from mavproxy_handover.mission.items import COMMANDS, DELAY, TAKEOFFS, VTOL_LAND, VTOL_TAKEOFF
from mavproxy_handover.mission.plan import MADE_FOR, Route
from mavproxy_handover.mission.route_simulation import speed_at
from mavproxy_handover.vehicle.profiles import PROFILES

__all__ = ["PlanFacts", "plan_facts", "proposed_speed"]


@dataclass(frozen=True, slots=True)
class PlanFacts:
    """Facts of a plan that do not depend on the aircraft. None: it does not say so.

    `aircraft`: name of the profile. `made_for`: what else it was made for, in words. `home`: latitude and longitude.
    """

    aircraft: str | None = None
    made_for: str | None = None
    home: tuple[float, float] | None = None


def plan_facts(file: str, text: str) -> PlanFacts:
    """The kind of aircraft and home of a plan, as far as they can be read. Raises MissionError only for text that is
    not JSON."""
    if not file.endswith(".plan"):
        fields = next((line.split() for line in text.splitlines()[1:] if line.strip()), [])
        return PlanFacts(home=_place(fields[8:10]))
    where = Where(file)
    mission = where.table(parse_json(text, where), "the file").get("mission")
    if not isinstance(mission, dict):
        return PlanFacts()
    home = mission.get("plannedHomePosition")
    place = _place(home[:2]) if isinstance(home, list) else None
    kind = mission.get("vehicleType")
    if type(kind) is not int:
        return PlanFacts(home=place)
    aircraft = _aircraft(kind, vtol=_has_vtol_items(mission.get("items")))
    return PlanFacts(aircraft, None if aircraft else MADE_FOR.get(kind), place)


def _place(values: Sequence[object]) -> tuple[float, float] | None:
    try:
        lat, lon = (float(str(value)) for value in values)
    except ValueError:
        return None
    return (lat, lon) if abs(lat) <= 90.0 and abs(lon) <= 180.0 else None


def _has_vtol_items(items: object) -> bool:
    listed = items if isinstance(items, list) else []
    return any(isinstance(item, dict) and item.get("command") in (VTOL_TAKEOFF, VTOL_LAND) for item in listed)


def _aircraft(kind: int, *, vtol: bool) -> str | None:
    """The profile for a MAV_TYPE of a plan. One that refines another is for its VTOL types, or for VTOL items."""
    fitting = [profile for profile in PROFILES if kind in profile.types]
    vtol = vtol or MADE_FOR.get(kind) == "a VTOL aircraft"
    best = [profile for profile in fitting if (profile.refines is not None) == vtol] or fitting
    return best[0].name if best else None


def proposed_speed(route: Route) -> tuple[float, str] | None:
    """The speed (m/s) of a route and what names it; None: nothing does.

    A DO_CHANGE_SPEED before the first leg counts before the speed of the plan, because the route is flown with it.
    """
    flown = [item for item in route.items if COMMANDS[item.command].flown and item.command not in (*TAKEOFFS, DELAY)]
    changed = speed_at(route, flown[0].seq) if flown else None
    if changed is not None:
        return changed, "DO_CHANGE_SPEED before the first leg"
    if route.cruise_speed_mps is not None:
        return route.cruise_speed_mps, "speed of the plan"
    later = speed_at(route, len(route.items) + 1)
    return None if later is None else (later, "the last DO_CHANGE_SPEED of the plan")
