# SPDX-License-Identifier: GPL-3.0-or-later

"""One attempt to move authority, as the vehicle sees it.

Theory of operation
-------------------
The vehicle drives. It sends what the present step needs, again and again with the same id and a growing pause, until
it hears what moves it on; stations only answer, and answer a repeated question again. So every retransmission in the
system is here, and a station needs no clock for a transfer.

What a partner tells the commander (steps 2 and 5) it also tells the vehicle. That copy is what the vehicle passes on:
at once when the partner says that it has no ground link, otherwise as its retransmission. A dead ground link
costs nothing but the longer way.

    step            the vehicle waits for                 and meanwhile sends
    REQUEST         partner: ON_HANDOVER                  HANDOVER_REQUEST to the partner
    CONSENT         commander: OK_HANDOVER                ON_HANDOVER, passed on to the commander
    CONNECT         partner: DRONE_CONNECTED              CONNECT_HANDOVER to the partner
    CONNECT_FREED   the same; the commander has released  CONNECT_HANDOVER to the partner
    RELEASE         commander: DISCONNECT_HANDOVER        DRONE_CONNECTED, passed on to the commander

An ending names its outcome. ABORTED: the commander stays, nothing has changed. COMMITTED: commander and epoch change in
one step, which the arbiter makes. A transfer commits only after the partner's DRONE_CONNECTED and the commander's
consent; a release that comes before the partner's word waits in CONNECT_FREED.

When the commander is lost on the way, or was lost before, the transfer is forced: nobody is left to ask, so consent and
release are taken as given and only the partner's two words count. It ends at once if the commander returns.

A commander may have consented beforehand (it gave the aircraft away itself, or allowed takeover): it is not asked, and
has released with that. A station without a module of ours (`Station.standard`) has no words for some steps. What
follows from that is `Transfer.implied`: the causes that come by themselves in a step.

Everything that can happen in a step is in MOVES. What is not there changes nothing, whatever it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import inf

from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.messages import (
    ConnectHandover,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    Message,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.model import Consent, Outcome, Reason

__all__ = ["MOVES", "Cause", "End", "Step", "Transfer", "cause_of"]


class Step(Enum):
    """Where a transfer stands."""

    REQUEST = "request"
    CONSENT = "consent"
    CONNECT = "connect"
    CONNECT_FREED = "connect freed"
    RELEASE = "release"


class Cause(Enum):
    """What can move a transfer."""

    PARTNER_READY = "partner ready"
    PARTNER_ASKS = "partner's operator asked"
    PARTNER_REFUSED = "partner refused"
    CONSENTED = "commander consented"
    COMMANDER_ASKS = "commander's operator asked"
    DENIED = "commander denied"
    CONNECTED = "partner connected"
    RELEASED = "commander released"
    TIMEOUT = "step took too long"
    LEFT_REGION = "left the region"
    CANCELLED = "cancelled"
    COMMANDER_LOST = "commander lost"
    COMMANDER_RETURNED = "commander returned"
    PARTNER_LOST = "partner lost"
    OUT_OF_COVERAGE = "out of every zone"


@dataclass(frozen=True, slots=True)
class End:
    """The end of a transfer."""

    outcome: Outcome
    reason: Reason


def _aborted(reason: Reason) -> End:
    return End(Outcome.ABORTED, reason)


_ABORTS: dict[Cause, End] = {
    Cause.LEFT_REGION: _aborted(Reason.LEFT_REGION),
    Cause.CANCELLED: _aborted(Reason.CANCELLED),
    Cause.COMMANDER_RETURNED: _aborted(Reason.COMMANDER_RETURNED),
    Cause.PARTNER_LOST: _aborted(Reason.PARTNER_SILENT),
    Cause.OUT_OF_COVERAGE: _aborted(Reason.OUT_OF_COVERAGE),
}

MOVES: dict[tuple[Step, Cause], Step | End] = {
    **{(step, cause): end for step in Step for cause, end in _ABORTS.items()},
    (Step.REQUEST, Cause.PARTNER_READY): Step.CONSENT,
    (Step.REQUEST, Cause.PARTNER_ASKS): Step.REQUEST,
    (Step.REQUEST, Cause.PARTNER_REFUSED): _aborted(Reason.PARTNER_REFUSED),
    # the partner's copy to the vehicle was lost, but the commander has heard it and answered
    (Step.REQUEST, Cause.CONSENTED): Step.CONNECT,
    (Step.REQUEST, Cause.COMMANDER_ASKS): Step.CONSENT,
    (Step.REQUEST, Cause.DENIED): _aborted(Reason.COMMANDER_DENIED),
    (Step.REQUEST, Cause.COMMANDER_LOST): Step.REQUEST,
    (Step.REQUEST, Cause.TIMEOUT): _aborted(Reason.PARTNER_SILENT),
    (Step.CONSENT, Cause.PARTNER_REFUSED): _aborted(Reason.PARTNER_REFUSED),
    (Step.CONSENT, Cause.COMMANDER_ASKS): Step.CONSENT,
    (Step.CONSENT, Cause.CONSENTED): Step.CONNECT,
    (Step.CONSENT, Cause.DENIED): _aborted(Reason.COMMANDER_DENIED),
    (Step.CONSENT, Cause.COMMANDER_LOST): Step.CONNECT,
    (Step.CONSENT, Cause.TIMEOUT): _aborted(Reason.COMMANDER_SILENT),
    (Step.CONNECT, Cause.CONNECTED): Step.RELEASE,
    (Step.CONNECT, Cause.RELEASED): Step.CONNECT_FREED,
    (Step.CONNECT, Cause.COMMANDER_LOST): Step.CONNECT_FREED,
    (Step.CONNECT, Cause.PARTNER_REFUSED): _aborted(Reason.PARTNER_REFUSED),
    (Step.CONNECT, Cause.TIMEOUT): _aborted(Reason.PARTNER_SILENT),
    (Step.CONNECT_FREED, Cause.CONNECTED): End(Outcome.COMMITTED, Reason.NONE),
    (Step.CONNECT_FREED, Cause.PARTNER_REFUSED): _aborted(Reason.PARTNER_REFUSED),
    (Step.CONNECT_FREED, Cause.TIMEOUT): _aborted(Reason.PARTNER_SILENT),
    (Step.CONNECT_FREED, Cause.COMMANDER_LOST): Step.CONNECT_FREED,
    (Step.RELEASE, Cause.RELEASED): End(Outcome.COMMITTED, Reason.NONE),
    (Step.RELEASE, Cause.TIMEOUT): End(Outcome.COMMITTED, Reason.RELEASE_TIMEOUT),
    # the heartbeat may run out before the step does: both have agreed, so this is no loss of authority
    (Step.RELEASE, Cause.COMMANDER_LOST): End(Outcome.COMMITTED, Reason.RELEASE_TIMEOUT),
}


def cause_of(message: Message, sender: int) -> Cause | None:
    """What a station's message means to a transfer whose key it carries; None if it may not say that.

    Steps 2 and 5 are the partner's to say, 3 and 6 the commander's.
    """
    if isinstance(message, OnHandover) and sender == message.key.to_station:
        return {
            Consent.GRANTED: Cause.PARTNER_READY,
            Consent.WAITING: Cause.PARTNER_ASKS,
            Consent.DENIED: Cause.PARTNER_REFUSED,
        }[message.consent]
    if isinstance(message, OkHandover) and sender == message.key.from_station:
        return {
            Consent.GRANTED: Cause.CONSENTED,
            Consent.WAITING: Cause.COMMANDER_ASKS,
            Consent.DENIED: Cause.DENIED,
        }[message.consent]
    if isinstance(message, DroneConnected) and sender == message.key.to_station:
        return Cause.CONNECTED
    if isinstance(message, DisconnectHandover) and sender == message.key.from_station:
        return Cause.RELEASED
    return None


class Transfer:
    """The present attempt: its key, its step, and when to speak again. Times are monotonic seconds."""

    __slots__ = (
        "_limits",
        "_operator_timeout_s",
        "_pause_s",
        "attempt",
        "consented",
        "forced",
        "forced_until",
        "key",
        "operator_asked",
        "reason",
        "retry_at",
        "started_at",
        "step",
        "timeout_at",
    )

    def __init__(
        self,
        key: TransferKey,
        reason: Reason,
        limits: Limits,
        now: float,
        *,
        consented: bool = False,
        forced: bool = False,
        operator_timeout_s: float | None = None,
    ) -> None:
        """`consented`: the commander has agreed beforehand. `forced`: there is no commander to ask."""
        self._limits = limits
        self._operator_timeout_s = limits.operator_timeout_s if operator_timeout_s is None else operator_timeout_s
        self.consented = consented or forced
        self.forced = forced
        #: a forced transfer ends then, whatever step it is in
        self.forced_until = now + limits.forced_timeout_s if forced else inf
        self.key = key
        self.reason = reason
        self.started_at = now
        self._enter(Step.REQUEST, now, speak_now=True)

    def _enter(self, step: Step, now: float, *, speak_now: bool) -> None:
        self.step = step
        self.attempt = 0
        self._pause_s = self._limits.retry_first_s
        self.retry_at = now if speak_now else now + self._pause_s
        self.operator_asked = False
        limit_s = self._limits.release_timeout_s if step is Step.RELEASE else self._limits.step_timeout_s
        self.timeout_at = min(now + limit_s, self.forced_until)

    def move(self, cause: Cause, now: float, *, relay: bool = False) -> End | bool:
        """Apply `cause`. Returns the end it leads to, True if the step changed, False if it changed nothing.

        `relay`: the partner has no ground link, so what it said is to be passed on at once.
        """
        target = MOVES.get((self.step, cause))
        if target is None:
            return False
        if cause is Cause.COMMANDER_LOST:
            self.forced = self.consented = True
            self.reason = Reason.COMMANDER_LOST
            self.forced_until = now + self._limits.forced_timeout_s
            self.timeout_at = min(self.timeout_at, self.forced_until)
        if isinstance(target, End):
            return target
        asked = cause in (Cause.PARTNER_ASKS, Cause.COMMANDER_ASKS)
        changed = target is not self.step
        if changed:
            self._enter(target, now, speak_now=relay or target is Step.CONNECT)
        if asked:
            self.ask_operator(now)
        return changed

    def implied(self, *, partner_standard: bool, commander_standard: bool) -> Cause | None:
        """The cause that comes by itself in the present step, None if somebody's word is awaited."""
        if self.step is Step.REQUEST:
            return Cause.PARTNER_READY if partner_standard else None
        if self.step is Step.CONSENT:
            return Cause.CONSENTED if self.consented else None
        if self.step is Step.RELEASE:
            return Cause.RELEASED if self.consented or commander_standard else None
        return Cause.CONNECTED if partner_standard else None

    def ask_operator(self, now: float) -> None:
        """The commander's operator is being asked by other means: wait as long as that takes."""
        if not self.operator_asked:
            self.operator_asked = True
            self.timeout_at = min(now + self._operator_timeout_s, self.forced_until)

    def due(self, now: float) -> tuple[int, Message] | None:
        """The message to send now and its receiver, if it is time; advances the retransmission clock."""
        if now < self.retry_at:
            return None
        self.attempt += 1
        self.retry_at = now + self._pause_s
        self._pause_s = min(self._pause_s * self._limits.retry_growth, self._limits.retry_max_s)
        commander, partner = self.key.from_station, self.key.to_station
        if self.step is Step.REQUEST:
            return partner, HandoverRequest(self.key, self.reason)
        if self.step is Step.CONSENT:
            return commander, OnHandover(self.key, relayed=True)
        if self.step is Step.RELEASE:
            return commander, DroneConnected(self.key, relayed=True)
        return partner, ConnectHandover(self.key)
