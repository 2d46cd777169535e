# SPDX-License-Identifier: GPL-3.0-or-later

"""Who commands: owner, epoch, phase, and the view that is made of them.

Rules that live here
--------------------
* One owner. `commander` is the owner while it is heard, nobody after that.
* Whenever authority goes to a station, owner and epoch change in one step. It goes by a grant on the ground, by a
  commit, or back to the owner itself; and it ends by the owner's loss or release. Each is one method here, and whether
  it may happen is not asked: that is the caller's to know.
* After a restart the owner of before is lost until it is heard; the epoch has risen already, so its return raises it no
  more.
* Unless what the run before left is not proven to be its last word. Then the stations' memory decides. Nobody says a
  later epoch than the old one until somebody has authority, so that each first answer to CONNECT is what its station
  remembers of the time before. The owner has it back when it answers that it believes in itself, in that epoch or one
  after it, and everybody who can answer has, or the time to come back is over. Whoever remembers anybody else in that
  epoch, or anything else of one after it, ends its claim: then nobody has authority. No word gives anything to anybody
  but the owner, and its own outdoes nobody else's. It goes on in an epoch above all that may have been missed.
* A run that began without a state file may be behind what stations remember of earlier ones, and what is behind they do
  not believe. So it learns from their memory: from each station once, and then nobody can be ahead of it again.
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
        #: stations that may remember more than this run knows: they have not answered yet. A standard one never does
        self._may_be_ahead = {station.sysid for station in stations if not station.standard}
        self.owner: int | None = None
        #: who had authority by a state that is not proven; it has to show that it still has. And whether it did
        self.claimant: int | None = None
        self._shown = False
        #: the owner is not heard
        self.lost = False
        #: without a commander the aircraft flies on: it crosses a gap that its mission declares
        self.alone = False
        self._lost_at = -inf
        self.epoch = 0
        self.phase = Phase.ON_LOAD
        #: the attempt under way to move authority, and the number of the last one
        self.transfer: Transfer | None = None
        self.handover_id = 0
        #: a request for control is granted without asking the commander
        self.takeover_allowed = False
        #: the owner gave up control on the ground: nobody gets it without asking
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
        if restored.phase is not Phase.ON_LOAD:  # on the ground everything begins anew, but for the numbers
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
        """The station has authority as soon as it is heard: it is the owner, and nothing more is to be shown."""
        return self.lost and station == self.owner and self.claimant is None

    @property
    def waiting_for_start(self) -> bool:
        """On the ground, as far as is known: not armed, and no START is under way."""
        return self.phase is Phase.ON_LOAD and not self._flight.armed and not self.starting

    def grounded(self, now: float) -> bool:
        """On the ground to stay: the same, and the autopilot has said so just now."""
        return self.waiting_for_start and self._flight.disarmed(now)

    # ---- how it changes -------------------------------------------------------------------------------------------

    def await_owner(self, until: float) -> None:
        """The clock of a recovery starts, with the first event of the run; later nothing happens."""
        if self.recover_until == inf:
            self.recover_until = until

    def grant(self, station: int, reason: Reason, actions: list[Action]) -> None:
        """A station gets authority on the ground, where nobody has it."""
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
        """It is over. The view follows with the next `refresh`."""
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
        """The owner is not heard any more, or hears too little; `why`: what is said of it."""
        self.lost, self._lost_at = True, now
        text = f"{self.name(owner)} {why}: no station commands"
        actions.append(Record("authority_lost", text, Reason.COMMANDER_LOST, owner))
        self.refresh(Reason.COMMANDER_LOST, actions)

    def take_back(self, owner: int, actions: list[Action]) -> None:
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
        """The time in which the owner may come back after the restart is over."""
        if self._shown:
            self._believe(owner, actions)
            return
        self.recover_until, self._lost_at = None, now
        if self.claimant is not None:  # nobody is a successor of who may not have had it; it may still show that it had
            self.owner, self.lost = None, False
        text = f"{self.name(owner)} has not come back after the restart: no station commands"
        actions.append(Record("authority_lost", text, Reason.COMMANDER_LOST, owner))
        self.refresh(Reason.COMMANDER_LOST, actions)

    def learn(self, station: int, answer: ConnectAck, actions: list[Action]) -> None:
        """What a station remembers of epoch and commander, by its answer to CONNECT."""
        if self.claimant is None:
            self._learn_epoch(station, answer, actions)
        elif station in self._may_be_ahead:
            self._hear_of_claim(self.claimant, station, answer, actions)

    def _hear_of_claim(self, claimant: int, station: int, answer: ConnectAck, actions: list[Action]) -> None:
        """A station's first answer, while somebody has to show that it still has authority."""
        self._may_be_ahead.discard(station)
        if answer.epoch >= self.epoch + _UNSEEN:  # no disk can have missed as much: that is no memory of this flight
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
        """It has shown that it has authority since before the restart, and nobody knows better."""
        self.owner, self.claimant = claimant, None
        self.recover_until = None
        self.epoch += _UNSEEN - 1
        self.take_back(claimant, actions)

    def _learn_epoch(self, station: int, answer: ConnectAck, actions: list[Action]) -> None:
        """A station remembers a later epoch, or another commander of this one: nothing said here would be news to it.

        While somebody has authority, only a station's first answer counts: none can move the epoch at will.
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
        """It did, or gave up, or what was accepted does not count any more."""
        self.starting = False

    def land(self) -> None:
        """Disarmed: the flight is over. The view follows with the next `refresh`."""
        self._ground(PhaseCause.DISARMED)

    def end_rehearsal(self) -> None:
        """The aircraft is not carried any more. The view follows with the next `refresh`."""
        self._ground(PhaseCause.REHEARSAL_OVER)

    def _ground(self, cause: PhaseCause) -> None:
        self.move_phase(cause)
        self.takeover_allowed = self.alone = False
        if self._flight.armed is not False:  # a rehearsal has ended: whoever has to show something has to go on
            return
        if self.claimant is not None:  # on the ground nobody needs to show anything: the parent is there
            self.owner = self.claimant = self.recover_until = None
            self.lost = False

    def move_phase(self, cause: PhaseCause) -> None:
        """By the table of `phases.py`. The view follows with the next `refresh`."""
        self.phase = PHASES.get((self.phase, cause), self.phase)

    def resume_transfer_phase(self) -> None:
        """A transfer may have begun where it is no phase: on the ground, or while the aircraft was brought home."""
        if self.transfer is not None:
            self.move_phase(PhaseCause.TRANSFER_BEGUN)

    def refresh(self, reason: Reason, actions: list[Action]) -> None:
        """Make the view of what holds now, and announce it if it differs."""
        commander = None if self.lost else self.owner
        if commander is None:
            # what is brought home crosses no gap, not even while the order for that has to wait
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
