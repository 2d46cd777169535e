# SPDX-License-Identifier: GPL-3.0-or-later

"""The mission that the autopilot holds, as far as authority depends on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

__all__ = ["NO_MISSION", "Mission"]


@dataclass(frozen=True, slots=True)
class Mission:
    """The mission package and how far the aircraft has come.

    `digest`: its SHA-256, empty without one. `route`: the commanders that its planned track needs, in order.
    `at`: where on the route the present commander stands.
    """

    digest: bytes = b""
    route: tuple[int, ...] = ()
    at: int = 0

    @property
    def following(self) -> int | None:
        """The station that the route needs next; None at its end."""
        following = self.at + 1
        return self.route[following] if following < len(self.route) else None

    def advanced(self, station: int) -> Mission:
        """The same when this station commands; one that is not ahead on the route changes nothing."""
        if station not in self.route[self.at :]:
            return self
        return replace(self, at=self.route.index(station, self.at))


NO_MISSION = Mission()
