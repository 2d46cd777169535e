# SPDX-License-Identifier: GPL-3.0-or-later

"""The parent with children that are no MAVProxy: forks, signals, and who is told what. Real processes, no timing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform != "linux", reason="only on Linux does the companion run supervised"),
]

Run = Callable[..., "subprocess.Popen[str]"]

PROGRAM = """
import os, signal, sys, threading, time
from mavproxy_handover.supervision.rules import Limits
from mavproxy_handover.supervision.supervisor import Supervisor, single_threaded

def say(*words):
    os.write(1, (" ".join(map(str, words)) + "\\n").encode())

def child(line):
    say("child", os.getpid(), line.told.leases, line.told.why)
    {child}

{before}
sys.exit(Supervisor(child, Limits({limits})).run())
"""
LIVE = "line.beat(0.0)"
#: until the supervisor sends a signal, which is blocked until then
WAIT = "signal.sigwait([signal.SIGTERM]); line.ending()"


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    """Starts the program; what is still there at the end is killed."""
    running: list[subprocess.Popen[str]] = []

    def start(child: str, limits: str = "", before: str = "") -> subprocess.Popen[str]:
        program = PROGRAM.format(child=child, limits=limits, before=before)
        running.append(
            subprocess.Popen(
                [sys.executable, "-c", program],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
        )
        return running[-1]

    yield start
    for process in running:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def line(process: subprocess.Popen[str]) -> list[str]:
    """The words of the next line that is shown."""
    assert process.stdout is not None
    return process.stdout.readline().split(maxsplit=3)


def test_the_code_of_one_that_never_lived_is_passed_on(run: Run) -> None:
    process = run("return 3")
    assert process.wait(20) == 3
    assert line(process)[2] == "True"
    assert line(process) == []


def test_an_exception_is_an_end_like_any_other(run: Run) -> None:
    assert run("raise RuntimeError").wait(20) == 70


def test_each_death_is_followed_by_another_child_that_knows_why(run: Run) -> None:
    process = run(f"{LIVE}; os.kill(os.getpid(), 9) if not line.told.why else None; {WAIT}; return 0")
    first, second = line(process), line(process)
    assert first[0] == second[0] == "child"
    assert first[1] != second[1]
    assert second[2:] == ["True", "it was killed by SIGKILL\n"]
    process.terminate()
    assert process.wait(20) == 0


def test_a_child_that_does_not_end_is_killed(run: Run) -> None:
    process = run(f"{LIVE}; time.sleep(600)", limits="silent_s=600.0, end_s=0.2")
    pid = int(line(process)[1])
    process.send_signal(signal.SIGINT)
    assert process.wait(20) == 137
    assert not Path(f"/proc/{pid}").exists()


def test_between_two_children_it_ends_as_well(run: Run) -> None:
    process = run(f"{LIVE}; return 1", limits="trusted=0, hopeless_s=600.0")
    assert [line(process)[2], line(process)[2]] == ["True", "False"]
    process.terminate()  # it may be reaping the second one still: either way
    assert process.wait(20) in (0, 1)


def test_where_a_thread_runs_it_says_so(run: Run) -> None:
    before = "say(single_threaded()); threading.Thread(target=time.sleep, args=(600,), daemon=True).start(); "
    process = run("return 0", before=before + "say(single_threaded()); os._exit(0)")
    assert [line(process), line(process)] == [["True"], ["False"]]


def test_the_terminal_has_its_echo_again_after_a_child_that_was_killed(tmp_path: Path) -> None:
    """A child that reads lines with readline has switched it off."""
    off = "import termios; new = termios.tcgetattr(0); new[3] &= ~termios.ECHO; termios.tcsetattr(0, 0, new)"
    program = PROGRAM.format(
        child=f"{off}; {LIVE}; os.kill(os.getpid(), 9)", limits="trusted=0, hopeless_s=600", before=""
    )
    before = f"""
import os, pty, sys, termios
pid, terminal = pty.fork()
if pid == 0:
    os.execv(sys.executable, [sys.executable, "-c", {program!r}])
seen = b""
while seen.count(b"child") < 2:
    seen += os.read(terminal, 4096)
while not termios.tcgetattr(terminal)[3] & termios.ECHO:
    pass
os.kill(pid, 9)
"""
    ended = subprocess.run([sys.executable, "-c", before], env=dict(os.environ), timeout=20, check=False)
    assert ended.returncode == 0
