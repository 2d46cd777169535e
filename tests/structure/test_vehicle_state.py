# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot says is kept once: no part of the companion has a copy of the parameters beside the state's."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from tests.structure.imports import files

#: reads a parameter for one question and its answer, and keeps nothing
ANSWERS = {
    "mavproxy_handover.autopilot.preflight:_collector",
    "mavproxy_handover.autopilot.cruise:held_cruise",
    "mavproxy_handover.autopilot.cruise:_value_of",
    "mavproxy_handover.autopilot.cruise:_within",
    "mavproxy_handover.autopilot.cruise:_write",
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
