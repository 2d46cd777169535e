# SPDX-License-Identifier: GPL-3.0-or-later

"""The base of the benches: a loop, processes with their configurations, and our modules without MAVProxy.

`Loop` is one thread with many sockets and exact timers, in which fake autopilots and stations live. It waits by
`select.select` and not by epoll where it matters, because Python's epoll waits in whole milliseconds and frames are
sent a millisecond apart.

`Rig` has the processes of a bench. Waiting for something ends with what the processes said last.

`Host` is MAVProxy's main loop around one of our modules, without MAVProxy: so that many vehicles and stations fit in a
process. The modules are the real ones, with their real sockets, journals and configurations. What is MAVProxy's own is
here as far as the modules touch it: `mpstate`, idle tasks in every round and at least 100 times a second, sockets of
modules in the same select. Not here: logs, other modules, and the time they take.
"""

from __future__ import annotations

import hashlib
import heapq
import itertools
import select
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Final, TypeVar

from MAVProxy.modules.lib.mp_settings import MPSetting, MPSettings

from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.keys import key_path, write_key
from mavproxy_handover.tools.resources import shipped
from sitl.run.processes import Child, Processes
from sitl.run.wiring import write_toml

__all__ = [
    "AUTOPILOT",
    "IDLE_S",
    "VEHICLE",
    "BenchError",
    "Host",
    "Loop",
    "Rig",
    "Timer",
    "companion_config",
    "cpu_s",
    "frame_key",
    "key_file",
    "key_for",
    "last_words",
    "shipped_mission",
    "split",
    "station_config",
    "station_entry",
]

#: system id of the vehicle, component id of its autopilot
VEHICLE: Final = 1
AUTOPILOT: Final = 1
#: name of the key of the ground link
GROUND_KEY: Final = "ground"
#: MAVProxy's select_timeout
IDLE_S: Final = 0.01
_START_LIMIT_S: Final = 90.0

R = TypeVar("R", bound="Rig")


class BenchError(Exception):
    """A measurement cannot be made; one line for people."""


def cpu_s(pid: int) -> float:
    """Processor time of a process, user and system, all its threads, in seconds.

    The sum that /proc/PID/stat shows in hundredths of a second, from the process's own clock (clock_getcpuclockid of
    POSIX), which counts nanoseconds. Raises BenchError when there is no such process.
    """
    try:
        return time.clock_gettime((~pid << 3) | 2)
    except OSError as error:
        raise BenchError(f"processor time of process {pid}: {error.strerror}") from None


@dataclass(slots=True)
class Timer:
    """Something that happens again and again until it is cancelled."""

    interval_s: float
    job: Callable[[], None]
    due: float
    cancelled: bool = False

    def cancel(self) -> None:
        """No more."""
        self.cancelled = True


class Loop:
    """Runs timers and readers. Times are monotonic seconds."""

    #: a timer that is later than this skips what it missed instead of catching up
    CATCH_UP_S = 0.25

    def __init__(self, *, many: bool = False) -> None:
        """`many`: for hundreds of sockets. Waiting is then by epoll, and up to a millisecond too long."""
        self._epoll = select.epoll() if many else None
        self._readers: dict[int, Callable[[], None]] = {}
        self._timers: list[tuple[float, int, Timer]] = []
        self._clocks: list[Callable[[], float | None]] = []
        self._numbers = itertools.count()

    def add_reader(self, descriptor: int, job: Callable[[], None]) -> None:
        """Call `job` whenever there is something to read."""
        if self._epoll is not None and descriptor not in self._readers:
            self._epoll.register(descriptor, select.EPOLLIN)
        self._readers[descriptor] = job

    def remove_reader(self, descriptor: int) -> None:
        """Stop that; before the descriptor is closed."""
        if self._readers.pop(descriptor, None) is not None and self._epoll is not None:
            with suppress(OSError):  # its owner has closed it already: the system has forgotten it
                self._epoll.unregister(descriptor)

    def add_clock(self, job: Callable[[], float | None]) -> None:
        """Call `job` in every round.

        It returns in how many seconds it must be called again (None: it does not matter).
        """
        self._clocks.append(job)

    def remove_clock(self, job: Callable[[], float | None]) -> None:
        """Stop that."""
        self._clocks.remove(job)

    def every(self, interval_s: float, job: Callable[[], None], first_in_s: float = 0.0) -> Timer:
        """Call `job` every `interval_s`; a late call does not delay the next ones."""
        timer = Timer(interval_s, job, time.monotonic() + first_in_s)
        heapq.heappush(self._timers, (timer.due, next(self._numbers), timer))
        return timer

    def run(self, seconds: float) -> None:
        """Run for that long."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._round(until)

    def run_until(self, condition: Callable[[], bool], limit_s: float, what: str) -> None:
        """Run until `condition`. Raises BenchError, naming `what`, if that takes longer than `limit_s`."""
        until = time.monotonic() + limit_s
        while not condition():
            if time.monotonic() >= until:
                raise BenchError(f"{what}: not within {limit_s:g} s")
            self._round(min(until, time.monotonic() + 0.05))

    def _round(self, until: float) -> None:
        now = time.monotonic()
        while self._timers and self._timers[0][0] <= now < until:
            _due, _number, timer = heapq.heappop(self._timers)
            if timer.cancelled:
                continue
            timer.job()
            timer.due += timer.interval_s
            if now - timer.due > self.CATCH_UP_S:
                timer.due = now
            heapq.heappush(self._timers, (timer.due, next(self._numbers), timer))
            # a burst that catches up must not keep the receivers waiting
            if self._readers:
                self._read(0.0)
            now = time.monotonic()
        wait_s = until - now
        for clock in self._clocks:
            due_in_s = clock()
            if due_in_s is not None and due_in_s < wait_s:
                wait_s = due_in_s
        if self._timers:
            wait_s = min(wait_s, self._timers[0][0] - now)
        self._read(max(0.0, wait_s))

    def _read(self, wait_s: float) -> None:
        if self._epoll is None:
            ready, _, _ = select.select(list(self._readers), [], [], wait_s)
        else:
            ready = [descriptor for descriptor, _events in self._epoll.poll(wait_s)]
        for descriptor in ready:
            reader = self._readers.get(descriptor)
            if reader is not None:
                reader()


# ---- frames ---------------------------------------------------------------------------------------------------------


def split(data: bytes) -> tuple[list[bytes], bytes]:
    """Whole MAVLink frames in trusted bytes (of our own processes), and the rest that waits for more."""
    frames = []
    start, end = 0, len(data)
    while end - start >= 3:
        if data[start] == 0xFD:
            length = 12 + data[start + 1] + (13 if data[start + 2] & 1 else 0)
        elif data[start] == 0xFE:
            length = 8 + data[start + 1]
        else:
            start += 1
            continue
        if end - start < length:
            break
        frames.append(data[start : start + length])
        start += length
    return frames, data[start:]


def frame_key(raw: bytes) -> bytes:
    """The identity of a MAVLink 2 frame on its way, signed or not: sequence number, ids and payload."""
    return raw[4 : 10 + raw[1]]


# ---- configurations -------------------------------------------------------------------------------------------------


def shipped_mission(name: str) -> MissionPackage:
    """One of the missions that ship."""
    return mission_package.load(shipped("missions") / name)


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


def station_entry(name: str, sysid: int, port: int, key: Path | None = None) -> dict[str, Any]:
    """The companion's [[station]] for a station that listens at a UDP port; it signs if there is a key."""
    entry: dict[str, Any] = {"name": name, "sysid": sysid, "links": [f"udpout:127.0.0.1:{port}"]}
    return entry if key is None else {**entry, "key": str(key)}


def companion_config(
    folder: Path,
    stations: Sequence[dict[str, Any]],
    *,
    dwell_s: float | None = None,
    more: Mapping[str, Any] | None = None,
    **vehicle: Any,
) -> Path:
    """Write the companion's configuration file for these stations, the first the parent. Raises OSError.

    `dwell_s` 0: one transfer may follow the other at once. `more`: further tables. `vehicle`: what [vehicle] has
    besides.
    """
    own = {"name": "drone-1", "sysid": VEHICLE, "parent": stations[0]["name"], "journal": "companion.jsonl"}
    own |= {"guard": False, "allow_unsigned": not any("key" in station for station in stations), **vehicle}
    # a commander that is not heard for a while is no reason to fly home
    policy = {"out_of_coverage": "warn", "commander_lost": "warn"}
    tables: dict[str, Any] = {"vehicle": own, "station": list(stations), "policy": policy, **(more or {})}
    return write_toml(
        folder / "handover.toml", tables if dwell_s is None else {**tables, "limits": {"dwell_s": dwell_s}}
    )


def station_config(
    folder: Path,
    station: dict[str, Any],
    listen: int,
    peers: dict[str, tuple[int, int]],
    *,
    keys: Path | None,
    vehicles: Sequence[dict[str, Any]] = (),
) -> Path:
    """Write a station's configuration file. Raises OSError, KeysError.

    `listen`: port of its ground link; `peers`: name -> system id and port of another one's. `keys`: the folder of the
    ground link's key, if it is signed. `vehicles`: what [[vehicle]] has, if there are several.
    """
    own = {"journal": f"{station['name']}.jsonl", **station}
    ground: dict[str, Any] = {"listen": f"udpin:127.0.0.1:{listen}"}
    ground |= {"allow_unsigned": True} if keys is None else {"key": str(key_file(keys, GROUND_KEY))}
    others = [
        {"name": name, "sysid": sysid, "link": f"udpout:127.0.0.1:{port}"} for name, (sysid, port) in peers.items()
    ]
    tables = {"station": own, "ground": ground, "peer": others, "vehicle": list(vehicles)}
    return write_toml(folder / "station.toml", tables)


# ---- processes ------------------------------------------------------------------------------------------------------


class Rig:
    """The processes of a bench, and the loop of what runs beside them. Leaving the `with` block ends all of it."""

    def __init__(self, folder: Path, *, many: bool = False) -> None:
        """`many`: see `Loop`."""
        self.folder = folder
        self.loop = Loop(many=many)
        self.processes = Processes()

    def __enter__(self: R) -> R:
        try:
            self.set_up()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def set_up(self) -> None:
        """Start everything, and wait until it is ready. Raises BenchError, OSError."""
        raise NotImplementedError

    def close(self) -> None:
        """End the processes, then close all sockets."""
        self.processes.stop_all()

    def run(self, name: str, argv: Sequence[str]) -> Child:
        """Start a process in a folder of its own. Raises OSError."""
        return self.processes.start(name, argv, self.folder / name)

    def check(self) -> None:
        """Raises BenchError if the bench is broken: a process has ended."""
        for child in self.processes.dead():
            raise BenchError(f"{child.name} has ended: {last_words(child)}")

    def wait(
        self, condition: Callable[[], bool], what: str, limit_s: float = _START_LIMIT_S, every_s: float = 0.0
    ) -> None:
        """Run until the condition is true, which is asked `every_s`. Raises BenchError after `limit_s`."""
        next_look = 0.0

        def looked() -> bool:
            nonlocal next_look
            if time.monotonic() < next_look:
                return False
            next_look = time.monotonic() + every_s
            self.check()
            return condition()

        try:
            self.loop.run_until(looked, limit_s, what)
        except BenchError as error:
            told = "; ".join(f"{child.name} said: {last_words(child)}" for child in self.processes if child.alive())
            raise BenchError(f"{error} ({told})") from None


def last_words(child: Child) -> str:
    """The end of a process's console."""
    return " | ".join(child.console()[-5:])


# ---- modules without MAVProxy ---------------------------------------------------------------------------------------


class _Console:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def writeln(self, text: str, fg: str = "black", bg: str = "white") -> None:
        self.lines.append(str(text))
        del self.lines[:-20]

    def set_status(self, name: str, text: str = "", row: int = 0, fg: str = "black", bg: str = "white") -> None:
        """Nothing is shown."""


class _Prompt:
    """MAVProxy's prompt, which no operator sees here."""

    def set_prompt(self, text: str) -> None:
        """Nothing is shown."""


class Host:
    """One module in its MAVProxy. `master` is MAVProxy's link to the vehicle's side: it needs `write(bytes)`."""

    def __init__(self, loop: Loop, master: Any, sysid: int, component: int) -> None:
        self.console = _Console()
        self.rl = _Prompt()
        self.settings = MPSettings(
            [
                MPSetting("heartbeat", float, 1),
                MPSetting("mavfwd", bool, True),
                MPSetting("mavfwd_disarmed", bool, True),
                MPSetting("moddebug", int, 0),
                MPSetting("source_system", int, sysid),
                MPSetting("source_component", int, component),
                MPSetting("target_system", int, 0),
                MPSetting("target_component", int, 0),
            ]
        )
        self.command_map: dict[str, Any] = {}
        self.completions: dict[str, list[str]] = {"set": ["(SETTING)"]}
        self.completion_functions: dict[str, Any] = {}
        self.modules: list[tuple[Any, ModuleType]] = []
        self.public_modules: dict[str, Any] = {}
        self.multi_instance: dict[str, Any] = {}
        self.instance_count: dict[str, int] = {}
        self.select_extra: dict[int, tuple[Callable[[Any], None], Any]] = {}
        self.mav_outputs: list[Any] = []
        self.sysid_outputs: dict[int, Any] = {}
        self.mav_master = [master]
        self.mav_param: dict[str, float] = {}
        self.status = SimpleNamespace(logdir=None, exit=False)
        self.functions = SimpleNamespace(say=lambda text: None)
        self.logqueue = SimpleNamespace(put=lambda data: None)
        self._loop = loop
        self._watched: dict[int, Callable[[], None]] = {}
        self._idle_at = 0.0

    def master(self, _sysid: int = -1) -> Any:
        """MAVProxy's `mpstate.master()`."""
        return self.mav_master[0]

    def module(self, name: str) -> Any:
        """MAVProxy's `mpstate.module()`."""
        return self.public_modules.get(name)

    def load(self, package: ModuleType, config: str) -> Any:
        """`module load`; returns the module. Raises BenchError with the module's own words."""
        module = package.init(self, config=config)
        if module is None:
            raise BenchError("; ".join(self.console.lines) or f"{package.__name__} was not loaded")
        self.modules.append((module, package))
        self._watch()
        return module

    def type(self, line: str) -> None:
        """A command at the console."""
        word, *rest = line.split()
        self.command_map[word][0](rest)

    def deliver(self, message: Any) -> None:
        """A message has come in from the vehicle's side."""
        for module, _package in self.modules:
            module.mavlink_packet(message)
        self.idle()

    def idle(self) -> None:
        """One round of the main loop."""
        self._idle_at = time.monotonic()
        for module, _package in self.modules:
            module.idle_task()
        self._watch()

    def idle_if_due(self) -> None:
        """Make a round if the last one is long ago."""
        if time.monotonic() - self._idle_at >= IDLE_S:
            self.idle()

    def _watch(self) -> None:
        """Modules may open and close sockets at any time."""
        if self._watched.keys() == self.select_extra.keys():
            return
        for descriptor in [*self._watched]:
            if descriptor not in self.select_extra:
                self._loop.remove_reader(descriptor)
                del self._watched[descriptor]
        for descriptor in self.select_extra:
            if descriptor not in self._watched:
                self._watched[descriptor] = self._reader(descriptor)
                self._loop.add_reader(descriptor, self._watched[descriptor])

    def _reader(self, descriptor: int) -> Callable[[], None]:
        def read() -> None:
            handler = self.select_extra.get(descriptor)
            if handler is not None:
                handler[0](handler[1])
            self.idle()

        return read

    def unload(self) -> None:
        """Unload the module: its sockets are closed, its journal ends."""
        for module, _package in self.modules:
            module.unload()
        self.modules.clear()
        self.select_extra.clear()
        self._watch()
