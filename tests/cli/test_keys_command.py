# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover keys`: what an operator types and reads. A passphrase shows once, a key never."""

from __future__ import annotations

import io
import re
import stat
from pathlib import Path

import pytest

from mavproxy_handover.cli.keys import main
from mavproxy_handover.store.keys import StationKeys, key_of, load_key, load_station_keys
from mavproxy_handover.wire.signing import fingerprint

PASSPHRASE = "correct-horse-battery-staple"


@pytest.fixture
def keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The default folder, not there yet."""
    monkeypatch.chdir(tmp_path)
    return tmp_path / "keys"


def typed(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(text))


def contents(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def test_make_writes_a_key_for_each_station_and_shows_the_passphrases_that_make_them(
    keys: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["make", "GCSA", "GCSB"]) == 0
    out = capsys.readouterr().out
    shown = re.findall(r"^  passphrase  (\S+)$", out, re.MULTILINE)
    names = ["GCSA.key", "GCSB.key", "ground.key"]
    assert [key_of(passphrase) for passphrase in shown] == [load_key(keys / name) for name in names]
    assert f"GCSA: keys/GCSA.key written, fingerprint {fingerprint(load_key(keys / 'GCSA.key'))}\n" in out
    assert "signing key PASSPHRASE" in out
    assert load_key(keys / "GCSA.key").hex() not in out
    assert stat.S_IMODE(keys.stat().st_mode) == 0o700
    assert stat.S_IMODE((keys / "GCSA.key").stat().st_mode) == 0o600
    assert contents(keys) == names


def test_the_key_of_the_ground_link_is_made_with_the_first_station_and_stays(keys: Path) -> None:
    """It is one for all stations; a second one would part them."""
    assert main(["make", "guard"]) == 0
    assert contents(keys) == ["guard.key"], "the guard has no ground link"
    assert main(["make", "GCSA"]) == 0
    first = load_key(keys / "ground.key")
    assert main(["make", "GCSB"]) == 0
    assert load_key(keys / "ground.key") == first
    assert main(["make", "ground"]) == 2


def test_at_the_station_where_the_passphrase_is_typed_no_other_key_is_made_up(
    keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("GCSA", "ground"):
        typed(monkeypatch, f"the-passphrase-of-{name}\n")
        assert main(["make", name, "--passphrase-stdin"]) == 0
    assert contents(keys) == ["GCSA.key", "ground.key"]
    assert load_key(keys / "ground.key") == key_of("the-passphrase-of-ground")


def test_make_never_replaces_a_key_and_makes_all_or_none(keys: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["make", "GCSB"]) == 0
    before = load_key(keys / "GCSB.key")
    capsys.readouterr()
    assert main(["make", "GCSA", "GCSB"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == (
        "handover keys: keys/GCSB.key: exists already; 'handover keys rotate' replaces a key. Nothing was made\n"
    )
    assert load_key(keys / "GCSB.key") == before
    assert contents(keys) == ["GCSB.key", "ground.key"]


def test_a_passphrase_can_be_typed_at_the_other_end(
    keys: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed(monkeypatch, PASSPHRASE + "\n")
    assert main(["make", "GCSA", "--passphrase-stdin", "--dir", "elsewhere"]) == 0
    captured = capsys.readouterr()
    assert load_key(keys.parent / "elsewhere" / "GCSA.key") == key_of(PASSPHRASE)
    assert PASSPHRASE not in captured.out + captured.err


@pytest.mark.parametrize(
    ("words", "text", "message"),
    [
        (["make", "GCSA", "--passphrase-stdin"], "short\n", "the passphrase has 5 characters, must have 16 or more"),
        (["make", "GCSA", "--passphrase-stdin"], "", "the passphrase has 0 characters, must have 16 or more"),
        (["make", "GCSA", "GCSB", "--passphrase-stdin"], PASSPHRASE, "takes one NAME: no two stations may have"),
        (["make", "GCSA", "GCSA"], "", "a station is named twice"),
        (["make", "../GCSA"], "", "station name '../GCSA' must be 1 to 20 letters"),
    ],
)
def test_make_refuses_what_it_cannot_do(
    keys: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    text: str,
    message: str,
) -> None:
    typed(monkeypatch, text)
    assert main(words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert not keys.exists() or contents(keys) == []


def test_no_two_stations_get_the_same_key(
    keys: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed(monkeypatch, PASSPHRASE)
    assert main(["make", "GCSA", "--passphrase-stdin"]) == 0
    typed(monkeypatch, PASSPHRASE)
    assert main(["make", "GCSB", "--passphrase-stdin"]) == 2
    assert "GCSA and GCSB have the same key" in capsys.readouterr().err
    assert main(["make", "GCSB"]) == 0
    typed(monkeypatch, PASSPHRASE)
    assert main(["rotate", "GCSB", "--passphrase-stdin"]) == 2
    assert contents(keys) == ["GCSA.key", "GCSB.key", "ground.key"]


def test_rotate_keeps_the_old_key_says_what_to_do_and_retire_ends_it(
    keys: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["make", "GCSA"]) == 0
    old = load_key(keys / "GCSA.key")
    capsys.readouterr()
    assert main(["rotate", "GCSA"]) == 0
    out = capsys.readouterr().out
    (passphrase,) = re.findall(r"^  passphrase  (\S+)$", out, re.MULTILINE)
    assert load_station_keys(keys / "GCSA.key") == StationKeys(key_of(passphrase), old)
    assert "the old key is kept as GCSA.key.old" in out
    assert "3. When all are heard: handover keys retire GCSA" in out
    assert "handover keys rotate GCSA --passphrase-stdin" in out
    assert old.hex() not in out
    assert main(["rotate", "GCSA"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "an earlier rotation is not finished; 'handover keys retire' ends it" in captured.err
    assert main(["retire", "GCSA"]) == 0
    assert capsys.readouterr().out == (
        "GCSA: the old key is gone; a running companion accepts it until it is restarted\n"
    )
    assert load_station_keys(keys / "GCSA.key") == StationKeys(key_of(passphrase), None)


@pytest.mark.parametrize("word", ["rotate", "retire"])
def test_a_station_without_a_key_is_named(keys: Path, capsys: pytest.CaptureFixture[str], word: str) -> None:
    assert main([word, "GCSA"]) == 2
    assert capsys.readouterr() == (
        "",
        "handover keys: keys/GCSA.key: no such key file; 'handover keys make' writes one\n",
    )


def test_list_names_keys_by_fingerprint_and_shows_rotations(keys: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["make", "GCSA", "GCSB"]) == 0
    old = load_key(keys / "GCSB.key")
    assert main(["rotate", "GCSB"]) == 0
    capsys.readouterr()
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    first, second = fingerprint(load_key(keys / "GCSA.key")), fingerprint(load_key(keys / "GCSB.key"))
    assert re.fullmatch(rf"GCSA {{17}}{first}  \d{{4}}-\d\d-\d\d \d\d:\d\d UTC", lines[0])
    assert re.fullmatch(
        rf"GCSB {{17}}{second}  \d{{4}}-\d\d-\d\d \d\d:\d\d UTC  rotation under way, old key {fingerprint(old)}",
        lines[1],
    )
    assert lines[2].startswith("ground ")
    assert len(lines) == 3


def test_check_says_that_all_is_well(keys: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["make", "GCSA"]) == 0
    capsys.readouterr()
    assert main(["check"]) == 0
    assert capsys.readouterr() == ("keys: 2 keys, all good\n", "")


@pytest.mark.parametrize("word", ["check", "list"])
def test_every_bad_key_is_named_and_the_exit_code_is_1(
    keys: Path, capsys: pytest.CaptureFixture[str], word: str
) -> None:
    assert main(["make", "GCSA", "GCSB", "GCSC", "GCSD"]) == 0
    (keys / "GCSA.key").chmod(0o644)
    (keys / "GCSB.key").write_bytes(b"torn")
    (keys / "GCSC.key").write_bytes((keys / "GCSD.key").read_bytes())
    capsys.readouterr()
    assert main([word]) == 1
    captured = capsys.readouterr()
    assert captured.err.splitlines() == [
        "handover keys: keys/GCSA.key: mode 0644 must be 0600, because only its owner may read a key: "
        "chmod 600 keys/GCSA.key",
        "handover keys: keys/GCSB.key: must hold 64 hexadecimal digits and nothing else",
        "handover keys: keys: GCSC and GCSD have the same key; each station needs one of its own",
    ]
    assert "all good" not in captured.out


@pytest.mark.parametrize("word", ["check", "list"])
def test_a_folder_without_keys_is_bad_input(keys: Path, capsys: pytest.CaptureFixture[str], word: str) -> None:
    assert main([word]) == 2
    assert "keys: No such file or directory; 'handover keys make NAME' makes it" in capsys.readouterr().err
    keys.mkdir()
    assert main([word]) == 2
    assert "keys: no key in it" in capsys.readouterr().err


@pytest.mark.parametrize("words", [[], ["frobnicate"], ["make"], ["rotate"], ["list", "--nonsense"]])
def test_wrong_usage_is_exit_code_2(keys: Path, capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    assert main(words) == 2
    assert "usage: handover keys" in capsys.readouterr().err


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(f"    {word} " in out for word in ("make", "list", "rotate", "retire", "check"))
