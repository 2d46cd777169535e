# SPDX-License-Identifier: GPL-3.0-or-later

"""How a station ends: a program that waits for input as MAVProxy does, and real stations."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

TIMEOUT_S = 60.0
ASKS = (
    "You command drone-1 in flight. 'handover give STATION' hands it over. Press Ctrl-C again within 3 s to end this "
    "station."
)
CTRL_C = b"\x03"
#: as much of MAVProxy as there is to interrupt
PROGRAM = """
import signal, sys, threading, time
from types import SimpleNamespace
from gcs_module.interrupts import Interrupts
mpstate = SimpleNamespace(
    status=SimpleNamespace(exit=False), settings=SimpleNamespace(requireexit={requireexit})
)
def quit_handler(number, frame):
    if mpstate.status.exit:
        sys.exit(0)
    mpstate.status.exit = True
signal.signal(signal.SIGTERM, quit_handler)
class Closing:
    @property
    def flown(self):
        {flying}
    def wait(self):
        print("offered", flush=True)
        end = time.monotonic() + {offers_s}
        while time.monotonic() < end:
            time.sleep(0.05)  # as the real one: a signal just before a long sleep would be noticed after it
        print("waited", flush=True)
    def ask(self, then):
        print("offered", flush=True)
        threading.Timer(0.3, then).start()
mpstate.rl = SimpleNamespace(input=lambda: input("MAV> "))
interrupts = Interrupts(mpstate, Closing(), time.monotonic)
interrupts.install()
def input_loop():
    while not mpstate.status.exit:
        try:
            line = mpstate.rl.input()
            print("line:", line, flush=True)
            if line == "exit":
                threading.Timer(0.1, interrupts.on_exit).start()
        except (EOFError, OSError):
            mpstate.status.exit = True
print("ready", flush=True)
while not mpstate.status.exit:
    try:
        input_loop()
    except KeyboardInterrupt:
        print("interrupt caught")
interrupts.restore()
print("in order")
"""
IN_FLIGHT, ON_THE_GROUND, BROKEN = "return 'drone-1'", "return ''", "raise RuntimeError"


class Terminal:
    """A program on a terminal of its own."""

    def __init__(self, command: list[str], folder: Path) -> None:
        self._screen, slave = pty.openpty()
        self.process = subprocess.Popen(
            ["setsid", "--ctty", *command], cwd=folder, stdin=slave, stdout=slave, stderr=slave
        )
        os.close(slave)
        self.text = ""

    def shows(self, words: str, count: int = 1) -> None:
        """Wait until it does."""
        end = time.monotonic() + TIMEOUT_S
        while self.text.count(words) < count:
            assert time.monotonic() < end, self.text
            self._read(0.1)

    def types(self, keys: bytes) -> None:
        os.write(self._screen, keys)

    def ends(self) -> int:
        """Wait for its end; returns its exit code."""
        end = time.monotonic() + TIMEOUT_S
        while self.process.poll() is None:
            assert time.monotonic() < end, self.text
            self._read(0.1)
        while self._read(0.1):
            pass
        return self.process.returncode

    def _read(self, seconds: float) -> bool:
        if not select.select([self._screen], [], [], seconds)[0]:
            return False
        try:
            data = os.read(self._screen, 65536)
        except OSError:  # nobody has it open any more
            return False
        self.text += data.decode("utf-8", "replace").replace("\r\n", "\n")
        return bool(data)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self._screen)


@pytest.fixture
def terminals() -> Iterator[list[Terminal]]:
    running: list[Terminal] = []
    yield running
    for terminal in running:
        terminal.close()


def started(terminals: list[Terminal], folder: Path, flying: str, requireexit: bool = False) -> Terminal:
    program = PROGRAM.format(flying=flying, requireexit=requireexit, offers_s=0.5)
    terminals.append(Terminal([sys.executable, "-c", program], folder))
    terminals[-1].shows("MAV> ")
    time.sleep(0.3)  # it has written its prompt, and is about to wait for a line
    return terminals[-1]


def test_the_first_one_in_flight_asks_and_the_second_ends_it(terminals: list[Terminal], tmp_path: Path) -> None:
    terminal = started(terminals, tmp_path, IN_FLIGHT)
    terminal.types(CTRL_C)
    terminal.shows(ASKS)
    terminal.types(b"hello\n")
    terminal.shows("line: hello")
    terminal.shows("MAV> ", 2)
    time.sleep(0.3)
    terminal.types(CTRL_C)
    assert terminal.ends() == 0
    assert "in order" in terminal.text
    assert terminal.text.count(ASKS) == 1


def test_one_that_comes_later_asks_again(terminals: list[Terminal], tmp_path: Path) -> None:
    terminal = started(terminals, tmp_path, IN_FLIGHT)
    terminal.types(CTRL_C)
    terminal.shows(ASKS)
    time.sleep(3.2)
    terminal.types(CTRL_C)
    terminal.shows(ASKS, 2)
    assert terminal.process.poll() is None


@pytest.mark.parametrize("flying", [ON_THE_GROUND, BROKEN], ids=["on the ground", "fault"])
def test_otherwise_it_ends_at_once_and_in_order(flying: str, terminals: list[Terminal], tmp_path: Path) -> None:
    terminal = started(terminals, tmp_path, flying)
    terminal.types(CTRL_C)
    assert terminal.ends() == 0
    assert "in order" in terminal.text


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_after_the_aircraft_was_offered(
    number: signal.Signals, terminals: list[Terminal], tmp_path: Path
) -> None:
    terminal = started(terminals, tmp_path, IN_FLIGHT)
    terminal.process.send_signal(number)
    assert terminal.ends() == 0
    assert terminal.text.index("offered") < terminal.text.index("in order")
    assert "You command" not in terminal.text


def test_a_second_signal_ends_it_at_once(terminals: list[Terminal], tmp_path: Path) -> None:
    program = PROGRAM.format(flying=IN_FLIGHT, requireexit=False, offers_s=30.0)
    terminals.append(Terminal([sys.executable, "-c", program], tmp_path))
    terminals[0].shows("MAV> ")
    time.sleep(0.3)
    terminals[0].process.send_signal(signal.SIGTERM)
    terminals[0].shows("offered")
    terminals[0].process.send_signal(signal.SIGTERM)
    assert terminals[0].ends() == 0
    assert "in order" in terminals[0].text
    assert "waited" not in terminals[0].text


@pytest.mark.parametrize(
    ("keys", "question"), [(b"\x04", "Press Ctrl-D again within 3 s"), (b"exit\n", "Type 'exit' again within 15 s")]
)
def test_the_end_of_input_and_exit_ask_first_too(
    keys: bytes, question: str, terminals: list[Terminal], tmp_path: Path
) -> None:
    terminal = started(terminals, tmp_path, IN_FLIGHT)
    terminal.types(keys)
    terminal.shows(question)
    assert terminal.process.poll() is None
    terminal.types(keys)
    assert terminal.ends() == 0
    assert terminal.text.index("offered") < terminal.text.index("in order")


@pytest.mark.parametrize("keys", [b"\x04", b"exit\n"])
def test_on_the_ground_they_end_it(keys: bytes, terminals: list[Terminal], tmp_path: Path) -> None:
    terminal = started(terminals, tmp_path, ON_THE_GROUND)
    terminal.types(keys)
    assert terminal.ends() == 0
    assert "in order" in terminal.text


@pytest.mark.parametrize("how", ["end of input", "exit", "interrupt", "terminate", "hang up"])
def test_in_a_pipe_it_asks_nothing_and_offers_the_aircraft(how: str) -> None:
    program = PROGRAM.format(flying=IN_FLIGHT, requireexit=False, offers_s=0.5)
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    time.sleep(0.3)
    numbers = {"interrupt": signal.SIGINT, "terminate": signal.SIGTERM, "hang up": signal.SIGHUP}
    if how in numbers:
        process.send_signal(numbers[how])
    elif how == "exit":
        process.stdin.write(b"exit\n")
        process.stdin.flush()
    else:
        process.stdin.close()
    said = process.stdout.read().decode()
    process.wait(TIMEOUT_S)
    if not process.stdin.closed:
        process.stdin.close()
    process.stdout.close()
    assert said.index("offered") < said.index("in order")
    assert "You command" not in said


def test_where_mavproxy_wants_the_word_exit_it_still_does(terminals: list[Terminal], tmp_path: Path) -> None:
    terminal = started(terminals, tmp_path, ON_THE_GROUND, requireexit=True)
    terminal.types(CTRL_C)
    terminal.shows("interrupt caught")
    assert terminal.process.poll() is None


STATION = """
[station]
name = "GCSA"
sysid = 251
vehicle = 1
"""


@pytest.fixture
def station(terminals: list[Terminal], tmp_path: Path) -> Terminal:
    config = tmp_path / "station.toml"
    config.write_text(STATION)
    words = ["station", f"--config={config}", "--master=udpin:127.0.0.1:0"]
    terminals.append(Terminal([sys.executable, "-m", "mavproxy_handover.cli", *words], tmp_path))
    terminals[-1].shows("MAV> ")
    time.sleep(0.3)
    return terminals[-1]


@pytest.mark.parametrize("how", ["ctrl-c", "sigterm"])
def test_a_real_station_unloads_its_modules_and_ends(station: Terminal, how: str) -> None:
    if how == "ctrl-c":
        station.types(CTRL_C)
    else:
        station.process.send_signal(signal.SIGTERM)
    station.ends()
    assert "Unloading module handover_gcs" in station.text
    assert "Traceback" not in station.text
