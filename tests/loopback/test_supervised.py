# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover companion` as a process: what kills it, what it outlives, and how it ends."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.cli.launch import mavproxy
from tests.depth import first
from tests.loopback.conftest import Autopilot, MavProxy, vehicle_file, wait_for

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform != "linux", reason="only on Linux does the companion run supervised"),
]

HANDOVER = [sys.executable, "-c", "import sys; from mavproxy_handover.cli import main; sys.exit(main())"]


class Companion:
    """One `handover companion`. Its console goes to a file, and nobody types, unless a test says otherwise."""

    def __init__(self, autopilot: Autopilot, config: Path, *options: str, **streams: Any) -> None:
        self._autopilot = autopilot
        self._folder = config.parent
        self._console = (self._folder / "console.txt").open("ab")
        argv = [*HANDOVER, "companion", "--config", str(config), "--master", autopilot.master, *options]
        self.process = subprocess.Popen(
            argv,
            cwd=self._folder,
            start_new_session=True,
            **{
                "env": {**os.environ, "HOME": str(self._folder)},
                "stdin": subprocess.DEVNULL,
                "stdout": self._console,
                "stderr": self._console,
                **streams,
            },
        )

    def console(self) -> str:
        return (self._folder / "console.txt").read_text(errors="replace")

    def child(self) -> int:
        """The process that runs MAVProxy."""
        pid = self.process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        assert len(children) == 1, "there is one child, always"
        return int(children[0])

    def sends_leases(self) -> None:
        """From now on, some."""
        before = self._autopilot.leases()
        wait_for(lambda: self._autopilot.leases() > before + 3, lambda: f"no leases came:\n{self.console()}")

    def signal_child(self, number: signal.Signals) -> None:
        """Send it to the child, and wait for the next one's leases."""
        child, nonces = self.child(), set(self._autopilot.nonces())
        os.kill(child, number)
        wait_for(lambda: set(self._autopilot.nonces()) - nonces, lambda: f"no new run:\n{self.console()}")
        assert self.child() != child
        assert not Path(f"/proc/{child}").exists(), "reaped before the next one was started"

    def journal(self) -> list[dict[str, Any]]:
        """Of all its runs."""
        found = sorted(self._folder.glob("flights/2*/drone-1.jsonl")) or [self._folder / "companion.jsonl"]
        return [json.loads(line) for path in found for line in path.read_text().splitlines()]

    def events(self) -> list[str]:
        return [entry["event"] for entry in self.journal()]

    def ends(self, number: signal.Signals | None = signal.SIGTERM) -> int:
        """Have it end; returns its exit code."""
        if number is not None:
            self.process.send_signal(number)
        return self.process.wait(20)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.close()
        self._console.close()


Start = Callable[..., Companion]


@pytest.fixture
def config(tmp_path: Path, station_port: int) -> Path:
    return vehicle_file(tmp_path / "handover.toml", station_port)


@pytest.fixture
def companion(autopilot: Autopilot, config: Path) -> Iterator[Start]:
    """Starts one, and waits for its leases."""
    running: list[Companion] = []

    def start(*options: str, leases: bool = True, **streams: Any) -> Companion:
        running.append(Companion(autopilot, config, *options, **streams))
        if leases:
            running[-1].sends_leases()
        return running[-1]

    yield start
    for one in running:
        one.close()


def has_ended(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


# ---- what kills it ------------------------------------------------------------------------------------------------


def test_killed_or_stalled_it_is_started_again_and_a_third_time_without_leases(
    companion: Start, autopilot: Autopilot
) -> None:
    running = companion()
    running.signal_child(signal.SIGKILL)
    time.sleep(1.0)  # its first lease may come before its first sign of life: stalled then, it has not started
    running.signal_child(signal.SIGSTOP)
    assert len(set(autopilot.nonces())) == 3
    running.sends_leases()

    os.kill(running.child(), signal.SIGKILL)
    wait_for(lambda: "failed_closed" in running.events(), running.console)
    leases, heard = autopilot.leases(), len(autopilot.received)
    wait_for(
        lambda: [m.get_type() for m in list(autopilot.received)[heard:]].count("HEARTBEAT") >= 3,
        lambda: "the companion is not there any more",
    )
    assert autopilot.leases() == leases
    why = [entry["text"].partition(": ")[2] for entry in running.journal() if entry["event"] == "started_again"]
    assert why[0] == "it was killed by SIGKILL"
    assert why[1].startswith("its main loop stood still for 1.")
    assert why[2] == "it was killed by SIGKILL"
    assert "restarted too often: no leases, no station commands" in running.console()
    assert running.ends() == 0


def test_the_tlog_of_before_is_still_there_after_a_restart(
    companion: Start, autopilot: Autopilot, tmp_path: Path
) -> None:
    log = tmp_path / "flight.tlog"
    running = companion("--logfile", str(log))
    autopilot.flood = attitudes()
    wait_for(lambda: log.stat().st_size > 300_000, lambda: "no load")
    autopilot.flood = b""
    running.signal_child(signal.SIGKILL)
    running.sends_leases()
    assert running.ends() == 0
    assert log.stat().st_size > 300_000


def frames_of(log: Path) -> list[str]:
    """Kinds of all frames that pymavlink reads."""
    os.environ["MAVLINK20"] = "1"  # or it looks for our dialect among those of MAVLink 1
    reader = mavutil.mavlink_connection(str(log), dialect="handover", robust_parsing=True)
    kinds = []
    while (message := reader.recv_match()) is not None:
        kinds.append(message.get_type())
    reader.close()
    return kinds


def flights_of(folder: Path) -> list[Path]:
    return sorted(folder.glob("flights/2*"))


def test_restarts_in_flight_leave_one_whole_log_and_journal(
    companion: Start, autopilot: Autopilot, tmp_path: Path
) -> None:
    """Of the supervised process: it is the same run."""
    running = companion()
    (folder,) = flights_of(tmp_path)
    log = folder / "drone-1.tlog"
    autopilot.flood = attitudes()
    wait_for(lambda: log.stat().st_size > 300_000, lambda: "no load")
    autopilot.flood = b""
    os.kill(running.child(), signal.SIGSTOP)  # so that nothing is written between the look and the end
    before, journal = log.read_bytes(), (folder / "drone-1.jsonl").read_bytes()
    running.signal_child(signal.SIGKILL)
    running.sends_leases()
    assert running.ends() == 0
    assert flights_of(tmp_path) == [folder]
    assert log.read_bytes().startswith(before)
    assert (folder / "drone-1.jsonl").read_bytes().startswith(journal)
    kinds = frames_of(log)
    assert kinds.count("ATTITUDE") >= before.count(b"\xfd\x1c\x00\x00") - 1, "but for one that was cut"
    assert "HEARTBEAT" in kinds[-200:], "and it went on behind it"
    assert running.events()[-1] == "unloaded"
    assert (folder / "handover.toml").is_file()
    assert json.loads((folder / "run.json").read_text())["who"] == "drone-1"
    assert (tmp_path / "flights" / "latest").resolve() == folder


def test_a_companion_that_is_started_anew_touches_nothing_of_the_one_before(
    companion: Start, autopilot: Autopilot, tmp_path: Path
) -> None:
    """Power, or SIGKILL of all of it: the new one is another run."""
    running = companion()
    (first,) = flights_of(tmp_path)
    child = running.child()
    running.process.kill()
    running.process.wait()
    wait_for(lambda: has_ended(child), lambda: "a companion without a supervisor lives on")
    before = {path.name: path.read_bytes() for path in first.iterdir()}
    for line in before["drone-1.jsonl"].splitlines():
        json.loads(line)
    second = companion()
    assert second.ends() == 0
    assert {path.name: path.read_bytes() for path in first.iterdir()} == before
    again = [folder for folder in flights_of(tmp_path) if folder != first]
    assert len(again) == 1
    assert frames_of(again[0] / "drone-1.tlog")


def test_where_no_folder_can_be_made_it_flies_without(companion: Start, tmp_path: Path) -> None:
    (tmp_path / "flights").write_text("a file in the way")
    running = companion()
    assert "WARNING: " in running.console()
    assert "no tlog, and the journal where the configuration has it" in running.console()
    assert (tmp_path / "companion.jsonl").is_file()
    assert running.ends() == 0


def test_it_dies_with_its_supervisor(companion: Start) -> None:
    running = companion()
    child = running.child()
    running.process.kill()
    wait_for(lambda: has_ended(child), lambda: "a companion without a supervisor lives on")


def test_a_service_manager_hears_of_its_life(companion: Start, tmp_path: Path) -> None:
    """Ready with its leases, in order while its judge is replaced, and of its end."""
    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    manager.bind(str(tmp_path / "notify"))
    manager.settimeout(20.0)
    try:
        environment = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "900000", "HOME": str(tmp_path)}
        running = companion(env={**os.environ, **environment})
        words = []
        while words[-1:] != [b"READY=1"]:
            words.append(manager.recv(4096))
        assert set(words[:-1]) <= {b"WATCHDOG=1"}
        running.signal_child(signal.SIGKILL)
        while words[-1:] != [b"STATUS=started again: it was killed by SIGKILL"]:
            words.append(manager.recv(4096))
        for _ in range(5):
            assert manager.recv(4096) == b"WATCHDOG=1"
        assert running.ends() == 0
        while words[-1:] != [b"STOPPING=1"]:
            words.append(manager.recv(4096))
        assert words.count(b"READY=1") == 1
    finally:
        manager.close()


def test_what_cannot_be_loaded_is_not_tried_again(companion: Start, config: Path) -> None:
    config.write_text(config.read_text().replace("udpout", "udpin"))  # the port is the station's
    running = companion(leases=False)
    assert running.ends(None) == 2
    assert "handover is not loaded: link udpin:" in running.console()
    assert running.console().count("Connect tcp:") == 1


# ---- never two judges ---------------------------------------------------------------------------------------------


def test_a_second_companion_is_refused_however_it_is_started(
    companion: Start, start: Callable[..., MavProxy], config: Path
) -> None:
    running = companion()
    locked = f"{config.parent}/state/drone-1.lock is locked: another companion of drone-1 is running"
    second = companion(leases=False)
    assert second.ends(None) == 2
    assert f"handover is not loaded: {locked}" in second.console()
    other = Autopilot()  # it has one line for one companion
    try:
        stock = start(command=[*mavproxy(), f"--master={other.master}", "--default-modules=link,signing"])
        assert stock.answer("module load handover", "handover is not loaded") == f"handover is not loaded: {locked}"
        running.sends_leases()
        assert running.ends() == 0
        stock.answer("module load handover", "Loaded module handover")
        stock.end()
    finally:
        other.close()


# ---- its terminal -------------------------------------------------------------------------------------------------


def closed_input() -> None:
    os.close(0)


@pytest.mark.parametrize(
    "streams",
    [{"stdin": subprocess.DEVNULL}, {"stdin": None, "preexec_fn": closed_input}],
    ids=["no input", "input closed"],
)
def test_it_lives_without_a_terminal(companion: Start, streams: dict[str, Any]) -> None:
    running = companion(**streams)
    for pid in (running.process.pid, running.child()):
        os.kill(pid, signal.SIGHUP)
        os.kill(pid, signal.SIGTSTP)
    running.sends_leases()
    assert running.events().count("loaded") == 1
    assert running.ends() == 0


def test_the_end_of_its_input_is_not_its_own_and_the_word_exit_is(companion: Start) -> None:
    running = companion(stdin=subprocess.PIPE)
    assert running.process.stdin is not None
    running.process.stdin.write(b"handover status\n")
    running.process.stdin.close()
    wait_for(lambda: "commander no station" in running.console(), running.console)
    running.sends_leases()
    assert running.ends() == 0

    typed = companion(stdin=subprocess.PIPE)
    assert typed.process.stdin is not None
    typed.process.stdin.write(b"exit\n")
    typed.process.stdin.flush()
    assert typed.ends(None) == 0
    assert typed.events()[-1] == "unloaded"


def test_a_console_that_nobody_reads_holds_nothing_up(companion: Start) -> None:
    reader, writer = os.pipe()
    try:
        running = companion(stdin=subprocess.PIPE, stdout=writer, stderr=writer)
        assert running.process.stdin is not None
        running.process.stdin.write(b"help\nhandover help\nset\n" * 200)  # some hundred kilobytes
        running.process.stdin.flush()
        time.sleep(0.5)  # the pipe is full by then, or this shows nothing
        running.sends_leases()
        assert running.ends() == 0
        assert running.events()[-1] == "unloaded"
    finally:
        os.close(reader)
        os.close(writer)


# ---- its end ------------------------------------------------------------------------------------------------------


def attitudes() -> bytes:
    own = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return b"".join(mavlink.MAVLink_attitude_message(n, 0, 0, 0, 0, 0, 0).pack(own) for n in range(400))


def assert_whole(log: bytes) -> None:
    """A tlog holds a stamp and a frame, again and again, to its last byte."""
    at = frames = 0
    while at < len(log):
        assert log[at + 8] == 0xFD, f"no frame at {at}"
        at += 8 + 12 + log[at + 9] + 13 * (log[at + 10] & 1)
        frames += 1
    assert at == len(log)
    assert frames > 1000


@pytest.mark.parametrize("number", first(1, [signal.SIGTERM, signal.SIGINT]))
def test_under_load_it_ends_with_everything_closed(
    companion: Start, autopilot: Autopilot, tmp_path: Path, number: signal.Signals
) -> None:
    # somebody could type, so MAVProxy's own prompt would have the main thread wait for that
    running = companion("--logfile", str(tmp_path / "flight.tlog"), stdin=subprocess.PIPE)
    autopilot.flood = attitudes()
    child = running.child()
    wait_for(lambda: (tmp_path / "flight.tlog").stat().st_size > 300_000, lambda: "no load")
    assert running.ends(number) == 0
    assert has_ended(child)
    assert running.events()[-1] == "unloaded"
    assert running.events().count("loaded") == 1
    assert_whole((tmp_path / "flight.tlog").read_bytes())


def fill(path: Path) -> None:
    """Until there is no room left on its disk."""
    with path.open("wb", buffering=0) as file, suppress(OSError):
        while file.write(bytes(1 << 20)):
            pass
    assert os.statvfs(path).f_bavail == 0


#: in a mount namespace of its own: a disk of 216 MiB, of which MAVProxy wants 200 at its start
ON_A_SMALL_DISK = "mount -t tmpfs -o size=216m none {folder} && cp {kept} {folder}/ && cd {folder} && exec {command}"


def test_on_a_full_disk_it_is_started_again_and_ends(autopilot: Autopilot, tmp_path: Path, station_port: int) -> None:
    probe = ["unshare", "-m", "mount", "-t", "tmpfs", "none", str(tmp_path)]
    if os.geteuid() != 0 or subprocess.run(probe, capture_output=True, check=False).returncode != 0:
        pytest.skip("only root, in a mount namespace, can make a disk that is full")
    disk = tmp_path / "disk"
    disk.mkdir()
    config = vehicle_file(tmp_path / "handover.toml", station_port)
    words = [*HANDOVER, "companion", "--config", str(disk / config.name), "--master", autopilot.master]
    command = " ".join(f"'{word}'" for word in words)
    script = ON_A_SMALL_DISK.format(folder=disk, kept=config, command=command)
    console = (tmp_path / "console.txt").open("wb")
    with subprocess.Popen(
        ["unshare", "-m", "sh", "-c", script],
        env={**os.environ, "HOME": str(tmp_path)},
        stdin=subprocess.DEVNULL,
        stdout=console,
        stderr=console,
    ) as process:
        try:
            said = (tmp_path / "console.txt").read_text
            wait_for(lambda: autopilot.leases() > 3, said)
            inside = Path(f"/proc/{process.pid}/root{disk}")
            fill(inside / "filler")
            autopilot.flood = attitudes()
            children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
            (child,) = children.read_text().split()
            nonces = set(autopilot.nonces())
            os.kill(int(child), signal.SIGKILL)
            wait_for(lambda: set(autopilot.nonces()) - nonces, said)
            more = autopilot.leases()
            wait_for(lambda: autopilot.leases() > more + 3, said)
            process.terminate()
            assert process.wait(20) == 0, said()
        finally:
            process.kill()
            console.close()
