# SPDX-License-Identifier: GPL-3.0-or-later

"""Effects of requests of operator control. `control.py` judges them."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.authority.control import ControlFacts, Effect, judge_control, waiting_s
from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.authority.transfer import Cause
from mavproxy_handover.core.authority.transfer_manager import TransferManager
from mavproxy_handover.core.common.events import Action, Advise, ControlAnswer, ControlRequested, ControlResult, Record
from mavproxy_handover.core.common.model import Reason
from mavproxy_handover.core.common.never import assert_never

__all__ = ["Requests"]

#: effect of a request -> reason of the transfer that it begins
_REASONS: Final = {
    Effect.TRANSFER: Reason.REQUESTED,
    Effect.TRANSFER_CONSENTED: Reason.REQUESTED,
    Effect.GIVE: Reason.GIVEN,
    Effect.FORCE: Reason.COMMANDER_LOST,
}


class Requests:
    """Answers requests of operator control, and carries them out."""

    __slots__ = ("_authority", "_candidates", "_presence", "_transfer_manager")

    def __init__(
        self,
        authority: Authority,
        presence: dict[int, Presence],
        candidates: Candidates,
        transfer_manager: TransferManager,
    ) -> None:
        self._authority = authority
        self._presence = presence
        self._candidates = candidates
        self._transfer_manager = transfer_manager

    def on_request(self, request: ControlRequested, now: float, actions: list[Action]) -> None:
        """A request of a known station, at monotonic time `now` (s)."""
        authority, echo = self._authority, self._transfer_manager.echo
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
        self._carry_out(decision.effect, request, now, actions)

    def _facts(self, station: int, now: float) -> ControlFacts:
        authority, zones, transfer = self._authority, self._candidates.zones, self._authority.transfer
        known = station in self._presence
        waiting_for = None
        if transfer is not None:
            waiting_for = station if station in transfer.partners else transfer.key.to_station
        return ControlFacts(
            commander=authority.view.commander,
            lost=authority.lost,
            recovering=authority.recovering,
            grounded=authority.grounded(now),
            waiting_for=waiting_for,
            yields=transfer is not None and transfer.yields_to(Reason.GIVEN),
            takeover_allowed=authority.takeover_allowed,
            known=known,
            unfit=self._candidates.unfit(station, now) if known else None,
            in_zone=zones.holds(station) or not zones.known,
            paused_s=self._candidates.paused_s(station, Reason.REQUESTED, now),
            position_known=self._transfer_manager.position_known(now),
            just_changed=self._transfer_manager.just_changed(now),
            name=authority.name(station),
        )

    def _carry_out(self, effect: Effect, request: ControlRequested, now: float, actions: list[Action]) -> None:
        authority, transfer_manager = self._authority, self._transfer_manager
        match effect:
            case Effect.NOTHING:
                pass
            case Effect.SET_TAKEOVER:
                authority.allow_takeover(request.takeover, actions)
            case Effect.CONSENT:
                transfer_manager.consent(now, actions)
            case Effect.DENY:
                authority.allow_takeover(False, actions)
                transfer_manager.move(Cause.DENIED, now, actions)
                transfer_manager.move(
                    Cause.CANCELLED, now, actions
                )  # it had agreed: until the commit it may think again
            case Effect.TRANSFER | Effect.TRANSFER_CONSENTED | Effect.FORCE | Effect.GIVE:
                transfer_manager.begin(
                    request.for_station,
                    _REASONS[effect],
                    now,
                    actions,
                    consented=effect in (Effect.TRANSFER_CONSENTED, Effect.GIVE),
                    forced=effect is Effect.FORCE,
                    operator_timeout_s=waiting_s(request.timeout_s),
                )
            case Effect.GRANT:
                authority.grant(request.station, Reason.OPERATOR, actions)
            case Effect.RELEASE:
                authority.release(actions)
            case Effect.OFFER:
                self._offer(now, actions)
            case _:
                assert_never(effect)

    def _offer(self, now: float, actions: list[Action]) -> None:
        """The commander gives the aircraft to any station that can take it."""
        first = not self._authority.takeover_allowed
        self._authority.allow_takeover(True, actions)
        if self._authority.transfer is not None:
            self._transfer_manager.consent(now, actions)
            return
        usable = self._candidates.usable(self._authority.owner, Reason.GIVEN, now, actions)
        if usable:
            self._transfer_manager.begin(self._candidates.best(usable), Reason.GIVEN, now, actions, consented=True)
        elif first:
            self._tell_offered(actions)

    def _tell_offered(self, actions: list[Action]) -> None:
        """Tell all other stations that they may take the aircraft."""
        owner = self._authority.owner
        others = tuple(station for station in self._presence if station != owner)
        text = f"{self._authority.name(owner)} gives up control, and no station can take the aircraft now."
        if others:
            actions.append(Advise(others, f"{text} When it is in your zone, type 'handover request'."))
