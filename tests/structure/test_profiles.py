# SPDX-License-Identifier: GPL-3.0-or-later

"""All that depends on the kind of aircraft is in `vehicle/profiles/`: no other part asks what kind of aircraft it is.

A test for the kind is one of TESTS in the code of a line, outside the profiles, without comments and docstrings. On
28 November 2026, before the profiles, these patterns found 188 such lines in 49 files.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from typing import Final

from mavproxy_handover.vehicle.profiles import PROFILES
from tests.structure.imports import files

#: the code that flies, and that of the stations
PARTS: Final = ("mavproxy_handover", "gcs_module")
PROFILES_ARE_IN: Final = "mavproxy_handover.vehicle.profiles"
#: what names a kind of aircraft, or asks for one
TESTS: Final = (
    r"\bwinged\b|\bWINGED\w*|\bis_(?:copter|plane|rover)\b",
    r"\b(?:COPTER|PLANE|QUADPLANE)S?\b|\b(?:COPTER|PLANE)_AUTO\b",
    r"\bKind\.(?:COPTER|PLANE|QUADPLANE)\b|\bwings: bool\b|\bwings=(?:True|False)\b",
    r"'(?:copter|plane|quadplane|rover)'",
    r"\bMAV_TYPE_(?:FIXED_WING|VTOL\w*|\w+ROTOR|HELICOPTER|COAXIAL|GROUND_ROVER|SURFACE_BOAT)\b",
    r"(?<!for )\bprofile(?:\.name|\.firmware)? (?:is|is not|==|!=|in|not in) (?!None\b|not None\b)\S",
    r" (?:is|is not|==|!=) [\w.]*\bprofile(?:\.name|\.firmware)?(?![\w.])",
    r"\bisinstance\([^)]*Procedures\b|\btype\(\S*procedures\b",
)
#: what every one of them contains
_NAMES: Final = re.compile("wing|copter|plane|rover|kind|mav_type|profile|procedures", re.IGNORECASE)
#: module -> how many stay, and why
STAY: Final = {
    "mavproxy_handover.monitors.preflight.rules": (1, "a value of the parameter Q_MAV_TYPE, which ArduPlane has"),
    "mavproxy_handover.monitors.preflight.plan_fit": (1, "whether mission and aircraft have the same profile"),
}
MOST: Final = 10


class _WithoutDocstrings(ast.NodeTransformer):
    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        return None if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str) else node


def questions_of_kind(source: str) -> Iterator[str]:
    """The lines of code of that source that ask for the kind of aircraft."""
    if not _NAMES.search(source):
        return
    tree = ast.fix_missing_locations(_WithoutDocstrings().visit(ast.parse(source)))
    found = re.compile("|".join(TESTS))
    for line in ast.unparse(tree).splitlines():
        if found.search(line):
            yield line.strip()


def test_no_part_but_the_profiles_asks_what_kind_of_aircraft_it_is() -> None:
    asked = {
        module: lines
        for module, path in files().items()
        if module.startswith(PARTS) and not module.startswith(PROFILES_ARE_IN)
        if (lines := list(questions_of_kind(path.read_text(encoding="utf-8"))))
    }
    assert {module: len(lines) for module, lines in asked.items()} == {
        module: count for module, (count, _why) in STAY.items()
    }, asked
    assert sum(count for count, _why in STAY.values()) <= MOST


def test_each_way_to_ask_would_be_found() -> None:
    """Else the test above holds whatever the code does."""
    for line in (
        "if route.kind.winged: pass",
        "from mavproxy_handover.vehicle.profiles import QUADPLANE",
        "if kind is Kind.PLANE: pass",
        "model = settings.model(wings=True)",
        "if package.profile.name == 'plane': pass",
        "if m.type == mavlink.MAV_TYPE_FIXED_WING: pass",
        "if state.profile is ASSUMED: pass",
        "if state.profile in (A, B): pass",
        "if isinstance(procedures, CopterProcedures): pass",
    ):
        assert len(list(questions_of_kind(line))) == 1, line
    for line in (
        '"""A copter."""',
        "pass  # PLANE",
        "if profile is None: pass",
        "if state.profile.holds_by_circling: pass",
        "profiles = {profile.name: profile for profile in PROFILES}",
    ):
        assert list(questions_of_kind(line)) == [], line


def test_each_profile_has_a_name_of_its_own_and_a_mode_for_each_role() -> None:
    assert max(Counter(profile.name for profile in PROFILES).values()) == 1
    for profile in PROFILES:
        assert {profile.auto, profile.guided, profile.back, profile.land} <= profile.modes.keys(), profile.name
        assert profile.carried_out.keys() == profile.handling.shows.keys(), profile.name
        assert profile.types, profile.name
