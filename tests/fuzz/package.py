# SPDX-License-Identifier: GPL-3.0-or-later

"""A mission package driven by bytes, from the radio link to the walk, as companion and station take one in.

A plan's first byte says how the rest is meant: as the package itself, as what is in it when unpacked, or as the texts
of its files, with a zero byte between them, which are then packed as `to_bytes` does it. What must hold:

* `from_bytes` gives a package or MissionError with one line, and nothing else;
* what it takes comes back the same over `to_bytes`, and its digest is that of its contents;
* what is done with it beside the main loop (walk, check, mission items) ends;
* all of that in bounded time and memory, which the fuzzer looks after (`fuzz`).
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from mavproxy_handover.mission.check import check
from mavproxy_handover.mission.check_json import report_json
from mavproxy_handover.mission.check_text import report_text
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MISSION_FILE, MissionPackage, from_bytes
from tests.mission.conftest import PLAN, TOML, ZONES

__all__ = ["FILES", "PACKED", "PLAIN", "TEXTS", "packed", "run", "seeds"]

PACKED, PLAIN, TEXTS = range(3)
#: names that the texts of a plan may have; TOML tells which of them count
FILES: Final = (MISSION_FILE, "small.plan", "zones.geojson", "small.waypoints")
_MISSIONS: Final = Path(__file__).resolve().parents[2] / "missions"

CIRCLES: Final = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"station": name, "radius_m": 300, "min_alt_m": 0, "max_alt_m": 120},
            "geometry": {"type": "Point", "coordinates": [longitude, 0.0]},
        }
        for name, longitude in (("A", 10.002), ("B", 10.004))
    ],
}
CORRIDOR: Final = (
    TOML.replace('"polygons"', '"waypoints"')
    .replace('zones = "zones.geojson"\n', "")
    .replace("expected_handovers = 1", "expected_handovers = 1\ncorridor_m = 150.0")
    .replace("sysid = 251", "sysid = 251\nwaypoints = [1, 2]")
    .replace("sysid = 252", "sysid = 252\nwaypoints = [2, 3]")
)
WAYPOINTS: Final = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t0\t10.001\t100\t1
1\t0\t3\t22\t0\t0\t0\t0\t0\t10.001\t30\t1
2\t0\t3\t16\t0\t0\t0\t0\t0\t10.005\t30\t1
3\t0\t3\t21\t0\t0\t0\t0\t0\t10.005\t0\t1
"""


def packed(texts: dict[str, str]) -> bytes:
    """Files as they travel, whatever is in them."""
    plain = json.dumps(texts, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return zlib.compress(plain.encode("utf-8", "surrogatepass"), 1)


def _as_plan(*texts: str) -> bytes:
    return bytes([TEXTS]) + "\0".join(texts).encode()


def seeds() -> Iterator[bytes]:
    """A small mission of each kind, and what a package is made of."""
    plan, zones = json.dumps(PLAN), json.dumps(ZONES)
    yield _as_plan(TOML, plan, zones)
    yield _as_plan(TOML.replace('"polygons"', '"circles"'), plan, json.dumps(CIRCLES))
    yield _as_plan(CORRIDOR, plan)
    yield _as_plan(CORRIDOR.replace('"waypoints"', '"reached"').replace("[2, 3]", "[3]"), plan)
    yield _as_plan(TOML.replace("small.plan", "small.waypoints"), "", zones, WAYPOINTS)
    yield _as_plan(TOML + "\n[policy]\non_out_of_coverage = 'land'\n", plan, zones)
    yield _as_plan("a" + ".a" * 40 + " = 1\n" + TOML, plan, zones)
    yield bytes([PACKED]) + packed({MISSION_FILE: TOML, "small.plan": plan, "zones.geojson": zones})
    yield bytes([PLAIN]) + json.dumps({MISSION_FILE: TOML}, separators=(",", ":")).encode()


def run(plan: bytes) -> MissionPackage | None:
    """Carry a plan out; any exception is a finding. The package, if it is one."""
    if not plan:
        return None
    how, rest = plan[0] % 3, plan[1:]
    if how == PACKED:
        data = rest
    elif how == PLAIN:
        data = zlib.compress(rest, 1)
    else:
        texts = dict(zip(FILES, rest.decode("utf-8", "replace").split("\0"), strict=False))
        data = packed({name: text for name, text in texts.items() if text})
    refused = ""
    try:
        package = from_bytes(data)
    except MissionError as error:
        refused = str(error)
    if refused:
        assert "\n" not in refused
        return None
    again = from_bytes(package.to_bytes())
    assert again == package
    assert package.digest == hashlib.sha256(zlib.decompress(data)).digest()
    report = check(package)
    assert report_text(report)
    assert json.dumps(report_json(report), allow_nan=False)
    assert report.simulation.commanders
    assert package.route.upload_items()
    return package
