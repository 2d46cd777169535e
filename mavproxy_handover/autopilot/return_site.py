# SPDX-License-Identifier: GPL-3.0-or-later

"""Where a return goes: the candidates, judged each second, and the best one kept in the autopilot's list.

Which candidates there are, what each is worth, what the battery leaves and which one is chosen is in
`monitors/return_site/`; how the autopilot flies a return in `vehicle/return_limits.py`; how a place gets into the
autopilot in `rally.py`. Here they meet. Rules that live here:

* While no position comes, the battery goes on emptying: until the aircraft returns, the way back is the one from where
  it was seen last, and from as far beyond as it may have flown since. On its way back it gets nearer, and what was
  known stays.
* On its way to a place the aircraft reads no list: RTL has read it when it began. So a choice that changes then needs a
  bounce, GUIDED and RTL again. It is done only for a return that was ordered here, under a commander who is heard, not
  outside the fence, not while any failsafe of the autopilot acts, and once for a change. In every other return nothing
  changes: the list goes on holding the place that is flown to.

Nothing in here raises: what breaks costs a place, the questions or the choice that second. What was told last stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from mavproxy_handover.autopilot.context import Context
from mavproxy_handover.autopilot.rally import RallyKeeper
from mavproxy_handover.autopilot.rally_list import RallyList
from mavproxy_handover.autopilot.return_news import ReturnNews
from mavproxy_handover.autopilot.return_questions import ReturnQuestions
from mavproxy_handover.core.common.events import PlaceJudged
from mavproxy_handover.core.common.model import LeaseState
from mavproxy_handover.core.safety.energy import EnergyFact
from mavproxy_handover.core.safety.return_site import Choice
from mavproxy_handover.mission.items import RallyPoint
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.monitors.return_site.candidates import Candidates
from mavproxy_handover.monitors.return_site.choice import SiteChoice
from mavproxy_handover.monitors.return_site.margin import Margin
from mavproxy_handover.monitors.return_site.views import LOOKING, Views
from mavproxy_handover.schedule import attempt

__all__ = ["ReturnSite"]

#: an older position tells nothing
_FRESH_S: Final = 2.0
#: an autopilot that was silent for so long may have begun anew
_REBOOT_S: Final = 3.0
#: what was said of a breach of the fence counts so long
_BREACH_S: Final = 3.0
_COMMANDED: Final = (LeaseState.HELD, LeaseState.TRANSFER)
#: what people are told has broken
_ASKING: Final = "home and limits of a return"


class ReturnSite:
    """The place of a return of one vehicle. `energy` gives what is known of energy now. Times are monotonic seconds."""

    def __init__(self, sysid: int, context: Context, energy: Callable[[], EnergyFact]) -> None:
        state, authority, reports = context.state, context.authority, context.reports
        conversations = context.conversations
        self._state = state
        self._energy = energy
        self._authority = authority
        self._reports = reports
        self.candidates = Candidates(state)
        self.views = Views(state, self.candidates, reports.fault)
        self._margin = Margin(state, self.candidates, self.views)
        self._choice = SiteChoice(state, self.candidates, self.views, self._margin)
        self._questions = ReturnQuestions(sysid, state, self.candidates, conversations, self._look_at_home)
        self._keeper = RallyKeeper(sysid, conversations, self._held, self._not_held, self._overwritten)
        #: the rally list as stations see it
        self.list = RallyList(authority.commands, reports, lambda: self.candidates.rally, self._replaced)
        self._news = ReturnNews(state, authority.arbiter.name, reports)
        #: what was told of the choice last
        self._judged: PlaceJudged | None = None
        #: the heartbeat before this one
        self._before = state.telemetry.heartbeat
        #: the place that a return is sent to when it is in the list
        self._bounces_to = ""
        #: the list holds that place now, so the return can begin again
        self._bounce_due = False

    # ---- what is asked of it --------------------------------------------------------------------------------------

    @property
    def choice(self) -> Choice | None:
        """Where a return goes now; None while there are no places."""
        return self._choice.now

    @property
    def where(self) -> tuple[str, float, float] | None:
        """Name, latitude and longitude (degrees) of the place where a return goes now; None: none is chosen yet, or
        what the autopilot's list holds is not known."""
        if self._elsewhere:
            held = self._keeper.held
            place = None if held is None else self.candidates.like(held)
        else:
            place = self.candidates.named(self._choice.name)
        return None if place is None else (place.name, place.lat_deg, place.lon_deg)

    @property
    def _elsewhere(self) -> bool:
        """The place that is chosen could not be written: a return may go to another one."""
        return self._keeper.failing and not self._keeper.settled

    @property
    def goes_to(self) -> tuple[float, float] | None:
        """Latitude and longitude (degrees) of the place in the autopilot's list; None: it is not known."""
        held = self._keeper.held
        return None if held is None else (held.lat_deg, held.lon_deg)

    @property
    def short(self) -> bool:
        """No place is in reach any more with the reserve left, as far as is known."""
        return self._margin.short(self._energy())

    @property
    def margin_wh(self) -> float | None:
        """What the best place leaves beyond need and reserve; None: not known."""
        return self._margin.margin_wh(self._energy())

    @property
    def energy_words(self) -> str:
        """What is left, and what the way to the best place needs, for people; "" where that is not known."""
        return self._margin.words(self._energy())

    def words(self) -> str:
        """Where a return goes, for people; "" while there is no place."""
        return "" if self.choice is None else self._news.words(self.choice, listed=not self._elsewhere)

    # ---- what comes in --------------------------------------------------------------------------------------------

    def adopt(self, package: MissionPackage | None, now: float, *, keeps_rally: bool = False) -> None:
        """The autopilot holds this mission; None: nobody knows which one, and the places of before stay.

        `keeps_rally`: rally points that a station has sent go on to count.
        """
        if package is None:
            return
        self._keeper.forget()
        self._questions.adopt(bool(package.route.fence), now)
        self.candidates.adopt(package, keeps_rally=keeps_rally)
        self.views.forget_others()

    def reroute(self, route: Route) -> None:
        """Another route is flown than the package's."""
        self.candidates.reroute(route)
        self.views.forget_others()

    def _replaced(self, points: tuple[RallyPoint, ...], station: str, now: float) -> None:
        self.candidates.replace_rally(points)
        self._reports.event_log.rally_list(len(points), station, now)

    def autopilot_restarted(self, now: float) -> None:
        """The autopilot has started again, or was silent so long that it may have.

        In flight, and when the companion has just started, the list is read at once: a return may need it.
        """
        if self.candidates.package is None:
            return
        if self._state.flying or self._before.at == -math.inf:
            self._keeper.forget()
        else:
            self._keeper.restarted(now)

    def take(self, message: Any, now: float) -> None:
        """HEARTBEAT, PARAM_VALUE or HOME_POSITION of the autopilot, which the state has taken in."""
        match message.get_type():
            case "HEARTBEAT":
                self._on_heartbeat(now)
            case "PARAM_VALUE":
                self._keeper.counted(message.param_id, now)
            case "HOME_POSITION":
                self._look_at_home()

    def _on_heartbeat(self, now: float) -> None:
        if now - self._before.at > _REBOOT_S:
            self.autopilot_restarted(now)  # another one, for all that is known
        before, self._before = self._before, self._state.telemetry.heartbeat
        if self._state.armed and not before.armed:
            self._questions.armed(now)
            self._news.armed()
            self._tell_elsewhere()
        elif before.armed and not self._state.armed:
            self._bounces_to, self._bounce_due = "", False
            self._news.landed()
            self.candidates.landed()
            self.views.forget_others()
        self._margin.update(self._energy())

    def _look_at_home(self) -> None:
        self.candidates.look_at_home()
        self.views.forget_others()

    # ---- each second ----------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        self._keeper.tick(now)
        self.list.tick(now)

    def each_second(self, now: float, *, returning: bool) -> None:
        """Judge the places, and keep the best one in the list. `returning`: as in `bounces`."""
        if self.candidates.package is None or self._state.foreign:
            return
        attempt(self._reports.fault, _ASKING, self._questions.ask, now)
        attempt(self._reports.fault, LOOKING, self._look, now, returning)

    def _look(self, now: float, ordered: bool) -> None:
        state, chosen = self._state, self._choice.name
        self.candidates.gather_sent()
        self.views.forget_others()
        here, unseen_s = state.where, now - state.position.at
        if here is not None and unseen_s <= _FRESH_S:
            self.views.measure(chosen, here, self._energy())
        elif here is not None and state.flying and not state.to_place:
            beyond_m = unseen_s * max(state.track[1], self.candidates.return_mps or 0.0)
            self.views.measure(chosen, here, self._energy(), beyond_m)
        self._choose(now, ordered)

    def _choose(self, now: float, ordered: bool) -> None:
        if not self.views.seen or (not self._keeper.known and now < self._questions.unread_until):
            return  # what holds is about to be read
        if self._before.at == -math.inf:
            return  # whether it flies is not known
        arbiter, energy = self._authority.arbiter, self._energy()
        self._choice.take_up(self._keeper.held, energy, now)
        returning = self._state.flying and self._state.to_place
        recovering = arbiter.view.lease is LeaseState.RECOVERING
        may_bounce = ordered and returning and self._may_bounce(now)
        bounces_to = self._choice.update(
            arbiter.usable(now), energy, now, recovering=recovering, returning=returning, may_bounce=may_bounce
        )
        choice = self.choice
        place = self.candidates.named(self._choice.name)
        if choice is None or place is None:
            return
        self._bounces_to = bounces_to or self._bounces_to
        self._keeper.want(self.candidates.point(place))
        if self._keeper.settled:
            self._news.place(choice, listed=True)
        figures = self._news.figures(choice, listed=not self._elsewhere)
        judged = PlaceJudged(place.name, choice.reachable, figures)
        if judged != self._judged:
            self._judged = judged
            self._authority.handle(judged, now)

    # ---- the list -------------------------------------------------------------------------------------------------

    def _held(self, _point: RallyPoint, now: float) -> None:
        """The list holds that point."""
        self._news.written()
        if self.choice is None or not self._keeper.settled:
            return  # it is not the one any more: the next one is on its way
        name = self.choice.place.name
        self._news.place(self.choice, listed=True)
        self._bounce_due, self._bounces_to = self._bounces_to == name, ""

    def _not_held(self, why: str) -> None:
        self._news.not_written(why)
        self._tell_elsewhere()

    def _tell_elsewhere(self) -> None:
        if self._elsewhere and self.choice is not None:
            self._news.elsewhere(self.choice.place.name)

    def _overwritten(self, now: float) -> None:
        self._news.overwritten(now)

    # ---- a return -------------------------------------------------------------------------------------------------

    def before_return(self, now: float, *, returning: bool) -> Callable[[], bool]:
        """A return is about to be ordered: judge the places again, and write the chosen one if the list does not hold
        it. `returning`: as in `bounces`.

        Returns a function that says whether the list holds it. A return does not wait long for that.
        """
        self._questions.hurry(now)
        attempt(self._reports.fault, LOOKING, self._look, now, returning)
        if not self._keeper.settled:
            self._keeper.hurry(now)
        return lambda: self._keeper.settled

    def bounces(self, now: float, *, returning: bool) -> bool:
        """Whether the return must begin again now, because its place was changed in the list; told once.

        `returning`: the aircraft returns by an order of the companion.
        """
        due, self._bounce_due = self._bounce_due, False
        if not due or not returning or not self._state.to_place or not self._keeper.settled or self.choice is None:
            return False
        if not self._may_bounce(now):
            return False
        self._reports.event_log.bounced(self.choice.place.name)
        return True

    def _may_bounce(self, now: float) -> bool:
        """Whether a return that was ordered here and is under way may begin again."""
        state, view = self._state, self._authority.arbiter.view
        where = state.where
        breached = now - state.breached_at <= _BREACH_S
        outside = where is None or not self.candidates.finder.in_fence(where[:2]) or breached
        commanded = view.commander is not None and view.lease in _COMMANDED
        failsafe = state.telemetry.heartbeat.failsafe
        # by a bounce what hovers already would fly off forwards once more
        return commanded and not outside and not failsafe and not state.hovers
