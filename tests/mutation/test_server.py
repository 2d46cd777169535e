# SPDX-License-Identifier: GPL-3.0-or-later

"""What can be planted in a running process, which lines a test reaches, and what is planted together."""

from __future__ import annotations

import ast
from pathlib import Path
from types import CodeType

import pytest

from tests.mutation.core import Listed, rounds, stale_of
from tests.mutation.faults import Fault, faults
from tests.mutation.server import _Book, _changed, _Lines

SOURCE = """
NUMBER = 4

def plain(value, limit=5):
    if value < limit:
        return value
    return limit

class Some:
    field: int = 6

    def method(self):
        return [each for each in (1, 2)]

TABLE = {"one": lambda value: not value}
"""


def planted(old: str, new: str) -> set[str] | None:
    """The names of the functions that differ; None if it cannot be planted."""
    assert old in SOURCE
    found: dict[tuple[str, str, int], CodeType] = {}
    codes = [compile(source, "some.py", "exec") for source in (SOURCE, SOURCE.replace(old, new))]
    return {key[1] for key in found} if _changed(*codes, found) else None


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        ("value < limit", "value <= limit", {"plain"}),
        ("(1, 2)", "(1, 3)", {"Some.method"}),
        ("not value", "value", {"<lambda>"}),
        ("limit=5", "limit=6", None),
        ("NUMBER = 4", "NUMBER = 5", None),
        ("field: int = 6", "field: int = 7", None),
        ('"one"', '"two"', None),
    ],
)
def test_a_function_is_planted_and_what_a_module_begins_with_is_not(old: str, new: str, names: set[str] | None) -> None:
    assert planted(old, new) == names


def test_each_fault_of_a_function_makes_another_module() -> None:
    original = compile(ast.parse(SOURCE), "some.py", "exec")
    made = [fault.edit.made(lambda tree: compile(tree, "some.py", "exec")) for fault in faults(SOURCE) if fault.edit]
    assert len(made) == 8
    assert original not in made
    assert compile(ast.parse(SOURCE), "some.py", "exec") == original


@pytest.mark.parametrize(("value", "lines"), [(4, {4, 5, 6}), (9, {4, 5, 7})])
def test_the_lines_that_are_reached(value: int, lines: set[int]) -> None:
    module: dict[str, object] = {}
    exec(compile(SOURCE, "some.py", "exec"), module)
    plain = module["plain"]
    assert callable(plain)
    with _Lines({"some.py"}) as reached:
        plain(value)
    assert reached.reached == {"some.py": sum(1 << line for line in lines)}


def test_a_function_that_is_called_often_reaches_all_of_its_lines() -> None:
    module: dict[str, object] = {}
    exec(compile(SOURCE, "some.py", "exec"), module)
    plain = module["plain"]
    assert callable(plain)
    with _Lines({"some.py"}) as reached:
        for _number in range(1000):
            plain(4)
    assert reached.reached["some.py"] & 1 << 7


def listed(*names: str) -> list[Listed]:
    return [("some", Fault(name)) for name in names]


def test_two_faults_of_one_statement_or_table_are_not_planted_together() -> None:
    found = [fault for fault in faults(SOURCE) if fault.edit]
    groups = rounds([("some", fault) for fault in found])
    for group in groups:
        lines = [fault.edit.lines.start for _module, fault in group if fault.edit]
        assert len(set(lines)) == len(lines)
    assert sum(map(len, groups)) == len(found)
    names = [[fault.name for _module, fault in group] for group in rounds(listed("f: 1", "g: 1", "f: 2", "h: 1"))]
    assert names == [["f: 1", "g: 1", "h: 1"], ["f: 2"]]


@pytest.mark.parametrize(
    ("noticed", "stale", "apart"),
    [
        ([], set(), set()),
        (["b"], {"b"}, set()),
        (["a", "e"], {"a", "e"}, set()),
        (["a", "b", "c", "d", "e"], {"a", "b", "c", "d", "e"}, set()),
        (["bd"], set(), {"d"}),
        (["ace", "b"], {"b"}, {"e"}),
    ],
)
def test_of_faults_planted_together_those_that_are_noticed_are_found(
    noticed: list[str], stale: set[str], apart: set[str]
) -> None:
    """Each test notices the faults in its name, if all of these are planted."""

    def noticing(some: list[Listed], only: list[str] | None) -> list[str]:
        planted = {fault.name for _module, fault in some}
        return [test for test in noticed if planted.issuperset(test) and (only is None or test in only)]

    found = stale_of(listed("a", "b", "c", "d", "e"), noticing)
    assert [{fault.name for _module, fault in group} for group in found] == [stale, apart]


def test_what_is_recorded_of_a_test_holds_until_its_file_or_the_rules_change(tmp_path: Path) -> None:
    kept, rules, test = tmp_path / "kept", tmp_path / "rules.py", tmp_path / "test_some.py"
    rules.write_text("a rule", encoding="utf-8")
    test.write_text("a test", encoding="utf-8")
    book = _Book(kept, [str(rules)])
    book.of_file(test)["test_one"] = 0.5, {"rules.py": 6}
    book.keep()
    assert _Book(kept, [str(rules)]).of_file(test) == {"test_one": (0.5, {"rules.py": 6})}
    test.write_text("another test", encoding="utf-8")
    assert _Book(kept, [str(rules)]).of_file(test) == {}
    test.write_text("a test", encoding="utf-8")
    rules.write_text("another rule", encoding="utf-8")
    assert _Book(kept, [str(rules)]).of_file(test) == {}
