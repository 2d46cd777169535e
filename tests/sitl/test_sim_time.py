# SPDX-License-Identifier: GPL-3.0-or-later

"""Simulated time of a run: its programs' clocks are the vehicle's, whatever the wall clock says."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from sitl import sim_time
from sitl.run import pacing
from sitl.run.pacing import Pacing
from sitl.run.stopper import UNTENDED_S, Stopper
from sitl.run.stopper import main as stopper_main
from sitl.sim_time import ASLEEP_S, LATE_S, SILENT_S, STARVED_S, Pace, Page, in_sim_time

ROOT = Path(__file__).resolve().parents[2]


class Wall:
    """The wall clock of the page, which a test moves."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    clock = Wall()
    monkeypatch.setattr(sim_time, "_wall", clock)
    return clock


@pytest.fixture
def page(wall: Wall, tmp_path: Path) -> Page:
    return Page(tmp_path / "page", make=True)


@pytest.fixture
def state(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The state of every thread, as the system says; "": there is none."""
    state = ["R"]
    monkeypatch.setattr(sim_time, "_works", lambda _thread: state[0] in ("R", "D"))
    return state


class TestPage:
    def test_it_stands_still_until_the_vehicle_writes(self, page: Page, wall: Wall) -> None:
        wall.now += 4.0
        assert page.read()[:2] == (0.0, 1000.0)

    def test_it_is_what_the_vehicle_wrote_last(self, page: Page, wall: Wall) -> None:
        page.write(12.0, 8.0)
        wall.now += SILENT_S
        assert page.read()[0] == 12.0

    def test_without_the_vehicle_it_goes_on(self, page: Page, wall: Wall) -> None:
        page.write(12.0, 8.0)
        wall.now += SILENT_S + 2.0
        assert page.read()[0] == pytest.approx(12.0 + 16.0)

    def test_a_vehicle_that_gets_no_processor_for_a_while_is_waited_for(self, page: Page, wall: Wall) -> None:
        page.write(12.0, 8.0)
        wall.now += 25.0
        assert page.read()[0] == 12.0

    def test_at_the_end_no_program_waits_for_the_vehicle(self, page: Page, wall: Wall) -> None:
        page.write(12.0, 8.0)
        wall.now += 1.0
        page.let_go()
        assert page.read()[0] == 12.0
        wall.now += 0.5
        assert page.read()[0] == pytest.approx(16.0)

    def test_a_reader_that_gets_no_processor_sees_no_silence(
        self, page: Page, wall: Wall, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        page.write(12.0, 8.0)
        head = sim_time._HEAD

        def slowly(*arguments: Any) -> Any:
            found = head.unpack_from(*arguments)
            wall.now += SILENT_S + 2.0
            return found

        monkeypatch.setattr(sim_time, "_HEAD", SimpleNamespace(unpack_from=slowly))
        assert page.read()[0] == 12.0

    def test_another_process_reads_what_is_written(self, page: Page, wall: Wall) -> None:
        other = Page(page.path)
        page.write(33.0, 4.0)
        assert other.read()[0] == 33.0
        assert other.pace == 4.0

    def test_each_thread_has_a_slot_of_its_own(self, page: Page) -> None:
        assert [page.claim(), Page(page.path).claim()] == [0, 1]
        page.promise(1, 7, 2.5)
        me = threading.get_native_id()
        assert page.promises() == [(me, 0, 0.0), (me, 7, 2.5)]

    def test_there_is_an_end_to_slots(self, page: Page) -> None:
        for _ in range(128):
            page.claim()
        with pytest.raises(RuntimeError, match="more than 128 threads"):
            page.claim()


WRITER = """
import sys
from pathlib import Path
from sitl.sim_time import Page
page = Page(Path(sys.argv[1]))
slot = page.claim()
page.write(33.0, 4.0)
print("writes", flush=True)
while True:
    page.write(33.0, 4.0)
    page.promise(slot, 7, 8.0)
"""


@pytest.mark.process
def test_what_is_written_is_read_whole(tmp_path: Path) -> None:
    page = Page(tmp_path / "page", make=True)
    begun, utc = page.read()[1:]
    page.claim()
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(page.path)], cwd=ROOT, stdout=-1)
    try:
        assert writer.stdout is not None
        writer.stdout.readline()
        wrong = []
        until = time.monotonic() + 2.0
        while time.monotonic() < until:
            read, threads = page.read(), [promise[0] for promise in page.promises()]
            if read != (33.0, begun, utc) or threads != [threading.get_native_id(), writer.pid]:
                wrong.append((read, threads))
        assert wrong == []
    finally:
        writer.kill()
        writer.communicate()


class TestPace:
    def test_the_vehicle_goes_on_while_all_have_done_their_work(self, page: Page) -> None:
        page.promise(page.claim(), 1, 10.0)
        assert Pace(page).may_go_on(10.0 + LATE_S)

    def test_it_waits_for_one_that_is_late(self, page: Page) -> None:
        page.promise(page.claim(), 1, 10.0)
        page.promise(page.claim(), 1, 11.0)
        assert not Pace(page).may_go_on(10.01 + LATE_S)

    def test_as_long_as_that_one_moves(self, page: Page, wall: Wall, state: list[str]) -> None:
        slot, pace = page.claim(), Pace(page)
        state[0] = "S"
        for looks in range(200):
            page.promise(slot, looks, 10.0)
            assert not pace.may_go_on(12.0)
            wall.now += ASLEEP_S - 0.1

    @pytest.mark.parametrize("asleep", ["S", "T", "Z", ""])
    def test_not_for_one_that_is_asleep_stopped_or_dead(
        self, page: Page, wall: Wall, state: list[str], asleep: str
    ) -> None:
        page.promise(page.claim(), 1, 10.0)
        state[0], pace = asleep, Pace(page)
        assert not pace.may_go_on(12.0)
        wall.now += ASLEEP_S
        assert pace.may_go_on(12.0)

    @pytest.mark.parametrize("working", ["R", "D"])
    def test_longer_for_one_that_gets_no_processor(
        self, page: Page, wall: Wall, state: list[str], working: str
    ) -> None:
        page.promise(page.claim(), 1, 10.0)
        state[0], pace = working, Pace(page)
        assert not pace.may_go_on(12.0)
        wall.now += STARVED_S - 0.1
        assert not pace.may_go_on(12.0)
        wall.now += 0.1
        assert pace.may_go_on(12.0)

    def test_and_again_when_it_moves_again(self, page: Page, wall: Wall, state: list[str]) -> None:
        slot, pace = page.claim(), Pace(page)
        state[0] = "S"
        page.promise(slot, 1, 10.0)
        pace.may_go_on(12.0)
        wall.now += ASLEEP_S
        page.promise(slot, 2, 10.5)
        assert not pace.may_go_on(12.0)

    def test_a_program_that_starts_is_late_from_its_first_moment(self, page: Page) -> None:
        page.write(50.0, 8.0)
        page.claim()
        assert Pace(page).may_go_on(50.0 + LATE_S)
        assert not Pace(page).may_go_on(50.01 + LATE_S)


def test_the_state_of_a_thread_is_that_of_the_system() -> None:
    assert sim_time._works(threading.get_native_id())
    asleep = subprocess.Popen([sys.executable, "-c", "print(1, flush=True); input()"], stdin=-1, stdout=-1)
    assert asleep.stdout is not None
    asleep.stdout.readline()
    until = time.monotonic() + 60.0
    while sim_time._works(asleep.pid) and time.monotonic() < until:
        time.sleep(0.01)
    assert not sim_time._works(asleep.pid)
    asleep.kill()
    asleep.communicate()
    assert not sim_time._works(asleep.pid)


PROGRAM = """
import os, select, sys, time
def say(word):
    print(word, flush=True)
say(f"{time.monotonic():.3f} {time.time():.3f}")
first, second = time.monotonic(), time.monotonic()
say(second > first)
time.sleep(5)
say("slept")
select.select([0], [], [], 5)
say("selected")
poll = select.poll()
poll.register(0, select.POLLIN)
say(poll.poll(5000))
say(poll.poll(0))
say(select.select([0], [], [], 0))
say("reads")
say(len(select.select([0], [], [])[0]))
"""


class Program:
    """A program that follows a page; the page moves only when a test says so."""

    def __init__(self, folder: Path) -> None:
        self.page = Page(folder / "page", make=True)
        script = folder / "program.py"
        script.write_text(PROGRAM, encoding="utf-8")
        self.process = subprocess.Popen(
            in_sim_time(self.page.path, [sys.executable, str(script)]),
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.begun, self.utc = self.page.read()[1:]

    def says(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def waits_until(self) -> float:
        """Until when it has promised to wait; waits for the promise."""
        until = time.monotonic() + 60.0
        while time.monotonic() < until:
            promises = self.page.promises()
            if promises and promises[0][2] > self.page.read()[0] + 1.0:
                return promises[0][2]
            time.sleep(0.01)
        raise AssertionError(f"it does not wait: {self.page.promises()}")


@pytest.fixture
def program(tmp_path: Path) -> Iterator[Program]:
    program = Program(tmp_path)
    yield program
    program.process.kill()
    program.process.communicate()


@pytest.mark.process
def test_a_program_waits_in_the_vehicles_time(program: Program) -> None:
    assert program.says() == f"{program.begun:.3f} {program.utc:.3f}"
    assert program.says() == "True"
    assert program.waits_until() == pytest.approx(5.0, abs=0.1)
    program.page.write(5.1, 0.001)
    assert program.says() == "slept"
    assert program.waits_until() == pytest.approx(10.1, abs=0.2)
    program.page.write(10.4, 0.001)
    assert program.says() == "selected"
    program.waits_until()
    program.page.write(15.9, 0.001)
    assert [program.says(), program.says(), program.says()] == ["[]", "[]", "([], [], [])"]
    assert program.says() == "reads"
    assert program.waits_until() == math.inf
    assert program.process.stdin is not None
    program.process.stdin.write("now\n")
    program.process.stdin.flush()
    assert program.says() == "1"


def test_words_before_python_stay_before_it(tmp_path: Path) -> None:
    argv = ["/usr/bin/env", "A=1", sys.executable, "-m", "sitl.run.rogue", "--config", "x"]
    page = tmp_path / "page"
    assert in_sim_time(page, argv) == (
        *("/usr/bin/env", "A=1", sys.executable, "-m", "sitl.sim_time", str(page)),
        *("-m", "sitl.run.rogue", "--config", "x"),
    )


def test_the_program_of_another_python_goes_by_the_wall_clock(tmp_path: Path) -> None:
    assert in_sim_time(tmp_path, ["/opt/other/python", "gcs.py"]) == ("/opt/other/python", "gcs.py")


def state_of(pid: int) -> str:
    """The state of a process in the kernel's letters: S asleep, T stopped."""
    return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]


def waits_for(what: Callable[[], object]) -> None:
    until = time.monotonic() + 60.0
    while not what():
        assert time.monotonic() < until
        time.sleep(0.002)


class TestPacing:
    """ArduPilot's program, which knows nothing of the page."""

    @pytest.fixture
    def signals(self, monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, signal.Signals]]:
        sent: list[tuple[int, signal.Signals]] = []
        monkeypatch.setattr(pacing.os, "kill", lambda pid, number: sent.append((pid, number)))
        return sent

    def test_its_time_is_that_of_the_page(self, page: Page, signals: list[tuple[int, signal.Signals]]) -> None:
        paced = Pacing(page, 4711, 8.0, leads=True)
        paced.on_message(SimpleNamespace(time_boot_ms=12_340))
        paced.tick()
        assert page.read()[0] == 12.34
        assert page.pace == 8.0
        assert signals == []

    def test_time_goes_on_in_small_steps_though_the_vehicle_is_further(
        self, page: Page, signals: list[tuple[int, signal.Signals]]
    ) -> None:
        paced = Pacing(page, 4711, 8.0, leads=True)
        times = []
        for boot_ms in (10_000, 10_020, 10_140, 10_140, 10_140):
            paced.on_message(SimpleNamespace(time_boot_ms=boot_ms))
            paced.tick()
            times.append(round(page.read()[0], 3))
        assert times == [10.0, 10.02, 10.07, 10.12, 10.14]
        assert signals == [(4711, signal.SIGSTOP), (4711, signal.SIGCONT)]

    def test_after_a_reboot_it_goes_on(self, page: Page, signals: list[tuple[int, signal.Signals]]) -> None:
        paced = Pacing(page, 4711, 8.0, leads=True)
        for boot_ms in (60_000, 500, 1_500):
            paced.on_message(SimpleNamespace(time_boot_ms=boot_ms))
        paced.tick()
        assert page.read()[0] == 61.5

    def test_it_is_held_while_a_program_is_late(self, page: Page, signals: list[tuple[int, signal.Signals]]) -> None:
        slot, paced = page.claim(), Pacing(page, 4711, 8.0, leads=True)
        paced.on_message(SimpleNamespace(time_boot_ms=20_000))
        page.promise(slot, 1, 10.0)
        paced.tick()
        paced.tick()
        assert signals == [(4711, signal.SIGSTOP)]
        page.promise(slot, 2, 20.0)
        paced.tick()
        assert signals[1:] == [(4711, signal.SIGCONT)]

    def test_a_further_one_is_held_while_it_is_ahead(
        self, page: Page, signals: list[tuple[int, signal.Signals]]
    ) -> None:
        paced = Pacing(page, 4711, 8.0, leads=False)
        page.write(20.0, 8.0)
        paced.on_message(SimpleNamespace(time_boot_ms=20_300))
        paced.tick()
        assert signals == [(4711, signal.SIGSTOP)]
        page.write(20.3, 8.0)
        paced.tick()
        assert signals[1:] == [(4711, signal.SIGCONT)]

    def test_at_the_end_it_is_let_go(self, page: Page, signals: list[tuple[int, signal.Signals]]) -> None:
        page.promise(page.claim(), 1, 10.0)
        paced = Pacing(page, 4711, 8.0, leads=True)
        paced.on_message(SimpleNamespace(time_boot_ms=20_000))
        paced.tick()
        paced.release()
        paced.release()
        assert signals == [(4711, signal.SIGSTOP), (4711, signal.SIGCONT)]

    def test_it_is_stopped_while_the_runner_gets_no_processor(self, page: Page) -> None:
        program = subprocess.Popen(["sleep", "60"])
        stopper = Stopper(page, program.pid)
        try:
            paced = Pacing(page, program.pid, 8.0, leads=True, stopper=stopper)
            paced.on_message(SimpleNamespace(time_boot_ms=20_000))
            waits_for(lambda: state_of(program.pid) == "T")  # nobody ticks
            waits_for(lambda: paced.tick() or state_of(program.pid) == "S")
            waits_for(lambda: state_of(program.pid) == "T")
            paced.release()
            time.sleep(3 * UNTENDED_S)
            assert state_of(program.pid) == "S"
        finally:
            stopper.end()
            program.kill()
            program.wait()

    def test_the_stopper_ends_with_the_program(self, page: Page) -> None:
        with subprocess.Popen(["sleep", "60"]) as program:
            program.kill()
        assert stopper_main([str(page.path), str(program.pid)]) == 0

    def test_a_program_that_has_ended_is_no_fault(self, page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
        def gone(_pid: int, _number: int) -> None:
            raise ProcessLookupError

        monkeypatch.setattr(pacing.os, "kill", gone)
        page.promise(page.claim(), 1, 10.0)
        paced = Pacing(page, 4711, 8.0, leads=True)
        paced.on_message(SimpleNamespace(time_boot_ms=20_000))
        paced.tick()
