# SPDX-License-Identifier: GPL-3.0-or-later

"""What the operator sees: lines in the thesis's form, the status line of MAVProxy's console, telemetry."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from gcs_module.core import Role, StationCore

__all__ = ["View", "telemetry_line"]

_COLOURS = {Role.COMMANDER: "green", Role.PARTNER: "orange", Role.OBSERVER: "black"}


def telemetry_line(m: Any, zone_name: str) -> str:
    """HANDOVER_TELEMETRY as one line."""
    battery = "?" if m.battery_remaining < 0 else f"{m.battery_remaining}%"
    return (
        f"{m.lat / 1e7:.6f} {m.lon / 1e7:.6f} {m.relative_alt / 1000:.0f} m, {m.groundspeed:.1f} m/s, "
        f"battery {battery}, waypoint {m.waypoint}, zone {zone_name}"
    )


class View:
    """Lines on the console, in the form `[time|GCSA][ONHANDOVER]: text`."""

    def __init__(self, core: StationCore, name: str, console: Any, speak: Callable[[str], None]) -> None:
        self._core = core
        self._name = name
        self._console = console
        self._speak = speak
        self.last_telemetry: Any | None = None

    def line(self, text: str, *, urgent: bool = False) -> None:
        """One line; spoken as well if it is urgent and MAVProxy's speech module is loaded."""
        phase = self._core.phase.name.replace("_", "")
        stamp = time.strftime("%H:%M:%S")
        self._console.writeln(f"[{stamp}|{self._name}][{phase}]: {text}")
        if urgent:
            self._speak(text)

    def show(self, text: str) -> None:
        """A line as it is: the answer to what the operator typed."""
        self._console.writeln(text)

    def status(self) -> None:
        """The status field of MAVProxy's graphical console."""
        core = self._core
        text = f"Auth: {core.name(core.commander)} ({core.role.value})"
        self._console.set_status("HANDOVER", text, row=6, fg=_COLOURS[core.role])
