# SPDX-License-Identifier: GPL-3.0-or-later

"""Owner of authority, epoch, phase, and the view that is made of them.

Rules that live here
--------------------
* There is one owner. The owner is the commander while it is heard. Without a heard owner there is no commander.
* If authority goes to a station, owner and epoch change in one step. Authority goes by a grant on the ground, by a
  commit, or back to the owner. It ends when the owner is lost or releases it. Each is one method here. The caller
  decides whether it may happen.
* After a restart the owner of the run before is lost until it is heard (standard station) or answers CONNECT (station
  with our module). The epoch has risen already, so the owner's
  return does not raise it again.
* If the state of the run before is not proven to be the last one, the stations' memory decides:
  - Until a station has authority, the vehicle says no later epoch than the old one. So the first answer of each station
    to CONNECT is its memory of the time before.
  - The owner gets authority back when it answers that it is the commander, in that epoch or a later one. But first
    every station that can answer has to answer, or the time to come back has to be over.
  - A station that remembers another commander in that epoch, or something else of a later epoch, ends the owner's
    claim. Then no station has authority.
  - An answer gives authority only to the owner, and the owner's answer does not outweigh another station's.
  - The owner goes on in an epoch above all epochs that may have been missed.
* A run without a state file may have a lower epoch than the stations remember, and they would not believe it. So it
  learns the epoch from each station once. After that no station can be ahead of it.
* Every change ends in `refresh`, which makes the view and announces it if it differs.
"""

from __future__ import annotations

from collections.abc import Collection
from math import inf

from mavproxy_handover.core.authority.phases import PHASES, PhaseCause
from mavproxy_handover.core.authority.transfer import Transfer
from mavproxy_handover.core.common.events import Action, Record, ViewChanged
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.messages import EPOCH_MAX, ConnectAck
from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase, Reason, Station
from mavproxy_handover.core.common.snapshot import Snapshot

__all__ = ["Authority"]

#: more changes of authority than a disk can have missed
_UNSEEN = 1000


class Authority:
    """Authority over one vehicle. Times are monotonic seconds."""

    __slots__ = (
        "_flight",
        "_lost_at",
        "_may_be_ahead",
        "_shown",
        "alone",
        "claimant",
        "epoch",
        "handover_id",
        "lost",
        "names",
        "owner",
        "phase",
        "recover_until",
        "released",
        "starting",
        "takeover_allowed",
        "transfer",
        "view",
    )

    def __init__(self, stations: Collection[Station], flight: Flight) -> None:
        self.names = {station.sysid: station.name for station in stations}
        self._flight = flight
        #: stations that may remember more than this run knows, because they have not answered yet; standard ones never
        #: do
        self._may_be_ahead = {station.sysid for station in stations if not station.standard}
        self.owner: int | None = None
        #: the owner by a state that is not proven: it has to show that it still has authority; and whether it has shown
        #: it
        self.claimant: int | None = None
        self._shown = False
        #: the owner is not heard
        self.lost = False
        #: the aircraft flies on without a commander, through a gap that its mission declares
        self.alone = False
        self._lost_at = -inf
        self.epoch = 0
        self.phase = Phase.ON_LOAD
        #: the attempt under way to move authority, and the number of the last one
        self.transfer: Transfer | None = None
        self.handover_id = 0
        #: a request for control is granted without asking the commander
        self.takeover_allowed = False
        #: the owner gave up control on the ground: a station gets it only if it asks
        self.released = False
        #: START was accepted, and the edge is carrying it out
        self.starting = False
        #: until then the owner of the run before may come back; None in a run that began without one
        self.recover_until: float | None = None
        self.view = AuthorityView(armed=True)

    def restore(self, restored: Snapshot) -> None:
        """Take up what the run before left behind; no station commands until its owner answers."""
        self.epoch = restored.epoch + 1
        if restored.proven:
            self._may_be_ahead.clear()
        self.handover_id = restored.handover_id
        if restored.phase is not Phase.ON_LOAD:  # on the ground only the numbers are kept
            self.takeover_allowed = restored.takeover_allowed
            self.phase = Phase.ON_MISSION if restored.phase is Phase.ON_HANDOVER else restored.phase
            if restored.owner in self.names:
                self.owner, self.lost = restored.owner, True
                self.recover_until = inf  # the clock starts with the first event
                if not restored.proven:
                    self.claimant, self.epoch = restored.owner, restored.epoch
        self.refresh(Reason.RESTARTED, [])

    # ---- looking --------------------------------------------------------------------------------------------------

    def name(self, sysid: int | None) -> str:
        """A station's name, for people."""
        return "no station" if not sysid else self.names.get(sysid, f"station {sysid}")

    @property
    def recovering(self) -> bool:
        """The owner of the run before may still come back."""
        return self.recover_until is not None

    def waits_for(self, station: int) -> bool:
        """Whether the station has authority as soon as it is heard: an owner without anything more to show."""
        return self.lost and station == self.owner and self.claimant is None

    @property
    def waiting_for_start(self) -> bool:
        """On the ground, as far as is known: not armed, and no START is under way."""
        return self.phase is Phase.ON_LOAD and not self._flight.armed and not self.starting

    def grounded(self, now: float) -> bool:
        """Whether the aircraft stays on the ground: it waits for START, and the autopilot has just said disarmed."""
        return self.waiting_for_start and self._flight.disarmed(now)

    # ---- how it changes -------------------------------------------------------------------------------------------

    def await_owner(self, until: float) -> None:
        """The clock of a recovery starts, with the first event of the run; later nothing happens."""
        if self.recover_until == inf:
            self.recover_until = until

    def grant(self, station: int, reason: Reason, actions: list[Action]) -> None:
        """A station gets authority on the ground, where no station has it."""
        self.owner, self.lost, self.released, self.claimant = station, False, False, None
        self.takeover_allowed = False
        self.epoch += 1
        text = f"{self.name(station)} commands, epoch {self.epoch}"
        actions.append(Record("authority", text, reason, station))
        self.refresh(reason, actions)

    def release(self, actions: list[Action]) -> None:
        """The owner gives authority up on the ground."""
        owner = self.owner
        self.owner, self.released, self.takeover_allowed = None, True, False
        self.epoch += 1
        actions.append(Record("authority", "control released: no station commands", Reason.OPERATOR, owner))
        self.refresh(Reason.OPERATOR, actions)

    def number_transfer(self) -> int:
        """The number of the transfer that is about to begin."""
        self.handover_id = self.handover_id % 0xFFFF + 1
        return self.handover_id

    def begin_transfer(self, transfer: Transfer) -> None:
        """An attempt to move authority is under way. The view follows with the next `refresh`."""
        self.transfer = transfer
        self.move_phase(PhaseCause.TRANSFER_BEGUN)

    def end_transfer(self) -> None:
        """The transfer is over. The view follows with the next `refresh`."""
        self.transfer = None
        self.move_phase(PhaseCause.TRANSFER_ENDED)

    def commit(self, station: int) -> None:
        """A transfer moves authority. The view follows when its end is told."""
        self.owner, self.lost, self.recover_until = station, False, None
        self.epoch += 1
        self.takeover_allowed = False

    def fly_alone(self, allowed: bool) -> None:
        """Whether the aircraft flies on without a commander. The view follows with the next `refresh`."""
        self.alone = allowed

    def hurry_until(self, forced_timeout_s: float) -> float:
        """Until when a successor of a lost owner is awaited before the aircraft turns home; -inf if none is lost."""
        return self._lost_at + forced_timeout_s

    def lose(self, owner: int, now: float, actions: list[Action], *, why: str = "is lost") -> None:
        """The owner is not heard any more, or hears too little; `why`: in words."""
        self.lost, self._lost_at = True, now
        text = f"{self.name(owner)} {why}: no station commands"
        actions.append(Record("authority_lost", text, Reason.COMMANDER_LOST, owner))
        self.refresh(Reason.COMMANDER_LOST, actions)

    def restore_owner(self, owner: int, actions: list[Action]) -> None:
        """The owner has answered, or is heard again where it cannot answer."""
        self.lost = False
        if not self.recovering:
            self.epoch += 1
        how = "commands on after the restart" if self.recovering else "is back and commands again"
        self.recover_until = None
        text = f"{self.name(owner)} {how}, epoch {self.epoch}"
        actions.append(Record("authority", text, Reason.COMMANDER_RETURNED, owner))
        self.refresh(Reason.COMMANDER_RETURNED, actions)

    def wait_no_longer(self, owner: int, now: float, actions: list[Action]) -> None:
        """The time for the owner to come back after the restart is over."""
        if self._shown:
            self._believe(owner, actions)
            return
        self.recover_until, self._lost_at = None, now
        if self.claimant is not None:  # its authority is not proven, so it has no successor; it may still prove it
            self.owner, self.lost = None, False
        text = f"{self.name(owner)} has not come back after the restart: no station commands"
        actions.append(Record("authority_lost", text, Reason.COMMANDER_LOST, owner))
        self.refresh(Reason.COMMANDER_LOST, actions)

    def learn(self, station: int, answer: ConnectAck, actions: list[Action]) -> None:
        """A station's memory of epoch and commander, by its answer to CONNECT."""
        if self.claimant is None:
            self._learn_epoch(station, answer, actions)
        elif station in self._may_be_ahead:
            self._hear_of_claim(self.claimant, station, answer, actions)

    def _hear_of_claim(self, claimant: int, station: int, answer: ConnectAck, actions: list[Action]) -> None:
        """A station's first answer, while the claimant has to show that it still has authority."""
        self._may_be_ahead.discard(station)
        if answer.epoch >= self.epoch + _UNSEEN:  # no disk misses so many: this is no memory of this flight
            text = f"{self.name(station)} says epoch {answer.epoch}: no memory of this flight, not believed"
            actions.append(Record("epoch_not_believed", text, Reason.RESTARTED, station))
            return
        its = answer.commander == claimant and self.epoch <= answer.epoch
        if not its and (answer.epoch, answer.commander is not None) > (self.epoch, False):
            claims = f"{self.name(station)} remembers {self.name(answer.commander)} in epoch {answer.epoch}"
            text = f"{claims}: no station commands"
            actions.append(Record("authority_lost", text, Reason.RESTARTED, station))
            self.owner = self.claimant = self.recover_until = None
            self.lost, self.epoch = False, answer.epoch
            self.refresh(Reason.RESTARTED, actions)
            return
        if station == claimant:
            self._shown = its
        if self._shown and not (self.recovering and self._may_be_ahead):
            self._believe(claimant, actions)

    def _believe(self, claimant: int, actions: list[Action]) -> None:
        """The claimant has shown that it has authority, and no station contradicts."""
        self.owner, self.claimant = claimant, None
        self.recover_until = None
        self.epoch += _UNSEEN - 1
        self.restore_owner(claimant, actions)

    def _learn_epoch(self, station: int, answer: ConnectAck, actions: list[Action]) -> None:
        """Learn the epoch of a station that remembers a later one, or another commander in this one.

        Such a station would not believe the present epoch. While a station has authority, only the first answer of each
        station counts, so no station can move the epoch at will.
        """
        owned, first = self.owner is not None, station in self._may_be_ahead
        if owned and (not first or self.transfer is not None):  # a transfer ends in the epoch that it began in
            return
        self._may_be_ahead.discard(station)
        differs = owned and answer.epoch == self.epoch and answer.commander not in (None, self.owner)
        if (answer.epoch > self.epoch or differs) and answer.epoch <= EPOCH_MAX:
            text = f"{self.name(station)} remembers epoch {answer.epoch}: the state of an earlier run was lost"
            actions.append(Record("epoch_learnt", text, Reason.RESTARTED, station))
            self.epoch = answer.epoch + 1 if owned else answer.epoch
            self.refresh(Reason.RESTARTED, actions)

    def allow_takeover(self, allowed: bool, actions: list[Action]) -> None:
        """Whether a request for control needs no consent from now on."""
        self.takeover_allowed = allowed
        self.refresh(Reason.OPERATOR, actions)

    def start_begun(self) -> None:
        """START was accepted: the edge is carrying it out."""
        self.starting = True

    def start_over(self) -> None:
        """START is over: it succeeded, was given up, or does not count any more."""
        self.starting = False

    def land(self) -> None:
        """Disarmed: the flight is over. The view follows with the next `refresh`."""
        self._ground(PhaseCause.DISARMED)

    def end_rehearsal(self) -> None:
        """The aircraft is no longer carried in a rehearsal. The view follows with the next `refresh`."""
        self._ground(PhaseCause.REHEARSAL_OVER)

    def _ground(self, cause: PhaseCause) -> None:
        self.move_phase(cause)
        self.takeover_allowed = self.alone = False
        if self._flight.armed is not False:  # a rehearsal has ended: the claimant still has to show its authority
            return
        if self.claimant is not None:  # on the ground no claim is needed: the parent is there
            self.owner = self.claimant = self.recover_until = None
            self.lost = False

    def move_phase(self, cause: PhaseCause) -> None:
        """By the table of `phases.py`. The view follows with the next `refresh`."""
        self.phase = PHASES.get((self.phase, cause), self.phase)

    def resume_transfer_phase(self) -> None:
        """Show a transfer as phase that began on the ground or during an emergency, where it is no phase."""
        if self.transfer is not None:
            self.move_phase(PhaseCause.TRANSFER_BEGUN)

    def refresh(self, reason: Reason, actions: list[Action]) -> None:
        """Make the present view, and announce it if it differs."""
        commander = None if self.lost else self.owner
        if commander is None:
            # an aircraft that is brought home crosses no gap, not even while that order has to wait
            crosses = self.alone and self.lost and self.phase is not Phase.EMERGENCY
            alone = LeaseState.ALONE if crosses else LeaseState.LOST
            lease = LeaseState.RECOVERING if self.recovering else alone
        elif self.transfer is not None:
            lease = LeaseState.TRANSFER
        else:
            lease = LeaseState.HELD
        view = AuthorityView(
            phase=self.phase,
            commander=commander,
            partner=None if self.transfer is None else self.transfer.key.to_station,
            epoch=self.epoch,
            lease=lease,
            armed=self._flight.armed is not False or self._flight.rehearsing,
            handover_id=self.handover_id,
            takeover_allowed=self.takeover_allowed,
            why=Reason.NONE if self.transfer is None else self.transfer.reason,
            crossing=0 if self.transfer is None else self.transfer.crossing,
            rehearsal=self._flight.rehearsing,
        )
        if view != self.view:
            self.view = view
            actions.append(ViewChanged(view, reason))
