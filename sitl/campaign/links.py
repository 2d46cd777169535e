# SPDX-License-Identifier: GPL-3.0-or-later

"""The fate of a message between vehicle and station: it arrives after the link's delay, or it is lost.

Well inside its zone a station's link is good. Near the border some flights lose a part of everything. Outside, more and
more is lost over `FADES_M`, and beyond that everything is. Faults cut a link one way or both, or thin it out.

A number decides whether a message is lost: of seed, link, moment and how many went before it in this moment. So other
senders' messages do not matter, and the same messages are lost however time is let pass.
"""

from __future__ import annotations

from sitl.campaign.plane import Circle

__all__ = ["EDGE_M", "FADES_M", "WEAK_LOSS", "Link"]

#: so far outside its zone a station is not heard any more
FADES_M = 60.0
#: so far inside its border a link loses nothing by itself
EDGE_M = 80.0
#: of a link that is weak
WEAK_LOSS = 0.33
_MASK = (1 << 64) - 1


def _mixed(number: int) -> float:
    """A number from 0 to 1 that looks like chance (splitmix64, Steele, Lea and Flood 2014)."""
    number = (number + 0x9E3779B97F4A7C15) & _MASK
    number = ((number ^ (number >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    number = ((number ^ (number >> 27)) * 0x94D049BB133111EB) & _MASK
    return ((number ^ (number >> 31)) >> 11) / (1 << 53)


class Link:
    """One way of one link. Times are ticks."""

    __slots__ = ("_at", "_count", "_key", "cut", "delay", "edge_loss", "loss", "off", "zone")

    def __init__(self, seed: int, number: int, zone: Circle | None, delay: int, edge_loss: float) -> None:
        """`edge_loss`: part that is lost near the border. `zone` None: the aircraft's place plays no part."""
        self._key = (seed << 20) ^ (number << 8)
        self._at, self._count = -1, 0
        self.zone, self.delay, self.edge_loss = zone, delay, edge_loss
        #: part that a fault loses
        self.loss = 0.0
        #: how many faults cut it
        self.cut = 0
        #: how many have it off for a moment, as part of a rhythm
        self.off = 0

    def lost_part(self, x_m: float, y_m: float) -> float:
        """The part of the messages that is lost with the aircraft there."""
        if self.cut or self.off:
            return 1.0
        if self.zone is None:
            return self.loss
        margin = self.zone.margin_m(x_m, y_m)
        if margin >= EDGE_M:
            return self.loss
        return min(1.0, self.loss + self.edge_loss + max(0.0, -margin / FADES_M))

    def fades(self, x_m: float, y_m: float, vx: float, vy: float) -> bool:
        """Whether it gets no better for an aircraft there that flies on, or a fault is at it."""
        zone = self.zone
        return zone is None or self.loss > 0.0 or self.off > 0 or (x_m - zone.x_m) * vx + (y_m - zone.y_m) * vy >= 0.0

    def steady(self, x_m: float, y_m: float) -> bool:
        """Whether everything gets through, or nothing."""
        return self.lost_part(x_m, y_m) in (0.0, 1.0)

    def arrives(self, now: int, x_m: float, y_m: float) -> int | None:
        """When a message arrives that is sent now; None: never."""
        lost = self.lost_part(x_m, y_m)
        if lost <= 0.0:
            return now + self.delay
        if lost >= 1.0:
            return None
        self._count = self._count + 1 if now == self._at else 0
        self._at = now
        return None if _mixed(self._key + (now << 24) + self._count) < lost else now + self.delay
