# SPDX-License-Identifier: GPL-3.0-or-later

"""Which of several vehicles is meant: MAVProxy's own choice (`vehicle`), which is the default of `handover` too.

`vehicle drone-2` does what `vehicle 2` does. Sticks are let go of when another vehicle is chosen: MAVProxy repeats its
`rc 3 1200` to whoever is chosen, and would fly the other aircraft by the sticks of the one before.
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
    """Stands in for MAVProxy's `vehicle` from `take` to `give_back`. `changed`: told the system ids before and now, at
    once; `show`: a line for whoever typed."""

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
        """The system id that MAVProxy has chosen, whoever's it is."""
        return int(self._mpstate.settings.target_system)

    @property
    def vehicle(self) -> FleetVehicle | None:
        """The vehicle that is chosen; None: none of ours."""
        return next((vehicle for vehicle in self._vehicles if vehicle.sysid == self.sysid), None)

    def take(self) -> None:
        """From now on `vehicle` goes through here."""
        self._inner = self._mpstate.command_map.get("vehicle")
        if self._inner is not None:
            self._mpstate.command_map["vehicle"] = (self._run, self._inner[1])

    def give_back(self) -> None:
        """Leave the command as it was; another one that has taken our place since stays."""
        if self._inner is not None and self._mpstate.command_map.get("vehicle", (None,))[0] == self._run:
            self._mpstate.command_map["vehicle"] = self._inner

    def look(self) -> None:
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
        self.look()
