# SPDX-License-Identifier: GPL-3.0-or-later

"""The edge of the return sites: the facts of each, the contents of the autopilot's rally list, the texts.

The rules value and choose a site (`core/safety/return_site.py`), as on the aircraft. This module does the work of
`operator/return_site/return_site.py`: facts from believed position and energy, and one point in the list. The point is
rewritten when the choice changes, every 5 s at most, and a return is restarted for another site.

It works each second. Where time is left out it works when something can have changed, and not later (`_holds_m`): a
site keeps its facts while the aircraft has moved less than to where one of them changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import hypot, inf
from typing import Final

from mavproxy_handover.core.common.events import PlaceJudged
from mavproxy_handover.core.common.model import AuthorityView, LeaseState
from mavproxy_handover.core.safety.energy import EnergyModel, Piece, way_home
from mavproxy_handover.core.safety.return_site import (
    SOONER_PART,
    SOONER_S,
    Choice,
    Coverage,
    PlaceFact,
    Reach,
    ReturnSiteChooser,
)
from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.plan import FenceCircle
from mavproxy_handover.mission.return_paths import PlaceFinder, flown_s
from mavproxy_handover.mission.zones import Zone
from sitl.campaign.aircraft import Aircraft, Mode
from sitl.campaign.plan import FlightPlan
from sitl.campaign.plane import Circle, Spot, bare_spans, bearing_deg, on_earth
from sitl.campaign.times import SECOND, in_seconds, in_ticks

__all__ = ["Places"]

#: RallyWriter.WRITE_S, and how long what is found after a beginning stays
_WRITE: Final = in_ticks(5.0)
_SETTLE_S: Final = 5.0
#: how far (m) it is tried whether a place stands as it does, and how exact that is
_TRIED_M: Final = (30.0, 120.0, 480.0, 1900.0)
_BIT_M: Final = 3.0
_COMMANDED: Final = (LeaseState.HELD, LeaseState.TRANSFER)


class Places:
    """The places of one vehicle, as one run of its companion has them. Times are ticks."""

    def __init__(self, plan: FlightPlan, aircraft: Aircraft, zones: Iterable[Zone]) -> None:
        self._plan, self._aircraft, self._model = plan, aircraft, plan.model()
        #: what the battery says falls so much faster than the model has it (W a W)
        self._faster = plan.truth.power * plan.truth.gauge
        circle = FenceCircle(True, *on_earth(plan.fence.x_m, plan.fence.y_m), plan.fence.radius_m)
        self._finder = PlaceFinder(zones, Fence((circle,)))
        self._circles = plan.zones
        self._places = plan.named_places
        self._chooser = ReturnSiteChooser()
        self._rates = _Rates(self._model)
        self._facts: dict[str, PlaceFact] = {}
        self.choice: Choice | None = None
        self._settled_at = inf
        self._write_at = 0
        #: a return was ordered here, and is flown; the place that it is to be sent to
        self.returning = False
        self._bounces_to: str | None = None
        self._judged: PlaceJudged | None = None
        self._key: tuple[object, ...] = ()
        #: when it was looked at last, and who could take the aircraft then
        self._looked_at = 0
        self._usable: frozenset[int] = frozenset()
        #: when to look again at the latest
        self.due = 0

    # ---- each second ------------------------------------------------------------------------------------------------

    def judge(
        self, now: int, usable: frozenset[int], view: AuthorityView, *, fix: bool, always: bool
    ) -> PlaceJudged | None:
        """Judge, choose, keep the list; what there is to tell the rules. `fix`: the position is fresh."""
        aircraft = self._aircraft
        if self.returning and aircraft.by != "companion":
            self.returning = False
        key = aircraft.mode, aircraft.begun, view.commander, view.lease, usable, fix
        if not always and now < self.due and key == self._key:
            return None
        self._key = key
        if self._facts and now - self._looked_at > SECOND:  # until a second ago nothing had changed
            places = [self._facts[name] for name, _place in self._places]
            self._chooser.choose(places, self._usable, in_seconds(now - SECOND), fixed=True)
        self._looked_at, self._usable = now, usable
        left_wh = aircraft.left_wh(now) * self._plan.truth.gauge
        here = aircraft.at(now)
        if fix or not self._facts:
            self._measure(here, left_wh)
        self._choose(now, usable, view)
        self.due = now + self._waits(now, here)
        return self._news(view)

    def _measure(self, here: tuple[float, float, float], left_wh: float) -> None:
        model = self._model
        x, y, z = here
        here_deg = on_earth(x, y)
        for name, place in self._places:
            way = self._way(place, x, y, z)
            height = max(z, place.alt_m, model.return_alt_m)
            view = self._finder.evaluate(here_deg, on_earth(place.x_m, place.y_m), height)
            need = model.need_wh(way)
            self._facts[name] = PlaceFact(
                name,
                place.away_m(x, y),
                flown_s(way, model, self._plan.speed_mps),
                left_wh - model.budget_wh(need),
                left_wh - model.reserve_factor * need,
                model.reserve_factor * need / model.battery_wh if need < inf else None,
                left_wh / model.battery_wh,
                view.inside,
                view.way_inside,
                view.there,
                view.way,
            )

    def _way(self, place: Spot, x: float, y: float, z: float) -> tuple[Piece, ...]:
        away = place.away_m(x, y)
        bearing = bearing_deg(place.x_m - x, place.y_m - y) if away > 0.0 else 0.0
        return way_home(away, bearing, z, place.alt_m, self._model.return_alt_m)

    def _choose(self, now: int, usable: frozenset[int], view: AuthorityView) -> None:
        aircraft, now_s = self._aircraft, in_seconds(now)
        if self._settled_at == inf:
            self._settled_at = now_s + _SETTLE_S
            if aircraft.flying:  # what the list holds is where a return goes
                self._chooser.restore(next(name for name, place in self._places if place == aircraft.rally))
        returning = aircraft.flying and aircraft.mode is Mode.RTL
        unsettled = now_s < self._settled_at or view.lease is LeaseState.RECOVERING
        fixed = unsettled or (returning and not self._may_bounce(view))
        before = self.choice
        self.choice = self._chooser.choose(
            [self._facts[name] for name, _place in self._places], usable, now_s, returning=returning, fixed=fixed
        )
        assert self.choice is not None
        name = self.choice.place.name
        if returning and before is not None and before.place.name != name:
            self._bounces_to = name
        if not self._written and now >= self._write_at:
            self._write(now)
        bounces, self._bounces_to = self._bounces_to == name and self._written, None if self._written else name
        if bounces and aircraft.mode is Mode.RTL and self._may_bounce(view):
            aircraft.return_anew("companion", now)

    def _news(self, view: AuthorityView) -> PlaceJudged | None:
        assert self.choice is not None
        judged = PlaceJudged(self.choice.place.name, self.choice.reachable, self.choice.figures(lambda s: f"GCS {s}"))
        if judged == self._judged:
            return None
        self._judged = judged
        return judged

    def before_return(self, now: int, usable: frozenset[int], view: AuthorityView, *, fix: bool) -> PlaceJudged | None:
        """A return is about to be ordered: judge once more, and write what is not written."""
        judged = self.judge(now, usable, view, fix=fix, always=True)
        if not self._written:
            self._write(now)
        self.returning = True
        return judged

    # ---- the list ---------------------------------------------------------------------------------------------------

    @property
    def _chosen(self) -> Spot:
        assert self.choice is not None
        return dict(self._places)[self.choice.place.name]

    @property
    def _written(self) -> bool:
        return self._aircraft.rally == self._chosen

    def _write(self, now: int) -> None:
        self._aircraft.rally_is(self._chosen, now)
        self._write_at = now + _WRITE

    def _may_bounce(self, view: AuthorityView) -> bool:
        commanded = view.commander is not None and view.lease in _COMMANDED
        return self.returning and commanded and not self._aircraft.breached and not self._aircraft.failsafe

    # ---- energy -----------------------------------------------------------------------------------------------------

    @property
    def short(self) -> bool:
        """No place is in reach any more with the reserve left."""
        margins = [fact.margin_wh for fact in self._facts.values() if fact.inside and fact.margin_wh is not None]
        return bool(margins) and max(margins) <= 0.0

    def note_event(self, now: int) -> None:
        """The known energy has jumped."""
        self.due = now

    # ---- how long nothing changes -----------------------------------------------------------------------------------

    def _waits(self, now: int, here: tuple[float, float, float]) -> int:
        """For so many ticks another look would come to the same."""
        now_s = in_seconds(now)
        stays_s = self._chooser.stays_until(now_s) - now_s
        if now_s < self._settled_at or stays_s <= 0.0 or not self._written:
            return SECOND
        holds = self._holds(here, self._chooser.usable)
        return holds if stays_s == inf else min(holds, SECOND * max(1, int(stays_s)))

    def _holds(self, here: tuple[float, float, float], usable: frozenset[int]) -> int:
        """For so many ticks, a whole number of seconds, every place stands as it does, and none becomes clearly
        sooner."""
        aircraft, rates = self._aircraft, self._rates
        vx, vy, vz = aircraft.velocity
        speed = hypot(vx, vy)
        low = here[2] < 12.0
        falls_w = rates.most_w * self._faster + rates.need_wpm * speed + rates.down(vz, low=low)
        seconds = inf
        stand: dict[str, tuple[Reach, Coverage]] = {}
        for name, place in self._places:
            fact = self._facts[name]
            assert fact.margin_wh is not None
            assert fact.spare_wh is not None
            stand[name] = fact.reach, fact.coverage(usable)
            for edge in (fact.margin_wh, fact.spare_wh):
                seconds = min(seconds, abs(edge) * 3600.0 / falls_w)
            if speed > 0.0 and not fact.there.isdisjoint(usable):
                seconds = min(seconds, self._holds_m(here, place, fact.coverage(usable), usable) / speed)
        if self._plan.fence.margin_m(here[0], here[1]) <= 0.0:
            return SECOND
        if speed > 0.0:
            seconds = min(seconds, self._plan.fence.margin_m(here[0], here[1]) / speed)
        seconds = min(seconds, self._sooner_s(stand, rates.time_spm * speed + rates.slower(vz, low=low)))
        return SECOND * max(1, int(min(seconds, 1e5)))

    def _holds_m(
        self, here: tuple[float, float, float], place: Spot, coverage: Coverage, usable: frozenset[int]
    ) -> float:
        """The way from anywhere within so many metres of here is covered as it is from here."""
        circles = [self._circles[station] for station in usable]
        held = 0.0
        for off_m in _TRIED_M:
            if coverage is Coverage.ALL:
                same = _bare(here, place, circles, -off_m) == 0.0
            else:
                same = _bare(here, place, circles, off_m) > _BIT_M
            if not same:
                break
            held = off_m - _BIT_M
        return held

    def _sooner_s(self, stand: dict[str, tuple[Reach, Coverage]], rate: float) -> float:
        """How long no place that stands alike becomes clearly sooner than the chosen one."""
        assert self.choice is not None
        chosen = self._facts[self.choice.place.name]
        slack = [
            abs(fact.time_s - (SOONER_PART * chosen.time_s - SOONER_S))
            for name, fact in self._facts.items()
            if name != chosen.name and stand[name] == stand[chosen.name]
        ]
        return min(slack, default=inf) / max(1e-6, (1.0 + SOONER_PART) * rate)


class _Rates:
    """How fast what is known of a place can change with the aircraft, whichever way it flies."""

    def __init__(self, model: EnergyModel) -> None:
        steps = 72
        made = [model.made_good(360.0 * n / steps) for n in range(steps)]
        slow = [1.0 / each.speed_mps if each.speed_mps > 0.0 else inf for each in made]
        cost = [each.power_w * part if part < inf else inf for each, part in zip(made, slow, strict=True)]
        self.most_w = 1.2 * max(model.climb_w, model.power_w(model.airspeed_mps))
        #: need of a place (W s) and time to it (s) for each metre that the aircraft moves, the reserve with it
        self.need_wpm = model.reserve_factor * _lipschitz(cost)
        self.time_spm = _lipschitz(slow)
        self._factor = model.reserve_factor

    def down(self, vz: float, *, low: bool) -> float:
        """How fast the need of a place changes with the height (W), near the ground twice as fast."""
        return self._factor * self.most_w * self.slower(vz, low=low)

    @staticmethod
    def slower(vz: float, *, low: bool) -> float:
        """How fast the time to a place changes with the height (s in a second)."""
        return (2.4 if low else 1.1) * abs(vz)


def _lipschitz(around: Sequence[float]) -> float:
    """The most that length times a value of direction changes by for each metre: the value, and its slope."""
    step = 6.283185307179586 / len(around)
    slope = max(abs(b - a) / step for a, b in pairwise((*around, around[0])))
    return 1.1 * (max(around) + 1.3 * slope)


def _bare(here: tuple[float, float, float], place: Spot, circles: Sequence[Circle], more_m: float) -> float:
    """How much of the straight way (m) is in none of the circles, each larger by `more_m`."""
    x, y, _z = here
    if place.away_m(x, y) < 1e-3:
        return 0.0 if any(each.margin_m(x, y) + more_m > 0.0 for each in circles) else inf
    return sum(ends - begins for begins, ends in bare_spans(Spot(x, y), place, circles, more_m))
