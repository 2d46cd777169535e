# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover check MISSION`: finds faults of a mission before flight.

`check` judges, `report_text` prints; the command is `cli/check.py`, and `energy.py` has the energy budget. There are
three severities. An error leaves the aircraft without a commander, without enough time for a transfer, or without the
energy to come down at the right place. A warning costs reserve. An info is worth knowing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from math import cos, inf, isclose, isfinite, radians, sin

from mavproxy_handover.core.authority.consent_lines import refused_on_route, without_consent
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import Station
from mavproxy_handover.core.safety.energy import Wind
from mavproxy_handover.mission.addresses import ADDRESSES_FILE, without_addresses
from mavproxy_handover.mission.curves import WITHIN_M
from mavproxy_handover.mission.energy import Budget, budget_of, places_inside, places_of, released_at
from mavproxy_handover.mission.fence import outside_fence
from mavproxy_handover.mission.gaps import Stretch, undeclared
from mavproxy_handover.mission.geodesy import distance_m, offset
from mavproxy_handover.mission.heights import (
    HOME_WITHIN_M,
    above_ground_m,
    above_sea,
    above_terrain,
    listed,
    low_ways,
    named,
)
from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.package import MISSION_FILE, MissionPackage
from mavproxy_handover.mission.path import Path, Turn
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.route_simulation import (
    Gap,
    Handover,
    RouteSimulation,
    curves_lacking,
    landing_sequences,
    sequence_place,
)
from mavproxy_handover.mission.terrain import CLEAR_M
from mavproxy_handover.mission.wings import Air
from mavproxy_handover.mission.zones import overlap
from mavproxy_handover.wire.vehicle_address import on_this_computer

__all__ = ["OPERATOR_S", "REACH_M", "TRANSFER_S", "CheckReport", "Finding", "Severity", "check", "report_text"]

#: time (s) of a transfer over a link that loses every fifth message each way, in 99 of 100 cases
TRANSFER_S = 3.0
#: time (s) that an operator has to answer, if nothing else is configured
OPERATOR_S = Limits().operator_timeout_s
#: time (s) before the end of the commander's zone at which authority moves, whatever else is waited for
EXIT_SOON_S = Limits().exit_soon_s
#: a rally point farther than this from every place of the route is an error of its planner
REACH_M = 5000.0
#: a landing sequence that begins farther from a return site than this does not belong to it
SEQUENCE_M = 2000.0
#: directions all around a place
_ROUND = [radians(15.0 * number) for number in range(24)]


class Severity(Enum):
    """Severity of a finding."""

    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report."""

    severity: Severity
    text: str


@dataclass(frozen=True, slots=True)
class CheckReport:
    """Result of the check of a mission."""

    package: MissionPackage
    simulation: RouteSimulation
    findings: tuple[Finding, ...]
    #: assumed time of a transfer, seconds
    transfer_s: float
    #: energy budget; None: the mission has no numbers for it
    energy: Budget | None = None
    #: the declared gaps that are on the route
    crossed: tuple[Stretch, ...] = ()
    #: path of wings, with its air; None: the aircraft has none
    path: Path | None = None
    air: Air | None = None

    def count(self, severity: Severity) -> int:
        """Number of findings of that severity."""
        return sum(finding.severity is severity for finding in self.findings)

    @property
    def exit_code(self) -> int:
        """0 without errors, else 1."""
        return 1 if self.count(Severity.ERROR) else 0


def check(
    package: MissionPackage,
    *,
    transfer_s: float = TRANSFER_S,
    operator_s: float = OPERATOR_S,
    reach_m: float = REACH_M,
    wind: Wind | None = None,
    stations: Sequence[Station] = (),
) -> CheckReport:
    """Simulate the mission and judge it.

    `transfer_s`: time that a transfer needs. `operator_s`: time that an operator has to answer. `reach_m`: allowed
    distance of a rally point from the route. `wind`: wind for energy and wings; None: that of [energy] for an unknown
    wind. `stations`: stations of the vehicle's file, if it is known.
    """
    simulation = package.simulate(wind)
    path = package.path(wind)
    model = package.energy.model(wind, package.profile.energy)
    energy = None if model is None else budget_of(package.route, package.cruise_speed_mps, model)
    crossed = package.stretches(simulation, wind)
    return_alt_m = package.profile.energy.return_alt_m if model is None else model.return_alt_m
    findings = [
        *_start(package, simulation),
        *_gaps(package, simulation, path),
        *(() if path is None else _turns(path)),
        *_returns(package),
        *_declared(package, crossed),
        *_handovers(package, simulation, crossed, transfer_s),
        *_waypoints(package, simulation),
        *_operators(simulation, transfer_s, operator_s),
        *_consent(simulation, stations),
        *_lonely_zones(package, crossed),
        *_rally(package, simulation, reach_m, return_alt_m),
        *_fence(package, simulation),
        *_ground(package, return_alt_m),
        *_heights(package),
        *_curves(package),
        *(() if energy is None else _energy(energy)),
        *_payload(package),
        *_speed(package),
        *_addresses(package),
        *(Finding(Severity.WARNING, text) for text in package.route.warnings),
    ]
    order = list(Severity)
    findings.sort(key=lambda finding: order.index(finding.severity))
    air = None if path is None else package.air(wind)
    return CheckReport(package, simulation, tuple(findings), transfer_s, energy, crossed, path, air)


def _addresses(package: MissionPackage) -> Iterator[Finding]:
    if package.addresses_fault:
        yield Finding(Severity.ERROR, without_addresses(package.addresses_fault))
    for station in package.stations:
        for address in package.addresses.get(station.sysid, ()):
            if on_this_computer(address):
                text = f"{ADDRESSES_FILE}: {station.name}: {address.text} is the station's own computer"
                yield Finding(Severity.WARNING, f"{text}: give the vehicle's address, as the station reaches it")


def _start(package: MissionPackage, simulation: RouteSimulation) -> Iterator[Finding]:
    if package.parent.sysid not in simulation.samples[0].holding:
        text = f"take-off is outside the zone of the parent station {package.parent.name}"
        yield Finding(Severity.ERROR, text)


def _gaps(package: MissionPackage, simulation: RouteSimulation, path: Path | None) -> Iterator[Finding]:
    # a mission that only warns out of coverage has decided to fly its gaps
    warns = package.policies.get("on_out_of_coverage") == "warn"
    found = undeclared(package.gaps, simulation)
    same, told = Counter(_same(gap) for gap in found), set[tuple[int, float, float, float]]()
    for gap in found:
        if _same(gap) in told:  # each round of a circle has it
            continue
        told.add(_same(gap))
        turn = None if path is None else path.turn_at(gap.distance_along_m)
        text = f"no coverage for {_gap_words(gap)}" + ("" if turn is None else f", in {_turn_words(turn)}")
        text += f", {same[_same(gap)]} times" if same[_same(gap)] > 1 else ""
        yield Finding(Severity.WARNING if warns else Severity.ERROR, text)


def _same(gap: Gap) -> tuple[int, float, float, float]:
    """Equal for the same gap in each round of a circle."""
    return gap.seq, round(gap.lat_deg, 5), round(gap.lon_deg, 5), round(gap.length_m)


def _turn_words(turn: Turn) -> str:
    if turn.circle:
        return f"the circle of {turn.radius_m:.0f} m at item {turn.seq}"
    outside = f", {turn.outside_m:.0f} m outside" if turn.outside_m >= 0.5 else ""
    return f"the turn at item {turn.seq} ({turn.angle_deg:.0f} degrees, radius {turn.radius_m:.0f} m{outside})"


def _turns(path: Path) -> Iterator[Finding]:
    """Findings about legs and directions that wings cannot fly."""
    for seq in path.unflown:
        yield Finding(Severity.ERROR, f"the wind does not let the way to item {seq} be flown")
    for tight in path.tight:
        text = (
            f"the leg to item {tight.seq} is {tight.length_m:.0f} m, the turns at its ends need {tight.needed_m:.0f} m:"
            " where it is flown is not known"
        )
        yield Finding(Severity.ERROR, text)


def _returns(package: MissionPackage) -> Iterator[Finding]:
    """How a return ends, if it does not just come down at its place."""
    if package.profile.return_note:
        yield Finding(Severity.INFO, package.profile.return_note)
    if not package.profile.lands_by_sequence:
        return
    starts = [(*sequence_place(each), each[0].seq) for each in landing_sequences(package.route)]
    finder = package.zone_finder()
    circle = package.route.wings.circle_radius_m(0.0, package.air().fastest_mps)
    for place in places_of(package.route):
        near = [(distance_m(place.lat_deg, place.lon_deg, lat, lon), seq) for lat, lon, seq in starts]
        away, seq = min(near, default=(inf, 0))
        if away > SEQUENCE_M:
            text = (
                f"a return to {place.name} would circle for ever: no landing sequence (DO_LAND_START to NAV_LAND) "
                f"begins within {SEQUENCE_M:g} m of it"
            )
            yield Finding(Severity.ERROR, text)
            continue
        text = f"a return to {place.name} ends in the landing sequence of item {seq}: it needs RTL_AUTOLAND 1 or 2"
        yield Finding(Severity.INFO, text)
        around = [offset(place.lat_deg, place.lon_deg, circle * cos(a), circle * sin(a)) for a in _ROUND]
        if not all(finder.holding(*spot, place.alt_m) for spot in around):
            text = f"the circle of {circle:.0f} m around {place.name} leaves every zone: a return waits there"
            yield Finding(Severity.WARNING, text)


def _gap_words(gap: Gap) -> str:
    place = f"{_place(gap.lat_deg, gap.lon_deg)} at {gap.alt_m:.0f} m, {_way(gap.distance_along_m)}"
    return f"{gap.length_m:.0f} m ({gap.duration_s:.0f} s) from {place}, on the way to {gap.seq}"


def _declared(package: MissionPackage, crossed: Sequence[Stretch]) -> Iterator[Finding]:
    for stretch in crossed:
        declared, limit_s = stretch.declared, stretch.declared.limit_s
        if not isfinite(stretch.time_s):
            yield Finding(Severity.ERROR, f"gap {declared.words}: the wind does not let it be crossed")
        elif stretch.time_s > limit_s:
            text = f"gap {declared.words}: it takes {stretch.time_s:.0f} s against the wind, its limit is {limit_s:g} s"
            yield Finding(Severity.ERROR, text)
        note = f": {declared.note}" if declared.note else ""
        text = f"gap {declared.words}, alone for {_gap_words(stretch.found)}, at most {limit_s:g} s{note}"
        yield Finding(Severity.INFO, text)
    for declared in package.gaps:
        if declared not in [stretch.declared for stretch in crossed]:
            yield Finding(Severity.ERROR, f"gap {declared.words} is declared, and the route has none there")


def _handovers(
    package: MissionPackage, simulation: RouteSimulation, crossed: Sequence[Stretch], transfer_s: float
) -> Iterator[Finding]:
    behind = [stretch.found.distance_along_m + stretch.found.length_m for stretch in crossed]
    for number, handover in enumerate(simulation.handovers, 1):
        name = f"handover {number} {_pair(package, handover)}"
        if any(isclose(handover.distance_along_m, end, abs_tol=0.1) for end in behind):  # on contact
            continue
        if handover.overlap_s == 0.0:
            yield Finding(Severity.ERROR, f"{name}: the zones do not overlap on the route, {_handover_way(handover)}")
        elif handover.overlap_s < transfer_s:
            text = f"{name}: {handover.overlap_s:.1f} s inside both zones, a transfer needs {transfer_s:g} s"
            yield Finding(Severity.ERROR, text)
        elif handover.overlap_s < 2.0 * transfer_s:
            text = f"{name}: {handover.overlap_s:.1f} s inside both zones leave no time for a second try"
            yield Finding(Severity.WARNING, text)
    if len(simulation.handovers) != package.expected_handovers:
        made, expected = len(simulation.handovers), package.expected_handovers
        text = f"the route makes {made} handovers, {MISSION_FILE} expects {expected}"
        yield Finding(Severity.ERROR, text)
    flown = set(simulation.commanders)
    for station in package.stations:
        if station.sysid not in flown:
            yield Finding(Severity.WARNING, f"station {station.name} never commands on this route")


def _waypoints(package: MissionPackage, simulation: RouteSimulation) -> Iterator[Finding]:
    """Findings about handovers without a waypoint, although waypoints should decide."""
    belonging = package.belonging
    if belonging is None:
        return
    for number, handover in enumerate(simulation.handovers, 1):
        name, seq = f"handover {number} {_pair(package, handover)}", handover.seq
        if not belonging.returns.isdisjoint((seq, seq + 1)):
            continue
        if belonging.owner(seq) != handover.to_station:
            text = f"{name}: on the way to {seq} the zone of the first ends, before a waypoint of the second is reached"
            yield Finding(Severity.WARNING, text)
        elif handover.overlap_s < EXIT_SOON_S:
            text = (
                f"{name}: the zone of the first ends {handover.overlap_s:.1f} s after waypoint {seq}: authority moves "
                f"{EXIT_SOON_S:g} s before that end, and not when the waypoint is reached"
            )
            yield Finding(Severity.WARNING, text)


def _operators(simulation: RouteSimulation, transfer_s: float, operator_s: float) -> Iterator[Finding]:
    """Handover regions that are long enough, but end before an operator has to have answered.

    The operator is asked `operator_s` before the region begins, but not before the previous handover.
    """
    short, asked_at = [], 0.0
    for number, handover in enumerate(simulation.handovers, 1):
        begins_s = min(operator_s, handover.time_s - asked_at)
        left_s = begins_s + handover.overlap_s
        if handover.overlap_s >= transfer_s and left_s < operator_s + transfer_s:
            short.append((number, left_s))
        asked_at = handover.time_s
    if short:
        which = ", ".join(str(number) for number, _left_s in short)
        least_s = min(left_s for _number, left_s in short)
        text = (
            f"an operator who is asked may take {operator_s:g} s to answer; there is less at handover {which}, "
            f"even if asked early: {least_s:.1f} s at the least"
        )
        yield Finding(Severity.INFO, text)


def _consent(simulation: RouteSimulation, stations: Sequence[Station]) -> Iterator[Finding]:
    """Findings about handovers without possible consent, for which START is refused."""
    for text in refused_on_route(stations, simulation.commanders):
        yield Finding(Severity.ERROR, text)
    for text in without_consent(stations):
        yield Finding(Severity.WARNING, f"{text}. Else START needs its program to show operator control first")


def _lonely_zones(package: MissionPackage, crossed: Sequence[Stretch]) -> Iterator[Finding]:
    if len(package.zones) < 2:
        return
    reached = {station for each in crossed for station in (each.declared.from_station, each.declared.to_station)}
    for zone in package.zones:
        if zone.station not in reached and all(
            overlap(zone, other).is_empty for other in package.zones if other is not zone
        ):
            yield Finding(Severity.ERROR, f"the zone of {zone.station_name} overlaps no other zone")


def _rally(
    package: MissionPackage, simulation: RouteSimulation, reach_m: float, return_alt_m: float
) -> Iterator[Finding]:
    route, finder = package.route, package.zone_finder()
    for number, point in enumerate(route.rally, 1):
        name = f"rally point {number} at {_place(point.lat_deg, point.lon_deg)}"
        if not finder.holding(point.lat_deg, point.lon_deg, point.alt_m):
            yield Finding(Severity.WARNING, f"{name} is in no zone: no station would command the aircraft there")
        if outside_fence(route.fence, point.lat_deg, point.lon_deg):
            yield Finding(Severity.WARNING, f"{name} is outside the geofence: no return goes there")
        nearest = min(distance_m(s.lat_deg, s.lon_deg, point.lat_deg, point.lon_deg) for s in simulation.samples)
        if nearest > reach_m:
            text = f"{name} is out of reach: {nearest:.0f} m off the route, {reach_m:g} m are allowed (--reach)"
            yield Finding(Severity.ERROR, text)
        if package.profile.returns_level and point.alt_m < return_alt_m:
            text = f"{name} is flown to at RTL_ALTITUDE, not at {point.alt_m:g} m: wings have to stay up on the way"
            yield Finding(Severity.INFO, text)
    places = [
        place
        for place in ((route.home.lat_deg, route.home.lon_deg), *((p.lat_deg, p.lon_deg) for p in route.rally))
        if not outside_fence(route.fence, *place)
    ]
    if not places:
        return
    far = max(simulation.samples, key=lambda s: min(distance_m(s.lat_deg, s.lon_deg, *place) for place in places))
    away = min(distance_m(far.lat_deg, far.lon_deg, *place) for place in places)
    yield Finding(Severity.INFO, f"home or a rally point is never farther than {away:.0f} m (on the way to {far.seq})")


def _fence(package: MissionPackage, simulation: RouteSimulation) -> Iterator[Finding]:
    if not places_inside(package.route):
        yield Finding(Severity.ERROR, "no return site is inside the geofence")
    for sample in simulation.samples:
        if outside_fence(package.route.fence, sample.lat_deg, sample.lon_deg):
            place = f"{_place(sample.lat_deg, sample.lon_deg)}, {_way(sample.distance_along_m)}"
            yield Finding(Severity.ERROR, f"the route leaves the geofence of the plan at {place}")
            return


def _payload(package: MissionPackage) -> Iterator[Finding]:
    payload_kg, released = package.energy.payload_kg, released_at(package.route)
    if payload_kg and released is None:
        yield Finding(Severity.WARNING, f"energy: no item of the route drops the payload of {payload_kg:g} kg")
    elif payload_kg:
        yield Finding(Severity.INFO, f"energy: after item {released} it is flown without {payload_kg:g} kg of payload")


def _ground(package: MissionPackage, return_alt_m: float) -> Iterator[Finding]:
    """Findings about the ground below the path, and below the returns from the end of each leg."""
    relief = package.relief()
    if relief is None:
        return
    home = package.route.home
    if relief.terrain.lowest_m((home.lat_deg, home.lon_deg)) is None:
        yield Finding(Severity.WARNING, "the heights of the ground do not reach to home: the plan's altitude counts")
    places = places_inside(package.route)
    legs = package.legs()
    lowest: dict[int, float] = {}
    for leg in legs:
        if leg.length_m > 0.0:
            lowest[leg.seq] = min(lowest.get(leg.seq, inf), above_ground_m(relief, leg))
    for seq, way in lowest.items():
        if way < CLEAR_M:
            word = f"{way:.0f} m above the ground" if way >= 0.0 else f"{-way:.0f} m below the ground"
            text = f"the way to {named(package.route.items[seq - 1])} is {word}"
            yield Finding(Severity.WARNING if way >= 0.0 else Severity.ERROR, text)
    ends = {leg.seq: leg.end for leg in legs if leg.length_m > 0.0}
    for seq, (lat, lon, end_m) in ends.items():
        # a level return leads down to its height, from wherever it is higher
        alt = return_alt_m if package.profile.returns_level else end_m
        backs = [
            (relief.above_m((lat, lon), (p.lat_deg, p.lon_deg), max(alt, p.alt_m, return_alt_m)), p.name)
            for p in places
        ]
        best, name = max(backs, default=(inf, ""))
        if best < CLEAR_M:
            text = f"no return from item {seq} is {CLEAR_M:g} m above the ground: to {name} it is {best:.0f} m"
            yield Finding(Severity.WARNING, text)


def _heights(package: MissionPackage) -> Iterator[Finding]:
    """Findings about heights above the sea, above terrain, and near home's height."""
    route = package.route
    sea, terrain = above_sea(route), above_terrain(route)
    if sea:
        text = (
            f"{listed(sea)}: the height is above the sea. It is right only with home at {route.home.alt_m:g} m, as in "
            f"the plan: START refuses more than {HOME_WITHIN_M:g} m of difference. Plan heights above home instead"
        )
        yield Finding(Severity.WARNING, text)
    unknown = [item for item in terrain if not _ground_known(route, item)]
    if unknown:
        limited = any(zone.min_alt_m is not None or zone.max_alt_m is not None for zone in package.zones)
        because = ", and a zone has limits of height" if limited else ""
        text = (
            f"{listed(unknown)}: the height is above terrain, and the mission has no height of the ground there. It is "
            f"counted as above home{because}. Bring the heights of the ground (key 'terrain' in {MISSION_FILE})"
        )
        yield Finding(Severity.ERROR if limited else Severity.WARNING, text)
    if terrain:
        text = f"{listed(terrain)}: the height is above terrain: START needs TERRAIN_ENABLE 1 in the autopilot"
        yield Finding(Severity.INFO, text)
    for low in low_ways(route, package.legs()):
        yield Finding(Severity.ERROR if low.below else Severity.WARNING, low.text)


def _ground_known(route: Route, item: MissionItem) -> bool:
    return route.ground is not None and (
        not item.has_place or route.ground.rise_m(item.lat_deg, item.lon_deg) is not None
    )


def _curves(package: MissionPackage) -> Iterator[Finding]:
    """Findings about a copter's circles and splines."""
    lacking = curves_lacking(package.route, package.cruise_speed_mps)
    if lacking > 1.0:
        text = (
            f"the route has more curves than are walked exactly: circles and splines are within "
            f"{WITHIN_M * lacking**2:.1f} m. Split the mission"
        )
        yield Finding(Severity.WARNING, text)


def _energy(budget: Budget) -> Iterator[Finding]:
    for item in budget.items:
        if not isfinite(item.need_wh):
            text = f"energy: the wind does not let the way to item {item.seq} be flown"
            yield Finding(Severity.ERROR, text)
            return
    if budget.budget_wh > budget.model.battery_wh:
        text = f"energy: the route needs {_of_battery(budget)} with the reserve: it does not close"
        yield Finding(Severity.ERROR, text)
    for item in budget.items:
        if item.back is not None and item.back.margin_wh < 0.0:
            text = f"energy: from item {item.seq} no place is in reach with the reserve: the best is {item.back.place}"
            yield Finding(Severity.ERROR, text)
            return
    if budget.no_return_m is not None:
        text = f"energy: from {_way(budget.no_return_m)} on no return site is in reach with the reserve"
        yield Finding(Severity.INFO, text)


def _speed(package: MissionPackage) -> Iterator[Finding]:
    if not package.cruise_speed_named:
        speed = f"{package.cruise_speed_mps:g} m/s"
        text = f"neither mission nor plan names a cruise speed: checked at {speed}, flown as the autopilot is set"
        yield Finding(Severity.WARNING, text)


# --- words ---


def _place(lat: float, lon: float) -> str:
    return f"{abs(lat):.5f} {'N' if lat >= 0 else 'S'} {abs(lon):.5f} {'E' if lon >= 0 else 'W'}"


def _way(distance: float) -> str:
    return f"{distance:.0f} m along the route"


def _handover_way(handover: Handover) -> str:
    return f"{_place(handover.lat_deg, handover.lon_deg)}, {_way(handover.distance_along_m)}"


def _pair(package: MissionPackage, handover: Handover) -> str:
    names = {station.sysid: station.name for station in package.stations}
    return f"{names[handover.from_station]} -> {names[handover.to_station]}"


def _minutes(seconds: float) -> str:
    return f"{int(seconds) // 60} min {int(seconds) % 60:02d} s"


def _of_battery(budget: Budget) -> str:
    return f"{budget.budget_wh:.1f} Wh of {budget.model.battery_wh:.1f} Wh"


def _energy_line(report: CheckReport) -> str:
    budget = report.energy
    if budget is None:
        return f"unknown: {report.package.energy.missing} in {MISSION_FILE}"
    wind, ahead = budget.model.wind, budget.model.headwind_mps
    if wind is None:
        words = f"{ahead:g} m/s from ahead wherever it flies"
    else:
        words = f"{wind.speed_mps:g} m/s from {wind.from_deg:g} degrees"
    if not isfinite(budget.need_wh):
        return f"the route cannot be flown; wind: {words}"
    return f"the route takes {budget.need_wh:.1f} Wh, with the reserve {_of_battery(budget)}; wind: {words}"


def _wings_lines(report: CheckReport) -> Iterator[str]:
    air, package = report.air, report.package
    if air is None:
        return
    wings = package.route.wings
    if air.wind is None:
        blows = f"wind up to {air.wind_mps:g} m/s from anywhere"
    else:
        blows = f"wind {air.wind.speed_mps:g} m/s from {air.wind.from_deg:g} degrees"
    radius = wings.turn_radius_m(air.fastest_mps)
    yield (
        f"wings       {package.profile.name}, airspeed {air.airspeed_mps:g} m/s, {blows}: up to "
        f"{air.fastest_mps:g} m/s over ground, turns of {radius:.0f} m at {wings.bank_deg:g} degrees"
    )


def _turn_rows(path: Path) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("at item", "turn", "radius", "outside", "begins")]
    for turn in path.turns:
        angle = "circle" if turn.circle else f"{turn.angle_deg:.0f} deg"
        outside = "-" if turn.circle else f"{turn.outside_m:.0f} m"
        rows.append((str(turn.seq), angle, f"{turn.radius_m:.0f} m", outside, f"{turn.begins_m:.0f} m"))
    return rows


def _crossed_line(report: CheckReport) -> str:
    if not report.crossed:
        return ""
    longest_s = max(stretch.declared.limit_s for stretch in report.crossed)
    count = len(report.crossed)
    return f"; {count} gap{'s' if count > 1 else ''} crossed alone: HNDO_ALONE_MAX {longest_s:g} or more"


def _wh(energy_wh: float) -> str:
    """Text of an energy (Wh); infinite if it cannot be flown."""
    return f"{energy_wh:.1f} Wh" if isfinite(energy_wh) else "-"


def _energy_rows(budget: Budget) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [
        ("to item", "length", "speed", "power", "needs", "left", "back to", "needs", "margin")
    ]
    for item in budget.items:
        made, back = item.made, item.back
        rows.append(
            (
                str(item.seq),
                f"{item.length_m:.0f} m",
                f"{made.speed_mps:.1f} m/s" if made is not None else "-",
                f"{made.power_w:.0f} W" if made is not None and made.speed_mps > 0.0 else "-",
                _wh(item.need_wh),
                _wh(item.left_wh),
                back.place if back is not None else "-",
                _wh(back.need_wh) if back is not None else "-",
                _wh(back.margin_wh) if back is not None else "-",
            )
        )
    return rows


def _table(rows: list[tuple[str, ...]], words: Collection[int]) -> Iterator[str]:
    """The rows as lines. The columns of `words` are aligned to the left; the others are numbers."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        cells = [
            cell.ljust(width) if column in words else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield "  " + "  ".join(cells)


def _address_lines(package: MissionPackage) -> Iterator[str]:
    if package.addresses:
        listed = [
            f"{each.name} {', '.join(address.text for address in package.addresses.get(each.sysid, ())) or 'none'}"
            for each in package.stations
        ]
        yield f"addresses   {'; '.join(listed)} ({ADDRESSES_FILE}, not in the digest)"


def report_text(report: CheckReport) -> str:
    """The report as a table to print, without a line end at its end."""
    package, simulation = report.package, report.simulation
    names = {station.sysid: station.name for station in package.stations}
    gap = sum(gap.length_m for gap in simulation.gaps)
    covered = 100.0 * (1.0 - gap / simulation.length_m) if simulation.length_m > 0.0 else 100.0
    lines = [
        f"mission     {package.name}  ({', '.join(package.files)}; digest {package.digest.hex()[:12]})",
        f"stations    {', '.join(f'{s.name} ({s.sysid})' for s in package.stations)}; zones from {package.detector}",
        f"route       {len(package.route.items)} items, {simulation.length_m / 1000.0:.2f} km, at least "
        f"{_minutes(simulation.duration_s)} at {package.cruise_speed_mps:g} m/s, "
        f"{len(package.route.rally)} rally points",
        f"coverage    {covered:.1f} % of the route{_crossed_line(report)}",
        f"commanders  {' -> '.join(names[sysid] for sysid in simulation.commanders)}",
        f"energy      {_energy_line(report)}",
        *_wings_lines(report),
        *_address_lines(package),
    ]
    if simulation.handovers:
        rows: list[tuple[str, ...]] = [
            ("#", "from", "to", "starts at", "along", "after", "to item", "overlap", "time", "needed")
        ]
        for number, handover in enumerate(simulation.handovers, 1):
            rows.append(
                (
                    str(number),
                    names[handover.from_station],
                    names[handover.to_station],
                    _place(handover.lat_deg, handover.lon_deg),
                    f"{handover.distance_along_m:.0f} m",
                    f"{handover.time_s:.0f} s",
                    str(handover.seq),
                    f"{handover.overlap_length_m:.0f} m",
                    f"{handover.overlap_s:.1f} s",
                    f"{report.transfer_s:g} s",
                )
            )
        lines += ["", *_table(rows, (1, 2, 3))]
    if report.path is not None and report.path.turns:
        lines += ["", *_table(_turn_rows(report.path), ())]
    if report.energy is not None:
        lines += ["", *_table(_energy_rows(report.energy), (6,))]
    if report.findings:
        lines.append("")
        lines += [f"{finding.severity.value + ':':9}{finding.text}" for finding in report.findings]
    errors, warnings = report.count(Severity.ERROR), report.count(Severity.WARNING)
    lines += ["", f"check {'failed' if errors else 'passed'}: {errors} errors, {warnings} warnings"]
    return "\n".join(lines)
