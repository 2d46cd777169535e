# SPDX-License-Identifier: GPL-3.0-or-later

"""`module unload handover`: in flight it has to be typed twice."""

from __future__ import annotations

from typing import Any

import pytest

from mavproxy_handover.companion.unloading import AGAIN_S, UnloadQuestion
from tests.module.conftest import Bench


class Prompt:
    """MAVProxy's table of commands, with its own `module` in it."""

    def __init__(self, *, flies: bool = True) -> None:
        self.ran: list[list[str]] = []
        self.shown: list[str] = []
        self.now, self.flies = 100.0, flies
        self.map: dict[str, Any] = {"module": (self.ran.append, "help of module")}
        self.own = self.map["module"]
        self.question = UnloadQuestion(
            self.map, "handover", flies=lambda: self.flies, show=self.shown.append, clock=lambda: self.now
        )
        self.question.install()

    def type(self, line: str) -> None:
        self.map["module"][0](line.split())


@pytest.mark.parametrize(
    "line", ["unload handover", "reload handover", 'reload handover:{"config":"x"}', "unload ./handover"]
)
def test_in_flight_it_is_done_the_second_time(line: str) -> None:
    prompt = Prompt()
    prompt.type(line)
    assert prompt.ran == []
    assert len(prompt.shown) == 1
    assert "in flight" in prompt.shown[0]
    prompt.now += AGAIN_S - 0.1
    prompt.type(line)
    assert prompt.ran == [line.split()]


def test_much_later_it_is_asked_again() -> None:
    prompt = Prompt()
    prompt.type("unload handover")
    prompt.now += AGAIN_S
    prompt.type("unload handover")
    assert prompt.ran == []
    assert len(prompt.shown) == 2


def test_on_the_ground_nobody_is_asked() -> None:
    prompt = Prompt(flies=False)
    prompt.type("unload handover")
    assert prompt.ran == [["unload", "handover"]]
    assert prompt.shown == []


@pytest.mark.parametrize(
    "line", ["", "list", "load handover", "unload", "unload map", "unload handover_gcs", "reload misc"]
)
def test_everything_else_passes(line: str) -> None:
    prompt = Prompt()
    prompt.type(line)
    assert prompt.ran == [line.split()]
    assert prompt.shown == []


def test_the_command_is_given_back() -> None:
    prompt = Prompt()
    assert prompt.map["module"][1] == "help of module"
    prompt.question.give_back()
    assert prompt.map["module"] is prompt.own
    prompt.question.give_back()
    assert prompt.map["module"] is prompt.own


def test_who_has_taken_its_place_since_stays() -> None:
    prompt = Prompt()
    other = (prompt.ran.append, "another's")
    prompt.map["module"] = other
    prompt.question.give_back()
    assert prompt.map["module"] is other


def test_without_such_a_command_there_is_nothing_to_take() -> None:
    table: dict[str, Any] = {}
    question = UnloadQuestion(table, "handover", flies=lambda: True, show=print, clock=lambda: 0.0)
    question.install()
    question.give_back()
    assert table == {}


def test_in_the_module_it_goes_by_the_autopilot(bench: Bench) -> None:
    ran: list[list[str]] = []
    own = bench.mpstate.command_map["module"] = (ran.append, "modules")
    bench.connect()
    bench.mpstate.type("module unload handover")
    assert ran == [["unload", "handover"]], "disarmed"
    bench.autopilot.armed = True
    bench.run(2.0)
    (line,) = bench.mpstate.type("module unload handover")
    assert line.startswith("handover: the aircraft is in flight.")
    bench.mpstate.type("module unload handover")
    assert len(ran) == 2
    bench.mpstate.unload("handover")
    assert bench.mpstate.command_map["module"] is own
