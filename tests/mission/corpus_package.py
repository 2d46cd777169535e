# SPDX-License-Identifier: GPL-3.0-or-later

"""Makes the mission package of a file of the corpus, with one station whose zone holds all of it."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.mission.package import MissionPackage, from_texts
from tests.mission.corpus import HOME, Case

__all__ = ["package_of"]

_TOML: Final = """\
name = "corpus"
aircraft = "{kind}"
detector = "circles"
route = "{file}"
zones = "zones.geojson"
expected_handovers = 0
{extra}

[[stations]]
name = "A"
sysid = 251

{tables}
"""
_ZONES: Final = """\
{{"type": "FeatureCollection", "features": [{{"type": "Feature", "properties": {{"station": "A", "radius_m": 9000}},
"geometry": {{"type": "Point", "coordinates": [{lon}, {lat}]}}}}]}}
"""
#: what SITL's aircraft draw
_TABLES: Final = {
    "copter": """
[energy]
battery_wh = 5000.0
hover_w = 354.0
cruise_w = 385.0
climb_factor = 1.1
descent_factor = 0.96
""",
    "plane": """
[wings]
circle_m = 80

[energy]
battery_wh = 5000.0
cruise_w = 134.0
cruise_mps = 22.0
headwind_mps = 0
""",
    "quadplane": """
[wings]
circle_m = 80
turn_part = 0.77

[energy]
battery_wh = 5000.0
hover_w = 530.0
cruise_w = 127.0
climb_factor = 1.17
descent_factor = 0.95
cruise_mps = 22.0
headwind_mps = 0
""",
}


def package_of(case: Case) -> MissionPackage:
    """The package of a case. Raises MissionError."""
    speed = f"cruise_speed_mps = {10 if case.kind == 'copter' else 22}"
    texts = {
        "mission.toml": _TOML.format(
            kind=case.kind, file=case.file, extra=f"{speed}\n{case.extra}", tables=_TABLES[case.kind]
        ),
        "zones.geojson": _ZONES.format(lat=HOME[0], lon=HOME[1]),
        case.file: case.text,
    }
    if case.terrain:
        texts["ground.asc"] = case.terrain
    return from_texts(texts, case.name)
