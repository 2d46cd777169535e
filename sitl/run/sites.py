# SPDX-License-Identifier: GPL-3.0-or-later

"""The place of a station of a run: this machine's loopback, or a computer of its own with several addresses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from sitl.vehicles.ports import LOOPBACK

__all__ = ["HERE", "Reach", "Site"]


@dataclass(frozen=True, slots=True)
class Reach:
    """How a link reaches a station. `way`: the vehicle's interface that the link leaves by; "": any."""

    address: str
    way: str = ""


@dataclass(frozen=True, slots=True)
class Site:
    """The computer of a station.

    `under`: words before the command line of a program that runs there. `links`: label of a link -> how it reaches the
    station; a label that is not named has the loopback address. `port`: where the station listens for the vehicle, at
    each of its addresses; `ground_port`: where it listens for other stations, at the address `ground`. Port 0: any that
    is free.
    """

    under: tuple[str, ...] = ()
    links: Mapping[str, Reach] = field(default_factory=dict)
    port: int = 0
    ground: str = LOOPBACK
    ground_port: int = 0

    def reach(self, label: str) -> Reach:
        """How the link with that label reaches the station."""
        return self.links.get(label, Reach(LOOPBACK))


#: this machine
HERE: Final = Site()
