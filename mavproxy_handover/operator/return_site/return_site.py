# SPDX-License-Identifier: GPL-3.0-or-later

"""The return site: judges the candidates each second, and keeps the best one in the autopilot's rally list.

`monitors/return_site/` has the candidates, their value, the energy margin and the choice. `vehicle/return_limits.py`
says how the autopilot flies a return, `rally_writer.py` writes the rally list. This module connects them. Rules:

* While no position comes, the battery still empties. Until the aircraft returns, the way back begins at the last
  position, plus the distance that the aircraft may have flown since. During a return the aircraft comes nearer, so the
  last values stay.
* During a return the autopilot does not read the list: RTL has read it at its beginning. If the choice changes then,
  the companion bounces the aircraft: GUIDED, then RTL again.
* A bounce needs a return that the companion ordered and a commander that is heard. The aircraft must be inside the
  fence, and no failsafe of the autopilot may act. There is one bounce for each change.
* In every other return the list keeps the site that the aircraft flies to.
* A return flies to the site that the list held when it began. Another one may be chosen by then and not be written yet,
  and a return may begin while the autopilot is not heard. So the list is read if it is not known, and its site is
  chosen. A return that the companion has ordered begins again when the better site is in the list.

Nothing in here raises. A fault costs a site, the questions or the choice of that second; the last result stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from mavproxy_handover.core.common.events import PlaceJudged
from mavproxy_handover.core.common.model import LeaseState
from mavproxy_handover.core.safety.energy import EnergyFact
from mavproxy_handover.core.safety.return_site import Choice
from mavproxy_handover.mission.items import RallyPoint
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import Route
from mavproxy_handover.monitors.return_site.candidates import Candidates
from mavproxy_handover.monitors.return_site.margin import Margin
from mavproxy_handover.monitors.return_site.selection import SiteSelection
from mavproxy_handover.monitors.return_site.views import JUDGING, Views
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.return_site.rally_list import RallyList
from mavproxy_handover.operator.return_site.rally_writer import RallyWriter
from mavproxy_handover.operator.return_site.return_news import ReturnNews
from mavproxy_handover.operator.return_site.return_questions import ReturnQuestions
from mavproxy_handover.tools.schedule import attempt

__all__ = ["ReturnSite"]

#: a position older than this (s) does not count
_FRESH_S: Final = 2.0
#: an autopilot that was silent for this time (s) may have restarted
_REBOOT_S: Final = 3.0
#: a report of a fence breach counts for this time (s)
_BREACH_S: Final = 3.0
_COMMANDED: Final = (LeaseState.HELD, LeaseState.TRANSFER)
#: name of the job in reports of faults
_ASKING: Final = "home and limits of a return"


class ReturnSite:
    """The return site of one vehicle. `energy` returns the current energy fact. Times are monotonic seconds."""

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
        self._selection = SiteSelection(state, self.candidates, self.views, self._margin)
        self._questions = ReturnQuestions(sysid, state, self.candidates, conversations, self._update_home)
        self._rally_writer = RallyWriter(sysid, conversations, self._held, self._not_held, self._overwritten)
        #: the rally list as stations see it
        self.list = RallyList(authority.commands, reports, lambda: self.candidates.rally, self._replaced)
        self._news = ReturnNews(state, authority.arbiter.name, reports)
        #: the last event about the choice
        self._judged: PlaceJudged | None = None
        #: the previous heartbeat
        self._before = state.telemetry.heartbeat
        #: the site that a return is sent to as soon as the list holds it
        self._bounces_to = ""
        #: the aircraft flew a return at the last heartbeat
        self._returns = False
        #: a return has begun, and the site that it flies to is not found out yet
        self._begun = False
        #: the list holds that site now, so the return can begin again
        self._bounce_due = False

    # ---- queries --------------------------------------------------------------------------------------------------

    @property
    def choice(self) -> Choice | None:
        """The chosen return site; None while there are no candidates."""
        return self._selection.current

    @property
    def where(self) -> tuple[str, float, float] | None:
        """Name, latitude and longitude (degrees) of the site that a return goes to now.

        None: no site is chosen yet, or the content of the autopilot's list is not known.
        """
        if self._elsewhere or self._begun:
            held = self._rally_writer.held
            place = None if held is None else self.candidates.like(held)
        else:
            place = self.candidates.named(self._selection.name)
        return None if place is None else (place.name, place.lat_deg, place.lon_deg)

    @property
    def way(self) -> tuple[float, float | None] | None:
        """Time (s) and part of the battery that a return to the site of `where` needs, with the landing.

        A part of None is not known; None: nothing is known of the way.
        """
        choice, where = self.choice, self.where
        if choice is None or where is None or choice.place.name != where[0]:
            return None
        return choice.place.time_s, choice.place.needs

    @property
    def _elsewhere(self) -> bool:
        """The chosen site could not be written: a return may go to another one."""
        return self._rally_writer.failing and not self._rally_writer.settled

    @property
    def goes_to(self) -> tuple[float, float] | None:
        """Latitude and longitude (degrees) of the site in the autopilot's list; None: not known."""
        held = self._rally_writer.held
        return None if held is None else (held.lat_deg, held.lon_deg)

    @property
    def short(self) -> bool:
        """No site is in reach with the reserve any more, as far as is known."""
        return self._margin.short(self._energy())

    @property
    def margin_wh(self) -> float | None:
        """The energy (Wh) left beyond need and reserve at the best site; None: not known."""
        return self._margin.margin_wh(self._energy())

    @property
    def energy_words(self) -> str:
        """The energy left and the need of the way to the best site, for people; "" if not known."""
        return self._margin.words(self._energy())

    def words(self) -> str:
        """The return site, for people; "" while there is none."""
        return "" if self.choice is None else self._news.words(self.choice, listed=not self._elsewhere)

    def brief(self) -> str:
        """The return site, for a line that has what is left in the battery already."""
        return "" if self.choice is None else self._news.brief(self.choice, listed=not self._elsewhere)

    # ---- changes --------------------------------------------------------------------------------------------------

    def set_mission(self, package: MissionPackage | None, now: float, *, keeps_rally: bool = False) -> None:
        """The autopilot holds this mission; None: not known, and the former candidates stay.

        `keeps_rally`: rally points that a station has sent still count.
        """
        if package is None:
            return
        self._rally_writer.forget()
        self._questions.set_mission(bool(package.route.fence), now)
        self.candidates.set_mission(package, keeps_rally=keeps_rally)
        self.views.forget_others()

    def reroute(self, route: Route) -> None:
        """The aircraft flies another route than the package's."""
        self.candidates.reroute(route)
        self.views.forget_others()

    def _replaced(self, points: tuple[RallyPoint, ...], station: str, now: float) -> None:
        self.candidates.replace_rally(points)
        self._reports.event_log.rally_list(len(points), station, now)

    def autopilot_restarted(self, now: float) -> None:
        """The autopilot has restarted, or was silent so that it may have restarted.

        In flight, and when the companion has just started, the list is read at once: a return may need it.
        """
        if self.candidates.package is None:
            return
        if self._state.flying or self._before.at == -math.inf:
            self._rally_writer.forget()
        else:
            self._rally_writer.restarted(now)

    def on_message(self, message: Any, now: float) -> None:
        """A HEARTBEAT, PARAM_VALUE or HOME_POSITION of the autopilot, after the state was updated."""
        match message.get_type():
            case "HEARTBEAT":
                self._on_heartbeat(now)
            case "PARAM_VALUE":
                self._rally_writer.counted(message.param_id, now)
            case "HOME_POSITION":
                self._update_home()

    def _on_heartbeat(self, now: float) -> None:
        if now - self._before.at > _REBOOT_S:
            self.autopilot_restarted(now)  # it may be another autopilot
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
        returned, self._returns = self._returns, self._state.flying and self._state.to_place
        if self._returns and not returned:
            self._begun = True
            self._rally_writer.rest()
        self._margin.update(self._energy())

    def _update_home(self) -> None:
        self.candidates.update_home()
        self.views.forget_others()

    # ---- each second ----------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        self._rally_writer.tick(now)
        self.list.tick(now)

    def each_second(self, now: float, *, returning: bool) -> None:
        """Judge the candidates, and keep the best one in the list. `returning`: as in `bounces`."""
        if self.candidates.package is None or self._state.foreign:
            return
        attempt(self._reports.fault, _ASKING, self._questions.ask, now)
        attempt(self._reports.fault, JUDGING, self._judge_candidates, now, returning)

    def _judge_candidates(self, now: float, ordered: bool) -> None:
        state, chosen = self._state, self._selection.name
        self.candidates.gather_sent()
        self.views.forget_others()
        here, unseen_s = state.where, now - state.position.at
        if here is not None and unseen_s <= _FRESH_S:
            self.views.update(chosen, here, self._energy())
        elif here is not None and state.flying and not state.to_place:
            beyond_m = unseen_s * max(state.track[1], self.candidates.return_mps or 0.0)
            self.views.update(chosen, here, self._energy(), beyond_m)
        self._choose(now, ordered)

    def _choose(self, now: float, ordered: bool) -> None:
        if not self.views.seen or (not self._rally_writer.known and now < self._questions.unread_until):
            return  # the list is about to be read
        if self._before.at == -math.inf:
            return  # it is not known whether the aircraft flies
        arbiter, energy = self._authority.arbiter, self._energy()
        self._selection.restore_from_list(self._rally_writer.held, energy, now)
        returning = self._state.flying and self._state.to_place
        recovering = arbiter.view.lease is LeaseState.RECOVERING
        may_bounce = ordered and returning and self._may_bounce(now)
        unknown = returning and self._begun and self._choose_listed(energy)
        bounces_to = self._selection.update(
            arbiter.usable(now), energy, now, recovering=recovering, returning=returning, may_bounce=may_bounce
        )
        choice = self.choice
        place = self.candidates.named(self._selection.name)
        if choice is None or place is None:
            return
        self._begun = unknown and not may_bounce
        if unknown and may_bounce:
            bounces_to = place.name
        self._bounces_to = bounces_to or self._bounces_to
        if not self._begun:
            self._rally_writer.want(self.candidates.point(place))
        if self._rally_writer.settled:
            self._news.place(choice, listed=True)
        figures = self._news.figures(choice, listed=not self._elsewhere)
        judged = PlaceJudged(place.name, choice.reachable, figures)
        if judged != self._judged:
            self._judged = judged
            self._authority.handle(judged, now)

    def _choose_listed(self, energy: EnergyFact) -> bool:
        """A return has begun: the site in the list, to which it flies, becomes the choice.

        Returns whether the site is not known yet. It is not before the list is read, and after a failed write.
        """
        writer = self._rally_writer
        if not writer.known or writer.held is None:
            return not writer.known or writer.failing
        self._selection.choose_listed(writer.held, energy)
        return False

    # ---- the list -------------------------------------------------------------------------------------------------

    def _held(self, _point: RallyPoint, now: float) -> None:
        """The list holds the point that was written."""
        self._news.written()
        if self.choice is None or not self._rally_writer.settled:
            return  # another site is chosen by now: the next write follows
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
        """A return is about to be ordered: judge the candidates again, and write the chosen one if needed.

        `returning`: as in `bounces`. Returns a function that says whether the list holds the chosen site. A return does
        not wait long for that.
        """
        self._questions.hurry(now)
        attempt(self._reports.fault, JUDGING, self._judge_candidates, now, returning)
        if not self._rally_writer.settled:
            self._rally_writer.hurry(now)
        return lambda: self._rally_writer.settled

    def bounces(self, now: float, *, returning: bool) -> bool:
        """Whether the return must begin again now, because its site was changed in the list; true once.

        `returning`: the aircraft returns by an order of the companion.
        """
        due, self._bounce_due = self._bounce_due, False
        if (
            not due
            or not returning
            or not self._state.to_place
            or not self._rally_writer.settled
            or self.choice is None
        ):
            return False
        if not self._may_bounce(now):
            return False
        self._reports.event_log.bounced(self.choice.place.name)
        return True

    def _may_bounce(self, now: float) -> bool:
        """Whether a return that the companion has ordered may begin again."""
        state, view = self._state, self._authority.arbiter.view
        where = state.where
        breached = now - state.breached_at <= _BREACH_S
        outside = where is None or not self.candidates.finder.in_fence(where[:2]) or breached
        commanded = view.commander is not None and view.lease in _COMMANDED
        failsafe = state.telemetry.heartbeat.failsafe
        # after a bounce, a hovering QuadPlane would fly off forwards once more
        return commanded and not outside and not failsafe and not state.hovers
