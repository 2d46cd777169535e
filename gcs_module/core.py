# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of a ground station, and its sentences to the operator, without I/O: see `mavproxy_handover.core`.

Rules that live here
--------------------
* The vehicle decides which station commands. A station believes only the newest epoch that it has heard. Within an
  epoch the order is: no station commands yet (the vehicle has restarted and waits for its commander), a station
  commands, no station commands any more. No flight has an epoch above EPOCH_MAX: after such an epoch the station
  believes the vehicle's next message with an epoch up to EPOCH_MAX.
* A station only answers and never retransmits: the vehicle asks again, and the same question gets the same answer. Late
  messages of a transfer before the vehicle's latest one, or of an aborted one, are ignored.
* As partner the station answers HANDOVER_REQUEST with ON_HANDOVER, to the commander over the ground link and to the
  vehicle, and CONNECT_HANDOVER with DRONE_CONNECTED to both. Without a ground link to the commander it asks the
  vehicle to relay the answer.
* As commander the station answers ON_HANDOVER with OK_HANDOVER, and DRONE_CONNECTED with DISCONNECT_HANDOVER, the last
  only for a transfer that it has consented to. It believes what the vehicle relays. Over the ground link it accepts
  these messages only from the partner itself, while this station commands. The vehicle must have announced the transfer
  (AUTHORITY_STATUS, or a relayed message). So a message of a peer only speeds up what the vehicle does; it neither
  opens nor replaces a question. If it arrives just before the vehicle's message, it waits for that.
* A change of control is told in the words of a positive exchange of control, after the vehicle has confirmed it: "I
  have drone-1" at the station that has got it, "GCSB has drone-1" at the one that has given it. The vehicle's name is
  the one that it uses for itself.
* If the vehicle foresees the border at which it will ask, the operator may answer early (`ahead.py`). The answer stands
  at the border, until the operator changes it, an emergency begins, or another border comes first.
* Consent is automatic for the reasons that the configuration names (`automatic`). For all others the operator consents,
  and until then the answer is "waiting". The reason is what the vehicle has said; if it has said none, there is none.
  If the same question comes for a reason that needs no operator, it is answered by that.
* If the vehicle sends no message of ours, but has a manager of the MAVLink operator-control standard, that manager
  tells which station commands (`standard_control.py`).
* After an operator has asked for control, a transfer to this station needs no further question: for one minute, and for
  one transfer. Before the vehicle has answered the request, it counts only if the vehicle gives it as the reason. A
  refused request is no consent.

Events and actions are in `events`. Steps and messages: docs/architecture.md. Names and console lines follow section 4.5
of the thesis.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from math import ceil, inf
from typing import Any

from gcs_module.ahead import Ahead, EarlyConsent
from gcs_module.events import (
    AcknowledgeManager,
    Action,
    Answer,
    AskManager,
    AuthorityHeard,
    AutopilotHeard,
    ControlAsked,
    ControlStatusHeard,
    Event,
    FromPeer,
    FromVehicle,
    MissionHeld,
    Notice,
    PeerHeard,
    ToPeer,
    ToVehicle,
    VehicleHeard,
    Wish,
    WishAnswered,
)
from gcs_module.notices import notice
from gcs_module.standard_control import StandardControl
from mavproxy_handover.core.authority.cures import ended
from mavproxy_handover.core.authority.transfer_manager import READ_S
from mavproxy_handover.core.common.messages import (
    EPOCH_MAX,
    Connect,
    ConnectAck,
    ConnectHandover,
    CrossingKey,
    DisconnectHandover,
    DroneConnected,
    HandoverAhead,
    HandoverRequest,
    HandoverResult,
    Message,
    OkAhead,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.common.model import PROTOCOL_VERSION, QUESTIONS, Consent, Outcome, Phase, Reason, Station
from mavproxy_handover.core.common.never import assert_never

__all__ = [
    "AcknowledgeManager",
    "Action",
    "Answer",
    "AskManager",
    "AuthorityHeard",
    "AutopilotHeard",
    "ControlAsked",
    "ControlStatusHeard",
    "Event",
    "FromPeer",
    "FromVehicle",
    "MissionHeld",
    "Notice",
    "PeerHeard",
    "Role",
    "StationCore",
    "ToPeer",
    "ToVehicle",
    "VehicleHeard",
    "Wish",
    "WishAnswered",
]


class Role(Enum):
    """The station's role for the vehicle now."""

    COMMANDER = "commander"
    PARTNER = "partner"
    OBSERVER = "observer"


class _Stage(IntEnum):
    """How authority has developed within an epoch."""

    NOBODY_YET = 0
    COMMANDED = 1
    NOBODY_ANY_MORE = 2


@dataclass(slots=True)
class _Part:
    """The part of this station in the present transfer."""

    key: TransferKey
    as_partner: bool
    consent: Consent
    #: the number of the border that it was begun for, if the vehicle foresaw that border; else 0
    crossing: int
    #: DRONE_CONNECTED was sent (partner) or received (commander)
    connected: bool = False
    #: the partner has sent that it is ready
    ready: bool = False
    #: the vehicle asks because the commander is lost
    forced: bool = False
    #: the time left (s) that the operator was told last
    told_left_s: float = inf


def _about(why: Reason) -> str:
    """The reason of a question, in brackets, for people."""
    return f" ({QUESTIONS[why]})" if why in QUESTIONS else ""


class StationCore:
    """One station's view of one vehicle. Times are monotonic seconds; not safe for threads."""

    PEER_LOST_S = 3.0
    VEHICLE_LOST_S = 5.0
    #: a request for control counts for this long (s)
    WISH_S = 60.0
    #: a message of a peer waits this long (s) for the vehicle's
    TOO_SOON_S = 0.125
    #: the operator is told the time left when it falls below these values (s)
    LEFT_S = (10.0, 5.0)
    #: the operator is told that the commander's zone ends when ENDS_S are left; and again only after more than AGAIN_S
    #: were left
    ENDS_S, AGAIN_S = 15.0, 18.0

    def __init__(
        self, station: Station, vehicle_name: str, peers: tuple[Station, ...], *, automatic: Collection[str]
    ) -> None:
        """`automatic`: the reasons that need no operator's consent here, in the words of `model.QUESTIONS`."""
        self._station = station
        #: an operator is on duty, or none is required
        self.manned = True
        #: the operator on duty; "": none has signed on
        self.operator = ""
        #: the name that the vehicle uses for itself; before it has said one, the configured name
        self.vehicle_name = vehicle_name
        self._automatic = frozenset(automatic)
        self._names = {peer.sysid: peer.name for peer in peers} | {station.sysid: station.name}
        self._peers_heard = {peer.sysid: -inf for peer in peers}
        #: the peers whose ground link works
        self._peers_up: frozenset[int] = frozenset()
        self._vehicle_heard = -inf
        self._vehicle_lost = True
        #: the station whose zone holds the aircraft (the commander's first), and the commander whose zone is about to
        #: end
        self._zone: int | None = None
        self._zone_ending: int | None = None
        #: no station commands, because the mission declares a gap there
        self.alone = False
        #: the end of the time in which an operator may answer, here or at the other station
        self._answer_until = inf
        self._part: _Part | None = None
        self._early_consent = EarlyConsent(station.sysid)
        #: the autopilot's last heartbeat says that it is armed
        self._armed = False
        asks_nobody = QUESTIONS[Reason.REQUESTED] in self._automatic
        #: control by the MAVLink standard, if the vehicle's manager is not our companion
        self.control = StandardControl(station.sysid, self.name, lambda: self.vehicle_name, automatic=asks_nobody)
        #: when the operator's present question was first asked
        self.asked_at = -inf
        #: when a question last ended without an answer, and until when an answer may be meant for that question
        self._unanswered_at = -inf
        self._read_until = -inf
        #: until when this station's own request for control counts
        self._wished_until = -inf
        #: the vehicle has accepted that request, or is asking the commander
        self._wish_accepted = False
        #: the newest transfer in messages of the vehicle itself, and the one that it announces as under way
        self._latest: TransferKey | None = None
        self._announced: TransferKey | None = None
        #: the last transfer that the vehicle has aborted
        self._over: TransferKey | None = None
        #: a peer's message about a transfer that the vehicle has not named yet, and until when it counts
        self._too_soon: OnHandover | None = None
        self._too_soon_until = -inf
        #: the reason of the announced transfer, and the number of its border
        self._why, self._crossing = Reason.NONE, 0
        self.digest = b""
        self.vehicle_digest = b""
        self.epoch = 0
        self._stage = _Stage.NOBODY_YET
        self.commander: int | None = None
        self.partner: int | None = None
        self.phase = Phase.ON_LOAD

    # ---- what others may look at ----------------------------------------------------------------------------------

    @property
    def role(self) -> Role:
        """The role of this station for the vehicle, as far as it has heard."""
        if self.commander == self._station.sysid:
            return Role.COMMANDER
        return Role.PARTNER if self.partner == self._station.sysid else Role.OBSERVER

    @property
    def question(self) -> TransferKey | None:
        """The transfer that waits for the answer of this station's operator."""
        part = self._part
        return part.key if part is not None and part.consent is Consent.WAITING else None

    @property
    def ahead(self) -> Ahead | None:
        """The next foreseen border at which this station hands the aircraft over or takes it; None: none is known."""
        return self._early_consent.ahead

    @property
    def asked_ahead(self) -> CrossingKey | None:
        """The foreseen border about which this station's operator is asked early."""
        ahead = self._early_consent.ahead
        return None if ahead is None or not ahead.waits or self.question is not None else ahead.key

    @property
    def asked_to_take(self) -> tuple[int, ...] | None:
        """Identifies the open question to this operator whether the station takes the aircraft; None: there is none."""
        matter = self.open_question
        return matter if matter is not None and matter[1] == self._station.sysid else None

    @property
    def open_question(self) -> tuple[int, ...] | None:
        """Identifies the question to the operator, asked early or at the border; None: there is none."""
        part, ahead = self._part, self._early_consent.ahead
        if part is not None and part.consent is Consent.WAITING:
            key, number = part.key, (part.crossing, -1) if part.crossing else (0, part.key.handover_id)
            return key.from_station, key.to_station, key.epoch, *number
        if self.control.question is not None:
            asked = self.control.question
            return self._station.sysid, asked.requester, 0, 0, asked.number
        if ahead is None or not ahead.waits:
            return None
        return ahead.question

    def answer_left_s(self, now: float) -> float:
        """The time left (s) for an operator who is asked, here or at the other station.

        inf: none is asked, as far as is known.
        """
        ahead = self._early_consent.ahead
        if self.partner is None and ahead is not None and ahead.waits:
            return ahead.at - now
        return self._answer_until - now

    def name(self, sysid: int | None) -> str:
        """A station's name, for people."""
        return "no station" if not sysid else self._names.get(sysid, f"station {sysid}")

    def zone_name(self, zone: int, other_zone: int) -> str:
        """The aircraft's zone, for people; the zones of two stations together are the handover zone."""
        if zone and other_zone:
            return f"Handover Zone ({self.name(zone)} and {self.name(other_zone)})"
        return self.name(zone) if zone else "none"

    def peer_alive(self, peer: int, now: float) -> bool:
        """Whether the ground link to another station works."""
        return now - self._peers_heard.get(peer, -inf) < self.PEER_LOST_S

    def peer_heard_at(self, peer: int) -> float:
        """When another station was last heard over the ground link; -inf if it never was."""
        return self._peers_heard.get(peer, -inf)

    def vehicle_silent_s(self, now: float) -> float:
        """The time (s) since the vehicle's companion was last heard; inf if it never was."""
        return now - self._vehicle_heard

    def vehicle_alive(self, now: float) -> bool:
        """Whether the vehicle's companion was heard within VEHICLE_LOST_S."""
        return self.vehicle_silent_s(now) < self.VEHICLE_LOST_S

    # ---- entry points ---------------------------------------------------------------------------------------------

    def handle(self, event: Event, now: float) -> list[Action]:
        """Handle one event at monotonic time `now` (s); returns the actions, in order."""
        actions: list[Action] = []
        before = self.open_question
        if now >= self._too_soon_until:
            self._too_soon = None
        self._dispatch(event, now, actions)
        if self.open_question != before:
            self._question_changed(before, isinstance(event, (Answer, Wish)), now)
        return actions

    def _question_changed(self, before: tuple[int, ...] | None, answered: bool, now: float) -> None:
        if before is not None and not answered:
            self._unanswered_at = now
        if self.open_question is not None:
            self.asked_at = now
            self._read_until = now + READ_S if now - self._unanswered_at < READ_S else -inf

    def _dispatch(self, event: Event, now: float, actions: list[Action]) -> None:
        match event:
            case FromVehicle():
                self._on_vehicle_heard(now, actions)
                self._on_vehicle(event.message, now, actions)
            case VehicleHeard():
                if not self.control.in_use:
                    self._on_vehicle_heard(now, actions)
            case ControlStatusHeard():
                self._on_control_status(event, now, actions)
            case ControlAsked():
                actions += self.control.on_asked(event, now)
                self._follow_control()
            case AutopilotHeard():
                self._armed = event.armed
                self._follow_control()
            case FromPeer():
                self._peers_heard[event.peer] = now
                self._on_peer(event.peer, event.message, now, actions)
            case PeerHeard():
                self._on_peer_heard(event.peer, now, actions)
            case AuthorityHeard():
                self._on_authority(event, now, actions)
            case MissionHeld():
                self.digest = event.digest
            case Wish():
                self._on_wish(event, now, actions)
            case WishAnswered():
                self._on_wish_answered(event, now)
            case Answer():
                self._on_answer(event.yes, now, actions)
            case _:
                assert_never(event)

    def tick(self, now: float) -> list[Action]:
        """Time has passed: returns notices about a vehicle or stations that are silent now, and the count-down."""
        actions: list[Action] = []
        if not self._vehicle_lost and not self.vehicle_alive(now):
            self._vehicle_lost = True
            lost = "manager_silent" if self.control.in_use else "vehicle_lost"
            actions.append(notice(lost, vehicle=self.vehicle_name))
        for peer in [peer for peer in self._peers_up if not self.peer_alive(peer, now)]:
            self._peers_up -= {peer}
            actions.append(notice("peer_down", station=self.name(peer)))
        if self._early_consent.expire(now):
            actions.append(notice("ahead_over"))
        self._count_down(now, actions)
        actions += self.control.tick(now, self.LEFT_S)
        self._follow_control()
        return actions

    def _asked(self) -> _Part | Ahead | None:
        """The question that waits for the operator: about a transfer first, else about the border ahead."""
        if self.question is not None:
            return self._part
        return self._early_consent.ahead if self._early_consent.waits else None

    def _count_down(self, now: float, actions: list[Action]) -> None:
        """Tell an operator who has not answered the time left, and what happens without an answer."""
        asked = self._asked()
        if asked is None:
            return
        left_s = self.answer_left_s(now)
        due = [at for at in self.LEFT_S if left_s <= at < asked.told_left_s]
        if due:
            asked.told_left_s = min(due)
            values: dict[str, Any] = {"left_s": ceil(max(0.0, left_s)), "stations": self._in_words(asked.key)}
            if isinstance(asked, Ahead):
                actions.append(notice("time_left_ahead", waits=True, **values))
            elif self.commander is None:
                actions.append(notice("time_left_no_commander", waits=True, **values))
            else:
                actions.append(notice("time_left", waits=True, commander=self.name(self.commander), **values))

    # ---- a manager of the standard --------------------------------------------------------------------------------

    def _on_control_status(self, event: ControlStatusHeard, now: float, actions: list[Action]) -> None:
        used = self.control.in_use
        of_manager, found = self.control.on_status(event, self._armed, now)
        if of_manager:
            self._vehicle_heard = now
            if self._vehicle_lost and used:
                actions.append(notice("manager_heard", vehicle=self.vehicle_name))
            self._vehicle_lost = False
        actions += found
        self._follow_control()

    def _follow_control(self) -> None:
        """While the standard is used, its manager names the commander. The standard knows no phases."""
        if self.control.in_use:
            self.phase = Phase.ON_MISSION if self._armed else Phase.ON_LOAD
            self.commander, self.partner = self.control.in_control, self.control.partner
            self._answer_until = self.control.answer_until

    # ---- the vehicle ----------------------------------------------------------------------------------------------

    def _on_vehicle_heard(self, now: float, actions: list[Action]) -> None:
        self._vehicle_heard = now
        if self._vehicle_lost:
            self._vehicle_lost = False
            actions.append(notice("vehicle_found", vehicle=self.vehicle_name))

    def _on_vehicle(self, message: Message, now: float, actions: list[Action]) -> None:
        match message:
            case Connect():
                self.control.ours()
                if message.name.isprintable() and message.name.strip():
                    self.vehicle_name = message.name.strip()
                self.vehicle_digest = message.mission_digest
                # without a commander CONNECT does not say whether a station has commanded yet: AUTHORITY_STATUS does
                self._update_authority(message.commander, message.epoch, actions, over=False)
                actions.append(ToVehicle(self._connect_ack(message.nonce)))
            case HandoverResult():
                self._on_result(message, actions)
            case HandoverAhead():
                self._on_ahead(message, now, actions)
            case HandoverRequest():
                self._on_request(message, now, actions)
            case ConnectHandover():
                self._on_connect_handover(message, now, actions)
            case OnHandover() | DroneConnected():
                self._as_commander(message, now, actions, of_vehicle=True)
            case ConnectAck() | OkAhead() | OkHandover() | DisconnectHandover():  # only stations send these
                pass
            case _:
                assert_never(message)

    def _connect_ack(self, nonce: int) -> ConnectAck:
        return ConnectAck(
            self._station.sysid,
            PROTOCOL_VERSION,
            nonce,
            self.epoch,
            self.commander,
            self._station.name,
            self.digest,
            manned=self.manned,
            operator=self.operator,
        )

    def _update_authority(self, commander: int | None, epoch: int, actions: list[Action], *, over: bool) -> None:
        """Accept the commander and epoch of a message of the vehicle, unless they are stale."""
        self._drop_invalid_epoch(epoch)
        nobody = _Stage.NOBODY_ANY_MORE if over else _Stage.NOBODY_YET
        stage = nobody if commander is None else _Stage.COMMANDED
        if (epoch, stage) <= (self.epoch, self._stage):
            return
        known = (commander, epoch) == (self.commander, self.epoch)
        before, self.commander, self.epoch, self._stage = self.role, commander, epoch, stage
        if known:
            return
        forced = self._part is not None and self._part.as_partner and self._part.forced
        self._wished_until = -inf  # the request was to another commander
        if self._part is not None and self._part.key.epoch < epoch:
            self._part = None  # the transfer is over, with any outcome, so its question is closed
        self._early_consent.end()
        values: dict[str, Any] = {"vehicle": self.vehicle_name, "epoch": epoch}
        if commander is None and self.alone:
            actions.append(notice("in_gap", **values))
        elif commander is None and over and self.phase is not Phase.ON_LOAD:
            actions.append(notice("no_commander", **values))
        elif self.role is before:
            actions.append(notice("commands", station=self.name(commander), **values))
        elif self.role is Role.COMMANDER:
            actions.append(notice("gained_forced" if forced else "gained", station=self._station.name, **values))
        elif commander is not None:
            actions.append(notice("passed_on", station=self.name(commander), **values))
        else:
            actions.append(notice("no_commander_now", **values))

    def _drop_invalid_epoch(self, epoch: int) -> None:
        """The vehicle sends `epoch`. If only the epoch known here is above EPOCH_MAX, start afresh."""
        if self.epoch > EPOCH_MAX >= epoch:
            self.epoch, self._stage = 0, _Stage.NOBODY_YET
            self._part = self._latest = self._announced = self._over = None

    def _on_authority(self, event: AuthorityHeard, now: float, actions: list[Action]) -> None:
        self.control.ours()
        self._drop_invalid_epoch(event.epoch)
        self._answer_until = now + event.answer_left_s
        self.alone = event.alone
        if event.phase is Phase.EMERGENCY and self._early_consent.end():
            actions.append(notice("ahead_emergency"))
        if event.phase is not self.phase:
            self.phase = event.phase
            phase = event.phase.name.replace("_", " ").lower()
            if event.phase is not Phase.EMERGENCY:  # the decision tells what is wrong and what is done
                actions.append(notice("phase", vehicle=self.vehicle_name, phase=phase))
        self._on_zone(event, actions)
        self.partner = event.partner
        self._announced = None
        if event.partner is not None:
            self._supersede(event.handover_id, event.epoch, actions)
            if event.commander is not None:
                self._announced = TransferKey(event.commander, event.partner, event.handover_id, event.epoch)
                self._why, self._crossing = event.why, event.crossing
        self._update_authority(event.commander, event.epoch, actions, over=not event.recovering)
        word, self._too_soon = self._too_soon, None
        if word is not None:
            self._on_peer(word.key.to_station, word, now, actions)

    def _on_zone(self, event: AuthorityHeard, actions: list[Action]) -> None:
        """Tell the operator that the commander's zone is about to end, or was left."""
        commander, flying = event.commander, event.phase is not Phase.ON_LOAD
        ending = flying and commander is not None and event.zone == commander and event.zone_ends_s <= self.ENDS_S
        if ending and self._zone_ending != commander:
            actions.append(notice("zone_ends", station=self.name(commander), left_s=event.zone_ends_s))
        if ending:
            self._zone_ending = commander
        elif event.zone != commander or event.zone_ends_s > self.AGAIN_S:
            self._zone_ending = None
        left = self._zone == commander and commander is not None and event.zone != commander
        if flying and left and commander == self.commander:
            values: dict[str, Any] = {"vehicle": self.vehicle_name, "station": self.name(commander)}
            there = "zone_left" if event.zone else "zones_left"
            actions.append(notice(there, other=self.name(event.zone), **values))
        self._zone = event.zone

    def _supersede(self, handover_id: int, epoch: int, actions: list[Action]) -> None:
        """The vehicle has begun another transfer: an earlier one and its question are over."""
        part = self._part
        if part is None or not part.key.before(replace(part.key, handover_id=handover_id, epoch=epoch)):
            return
        self._part = None
        if part.consent is Consent.WAITING:
            actions.append(notice("superseded", number=part.key.handover_id))

    def _on_result(self, message: HandoverResult, actions: list[Action]) -> None:
        key, aborted = message.key, message.outcome is Outcome.ABORTED
        if aborted:
            self._over = key
        if self._part is not None and self._part.key.handover_id == key.handover_id:
            self._part = None
            if aborted:
                why = ended(message.reason, self.name(key.from_station), self.name(key.to_station))
                actions.append(notice("aborted", number=key.handover_id, why=why))
        self.partner = None
        self._update_authority(message.commander, key.epoch, actions, over=True)
        actions.append(ToVehicle(self._connect_ack(0)))

    def _stale(self, key: TransferKey, *, of_vehicle: bool) -> bool:
        """Whether this transfer has an older epoch, is before the vehicle's latest one, or was aborted.

        Only a message of the vehicle makes a transfer the latest one: a peer could send any number.
        """
        later = any(latest is not None and key.before(latest) for latest in (self._latest, self._announced))
        if key.epoch < self.epoch or later or key == self._over:
            return True
        if of_vehicle:
            self._latest = key
        return False

    # ---- as partner -----------------------------------------------------------------------------------------------

    def _consent(
        self, key: TransferKey, why: Reason, crossing: int, now: float, *, as_partner: bool
    ) -> tuple[_Part, bool]:
        """The part of this station in a transfer, with its answer; and whether the answer is new."""
        part, automatic = self._part, QUESTIONS.get(why) in self._automatic
        if part is not None and part.key == key and part.as_partner is as_partner:
            if part.consent is Consent.WAITING and automatic:
                part.consent = Consent.GRANTED
                return part, True
            return part, False
        wished = as_partner and self._wants_control(now, requested=why is Reason.REQUESTED)
        if wished:
            self._wished_until = -inf
        said = self._early_consent.answer_for(key, why, crossing, as_partner=as_partner)
        consent = Consent.GRANTED if automatic or wished else Consent.WAITING
        self._part = part = _Part(key, as_partner, consent if said is None else said, crossing)
        self._early_consent.on_asked_at_border(key, crossing)
        return part, True

    def _announced_reason(self, key: TransferKey) -> tuple[Reason, int]:
        """The reason and the border of this transfer as the vehicle announces them to all stations."""
        return (self._why, self._crossing) if key == self._announced else (Reason.NONE, 0)

    def _on_ahead(self, message: HandoverAhead, now: float, actions: list[Action]) -> None:
        """The vehicle foresees a border: this station's operator may answer before the border is reached."""
        if self.phase is Phase.EMERGENCY or not self._early_consent.fits(message, self.epoch, self.commander):
            return
        key, partner = message.key, message.key.to_station == self._station.sysid
        agrees = QUESTIONS[Reason.ZONE] in self._automatic or (partner and self._wants_control(now))
        known = self._early_consent.ahead
        other = None if known is None or known.key != key else known.other
        new = self._early_consent.update(message, now, agrees=agrees)
        ahead = self._early_consent.ahead
        assert ahead is not None
        actions.append(ToVehicle(OkAhead(key, ahead.consent)))
        if new:
            name = ("ahead_to_take" if partner else "ahead_to_give") if ahead.waits else "ahead"
            values: dict[str, Any] = {
                "stations": self._in_words(key),
                "vehicle": self.vehicle_name,
                "in_s": message.in_s,
            }
            actions.append(notice(name, waits=ahead.consent is Consent.WAITING, **values))
        if ahead.other is Consent.DENIED and other is not Consent.DENIED:
            denies = self.name(key.from_station if partner else key.to_station)
            actions.append(notice("ahead_denied", station=denies, stations=self._in_words(key)))

    def _on_request(self, message: HandoverRequest, now: float, actions: list[Action]) -> None:
        key = message.key
        if key.to_station != self._station.sysid or self._stale(key, of_vehicle=True):
            return
        part, new = self._consent(key, message.reason, message.crossing, now, as_partner=True)
        part.forced = message.reason is Reason.COMMANDER_LOST
        consent = part.consent
        if new:
            waits = consent is Consent.WAITING
            stations = f"{self.name(key.from_station)} -> {self._station.name}"
            name = "to_take" if waits else "takes"
            actions.append(notice(name, waits=waits, why=_about(message.reason), stations=stations))
        self._send_readiness(key, consent, now, actions)

    def _in_words(self, key: TransferKey | CrossingKey) -> str:
        return f"{self.name(key.from_station)} -> {self.name(key.to_station)}"

    def _send_readiness(self, key: TransferKey, consent: Consent, now: float, actions: list[Action]) -> None:
        reason = Reason.OPERATOR if consent is Consent.DENIED else Reason.NONE
        ground = self.peer_alive(key.from_station, now)
        word = OnHandover(key, consent, reason, relay=not ground and consent is Consent.GRANTED)
        if ground and consent is Consent.GRANTED:
            actions.append(ToPeer(key.from_station, word))
        actions.append(ToVehicle(word))
        part = self._part
        if consent is Consent.GRANTED and part is not None and part.key == key and not part.ready:
            part.ready = True
            self._tell_commander_informed(part, f"ready to take {self.vehicle_name}", ground, actions)

    def _tell_commander_informed(self, part: _Part, what: str, ground: bool, actions: list[Action]) -> None:
        """Tell the operator how the commander is informed. A commander that is lost is not."""
        if not part.forced and self.commander == part.key.from_station:
            way = "over the ground link" if ground else "by the vehicle"
            actions.append(notice("commander_told", station=self.name(part.key.from_station), way=way, what=what))

    def _on_connect_handover(self, message: ConnectHandover, now: float, actions: list[Action]) -> None:
        key = message.key
        if key.to_station != self._station.sysid or self._stale(key, of_vehicle=True):
            return
        if (self._part is None or self._part.key != key) and key != self._announced:
            return  # the station does not know this transfer; AUTHORITY_STATUS brings the reason
        part, _new = self._consent(key, *self._announced_reason(key), now, as_partner=True)
        if part.consent is not Consent.GRANTED:
            self._send_readiness(key, part.consent, now, actions)
            return
        ground = self.peer_alive(key.from_station, now)
        word = DroneConnected(key, relay=not ground)
        if ground:
            actions.append(ToPeer(key.from_station, word))
        actions.append(ToVehicle(word))
        if not part.connected:
            part.connected = True
            actions.append(notice("set_up"))
            self._tell_commander_informed(part, "Drone Connected", ground, actions)

    # ---- as commander ---------------------------------------------------------------------------------------------

    def _on_peer_heard(self, peer: int, now: float, actions: list[Action]) -> None:
        was_up = peer in self._peers_up and self.peer_alive(peer, now)
        self._peers_heard[peer] = now
        if not was_up:
            self._peers_up |= {peer}
            actions.append(notice("peer_up", station=self.name(peer)))

    def _on_peer(self, peer: int, message: Message, now: float, actions: list[Action]) -> None:
        if not isinstance(message, (OnHandover, DroneConnected)) or message.key.to_station != peer:
            return
        if self.role is not Role.COMMANDER or message.key.epoch != self.epoch:
            return
        if message.key not in (self._announced, self._latest):
            if isinstance(message, OnHandover):  # this message may overtake the vehicle's AUTHORITY_STATUS
                self._too_soon, self._too_soon_until = message, now + self.TOO_SOON_S
            return
        if isinstance(message, OnHandover):
            reason, crossing = self._announced_reason(message.key)  # only the vehicle says these
            message = replace(message, reason=reason, crossing=crossing)
        self._as_commander(message, now, actions, of_vehicle=False)

    def _as_commander(
        self, message: OnHandover | DroneConnected, now: float, actions: list[Action], *, of_vehicle: bool
    ) -> None:
        key = message.key
        if key.from_station != self._station.sysid or self._stale(key, of_vehicle=of_vehicle):
            return
        if isinstance(message, DroneConnected):
            self._release(key, actions)
            return
        part, new = self._consent(key, message.reason, message.crossing, now, as_partner=False)
        consent = part.consent
        actions.append(ToVehicle(self._ok_handover(key, consent)))
        if not new:
            return
        station, why = self.name(key.to_station), _about(message.reason)
        if consent is Consent.GRANTED:
            actions.append(notice("gives", station=station, vehicle=self.vehicle_name, why=why))
            actions.append(notice("authorized"))
            return
        if consent is Consent.DENIED:
            actions.append(notice("denied_before"))
            return
        actions.append(notice("to_give", waits=True, station=station, vehicle=self.vehicle_name, why=why))

    def _release(self, key: TransferKey, actions: list[Action]) -> None:
        """The partner has connected: send DISCONNECT_HANDOVER if this station has consented."""
        part = self._part
        if part is None or part.as_partner or part.key != key or part.consent is not Consent.GRANTED:
            return
        actions.append(ToVehicle(DisconnectHandover(key)))
        if not part.connected:
            part.connected = True
            actions.append(notice("released", station=self.name(key.to_station)))

    @staticmethod
    def _ok_handover(key: TransferKey, consent: Consent) -> OkHandover:
        return OkHandover(key, consent, Reason.OPERATOR if consent is Consent.DENIED else Reason.NONE)

    # ---- the operator ---------------------------------------------------------------------------------------------

    def _on_wish(self, wish: Wish, now: float, actions: list[Action]) -> None:
        part, station = self._part, wish.station
        if self.control.in_use:
            self.control.request(wish.timeout_s, now)
            self._follow_control()
            return
        if part is not None and part.consent is Consent.WAITING and part.key.to_station == station:
            self._answer_transfer(part, True, now, actions)
            return
        ahead = self._early_consent.ahead
        if ahead is not None and ahead.waits and ahead.key.to_station == station:
            self._answer_ahead(ahead, True, actions)
            return
        if station == self._station.sysid:
            self._wished_until, self._wish_accepted = now + self.WISH_S, False

    def _on_wish_answered(self, answer: WishAnswered, now: float) -> None:
        if self.control.in_use:
            self.control.answered(answer)
            self._follow_control()
        if answer.station == self._station.sysid and now < self._wished_until:
            self._wish_accepted = answer.accepted
            if not answer.accepted:
                self._wished_until = -inf

    def _wants_control(self, now: float, *, requested: bool = False) -> bool:
        """Whether this station's own request for control counts. `requested`: the vehicle gives it as the reason."""
        return now < self._wished_until and (self._wish_accepted or requested)

    def _on_answer(self, yes: bool, now: float, actions: list[Action]) -> None:
        if self.question is None and self.control.question is not None:
            self._answer_control(self.control.question.requester, yes, now, actions)
            return
        asked = self._asked()
        if asked is None and not self._change_early_answer(yes, actions):
            actions.append(notice("no_question"))
        if asked is None:
            return
        if now < self._read_until:
            actions.append(notice("other_question", stations=self._in_words(asked.key)))
            return
        if isinstance(asked, Ahead):
            self._answer_ahead(asked, yes, actions)
        else:
            self._answer_transfer(asked, yes, now, actions)

    def _answer_control(self, requester: int, yes: bool, now: float, actions: list[Action]) -> None:
        """The operator's answer to another station's request by the standard."""
        if now < self._read_until:
            stations = f"{self._station.name} -> {self.name(requester)}"
            actions.append(notice("other_question", stations=stations))
            return
        self.control.answer(yes, now, actions)
        self._follow_control()

    def _change_early_answer(self, yes: bool, actions: list[Action]) -> bool:
        """Change the early answer for the border ahead; returns whether there was one to change."""
        ahead, consent = self._early_consent.ahead, Consent.GRANTED if yes else Consent.DENIED
        if ahead is None or self._part is not None or ahead.consent is consent:
            return False
        self._answer_ahead(ahead, yes, actions)
        return True

    def _answer_ahead(self, ahead: Ahead, yes: bool, actions: list[Action]) -> None:
        """Store and send the operator's answer to the question about the border ahead."""
        ahead.consent = Consent.GRANTED if yes else Consent.DENIED
        answer, other = ("accepted", "deny") if yes else ("denied", "accept")
        actions.append(notice("ahead_answered", stations=self._in_words(ahead.key), answer=answer, other=other))
        actions.append(ToVehicle(OkAhead(ahead.key, ahead.consent)))

    def _answer_transfer(self, part: _Part, yes: bool, now: float, actions: list[Action]) -> None:
        """Store and send the operator's answer to the question of a transfer."""
        part.consent = Consent.GRANTED if yes else Consent.DENIED
        actions.append(notice("authorized" if yes else "denied"))
        if part.as_partner:
            self._send_readiness(part.key, part.consent, now, actions)
        else:
            actions.append(ToVehicle(self._ok_handover(part.key, part.consent)))
