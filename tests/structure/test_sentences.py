# SPDX-License-Identifier: GPL-3.0-or-later

"""Every sentence of the vehicle is in the tables that the page about messages is made from.

`tests/module` compares what the companion says while its tests run. Here the sources are walked: a literal that people
could read has to be a part of a row, a value of one (`words.py`), or is counted in `WITHOUT` with the reason.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from mavproxy_handover.core.common.levels import Level
from mavproxy_handover.gate.refusal_text import COMMANDS, MESSAGES
from reference.messages import messages
from reference.sentences import COMPANION, GUARD, NOTHING, OF_GUARD, VEHICLE, guard
from reference.sentences.matching import normal, pieces
from reference.sentences.row import LISTS, VALUES, Group, Sentence
from reference.sentences.words import WORDS
from tests.module.said import unknown

ROOT = Path(__file__).resolve().parents[2]
PARTS = ("companion", "operator", "core", "monitors", "vehicle", "gate")
GROUPS = {group.name: group for group in VEHICLE}
ROWS = [(group, row) for group in VEHICLE for row in group.rows]
#: files whose literals are no sentences of a flight: file or folder -> why
OTHER_TEXTS = {
    "core/common/causes.py": "the meaning of each cause: in the configuration, and in this page's table of causes",
    "core/common/handling.py": "what an order does to the aircraft: for 'handover explain'",
    "core/safety/explain.py": "the answer of 'handover explain', which docs/safety.md is made from",
    "core/safety/strategy.py": "facts of the decision table: docs/safety.md is made from it",
    "core/authority/transfer.py": "steps of a transfer: docs/authority.md has them",
    "gate/explain.py": "the answer of 'handover policy'",
    "gate/examples.py": "the answer of 'handover policy'",
    "gate/trial.py": "the answer of 'handover policy'",
    "gate/policy": "why a class is refused: the answer of 'handover policy', and docs/reference/locked.md",
    "gate/onboard.py": "names of the filters of onboard programs, for docs/onboard-programs.md",
    "gate/filters.py": "names of the gate's filters, for docs/architecture.md",
    "vehicle/profiles": "kinds of aircraft: docs/missions.md and docs/wings.md",
}
#: literals that no person reads by themselves: reason -> the literals
EXEMPT = {
    "the name of a part, in 'internal fault of the companion: PART'": (
        "mission read back",
        "order in a rehearsal",
        "word of it",
        "what follows from a new view",
        "closing the state",
        "start called off",
        "the answer to the disarm",
        "the return site to be written",
        "the way alone",
        "whether it is on the ground",
        "frame of a station",
        "stamps of the autopilot",
        "message of the autopilot",
        "parameters of a return",
        "fence of a return",
        "word of a decision",
        "word of a fault",
        "word of heartbeats",
        "home and limits of a return",
        "memory of the batteries",
        "judging a command",
        "mission found in flight",
        "upload read back",
        "upload on the ground",
        "uploads in flight",
        "uploads on the ground",
        "end of a load",
        "way of the mission",
        "the mission on board",
        "the way ahead",
        "time to pass",
        "frame that passed",
        "news of feeds",
        "Remote ID of a station",
        "answering a terrain request",
    ),
    "the name of a subject in 'N more entries of STATION left out: SUBJECT'": (
        "refused frames in its name without a valid signature",
        "refused frames without proof of their sender",
        "what it said and was told",
    ),
    "what MAVProxy calls the module": ("autopilot of this vehicle", "authority handover (companion)"),
    "what a command does, in the COMMAND of a refusal": (
        "making a folder",
        "renaming a file",
        "removing a file",
        "ending a file transfer",
        "rally point upload",
        "upload of everything",
        "rally point removal",
        "removal of everything",
    ),
    "the meaning of a member of an enumeration, for the code": (
        "to a place that is named",
        "stands still, or circles where it is",
        "down to the ground",
        "no source in flight",
        "the station with authority",
        "the mission, at its end",
        "an unknown source",
        "the autopilot follows",
        "takeover allowed or not",
        "the transfer under way has the commander's consent",
        "takeover not allowed, nor the transfer under way",
        "a transfer; the commander is asked",
        "a transfer; the commander has consented",
        "a transfer; it is the commander's own wish",
        "a forced transfer: there is no commander",
        "granted at once, on the ground",
        "no station commands, on the ground",
        "offered to any station that can take it, takeover allowed",
    ),
    "a mistake of the code that constructs it, which no configuration can make": (
        "no case for \0",
        "parent \0 is not among the stations",
        "system id \0 of station \0: must be 1 to 255",
        "\0 = \0: must be above 0",
        "most = \0: must be 1 or more",
    ),
    "a type": ("str | int | bytes",),
    "a pattern that is searched": ("HNDO: lease refused, channel (\\d+) not (-?\\d+)",),
    "the name of an auxiliary function that has none": ("not known here",),
    "an error of the configuration": (
        "\0 says nothing without mass_kg, the mass at take-off with it",
        "\0 must be less than mass_kg, \0",
    ),
}
_EXEMPT = {text for texts in EXEMPT.values() for text in texts}


def literals(source: str) -> Iterator[tuple[int, str]]:
    """The literals of a file that have at least three words, with a gap for each value; docstrings are left out."""
    tree, skipped = ast.parse(source), set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            skipped.update(id(each.value) for each in node.body if isinstance(each, ast.Expr))
        text = ""
        if isinstance(node, ast.JoinedStr):
            skipped.update(map(id, node.values))
            text = "".join(str(each.value) if isinstance(each, ast.Constant) else "\0" for each in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in skipped:
            text = re.sub(r"\{\w*(![rs])?(:[^}]*)?\}", "\0", node.value)
        if (
            len(
                [word for word in re.split(r"[\s\0]+", text) if re.search(r"(?<![A-Za-z_])[A-Za-z]?[a-z]+(?!\w)", word)]
            )
            >= 3
        ):
            yield node.lineno, " ".join(text.split())


@cache
def known() -> tuple[str, ...]:
    """The texts of all rows, and the words that stand in them."""
    words = [pattern.replace("\\", "") for pattern in WORDS.values()]
    words += [*COMMANDS.values(), *MESSAGES.values()]
    return tuple(text.lower() for text in (*(normal(row.template) for _group, row in ROWS), *words))


def is_known(text: str) -> bool:
    """Whether one row has all parts of a literal, in its order."""
    parts = [part.lower().strip("[]") for part in pieces(text)]

    def has(row: str) -> bool:
        at = 0
        for part in parts:
            at = row.find(part, at)
            if at < 0:
                return False
            at += len(part)
        return True

    return any(map(has, known()))


def unknown_in(path: Path) -> list[str]:
    found = literals(path.read_text(encoding="utf-8"))
    return [f"{line}: {text!r}" for line, text in found if text not in _EXEMPT and not is_known(text)]


def files() -> Iterator[tuple[str, Path]]:
    for part in PARTS:
        for path in sorted((ROOT / "mavproxy_handover" / part).rglob("*.py")):
            name = path.relative_to(ROOT / "mavproxy_handover").as_posix()
            if not name.startswith(tuple(OTHER_TEXTS)):
                yield name, path


@pytest.mark.parametrize(("name", "path"), [*files()])
def test_every_literal_that_people_read_is_a_part_of_a_row(name: str, path: Path) -> None:
    assert unknown_in(path) == [], f"{name}: write a row in reference/sentences"


def test_what_is_left_out_exists() -> None:
    assert [name for name in OTHER_TEXTS if not (ROOT / "mavproxy_handover" / name).exists()] == []
    there = {text for _name, path in files() for _line, text in literals(path.read_text(encoding="utf-8"))}
    assert _EXEMPT - there == set()


def test_a_sentence_without_a_row_is_noticed(tmp_path: Path) -> None:
    file = tmp_path / "new.py"
    file.write_text(
        '"""A docstring that no one reads."""\nsay(f"the moon is in the way of {name}")\nsay("no mission loaded")'
    )
    assert unknown_in(file) == ["2: 'the moon is in the way of \\x00'"]
    said = [
        ("The moon is in the way.", None),
        ("GCSA commands now", Level.EMERGENCY),
        ("GCSA commands now", Level.ADVISORY),
    ]
    assert unknown(said) == [
        "no row in reference/sentences: 'The moon is in the way.'",
        "EMERGENCY in flight, ADVISORY in its row: 'GCSA commands now'",
    ]


@pytest.mark.parametrize("text", ["Something is wrong", "a", "x: y", "It works.", "GCSA is here: GCSB. All is well"])
def test_no_row_matches_any_text(text: str) -> None:
    assert COMPANION.find(text) is None


def test_no_whole_sentence_is_only_a_value_that_can_be_anything() -> None:
    anything = {name for name, pattern in VALUES.items() if pattern == ".+"}
    for group, row in ROWS:
        if group.whole:
            assert re.sub(r"\{\w+\}", "", row.template).strip(" .:") or not set(_values(row)) & anything, row.template


def _values(row: Sentence) -> list[str]:
    return re.findall(r"\{(\w+)\}", row.template)


def test_every_value_is_a_group_or_has_a_pattern() -> None:
    names = {*GROUPS, *LISTS, *VALUES, *WORDS}
    assert [f"{row.template}: {name}" for _group, row in ROWS for name in _values(row) if name not in names] == []
    assert Counter([*GROUPS, *LISTS, *VALUES, *WORDS]).most_common(1)[0][1] == 1


def test_every_group_of_parts_stands_in_a_row() -> None:
    lists = {name: group for name, (group, _between) in LISTS.items()}
    used = {lists.get(name, name) for _group, row in ROWS for name in _values(row)}
    assert {group.name for group in VEHICLE if not group.whole} - used == set()


@pytest.mark.parametrize("group", [*VEHICLE, *GUARD], ids=lambda group: group.name)
def test_a_row_has_meaning_and_action(group: Group) -> None:
    for row in group.rows:
        for text in (row.meaning, row.action):
            assert re.fullmatch(r"['A-Z\[].*\.", text, re.DOTALL), text
        if row.level >= Level.WARNING and group.whole:
            assert row.action != NOTHING or row.level is Level.WARNING, row.template


def test_no_row_stands_twice_in_its_group() -> None:
    for group in (*VEHICLE, *GUARD):
        assert [text for text, count in Counter(row.template for row in group.rows).items() if count > 1] == []


def test_the_page_has_every_row() -> None:
    page = messages()
    for group in (*VEHICLE, *GUARD):
        section = page.partition(f"\n### {group.title}\n")[2].partition("\n##")[0]
        assert section.count("\n| `") == len(group.rows), group.title


# ---- the guard ----------------------------------------------------------------------------------------------------


def lua_literals() -> list[str]:
    """The literals of the guard's script that have at least two words, with a gap for each value."""
    source = (ROOT / "ardupilot_lua" / "handover_guard.lua").read_text(encoding="utf-8")
    code = re.sub(r"--\[\[.*?--\]\]", "", source, flags=re.DOTALL)
    found = [text for text in re.findall(r'"((?:[^"\\\n]|\\.)*)"|--[^\n]*', code) if text]
    return [re.sub(r"%[-.\d]*[a-z]", "\0", text) for text in found if re.search(r"[a-z] | [a-z]", text)]


def test_every_literal_of_the_guard_is_a_part_of_a_row() -> None:
    rows = [normal(row.template) for group in GUARD for row in group.rows]
    known = " | ".join([*rows, *(pattern for pattern in guard.WORDS.values())]).lower()
    literals = lua_literals()
    assert len(literals) > 40
    missing = [text for text in literals if not all(part.lower() in known for part in pieces(text))]
    assert sorted(missing) == sorted(NO_TEXTS)


#: literals of the guard by which it limits how often a text is sent
NO_TEXTS = ("guard nonce", "gcs id", "gcs id")


@pytest.mark.parametrize("text", ["HNDO: ", "HNDO: something", "RTL", "no lease"])
def test_no_row_of_the_guard_matches_any_text(text: str) -> None:
    assert OF_GUARD.find(text) is None
