# SPDX-License-Identifier: GPL-3.0-or-later

"""A machine that all is well with, below a folder: laid out by `handover install`, with a program, a user and a clock.

And the other ends of its links: something that speaks like an autopilot on TCP, stations on UDP.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover import cli
from mavproxy_handover.link.timesync import probe_answer
from mavproxy_handover.store.keys import write_key
from mavproxy_handover.tools.resources import shipped
from mavproxy_handover.wire.frames import FrameSplitter
from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer
from sitl.vehicles.ports import PortPicker

PACKAGES = ("MAVProxy", "future", "numpy", "pymavlink", "pyserial", "shapely", "tomli")
#: whom the service runs as, where a test may give files away
SERVICE_UID = 54321
ROOT_RUNS = os.geteuid() == 0
KEYS = {"GCSA": b"A" * 32, "GCSB": b"B" * 32}


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    picker = PortPicker()
    return picker.udp() if kind is socket.SOCK_DGRAM else picker.tcp()


@dataclass(frozen=True)
class Found:
    """What the doctor has said."""

    code: int
    report: dict[str, Any]

    def lines(self, level: str) -> list[str]:
        return [
            f"{each['check']}: {each['what']}: {each['found']} -> {each['do']}"
            for each in self.report["findings"]
            if each["level"] == level
        ]

    def of(self, check: str, level: str | None = None) -> list[str]:
        return [
            f"{each['what']}: {each['found']}"
            for each in self.report["findings"]
            if each["check"] == check and level in (None, each["level"])
        ]


class Machine:
    """Below `root`; `path` says where something of it lies."""

    def __init__(self, folder: Path, kind: str, text: str, *, device: str | None) -> None:
        self.root = folder / "root"
        self.kind = kind
        given = folder / "given"
        (given / "keys").mkdir(parents=True, mode=0o700)
        for name, key in KEYS.items():
            write_key(given / "keys" / f"{name}.key", key)
        name = "vehicle.toml" if kind == "companion" else "station.toml"
        (given / name).write_text(text)
        words = ["install", kind, "--config", str(given / name), "--program", "/opt/handover/bin/handover"]
        words += ["--root", str(self.root)] + ([] if device is None else ["--device", device])
        assert cli.main(words) == 0
        shutil.copytree(shipped("missions") / "delivery", self.path("srv/delivery"))
        self._program()
        self._started(kind)

    def path(self, name: str) -> Path:
        return self.root / name

    @property
    def config(self) -> Path:
        return self.path(f"etc/handover/{'vehicle' if self.kind == 'companion' else 'station'}.toml")

    def _program(self) -> None:
        """A virtual environment, as far as one looks at it."""
        prefix = self.path("opt/handover")
        packages = self.packages
        (prefix / "bin").mkdir(parents=True)
        for name in ("handover", "mavproxy.py"):
            (prefix / "bin" / name).write_text("#!/bin/sh\n")
            (prefix / "bin" / name).chmod(0o755)
        (prefix / "pyvenv.cfg").write_text("home = /usr/bin\nversion = 3.11.2\n")
        for name in PACKAGES:
            version = "2.0.1" if name == "tomli" else metadata.version(name)
            self.has_package(name, version)
        ours = packages / "mavproxy_handover-0.1.0.dist-info"
        ours.mkdir()
        text = metadata.distribution("mavproxy-handover").read_text("METADATA")
        assert text is not None
        (ours / "METADATA").write_text(text)
        for file, text in (
            ("handover.py", "from mavproxy_handover.supervision.must_load import starter\n"),
            ("handover_gcs.py", "from mavproxy_handover.supervision.must_load import starter\n"),
            ("handover_dialect.pth", "import handover_dialect\n"),
            ("mavproxy_handover/data/dialect/handover.py", ""),
        ):
            (packages / file).parent.mkdir(parents=True, exist_ok=True)
            (packages / file).write_text(text)

    @property
    def packages(self) -> Path:
        return self.path("opt/handover/lib/python3.11/site-packages")

    def has_package(self, name: str, version: str) -> None:
        """The package is installed in this version, and in no other."""
        for old in self.packages.glob(f"{name}-*.dist-info"):
            shutil.rmtree(old)
        info = self.packages / f"{name}-{version}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")

    def _started(self, kind: str) -> None:
        """What systemd makes when the machine starts."""
        uid = SERVICE_UID if ROOT_RUNS else os.geteuid()
        self.path("etc/passwd").write_text(f"root:x:0:0::/root:/bin/sh\nhandover:x:{uid}:{uid}::/:/bin/false\n")
        self.path("etc/group").write_text(f"handover:x:{uid}:\n")
        wants = self.path("etc/systemd/system/multi-user.target.wants")
        wants.mkdir()
        (wants / f"handover-{kind}.service").symlink_to(f"../handover-{kind}.service")
        self.path("run/systemd/timesync").mkdir(parents=True)
        self.path("run/systemd/timesync/synchronized").touch()
        self.path("var/lib/handover").mkdir(parents=True, exist_ok=True)
        self.path("var/lib/handover").chmod(0o750)
        self.path("etc/handover").chmod(0o750)
        if ROOT_RUNS:
            for path in (self.path("etc/handover"), self.path("etc/handover/keys"), self.config):
                os.chown(path, 0, uid)
            for path in (self.path("var/lib/handover"), *self.path("etc/handover/keys").iterdir()):
                os.chown(path, uid, uid)

    def doctor(self, capsys: pytest.CaptureFixture[str], *words: str) -> Found:
        capsys.readouterr()
        code = cli.main(["doctor", self.kind, "--root", str(self.root), "--json", *words])
        report = json.loads(capsys.readouterr().out)
        assert report["exit"] == code
        return Found(code, report)


def companion(folder: Path, device: str, ports: dict[str, int], listens: int | None = None, more: str = "") -> Machine:
    """A companion with two stations, each at its port; of the second one a link that the companion listens on."""
    second = "" if listens is None else f', "udpin:127.0.0.1:{listens}"'
    text = f"""
        [vehicle]
        name = "drone-1"
        parent = "GCSA"
        journal = "/var/lib/handover/handover.jsonl"
        state = "/var/lib/handover/state"
        mission = "/srv/delivery"
        {more}
        [[station]]
        name = "GCSA"
        sysid = 251
        links = ["udpout:127.0.0.1:{ports["GCSA"]}"]
        key = "keys/GCSA.key"
        [[station]]
        name = "GCSB"
        sysid = 252
        links = ["udpout:127.0.0.1:{ports["GCSB"]}"{second}]
        key = "keys/GCSB.key"
        """
    return Machine(folder, "companion", text, device=device)


class Server:
    """A thread with a loop; `close` ends it."""

    def __init__(self) -> None:
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def start(self) -> None:
        self._thread.start()

    def _run(self) -> None:
        while not self._done.is_set():
            self._once()

    def _once(self) -> None:
        raise NotImplementedError

    def close(self) -> None:
        self._done.set()
        self._thread.join()


class Speaker(Server):
    """Says the same, over and over, to whoever connects by TCP; keeps what comes back."""

    def __init__(self, frames: Callable[[], bytes]) -> None:
        super().__init__()
        self.received = b""
        #: how often somebody has connected
        self.visits = 0
        self._frames = frames
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.05)
        self._client: socket.socket | None = None
        self.device = f"tcp:127.0.0.1:{self._server.getsockname()[1]}"
        self.start()

    def _once(self) -> None:
        try:
            if self._client is None:
                self._client, _address = self._server.accept()
                self._client.settimeout(0.1)
                self.visits += 1
            self._client.sendall(self._frames())
            data = self._client.recv(65536)
            self.received += data
            if not data:
                self._gone()
        except TimeoutError:
            return
        except OSError:
            self._gone()

    def _gone(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def close(self) -> None:
        super().close()
        self._gone()
        self._server.close()


def heartbeat(sysid: int = 1, *, armed: bool = False) -> bytes:
    """Of a copter."""
    own = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)
    return bytes(mavlink.MAVLink_heartbeat_message(2, 3, 81 | (128 if armed else 0), 0, 3, 3).pack(own))


class Station(Server):
    """What `handover_gcs` does on a link: heartbeats, and answers to probes, signed. `to`: a port of the vehicle's."""

    def __init__(self, sysid: int, key: bytes, port: int, to: int | None = None) -> None:
        super().__init__()
        self.port = port
        self._peer = SignedPeer(key)
        self._own = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=190)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(0.05)
        self._to = {("127.0.0.1", to)} if to is not None else set()
        self._beat_at = 0.0
        #: components of the vehicle whose frames came with a good signature
        self.heard: set[tuple[int, int]] = set()
        self.start()

    def _once(self) -> None:
        if time.monotonic() >= self._beat_at:
            self._beat_at = time.monotonic() + 0.25
            self._send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        try:
            data, address = self._socket.recvfrom(2048)
        except (TimeoutError, ConnectionError):
            return
        self._to.add(address)
        for frame in FrameSplitter().feed(data):
            if self._peer.check(frame, time.time(), time.monotonic()) is SignatureVerdict.OK:
                self.heard.add((frame.msgid, frame.compid))
                answer = probe_answer(frame, time.monotonic_ns())
                if answer is not None:
                    self._send(answer)

    def _send(self, message: Any) -> None:
        data = self._peer.sign(bytes(message.pack(self._own)), 0, time.time(), time.monotonic())
        assert data is not None
        for address in list(self._to):
            self._socket.sendto(data, address)

    def close(self) -> None:
        super().close()
        self._socket.close()
