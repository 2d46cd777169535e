# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover init demo`: a folder to fly by hand from, with passphrases to type into other programs where asked for."""

from __future__ import annotations

import re
import stat
from pathlib import Path

import pytest

from mavproxy_handover.cli.init import main
from mavproxy_handover.config.files import load_station, load_vehicle
from mavproxy_handover.mission import package as packages
from mavproxy_handover.store.keys import KeysError, key_of, load_key
from mavproxy_handover.wire.signing import fingerprint

NAMES = ("GCSA", "GCSB", "ground")


def shown(out: str) -> dict[str, str]:
    """The passphrases by the key that stands above each."""
    return dict(re.findall(r"^(\w+): .*\n  passphrase  (\S+)$", out, re.MULTILINE))


def test_the_keys_of_the_demo_are_those_of_the_passphrases_that_are_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    demo = tmp_path / "demo"
    assert main(["demo", str(demo), "--with-passphrases"]) == 0
    out = capsys.readouterr().out
    passphrases = shown(out)
    assert tuple(passphrases) == NAMES
    assert len(set(passphrases.values())) == 3
    for name, passphrase in passphrases.items():
        path = demo / "keys" / f"{name}.key"
        assert load_key(path) == key_of(passphrase)
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert fingerprint(load_key(path)) in out
        assert load_key(path).hex() not in out
    assert "shown this once and stored nowhere" in out
    assert "Mission Planner" in out
    assert stat.S_IMODE((demo / "keys").stat().st_mode) == 0o700


def test_no_passphrase_lies_in_the_folder_or_travels_in_the_package(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    demo = tmp_path / "demo"
    assert main(["demo", str(demo), "--with-passphrases"]) == 0
    for name, passphrase in shown(capsys.readouterr().out).items():
        secrets = (passphrase.encode(), load_key(demo / "keys" / f"{name}.key").hex().encode())
        holders = [path.name for path in demo.rglob("*") if path.is_file() and secrets[0] in path.read_bytes()]
        assert holders == []
        package = packages.load(demo / "delivery").to_bytes()
        assert all(secret not in package for secret in secrets)


def test_without_the_option_nothing_is_shown_and_the_keys_are_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("one", "other"):
        assert main(["demo", str(tmp_path / name)]) == 0
    out = capsys.readouterr().out
    assert "passphrase" not in out
    keys = [load_key(tmp_path / folder / "keys" / f"{name}.key") for folder in ("one", "other") for name in NAMES]
    assert len(set(keys)) == 6


def test_the_folder_is_one_that_companion_and_stations_take(tmp_path: Path) -> None:
    demo = tmp_path / "demo"
    assert main(["demo", str(demo), "--with-passphrases"]) == 0
    vehicle = load_vehicle(demo / "handover.toml")
    keys = {entry.station.name: entry.key for entry in vehicle.stations}
    for name, key in keys.items():
        station = load_station(demo / f"{name}.toml")
        assert [vehicle.key for vehicle in station.vehicles] == [key]
        assert key is not None
        assert load_key(key)


@pytest.mark.parametrize("kind", ["vehicle", "station"])
def test_passphrases_are_for_the_demo_alone(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "x"
    assert main([kind, str(target), "--with-passphrases"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == (
        "handover init: --with-passphrases goes with 'demo'; 'handover keys make NAME' is for the others\n"
    )
    assert not target.exists()


def test_what_is_there_is_left_alone_and_no_passphrase_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    demo = tmp_path / "demo"
    demo.mkdir()
    (demo / "mine").write_text("mine")
    assert main(["demo", str(demo), "--with-passphrases"]) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", f"handover init: {demo} exists already: nothing written\n")
    assert [path.name for path in demo.iterdir()] == ["mine"]


def test_a_key_that_cannot_be_written_is_told_in_a_line_and_no_passphrase_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, _key: bytes) -> None:
        raise KeysError(f"{path}: No space left on device")

    monkeypatch.setattr("mavproxy_handover.cli.init.write_key", full)
    demo = tmp_path / "demo"
    assert main(["demo", str(demo), "--with-passphrases"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == f"handover init: {demo}/keys/GCSA.key: No space left on device\n"


def test_a_folder_that_cannot_be_made_is_told_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["demo", str(tmp_path / "file" / "demo"), "--with-passphrases"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
