# SPDX-License-Identifier: GPL-3.0-or-later

"""`addresses.toml`: where each station reaches the vehicle. It travels with the mission, outside its digest."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import from_bytes, load
from mavproxy_handover.vehicle_address import VehicleAddress
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
def test_a_wrong_file_is_refused_by_file_place_and_what_is_allowed(folder: Path, text: str, error: str) -> None:
    with pytest.raises(MissionError) as caught:
        load(written(folder, text))
    assert str(caught.value).startswith(error)


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
    with pytest.raises(MissionError) as caught:
        load(written(folder, f"[vehicle]\n{rows}"))
    assert str(caught.value) == (
        "addresses.toml: [vehicle]: 24 addresses (allowed: at most 22 for all stations together)"
    )
