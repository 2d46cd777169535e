# SPDX-License-Identifier: GPL-3.0-or-later

"""Every sentence of a station's rules is in the table that the page about messages is made from."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from string import Formatter

import pytest

from gcs_module.alarms import EVENTS
from gcs_module.notices import NOTICES, QUESTION, notice
from reference.messages import messages
from tests.structure.language import Text, check

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "gcs_module").rglob("*.py"))
#: file -> how many notices it makes without the table, and why
WITHOUT = {
    "notices.py": (1, "it makes them from the table"),
    "decisions.py": (4, "the sentence is the vehicle's, which is in core/safety/sentence.py"),
    "aircraft.py": (2, "a line about an address, of mission/keys.py or vehicle_addresses.py"),
    "commands.py": (1, "a line about an address, of vehicle_addresses.py"),
}


def calls(source: str, name: str) -> Iterator[ast.Call]:
    """The calls of a class by any path, or of a function by its name: methods have the function's name too."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        by_name = isinstance(node.func, ast.Name) and node.func.id == name
        by_path = isinstance(node.func, ast.Attribute) and node.func.attr == name == "Notice"
        if by_name or by_path:
            yield node


def names(call: ast.Call) -> set[str]:
    """The rows that the first argument of a call can name."""
    return {
        node.value for node in ast.walk(call.args[0]) if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }


def named(source: str) -> set[str]:
    """The rows that a file names: in a call, or in a variable that a call uses."""
    found = {name for call in calls(source, "notice") for name in names(call)}
    variables = {call.args[0].id for call in calls(source, "notice") if isinstance(call.args[0], ast.Name)}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Assign) and any(getattr(target, "id", "") in variables for target in node.targets):
            found |= {part.value for part in ast.walk(node.value) if isinstance(part, ast.Constant)}
    return found


def test_no_notice_is_made_without_the_table() -> None:
    made = {path.name: len([*calls(path.read_text(encoding="utf-8"), "Notice")]) for path in SOURCES}
    assert {name: count for name, count in made.items() if count} == {name: n for name, (n, _why) in WITHOUT.items()}


def test_every_row_is_told_and_every_name_is_a_row() -> None:
    told = set().union(*(named(path.read_text(encoding="utf-8")) for path in SOURCES))
    assert told == set(NOTICES)


def test_a_notice_past_the_table_is_noticed() -> None:
    for made in ("Notice", "events.Notice"):
        assert len([*calls(f'actions.append({made}("lost", "it has gone."))', "Notice")]) == 1
    assert named('name = "a" if x else "b"\nnotice(name, y="no")\nnotice("c")') == {"a", "b", "c"}


@pytest.mark.parametrize("name", NOTICES)
def test_a_row_is_a_sentence_with_meaning_and_action(name: str) -> None:
    row = NOTICES[name]
    assert row.event in EVENTS
    for text in (row.meaning, row.action):
        assert re.fullmatch(r"['A-Z].*\.", text), text
    shown = re.sub(r"\{[^}]*\}", "X", row.template)
    assert [found for text in (shown, row.meaning, row.action) for found in check(Text("message", 1, text))] == []


@pytest.mark.parametrize("name", NOTICES)
def test_a_row_takes_its_values_and_asks_only_if_it_waits(name: str) -> None:
    fields = [field for _text, field, _spec, _how in Formatter().parse(NOTICES[name].template) if field]
    values = {field: 7.0 if field.endswith("_s") else "{drone}" for field in fields}
    line = notice(name, **values)
    assert line.gravity is NOTICES[name].gravity
    assert notice(name, waits=True, **values).text == line.text + QUESTION
    assert line.text.count("{drone}") == sum(not field.endswith("_s") for field in fields)


def test_the_page_has_every_row() -> None:
    rows = [line for line in messages().partition("\n### ")[0].splitlines() if line.startswith("| `")]
    assert len(rows) == len(NOTICES)
