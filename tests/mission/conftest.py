# SPDX-License-Identifier: GPL-3.0-or-later

"""A small sound mission, in pieces that a test can spoil one at a time.

It lies on the equator at longitude 10, where a degree of latitude is 110574.3 m and a degree of longitude 111319.5 m:
zone A from longitude 10.000 to 10.004, zone B from 10.002 to 10.006, both from latitude -0.001 to 0.001.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

MISSIONS = Path(__file__).resolve().parents[2] / "missions"

TOML = """\
name = "small"
detector = "polygons"
route = "small.plan"
zones = "zones.geojson"
expected_handovers = 1

[[stations]]
name = "A"
sysid = 251

[[stations]]
name = "B"
sysid = 252
"""


def simple_item(number: int, command: int, lat: float, lon: float, alt: float, param1: float = 0) -> dict[str, Any]:
    return {
        "AMSLAltAboveTerrain": None,
        "Altitude": alt,
        "AltitudeMode": 1,
        "autoContinue": True,
        "command": command,
        "doJumpId": number,
        "frame": 3,
        "params": [param1, 0, 0, None, lat, lon, alt],
        "type": "SimpleItem",
    }


PLAN: dict[str, Any] = {
    "fileType": "Plan",
    "version": 1,
    "groundStation": "QGroundControl",
    "geoFence": {"circles": [], "polygons": [], "version": 2},
    "rallyPoints": {"points": [[0.0, 10.0035, 30]], "version": 2},
    "mission": {
        "version": 2,
        "firmwareType": 3,
        "vehicleType": 2,
        "cruiseSpeed": 15,
        "hoverSpeed": 5,
        "plannedHomePosition": [0.0, 10.001, 100.0],
        "items": [
            simple_item(1, 22, 0.0, 10.001, 30),
            simple_item(2, 16, 0.0, 10.005, 30),
            simple_item(3, 21, 0.0, 10.005, 0),
        ],
    },
}


def box(west: float, east: float, south: float = -0.001, north: float = 0.001) -> list[list[float]]:
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


def feature(station: str, coordinates: Any, kind: str = "Polygon", **properties: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"station": station, **properties},
        "geometry": {"type": kind, "coordinates": coordinates},
    }


ZONES: dict[str, Any] = {
    "type": "FeatureCollection",
    "features": [feature("A", [box(10.0, 10.004)]), feature("B", [box(10.002, 10.006)])],
}


class SmallMission:
    """The pieces of the small mission; change them, then `write()` the folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.toml = TOML
        self.plan = copy.deepcopy(PLAN)
        self.zones = copy.deepcopy(ZONES)
        self.item: Callable[..., dict[str, Any]] = simple_item
        self.feature: Callable[..., dict[str, Any]] = feature
        self.box: Callable[..., list[list[float]]] = box

    @property
    def items(self) -> list[Any]:
        return self.plan["mission"]["items"]

    def write(self) -> Path:
        self.folder.mkdir(exist_ok=True)
        (self.folder / "mission.toml").write_text(self.toml, encoding="utf-8")
        (self.folder / "small.plan").write_text(json.dumps(self.plan), encoding="utf-8")
        (self.folder / "zones.geojson").write_text(json.dumps(self.zones), encoding="utf-8")
        return self.folder


@pytest.fixture
def small(tmp_path: Path) -> SmallMission:
    return SmallMission(tmp_path / "small")


@pytest.fixture
def missions() -> Path:
    return MISSIONS
