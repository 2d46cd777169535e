# SPDX-License-Identifier: GPL-3.0-or-later

"""Requests of operator control: the rules of the MAVLink standard, fitted to what the vehicle may promise in flight.

`judge_control` is pure and total: the request and what holds now in, an answer and an effect out.
`requests.py` carries the effect out.

* A request by the commander says whether takeover is allowed from now on. While a transfer waits for the commander's
  consent, a request that allows takeover is the consent. One that does not allow it is the refusal. The request does
  not name the transfer. If the transfer in question has just ended, the request is neither, and allows no takeover.
* A request by the commander for another station gives the aircraft to that station.
* A request by another station starts a transfer to it: at once if takeover is allowed. Otherwise the commander is
  asked, and the answer is "pending". A station cannot ask for a third station.
* On the ground a station need not hold the vehicle's mission package: it may bring another one.
* Without a commander on the ground, a request is granted. In flight it starts a forced transfer from the lost
  commander, if the aircraft is in the asking station's zone. While the commander of the run before may still come back
  after a restart, no station gets its place.
* An operator's wish has a rank among the reasons for a transfer (`RANKS` in `common/model.py`). A gift of the commander
  replaces a request under way; a request replaces nothing. A failed request has a pause before the next.
* A release on the ground leaves no station in command. In flight, and from START on, the aircraft always keeps a
  commander: the release offers it to a station whose zone holds it. Until that station has taken it, the commander
  stays, with takeover allowed. If a transfer waits for the commander's consent, the release is the consent.
* Only the commander can release. CONTROL_STATUS, not the answer, tells which station commands.
* A request that comes again right after it took effect is a repetition, because the answer was lost. It is answered
  again and changes nothing (`Echo`).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import ceil, inf

from mavproxy_handover.core.authority.cures import cure
from mavproxy_handover.core.common.events import ControlRequested, ControlResult
from mavproxy_handover.core.common.model import NO_MATTER_ON_GROUND, Reason

__all__ = ["ControlDecision", "ControlFacts", "Echo", "Effect", "judge_control", "waiting_s"]

#: least and longest time that a request of operator control may wait for the owner (MAVLink: 3 to 60 s)
_REQUEST_S = (3.0, 60.0)
#: a request that comes again this soon after it has taken effect is its repetition
_ECHO_S = 10.0


def waiting_s(wanted_s: float) -> float:
    """How long a request waits for the owner, in seconds, within what the standard allows."""
    return min(_REQUEST_S[1], max(_REQUEST_S[0], wanted_s))  # in this order what is no number is the least


@dataclass(frozen=True, slots=True)
class ControlFacts:
    """State of the vehicle at a request.

    `commander`: None if there is none. `lost`: there is an owner, and it is not heard. `recovering`: the owner has not
    been heard since a restart just now. `grounded`: disarmed, the autopilot has just said so, and no START is under
    way. `waiting_for`: the partner of the transfer under way, None without one; of several stations that are asked, the
    one that is to have control. `yields`: that transfer gives way to a gift. `unfit`: why the station that is to have
    control could not be a partner, None if it could. `in_zone`: its zone holds the aircraft, or no zones are known.
    `paused_s`: how long its requests have to wait. `position_known`: known and fresh. `just_changed`: a transfer has
    ended, or another has taken its place, so lately that the commander may mean that one.
    """

    commander: int | None
    lost: bool
    recovering: bool
    grounded: bool
    waiting_for: int | None
    takeover_allowed: bool
    known: bool
    unfit: Reason | None
    in_zone: bool
    yields: bool = False
    paused_s: float = 0.0
    position_known: bool = True
    just_changed: bool = False
    #: the name of the station that is to have control
    name: str = "the station"


class Effect(Enum):
    """Effect of an answered request."""

    NOTHING = "nothing"
    SET_TAKEOVER = "takeover allowed or not"
    CONSENT = "the transfer under way has the commander's consent"
    DENY = "takeover not allowed, nor the transfer under way"
    TRANSFER = "a transfer; the commander is asked"
    TRANSFER_CONSENTED = "a transfer; the commander has consented"
    GIVE = "a transfer; it is the commander's own wish"
    FORCE = "a forced transfer: there is no commander"
    GRANT = "granted at once, on the ground"
    RELEASE = "no station commands, on the ground"
    OFFER = "offered to any station that can take it, takeover allowed"


@dataclass(frozen=True, slots=True)
class ControlDecision:
    """The answer and the effect; `text` says why it was denied."""

    result: ControlResult
    effect: Effect = Effect.NOTHING
    text: str = ""


def _denied(text: str) -> ControlDecision:
    return ControlDecision(ControlResult.DENIED, text=text)


def judge_control(request: ControlRequested, facts: ControlFacts) -> ControlDecision:
    """Decide on one request."""
    if request.station == facts.commander:
        return _of_commander(request, facts)
    if not request.request:
        return _denied("only the commander can release")
    if request.for_station != request.station:
        return _denied("only the commander can ask for another station")
    return _of_other(request, facts)


def _of_commander(request: ControlRequested, facts: ControlFacts) -> ControlDecision:
    if not request.request:
        at_once = facts.grounded and facts.waiting_for is None
        return ControlDecision(ControlResult.ACCEPTED, Effect.RELEASE if at_once else Effect.OFFER)
    if request.for_station == request.station:
        if facts.just_changed and (facts.waiting_for is not None or request.takeover):
            return _denied("the transfer that was asked about is over")
        if facts.waiting_for is not None:
            return ControlDecision(ControlResult.ACCEPTED, Effect.CONSENT if request.takeover else Effect.DENY)
        return ControlDecision(ControlResult.ACCEPTED, Effect.SET_TAKEOVER)
    if facts.waiting_for == request.for_station:
        return ControlDecision(ControlResult.ACCEPTED, Effect.CONSENT)
    refusal = _cannot_take(facts, busy=facts.waiting_for is not None and not facts.yields)
    return refusal or ControlDecision(ControlResult.ACCEPTED, Effect.GIVE)


def _of_other(request: ControlRequested, facts: ControlFacts) -> ControlDecision:
    if facts.waiting_for == request.station:
        if facts.takeover_allowed:
            return ControlDecision(ControlResult.ACCEPTED, Effect.CONSENT)
        return ControlDecision(ControlResult.PENDING)
    refusal = _cannot_take(facts, busy=facts.waiting_for is not None)
    if refusal is not None:
        return refusal
    if facts.commander is None:
        if facts.recovering:
            return _denied("the commander may come back after the restart")
        if facts.grounded:
            return ControlDecision(ControlResult.ACCEPTED, Effect.GRANT)
        if not facts.lost:
            return _denied("there is no commander to follow")
        return ControlDecision(ControlResult.PENDING, Effect.FORCE)
    if facts.paused_s > 0.0:
        return _denied(f"too soon: again in {ceil(facts.paused_s)} s")
    if facts.takeover_allowed:
        return ControlDecision(ControlResult.ACCEPTED, Effect.TRANSFER_CONSENTED)
    return ControlDecision(ControlResult.PENDING, Effect.TRANSFER)


def _cannot_take(facts: ControlFacts, *, busy: bool) -> ControlDecision | None:
    """Why the station that is to have control cannot have it now. `busy`: another transfer comes first."""
    if not facts.known:
        return _denied("unknown station")
    if busy:
        return _denied("another handover is under way")
    if facts.unfit is not None and not (facts.grounded and facts.unfit in NO_MATTER_ON_GROUND):
        return _denied(cure(facts.name, facts.unfit).rstrip("."))
    if not facts.grounded and not facts.position_known:
        return _denied("no position of the aircraft")
    if not facts.grounded and not facts.in_zone:
        return _denied(f"the aircraft is outside the zone of {facts.name}")
    return None


#: what is a consent if it comes from the commander; it reads as a request when another one commands
_CONSENTS = (Effect.CONSENT, Effect.TRANSFER_CONSENTED, Effect.GIVE, Effect.OFFER, Effect.RELEASE)


class Echo:
    """The request by which authority is about to move, or has moved just now. Times are monotonic seconds."""

    __slots__ = ("_request", "_until")

    def __init__(self) -> None:
        self._request: ControlRequested | None = None
        #: until when it may be repeated; -inf before it takes effect
        self._until = -inf

    def note(self, request: ControlRequested, effect: Effect, now: float) -> None:
        """A request was answered, with this effect."""
        if effect in _CONSENTS:
            self._request = request
            self._until = now + _ECHO_S if effect is Effect.RELEASE else -inf

    def took_effect(self, now: float) -> None:
        """Authority has moved."""
        self._until = now + _ECHO_S

    def forget(self) -> None:
        """Authority does not move by that request."""
        self._request = None

    def repeats(self, request: ControlRequested, now: float) -> bool:
        """Whether this is a request that has just taken effect."""
        return request == self._request and now < self._until
