# SPDX-License-Identifier: GPL-3.0-or-later

"""Makes the files of a mission package from a plan, drawn zones, and what neither of them says."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from shapely.geometry import MultiPolygon, Polygon, mapping

from mavproxy_handover.mission.drawn.areas import Area, DrawnZone, cut_at_meridian, with_few_corners
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.geojson import MAX_CORNERS
from mavproxy_handover.mission.package import MISSION_FILE, MissionPackage, from_texts
from mavproxy_handover.mission.wings import AS_IT_COMES
from mavproxy_handover.mission.zones import Circle, Zone, ZoneFinder
from mavproxy_handover.vehicle.profiles import PROFILES, Profile

__all__ = ["Draft", "DraftStation", "file_name", "holders_of_home", "with_few", "written"]

ZONES_FILE: Final = "zones.geojson"
TERRAIN_FILE: Final = "terrain.asc"
#: corners of all zones together: a package has to fit into one transfer
_ALL_CORNERS: Final = 5000
#: column of the comments in mission.toml
_COLUMN: Final = 32
#: a centimetre, as ArduPilot stores places
_DIGITS: Final = 7


@dataclass(frozen=True, slots=True)
class DraftStation:
    """A station with its MAVLink system id and its zone."""

    name: str
    sysid: int
    zone: DrawnZone


@dataclass(frozen=True, slots=True)
class Draft:
    """All that a package is made of. The first station is the parent."""

    name: str
    profile: Profile
    stations: tuple[DraftStation, ...]
    route_file: str
    route_text: str
    speed_mps: float
    #: where the speed comes from, for the comment beside it
    speed_source: str
    on_out_of_coverage: str
    #: keys of [energy]
    energy: Mapping[str, float]
    #: text of an Esri ASCII grid with heights of the ground; "": none
    terrain_text: str = ""
    endless_jump: bool = False


def with_few(stations: Sequence[DraftStation]) -> tuple[tuple[DraftStation, ...], tuple[tuple[str, float], ...]]:
    """The stations with simplified zones where they have too many corners, and by how many metres each zone moved."""
    most = min(MAX_CORNERS, _ALL_CORNERS // len(stations))
    found, moved = [], []
    for station in stations:
        zone, moved_m = with_few_corners(station.zone, most)
        found.append(replace(station, zone=zone))
        if zone is not station.zone and moved_m > 0.0:
            moved.append((station.name, moved_m))
    return tuple(found), tuple(moved)


def holders_of_home(stations: Sequence[DraftStation], home: tuple[float, float]) -> tuple[str, ...]:
    """The stations whose zones hold home, on the ground."""
    zones = [_zone(station) for station in stations]
    holding = ZoneFinder(zones).holding(*home, 0.0)
    return tuple(station.name for station in stations if station.sysid in holding)


def _zone(station: DraftStation) -> Zone:
    zone = station.zone
    assert zone.area is not None
    return Zone(station.sysid, station.name, zone.area, zone.name, zone.min_alt_m, zone.max_alt_m)


def file_name(drawn: str, ending: str) -> str:
    """A file name that a package may hold."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", drawn).strip("-")[:40]
    return f"{plain or 'route'}{ending}"


def written(draft: Draft, handovers: int | None = None) -> tuple[MissionPackage, dict[str, str]]:
    """The package of a draft, and its files by name. `handovers`: how many are expected; None: as many as its route
    makes. Raises MissionError."""
    texts = {
        draft.route_file: draft.route_text,
        ZONES_FILE: zones_text(draft.stations),
        MISSION_FILE: mission_text(draft, 0, ()),
    }
    if draft.terrain_text:
        texts[TERRAIN_FILE] = draft.terrain_text
    simulation = _package(draft, texts).simulate()
    names = {station.sysid: station.name for station in draft.stations}
    commanders = [names[sysid] for sysid in simulation.commanders]
    made = len(simulation.handovers) if handovers is None else handovers
    texts[MISSION_FILE] = mission_text(draft, made, commanders)
    return _package(draft, texts), texts


def _package(draft: Draft, texts: Mapping[str, str]) -> MissionPackage:
    try:
        return from_texts(texts, draft.name)
    except MissionError as error:
        if "packed" in str(error):
            raise MissionError(f"{error}. Split the plan, or draw the zones with fewer corners") from None
        raise


# ---- its files ----------------------------------------------------------------------------------------------------


def detector_of(stations: Sequence[DraftStation]) -> str:
    """How zones are given: as circles if all are circles."""
    return "circles" if all(isinstance(each.zone.area, Circle) for each in stations) else "polygons"


def zones_text(stations: Sequence[DraftStation]) -> str:
    """The zones as GeoJSON, a feature on each line."""
    circles = detector_of(stations) == "circles"
    features = ",\n".join(json.dumps(_feature(each, circles=circles), ensure_ascii=False) for each in stations)
    return f'{{"type": "FeatureCollection", "features": [\n{features}\n]}}\n'


def _feature(station: DraftStation, *, circles: bool) -> dict[str, object]:
    zone = station.zone
    assert zone.area is not None
    given = {"name": zone.name, "min_alt_m": zone.min_alt_m, "max_alt_m": zone.max_alt_m}
    properties: dict[str, object] = {"station": station.name}
    properties |= {key: value for key, value in given.items() if value not in (None, "", station.name)}
    if circles:
        assert isinstance(zone.area, Circle)
        properties["radius_m"] = round(zone.area.radius_m, 2)
        place = [round(zone.area.lon_deg, _DIGITS), round(zone.area.lat_deg, _DIGITS)]
        geometry: dict[str, object] = {"type": "Point", "coordinates": place}
    else:
        area = mapping(_outline(zone.area))
        geometry = {"type": area["type"], "coordinates": _rounded(area["coordinates"])}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _outline(area: Area) -> Polygon | MultiPolygon:
    return cut_at_meridian(area.outline()) if isinstance(area, Circle) else area


def _rounded(value: object) -> object:
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    assert isinstance(value, float)
    return round(value, _DIGITS)


def mission_text(draft: Draft, handovers: int, commanders: Sequence[str]) -> str:
    """The text of mission.toml."""
    return "\n".join(_mission_lines(draft, handovers, commanders)) + "\n"


def _mission_lines(draft: Draft, handovers: int, commanders: Sequence[str]) -> Iterator[str]:
    yield f"name = {json.dumps(draft.name, ensure_ascii=False)}"
    yield _line(f'aircraft = "{draft.profile.name}"', f"one of {', '.join(profile.name for profile in PROFILES)}")
    yield _line(f'detector = "{detector_of(draft.stations)}"', f"each zone is a feature of {ZONES_FILE}")
    yield f'route = "{draft.route_file}"'
    yield f'zones = "{ZONES_FILE}"'
    if draft.terrain_text:
        yield _line(f'terrain = "{TERRAIN_FILE}"', "heights of the ground")
    if draft.endless_jump:
        yield _line("endless_jump = true", "a DO_JUMP of the route may repeat without end")
    yield _line(f"expected_handovers = {handovers}", f"commanders along the route: {' '.join(commanders)}")
    yield _line(f"cruise_speed_mps = {draft.speed_mps:g}", draft.speed_source)
    yield _line("# delivery_waypoint = 8", "item of the route where a delivery happens")
    yield ""
    yield "# The first station is the parent: it starts the flight."
    for station in draft.stations:
        yield from ("[[stations]]", f'name = "{station.name}"', f"sysid = {station.sysid}", "")
    yield "[policy]"
    yield _line(f'on_out_of_coverage = "{draft.on_out_of_coverage}"', '"return", "land" or "warn"')
    yield ""
    yield from _energy_lines(draft.energy)
    if draft.profile.flies_past:
        yield ""
        yield from _wings_lines()


def _energy_lines(energy: Mapping[str, float]) -> Iterator[str]:
    if energy:
        yield _line("[energy]", "what the aircraft draws and holds")
        yield from (f"{key} = {value:.12g}" for key, value in energy.items())
        return
    yield "# Without these numbers the energy budget is unknown, and nothing is refused for it."
    yield "# [energy]"
    yield _line("# battery_wh = 126.0", "what all packs give together when full")
    yield _line("# hover_w = 354.0", "power in hover, with the payload")
    yield _line("# cruise_w = 385.0", "power in level flight")


def _wings_lines() -> Iterator[str]:
    yield "# As the autopilot is set; these are the values that count without this table."
    yield "# [wings]"
    yield _line(f"# bank_deg = {AS_IT_COMES.bank_deg:g}", "ROLL_LIMIT_DEG")
    yield _line(f"# waypoint_m = {AS_IT_COMES.waypoint_m:g}", "WP_RADIUS")
    yield _line(f"# circle_m = {AS_IT_COMES.circle_m:g}", "WP_LOITER_RAD, without its sign")
    yield _line(f"# turn_part = {AS_IT_COMES.turn_part:g}", "1 for an aircraft that turns without sideslip")


def _line(text: str, comment: str) -> str:
    return f"{text.ljust(_COLUMN - 1)} # {comment}"
