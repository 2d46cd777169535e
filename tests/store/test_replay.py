# SPDX-License-Identifier: GPL-3.0-or-later

"""The replay state on disk: what was accepted before a restart, a crash or a damaged file is not accepted after it."""

from __future__ import annotations

import hashlib
import json
import os
import stat
import tempfile
import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.store import replay
from mavproxy_handover.store.replay import ReplayStore
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer, fingerprint, sign

OK = SignatureVerdict.OK
TOO_OLD = SignatureVerdict.TOO_OLD

KEY = bytes(range(32))
OTHER_KEY = bytes(range(1, 33))
#: 2026-11-20 00:00 UTC
UTC_S = 1_795_132_800.0
STAMP = 37_506_240_000_000
SECOND = 100_000


def heartbeat(stamp: int, key: bytes = KEY, link: int = 0) -> Frame:
    plain = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 251, 190)))
    frame = parse_one(sign(plain, key, link, stamp) or b"")
    assert frame is not None
    return frame


def started(path: Path, utc_s: float = UTC_S) -> tuple[ReplayStore, SignedPeer]:
    """A companion's start, as far as GCSA's key is concerned."""
    store, peer = ReplayStore(path), SignedPeer(KEY)
    store.load(utc_s)
    store.attach("GCSA", peer)
    return store, peer


def test_our_own_stamps_go_on_above_all_that_was_sent_where_that_is_asked_for(path: Path) -> None:
    """The autopilot refuses what is not newer; a crash in between costs no stamp either."""
    plain = bytes(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 1, 191)))
    newest = 0
    for start, orderly in enumerate((True, False, False, True, False)):
        store, peer = ReplayStore(path), SignedPeer(KEY, keeps_sent=True)
        store.load(0.0)
        store.attach("autopilot", peer)
        for count in range(40):
            now_s = start * 10.0 + count / 10
            signed = peer.sign(plain, 1, UTC_S if start == 0 else 0.0, now_s)
            assert signed is not None
            stamp = int.from_bytes(signed[-12:-6], "little")
            assert stamp >= newest + (SECOND // 20 if count else 1)  # nor do they fall behind time
            newest = stamp
            store.tick(now_s)
            settle(store)
        if orderly:
            store.close()
    assert newest < STAMP + 60 * SECOND


def settle(store: ReplayStore) -> None:
    """Wait for the write that is under way."""
    assert store.wait_until_written(WAIT_S)


WAIT_S = 30.0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "replay.json"


def test_after_an_orderly_restart_old_frames_are_refused_and_new_ones_accepted_at_once(path: Path) -> None:
    store, peer = started(path)
    assert store.note == f"{path}: no replay state yet; signed frames are accepted if they are new by the clock"
    assert peer.check(heartbeat(STAMP), UTC_S, 0.0) is OK
    store.close()
    store, peer = started(path, utc_s=0.0)
    assert store.note == ""
    assert peer.check(heartbeat(STAMP), 0.0, 0.0) is TOO_OLD
    assert peer.check(heartbeat(STAMP, link=1), 0.0, 0.0) is TOO_OLD
    assert peer.check(heartbeat(STAMP + 1), 0.0, 0.0) is OK


def test_after_a_crash_nothing_accepted_since_the_last_write_is_accepted_again(path: Path) -> None:
    store, peer = started(path)
    captured = []
    for count in range(200):  # ten frames a second for 20 seconds, a tick after each; then the process is gone
        now_s = count / 10
        captured.append(heartbeat(STAMP + int(now_s * SECOND)))
        assert peer.check(captured[-1], UTC_S + now_s, now_s) is OK
        store.tick(now_s)
        settle(store)
    _store, peer = started(path, utc_s=0.0)
    assert {peer.check(frame, 0.0, 0.0) for frame in captured} == {TOO_OLD}
    # ahead by no more than the reserve of 4 s
    assert peer.check(heartbeat(STAMP + 24 * SECOND), 0.0, 0.0) is OK


def test_it_is_written_when_half_the_reserve_is_used_up_and_not_while_nobody_speaks(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[int] = []
    store, peer = started(path)
    real = os.replace

    def watched(source: Path, target: Path) -> None:
        real(source, target)
        written.append(json.loads(path.read_text())["stamps"]["GCSA"][fingerprint(KEY)])

    monkeypatch.setattr(os, "replace", watched)

    def at(second: float, *, frame: bool) -> list[int]:
        if frame:
            assert peer.check(heartbeat(STAMP + int(second * SECOND)), UTC_S + second, second) is OK
        store.tick(second)
        settle(store)
        return written

    at(0.0, frame=False)
    assert written == []
    at(0.0, frame=True)
    assert written == [STAMP + 4 * SECOND]
    for tenth in range(1, 21):  # two seconds: not more than half
        at(tenth / 10, frame=True)
    assert len(written) == 1
    at(2.1, frame=True)
    assert written[1:] == [STAMP + int(6.1 * SECOND)]
    for second in range(3, 100):
        at(float(second), frame=False)
    assert len(written) == 2


def test_stamps_that_jump_do_not_make_it_write_more_than_once_a_second(path: Path) -> None:
    store, peer = started(path)
    writes = 0
    for count in range(100):  # two seconds; each frame ten seconds after the one before it, by its stamp
        assert peer.check(heartbeat(STAMP + count * 10 * SECOND), UTC_S, count / 50) is OK
        before = path.read_bytes() if path.exists() else b""
        store.tick(count / 50)
        settle(store)
        writes += path.read_bytes() != before
    assert writes == 2


def test_restarts_without_a_frame_do_not_move_the_stamp(path: Path) -> None:
    store, peer = started(path)
    assert peer.check(heartbeat(STAMP), UTC_S, 0.0) is OK
    store.tick(0.0)
    settle(store)  # and crashed
    for _ in range(10):
        store, peer = started(path)
        store.tick(0.0)
        settle(store)
        store.close()
    _store, peer = started(path)
    assert peer.check(heartbeat(STAMP + 4 * SECOND + 1), 0.0, 0.0) is OK


def test_the_stamp_of_a_peer_that_is_silent_does_not_move_while_others_speak(path: Path) -> None:
    for start in range(3):
        store = ReplayStore(path)
        store.load(UTC_S)
        gcsa, gcsb = SignedPeer(KEY), SignedPeer(OTHER_KEY)
        store.attach("GCSA", gcsa)
        store.attach("GCSB", gcsb)
        if start == 0:
            assert gcsb.check(heartbeat(STAMP, OTHER_KEY), UTC_S, 0.0) is OK
            store.close()
            continue
        assert gcsa.check(heartbeat(STAMP + start * 100 * SECOND), UTC_S, 0.0) is OK
        store.tick(0.0)
        settle(store)  # and crashed
        stamps = json.loads(path.read_text())["stamps"]
        assert stamps["GCSA"] == {fingerprint(KEY): STAMP + (start * 100 + 4) * SECOND}
        assert stamps["GCSB"] == {fingerprint(OTHER_KEY): STAMP}


def test_each_peer_has_its_own_stamps_and_an_absent_one_keeps_its(path: Path) -> None:
    store = ReplayStore(path)
    store.load(UTC_S)
    gcsa, gcsb = SignedPeer(KEY), SignedPeer(OTHER_KEY)
    store.attach("GCSA", gcsa)
    store.attach("GCSB", gcsb)
    assert gcsa.check(heartbeat(STAMP + 1000 * SECOND), UTC_S, 0.0) is OK
    assert gcsb.check(heartbeat(STAMP, OTHER_KEY), UTC_S, 0.0) is OK
    store.close()
    store, peer = started(path)  # GCSA alone
    assert peer.check(heartbeat(STAMP + 1001 * SECOND), UTC_S, 0.0) is OK
    store.close()
    store = ReplayStore(path)
    store.load(UTC_S)
    gcsb = SignedPeer(OTHER_KEY)
    store.attach("GCSB", gcsb)
    assert gcsb.check(heartbeat(STAMP, OTHER_KEY), 0.0, 0.0) is TOO_OLD
    assert gcsb.check(heartbeat(STAMP + 1, OTHER_KEY), 0.0, 0.0) is OK


def test_the_file_is_for_its_owner_alone_and_holds_no_key(path: Path) -> None:
    store, peer = started(path)
    assert peer.check(heartbeat(STAMP), UTC_S, 0.0) is OK
    store.close()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert json.loads(path.read_text())["stamps"] == {"GCSA": {fingerprint(KEY): STAMP}}
    assert KEY.hex() not in path.read_text()
    assert [entry.name for entry in path.parent.iterdir()] == ["replay.json"]


def saved(path: Path) -> bytes:
    store, peer = started(path)
    assert peer.check(heartbeat(STAMP), UTC_S, 0.0) is OK
    store.close()
    return path.read_bytes()


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (lambda data: data[:-20], "it is cut or no JSON"),
        (lambda data: b"", "it is cut or no JSON"),
        (lambda data: bytes(len(data)), "it is cut or no JSON"),
        (lambda data: b"[]", "it is not in the form 'handover replay state 1'"),
        (lambda data: data.replace(b"state 1", b"state 2"), "it is not in the form 'handover replay state 1'"),
        (lambda data: data.replace(b"37506240000000", b"00000000000001"), "it is cut or no JSON"),
        (lambda data: data.replace(b"37506240000000", b"17506240000000"), "its checksum is wrong"),
        (lambda data: data.replace(b"GCSA", b"GCSB"), "its checksum is wrong"),
        (lambda data: b"[" * 100_000, "it is cut or no JSON"),
    ],
)
def test_a_damaged_file_lets_nothing_old_in_and_nobody_out_for_good(path: Path, damage, why: str) -> None:  # type: ignore[no-untyped-def]
    path.parent.mkdir()
    path.write_bytes(damage(saved(path)))
    os.utime(path, (UTC_S, UTC_S))
    store, peer = started(path, utc_s=UTC_S + 100)
    kept = path.with_name("replay.json.damaged")
    assert store.note.endswith("what was signed before now is refused; the file is kept as replay.json.damaged")
    assert why in store.note or "recursion" in store.note
    assert kept.exists()
    assert peer.check(heartbeat(STAMP), 0.0, 0.0) is TOO_OLD
    assert peer.check(heartbeat(STAMP + 100 * SECOND), 0.0, 0.0) is TOO_OLD
    assert peer.check(heartbeat(STAMP + 101 * SECOND), 0.0, 0.0) is OK
    store.close()
    assert started(path)[0].note == ""


def test_with_a_damaged_file_and_a_clock_that_is_not_set_the_time_of_the_file_counts(path: Path) -> None:
    path.parent.mkdir()
    path.write_bytes(saved(path)[:-20])
    os.utime(path, (UTC_S + 50, UTC_S + 50))
    _store, peer = started(path, utc_s=0.0)
    assert peer.check(heartbeat(STAMP + 50 * SECOND), 0.0, 0.0) is TOO_OLD
    assert peer.check(heartbeat(STAMP + 51 * SECOND), 0.0, 0.0) is OK


def test_a_crash_after_the_damage_was_found_does_not_make_it_a_first_start(path: Path) -> None:
    path.parent.mkdir()
    path.write_bytes(saved(path)[:-20])
    started(path, utc_s=UTC_S + 100)  # and crashed before anything was written
    store, peer = started(path, utc_s=UTC_S + 200)
    assert "cannot be read" in store.note
    assert store.note.endswith("; the file is kept as replay.json.damaged")
    assert peer.check(heartbeat(STAMP + 200 * SECOND), 0.0, 0.0) is TOO_OLD


def test_the_floor_after_damage_outlives_the_next_restart(path: Path) -> None:
    path.parent.mkdir()
    path.write_bytes(b"damaged")
    os.utime(path, (UTC_S, UTC_S))
    store, _peer = started(path, utc_s=UTC_S + 100)
    store.close()
    _store, peer = started(path, utc_s=0.0)
    assert peer.check(heartbeat(STAMP + 100 * SECOND), 0.0, 0.0) is TOO_OLD
    assert peer.check(heartbeat(STAMP + 101 * SECOND), 0.0, 0.0) is OK


class TestCopyInMemory:
    """A restart within a boot, whatever became of the disk."""

    def started(self, path: Path, memory: Path, utc_s: float = UTC_S) -> tuple[ReplayStore, SignedPeer]:
        store, peer = ReplayStore(path, memory=memory), SignedPeer(KEY)
        store.load(utc_s, first=False)
        store.attach("GCSA", peer)
        return store, peer

    def test_what_a_full_disk_did_not_take_is_old_all_the_same(self, path: Path, tmp_path: Path) -> None:
        memory = tmp_path / "memory.replay"
        store, peer = self.started(path, memory)
        assert peer.check(heartbeat(STAMP + 30 * SECOND), 0.0, 0.0) is OK
        store.tick(0.0)
        settle(store)
        path.unlink()
        path.mkdir()  # nothing can be written there any more
        assert peer.check(heartbeat(STAMP + 50 * SECOND), 0.0, 5.0) is OK
        store.tick(5.0)
        settle(store)
        assert store.errors == 1
        _store, peer = self.started(path, memory)  # and the process before was killed
        assert peer.check(heartbeat(STAMP + 50 * SECOND), 0.0, 0.0) is TOO_OLD
        assert peer.check(heartbeat(STAMP + 53 * SECOND), 0.0, 0.0) is TOO_OLD
        assert peer.check(heartbeat(STAMP + 55 * SECOND), 0.0, 0.0) is OK

    def test_after_an_orderly_end_the_file_alone_counts(self, path: Path, tmp_path: Path) -> None:
        memory = tmp_path / "memory.replay"
        store, peer = self.started(path, memory)
        assert peer.check(heartbeat(STAMP + 30 * SECOND), 0.0, 0.0) is OK
        store.tick(0.0)
        settle(store)
        assert memory.exists()
        store.close()
        assert not memory.exists()

    def test_where_memory_is_full_the_file_counts(
        self, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        memory = tmp_path / "memory.replay"
        store, peer = self.started(path, memory)
        assert peer.check(heartbeat(STAMP + 30 * SECOND), 0.0, 0.0) is OK
        store.tick(0.0)
        settle(store)
        write = replay.replace_whole

        def full(where: Path, data: bytes, *, sync: bool = True) -> None:
            if where == memory:
                raise OSError(28, "No space left on device")
            write(where, data, sync=sync)

        monkeypatch.setattr(replay, "replace_whole", full)
        assert peer.check(heartbeat(STAMP + 50 * SECOND), 0.0, 5.0) is OK
        store.tick(5.0)
        settle(store)
        _store, peer = self.started(path, memory)
        assert peer.check(heartbeat(STAMP + 50 * SECOND), 0.0, 0.0) is TOO_OLD

    @pytest.mark.parametrize("damage", [b"", b"[" * 100_000, b"{}"])
    def test_a_damaged_copy_is_none(self, path: Path, tmp_path: Path, damage: bytes) -> None:
        path.parent.mkdir()
        path.write_bytes(saved(path))
        memory = tmp_path / "memory.replay"
        memory.write_bytes(damage)
        assert self.started(path, memory)[0].note == ""


def test_a_restart_in_flight_finds_no_file_and_lets_nothing_old_in(path: Path) -> None:
    store, peer = ReplayStore(path), SignedPeer(KEY)
    assert store.load(UTC_S + 100, first=False).endswith("what was signed before now is refused")
    store.attach("GCSA", peer)
    assert peer.check(heartbeat(STAMP + 100 * SECOND), 0.0, 0.0) is TOO_OLD
    assert peer.check(heartbeat(STAMP + 101 * SECOND), 0.0, 0.0) is OK


def test_a_file_that_cannot_be_read_is_a_damaged_one(path: Path) -> None:
    path.mkdir(parents=True)
    os.utime(path, (UTC_S, UTC_S))
    store, peer = started(path, utc_s=UTC_S + 100)
    assert store.note.startswith(f"{path}: replay state cannot be read (Is a directory); what was signed before now")
    assert peer.check(heartbeat(STAMP), 0.0, 0.0) is TOO_OLD
    store.close()
    assert store.errors == 1
    assert [entry.name for entry in path.parent.iterdir()] == ["replay.json"]


def test_a_disk_that_fails_is_counted_and_tried_again(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store, peer = started(path)

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        assert peer.check(heartbeat(STAMP), UTC_S, 0.0) is OK
        store.tick(0.0)
        settle(store)
        assert store.errors == 1
        assert store.note == f"{path}: replay state cannot be written (No space left on device)"
        assert list(path.parent.iterdir()) == []
    store.tick(0.5)
    settle(store)
    assert not path.exists()  # not before a second has passed
    store.tick(1.0)
    settle(store)
    assert path.exists()


def test_the_main_loop_does_not_wait_for_the_disk(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store, peer = started(path)
    began, free = threading.Event(), threading.Event()
    real = os.fsync

    fsyncs = 0

    def slow(descriptor: int) -> None:
        nonlocal fsyncs
        fsyncs += 1
        began.set()
        assert free.wait(WAIT_S)
        real(descriptor)

    monkeypatch.setattr(os, "fsync", slow)
    assert peer.check(heartbeat(STAMP), UTC_S, 0.0) is OK
    store.tick(0.0)
    assert began.wait(WAIT_S)
    assert not path.exists()
    assert peer.check(heartbeat(STAMP + 10 * SECOND), UTC_S, 10.0) is OK
    store.tick(10.0)  # the first write is still under way: no second one beside it
    assert fsyncs == 1
    assert not store.wait_until_written(0.0)
    threading.Timer(0.05, free.set).start()
    assert store.close(WAIT_S)  # waits for the first write, lest that one comes last
    assert json.loads(path.read_text())["stamps"] == {"GCSA": {fingerprint(KEY): STAMP + 10 * SECOND}}


def test_the_end_does_not_wait_for_a_disk_that_hangs(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store, peer = started(path)
    free = threading.Event()
    monkeypatch.setattr(os, "fsync", lambda _descriptor: free.wait(WAIT_S))
    assert peer.check(heartbeat(STAMP), UTC_S, 0.0) is OK
    assert not store.close(0.01)
    free.set()
    assert store.wait_until_written(WAIT_S)


def sealed(stamps: object) -> bytes:
    """Stamps with the right checksum, whatever they are."""
    body = json.dumps(stamps, sort_keys=True)
    digest = hashlib.sha256(body.encode()).hexdigest()
    return json.dumps({"format": "handover replay state 1", "sha256": digest, "stamps": stamps}).encode()


@pytest.mark.parametrize(
    "stamps", [None, [], {"GCSA": 1}, {"GCSA": {"a": -1}}, {"GCSA": {"a": 2**48}}, {"GCSA": {"a": True}}]
)
def test_something_else_than_stamps_is_damage(path: Path, stamps: object) -> None:
    path.parent.mkdir()
    path.write_bytes(sealed(stamps))
    assert "it holds something else than stamps" in started(path)[0].note


@given(
    st.one_of(
        st.binary(max_size=200),
        st.recursive(
            st.none() | st.booleans() | st.integers() | st.text(max_size=5),
            lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
        ).map(sealed),
    )
)
def test_no_content_makes_loading_raise(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "replay.json"
        path.write_bytes(content)
        os.utime(path, (UTC_S, UTC_S))
        store, peer = started(path)
        assert peer.check(heartbeat(STAMP + 1), UTC_S, 0.0) is OK
        store.close()
        assert started(path)[0].note == ""
