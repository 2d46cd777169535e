# SPDX-License-Identifier: GPL-3.0-or-later

"""Key files: the keys that stock programs make, for one pair of eyes, whole or not there, never shown."""

from __future__ import annotations

import hashlib
import os
import re
import stat
import sys
import tempfile
import traceback
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.store.keys import (
    KeysError,
    StationKeys,
    check_distinct,
    key_of,
    key_path,
    load_key,
    load_station_keys,
    make_passphrase,
    previous_path,
    retire_key,
    rotate_key,
    write_key,
)
from mavproxy_handover.wire.signing import fingerprint

KEY = bytes.fromhex("87cbebfeebc05f7c54ac9336c4b4bbec831227a641951a4bde7edd56020f8590")
NEW_KEY = bytes(range(32))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where the key of GCSA belongs; not there yet."""
    return tmp_path / "GCSA.key"


def put(path: Path, content: bytes, mode: int = 0o600) -> None:
    path.write_bytes(content)
    path.chmod(mode)


# ---- passphrases --------------------------------------------------------------------------------------------------


def test_a_passphrase_makes_the_key_that_mavproxy_makes_of_it() -> None:
    from MAVProxy.modules.mavproxy_signing import SigningModule

    passphrase = "correct-horse-battery-staple"
    assert key_of(passphrase) == KEY
    assert SigningModule.passphrase_to_key(SimpleNamespace(), passphrase) == KEY


def test_a_made_passphrase_has_125_random_bits_without_look_alikes_and_can_be_used() -> None:
    made = {make_passphrase() for _ in range(200)}
    assert len(made) == 200
    for passphrase in made:
        assert re.fullmatch(r"([a-km-np-z2-9]{5}-){4}[a-km-np-z2-9]{5}", passphrase)
        assert key_of(passphrase) == hashlib.sha256(passphrase.encode()).digest()
    used = set("".join(made)) - {"-"}
    assert len(used) == 32  # 5 bits each
    assert used.isdisjoint("01lo")


@pytest.mark.parametrize(
    ("passphrase", "text"),
    [
        ("fifteen-letters", "the passphrase has 15 characters, must have 16 or more"),
        ("", "the passphrase has 0 characters, must have 16 or more"),
        ("with a blank in it", "the passphrase must be ASCII letters, digits and signs, without blanks"),
        ("semicolon;in-between", "without blanks and \" ' \\ ; #"),
        ('quote"in-between-them', "without blanks and \" ' \\ ; #"),
        ("schlüsselwort-mit-ü", "the passphrase must be ASCII"),
        ("with-a-line\n-break-in-it", "the passphrase must be ASCII"),
    ],
)
def test_a_passphrase_that_is_weak_or_cannot_be_typed_everywhere_is_refused(passphrase: str, text: str) -> None:
    with pytest.raises(KeysError) as raised:
        key_of(passphrase)
    assert text in str(raised.value)
    assert not passphrase or passphrase not in str(raised.value)


def test_sixteen_characters_are_enough() -> None:
    assert key_of("sixteen-letters!") == hashlib.sha256(b"sixteen-letters!").digest()


# ---- reading ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("content", [KEY.hex().encode() + b"\n", KEY.hex().upper().encode(), b" " + KEY.hex().encode()])
def test_a_key_file_holds_64_hexadecimal_digits(path: Path, content: bytes) -> None:
    put(path, content)
    assert load_key(path) == KEY


@pytest.mark.parametrize(
    "content",
    [
        b"",
        KEY.hex().encode()[:-1],
        KEY.hex().encode() + b"0",
        KEY.hex().encode()[:-1] + b"g",
        KEY,
        KEY.hex().encode() + b" " + KEY.hex().encode(),
        b"\xff" * 64,
        KEY.hex().encode() + b"\n" * 200 + b"0",
        KEY.hex().encode() + b"\n" * 65,
    ],
)
def test_a_file_with_anything_else_in_it_is_refused_without_showing_it(path: Path, content: bytes) -> None:
    put(path, content)
    with pytest.raises(KeysError) as raised:
        load_key(path)
    assert str(raised.value) == f"{path}: must hold 64 hexadecimal digits and nothing else"


def test_the_key_of_zeros_is_refused(path: Path) -> None:
    put(path, b"0" * 64)
    with pytest.raises(KeysError, match="a key of zeros switches signing off in MAVLink"):
        load_key(path)


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o660, 0o610, 0o700, 0o4600, 0o666])
def test_a_file_that_is_not_for_its_owner_alone_is_refused(path: Path, mode: int) -> None:
    put(path, KEY.hex().encode(), mode)
    with pytest.raises(KeysError) as raised:
        load_key(path)
    expected = f"{path}: mode {mode:04o} must be 0600, because only its owner may read a key: chmod 600 {path}"
    assert str(raised.value) == expected


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="counts descriptors in /proc")
def test_reading_leaves_no_file_open(path: Path) -> None:
    put(path, KEY.hex().encode())
    before = len(os.listdir("/proc/self/fd"))
    for mode in (0o600, 0o644):
        path.chmod(mode)
        for _ in range(10):
            if mode == 0o600:
                load_key(path)
            else:
                with pytest.raises(KeysError):
                    load_key(path)
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_read_only_key_file_is_good(path: Path) -> None:
    put(path, KEY.hex().encode(), 0o400)
    assert load_key(path) == KEY


def test_a_file_of_another_user_is_refused(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(path, KEY.hex().encode())
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    with pytest.raises(KeysError) as raised:
        load_key(path)
    assert str(raised.value) == f"{path}: belongs to user {own}, must belong to {own + 1}, who runs this"


def test_a_key_file_may_be_looked_at_for_another_user(path: Path) -> None:
    write_key(path, KEY)
    own = os.geteuid()
    assert load_key(path, own) == KEY
    with pytest.raises(KeysError) as raised:
        load_station_keys(path, own + 1)
    assert str(raised.value) == f"{path}: belongs to user {own}, must belong to {own + 1}, who is to use it"


def test_what_is_no_file_is_refused(path: Path) -> None:
    with pytest.raises(KeysError) as raised:
        load_key(path)
    assert str(raised.value) == f"{path}: no such key file; 'handover keys make' writes one"
    path.mkdir(mode=0o600)
    with pytest.raises(KeysError, match="is not a file"):
        load_key(path)
    path.rmdir()
    os.mkfifo(path, 0o600)  # opened for reading, one would wait for ever
    with pytest.raises(KeysError, match="is not a file"):
        load_key(path)


def test_an_error_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(KeysError) as raised:
        load_key(tmp_path / "two\nlines.key")
    assert "\n" not in str(raised.value)


@given(st.binary(max_size=300))
def test_no_content_makes_reading_raise_anything_else(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "GCSA.key"
        put(path, content)
        with pytest.raises(KeysError, match="must hold 64 hexadecimal digits"):
            load_key(path)


# ---- writing ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("umask", [0o000, 0o022, 0o077, 0o777])
def test_a_key_file_is_for_its_owner_alone_whatever_the_umask(path: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        write_key(path, KEY)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert path.read_bytes() == KEY.hex().encode() + b"\n"
    assert load_key(path) == KEY
    assert [entry.name for entry in path.parent.iterdir()] == ["GCSA.key"]


def test_the_file_is_never_open_to_others_while_it_is_written(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    real = os.open

    def watched(name: os.PathLike[str], flags: int, mode: int = 0o777) -> int:
        if flags & os.O_CREAT:
            assert flags & os.O_EXCL
            seen.append(mode)
        return real(name, flags, mode)

    monkeypatch.setattr(os, "open", watched)
    write_key(path, KEY)
    assert seen == [0o600]


def test_a_key_is_never_written_over_another(path: Path) -> None:
    write_key(path, KEY)
    with pytest.raises(KeysError) as raised:
        write_key(path, NEW_KEY)
    assert str(raised.value) == f"{path}: exists already; 'handover keys rotate' replaces a key"
    assert load_key(path) == KEY
    assert [entry.name for entry in path.parent.iterdir()] == ["GCSA.key"]


def test_a_write_that_fails_leaves_nothing_behind(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(KeysError) as raised:
        write_key(path, KEY)
    assert str(raised.value) == f"{path}: No space left on device"
    assert list(path.parent.iterdir()) == []


def test_a_folder_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "none" / "GCSA.key"
    with pytest.raises(KeysError) as raised:
        write_key(path, KEY)
    assert str(raised.value) == f"{path}: No such file or directory"


def test_what_is_no_key_is_not_written(path: Path) -> None:
    with pytest.raises(ValueError, match="a signing key has 32 bytes, not 31"):
        write_key(path, KEY[:-1])
    assert list(path.parent.iterdir()) == []


# ---- names --------------------------------------------------------------------------------------------------------


def test_a_station_has_one_file_named_after_it() -> None:
    assert key_path(Path("keys"), "GCSA") == Path("keys/GCSA.key")
    assert key_path(Path("keys"), "north-2.b_c") == Path("keys/north-2.b_c.key")
    assert previous_path(Path("keys/GCSA.key")) == Path("keys/GCSA.key.old")


@pytest.mark.parametrize("name", ["", "../GCSA", "a/b", ".hidden", "-rf", "A" * 21, "ä", "a b", "a\nb", "a\0b"])
def test_a_name_that_leads_elsewhere_is_refused(name: str) -> None:
    with pytest.raises(KeysError, match="to name a key file"):
        key_path(Path("keys"), name)


# ---- rotation -----------------------------------------------------------------------------------------------------


def test_a_rotation_keeps_the_old_key_and_both_are_loaded(path: Path) -> None:
    write_key(path, KEY)
    assert load_station_keys(path) == StationKeys(KEY, None)
    rotate_key(path, NEW_KEY)
    assert load_station_keys(path) == StationKeys(NEW_KEY, KEY)
    assert stat.S_IMODE(previous_path(path).stat().st_mode) == 0o600
    assert sorted(entry.name for entry in path.parent.iterdir()) == ["GCSA.key", "GCSA.key.old"]


def test_a_second_rotation_waits_until_the_first_is_finished(path: Path) -> None:
    write_key(path, KEY)
    rotate_key(path, NEW_KEY)
    with pytest.raises(KeysError, match="an earlier rotation is not finished; 'handover keys retire' ends it"):
        rotate_key(path, bytes(31) + b"\1")
    assert load_station_keys(path) == StationKeys(NEW_KEY, KEY)
    retire_key(path)
    assert load_station_keys(path) == StationKeys(NEW_KEY, None)
    rotate_key(path, bytes(31) + b"\1")
    assert load_station_keys(path) == StationKeys(bytes(31) + b"\1", NEW_KEY)


def test_there_is_no_rotation_to_the_same_key_or_without_one(path: Path) -> None:
    with pytest.raises(KeysError, match="no such key file"):
        rotate_key(path, NEW_KEY)
    write_key(path, KEY)
    with pytest.raises(KeysError, match="holds this very key already"):
        rotate_key(path, KEY)
    with pytest.raises(KeysError, match="no rotation is under way"):
        retire_key(path)
    assert load_station_keys(path) == StationKeys(KEY, None)


def test_the_old_key_is_not_removed_while_the_new_one_is_no_good(path: Path) -> None:
    write_key(path, KEY)
    rotate_key(path, NEW_KEY)
    path.chmod(0o644)
    with pytest.raises(KeysError, match="mode 0644"):
        retire_key(path)
    assert load_key(previous_path(path)) == KEY


def test_a_rotation_cut_by_a_power_failure_leaves_a_key_that_works(path: Path) -> None:
    write_key(path, KEY)
    os.link(path, previous_path(path))  # as far as it came
    assert load_station_keys(path) == StationKeys(KEY, None)
    retire_key(path)
    rotate_key(path, NEW_KEY)
    assert load_station_keys(path) == StationKeys(NEW_KEY, KEY)


def test_a_rotation_that_fails_changes_nothing(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(source: Path, target: Path) -> None:
        raise OSError(5, "Input/output error")

    write_key(path, KEY)
    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(KeysError) as raised:
        rotate_key(path, NEW_KEY)
    assert str(raised.value) == f"{path}: Input/output error"
    assert load_station_keys(path) == StationKeys(KEY, None)
    assert [entry.name for entry in path.parent.iterdir()] == ["GCSA.key"]


def test_an_old_key_that_others_may_read_is_refused_like_any_other(path: Path) -> None:
    write_key(path, KEY)
    rotate_key(path, NEW_KEY)
    previous_path(path).chmod(0o644)
    with pytest.raises(KeysError, match=r"GCSA\.key\.old: mode 0644"):
        load_station_keys(path)


# ---- no two alike, none shown -------------------------------------------------------------------------------------


def test_two_stations_with_the_same_key_are_refused() -> None:
    check_distinct({"GCSA": StationKeys(KEY), "GCSB": StationKeys(NEW_KEY)})
    for other in (StationKeys(KEY), StationKeys(NEW_KEY, KEY)):
        with pytest.raises(KeysError) as raised:
            check_distinct({"GCSA": StationKeys(KEY), "GCSB": other})
        assert str(raised.value) == "GCSA and GCSB have the same key; each station needs one of its own"


def test_keys_do_not_show_in_what_python_prints() -> None:
    shown = f"{StationKeys(KEY, NEW_KEY)} {StationKeys(KEY)!r}"
    assert shown == (
        f"StationKeys({fingerprint(KEY)}, previous {fingerprint(NEW_KEY)}) StationKeys({fingerprint(KEY)})"
    )


def test_keys_do_not_show_in_a_traceback(path: Path) -> None:
    put(path, KEY.hex().encode() + b"00")
    try:
        load_key(path)
    except KeysError:
        text = "".join(traceback.format_exception(*sys.exc_info()))
    assert KEY.hex() not in text
