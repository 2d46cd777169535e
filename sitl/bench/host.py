# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's main loop around one of our modules, without MAVProxy: so that many vehicles and stations fit in a
process.

The modules are the real ones, with their real sockets, journals and configurations. What is MAVProxy's own is here as
far as the modules touch it: `mpstate`, idle tasks in every round and at least 100 times a second, sockets of modules
in the same select. Not here: logs, other modules, and the time they take.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

from MAVProxy.modules.lib.mp_settings import MPSetting, MPSettings

from sitl.bench.loop import BenchError, Loop

__all__ = ["IDLE_S", "Host"]

#: MAVProxy's select_timeout
IDLE_S = 0.01


class _Console:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def writeln(self, text: str, fg: str = "black", bg: str = "white") -> None:
        self.lines.append(str(text))
        del self.lines[:-20]

    def set_status(self, name: str, text: str = "", row: int = 0, fg: str = "black", bg: str = "white") -> None:
        """Nothing is shown."""


class _NoLog:
    """MAVProxy's log queue, which a writer would empty."""

    def put(self, data: bytes) -> None:
        """Gone."""


class Host:
    """One module in its MAVProxy. `master` is MAVProxy's link to the vehicle's side: it needs `write(bytes)`."""

    def __init__(self, loop: Loop, master: Any, sysid: int, component: int) -> None:
        self.console = _Console()
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
        self.logqueue = _NoLog()
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
