# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether the mission package counts, and what operators are told when it does not count any more.

1. What a station writes to the autopilot on the ground stays there. It is no mission package, so START is refused until
   a package is loaded. Nothing replaces it until the commander shares a package or clears the mission.
2. Every station is told when a package is dropped or replaced, and what to do.
3. The package on board (`mission` in the vehicle's configuration) is loaded by itself at the start, after a flight that
   changed the mission, and after the commander has cleared the mission. Every station is told.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.ties import Ties
from mavproxy_handover.gate.list_changes import MISSION, ListChange
from mavproxy_handover.stations.port import StationPort

__all__ = ["ON_BOARD_RETRY_S", "PackageStanding"]

#: between two attempts to load the package on board, and after the commander has cleared the mission (s)
ON_BOARD_RETRY_S: Final = 10.0

_NOTICE: Final[int] = mavlink.MAV_SEVERITY_NOTICE
_CURE: Final = "START needs 'handover share'"
_OR_CLEAR: Final = "or clear the mission: then the package on board is loaded"
#: name of a source that is no station
_VEHICLE: Final = "the vehicle's own package"


class PackageStanding:
    """Of one vehicle. `on_board`: its configuration names a package."""

    def __init__(self, on_board: bool, ties: Ties) -> None:
        self._on_board = on_board
        self._ties = ties
        #: a station wrote the list that the autopilot holds: the package on board does not replace it
        self.kept = False
        #: the commander has cleared the mission, and the package on board is about to be loaded
        self._cleared = False
        #: why the package on board was not loaded, as it was told last
        self._failure = ""

    def changed(self, port: StationPort, change: ListChange, was_loaded: bool) -> None:
        """A station's message changes a list of the autopilot. `was_loaded`: a package counted until now."""
        clears = change.clears and change.what == MISSION and self._on_board
        known = self._cleared if clears else self.kept
        self.kept, self._cleared = not clears, clears
        if was_loaded or not known:
            self._ties.narrator.list_changed(port.name, change.what)
        if clears and (was_loaded or not known):
            text = f"{port.name} cleared the mission on the autopilot. The package on board is loaded in"
            self._say(f"{text} {ON_BOARD_RETRY_S:g} s.")
        elif was_loaded:
            dropped = f"{port.name} changed the {change.what} on the autopilot. The package is not loaded any more."
            cure = f"{_CURE}; {_OR_CLEAR}" if self._on_board else _CURE
            self._say(f"{dropped} {cure}.")
        elif not known:
            text = f"The {change.what} is on the autopilot. START needs a mission package: 'handover share'."
            self._ties.voice.say(port, text)

    def flight_over(self) -> None:
        """On the ground again: the mission was changed in flight, so the package does not count."""
        follows = "The package on board is loaded now" if self._on_board else _CURE
        self._say(f"The mission was changed in flight. {follows}.")

    def loaded(self, mission: str, sender: StationPort | None) -> None:
        """A package was written and read back; `sender`, who hears it otherwise, is None for the package on board."""
        self.kept = self._cleared = False
        self._failure = ""
        source = _VEHICLE if sender is None else sender.name
        text = f"Mission {mission} loaded from {source}: written, read back, equal."
        for port in self._ties.voice.ports.values():
            if port is not sender:
                self._ties.voice.say(port, text, _NOTICE)

    def failed(self, mission: str, why: str, station: str | None) -> None:
        """It was not. The package on board is tried again, and operators hear of a new reason only."""
        text = f"Mission {mission} not loaded: {why}."
        if station is not None:
            self._say(f"{text} {_CURE}.")
        elif text != self._failure:
            self._failure = text
            self._say(f"{text} It is tried again every {ON_BOARD_RETRY_S:g} s.")

    def _say(self, text: str) -> None:
        self._ties.voice.say_to_all(text)
