# SPDX-License-Identifier: GPL-3.0-or-later

"""Transfers of authority: when one begins, what moves it on, and what its end changes.

`transfer.py` says what may happen in which step; this module carries out the results. A commit changes owner and epoch
in one step; an abort changes nothing. A message with another epoch or transfer number is dropped. A station that asks
about the transfer that is just over is told its result again.

There is one transfer at a time. A transfer for a graver reason takes its place (`Transfer.yields_to`), so that a
question to an operator does not delay what the aircraft needs.
"""

from __future__ import annotations

from math import inf

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.authority.control import Echo, waiting_s
from mavproxy_handover.core.authority.cures import PEOPLES_WORD, ended
from mavproxy_handover.core.authority.foresight import Foresight
from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.authority.results import Results
from mavproxy_handover.core.authority.transfer import Cause, End, Step, Transfer, cause_of
from mavproxy_handover.core.common.events import Action, Advise, NotifyOwner, Record, Send
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import (
    DroneConnected,
    HandoverResult,
    Message,
    OnHandover,
    TransferKey,
    TransferMessage,
)
from mavproxy_handover.core.common.model import AUTOMATIC, QUESTIONS, Outcome, Phase, Reason, StandingConsent, in_words

__all__ = ["READ_S", "TransferManager"]

#: time that an operator needs to read that a question has taken the place of another (s)
READ_S = 2.0


class TransferManager:
    """Manages the transfer under way, `Authority.transfer`. Times are monotonic seconds."""

    __slots__ = (
        "_aborted_at",
        "_authority",
        "_candidates",
        "_flight",
        "_limits",
        "_presence",
        "echo",
        "foresight",
        "results",
    )

    def __init__(
        self,
        authority: Authority,
        flight: Flight,
        presence: dict[int, Presence],
        candidates: Candidates,
        limits: Limits,
    ) -> None:
        self._authority = authority
        self._flight = flight
        self._presence = presence
        self._candidates = candidates
        self._limits = limits
        #: when a transfer was last aborted, except by the commander's denial
        self._aborted_at = -inf
        self.results = Results(limits)
        self.foresight = Foresight(authority, flight, presence, candidates, limits)
        self.echo = Echo()

    def position_known(self, now: float) -> bool:
        """Whether it is known where the aircraft is."""
        return self._flight.position_known(now)

    def seek(self, now: float, actions: list[Action]) -> None:
        """Begin a transfer in flight if zones or links ask for one, or the commander is lost."""
        authority, flight = self._authority, self._flight
        if authority.owner is None or not flight.flying:
            return
        if not flight.position_known(now):  # the zones that hold the aircraft are not known any more
            return
        if authority.lost:
            self._seek_successor(authority.owner, now, actions)
        elif authority.phase in (Phase.ON_MISSION, Phase.EMERGENCY) or (
            authority.transfer is not None and authority.transfer.yields_to(Reason.ZONE_ENDS)
        ):
            wanted = self._candidates.wanted(authority.owner, now, actions)
            if wanted is not None:
                self._want(*wanted, now, actions)

    def _want(self, partner: int, reason: Reason, now: float, actions: list[Action]) -> None:
        """Zones or links ask for a transfer: it begins, unless one under way comes first."""
        transfer = self._authority.transfer
        if transfer is not None and not transfer.yields_to(reason):
            return
        if transfer is not None and transfer.key.to_station == partner:
            self._raise(transfer, reason, now, actions)
            return
        self.begin(partner, reason, now, actions, consented=self._authority.takeover_allowed)

    def _raise(self, transfer: Transfer, reason: Reason, now: float, actions: list[Action]) -> None:
        """Raise the transfer under way to a graver reason."""
        crossing = transfer.crossing or self.foresight.number_for(transfer.key.to_station, reason, now)
        transfer.raise_to(reason, now, crossing=crossing)
        if self._hurries(transfer, now, actions):
            transfer.hurry(now)
        text = f"handover {transfer.key.handover_id} is now for {in_words(reason)}"
        actions.append(Record("transfer_raised", text, reason, transfer.key.to_station))
        self._authority.refresh(reason, actions)
        self.imply(now, actions)  # the vehicle's file may answer this reason

    def _seek_successor(self, lost: int, now: float, actions: list[Action]) -> None:
        """The commander is lost in flight: stations whose zones hold the aircraft may take it, without asking."""
        if self._authority.recovering:  # after a restart its heartbeat may still come
            return
        usable = self._candidates.usable(lost, Reason.COMMANDER_LOST, now, actions)
        if usable and self._authority.transfer is None:
            self.begin(self._candidates.best(usable), Reason.COMMANDER_LOST, now, actions, forced=True)
        transfer = self._authority.transfer
        if transfer is None or not transfer.forced:
            return
        for station in usable:
            if station not in transfer.partners:
                transfer.invite(station, now, ready=self._standard(station))
                text = f"handover {transfer.key.handover_id} (forced): {self._authority.name(station)} is asked too"
                actions.append(Record("candidate", text, Reason.COMMANDER_LOST, station))

    def begin(
        self,
        partner: int,
        reason: Reason,
        now: float,
        actions: list[Action],
        *,
        consented: bool = False,
        forced: bool = False,
        operator_timeout_s: float | None = None,
    ) -> None:
        """Begin a transfer from the owner; one under way that yields to it is over.

        `consented`: the owner has agreed. `forced`: the owner is lost, so it is not asked.
        """
        authority = self._authority
        assert authority.owner is not None
        self.move(Cause.PREEMPTED, now, actions)
        assert authority.transfer is None
        key = TransferKey(authority.owner, partner, authority.number_transfer(), authority.epoch)
        transfer = Transfer(
            key,
            reason,
            self._limits,
            now,
            consented=consented,
            forced_until=self._forced_until(now) if forced else None,
            operator_timeout_s=operator_timeout_s,
            crossing=0 if forced else self.foresight.number_for(partner, reason, now),
        )
        if now - self._aborted_at < READ_S:
            transfer.follows_another(now + READ_S)
        self.results.forget((key.from_station, key.to_station))
        if not consented or reason not in (Reason.REQUESTED, Reason.GIVEN):  # it is not by the last request
            self.echo.forget()
        authority.begin_transfer(transfer)
        authority.refresh(reason, actions)
        how = " (forced)" if forced else ""
        text = f"handover {key.handover_id}{how}: {authority.name(authority.owner)} -> {authority.name(partner)}"
        actions.append(Record("transfer_begun", text, reason, partner))
        self.imply(now, actions)

    def _forced_until(self, now: float) -> float:
        """Time limit of a forced transfer: all attempts after one loss share one limit."""
        hurry_until = self._authority.hurry_until(self._limits.forced_timeout_s)
        return hurry_until if now < hurry_until else now + self._limits.forced_timeout_s

    def on_message(self, station: int, message: TransferMessage, now: float, actions: list[Action]) -> str | None:
        """Take a station's message of a transfer; returns why it was dropped, None if it counts."""
        key = message.key
        transfer = self._authority.transfer
        if transfer is None or not transfer.concerns(key):
            last = self.results.told(station)
            if last is not None and key.handover_id == last.key.handover_id:
                actions.append(Send(station, last))
                return "transfer already over"
            return "stale epoch or unknown transfer"
        cause = cause_of(message, station)
        if cause is None:
            return "not the sender's to say"
        if self._authority.lost and station == key.from_station:  # a forced transfer does not ask the commander
            return "the commander is lost"
        self._candidates.spoke(station)
        if cause is Cause.PARTNER_ASKS and self._hurries(transfer, now, actions):
            transfer.partner_asks_in_a_hurry(now)
            return None
        relay = isinstance(message, (OnHandover, DroneConnected)) and message.relay
        self.move(cause, now, actions, station=key.to_station, relay=relay)
        return None

    def _hurries(self, transfer: Transfer, now: float, actions: list[Action]) -> bool:
        """Whether the transfer gives the partner's operator no extra time: the zone ends, and others are there."""
        if transfer.forced or transfer.reason is not Reason.ZONE_ENDS:
            return False
        reasons = self._candidates.reasons(transfer.key.from_station, now, actions)
        return any(why is transfer.reason for station, why in reasons.items() if station != transfer.key.to_station)

    def cancel(self, station: int, now: float, actions: list[Action]) -> None:
        """One of its two stations cancels the transfer; a forced one goes on with the other stations."""
        transfer = self._authority.transfer
        if transfer is not None and station in (transfer.key.from_station, transfer.key.to_station):
            self.move(Cause.PARTNER_REFUSED if transfer.others else Cause.CANCELLED, now, actions)

    def just_changed(self, now: float) -> bool:
        """Whether an answer of the commander that names no transfer may be meant for one that is over."""
        transfer = self._authority.transfer
        if transfer is None:
            return now - self._aborted_at < READ_S
        return not transfer.consented and now < transfer.read_until

    def consent(self, now: float, actions: list[Action]) -> None:
        """The commander agrees to the transfer under way by other means than its messages."""
        if self._authority.transfer is not None:
            self._authority.transfer.consent_given()
            self.imply(now, actions)

    def move(
        self, cause: Cause, now: float, actions: list[Action], *, station: int | None = None, relay: bool = False
    ) -> None:
        """Apply a cause to the transfer under way, if there is one. `station`, `relay`: as in `Transfer.move`."""
        transfer = self._authority.transfer
        if transfer is None:
            return
        if cause is Cause.TIMEOUT and self._authority.phase is Phase.ON_LOAD:
            transfer.stop_waiting_for_operators()  # nothing flies
        if (
            cause is Cause.TIMEOUT
            and transfer.step is Step.CONSENT
            and not self._presence[transfer.key.from_station].can_be_asked
        ):
            cause = Cause.CANNOT_BE_ASKED
        before, partner = transfer.step, transfer.key.to_station
        end = transfer.move(cause, now, station=station, relay=relay)
        self._bury(transfer, now, actions)
        if isinstance(end, End):
            self._end(transfer, self._permitted(transfer, end, now), now, actions)
            return
        if transfer.key.to_station != partner:
            self._authority.refresh(transfer.reason, actions)
            name = self._authority.name(transfer.key.to_station)
            text = f"handover {transfer.key.handover_id} (forced): {name} is the partner now"
            actions.append(Record("candidate", text, transfer.reason, transfer.key.to_station))
        if end:
            step = f"handover {transfer.key.handover_id}: {before.value} -> {transfer.step.value} ({cause.value})"
            actions.append(Record("step", step, duration_s=now - transfer.started_at))
            self.imply(now, actions)

    def _permitted(self, transfer: Transfer, end: End, now: float) -> End:
        """The end that the steps lead to; an abort if the partner cannot take the aircraft now."""
        partner = transfer.key.to_station
        why = None if end.outcome is Outcome.ABORTED else self._candidates.unable(partner, now, self._flight.flying)
        return end if why is None else End(Outcome.ABORTED, why)

    def take_off(self, now: float, actions: list[Action]) -> None:
        """At take-off keep only the candidates that could take the aircraft in the air."""
        transfer = self._authority.transfer
        for station in () if transfer is None else (*transfer.others, transfer.key.to_station):
            if self._candidates.unable(station, now, True) is not None:
                self.move(Cause.LEFT_REGION, now, actions, station=station)

    def _bury(self, transfer: Transfer, now: float, actions: list[Action]) -> None:
        """Pause the candidates that fell away, so that they are not asked again at once."""
        for station, why in transfer.pop_fallen():
            self._candidates.pause(station, transfer.reason, why, now)
            text = f"handover {transfer.key.handover_id} (forced): {self._authority.name(station)}: {in_words(why)}"
            actions.append(Record("candidate", text, why, station))

    def imply(self, now: float, actions: list[Action]) -> None:
        """Apply the causes that come by themselves in the present step."""
        transfer = self._authority.transfer
        if transfer is None:
            return
        key = transfer.key
        cause = transfer.implied(
            partner_standard=self._standard(key.to_station), commander_standard=self._standard(key.from_station)
        )
        if cause is None and transfer.step is Step.CONSENT:
            cause = self._standing(key.from_station, transfer.reason)
        if cause is not None:
            self.move(cause, now, actions, relay=True)  # no station has sent a message that could be passed on
        elif transfer.step is Step.CONSENT and self._standard(key.from_station):
            transfer.ask_operator(now)

    def _standing(self, commander: int, reason: Reason) -> Cause | None:
        """The configuration's answer for a commander that cannot be asked; None: its operator is asked.

        `automatic` never answers the request of another operator.
        """
        consent = self._presence[commander].station.consent
        if consent is StandingConsent.AUTOMATIC and QUESTIONS[reason] in AUTOMATIC:
            return Cause.CONSENTED
        return Cause.CONSENT_REFUSED if consent is StandingConsent.REFUSE else None

    def _end(self, transfer: Transfer, end: End, now: float, actions: list[Action]) -> None:
        authority = self._authority
        key = transfer.key
        committed = end.outcome is Outcome.COMMITTED
        reason = end.reason if end.reason is not Reason.NONE else transfer.reason
        authority.end_transfer()
        if committed:
            self.echo.took_effect(now)
            authority.commit(key.to_station)
            self._candidates.moved(key.to_station, now, flying=authority.phase is not Phase.ON_LOAD)
        else:
            if end.reason is not Reason.COMMANDER_DENIED:  # after a denial no answer is on its way
                self._aborted_at = now
            for station in transfer.partners:
                self._candidates.pause(station, transfer.reason, end.reason, now)
            self.echo.forget()
        authority.refresh(reason, actions)
        commander = authority.view.commander
        text = (
            f"handover {key.handover_id} committed: {authority.name(key.to_station)} commands, epoch {authority.epoch}"
            if committed
            else f"handover {key.handover_id} aborted ({in_words(end.reason)}): {authority.name(commander)} commands"
        )
        event = "transfer_committed" if committed else "transfer_aborted"
        actions.append(Record(event, text, reason, key.to_station, now - transfer.started_at))
        if not committed and end.reason in PEOPLES_WORD:  # the result tells it to stations with our module
            names = authority.name(key.from_station), authority.name(key.to_station)
            standard = tuple(each for each in (key.from_station, *transfer.partners) if self._standard(each))
            if standard:
                actions.append(Advise(standard, f"No handover: {ended(end.reason, *names)}"))
        now_key = TransferKey(key.from_station, key.to_station, key.handover_id, authority.epoch)
        result = HandoverResult(now_key, commander, end.outcome, reason)
        told = [station for station in (key.from_station, *transfer.partners) if not self._standard(station)]
        self.results.announce(result, told, now, actions)

    # ---- what is said ---------------------------------------------------------------------------------------------

    def speak(self, now: float, actions: list[Action]) -> None:
        """Send the messages that are due: of the present transfer, the last one, and the one ahead."""
        transfer = self._authority.transfer
        if transfer is not None:
            actions += [self._put(station, message, transfer, now) for station, message in transfer.due(now)]
        self.results.repeat(now, self._authority.names, actions)
        self.foresight.speak(now, actions)

    def _put(self, station: int, message: Message, transfer: Transfer, now: float) -> Action:
        """The action for a message. A standard station only ever gets the question of consent, as its command."""
        if self._standard(station):
            return NotifyOwner(station, transfer.key.to_station, waiting_s(transfer.timeout_at - now))
        return Send(station, message, transfer.attempt)

    def _standard(self, station: int) -> bool:
        return self._presence[station].station.standard

    def deadlines(self) -> list[float]:
        """Times at which something is due."""
        times = [*self.results.deadlines(), *self.foresight.deadlines()]
        transfer = self._authority.transfer
        if transfer is not None:
            times += [transfer.retry_at, transfer.timeout_at]
            times += [self._presence[station].lost_at() for station in transfer.partners]
        return times
