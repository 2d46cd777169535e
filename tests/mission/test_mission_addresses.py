# SPDX-License-Identifier: GPL-3.0-or-later

"""`addresses.toml`: where each station reaches the vehicle. It travels with the mission, outside its digest."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from mavproxy_handover.mission.package import from_bytes, load
from mavproxy_handover.store.state_file import StateFile
from mavproxy_handover.wire.vehicle_address import VehicleAddress
from tests.packages import ROUND

GOOD = """
[vehicle]
GCSB = ["udpout:10.0.0.2:14552", "udpout:100.64.3.7:5762"]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(ROUND, tmp_path / "delivery"))


def written(folder: Path, text: str) -> Path:
    (folder / "addresses.toml").write_text(text, encoding="utf-8")
    return folder


def test_each_station_has_its_addresses_in_order(folder: Path) -> None:
    package = load(written(folder, GOOD))
    assert dict(package.addresses) == {252: (VehicleAddress("10.0.0.2", 14552), VehicleAddress("100.64.3.7", 5762))}


def test_a_mission_without_the_file_has_none(folder: Path) -> None:
    assert dict(load(folder).addresses) == {}


def test_two_that_differ_only_in_addresses_are_the_same_mission(folder: Path) -> None:
    plain = load(folder)
    package = load(written(folder, GOOD))
    other = load(written(folder, GOOD.replace("10.0.0.2", "10.9.9.9")))
    assert package.digest == other.digest == plain.digest
    assert package == other == plain
    assert package.to_bytes() == other.to_bytes() == plain.to_bytes()
    assert "addresses.toml" not in package.files
    assert dict(from_bytes(package.to_bytes()).addresses) == {}


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "addresses.toml: key 'vehicle' is missing"),
        ("[vehicle", "addresses.toml: not TOML: "),
        ("[vehicles]\n", "addresses.toml: unknown key 'vehicles', did you mean 'vehicle'? (allowed: vehicle)"),
        ("vehicle = 1\n", "addresses.toml: [vehicle]: vehicle is 1 (allowed: a table of keys and values)"),
        (
            '[vehicle]\nGCSX = ["udpout:10.0.0.2:14552"]\n',
            "addresses.toml: [vehicle]: unknown key 'GCSX', did you mean 'GCSB'? (allowed: GCSA, GCSB)",
        ),
        (
            '[vehicle]\nGCSB = "udpout:10.0.0.2:14552"\n',
            "addresses.toml: [vehicle], GCSB: the value is 'udpout:10.0.0.2:14552' (allowed: a list)",
        ),
        ("[vehicle]\nGCSB = []\n", "addresses.toml: [vehicle], GCSB: 0 addresses (allowed: 1 to 4, each udpout:"),
        (
            f"[vehicle]\nGCSB = {[f'udpout:10.0.0.2:{port}' for port in range(1, 6)]}\n",
            "addresses.toml: [vehicle], GCSB: 5 addresses (allowed: 1 to 4, each udpout:",
        ),
        (
            '[vehicle]\nGCSB = ["udpout:10.0.0.2:14552", "udpout:10.0.0.2:14552"]\n',
            "addresses.toml: [vehicle], GCSB, address 2: udpout:10.0.0.2:14552 is given twice",
        ),
        (
            '[vehicle]\nGCSB = ["udpout:10.0.0.2:14552", "serial:/dev/ttyUSB0:57600"]\n',
            "addresses.toml: [vehicle], GCSB, address 2: not an address of a vehicle (allowed: udpout:",
        ),
        (
            '[vehicle]\nGCSB = ["udpout:drone.local:14552"]\n',
            "addresses.toml: [vehicle], GCSB, address 1: 'drone.local' is not an IPv4 address in digits (allowed: ",
        ),
        (
            '[vehicle]\nGCSB = ["udpout:0.0.0.0:14552"]\n',
            "addresses.toml: [vehicle], GCSB, address 1: 0.0.0.0 names no computer",
        ),
    ],
)
def test_a_wrong_file_costs_the_addresses_and_not_the_mission(folder: Path, text: str, error: str) -> None:
    """The fault: a station that was restarted in flight did not start."""
    package = load(written(folder, text))
    assert package == load(ROUND)
    assert dict(package.addresses) == {}
    assert package.addresses_fault.startswith(f"{folder / error}")


def test_a_fault_of_the_text_has_its_line(folder: Path) -> None:
    fault = load(written(folder, "[vehicle]\nGCSB = [\nx")).addresses_fault
    assert "(at line 3, column 1)" in fault


def test_a_file_that_cannot_be_read_costs_the_addresses_alone(folder: Path) -> None:
    (folder / "addresses.toml").mkdir()
    assert load(folder).addresses_fault == f"{folder}/addresses.toml: Is a directory"
    (folder / "addresses.toml").rmdir()
    (folder / "addresses.toml").symlink_to("nowhere")
    assert load(folder).addresses_fault == f"{folder}/addresses.toml: No such file or directory"
    (folder / "addresses.toml").unlink()
    (folder / "addresses.toml").write_bytes(b"\xff")
    assert load(folder).addresses_fault == f"{folder}/addresses.toml: not UTF-8 text (byte 0)"


def test_a_right_file_has_no_fault(folder: Path) -> None:
    assert load(folder).addresses_fault == ""
    assert load(written(folder, GOOD)).addresses_fault == ""


def test_no_more_addresses_than_a_message_has_room_for(folder: Path) -> None:
    stations = "".join(f'[[stations]]\nname = "S{n}"\nsysid = {n}\n' for n in range(1, 7))
    (folder / "mission.toml").write_text(
        f'name = "many"\ndetector = "circles"\nroute = "delivery.plan"\nzones = "zones.geojson"\n'
        f"expected_handovers = 0\n{stations}",
        encoding="utf-8",
    )
    features = ",".join(
        f'{{"type":"Feature","properties":{{"station":"S{n}","radius_m":5000}},'
        '"geometry":{"type":"Point","coordinates":[5.924,52.679]}}'
        for n in range(1, 7)
    )
    (folder / "zones.geojson").write_text(f'{{"type":"FeatureCollection","features":[{features}]}}', encoding="utf-8")
    four = '["udpout:10.0.0.2:1", "udpout:10.0.0.2:2", "udpout:10.0.0.2:3", "udpout:10.0.0.2:4"]'
    rows = "".join(f"S{n} = {four}\n" for n in range(1, 7))
    assert load(written(folder, f"[vehicle]\n{rows}")).addresses_fault == (
        f"{folder}/addresses.toml: [vehicle]: 24 addresses (allowed: at most 22 for all stations together)"
    )


def test_the_state_keeps_them_with_the_package(folder: Path, tmp_path: Path) -> None:
    """The fault: after a restart of the companion the package that it gave back to a station had no addresses."""
    package = load(written(folder, GOOD))
    store = StateFile(tmp_path / "state", "drone-1")
    store.save_package(package)
    kept = StateFile(tmp_path / "state", "drone-1").load_package(package.digest)
    assert kept == package
    assert dict(kept.addresses) == {252: (VehicleAddress("10.0.0.2", 14552), VehicleAddress("100.64.3.7", 5762))}
    store.save_package(from_bytes(package.to_bytes()))
    assert dict(store.load_package(package.digest).addresses) == {}


@pytest.mark.parametrize("damage", [b"", b"x", bytes(40), b"\xff" * 400])
def test_a_damaged_file_of_the_state_costs_the_addresses_alone(folder: Path, tmp_path: Path, damage: bytes) -> None:
    package = load(written(folder, GOOD))
    store = StateFile(tmp_path / "state", "drone-1")
    store.save_package(package)
    (tmp_path / "state" / "drone-1.addresses").write_bytes(damage)
    assert store.load_package(package.digest) == package
    assert dict(store.load_package(package.digest).addresses) == {}
