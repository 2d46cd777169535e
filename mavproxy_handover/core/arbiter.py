# SPDX-License-Identifier: GPL-3.0-or-later

"""The sole judge of authority.

Rules that live here
--------------------
* One owner. `commander` is the owner while its heartbeat lives, nobody after that: a silent owner's frames have no
  authority, and only itself can take it up again (with a new epoch), or a committed transfer.
* The parent becomes the owner on the ground, disarmed, once it has answered CONNECT. In flight nobody is ever granted
  authority by connecting.
* Authority moves by a committed transfer (`transfer.py`): owner and epoch change in one step.
* The phase moves by the table of `phases.py`; emergencies are decided by `safety.py`, zones by `zones.py`.
* Whatever a station repeats is answered again and changes nothing; what carries another epoch or transfer number is
  dropped and counted.

The caller passes every event with the present monotonic time, carries out the actions in order, and calls again with
`Tick` no later than `next_deadline()`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

from mavproxy_handover.core.control import ControlFacts, Effect, judge_control
from mavproxy_handover.core.events import (
    Action,
    AutopilotState,
    BeginStart,
    Cancel,
    ControlAnswer,
    ControlRequested,
    ControlResult,
    Event,
    FlightAction,
    Flush,
    Fly,
    GuardSeen,
    GuardState,
    LinkJudged,
    MissionLoaded,
    NotifyOwner,
    PositionSeen,
    Record,
    Send,
    StartFinished,
    StartRefused,
    StartRequested,
    StationHeard,
    StationMessage,
    ViewChanged,
)
from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.messages import (
    Connect,
    ConnectAck,
    DroneConnected,
    HandoverResult,
    Message,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.model import (
    PROTOCOL_VERSION,
    AuthorityView,
    LeaseState,
    Outcome,
    Phase,
    Reason,
    Station,
)
from mavproxy_handover.core.phases import PHASES, PhaseCause
from mavproxy_handover.core.presence import Presence
from mavproxy_handover.core.results import Results
from mavproxy_handover.core.safety import NOTHING_WRONG, Decision, Situation, decide
from mavproxy_handover.core.snapshot import Snapshot
from mavproxy_handover.core.transfer import Cause, End, Step, Transfer, cause_of
from mavproxy_handover.core.zones import ZoneTracker

__all__ = ["Arbiter", "Identity"]


@dataclass(frozen=True, slots=True)
class Identity:
    """Who this vehicle is. `nonce` is drawn at start by the edge; it makes questions of this run recognisable."""

    name: str
    stations: tuple[Station, ...]
    parent: int
    nonce: int = 1


#: least and longest time that a request of operator control may wait for the owner (MAVLink: 3 to 60 s)
_REQUEST_S = (3.0, 60.0)
#: a request that comes again this soon after it has taken effect is its repetition: the answer was lost on the way
_ECHO_S = 10.0
#: what is a consent if it comes from the commander; it reads as a request when another one commands
_CONSENTS = (Effect.CONSENT, Effect.TRANSFER_CONSENTED, Effect.OFFER, Effect.RELEASE)
#: beyond this an epoch is nobody's memory (it travels in 32 bits)
_EPOCH_MAX = 0x7FFF_FFFF
#: a transfer that ended because somebody did not want it
_OPERATORS_WORD = (Reason.COMMANDER_DENIED, Reason.PARTNER_REFUSED, Reason.CANCELLED)


def _request_s(wanted_s: float) -> float:
    return min(_REQUEST_S[1], max(_REQUEST_S[0], wanted_s))  # in this order what is no number is the least


class Arbiter:
    """Authority over one vehicle. Pure: no clock, no I/O; not safe for threads."""

    def __init__(self, identity: Identity, limits: Limits | None = None, restored: Snapshot | None = None) -> None:
        """`restored`: what a run before this one left behind; nobody commands until its owner is heard again."""
        self._identity = identity
        self._limits = limits or Limits()
        self._names = {station.sysid: station.name for station in identity.stations}
        if identity.parent not in self._names:
            raise ValueError(f"parent {identity.parent} is not among the stations")
        self._presence = {station.sysid: Presence(station, self._limits) for station in identity.stations}
        self._zones = ZoneTracker(self._limits)
        self._nonce = identity.nonce
        self._owner: int | None = None
        self._owner_lost = False
        self._epoch = 0
        self._phase = Phase.ON_LOAD
        self._transfer: Transfer | None = None
        self._handover_id = 0
        self._results = Results(self._limits)
        self._retry_after: dict[int, float] = {}
        self._route: tuple[int, ...] = ()
        self._route_at = 0
        self._digest = b""
        self._armed: bool | None = None
        self._flying = False
        self._autopilot_at = -inf
        self._position_at = -inf
        self._guard = GuardState.SILENT
        self._guard_ours = False
        self._guard_at = -inf
        self._starting = False
        #: the strongest decision since the present emergency began
        self._emergency: Decision = NOTHING_WRONG
        self._judged_at = -inf
        self._stale_told = False
        #: stations whose links are all over a limit, and those under whose name bad signatures come in
        self._weak: dict[int, float] = {}
        #: until when a station's links were last seen weak
        self._weak_until: dict[int, float] = {}
        self._attacked: set[int] = set()
        self._takeover_allowed = False
        #: the request by which authority is about to move, or has moved just now, and until when it may be repeated
        self._settled: ControlRequested | None = None
        self._settled_until = -inf
        #: the owner gave up control on the ground: nobody gets it without asking
        self._released = False
        #: the run before ended in a transfer: its zone has still to be served
        self._interrupted = False
        #: until then the owner of the run before may come back; None in a run that began without one
        self._recover_until: float | None = None
        self._view = AuthorityView()
        if restored is not None:
            self._restore(restored)
        #: what was dropped, by cause
        self.dropped: Counter[str] = Counter()

    def _restore(self, restored: Snapshot) -> None:
        self._epoch = restored.epoch + 1
        self._handover_id = restored.handover_id
        if restored.phase is not Phase.ON_LOAD:  # on the ground everything begins anew, but for the numbers
            self._digest, self._route, self._route_at = restored.digest, restored.route, restored.route_at
            self._takeover_allowed = restored.takeover_allowed
            if restored.out_of_coverage is not None:
                self._limits = replace(self._limits, out_of_coverage=restored.out_of_coverage)
            self._interrupted = restored.phase is Phase.ON_HANDOVER
            self._phase = Phase.ON_MISSION if self._interrupted else restored.phase
            if self._phase is Phase.EMERGENCY:  # its cause is judged anew: this one is over when none is found
                self._emergency = Decision(FlightAction.WARN, Reason.RESTARTED)
            if restored.owner in self._presence:
                self._owner, self._owner_lost = restored.owner, True
                self._recover_until = inf  # the clock starts with the first event
        self._refresh(Reason.RESTARTED, [])

    # ---- what others may look at ----------------------------------------------------------------------------------

    @property
    def view(self) -> AuthorityView:
        """The present authority, immutable."""
        return self._view

    @property
    def mission_digest(self) -> bytes:
        """SHA-256 of the mission package that the autopilot holds; empty before one is loaded."""
        return self._digest

    def snapshot(self) -> Snapshot:
        """What a run after this one needs to know."""
        return Snapshot(
            self._owner,
            self._epoch,
            self._handover_id,
            self._phase,
            self._route_at,
            self._digest,
            self._route,
            self._takeover_allowed,
            self._limits.out_of_coverage,
        )

    def name(self, sysid: int | None) -> str:
        """A station's name, for people."""
        return "nobody" if not sysid else self._names.get(sysid, f"station {sysid}")

    def guard(self, now: float) -> GuardState:
        """What the guard last said of itself; SILENT when that is too long ago."""
        return self._guard if now - self._guard_at < self._limits.guard_lost_s else GuardState.SILENT

    def zone(self) -> int:
        """Station in whose zone the aircraft is, the commander's first; 0 = none."""
        inside = self._zones.inside(self._owner)
        return inside[0] if inside else 0

    def connected(self, station: int, now: float) -> bool:
        """Whether messages to and from the station get through."""
        return station in self._presence and self._presence[station].connected(now)

    def heard_ago_s(self, station: int, now: float) -> float | None:
        """Seconds since the station was heard; None if never."""
        heard_at = self._presence[station].heard_at
        return None if heard_at == -inf else now - heard_at

    def unfit(self, station: int, now: float) -> Reason | None:
        """Why this station could not be a partner now; None if it could."""
        return self._presence[station].unfit(self._digest, now)

    # ---- the two entry points -------------------------------------------------------------------------------------

    def handle(self, event: Event, now: float) -> list[Action]:
        """Take in one event at monotonic time `now` (s); returns what to do, in order.

        What has run out by then runs out before the event counts, even if the caller's tick is late.
        """
        actions: list[Action] = []
        if self._recover_until == inf:
            self._recover_until = now + self._limits.heartbeat_lost_s
        self._expire(now, actions)
        if isinstance(event, StationHeard):
            self._on_heard(event.station, now, actions)
        elif isinstance(event, StationMessage):
            self._on_message(event, now, actions)
        elif isinstance(event, PositionSeen):
            self._on_position(event, now, actions)
        elif isinstance(event, AutopilotState):
            self._on_autopilot(event, now, actions)
        elif isinstance(event, GuardSeen):
            self._on_guard(event, now, actions)
        elif isinstance(event, MissionLoaded):
            self._on_mission(event, actions)
        elif isinstance(event, StartRequested):
            self._on_start(event.station, now, actions)
        elif isinstance(event, StartFinished):
            self._on_start_finished(event, actions)
        elif isinstance(event, Cancel):
            self._on_cancel(event.station, now, actions)
        elif isinstance(event, ControlRequested):
            self._on_control(event, now, actions)
        elif isinstance(event, LinkJudged):
            self._on_link(event, now, actions)
        self._speak(now, actions)
        self._judge_safety(now, actions)
        self._ask_around(now, actions)
        return actions

    def next_deadline(self) -> float | None:
        """When `Tick` is due at the latest (monotonic s); None if nothing is pending."""
        times = [presence.ask_at for presence in self._presence.values()]
        times += self._results.deadlines()
        if self._owner is not None and not self._owner_lost:
            times.append(self._presence[self._owner].lost_at())
        if self._recover_until is not None and self._recover_until != inf:
            times.append(self._recover_until)
        if self._transfer is not None:
            times += [self._transfer.retry_at, self._transfer.timeout_at]
            times.append(self._presence[self._transfer.key.to_station].lost_at())
        if self._flying and not self._stale_told:
            times.append(self._position_at + self._limits.position_stale_s)
        if self._zones.out_since is not None:
            held_until = self._zones.out_since + self._limits.out_hold_s
            if held_until > self._judged_at:
                times.append(held_until)
        return min(times, default=None)

    # ---- stations -------------------------------------------------------------------------------------------------

    def _on_heard(self, station: int, now: float, actions: list[Action]) -> None:
        presence = self._presence.get(station)
        if presence is None:
            self.dropped["unknown station"] += 1
            return
        if not presence.alive(now):
            actions.append(Record("station_heard", f"{self.name(station)} is heard", station=station))
            if not self._standard(station):
                presence.ask_at = now
        presence.heard_at = now
        if station == self._owner and self._owner_lost:
            self._on_return(station, now, actions)

    def _on_return(self, station: int, now: float, actions: list[Action]) -> None:
        """The owner is heard again. After a restart the epoch has risen already."""
        self._end_by(Cause.COMMANDER_RETURNED, now, actions)
        self._owner_lost = False
        if self._recover_until is None:
            self._epoch += 1
        how = "is back and commands again" if self._recover_until is None else "commands on after the restart"
        self._recover_until = None
        text = f"{self.name(station)} {how}, epoch {self._epoch}"
        actions.append(Record("authority", text, Reason.COMMANDER_RETURNED, station))
        self._refresh(Reason.COMMANDER_RETURNED, actions)

    def _on_message(self, event: StationMessage, now: float, actions: list[Action]) -> None:
        station, message = event.station, event.message
        if station not in self._presence:
            self.dropped["unknown station"] += 1
            return
        self._on_heard(station, now, actions)
        if isinstance(message, Connect):
            self._on_connect(station, message, actions)
        elif isinstance(message, ConnectAck):
            self._on_connect_ack(station, message, now, actions)
        else:
            self._on_transfer_message(event, now, actions)

    def _on_link(self, event: LinkJudged, now: float, actions: list[Action]) -> None:
        """Quality below its limits is a reason to move on while somebody better is there; an attack is a warning."""
        name = self.name(event.station)
        if event.weak is not (event.station in self._weak):
            if event.weak:
                self._weak[event.station] = now
            else:
                del self._weak[event.station]
                self._weak_until[event.station] = now
            text = f"links of {name} are {'weak' if event.weak else 'good again'}: {event.text}"
            actions.append(Record("link_quality", text, Reason.LINK_QUALITY, event.station))
        if event.attacked is not (event.station in self._attacked):
            (self._attacked.add if event.attacked else self._attacked.discard)(event.station)
            text = f"somebody {'speaks' if event.attacked else 'no longer speaks'} in the name of {name}: {event.text}"
            actions.append(Record("attack", text, Reason.AUTHENTICATION, event.station))
        self._seek_transfer(now, actions)

    def _on_connect(self, station: int, message: Connect, actions: list[Action]) -> None:
        accepted = message.protocol_version == PROTOCOL_VERSION
        answer = ConnectAck(
            station,
            PROTOCOL_VERSION,
            message.nonce,
            self._epoch,
            self._view.commander,
            self._identity.name,
            self._digest,
            accepted,
        )
        actions.append(Send(station, answer))

    def _on_connect_ack(self, station: int, message: ConnectAck, now: float, actions: list[Action]) -> None:
        presence = self._presence[station]
        self._results.acknowledged(station, message)
        if message.nonce == 0:
            return
        if not presence.answers(message.nonce):
            doubled = presence.answer is not None and message.nonce == presence.answer.nonce
            self.dropped["doubled answer to CONNECT" if doubled else "stale answer to CONNECT"] += 1
            return
        was_connected = presence.connected(now)
        presence.answered_at = now
        presence.answer = message
        if not was_connected:
            actions.append(Record("connected", f"{self.name(station)} is connected", station=station))
        self._learn_epoch(station, message.epoch, actions)
        self._grant_parent(now, actions)

    def _learn_epoch(self, station: int, epoch: int, actions: list[Action]) -> None:
        """Nobody commands, and a station remembers a later epoch: without it nothing said here would be news there."""
        if self._owner is None and self._epoch < epoch <= _EPOCH_MAX:
            text = f"{self.name(station)} remembers epoch {epoch}: the state of an earlier run was lost"
            actions.append(Record("epoch_learnt", text, Reason.RESTARTED, station))
            self._epoch = epoch
            self._refresh(Reason.RESTARTED, actions)

    def _grant_parent(self, now: float, actions: list[Action]) -> None:
        parent = self._identity.parent
        # it need not hold the mission package yet: it may be about to bring it
        fit = self._presence[parent].unfit(self._digest, now) in (None, Reason.MISSION_DIFFERS)
        gone = self._owner_lost and self._recover_until is None
        free = self._owner is None or (gone and self._owner != parent)
        if not free or self._released or self._transfer is not None or not self._grounded(now) or not fit:
            return
        self._owner, self._owner_lost, self._takeover_allowed = parent, False, False
        self._epoch += 1
        actions.append(
            Record("authority", f"{self.name(parent)} commands, epoch {self._epoch}", Reason.PARENT_CONNECTED, parent)
        )
        self._refresh(Reason.PARENT_CONNECTED, actions)

    def _grounded(self, now: float) -> bool:
        """Disarmed, and the autopilot has said so just now."""
        known = now < self._autopilot_at + self._limits.autopilot_lost_s
        return known and self._armed is False and self._phase is Phase.ON_LOAD

    def _ask_around(self, now: float, actions: list[Action]) -> None:
        for station, presence in self._presence.items():
            if now < presence.ask_at:
                continue
            self._nonce = self._nonce % 0xFFFFFFFF + 1
            presence.asked.append(self._nonce)
            presence.ask_at = now + self._limits.connect_interval_s
            actions.append(
                Send(
                    station,
                    Connect(
                        station,
                        PROTOCOL_VERSION,
                        self._nonce,
                        self._epoch,
                        self._view.commander,
                        self._identity.name,
                        self._digest,
                    ),
                )
            )

    # ---- transfers ------------------------------------------------------------------------------------------------

    def _begin_transfer(
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
        assert self._owner is not None
        self._handover_id = self._handover_id % 0xFFFF + 1
        key = TransferKey(self._owner, partner, self._handover_id, self._epoch)
        self._transfer = Transfer(
            key, reason, self._limits, now, consented=consented, forced=forced, operator_timeout_s=operator_timeout_s
        )
        self._results.forget()
        if not consented or reason is not Reason.OPERATOR:  # it is not by the last request that this one begins
            self._settled = None
        self._move_phase(PhaseCause.TRANSFER_BEGUN)
        self._refresh(reason, actions)
        how = " (forced)" if forced else ""
        text = f"handover {key.handover_id}{how}: {self.name(self._owner)} -> {self.name(partner)}"
        actions.append(Record("transfer_begun", text, reason, partner))
        self._imply(now, actions)

    def _standard(self, station: int) -> bool:
        return self._presence[station].station.standard

    def _imply(self, now: float, actions: list[Action]) -> None:
        """What comes by itself in the step that the transfer is in now."""
        transfer = self._transfer
        if transfer is None:
            return
        key = transfer.key
        cause = transfer.implied(
            partner_standard=self._standard(key.to_station), commander_standard=self._standard(key.from_station)
        )
        if cause is not None:
            self._move_transfer(cause, now, actions, relay=True)  # nobody else passes on what nobody has said
        elif transfer.step is Step.CONSENT and self._standard(key.from_station):
            transfer.ask_operator(now)

    def _on_transfer_message(self, event: StationMessage, now: float, actions: list[Action]) -> None:
        key: TransferKey = event.message.key  # type: ignore[union-attr]
        transfer = self._transfer
        if transfer is None or key != transfer.key:
            last = self._results.last
            if (
                last is not None
                and key.handover_id == last.key.handover_id
                and event.station in (last.key.from_station, last.key.to_station)
            ):
                actions.append(Send(event.station, last))
                self.dropped["transfer already over"] += 1
            else:
                self.dropped["stale epoch or unknown transfer"] += 1
            return
        cause = cause_of(event.message, event.station)
        if cause is None:
            self.dropped["not the sender's to say"] += 1
            return
        relay = isinstance(event.message, (OnHandover, DroneConnected)) and event.message.relay
        self._move_transfer(cause, now, actions, relay=relay)

    def _move_transfer(self, cause: Cause, now: float, actions: list[Action], *, relay: bool = False) -> None:
        transfer = self._transfer
        if transfer is None:
            return
        before = transfer.step
        end = transfer.move(cause, now, relay=relay)
        if isinstance(end, End):
            self._end_transfer(end, now, actions)
        elif end:
            step = f"handover {transfer.key.handover_id}: {before.value} -> {transfer.step.value} ({cause.value})"
            actions.append(Record("step", step, duration_s=now - transfer.started_at))
            self._imply(now, actions)

    def _end_transfer(self, end: End, now: float, actions: list[Action]) -> None:
        transfer = self._transfer
        assert transfer is not None
        self._transfer = None
        key = transfer.key
        duration_s = now - transfer.started_at
        committed = end.outcome is Outcome.COMMITTED
        reason = end.reason if end.reason is not Reason.NONE else transfer.reason
        self._move_phase(PhaseCause.TRANSFER_ENDED)
        if committed:
            self._settled_until = now + _ECHO_S
            self._owner, self._owner_lost, self._recover_until = key.to_station, False, None
            self._epoch += 1
            self._takeover_allowed = False
            self._zones.moved(now)
            self._retry_after.clear()
            if self._phase is not Phase.ON_LOAD:
                self._advance_route(key.to_station)
        else:
            pause_s = self._limits.denied_pause_s if end.reason in _OPERATORS_WORD else self._limits.retry_pause_s
            self._retry_after[key.to_station] = now + pause_s
            self._settled = None
        self._refresh(reason, actions)
        if committed:
            actions.append(Flush(key.from_station))
        text = (
            f"handover {key.handover_id} committed: {self.name(key.to_station)} commands, epoch {self._epoch}"
            if committed
            else f"handover {key.handover_id} aborted ({end.reason.name.lower()}): "
            f"{self.name(self._view.commander)} commands"
        )
        actions.append(
            Record("transfer_committed" if committed else "transfer_aborted", text, reason, key.to_station, duration_s)
        )
        result = HandoverResult(
            TransferKey(key.from_station, key.to_station, key.handover_id, self._epoch),
            self._view.commander,
            end.outcome,
            reason,
        )
        told = [station for station in (key.from_station, key.to_station) if not self._standard(station)]
        actions += self._results.announce(result, told, now)

    def _advance_route(self, station: int) -> None:
        if station in self._route[self._route_at :]:
            self._route_at = self._route.index(station, self._route_at)

    def _route_next(self) -> int | None:
        following = self._route_at + 1
        return self._route[following] if following < len(self._route) else None

    def _on_cancel(self, station: int, now: float, actions: list[Action]) -> None:
        if self._transfer is not None and station in (self._transfer.key.from_station, self._transfer.key.to_station):
            self._move_transfer(Cause.CANCELLED, now, actions)

    # ---- operator control (the MAVLink standard) --------------------------------------------------------------------

    def _on_control(self, request: ControlRequested, now: float, actions: list[Action]) -> None:
        if request.station not in self._presence:
            self.dropped["unknown station"] += 1
            return
        if request == self._settled and now < self._settled_until and request.station != self._view.commander:
            actions.append(ControlAnswer(request.station, ControlResult.ACCEPTED))
            return
        decision = judge_control(request, self._control_facts(request.for_station, now))
        if decision.effect in _CONSENTS:
            self._settled = request
            self._settled_until = now + _ECHO_S if decision.effect is Effect.RELEASE else -inf
        what = "requests" if request.request else "releases"
        answer = f"{self.name(request.station)} {what} control: {decision.result.name.lower()}"
        text = f"{answer} ({decision.text})" if decision.text else answer
        actions.append(Record("control", text, Reason.OPERATOR, request.station))
        actions.append(ControlAnswer(request.station, decision.result, decision.text))
        self._take_effect(decision.effect, request, now, actions)

    def _control_facts(self, station: int, now: float) -> ControlFacts:
        presence = self._presence.get(station)
        return ControlFacts(
            commander=self._view.commander,
            lost=self._owner_lost,
            recovering=self._recover_until is not None,
            grounded=self._grounded(now),
            waiting_for=None if self._transfer is None else self._transfer.key.to_station,
            takeover_allowed=self._takeover_allowed,
            known=presence is not None,
            unfit=None if presence is None else presence.unfit(self._digest, now),
            in_zone=self._zones.holds(station) or not self._zones.known,
        )

    def _take_effect(self, effect: Effect, request: ControlRequested, now: float, actions: list[Action]) -> None:
        if effect is Effect.SET_TAKEOVER:
            self._takeover_allowed = request.takeover
            self._refresh(Reason.OPERATOR, actions)
        elif effect is Effect.CONSENT:
            self._consent_beforehand(now, actions)
        elif effect is Effect.DENY:
            self._takeover_allowed = False
            self._refresh(Reason.OPERATOR, actions)
            self._end_by(Cause.DENIED, now, actions)
            self._end_by(Cause.CANCELLED, now, actions)  # it had agreed before: until the commit it may think again
        elif effect in (Effect.TRANSFER, Effect.TRANSFER_CONSENTED, Effect.FORCE):
            self._transfer_by_request(effect, request, now, actions)
        elif effect is Effect.GRANT:
            self._owner, self._owner_lost, self._released = request.station, False, False
            self._takeover_allowed = False
            self._epoch += 1
            text = f"{self.name(request.station)} commands, epoch {self._epoch}"
            actions.append(Record("authority", text, Reason.OPERATOR, request.station))
            self._refresh(Reason.OPERATOR, actions)
        elif effect is Effect.RELEASE:
            self._owner, self._released, self._takeover_allowed = None, True, False
            self._epoch += 1
            actions.append(Record("authority", "control released: nobody commands", Reason.OPERATOR, request.station))
            self._refresh(Reason.OPERATOR, actions)
        elif effect is Effect.OFFER:
            self._takeover_allowed = True
            self._refresh(Reason.OPERATOR, actions)
            if self._transfer is not None:
                self._consent_beforehand(now, actions)
                return
            partner = self._zones.best(self._usable(now, actions), self._route_next())
            if partner is not None:
                self._begin_transfer(partner, Reason.OPERATOR, now, actions, consented=True)

    def _consent_beforehand(self, now: float, actions: list[Action]) -> None:
        if self._transfer is not None:
            self._transfer.consented = True
            self._imply(now, actions)

    def _transfer_by_request(
        self, effect: Effect, request: ControlRequested, now: float, actions: list[Action]
    ) -> None:
        self._begin_transfer(
            request.for_station,
            Reason.OPERATOR,
            now,
            actions,
            consented=effect is Effect.TRANSFER_CONSENTED,
            forced=effect is Effect.FORCE,
            operator_timeout_s=_request_s(request.timeout_s),
        )

    # ---- the aircraft ---------------------------------------------------------------------------------------------

    def _on_position(self, event: PositionSeen, now: float, actions: list[Action]) -> None:
        self._position_at = now
        self._stale_told = False
        first = not self._zones.known
        change = self._zones.update(event.zones, now)
        if first and not self._interrupted:  # there the aircraft has been all along
            self._zones.forget_entries()
        for station in change.entered:
            actions.append(Record("zone_entered", f"zone of {self.name(station)} entered", station=station))
        for station in change.left:
            actions.append(Record("zone_left", f"zone of {self.name(station)} left", station=station))
        if self._transfer is not None and self._transfer.key.to_station in change.left:
            self._move_transfer(Cause.LEFT_REGION, now, actions)
        self._seek_transfer(now, actions)

    def _seek_transfer(self, now: float, actions: list[Action]) -> None:
        if self._owner is None or self._transfer is not None or not self._flying:
            return
        if now >= self._position_at + self._limits.position_stale_s:  # who holds the aircraft is not known any more
            return
        if self._owner_lost:
            self._seek_successor(now, actions)
        elif self._phase is Phase.ON_MISSION:
            usable = self._usable(now, actions)
            better = self._better(self._owner, usable, now)
            partner = self._zones.next_commander(self._owner, usable, self._route_next(), now, better)
            if partner is not None:
                reason = Reason.LINK_QUALITY if partner in better else Reason.ZONE
                self._begin_transfer(partner, reason, now, actions, consented=self._takeover_allowed)

    def _seek_successor(self, now: float, actions: list[Action]) -> None:
        """The commander is lost in flight: a station whose zone holds the aircraft may take it, without asking."""
        if self._recover_until is not None:  # after a restart its heartbeat may be on the way
            return
        partner = self._zones.best(self._usable(now, actions), self._route_next())
        if partner is not None:
            self._begin_transfer(partner, Reason.COMMANDER_LOST, now, actions, forced=True)

    def _better(self, owner: int, usable: Sequence[int], now: float) -> list[int]:
        """Stations whose links have long been good, while the commander's have been weak for a while: no ping-pong."""
        if now - self._weak.get(owner, inf) < self._limits.link_weak_s:
            return []
        steady_s = self._limits.link_steady_s
        return [
            station
            for station in usable
            if station not in self._weak and now - self._weak_until.get(station, -inf) >= steady_s
        ]

    def _usable(self, now: float, actions: list[Action]) -> Sequence[int]:
        """Stations whose zone holds the aircraft and that could take it; says once why another could not."""
        usable = []
        for station in self._zones.inside():
            presence = self._presence.get(station)
            if presence is None or station == self._owner or now < self._retry_after.get(station, -inf):
                continue
            why = presence.unfit(self._digest, now)
            if why is None:
                usable.append(station)
            elif why is not presence.told_why:
                text = f"{self.name(station)} cannot be partner: {why.name.lower().replace('_', ' ')}"
                actions.append(Record("partner_unfit", text, why, station))
            presence.told_why = why
        return usable

    def _on_autopilot(self, event: AutopilotState, now: float, actions: list[Action]) -> None:
        was_armed = self._armed
        self._autopilot_at = now
        self._armed = event.armed
        self._flying = event.armed and event.flying
        if not event.armed and self._phase is not Phase.ON_LOAD:
            self._end_by(Cause.CANCELLED, now, actions)
            self._move_phase(PhaseCause.DISARMED)
            self._takeover_allowed = False
            self._emergency = NOTHING_WRONG
            self._route_at = 0
            actions.append(Record("landed", "disarmed: the flight is over", Reason.LANDED))
            self._refresh(Reason.LANDED, actions)
        elif self._flying and self._phase is Phase.ON_LOAD and not self._starting:
            self._enter_mission(actions, "airborne")
        elif was_armed is not event.armed:
            self._refresh(Reason.NONE, actions)
        self._grant_parent(now, actions)

    def _end_by(self, cause: Cause, now: float, actions: list[Action]) -> None:
        if self._transfer is not None:
            self._move_transfer(cause, now, actions)

    def _enter_mission(self, actions: list[Action], how: str) -> None:
        self._move_phase(PhaseCause.STARTED)
        self._resume_transfer_phase()
        self._zones.forget_entries()
        actions.append(Record("started", f"on mission: {how}", Reason.STARTED, self._owner))
        self._refresh(Reason.STARTED, actions)

    def _on_guard(self, event: GuardSeen, now: float, actions: list[Action]) -> None:
        before = self.guard(now)
        self._guard_at = now
        self._guard_ours = event.ours
        self._guard = event.state
        if before is not event.state:
            actions.append(Record("guard", f"guard: {before.name.lower()} -> {event.state.name.lower()}"))

    def _on_mission(self, event: MissionLoaded, actions: list[Action]) -> None:
        self._digest = event.digest
        self._route = event.route
        self._route_at = 0
        if event.out_of_coverage is not None:
            self._limits = replace(self._limits, out_of_coverage=event.out_of_coverage)
        if event.digest:
            names = " ".join(self.name(station) for station in event.route)
            actions.append(Record("mission_loaded", f"mission loaded, commanders along the route: {names}"))
        else:
            actions.append(Record("mission_dropped", "the autopilot no longer holds the mission that was loaded"))
        self._refresh(Reason.NONE, actions)

    # ---- START ----------------------------------------------------------------------------------------------------

    def start_needs(self, station: int, now: float) -> tuple[str, ...]:
        """What START from this station still lacks, in words; empty when the aircraft may take off."""
        needs = []
        if self._view.commander != station:
            needs.append(f"{self.name(station)} does not command")
        if self._phase is not Phase.ON_LOAD or self._armed or self._starting:
            needs.append("the vehicle is already flying or starting")
        if not self._digest:
            needs.append("no mission loaded")
        if self._transfer is not None:
            needs.append("a handover is under way")
        if now - self._autopilot_at >= self._limits.autopilot_lost_s:
            needs.append("no autopilot")
        if self._limits.guard_required and not (self._guard_ours and self.guard(now) is GuardState.LIVE):
            needs.append("the guard does not answer the lease")
        if now - self._position_at >= self._limits.position_stale_s:
            needs.append("no position")
        elif not self._zones.holds(station):
            needs.append(f"outside the zone of {self.name(station)}")
        return tuple(needs)

    def _on_start(self, station: int, now: float, actions: list[Action]) -> None:
        needs = self.start_needs(station, now)
        if needs:
            actions.append(Record("start_refused", "START refused: " + ", ".join(needs), Reason.NOT_READY, station))
            actions.append(StartRefused(station, needs))
            return
        self._starting = True
        actions.append(Record("start", f"START from {self.name(station)}", station=station))
        actions.append(BeginStart(station))

    def _on_start_finished(self, event: StartFinished, actions: list[Action]) -> None:
        if not self._starting:
            return
        self._starting = False
        if event.ok:
            self._enter_mission(actions, "armed and in AUTO")
        else:
            actions.append(Record("start_failed", f"START failed: {event.text}", Reason.NOT_READY, self._owner))

    # ---- time -----------------------------------------------------------------------------------------------------

    def _expire(self, now: float, actions: list[Action]) -> None:
        # the partner first: from here on nothing commits to a station that is lost itself
        if self._transfer is not None and not self._presence[self._transfer.key.to_station].alive(now):
            self._move_transfer(Cause.PARTNER_LOST, now, actions)
        if self._owner is not None and not self._owner_lost and not self._presence[self._owner].alive(now):
            self._lose_owner(self._owner, now, actions)
        if self._transfer is not None and now >= self._transfer.timeout_at:
            self._move_transfer(Cause.TIMEOUT, now, actions)
        if self._recover_until is not None and now >= self._recover_until and self._owner is not None:
            self._recover_until = None
            text = f"{self.name(self._owner)} has not come back after the restart: nobody commands"
            actions.append(Record("authority_lost", text, Reason.COMMANDER_LOST, self._owner))
            self._refresh(Reason.COMMANDER_LOST, actions)
            self._seek_transfer(now, actions)

    def _lose_owner(self, owner: int, now: float, actions: list[Action]) -> None:
        self._end_by(Cause.COMMANDER_LOST, now, actions)
        if self._owner != owner:  # the partner had confirmed and the commander consented: committed
            return
        self._owner_lost = True
        self._retry_after.clear()  # what was agreed or denied under it
        text = f"{self.name(owner)} is lost: nobody commands"
        actions.append(Record("authority_lost", text, Reason.COMMANDER_LOST, owner))
        self._refresh(Reason.COMMANDER_LOST, actions)
        self._imply(now, actions)
        self._retry_after.clear()  # a step that this commander left unanswered must not keep a ready partner waiting
        self._seek_transfer(now, actions)

    def _speak(self, now: float, actions: list[Action]) -> None:
        transfer = self._transfer
        if transfer is not None:
            due = transfer.due(now)
            if due is not None:
                actions.append(self._put(due[0], due[1], transfer, now))
        actions += self._results.due(now, self._names)

    def _put(self, station: int, message: Message, transfer: Transfer, now: float) -> Action:
        """To a station of the standard alone the question of consent is its command; nothing else is ever due to it."""
        if self._standard(station):
            return NotifyOwner(station, transfer.key.to_station, _request_s(transfer.timeout_at - now))
        return Send(station, message, transfer.attempt)

    def _judge_safety(self, now: float, actions: list[Action]) -> None:
        if self._flying and now >= self._position_at + self._limits.position_stale_s and not self._stale_told:
            self._stale_told = True
            actions.append(Record("position_stale", "no fresh position: no handover by zone", Reason.POSITION_STALE))
        out_since = self._zones.out_since
        changing = self._recover_until is not None or (self._transfer is not None and self._transfer.forced)
        # once the aircraft turns home for it, an attempt at another commander does not end the emergency: a commit does
        changing = changing and self._emergency.reason is not Reason.COMMANDER_LOST
        lost = (self._owner_lost and not changing) or (self._owner is None and self._flying)
        self._judged_at = now
        decision = decide(Situation(self._flying, lost, out_since, now), self._limits)
        if decision.reason is Reason.NONE and self._recover_until is not None:  # not known yet
            return
        # once for each emergency, and again where it turns worse: what was a warning on the ground takes off
        if decision.reason is self._emergency.reason and decision.action <= self._emergency.action:
            return
        self._emergency = decision
        if decision.reason is Reason.NONE:
            actions.append(Record("emergency_over", "the cause of the emergency is gone"))
            self._move_phase(PhaseCause.RECOVERED)
            self._resume_transfer_phase()
            self._refresh(Reason.NONE, actions)
            return
        if decision.action is not FlightAction.WARN:
            if decision.reason is Reason.OUT_OF_COVERAGE:  # a transfer from a lost commander goes on
                self._end_by(Cause.OUT_OF_COVERAGE, now, actions)
            self._starting = False
            if self._phase is Phase.ON_LOAD:
                self._enter_mission(actions, "airborne")
            self._move_phase(PhaseCause.EMERGENCY)
        what = decision.reason.name.lower().replace("_", " ")
        actions.append(Record("emergency", f"{what}: {decision.action.name.lower()}", decision.reason, self._owner))
        self._refresh(decision.reason, actions)
        if decision.action is not FlightAction.WARN:
            actions.append(Fly(decision.action, decision.reason))

    # ---- the view -------------------------------------------------------------------------------------------------

    def _move_phase(self, cause: PhaseCause) -> None:
        self._phase = PHASES.get((self._phase, cause), self._phase)

    def _resume_transfer_phase(self) -> None:
        """A transfer may have begun where it is no phase: on the ground, or while the aircraft was brought home."""
        if self._transfer is not None:
            self._move_phase(PhaseCause.TRANSFER_BEGUN)

    def _refresh(self, reason: Reason, actions: list[Action]) -> None:
        """Make the view of what holds now, and announce it if it differs."""
        commander = None if self._owner_lost else self._owner
        if commander is None:
            lease = LeaseState.LOST if self._recover_until is None else LeaseState.RECOVERING
        elif self._transfer is not None:
            lease = LeaseState.TRANSFER
        else:
            lease = LeaseState.HELD
        view = AuthorityView(
            phase=self._phase,
            commander=commander,
            partner=None if self._transfer is None else self._transfer.key.to_station,
            epoch=self._epoch,
            lease=lease,
            armed=bool(self._armed),
            handover_id=self._handover_id,
            takeover_allowed=self._takeover_allowed,
        )
        if view != self._view:
            self._view = view
            actions.append(ViewChanged(view, reason))
