# SPDX-License-Identifier: GPL-3.0-or-later

"""One attempt to move authority, from the vehicle's side.

Theory of operation
-------------------
The vehicle drives the transfer. It repeats the message of the present step, with the same id and a growing pause, until
an answer moves it on. Stations only answer, and answer a repeated question again. So every retransmission in the system
is here, and a station needs no clock for a transfer.

A partner tells the vehicle everything that it tells the commander (steps 2 and 5). The vehicle passes that copy on: at
once if the partner says that it has no ground link, otherwise as its retransmission. So a dead ground link costs only
time.

    step            the vehicle waits for                 and meanwhile sends
    REQUEST         partner: ON_HANDOVER                  HANDOVER_REQUEST to the partner
    CONSENT         commander: OK_HANDOVER                ON_HANDOVER, passed on to the commander
    CONNECT         partner: DRONE_CONNECTED              CONNECT_HANDOVER to the partner
    CONNECT_FREED   the same; the commander has released  CONNECT_HANDOVER to the partner
    RELEASE         commander: DISCONNECT_HANDOVER        DRONE_CONNECTED, passed on to the commander

An end names its outcome. ABORTED: the commander stays, and nothing has changed. COMMITTED: commander and epoch change
in one step, by the arbiter. A transfer commits only after the partner's DRONE_CONNECTED and the commander's consent. A
release that comes before the partner's message waits in CONNECT_FREED.

If the commander is lost on the way, or was lost before, the transfer is forced. There is no commander to ask, so
consent and release count as given, and only the partner's two messages are needed. It ends at once if the commander
returns.

During a forced transfer no station commands, and the aircraft turns home if it takes too long. So every station that
could take the aircraft is asked at once (`others`). CONNECT_HANDOVER goes to the first one that is ready. That one is
the partner from then on, and the others stay in reserve. If the partner falls away, or lets CONNECT wait while another
is ready, the next one becomes the partner. If the time is up and only operators have still to answer, the question
stays open and the hurry ends (`hurry_over`): the aircraft turns home meanwhile. If every station that is asked has said
that its operator is asked, the hurry ends at once. Then only a yes moves authority.

The reason of a transfer is its rank (`RANKS` in `common/model.py`). A transfer for a graver reason takes its place
until the partner has been told to set itself up (`yields_to`). If both are to the same partner, this one is raised
instead.

A commander may have consented before (it gave the aircraft away itself, or allowed takeover). Then it is not asked, and
has also released. A station without our module (`Station.standard`) has no messages for some steps. `Transfer.implied`
has the causes that come by themselves in a step because of that.

What MOVES says, and what it does not say
-----------------------------------------
MOVES has every change of the step and every end of a transfer that is not forced. A pair that is not there changes
nothing. A forced transfer with several candidates has more state than its step (`others`, `ready`, `asking`,
`hurry_over`). So three methods of `Transfer` go around MOVES for it:

* `_of_other`: a cause of a station in reserve changes only these fields and the time limit, never step, partner or end.
  There is one exception, in `move`: in step REQUEST a station in reserve that is ready becomes the partner. The cause
  PARTNER_READY then goes through MOVES.
* `_next`: the partner of a forced transfer falls away, and another station is in reserve. That one becomes the partner,
  in step CONNECT if it is ready, else in REQUEST. Without a station in reserve MOVES applies.
* `_run_out`: the time of a forced transfer is up. The next candidate becomes the partner (`_next`), or the transfer
  goes on waiting for operators, or it is aborted. TIMEOUT and UNANSWERED of MOVES apply to transfers that are not
  forced.
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
    """Causes that can move a transfer."""

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
    """Cause that a station's message is to the transfer whose key it carries; None: this station may not say that.

    Steps 2 and 5 come from the partner, 3 and 6 from the commander.
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


#: causes that take one candidate out of a forced transfer
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
        "hurry_over",
        "key",
        "operator_asked",
        "others",
        "partner_asks",
        "question_open",
        "read_until",
        "ready",
        "reason",
        "retry_at",
        "stale_answer",
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
        """`consented`: the commander has agreed before. `forced_until`: there is no commander to ask; the time limit of
        the transfer. `crossing`: its border, if that was foreseen (`foresight.py`), else 0.
        """
        forced = forced_until is not None
        self._limits = limits
        self._operator_timeout_s = limits.operator_timeout_s if operator_timeout_s is None else operator_timeout_s
        self.consented = consented or forced
        self.forced = forced
        #: the time limit of a forced transfer, whatever its step; inf if there is no hurry
        self.forced_until = inf if forced_until is None else forced_until
        #: forced, and no longer in a hurry: the transfer waits for operators
        self.hurry_over = False
        #: in a forced transfer: the stations that are asked besides the partner; of all these the ones that are ready,
        #: and the ones whose operators are being asked
        self.others: tuple[int, ...] = ()
        self.ready: frozenset[int] = frozenset()
        self.asking: frozenset[int] = frozenset()
        #: candidates that fell away, and why, until the caller takes them
        self.fallen: tuple[tuple[int, Reason], ...] = ()
        #: until then an answer may be meant for the question before this one
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
        #: the partner's question is out, and no answer has come; and one may still come that was given to the question
        #: before the commander was lost
        self.question_open = self.stale_answer = False
        self._limit(now)

    def _limit(self, now: float) -> None:
        limit_s = self._limits.release_timeout_s if self.step is Step.RELEASE else self._limits.step_timeout_s
        if self._reserve():  # another station is waiting
            limit_s = min(limit_s, self._limits.reserve_timeout_s)
        elif self.forced and self.step is Step.REQUEST:
            self.timeout_at = self._asked_until if self.hurry_over else self.forced_until
            return
        self.timeout_at = min(now + limit_s, self.forced_until)

    def _reserve(self) -> frozenset[int]:
        """Stations in reserve that are ready."""
        return self.ready.intersection(self.others)

    # ---- who is asked ---------------------------------------------------------------------------------------------

    @property
    def partners(self) -> tuple[int, ...]:
        """The partner, and the other stations that are asked."""
        return (self.key.to_station, *self.others)

    def concerns(self, key: TransferKey) -> bool:
        """Whether this key names the transfer, to the partner or to another station that is asked."""
        return key == self.key or (key.to_station in self.others and key == self._key_of(key.to_station))

    def _key_of(self, station: int) -> TransferKey:
        return replace(self.key, to_station=station)

    def invite(self, station: int, now: float, *, ready: bool) -> None:
        """Ask one more station. `ready`: a standard station has no message for that, so it counts as ready."""
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
        """Whether the transfer takes longer than usual, and has not moved authority yet."""
        return now >= self.asked_at + self._limits.answer_s

    def unanswered(self, now: float) -> bool:
        """Whether the partner has not answered for that time, though its operator is not being asked."""
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

    def pop_fallen(self) -> tuple[tuple[int, Reason], ...]:
        """The candidates that fell away since the last call, and why."""
        fallen, self.fallen = self.fallen, ()
        return fallen

    def partner_asks_in_a_hurry(self, now: float) -> None:
        """The partner's operator is asked, and other stations could take the aircraft.

        So the operator gets no more time than a partner has.
        """
        # the same word may come once more, late, when the partner has consented
        self.partner_asks = self.step is Step.REQUEST
        self.question_open = False
        self.hurry(now)  # its operator may have been given time before the others were there

    def hurry(self, now: float) -> None:
        """The partner's operator has no more time than a partner has."""
        if self.step is Step.REQUEST:
            self.timeout_at = min(self.timeout_at, now + self._limits.step_timeout_s)

    # ---- what happens to it ---------------------------------------------------------------------------------------

    def move(self, cause: Cause, now: float, *, station: int | None = None, relay: bool = False) -> End | bool:
        """Apply `cause`. Returns the end it leads to, True if the step or the partner changed, False if neither did.

        `station`: the station that the cause concerns, if not the partner. `relay`: the partner has no ground link, so
        the vehicle passes its message on at once.
        """
        if cause is Cause.PARTNER_ASKS and station in (None, self.key.to_station):
            if self.stale_answer:  # "my operator is asked" was said of another question: the commander lives no more
                self.stale_answer = False
                return False
            self.question_open = False
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
            if self.step is Step.REQUEST:  # the stations are asked another question now
                self.retry_at, self.asking, self.stale_answer = now, frozenset(), self.question_open
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
        """A cause that concerns a station in reserve."""
        if cause is Cause.PARTNER_READY:
            self.ready |= {station}
            self.timeout_at = min(self.timeout_at, now + self._limits.reserve_timeout_s)
        elif cause in _FALLS_AWAY:
            self._fall(station, _FALLS_AWAY[cause])

    def _note_asking(self, station: int, now: float) -> None:
        """The operator of a station is being asked; a repetition of this gives no more time."""
        if station not in self.asking:
            self.asking |= {station}
            self._asked_until = now + self._operator_timeout_s
            if self.hurry_over:
                self._limit(now)
            elif self.forced and self.step is Step.REQUEST and self.asking.issuperset(self.partners):
                self._end_hurry(now)

    def _end_hurry(self, now: float) -> None:
        """Only operators have still to answer: there is no hurry any more."""
        self.hurry_over, self.forced_until = True, inf
        self._limit(now)

    def _prefer(self, station: int) -> None:
        """A station in reserve becomes the partner; the partner so far goes into reserve."""
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
        """The partner fell away: the first station in reserve that is ready, else the first one, takes its place."""
        station = next((other for other in self.others if other in self.ready), self.others[0])
        self.others = tuple(other for other in self.others if other != station)
        self.key = self._key_of(station)
        self._enter(Step.CONNECT if station in self.ready else Step.REQUEST, now, speak_now=True)
        return True

    def _run_out(self, now: float) -> End | bool:
        """A forced transfer's time is up, of the step or of the whole."""
        if self._reserve() or (self.others and now < self.forced_until):
            if now >= self.forced_until:  # the aircraft turns home; a station that is ready may still take it
                self.forced_until = now + self._limits.forced_timeout_s
            self._fall(self.key.to_station, self._no_answer())
            return self._next(now)
        if self.step is Step.REQUEST and self.asking and not self.hurry_over:
            for station in self.partners:
                if station not in self.asking:
                    self._fall(station, Reason.PARTNER_SILENT)
            self._end_hurry(now)
            if self.key.to_station not in self.asking:
                self.key = self._key_of(self.others[0])
                self.others = self.others[1:]
                return True
            return False
        return _aborted(self._no_answer())

    def _no_answer(self) -> Reason:
        """Reason why the partner of a forced transfer has not taken the aircraft: its operator or its program."""
        asking = self.step is Step.REQUEST and self.key.to_station in self.asking
        return Reason.PARTNER_UNANSWERED if asking else Reason.PARTNER_SILENT

    def implied(self, *, partner_standard: bool, commander_standard: bool) -> Cause | None:
        """Cause that comes by itself in the present step; None if a message is awaited."""
        if self.step is Step.REQUEST:
            return Cause.PARTNER_READY if partner_standard else None
        if self.step is Step.CONSENT:
            return Cause.CONSENTED if self.consented else None
        if self.step is Step.RELEASE:
            return Cause.RELEASED if self.consented or commander_standard else None
        return Cause.CONNECTED if partner_standard else None

    def ask_operator(self, now: float) -> None:
        """An operator is being asked: the step may take as long as that."""
        if not self.operator_asked:
            self.operator_asked = True
            if not self.forced:  # a forced transfer keeps its time limit, see `_run_out`
                self.timeout_at = now + self._operator_timeout_s

    # ---- what it says ---------------------------------------------------------------------------------------------

    def due(self, now: float) -> list[tuple[int, Message]]:
        """The messages to send now and their receivers, if it is time; advances the retransmission clock."""
        if now < self.retry_at:
            return []
        self.attempt += 1
        self.question_open = self.step is Step.REQUEST
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
