# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's line for a refused command is left out if the vehicle says why; else it is shown, a second later."""

from __future__ import annotations

import pytest

from gcs_module.answer_lines import AnswerLines

REFUSED = "Got COMMAND_ACK: DO_SET_MODE: NOT_IN_CONTROL"


class Console:
    """MAVProxy's console."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []

    def writeln(self, text: str, fg: str = "black", bg: str = "white") -> None:
        self.lines.append((text, fg))


class Bench:
    """The filter with a console and a clock."""

    def __init__(self) -> None:
        self.console = Console()
        self.now = 100.0
        self.filter = AnswerLines(lambda: self.console, lambda: self.now)
        self.filter.tick()

    def shown(self) -> list[str]:
        return [text for text, _colour in self.console.lines]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_the_line_of_a_refusal_is_left_out_when_the_vehicle_says_why(bench: Bench) -> None:
    bench.console.writeln(REFUSED)
    assert bench.shown() == []
    bench.filter.said("mode RTL refused: GCSA commands ('handover request')")
    bench.now += 2.0
    bench.filter.tick()
    assert bench.shown() == []


def test_a_refusal_without_a_text_is_shown_after_a_second(bench: Bench) -> None:
    bench.console.writeln(REFUSED)
    bench.now += 0.9
    bench.filter.tick()
    assert bench.shown() == []
    bench.now += 0.2
    bench.filter.tick()
    assert bench.shown() == [REFUSED]


def test_one_text_is_for_one_refusal(bench: Bench) -> None:
    other = "Got COMMAND_ACK: NAV_TAKEOFF: DENIED"
    bench.console.writeln(REFUSED)
    bench.console.writeln(other)
    bench.filter.said("mode RTL refused: GCSA commands")
    bench.now += 2.0
    bench.filter.tick()
    assert bench.shown() == [other]


@pytest.mark.parametrize(
    "line",
    [
        "Got COMMAND_ACK: DO_SET_MODE: ACCEPTED",
        "Got COMMAND_ACK: MISSION_START: IN_PROGRESS",
        "Mode RTL",
        "AP: mode RTL refused: GCSA commands",
    ],
)
def test_every_other_line_is_shown_at_once(bench: Bench, line: str) -> None:
    bench.console.writeln(line, fg="red")
    assert bench.console.lines == [(line, "red")]


def test_a_text_without_a_refusal_leaves_the_line(bench: Bench) -> None:
    bench.console.writeln(REFUSED)
    bench.filter.said("PreArm: Compass not healthy")
    bench.now += 2.0
    bench.filter.tick()
    assert bench.shown() == [REFUSED]


def test_a_console_that_replaces_the_first_one_is_filtered_as_well(bench: Bench) -> None:
    first, bench.console = bench.console, Console()
    bench.filter.tick()
    bench.console.writeln(REFUSED)
    first.writeln("Mode RTL")
    assert bench.shown() == []
    assert first.lines == [("Mode RTL", "black")]


def test_at_the_end_what_waits_is_shown_and_the_console_is_as_before(bench: Bench) -> None:
    bench.console.writeln(REFUSED)
    bench.filter.release()
    assert bench.shown() == [REFUSED]
    bench.console.writeln(REFUSED)
    assert bench.shown() == [REFUSED, REFUSED]
    assert "writeln" not in vars(bench.console)


def test_a_flood_of_refusals_is_not_kept(bench: Bench) -> None:
    for _ in range(50):
        bench.console.writeln(REFUSED)
    assert len(bench.shown()) == 50 - AnswerLines.WAITING
