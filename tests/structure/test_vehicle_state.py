# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot says is kept once, in small classes: no part has a copy of the parameters beside the state's."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from tests.structure.imports import edges, files

#: reads a parameter for one question and its answer, and keeps nothing
ANSWERS = {
    "mavproxy_handover.vehicle.parameter_reading:_collector",
    "mavproxy_handover.vehicle.cruise:held_cruise",
    "mavproxy_handover.vehicle.cruise:_value_of",
    "mavproxy_handover.vehicle.cruise:_within",
    "mavproxy_handover.vehicle.cruise:_write",
}
CACHE = "mavproxy_handover.vehicle.parameters:Parameters"


def readers(source: str) -> Iterator[str]:
    """The classes and functions at the top of a module that read the value of a PARAM_VALUE."""
    for node in ast.parse(source).body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and any(
            isinstance(part, ast.Attribute) and part.attr == "param_value" for part in ast.walk(node)
        ):
            yield node.name


def found() -> set[str]:
    return {
        f"{module}:{name}"
        for module, path in files().items()
        if module.startswith("mavproxy_handover.")
        for name in readers(path.read_text(encoding="utf-8"))
    }


def test_one_class_keeps_the_autopilots_parameters() -> None:
    assert found() - ANSWERS == {CACHE}


def test_a_second_copy_would_be_found() -> None:
    """Else the test above holds whatever the code does."""
    copy = "class Watch:\n    def take(self, m):\n        self._told[m.param_id] = float(m.param_value)\n"
    assert list(readers(copy)) == ["Watch"]
    assert list(readers("class Watch:\n    pass\n")) == []


#: a class of these parts has no more fields
MOST_FIELDS = 15
PARTS = ("mavproxy_handover.vehicle.", "mavproxy_handover.monitors.")
#: data of a kind of aircraft: tables and no state
TABLES = {"mavproxy_handover.vehicle.profiles.profile:Profile"}


def fields(cls: ast.ClassDef) -> set[str]:
    """What a class keeps: its annotated fields, and whatever its methods assign to `self`."""
    declared = {
        node.target.id for node in cls.body if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    assigned = {
        node.attr
        for node in ast.walk(cls)
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Store)
        and isinstance(node.value, ast.Name)
        and node.value.id == "self"
    }
    return declared | assigned


def test_no_class_of_state_and_monitors_keeps_much() -> None:
    large = {
        f"{module}:{node.name}": len(fields(node))
        for module, path in files().items()
        if module.startswith(PARTS)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef) and len(fields(node)) > MOST_FIELDS
    }
    assert set(large) == TABLES, large


def test_fields_are_counted_however_they_are_made() -> None:
    source = (
        "class A:\n    a: int\n    def f(self):\n        self.b, self.c = 1, 2\n        self.b += 1\n        x.d = 3\n"
    )
    (cls,) = ast.parse(source).body
    assert isinstance(cls, ast.ClassDef)
    assert fields(cls) == {"a", "b", "c"}


def monitor(module: str) -> str | None:
    """The monitor that a module belongs to, a file or a folder of `monitors/`; None: it belongs to none."""
    parts = module.split(".")
    return parts[2] if parts[:2] == ["mavproxy_handover", "monitors"] and len(parts) > 2 else None


def test_no_monitor_imports_another() -> None:
    names = {monitor(module) for module in files()} - {None}
    assert {
        "borders",
        "conditions",
        "energy",
        "gaps",
        "mode_and_motion",
        "position",
        "preflight",
        "reboots",
        "return_site",
        "route",
        "waypoints",
    } <= names
    assert [
        f"{module} imports {other}"
        for module, others in edges().items()
        for other in others
        if monitor(module) and monitor(other) and monitor(module) != monitor(other)
    ] == []


#: by these a part would speak or act itself
VOICES = ("mavproxy_handover.operator", "mavproxy_handover.companion")


def test_monitors_return_what_they_find_and_tell_nobody() -> None:
    assert [
        f"{module} imports {other}"
        for module, others in edges().items()
        for other in others
        if monitor(module) and other.startswith(VOICES)
    ] == []
    assert any(other.startswith(VOICES) for other in edges()["mavproxy_handover.operator.base.context"])
