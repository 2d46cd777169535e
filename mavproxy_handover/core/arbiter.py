# SPDX-License-Identifier: GPL-3.0-or-later

"""The sole judge of authority, and the only object that knows both authority and safety.

It owns the parts of `authority/` and one `Safety` (`safety/safety.py`). It takes every event to the part that the event
belongs to, and decides where authority and safety meet:

* Safety reads authority through `common/authority_facts.py`, which `authority/coverage.py` implements.
* A decision of safety moves the phase, ends a START under way, and may end a transfer (`_on_news`, `_come_home`).
* A gap that the mission declares lets the aircraft fly on without a commander (`Authority.fly_alone`).

The parts of authority:

* `authority/authority.py`: owner, epoch, phase, and the view of them; the phase moves by the table of
  `authority/phases.py`.
* `authority/contacts.py`, `authority/presence.py`: which stations are there, both ways, with the same mission package.
* `authority/candidates.py`, `authority/zones.py`, `authority/links.py`: which stations could take the aircraft, and
  which one should.
* `authority/transfer_manager.py`, `authority/transfer.py`, `authority/results.py`: how authority moves;
  `authority/requests.py`, `authority/control.py`: requests by the MAVLink standard.
* `authority/start.py`: how a flight begins; `authority/rehearsal.py`: how one is rehearsed on the ground.
* `common/flight.py`: what the aircraft said.

Rules that live here
--------------------
* The frames of an owner that is not heard have no authority. Only this owner can take authority up again, with a new
  epoch, or a transfer that commits.
* The parent becomes the owner on the ground, disarmed, after it has answered CONNECT. In flight no station gets
  authority by connecting.

The caller passes every event with the present monotonic time, carries out the actions in order, and calls again with
`Tick` no later than `next_deadline()`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from math import inf

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.authority.contacts import Contacts
from mavproxy_handover.core.authority.coverage import Coverage
from mavproxy_handover.core.authority.phases import PhaseCause
from mavproxy_handover.core.authority.rehearsal import Rehearsal
from mavproxy_handover.core.authority.requests import Requests
from mavproxy_handover.core.authority.start import Start
from mavproxy_handover.core.authority.transfer import Cause
from mavproxy_handover.core.authority.transfer_manager import TransferManager
from mavproxy_handover.core.common.causes import CAUSES
from mavproxy_handover.core.common.causes import Cause as Wrong
from mavproxy_handover.core.common.events import (
    Action,
    AircraftJudged,
    AutopilotState,
    BordersSeen,
    BoxJudged,
    Cancel,
    ControlRequested,
    EnergyJudged,
    Event,
    GapsJudged,
    GuardSeen,
    HeightsJudged,
    LinkJudged,
    MissionJudged,
    MissionLoaded,
    OperatorControlShown,
    PositionSeen,
    Record,
    RehearsalAsked,
    RehearsalMoved,
    ReturnJudged,
    StartFinished,
    StartRequested,
    StationHeard,
    StationMessage,
    TakeOffPassed,
    Tick,
)
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Connect, ConnectAck, CrossingKey, HandoverAhead, OkAhead
from mavproxy_handover.core.common.model import (
    NO_MATTER_ON_GROUND,
    AuthorityView,
    FlightAction,
    GuardState,
    LeaseState,
    Mission,
    Phase,
    Reason,
    Station,
)
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.core.safety.emergency import News
from mavproxy_handover.core.safety.safety import Safety
from mavproxy_handover.core.safety.strategy import Fact, Situation

__all__ = ["Arbiter", "Identity"]


@dataclass(frozen=True, slots=True)
class Identity:
    """The vehicle and its stations. `nonce` is drawn by the caller at start: it marks the questions of this run."""

    name: str
    stations: tuple[Station, ...]
    parent: int
    nonce: int = 1


class Arbiter:
    """Authority over one vehicle. Pure: no clock, no I/O; not safe for threads."""

    def __init__(self, identity: Identity, limits: Limits | None = None, restored: Snapshot | None = None) -> None:
        """`restored`: the state of the run before; no station commands until its owner answers."""
        if identity.parent not in {station.sysid for station in identity.stations}:
            raise ValueError(f"parent {identity.parent} is not among the stations")
        self._parent = identity.parent
        self._limits = limits or Limits()
        self._flight = Flight(self._limits)
        self._authority = Authority(identity.stations, self._flight)
        self._contacts = Contacts(identity.name, identity.stations, identity.nonce, self._limits)
        self._presence = self._contacts.presence
        self._candidates = Candidates(self._presence, self._limits)
        self._transfer_manager = TransferManager(
            self._authority, self._flight, self._presence, self._candidates, self._limits
        )
        self._requests = Requests(self._authority, self._presence, self._candidates, self._transfer_manager)
        self._start = Start(self._authority, self._flight, self._candidates, self._transfer_manager)
        self._rehearsal = Rehearsal(self._authority, self._flight, self._transfer_manager, self._start, self._limits)
        coverage = Coverage(self._authority, self._flight, self._candidates, self._limits)
        self._safety = Safety(coverage, self._flight, self._limits)
        #: the epoch of the last event, None before the first one, and since when it has been so
        self._epoch: int | None = None
        self._epoch_since = -inf
        #: the run before ended in a transfer, so the zone that called for it still counts as entered
        self._interrupted = False
        if restored is not None:
            self._restore(restored)
        #: what was dropped, by cause
        self.dropped: Counter[str] = Counter()

    def _restore(self, restored: Snapshot) -> None:
        in_flight = restored.phase is not Phase.ON_LOAD
        if restored.rehearsal and in_flight:
            self._flight.rehearsal_begun()
        self._authority.restore(restored)
        if in_flight:
            self._candidates.hold(Mission(restored.digest, restored.route, restored.route_at))
            self._interrupted = restored.phase is Phase.ON_HANDOVER
            self._safety.resume(restored)

    # ---- what others may look at ----------------------------------------------------------------------------------

    @property
    def view(self) -> AuthorityView:
        """The present authority, immutable."""
        return self._authority.view

    @property
    def mission_digest(self) -> bytes:
        """SHA-256 of the mission package that the autopilot holds; empty before one is loaded."""
        return self._candidates.mission.digest

    def snapshot(self) -> Snapshot:
        """What a run after this one needs to know."""
        authority, mission, safety = self._authority, self._candidates.mission, self._safety
        return Snapshot(
            authority.owner if authority.claimant is None else authority.claimant,
            authority.epoch,
            authority.handover_id,
            authority.phase,
            mission.at,
            mission.digest,
            mission.route,
            authority.takeover_allowed,
            safety.emergency.out_of_coverage,
            safety.conditions.crossing.since,
            authority.claimant is None,
            self._flight.rehearsing,
            safety.held_since,
            safety.executor.held_for,
            safety.verification.stands,
            safety.emergency.lasting,
        )

    def name(self, sysid: int | None) -> str:
        """A station's name, for people."""
        return self._authority.name(sysid)

    def operator(self, sysid: int) -> str:
        """The operator on duty at a station, as the station last said; "": it has named none."""
        presence = self._presence.get(sysid)
        return "" if presence is None or presence.answer is None else presence.answer.operator

    @property
    def causes(self) -> frozenset[Wrong]:
        """What is wrong now, by the table of causes, whatever is done about it."""
        return self._safety.emergency.causes

    def guard(self, now: float) -> GuardState:
        """What the guard last said of itself; SILENT when that is too long ago."""
        return self._flight.guard(now)

    def grounded(self, now: float) -> bool:
        """On the ground to stay: disarmed, the autopilot has said so just now, and no START is under way."""
        return self._authority.grounded(now)

    def zone(self) -> int:
        """Station in whose zone the aircraft is, the commander's first; 0 = none."""
        return self.zones()[0]

    def zones(self) -> tuple[int, int]:
        """Two stations in whose zones the aircraft is, the commander's first; 0 = none.

        With two stations the aircraft is in an overlap.
        """
        first, second, *_ = (*self._candidates.zones.inside(self._authority.owner), 0, 0)
        return first, second

    @property
    def zone_ends_s(self) -> float:
        """Seconds until the known way leaves the commander's zone; inf: no end in sight, or outside of it."""
        owner, zones = self._authority.owner, self._candidates.zones
        return zones.ends_s(owner) if owner is not None and zones.holds(owner) else inf

    @property
    def passed_at_m(self) -> float | None:
        """Distance (m) inside the commander's zone at which a border counts as passed; None: there is none.

        It is the border at which the commander ordered the aircraft on.
        """
        return self._safety.conditions.passed_at_m

    @property
    def awaits_commander(self) -> bool:
        """Whether the commander has to answer in the transfer under way: it can answer, and has not agreed before."""
        transfer = self._authority.transfer
        if transfer is None or transfer.consented:
            return False
        return not self._presence[transfer.key.from_station].station.standard

    def answer_left_s(self, now: float) -> float:
        """Seconds left for an operator who is asked in the transfer under way; inf: no operator is asked."""
        transfer = self._authority.transfer
        return transfer.timeout_at - now if transfer is not None and transfer.operator_asked else inf

    @property
    def ahead(self) -> CrossingKey | None:
        """The border ahead that both stations are told of; None: none is foreseen."""
        return self._transfer_manager.foresight.key

    def ahead_s(self, now: float) -> float:
        """Seconds until that border is reached; inf: none is foreseen."""
        return self._transfer_manager.foresight.left_s(now)

    def connected(self, station: int, now: float) -> bool:
        """Whether messages to and from the station get through."""
        return station in self._presence and self._presence[station].connected(now)

    def wavers(self, now: float) -> bool:
        """Whether a station that is heard answers a part of its questions: the next one may change what counts."""
        return any(each.alive(now) and each.hearing.wavering for each in self._presence.values())

    def settled(self, now: float) -> bool:
        """Whether nothing changes what is known of the stations while each goes on as it does."""
        return all(each.hearing.settled or not each.alive(now) for each in self._presence.values())

    def heard_ago_s(self, station: int, now: float) -> float | None:
        """Seconds since the station was heard; None if never."""
        heard_at = self._presence[station].heard_at
        return None if heard_at == -inf else now - heard_at

    def unfit(self, station: int, now: float) -> Reason | None:
        """Why this station could not be a partner now; None if it could."""
        return self._candidates.unfit(station, now)

    def usable(self, now: float) -> frozenset[int]:
        """Stations that have the aircraft or could take it: the commander while it is heard, and possible partners.

        The position of the aircraft plays no part: the caller looks at that.
        """
        authority = self._authority
        fit = {station for station in self._presence if self.unfit(station, now) is None}
        owner = set() if authority.owner is None else {authority.owner}
        return frozenset(fit - owner if authority.lost else fit | owner)

    def alone_s(self, now: float) -> float:
        """Seconds for which the aircraft may still fly on without a commander; 0: not at all.

        Only a gap that the mission declares allows it.
        """
        return self._safety.conditions.crossing.left_s(now) if self.view.lease is LeaseState.ALONE else 0.0

    def start_needs(self, station: int, now: float) -> tuple[str, ...]:
        """What START from this station still lacks, in words; empty when the aircraft may take off."""
        return self._start.needs(station, now)

    def take_off_needs(self, station: int, now: float) -> tuple[str, ...]:
        """What any other command of this station that arms or takes off still lacks: what START does."""
        return self._start.needs(station, now, by_hand=True)

    # ---- the two entry points -------------------------------------------------------------------------------------

    def handle(self, event: Event, now: float) -> list[Action]:
        """Take in one event at monotonic time `now` (s); returns what to do, in order.

        What has run out by then runs out before the event counts, even if the caller's tick is late.
        """
        actions: list[Action] = []
        self._authority.await_owner(now + self._limits.recovery_s)
        self._expire(now, actions)
        match event:
            case Tick():
                pass
            case StationHeard():
                self._on_heard(event.station, now, actions)
            case StationMessage():
                self._on_message(event, now, actions)
            case PositionSeen():
                self._on_position(event, now, actions)
            case BordersSeen():
                self._transfer_manager.foresight.seen(event, now, actions)
            case AutopilotState():
                self._on_autopilot(event, now, actions)
            case GuardSeen():
                self._on_guard(event, now, actions)
            case (
                EnergyJudged()
                | GapsJudged()
                | AircraftJudged()
                | BoxJudged()
                | HeightsJudged()
                | ReturnJudged()
                | MissionJudged()
            ):
                self._flight.judged(event)
            case MissionLoaded():
                self._on_mission(event, actions)
            case StartRequested():
                self._start.requested(event.station, now, actions)
            case RehearsalAsked():
                if self._rehearsal.asked(event, now, actions):
                    self._end_rehearsal(f"ended by {self.name(event.station)}", Reason.OPERATOR, now, actions)
            case TakeOffPassed():
                self._start.by_hand(now, actions)
            case StartFinished():
                self._start.finished(event, now, actions)
            case Cancel():
                self._transfer_manager.cancel(event.station, now, actions)
            case ControlRequested():
                if self._known(event.station):
                    self._requests.on_request(event, now, actions)
            case OperatorControlShown():
                if self._known(event.station):
                    self._presence[event.station].control_shown()
            case LinkJudged():
                self._candidates.links.judged(event, self.name(event.station), now, actions)
                self._transfer_manager.seek(now, actions)
            case _:
                self._safety.handle(event, now, actions)
        self._transfer_manager.speak(now, actions)
        self._judge_safety(now, actions)
        self._rehearsal.update(now)
        self._contacts.ask(self._authority, self.mission_digest, now, actions)
        if self._epoch != self._authority.epoch:
            self._epoch, self._epoch_since = self._authority.epoch, now
        return actions

    def next_deadline(self) -> float | None:
        """When `Tick` is due at the latest (monotonic s); None if nothing is pending."""
        authority = self._authority
        times = [presence.ask_at for presence in self._presence.values()]
        times += self._transfer_manager.deadlines()
        if authority.owner is not None and not authority.lost:
            times.append(self._owner_lost_at(authority.owner))
        others = (
            None if authority.recover_until == inf else authority.recover_until,
            self._flight.stale_at(),
            self._rehearsal.due_at(),
        )
        times += self._safety.due_at()
        return min([*times, *(time for time in others if time is not None)], default=None)

    # ---- stations -------------------------------------------------------------------------------------------------

    def _known(self, station: int) -> bool:
        if station in self._presence:
            return True
        self.dropped["unknown station"] += 1
        return False

    def _on_heard(self, station: int, now: float, actions: list[Action]) -> None:
        if not self._known(station):
            return
        waits = self._authority.lost and station == self._authority.owner
        self._contacts.note_heard(station, now, actions, commanded=waits)
        if self._presence[station].station.standard:
            self._return(station, now, actions)

    def _return(self, station: int, now: float, actions: list[Action]) -> None:
        """A station is there. If it is the commander that was lost, and hears enough, it commands again."""
        if self._authority.waits_for(station) and not self._presence[station].hearing.barred:
            self._transfer_manager.move(Cause.COMMANDER_RETURNED, now, actions)
            self._authority.restore_owner(station, actions)

    def _owner_lost_at(self, owner: int) -> float:
        """When the owner counts as lost if nothing more is heard of it, or it does not answer."""
        presence = self._presence[owner]
        return min(presence.lost_at(), presence.deaf_at(self._epoch_since))

    def _on_message(self, event: StationMessage, now: float, actions: list[Action]) -> None:
        station, message = event.station, event.message
        self._on_heard(station, now, actions)
        if station not in self._presence:
            return
        if self._presence[station].station.standard:
            self._presence[station].control_shown()
        match message:
            case Connect():
                self._contacts.answer(station, message, self._authority, self.mission_digest, actions)
                return
            case ConnectAck():
                dropped = self._on_connect_ack(station, message, now, actions)
            case OkAhead():
                dropped = self._transfer_manager.foresight.accept_answer(station, message, actions)
            case HandoverAhead():
                dropped = "not the sender's to say"
            case _:
                dropped = self._transfer_manager.on_message(station, message, now, actions)
        if dropped is not None:
            self.dropped[dropped] += 1

    def _on_connect_ack(self, station: int, answer: ConnectAck, now: float, actions: list[Action]) -> str | None:
        self._transfer_manager.results.acknowledged(station, answer)
        if answer.nonce == 0:  # unasked: it shows that a result is known, and no more
            return None
        grounded, hearing = self._authority.grounded(now), self._presence[station].hearing
        was_barred = hearing.barred
        dropped = self._contacts.answered(station, answer, now, actions, grounded=grounded)
        if hearing.barred and not was_barred:
            self._tell_deaf(station, actions)
        if dropped is None:
            self._return(station, now, actions)
            self._authority.learn(station, answer, actions)
            self._grant_parent(now, actions)
        return dropped

    def _grant_parent(self, now: float, actions: list[Action]) -> None:
        authority, parent = self._authority, self._parent
        # the parent may bring the mission package later
        fit = self.unfit(parent, now) in (None, *NO_MATTER_ON_GROUND)
        gone = authority.lost and not authority.recovering
        free = authority.owner is None or (gone and authority.owner != parent)
        if free and fit and not authority.released and authority.transfer is None and authority.grounded(now):
            authority.grant(parent, Reason.PARENT_CONNECTED, actions)

    def _asked(self) -> tuple[int, ...]:
        """Stations that are asked in the transfer under way, the partner last.

        If the partner is taken out first, the next station becomes the partner and could be taken out with it.
        """
        transfer = self._authority.transfer
        return () if transfer is None else (*transfer.others, transfer.key.to_station)

    # ---- the aircraft ---------------------------------------------------------------------------------------------

    def _on_position(self, event: PositionSeen, now: float, actions: list[Action]) -> None:
        self._flight.position_seen(now)
        zones = self._candidates.zones
        first = not zones.known
        change = zones.update(event.zones, now)
        if first and not self._interrupted:  # the aircraft was in these zones before
            zones.forget_entries()
        for station in change.entered:
            actions.append(Record("zone_entered", f"zone of {self.name(station)} entered", station=station))
        for station in change.left:
            actions.append(Record("zone_left", f"zone of {self.name(station)} left", station=station))
        for station in self._asked():
            if station in change.left:
                self._transfer_manager.move(Cause.LEFT_REGION, now, actions, station=station)
        if event.gap is None or event.gap.ahead:  # from here on the aircraft counts as in no gap
            self._authority.fly_alone(False)
        self._transfer_manager.seek(now, actions)
        self._safety.position_seen(event.gap, now)

    def _on_autopilot(self, event: AutopilotState, now: float, actions: list[Action]) -> None:
        authority = self._authority
        was_armed = self._flight.armed
        self._flight.autopilot_said(event, now)
        self._end_rehearsal_if_over(now, actions)
        if not event.armed and authority.phase is not Phase.ON_LOAD and not self._flight.rehearsing:
            self._land(now, actions)
        elif self._flight.flying and authority.phase is Phase.ON_LOAD and not authority.starting:
            self._start.enter_mission("airborne", now, actions)
        elif was_armed is not event.armed:
            authority.refresh(Reason.NONE, actions)
        self._grant_parent(now, actions)

    def _land(self, now: float, actions: list[Action]) -> None:
        self._transfer_manager.move(Cause.CANCELLED, now, actions)
        self._authority.land()
        self._forget_flight()
        actions.append(Record("landed", "disarmed: the flight is over", Reason.LANDED))
        self._authority.refresh(Reason.LANDED, actions)

    def _forget_flight(self) -> None:
        self._safety.landed()
        self._candidates.hold(replace(self._candidates.mission, at=0))
        for presence in self._presence.values():
            presence.hearing.forgive()

    def _end_rehearsal_if_over(self, now: float, actions: list[Action]) -> None:
        over = self._rehearsal.over(now)
        if over is not None:
            self._end_rehearsal(*over, now, actions)

    def _end_rehearsal(self, why: str, reason: Reason, now: float, actions: list[Action]) -> None:
        """End the rehearsal. Its decisions no longer count: if this is a flight by now, everything is judged again."""
        self._transfer_manager.move(Cause.CANCELLED, now, actions)
        self._safety.executor.rehearsal_over(actions)
        self._rehearsal.end()
        self._forget_flight()
        self._authority.refresh(reason, actions)
        actions.append(RehearsalMoved(False, f"REHEARSAL OVER: {why}", reason))

    def _on_guard(self, event: GuardSeen, now: float, actions: list[Action]) -> None:
        before = self.guard(now)
        self._flight.guard_said(event, now)
        if event.state not in (before, GuardState.SILENT):
            actions.append(Record("guard", f"guard: {before.name.lower()} -> {event.state.name.lower()}"))

    def _on_mission(self, event: MissionLoaded, actions: list[Action]) -> None:
        self._candidates.hold(Mission(event.digest, event.route))
        self._safety.emergency.set_policy(event.out_of_coverage)
        if event.digest:
            names = " ".join(self.name(station) for station in event.route)
            actions.append(Record("mission_loaded", f"mission loaded, commanders along the route: {names}"))
        else:
            actions.append(Record("mission_dropped", "the autopilot no longer holds the mission that was loaded"))

    # ---- time and safety ------------------------------------------------------------------------------------------

    def _expire(self, now: float, actions: list[Action]) -> None:
        authority, transfer = self._authority, self._authority.transfer
        for station, presence in self._presence.items():
            if presence.judge(now):
                self._tell_deaf(station, actions)
        # the partner first: after this no transfer commits to a lost station
        for station in self._asked():
            if not self._presence[station].alive(now) or self._presence[station].hearing.barred:
                self._transfer_manager.move(Cause.PARTNER_LOST, now, actions, station=station)
        if authority.owner is not None and not authority.lost and now >= self._owner_lost_at(authority.owner):
            self._lose_owner(authority.owner, now, actions)
        transfer = authority.transfer
        if transfer is not None and now >= transfer.timeout_at:
            self._transfer_manager.move(Cause.TIMEOUT, now, actions)
        if authority.recover_until is not None and now >= authority.recover_until and authority.owner is not None:
            authority.wait_no_longer(authority.owner, now, actions)
            self._transfer_manager.seek(now, actions)
        self._end_rehearsal_if_over(now, actions)

    def _tell_deaf(self, station: int, actions: list[Action]) -> None:
        text = f"{self.name(station)} {self._candidates.hears_little}"
        actions.append(Record("deaf", text, station=station))

    def _lose_owner(self, owner: int, now: float, actions: list[Action]) -> None:
        self._transfer_manager.move(Cause.COMMANDER_LOST, now, actions)
        if self._authority.owner != owner:  # the partner had confirmed and the commander consented: committed
            return
        presence = self._presence[owner]
        # now, because the first lease with ALONE says how long it may last
        self._authority.fly_alone(self._safety.commander_lost(now))
        deaf = presence.alive(now)
        answers = presence.connected(now)
        why = self._candidates.hears_little if answers else "answers no more" if deaf else "is lost"
        if not presence.station.standard:  # a standard station is judged by its heartbeat only
            presence.hearing.lost(now, deaf=deaf)
        self._authority.lose(owner, now, actions, why=why)
        # a denial or a missing answer under the lost commander must not delay a ready partner
        self._candidates.forget_pauses()
        self._transfer_manager.seek(now, actions)

    def _judge_safety(self, now: float, actions: list[Action]) -> None:
        if self._flight.position_lost(now):
            actions.append(Record("position_stale", "no fresh position: no handover by zone", Reason.POSITION_STALE))
        executor = self._safety.executor
        executor.resolve_doubt(now, actions)
        untold = executor.tells_at()
        facts = self._judge(now, actions)
        if untold is not None and untold == executor.tells_at():
            executor.tell_return(now, actions)
        if executor.verify_order(facts, now, actions):  # the autopilot does not follow: the table has something graver
            self._judge(now, actions)

    def _judge(self, now: float, actions: list[Action]) -> Situation:
        """Decide; returns the facts that hold after that."""
        facts, news = self._safety.judge(now)
        self._authority.fly_alone(Fact.GAP in facts and not self._safety.emergency.brings_down)
        if news is not None:
            self._on_news(news, now, actions)
            return self._safety.facts.now(now)
        if self._authority.lost:
            self._authority.refresh(Reason.COMMANDER_LOST, actions)
        return facts

    def _on_news(self, news: News, now: float, actions: list[Action]) -> None:
        authority, decision = self._authority, news.decision
        if decision is None:
            what = "gap" if news.crossed else "emergency" if news.grave else "warning"
            text = "the gap is crossed" if news.crossed else f"the cause of the {what} is gone"
            actions.append(Record(f"{what}_over", text))
        elif news.continues:
            text = f"{CAUSES[decision.cause].words}: {self._safety.conditions.crossing.words(now)}"
            actions.append(Record("gap", text, news.reason, authority.owner))
        else:
            kind = "warning" if news.warning else "would" if self._flight.rehearsing else "emergency"
            would = "would " if kind == "would" else ""
            text = f"{CAUSES[decision.cause].words}: {would}{decision.action.name.lower()}"
            actions.append(Record(kind, text, news.reason, authority.owner))
        if decision is not None and decision.action >= FlightAction.RETURN:
            self._come_home(decision.cause, now, actions)
        else:  # a warning is no emergency
            authority.move_phase(PhaseCause.RECOVERED)
            authority.resume_transfer_phase()
        authority.refresh(news.reason, actions)
        self._safety.executor.carry_out(news, now, actions)

    def _come_home(self, cause: Wrong, now: float, actions: list[Action]) -> None:
        """The aircraft is about to be brought home, or down."""
        if cause is Wrong.OUT_OF_COVERAGE:  # a transfer from a lost commander goes on
            self._transfer_manager.move(Cause.OUT_OF_COVERAGE, now, actions)
        self._authority.start_over()
        if self._authority.phase is Phase.ON_LOAD:
            self._start.enter_mission("airborne", now, actions)
        self._authority.move_phase(PhaseCause.EMERGENCY)
