# SPDX-License-Identifier: GPL-3.0-or-later

"""`module load handover`: the MAVProxy module of the companion computer.

It decides nothing: it opens the stations' sockets, hands bytes, messages and ticks to `Companion`, and shows what comes
back. What it must see to, because MAVProxy does not:

* nothing reaches the autopilot past the gate: it refuses to load while `--out` links exist, and switches `mavfwd`,
  `mavfwd_disarmed` and MAVProxy's own heartbeat off, and off again if somebody switches them on;
* every callback is wrapped: MAVProxy would swallow an exception, or drop the socket, without a word;
* its sockets are polled in `idle_task` as well, because MAVProxy does not select on them while it has no master.

The lease goes out from MAVProxy's main loop, so it stops when that loop stalls.
"""

from __future__ import annotations

import secrets
import time
import traceback
from collections.abc import Callable
from typing import Any

from MAVProxy.modules.lib import mp_module

from mavproxy_handover.commands import VehicleCommands
from mavproxy_handover.companion import Companion
from mavproxy_handover.config import ConfigError, VehicleConfig, find_vehicle_config, load_vehicle
from mavproxy_handover.journal import Journal
from mavproxy_handover.links import LinkError, UdpLink
from mavproxy_handover.stations import StationPort, open_ports
from mavproxy_handover.version import VERSION

__all__ = ["HandoverModule", "init"]

#: MAVProxy settings that would let others past the gate -> the value that does not
_SETTINGS = {"mavfwd": False, "mavfwd_disarmed": False, "heartbeat": 0}
#: the configuration of the last load, for `module reload handover`
_last_config: list[str] = []


class HandoverModule(mp_module.MPModule):
    """The vehicle's side of authority handover."""

    def __init__(self, mpstate: Any, config: VehicleConfig, ports: dict[int, StationPort], journal: Journal) -> None:
        super().__init__(mpstate, "handover", "authority handover (companion)", public=True, multi_vehicle=True)
        self._nag_at = 0.0
        self._kept = {name: getattr(self.settings, name) for name in _SETTINGS if hasattr(self.settings, name)}
        nonce = secrets.randbelow(0xFFFFFFFF) + 1
        self.companion = Companion(config, ports, journal, self._write_autopilot, nonce, self._show)
        self._commands = VehicleCommands(self.companion, self._show)
        self._links = [(port, link) for port in ports.values() for link in port.links]
        for port, link in self._links:
            mpstate.select_extra[link.fileno()] = (self._readable, (port, link))
        self.add_command("handover", self._commands.run, "authority handover", self._commands.completions())
        journal.write("loaded", f"handover {VERSION}, configuration {config.path}", version=VERSION)
        self._close_side_doors()

    # ---- MAVProxy's callbacks, all wrapped ------------------------------------------------------------------------

    def idle_task(self) -> None:
        """Called by MAVProxy in every round of its main loop."""
        self._guarded("idle", self._idle)

    def mavlink_packet(self, m: Any) -> None:
        """A message from the vehicle's side."""
        self._guarded("message of the autopilot", lambda: self.companion.on_autopilot(m, time.monotonic()))

    def _readable(self, where: tuple[StationPort, UdpLink]) -> None:
        self._guarded("link", lambda: self._read(*where))

    def unload(self) -> None:
        """Give everything back: sockets, command, settings."""
        for _port, link in self._links:
            self.mpstate.select_extra.pop(link.fileno(), None)
        self.mpstate.command_map.pop("handover", None)
        self.mpstate.public_modules.pop("handover", None)
        for name, value in self._kept.items():
            setattr(self.settings, name, value)
        self._guarded("unload", self.companion.close)

    # ---- behind them ----------------------------------------------------------------------------------------------

    def _guarded(self, where: str, job: Callable[[], None]) -> None:
        try:
            job()
        except Exception:
            self.companion.fault(where, traceback.format_exc(limit=-3))

    def _idle(self) -> None:
        for port, link in self._links:
            self._read(port, link)
        now = time.monotonic()
        if now >= self._nag_at:
            self._nag_at = now + 1.0
            self._close_side_doors()
        self.companion.tick(now)

    def _read(self, port: StationPort, link: UdpLink) -> None:
        frames = port.read(link)
        if frames:
            self.companion.on_station(port, frames, time.monotonic())

    def _close_side_doors(self) -> None:
        for name, value in _SETTINGS.items():
            if name in self._kept and getattr(self.settings, name) != value:
                if self._nag_at:
                    self._show(f"handover: {name} is set back to {value}: only the gate lets stations through")
                setattr(self.settings, name, value)
        if self.mpstate.mav_outputs and not self.companion.config.listen_only_outputs and self._nag_at:
            for output in list(self.mpstate.mav_outputs):
                self._show(f"handover: output {output.address} is closed: stations belong in the configuration")
                self.mpstate.mav_outputs.remove(output)
                output.close()

    def _write_autopilot(self, data: bytes) -> None:
        self.master.write(data)

    def _show(self, text: str) -> None:
        self.console.writeln(text)


def init(mpstate: Any, config: str | None = None, **unknown: Any) -> HandoverModule | None:
    """Called by MAVProxy. Without a usable configuration it says why, and MAVProxy lives on.

    `config`: path of the configuration file (`module load handover:{"config":"FILE"}`).
    """
    if unknown:
        return _not_loaded(mpstate, f"unknown argument {', '.join(unknown)}; allowed is: config")
    try:
        path = find_vehicle_config(config or (_last_config[-1] if _last_config else None))
        settings = load_vehicle(path)
        if mpstate.mav_outputs and not settings.listen_only_outputs:
            outputs = ", ".join(output.address for output in mpstate.mav_outputs)
            return _not_loaded(
                mpstate,
                f"MAVProxy has outputs ({outputs}): whoever is behind them could pass the gate. Start without --out, "
                "or set listen_only_outputs = true in [vehicle]",
            )
        ports = open_ports(settings.stations)
    except (ConfigError, LinkError) as error:
        return _not_loaded(mpstate, str(error))
    try:
        journal = Journal(settings.journal, settings.name)
    except OSError as error:
        for port in ports.values():
            port.close()
        return _not_loaded(mpstate, f"journal {settings.journal}: {error.strerror}")
    _last_config[:] = [str(path)]
    return HandoverModule(mpstate, settings, ports, journal)


def _not_loaded(mpstate: Any, text: str) -> HandoverModule | None:
    """Say why; the answer to MAVProxy is that there is no module."""
    mpstate.console.writeln(f"handover: {text}")
    return None
