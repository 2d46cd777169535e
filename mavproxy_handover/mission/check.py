# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover check MISSION`: finds faults of a mission before flight.

`check` judges. `check_text.py` prints the report for people, `check_json.py` for programs; the command is
`cli/check.py`, and `energy.py` has the energy budget. There are
three severities. An error leaves the aircraft without a commander, without enough time for a transfer, or without the
energy to come down at the right place. A warning costs reserve. An info is worth knowing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import cos, inf, isclose, isfinite, radians, sin, tau

from mavproxy_handover.core.authority.consent_lines import refused_on_route, without_consent
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import Station
from mavproxy_handover.core.safety.energy import EnergyModel, Wind
from mavproxy_handover.mission.addresses import ADDRESSES_FILE, without_addresses
from mavproxy_handover.mission.check_feeds import ground_lacks, places_lack
from mavproxy_handover.mission.check_payload import far_payloads, idle_rules
from mavproxy_handover.mission.check_words import (
    battery_words,
    handover_words,
    pair_words,
    position_words,
    way_words,
)
from mavproxy_handover.mission.curves import WITHIN_M, ring
from mavproxy_handover.mission.energy import Budget, budget_of, places_inside, places_of, released_at
from mavproxy_handover.mission.fence import Fence, outside_fence
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
from mavproxy_handover.mission.items import LOITER_TURNS, MissionItem, stored_radius_m, stored_turns
from mavproxy_handover.mission.leg import first_pass
from mavproxy_handover.mission.open_takeoff import climb_m, open_takeoff
from mavproxy_handover.mission.package import MISSION_FILE, MissionPackage
from mavproxy_handover.mission.path import Path, Turn
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.room import has_room, is_covered
from mavproxy_handover.mission.route_simulation import (
    Gap,
    RouteSimulation,
    curves_lacking,
    landing_sequences,
    legs_of,
    sequence_place,
    simulate_legs,
    speed_at,
)
from mavproxy_handover.mission.terrain import CLEAR_M
from mavproxy_handover.mission.wings import Air
from mavproxy_handover.mission.zones import overlap
from mavproxy_handover.wire.vehicle_address import on_this_computer

__all__ = ["OPERATOR_S", "TRANSFER_S", "CheckReport", "Finding", "Severity", "check"]

#: time (s) of a transfer over a link that loses every fifth message each way, in 99 of 100 cases
TRANSFER_S = 3.0
#: a first try can fail with one lost link, a second one follows it
TRIES = 2
#: time (s) that an operator has to answer, if nothing else is configured
OPERATOR_S = Limits().operator_timeout_s
#: time (s) before the end of the commander's zone at which authority moves, whatever else is waited for
EXIT_SOON_S = Limits().exit_soon_s
#: a landing sequence that begins farther from a return site than this does not belong to it
SEQUENCE_M = 2000.0
#: a circle that is flown so much smaller than told (m) is worth a line
_SMALLER_M = 1.0
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
    #: number of the item that it is about; None: it is about no item, or about several
    item: int | None = None
    #: what was judged, one word for programs
    rule: str = ""


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
    wind: Wind | None = None,
    stations: Sequence[Station] = (),
) -> CheckReport:
    """Simulate the mission and judge it.

    `transfer_s`: time that a transfer needs. `operator_s`: time that an operator has to answer. `wind`: wind for energy
    and wings; None: that of [energy] for an unknown wind. `stations`: stations of the vehicle's file, if it is known.
    """
    simulation = package.simulate(wind)
    # the fastest of the speeds that may be set leaves the least time for a handover
    fast = replace(package, route=replace(package.route, fastest=True))
    fastest = fast.simulate(wind) if fast.legs(wind) != package.legs(wind) else simulation
    path = package.path(wind)
    air = None if path is None else package.air(wind)
    model = package.energy.model(wind, package.profile.energy)
    energy = None if model is None else _most(package, fast, model)
    crossed = package.stretches(simulation, wind)
    return_alt_m = package.profile.energy.return_alt_m if model is None else model.return_alt_m
    by_rule: tuple[tuple[str, Iterable[Finding]], ...] = (
        ("parent-zone", _start(package, simulation)),
        ("coverage", _gaps(package, simulation, path)),
        ("turns", () if path is None or air is None else _turns(package, path, air)),
        ("turns", () if path is None else _other_side(package, simulation, path, wind)),
        ("take-off", _takeoff(package, air)),
        ("landing-sequence", _returns(package)),
        ("declared-gaps", _declared(package, crossed)),
        ("overlap", _overlaps(package, fastest, crossed, transfer_s)),
        ("handovers", _handovers(package, simulation)),
        ("waypoints", _waypoints(package, fastest)),
        ("operators", _operators(package, fastest, stations, transfer_s=transfer_s, operator_s=operator_s)),
        ("consent", _consent(simulation, stations)),
        ("zones", _lonely_zones(package, crossed)),
        ("rally", _rally(package, simulation, return_alt_m)),
        ("fence", _fence(package, simulation)),
        ("ground", _ground(package, return_alt_m)),
        ("heights", _heights(package)),
        ("curves", _curves(package)),
        ("energy", () if energy is None else _energy(energy)),
        ("payload", _payload(package, simulation)),
        ("speed", _speed(package)),
        ("addresses", _addresses(package)),
        ("remote-id", _told(Severity.WARNING, places_lack(package))),
        ("route", (Finding(Severity.WARNING, text) for text in package.route.warnings)),
    )
    findings = [replace(finding, rule=rule) for rule, found in by_rule for finding in found]
    order = list(Severity)
    findings.sort(key=lambda finding: order.index(finding.severity))
    return CheckReport(package, simulation, tuple(findings), transfer_s, energy, crossed, path, air)


def _most(package: MissionPackage, fast: MissionPackage, model: EnergyModel) -> Budget:
    """The larger budget of the slowest and the fastest speeds that the route may have."""
    budgets = (budget_of(each.route, package.cruise_speed_mps, model) for each in (package, fast))
    return max(budgets, key=lambda budget: budget.need_wh)


def _told(severity: Severity, text: str) -> Iterator[Finding]:
    """A finding with this text, if there is one."""
    if text:
        yield Finding(severity, text)


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
        yield Finding(Severity.WARNING if warns else Severity.ERROR, text, gap.seq)


def _same(gap: Gap) -> tuple[int, float, float, float]:
    """Equal for the same gap in each round of a circle."""
    return gap.seq, round(gap.lat_deg, 5), round(gap.lon_deg, 5), round(gap.length_m)


def _turn_words(turn: Turn) -> str:
    if turn.circle:
        return f"the circle of {turn.radius_m:.0f} m at item {turn.seq}"
    outside = f", {turn.outside_m:.0f} m outside" if turn.outside_m >= 0.5 else ""
    return f"the turn at item {turn.seq} ({turn.angle_deg:.0f} degrees, radius {turn.radius_m:.0f} m{outside})"


def _turns(package: MissionPackage, path: Path, air: Air) -> Iterator[Finding]:
    """Findings about legs and directions that wings cannot fly."""
    for seq in path.unflown:
        yield Finding(Severity.ERROR, f"the wind does not let the way to item {seq} be flown", seq)
    finder, fence = package.zone_finder(), Fence(package.route.fence)
    lines = first_pass(legs_of(package.route, package.cruise_speed_mps))
    for tight in path.tight:
        text = (
            f"the leg to item {tight.seq} is {tight.length_m:.0f} m, the turns at its ends need {tight.needed_m:.0f} m:"
            " where it is flown is not known"
        )
        leg = lines[tight.seq][0]
        reach_m = package.route.wings.reach_m(replace(air, airspeed_mps=leg.speed_mps).fastest_mps)
        if has_room(leg, reach_m, finder, fence):
            yield Finding(Severity.WARNING, f"{text}. All within {reach_m:.0f} m of it is covered alike", tight.seq)
        else:
            yield Finding(Severity.ERROR, text, tight.seq)


def _other_side(
    package: MissionPackage, simulation: RouteSimulation, path: Path, wind: Wind | None
) -> Iterator[Finding]:
    """Findings about what wings may fly beside their path: narrower turns, turns about, and what is not known."""
    finder, fence = package.zone_finder(), Fence(package.route.fence)
    for loose in path.loose:
        if not is_covered(loose.leg, loose.radius_m, finder, fence):
            text = f"on the way to item {loose.seq} the aircraft {loose.why}, anywhere within {loose.radius_m:.0f} m"
            yield Finding(Severity.ERROR, f"{text}. Not all of that is covered, and inside the geofence", loose.seq)
    other = package.path_on_other_side(wind)
    if other is None or path.turns == other.turns:
        return
    beside = simulate_legs(other.legs, finder, package.parent.sysid, belonging=package.belonging)
    known = {gap.seq for gap in undeclared(package.gaps, simulation)}
    warns = package.policies.get("on_out_of_coverage") == "warn"
    for gap in undeclared(package.gaps, beside):
        if gap.seq not in known:
            known.add(gap.seq)
            text = f"no coverage for {_gap_words(gap)}, if it turns without sideslip, or to the other side"
            yield Finding(Severity.WARNING if warns else Severity.ERROR, text, gap.seq)
    if not any(True for _ in _fence(package, simulation)):
        yield from _fence(package, beside)


def _takeoff(package: MissionPackage, air: Air | None) -> Iterator[Finding]:
    """A take-off without a place has to have room in every direction."""
    item = open_takeoff(package.route)
    if item is None or air is None:
        return
    leg = package.legs()[0]
    climb = climb_m(leg.end[2] - leg.start[2], air.fastest_mps)
    turned_m = package.route.wings.reach_m(air.fastest_mps)
    around = replace(leg, end=(*leg.start[:2], leg.end[2]))
    if not has_room(around, climb + turned_m, package.zone_finder(), Fence(package.route.fence)):
        text = (
            f"{named(item)} has no place: it climbs {climb:.0f} m ahead, wherever the aircraft points, and turns "
            "there. Not all of that is covered alike, and inside the geofence. Give the item a place ahead on the "
            "runway"
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
    place = f"{position_words(gap.lat_deg, gap.lon_deg)} at {gap.alt_m:.0f} m, {way_words(gap.distance_along_m)}"
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


def _overlaps(
    package: MissionPackage, simulation: RouteSimulation, crossed: Sequence[Stretch], transfer_s: float
) -> Iterator[Finding]:
    """Findings about handovers with too little time: a transfer that fails must have time for a second one."""
    after_gaps = [stretch.found.distance_along_m + stretch.found.length_m for stretch in crossed]
    needed_s = TRIES * transfer_s
    for number, handover in enumerate(simulation.handovers, 1):
        name = f"handover {number} {pair_words(package, handover)}"
        if any(isclose(handover.distance_along_m, end, abs_tol=0.1) for end in after_gaps):  # on contact
            continue
        if handover.overlap_s == 0.0:
            text = f"{name}: the zones do not overlap on the route, {handover_words(handover)}"
            yield Finding(Severity.ERROR, text, handover.seq)
        elif handover.overlap_s < needed_s:
            text = (
                f"{name}: {handover.overlap_s:.1f} s inside both zones. A transfer and a second try need {needed_s:g} s"
            )
            yield Finding(Severity.ERROR, text, handover.seq)


def _handovers(package: MissionPackage, simulation: RouteSimulation) -> Iterator[Finding]:
    made, expected = len(simulation.handovers), package.expected_handovers
    if expected is None:
        text = f"{MISSION_FILE} has no expected_handovers. Write {made} there, and a later change of the route shows"
        yield Finding(Severity.INFO, text)
    elif made != expected:
        yield Finding(Severity.ERROR, f"the route makes {made} handovers, {MISSION_FILE} expects {expected}")
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
        name, seq = f"handover {number} {pair_words(package, handover)}", handover.seq
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


def _operators(
    package: MissionPackage,
    simulation: RouteSimulation,
    stations: Sequence[Station],
    *,
    transfer_s: float,
    operator_s: float,
) -> Iterator[Finding]:
    """Findings about handover regions that end before an operator has to have answered.

    The operator is asked `operator_s` before the region begins, but not before the previous handover. Whether an
    operator is asked is known only from the vehicle's file.
    """
    answered = {each.sysid for each in stations if each.consent is not None}
    asked, short, asked_at = bool(stations), [], 0.0
    for number, handover in enumerate(simulation.handovers, 1):
        begins_s = min(operator_s, handover.time_s - asked_at)
        left_s = begins_s + handover.overlap_s
        long_enough = handover.overlap_s >= TRIES * transfer_s
        if long_enough and left_s < operator_s + transfer_s and handover.to_station not in answered:
            short.append((number, left_s))
        asked_at = handover.time_s
    if short:
        which = ", ".join(str(number) for number, _left_s in short)
        least_s = min(left_s for _number, left_s in short)
        text = (
            f"an operator who is asked may take {operator_s:g} s to answer; there is less at handover {which}, "
            f"even if asked early: {least_s:.1f} s at the least"
        )
        yield Finding(Severity.WARNING if asked else Severity.INFO, text)


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


def _rally(package: MissionPackage, simulation: RouteSimulation, return_alt_m: float) -> Iterator[Finding]:
    route, finder, reach_m = package.route, package.zone_finder(), package.rally_reach_m
    for number, point in enumerate(route.rally, 1):
        name = f"rally point {number} at {position_words(point.lat_deg, point.lon_deg)}"
        if not finder.holding(point.lat_deg, point.lon_deg, point.alt_m):
            yield Finding(Severity.WARNING, f"{name} is in no zone: no station would command the aircraft there")
        if outside_fence(route.fence, point.lat_deg, point.lon_deg):
            yield Finding(Severity.WARNING, f"{name} is outside the geofence: no return goes there")
        nearest = min(distance_m(s.lat_deg, s.lon_deg, point.lat_deg, point.lon_deg) for s in simulation.samples)
        if nearest > reach_m:
            text = (
                f"{name} is out of reach: {nearest:.0f} m off the route (allowed: {reach_m:g} m). Remove it, or "
                f"declare the distance with rally_reach_m in {MISSION_FILE}"
            )
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
            place = f"{position_words(sample.lat_deg, sample.lon_deg)}, {way_words(sample.distance_along_m)}"
            yield Finding(Severity.ERROR, f"the route leaves the geofence of the plan at {place}", sample.seq)
            return


def _payload(package: MissionPackage, simulation: RouteSimulation) -> Iterator[Finding]:
    for text in (*far_payloads(package, simulation), *idle_rules(package)):
        yield Finding(Severity.WARNING, text)
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
            yield Finding(Severity.WARNING if way >= 0.0 else Severity.ERROR, text, seq)
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
            yield Finding(Severity.WARNING, text, seq)


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
    yield from _told(Severity.INFO, ground_lacks(package))
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
    if not package.profile.flies_past:
        for item in package.route.items:
            if item.command == LOITER_TURNS:
                yield from _ring(package, item)


def _ring(package: MissionPackage, item: MissionItem) -> Iterator[Finding]:
    """A finding about a circle that is flown smaller than it is told."""
    told_m, turns = abs(stored_radius_m(item.param3)), stored_turns(item.param1)
    speed_mps = speed_at(package.route, item.seq) or package.cruise_speed_mps
    flown = ring(told_m, speed_mps)
    if told_m - flown.radius_m < _SMALLER_M or turns == 0.0:
        return
    km = [turns * tau * radius_m / 1000.0 for radius_m in (flown.radius_m, told_m)]
    text = (
        f"{named(item)}: ArduCopter flies this circle of {told_m:g} m at {flown.radius_m:.0f} m, because it trails its "
        f"target at {flown.speed_mps * told_m / flown.radius_m:.0f} m/s: its turns are {km[0]:.2f} km, not "
        f"{km[1]:.2f} km. Plan {2.0 * told_m - flown.radius_m:.0f} m, or fly slower, if the distance matters"
    )
    yield Finding(Severity.INFO, text, item.seq)


def _energy(budget: Budget) -> Iterator[Finding]:
    for item in budget.items:
        if not isfinite(item.need_wh):
            text = f"energy: the wind does not let the way to item {item.seq} be flown"
            yield Finding(Severity.ERROR, text, item.seq)
            return
    if budget.budget_wh > budget.model.battery_wh:
        text = f"energy: the route needs {battery_words(budget)} with the reserve: it does not close"
        yield Finding(Severity.ERROR, text)
    for item in budget.items:
        if item.back is not None and item.back.margin_wh < 0.0:
            text = f"energy: from item {item.seq} no place is in reach with the reserve: the best is {item.back.place}"
            yield Finding(Severity.ERROR, text, item.seq)
            return
    if budget.no_return_m is not None:
        text = f"energy: from {way_words(budget.no_return_m)} on no return site is in reach with the reserve"
        yield Finding(Severity.INFO, text)


def _speed(package: MissionPackage) -> Iterator[Finding]:
    if not package.cruise_speed_named:
        speed = f"{package.cruise_speed_mps:g} m/s"
        text = f"neither mission nor plan names a cruise speed: checked at {speed}, flown as the autopilot is set"
        yield Finding(Severity.WARNING, text)
