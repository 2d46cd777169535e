# SPDX-License-Identifier: GPL-3.0-or-later

"""What a request of operator control does. How it is judged is in `control.py`."""

from __future__ import annotations

from mavproxy_handover.core.authority import Authority
from mavproxy_handover.core.candidates import Candidates
from mavproxy_handover.core.conductor import Handover
from mavproxy_handover.core.control import ControlFacts, Effect, judge_control, waiting_s
from mavproxy_handover.core.events import Action, ControlAnswer, ControlRequested, ControlResult, Record
from mavproxy_handover.core.model import Reason
from mavproxy_handover.core.presence import Presence
from mavproxy_handover.core.transfer import Cause

__all__ = ["Requests"]


class Requests:
    """Answers requests of operator control, and carries them out."""

    __slots__ = ("_authority", "_candidates", "_handover", "_presence")

    def __init__(
        self, authority: Authority, presence: dict[int, Presence], candidates: Candidates, handover: Handover
    ) -> None:
        self._authority = authority
        self._presence = presence
        self._candidates = candidates
        self._handover = handover

    def on_request(self, request: ControlRequested, now: float, actions: list[Action]) -> None:
        """A request of a known station, at monotonic time `now` (s)."""
        authority, echo = self._authority, self._handover.echo
        if request.station != authority.view.commander and echo.repeats(request, now):
            actions.append(ControlAnswer(request.station, ControlResult.ACCEPTED))
            return
        decision = judge_control(request, self._facts(request.for_station, now))
        echo.note(request, decision.effect, now)
        what = "requests" if request.request else "releases"
        answer = f"{authority.name(request.station)} {what} control: {decision.result.name.lower()}"
        text = f"{answer} ({decision.text})" if decision.text else answer
        actions.append(Record("control", text, Reason.OPERATOR, request.station))
        actions.append(ControlAnswer(request.station, decision.result, decision.text))
        self._take_effect(decision.effect, request, now, actions)

    def _facts(self, station: int, now: float) -> ControlFacts:
        authority, zones = self._authority, self._candidates.zones
        known = station in self._presence
        return ControlFacts(
            commander=authority.view.commander,
            lost=authority.lost,
            recovering=authority.recovering,
            grounded=authority.grounded(now),
            waiting_for=None if authority.transfer is None else authority.transfer.key.to_station,
            takeover_allowed=authority.takeover_allowed,
            known=known,
            unfit=self._candidates.unfit(station, now) if known else None,
            in_zone=zones.holds(station) or not zones.known,
        )

    def _take_effect(self, effect: Effect, request: ControlRequested, now: float, actions: list[Action]) -> None:
        authority, handover = self._authority, self._handover
        if effect is Effect.SET_TAKEOVER:
            authority.allow_takeover(request.takeover, actions)
        elif effect is Effect.CONSENT:
            handover.consent(now, actions)
        elif effect is Effect.DENY:
            authority.allow_takeover(False, actions)
            handover.move(Cause.DENIED, now, actions)
            handover.move(Cause.CANCELLED, now, actions)  # it had agreed before: until the commit it may think again
        elif effect in (Effect.TRANSFER, Effect.TRANSFER_CONSENTED, Effect.FORCE):
            handover.begin(
                request.for_station,
                Reason.OPERATOR,
                now,
                actions,
                consented=effect is Effect.TRANSFER_CONSENTED,
                forced=effect is Effect.FORCE,
                operator_timeout_s=waiting_s(request.timeout_s),
            )
        elif effect is Effect.GRANT:
            authority.grant(request.station, Reason.OPERATOR, actions)
        elif effect is Effect.RELEASE:
            authority.release(actions)
        elif effect is Effect.OFFER:
            self._offer(now, actions)

    def _offer(self, now: float, actions: list[Action]) -> None:
        """The commander gives the aircraft to whoever can take it."""
        self._authority.allow_takeover(True, actions)
        if self._authority.transfer is not None:
            self._handover.consent(now, actions)
            return
        partner = self._candidates.best(self._authority.owner, now, actions)
        if partner is not None:
            self._handover.begin(partner, Reason.OPERATOR, now, actions, consented=True)
