# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether what the companion ordered, and the autopilot did not fly, was ordered again, and given up in time."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

from mavproxy_handover.core.common.model import Reason
from sitl.campaign.aircraft import Mode
from sitl.campaign.log import FlightLog
from sitl.campaign.plan import FlightPlan
from sitl.campaign.times import SECOND
from sitl.campaign.truth import LEFT_M, ON_ITS_WAY, Found, Moment, parts_whole_s

__all__ = ["GIVEN_UP_S", "OBEYED_S", "STANDS_S", "not_again", "not_landed"]

#: ordered and not flown, with its cause still there: `obey_s` until it is ordered again, and 2 s for news each second
OBEYED_S: Final = 8
#: ordered twice and not flown, with its cause still there: then a landing is ordered (s)
GIVEN_UP_S: Final = 2 * OBEYED_S
#: a return that stands still away from its place: `stuck_s`, and the same margins. Within _HOME_M (m) of its place it
#: is there; an aircraft that moves less than _STILL_M (m) in a second stands still
STANDS_S: Final = 35
_HOME_M, _STILL_M = 20.0, 0.05


def not_again(plan: FlightPlan, log: FlightLog, _moments: tuple[Moment, ...]) -> Found | None:
    """An order that is not flown is given again, or a graver one is, while its cause is there."""
    for (at, action, why), (following, *_rest) in pairwise((*log.orders, (log.ended, "", ""))):
        until = at + OBEYED_S * SECOND
        if action in ("RETURN", "LAND") and following > until and _not_flown(plan, log, why, at, until):
            text = f"{action} ({why.lower()}) was ordered and not flown for {OBEYED_S} s, and nothing more was ordered"
            return Found("not ordered again", until, text)
    return None


def not_landed(plan: FlightPlan, log: FlightLog, moments: tuple[Moment, ...]) -> Found | None:
    """A return that is not flown, or that gets nowhere, is given up for a landing."""
    for number, (at, action, why) in enumerate(log.orders):
        until = at + GIVEN_UP_S * SECOND
        words = {(action, why), *((each, reason) for then, each, reason in log.orders[number:] if then <= until)}
        if words == {("RETURN", why)} and _not_flown(plan, log, why, at, until):
            text = f"RETURN ({why.lower()}) was ordered and not flown for {GIVEN_UP_S} s, and no landing was ordered"
            return Found("not landed", until, text)
    run = 0
    for before, moment in pairwise(moments):
        follows = moment.at - before.at == SECOND
        run = run + 1 if follows and _stands(plan, log, before, moment) else 0
        if run > STANDS_S and parts_whole_s(log, moment.at) >= run and _cause_stays(plan, log, moment.at, run):
            text = f"a return of the companion stood still for {STANDS_S} s on its way, and was not made a landing"
            return Found("not landed", moment.at, text)
    return None


def _cause_stays(plan: FlightPlan, log: FlightLog, at: int, seconds: int) -> bool:
    """Whether the cause of the last order had been there for this time (s).

    Without such a cause a commander can act.
    """
    why = next((reason for then, _action, reason in reversed(log.orders) if then <= at), "")
    return _still_wrong(plan, log, why, at - seconds * SECOND, at)


def _stands(plan: FlightPlan, log: FlightLog, before: Moment, moment: Moment) -> bool:
    """Whether a return of the companion has got nowhere in this second, and is not there."""
    begun, mode, by = log.mode_at(before.at)
    if mode != Mode.RTL.name or by != "companion" or log.mode_at(moment.at)[0] != begun or log.breached.at(moment.at):
        return False  # outside of its fence a change of the mode costs more than it gives
    place = log.rally.at(begun) or plan.places[0]
    moved = max(abs(now - then) for now, then in zip(moment.place, before.place, strict=True))
    return moved < _STILL_M and place.away_m(*moment.place[:2]) > _HOME_M


def _not_flown(plan: FlightPlan, log: FlightLog, why: str, at: int, until: int) -> bool:
    """Whether what was ordered then, for that reason, was not flown until then, with nothing that excuses it."""
    whole = all(series.stays(True, at - SECOND, until) for series in (log.companion, log.cable, log.fix))
    begun, mode, by = log.mode_at(until)
    on_its_way = begun <= at and mode in ON_ITS_WAY and by != "commander"
    return whole and on_its_way and log.obeys.stays(False, at, until) and _still_wrong(plan, log, why, at, until)


def _still_wrong(plan: FlightPlan, log: FlightLog, why: str, first: int, last: int) -> bool:
    """Whether this reason of an order is really there from the first to the last of these moments."""
    if why == Reason.COMMANDER_LOST.name:
        return log.commander.stays(None, first, last)
    if why == Reason.OUT_OF_COVERAGE.name:
        places = [log.place_at(at) for at in range(first, last + 1, SECOND)]
        return all(zone.margin_m(x, y) < -LEFT_M for x, y, _z in places for zone in plan.zones.values())
    return why == Reason.ENERGY.name  # less energy does not become more
