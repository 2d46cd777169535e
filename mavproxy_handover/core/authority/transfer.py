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

A forced transfer is in a hurry: until it ends nobody commands, and the aircraft turns home when it has lasted too long.
So every station that could take the aircraft is asked at once (`others`), and CONNECT_HANDOVER goes to the first that
is ready: that one is the partner from then on, the others stay in reserve. A partner that falls away, or lets CONNECT
wait while another is ready, makes way for the next. Where only operators are left to wait for when the time is up,
the question stays open and the hurry ends (`patient`): the aircraft turns home meanwhile. When every station that is
asked has said that its operator is asked, that is so at once: a yes moves authority then, and nothing else.

Why a transfer was begun is its rank (`model.RANKS`). A transfer for a graver reason takes its place as long as the
partner has not been told to set itself up (`yields_to`); if it is to the same partner, this one is raised instead.

A commander may have consented beforehand (it gave the aircraft away itself, or allowed takeover): it is not asked, and
has released with that. A station without a module of ours (`Station.standard`) has no words for some steps. What
follows from that is `Transfer.implied`: the causes that come by themselves in a step.

Everything that can happen in a step is in MOVES. What is not there changes nothing, whatever it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from math import inf

from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import (
    ConnectHandover,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    Message,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.common.model import RANKS, Consent, Outcome, Reason

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
    UNANSWERED = "an operator was asked and did not answer in time"
    CANNOT_BE_ASKED = "the commander's program did not show that it asks its operator"
    CONSENT_REFUSED = "the configuration refuses for the commander"
    LEFT_REGION = "left the region"
    CANCELLED = "cancelled"
    COMMANDER_LOST = "commander lost"
    COMMANDER_RETURNED = "commander returned"
    PARTNER_LOST = "partner lost"
    PREEMPTED = "a graver reason came up"
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
    (Step.REQUEST, Cause.PREEMPTED): _aborted(Reason.PREEMPTED),
    (Step.CONSENT, Cause.PREEMPTED): _aborted(Reason.PREEMPTED),
    (Step.REQUEST, Cause.PARTNER_READY): Step.CONSENT,
    (Step.REQUEST, Cause.PARTNER_ASKS): Step.REQUEST,
    (Step.REQUEST, Cause.PARTNER_REFUSED): _aborted(Reason.PARTNER_REFUSED),
    # the partner's copy to the vehicle was lost, but the commander has heard it and answered
    (Step.REQUEST, Cause.CONSENTED): Step.CONNECT,
    (Step.REQUEST, Cause.COMMANDER_ASKS): Step.CONSENT,
    (Step.REQUEST, Cause.DENIED): _aborted(Reason.COMMANDER_DENIED),
    (Step.REQUEST, Cause.COMMANDER_LOST): Step.REQUEST,
    (Step.REQUEST, Cause.TIMEOUT): _aborted(Reason.PARTNER_SILENT),
    (Step.REQUEST, Cause.UNANSWERED): _aborted(Reason.PARTNER_UNANSWERED),
    (Step.CONSENT, Cause.PARTNER_REFUSED): _aborted(Reason.PARTNER_REFUSED),
    (Step.CONSENT, Cause.COMMANDER_ASKS): Step.CONSENT,
    (Step.CONSENT, Cause.CONSENTED): Step.CONNECT,
    (Step.CONSENT, Cause.DENIED): _aborted(Reason.COMMANDER_DENIED),
    (Step.CONSENT, Cause.COMMANDER_LOST): Step.CONNECT,
    (Step.CONSENT, Cause.TIMEOUT): _aborted(Reason.COMMANDER_SILENT),
    (Step.CONSENT, Cause.UNANSWERED): _aborted(Reason.COMMANDER_UNANSWERED),
    (Step.CONSENT, Cause.CANNOT_BE_ASKED): _aborted(Reason.CANNOT_BE_ASKED),
    (Step.CONSENT, Cause.CONSENT_REFUSED): _aborted(Reason.CONSENT_REFUSED),
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


#: what takes one candidate out of a forced transfer
_FALLS_AWAY = {
    Cause.PARTNER_REFUSED: Reason.PARTNER_REFUSED,
    Cause.PARTNER_LOST: Reason.PARTNER_SILENT,
    Cause.LEFT_REGION: Reason.LEFT_REGION,
}


class Transfer:
    """The present attempt: its key, its step, and when to speak again. Times are monotonic seconds."""

    __slots__ = (
        "_asked_until",
        "_entered_at",
        "_limits",
        "_operator_timeout_s",
        "_pause_s",
        "asked_at",
        "asking",
        "attempt",
        "consented",
        "crossing",
        "fallen",
        "forced",
        "forced_until",
        "key",
        "operator_asked",
        "others",
        "partner_asks",
        "patient",
        "read_until",
        "ready",
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
        forced_until: float | None = None,
        operator_timeout_s: float | None = None,
        crossing: int = 0,
    ) -> None:
        """`consented`: the commander has agreed beforehand. `forced_until`: there is no commander to ask, and until
        then it may take. `crossing`: the border for which it is, if that was foreseen (`foresight.py`), else 0."""
        forced = forced_until is not None
        self._limits = limits
        self._operator_timeout_s = limits.operator_timeout_s if operator_timeout_s is None else operator_timeout_s
        self.consented = consented or forced
        self.forced = forced
        #: a forced transfer has so long, whatever step it is in; inf where there is no hurry
        self.forced_until = inf if forced_until is None else forced_until
        #: forced, and no longer in a hurry: it waits for operators
        self.patient = False
        #: of a forced one: the stations that are asked besides the partner; of all these those that are ready, and
        #: those whose operators are being asked
        self.others: tuple[int, ...] = ()
        self.ready: frozenset[int] = frozenset()
        self.asking: frozenset[int] = frozenset()
        #: candidates that fell away, and why, for the caller to take
        self.fallen: tuple[tuple[int, Reason], ...] = ()
        #: a question that came before this one is over so lately that until then an answer may be meant for that
        self.read_until = -inf
        self.key = key
        self.reason = reason
        self.crossing = crossing
        self.started_at = now
        #: when it was first wanted for this reason
        self.asked_at = now
        self._asked_until = inf
        self._enter(Step.REQUEST, now, speak_now=True)

    def _enter(self, step: Step, now: float, *, speak_now: bool) -> None:
        self.step = step
        self._entered_at = now
        self.attempt = 0
        self._pause_s = self._limits.retry_first_s
        self.retry_at = now if speak_now else now + self._pause_s
        self.operator_asked = self.partner_asks = False
        self._limit(now)

    def _limit(self, now: float) -> None:
        limit_s = self._limits.release_timeout_s if self.step is Step.RELEASE else self._limits.step_timeout_s
        if self._reserve():  # somebody else is waiting
            limit_s = min(limit_s, self._limits.reserve_timeout_s)
        elif self.forced and self.step is Step.REQUEST:
            self.timeout_at = self._asked_until if self.patient else self.forced_until
            return
        self.timeout_at = min(now + limit_s, self.forced_until)

    def _reserve(self) -> frozenset[int]:
        """Who is ready besides the partner."""
        return self.ready.intersection(self.others)

    # ---- who is asked ---------------------------------------------------------------------------------------------

    @property
    def partners(self) -> tuple[int, ...]:
        """The partner, and whoever else is asked."""
        return (self.key.to_station, *self.others)

    def concerns(self, key: TransferKey) -> bool:
        """Whether this key names the transfer, to the partner or to another station that is asked."""
        return key == self.key or (key.to_station in self.others and key == self._key_of(key.to_station))

    def _key_of(self, station: int) -> TransferKey:
        return replace(self.key, to_station=station)

    def invite(self, station: int, now: float, *, ready: bool) -> None:
        """Ask one more station; `ready`: it has no words for that, and can only be taken as ready."""
        self.others += (station,)
        if ready:
            self.ready |= {station}
            if self.step is Step.REQUEST:
                self._limit(now)
        self.retry_at = now

    def yields_to(self, reason: Reason) -> bool:
        """Whether a transfer for this reason may take the place of this one."""
        own = Reason.COMMANDER_LOST if self.forced else self.reason
        return (self.step, Cause.PREEMPTED) in MOVES and RANKS[reason] > RANKS[own]

    def raise_to(self, reason: Reason, now: float, *, crossing: int) -> None:
        """The same transfer, now for a graver reason. The station that was asked is asked again at once. `crossing`: as
        at the beginning."""
        self.reason, self.crossing = reason, crossing
        self.retry_at = self.asked_at = now

    def slow(self, now: float) -> bool:
        """It has had the time that a transfer takes, and has not moved authority yet."""
        return now >= self.asked_at + self._limits.answer_s

    def unanswered(self, now: float) -> bool:
        """The partner has not said for as long what it is asked, and no operator of its is why."""
        if self.step in (Step.CONSENT, Step.RELEASE) or now < self._entered_at + self._limits.answer_s:
            return False
        return self.step is not Step.REQUEST or self.key.to_station not in self.asking

    def follows_another(self, read_until: float) -> None:
        """The question before this one ended a moment ago: until then an answer may be meant for that one."""
        self.read_until = read_until

    def consent_given(self) -> None:
        """The commander agrees by other means than its messages."""
        self.consented = True

    def stop_waiting_for_operators(self) -> None:
        """No operator is waited for any more."""
        self.asking = frozenset()

    def take_fallen(self) -> tuple[tuple[int, Reason], ...]:
        """The candidates that fell away since the last call, and why."""
        fallen, self.fallen = self.fallen, ()
        return fallen

    def partner_asks_in_a_hurry(self, now: float) -> None:
        """The partner's operator is asked, and other stations could take the aircraft: its operator gets no more time
        than a partner has."""
        # the same word may come once more, late, when the partner has consented
        self.partner_asks = self.step is Step.REQUEST
        self.hurry(now)  # its operator may have been given time before the others were there

    def hurry(self, now: float) -> None:
        """The partner's operator has no more time than a partner has."""
        if self.step is Step.REQUEST:
            self.timeout_at = min(self.timeout_at, now + self._limits.step_timeout_s)

    # ---- what happens to it ---------------------------------------------------------------------------------------

    def move(self, cause: Cause, now: float, *, station: int | None = None, relay: bool = False) -> End | bool:
        """Apply `cause`. Returns the end it leads to, True if the step or the partner changed, False if neither did.

        `station`: whose word or loss it is, where that is not the partner. `relay`: the partner has no ground link, so
        what it said is to be passed on at once.
        """
        if cause is Cause.PARTNER_ASKS:
            self._note_asking(self.key.to_station if station is None else station, now)
        awaits_operator = self.operator_asked or self.partner_asks
        if cause is Cause.TIMEOUT and awaits_operator and (self.step, Cause.UNANSWERED) in MOVES:
            cause = Cause.UNANSWERED
        if station is not None and station != self.key.to_station:
            if cause is not Cause.PARTNER_READY or self.step is not Step.REQUEST:
                self._of_other(cause, station, now)
                return False
            self._prefer(station)
        elif self.forced and self.others and cause in _FALLS_AWAY:
            self._fall(self.key.to_station, _FALLS_AWAY[cause])
            return self._next(now)
        elif self.forced and cause in (Cause.TIMEOUT, Cause.UNANSWERED):
            return self._run_out(now)
        target = MOVES.get((self.step, cause))
        if target is None:
            return False
        if cause is Cause.COMMANDER_LOST:
            self.forced = self.consented = True
            self.reason, self.crossing = Reason.COMMANDER_LOST, 0
            self.forced_until = now + self._limits.forced_timeout_s
            self._limit(now)
            if self.step is Step.REQUEST:  # the question is another one now
                self.retry_at, self.asking = now, frozenset()
        if isinstance(target, End):
            return target
        asked = cause in (Cause.PARTNER_ASKS, Cause.COMMANDER_ASKS)
        changed = target is not self.step
        if changed:
            self._enter(target, now, speak_now=relay or target is Step.CONNECT)
        if asked:
            self.ask_operator(now)
        return changed

    def _of_other(self, cause: Cause, station: int, now: float) -> None:
        """A word about a station in reserve."""
        if cause is Cause.PARTNER_READY:
            self.ready |= {station}
            self.timeout_at = min(self.timeout_at, now + self._limits.reserve_timeout_s)
        elif cause in _FALLS_AWAY:
            self._fall(station, _FALLS_AWAY[cause])

    def _note_asking(self, station: int, now: float) -> None:
        """Its operator is being asked; saying so again wins no time."""
        if station not in self.asking:
            self.asking |= {station}
            self._asked_until = now + self._operator_timeout_s
            if self.patient:
                self._limit(now)
            elif self.forced and self.step is Step.REQUEST and self.asking.issuperset(self.partners):
                self._be_patient(now)

    def _be_patient(self, now: float) -> None:
        """Operators are all that is waited for: there is no hurry any more."""
        self.patient, self.forced_until = True, inf
        self._limit(now)

    def _prefer(self, station: int) -> None:
        """This one of the others is the partner; the partner so far goes into reserve."""
        others = tuple(other for other in self.others if other != station)
        self.others = (self.key.to_station, *others)
        self.key = self._key_of(station)
        self.ready |= {station}

    def _fall(self, station: int, why: Reason) -> None:
        self.fallen += ((station, why),)
        self.ready -= {station}
        self.asking -= {station}
        self.others = tuple(other for other in self.others if other != station)

    def _next(self, now: float) -> bool:
        """The partner fell away: another one is, the first that is ready if there is one."""
        station = next((other for other in self.others if other in self.ready), self.others[0])
        self.others = tuple(other for other in self.others if other != station)
        self.key = self._key_of(station)
        self._enter(Step.CONNECT if station in self.ready else Step.REQUEST, now, speak_now=True)
        return True

    def _run_out(self, now: float) -> End | bool:
        """A forced transfer's time is up, of the step or of the whole."""
        if self._reserve() or (self.others and now < self.forced_until):
            if now >= self.forced_until:  # the aircraft is on its way home; whoever is ready may take it all the same
                self.forced_until = now + self._limits.forced_timeout_s
            self._fall(self.key.to_station, self._no_answer())
            return self._next(now)
        if self.step is Step.REQUEST and self.asking and not self.patient:
            for station in self.partners:
                if station not in self.asking:
                    self._fall(station, Reason.PARTNER_SILENT)
            self._be_patient(now)
            if self.key.to_station not in self.asking:
                self.key = self._key_of(self.others[0])
                self.others = self.others[1:]
                return True
            return False
        return _aborted(self._no_answer())

    def _no_answer(self) -> Reason:
        """Why the partner of a forced transfer has not taken the aircraft: its operator or its program."""
        asking = self.step is Step.REQUEST and self.key.to_station in self.asking
        return Reason.PARTNER_UNANSWERED if asking else Reason.PARTNER_SILENT

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
        """An operator is being asked: wait as long as that takes."""
        if not self.operator_asked:
            self.operator_asked = True
            if not self.forced:  # where there is a hurry that comes first, see `_run_out`
                self.timeout_at = now + self._operator_timeout_s

    # ---- what it says ---------------------------------------------------------------------------------------------

    def due(self, now: float) -> list[tuple[int, Message]]:
        """The messages to send now and their receivers, if it is time; advances the retransmission clock."""
        if now < self.retry_at:
            return []
        self.attempt += 1
        self.retry_at = now + self._pause_s
        self._pause_s = min(self._pause_s * self._limits.retry_growth, self._limits.retry_max_s)
        requests: list[tuple[int, Message]] = [
            (station, HandoverRequest(self._key_of(station), self.reason))
            for station in self.others
            if station not in self.ready
        ]
        return [self._of_step(), *requests]

    def _of_step(self) -> tuple[int, Message]:
        commander, partner = self.key.from_station, self.key.to_station
        if self.step is Step.REQUEST:
            return partner, HandoverRequest(self.key, self.reason, self.crossing)
        if self.step is Step.CONSENT:
            return commander, OnHandover(self.key, reason=self.reason, relayed=True, crossing=self.crossing)
        if self.step is Step.RELEASE:
            return commander, DroneConnected(self.key, relayed=True)
        return partner, ConnectHandover(self.key)
