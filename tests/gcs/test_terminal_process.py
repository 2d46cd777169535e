# SPDX-License-Identifier: GPL-3.0-or-later

"""A program on a terminal of its own that waits for input as MAVProxy does, with the station's status line.

The terminal is emulated (pyte), the line editor is the real readline.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pyte
import pytest

pty = pytest.importorskip("pty", reason="terminals of POSIX")

pytestmark = pytest.mark.process

WIDTH, HEIGHT = 60, 10
PROGRAM = """
import sys, threading, time
from types import SimpleNamespace
from MAVProxy.modules.lib import rline
from MAVProxy.modules.lib.textconsole import SimpleConsole
from gcs_module.alarms import Level
from gcs_module.banner import Situation
from gcs_module.terminal.lines import ConsoleLines
from gcs_module.terminal.terminal import Terminal
from mavproxy_handover.core.common.model import Phase
mpstate = SimpleNamespace(
    settings=SimpleNamespace(completion=None), completions={}, command_map={"handover": None}, aliases={}
)
mpstate.rl = rline.rline("MAV> ", mpstate)
console = SimpleConsole()
own = True
def situation():
    return Situation("drone-1", Phase.ON_MISSION, "GCSA" if own else "GCSB", own=own, mode="AUTO", heard_s=0.1)
terminal = Terminal(mpstate, situation, lambda where, text: print(where, text))
terminal.install()
lines = ConsoleLines(lambda: console, time.monotonic, painted=terminal.painted)
lines.tick()
def run():
    global own
    while True:
        time.sleep(0.1)
        words = commands.pop(0).split() if commands else []
        if words[:1] == ["say"]:
            console.writeln(" ".join(words[1:]), "white", "red")
        if words[:1] == ["later"]:
            threading.Timer(1.0, lambda: [print("later", n) for n in range(20)]).start()
        if words[:1] == ["mode"]:
            mpstate.rl.set_prompt(words[1] + "> ")
        if words[:1] == ["lose"]:
            own = False
        if words[:1] == ["hang"]:
            global updates
            updates = False
        if updates:
            terminal.update(" GCSA | CONTROL: GCSA (you) ", Level.EMERGENCY)
updates, commands = True, []
threading.Thread(target=run, daemon=True).start()
while True:
    line = mpstate.rl.input()
    print("got:", line)
    commands.append(line)
    if line == "end":
        break
terminal.restore()
print("after")
"""


class Terminal:
    """The program on an emulated terminal."""

    def __init__(self, folder: Path, **environment: str) -> None:
        self.screen = pyte.Screen(WIDTH, HEIGHT)
        self._stream = pyte.ByteStream(self.screen)
        self.raw = b""
        self._master, slave = pty.openpty()
        program = folder / "program.py"
        program.write_text(PROGRAM)
        self.process = subprocess.Popen(
            ["setsid", "--ctty", "sh", "-c", f"stty rows {HEIGHT} cols {WIDTH}; exec {sys.executable} {program}"],
            env={**os.environ, "TERM": "xterm", "PYTHONPATH": os.getcwd(), **environment},
            cwd=folder,
            stdin=slave,
            stdout=slave,
            stderr=slave,
        )
        os.close(slave)

    def read(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if select.select([self._master], [], [], 0.05)[0]:
                try:
                    data = os.read(self._master, 65536)
                except OSError:  # the program has ended
                    return
                self.raw += data
                self._stream.feed(data)

    def types(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def shows(self, *rows: str, within_s: float = 20.0) -> None:
        """Wait until these rows are there, in this order."""
        end = time.monotonic() + within_s
        while not self._has(rows):
            assert time.monotonic() < end, "\n".join(self.rows)
            self.read(0.1)

    def _has(self, rows: tuple[str, ...]) -> bool:
        left = iter(self.rows)
        return all(row in left for row in rows)

    @property
    def rows(self) -> list[str]:
        return [row.rstrip() for row in self.screen.display]

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self._master)


@pytest.fixture
def opened() -> Iterator[list[Terminal]]:
    found: list[Terminal] = []
    yield found
    for terminal in found:
        terminal.close()


@pytest.fixture
def terminal(opened: list[Terminal], tmp_path: Path) -> Terminal:
    opened.append(Terminal(tmp_path))
    opened[0].shows("YOU MAV>", " GCSA | CONTROL: GCSA (you)")
    return opened[0]


STATUS = " GCSA | CONTROL: GCSA (you)"


def test_a_half_typed_line_survives_twenty_lines_and_goes_on(terminal: Terminal) -> None:
    terminal.types("later\r")
    terminal.shows("got: later")
    terminal.types("handover gie GCSB")
    terminal.types("\x1b[D" * 6 + "v")  # back to the "e", and the missing letter
    terminal.shows("later 18", "later 19", "YOU MAV>        handover give GCSB", STATUS)
    terminal.types("\r")
    terminal.shows("got: handover give GCSB")
    assert terminal.rows[-1] == STATUS


def test_history_and_completion_work_under_the_status_line(terminal: Terminal) -> None:
    terminal.types("say one\r")
    terminal.shows("one")
    terminal.types("say two\r")
    terminal.shows("two")
    terminal.types("\x1b[A\x1b[A")
    terminal.shows("YOU MAV>        say one")
    terminal.types("\x15hand\t")
    terminal.shows("YOU MAV>        handover", STATUS)


def test_the_prompt_follows_mode_and_commander_while_nothing_is_typed(terminal: Terminal) -> None:
    terminal.types("mode AUTO\r")
    terminal.shows("YOU AUTO>")
    terminal.types("lose\r")
    terminal.shows("GCSB AUTO>")
    terminal.types("ha")
    terminal.shows("GCSB AUTO>      ha")


def test_colours_of_lines_and_status_line(terminal: Terminal) -> None:
    terminal.types("say danger\r")
    terminal.shows("danger")
    row = terminal.rows.index("danger")
    assert (terminal.screen.buffer[row][0].bg, terminal.screen.buffer[row][0].bold) == ("red", True)
    assert terminal.screen.buffer[HEIGHT - 1][3].bg == "red"


def test_a_program_that_stands_still_says_so(terminal: Terminal) -> None:
    terminal.types("hang\r")
    end = time.monotonic() + 20.0
    while " OLD: 5 s. THIS STATION'S PROGRAM STANDS STILL." not in terminal.rows[-1]:
        assert time.monotonic() < end, terminal.rows
        terminal.read(0.1)


def test_a_terminal_that_stands_still_does_not_stop_the_program(terminal: Terminal) -> None:
    terminal.types("later\r")
    time.sleep(8.0)  # nobody reads, as after Ctrl-S
    terminal.shows("later 19", STATUS)


def test_at_the_end_the_terminal_is_as_before(terminal: Terminal) -> None:
    terminal.types("end\r")
    terminal.process.wait(20.0)
    terminal.read(0.5)
    assert "after" in terminal.rows
    assert STATUS not in terminal.rows
    assert terminal.screen.margins in (None, pyte.screens.Margins(0, HEIGHT - 1))


def test_no_color_leaves_the_status_line_inverted(opened: list[Terminal], tmp_path: Path) -> None:
    opened.append(Terminal(tmp_path, NO_COLOR="1"))
    opened[0].shows(STATUS)
    opened[0].types("say danger\r")
    opened[0].shows("danger")
    assert opened[0].screen.buffer[HEIGHT - 1][3].reverse
    assert b"\x1b[1;97;41m" not in opened[0].raw


def test_a_dumb_terminal_gets_no_control_sequence(opened: list[Terminal], tmp_path: Path) -> None:
    opened.append(Terminal(tmp_path, TERM="dumb"))
    opened[0].shows("YOU MAV>")
    opened[0].types("say danger\r")
    opened[0].shows("got: say danger", "YOU MAV> danger")
    assert b"\x1b7" not in opened[0].raw
    assert b"\x1b[1;97;41m" not in opened[0].raw
