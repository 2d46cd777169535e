# SPDX-License-Identifier: GPL-3.0-or-later

"""How grave a line is, what stands behind it, and what is said again."""

from __future__ import annotations

import ast
from math import inf
from pathlib import Path

import pytest

import gcs_module
from gcs_module.alarms import DECISIONS, ENDS, EVENTS, LOOKS, STANDS, Alarms, Level
from gcs_module.events import Notice
from mavproxy_handover.core.common.model import FlightAction

FOLDER = Path(gcs_module.__file__).parent
NOW = 100.0
EMERGENCY, WARNING, ADVISORY = Level.EMERGENCY, Level.WARNING, Level.ADVISORY


def events_named() -> set[str]:
    """The first word of every Notice that is made anywhere in the package."""
    found = set()
    for path in FOLDER.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Notice":
                words = [each.value for each in ast.walk(node.args[0]) if isinstance(each, ast.Constant)]
                found |= {word for word in words if isinstance(word, str)}
    return found


def test_every_line_that_is_made_is_in_the_table() -> None:
    named = events_named() - {"requested", "announced"}  # chosen before
    assert named
    assert named <= set(EVENTS)
    assert set(STANDS) <= set(EVENTS)
    assert set(ENDS) <= set(EVENTS)
    assert set(ENDS.values()) <= set(STANDS.values()), "what never stands cannot end"
    assert set(DECISIONS) == set(FlightAction)
    assert set(LOOKS) == set(Level)


def test_the_levels_as_they_are_written_on_the_card() -> None:
    grave = {event for event, level in EVENTS.items() if level is EMERGENCY}
    assert grave == {"no_commander", "decision", "program_lost"}
    waits = {event for event, level in EVENTS.items() if level is WARNING}
    assert waits == {"lost", "requested", "asked", "countdown", "off_route", "stream", "managers"}
    assert [DECISIONS[action] for action in FlightAction] == [
        WARNING,
        WARNING,
        WARNING,
        WARNING,
        EMERGENCY,
        EMERGENCY,
    ]


def test_what_is_graver_looks_and_sounds_no_milder() -> None:
    looks = [LOOKS[level] for level in Level]
    assert [look.bell for look in looks] == [False, False, True, True]
    assert [look.spoken for look in looks] == [False, True, True, True]
    assert [look.again_s for look in looks] == [inf, inf, 30.0, 10.0]
    assert len({(look.colour, look.ground) for look in looks}) == len(looks)


def test_a_line_may_be_graver_than_its_word() -> None:
    assert Notice("decision", "", WARNING).gravity is WARNING
    assert Notice("decision", "").gravity is EMERGENCY


def standing(*events: str) -> Alarms:
    alarms = Alarms()
    for event in events:
        alarms.on_line(event, EVENTS[event], f"{event}!", NOW)
    return alarms


def test_it_is_said_again_while_it_stands() -> None:
    alarms = standing("no_commander", "lost")
    assert alarms.due(NOW + 9.9) == ()
    assert [alarm.text for alarm in alarms.due(NOW + 10.0)] == ["no_commander!"]
    assert alarms.due(NOW + 19.9) == ()
    assert [alarm.text for alarm in alarms.due(NOW + 30.0)] == ["no_commander!", "lost!"], "the gravest first"


@pytest.mark.parametrize(
    ("begins", "ends"), [("no_commander", "control_lost"), ("lost", "connected"), ("asked", "consent")]
)
def test_it_ends_with_its_line(begins: str, ends: str) -> None:
    alarms = standing(begins, ends)
    assert alarms.standing == ()
    assert alarms.due(inf) == ()


def test_what_is_acknowledged_stands_and_is_silent() -> None:
    alarms = standing("no_commander", "lost")
    assert len(alarms.acknowledge()) == 2
    assert alarms.acknowledge() == ()
    assert alarms.due(NOW + 1e6) == ()
    assert [alarm.acknowledged for alarm in alarms.standing] == [True, True]


def test_other_words_of_the_same_gravity_stay_acknowledged_and_graver_ones_are_said() -> None:
    alarms = Alarms()
    alarms.on_line("decision", WARNING, "holds", NOW)
    alarms.acknowledge()
    alarms.on_line("decision", WARNING, "holds, still", NOW)
    assert alarms.due(NOW + 1e6) == ()
    alarms.on_line("decision", EMERGENCY, "returns", NOW)
    assert [alarm.text for alarm in alarms.due(NOW + 10.0)] == ["returns"]
    alarms.acknowledge()
    alarms.on_line("decision", WARNING, "holds", NOW)
    assert alarms.due(NOW + 1e6) == (), "milder than what was acknowledged"


def test_what_nobody_has_acknowledged_is_said_again_whatever_its_words() -> None:
    alarms = standing("decision", "decision")
    assert [alarm.text for alarm in alarms.due(NOW + 10.0)] == ["decision!"]


def test_what_is_only_to_be_known_is_said_once() -> None:
    alarms = Alarms()
    alarms.on_line("decision", ADVISORY, "guard silent", NOW)
    assert [alarm.text for alarm in alarms.standing] == ["guard silent"]
    assert alarms.due(NOW + 1e9) == ()


def test_the_documentation_says_the_same() -> None:
    text = (Path(__file__).parents[2] / "docs/operating.md").read_text(encoding="utf-8")
    for level in Level:
        look = LOOKS[level]
        again = "never" if look.again_s == inf else f"every {look.again_s:.0f} s"
        heard = " | ".join("yes" if each else "no" for each in (look.bell, look.spoken))
        (row,) = [line for line in text.splitlines() if line.startswith(f"| {level.name.lower()} |")]
        assert row.endswith(f"| {heard} | {again} |")
