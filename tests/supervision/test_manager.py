# SPDX-License-Identifier: GPL-3.0-or-later

"""The service manager's side of the companion: this test is the manager, on a socket of its own. systemd is not run."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from math import inf
from pathlib import Path

import pytest

from mavproxy_handover.supervision.manager import ServiceManager, named_manager, service_manager

READY, BEAT, STOPPING = b"READY=1", b"WATCHDOG=1", b"STOPPING=1"


@pytest.fixture(params=["a path", "an abstract name"])
def heard(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """The manager's socket, and what it is called."""
    name = str(tmp_path / "notify") if request.param == "a path" else f"@handover-test-{os.getpid()}"
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listening.bind(name if name[0] != "@" else "\0" + name[1:])
    listening.settimeout(20.0)
    yield listening, name
    listening.close()


def said(listening: socket.socket) -> list[bytes]:
    """All that has come by now."""
    words = []
    listening.setblocking(False)
    try:
        while True:
            words.append(listening.recv(4096))
    except BlockingIOError:
        return words
    finally:
        listening.settimeout(20.0)


# ---- the words ------------------------------------------------------------------------------------------------------


def test_ready_is_told_once_and_a_beat_three_times_as_often_as_it_is_waited_for(
    heard: tuple[socket.socket, str],
) -> None:
    listening, name = heard
    manager = ServiceManager(name, 9.0)
    manager.in_order(100.0, lived=False)
    assert said(listening) == [BEAT]
    assert manager.due_at() == 103.0
    manager.in_order(102.9, lived=True)
    manager.in_order(102.9, lived=True)
    assert said(listening) == [READY]
    manager.in_order(103.0, lived=True)
    manager.replaced("it was killed by SIGKILL")
    manager.stopping()
    assert said(listening) == [BEAT, b"STATUS=started again: it was killed by SIGKILL", STOPPING]
    manager.close()


def test_without_a_watchdog_only_ready_is_told(heard: tuple[socket.socket, str]) -> None:
    listening, name = heard
    manager = ServiceManager(name)
    for now in (1.0, 1e6):
        manager.in_order(now, lived=True)
    assert said(listening) == [READY]
    assert manager.due_at() == inf
    manager.close()


@pytest.mark.parametrize("address", [None, "/nowhere/notify", "@nobody-listens-here", "x" * 300])
def test_a_manager_that_is_not_there_is_no_trouble(address: str | None) -> None:
    manager = ServiceManager(address, 10.0)
    manager.in_order(1.0, lived=True)
    manager.replaced("")
    manager.stopping()
    manager.close()
    manager.in_order(100.0, lived=True)
    assert manager.due_at() == inf


def test_one_that_does_not_read_holds_nobody_up(heard: tuple[socket.socket, str]) -> None:
    listening, name = heard
    manager = ServiceManager(name, 0.001)
    for now in range(5000):
        manager.in_order(float(now), lived=True)
    assert 1 <= len(said(listening)) < 5000
    manager.close()


def test_ready_is_told_until_it_gets_through(heard: tuple[socket.socket, str]) -> None:
    """While a computer starts, the manager has much to read; one that is not ready in time is killed."""
    listening, name = heard
    others = ServiceManager(name, 0.001)
    for now in range(5000):  # its queue is full
        others.in_order(float(now), lived=True)
    manager = ServiceManager(name, 9.0)
    manager.in_order(100.0, lived=True)
    assert manager.due_at() == 100.1, "so is a beat"
    assert b"WATCHDOG=1" in said(listening)
    manager.in_order(100.05, lived=True)
    assert said(listening) == [], "in its time: the main loop has more to do"
    manager.in_order(100.1, lived=True)
    assert said(listening) == [READY, BEAT]
    manager.in_order(100.2, lived=True)
    assert said(listening) == []
    assert manager.due_at() == 103.1
    for each in (others, manager):
        each.close()


def test_one_that_is_asked_for_by_name_can_be_asked_for_again(heard: tuple[socket.socket, str]) -> None:
    environment = {"NOTIFY_SOCKET": heard[1], "WATCHDOG_USEC": "3000000"}
    for _ in range(2):
        manager = named_manager(environment)
        manager.in_order(0.0, lived=True)
        assert said(heard[0]) == [READY, BEAT]
        assert manager.due_at() == 1.0
        manager.close()


def test_what_the_manager_says_of_itself_is_taken_out_of_the_environment(heard: tuple[socket.socket, str]) -> None:
    def named(**more: str) -> tuple[dict[str, str], float]:
        environment = {"NOTIFY_SOCKET": heard[1], "PATH": "/bin", **more}
        manager = service_manager(environment)
        manager.in_order(0.0, lived=False)
        due_at = manager.due_at()
        manager.close()
        return environment, due_at

    own = str(os.getpid())
    assert named(WATCHDOG_USEC="3000000", WATCHDOG_PID=own) == ({"PATH": "/bin"}, 1.0)
    assert named(WATCHDOG_USEC="3000000") == ({"PATH": "/bin"}, 1.0)
    for of_none in ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "1"}, {"WATCHDOG_USEC": "soon"}, {}):
        assert named(**of_none) == ({"PATH": "/bin"}, inf)
    assert service_manager({}).due_at() == inf


# ---- a supervisor and its children ----------------------------------------------------------------------------------

PROGRAM = """
import os, signal, sys, time
from mavproxy_handover.supervision.manager import service_manager
from mavproxy_handover.supervision.rules import Limits
from mavproxy_handover.supervision.supervisor import Supervisor

def live(line, seconds):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        line.beat(time.monotonic())
        if signal.sigtimedwait([signal.SIGTERM], 0.02):
            line.ending()
            os._exit(0)

def child(line):
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
    assert "NOTIFY_SOCKET" not in os.environ
    {child}

{before}
sys.exit(Supervisor(child, Limits(silent_s=0.4, failed_s=0.05, window_s=0.0), service_manager()).run())
"""

Start = Callable[..., "subprocess.Popen[bytes]"]


@pytest.fixture
def start(heard: tuple[socket.socket, str]) -> Iterator[Start]:
    """Starts a supervisor as its service, with a watchdog of three seconds."""
    running: list[subprocess.Popen[bytes]] = []

    def run(child: str, before: str = "") -> subprocess.Popen[bytes]:
        environment = {**os.environ, "NOTIFY_SOCKET": heard[1], "WATCHDOG_USEC": "3000000"}
        words = [sys.executable, "-c", PROGRAM.format(child=child, before=before)]
        running.append(subprocess.Popen(words, env=environment, start_new_session=True))
        return running[-1]

    yield run
    for process in running:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.wait()


def until(listening: socket.socket, word: bytes) -> list[bytes]:
    """What is heard up to this word."""
    words = []
    while not words or words[-1] != word:
        words.append(listening.recv(4096))
    return words


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only on Linux does the companion run supervised")


@pytest.mark.process
def test_it_is_ready_when_the_main_loop_goes_round_and_says_so_on_until_its_end(
    heard: tuple[socket.socket, str], start: Start
) -> None:
    process = start("time.sleep(0.5); live(line, 600)")
    words = until(heard[0], READY)
    assert set(words[:-1]) <= {BEAT}
    assert until(heard[0], BEAT)[-2:] == [BEAT]
    until(heard[0], BEAT)
    process.terminate()
    assert until(heard[0], STOPPING)[-1] == STOPPING
    assert process.wait(20) == 0


@pytest.mark.process
def test_children_that_are_replaced_in_time_are_in_order(heard: tuple[socket.socket, str], start: Start) -> None:
    """One stands still, one is killed."""
    start("live(line, 0.2); time.sleep(600 if not line.told.why else 0); os.kill(os.getpid(), 9)")
    words = until(heard[0], b"STATUS=started again: it was killed by SIGKILL")
    assert any(word.startswith(b"STATUS=started again: its main loop stood still") for word in words)
    until(heard[0], BEAT)
    until(heard[0], BEAT)


@pytest.mark.process
def test_of_a_child_that_cannot_be_replaced_nothing_is_told(heard: tuple[socket.socket, str], start: Start) -> None:
    no_more = "forks = []\nreal = os.fork\ndef fork():\n    if forks: raise OSError(11, 'no more')\n"
    no_more += "    forks.append(1)\n    return real()\nos.fork = fork"
    process = start("live(line, 0.3); os._exit(1)", before=no_more)
    until(heard[0], b"STATUS=started again: it ended with 1")
    time.sleep(3.0)
    assert BEAT not in said(heard[0])
    assert process.poll() is None


@pytest.mark.process
def test_of_a_supervisor_that_hangs_nothing_is_heard(heard: tuple[socket.socket, str], start: Start) -> None:
    process = start("live(line, 600)")
    until(heard[0], READY)
    process.send_signal(signal.SIGSTOP)
    time.sleep(0.2)
    said(heard[0])
    time.sleep(3.0)
    assert said(heard[0]) == []
