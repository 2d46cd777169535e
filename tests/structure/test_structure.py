# SPDX-License-Identifier: GPL-3.0-or-later

"""The house is as `docs/architecture.md` says: imports run downwards, none in a circle, and the picture is true."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from graphlib import CycleError, TopologicalSorter

import pytest

from tests.structure.imports import (
    DOCUMENT,
    INNER,
    PACKAGES,
    ROOT,
    edges,
    files,
    floors,
    imported,
    part_of,
    part_within,
)
from tests.structure.picture import PICTURE, arrows, svg

#: named without its folder, where the text before it says which
WHERE = ("", "mavproxy_handover", "mavproxy_handover/gate")
#: every table of floors, and the part of it that a module belongs to
TABLES: list[tuple[str, Callable[[str], str | None]]] = [
    ("floors", part_of),
    *((table, partial(part_within, folder)) for table, folder in INNER.items()),
]


def _graph(belongs_to: Callable[[str], str | None], parts: set[str]) -> Mapping[str, set[str]]:
    """Each of these parts, and those of them that it imports."""
    graph: dict[str, set[str]] = {part: set() for part in parts}
    for module, others in edges().items():
        here = belongs_to(module)
        if here in graph:
            graph[here] |= {there for other in others if (there := belongs_to(other)) in parts and there != here}
    return graph


def _levels(graph: Mapping[str, set[str]]) -> int:
    """The number of levels; raises CycleError if imports run in a circle."""
    level: dict[str, int] = {}
    for part in TopologicalSorter(graph).static_order():
        level[part] = 1 + max((level[below] for below in graph[part]), default=0)
    return max(level.values())


@pytest.mark.parametrize(("table", "belongs_to"), TABLES)
def test_imports_run_downwards_only(table: str, belongs_to: Callable[[str], str | None]) -> None:
    floor = {part.name: part.floor for part in floors(table)}
    upwards = [
        f"{module} (floor {floor[here]}) imports {other} (floor {floor[there]})"
        for module, others in edges().items()
        for other in others
        if (here := belongs_to(module)) in floor
        and (there := belongs_to(other)) in floor
        and here != there
        and floor[here] <= floor[there]
    ]
    assert upwards == []


@pytest.mark.parametrize(("table", "belongs_to"), TABLES)
def test_every_file_has_its_place_and_every_place_its_files(
    table: str, belongs_to: Callable[[str], str | None]
) -> None:
    """But for the face of the package itself."""
    found = {belongs_to(module) for module in files()} - {None, "mavproxy_handover/"}
    assert found == {part.name for part in floors(table)}


@pytest.mark.parametrize(
    ("belongs_to", "parts", "imports", "levels"),
    [
        (part_of, {part.name for part in floors()} - {"gcs_module/", "sitl/"}, 80, 9),
        (TABLES[1][1], {part.name for part in floors("operators")}, 30, 5),
    ],
)
def test_the_parts_are_few_and_stand_on_few_levels(
    belongs_to: Callable[[str], str | None], parts: set[str], imports: int, levels: int
) -> None:
    graph = _graph(belongs_to, parts)
    assert len(parts) <= 16
    assert sum(map(len, graph.values())) <= imports
    assert _levels(graph) <= levels


def test_a_circle_of_parts_is_seen() -> None:
    """Files need not form a circle when their folders do."""
    assert _levels({"a": {"b"}, "b": {"c"}, "c": set()}) == 3
    with pytest.raises(CycleError):
        _levels({"a": {"b"}, "b": {"c"}, "c": {"a"}})


def test_no_files_import_each_other_in_a_circle() -> None:
    try:
        TopologicalSorter(edges()).prepare()
    except CycleError as circle:
        pytest.fail(" -> ".join(circle.args[1]))


def test_what_the_document_names_is_there() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    named = set(re.findall(r"`([a-z_]+/[\w/]*|[\w/]+\.(?:py|lua|xml|toml))`", text))
    assert len(named) > 50
    assert [name for name in sorted(named) if not any((ROOT / where / name).exists() for where in WHERE)] == []


def test_the_picture_is_drawn_from_the_code_as_it_is() -> None:
    assert PICTURE.read_text(encoding="utf-8") == svg(), "make picture draws it anew"


def test_the_walk_sees_what_it_is_to_see() -> None:
    """Else the tests above hold whatever the code does."""
    modules = {"a": 1, "a.b": 1, "a.c": 1}
    source = "import a\nfrom a import b, x\nif TYPE_CHECKING:\n    import json\ndef f():\n    from a.c import d\n"
    assert imported(source, modules) == {"a", "a.b", "a.c"}
    assert len(files()) > 150
    assert ("vehicle/profiles/", "wire/") in arrows()
    assert ("gate/", "core/") not in arrows(), "it follows from two others"
    assert {name.split(".")[0] for name in files()} == set(PACKAGES)
