# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion is killed and comes back, through the real module and what it kept in memory and on the disk.

Killed means: no callback runs any more, nothing is said or written; a new MAVProxy loads the module from the same
configuration. Zone A ends at longitude 5.9285 on latitude 52.679, zone B begins at 5.9262.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.core import AuthorityHeard, FromVehicle, MissionHeld, StationCore
from gcs_module.core import Role as StationRole
from mavproxy_handover.core.common.model import (
    AUTOMATIC,
    LeaseState,
    Phase,
    Station,
)
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.uploads import package_reader
from mavproxy_handover.store import state_file, state_store
from mavproxy_handover.store.memory import Slots, memory_folder
from mavproxy_handover.store.state_file import StateFile
from mavproxy_handover.store.state_store import StateStore
from mavproxy_handover.wire import codec
from tests.module import vehicle
from tests.module.conftest import Bench
from tests.module.proxy import MPState
from tests.module.test_handover import IN_A, IN_BOTH, OUTSIDE, give_rules
from tests.module.vehicle import AUTO, RTL

START, LAND = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_NAV_LAND
CONTROL = mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL
DENIED, NOT_IN_CONTROL = 2, 10
HELD, TRANSFER, LOST, RECOVERING = LeaseState.HELD, LeaseState.TRANSFER, LeaseState.LOST, LeaseState.RECOVERING


def kill(bench: Bench, away_s: float = 1.0) -> None:
    """The process ends here. Its sockets and files go with it; nobody hears a word of it."""
    companion = bench.companion
    assert bench.mpstate.escaped == []
    assert companion.wait_until_written(10.0)
    for port in companion.ports.values():
        port.close()
    companion.journal.close()
    bench.module.lock.release()
    bench.mpstate, bench.module = MPState(), None
    for _ in range(round(away_s / 0.05)):
        bench.clock.now += 0.05
        bench.autopilot.step([], bench.clock.now)
        for station in (bench.a, bench.b):
            station.step(bench.clock.now)
    bench.autopilot.received.clear()


def restart(bench: Bench, away_s: float = 1.0) -> None:
    kill(bench, away_s)
    assert bench.load() is not None, bench.mpstate.console.lines


def kept_in_memory(bench: Bench) -> Path:
    """The file in memory."""
    place = memory_folder(os.environ)
    assert place is not None, "these tests need storage in memory: /dev/shm"
    name = hashlib.sha256(f"{(bench.folder / 'state').resolve()}\0drone-1".encode()).hexdigest()[:32]
    return place / f"{name}.state"


def lose_power(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kill, and what was in memory is gone; another boot begins."""
    kill(bench)
    kept_in_memory(bench).unlink()
    kept_in_memory(bench).with_suffix(".mission").unlink(missing_ok=True)
    monkeypatch.setattr(state_store, "boot_id", lambda: "another boot")


def leases(bench: Bench) -> list[tuple[int, int, int]]:
    """State, commander and epoch of the leases since the start, without repetitions."""
    seen: list[tuple[int, int, int]] = []
    for lease in bench.autopilot.leases():
        told = (lease[1], lease[2], lease[6])
        if not seen or seen[-1] != told:
            seen.append(told)
    return seen


def path_of_state(bench: Bench) -> Path:
    return bench.folder / "state" / "drone-1.state.json"


def with_rules(bench: Bench, delivery: MissionPackage) -> None:
    """Both stations with their own rules and the mission package; there is no ground link."""
    for station, other in ((bench.a, bench.b), (bench.b, bench.a)):
        peers = (Station(other.sysid, other.name),)
        core = StationCore(Station(station.sysid, station.name), "drone-1", peers, automatic=AUTOMATIC)
        core.handle(MissionHeld(delivery.digest), bench.clock.now)
        give_rules(station, core, bench)


@pytest.fixture
def flight(bench: Bench, delivery: MissionPackage) -> Bench:
    """On its way in zone A, GCSA in command in epoch 1."""
    bench.connect()
    bench.share(delivery, at_once=True)
    with_rules(bench, delivery)
    bench.wait(1.5)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.run(0.5)
    assert (bench.companion.view.commander, bench.companion.view.epoch) == (251, 1)
    return bench


class TestInFlight:
    def test_same_commander_once_heard_one_epoch_on_and_the_mission_goes_on(self, flight: Bench) -> None:
        restart(flight)
        flight.run(2.0)
        assert leases(flight) == [(RECOVERING, 0, 2), (HELD, 251, 2)]
        assert flight.companion.view.phase is Phase.ON_MISSION
        assert flight.autopilot.mode == AUTO
        assert flight.journal("fly") == []
        assert flight.mpstate.console.said("Restarted in flight, epoch 2: waiting for GCSA.")
        assert flight.mpstate.console.said("GCSA commands on after the restart, epoch 2.")

    def test_the_route_is_not_walked_again_and_is_known_all_the_same(
        self, flight: Bench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A zone like a comb takes seconds, and the guard gives a restart three."""
        monkeypatch.setattr(MissionPackage, "simulate", lambda _self: pytest.fail("it was walked"))
        monkeypatch.setattr(package_reader, "prepare", lambda _package: pytest.fail("it was prepared"))
        restart(flight)
        flight.run(2.0)
        assert leases(flight) == [(RECOVERING, 0, 2), (HELD, 251, 2)]
        assert flight.companion.arbiter.snapshot().route == (251, 252, 251, 252, 251)
        assert flight.companion.autopilot.zones.facts() != ()

    def test_the_lease_is_there_with_the_first_round_and_authority_within_two_seconds(self, flight: Bench) -> None:
        restart(flight)
        flight.run(0.05)
        (first,) = flight.autopilot.leases()
        assert (first[1], first[2], first[6]) == (RECOVERING, 0, 2)
        flight.run(1.95)
        assert flight.autopilot.leases()[-1][1:3] == (HELD, 251)

    def test_leases_of_the_new_run_are_new_to_the_guard(self, flight: Bench) -> None:
        # another nonce in a later epoch: that is what it takes up at once
        before = flight.autopilot.leases()[-1]
        restart(flight)
        flight.run(0.5)
        first = flight.autopilot.leases()[0]
        assert first[4] != before[4]
        assert first[4] != 0
        assert first[6] == before[6] + 1

    def test_until_it_is_heard_its_commands_are_refused_like_everybodys(self, flight: Bench) -> None:
        kill(flight)
        flight.a.alive = flight.b.alive = False
        flight.load()
        flight.run(0.1)
        for station in (flight.a, flight.b):
            station.send(mavlink.MAVLink_command_long_message(1, 1, LAND, 0, 0, 0, 0, 0, 0, 0, 0))
        flight.run(0.3)
        assert flight.autopilot.commands() == []
        assert flight.a.acks(LAND) == [DENIED], "they have not shown this run that they know the other result"
        assert flight.b.acks(LAND) == [DENIED]

    def test_nobody_else_gains_by_asking_first(self, flight: Bench) -> None:
        kill(flight)
        flight.a.alive = False
        flight.autopilot.position = IN_BOTH
        flight.load()
        flight.run(1.2)
        flight.b.command(CONTROL, 1, 1, 10, 252, component=191)
        flight.run(0.3)
        assert flight.b.acks(CONTROL) == [mavlink.MAV_RESULT_DENIED]
        assert "Control denied: the commander may come back after the restart" in flight.b.texts()
        assert flight.companion.view.commander is None
        flight.a.alive = True
        flight.run(1.2)
        assert (flight.companion.view.commander, flight.companion.view.epoch) == (251, 2)

    def test_the_zones_are_known_again_and_the_next_handover_comes(self, flight: Bench) -> None:
        restart(flight)
        flight.wait(3.0)
        assert "inside" in flight.mpstate.type("handover zones")[0]
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: flight.companion.view.commander == 252)
        assert flight.companion.view.epoch == 3

    def test_it_turns_home_out_of_every_zone_as_before(self, flight: Bench) -> None:
        restart(flight)
        flight.wait(3.0)
        flight.autopilot.position = OUTSIDE
        flight.until(lambda: flight.autopilot.mode == RTL)

    def test_a_commander_that_is_gone_too_is_replaced_by_who_is_there(self, flight: Bench) -> None:
        kill(flight)
        flight.a.alive = False
        flight.autopilot.position = IN_BOTH
        flight.load()
        flight.until(lambda: flight.companion.view.commander == 252)
        assert leases(flight) == [(RECOVERING, 0, 2), (LOST, 0, 2), (HELD, 252, 3)]
        assert flight.autopilot.mode == AUTO

    def test_with_nobody_there_the_aircraft_comes_home(self, flight: Bench) -> None:
        kill(flight)
        flight.a.alive = flight.b.alive = False
        flight.load()
        flight.run(2.0)
        assert flight.autopilot.mode == AUTO
        flight.until(lambda: flight.autopilot.mode == RTL, limit_s=2.0)
        assert leases(flight) == [(RECOVERING, 0, 2), (LOST, 0, 2)]

    def test_an_aircraft_on_its_way_home_stays_on_it(self, flight: Bench) -> None:
        flight.a.alive = flight.b.alive = False
        flight.until(lambda: flight.autopilot.mode == RTL)
        flight.autopilot.received.clear()
        restart(flight)
        flight.wait(4.0)
        assert flight.companion.view.phase is Phase.EMERGENCY
        assert flight.autopilot.mode == RTL

    def test_a_landing_after_the_restart_ends_the_flight(self, flight: Bench) -> None:
        restart(flight)
        flight.run(2.0)
        flight.autopilot.armed = flight.autopilot.airborne = False
        flight.until(lambda: flight.companion.view.phase is Phase.ON_LOAD)
        flight.run(1.0)
        flight.a.command(START)
        flight.until(lambda: flight.companion.view.phase is Phase.ON_MISSION)

    def test_the_stations_follow(self, flight: Bench) -> None:
        """What the real rules of a station make of it: nobody for a moment, then the same commander."""
        core = StationCore(Station(251, "GCSA"), "drone-1", (), automatic=AUTOMATIC)
        roles: list[tuple[StationRole, int]] = []

        def listen() -> None:
            for m in flight.a.received:
                if m.get_type() == "AUTHORITY_STATUS":
                    recovering = m.lease == RECOVERING
                    core.handle(
                        AuthorityHeard(Phase(m.phase), m.commander or None, None, m.epoch, recovering=recovering), 0.0
                    )
                elif m.get_type() in ("CONNECT", "HANDOVER_RESULT"):
                    decoded = codec.decode(m)
                    assert decoded is not None
                    core.handle(FromVehicle(decoded), 0.0)
                if not roles or roles[-1] != (core.role, core.epoch):
                    roles.append((core.role, core.epoch))

        listen()
        restart(flight)
        flight.wait(3.0)
        listen()
        assert roles[-3:] == [(StationRole.COMMANDER, 1), (StationRole.OBSERVER, 2), (StationRole.COMMANDER, 2)]


MESSAGES = [
    ("out", "HANDOVER_REQUEST"),
    ("in", "ON_HANDOVER"),
    ("out", "ON_HANDOVER"),
    ("in", "OK_HANDOVER"),
    ("out", "CONNECT_HANDOVER"),
    ("in", "DRONE_CONNECTED"),
    ("out", "DRONE_CONNECTED"),
]


class TestInATransfer:
    """Killed right after each message of a transfer."""

    @pytest.mark.parametrize(("direction", "name"), MESSAGES, ids=str)
    def test_before_the_commit_the_commander_stays(self, flight: Bench, direction: str, name: str) -> None:
        self.until_message(flight, direction, name)
        kill(flight)
        flight.b.alive = False
        flight.load()
        flight.run(2.0)
        assert leases(flight) == [(RECOVERING, 0, 2), (HELD, 251, 2)]
        assert flight.companion.view.handover_id == 1
        assert flight.autopilot.mode == AUTO

    @pytest.mark.parametrize(("direction", "name"), MESSAGES, ids=str)
    def test_and_the_transfer_is_made_anew(self, flight: Bench, direction: str, name: str) -> None:
        self.until_message(flight, direction, name)
        restart(flight)
        flight.until(lambda: flight.companion.view.commander == 252, limit_s=5.0)
        assert leases(flight) == [(RECOVERING, 0, 2), (HELD, 251, 2), (TRANSFER, 251, 2), (HELD, 252, 3)]
        assert flight.companion.view.handover_id == 2
        assert flight.autopilot.mode == AUTO

    def test_after_the_commit_it_is_the_partner(self, flight: Bench) -> None:
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: flight.companion.view.commander == 252)
        restart(flight)
        flight.run(2.0)
        assert leases(flight) == [(RECOVERING, 0, 3), (HELD, 252, 3)]
        flight.a.command(LAND)
        flight.run(0.2)
        assert flight.a.acks(LAND) == [NOT_IN_CONTROL]

    def test_the_commit_outlives_the_process_before_anybody_hears_of_it(
        self, flight: Bench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Whoever has been told that it commands must command after a crash."""
        order: list[str] = []
        save, write = StateStore.save, type(flight.companion.ports[252]).write_all

        def saved(self: StateStore, snapshot: Any) -> None:
            save(self, snapshot)
            order.append(f"saved {snapshot.owner}")

        def told(self: Any, data: bytes) -> None:
            for message in vehicle.frames(data):
                if message.get_type() == "HANDOVER_RESULT":
                    order.append(f"told {message.commander}")
            write(self, data)

        monkeypatch.setattr(StateStore, "save", saved)
        monkeypatch.setattr(type(flight.companion.ports[252]), "write_all", told)
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: "told 252" in order)
        assert order.index("saved 252") < order.index("told 252")

    @staticmethod
    def until_message(flight: Bench, direction: str, name: str) -> None:
        """Stop the world when this message has been sent or taken in, and what it has led to at once is done."""
        companion = flight.companion
        original = companion.event_log.message

        seen = []

        def watching(way: str, station: int, message: Any, *more: Any) -> None:
            original(way, station, message, *more)
            if (way, codec.name_of(message)) == (direction, name):
                seen.append(name)

        companion.event_log.message = watching
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: seen)
        assert companion.view.commander == 251, "too late: it has committed in the same round"


class TestAgain:
    def test_each_start_is_an_epoch_of_its_own(self, flight: Bench) -> None:
        for epoch in (2, 3, 4):
            restart(flight)
            flight.run(2.0)
            assert (flight.companion.view.commander, flight.companion.view.epoch) == (251, epoch)

    def test_even_if_it_dies_before_anybody_was_heard(self, flight: Bench) -> None:
        # or the guard would take the leases of the third run for those of the second
        for epoch in (2, 3, 4):
            kill(flight)
            flight.a.alive = flight.b.alive = False
            flight.load()
            flight.run(0.2)
            assert leases(flight) == [(RECOVERING, 0, epoch)]
        flight.a.alive = flight.b.alive = True
        flight.run(2.0)
        assert (flight.companion.view.commander, flight.companion.view.epoch) == (251, 4)


class TestOnTheGround:
    def test_the_parent_has_it_again_in_a_later_epoch(self, bench: Bench) -> None:
        bench.connect()
        assert bench.companion.view.epoch == 1
        kill(bench)
        before = len(bench.a.received)
        bench.load()
        bench.until(lambda: bench.companion.view.commander == 251)
        bench.run(0.1)
        assert bench.companion.view.epoch == 3
        told = [(m.commander, m.epoch) for m in bench.a.received[before:] if m.get_type() == "AUTHORITY_STATUS"]
        assert set(told) == {(0, 2), (251, 3)}
        assert not bench.mpstate.console.said("Restarted in flight")

    def test_a_mission_is_to_be_loaded_again(self, bench: Bench, delivery: MissionPackage) -> None:
        bench.connect()
        bench.share(delivery)
        restart(bench)
        bench.until(lambda: bench.companion.view.commander == 251)
        assert bench.companion.arbiter.mission_digest == b""
        bench.share(delivery)
        assert bench.companion.arbiter.mission_digest == delivery.digest


class TestBadState:
    """After a loss of power: what cannot be trusted gives nobody anything, and in flight the aircraft comes home."""

    def spoil(self, path: Path, how: str) -> None:
        data = path.read_bytes()
        if how == "torn":
            path.write_bytes(data[: len(data) // 2])
        elif how == "empty":
            path.write_bytes(b"")
        elif how == "flipped":
            path.write_bytes(data.replace(b'"owner": 251', b'"owner": 252'))
        elif how == "of another vehicle":
            kept = StateFile(path.parent, "drone-1").load()
            assert kept is not None
            StateFile(path.parent, "drone-2").save(kept.snapshot)
            (path.parent / "drone-2.state.json").replace(path)
        elif how == "a folder":
            path.unlink()
            path.mkdir()

    @pytest.mark.parametrize("how", ["torn", "empty", "flipped", "of another vehicle", "a folder"])
    def test_in_flight(self, flight: Bench, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
        lose_power(flight, monkeypatch)
        self.spoil(path_of_state(flight), how)
        flight.load()
        flight.wait(3.0)
        assert flight.autopilot.mode == RTL
        assert flight.companion.view.commander is None
        assert {state for state, _commander, _epoch in leases(flight)} == {LOST}
        assert {commander for _state, commander, _epoch in leases(flight)} == {0}
        flight.a.command(LAND)
        flight.b.command(LAND)
        flight.run(0.2)
        assert flight.a.acks(LAND) == flight.b.acks(LAND) == [NOT_IN_CONTROL]
        flight.wait(20.0)
        assert flight.companion.view.commander is None, "neither the former commander nor anybody else"
        (entry,) = flight.journal("state_lost")
        assert "drone-1.state.json" in entry["text"]
        assert flight.mpstate.console.said("no station commands.")

    @pytest.mark.parametrize("how", ["torn", "empty", "flipped", "of another vehicle", "a folder"])
    def test_while_the_power_is_on_the_disk_does_not_matter(self, flight: Bench, how: str) -> None:
        kill(flight)
        self.spoil(path_of_state(flight), how)
        flight.load()
        flight.run(2.0)
        assert leases(flight) == [(RECOVERING, 0, 2), (HELD, 251, 2)]
        assert flight.autopilot.mode == AUTO

    def test_without_any_file_neither(self, flight: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
        lose_power(flight, monkeypatch)
        path_of_state(flight).unlink()
        flight.load()
        flight.wait(3.0)
        assert flight.autopilot.mode == RTL
        assert flight.companion.view.commander is None

    def test_on_the_ground_it_is_a_word_in_the_journal(
        self, bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with_rules(bench, delivery)
        bench.connect()
        for _ in range(3):
            restart(bench)
            bench.until(lambda: bench.companion.view.commander == 251)
            bench.run(1.5)
        assert bench.companion.view.epoch == 7
        lose_power(bench, monkeypatch)
        self.spoil(path_of_state(bench), "torn")
        bench.load()
        bench.until(lambda: bench.companion.view.commander == 251)
        assert len(bench.journal("state_lost")) == 1
        # the numbers were lost too, but the stations remember them, or they would believe nothing that is said now
        assert bench.companion.view.epoch == 8
        assert bench.journal("epoch_learnt")[-1]["text"] == (
            "GCSA remembers epoch 7: the state of an earlier run was lost"
        )

    def test_a_mission_that_is_gone_costs_the_zones_and_not_the_commander(self, flight: Bench) -> None:
        kill(flight)
        for path in (flight.folder / "state" / "drone-1.mission", kept_in_memory(flight).with_suffix(".mission")):
            assert path.exists()
            path.write_bytes(b"rubbish")
        flight.load()
        flight.run(2.0)
        assert (flight.companion.view.commander, flight.companion.view.epoch) == (251, 2)
        assert (
            flight.journal("state_lost")[-1]["text"] == "the mission package of the previous run is missing: no zones"
        )
        assert flight.autopilot.mode == AUTO

    def test_a_mission_that_the_disk_has_not_got_is_in_memory(self, flight: Bench) -> None:
        kill(flight)
        (flight.folder / "state" / "drone-1.mission").unlink()
        flight.load()
        flight.run(2.0)
        assert flight.journal("state_lost") == []
        assert flight.companion.autopilot.zones.facts() != ()

    def test_a_mission_of_another_flight_is_not_taken_for_this_one(
        self, flight: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        kill(flight)
        monkeypatch.setattr(state_file, "from_bytes", lambda data: _Other())
        flight.load()
        flight.run(2.0)
        assert flight.companion.autopilot.zones.facts() == ()
        assert flight.journal("state_lost")


class _Other:
    digest = bytes(32)


def no_room(*_arguments: Any) -> None:
    """What a full or read-only disk answers."""
    raise OSError(28, "No space left on device")


class TestTheDiskTakesNothing:
    """As long as the power is on that changes nothing; after it is lost the stations decide."""

    @pytest.fixture
    def full(self, flight: Bench) -> Iterator[pytest.MonkeyPatch]:
        assert flight.companion.wait_until_written(10.0)
        patch = pytest.MonkeyPatch()
        patch.setattr(StateFile, "save", no_room)
        yield patch
        patch.undo()

    @staticmethod
    def hand_over(flight: Bench) -> None:
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: flight.companion.view.commander == 252)
        flight.wait(1.5)

    def test_the_flight_goes_on_and_it_is_told(self, flight: Bench, full: pytest.MonkeyPatch) -> None:
        self.hand_over(flight)
        flight.wait(5.0)
        assert flight.autopilot.leases()[-1][1:3] == (HELD, 252)
        assert flight.companion.faults == {}
        words = "the state is not kept as it should be: the disk does not take it: No space left"
        assert [entry["text"][: len(words)] for entry in flight.journal("state_kept")] == [words]
        assert [flight.a.texts().count(words), flight.b.texts().count(words)] == [1, 1]

    def test_after_a_restart_the_commander_is_the_one_of_before(self, flight: Bench, full: pytest.MonkeyPatch) -> None:
        """The old file is still there, and says GCSA."""
        self.hand_over(flight)
        restart(flight)
        flight.wait(3.0)
        assert leases(flight) == [(RECOVERING, 0, 3), (HELD, 252, 3)]
        assert flight.autopilot.mode == AUTO

    def test_when_there_is_room_again_it_is_written(self, flight: Bench, full: pytest.MonkeyPatch) -> None:
        self.hand_over(flight)
        full.undo()
        flight.run(2.1)
        assert flight.companion.wait_until_written(10.0)
        kept = StateFile(flight.folder / "state", "drone-1").load()
        assert kept is not None
        assert (kept.snapshot.owner, kept.snapshot.epoch) == (252, 2)

    @pytest.mark.parametrize("silent", [None, 251, 252])
    def test_after_a_loss_of_power_the_stations_know_better_than_the_old_file(
        self, flight: Bench, full: pytest.MonkeyPatch, silent: int | None
    ) -> None:
        """Issue: GCSA had authority back by the old file, and GCSB went on in the same epoch."""
        self.hand_over(flight)
        lose_power(flight, full)
        flight.a.alive, flight.b.alive = silent != 251, silent != 252
        flight.load()
        flight.wait(10.0)
        assert {commander for _state, commander, _epoch in leases(flight)} == {0}
        assert flight.autopilot.mode == RTL
        assert flight.companion.view.commander is None
        flight.a.alive = flight.b.alive = True
        flight.wait(5.0)
        assert flight.companion.view.commander is None

    def test_after_a_loss_of_power_with_nothing_missed_the_commander_goes_on(
        self, flight: Bench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        self.hand_over(flight)
        lose_power(flight, monkeypatch)
        flight.load()
        flight.wait(3.0)
        assert flight.mpstate.console.said("GCSB has to show that it still has authority")
        assert leases(flight) == [(RECOVERING, 0, 2), (HELD, 252, 1002)]
        assert flight.autopilot.mode == AUTO
        assert [entry["proven"] for entry in flight.journal("restarted")] == [False]


class TestUnwritable:
    """The state cannot be kept at all: the flight goes on, and no restart gives authority to a former commander."""

    @pytest.fixture(params=[OSError(5, "Input/output error"), RuntimeError("a bug")], ids=["memory", "fault"])
    def broken(self, flight: Bench, request: pytest.FixtureRequest) -> Iterator[pytest.MonkeyPatch]:
        def breaks(*_arguments: Any) -> None:
            raise request.param

        patch = pytest.MonkeyPatch()
        patch.setattr(Slots, "write", breaks)
        yield patch
        patch.undo()

    def test_the_flight_goes_on(
        self, flight: Bench, broken: pytest.MonkeyPatch, request: pytest.FixtureRequest
    ) -> None:
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: flight.companion.view.commander == 252)
        flight.run(1.0)
        assert flight.autopilot.leases()[-1][1:3] == (HELD, 252)
        if request.node.callspec.params["broken"].args[0] == 5:  # the storage's fault is none of ours
            assert flight.companion.faults == {}
            assert flight.a.texts().count("the state is not kept as it should be: Input/output error") == 1
            return
        assert flight.companion.faults["state file"] >= 1
        assert flight.journal("fault")[0]["text"].startswith("state file: ")

    @pytest.mark.parametrize("disk", ["takes it", "does not"])
    def test_what_was_kept_is_not_true_any_more_so_it_counts_for_nobody(
        self, flight: Bench, broken: pytest.MonkeyPatch, disk: str
    ) -> None:
        if disk == "does not":
            broken.setattr(StateFile, "save", no_room)
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: flight.companion.view.commander == 252)
        restart(flight)
        flight.wait(3.0)
        assert flight.companion.view.commander is None, "GCSA had authority once, and GCSB is not on record"
        assert flight.autopilot.mode == RTL
        assert flight.mpstate.console.said("the copy in memory is void: no station commands.")

    def test_when_it_can_be_kept_again_it_is(self, flight: Bench, broken: pytest.MonkeyPatch) -> None:
        flight.autopilot.position = IN_BOTH
        flight.until(lambda: flight.companion.view.commander == 252)
        flight.run(2.0)
        broken.undo()
        flight.run(1.1)
        restart(flight)
        flight.run(2.0)
        assert leases(flight) == [(RECOVERING, 0, 3), (HELD, 252, 3)]

    def test_nothing_changed_nothing_is_written(self, flight: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
        written: list[Any] = []
        assert flight.companion.wait_until_written(10.0)
        monkeypatch.setattr(StateFile, "save", lambda self, *what: written.append(what))
        monkeypatch.setattr(Slots, "write", lambda self, *what: written.append(what))
        flight.wait(10.0)
        assert flight.companion.wait_until_written(10.0)
        assert written == []


def test_a_stations_late_answers_to_the_run_before_connect_nobody(flight: Bench) -> None:
    """Nonces of questions are drawn anew: an answer to the former run is an answer to nothing."""
    question = next(m for m in reversed(flight.b.received) if m.get_type() == "CONNECT")
    restart(flight)
    flight.b.alive = False
    values = (1, 191, 1, 252, 1, question.nonce, 1, 252, b"GCSB", list(flight.b.digest))
    flight.run(0.1)
    flight.b.send(mavlink.MAVLink_connect_ack_message(*values, 0))
    flight.run(0.1)
    assert not flight.companion.arbiter.connected(252, flight.clock.now)


def test_in_zone_a_alone_nothing_else_happens(flight: Bench) -> None:
    restart(flight)
    flight.autopilot.position = IN_A
    flight.wait(20.0)
    assert leases(flight) == [(RECOVERING, 0, 2), (HELD, 251, 2)]
    assert flight.companion.faults == {}
