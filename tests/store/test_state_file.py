# SPDX-License-Identifier: GPL-3.0-or-later

"""The state file: after whatever happened to it, the old state, the new one, or the word that none is to be trusted."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.common.snapshot import PackMemory, Snapshot
from mavproxy_handover.core.safety.battery import Batteries, PackReport
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store import state_file
from mavproxy_handover.store.state_file import Kept, StateError, StateFile

MISSIONS = Path(__file__).resolve().parents[2] / "missions"
DIGEST = bytes(range(32))
LOW = PackMemory(59.0, 1.0, 60.0)
BEFORE = Snapshot(
    251, 4, 7, Phase.ON_MISSION, 2, DIGEST, (251, 252, 251), True, "land", lasting=(Cause.ENERGY,), packs=(LOW,)
)
AFTER = Snapshot(252, 5, 8, Phase.ON_HANDOVER, 3, DIGEST, (251, 252, 251), False, "return")


def held(store: StateFile) -> Snapshot | None:
    """What the file says."""
    kept = store.load()
    return None if kept is None else kept.snapshot


def told(store: StateFile) -> Snapshot | str | None:
    """What the file says, or why it is not to be trusted."""
    try:
        return held(store)
    except StateError as error:
        return str(error)


class Killed(BaseException):
    """The process ends here: nothing behind it runs, whatever it catches."""


@pytest.fixture
def store(tmp_path: Path) -> StateFile:
    return StateFile(tmp_path, "drone-1")


@pytest.fixture(scope="module")
def delivery() -> MissionPackage:
    return mission_package.load(MISSIONS / "delivery")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "drone-1.state.json"


def signed(body: Any) -> bytes:
    """A file whose checksum fits, whatever its contents."""
    text = json.dumps(body, sort_keys=True)
    return json.dumps({"body": body, "sha256": hashlib.sha256(text.encode()).hexdigest()}).encode()


def good_body() -> dict[str, Any]:
    return {
        "format": 9,
        "vehicle": "drone-1",
        "boot": "b1",
        "serial": 12,
        "owner": 251,
        "epoch": 4,
        "handover_id": 7,
        "phase": 1,
        "route_at": 2,
        "digest": DIGEST.hex(),
        "route": [251, 252, 251],
        "takeover_allowed": True,
        "out_of_coverage": "land",
        "gap_since": None,
        "proven": True,
        "rehearsal": False,
        "held_since": None,
        "held_for": None,
        "stands": False,
        "lasting": ["energy"],
        "packs": [{"left_wh": 59.0, "used_wh": 1.0, "most_wh": 60.0, "ohm": None}],
        "kept": False,
        "kept_by": "",
    }


GOOD_PACK = good_body()["packs"][0]
BAD_AMOUNTS = (1, "1.0", True, [1.0], -0.1, 1.1e12, float("nan"), float("inf"))


class TestKept:
    @pytest.mark.parametrize(
        "snapshot",
        [
            BEFORE,
            AFTER,
            Snapshot(None, 0, 0, Phase.ON_LOAD, 0, b"", ()),
            Snapshot(255, 0xFFFF_0000, 0xFFFF, Phase.EMERGENCY, 9, DIGEST, (1,) * 50),
            replace(BEFORE, proven=False),
            replace(BEFORE, gap_since=1234.5),
            replace(BEFORE, gap_since=-1e9),
            replace(BEFORE, rehearsal=True),
            replace(BEFORE, held_since=1234.5, held_for=Cause.COVERAGE_ENDS),
            replace(BEFORE, stands=True),
            replace(BEFORE, lasting=()),
            replace(BEFORE, packs=(PackMemory(), PackMemory(0.0, 126.0, 1e12, 0.021))),
            replace(BEFORE, kept=True, kept_by=DIGEST),
        ],
    )
    def test_what_was_saved_is_what_is_loaded(self, store: StateFile, snapshot: Snapshot) -> None:
        store.save(snapshot)
        assert held(store) == snapshot

    def test_no_word_of_a_battery_monitor_costs_the_file(self, store: StateFile) -> None:
        """The fault: a counter of millions was kept, and with it the next run read nothing of who commands either."""
        packs = Batteries(126.0, 1, 3.0, 1e9, 385.0)
        most = PackReport(used_mah=1e8, remaining=1.0, voltage_v=1000.0, current_a=10_000.0)
        for second in range(10):
            packs.add_report(0, replace(most, used_mah=1e8 * (second % 2)), float(second), False)
        assert packs.memory
        assert (packs.memory[0].used_wh or 0.0) > 1e7
        snapshot = replace(BEFORE, packs=packs.memory)
        store.save(snapshot)
        assert held(store) == snapshot

    def test_the_last_one_counts(self, store: StateFile) -> None:
        store.save(BEFORE)
        store.save(AFTER)
        assert held(store) == AFTER

    def test_the_file_is_what_it_says(self, store: StateFile, path: Path) -> None:
        store.save(BEFORE, "b1", 12)
        assert json.loads(path.read_bytes()) == json.loads(signed(good_body()))
        path.write_bytes(signed(good_body()))
        assert store.load() == Kept(BEFORE, "b1", 12)

    def test_another_run_reads_it(self, store: StateFile, tmp_path: Path) -> None:
        store.save(BEFORE)
        assert held(StateFile(tmp_path, "drone-1")) == BEFORE

    def test_two_vehicles_do_not_mix(self, store: StateFile, tmp_path: Path) -> None:
        other = StateFile(tmp_path, "drone-2")
        store.save(BEFORE)
        other.save(AFTER)
        assert (held(store), held(other)) == (BEFORE, AFTER)

    def test_the_folder_is_made(self, tmp_path: Path) -> None:
        store = StateFile(tmp_path / "not" / "there", "drone-1")
        assert held(store) is None
        store.save(BEFORE)
        assert held(store) == BEFORE

    def test_never_saved_is_nothing_to_recover(self, store: StateFile) -> None:
        assert store.load() is None


class TestNotTrusted:
    """A file that is there and does not fit is never guessed at."""

    def check(self, store: StateFile, why: str = "") -> None:
        with pytest.raises(StateError, match="not to be trusted") as caught:
            store.load()
        text = str(caught.value)
        assert why in text
        assert "\n" not in text

    @pytest.mark.parametrize("kept", [0, 1, 2, 10, 100, 200, -1])
    def test_cut_off(self, store: StateFile, path: Path, kept: int) -> None:
        store.save(BEFORE)
        path.write_bytes(path.read_bytes()[:kept])
        self.check(store)

    def test_cut_off_anywhere(self, store: StateFile, path: Path) -> None:
        store.save(BEFORE)
        whole = path.read_bytes()
        for length in range(len(whole)):
            path.write_bytes(whole[:length])
            assert not isinstance(told(store), Snapshot)

    def test_the_end_overwritten_with_zeros(self, store: StateFile, path: Path) -> None:
        # what a file system may leave behind when the power fails
        store.save(BEFORE)
        whole = path.read_bytes()
        for length in range(0, len(whole), 7):
            path.write_bytes(whole[:length] + bytes(len(whole) - length))
            self.check(store)

    def test_the_head_of_one_and_the_tail_of_the_other(self, store: StateFile, path: Path) -> None:
        store.save(BEFORE)
        before = path.read_bytes()
        store.save(AFTER)
        after = path.read_bytes()
        for cut in range(1, min(len(before), len(after))):
            path.write_bytes(before[:cut] + after[cut:])
            try:
                loaded = held(store)
            except StateError:
                continue
            assert loaded in (BEFORE, AFTER)

    def test_every_single_bit(self, store: StateFile, path: Path) -> None:
        store.save(BEFORE)
        whole = bytearray(path.read_bytes())
        for position in range(len(whole)):
            for bit in range(8):
                whole[position] ^= 1 << bit
                path.write_bytes(whole)
                loaded = told(store)
                # white space and the case of an escape say the same either way; nothing else may
                assert loaded == BEFORE or isinstance(loaded, str)
                whole[position] ^= 1 << bit

    @settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(data=st.binary(max_size=200))
    def test_anything_at_all(self, store: StateFile, path: Path, data: bytes) -> None:
        path.write_bytes(data)
        self.check(store)

    @pytest.mark.parametrize(
        "data",
        [
            b"null",
            b"[]",
            b"{}",
            b"3",
            b'"body"',
            b'{"body": {}}',
            b'{"body": null, "sha256": null}',
            b"[" * 100_000,
            b'{"body": ' * 5000,
            b"\xff\xfe",
            signed(None),
            signed([]),
            signed({}),
            signed("x"),
        ],
        ids=lambda data: repr(data[:20]),
    )
    def test_other_json(self, store: StateFile, path: Path, data: bytes) -> None:
        path.write_bytes(data)
        self.check(store)

    def test_a_checksum_of_something_else(self, store: StateFile, path: Path) -> None:
        whole = json.loads(signed(good_body()))
        whole["body"]["owner"] = 252
        path.write_bytes(json.dumps(whole).encode())
        self.check(store, "its checksum does not fit")

    @pytest.mark.parametrize("change", [{"vehicle": "drone-2"}, {"vehicle": None}, {"format": 1}, {"format": "2"}])
    def test_of_another_vehicle_or_version(self, store: StateFile, path: Path, change: dict[str, Any]) -> None:
        path.write_bytes(signed(good_body() | change))
        self.check(store, "it is of another vehicle or version")

    def test_a_file_copied_from_another_vehicle(self, store: StateFile, tmp_path: Path, path: Path) -> None:
        StateFile(tmp_path, "drone-2").save(AFTER)
        os.replace(tmp_path / "drone-2.state.json", path)
        self.check(store, "it is of another vehicle or version")

    @pytest.mark.parametrize("key", list(good_body()))
    def test_a_key_that_is_missing(self, store: StateFile, path: Path, key: str) -> None:
        body = good_body()
        del body[key]
        path.write_bytes(signed(body))
        self.check(store)

    @pytest.mark.parametrize(
        "change",
        [
            {"owner": "GCSA"},
            {"owner": [251]},
            {"owner": float("inf")},
            {"owner": float("nan")},
            {"epoch": None},
            {"epoch": "four"},
            {"epoch": float("inf")},
            {"handover_id": {}},
            {"phase": 4},
            {"phase": -1},
            {"phase": "ON_MISSION"},
            {"phase": None},
            {"digest": "xyz"},
            {"digest": 5},
            {"route": None},
            {"route": 251},
            {"route": ["GCSA"]},
            {"route_at": None},
            {"out_of_coverage": 2},
            {"out_of_coverage": "off"},
            {"held_for": "nothing"},
            {"held_since": 12},
            # of its kind, and out of its range
            {"owner": 0},
            {"owner": 256},
            {"owner": 251.5},
            {"owner": True},
            {"owner": "251"},
            {"epoch": -1},
            {"epoch": 1 << 32},
            {"epoch": 0xFFFF_FFFF},  # the one behind it could not be sent
            {"epoch": 0xFFFF_0001},
            {"epoch": 4.5},
            {"epoch": "4"},
            {"handover_id": -1},
            {"handover_id": 0x10000},
            {"phase": True},
            {"phase": 1.0},
            {"digest": "00"},
            {"digest": DIGEST.hex() + "00"},
            {"route": [251, 0]},
            {"route": [251, 252.5]},
            {"route": "251"},
            {"route": {"251": 1}},
            {"route_at": -1},
            {"route_at": 4},
            {"route_at": 1.5},
            {"takeover_allowed": 1},
            {"takeover_allowed": None},
            {"takeover_allowed": "false"},
            {"out_of_coverage": True},
            {"held_for": ["energy"]},
            {"held_since": "12.0"},
            {"boot": None},
            {"boot": 1},
            {"serial": -1},
            {"serial": 1 << 63},
            {"serial": True},
            {"serial": None},
            {"proven": 1},
            {"rehearsal": 1},
            {"rehearsal": None},
            {"proven": None},
            {"lasting": None},
            {"lasting": "energy"},
            {"lasting": ["nothing"]},
            {"lasting": [["energy"]]},
            {"lasting": ["fence"]},  # it is over when its sign is gone
            {"packs": None},
            {"kept": 1},
            {"kept_by": "00"},
            {"packs": {}},
            {"packs": [None]},
            {"packs": [[59.0, 1.0, 60.0, None]]},
            {"packs": [{}]},
            {"packs": [{"left_wh": 59.0, "used_wh": 1.0, "most_wh": 60.0}]},
            {"packs": [GOOD_PACK | {"cells": 3.0}]},
            *({"packs": [GOOD_PACK, GOOD_PACK | {name: value}]} for name in GOOD_PACK for value in BAD_AMOUNTS),
            {"stands": 1},
            {"stands": None},
        ],
        ids=str,
    )
    def test_a_value_that_is_none_of_its_kind(self, store: StateFile, path: Path, change: dict[str, Any]) -> None:
        path.write_bytes(signed(good_body() | change))
        self.check(store)

    def test_a_folder_in_its_place(self, store: StateFile, path: Path) -> None:
        path.mkdir()
        with pytest.raises(StateError, match="Is a directory"):
            store.load()
        assert not isinstance(told(store), Snapshot)

    def test_a_file_in_place_of_the_folder(self, tmp_path: Path) -> None:
        (tmp_path / "state").write_text("")
        store = StateFile(tmp_path / "state", "drone-1")
        with pytest.raises(StateError, match="Not a directory"):
            store.load()

    def test_the_next_save_puts_it_right(self, store: StateFile, path: Path) -> None:
        path.write_bytes(b"rubbish")
        store.save(AFTER)
        assert held(store) == AFTER


#: where the process can die while it saves, in the order in which these are called
STEPS = ["open", "write", "flush", "fsync", "replace", "fsync of the folder"]


def dying_at(step: str, monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """From now on a save ends at this step; returns what ends that."""
    context = pytest.MonkeyPatch()
    if step in ("open", "write", "flush"):
        original = Path.open

        def opened(self: Path, *arguments: Any, **options: Any) -> Any:
            if step == "open":
                raise Killed
            with original(self, *arguments, **options) as file:
                if step == "flush":
                    file.write(b'{"body": {"half')
            raise Killed

        context.setattr(Path, "open", opened)
    elif step == "fsync":
        context.setattr(state_file.os, "fsync", killed)
    elif step == "replace":
        context.setattr(state_file.os, "replace", killed)
    else:
        context.setattr(state_file, "sync_folder", killed)
    return context.undo


def killed(*_arguments: Any) -> None:
    raise Killed


class TestKilled:
    """A crash in the middle of a save leaves the old state or the new one."""

    @pytest.mark.parametrize("step", STEPS)
    def test_the_old_state_or_the_new_one(
        self, store: StateFile, tmp_path: Path, step: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        store.save(BEFORE)
        end = dying_at(step, monkeypatch)
        with pytest.raises(Killed):
            store.save(AFTER)
        end()
        expected = AFTER if step == "fsync of the folder" else BEFORE
        assert held(StateFile(tmp_path, "drone-1")) == expected

    @pytest.mark.parametrize("step", STEPS)
    def test_and_the_next_run_can_save(
        self, store: StateFile, tmp_path: Path, step: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        end = dying_at(step, monkeypatch)
        with pytest.raises(Killed):
            store.save(BEFORE)
        end()
        again = StateFile(tmp_path, "drone-1")
        again.save(AFTER)
        assert held(again) == AFTER

    @pytest.mark.parametrize("step", STEPS[:-1])
    def test_at_the_very_first_save_there_is_none(
        self, store: StateFile, step: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        end = dying_at(step, monkeypatch)
        with pytest.raises(Killed):
            store.save(BEFORE)
        end()
        assert store.load() is None

    def test_what_a_killed_save_has_left_is_never_read(self, store: StateFile, path: Path) -> None:
        store.save(BEFORE)
        (path.parent / "drone-1.state.json.new").write_bytes(b'{"body": {"owner": 252')
        assert held(store) == BEFORE

    def test_it_is_on_the_disk_before_it_has_its_name(self, store: StateFile, monkeypatch: pytest.MonkeyPatch) -> None:
        order: list[str] = []
        fsync, renamed = os.fsync, os.replace
        monkeypatch.setattr(state_file.os, "fsync", lambda d: (order.append("fsync"), fsync(d))[1])
        monkeypatch.setattr(state_file.os, "replace", lambda a, b: (order.append("replace"), renamed(a, b))[1])
        monkeypatch.setattr(state_file, "sync_folder", lambda p: order.append("folder"))
        store.save(BEFORE)
        assert order == ["fsync", "replace", "folder"]


class TestUnwritable:
    """What cannot be written is an OSError, and what was there stays."""

    def test_a_folder_that_cannot_be_made(self, tmp_path: Path) -> None:
        (tmp_path / "state").write_text("")
        with pytest.raises(OSError):
            StateFile(tmp_path / "state", "drone-1").save(BEFORE)

    @pytest.mark.parametrize("call", ["fsync", "replace"])
    def test_a_full_disk(self, store: StateFile, call: str, monkeypatch: pytest.MonkeyPatch) -> None:
        def full(*_arguments: Any) -> None:
            raise OSError(28, "No space left on device")

        store.save(BEFORE)
        with monkeypatch.context() as patch:
            patch.setattr(state_file.os, call, full)
            with pytest.raises(OSError, match="No space left"):
                store.save(AFTER)
        assert held(store) == BEFORE
        store.save(AFTER)
        assert held(store) == AFTER

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
    def test_a_folder_without_permission(self, tmp_path: Path) -> None:
        tmp_path.chmod(0o500)
        try:
            with pytest.raises(PermissionError):
                StateFile(tmp_path, "drone-1").save(BEFORE)
        finally:
            tmp_path.chmod(0o700)


class TestPackage:
    def test_kept_and_found_by_its_digest(self, store: StateFile, delivery: MissionPackage) -> None:
        store.save_package(delivery)
        found = store.load_package(delivery.digest)
        assert found is not None
        assert found.digest == delivery.digest
        assert found.to_bytes() == delivery.to_bytes()

    def test_another_digest_is_another_mission(self, store: StateFile, delivery: MissionPackage) -> None:
        store.save_package(delivery)
        assert store.load_package(DIGEST) is None
        assert store.load_package(b"") is None

    def test_none_was_kept(self, store: StateFile, delivery: MissionPackage) -> None:
        assert store.load_package(delivery.digest) is None

    def test_damaged_it_is_none(self, store: StateFile, tmp_path: Path, delivery: MissionPackage) -> None:
        store.save_package(delivery)
        path = tmp_path / "drone-1.mission"
        whole = bytearray(path.read_bytes())
        for position in range(0, len(whole), max(1, len(whole) // 150)):
            whole[position] ^= 0x10
            path.write_bytes(whole)
            found = store.load_package(delivery.digest)
            assert found is None or found.to_bytes() == delivery.to_bytes()
            whole[position] ^= 0x10
            path.write_bytes(whole[:position])
            assert store.load_package(delivery.digest) is None

    def test_a_killed_save_leaves_the_old_one(self, store: StateFile, delivery: MissionPackage) -> None:
        store.save_package(delivery)
        patch = pytest.MonkeyPatch()
        patch.setattr(state_file.os, "replace", killed)
        with pytest.raises(Killed):
            store.save_package(delivery)
        patch.undo()
        assert store.load_package(delivery.digest) is not None

    def test_state_and_mission_do_not_touch_each_other(
        self, store: StateFile, tmp_path: Path, delivery: MissionPackage
    ) -> None:
        store.save(replace(BEFORE, digest=delivery.digest))
        store.save_package(delivery)
        (tmp_path / "drone-1.state.json").unlink()
        assert store.load_package(delivery.digest) is not None
