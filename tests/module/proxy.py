# SPDX-License-Identifier: GPL-3.0-or-later

"""A MAVProxy for tests: as little of its `mpstate` as a module touches, behaving as MAVProxy 1.8.74 does there.

What matters and is kept: a module that is loaded twice is left alone, `init` that returns no module is a failed load,
`unload` runs in a thread, an exception out of `idle_task` or `mavlink_packet` is swallowed without a word, one out of a
`select_extra` handler costs the handler its socket, and nobody selects on sockets while there is no master. Swallowed
exceptions are kept in `escaped`, which must stay empty.
"""

from __future__ import annotations

import select
import threading
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

from MAVProxy.modules.lib.mp_module import MPModule
from MAVProxy.modules.lib.mp_settings import MPSetting, MPSettings
from pymavlink.dialects.v20 import ardupilotmega as stock


class Console:
    """MAVProxy's text console."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.statuses: dict[str, str] = {}
        #: the same with its colours: of the words, and behind them
        self.looks: dict[str, tuple[str, str, str]] = {}

    def writeln(self, text: str, fg: str = "black", bg: str = "white") -> None:
        self.lines.append(str(text))

    def set_status(self, name: str, text: str = "", row: int = 0, fg: str = "black", bg: str = "white") -> None:
        self.statuses[name] = text
        self.looks[name] = text, fg, bg

    def said(self, part: str) -> bool:
        return any(part in line for line in self.lines)


class Master:
    """The link to the vehicle's side; `write` gets what the module sends there, packed by itself or by `mav`.

    `label`: as `--master=DEVICE:{"label":...}` gives it; without one there is no such attribute, as in MAVProxy.
    """

    def __init__(self, label: str | None = None, address: str = "udpin:127.0.0.1:14550") -> None:
        self.address = address
        if label is not None:
            self.label = label
        self.linkerror = False
        self.written: list[bytes] = []
        self.broken: Exception | None = None
        self.mav = stock.MAVLink(self, srcSystem=255, srcComponent=230)

    def write(self, data: bytes) -> None:
        if self.broken is not None:
            raise self.broken
        self.written.append(bytes(data))


class Output:
    """A `--out` link."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.closed = False

    def close(self) -> None:
        self.closed = True


class MPState:
    """MAVProxy's global state and the parts of its main loop that call modules."""

    def __init__(self) -> None:
        self.console = Console()
        self.settings = MPSettings(
            [
                MPSetting("heartbeat", float, 1, range=(0, 100)),
                MPSetting("mavfwd", bool, True),
                MPSetting("mavfwd_disarmed", bool, True),
                MPSetting("moddebug", int, 0),
                MPSetting("source_system", int, 255, range=(0, 255)),
                MPSetting("source_component", int, 230, range=(0, 255)),
                MPSetting("link", int, 1),
                MPSetting("target_system", int, 0, range=(0, 255)),
                MPSetting("target_component", int, 0, range=(0, 255)),
                MPSetting("vehicle_name", str, ""),
            ]
        )
        self.prompts: list[str] = []
        self.rl = SimpleNamespace(set_prompt=self.prompts.append)
        self.command_map: dict[str, tuple[Callable[[list[str]], None], str]] = {}
        self.completions: dict[str, list[str]] = {"set": ["(SETTING)"]}
        self.completion_functions: dict[str, Any] = {"(SETTING)": self.settings.completion}
        self.modules: list[tuple[Any, ModuleType]] = []
        self.public_modules: dict[str, Any] = {}
        self.multi_instance: dict[str, Any] = {}
        self.instance_count: dict[str, int] = {}
        self.select_extra: dict[int, tuple[Callable[[Any], None], Any]] = {}
        self.mav_outputs: list[Output] = []
        self.sysid_outputs: dict[int, Output] = {}
        self.status = SimpleNamespace(logdir=None, exit=False)
        self.spoken: list[str] = []
        self.functions = SimpleNamespace(say=self.spoken.append)
        self.mav_master: list[Master] = [Master()]
        self.printed: list[str] = []
        self.escaped: list[Exception] = []

    def master(self) -> Master | None:
        return self.mav_master[self.settings.link - 1] if self.mav_master else None

    def module(self, name: str) -> Any:
        return self.public_modules.get(name)

    def connect(self, *masters: Master) -> None:
        """These links and no others, wired as MAVProxy's module `link` does it, which brings the command `vehicle`."""
        self.mav_master[:] = masters
        for master in masters:
            master.mav.set_callback(lambda message, _master: self.deliver(message), master)
        self.command_map["vehicle"] = (self._choose_vehicle, "set the vehicle")

    def _choose_vehicle(self, args: list[str]) -> None:
        """MAVProxy sets the first link where no heartbeat of the vehicle has come yet."""
        self.settings.target_system = int(args[0].split(":")[0])
        self.settings.link = 1

    # ---- commands of MAVProxy -----------------------------------------------------------------------------------

    def load(self, name: str, package: ModuleType, **kwargs: Any) -> Any:
        """`module load NAME`; returns the module, or None."""
        if any(module.name == name for module, _package in self.modules):
            self.printed.append(f"module {name} already loaded")
            return None
        module = package.init(self, **kwargs)
        if not isinstance(module, MPModule):
            self.printed.append(f"Failed to load module: {name}.init did not return a MPModule instance.")
            return None
        self.modules.append((module, package))
        self.printed.append(f"Loaded module {name}")
        return module

    def unload(self, name: str) -> bool:
        """`module unload NAME`."""
        for entry in self.modules:
            if entry[0].name == name:
                thread = threading.Thread(target=entry[0].unload)
                thread.start()
                thread.join(timeout=5)
                assert not thread.is_alive(), f"unload on module {name} did not complete"
                self.modules.remove(entry)
                self.public_modules.pop(name, None)
                return True
        self.printed.append(f"Unable to find module {name}")
        return False

    def type(self, line: str) -> list[str]:
        """A command line typed by the operator; returns the lines that the console shows for it."""
        words = line.split()
        before = len(self.console.lines)
        if words[0] not in self.command_map:
            return [f"Unknown command '{line}'"]
        try:
            self.command_map[words[0]][0](words[1:])
        except Exception as error:
            self.escaped.append(error)
        return self.console.lines[before:]

    # ---- the main loop ------------------------------------------------------------------------------------------

    def loop(self) -> None:
        """One round: idle tasks, that of MAVProxy's own module `link` before all, then select."""
        for master in self.mav_master:
            master.mav.srcSystem = self.settings.source_system
            master.mav.srcComponent = self.settings.source_component
        for module, _package in list(self.modules):
            self._call(module.idle_task)
        if not self.mav_master:
            return
        ready, _, _ = select.select(list(self.select_extra), [], [], 0)
        for descriptor in ready:
            function, argument = self.select_extra[descriptor]
            if not self._call(function, argument):
                del self.select_extra[descriptor]

    def deliver(self, message: Any, master: Master | None = None) -> None:
        """A message of the vehicle's side, decoded by MAVProxy already; by a link: through that one's callback."""
        if master is not None:
            master.mav.callback(message, *master.mav.callback_args, **master.mav.callback_kwargs)
            return
        for module, _package in list(self.modules):
            self._call(module.mavlink_packet, message)

    def _call(self, function: Callable[..., None], *arguments: Any) -> bool:
        try:
            function(*arguments)
        except Exception as error:
            self.escaped.append(error)
            return False
        return True


class LinkModule:
    """MAVProxy's module `link`, as far as it adds and removes links."""

    def __init__(self, mpstate: MPState) -> None:
        self.mpstate = mpstate
        self.added: list[str] = []
        self.opens = True

    def link_add(self, descriptor: str) -> bool:
        self.added.append(descriptor)
        if not self.opens:
            return False
        device, _, label = descriptor.partition(':{"label":"')
        address = device.partition(":")[2] if device.startswith("udp") else device
        self.mpstate.mav_master.append(Master(label.removesuffix('"}') or None, address))
        return True

    def cmd_link_remove(self, args: list[str]) -> None:
        if len(self.mpstate.mav_master) > 1:
            self.mpstate.mav_master.pop(int(args[0]))
