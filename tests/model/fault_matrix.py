# SPDX-License-Identifier: GPL-3.0-or-later

"""One fault at one step of one transfer, in every combination, and how each ends.

    python tests/model/fault_matrix.py [--rows]

prints the table as Markdown, or row by row as `test_fault_matrix.py` has it. The aircraft enters GCSB's zone at 20 s
and leaves GCSA's at 40 s, with the limits of flight and 10 ms from anyone to anyone; GCSA commands at first. At the
first message of a step

* the message is *lost* (the first transmission, with its copy to the vehicle), *doubled* (every transmission arrives
  twice), *late* (every transmission of this transfer takes 6 s, longer than the step may), or *reordered* (the first
  transmission waits until another message to the same receiver has arrived, at most 1 s), and, as soon as it is sent,
* nobody, the partner, the commander or the vehicle's companion is killed. A station is started anew 0.5 s or 8 s later,
  knowing nothing; the companion 1 s later, from its state file.

Rules, clock and order are those of the real objects; nothing is left to chance.
"""

from __future__ import annotations

import heapq
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from itertools import count
from math import inf
from pathlib import Path

if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parents[2]))

from gcs_module import core as gcs
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common.events import (
    AutopilotState,
    Event,
    Fly,
    GuardSeen,
    MissionLoaded,
    PositionSeen,
    Record,
    Send,
    StartFinished,
    StartRequested,
    StationHeard,
    StationMessage,
    Tick,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import (
    ConnectHandover,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    HandoverResult,
    Message,
    OkHandover,
    OnHandover,
)
from mavproxy_handover.core.common.model import (
    AUTOMATIC,
    GuardState,
    LeaseState,
    Station,
    ZoneFact,
)

__all__ = ["FAULTS", "KILLS", "NAMES", "Fault", "Kill", "Outcome", "markdown", "rows", "run"]

A, B, VEHICLE = 251, 252, 1
STATIONS = (Station(A, "GCSA"), Station(B, "GCSB"))
DIGEST = b"mission"
DELAY_S = 0.01
LATE_S = 6.0
#: how long a message waits for another one to overtake it
OVERTAKE_S = 1.0
ENTERS_B_S, LEAVES_A_S, END_S = 20.0, 40.0, 50.0

STEPS: dict[type, int] = {
    HandoverRequest: 1,
    OnHandover: 2,
    OkHandover: 3,
    ConnectHandover: 4,
    DroneConnected: 5,
    DisconnectHandover: 6,
    HandoverResult: 7,
}
NAMES = {1: "REQUEST", 2: "ON", 3: "OK", 4: "CONNECT", 5: "CONNECTED", 6: "DISCONNECT", 7: "RESULT"}


class Fault(Enum):
    """What befalls the messages of the step."""

    LOST = "lost"
    DOUBLED = "doubled"
    LATE = "late"
    REORDERED = "reordered"


FAULTS = tuple(Fault)


@dataclass(frozen=True, slots=True)
class Kill:
    """Who is killed at the step, and after how long it starts anew."""

    name: str
    who: int | None
    down_s: float = 0.0


KILLS = (
    Kill("nobody", None),
    Kill("partner 0.5 s", B, 0.5),
    Kill("partner 8 s", B, 8.0),
    Kill("commander 0.5 s", A, 0.5),
    Kill("commander 8 s", A, 8.0),
    Kill("vehicle 1 s", VEHICLE, 1.0),
)


@dataclass(slots=True)
class Outcome:
    """How it ended. Times are seconds since the aircraft entered the region."""

    #: how each transfer ended
    transfers: list[str] = field(default_factory=list)
    #: from when GCSB commanded; None if it never did
    moved_s: float | None = None
    #: during which times nobody commanded
    nobody_s: list[tuple[float, float]] = field(default_factory=list)
    returned: bool = False
    end: str = ""

    def __str__(self) -> str:
        moved = "never moved" if self.moved_s is None else f"B after {self.moved_s:.2f} s"
        parts = [self.end, moved, ", ".join(self.transfers)]
        parts += [f"nobody {begin:.1f}-{end:.1f} s" for begin, end in self.nobody_s]
        return "; ".join(part for part in parts if part) + ("; RETURN" if self.returned else "")


def _due(arbiter: Arbiter) -> float:
    """When the arbiter wants its next tick; inf: it waits for nothing."""
    deadline = arbiter.next_deadline()
    return inf if deadline is None else deadline


class _Flight:
    """The vehicle, two stations and the links between them, in virtual time."""

    def __init__(self, step: int, fault: Fault, kill: Kill) -> None:
        self._step, self._fault, self._kill = step, fault, kill
        self._limits = Limits()
        self.now = 0.0
        self.outcome = Outcome()
        self._identity = Identity("drone", STATIONS, A, nonce=7)
        self.arbiter: Arbiter | None = Arbiter(self._identity, self._limits)
        self._saved = self.arbiter.snapshot()
        #: when the arbiter's next tick is due
        self._due = _due(self.arbiter)
        self.cores: dict[int, gcs.StationCore | None] = {station.sysid: self._new_core(station) for station in STATIONS}
        self._queue: list[tuple[float, int, Callable[[], None]]] = []
        self._number = count()
        self._struck: dict[tuple[int, int], int] = {}
        self._killed = False
        #: receiver -> what waits for another message to overtake it
        self._overtaken: dict[int, list[Callable[[], None]]] = {}
        self._nobody_since: float | None = None
        for sysid in (A, B):
            self._every(1.0, 0.001 * (sysid - A), lambda sysid=sysid: self._beat(sysid))  # type: ignore[misc]
        self._every(1.0, 0.5, self._vehicle_beats)
        self._every(0.5, 0.25, self._status)
        for second in range(int(ENTERS_B_S)):
            self._at(second, lambda: self.give(PositionSeen(self._facts())))
        self._every(0.1, ENTERS_B_S, lambda: self.give(PositionSeen(self._facts())))
        self._every(0.5, 0.2, lambda: self.give(AutopilotState(self.now >= 5.0, self.now >= 5.0)))
        self._every(0.5, 0.3, lambda: self.give(GuardSeen(GuardState.LIVE, ours=True)))
        self._at(2.0, lambda: self.give(MissionLoaded(DIGEST, (A, B))))
        self._at(4.0, lambda: self.give(StartRequested(A)))
        self._at(4.5, lambda: self.give(StartFinished(ok=True)))

    @staticmethod
    def _new_core(station: Station) -> gcs.StationCore:
        peers = tuple(other for other in STATIONS if other is not station)
        core = gcs.StationCore(station, "drone", peers, automatic=AUTOMATIC)
        core.handle(gcs.MissionHeld(DIGEST), 0.0)
        return core

    # ---- time -------------------------------------------------------------------------------------------------------

    def _at(self, when: float, job: Callable[[], None]) -> None:
        heapq.heappush(self._queue, (when, next(self._number), job))

    def _every(self, pause_s: float, first_s: float, job: Callable[[], None]) -> None:
        def again(times: int) -> None:
            job()
            self._at(first_s + (times + 1) * pause_s, lambda: again(times + 1))

        self._at(first_s, lambda: again(0))

    def run(self) -> Outcome:
        """Fly to the end."""
        while True:
            due = max(self._due, self.now)
            if self._queue[0][0] <= min(due, END_S):
                when, _number, job = heapq.heappop(self._queue)
                self.now = max(self.now, when)
                job()
            elif due <= END_S:
                self.now = due
                self.give(Tick())
            else:
                return self._ended()

    def _ended(self) -> Outcome:
        assert self.arbiter is not None
        view = self.arbiter.view
        believed = {core.commander for core in self.cores.values() if core is not None}
        epochs = {core.epoch for core in self.cores.values() if core is not None}
        agreed = "" if (believed, epochs) == ({view.commander}, {view.epoch}) else ", DISAGREEMENT"
        who = {A: "A", B: "B", None: "nobody"}[view.commander]
        self.outcome.end = f"{who} e{view.epoch} {view.phase.name}{agreed}"
        return self.outcome

    # ---- who speaks -------------------------------------------------------------------------------------------------

    def give(self, event: Event) -> None:
        """An event for the arbiter, if it runs."""
        if self.arbiter is None:
            return
        actions = self.arbiter.handle(event, self.now)
        self._due = _due(self.arbiter)
        for action in actions:
            if isinstance(action, Send):
                self._send(VEHICLE, action.station, action.message)
            elif isinstance(action, ViewChanged):
                self._saw(action)
            elif isinstance(action, Fly):
                self.outcome.returned = True
            elif isinstance(action, Record) and action.event in ("transfer_committed", "transfer_aborted"):
                # "handover 1 committed: ...", "handover 2 aborted (partner silent): ..."
                number, how = action.text.removeprefix("handover ").split(":")[0].split(" ", 1)
                cause = "" if action.event.endswith("aborted") else f" ({action.reason.name.lower()})"
                self.outcome.transfers.append(f"#{number} {how}{cause}")

    def _saw(self, change: ViewChanged) -> None:
        since = self.now - ENTERS_B_S
        if change.view.commander == B and self.outcome.moved_s is None:
            self.outcome.moved_s = since
        nobody = change.view.lease in (LeaseState.LOST, LeaseState.RECOVERING)
        if nobody and self._nobody_since is None and since > 0:
            self._nobody_since = since
        elif not nobody and self._nobody_since is not None:
            self.outcome.nobody_s.append((self._nobody_since, since))
            self._nobody_since = None
        self._status()

    def _status(self) -> None:
        if self.arbiter is None:
            return
        view = self.arbiter.view
        recovering = view.lease is LeaseState.RECOVERING
        who = view.commander, view.partner
        heard = gcs.AuthorityHeard(view.phase, *who, view.epoch, view.handover_id, recovering, view.why)
        for sysid in (A, B):
            self._at(self.now + DELAY_S, lambda sysid=sysid: self._hear(sysid, heard))  # type: ignore[misc]

    def _vehicle_beats(self) -> None:
        if self.arbiter is not None:
            for sysid in (A, B):
                self._at(self.now + DELAY_S, lambda sysid=sysid: self._hear(sysid, gcs.VehicleHeard()))  # type: ignore[misc]

    def _beat(self, sysid: int) -> None:
        core = self.cores[sysid]
        if core is not None:
            core.tick(self.now)
            other = A + B - sysid
            self._at(self.now + DELAY_S, lambda: self.give(StationHeard(sysid)))
            self._at(self.now + DELAY_S, lambda: self._hear(other, gcs.PeerHeard(sysid)))

    def _facts(self) -> tuple[ZoneFact, ...]:
        left_s = LEAVES_A_S - self.now
        return (
            ZoneFact(A, 50.0 if left_s > 0 else -50.0, left_s if left_s > 0 else None),
            ZoneFact(B, 50.0 if self.now >= ENTERS_B_S else -50.0, None),
        )

    def _hear(self, sysid: int, event: gcs.Event) -> None:
        core = self.cores[sysid]
        if core is None:
            return
        for action in core.handle(event, self.now):
            if isinstance(action, gcs.ToVehicle):
                self._send(sysid, VEHICLE, action.message)
            elif isinstance(action, gcs.ToPeer):
                self._send(sysid, action.peer, action.message)

    # ---- the links, and what befalls them --------------------------------------------------------------------------

    def _send(self, sender: int, receiver: int, message: Message) -> None:
        def arrive() -> None:
            if receiver == VEHICLE:
                self.give(StationMessage(sender, message))
            elif sender == VEHICLE:
                self._hear(receiver, gcs.FromVehicle(message))
            else:
                self._hear(receiver, gcs.FromPeer(sender, message))
            for waiting in self._overtaken.pop(receiver, []) if type(message) in STEPS else []:
                waiting()

        delays = [DELAY_S]
        first_transfer = type(message) in STEPS and message.key.handover_id == 1  # type: ignore[union-attr]
        if first_transfer and STEPS[type(message)] == self._step:
            times = self._struck[sender, receiver] = self._struck.get((sender, receiver), 0) + 1
            if self._fault is Fault.LOST and times == 1:
                delays = []
            elif self._fault is Fault.DOUBLED:
                delays = [DELAY_S, 2 * DELAY_S]
            elif self._fault is Fault.LATE:
                delays = [LATE_S]
            elif self._fault is Fault.REORDERED and times == 1:
                delays = []
                self._at(self.now + DELAY_S, lambda: self._hold(receiver, arrive))
            if not self._killed:
                self._killed = True
                self._at(self.now, self._strike)
        for delay_s in delays:
            self._at(self.now + delay_s, arrive)

    def _hold(self, receiver: int, arrive: Callable[[], None]) -> None:
        """It is there, and waits until another message has been faster; not for ever."""
        waiting = self._overtaken.setdefault(receiver, [])
        waiting.append(arrive)

        def at_last() -> None:
            if arrive in self._overtaken.get(receiver, []):
                self._overtaken[receiver].remove(arrive)
                arrive()

        self._at(self.now + OVERTAKE_S, at_last)

    def _strike(self) -> None:
        who = self._kill.who
        if who is None:
            return
        if who == VEHICLE:
            assert self.arbiter is not None
            self._saved = self.arbiter.snapshot()
            self.arbiter, self._due = None, inf
            if self._nobody_since is None:
                self._nobody_since = self.now - ENTERS_B_S
        else:
            self.cores[who] = None
        self._at(self.now + self._kill.down_s, lambda: self._revive(who))

    def _revive(self, who: int) -> None:
        if who == VEHICLE:
            self.arbiter = Arbiter(self._identity, self._limits, self._saved)
            self._due = _due(self.arbiter)
        else:
            self.cores[who] = self._new_core(STATIONS[who - A])


def run(step: int, fault: Fault, kill: Kill) -> Outcome:
    """How a flight with this fault ends."""
    return _Flight(step, fault, kill).run()


def rows() -> Iterator[str]:
    """All of it, one line for each combination."""
    for step in NAMES:
        for fault in FAULTS:
            for kill in KILLS:
                yield f"{step} {fault.value:9} | {kill.name:15} | {run(step, fault, kill)}"


def markdown() -> str:
    """All of it as a table: one row for each message and fault, one column for each kill."""
    lines = ["| step | message is | " + " | ".join(kill.name for kill in KILLS) + " |", "|" + "---|" * (len(KILLS) + 2)]
    for step, name in NAMES.items():
        for fault in FAULTS:
            cells = " | ".join(str(run(step, fault, kill)) for kill in KILLS)
            lines.append(f"| {step} {name} | {fault.value} | {cells} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print("\n".join(rows()) if sys.argv[1:] == ["--rows"] else markdown())
