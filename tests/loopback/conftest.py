# SPDX-License-Identifier: GPL-3.0-or-later

"""The ends that real processes talk with, and MAVProxy to type into."""

from __future__ import annotations

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

from mavproxy_handover.cli.launch import mavproxy

LIMIT_S = 60.0


def wait_for(condition: Callable[[], Any], what: Callable[[], str]) -> None:
    end = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < end, what()
        time.sleep(0.02)


class Autopilot:
    """Sends heartbeats to whoever connects, and keeps what comes back."""

    def __init__(self, sysid: int = 1) -> None:
        self._sysid = sysid
        self.received: list[Any] = []
        #: frames that it sends besides, as fast as they are taken
        self.flood = b""
        #: it says that it is armed, in AUTO and in the air
        self.airborne = False
        #: when each lease of a station that commands came (monotonic s), and the nonce of its run
        self.held: list[tuple[float, int]] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.05)
        self._address: tuple[str, int] = self._server.getsockname()
        self.master = f"tcp:127.0.0.1:{self._address[1]}"
        self._done, self._gone = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        own, parser = mavlink.MAVLink(None, srcSystem=self._sysid, srcComponent=1), mavlink.MAVLink(None)
        parser.robust_parsing = True
        connection = None
        beat_at = 0.0
        while not self._done.is_set():
            if self._gone.is_set():
                if connection is not None:
                    connection.close()
                    connection = None
                self._server.close()
                time.sleep(0.02)
                continue
            try:
                if self._server.fileno() < 0:
                    self._server = socket.create_server(self._address)
                    self._server.settimeout(0.05)
                if connection is None:
                    connection, _address = self._server.accept()
                    connection.settimeout(0.02)
                if time.monotonic() >= beat_at:
                    beat_at = time.monotonic() + 0.25
                    for message in self._state():
                        connection.sendall(message.pack(own))
                connection.sendall(self.flood)
                data = connection.recv(65536)
                self._take(parser.parse_buffer(data) or [])
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

    def _state(self) -> list[Any]:
        if not self.airborne:
            return [mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3)]
        return [
            mavlink.MAVLink_heartbeat_message(2, 3, 81 | 128, 3, 4, 3),
            mavlink.MAVLink_extended_sys_state_message(0, 2),
        ]

    def _take(self, messages: list[Any]) -> None:
        self.received += messages
        for m in messages:
            if m.get_type() == "TUNNEL" and m.payload_type == 47116 and m.payload[1] == 1:
                self.held.append((time.monotonic(), int.from_bytes(m.payload[4:8], "little")))

    def stop(self) -> None:
        """Nobody can connect any more, until `go_on`."""
        self._gone.set()

    def go_on(self) -> None:
        """It can be connected to again."""
        self._gone.clear()

    def leases(self) -> int:
        """Leases that have arrived from the companion's component."""
        return len(self.nonces())

    def nonces(self) -> list[int]:
        """The nonce of each of them: of the companion's run."""
        return [
            int.from_bytes(m.payload[4:8], "little")
            for m in list(self.received)
            if m.get_type() == "TUNNEL"
            and m.payload_type == 47116
            and (m.get_srcSystem(), m.get_srcComponent()) == (1, 191)
        ]

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
