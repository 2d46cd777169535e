# SPDX-License-Identifier: GPL-3.0-or-later

"""The record in memory: the old one or the new one, whatever happens while it is written, and nobody else's."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover.store import memory
from mavproxy_handover.store.memory import SLOT_BYTES, Condition, Slots, boot_id, in_memory, memory_folder, passed_over


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state"


def found(path: Path) -> tuple[Condition, int, bytes]:
    """What the next process finds."""
    slots = Slots(path)
    slots.close()
    return slots.condition, slots.serial, slots.record


def written(path: Path, *records: bytes) -> Slots:
    slots = Slots(path)
    for serial, record in enumerate(records, 1):
        slots.write(record, serial)
    return slots


class TestKept:
    def test_at_first_there_is_nothing(self, path: Path) -> None:
        assert found(path) == (Condition.EMPTY, 0, b"")

    @pytest.mark.parametrize("count", range(1, 6))
    def test_the_last_one_counts(self, path: Path, count: int) -> None:
        written(path, *(b"record %d" % number for number in range(1, count + 1)))
        assert found(path) == (Condition.HELD, count, b"record %d" % count)

    def test_a_serial_may_leave_numbers_out(self, path: Path) -> None:
        slots = written(path, b"one")
        slots.write(b"three", 3)
        assert found(path) == (Condition.HELD, 3, b"three")

    def test_the_room_is_taken_at_once_and_never_again(self, path: Path) -> None:
        slots = Slots(path)
        before = path.stat()
        assert before.st_size == 2 * SLOT_BYTES
        assert before.st_blocks * 512 >= 2 * SLOT_BYTES
        for serial in range(1, 6):
            slots.write(b"x" * (SLOT_BYTES // 2), serial)
        after = path.stat()
        assert (after.st_size, after.st_blocks) == (before.st_size, before.st_blocks)

    def test_a_record_that_does_not_fit_is_refused_and_the_last_one_stays(self, path: Path) -> None:
        slots = written(path, b"one")
        with pytest.raises(OSError, match="more than a slot holds"):
            slots.write(b"x" * SLOT_BYTES, 2)
        assert found(path) == (Condition.HELD, 1, b"one")

    def test_what_was_made_void_is_nothing_and_shows(self, path: Path) -> None:
        slots = written(path, b"one", b"two")
        slots.void()
        assert found(path) == (Condition.VOID, 0, b"")
        slots.write(b"three", 3)
        assert found(path) == (Condition.HELD, 3, b"three")


class TestKilled:
    def test_in_the_middle_of_a_write_the_one_before_counts(self, path: Path) -> None:
        """Nobody has heard yet of what it was about to say."""
        slots = written(path, b"one", b"two" * 20, b"three" * 20)
        whole = path.read_bytes()
        slots.write(b"four" * 20, 4)
        after = path.read_bytes()
        changed = [at for at in range(len(whole)) if whole[at] != after[at]]
        assert min(changed) < SLOT_BYTES, "it goes where two was"
        for cut in range(changed[0], changed[-1] + 1):
            path.write_bytes(after[:cut] + whole[cut:])
            assert found(path) == (Condition.HELD, 3, b"three" * 20)

    def test_in_the_very_first_write_there_is_none_to_trust(self, path: Path) -> None:
        written(path, b"one" * 20)
        whole = path.read_bytes()
        for kept in (1, 8, 9, 30, 60, 100):
            path.write_bytes((whole[: SLOT_BYTES + kept]).ljust(len(whole), b"\0"))
            assert found(path)[0] is Condition.DAMAGED


class TestDamaged:
    def test_every_single_byte(self, path: Path) -> None:
        """It is the record or none; never half of one."""
        written(path, b"the record")
        whole = bytearray(path.read_bytes())
        for at in range(SLOT_BYTES, SLOT_BYTES + 80):
            whole[at] ^= 0x20
            path.write_bytes(whole)
            condition, _serial, record = found(path)
            assert (condition is Condition.HELD) is (record == b"the record")
            assert condition in (Condition.HELD, Condition.DAMAGED)
            whole[at] ^= 0x20

    @pytest.mark.parametrize("data", [b"\xff" * 2 * SLOT_BYTES, b"x", b"HNDOheld" + b"\xff" * 200], ids=len)
    def test_anything_at_all(self, path: Path, data: bytes) -> None:
        path.write_bytes(data)
        assert found(path)[::2] == (Condition.DAMAGED, b"")

    def test_a_record_in_the_other_slot_is_none(self, path: Path) -> None:
        written(path, b"one")
        whole = path.read_bytes()
        path.write_bytes(whole[SLOT_BYTES:] + whole[:SLOT_BYTES])
        assert found(path)[0] is Condition.DAMAGED


class TestOursAlone:
    def test_nobody_else_may_read_it(self, path: Path) -> None:
        path.touch(0o666)
        path.chmod(0o666)
        Slots(path).close()
        assert stat.S_IMODE(path.stat().st_mode) == 0o600

    def test_a_link_is_not_followed(self, path: Path, tmp_path: Path) -> None:
        (tmp_path / "another's").write_text("mine")
        path.symlink_to(tmp_path / "another's")
        with pytest.raises(OSError):
            Slots(path)
        assert (tmp_path / "another's").read_text() == "mine"

    def test_nor_is_a_second_name_of_a_file(self, path: Path, tmp_path: Path) -> None:
        (tmp_path / "another's").write_text("mine")
        os.link(tmp_path / "another's", path)
        with pytest.raises(PermissionError):
            Slots(path)
        assert (tmp_path / "another's").read_text() == "mine"

    @pytest.mark.parametrize("kind", ["folder", "pipe"])
    def test_what_is_no_file_is_refused_and_not_waited_for(self, path: Path, kind: str) -> None:
        path.mkdir() if kind == "folder" else os.mkfifo(path)
        with pytest.raises(OSError):
            Slots(path)

    def test_another_users_is_not_taken(self, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        Slots(path).close()
        monkeypatch.setattr(memory.os, "geteuid", lambda: os.getuid() + 1)
        with pytest.raises(PermissionError):
            Slots(path)


class TestTheFolder:
    @pytest.fixture
    def shared(self, runtime_directory: Path | None, tmp_path: Path) -> Path:
        if runtime_directory is None:
            pytest.skip("no storage in memory here")
        shared = runtime_directory / tmp_path.name
        shared.mkdir()
        return shared

    def test_the_one_that_is_named_goes_first(self, shared: Path) -> None:
        folder = memory_folder({"RUNTIME_DIRECTORY": f"{shared}:/another"})
        assert folder is not None
        assert folder.parent == shared
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert memory_folder({"RUNTIME_DIRECTORY": str(shared)}) == folder

    def test_one_on_a_disk_is_passed_over(self, shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(memory, "in_memory", lambda path: False)
        assert memory_folder({"RUNTIME_DIRECTORY": str(shared)}) is None
        assert list(shared.iterdir()) == []

    @pytest.mark.parametrize("how", ["open to others", "a link", "a file", "another's"])
    def test_one_that_may_be_somebody_elses_is_passed_over(
        self, shared: Path, how: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Whoever made it first in a place that is everybody's could put there what he likes."""
        folder = memory_folder({"RUNTIME_DIRECTORY": str(shared)})
        assert folder is not None
        if how == "open to others":
            folder.chmod(0o770)
        elif how == "another's":
            found = folder.lstat()
            fields = [*found][:10]
            fields[4] = found.st_uid + 1
            real = Path.lstat
            monkeypatch.setattr(Path, "lstat", lambda path: os.stat_result(fields) if path == folder else real(path))
        else:
            folder.rmdir()
            if how == "a file":
                folder.touch()
            else:
                folder.symlink_to(shared.parent)
        assert memory_folder({"RUNTIME_DIRECTORY": str(shared)}) != folder

    def test_the_user_hears_whose_it_is_and_what_to_do(self, shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        environment = {"RUNTIME_DIRECTORY": str(shared)}
        folder = memory_folder(environment)
        assert folder is not None
        assert passed_over(environment) == ""
        folder.chmod(0o770)
        cure = f"and is not used. Remove it (sudo rm -r {folder}) and start again"
        assert passed_over(environment) == f"{folder} has mode 0770, which lets other users in, {cure}"
        folder.chmod(0o700)
        found = folder.lstat()
        fields = [*found][:10]
        fields[4] = 4242
        real = Path.lstat
        monkeypatch.setattr(Path, "lstat", lambda path: os.stat_result(fields) if path == folder else real(path))
        assert passed_over(environment) == f"{folder} belongs to user 4242, not to user {os.geteuid()}, {cure}"

    def test_what_lives_in_memory(self, tmp_path: Path) -> None:
        assert not in_memory(tmp_path / "not there")
        assert not in_memory(Path("/proc"))

    @pytest.mark.parametrize("mounts", ["", "1 2\n", "a b c - \n", "22 1 {} / / rw\n"], ids=repr)
    def test_a_list_of_mounts_that_makes_no_sense_is_none(
        self, tmp_path: Path, mounts: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        device = tmp_path.stat().st_dev
        file = tmp_path / "mounts"
        file.write_text(mounts.format(f"{os.major(device)}:{os.minor(device)}"))
        monkeypatch.setattr(memory, "_MOUNTS", file)
        assert not in_memory(tmp_path)
        file.write_text(f"22 1 {os.major(device)}:{os.minor(device)} / /x rw shared:3 - tmpfs tmpfs rw\n")
        assert in_memory(tmp_path)


def test_the_boot_has_a_name_or_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert boot_id() == boot_id()
    monkeypatch.setattr(memory, "_BOOT_ID", tmp_path / "not there")
    assert boot_id() == ""


def test_what_is_left_of_a_file_that_cannot_be_made_whole_is_closed(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_arguments: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(memory.os, "posix_fallocate", full)
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(OSError, match="No space left"):
        Slots(path)
    assert len(os.listdir("/proc/self/fd")) == before
