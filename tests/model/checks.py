# SPDX-License-Identifier: GPL-3.0-or-later

"""What must hold, checked at every step of an exploration.

The books are kept apart from the rules: they know what was said and heard, and judge by what docs/architecture.md says
of a transfer what the rules make of it. Nothing is asked of an arbiter but its view, the gate's word on who commands.

1. Every change of the view is announced, and nobody is told of an epoch before the gate is.
2. The commander changes for one of these causes only. To nobody: it was not heard for the heartbeat limit, has not
   answered for as long as one that hears nothing may, or released on the ground. To a station: the ground grant; the
   return of the one that had authority; a committed transfer, after the partner's word and the commander's consent and
   release (the release may be overdue; who gives control away by the standard's command has released with that), or
   with no commander left (forced). The aircraft is in the partner's zone, the partner alive.
3. The epoch grows by one with every such change but the first return after a restart, and never otherwise; unless the
   state file was lost and a station remembers a later one.
4. What carries another epoch or transfer number does no more than a heartbeat would, and what comes twice no more than
   what comes once.
5. LOST means that the commander was not heard for that long and no forced transfer is running; then the aircraft is
   being brought home.
   Unless it is in a gap that the mission declares: then it is ALONE, on its way, no longer than the gap's limit.
6. The aircraft is held only where its commander's zone is about to end, and is told to go on only when authority has
   moved since, or in a gap that the mission declares. Behind a restart of the companion it is held on, or told to go on
   where nothing is found wrong any more.
7. Once the energy has been short for its hold-off the aircraft is brought home, and until it has landed nothing else is
   commanded: whatever becomes of authority meanwhile, over a restart of the companion too.
8. No transfer is begun of the vehicle's own accord unless the zone was entered since authority last changed, the
   commander's zone has ended or is about to and the partner's is not, or its links are weak and the partner's are not.
What must hold for stations is in `station_checks.py`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from mavproxy_handover.core.common.events import (
    Action,
    AutopilotState,
    ConditionsSeen,
    ControlRequested,
    Event,
    Fly,
    LinkJudged,
    PositionSeen,
    Send,
    StationHeard,
    StationMessage,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import (
    Connect,
    ConnectAck,
    DroneConnected,
    HandoverRequest,
    HandoverResult,
    TransferKey,
)
from mavproxy_handover.core.common.model import AuthorityView, Consent, FlightAction, LeaseState, Phase, Reason
from tests.model.canonical import GAP_S
from tests.model.setting import PARENT

__all__ = ["Books", "Violation", "Words", "check_vehicle", "demand", "is_old"]

Words = frozenset[tuple[int, str]]
#: the leases while no station commands
NOBODYS = (LeaseState.LOST, LeaseState.RECOVERING, LeaseState.ALONE)
#: so many ticks the energy has to be short before anything is done for it (`causes.py`), and what is done then
SHORT_S = 2
#: why a planned handover is begun
PLANNED = (Reason.ZONE, Reason.ZONE_ENDS, Reason.LINK_QUALITY)
HOMEWARD = (FlightAction.RETURN, FlightAction.LAND)


class Violation(AssertionError):
    """Something that must hold does not."""


def demand(condition: object, text: str) -> None:
    """Raise `Violation` with this text unless the condition holds."""
    if not condition:
        raise Violation(text)


@dataclass(frozen=True, slots=True)
class Books:
    """What the world knows of the vehicle. Ages are whole ticks, not counted beyond what matters."""

    #: who had authority last
    had: int | None = None
    #: station -> ticks since it was heard
    silent: tuple[tuple[int, int], ...] = ()
    #: ticks since the one that had authority last answered CONNECT, or since this epoch began
    unanswered: int = 0
    #: station -> ticks since it was asked CONNECT while it was heard, and whether it answered; oldest first
    fates: tuple[tuple[int, tuple[tuple[int, bool], ...]], ...] = ()
    #: what stations have said in the present transfer: station, word
    words: Words = frozenset()
    #: the commander agreed to the present transfer by other means than OK_HANDOVER
    agreed: bool = False
    #: stations that HANDOVER_REQUEST of the present transfer has gone to
    asked: frozenset[int] = frozenset()
    #: ticks since the partner's DRONE_CONNECTED in the present transfer
    connected: int | None = None
    #: stations whose zone holds the aircraft, and those of them entered since authority last changed: where a station
    #: awaits it at a waypoint, by reaching that
    zones: frozenset[int] = frozenset()
    awaiting: frozenset[int] = frozenset()
    entered: frozenset[int] = frozenset()
    #: zones that are about to end
    ending: frozenset[int] = frozenset()
    #: False until the first position after a start: what holds the aircraft then was not entered
    placed: bool = False
    #: unless the run before ended in a transfer: then it is still owed
    interrupted: bool = False
    #: stations whose links are over a limit
    weak: frozenset[int] = frozenset()
    flying: bool = False
    grounded: bool = False
    #: ticks since a restart from which the commander has not yet been heard
    recovering: int | None = None
    #: it is in a gap that the mission declares; and ticks since it has been without a commander in its zone there
    gap: bool = False
    alone: int | None = None
    #: it was held since another station commanded
    held: bool = False
    #: it was when the run before ended: it may be held on, and told to go on where nothing is found wrong any more
    stood: bool = False
    #: ticks since no more energy is left than the way back needs; None: there is more
    short: int | None = None
    #: the state file was lost: no station commands until the next flight
    blank: bool = False
    #: the run began without a state file
    unaware: bool = False

    def later(self, limits: Limits) -> Books:
        """One tick later."""
        most = int(limits.heartbeat_lost_s)
        return replace(
            self,
            silent=tuple((station, min(age + 1, most)) for station, age in self.silent),
            unanswered=min(self.unanswered + 1, int(limits.deaf_lost_s)),
            fates=tuple((station, _later(fates, limits)) for station, fates in self.fates),
            connected=None if self.connected is None else min(self.connected + 1, int(limits.release_timeout_s)),
            recovering=None if self.recovering is None else min(self.recovering + 1, most),
            alone=None if self.alone is None else min(self.alone + 1, int(GAP_S)),
            short=None if self.short is None else min(self.short + 1, SHORT_S + 1),
        )

    def restarted(self, phase: Phase, *, blank: bool) -> Books:
        """The companion starts again, from a state file that says `phase`.

        What the previous run heard is lost. A station counts as heard only when this run has heard it. Until then the
        questions to this station do not count, and it cannot take the aircraft.
        """
        known = Books(zones=self.zones, gap=self.gap, alone=self.alone, blank=blank or self.blank, unaware=blank)
        if blank or phase is Phase.ON_LOAD:
            return known
        interrupted = phase is Phase.ON_HANDOVER
        recovering = 0 if self.had else None
        # what was not acted on yet is found again, or not, like anything else; what stands by an order stands on
        short = SHORT_S if self.short is not None and self.short >= SHORT_S else None
        known = replace(known, had=self.had, recovering=recovering, interrupted=interrupted)
        return replace(known, short=short, stood=self.held or self.stood)

    def lost(self, station: int, limits: Limits, standard: frozenset[int]) -> bool:
        """Whether that commander counts as lost: it is silent, or hears nothing."""
        deaf = station == self.had and station not in standard and self.unanswered >= int(limits.deaf_lost_s)
        deaf = deaf or self.hears_little(station, limits)
        return deaf or self.age(station, limits) >= int(limits.heartbeat_lost_s)

    def hears_little(self, station: int, limits: Limits) -> bool:
        """Whether it has answered too few questions of late."""
        fates = dict(self.fates).get(station, ())
        if not fates:
            return False
        spans = {True: 0.0, False: 0.0}
        for (age, answered), (ends, _) in zip(fates, (*fates[1:], (0, False)), strict=True):
            until = max(ends, age - limits.connect_interval_s, 0.0 if answered else limits.answer_s)
            spans[answered] += max(0.0, min(age, _window_s(limits)) - until)
        asked_s = spans[True] + spans[False]
        return asked_s >= limits.deaf_lost_s / 2.0 and spans[True] < limits.deaf_share * asked_s + 1e-9

    def asked_now(self, station: int, limits: Limits) -> Books:
        """It is asked whether it is there; that counts if it is heard."""
        if self.age(station, limits) >= int(limits.heartbeat_lost_s):
            return self
        fates = dict(self.fates)
        fates[station] = (*fates.get(station, ()), (0, False))
        return replace(self, fates=tuple(sorted(fates.items())))

    def answers_now(self, station: int) -> Books:
        """It has answered what it was asked last, which was now."""
        fates = dict(self.fates)
        if fates.get(station) and fates[station][-1][0] == 0:
            fates[station] = (*fates[station][:-1], (0, True))
        return replace(self, fates=tuple(sorted(fates.items())))

    def age(self, station: int, limits: Limits) -> int:
        """Ticks since the station was heard."""
        return dict(self.silent).get(station, int(limits.heartbeat_lost_s))


def _window_s(limits: Limits) -> float:
    return limits.answer_s + limits.deaf_lost_s / (1.0 - limits.deaf_share)


def _later(fates: tuple[tuple[int, bool], ...], limits: Limits) -> tuple[tuple[int, bool], ...]:
    return tuple((age + 1, answered) for age, answered in fates if age + 1 < _window_s(limits) + 1.0)


def _key(view: AuthorityView, had: int | None) -> TransferKey | None:
    """The transfer under way, as far as the view tells."""
    if view.partner is None or had is None:
        return None
    return TransferKey(had, view.partner, view.handover_id, view.epoch)


def _word(event: StationMessage) -> str:
    consent = getattr(event.message, "consent", Consent.GRANTED)
    return type(event.message).__name__ + ("" if consent is Consent.GRANTED else f" {consent.name}")


def _of_candidate(event: StationMessage, view: AuthorityView, books: Books) -> bool:
    """Whether a station that is asked beside the partner speaks for itself: nobody commands, several may take over."""
    key, named = _key(view, books.had), getattr(event.message, "key", None)
    if key is None or named is None or view.commander is not None or event.station not in books.asked:
        return False
    return event.station == named.to_station and replace(key, to_station=event.station) == named


def is_old(event: Event, view: AuthorityView, books: Books) -> bool:
    """Whether the event is a transfer message that is not of the present transfer."""
    if not isinstance(event, StationMessage) or isinstance(event.message, (Connect, ConnectAck)):
        return False
    return event.message.key != _key(view, books.had) and not _of_candidate(event, view, books)


def _note(books: Books, view: AuthorityView, event: Event, standard: frozenset[int], heard_s: int) -> Books:
    """The books after what the event brought, before what the vehicle makes of it."""
    if isinstance(event, (StationHeard, StationMessage)):
        if event.station not in dict(books.silent) or dict(books.silent)[event.station] >= heard_s:
            books = replace(books, fates=tuple(entry for entry in books.fates if entry[0] != event.station))
        books = replace(books, silent=tuple(sorted({**dict(books.silent), event.station: 0}.items())))
    answers = isinstance(event, StationMessage) and isinstance(event.message, ConnectAck) and event.message.nonce != 0
    if answers:
        books = books.answers_now(event.station)  # type: ignore[union-attr]
    if answers and event.station == books.had:  # type: ignore[union-attr]
        books = replace(books, unanswered=0)
    if isinstance(event, AutopilotState):
        flying = event.armed and event.flying
        short = books.short if flying else None
        held, stood = books.held and flying, books.stood and flying
        books = replace(books, flying=flying, grounded=not event.armed, held=held, stood=stood, short=short)
    if isinstance(event, ConditionsSeen):
        books = replace(books, short=0 if books.short is None else books.short)
    if isinstance(event, LinkJudged):
        books = replace(books, weak=books.weak - {event.station} | ({event.station} if event.weak else set()))
    if isinstance(event, PositionSeen):
        zones = frozenset(fact.station for fact in event.zones if fact.margin_m > 0)
        awaiting = frozenset(fact.station for fact in event.zones if fact.awaits)
        entered = ((books.entered | (zones - books.zones) | books.awaiting) & zones) - awaiting
        if not books.placed:
            entered = zones - {books.had} - awaiting if books.interrupted else frozenset()
        ending = frozenset(fact.station for fact in event.zones if fact.exit_s is not None)
        entered = entered if books.flying else frozenset()
        gap = event.gap is not None
        books = replace(books, zones=zones, awaiting=awaiting, entered=entered, ending=ending, placed=True, gap=gap)
    key = _key(view, books.had)
    if isinstance(event, StationMessage) and key is not None and getattr(event.message, "key", None) == key:
        connected = books.connected
        if isinstance(event.message, DroneConnected) and event.station == key.to_station and connected is None:
            connected = 0
        books = replace(books, words=books.words | {(event.station, _word(event))}, connected=connected)
    elif isinstance(event, StationMessage) and _of_candidate(event, view, books) and _word(event) == "OnHandover":
        books = replace(books, words=books.words | {(event.station, _word(event))})
    waived = key is not None and key.to_station in standard and books.connected is None
    if waived and isinstance(event, StationMessage) and _word(event) == "OkHandover":
        books = replace(books, connected=0)  # there is no word to wait for
    if isinstance(event, ControlRequested) and key is not None and not books.agreed:
        by_commander = event.station == view.commander and (
            event.takeover or not event.request or event.for_station == key.to_station
        )
        by_partner = event.station == key.to_station and view.takeover_allowed
        books = replace(books, agreed=by_commander or by_partner)
    return books


def check_vehicle(
    books: Books,
    before: AuthorityView,
    event: Event,
    actions: Iterable[Action],
    after: AuthorityView,
    limits: Limits,
    standard: frozenset[int] = frozenset(),
    automatic: frozenset[int] = frozenset(),
) -> Books:
    """Judge what the vehicle made of one event; returns the books after it.

    `automatic`: commanders of the standard whose consent to a planned handover the vehicle's file gives.
    """
    old_books, books = books, _note(books, before, event, standard, int(limits.heartbeat_lost_s))
    gate = before
    for action in actions:
        if isinstance(action, ViewChanged):
            _check_change(books, old_books, gate, action.view, event, limits, standard, automatic)
            books = _change(books, gate, action.view, event, limits)
            gate = action.view
        elif isinstance(action, Send):
            if isinstance(action.message, Connect):
                books = books.asked_now(action.station, limits)
            if isinstance(action.message, HandoverRequest):
                books = replace(books, asked=books.asked | {action.station})
            epoch = getattr(action.message, "epoch", None) or action.message.key.epoch  # type: ignore[union-attr]
            exact = not isinstance(action.message, HandoverResult)
            told = epoch == gate.epoch if exact else epoch <= gate.epoch
            demand(told, f"station {action.station} is told of epoch {epoch} while the gate has {gate.epoch}")
        elif isinstance(action, Fly):
            books = _check_command(books, gate, action)
    demand(gate == after, "a change of the view was not announced")
    books = _crosses(books, after)
    _check_view(books, after)
    return books


def _check_command(books: Books, gate: AuthorityView, fly: Fly) -> Books:
    if books.short is not None and books.short >= SHORT_S:
        demand(fly.action in HOMEWARD, f"{fly.action.name} is commanded, and the energy is for the way back only")
    if fly.reason is Reason.COMMANDER_LOST:
        demand(gate.lease is LeaseState.LOST, f"{fly.action.name} for a lost commander, but it is not lost")
    if fly.action is FlightAction.HOLD:
        here = gate.commander in books.ending or books.held
        demand(here or books.stood, "it is held where no zone is about to end")
        return replace(books, held=here)
    if fly.action is FlightAction.CONTINUE:
        demand(books.gap or not books.held, "it is told to go on, and authority has not moved")
    return books


def _crosses(books: Books, view: AuthorityView) -> Books:
    """The books' own clock of a crossing: it runs in a gap, once no zone holds the aircraft or no station commands."""
    if not books.flying or (view.commander is not None and view.commander in books.zones):
        return replace(books, alone=None)
    exposed = not books.zones or view.commander is None
    return replace(books, alone=0) if books.alone is None and books.gap and exposed else books


def _check_view(books: Books, view: AuthorityView) -> None:
    transfer = view.partner is not None
    quiet = view.phase in (Phase.ON_LOAD, Phase.EMERGENCY)  # there a transfer is no phase
    leases = (LeaseState.HELD, LeaseState.TRANSFER) if view.commander else NOBODYS
    nobody = view.lease is LeaseState.LOST and books.flying and not transfer
    late = books.short is not None and books.short > SHORT_S and books.flying
    demand(view.phase is Phase.EMERGENCY or not late, f"the energy is for the way back only, and it flies on: {view}")
    if (view.phase is Phase.ON_HANDOVER) is not (transfer and not quiet):
        raise Violation(f"the phase does not fit: {view}")
    if transfer and view.partner == view.commander:
        raise Violation(f"commander and partner are one: {view}")
    if view.lease not in leases:
        raise Violation(f"the lease does not fit: {view}")
    if view.lease is LeaseState.ALONE:
        inside = books.gap and books.flying and view.phase is not Phase.EMERGENCY
        demand(inside, f"ALONE, and in no gap: {view}")
        demand(books.alone is not None and books.alone < GAP_S, "ALONE for longer than the gap's limit")
    if view.lease is LeaseState.RECOVERING and books.recovering is None:
        raise Violation("RECOVERING without a restart")
    if nobody and view.phase is not Phase.EMERGENCY:
        raise Violation(f"LOST in flight, and no emergency: {view}")


def _check_change(
    books: Books,
    before: Books,
    old: AuthorityView,
    new: AuthorityView,
    event: Event,
    limits: Limits,
    standard: frozenset[int],
    automatic: frozenset[int],
) -> None:
    begun = new.partner is not None and (old.partner is None or old.handover_id != new.handover_id)
    if begun:
        _check_begun(books, old, new, event)
    if new.commander == old.commander:
        rise = 0 if books.had is None else 1
        learnt = (rise == 0 or (books.unaware and not new.partner)) and new.epoch == _remembered(event) + rise
        demand(new.epoch == old.epoch or learnt, f"the epoch changed with nothing: {old.epoch} -> {new.epoch}")
        return
    if new.commander is None:
        assert old.commander is not None
        released = isinstance(event, ControlRequested) and not event.request and event.station == old.commander
        if released and books.grounded:
            demand(new.epoch == old.epoch + 1, "a release that raises no epoch")
            return
        age = before.age(old.commander, limits)
        demand(
            before.lost(old.commander, limits, standard), f"station {old.commander} lost authority, heard {age} s ago"
        )
        demand(new.epoch == old.epoch, "a loss that changes the epoch")
        return
    if _ground_grant(books, old, new, event, limits, standard):
        demand(new.epoch == old.epoch + 1, "a grant that does not raise the epoch by one")
        return
    came = getattr(event, "station", None) if isinstance(event, (StationHeard, StationMessage)) else None
    if old.commander is None and new.commander == books.had and came == new.commander:
        answers = isinstance(event, StationMessage) and isinstance(event.message, ConnectAck)
        demand(answers or came in standard, f"station {came} is back, and has not answered")
        rise = 0 if books.recovering is not None else 1
        demand(new.epoch == old.epoch + rise, f"a return that changes the epoch by {new.epoch - old.epoch}")
        return
    demand(new.epoch == old.epoch + 1, "a commit that does not raise the epoch by one")
    _check_commit(books, before, old, new.commander, limits, standard, automatic)


def _ground_grant(
    books: Books, old: AuthorityView, new: AuthorityView, event: Event, limits: Limits, standard: frozenset[int]
) -> bool:
    if old.commander is not None or not books.grounded:
        return False
    if isinstance(event, ControlRequested):
        return event.request and event.station == new.commander
    free = books.had is None or (books.recovering is None and books.lost(books.had, limits, standard))
    return new.commander == PARENT and free and new.commander != books.had


def _remembered(event: Event) -> int:
    """The epoch that a station's answer to CONNECT shows."""
    known = isinstance(event, StationMessage) and isinstance(event.message, ConnectAck)
    return event.message.epoch if known else 0  # type: ignore[union-attr]


def _check_begun(books: Books, old: AuthorityView, new: AuthorityView, event: Event) -> None:
    if isinstance(event, ControlRequested):
        return
    demand(new.partner in books.zones, f"a transfer to station {new.partner}, whose zone does not hold the aircraft")
    if new.commander is not None:
        better = new.commander in books.weak and new.partner not in books.weak
        ended = new.commander not in books.zones
        ends = new.commander in books.ending and new.partner not in books.ending
        wanted = new.partner in books.entered or ended or ends or better
        demand(wanted, f"authority wanders to station {new.partner}: no zone was entered, none has ended")


def _check_commit(
    books: Books,
    before: Books,
    old: AuthorityView,
    new: int,
    limits: Limits,
    standard: frozenset[int],
    automatic: frozenset[int],
) -> None:
    had = books.had
    assert had is not None, "a commit, and nobody had authority"
    key = _key(old, had)
    demand(key is not None and key.to_station == new, f"station {new} commands, and there was no transfer to it")
    limit = int(limits.heartbeat_lost_s)
    said = {word for station, word in books.words if station == new}
    answered = {word for station, word in books.words if station == had}
    demand(before.age(new, limits) < limit, f"committed to station {new}, which is lost itself")
    demand(not before.hears_little(new, limits), f"committed to station {new}, which hears too little")
    demand(new in standard or "DroneConnected" in said, f"committed without the word of station {new}")
    demand(books.grounded or new in books.zones, f"committed to station {new}, whose zone does not hold the aircraft")
    # what the commander answers, it was asked by the partner
    ready = new in standard or "OnHandover" in said or any(word.startswith("OkHandover") for word in answered)
    demand(ready, f"committed before station {new} was ready")
    if before.lost(had, limits, standard) or old.commander is None:
        return  # nobody is left to ask, or both had agreed; one that is back has still to show that it hears
    demand(old.commander == had, f"a forced transfer while station {had} lives")
    standing = had in automatic and old.why in PLANNED
    demand(books.agreed or standing or "OkHandover" in answered, f"committed without the consent of station {had}")
    overdue = books.connected is not None and books.connected >= int(limits.release_timeout_s)
    released = had in standard or books.agreed or "DisconnectHandover" in answered
    demand(released or overdue, f"committed before station {had} released")


def _change(books: Books, old: AuthorityView, new: AuthorityView, event: Event, limits: Limits) -> Books:
    """The books after a change of the view."""
    if new.epoch != old.epoch:
        books = replace(books, unanswered=0)
    if new.partner is None or old.partner is None or new.handover_id != old.handover_id:
        agreed = new.partner is not None and (old.takeover_allowed or new.takeover_allowed)
        if new.partner is not None and isinstance(event, ControlRequested) and event.station == old.commander:
            agreed = True
        books = replace(books, words=frozenset(), asked=frozenset(), agreed=agreed, connected=None)
    if new.commander is None and old.commander is not None:
        if new.epoch > old.epoch:
            return replace(books, had=None)
        books = replace(books, unanswered=int(limits.deaf_lost_s))  # to be heard does not bring it back, an answer does
    if new.commander is not None and new.commander != old.commander:
        books = replace(books, recovering=None, blank=False)
        if new.commander != books.had:
            kept = tuple(entry for entry in books.fates if entry[0] != new.commander)
            books = replace(books, fates=kept, had=new.commander, entered=frozenset(), held=False, stood=False)
    if new.lease in (LeaseState.LOST, LeaseState.ALONE) and books.recovering is not None:
        demand(books.recovering >= int(limits.recovery_s), f"given up {books.recovering} s after the restart")
        # it has not answered in the time it had, so it counts as lost even if it was heard; as above, a heartbeat does
        # not bring it back
        silent = tuple(entry for entry in books.silent if entry[0] != books.had)
        books = replace(books, recovering=None, silent=silent, unanswered=int(limits.deaf_lost_s))
    return books
