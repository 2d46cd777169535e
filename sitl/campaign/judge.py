# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of what is unsafe, and how a flight ended.

Both go by what really happened (`log.py`), never by what was believed.

A row says what must not be, for how long it may, and which policies excuse it: a configuration that only warns of a
cause accepts its results. Every second in the air is judged: the truth is sampled once a second, and every limit here
is many times longer.

Two kinds of rows. The first say what must never be, with any failure: their limits are sums of the worst, including a
dead companion and a dead guard. The others demand what the rules are for. While all that they need is whole, and has
been for a while (`whole_s`), nothing may be left to the guard or to the autopilot's failsafes, the next line of
defence. Their limits are those of the rules, and a little for a heartbeat a second.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.safety.commands import Limit
from sitl.campaign.aircraft import Mode
from sitl.campaign.log import FlightLog
from sitl.campaign.obedience import GIVEN_UP_S, OBEYED_S, STANDS_S, not_again, not_landed
from sitl.campaign.physics import Physics
from sitl.campaign.plan import FlightPlan, StationPlan
from sitl.campaign.plane import Spot, segment_m
from sitl.campaign.times import SECOND
from sitl.campaign.truth import (
    BORDER_M,
    ON_ITS_WAY,
    REACTS_S,
    SETTLED_S,
    Found,
    Moment,
    gap_allowed_s,
    has_left,
    is_behind_gap,
    longest,
    moments_of,
    parts_whole_s,
    unnoticed,
    whole_s,
)

__all__ = ["CLASSES", "UNSAFE", "Found", "Unsafe", "ended", "judge"]

#: without coverage, or without a commander, in seconds. 5 s until a station is lost and 2 s for a forced transfer. 10 s
#: of the autopilot's GCS failsafe if both the companion and the guard are gone, 1 s for rounding
ALONE_S: Final = 18
#: a commander that flies an aircraft outside its own zone (s): while its link lets it, then as for ALONE_S
OUTSIDE_S: Final = 30
#: changes between the same two stations, and in how many seconds; an aircraft that is flown on over their border, and
#: brought back, changes twice
PING_PONG, PING_PONG_S = 4, 60
#: how often a station may lose command and have it back, and in how many seconds
FLAPS, FLAPS_S = 5, 600
#: a fact about a return site must have been so for this time (s): 5 s until a station is lost, 20 s until one counts
#: again, 5 s between two writes of the rally list
KNOWN_S: Final = 32
#: a heartbeat each second tells the mode: an order on its way during a takeover cannot know it (s)
KNOWS_S: Final = 1.2
#: held for longer than `hold_s`, and 10 s for what goes wrong with the autopilot meanwhile (s)
HELD_S: Final = 70
#: two steps in which an operator may be asked, 34 s each, two without, 6 s, and 2 s for rounding
TRANSFER_S: Final = 76
#: a station must work, or not, for this time (s) until the vehicle knows: 5 s until it is lost, or has not answered for
#: too long, 1 s between two questions, and 2 s for rounding
_HEARD_S: Final = 8
#: over the border of the last coverage that counts (s): it is to stop before that, and may roll on
ROLLS_S: Final = 2
#: a station that gets the aircraft this time (s) before it leaves the station's zone, or later, can do nothing: it is
#: held 5 s before the border, and 1 s for rounding
_STOPS_S: Final = 6
#: an aircraft farther beside its route was carried there (m)
_CARRIED_M: Final = 20.0
#: the energy that is left beyond the way home falls no faster than so many times the power in the air
_FALLS: Final = 6.0
#: landed this near to a place is landed there (m)
_THERE_M: Final = 15.0


Look = Callable[[FlightPlan, FlightLog, tuple[Moment, ...]], Found | None]


@dataclass(frozen=True, slots=True)
class Unsafe:
    """One row: what must not be, the limit in words, and how it is found.

    `excused_by`: causes whose milder policies excuse it.
    """

    name: str
    words: str
    limit: str
    excused_by: frozenset[Cause]
    #: the operator answers for a lifted limit
    lifted: Limit | None
    look: Look


# ---- the rows -------------------------------------------------------------------------------------------------------


def _two_commanders(_plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    for at in sorted({at for series in log.believes.values() for at in series.times}):
        epochs = [epoch for series in log.believes.values() if (epoch := series.at(at)) is not None]
        if len(set(epochs)) < len(epochs):
            return Found("two commanders", at, f"two stations take themselves for the commander in epoch {epochs[0]}")
    return None


def _books(_plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    for at, text in log.broken:
        return Found("authority without cause", at, text)
    return None


def _obeyed(_plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    for at, station, allowed in log.obeyed:
        if not allowed:
            return Found("refused and obeyed", at, f"station {station} was obeyed without authority")
    return None


def _empty(_plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    return None if log.empty_at is None else Found("battery empty", log.empty_at, "the battery was empty in the air")


def _uncovered(_plan: FlightPlan, _log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    found = longest(moments, ALONE_S, lambda m: m.mode in ON_ITS_WAY and not m.usable)
    if found is None:
        return None
    return Found("uncovered, nothing done", found.at, f"{ALONE_S} s without a station that works, and it flew on")


def _nobody(_plan: FlightPlan, _log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    found = longest(moments, ALONE_S, lambda m: m.mode in ON_ITS_WAY and m.commander is None)
    if found is None:
        return None
    return Found("no commander, nothing done", found.at, f"{ALONE_S} s without a commander, and it flew on")


def _outside(plan: FlightPlan, _log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    found = longest(
        moments,
        OUTSIDE_S,
        lambda m: m.mode in ON_ITS_WAY and m.commander is not None and m.margin_m < -BORDER_M,
    )
    if found is None:
        return None
    return Found("commands outside", found.at, f"{_name(plan, found)} commanded for {OUTSIDE_S} s outside its zone")


def _ping_pong(_plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    by_pair: dict[frozenset[int], list[int]] = {}
    for at, old, new in log.moves:
        times = by_pair.setdefault(frozenset((old, new)), [])
        times.append(at)
        lately = [each for each in times if at - each < PING_PONG_S * SECOND]
        turned = sum(lately[0] < begun <= at for begun, _mode, _by in log.modes)
        if len(lately) - 2 * turned >= PING_PONG:
            return Found("ping-pong", at, f"{len(lately)} changes between {old} and {new} within {PING_PONG_S} s")
    return None


def _flaps(plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    """The same station commands, then none, then it again, and so on.

    A companion's death does not count: each of its runs is counted separately.
    """
    back: dict[int, list[int]] = {}
    values, had = zip(log.commander.times, log.commander.values, strict=True), None
    for at, commander in values:
        if commander is not None and commander == had and log.companion.since(at) < at - SECOND:
            times = back.setdefault(commander, [])
            times.append(at)
            if sum(at - each < FLAPS_S * SECOND for each in times) > FLAPS:
                name = next(station.name for station in plan.stations if station.sysid == commander)
                return Found("flapping", at, f"{name} lost command and had it back more than {FLAPS} times")
        had = commander if commander is not None else had
    return None


def _uncovered_place(plan: FlightPlan, log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    """Landed by a return at a site without a station, though a covered one could have been reached.

    A fact counts if it was so, and could be known, for `KNOWN_S` before the return began. The vehicle knows of a
    station what it hears, not much of one whose link loses a third of everything. The rally list is written by a
    companion that lives. A station that fails later is no fault of the rules.
    """
    begun = [at for at, mode, _by in log.modes if mode == Mode.RTL.name]
    if not begun or not moments or log.landed is None or log.modes[-2][1] != Mode.RTL.name:
        return None
    at, landed = begun[-1], log.landed
    there = min(plan.places, key=lambda place: place.away_m(landed[1], landed[2]))
    first = at - KNOWN_S * SECOND
    before = [moment for moment in moments if first <= moment.at <= at]
    steady = len(before) >= KNOWN_S and all(moment.writes for moment in before)
    if not steady or there.away_m(landed[1], landed[2]) > _THERE_M or _known(plan.stations, there, before, any):
        return None
    if _covered(plan, log, there, landed[0]):
        return None
    left, physics = log.left_wh_at(at) * plan.truth.gauge, Physics.of(plan)
    sound = [station for station in plan.stations if log.is_sound(station.sysid, first, at)]
    for place in plan.places:
        safe = left > 1.1 * physics.budget_wh(physics.home_wh(before[-1].place, place))
        if safe and _known(sound, place, before, all) and _covered(plan, log, place, landed[0]):
            text = f"landed at a place that no station covers; one {place.away_m(*landed[1:]):.0f} m away was in reach"
            return Found("landed uncovered", landed[0], text)
    return None


def _known(
    stations: Iterable[StationPlan], place: Spot, moments: Iterable[Moment], how: Callable[[Iterable[bool]], bool]
) -> bool:
    """Whether one of the stations that work and hear the aircraft covers the place.

    `how`: in any of these moments, or in all.
    """
    covering = {s.sysid for s in stations if s.zone.margin_m(place.x_m, place.y_m) > 0.0}
    return how(not covering.isdisjoint(moment.heard) for moment in moments)


def _covered(plan: FlightPlan, log: FlightLog, place: Spot, at: int) -> bool:
    return any(s.zone.margin_m(place.x_m, place.y_m) > 0.0 and log.working[s.sysid].at(at) for s in plan.stations)


def _never_down(_plan: FlightPlan, log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    if moments and log.landed is None:
        return Found("never down", log.ended, "it was still in the air at the end of the longest flight")
    return None


def _overruled(_plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    for (began, mode, _), (at, after, by) in pairwise(log.modes):
        knew = by == "guard" or at - began > KNOWS_S * SECOND
        if mode == Mode.PILOT.name and by in ("companion", "guard") and knew:
            return Found("pilot overruled", at, f"a pilot had it, and {by} made it {after}")
    return None


def _turned_back(_plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    for (began, mode, whose), (at, after, by) in pairwise(log.modes):
        coming = mode in (Mode.RTL.name, Mode.LAND.name)
        knew = whose == "companion" or at - began > KNOWS_S * SECOND
        if coming and knew and by == "companion" and (after in ON_ITS_WAY or (mode, after) == ("LAND", "RTL")):
            return Found("graver undone", at, f"the companion made {after} of a {mode}")
    return None


def _outside_all(_plan: FlightPlan, log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    found = unnoticed(log, moments, lambda m: m.inside_m < -BORDER_M)
    if found is None:
        return None
    return Found("outside, not noticed", found.at, f"{REACTS_S} s outside every zone with all whole, and it flew on")


def _dead_zone(plan: FlightPlan, log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    def wrong(moment: Moment) -> bool:
        return has_left(moment) and not moment.heard and not moment.behind_gap and _stations_settled(log, moment.at)

    found = unnoticed(log, moments, wrong)
    if found is None:
        return None
    text = f"{REACTS_S} s outside the zone of {_name(plan, found)}, where no station works, and it flew on"
    return Found("dead zone, not noticed", found.at, text)


def _given_too_late(log: FlightLog, moments: tuple[Moment, ...]) -> set[int]:
    """When the aircraft is outside of a zone that it left directly after its commander got authority."""
    found: set[int] = set()
    left: tuple[int | None, int] | None = None
    for moment in moments:
        if not has_left(moment):
            left = None
            continue
        if left is None or left[0] != moment.commander:
            left = moment.commander, moment.at
        given = log.commander.since(moment.at)
        if left[1] - given <= _STOPS_S * SECOND:
            found.add(moment.at)
    return found


def _over_border(plan: FlightPlan, log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    """Flown over the border of the last coverage that counts, though no station beyond it had taken the aircraft.

    Not with two other stations there: while a transfer to one of them is under way, the other is there to take it. Not
    if authority came directly before the border either.
    """
    late = _given_too_late(log, moments)

    def wrong(moment: Moment) -> bool:
        if moment.mode != Mode.AUTO.name or not has_left(moment) or moment.gap_s or moment.behind_gap:
            return False
        if moment.at in late:
            return False
        whole = parts_whole_s(log, moment.at) >= SETTLED_S and _stations_settled(log, moment.at)
        # what the companion itself has sent on after a hold is its own doing
        by_itself = log.mode_at(moment.at)[2] in ("start", "companion")
        return whole and by_itself and len(moment.heard) < 2 and _on_its_leg(plan, moment)

    found = longest(moments, ROLLS_S, wrong)
    if found is None:
        return None
    text = f"flown out of the zone of {_name(plan, found)} for {ROLLS_S} s with all whole, and not taken over"
    return Found("over the border", found.at, text)


def _name(plan: FlightPlan, moment: Moment) -> str:
    """Its commander's."""
    return next(station.name for station in plan.stations if station.sysid == moment.commander)


def _stations_settled(log: FlightLog, at: int) -> bool:
    """Whether all stations had worked, or not, long enough for the vehicle to know."""
    return all(at - series.since(at) >= _HEARD_S * SECOND for series in log.working.values())


def _on_its_leg(plan: FlightPlan, moment: Moment) -> bool:
    """Whether it is on its way, and was not carried beside it."""
    x, y, _z = moment.place
    return any(segment_m(x, y, start, end) <= _CARRIED_M for start, end in pairwise(plan.way))


def _lost(_plan: FlightPlan, log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    found = unnoticed(log, moments, lambda m: m.commander is None and not m.behind_gap)
    if found is None:
        return None
    return Found(
        "no commander, not noticed", found.at, f"{REACTS_S} s without a commander with all whole, and it flew on"
    )


def _crosses(plan: FlightPlan, log: FlightLog, began: int, at: int) -> bool:
    """Whether it is in a declared gap or directly after one, or was carried beside it within the gap's limit."""
    x, y, _z = log.place_at(at)
    if is_behind_gap(plan, x, y):
        return True
    longest_s = max((gap.limit_s for gap in plan.gaps), default=0.0)
    first = max(began, at - round(longest_s * SECOND))
    flown = ((then, *log.place_at(then)[:2]) for then in range(at, first - 1, -SECOND))
    return any(gap_allowed_s(plan, Mode.AUTO.name, x, y) * SECOND > at - then for then, x, y in flown)


def _left_to_others(plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    for (began, before, _), (at, mode, by) in pairwise(log.modes):
        stands_behind = by in ("guard", "GCS failsafe") and before in ON_ITS_WAY and mode == Mode.RTL.name
        if by == "GCS failsafe" and _crosses(plan, log, began, at):
            continue  # without a guard, which has it watch the companion, it allows no gap
        if stands_behind and at - began >= SETTLED_S * SECOND and whole_s(log, at - 1) >= SETTLED_S:
            return Found("left to others", at, f"all was whole, and it was the {by} that sent it home")
    return None


def _spent(plan: FlightPlan, log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    run, looks_at = 0, 0
    physics = Physics.of(plan)
    for moment in moments:
        if moment.mode not in ON_ITS_WAY or moment.at < looks_at:
            run = 0
            continue
        needs = min(physics.home_wh(moment.place, place) for place in plan.places)
        margin = moment.left_wh * plan.truth.gauge - physics.budget_wh(needs)
        if margin > 0.0:  # it stays so for this time, unless a part of the energy goes at once
            run = 0
            lasts_s = margin * 3600.0 / (_FALLS * physics.climb_w)
            looks_at = int(min(moment.at + lasts_s * SECOND, moment.piece_ends))
            continue
        run = run + 1 if whole_s(log, moment.at) >= SETTLED_S else 0
        if run > REACTS_S:
            return Found("energy, not noticed", moment.at, f"{REACTS_S} s with no place in reach, and it flew on")
    return None


def _held_on(_plan: FlightPlan, log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    """The aircraft stands still no longer than the rules say, also if the companion dies meanwhile."""
    run = 0
    for before, moment in pairwise(moments):
        stands = (
            before.mode == moment.mode == Mode.PAUSE.name and log.mode_at(before.at)[0] == log.mode_at(moment.at)[0]
        )
        run = run + 1 if stands else 0
        if run > HELD_S and parts_whole_s(log, moment.at) >= SETTLED_S:
            return Found("held too long", moment.at, f"it stood still for {HELD_S} s, and nothing more was ordered")
    return None


def _endless(plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    """A transfer of a living commander ends, whatever operators do; else no other station would ever be asked."""
    begins = zip(log.transfer.times, log.transfer.values, strict=True)
    for (begun, transfer), ended in zip(begins, (*log.transfer.times[1:], log.ended), strict=True):
        until = begun + TRANSFER_S * SECOND
        if transfer is not None and until < ended and log.commander.stays(log.commander.at(begun), begun, until):
            name = next(station.name for station in plan.stations if station.sysid == transfer[0])
            return Found("transfer without end", until, f"a transfer to {name} was under way for {TRANSFER_S} s")
    return None


def _row(name: str, words: str, limit: str, look: Look, *excused_by: Cause, lifted: Limit | None = None) -> Unsafe:
    return Unsafe(name, words, limit, frozenset(excused_by), lifted, look)


_LOST, _OUT, _NONE = Cause.COMMANDER_LOST, Cause.OUT_OF_COVERAGE, Cause.NO_STATION
#: everything that is unsafe
UNSAFE: Final = (
    _row("two commanders", "two stations take themselves for the commander in one epoch", "never", _two_commanders),
    _row("authority without cause", "authority moves by anything but a listed cause, or rules break", "never", _books),
    _row("refused and obeyed", "a station without authority is obeyed", "never", _obeyed),
    _row("battery empty", "the battery is empty in the air", "never", _empty, Cause.ENERGY, lifted=Limit.ENERGY),
    _row(
        "uncovered, nothing done",
        "no station that works covers the aircraft, and it flies on",
        f"{ALONE_S} s",
        _uncovered,
        *(_LOST, _OUT, _NONE),
        lifted=Limit.COVERAGE,
    ),
    _row(
        "no commander, nothing done", "no station commands, and the aircraft flies on", f"{ALONE_S} s", _nobody, _LOST
    ),
    _row(
        "commands outside",
        "a station commands an aircraft that flies on outside its zone",
        f"{OUTSIDE_S} s",
        _outside,
        *(_LOST, _OUT, _NONE),
        lifted=Limit.COVERAGE,
    ),
    _row(
        "ping-pong",
        "authority goes to and fro between two stations",
        f"{PING_PONG} in {PING_PONG_S} s, and two for each time that the aircraft is sent elsewhere meanwhile",
        _ping_pong,
    ),
    _row(
        "flapping",
        "a station loses command and has it back, again and again",
        f"{FLAPS} in {FLAPS_S} s",
        _flaps,
    ),
    _row(
        "landed uncovered",
        "a return ends where no station is, with a covered place in reach",
        "never",
        _uncovered_place,
    ),
    _row("never down", "the flight does not end", "90 min", _never_down),
    _row(
        "pilot overruled",
        "an aircraft that a pilot flies is taken from the pilot",
        f"never; by the companion from {KNOWS_S:g} s on, when a heartbeat has told it",
        _overruled,
    ),
    _row(
        "graver undone",
        "the companion undoes a return or a landing",
        f"never; one of another source from {KNOWS_S:g} s on, when a heartbeat has told it",
        _turned_back,
    ),
    _row(
        "outside, not noticed",
        "all is whole, no zone holds the aircraft, and it flies on",
        f"{REACTS_S} s",
        _outside_all,
        *(_OUT,),
        lifted=Limit.COVERAGE,
    ),
    _row(
        "dead zone, not noticed",
        "all is whole, the commander's zone has ended and no station works where the aircraft is, and it flies on",
        f"{REACTS_S} s",
        _dead_zone,
        *(_OUT, _NONE),
        lifted=Limit.COVERAGE,
    ),
    _row(
        "over the border",
        "all is whole, and the aircraft is flown out of its commander's zone, and no station has taken it",
        f"{ROLLS_S} s",
        _over_border,
        *(Cause.COVERAGE_ENDS,),
        lifted=Limit.COVERAGE,
    ),
    _row(
        "no commander, not noticed",
        "all is whole, no station commands, and the aircraft flies on",
        f"{REACTS_S} s",
        _lost,
        *(_LOST,),
    ),
    _row(
        "left to others",
        "all is whole, and guard or GCS failsafe send it home, not the companion",
        "never",
        _left_to_others,
        *(_LOST,),
    ),
    _row(
        "energy, not noticed",
        "all is whole, no place is in reach with the reserve, and it flies on",
        f"{REACTS_S} s",
        _spent,
        *(Cause.ENERGY,),
        lifted=Limit.ENERGY,
    ),
    _row(
        "not ordered again",
        "a return or a landing is ordered and not flown, its cause is there, and nothing more is ordered",
        f"{OBEYED_S} s",
        not_again,
    ),
    _row(
        "not landed",
        "a return is not flown, or stands still on its way, its cause is there, and no landing is ordered",
        f"{GIVEN_UP_S} s; {STANDS_S} s where it stands still",
        not_landed,
    ),
    _row("held too long", "the aircraft is held, all is whole, and it stays so", f"{HELD_S} s", _held_on),
    _row(
        "transfer without end",
        "a transfer is under way for longer than its steps and two operators may take together",
        f"{TRANSFER_S} s",
        _endless,
    ),
)


def _excused(plan: FlightPlan, row: Unsafe) -> bool:
    """Whether the configuration itself wants no more than a warning."""
    policies: Mapping[Cause, str] = plan.policies
    return any(policies.get(cause, CAUSES[cause].policies[0]) in ("warn", "off") for cause in row.excused_by)


def judge(plan: FlightPlan, log: FlightLog) -> tuple[Found, ...]:
    """Everything that was unsafe in a flight."""
    moments = tuple(moments_of(plan, log))
    looked = (row.look(plan, log, moments) for row in UNSAFE if not _excused(plan, row))
    lifted = {row.name: [at for at, limit in log.lifted if row.lifted and limit == row.lifted.value] for row in UNSAFE}
    return tuple(found for found in looked if found is not None and not any(at <= found.at for at in lifted[found.row]))


#: how flights end, and by whose word; the first that fits
CLASSES: Final[Mapping[str, tuple[str, ...]]] = {
    "not started": (),
    "delivered": ("start", "mission"),
    "sent on, delivered": ("commander",),
    "the strategy's return or landing": ("companion",),
    "the guard's return": ("guard",),
    "the autopilot's failsafe": ("GCS failsafe", "EKF failsafe", "battery failsafe", "fence failsafe"),
    "a pilot's flight": ("pilot",),
    "held to its end": ("hold",),
}


def ended(log: FlightLog) -> str:
    """The class of a flight: by whose word the aircraft flew last."""
    if not log.modes:
        return "not started"
    last = log.modes[-1][2]
    return next((name for name, words in CLASSES.items() if last in words), f"by {last}")
