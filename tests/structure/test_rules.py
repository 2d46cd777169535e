# SPDX-License-Identifier: GPL-3.0-or-later

"""How the rules are built: authority and safety do not know each other, and each object changes its own fields only."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest

from tests.structure.imports import edges, files

CORE = "mavproxy_handover.core"
#: part of the rules -> the parts that it may import; the arbiter, which stands above all of them, may import each
MAY_IMPORT = {
    "common": {"common"},
    "authority": {"authority", "common"},
    "safety": {"safety", "common"},
}


def rules() -> list[str]:
    return [name for name in files() if name.startswith(CORE + ".")]


def part(module: str) -> str:
    """The folder of the rules that a module lies in; "" for what lies above the folders."""
    folder = module.removeprefix(CORE).removeprefix(".").split(".")[0]
    return folder if folder in MAY_IMPORT else ""


def test_authority_and_safety_meet_in_common_and_in_the_arbiter_alone() -> None:
    wrong = [
        f"{module} imports {other}"
        for module in rules()
        if part(module)
        for other in edges()[module]
        if other.startswith(CORE + ".") and part(other) not in MAY_IMPORT[part(module)]
    ]
    assert wrong == []
    assert {part(module) for module in rules()} == {"", *MAY_IMPORT}
    assert {part(other) for other in edges()[f"{CORE}.arbiter"]} == set(MAY_IMPORT)


def foreign_writes(source: str) -> Iterator[str]:
    """Assignments to a field of another object than `self`, each with the function that it stands in."""
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        for node in ast.walk(function):
            if isinstance(node, ast.Assign | ast.Delete):
                targets = list(node.targets)
            elif isinstance(node, ast.AugAssign | ast.AnnAssign | ast.For | ast.comprehension):
                targets = [node.target]
            else:
                continue
            while targets:
                target = targets.pop()
                if isinstance(target, ast.Tuple | ast.List):
                    targets += target.elts
                elif isinstance(target, ast.Subscript | ast.Starred):
                    targets.append(target.value)
                elif isinstance(target, ast.Attribute) and not (
                    isinstance(target.value, ast.Name) and target.value.id == "self"
                ):
                    yield f"{function.name}: {ast.unparse(target)}"


@pytest.mark.parametrize("module", rules())
def test_each_object_of_the_rules_changes_its_own_fields_only(module: str) -> None:
    """Another object is told what has happened, by a method."""
    assert list(foreign_writes(files()[module].read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    ("statement", "written"),
    [
        ("self.a = 1", []),
        ("self.a[0] = 1", []),
        ("a = self.a", []),
        ("self.a.b = 1", ["f: self.a.b"]),
        ("other.b += 1", ["f: other.b"]),
        ("self.a, other.b = 1, 2", ["f: other.b"]),
        ("self.a = other.b = 1", ["f: other.b"]),
        ("other.b['x'] = 1", ["f: other.b"]),
        ("del other.b", ["f: other.b"]),
        ("for other.b in []: pass", ["f: other.b"]),
    ],
)
def test_the_walk_sees_the_writes(statement: str, written: list[str]) -> None:
    assert list(foreign_writes(f"def f(self, other):\n    {statement}\n")) == written
