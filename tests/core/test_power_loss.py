# SPDX-License-Identifier: GPL-3.0-or-later

"""The power fails in flight, and the state on the disk may be older than the last change of authority.

The stations remember. They are asked by CONNECT, and each answers here as a station's own rules do: it takes over what
it hears of a later epoch, or of a commander in the one that it knows.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product

import pytest

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.events import Action, Fly, Record, Send, StationHeard, StationMessage, ViewChanged
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, LeaseState
from mavproxy_handover.core.common.snapshot import Snapshot
from tests.core.bench import (
    DIGEST,
    NAMES,
    A,
    B,
    Bench,
    C,
    Connect,
    ConnectAck,
    D,
    DroneConnected,
    OnHandover,
    Phase,
    Reason,
    TransferKey,
    inside,
    outside,
)

#: GCSA commanded in epoch 4 by the disk, and what came after that the disk did not get
LEFT = Snapshot(A, 4, 7, Phase.ON_MISSION, 2, DIGEST, (A, B, A, B, A), proven=False)
WAITING = AuthorityView(Phase.ON_MISSION, None, None, 4, LeaseState.RECOVERING, True, 7)
#: above all that the disk may have missed
LATER = 1004
RETURN = Fly(FlightAction.RETURN, Reason.COMMANDER_LOST)

#: epoch and commander
Memory = tuple[int, int | None]


class Remembering(Bench):
    """Stations answer by what they remember; all of them are out of reach until `heard`."""

    def __init__(self, memory: dict[int, Memory], *, standard: tuple[int, ...] = (), snapshot: Snapshot = LEFT) -> None:
        super().__init__(standard=standard)
        self.memory = dict.fromkeys(NAMES, (0, None)) | memory
        self.alive = set()
        self.armed = self.flying = True
        self.facts = (inside(A), inside(B), outside(C), outside(D))
        self.restart(0.0, snapshot)

    def give(self, event: object) -> list[Action]:
        actions = super().give(event)  # type: ignore[arg-type]
        for action in actions:
            if isinstance(action, ViewChanged):
                self._tell_all()
        return actions

    def _surroundings(self) -> None:
        super()._surroundings()
        self._tell_all()

    def _tell_all(self) -> None:
        """AUTHORITY_STATUS, twice a second and on change."""
        view = self.arbiter.view
        for station in self.alive:
            self._tell(station, view.epoch, view.commander, over=view.lease is LeaseState.LOST)

    def _tell(self, station: int, epoch: int, commander: int | None, *, over: bool = False) -> None:
        """Within an epoch: nobody yet, somebody, nobody any more."""
        known_epoch, known = self.memory[station]
        if (epoch, 2 if over else commander is not None) > (known_epoch, known is not None):
            self.memory[station] = (epoch, commander)

    def ack(self, station: int, question: Connect) -> ConnectAck:
        self._tell(station, question.epoch, question.commander)
        epoch, commander = self.memory[station]
        return replace(super().ack(station, question), epoch=epoch, commander=commander)

    def heard(self, *stations: int) -> None:
        """These are in reach from now on, in this order."""
        for station in stations:
            self.alive.add(station)
            self.give(StationHeard(station))


def commander(bench: Bench) -> int | None:
    return bench.arbiter.view.commander


class TestTheOwnerOfTheFile:
    def test_is_nobody_at_first_in_the_old_epoch(self) -> None:
        """In a later one the question itself would be the answer."""
        assert Remembering({}).arbiter.view == WAITING

    def test_has_it_back_when_it_believes_in_itself_and_all_have_answered(self) -> None:
        bench = Remembering({A: (4, A), B: (4, A), C: (3, B)})
        bench.heard(A)
        assert commander(bench) is None
        bench.heard(B, C)
        assert commander(bench) is None, "GCSD may know better"
        bench.heard(D)
        assert bench.arbiter.view == AuthorityView(Phase.ON_MISSION, A, None, LATER, LeaseState.HELD, True, 7)
        assert bench.flights() == []

    def test_those_who_are_out_of_reach_are_waited_for_as_long_as_it_would_be_itself(self) -> None:
        bench = Remembering({A: (4, A)})
        begun_at = bench.now
        bench.heard(A)
        bench.run(10.0)
        (moved,) = bench.watch.moves
        assert moved == (begun_at + bench.limits.recovery_s, None, A, LATER)
        assert bench.flights() == []

    @pytest.mark.parametrize(
        "memory", [(0, None), (3, A), (4, None), (4, B), (5, B), (5, None), (9, C), (LATER, A), (0x80000000, A)]
    )
    def test_has_it_not_when_it_remembers_anything_else(self, memory: Memory) -> None:
        bench = Remembering({A: memory})
        bench.heard(A, B, C, D)
        bench.run(30.0)
        assert commander(bench) is None
        assert bench.flights() == [RETURN]

    @pytest.mark.parametrize("epoch", [5, 6, LATER - 1])
    def test_it_may_have_been_lost_and_have_come_back_since(self, epoch: int) -> None:
        bench = Remembering({A: (epoch, A), B: (epoch, A)})
        bench.heard(B, A, C, D)
        assert (commander(bench), bench.arbiter.view.epoch) == (A, LATER)

    def test_but_its_own_later_word_outdoes_nobodys(self) -> None:
        bench = Remembering({A: (9, A), B: (5, B)})
        bench.heard(A, B, C, D)
        bench.run(20.0)
        assert commander(bench) is None

    def test_a_heartbeat_shows_nothing(self) -> None:
        bench = Remembering({A: (4, A)})
        bench.deaf = {A}
        bench.heard(A, B, C, D)
        bench.run(30.0)
        assert commander(bench) is None
        assert bench.flights() == [RETURN]

    def test_nor_does_a_later_answer_mend_the_first(self) -> None:
        bench = Remembering({A: (4, None)})
        bench.heard(A, B, C, D)
        bench.memory[A] = (4, A)
        bench.run(30.0)
        assert commander(bench) is None

    def test_one_without_our_module_cannot_show_anything(self) -> None:
        bench = Remembering({A: (4, A)}, standard=(A,))
        bench.heard(A, B, C, D)
        bench.run(30.0)
        assert commander(bench) is None
        assert bench.flights() == [RETURN]

    def test_others_without_our_module_are_not_waited_for(self) -> None:
        bench = Remembering({A: (4, A)}, standard=(B, C, D))
        bench.heard(A)
        assert commander(bench) == A

    def test_may_show_it_after_the_time_to_come_back(self) -> None:
        bench = Remembering({A: (4, A)})
        bench.alive = {B}
        bench.run(12.0)
        assert bench.flights() == [RETURN]
        assert bench.records("authority_lost")[0].text == (
            "GCSA has not come back after the restart: no station commands"
        )
        bench.heard(A)
        assert (commander(bench), bench.arbiter.view.epoch) == (A, LATER)

    def test_nobody_succeeds_it_before_it_has_shown_that_it_had_it(self) -> None:
        bench = Remembering({})
        bench.alive = {B}
        bench.run(20.0)
        assert bench.sent() == []
        assert bench.arbiter.view.partner is None


class TestWhoKnowsBetter:
    @pytest.mark.parametrize("order", list(permutations((A, B))), ids=str)
    @pytest.mark.parametrize("memory", [(5, B), (5, None), (4, B), (9, C)], ids=str)
    def test_ends_the_claim_whoever_answers_first(self, order: tuple[int, int], memory: Memory) -> None:
        """GCSB has had it since, and GCSA has not heard of that."""
        bench = Remembering({A: (4, A), B: memory})
        bench.heard(*order)
        assert bench.arbiter.view == replace(WAITING, epoch=memory[0], lease=LeaseState.LOST)
        bench.heard(C, D)
        bench.run(20.0)
        assert commander(bench) is None
        assert bench.flights() == [RETURN]
        assert bench.records("authority_lost")[0] == Record(
            "authority_lost",
            f"GCSB remembers {bench.arbiter.name(memory[1])} in epoch {memory[0]}: no station commands",
            Reason.RESTARTED,
            B,
        )

    def test_gains_nothing_by_it(self) -> None:
        bench = Remembering({A: (4, A)})
        for station in (B, C):
            bench.memory[station] = (6, station)
            bench.heard(station)
            for number in (7, 8):
                for epoch in (4, 5, 6):
                    key = TransferKey(A, station, number, epoch)
                    words: list[Message] = [OnHandover(key), DroneConnected(key)]
                    for word in words:
                        bench.say(station, word)
            bench.give(bench.request(station, takeover=True))
        bench.run(20.0)
        assert bench.watch.moves == []

    def test_what_nobody_can_remember_is_not_believed(self) -> None:
        bench = Remembering({A: (4, A), B: (0x80000000, B)})
        bench.heard(B, A, C, D)
        assert commander(bench) == A

    @pytest.mark.parametrize("epoch", [1004, 0x7FFFFFFE, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF])
    def test_nor_what_no_disk_can_have_missed(self, epoch: int) -> None:
        # one damaged answer ended the claim of a healthy commander, and put the epoch near its end
        bench = Remembering({A: (4, A), B: (epoch, B)})
        bench.heard(B, A, C, D)
        assert commander(bench) == A
        assert bench.arbiter.view.epoch == LATER
        told = [record.text for record in bench.records("epoch_not_believed")]
        assert told == [f"GCSB says epoch {epoch}: no memory of this flight, not believed"]

    def test_a_thousand_changes_less_one_are_believed(self) -> None:
        bench = Remembering({A: (4, A), B: (1003, B)})
        bench.heard(B, A, C, D)
        assert commander(bench) is None

    @pytest.mark.parametrize("epoch", [1004, 0x7FFFFFFF, 0xFFFFFFFF])
    def test_nor_does_the_commander_show_anything_by_it(self, epoch: int) -> None:
        bench = Remembering({A: (epoch, A)})
        bench.heard(A, B, C, D)
        bench.run(10.0)
        assert commander(bench) is None
        assert bench.arbiter.view.epoch < 2000

    def test_once_the_claim_holds_a_late_one_is_outdone_and_nobody_doubts(self) -> None:
        """GCSB had it, was silent for all the time that a commander may be, and comes back."""
        bench = Remembering({A: (4, A), B: (6, B)})
        bench.heard(A)
        bench.run(6.0)
        assert (commander(bench), bench.arbiter.view.epoch) == (A, LATER)
        bench.heard(B)
        bench.run(1.0)
        assert (commander(bench), bench.arbiter.view.epoch) == (A, LATER)
        assert bench.memory[B] == (LATER, A)

    @pytest.mark.slow
    @pytest.mark.parametrize("missed", range(3))
    def test_never_two_who_believe_in_themselves_in_one_epoch(self, missed: int, pytestconfig: pytest.Config) -> None:
        """Every history that a disk may have missed, stations heard in every order, each in time or late.

        After two missed changes the owner of the state is heard first, second and last. GCSB and GCSC are alike in
        this, so only `--long` changes their order too.
        """
        orders = [*permutations((A, B, C))]
        if missed == 2 and not pytestconfig.getoption("--long"):
            orders = [(A, B, C), (B, A, C), (B, C, A)]
        histories = product((A, B, C), repeat=missed)
        # of two histories that leave the same memories, and of two orders that one late station makes the same, one
        distinct = dict.fromkeys(
            (self.memories((A, *history), ignorant), tuple(station for station in order if station != late), late)
            for history in histories
            for ignorant in (None, A, B, C)  # who heard of nothing but of its own
            for order in orders
            for late in (None, A, B, C)
        )
        for memories, order, late in distinct:
            self.check(dict(zip((A, B, C), memories, strict=True)), order, late)

    @staticmethod
    def memories(owners: tuple[int, ...], ignorant: int | None) -> tuple[Memory, ...]:
        """What GCSA, GCSB and GCSC remember of these owners, from epoch 4 on."""
        known = list(enumerate(owners, 4))
        return tuple(
            next((entry for entry in reversed(known) if entry[1] == station or station != ignorant), (0, None))
            for station in (A, B, C)
        )

    @staticmethod
    def check(memory: dict[int, Memory], order: tuple[int, ...], late: int | None) -> None:
        bench = Remembering(memory, standard=(D,))
        bench.heard(*order)
        bench.run(7.0)
        if late is not None:
            bench.heard(late)
        bench.run(3.0)
        view = bench.arbiter.view
        believers = [station for station, (_epoch, owner) in bench.memory.items() if owner == station]
        told = (memory, order, late, bench.memory, view)
        assert view.commander in (None, A), told
        assert believers == ([] if view.commander is None else [A]), told
        if late is None:
            assert (view.commander == A) is all(memory[station][1] in (None, A) for station in (A, B, C)), told


class TestAfterIt:
    def test_a_restart_before_anybody_has_shown_anything_proves_nothing(self) -> None:
        bench = Remembering({A: (5, B), B: (5, B)})
        bench.run(1.0)
        left = bench.arbiter.snapshot()
        assert left == replace(LEFT, out_of_coverage="return")
        bench.restart()
        bench.heard(A, B, C, D)
        assert commander(bench) is None

    def test_nor_after_the_time_to_come_back(self) -> None:
        bench = Remembering({A: (5, B)})
        bench.run(9.0)
        assert (bench.arbiter.snapshot().owner, bench.arbiter.snapshot().proven) == (A, False)

    def test_with_authority_it_is_proven_again(self) -> None:
        bench = Remembering({A: (4, A)})
        bench.heard(A, B, C, D)
        left = bench.arbiter.snapshot()
        assert (left.owner, left.epoch, left.proven) == (A, LATER, True)
        bench.restart()
        bench.give(StationHeard(A))
        assert (commander(bench), bench.arbiter.view.epoch) == (A, LATER + 1)

    def test_what_looked_wrong_around_it_counts_from_the_first_position_under_a_commander(self) -> None:
        """Not while no station commands, nor from before."""
        bench = Remembering({A: (4, A)})
        bench.limits, bench.facts = Limits(hold_off_s={Cause.NO_STATION: 0.0}), (outside(A), inside(B))
        bench.restart(0.0, LEFT)
        bench.run(2.4)
        bench.facts = None
        for _ in range(2):
            bench.run(0.3)
            assert bench.arbiter.causes == {Cause.COMMANDER_LOST}
        bench.position(outside(A), inside(B))
        bench.facts = None
        assert bench.arbiter.causes == {Cause.COMMANDER_LOST}
        bench.heard(A)
        assert (commander(bench), bench.arbiter.causes) == (A, frozenset())
        bench.position(outside(A), inside(B))
        assert bench.arbiter.causes == {Cause.NO_STATION}

    def test_and_when_the_claim_has_ended_nobody_is_on_record(self) -> None:
        bench = Remembering({B: (5, B)})
        bench.heard(B)
        left = bench.arbiter.snapshot()
        assert (left.owner, left.epoch, left.proven) == (None, 5, True)

    def test_a_handover_goes_on_from_there(self) -> None:
        bench = Remembering({A: (4, A)})
        bench.facts = (inside(A), outside(B), outside(C), outside(D))
        bench.heard(A, B, C, D)
        bench.run(6.0)
        bench.position(inside(A), inside(B), outside(C), outside(D))
        view = bench.arbiter.view
        assert (view.commander, view.partner, view.epoch, view.handover_id) == (A, B, LATER, 8)

    def test_on_the_ground_the_parent_has_it_above_all_that_is_remembered(self) -> None:
        bench = Remembering({A: (4, A), B: (6, B)})
        bench.autopilot_says(armed=False, flying=False)
        bench.heard(B, A)
        bench.run(1.0)
        assert (commander(bench), bench.arbiter.view.epoch) == (A, 7)

    @pytest.mark.parametrize("order", list(permutations((A, B))), ids=str)
    def test_after_a_flight_that_ended_on_the_ground_too(self, order: tuple[int, int]) -> None:
        ended = replace(LEFT, phase=Phase.ON_LOAD)
        bench = Remembering({A: (5, A), B: (6, B)}, snapshot=ended)
        bench.autopilot_says(armed=False, flying=False)
        bench.heard(*order)
        bench.run(1.0)
        assert (commander(bench), bench.arbiter.view.epoch) == (A, 7)

    def test_without_an_owner_nobody_has_it_in_flight_and_no_epoch_comes_twice(self) -> None:
        bench = Remembering({A: (9, A)}, snapshot=replace(LEFT, owner=None))
        bench.heard(A, B)
        bench.run(20.0)
        assert commander(bench) is None
        assert bench.flights() == [RETURN]
        assert bench.arbiter.view.epoch == 9
        bench.autopilot_says(armed=False, flying=False)
        bench.run(1.0)
        assert (commander(bench), bench.arbiter.view.epoch) == (A, 10)


def test_a_question_is_asked_in_the_old_epoch_until_somebody_has_authority() -> None:
    bench = Remembering({A: (4, A)})
    bench.run(3.0)
    asked = [a.message for _at, a in bench.log if isinstance(a, Send) and isinstance(a.message, Connect)]
    assert {(question.epoch, question.commander) for question in asked} == {(4, None)}


def test_an_answer_to_no_question_counts_for_nothing() -> None:
    bench = Remembering({})
    for nonce in (0, 1, 0xFFFFFFFF):
        bench.give(StationMessage(A, ConnectAck(A, 1, nonce, 4, A, "GCSA", DIGEST)))
    bench.run(20.0)
    assert commander(bench) is None
