# SPDX-License-Identifier: GPL-3.0-or-later

"""Stock MAVProxy processes and our modules, as installed: what a user types and sees."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.cli.launch import companion_argv, mavproxy, station_argv
from mavproxy_handover.version import VERSION

pytestmark = pytest.mark.process

LIMIT_S = 20.0


def wait_for(condition: Callable[[], Any], what: Callable[[], str]) -> None:
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end, what()
        time.sleep(0.02)


class Autopilot:
    """Sends heartbeats to whoever connects, and keeps what comes back."""

    def __init__(self) -> None:
        self.received: list[Any] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.05)
        self.master = f"tcp:127.0.0.1:{self._server.getsockname()[1]}"
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        own, parser = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), mavlink.MAVLink(None)
        parser.robust_parsing = True
        connection = None
        beat_at = 0.0
        while not self._done.is_set():
            try:
                if connection is None:
                    connection, _address = self._server.accept()
                    connection.settimeout(0.02)
                if time.monotonic() >= beat_at:
                    beat_at = time.monotonic() + 0.25
                    connection.sendall(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3).pack(own))
                data = connection.recv(65536)
                self.received += parser.parse_buffer(data) or []
                if not data:
                    connection.close()
                    connection = None
            except TimeoutError:
                continue
            except OSError:  # that MAVProxy has ended
                if connection is not None:
                    connection.close()
                connection = None
        if connection is not None:
            connection.close()
        self._server.close()

    def leases(self) -> int:
        """Leases that have arrived from the companion's component."""
        return sum(
            m.get_type() == "TUNNEL"
            and m.payload_type == 47116
            and (m.get_srcSystem(), m.get_srcComponent()) == (1, 191)
            for m in list(self.received)
        )

    def close(self) -> None:
        self._done.set()
        self._thread.join()


class MavProxy:
    """One MAVProxy process: type into it, see what it shows."""

    def __init__(self, command: list[str], folder: Path, environment: dict[str, str] | None = None) -> None:
        self.lines: list[str] = []
        kept = {name: value for name, value in os.environ.items() if name not in ("HANDOVER_CONFIG", "DISPLAY")}
        self._process = subprocess.Popen(
            command,
            cwd=folder,
            env={**kept, "HOME": str(folder), "PYTHONUNBUFFERED": "1", **(environment or {})},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.lines.append(line.rstrip("\n"))

    def shows(self, text: str, start: int = 0) -> str:
        """Wait for a line that holds `text`, from line `start` on; returns that line from `text` on."""
        wait_for(
            lambda: any(text in line for line in self.lines[start:]),
            lambda: f"MAVProxy never showed {text!r} but:\n" + "\n".join(self.lines[start:]),
        )
        found = next(line for line in self.lines[start:] if text in line)
        return found[found.index(text) :]

    def type(self, line: str) -> int:
        """Type a line; returns the number of the next line that will be shown."""
        assert self._process.stdin is not None
        start = len(self.lines)
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return start

    def answer(self, line: str, text: str) -> str:
        """Type a line and wait for what it must show."""
        return self.shows(text, self.type(line))

    def alive(self) -> None:
        """It still takes commands."""
        self.answer("still there", "Unknown command 'still there'")

    def end(self) -> str:
        """Close its input, which ends it, and wait; returns everything that was shown."""
        assert self._process.stdin is not None
        if not self._process.stdin.closed:
            self._process.stdin.close()
        try:
            self._process.wait(timeout=15)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            pytest.fail("MAVProxy does not end: " + "\n".join(self.lines[-10:]))
        finally:
            self._reader.join()
            assert self._process.stdout is not None
            self._process.stdout.close()
        return "\n".join(self.lines)


@pytest.fixture
def autopilot() -> Iterator[Autopilot]:
    autopilot = Autopilot()
    yield autopilot
    autopilot.close()


@pytest.fixture
def start(autopilot: Autopilot, tmp_path: Path) -> Iterator[Callable[..., MavProxy]]:
    """Starts a stock MAVProxy with few modules; `options` are added to its command line."""
    running: list[MavProxy] = []

    def start(*options: str, command: list[str] | None = None, **environment: str) -> MavProxy:
        stock = [
            *mavproxy(),
            f"--master={autopilot.master}",
            "--default-modules=link,signing,output",
            "--streamrate=-1",
        ]
        running.append(MavProxy(command or [*stock, *options], tmp_path, environment))
        running[-1].shows("Detected vehicle 1:1")
        return running[-1]

    yield start
    for process in running:
        process.end()


@pytest.fixture
def station_port() -> Iterator[int]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        yield station.getsockname()[1]


def vehicle_file(path: Path, port: int, kind: str = "udpout", more: str = "") -> Path:
    path.write_text(
        f"""
        [vehicle]
        name = "drone-1"
        parent = "GCSA"
        journal = "companion.jsonl"
        guard = false
        allow_unsigned = true
        {more}
        [[station]]
        name = "GCSA"
        sysid = 251
        links = ["{kind}:127.0.0.1:{port}"]
        """
    )
    return path


def station_file(path: Path) -> Path:
    path.write_text('[station]\nname = "GCSA"\nsysid = 251\njournal = "GCSA.jsonl"\n')
    return path


NO_CONFIGURATION = (
    'handover is not loaded: no configuration: looked for module load handover:{"config":"FILE"} (no spaces in it), '
    "$HANDOVER_CONFIG, ./handover.toml, /etc/handover/vehicle.toml; the shell's 'handover init vehicle' writes one"
)


def test_what_cannot_be_loaded_is_told_in_one_line_and_mavproxy_lives(
    start: Callable[..., MavProxy], autopilot: Autopilot, station_port: int, tmp_path: Path
) -> None:
    if Path("/etc/handover/vehicle.toml").exists():
        pytest.skip("this machine has a configuration in /etc/handover")
    console = start()
    head = "handover is not loaded: "
    assert console.answer("module load handover", head) == NO_CONFIGURATION

    spaces = vehicle_file(tmp_path / "x y.toml", station_port)
    assert console.answer(f'module load handover:{{"config":"{spaces}"}}', head) == NO_CONFIGURATION

    broken = tmp_path / "broken.toml"
    broken.write_text("[vehicle\n")
    line = console.answer(f'module load handover:{{"config":"{broken}"}}', head)
    assert line.startswith(f"{head}{broken}: not valid TOML: ")

    misspelt = vehicle_file(tmp_path / "misspelt.toml", station_port, more="gaurd = true")
    line = console.answer(f'module load handover:{{"config":"{misspelt}"}}', head)
    assert line == f"{head}{misspelt}: [vehicle] gaurd: unknown key; did you mean 'guard'?"

    taken = vehicle_file(tmp_path / "taken.toml", station_port, kind="udpin")
    line = console.answer(f'module load handover:{{"config":"{taken}"}}', head)
    assert line == f"{head}link udpin:127.0.0.1:{station_port} cannot be opened: Address already in use"

    assert console.answer('module load handover:{"config":5}', head).startswith(f"{head}argument config: 5 must be")
    assert console.answer('module load handover:{"cfg":"x"}', head).startswith(f"{head}unknown argument cfg; ")
    console.alive()
    assert autopilot.leases() == 0
    shown = console.end()
    assert "Traceback" not in shown.split("Unloading module")[0]


def test_load_unload_reload_and_load_again(
    start: Callable[..., MavProxy], autopilot: Autopilot, station_port: int, tmp_path: Path
) -> None:
    file = vehicle_file(tmp_path / "handover.toml", station_port)
    console = start()
    assert console.answer("module load handover", f"handover {VERSION}: ") == (
        f"handover {VERSION}: drone-1, stations GCSA, configuration {file}"
    )
    console.shows("Loaded module handover")
    wait_for(lambda: autopilot.leases() > 3, lambda: "no leases came")
    assert console.answer("set mavfwd", "mavfwd ") == "mavfwd False"
    assert console.answer("set heartbeat", "heartbeat ") == "heartbeat 0"

    start_of_status = console.type("handover status")
    assert console.shows("commander", start_of_status) == "commander nobody, epoch 0, lease LOST"
    assert console.answer("handover foo", "handover: ") == "handover: unknown command 'foo'"
    assert console.answer("help", "handover ").startswith("handover        : authority handover")
    assert console.answer("output add 127.0.0.1:9", "handover: output ") == (
        "handover: output 127.0.0.1:9 is closed: stations belong in the configuration"
    )

    console.answer("module reload handover", "Reloaded module handover")
    reloaded = autopilot.leases()
    wait_for(lambda: autopilot.leases() > reloaded + 3, lambda: "no leases came after reload")

    console.answer("module unload handover", "Unloaded module handover")
    assert console.answer("set mavfwd", "mavfwd ") == "mavfwd True"
    assert console.answer("set heartbeat", "heartbeat ") in ("heartbeat 1", "heartbeat 1.0")
    console.answer("handover", "Unknown command 'handover'")
    unloaded = autopilot.leases()
    wait_for(
        lambda: sum(m.get_type() == "HEARTBEAT" and m.get_srcSystem() == 255 for m in list(autopilot.received)) > 1,
        lambda: "MAVProxy's own heartbeat did not come back",
    )
    assert autopilot.leases() == unloaded

    console.answer("module load handover", "Loaded module handover")
    wait_for(lambda: autopilot.leases() > unloaded + 3, lambda: "no leases came after the second load")
    console.end()
    events = [json.loads(line)["event"] for line in (tmp_path / "companion.jsonl").read_text().splitlines()]
    assert (events.count("loaded"), events.count("unloaded")) == (3, 3), "the end of MAVProxy unloads it too"
    assert "fault" not in events


def test_it_loads_from_the_command_line_with_the_configuration_named_by_the_environment(
    start: Callable[..., MavProxy], autopilot: Autopilot, station_port: int, tmp_path: Path
) -> None:
    file = vehicle_file(tmp_path / "named.toml", station_port)
    console = start("--load-module=handover", HANDOVER_CONFIG=str(file))
    console.shows(f"configuration {file}")
    wait_for(lambda: autopilot.leases() > 3, lambda: "no leases came")


def test_a_default_module_that_cannot_be_loaded_does_not_end_mavproxy(
    start: Callable[..., MavProxy], tmp_path: Path
) -> None:
    """MAVProxy loads its default modules without a net: an exception there ends it."""
    console = start("--default-modules=link,handover,handover_gcs", HANDOVER_CONFIG=str(tmp_path / "missing.toml"))
    console.shows(f"handover is not loaded: {tmp_path / 'missing.toml'}: no such file")
    console.shows("handover_gcs is not loaded: no configuration: ")
    console.alive()


def test_it_does_not_load_beside_an_output(start: Callable[..., MavProxy], station_port: int, tmp_path: Path) -> None:
    vehicle_file(tmp_path / "handover.toml", station_port)
    console = start("--out=127.0.0.1:9")
    line = console.answer("module load handover", "handover is not loaded: ")
    assert line.startswith("handover is not loaded: MAVProxy has outputs (127.0.0.1:9): ")


def test_the_stations_module_loads_unloads_and_reloads(start: Callable[..., MavProxy], tmp_path: Path) -> None:
    console = start()
    assert console.answer("module load handover_gcs", "handover_gcs is not loaded: ").startswith(
        'handover_gcs is not loaded: no configuration: looked for module load handover_gcs:{"config":"FILE"} '
    )
    file = station_file(tmp_path / "station.toml")
    assert console.answer("module load handover_gcs", f"handover_gcs {VERSION}: ").endswith(f"configuration {file}")
    assert console.answer("set source_system", "source_system ") == "source_system 251"
    console.answer("handover status", "vehicle   not heard, ON_LOAD")
    assert console.answer("module load handover", "handover is not loaded: ").endswith(
        "vehicle and station need a MAVProxy each"
    )
    console.answer("module reload handover_gcs", "Reloaded module handover_gcs")
    console.answer("module unload handover_gcs", "Unloaded module handover_gcs")
    assert console.answer("set source_system", "source_system ") == "source_system 255"
    console.alive()


def test_the_command_line_of_the_companion_works(
    start: Callable[..., MavProxy], autopilot: Autopilot, station_port: int, tmp_path: Path
) -> None:
    file = vehicle_file(tmp_path / "vehicle.toml", station_port)
    console = start(command=companion_argv(file, autopilot.master, tmp_path / "companion.tlog"))
    console.shows("Loaded module handover")
    wait_for(lambda: autopilot.leases() > 3, lambda: "no leases came")
    senders = {(m.get_srcSystem(), m.get_srcComponent()) for m in autopilot.received if m.get_type() != "BAD_DATA"}
    assert senders == {(1, 191)}, "everything is said as the vehicle's companion"
    assert not any(m.get_type() == "REQUEST_DATA_STREAM" for m in autopilot.received)
    console.end()
    assert (tmp_path / "companion.tlog").exists()


def test_the_command_line_of_a_station_works(
    start: Callable[..., MavProxy], autopilot: Autopilot, tmp_path: Path
) -> None:
    file = station_file(tmp_path / "station.toml")
    console = start(command=station_argv(file, autopilot.master, tmp_path / "station.tlog"))
    console.shows("Loaded module handover_gcs")
    console.answer("handover status", "this station is observer")
    wait_for(
        lambda: any(m.get_type() == "HEARTBEAT" for m in list(autopilot.received)),
        lambda: "no heartbeat of the station came",
    )
    beats = {(m.get_srcSystem(), m.get_srcComponent()) for m in autopilot.received if m.get_type() == "HEARTBEAT"}
    assert beats == {(251, 190)}
