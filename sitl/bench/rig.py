# SPDX-License-Identifier: GPL-3.0-or-later

"""Two MAVProxy processes under the same load: the companion, and a stock MAVProxy with one `--out` a station.

Both are the installed MAVProxy with the same options (those of `handover companion`), the stock one without our module
and with its own heartbeat; if it is to be as it comes, with the modules that it loads by itself, too. Each has an
autopilot at a serial line (a pseudo-terminal) and stations of its own; the companion's parent commands, its mission is
loaded, and its aircraft is in the air, in the parent's zone.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from mavproxy_handover.cli.launch import companion_argv
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.store.keys import key_path, write_key
from mavproxy_handover.tools.resources import shipped
from sitl.bench.autopilot import SerialAutopilot
from sitl.bench.loop import BenchError, Loop, cpu_s
from sitl.bench.station import FakeStation
from sitl.bench.traffic import VEHICLE, Place
from sitl.run.processes import Processes

__all__ = ["IN_ZONE_A", "PARENT", "Proxy", "Rig", "key_file", "key_for", "make_stations", "toml", "write_config"]

PARENT = 251
#: in the delivery mission, inside the zone of GCSA and of no other; flying along
IN_ZONE_A = Place(52.6792, 5.9240, 30.0, 3.0, 4.0)
_START_LIMIT_S = 30.0


def toml(tables: dict[str, Any]) -> str:
    """Tables and lists of tables as TOML text; JSON's values are TOML's as well."""
    lines: list[str] = []
    for name, value in tables.items():
        for table in value if isinstance(value, list) else [value]:
            lines.append(f"[[{name}]]" if isinstance(value, list) else f"[{name}]")
            lines += [f"{key} = {json.dumps(entry)}" for key, entry in table.items()]
            lines.append("")
    return "\n".join(lines)


def key_for(station: str) -> bytes:
    """The key of a station, for measurements only: it is used only on loopback."""
    return hashlib.sha256(f"bench {station}".encode()).digest()


def key_file(folder: Path, station: str) -> Path:
    """The file with that key, made if needed. Raises KeysError."""
    path = key_path(folder, station)
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        write_key(path, key_for(station))
    return path


def write_config(folder: Path, stations: Sequence[FakeStation], *, signing: bool = False, guard: bool = False) -> Path:
    """The companion's configuration file for these stations; the first is the parent. Raises OSError, KeysError."""
    folder.mkdir(parents=True, exist_ok=True)
    entries = []
    for station in stations:
        entry: dict[str, Any] = {
            "name": station.name,
            "sysid": station.sysid,
            "links": [f"udpout:127.0.0.1:{station.port}"],
        }
        if signing:
            entry["key"] = str(key_file(folder / "keys", station.name))
        entries.append(entry)
    tables: dict[str, Any] = {
        "vehicle": {
            "name": "drone-1",
            "sysid": VEHICLE,
            "parent": stations[0].name,
            "journal": "companion.jsonl",
            "guard": guard,
            "allow_unsigned": not signing,
        },
        "station": entries,
        "policy": {"out_of_coverage": "warn", "commander_lost": "warn"},
    }
    path = folder / "handover.toml"
    path.write_text(toml(tables), encoding="utf-8")
    return path


def make_stations(loop: Loop, count: int, *, signing: bool = False) -> list[FakeStation]:
    """A number of stations, the first of them the parent. Raises OSError."""
    names = [f"GCS{chr(ord('A') + number)}" for number in range(count)]
    return [
        FakeStation(loop, name, _sysid(number), key_for(name) if signing else None) for number, name in enumerate(names)
    ]


def _sysid(number: int) -> int:
    """System ids of stations: those of the project's missions, then others."""
    return PARENT + number if number < 4 else 200 + number


class Proxy:
    """One MAVProxy process under test, its autopilot and its stations."""

    def __init__(self, loop: Loop, processes: Processes, folder: Path, name: str, stations: int, signing: bool) -> None:
        self.name = name
        self.autopilot = SerialAutopilot(loop, IN_ZONE_A)
        self.stations = make_stations(loop, stations, signing=signing)
        self._loop = loop
        self._processes = processes
        self._folder = folder
        self._child: Any = None

    def start(self, argv: Sequence[str]) -> None:
        """Start the process and wait until it has connected to the autopilot. Raises BenchError."""
        self._child = self._processes.start(self.name, argv, self._folder)
        self.autopilot.model.stream(0)
        self._wait(lambda: self.autopilot.connected, "MAVProxy connects")
        self._wait(lambda: all(station.heard for station in self.stations), "every station hears the vehicle")

    def _wait(self, condition: Any, what: str) -> None:
        try:
            self._loop.run_until(lambda: condition() or not self._child.alive(), _START_LIMIT_S, what)
            if not self._child.alive():
                raise BenchError(f"{what}: the process has ended")
        except BenchError as error:
            tail = " | ".join(self._child.console()[-5:])
            raise BenchError(f"{self.name}: {error} (console: {tail})") from None

    def establish(self) -> None:
        """Make the companion fly: parent in command, mission loaded, armed and airborne. Raises BenchError."""
        parent = self.stations[0]
        model = self.autopilot.model
        model.stream(50)
        self._wait(lambda: parent.commander == PARENT, "the parent commands")
        package = mission_package.load(shipped("missions") / "delivery")
        parent.share(package)
        self._wait(lambda: parent.shared or parent.share_trouble, "the mission package is loaded")
        if parent.share_trouble:
            raise BenchError(f"{self.name}: mission package refused: {parent.share_trouble}")
        for station in self.stations:
            station.digest = package.digest
        model.take_off()
        self._wait(lambda: parent.phase == Phase.ON_MISSION, "the aircraft is on its mission")

    def fly(self) -> None:
        """Put the aircraft in the air; a stock MAVProxy ignores that."""
        self.autopilot.model.take_off()

    @property
    def pid(self) -> int:
        return int(self._child.pid)

    def cpu_s(self) -> float:
        """Processor time so far. Raises BenchError when the process is gone."""
        return cpu_s(self.pid)

    def check(self) -> None:
        """Raises BenchError if the process has ended, or another station than the parent commands."""
        if not self._child.alive():
            tail = " | ".join(self._child.console()[-5:])
            raise BenchError(f"{self.name}: the process has ended (console: {tail})")
        commander = self.stations[0].commander
        if commander not in (None, PARENT):
            raise BenchError(f"{self.name}: station {commander} commands in the middle of a measurement")

    def close(self) -> None:
        """Close all sockets; the owner of the process ends it."""
        for station in self.stations:
            station.close()
        self.autopilot.close()


class Rig:
    """Ours and the baseline, started and ready. Leaving the `with` block ends both."""

    def __init__(self, folder: Path, stations: int, signing: bool = False, as_it_comes: bool = False) -> None:
        """`signing`: every station signs with a key of its own; the companion checks, and signs what it gets.
        `as_it_comes`: the stock MAVProxy loads its default modules."""
        self.loop = Loop()
        self._number = 0
        self._folder = folder
        self._processes = Processes()
        self._signing = signing
        #: options of ours that the stock one does without
        self._ours_alone = ("--cmd=", "--heartbeat=", *(("--default-modules=",) if as_it_comes else ()))
        self.ours = Proxy(self.loop, self._processes, folder / "ours", "companion", stations, signing)
        self.baseline = Proxy(self.loop, self._processes, folder / "baseline", "stock", stations, signing)

    def __enter__(self) -> Rig:
        try:
            config = write_config(self._folder / "ours", self.ours.stations, signing=self._signing)
            ours = companion_argv(config, self._master(self.ours), self._folder / "ours" / "mav.tlog")
            outs = [f"--out=udp:127.0.0.1:{station.port}" for station in self.baseline.stations]
            stock = companion_argv(config, self._master(self.baseline), self._folder / "baseline" / "mav.tlog")
            self.ours.start(ours)
            self.ours.establish()
            self.baseline.start([*(word for word in stock if not word.startswith(self._ours_alone)), *outs])
            self.baseline.fly()
            for proxy in (self.ours, self.baseline):
                proxy.autopilot.model.stream(0)
            self.loop.run(1.0)
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def _close(self) -> None:
        self._processes.stop_all()
        self.ours.close()
        self.baseline.close()

    def next_number(self) -> int:
        """A number for the next uplink frame, never given before."""
        self._number += 1
        return self._number

    @staticmethod
    def _master(proxy: Proxy) -> str:
        return proxy.autopilot.device
