# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover keys bundle`: what one station needs, and nothing that could speak as the vehicle or as another station."""

from __future__ import annotations

import stat
import subprocess
import tarfile
from pathlib import Path

import pytest

from mavproxy_handover.cli.keys import main
from mavproxy_handover.config.station import load_station
from mavproxy_handover.store.keys import load_key

STATION = """\
[station]
name = "GCSA"
sysid = 251
vehicle = 1
key = "keys/GCSA.key"
mission = "mission"

[ground]
listen = "udpin:127.0.0.1:14650"
key = "keys/ground.key"

[[peer]]
name = "GCSB"
sysid = 252
link = "udpout:198.51.100.2:14650"
"""
SECRETS = ("GCSB", "GCSC", "guard", "autopilot")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as `handover init mission` leaves it, with the keys of everybody."""
    monkeypatch.chdir(tmp_path)
    assert main(["make", "GCSA", *SECRETS]) == 0
    (tmp_path / "GCSA.toml").write_text(STATION)
    mission = tmp_path / "mission"
    mission.mkdir()
    (mission / "mission.toml").write_text("route = 'route.plan'\n")
    (mission / "route.plan").write_text("{}")
    (mission / "stray.key").write_text("ab" * 32)
    return tmp_path


def members(archive: Path) -> dict[str, tarfile.TarInfo]:
    with tarfile.open(archive) as opened:
        return {member.name: member for member in opened if member.isfile()}


def test_it_has_what_the_station_needs_and_no_more(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bundle", "GCSA"]) == 0
    archive = folder / "GCSA-bundle.tar.gz"
    found = members(archive)
    assert sorted(found) == [
        "GCSA/GCSA.toml",
        "GCSA/keys/GCSA.key",
        "GCSA/keys/ground.key",
        "GCSA/mission/mission.toml",
        "GCSA/mission/route.plan",
    ]
    assert stat.S_IMODE(archive.stat().st_mode) == 0o600
    assert {name: member.mode for name, member in found.items() if name.endswith(".key")} == {
        "GCSA/keys/GCSA.key": 0o600,
        "GCSA/keys/ground.key": 0o600,
    }
    assert {(member.uname, member.gname, member.uid) for member in found.values()} == {("", "", 0)}
    out = capsys.readouterr().out
    assert "handover station --config GCSA.toml" in out
    assert load_key(folder / "keys" / "GCSA.key").hex() not in out


def test_no_secret_of_others_is_in_it(folder: Path) -> None:
    assert main(["bundle", "GCSA"]) == 0
    with tarfile.open(folder / "GCSA-bundle.tar.gz") as archive:
        everything = b"".join(archive.extractfile(each).read() for each in archive if each.isfile())  # type: ignore[union-attr]
    own = (folder / "keys" / "GCSA.key").read_bytes().strip()
    assert own in everything
    for name in SECRETS:
        secret = (folder / "keys" / f"{name}.key").read_bytes().strip()
        assert secret not in everything, name
        assert load_key(folder / "keys" / f"{name}.key") not in everything, name


@pytest.mark.parametrize("vehicle", ["2", "b"])
def test_the_key_of_a_station_whose_name_begins_alike_is_refused(
    folder: Path, vehicle: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """`GCSA-2` may be another station."""
    assert main(["make", f"GCSA-{vehicle}"]) == 0
    (folder / "GCSA.toml").write_text(STATION.replace("keys/GCSA.key", f"keys/GCSA-{vehicle}.key"))
    assert main(["bundle", "GCSA"]) != 0
    assert f"keys/GCSA-{vehicle}.key: is not named after GCSA" in capsys.readouterr().err
    assert not (folder / "GCSA-bundle.tar.gz").exists()


def test_the_station_can_use_it(folder: Path, tmp_path: Path) -> None:
    assert main(["bundle", "GCSA", "--out", "a.tgz"]) == 0
    with tarfile.open(folder / "a.tgz") as archive:
        archive.extractall(tmp_path / "there", filter="data")
    loaded = load_station(tmp_path / "there" / "GCSA" / "GCSA.toml")
    assert loaded.station.name == "GCSA"
    assert load_key(loaded.vehicles[0].key or Path()) == load_key(folder / "keys" / "GCSA.key")


def test_unpacked_folders_are_closed_to_other_users(folder: Path) -> None:
    """Otherwise the umask decides, and `handover doctor` at the station reports the folder of the keys."""
    assert main(["bundle", "GCSA"]) == 0
    there = folder / "there"
    there.mkdir()
    subprocess.run(["sh", "-c", "umask 022; tar xzf ../GCSA-bundle.tar.gz"], cwd=there, check=True)
    folders = {each.relative_to(there).as_posix(): each for each in there.rglob("*") if each.is_dir()}
    modes = {name: stat.S_IMODE(each.stat().st_mode) for name, each in folders.items()}
    assert modes == {"GCSA": 0o700, "GCSA/keys": 0o700, "GCSA/mission": 0o700}


@pytest.mark.parametrize("other", SECRETS)
def test_a_configuration_that_names_anothers_key_is_refused(
    folder: Path, other: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "GCSA.toml").write_text(STATION.replace("keys/GCSA.key", f"keys/{other}.key"))
    assert main(["bundle", "GCSA"]) == 2
    assert f"{other}.key: is not named after GCSA" in capsys.readouterr().err
    assert not (folder / "GCSA-bundle.tar.gz").exists()
    (folder / "GCSA.toml").write_text(STATION.replace("keys/ground.key", f"keys/{other}.key"))
    assert main(["bundle", "GCSA"]) == 2
    assert "is not named after the ground link" in capsys.readouterr().err


def test_an_old_key_of_a_rotation_stays_here(folder: Path) -> None:
    old = (folder / "keys" / "GCSA.key").read_bytes().strip()
    assert main(["rotate", "GCSA"]) == 0
    assert main(["bundle", "GCSA"]) == 0
    with tarfile.open(folder / "GCSA-bundle.tar.gz") as archive:
        everything = b"".join(archive.extractfile(each).read() for each in archive if each.isfile())  # type: ignore[union-attr]
    assert old not in everything


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["GCSB"], "GCSB.toml"),
        (["GCSB", "--config", "GCSA.toml"], "is the configuration of GCSA, not of GCSB"),
        (["GCSA", "--out", "no/such/folder.tgz"], "No such file or directory. Nothing was written"),
        (["../x"], "../x"),
    ],
)
def test_what_cannot_be_is_one_line(
    folder: Path, typed: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(folder.rglob("*"))
    assert main(["bundle", *typed]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert sorted(folder.rglob("*")) == before


def test_a_bundle_that_is_there_is_not_replaced(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "GCSA-bundle.tar.gz").write_text("mine")
    assert main(["bundle", "GCSA"]) == 2
    assert "File exists" in capsys.readouterr().err
    assert (folder / "GCSA-bundle.tar.gz").read_text() == "mine"


def test_what_lies_beside_a_mission_stays_here(folder: Path) -> None:
    """A mission's folder may be that of all configurations: bundles and copies of other keys lie there."""
    for file in (folder / "mission").iterdir():
        file.rename(folder / file.name)
    for name in SECRETS:
        (folder / f"{name}.key.txt").write_bytes((folder / "keys" / f"{name}.key").read_bytes())
    (folder / "GCSB-bundle.tar.gz").write_bytes((folder / "keys" / "GCSB.key").read_bytes())
    (folder / "GCSA.toml").write_text(STATION.replace('mission = "mission"', 'mission = "."'))
    (folder / "addresses.toml").write_text("")
    assert main(["bundle", "GCSA"]) == 0
    assert sorted(members(folder / "GCSA-bundle.tar.gz")) == [
        "GCSA/GCSA.toml",
        "GCSA/addresses.toml",
        "GCSA/keys/GCSA.key",
        "GCSA/keys/ground.key",
        "GCSA/mission.toml",
        "GCSA/route.plan",
    ]


def test_a_file_of_the_mission_that_is_a_link_to_a_key_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "mission" / "route.plan").unlink()
    (folder / "mission" / "route.plan").symlink_to(folder / "keys" / "guard.key")
    assert main(["bundle", "GCSA"]) == 2
    assert "route.plan: is a link to another file" in capsys.readouterr().err
    assert not (folder / "GCSA-bundle.tar.gz").exists()


def test_a_mission_that_cannot_be_read_is_said_in_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "mission" / "mission.toml").write_text("route = [[[")
    assert main(["bundle", "GCSA"]) == 2
    err = capsys.readouterr().err
    assert "mission.toml" in err
    assert "handover check" in err
    assert err.count("\n") == 1
