# SPDX-License-Identifier: GPL-3.0-or-later

"""Processes of a run: fed, noticed when they end, and never left behind."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

import sitl
from sitl.run.processes import Processes, ProcessGone, ending
from sitl.vehicles import ports

pytestmark = pytest.mark.process

ECHO = [sys.executable, "-c", "import sys\nfor line in sys.stdin: print('got', line.strip(), flush=True)"]
SLEEP = [sys.executable, "-c", "import time; time.sleep(600)"]
STUBBORN = [
    sys.executable,
    "-c",
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); time.sleep(600)",
]


def gone(pid: int, within_s: float = 60.0) -> bool:
    """Whether the process ends in time; a zombie has ended."""
    until = time.monotonic() + within_s
    while time.monotonic() < until:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            return True
        if state == "Z":
            return True
        time.sleep(0.02)
    return False


def wait_for(path: Path, text: str) -> None:
    until = time.monotonic() + 60.0
    while text not in path.read_text():
        assert time.monotonic() < until, f"no {text!r} in {path}"
        time.sleep(0.02)


def test_a_typed_line_arrives_and_its_answer_is_in_the_log(tmp_path: Path) -> None:
    with Processes() as processes:
        child = processes.start("GCSA", ECHO, tmp_path / "GCSA")
        child.type("handover start")
        wait_for(child.log_path, "got handover start")


def test_each_process_has_a_home_of_its_own(tmp_path: Path) -> None:
    script = [sys.executable, "-c", "import os; print(os.environ['HOME'], os.getcwd(), flush=True)"]
    with Processes() as processes:
        child = processes.start("GCSA", script, tmp_path / "GCSA")
        wait_for(child.log_path, f"{tmp_path / 'GCSA'} {tmp_path / 'GCSA'}")


def test_leaving_the_block_ends_every_process(tmp_path: Path) -> None:
    with Processes() as processes:
        pids = [processes.start(name, SLEEP, tmp_path / name).pid for name in ("a", "b")]
    assert all(gone(pid, 0.0) or gone(pid) for pid in pids)


def test_an_error_ends_every_process(tmp_path: Path) -> None:
    pids = []

    def fail() -> None:
        with Processes() as processes:
            pids.append(processes.start("a", SLEEP, tmp_path / "a").pid)
            raise KeyError("x")

    with pytest.raises(KeyError):
        fail()
    assert gone(pids[0])


def test_one_that_does_not_listen_is_killed(tmp_path: Path) -> None:
    with Processes() as processes:
        child = processes.start("a", STUBBORN, tmp_path / "a")
        wait_for(child.log_path, "up")
        child.stop(timeout_s=0.2)
        assert child.returncode == -signal.SIGKILL


def test_an_end_nobody_asked_for_is_noticed_and_a_kill_is_not_one(tmp_path: Path) -> None:
    with Processes() as processes:
        dying = processes.start("dying", [sys.executable, "-c", "raise SystemExit(3)"], tmp_path / "dying")
        killed = processes.start("killed", SLEEP, tmp_path / "killed")
        killed.kill()
        assert gone(dying.pid)
        assert [(child.name, child.returncode) for child in processes.dead()] == [("dying", 3)]
        assert killed.returncode == -signal.SIGKILL


def test_typing_at_a_dead_process_says_so(tmp_path: Path) -> None:
    with Processes() as processes:
        child = processes.start("GCSA", SLEEP, tmp_path)
        child.kill()
        with pytest.raises(ProcessGone, match="GCSA has ended"):
            child.type("handover start")


def test_processes_die_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom sitl.run.processes import Processes\n"
        f"processes = Processes()\nchild = processes.start('a', {SLEEP!r}, Path({str(tmp_path)!r}))\n"
        "print(child.pid, flush=True)\ntime.sleep(600)\n"
    )
    root = str(Path(sitl.__file__).resolve().parents[1])
    parent = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": root}
    )
    assert parent.stdout is not None
    with parent.stdout:
        pid = int(parent.stdout.readline())
        parent.kill()
        parent.wait()
    assert gone(pid)


FORKS = [
    sys.executable,
    "-c",
    "import os, time\nif os.fork() == 0: time.sleep(600)\nprint('up', flush=True)\nos.wait()\ntime.sleep(600)",
]


def test_what_a_process_watches_over_is_known_and_weighed_and_ends_with_it(tmp_path: Path) -> None:
    with Processes() as processes:
        child = processes.start("companion", FORKS, tmp_path)
        until = time.monotonic() + 60.0
        while "up" not in child.console() and time.monotonic() < until:
            time.sleep(0.02)
        forked = child.offspring()
        assert forked is not None
        assert forked != child.pid
        os.kill(forked, signal.SIGKILL)
        assert gone(forked)
        assert child.alive()
        other = processes.start("lonely", SLEEP, tmp_path / "lonely")
        assert other.offspring() is None
        until = time.monotonic() + 60.0  # between fork and exec there is next to nothing of it
        while (other.resident_kb() or 0) <= 1000 and time.monotonic() < until:
            time.sleep(0.02)
        assert (other.resident_kb() or 0) > 1000


def test_a_name_is_used_once(tmp_path: Path) -> None:
    with Processes() as processes:
        processes.start("a", SLEEP, tmp_path)
        with pytest.raises(ValueError, match="started already"):
            processes.start("a", SLEEP, tmp_path)


def test_endings_are_told_in_words() -> None:
    assert ending(-9) == "killed by SIGKILL"
    assert ending(3) == "ended with 3"


def _eighty() -> list[int]:
    picker = ports.PortPicker()
    return [picker.udp() for _ in range(40)] + [picker.tcp() for _ in range(40)]


def test_no_port_is_handed_out_twice() -> None:
    assert len(set(_eighty())) == 80


def test_nor_by_two_pickers_that_begin_at_one_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fault: a port was picked for the box; the vehicle, launched before the box bound it, picked it as well."""
    monkeypatch.setattr(ports, "randrange", lambda _most: 100)
    pickers = [ports.PortPicker() for _ in range(20)]
    assert len({picker.tcp() for picker in pickers} | {picker.udp() for picker in pickers}) == 40


def test_nor_by_pickers_of_two_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fault: two processes of one test run began at one place; the later one found its port in use."""
    picks = (
        "from sitl.vehicles import ports\n"
        "ports.randrange = lambda _most: 200\n"
        "print(ports.PortPicker().udp(), flush=True)\n"
        "input()"
    )
    monkeypatch.setattr(ports, "randrange", lambda _most: 200)
    with subprocess.Popen([sys.executable, "-c", picks], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        theirs = int(other.stdout.readline())
        assert theirs not in [ports.PortPicker().udp() for _ in range(3)]
        other.communicate(b"\n")
    monkeypatch.setattr(ports, "PORTS", range(theirs, theirs + 1))
    assert ports.PortPicker().tcp() == theirs, "a process that has ended keeps no port"


def test_a_port_is_none_that_the_system_gives_to_other_sockets() -> None:
    """A station's ground port was once taken by somebody else's socket before the station bound it."""
    assert all(1024 <= port < 32768 for port in _eighty())


@pytest.mark.parametrize("kind", [socket.SOCK_DGRAM, socket.SOCK_STREAM])
def test_a_port_in_use_is_not_handed_out(kind: socket.SocketKind, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind((ports.LOOPBACK, 0))
        port = taken.getsockname()[1]
        monkeypatch.setattr(ports, "PORTS", range(port, port + 1))
        picker = ports.PortPicker()
        pick = picker.udp if kind is socket.SOCK_DGRAM else picker.tcp
        with pytest.raises(OSError, match=f"no free port on 127.0.0.1 from {port} to {port}"):
            pick()
