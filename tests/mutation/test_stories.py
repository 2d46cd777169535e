# SPDX-License-Identifier: GPL-3.0-or-later

"""A fault that shows is found and told in the fewest steps; without one nothing differs."""

from __future__ import annotations

from pathlib import Path

from tests.mutation.run import in_child
from tests.mutation.stories import Difference, Story, find, story

CONDITIONS = Path(__file__).parents[2] / "mavproxy_handover" / "core" / "safety" / "conditions.py"


def found(source: str, stories: int) -> Difference | None:
    """In a process of its own: two cores stand there beside each other."""
    (difference,) = in_child(lambda: [find("safety.conditions", source, stories)])
    return difference


def test_a_fault_is_told_in_the_steps_that_it_takes() -> None:
    source = CONDITIONS.read_text(encoding="utf-8")
    watches = "_NO_WATCH = (GuardState.SILENT, GuardState.DISABLED)"
    assert watches in source
    difference = found(source.replace(watches, "_NO_WATCH = (GuardState.SILENT,)"), 60)
    assert difference is not None
    steps = difference.story.steps
    assert [step for step, _choice in steps] == ["guard", "run"]
    assert steps[0] == ("guard", "DISABLED")
    assert "guard switched off" in difference.without
    assert "guard switched off" not in difference.with_it


def test_without_one_nothing_differs() -> None:
    assert found(CONDITIONS.read_text(encoding="utf-8"), 4) is None


def test_what_cannot_even_be_imported_shows() -> None:
    difference = found("import nothing_of_that_name", 1)
    assert difference is not None
    assert difference.story == Story(())
    assert "nothing_of_that_name" in difference.with_it


def test_a_seed_is_a_story() -> None:
    assert story(7) == story(7)
    assert story(7) != story(8)
