# SPDX-License-Identifier: GPL-3.0-or-later

"""Owner, epoch and phase by themselves: each way in which they change, and the view that is made of them."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.phases import PhaseCause
from mavproxy_handover.core.authority.transfer import Transfer
from mavproxy_handover.core.common.events import Action, AutopilotState, Record, ViewChanged
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import ConnectAck, TransferKey
from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase, Reason, Station
from mavproxy_handover.core.common.snapshot import Snapshot

A, B, C = 251, 252, 253
NOW = 100.0
STATIONS = (Station(A, "GCSA"), Station(B, "GCSB"), Station(C, "GCSC", standard=True))
LEFT = Snapshot(A, 4, 7, Phase.ON_MISSION, 2, b"", (A, B), takeover_allowed=True)
UNPROVEN = replace(LEFT, proven=False)


class Bench:
    """Authority over a vehicle, and what it has asked for so far."""

    def __init__(self, restored: Snapshot | None = None, *, armed: bool | None = False) -> None:
        self.flight = Flight(Limits())
        if armed is not None:
            self.says(armed=armed)
        self.authority = Authority(STATIONS, self.flight)
        if restored is not None:
            self.authority.restore(restored)
        self.actions: list[Action] = []

    def says(self, *, armed: bool, now: float = NOW) -> None:
        self.flight.autopilot_said(AutopilotState(armed, armed), now)

    def granted(self) -> Bench:
        self.authority.grant(A, Reason.PARENT_CONNECTED, self.actions)
        self.actions.clear()
        return self

    def transfer(self) -> None:
        key = TransferKey(A, B, self.authority.number_transfer(), self.authority.epoch)
        self.authority.begin_transfer(Transfer(key, Reason.ZONE, Limits(), NOW, crossing=3))
        self.authority.refresh(Reason.ZONE, self.actions)

    def remembers(self, station: int, epoch: int, commander: int | None) -> None:
        answer = ConnectAck(station, 1, 1, epoch, commander, "", b"")
        self.authority.learn(station, answer, self.actions)

    def view(self) -> AuthorityView:
        self.authority.refresh(Reason.NONE, self.actions)
        return self.authority.view

    def texts(self) -> list[str]:
        return [action.text for action in self.actions if isinstance(action, Record)]

    def has(self) -> tuple[int | None, bool, int]:
        """Owner, whether it is lost, epoch."""
        return self.authority.owner, self.authority.lost, self.authority.epoch


class TestGround:
    def test_before_anything_no_station_commands(self) -> None:
        bench = Bench()
        assert bench.has() == (None, False, 0)
        assert bench.authority.name(None) == "no station"
        assert (bench.authority.name(A), bench.authority.name(77)) == ("GCSA", "station 77")
        assert not bench.authority.recovering

    def test_a_grant_raises_the_epoch_and_allows_no_takeover(self) -> None:
        bench = Bench()
        bench.authority.lost = bench.authority.released = bench.authority.takeover_allowed = True
        bench.authority.claimant = B
        bench.authority.grant(A, Reason.PARENT_CONNECTED, bench.actions)
        authority = bench.authority
        assert bench.has() == (A, False, 1)
        assert (authority.released, authority.takeover_allowed, authority.claimant) == (False, False, None)
        assert bench.actions == [
            Record("authority", "GCSA commands, epoch 1", Reason.PARENT_CONNECTED, A),
            ViewChanged(authority.view, Reason.PARENT_CONNECTED),
        ]
        assert (authority.view.commander, authority.view.lease) == (A, LeaseState.HELD)

    def test_a_release_leaves_no_station_in_command(self) -> None:
        bench = Bench().granted()
        bench.authority.takeover_allowed = True
        bench.authority.release(bench.actions)
        assert bench.has() == (None, False, 2)
        assert (bench.authority.released, bench.authority.takeover_allowed) == (True, False)
        assert bench.texts() == ["control released: no station commands"]
        assert (bench.authority.view.commander, bench.authority.view.lease) == (None, LeaseState.LOST)

    def test_it_waits_for_start_on_the_ground_disarmed(self) -> None:
        bench = Bench()
        assert (bench.authority.waiting_for_start, bench.authority.grounded(NOW)) == (True, True)
        assert not bench.authority.grounded(NOW + 3.0)
        bench.authority.start_begun()
        assert (bench.authority.starting, bench.authority.waiting_for_start, bench.authority.grounded(NOW)) == (
            True,
            False,
            False,
        )
        bench.authority.start_over()
        assert bench.authority.waiting_for_start
        bench.says(armed=True)
        assert not bench.authority.waiting_for_start
        bench.says(armed=False)
        bench.authority.move_phase(PhaseCause.STARTED)
        assert not bench.authority.waiting_for_start

    def test_takeover_is_announced(self) -> None:
        bench = Bench().granted()
        bench.authority.allow_takeover(True, bench.actions)
        assert bench.authority.view.takeover_allowed
        assert bench.actions == [ViewChanged(bench.authority.view, Reason.OPERATOR)]


class TestTransfers:
    def test_they_are_numbered_from_one_to_the_largest_number_and_again(self) -> None:
        authority = Bench().authority
        assert [authority.number_transfer(), authority.number_transfer()] == [1, 2]
        authority.handover_id = 0xFFFF
        assert authority.number_transfer() == 1

    def test_in_flight_a_transfer_is_a_phase_and_a_lease_of_its_own(self) -> None:
        bench = Bench(armed=True).granted()
        bench.authority.move_phase(PhaseCause.STARTED)
        bench.transfer()
        view = bench.authority.view
        assert (view.phase, view.lease, view.commander, view.partner) == (
            Phase.ON_HANDOVER,
            LeaseState.TRANSFER,
            A,
            B,
        )
        assert (view.handover_id, view.why, view.crossing) == (1, Reason.ZONE, 3)
        bench.authority.end_transfer()
        view = bench.view()
        assert (view.phase, view.lease, view.partner, view.why, view.crossing) == (
            Phase.ON_MISSION,
            LeaseState.HELD,
            None,
            Reason.NONE,
            0,
        )

    def test_a_transfer_that_began_on_the_ground_is_a_phase_after_take_off(self) -> None:
        bench = Bench().granted()
        bench.authority.resume_transfer_phase()
        bench.transfer()
        assert bench.authority.phase is Phase.ON_LOAD
        bench.authority.move_phase(PhaseCause.STARTED)
        bench.authority.resume_transfer_phase()
        assert bench.authority.phase is Phase.ON_HANDOVER
        bench.authority.end_transfer()
        bench.authority.resume_transfer_phase()
        assert bench.authority.phase is Phase.ON_MISSION

    def test_a_commit_moves_owner_and_epoch(self) -> None:
        bench = Bench().granted()
        bench.authority.lost = bench.authority.takeover_allowed = True
        bench.authority.recover_until = 7.0
        bench.authority.commit(B)
        assert bench.has() == (B, False, 2)
        assert (bench.authority.takeover_allowed, bench.authority.recovering) == (False, False)


class TestLoss:
    def test_without_a_heard_owner_no_station_commands(self) -> None:
        bench = Bench(armed=True).granted()
        bench.authority.lose(A, NOW, bench.actions)
        assert bench.has() == (A, True, 1)
        assert bench.texts() == ["GCSA is lost: no station commands"]
        assert (bench.authority.view.commander, bench.authority.view.lease) == (None, LeaseState.LOST)
        assert bench.authority.hurry_until(2.0) == NOW + 2.0
        assert Bench().authority.hurry_until(2.0) == -inf

    def test_it_has_authority_again_when_it_is_heard(self) -> None:
        bench = Bench(armed=True).granted()
        bench.authority.lose(A, NOW, bench.actions, why="hears little")
        assert bench.texts() == ["GCSA hears little: no station commands"]
        assert [bench.authority.waits_for(station) for station in (A, B)] == [True, False]
        bench.actions.clear()
        bench.authority.restore_owner(A, bench.actions)
        assert bench.has() == (A, False, 2)
        assert bench.texts() == ["GCSA is back and commands again, epoch 2"]
        assert bench.authority.view.commander == A
        assert not bench.authority.waits_for(A)

    @pytest.mark.parametrize(
        ("alone", "phase", "lease"),
        [
            (True, Phase.ON_MISSION, LeaseState.ALONE),
            (False, Phase.ON_MISSION, LeaseState.LOST),
            (True, Phase.EMERGENCY, LeaseState.LOST),
        ],
    )
    def test_through_a_gap_it_flies_alone_unless_it_is_brought_home(
        self, alone: bool, phase: Phase, lease: LeaseState
    ) -> None:
        bench = Bench(armed=True).granted()
        bench.authority.phase = phase
        bench.authority.fly_alone(alone)
        assert bench.view().lease is LeaseState.HELD
        bench.authority.lose(A, NOW, bench.actions)
        assert bench.authority.view.lease is lease

    def test_without_an_owner_it_does_not_fly_alone(self) -> None:
        bench = Bench(armed=True)
        bench.authority.fly_alone(True)
        assert bench.view().lease is LeaseState.LOST


class TestEndOfFlight:
    def flown(self) -> Bench:
        bench = Bench(armed=True).granted()
        bench.authority.move_phase(PhaseCause.STARTED)
        bench.authority.takeover_allowed = bench.authority.alone = True
        return bench

    def test_a_landing(self) -> None:
        bench = self.flown()
        bench.says(armed=False)
        bench.authority.land()
        assert (bench.authority.phase, bench.authority.takeover_allowed, bench.authority.alone) == (
            Phase.ON_LOAD,
            False,
            False,
        )
        assert bench.has() == (A, False, 1)

    @pytest.mark.parametrize(("armed", "owner"), [(False, None), (True, A), (None, A)])
    def test_on_the_ground_no_claim_is_needed(self, armed: bool | None, owner: int | None) -> None:
        bench = Bench(UNPROVEN, armed=armed)
        if armed is None:
            bench.authority.end_rehearsal()
        else:
            bench.authority.land()
        assert bench.authority.phase is Phase.ON_LOAD
        assert bench.authority.owner == bench.authority.claimant == owner
        assert bench.authority.lost is (owner is not None)
        assert bench.authority.recovering is (owner is not None)

    def test_the_end_of_a_rehearsal(self) -> None:
        bench = Bench().granted()
        bench.authority.move_phase(PhaseCause.REHEARSED)
        bench.authority.end_rehearsal()
        assert bench.authority.phase is Phase.ON_LOAD


class TestView:
    @pytest.mark.parametrize(("armed", "shown"), [(None, True), (True, True), (False, False)])
    def test_armed_until_the_autopilot_says_otherwise(self, armed: bool | None, shown: bool) -> None:
        assert Bench(armed=armed).view().armed is shown

    def test_a_rehearsal_is_locked_as_armed(self) -> None:
        bench = Bench()
        bench.flight.rehearsal_begun()
        assert (bench.view().armed, bench.view().rehearsal) == (True, True)

    def test_only_a_change_is_announced(self) -> None:
        bench = Bench().granted()
        bench.authority.refresh(Reason.NONE, bench.actions)
        assert bench.actions == []


class TestRestart:
    def test_in_flight_the_owner_of_the_run_before_is_waited_for_in_the_next_epoch(self) -> None:
        bench = Bench(LEFT, armed=None)
        authority = bench.authority
        assert bench.has() == (A, True, 5)
        assert (authority.handover_id, authority.phase, authority.takeover_allowed) == (7, Phase.ON_MISSION, True)
        assert (authority.view.lease, authority.view.epoch) == (LeaseState.RECOVERING, 5)
        assert authority.waits_for(A)
        authority.await_owner(102.5)
        authority.await_owner(109.0)
        assert authority.recover_until == 102.5

    def test_in_the_first_event_alone_that_clock_starts(self) -> None:
        bench = Bench()
        bench.authority.await_owner(102.5)
        assert not bench.authority.recovering

    def test_a_transfer_under_way_is_over(self) -> None:
        assert Bench(replace(LEFT, phase=Phase.ON_HANDOVER)).authority.phase is Phase.ON_MISSION

    def test_on_the_ground_only_the_numbers_are_kept(self) -> None:
        bench = Bench(replace(LEFT, phase=Phase.ON_LOAD))
        assert bench.has() == (None, False, 5)
        assert (bench.authority.handover_id, bench.authority.takeover_allowed) == (7, False)
        assert not bench.authority.recovering

    def test_an_owner_that_is_not_of_the_mission_is_none(self) -> None:
        bench = Bench(replace(LEFT, owner=77))
        assert bench.has() == (None, False, 5)
        assert not bench.authority.recovering

    def test_back_it_commands_in_that_epoch(self) -> None:
        bench = Bench(LEFT, armed=True)
        bench.authority.restore_owner(A, bench.actions)
        assert bench.has() == (A, False, 5)
        assert not bench.authority.recovering
        assert bench.texts() == ["GCSA commands on after the restart, epoch 5"]

    def test_not_back_in_time_it_is_lost_from_then_on(self) -> None:
        bench = Bench(LEFT, armed=True)
        bench.authority.wait_no_longer(A, 102.5, bench.actions)
        assert bench.has() == (A, True, 5)
        assert (bench.authority.recovering, bench.authority.hurry_until(2.0)) == (False, 104.5)
        assert bench.texts() == ["GCSA has not come back after the restart: no station commands"]
        assert bench.authority.view.lease is LeaseState.LOST


class TestUnprovenState:
    """A change of authority may be missing from the file: the memory of the stations decides."""

    def test_until_a_station_has_authority_the_epoch_is_the_old_one(self) -> None:
        bench = Bench(UNPROVEN, armed=True)
        assert bench.has() == (A, True, 4)
        assert (bench.authority.claimant, bench.authority.waits_for(A)) == (A, False)

    def test_the_owner_that_says_so_has_it_when_all_others_have_answered(self) -> None:
        bench = Bench(UNPROVEN, armed=True)
        bench.remembers(A, 4, A)
        assert bench.has() == (A, True, 4)
        bench.remembers(B, 4, None)
        assert bench.has() == (A, False, 1004)
        assert (bench.authority.claimant, bench.authority.recovering) == (None, False)
        assert bench.texts() == ["GCSA is back and commands again, epoch 1004"]

    def test_in_whatever_order(self) -> None:
        bench = Bench(UNPROVEN, armed=True)
        bench.remembers(B, 3, A)
        assert bench.has() == (A, True, 4)
        bench.remembers(A, 4, A)
        assert bench.has() == (A, False, 1004)

    @pytest.mark.parametrize(("shown", "has"), [(True, (A, False, 1004)), (False, (None, False, 4))])
    def test_when_the_time_is_over_its_own_answer_is_enough_and_without_one_there_is_no_owner(
        self, shown: bool, has: tuple[int | None, bool, int]
    ) -> None:
        bench = Bench(UNPROVEN, armed=True)
        if shown:
            bench.remembers(A, 4, A)
        bench.authority.wait_no_longer(A, 102.5, bench.actions)
        assert bench.has() == has
        assert not bench.authority.recovering
        lost = "GCSA has not come back after the restart: no station commands"
        assert (lost in bench.texts()) is not shown

    def test_the_memory_of_another_station_counts_more_than_the_owners_own_answer(self) -> None:
        bench = Bench(UNPROVEN, armed=True)
        bench.remembers(A, 4, A)
        bench.remembers(B, 5, B)
        assert bench.has() == (None, False, 5)

    def test_after_that_time_it_may_still_show_it(self) -> None:
        bench = Bench(UNPROVEN, armed=True)
        bench.authority.wait_no_longer(A, 102.5, bench.actions)
        bench.remembers(A, 4, A)
        assert bench.has() == (A, False, 1004)

    @pytest.mark.parametrize(
        ("epoch", "commander", "contradicts"),
        [(4, B, True), (5, None, True), (5, B, True), (4, None, False), (3, B, False), (4, A, False), (5, A, False)],
    )
    def test_a_memory_of_another_commander_or_of_a_later_epoch_ends_the_claim(
        self, epoch: int, commander: int | None, contradicts: bool
    ) -> None:
        bench = Bench(UNPROVEN, armed=True)
        bench.remembers(B, epoch, commander)
        if contradicts:
            assert bench.has() == (None, False, epoch)
            assert (bench.authority.claimant, bench.authority.recovering) == (None, False)
            name = bench.authority.name(commander)
            assert bench.texts() == [f"GCSB remembers {name} in epoch {epoch}: no station commands"]
            assert isinstance(bench.actions[-1], ViewChanged)
        else:
            assert bench.has() == (A, True, 4)
            assert bench.texts() == []

    @pytest.mark.parametrize(("epoch", "believed"), [(1003, True), (1004, False)])
    def test_an_epoch_that_no_disk_can_have_missed_is_not_believed(self, epoch: int, believed: bool) -> None:
        bench = Bench(UNPROVEN, armed=True)
        bench.remembers(B, epoch, B)
        assert (bench.authority.owner is None) is believed
        if not believed:
            assert bench.texts() == [f"GCSB says epoch {epoch}: no memory of this flight, not believed"]

    def test_only_the_first_answer_of_a_station_counts(self) -> None:
        bench = Bench(UNPROVEN, armed=True)
        bench.remembers(B, 3, A)
        bench.remembers(B, 9, B)
        assert bench.has() == (A, True, 4)

    def test_a_standard_station_remembers_nothing(self) -> None:
        bench = Bench(UNPROVEN, armed=True)
        bench.remembers(C, 9, C)
        assert bench.has() == (A, True, 4)

    def test_its_own_answer_that_it_does_not_command_is_no_proof(self) -> None:
        bench = Bench(UNPROVEN, armed=True)
        bench.remembers(A, 3, A)
        bench.remembers(B, 4, None)
        assert bench.has() == (A, True, 4)


class TestLearningTheEpoch:
    """A run without the file of the run before may have a lower epoch than the stations remember."""

    def test_without_an_owner_the_epoch_is_that_of_the_memory(self) -> None:
        bench = Bench()
        bench.remembers(B, 9, A)
        assert bench.has() == (None, False, 9)
        assert bench.texts() == ["GCSB remembers epoch 9: the state of an earlier run was lost"]
        assert bench.authority.view.epoch == 9

    @pytest.mark.parametrize(
        ("epoch", "commander", "learnt"),
        [(9, B, 10), (9, A, 10), (1, B, 2), (1, None, 1), (1, A, 1), (0, B, 1)],
    )
    def test_with_an_owner_it_is_one_more(self, epoch: int, commander: int | None, learnt: int) -> None:
        bench = Bench().granted()
        bench.remembers(B, epoch, commander)
        assert bench.has() == (A, False, learnt)

    def test_with_an_owner_only_the_first_answer_counts(self) -> None:
        bench = Bench().granted()
        bench.remembers(B, 1, A)
        bench.remembers(B, 9, A)
        assert bench.has() == (A, False, 1)

    def test_without_one_every_answer_counts(self) -> None:
        bench = Bench()
        bench.remembers(B, 1, A)
        bench.remembers(B, 9, A)
        assert bench.has() == (None, False, 9)

    def test_a_transfer_ends_in_the_epoch_that_it_began_in(self) -> None:
        bench = Bench().granted()
        bench.transfer()
        bench.remembers(B, 9, A)
        assert bench.has() == (A, False, 1)
        bench.authority.end_transfer()
        bench.remembers(B, 9, A)
        assert bench.has() == (A, False, 10)

    def test_after_a_restart_with_a_proven_state_no_station_can_be_ahead(self) -> None:
        bench = Bench(LEFT, armed=True)
        bench.authority.restore_owner(A, [])
        bench.remembers(B, 9, A)
        assert bench.has() == (A, False, 5)

    @pytest.mark.parametrize(("epoch", "learnt"), [(0x7FFF_FFFF, 0x7FFF_FFFF), (0x8000_0000, 0)])
    def test_an_epoch_that_no_message_can_carry_is_not_learnt(self, epoch: int, learnt: int) -> None:
        bench = Bench()
        bench.remembers(B, epoch, A)
        assert bench.authority.epoch == learnt
