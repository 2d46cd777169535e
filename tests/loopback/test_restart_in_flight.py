# SPDX-License-Identifier: GPL-3.0-or-later

"""A companion that is killed in flight commands again, whatever was lost of what it was started with.

Real processes: `handover companion`, an autopilot that says that it flies, and a station that signs. Each test takes
something away in flight, kills the companion, and measures the time until the next lease of a commander.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover.store.memory import memory_folder
from tests.depth import first
from tests.loopback.conftest import Autopilot, wait_for
from tests.loopback.test_supervised import HANDOVER
from tests.module.vehicle import Station

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform != "linux", reason="only on Linux does the companion run supervised"),
]

MISSIONS = Path(__file__).resolve().parents[2] / "missions"
KEY = bytes(range(32))
#: from the kill to the next lease of a commander. The promise is 2.0 s on a quiet machine; the guard acts after 3 s
SOON_S = 3.0
#: epoch of MAVLink's signing stamps, and their unit
_EPOCH_S, _UNIT_S = 1420070400, 1e-5


class SignedStation(Station):
    """A station that signs, and answers in a thread of its own."""

    def __init__(self) -> None:
        super().__init__("GCSA", 251)
        signing = self.own.signing
        signing.secret_key, signing.sign_outgoing, signing.link_id = KEY, True, 3
        signing.timestamp = int((time.time() - _EPOCH_S) / _UNIT_S)
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        looked_at = 0
        while not self._done.is_set():
            self.step(time.monotonic())
            heard, looked_at = self.received[looked_at:], len(self.received)
            # as every station does: its stamps follow the clock, and those that it has heard
            stamps = [int.from_bytes(m.get_msgbuf()[-12:-6], "little") for m in heard if m.get_msgbuf()[2] & 1]
            signing = self.own.signing
            signing.timestamp = max([signing.timestamp, int((time.time() - _EPOCH_S) / _UNIT_S), *stamps])
            time.sleep(0.02)

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        super().close()


class Flight:
    """A companion in flight, with its station and its autopilot."""

    def __init__(self, folder: Path, autopilot: Autopilot, station: SignedStation) -> None:
        self.folder, self.autopilot, self.station = folder, autopilot, station
        self.config = folder / "handover.toml"
        self.key = folder / "GCSA.key"
        self.links = [f"udpout:127.0.0.1:{station.port}"]
        self.more = ""
        self.prefix: list[str] = []
        self.processes: list[subprocess.Popen[bytes]] = []
        shutil.copytree(MISSIONS / "delivery", folder / "mission")
        self.key.write_text(KEY.hex())
        self.key.chmod(0o600)

    def configure(self) -> None:
        links = ", ".join(f'"{link}"' for link in self.links)
        self.config.write_text(
            f"""
            [vehicle]
            name = "drone-1"
            parent = "GCSA"
            guard = false
            mission = "mission"
            autopilot_key = "GCSA.key"
            [limits]
            recovery_s = 30
            [[station]]
            name = "GCSA"
            sysid = 251
            links = [{links}]
            key = "GCSA.key"
            {self.more}
            """.replace('autopilot_key = "GCSA.key"\n', "\n")
        )

    def start(self) -> subprocess.Popen[bytes]:
        argv = [*self.prefix, *HANDOVER, "companion", "--config", str(self.config), "--master", self.autopilot.master]
        with (self.folder / "console.txt").open("ab") as console:
            process = subprocess.Popen(
                argv,
                cwd=self.folder,
                start_new_session=True,
                env={**os.environ, "HOME": str(self.folder)},
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
            )
        self.processes.append(process)
        return process

    def console(self) -> str:
        return (self.folder / "console.txt").read_text(errors="replace")

    def fly(self) -> None:
        """Start, wait until GCSA commands, and be in the air."""
        self.configure()
        self.start()
        wait_for(lambda: self.autopilot.held, self.console)
        self.autopilot.airborne = True
        wait_for(lambda: "started" in self.events(), self.console)
        time.sleep(0.5)

    def journal(self) -> list[dict[str, Any]]:
        found = sorted(self.folder.glob("flights*/2*/drone-1.jsonl"))
        return [json.loads(line) for path in found for line in path.read_text().splitlines()]

    def events(self) -> list[str]:
        return [entry["event"] for entry in self.journal()]

    def texts(self, event: str) -> str:
        return "\n".join(entry["text"] for entry in self.journal() if entry["event"] == event)

    def record(self) -> Path:
        """What a restart goes on with, in memory."""
        folder = memory_folder(os.environ)
        assert folder is not None
        records = {path: json.loads(path.read_text())["body"]["run"]["path"] for path in folder.glob("*.run")}
        (found,) = [path for path, config in records.items() if config == str(self.config)]
        return found

    def child(self) -> int:
        pid = self.processes[-1].pid
        (child,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return int(child)

    def kill(self) -> float:
        """Kill the judge, and return when."""
        at = time.monotonic()
        os.kill(self.child(), signal.SIGKILL)
        return at

    def commands_again(self, since: float, nonces: set[int]) -> float:
        """Wait for a lease of a commander in a new run; returns how long after `since` it came (s)."""
        wait_for(lambda: [at for at, nonce in list(self.autopilot.held) if nonce not in nonces], self.console)
        return next(at for at, nonce in list(self.autopilot.held) if nonce not in nonces) - since

    def nonces(self) -> set[int]:
        return set(self.autopilot.nonces())

    def killed(self) -> float:
        """Kill the judge; how long it takes until a station commands again."""
        nonces = self.nonces()
        return self.commands_again(self.kill(), nonces)

    def close(self) -> None:
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.wait()


@pytest.fixture
def station() -> Iterator[SignedStation]:
    made = SignedStation()
    yield made
    made.close()


@pytest.fixture
def flight(tmp_path: Path, autopilot: Autopilot, station: SignedStation) -> Iterator[Flight]:
    made = Flight(tmp_path, autopilot, station)
    yield made
    made.close()


def tell(record_property: Callable[[str, object], None], seconds: float) -> None:
    record_property("seconds_to_the_next_lease", round(seconds, 2))
    print(f"next lease of a commander after {seconds:.2f} s")


# ---- what the files of the configuration come to -------------------------------------------------------------------


def configuration_is_gone(flight: Flight) -> None:
    flight.config.unlink()


def configuration_is_broken(flight: Flight) -> None:
    flight.config.write_text("[vehicle\nname = ")


def configuration_is_edited(flight: Flight) -> None:
    flight.config.write_text(flight.config.read_text().replace("udpout:127.0.0.1", "udpout:192.0.2.1"))


def configuration_is_a_folder(flight: Flight) -> None:
    flight.config.unlink()
    flight.config.mkdir()


def key_is_gone(flight: Flight) -> None:
    flight.key.unlink()


def key_may_be_read_by_others(flight: Flight) -> None:
    flight.key.chmod(0o644)


def key_is_another(flight: Flight) -> None:
    flight.key.write_text("ab" * 32)


def mission_is_gone(flight: Flight) -> None:
    shutil.rmtree(flight.folder / "mission")


def mission_is_broken(flight: Flight) -> None:
    (flight.folder / "mission" / "mission.toml").write_text("name = ")


def state_is_gone(flight: Flight) -> None:
    shutil.rmtree(flight.folder / "state")


def state_is_a_file(flight: Flight) -> None:
    shutil.rmtree(flight.folder / "state")
    (flight.folder / "state").write_text("a file in the way")


def logs_are_gone(flight: Flight) -> None:
    shutil.rmtree(flight.folder / "flights")


def logs_are_a_file(flight: Flight) -> None:
    (flight.folder / "flights").rename(flight.folder / "flights-of-before")
    (flight.folder / "flights").write_text("a file in the way")


def replay_state_is_damaged(flight: Flight) -> None:
    (flight.folder / "state" / "drone-1.replay.json").write_text("{")


def everything_is_gone(flight: Flight) -> None:
    for path in flight.folder.iterdir():
        if path.name != "console.txt":
            (shutil.rmtree if path.is_dir() else os.unlink)(path)


#: the first five in each test run: one of each file, and one of all
LOSSES = [
    everything_is_gone,
    configuration_is_broken,
    key_may_be_read_by_others,
    state_is_a_file,
    logs_are_a_file,
    configuration_is_a_folder,
    configuration_is_gone,
    configuration_is_edited,
    key_is_gone,
    key_is_another,
    mission_is_gone,
    mission_is_broken,
    state_is_gone,
    logs_are_gone,
    replay_state_is_damaged,
]


@pytest.mark.parametrize("loss", first(5, LOSSES), ids=lambda loss: loss.__name__)
def test_a_restart_needs_no_file(
    flight: Flight, loss: Callable[[Flight], None], record_property: Callable[[str, object], None]
) -> None:
    flight.fly()
    loss(flight)
    seconds = flight.killed()
    tell(record_property, seconds)
    assert seconds < SOON_S
    assert "restarted too often" not in flight.console()
    note = f"Restart: configuration, keys and mission are those of the run before; {flight.config} is read at the next"
    assert f"{note} start on the ground." in flight.console()


@pytest.mark.parametrize(
    "loss",
    first(1, [everything_is_gone, configuration_is_broken, key_may_be_read_by_others]),
    ids=lambda loss: loss.__name__,
)
def test_nor_does_a_new_supervisor(
    flight: Flight, loss: Callable[[Flight], None], record_property: Callable[[str, object], None]
) -> None:
    """All of `handover companion` was killed in flight, and somebody, or a service manager, starts it again."""
    flight.fly()
    loss(flight)
    nonces = flight.nonces()
    flight.processes[-1].kill()
    flight.processes[-1].wait()
    at = time.monotonic()
    flight.start()
    seconds = flight.commands_again(at, nonces)
    tell(record_property, seconds)


def test_no_key_can_be_read_by_others_or_is_in_an_argument_or_the_environment(flight: Flight) -> None:
    flight.fly()
    secret = KEY.hex()
    for pid in (flight.processes[-1].pid, flight.child()):
        for name in ("cmdline", "environ"):
            assert secret not in Path(f"/proc/{pid}/{name}").read_bytes().decode("latin-1").lower()
    record = flight.record()
    assert record.stat().st_mode & 0o777 == 0o600
    assert record.parent.stat().st_mode & 0o777 == 0o700


def test_the_ground_reads_the_files_again(flight: Flight) -> None:
    """After an orderly end on the ground nothing is left in memory, and what is wrong with a file is an error."""
    flight.configure()
    flight.start()
    wait_for(lambda: flight.autopilot.held, flight.console)
    record = flight.record()
    flight.processes[-1].terminate()
    assert flight.processes[-1].wait(20) == 0
    assert not record.exists()
    flight.key.chmod(0o644)
    assert flight.start().wait(20) == 2
    assert "GCSA.key: mode 0644 must be 0600" in flight.console()


# ---- links ---------------------------------------------------------------------------------------------------------


def test_a_port_that_another_program_has_taken_is_a_closed_link(
    flight: Flight, record_property: Callable[[str, object], None]
) -> None:
    """The other link carries on; the port is used again when it is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
    flight.links.append(f"udpin:127.0.0.1:{port}")
    flight.fly()
    nonces, at = flight.nonces(), flight.kill()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
        while True:
            try:
                thief.bind(("127.0.0.1", port))
                break
            except OSError:
                assert time.monotonic() - at < 5.0
        seconds = flight.commands_again(at, nonces)
        tell(record_property, seconds)
        assert seconds < SOON_S
    wait_for(lambda: is_bound(port), flight.console)


def is_bound(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        try:
            one.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def test_a_serial_line_that_was_unplugged_is_a_closed_link(
    flight: Flight, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    near, far = os.openpty()
    line = tmp_path / "ttyUSB0"
    line.symlink_to(os.ttyname(far))
    flight.links.append(f"serial:{line}:57600")
    flight.fly()
    line.unlink()
    os.close(near)
    os.close(far)
    seconds = flight.killed()
    tell(record_property, seconds)
    assert seconds < SOON_S


@pytest.fixture
def hosts(flight: Flight, tmp_path: Path) -> Path:
    """The companion's own /etc/hosts, in a mount namespace of its own."""
    path = tmp_path / "etc-hosts"
    path.write_text("127.0.0.1 localhost gcs.example box.example\n")
    probe = ["unshare", "-m", "mount", "--bind", str(path), "/etc/hosts"]
    if os.geteuid() != 0 or subprocess.run(probe, capture_output=True, check=False).returncode != 0:
        pytest.skip("only root, in a mount namespace, can give the companion an /etc/hosts of its own")
    flight.prefix = ["unshare", "-m", "sh", "-c", f'mount --bind "{path}" /etc/hosts && exec "$0" "$@"']
    flight.links = [link.replace("127.0.0.1", "gcs.example") for link in flight.links]
    return path


def nobody_knows_a_name(hosts: Path) -> None:
    """In place: the file is mounted."""
    hosts.write_text("127.0.0.1 localhost\n")


def test_a_name_that_nobody_knows_any_more_has_its_last_address(
    flight: Flight, hosts: Path, record_property: Callable[[str, object], None]
) -> None:
    flight.more = '[position]\nbox = "tcp:box.example:9"\n'
    flight.fly()
    nobody_knows_a_name(hosts)
    seconds = flight.killed()
    tell(record_property, seconds)
    assert seconds < SOON_S


def test_a_name_that_was_never_known_in_this_run_is_a_closed_link_until_it_is(
    flight: Flight, hosts: Path, record_property: Callable[[str, object], None]
) -> None:
    """No record of the run before is left: the files are read, and names are looked up beside the main loop."""
    flight.fly()
    nobody_knows_a_name(hosts)
    flight.record().unlink()
    nonces = flight.nonces()
    flight.kill()
    wait_for(lambda: flight.nonces() - nonces, flight.console)
    time.sleep(3.0)
    assert not [at for at, nonce in flight.autopilot.held if nonce not in nonces]
    hosts.write_text("127.0.0.1 localhost gcs.example\n")
    seconds = flight.commands_again(time.monotonic(), nonces)
    tell(record_property, seconds)
    assert "restarted too often" not in flight.console()


# ---- storage without room -------------------------------------------------------------------------------------------

#: a disk for the logs of which MAVProxy wants 200 MiB at its start, one for the state, and storage in memory
ON_SMALL_DISKS = """
mkdir -p flights state memory
mount -t tmpfs -o size=216m none flights && mount -t tmpfs -o size=256k none state
mount -t tmpfs -o size=1m,mode=700 none memory && export RUNTIME_DIRECTORY="$PWD/memory" && exec "$0" "$@"
"""


def fill(path: Path) -> None:
    """Until there is no room left there."""
    with path.open("wb", buffering=0) as file, suppress(OSError):
        while file.write(bytes(1 << 16)):
            pass
    with path.with_name("rest").open("wb", buffering=0) as file, suppress(OSError):
        while file.write(b"."):
            pass
    assert os.statvfs(path).f_bavail == 0


@pytest.mark.parametrize("times", first(1, [2, 1]))
def test_where_nothing_can_be_written_any_more_it_commands_again(
    flight: Flight, tmp_path: Path, record_property: Callable[[str, object], None], times: int
) -> None:
    """Logs, state and the storage in memory are full; once, and once more."""
    probe = ["unshare", "-m", "mount", "-t", "tmpfs", "none", str(tmp_path)]
    if os.geteuid() != 0 or subprocess.run(probe, capture_output=True, check=False).returncode != 0:
        pytest.skip("only root, in a mount namespace, can make a disk that is full")
    flight.prefix = ["unshare", "-m", "sh", "-c", ON_SMALL_DISKS]
    flight.configure()
    flight.start()
    wait_for(lambda: flight.autopilot.held, flight.console)
    flight.autopilot.airborne = True
    wait_for(lambda: "On mission: airborne." in flight.console(), flight.console)
    time.sleep(0.5)
    inside = Path(f"/proc/{flight.processes[-1].pid}/root{tmp_path}")
    for folder in ("flights", "state", "memory"):
        fill(inside / folder / "filler")
    begun = len(flight.autopilot.held)
    time.sleep(3.0)
    times_held = [at for at, _nonce in flight.autopilot.held[begun:]]
    assert max(later - earlier for earlier, later in pairwise(times_held)) <= 0.4
    for _ in range(times):
        seconds = flight.killed()
        tell(record_property, seconds)
        assert seconds < SOON_S
        time.sleep(1.0)
    assert "restarted too often" not in flight.console()


# ---- loads that fail ------------------------------------------------------------------------------------------------


def test_an_autopilot_that_is_away_for_a_while_uses_up_no_restarts(
    flight: Flight, autopilot: Autopilot, record_property: Callable[[str, object], None]
) -> None:
    """MAVProxy ends when it cannot open its link to the autopilot, as when a cable is loose for some seconds."""
    flight.fly()
    nonces = flight.nonces()
    autopilot.stop()
    flight.kill()
    time.sleep(14.0)  # three loads of 4 s each, and their pauses
    autopilot.go_on()
    seconds = flight.commands_again(time.monotonic(), nonces)
    tell(record_property, seconds)
    assert "restarted too often" not in flight.console()
    assert "failed loads since then: " in flight.console()


HOLD = """
import fcntl, os, sys
held = os.open(sys.argv[1], os.O_RDONLY)
print("asks", flush=True)
fcntl.flock(held, fcntl.LOCK_EX)
print("held", flush=True)
sys.stdin.read()
"""


def test_a_lock_that_is_held_by_a_process_that_is_about_to_end_is_waited_for(
    flight: Flight, record_property: Callable[[str, object], None]
) -> None:
    flight.fly()
    nonces = flight.nonces()
    argv = [sys.executable, "-c", HOLD, str(flight.folder / "state" / "drone-1.lock")]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdin is not None
        # else the next companion may have the lock before this program asks for it, which then waits for ever
        assert holder.stdout.readline() == b"asks\n"
        flight.kill()
        assert holder.stdout.readline() == b"held\n"
        wait_for(lambda: "is locked: another companion of drone-1 is running" in flight.console(), flight.console)
        time.sleep(3.0)
        assert not [at for at, nonce in flight.autopilot.held if nonce not in nonces], "two judges"
        holder.stdin.close()
        holder.wait()
    seconds = flight.commands_again(time.monotonic(), nonces)
    tell(record_property, seconds)
    assert "restarted too often" not in flight.console()


def test_a_second_companion_that_is_started_in_flight_ends(flight: Flight) -> None:
    flight.fly()
    other = Autopilot()  # it has one line for one companion
    try:
        first, flight.autopilot = flight.autopilot, other
        second = flight.start()
        assert second.wait(30) == 2
        assert not other.leases(), "two judges"
        flight.autopilot = first
        held = len(first.held)
        wait_for(lambda: len(first.held) > held + 3, flight.console)
    finally:
        other.close()
