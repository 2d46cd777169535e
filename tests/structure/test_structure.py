# SPDX-License-Identifier: GPL-3.0-or-later

"""The house is as `docs/architecture.md` says: imports run downwards, none in a circle, and the picture is true."""

from __future__ import annotations

import re
from collections.abc import Callable
from graphlib import CycleError, TopologicalSorter

import pytest

from tests.structure.imports import (
    DOCUMENT,
    PACKAGES,
    ROOT,
    edges,
    files,
    floors,
    imported,
    part_of,
    simulation_part_of,
)
from tests.structure.picture import PICTURE, arrows, svg

#: named without its folder, where the text before it says which
WHERE = ("", "mavproxy_handover", "mavproxy_handover/gate")


@pytest.mark.parametrize(("table", "belongs_to"), [("floors", part_of), ("simulation", simulation_part_of)])
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


@pytest.mark.parametrize(("table", "belongs_to"), [("floors", part_of), ("simulation", simulation_part_of)])
def test_every_file_has_its_place_and_every_place_its_files(
    table: str, belongs_to: Callable[[str], str | None]
) -> None:
    """But for the face of the package itself."""
    found = {belongs_to(module) for module in files()} - {None, "mavproxy_handover/"}
    assert found == {part.name for part in floors(table)}


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
