# SPDX-License-Identifier: GPL-3.0-or-later

"""The lock of a vehicle: one holder at a time, and free as soon as that is gone."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mavproxy_handover.store.lock import LockError, VehicleLock, lock_line

HOLD = """
import sys
from pathlib import Path
from mavproxy_handover.store.lock import VehicleLock
lock = VehicleLock(Path(sys.argv[1]), "drone-1")
print("held", flush=True)
sys.stdin.read()
"""


def test_the_second_is_refused_and_told_why(tmp_path: Path) -> None:
    first = VehicleLock(tmp_path / "state", "drone-1")
    with pytest.raises(LockError) as refused:
        VehicleLock(tmp_path / "state", "drone-1")
    path = tmp_path / "state" / "drone-1.lock"
    assert str(refused.value) == f"{path} is locked: another companion of drone-1 is running"
    first.release()
    first.release()
    VehicleLock(tmp_path / "state", "drone-1").release()


def test_a_refusal_leaves_no_descriptor_open(tmp_path: Path) -> None:
    first = VehicleLock(tmp_path, "drone-1")
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        with pytest.raises(LockError):
            VehicleLock(tmp_path, "drone-1")
    assert len(os.listdir("/proc/self/fd")) == before
    first.release()


def test_two_vehicles_of_one_folder_do_not_know_each_other(tmp_path: Path) -> None:
    locks = [VehicleLock(tmp_path, name) for name in ("drone-1", "drone-2")]
    for lock in locks:
        lock.release()


def test_it_is_free_when_its_holder_is_killed(tmp_path: Path) -> None:
    argv = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(LockError):
            VehicleLock(tmp_path, "drone-1")
        holder.kill()
        holder.wait()
        VehicleLock(tmp_path, "drone-1").release()


def test_a_file_that_may_only_be_read_is_enough(tmp_path: Path) -> None:
    """As on a disk that the system has made read-only because it fails."""
    path = tmp_path / "drone-1.lock"
    path.touch(mode=0o444)
    lock = VehicleLock(tmp_path, "drone-1")
    assert path.stat().st_size == 0
    lock.release()


def test_a_folder_that_cannot_be_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "state").write_text("a file")
    with pytest.raises(OSError, match="exists"):
        VehicleLock(tmp_path / "state", "drone-1")


def test_in_flight_the_lock_in_memory_is_enough(tmp_path: Path) -> None:
    """The folder beside the state is gone; a second companion is refused all the same, also once it is back."""
    folder = tmp_path / "state"
    folder.write_text("a file in the way")
    lock = VehicleLock(folder, "drone-1", strict=False)
    with pytest.raises(LockError, match="another companion of drone-1 is running"):
        VehicleLock(folder, "drone-1", strict=False)
    folder.unlink()
    for strict in (True, False):
        with pytest.raises(LockError, match="another companion of drone-1 is running"):
            VehicleLock(folder, "drone-1", strict=strict)
    lock.release()
    VehicleLock(folder, "drone-1").release()


def test_a_folder_that_was_made_anew_holds_no_second_companion(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    lock = VehicleLock(folder, "drone-1")
    shutil.rmtree(folder)
    with pytest.raises(LockError, match="another companion of drone-1 is running"):
        VehicleLock(folder, "drone-1")
    lock.release()


def test_without_storage_in_memory_the_folder_is_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mavproxy_handover.store.lock.memory_folder", lambda _environment: None)
    (tmp_path / "state").write_text("a file")
    with pytest.raises(OSError, match="exists"):
        VehicleLock(tmp_path / "state", "drone-1", strict=False)
    lock = VehicleLock(tmp_path / "other", "drone-1")
    assert len(lock.descriptors) == 1
    lock.release()


def test_no_other_user_can_hold_it(tmp_path: Path) -> None:
    lock = VehicleLock(tmp_path, "drone-1")
    assert (tmp_path / "drone-1.lock").stat().st_mode & 0o777 == 0o600
    lock.release()


def test_a_serial_line_is_one_companion_s() -> None:
    near, far = os.openpty()
    name = os.ttyname(far)
    other = os.open(name, os.O_RDWR | os.O_NOCTTY)
    try:
        lock_line(far, name)
        lock_line(far, name)  # by the same one, as often as it likes
        with pytest.raises(LockError) as refused:
            lock_line(other, name)
        assert str(refused.value) == f"{name} is locked: another program uses this line, maybe another companion"
        os.close(far)
        lock_line(other, name)
    finally:
        os.close(near)
        os.close(other)


def test_what_knows_no_locks_is_left_as_it_is() -> None:
    closed = os.open(os.devnull, os.O_RDONLY)
    os.close(closed)
    lock_line(closed, "nothing")
