# SPDX-License-Identifier: GPL-3.0-or-later

"""The state in memory and on the disk: no disk is waited for, and what may be late is not the last word."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store import memory
from mavproxy_handover.store import state_store as keeping
from mavproxy_handover.store.state_file import StateFile
from mavproxy_handover.store.state_store import StateStore

MISSIONS = Path(__file__).resolve().parents[2] / "missions"
WAIT_S = 10.0
DIGEST = bytes(range(32))
A, B = 251, 252
FIRST = Snapshot(A, 4, 7, Phase.ON_MISSION, 2, DIGEST, (A, B, A))
SECOND = replace(FIRST, owner=B, epoch=5)
NOBODY = replace(FIRST, owner=None, proven=False)
GONE = "the copy in memory is gone, and the disk may be older"


class Place:
    """A vehicle's folder on the disk, its folder in memory, and the boot."""

    def __init__(self, root: Path, patch: pytest.MonkeyPatch) -> None:
        self.disk, self.memory = root / "state", root / "memory"
        self.memory.mkdir()
        self.boot = "boot 1"
        self.open: list[StateStore] = []
        self.has_memory = True
        patch.setattr(keeping, "memory_folder", lambda _environment: self.memory if self.has_memory else None)
        patch.setattr(keeping, "boot_id", lambda: self.boot)

    def start(self) -> StateStore:
        """A companion starts; the one before is dead."""
        self.open.append(StateStore(self.disk, "drone-1"))
        return self.open[-1]

    def recalled(self) -> tuple[Snapshot | None, str]:
        return self.start().recall()

    def power_lost(self) -> None:
        for file in self.memory.iterdir():
            file.unlink()
        self.boot = "boot 2"

    def in_memory(self) -> Path:
        (file,) = self.memory.glob("*.state")
        return file

    def on_disk(self) -> Snapshot | None:
        kept = StateFile(self.disk, "drone-1").load()
        return None if kept is None else kept.snapshot


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Place]:
    place = Place(tmp_path, monkeypatch)
    yield place
    for keeper in place.open:
        keeper.close(WAIT_S)


@pytest.fixture(scope="module")
def delivery() -> MissionPackage:
    return mission_package.load(MISSIONS / "delivery")


@pytest.fixture
def hanging(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """The disk hangs until this is set."""
    free, save = threading.Event(), StateFile.save

    def hang(self: StateFile, *arguments: Any) -> None:
        assert threading.current_thread() is not threading.main_thread(), "the disk is waited for"
        assert free.wait(WAIT_S)
        save(self, *arguments)

    monkeypatch.setattr(StateFile, "save", hang)
    yield free
    free.set()


def fails(_self: Any, *_arguments: Any) -> None:
    raise OSError(30, "Read-only file system")


def saved(keeper: StateStore, *snapshots: Snapshot) -> StateStore:
    keeper.recall()
    for snapshot in snapshots:
        keeper.save(snapshot)
    assert keeper.wait_until_written(WAIT_S)
    return keeper


class TestWithinABoot:
    def test_at_first_there_is_nothing(self, place: Place) -> None:
        assert place.recalled() == (None, "")

    def test_the_last_word_is_kept_and_the_disk_gets_it_too(self, place: Place) -> None:
        saved(place.start(), FIRST, SECOND)
        assert place.on_disk() == SECOND
        assert place.recalled() == (SECOND, "")

    def test_a_disk_that_hangs_is_not_waited_for_and_what_it_says_does_not_matter(
        self, place: Place, hanging: threading.Event
    ) -> None:
        keeper = place.start()
        keeper.save(FIRST)
        keeper.save(SECOND)
        assert place.on_disk() is None
        assert place.recalled() == (SECOND, "")
        hanging.set()
        assert keeper.wait_until_written(WAIT_S)
        assert place.on_disk() == SECOND

    def test_nor_does_one_that_cannot_be_written(self, place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
        keeper = saved(place.start(), FIRST)
        with monkeypatch.context() as read_only:
            read_only.setattr(StateFile, "save", fails)
            keeper.save(SECOND)
            assert keeper.wait_until_written(WAIT_S)
            assert keeper.tick() == ["the disk does not take it: Read-only file system"]
            assert place.on_disk() == FIRST
            assert place.recalled() == (SECOND, "")
            assert keeper.wait_until_written(WAIT_S)
        keeper.tick()
        assert keeper.wait_until_written(WAIT_S)
        assert place.on_disk() == SECOND, "tried again"

    def test_what_has_not_changed_is_written_once(self, place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
        written: list[Any] = []
        save = StateFile.save
        monkeypatch.setattr(StateFile, "save", lambda self, *a: (written.append(a), save(self, *a)))
        keeper = saved(place.start(), FIRST)
        for _ in range(5):
            assert keeper.tick() == []
            assert keeper.wait_until_written(WAIT_S)
        assert len(written) == 1

    def test_damage_on_the_disk_does_not_matter(self, place: Place) -> None:
        saved(place.start(), FIRST)
        (place.disk / "drone-1.state.json").write_bytes(b"rubbish")
        assert place.recalled() == (FIRST, "")

    def test_not_proven_stays_not_proven(self, place: Place) -> None:
        saved(place.start(), replace(FIRST, proven=False))
        assert place.recalled() == (replace(FIRST, proven=False), "")

    def test_two_vehicles_do_not_mix(self, place: Place) -> None:
        saved(place.start(), FIRST)
        other = StateStore(place.disk, "drone-2")
        assert other.recall() == (None, "")
        other.save(SECOND)
        assert place.recalled() == (FIRST, "")
        other.close(WAIT_S)

    def test_serials_rise_over_restarts(self, place: Place) -> None:
        for number in range(1, 5):
            keeper = place.start()
            keeper.recall()
            keeper.save(replace(FIRST, epoch=number))
            keeper.close(WAIT_S)
        assert place.recalled()[0] == replace(FIRST, epoch=4)


class TestTheLastWordIsLost:
    """In this boot there was one: what the disk says may be older, so nobody has authority by it."""

    def spoil(self, place: Place, how: str) -> str:
        file = place.in_memory()
        if how == "gone":
            file.unlink()
            return GONE
        if how == "damaged":
            file.write_bytes(b"x" * 2 * memory.SLOT_BYTES)
        elif how == "of another":
            slots = memory.Slots(file)
            slots.write(b"{}", 100)
            slots.close()
            return "the copy in memory is not to be trusted: 'body'"
        else:
            slots = memory.Slots(file)
            slots.void()
            slots.close()
        return f"the copy in memory is {how}"

    @pytest.mark.parametrize("how", ["gone", "damaged", "void", "of another"])
    def test_nobody_is_the_owner_and_the_numbers_stay(self, place: Place, how: str) -> None:
        saved(place.start(), FIRST)
        why = self.spoil(place, how)
        assert place.recalled() == (NOBODY, why)

    @pytest.mark.parametrize("how", ["damaged", "void"])
    def test_though_the_disk_is_of_an_earlier_boot(self, place: Place, how: str) -> None:
        saved(place.start(), FIRST)
        place.power_lost()
        place.start()  # makes the file
        why = self.spoil(place, how)
        assert place.recalled() == (NOBODY, why)

    def test_a_copy_in_memory_that_is_behind_the_disk_is_not_the_last_word(self, place: Place) -> None:
        saved(place.start(), FIRST)
        old = place.in_memory().read_bytes()
        saved(place.start(), SECOND)
        place.in_memory().write_bytes(old)
        assert place.recalled() == (
            replace(SECOND, owner=None, proven=False),
            "the copy in memory is older than the one on the disk",
        )

    def test_without_a_word_on_the_disk_there_is_nothing(self, place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(StateFile, "save", fails)
        saved(place.start(), FIRST)
        self.spoil(place, "damaged")
        assert place.recalled() == (None, "the copy in memory is damaged")

    def test_both_damaged(self, place: Place) -> None:
        saved(place.start(), FIRST)
        self.spoil(place, "damaged")
        (place.disk / "drone-1.state.json").write_bytes(b"rubbish")
        snapshot, why = place.recalled()
        assert snapshot is None
        assert "drone-1.state.json: not to be trusted" in why


class TestThePowerIsLost:
    def test_the_disk_counts_and_is_not_proven(self, place: Place) -> None:
        saved(place.start(), FIRST)
        place.power_lost()
        assert place.recalled() == (replace(FIRST, proven=False), "")

    def test_what_the_disk_did_not_get_in_time_is_missing(self, place: Place, hanging: threading.Event) -> None:
        hanging.set()
        keeper = saved(place.start(), FIRST)
        hanging.clear()
        keeper.save(SECOND)
        place.power_lost()
        assert place.recalled() == (replace(FIRST, proven=False), "")

    def test_a_damaged_file_says_so(self, place: Place) -> None:
        saved(place.start(), FIRST)
        place.power_lost()
        (place.disk / "drone-1.state.json").write_bytes(b"rubbish")
        snapshot, why = place.recalled()
        assert snapshot is None
        assert "not to be trusted" in why

    def test_in_the_next_boot_memory_has_the_last_word_again(self, place: Place) -> None:
        saved(place.start(), FIRST)
        place.power_lost()
        saved(place.start(), SECOND)
        assert place.recalled() == (SECOND, "")

    def test_a_system_that_does_not_name_its_boots_proves_nothing_by_a_disk(self, place: Place) -> None:
        place.boot = ""
        saved(place.start(), FIRST)
        for file in place.memory.iterdir():
            file.unlink()
        assert place.recalled() == (replace(FIRST, proven=False), "")


class TestItCannotBeKept:
    """What was kept before is not true any more, and must not give anybody authority."""

    @pytest.fixture(params=["write", "pack"])
    def broken(self, request: pytest.FixtureRequest) -> Callable[[pytest.MonkeyPatch], None]:
        def broken(*_arguments: Any) -> None:
            raise {"write": OSError(5, "Input/output error"), "pack": RuntimeError("a bug")}[request.param]

        def patch(monkeypatch: pytest.MonkeyPatch) -> None:
            target = (memory.Slots, "write") if request.param == "write" else (keeping, "pack")
            monkeypatch.setattr(*target, broken)

        return patch

    def test_the_copy_in_memory_is_void(
        self, place: Place, broken: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(StateFile, "save", lambda *_: None)
        keeper = saved(place.start(), FIRST)
        with monkeypatch.context() as patch:
            broken(patch)
            with pytest.raises((OSError, RuntimeError)):
                keeper.save(SECOND)
        assert place.recalled() == (None, "the copy in memory is void")

    def test_and_goes_if_not_even_that_can_be_written(self, place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
        keeper = saved(place.start(), FIRST)
        with monkeypatch.context() as patch:
            patch.setattr(memory.os, "pwrite", fails)
            with pytest.raises(OSError):
                keeper.save(SECOND)
        assert list(place.memory.glob("*.state")) == []
        assert keeper.wait_until_written(WAIT_S)
        assert place.on_disk() == SECOND
        with pytest.raises(OSError, match="nowhere"):
            keeper.save(FIRST)
        assert keeper.wait_until_written(WAIT_S)  # the disk gets it all the same
        assert place.recalled()[0] == replace(FIRST, owner=None, proven=False)

    def test_the_next_one_that_can_be_kept_counts(self, place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
        keeper = saved(place.start(), FIRST)
        with monkeypatch.context() as patch:
            patch.setattr(memory.Slots, "write", fails)
            with pytest.raises(OSError):
                keeper.save(SECOND)
        keeper.save(SECOND)
        assert place.recalled() == (SECOND, "")


class TestFolderOfAnotherUser:
    def test_it_is_said_in_words(self, place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
        why = "/dev/shm/mavproxy-handover-0 belongs to user 1000, not to user 0, and is not used. Remove it"
        monkeypatch.setattr("mavproxy_handover.store.state_store.passed_over", lambda environment: why)
        assert place.start().note == why


class TestWithoutMemory:
    def test_it_is_kept_beside_the_disks_copy_and_said_once(self, place: Place, hanging: threading.Event) -> None:
        place.has_memory = False
        keeper = place.start()
        assert (
            keeper.note
            == f"no storage in memory: the state is kept in {place.disk}, and a slow disk may hold up a handover"
        )
        keeper.save(FIRST)
        assert place.recalled() == (FIRST, "")

    def test_and_bound_to_the_boot(self, place: Place) -> None:
        place.has_memory = False
        saved(place.start(), FIRST)
        place.boot = "boot 2"
        assert place.recalled() == (replace(FIRST, proven=False), "")

    def test_nowhere_at_all_is_said_and_raises_nothing(self, place: Place) -> None:
        place.has_memory = False
        place.disk.write_text("no folder")
        keeper = place.start()
        assert keeper.note.startswith("the state outlives no restart: ")
        assert keeper.recall()[0] is None
        with pytest.raises(OSError, match="nowhere"):
            keeper.save(FIRST)


class TestPackages:
    def test_it_is_kept_in_both_places(self, place: Place, delivery: MissionPackage) -> None:
        keeper = place.start()
        keeper.keep(delivery)
        assert keeper.wait_until_written(WAIT_S)
        assert StateFile(place.disk, "drone-1").load_package(delivery.digest) is not None
        for file in place.disk.iterdir():
            file.unlink()
        found = place.start().load_package(delivery.digest)
        assert found is not None
        assert found.to_bytes() == delivery.to_bytes()

    def test_after_a_loss_of_power_it_is_the_disks(self, place: Place, delivery: MissionPackage) -> None:
        keeper = place.start()
        keeper.keep(delivery)
        assert keeper.wait_until_written(WAIT_S)
        place.power_lost()
        assert place.start().load_package(delivery.digest) is not None
        assert place.start().load_package(DIGEST) is None

    def test_what_cannot_be_written_is_told(
        self, place: Place, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(StateFile, "save_package", fails)
        keeper = place.start()
        keeper.keep(delivery)
        assert keeper.wait_until_written(WAIT_S)
        assert keeper.tick() == ["the mission package cannot be kept: Read-only file system"] * 2


def test_the_end_waits_for_a_disk_no_longer_than_told(place: Place, hanging: threading.Event) -> None:
    keeper = place.start()
    keeper.save(FIRST)
    assert not keeper.close(0.01)
    hanging.set()
    assert place.recalled() == (FIRST, "")
