# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle that MAVProxy has chosen (`vehicle`), which is also the default of `handover`.

`vehicle drone-2` does the same as `vehicle 2`. When another vehicle is chosen, the sticks are released: MAVProxy
repeats its `rc 3 1200` to the chosen vehicle, and would fly it by the sticks of the one before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mavproxy_handover.config.files import FleetVehicle

__all__ = ["VehicleSelection", "known", "vehicle_of"]


def known(vehicles: Sequence[FleetVehicle]) -> str:
    """The vehicles, for people: what may be typed."""
    return ", ".join(f"{vehicle.called} ({vehicle.sysid})" for vehicle in vehicles)


def vehicle_of(word: str, vehicles: Sequence[FleetVehicle]) -> FleetVehicle | None:
    """The vehicle of that name or system id."""
    return next((vehicle for vehicle in vehicles if word in (vehicle.name, str(vehicle.sysid))), None)


class VehicleSelection:
    """Replaces MAVProxy's `vehicle` from `install` to `restore`. `changed`: gets the system ids before and now, at
    once; `show`: shows a line to the operator."""

    def __init__(
        self,
        mpstate: Any,
        vehicles: Sequence[FleetVehicle],
        changed: Callable[[int, int], None],
        show: Callable[[str], None],
    ) -> None:
        self._mpstate = mpstate
        self._vehicles = vehicles
        self._changed = changed
        self._show = show
        self._seen = self.sysid
        self._inner: tuple[Callable[[list[str]], None], str] | None = None

    @property
    def sysid(self) -> int:
        """The system id that MAVProxy has chosen, of our vehicles or not."""
        return int(self._mpstate.settings.target_system)

    @property
    def vehicle(self) -> FleetVehicle | None:
        """The chosen vehicle; None: it is not in the configuration."""
        return next((vehicle for vehicle in self._vehicles if vehicle.sysid == self.sysid), None)

    def install(self) -> None:
        """Handle `vehicle` from now on."""
        self._inner = self._mpstate.command_map.get("vehicle")
        if self._inner is not None:
            self._mpstate.command_map["vehicle"] = (self._run, self._inner[1])

    def restore(self) -> None:
        """Restore the command, unless another module has replaced it since."""
        if self._inner is not None and self._mpstate.command_map.get("vehicle", (None,))[0] == self._run:
            self._mpstate.command_map["vehicle"] = self._inner

    def poll(self) -> None:
        """Notice a choice that was made in another way; to be called often."""
        before, now = self._seen, self.sysid
        if now != before:
            self._seen = now
            self._changed(before, now)

    def _run(self, args: list[str]) -> None:
        if self._inner is None:
            return
        word, colon, component = args[0].partition(":") if args else ("", "", "")
        vehicle = vehicle_of(word, self._vehicles)
        if args and vehicle is None and not (word.isascii() and word.isdigit()):
            self._show(f"vehicle: no vehicle {word!r}; there are {known(self._vehicles)}")
            return
        self._inner[0]([f"{vehicle.sysid}{colon}{component}", *args[1:]] if vehicle is not None else args)
        self.poll()
