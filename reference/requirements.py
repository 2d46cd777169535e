# SPDX-License-Identifier: GPL-3.0-or-later

"""`requirements.md`, from the table `tests/structure/requirements.toml`, and which tests a file has."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Final

from mavproxy_handover.config.toml import list_of_tables, read_toml
from mavproxy_handover.tools.key_table import KeyTable, items, text, word
from reference import ROOT
from reference.markdown import cell, code, page, table

__all__ = ["DATA", "PARTS", "Requirement", "read", "requirements", "names_in"]

DATA = ROOT / "tests" / "structure" / "requirements.toml"
#: part of the table -> its heading, what it is about, what its column of sources is called
PARTS: Final = {
    "thesis": (
        "The thesis",
        "What the project keeps, or mends, of the MSc thesis that it grew out of, by its sections. "
        "[The thesis, chapter by chapter](../thesis.md) says what was kept, changed, lifted or left out, and why.",
        "section",
    ),
    "standard": (
        "The operator-control standard of MAVLink",
        "In its layout of 2026; [qgroundcontrol.md](../qgroundcontrol.md) tells of it in use.",
        "what",
    ),
    "design": (
        "The promises of the design",
        "[architecture.md](../architecture.md) and [safety.md](../safety.md) tell how they are kept.",
        "part",
    ),
}
_REQUIREMENT: Final = KeyTable(
    "requirement",
    (
        text("id", "its name", required=True),
        word("part", tuple(PARTS), "the part of the table", required=True),
        text("source", "where it is asked for", ""),
        text("text", "what is asked for", required=True),
        items("tests", "pytest ids of the tests that hold it", []),
        text("none", "why it has no test", ""),
    ),
    many=True,
)


@dataclass(frozen=True, slots=True)
class Requirement:
    """One row. `tests`: pytest ids; where there are none, `none` says why."""

    id: str
    part: str
    source: str
    text: str
    tests: tuple[str, ...]
    none: str


def read() -> tuple[Requirement, ...]:
    """The table. Raises ConfigError."""
    found = []
    for entry in list_of_tables(read_toml(DATA), _REQUIREMENT, DATA):
        tests = tuple(entry["tests"])
        found.append(Requirement(entry["id"], entry["part"], entry["source"], entry["text"], tests, entry["none"]))
    return tuple(found)


@cache
def names_in(path: Path) -> frozenset[str]:
    """The tests of a file, as pytest names them behind its path; read from the source, not imported."""
    return frozenset(_tests(ast.parse(path.read_text(encoding="utf-8")).body, ()))


def _tests(body: list[ast.stmt], inside: tuple[str, ...]) -> Iterator[str]:
    for node in body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            yield "::".join((*inside, node.name))
        elif isinstance(node, ast.ClassDef) and node.name.startswith("Test"):
            yield from _tests(node.body, (*inside, node.name))


def requirements() -> str:
    """The page."""
    parts = [
        "What is asked of the system, and the tests that hold it. `pytest` takes each of these names; those under "
        "`tests/sitl` that need ArduCopter say so when they are skipped. A row without a test says why.",
    ]
    for part, rows in groupby(sorted(read(), key=_place), key=lambda each: each.part):
        title, about, source = PARTS[part]
        parts += [f"## {title}", about]
        shown = [(each.id, cell(each.source), cell(each.text), _held(each)) for each in rows]
        parts.append(table(("id", source, "requirement", "held by"), shown))
    return page("Requirements and their tests", *parts)


def _place(requirement: Requirement) -> tuple[int, tuple[int, ...]]:
    """Where a row stands: those of the thesis by its sections, the others as the file has them."""
    first = re.match(r"[\d.]+", requirement.source) if requirement.part == "thesis" else None
    sections = tuple(int(number) for number in first[0].split(".")) if first else ()
    return list(PARTS).index(requirement.part), sections


def _held(requirement: Requirement) -> str:
    if not requirement.tests:
        return f"none: {cell(requirement.none)}"
    return "<br>".join(code(name) for name in requirement.tests)
