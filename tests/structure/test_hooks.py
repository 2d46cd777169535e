# SPDX-License-Identifier: GPL-3.0-or-later

"""A part is complete when it is constructed: no other part assigns one of its functions later."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator

from tests.structure.imports import files
from tests.structure.test_rules import foreign_writes

#: the programs; the simulation is no part of them
PACKAGES = ("mavproxy_handover.", "gcs_module.")


def functions_held(source: str) -> Iterator[str]:
    """Fields that hold a function and can be assigned, by their annotation: what is frozen cannot be."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Attribute):
            fields = [node]
        elif isinstance(node, ast.ClassDef) and not any("frozen=True" in ast.unparse(d) for d in node.decorator_list):
            fields = [field for field in node.body if isinstance(field, ast.AnnAssign)]
        else:
            continue
        for field in fields:
            if ast.unparse(field.annotation).startswith("Callable"):
                yield field.target.attr if isinstance(field.target, ast.Attribute) else ast.unparse(field.target)


def hooks_set(sources: Iterable[str]) -> list[str]:
    """Assignments from outside to a field that holds a function."""
    known = list(sources)
    held = {name for source in known for name in functions_held(source)}
    return [
        written for source in known for written in foreign_writes(source) if written.rpartition(".")[2].strip() in held
    ]


def test_no_part_sets_a_function_of_another_one() -> None:
    sources = [path.read_text("utf-8") for name, path in files().items() if name.startswith(PACKAGES)]
    assert len(sources) > 300
    assert hooks_set(sources) == []


def test_the_walk_sees_a_hook() -> None:
    pipe = "class Pipe:\n    def __init__(self):\n        self.at_the_end: Callable[[], None] = print\n"
    user = "def start(self):\n    self.pipe.at_the_end = self.close\n    self.pipe.beats = 0\n"
    assert hooks_set([pipe, user]) == ["start: self.pipe.at_the_end"]
