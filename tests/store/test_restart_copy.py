# SPDX-License-Identifier: GPL-3.0-or-later

"""The restart copy: found by its configuration file, this user's alone, and only whole."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from mavproxy_handover.store import durable, restart_copy
from mavproxy_handover.store.restart_copy import RestartCopy

RUN = {"text": "abc", "keys": {"GCSA": ["key", None]}}


@pytest.fixture
def record(tmp_path: Path) -> RestartCopy:
    made = RestartCopy(tmp_path / "handover.toml")
    made.save(RUN)
    return made


def path_of(record: RestartCopy) -> Path:
    assert record.path is not None
    return record.path


def test_what_was_saved_is_loaded_and_gone_once_it_is_removed(record: RestartCopy, tmp_path: Path) -> None:
    assert RestartCopy(tmp_path / "handover.toml").load() == RUN
    assert RestartCopy(tmp_path / "other.toml").load() is None
    record.remove()
    record.remove()
    assert record.load() is None


def test_nobody_else_can_read_it(record: RestartCopy) -> None:
    before = os.umask(0)
    try:
        record.save(RUN)
    finally:
        os.umask(before)
    assert path_of(record).stat().st_mode & 0o777 == 0o600
    assert path_of(record).parent.stat().st_mode & 0o777 == 0o700
    assert list(path_of(record).parent.glob(f".{path_of(record).name}.*")) == []


def others_may_read(path: Path) -> None:
    path.chmod(0o604)


def is_a_link(path: Path) -> None:
    path.rename(path.with_suffix(".moved"))
    path.symlink_to(path.with_suffix(".moved"))


def is_a_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path, 0o600)


def is_cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


def is_changed(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b'"abc"', b'"abd"'))


def is_no_object(path: Path) -> None:
    path.write_text("[]")


def is_nested(path: Path) -> None:
    path.write_text("[" * 100_000)


def is_of_another_form(path: Path) -> None:
    whole = json.loads(path.read_text())
    whole["body"]["format"] = 2
    whole["sha256"] = durable.checksum(whole["body"])
    path.write_text(json.dumps(whole))


@pytest.mark.parametrize(
    "spoil",
    [others_may_read, is_a_link, is_a_pipe, is_cut, is_changed, is_no_object, is_nested, is_of_another_form],
)
def test_what_does_not_count_is_not_loaded(record: RestartCopy, spoil: Callable[[Path], None]) -> None:
    spoil(path_of(record))
    assert record.load() is None


def test_nor_is_one_of_another_boot(record: RestartCopy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(restart_copy, "boot_id", lambda: "another")
    assert record.load() is None


def test_what_cannot_be_saved_leaves_what_was_before(record: RestartCopy, monkeypatch: pytest.MonkeyPatch) -> None:

    def full(_path: Path, _data: bytes, *, sync: bool = True) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(restart_copy, "replace_whole", full)
    with pytest.raises(OSError, match="No space left"):
        record.save({"text": "other"})
    assert record.load() == RUN


def test_a_rename_that_fails_leaves_no_keys_beside_it(record: RestartCopy, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fault: the temporary file stayed, with the keys of every station in it."""

    def refuse(_source: Path, _target: Path) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", refuse)
        with pytest.raises(OSError, match="Input/output error"):
            record.save({"keys": "others"})
    assert list(path_of(record).parent.glob(f".{path_of(record).name}*")) == []
    assert record.load() == RUN


def test_what_a_killed_run_left_half_written_goes_with_the_record(record: RestartCopy) -> None:
    """It holds keys too, and no later write meets its name."""
    left = path_of(record).with_name(f".{path_of(record).name}.0a1b2c3d")
    other = path_of(record).with_name(".other.run.0a1b2c3d")
    left.touch()
    other.touch()
    record.remove()
    assert not left.exists()
    assert other.exists()
    other.unlink()


def test_without_storage_in_memory_nothing_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(restart_copy, "memory_folder", lambda _environment: None)
    record = RestartCopy(tmp_path / "handover.toml")
    with pytest.raises(OSError, match="there is no storage in memory"):
        record.save(RUN)
    assert record.load() is None
    record.remove()
