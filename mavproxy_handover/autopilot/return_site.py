# SPDX-License-Identifier: GPL-3.0-or-later

"""Where a return goes: the places of the mission, judged each second, and the best one kept in the autopilot's list.

What a place is worth is for `core/safety/places.py` to say, what the map says of it for `mission/places.py`, how it
gets into the autopilot for `rally.py`. Here they meet, with what the autopilot says of its home, its fence and its
parameters. Rules that live here:

* Home is where the autopilot has it, which moves when it arms; until it has told, where the plan has it.
* A return is flown at RTL_SPEED, and where that is 0 at the speed between waypoints. Both are written with the mission
  (`cruise.py`), and read here: what the autopilot says that it has is what counts. Of wings it is the airspeed.
  A plane without rotors comes down by the landing sequences of the mission that is flown now.
* Where no position comes any more, the battery goes on emptying: until it returns, the way back is the one from where
  it was seen last, and from as far beyond as it may have flown since. On its way back it gets nearer, and what was
  known stays.
* Where looking breaks, the battery goes on emptying as well: what was drawn since a place was seen does not take it
  there. It turns back as if it had flown away all that time, and lands for what was drawn alone.
* The candidates are home, the rally points and the place where the mission lands. The commander may replace the rally
  points (`rally_list.py`), for this flight.
* On its way to a place the aircraft reads no list: RTL has read it when it began. So a choice that changes then needs a
  bounce, GUIDED and RTL again. It is done only for a return that was ordered here, under a commander who is heard, not
  outside the fence, not while any failsafe of the autopilot acts, and once for a change. In every other return nothing
  changes: the list goes on holding the place that is flown to.
* A place that was found in the list after a restart is kept as a candidate, whoever put it there.

Nothing in here raises: what breaks costs a place, the questions or the choice that second. What was told last stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.mission_protocol import MissionProtocol
from mavproxy_handover.autopilot.orders import Orders
from mavproxy_handover.autopilot.own_failsafes import BELOW_CEILING_M
from mavproxy_handover.autopilot.preflight import reading
from mavproxy_handover.autopilot.rally import RallyKeeper, alike
from mavproxy_handover.autopilot.rally_list import RallyList
from mavproxy_handover.autopilot.ties import Ties
from mavproxy_handover.core.events import PlaceJudged
from mavproxy_handover.core.model import Kind, LeaseState
from mavproxy_handover.core.safety.energy import EnergyFact, Piece
from mavproxy_handover.core.safety.energy_prior import RETURN_ALT_M, WINGED_RETURN_ALT_M
from mavproxy_handover.core.safety.places import Choice, PlaceChooser, PlaceFact
from mavproxy_handover.mission.energy import Place, places_of, way_back, with_ways_down
from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.mission.items import RallyPoint
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.places import FenceLimits, PlaceFinder, flown_s
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.mission.returns import before_return
from mavproxy_handover.schedule import attempt
from mavproxy_handover.vehicle.kinds import VEHICLES
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Conversation, Conversations

__all__ = ["ReturnSite"]

#: places that are looked at in one second, besides the one that is chosen: each takes up to a millisecond
_AT_ONCE: Final = 4
#: an older position tells nothing
_FRESH_S: Final = 2.0
#: what was seen of a place longer ago says that looking is broken: up to forty of them come round in less
_OLD_S: Final = 10.0
#: what a metre more of the way back costs is taken from so many
_FARTHER_M: Final = 1000.0
#: after this run began, so long the stations may take to be heard: what was found in the list stays meanwhile
_SETTLE_S: Final = 5.0
_AGAIN_S: Final = 10.0
#: that somebody else writes the list is told this often at most
_OVERWRITTEN_S: Final = 60.0
#: an autopilot that was silent for so long may have begun anew
_REBOOT_S: Final = 3.0
#: so long (s) before the mission ends with a return its place is the best one of that moment: it is in the list by then
_LAST_S: Final = 12.0
#: what was said of a breach of the fence counts so long
_BREACH_S: Final = 3.0
#: parameter for the height of a return -> its units in a metre; a firmware has one of them
_RETURN_ALTS: Final = {"RTL_ALT_M": 1.0, "RTL_ALT": 100.0, "RTL_ALTITUDE": 1.0, "ALT_HOLD_RTL": 100.0}
#: parameter for the speed of a return (0: the one behind it), then that of missions -> its units in one m/s
_RETURN_SPEEDS: Final = {
    **{name: units for vehicle in VEHICLES for name, units in vehicle.back_speed.items()},
    **{name: units for vehicle in VEHICLES for name, units in vehicle.cruise.items()},
}
#: what is read of the autopilot
_NAMES: Final = (
    *_RETURN_ALTS, *_RETURN_SPEEDS, "FENCE_ENABLE", "FENCE_AUTOENABLE", "FENCE_TYPE", "FENCE_RADIUS", "FENCE_ALT_MAX",
    "WP_LOITER_RAD",
)  # fmt: skip
_CEILING, _CIRCLE = 1, 2
_HOME: Final = "home"
_NOT_LISTED: Final = ", NOT IN THE AUTOPILOT'S LIST"
_FOUND: Final = "place found in the list"
#: names of conversations
_WHERE_HOME_IS, _PARAMETERS, _OWN_FENCE = "where home is", "parameters of a return", "fence of a return"
_COMMANDED: Final = (LeaseState.HELD, LeaseState.TRANSFER)
#: what people are told has broken
_LOOKING, _ASKING = "places of a return", "home and limits of a return"


@dataclass(frozen=True, slots=True)
class _Seen:
    """What was seen of a place, and what that rests on.

    `at`: monotonic seconds, of the energy by which it was judged; `left_wh`: what was left then, None: not known;
    `metre_wh`: what each metre that the way back is longer by takes from its margin.
    """

    fact: PlaceFact
    at: float
    left_wh: float | None
    metre_wh: float


class ReturnSite:
    """The places of one vehicle. Times are monotonic seconds."""

    def __init__(
        self,
        sysid: int,
        aircraft: VehicleState,
        energy: Callable[[], EnergyFact],
        orders: Orders,
        conversations: Conversations,
        ties: Ties,
    ) -> None:
        self._aircraft = aircraft
        self._energy = energy
        self._orders = orders
        self._conversations = conversations
        self._ties = ties
        self._sysid = sysid
        self._lists = MissionProtocol(sysid)
        self._keeper = RallyKeeper(sysid, conversations, self._held, self._not_held, self._overwritten)
        #: the rally list as stations see it
        self.list = RallyList(ties, lambda: self._rally, self._replaced)
        self._chooser = PlaceChooser()
        #: where a return goes now; None while there are no places
        self.choice: Choice | None = None
        #: of the mission that is flown
        self._package: MissionPackage | None = None
        #: its route, or the one that the commander has sent since
        self._flown: Route | None = None
        self._finder = PlaceFinder((), Fence(()))
        self._rally: tuple[RallyPoint, ...] = ()
        self._found: Place | None = None
        #: home as it is among the places
        self._home: tuple[float, float] | None = None
        #: what the autopilot has told of its parameters
        self._parameters = aircraft.parameters.since()
        #: a station has sent these
        self._rally_sent = False
        self._replaced_at: float | None = None  # and not gathered yet
        self._places: tuple[Place, ...] = ()
        #: by the name of the place
        self._seen: dict[str, _Seen] = {}
        #: what was known of energy when the return that is flown began; None: none is
        self._turned: EnergyFact | None = None
        #: the item behind which the mission returns, and where that is; None: it does not
        self._last: tuple[int, tuple[float, float]] | None = None
        self._turn = 0
        #: what is asked for when
        self._home_at = self._parameters_at = self._fence_at = math.inf
        self._unread_until = -math.inf
        self._heard_at = -math.inf
        self._armed = False
        self._settled_at = math.inf
        self._judged: PlaceJudged | None = None
        #: the place that is in the journal, the one that stations know of, and one that a return is sent to when it is
        #: in the list
        self._told, self._stations_told = "", _HOME
        self._bounces_to: str | None = None
        #: the last try to write a place came to nothing, and the stations know
        self._unwritten = self._unwritten_told = False
        self._overwritten_told_at = -math.inf
        orders.before_return = self.before_return

    @property
    def where(self) -> tuple[str, float, float] | None:
        """Name, latitude and longitude (degrees) of the place where a return goes now; None: none is chosen yet, or
        what the autopilot's list holds is not known."""
        if self._elsewhere:
            held = self._keeper.held
            place = next((p for p in self._places if held is not None and alike(self._point(p), held)), None)
        else:
            name = None if self.choice is None else self.choice.place.name
            place = next((p for p in self._places if p.name == name), None)
        return None if place is None else (place.name, place.lat_deg, place.lon_deg)

    @property
    def _elsewhere(self) -> bool:
        """The place that is chosen could not be written: a return may go to another one."""
        return self._unwritten and not self._keeper.settled

    @property
    def goes_to(self) -> tuple[float, float] | None:
        """Latitude and longitude (degrees) of the place in the autopilot's list; None: it is not known."""
        held = self._keeper.held
        return None if held is None else (held.lat_deg, held.lon_deg)

    # ---- what there is to choose from -----------------------------------------------------------------------------

    def adopt(self, package: MissionPackage | None, now: float, *, keeps_rally: bool = False) -> None:
        """The autopilot holds this mission; None: nobody knows which one, and the places of before stay.

        `keeps_rally`: rally points that a station has sent go on to count.
        """
        if package is None:
            return
        self._package, self._flown = package, package.route
        self._finder = PlaceFinder(package.zones, Fence(package.route.fence), package.relief(self._home))
        self._rally_sent = self._rally_sent and keeps_rally
        if not self._rally_sent:
            self._rally = package.route.rally
        self._found = None
        self._last = before_return(package.route)
        self._keeper.forget()
        self._home_at = self._parameters_at = now
        self._fence_at = math.inf if package.route.fence else now
        self._unread_until = now + _AGAIN_S
        self._gather()

    def reroute(self, route: Route) -> None:
        """Another route is flown than the package's."""
        self._flown = route
        self._gather()

    def first_point(self, package: MissionPackage) -> RallyPoint:
        """What is written with a plan: home. Where a return goes is judged when the plan is there."""
        home = self._home or (package.route.home.lat_deg, package.route.home.lon_deg)
        return self._point(Place(_HOME, *home, 0.0))

    def _point(self, place: Place) -> RallyPoint:
        """A place as the autopilot's list holds it, heights in whole metres. What has wings flies there at that height,
        on its wings, so home is no lower than the return that the autopilot would fly without a list."""
        alt_m = place.alt_m
        if self._aircraft.kind.winged:
            ceiling_m = _fence_limits(self._parameters).ceiling_m
            return_m = self._return_alt_m()
            alt_m = max(alt_m, return_m if ceiling_m is None else min(return_m, ceiling_m - BELOW_CEILING_M))
        return RallyPoint(place.lat_deg, place.lon_deg, float(int(alt_m)))

    def _replaced(self, points: tuple[RallyPoint, ...], station: str, now: float) -> None:
        self._rally_sent = True
        self._rally, self._replaced_at = points, now  # judged with the next look: uploads may come in a row
        self._ties.narrator.rally_list(len(points), station, now)

    def _gather(self) -> None:
        """The places, from what is known of them."""
        if self._package is None or self._flown is None:
            return
        route = replace(self._package.route, rally=self._rally)
        places = [
            replace(place, lat_deg=self._home[0], lon_deg=self._home[1])
            if place.name == _HOME and self._home is not None
            else place
            for place in places_of(route)
        ]
        if self._found is not None and not any(alike(self._point(self._found), self._point(place)) for place in places):
            places.append(self._found)
        self._places = with_ways_down(places, self._flown, self._package.cruise_speed_mps)
        self._seen = {name: seen for name, seen in self._seen.items() if any(p.name == name for p in places)}

    def autopilot_restarted(self, now: float) -> None:
        """The autopilot has started again, or was silent so long that it may have.

        In flight, and when the companion has just started, the list is read at once: a return may need it.
        """
        if self._package is None:
            return
        if self._aircraft.flying or self._heard_at == -math.inf:
            self._keeper.forget()
        else:
            self._keeper.restarted(now)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def take(self, message: Any, now: float) -> None:
        """HEARTBEAT, PARAM_VALUE or HOME_POSITION of the autopilot, which the state has taken in."""
        match message.get_type():
            case "HEARTBEAT":
                if now - self._heard_at > _REBOOT_S:
                    self.autopilot_restarted(now)  # another one, for all that is known
                self._heard_at = now
                if self._aircraft.armed and not self._armed:
                    self._home_at = now  # it moves home to where it arms
                    self._unwritten_told = False
                    self._tell_unwritten()
                elif self._armed and not self._aircraft.armed:
                    self._landed()
                self._armed = self._aircraft.armed
                if not (self._aircraft.flying and self._aircraft.to_place):
                    self._turned = None
                elif self._turned is None:
                    self._turned = self._energy()
            case "PARAM_VALUE":
                self._keeper.counted(message.param_id, now)
            case "HOME_POSITION":
                self._look_at_home()

    def _look_at_home(self) -> None:
        if self._aircraft.telemetry.home.value != self._home:
            self._home = self._aircraft.telemetry.home.value
            self._finder.relief = None if self._package is None else self._package.relief(self._home)
            self._gather()

    def _landed(self) -> None:
        """The flight is over, and with it what the commander has put in the list."""
        self._bounces_to = self._found = None
        self._stations_told = _HOME
        if self._package is not None:
            self._rally, self._rally_sent = self._package.route.rally, False
            self._gather()

    # ---- each second ----------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        self._keeper.tick(now)
        self.list.tick(now)

    def each_second(self, now: float) -> None:
        """Judge the places, and keep the best one in the list."""
        if self._package is None or self._aircraft.foreign:
            return
        attempt(self._ties.fault, _ASKING, self._ask, now)
        attempt(self._ties.fault, _LOOKING, self._look, now)

    def _look(self, now: float) -> None:
        if self._replaced_at is not None:
            self._replaced_at = None
            self._gather()
        here, unseen_s = self._aircraft.where, now - self._aircraft.position.at
        if here is not None and unseen_s <= _FRESH_S:
            self._measure(here)
        elif here is not None and self._aircraft.flying and not self._aircraft.to_place:
            self._measure(here, unseen_s * max(self._aircraft.track[1], self.return_mps or 0.0))
        self._choose(now)

    def _measure(self, here: tuple[float, float, float], beyond_m: float = 0.0) -> None:
        """Look at the place that is chosen, at home, and at some of the others in turn. `beyond_m`: so much farther it
        may be than from here, which is where it was seen last."""
        chosen = None if self.choice is None else self.choice.place.name
        others = [place for place in self._places if place.name not in (chosen, _HOME)]
        now = [place for place in self._places if place.name in (chosen, _HOME)]
        for _ in range(min(_AT_ONCE, len(others))):
            self._turn = (self._turn + 1) % len(others)
            now.append(others[self._turn])
        now += [place for place in others if place.name not in self._seen and place not in now]
        for place in now:
            attempt(self._ties.fault, _LOOKING, self._see, place, here, beyond_m)

    def _see(self, place: Place, here: tuple[float, float, float], beyond_m: float = 0.0) -> None:
        """Look at one place."""
        assert self._package is not None
        spot, energy = (place.lat_deg, place.lon_deg), self._energy()
        model, limits = energy.model, _fence_limits(self._parameters)
        return_alt = max(self._return_alt_m(), 0.0 if model is None else model.return_alt_m)
        return_mps = self._return_mps(self._package)
        winged = model is not None and model.wings
        way = way_back(here, place, return_alt, return_mps, wings=winged, beyond_m=beyond_m)
        height = max(here[2], place.alt_m, return_alt)
        if limits.ceiling_m is not None:
            height = max(here[2], min(height, limits.ceiling_m))
        if self._aircraft.kind.winged:  # it glides all the way down to the height of the place in the list
            height = self._point(place).alt_m
        view = self._finder.look(here[:2], spot, height)
        inside = view.inside and self._within(limits, place)
        need = None if model is None else model.need_wh(way)
        margin = spare = needs = left = None
        metre_wh = 0.0
        if model is not None and need is not None and energy.left_wh is not None:
            margin = energy.left_wh - model.budget_wh(need)
            spare = energy.left_wh - model.reserve_factor * need
            left = energy.left_wh / model.battery_wh
            if math.isfinite(need):
                needs = model.reserve_factor * need / model.battery_wh
                level = max(way, key=lambda piece: piece.length_m)
                farther = Piece(_FARTHER_M, level.bearing_deg, speed_mps=level.speed_mps)
                metre_wh = model.reserve_factor * model.piece_wh(farther) / _FARTHER_M
        fact = PlaceFact(
            place.name,
            distance_m(*here[:2], *spot),
            flown_s(way, model, return_mps),
            margin,
            spare,
            needs,
            left,
            inside,
            inside and view.way_inside,
            view.there,
            view.way,
            view.way_clear,
        )
        self._seen[place.name] = _Seen(fact, energy.at, energy.left_wh, metre_wh)

    def _within(self, limits: FenceLimits, place: Place) -> bool:
        """Whether the autopilot's own fences around home and above it hold the place."""
        if limits.ceiling_m is not None and place.alt_m > limits.ceiling_m:
            return False
        home = next(entry for entry in self._places if entry.name == _HOME)
        away = distance_m(place.lat_deg, place.lon_deg, home.lat_deg, home.lon_deg)
        return limits.radius_m is None or away <= limits.radius_m

    @property
    def ceiling_m(self) -> float | None:
        """The ceiling of the autopilot's own fence (m above home); None: it has none that is known to be on."""
        return _fence_limits(self._parameters).ceiling_m

    @property
    def return_mps(self) -> float | None:
        """How fast a return is flown (m/s), of wings the airspeed; None: there is no mission."""
        return None if self._package is None else self._return_mps(self._package)

    def _return_mps(self, package: MissionPackage) -> float:
        held = (self._parameters[name] / units for name, units in _RETURN_SPEEDS.items() if name in self._parameters)
        return next((speed_mps for speed_mps in held if speed_mps > 0.0), package.cruise_speed_mps)

    def _return_alt_m(self) -> float:
        held = (self._parameters[name] / units for name, units in _RETURN_ALTS.items() if name in self._parameters)
        if not self._aircraft.kind.winged:
            return next(held, RETURN_ALT_M)
        alt_m = next(held, WINGED_RETURN_ALT_M)
        return alt_m if alt_m > 0.0 else WINGED_RETURN_ALT_M  # it stays as high as it is

    def _choose(self, now: float) -> None:
        if not self._seen or (not self._keeper.known and now < self._unread_until):
            return  # what holds is about to be read
        if self._heard_at == -math.inf:
            return  # whether it flies is not known
        view = self._ties.arbiter.view
        if self._settled_at == math.inf:
            self._settled_at = now + _SETTLE_S
            self._take_up(now)
        returning = self._aircraft.flying and self._aircraft.to_place
        unsettled = now < self._settled_at or view.lease is LeaseState.RECOVERING
        fixed = unsettled or (returning and not self._may_bounce(now))
        before = self.choice
        facts = [self._by_now(self._seen[place.name]) for place in self._places if place.name in self._seen]
        usable = self._ties.arbiter.usable(now)
        ends = not returning and self._mission_returns()
        self.choice = self._chooser.choose(facts, usable, now, returning=returning, fixed=fixed, ends=ends)
        if self.choice is None:
            return
        name = self.choice.place.name
        if returning and before is not None and before.place.name != name:
            self._bounces_to = name
        self._keeper.want(self._point(next(place for place in self._places if place.name == name)))
        if self._keeper.settled:
            self._unwritten = self._unwritten_told = False
            if name != self._told:
                self._tell()
        figures = f"{self.choice.figures(self._ties.arbiter.name)}{_NOT_LISTED if self._elsewhere else ''}"
        judged = PlaceJudged(name, self.choice.reachable, figures)
        if judged != self._judged:
            self._judged = judged
            self._ties.handle(judged, now)

    def _mission_returns(self) -> bool:
        """The mission flies to where it ends with a return, and is nearly there."""
        aircraft = self._aircraft
        if self._last is None or not aircraft.flies_mission or aircraft.where is None:
            return False
        seq, place = self._last
        return aircraft.waypoint == seq and distance_m(*aircraft.where[:2], *place) < _LAST_S * aircraft.track[1]

    def _take_up(self, now: float) -> None:
        """The list has been read for the first time: what it holds is where a return goes."""
        held = self._keeper.held
        if held is None or not self._aircraft.flying:
            return
        place = next((place for place in self._places if alike(self._point(place), held)), None)
        if place is None:
            self._found = Place(_FOUND, held.lat_deg, held.lon_deg, held.alt_m)
            self._gather()
            place = self._places[-1]
            if self._aircraft.where is not None:
                attempt(self._ties.fault, _LOOKING, self._see, place, self._aircraft.where)
        self._chooser.adopt(place.name)

    @property
    def short(self) -> bool:
        """No place is in reach any more with the reserve left, as far as is known. Not of a plane on its way down: a
        return would lead it away from there, and to the same landing."""
        if self._aircraft.kind is Kind.PLANE and self._aircraft.ways_down.is_on:
            return False
        margin_wh = self._margin_wh
        return margin_wh is not None and margin_wh <= 0.0

    @property
    def _margin_wh(self) -> float | None:
        """What the best place leaves beyond need and reserve; None where that is not known. Where none is inside the
        fence it is the best of all: energy comes to its end there as well, and nobody else would say so. Where none
        was seen yet it is what is left beyond the reserve."""
        seen = [each for each in self._seen.values() if each.fact.inside] or self._seen.values()
        margins = [margin for margin in map(self._margin_of, seen) if margin is not None]
        energy = self._energy()
        if margins or self._package is None or energy.model is None or energy.left_wh is None:
            return max(margins, default=None)
        return energy.left_wh - energy.model.reserve_wh

    def _margin_of(self, seen: _Seen) -> float | None:
        """Of one place; where looking is broken it may have flown away from there all the time."""
        margin_wh, old_s = self._by_now(seen).margin_wh, self._known.at - seen.at
        if margin_wh is None or old_s <= _OLD_S or not self._aircraft.flying:
            return margin_wh
        return margin_wh - seen.metre_wh * old_s * max(self._aircraft.track[1], self.return_mps or 0.0)

    def _by_now(self, seen: _Seen) -> PlaceFact:
        """The fact without what was drawn since: nothing, where it was looked at this second."""
        fact, left_wh = seen.fact, self._known.left_wh
        if fact.margin_wh is None or fact.spare_wh is None or fact.left is None:
            return fact
        if left_wh is None or seen.left_wh is None or left_wh >= seen.left_wh:
            return fact
        drawn_wh = seen.left_wh - left_wh
        return replace(
            fact,
            margin_wh=fact.margin_wh - drawn_wh,
            spare_wh=fact.spare_wh - drawn_wh,
            left=fact.left * left_wh / seen.left_wh,
        )

    @property
    def _known(self) -> EnergyFact:
        """What is known of energy; on its way back what was when it turned, for it gets nearer by what it draws."""
        return self._turned or self._energy()

    @property
    def energy_words(self) -> str:
        """What is left, and what the way to the best place needs, for people; "" where that is not known."""
        left_wh, margin_wh = self._energy().left_wh, self._margin_wh
        if left_wh is None or margin_wh is None or not math.isfinite(margin_wh):
            return ""
        return f"energy: {left_wh:.1f} Wh left, the way back needs {left_wh - margin_wh:.1f} Wh with the reserve"

    def candidates(self) -> tuple[Place, ...] | None:
        """Places that a return could be sent to, wherever it begins: those inside the fence; None: not known yet."""
        if not self._places:
            return None
        limits = _fence_limits(self._parameters)
        return tuple(
            place
            for place in self._places
            if self._finder.in_fence((place.lat_deg, place.lon_deg)) and self._within(limits, place)
        )

    def words(self) -> str:
        """Where a return goes, for people; "" while there is no place."""
        if self.choice is None:
            return ""
        return f"{self.choice.words(self._ties.arbiter.name)}{_NOT_LISTED if self._elsewhere else ''}"

    # ---- what the autopilot is asked ------------------------------------------------------------------------------

    def _ask(self, now: float) -> None:
        if "load" in self._conversations:
            return
        if now >= self._home_at and _WHERE_HOME_IS not in self._conversations:
            self._home_at = now + _AGAIN_S

            def home(talk: Conversation, now: float) -> None:
                if talk.failure is None:
                    self._home_at = math.inf
                    lat_deg, lon_deg = talk.result
                    self._aircraft.has_home(lat_deg, lon_deg, now)
                    self._look_at_home()

            self._conversations.begin(_WHERE_HOME_IS, self._lists.home(), home, now)
        if now >= self._parameters_at and _PARAMETERS not in self._conversations:
            self._parameters_at = now + _AGAIN_S

            def read(talk: Conversation, _now: float) -> None:
                if talk.result:
                    self._parameters_at = math.inf

            self._conversations.begin(_PARAMETERS, reading(self._sysid, _NAMES), read, now)
        if now >= self._fence_at and _OWN_FENCE not in self._conversations:
            self._fence_at = now + _AGAIN_S

            def own(talk: Conversation, _now: float) -> None:
                if talk.failure is None and self._package is not None:
                    self._fence_at = math.inf
                    relief = self._package.relief(self._home)
                    self._finder = PlaceFinder(self._package.zones, Fence(talk.result), relief)

            self._conversations.begin(_OWN_FENCE, self._lists.held_fence(), own, now)

    # ---- the list -------------------------------------------------------------------------------------------------

    def _held(self, point: RallyPoint, now: float) -> None:
        """The list holds that point."""
        self._unwritten = self._unwritten_told = False
        if self.choice is None or not self._keeper.settled:
            return  # it is not the one any more: the next one is on its way
        name = self.choice.place.name
        if name != self._told:
            self._tell()
        bounces, self._bounces_to = self._bounces_to == name, None
        if bounces and self._aircraft.to_place and self._may_bounce(now):
            self._ties.narrator.bounced(name)
            self._orders.again(now)

    def _tell(self) -> None:
        """Which place a return means from now on; the stations read it in flight, where it is not home."""
        assert self.choice is not None
        self._told = self.choice.place.name
        text = f"a return goes to {self.words()}"
        self._ties.narrator.place(text, self._told, self.choice.reachable)
        if self._aircraft.armed and self._told != self._stations_told:
            self._stations_told = self._told
            self._ties.voice.say_to_all(f"A{text[1:]}", mavlink.MAV_SEVERITY_NOTICE)

    def _not_held(self, why: str) -> None:
        self._ties.narrator.place_failed(why)
        self._unwritten = True
        self._tell_unwritten()

    def _tell_unwritten(self) -> None:
        """Stations read in flight, once, that the place could not be written."""
        if self._elsewhere and not self._unwritten_told and self.choice is not None and self._aircraft.armed:
            self._unwritten_told = True
            name = self.choice.place.name
            self._ties.voice.say_to_all(f"{name} is not in the autopilot's list: a return may go elsewhere")

    def _overwritten(self, now: float) -> None:
        self._ties.narrator.rally_overwritten()
        if self._aircraft.armed and now - self._overwritten_told_at >= _OVERWRITTEN_S:
            self._overwritten_told_at = now
            self._ties.voice.say_to_all("Rally list changed by another program. Restoring the return site")

    # ---- a return -------------------------------------------------------------------------------------------------

    def before_return(self, now: float) -> Callable[[], bool]:
        """A return is about to be ordered: judge once more, and write what is not written. Returns what tells whether
        it is, which is not to be waited for long."""
        self._unread_until = now
        attempt(self._ties.fault, _LOOKING, self._look, now)
        if not self._keeper.settled:
            self._keeper.hurry(now)
        return lambda: self._keeper.settled

    def _may_bounce(self, now: float) -> bool:
        """Whether a return that is under way may be begun anew."""
        view, where = self._ties.arbiter.view, self._aircraft.where
        outside = where is None or not self._finder.in_fence(where[:2]) or now - self._aircraft.breached_at <= _BREACH_S
        commanded = view.commander is not None and view.lease in _COMMANDED
        failsafe = self._aircraft.telemetry.heartbeat.failsafe
        # by a bounce what hovers already would fly off forwards once more
        return self._orders.returning and commanded and not outside and not failsafe and not self._aircraft.hovers


def _fence_limits(parameters: Mapping[str, float]) -> FenceLimits:
    """The autopilot's own fences around home and above it, as far as they are known to be on."""
    kinds = int(parameters.get("FENCE_TYPE", 0))
    if not parameters.get("FENCE_ENABLE", 0) and not parameters.get("FENCE_AUTOENABLE", 0):
        kinds = 0
    radius, ceiling = parameters.get("FENCE_RADIUS"), parameters.get("FENCE_ALT_MAX")
    return FenceLimits(radius if kinds & _CIRCLE else None, ceiling if kinds & _CEILING else None)
