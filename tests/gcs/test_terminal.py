# SPDX-License-Identifier: GPL-3.0-or-later

"""The station's terminal: words of status line and prompt, and the control sequences on an emulated terminal."""

from __future__ import annotations

from math import inf
from typing import Any

import pyte
import pytest

from gcs_module.alarms import Level
from gcs_module.banner import Situation
from gcs_module.terminal.look import Craft, line_colour, prompt, status, status_colour
from gcs_module.terminal.screen import Screen, without_commands
from gcs_module.terminal.terminal import Kind, kind_of
from mavproxy_handover.core.common.model import FlightAction, Phase

FLIES = Situation("drone-1", Phase.ON_MISSION, "GCSA", own=True, mode="AUTO", heard_s=0.5)
OTHER = Situation(
    "drone-2", Phase.ON_MISSION, "GCSB", mode="RTL", heard_s=0.5, action=FlightAction.RETURN, of="drone-2"
)
LOST = Situation("drone-1", Phase.ON_MISSION, "GCSA", own=True, heard_s=7.0)
WIDTH, HEIGHT = 40, 8


class TestWords:
    @pytest.mark.parametrize(
        ("now", "words"),
        [
            (FLIES, "YOU AUTO> "),
            (OTHER, "GCSB AUTO> "),
            (Situation("drone-1", Phase.ON_MISSION, "", mode="RTL", heard_s=0.5), "NONE AUTO> "),
            (LOST, "AUTO> "),
            (Situation("drone-1", heard_s=inf), "AUTO> "),
            (None, "AUTO> "),
        ],
    )
    def test_the_prompt_says_who_commands(self, now: Situation | None, words: str) -> None:
        assert prompt("AUTO> ", now) == words
        assert prompt("AUTO> ", now, fixed=True) == words.ljust(16)

    @pytest.mark.parametrize("other", ["", "nsh> x", "Password: "])
    def test_a_prompt_of_another_kind_stays(self, other: str) -> None:
        assert prompt(other, FLIES, fixed=True) == other

    def test_a_prompt_on_the_screen_keeps_its_width(self) -> None:
        long = Situation("drone-1", Phase.ON_MISSION, "Lighthouse-North", mode="AUTO", heard_s=0.5)
        assert prompt("AUTO> ", long, fixed=True) == "Lighthouse-North AUTO> "
        assert prompt("AUTO> ", long, 16, fixed=True) == "Lighthouse-Nor> "

    def test_the_status_line_has_station_commander_values_and_time(self) -> None:
        text, level = status("GCSA", [Craft(FLIES, "40 m, 8.0 m/s, battery 95%")], "12:31:54", 80, colour=True)
        assert text == f" GCSA | CONTROL: GCSA (you) | 40 m, 8.0 m/s, battery 95%{' ' * 15} 12:31:54"
        assert (len(text), level) == (80, Level.INFO)

    def test_of_several_the_most_urgent_is_first_and_what_does_not_fit_is_counted(self) -> None:
        crafts = [Craft(FLIES, "40 m"), Craft(OTHER, "")]
        text, level = status("GCSA", crafts, "12:31:54", 100, colour=True)
        assert text.startswith(" GCSA | drone-2: CONTROL: GCSB - RTL | CONTROL: GCSA (you) ")
        assert level is Level.EMERGENCY
        narrow, _level = status("GCSA", crafts, "12:31:54", 60, colour=False)
        assert narrow.startswith(" EMERGENCY GCSA | drone-2: CONTROL: GCSB - RTL | +1")
        assert len(narrow) == 60

    @pytest.mark.parametrize("width", [1, 10, 20, 39])
    def test_a_narrow_terminal_gets_what_fits(self, width: int) -> None:
        assert len(status("GCSA", [Craft(FLIES, "")], "12:31:54", width, colour=True)[0]) <= width

    def test_an_old_vehicle_is_not_shown_as_commanded(self) -> None:
        assert "NOT HEARD FOR 7 s" in status("GCSA", [Craft(LOST, "")], "12:31:54", 80, colour=True)[0]

    def test_colours(self) -> None:
        assert status_colour(Level.EMERGENCY, colour=True) == "\x1b[1;97;41m"
        assert {status_colour(level, colour=False) for level in Level} == {"\x1b[7m"}
        assert line_colour("x", "white", "red") == "\x1b[1;97;41mx\x1b[0m"
        assert line_colour("x", "black", "white") == line_colour("x", "white", (0, 128, 0)) == "x"

    @pytest.mark.parametrize(
        ("platform", "environment", "terminals", "kind"),
        [
            ("linux", {"TERM": "xterm"}, (True, True), Kind.FULL),
            ("darwin", {"TERM": "xterm-256color"}, (True, True), Kind.FULL),
            ("linux", {"TERM": "dumb"}, (True, True), Kind.PLAIN),
            ("linux", {}, (True, True), Kind.PLAIN),
            ("linux", {"TERM": "xterm"}, (True, False), Kind.PIPE),
            ("linux", {"TERM": "xterm"}, (False, True), Kind.PIPE),
            ("win32", {}, (True, True), Kind.WINDOWS),
            ("win32", {}, (False, True), Kind.PIPE),
        ],
    )
    def test_the_kind_of_terminal(
        self, platform: str, environment: dict[str, str], terminals: tuple[bool, bool], kind: Kind
    ) -> None:
        assert kind_of(platform, environment, *terminals) is kind


class Emulated:
    """An emulated terminal, in which somebody types."""

    def __init__(self) -> None:
        self.terminal = pyte.Screen(WIDTH, HEIGHT)
        self._stream = pyte.Stream(self.terminal)
        self.screen = Screen()
        self.write(self.screen.begin(WIDTH, HEIGHT))

    def write(self, text: str) -> None:
        self._stream.feed(text)

    @property
    def rows(self) -> list[str]:
        return [row.rstrip() for row in self.terminal.display]

    @property
    def cursor(self) -> tuple[int, int]:
        return self.terminal.cursor.y, self.terminal.cursor.x


@pytest.fixture
def emulated() -> Emulated:
    return Emulated()


class TestScreen:
    def test_lines_come_above_what_is_typed_and_the_cursor_stays_in_it(self, emulated: Emulated) -> None:
        emulated.write("YOU AUTO> handover gi\b\b")
        column = emulated.cursor[1]
        for number in range(20):
            emulated.write(emulated.screen.above(f"line {number}"))
            assert emulated.cursor[1] == column
        assert emulated.rows[: HEIGHT - 1] == [*(f"line {n}" for n in range(14, 20)), "YOU AUTO> handover gi"]
        assert emulated.cursor[0] == HEIGHT - 2

    def test_from_an_empty_screen_on(self, emulated: Emulated) -> None:
        emulated.write(emulated.screen.above("first"))
        emulated.write("MAV> ")
        emulated.write(emulated.screen.above("second"))
        assert emulated.rows[:3] == ["first", "second", "MAV>"]
        assert emulated.cursor == (2, 5)

    def test_the_status_line_stays_in_the_last_row(self, emulated: Emulated) -> None:
        emulated.write("MAV> ")
        emulated.write(emulated.screen.status(" GCSA | CONTROL", "\x1b[7m"))
        for number in range(20):
            emulated.write(emulated.screen.above(f"line {number}"))
            emulated.write("x\r\n")
        assert emulated.rows[-1] == " GCSA | CONTROL"
        assert emulated.terminal.buffer[HEIGHT - 1][3].reverse
        emulated.write(emulated.screen.end())
        assert emulated.rows[-1] == ""

    def test_a_long_line_takes_rows_and_keeps_its_colour(self, emulated: Emulated) -> None:
        emulated.write("MAV> abc")
        emulated.write(emulated.screen.above(f"\x1b[31m{'a' * 45}\x1b[0m"))
        assert emulated.rows[:3] == ["a" * 40, "a" * 5, "MAV> abc"]
        assert emulated.terminal.buffer[1][0].fg == "red"
        assert emulated.terminal.buffer[2][0].fg == "default"

    def test_what_would_move_the_cursor_is_left_out(self, emulated: Emulated) -> None:
        emulated.write("MAV> ")
        emulated.write(emulated.screen.above("a\x1b[2Jb\x1b]0;title\x07\x9b\rc\td"))
        assert emulated.rows[1] == "MAV>"
        assert emulated.rows[0].startswith("a[2Jb]0;title")

    @pytest.mark.parametrize("control", ["\x9b2J", "\x9d0;title\x9c", "\x84", "\x8d"])
    def test_control_characters_of_eight_bits_are_left_out(self, emulated: Emulated, control: str) -> None:
        assert control[0] not in emulated.screen.above(f"a{control}b")
        assert control[0] not in without_commands(f"a{control}b")

    def test_the_prompt_changes_under_what_is_typed(self, emulated: Emulated) -> None:
        emulated.write("YOU AUTO>       handover")
        emulated.write(emulated.screen.prompt("GCSB AUTO>      "))
        assert emulated.rows[0] == "GCSB AUTO>      handover"
        assert emulated.cursor == (0, 24)

    def test_another_size(self, emulated: Emulated) -> None:
        emulated.write("MAV> ")
        emulated.terminal.resize(6, 30)
        emulated.write(emulated.screen.begin(30, 6))
        emulated.write(emulated.screen.status("s", ""))
        for number in range(9):
            emulated.write(emulated.screen.above(str(number)))
        assert emulated.rows == ["5", "6", "7", "8", "MAV>", "s"]

    @pytest.mark.parametrize("rows", [1, 2, 3])
    def test_a_terminal_with_few_rows_has_no_status_line(self, rows: int) -> None:
        screen = Screen()
        assert f"[1;{rows}r" in screen.begin(80, rows)
        assert screen.status("s", "") == ""


def test_the_emulated_terminal_is_one(emulated: Emulated) -> None:
    """The tests above would say nothing on a terminal that ignores scrolling regions."""
    emulated.write("\r\n" * 30)
    assert emulated.cursor[0] == HEIGHT - 2
    kinds: Any = type(emulated.terminal).__mro__
    assert pyte.Screen in kinds
