# SPDX-License-Identifier: GPL-3.0-or-later

"""Which of several links a station's own messages use. Pure: time is an argument.

A MAVProxy with several `--master` links sends on the link that is set. It leaves that link only after five seconds in
which nothing came by it. That is long for a command in flight, so the station's module changes the setting:

* a link by which nothing came for SILENT_S, while several frames came by another one, is left at once: the vehicle
  probes every link ten times a second;
* otherwise the station follows the vehicle. The vehicle sends its telemetry on the link whose probes are best answered,
  so that link works both ways, which the station cannot measure itself.

It never changes back without one of these reasons, so the operator's choice between two good links stands.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

__all__ = ["FOLLOW_S", "SILENT_S", "UplinkSelector"]

SILENT_S: Final = 0.6
FOLLOW_S: Final = 0.5
_SAMPLE_S: Final = 0.05
#: a link works if it brings this many frames in SILENT_S: half the probes
_LIVING: Final = 3
#: a link carries the telemetry if it brings twice as many frames as the present one, and at least this many more in
#: FOLLOW_S
_MORE: Final = 8


class UplinkSelector:
    """Counts how many frames come by each link."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, tuple[int, ...]]] = deque()

    def choose(self, received: Sequence[int], chosen: int, now: float) -> int:
        """The link to use from now on. `received`: frames by each link since it began; `chosen`: the link used so far.

        To be called often. After links were added or removed, counting starts again.
        """
        counts = tuple(received)
        if self._samples and len(self._samples[-1][1]) != len(counts):
            self._samples.clear()
        if not self._samples or now - self._samples[-1][0] >= _SAMPLE_S:
            self._samples.append((now, counts))
        while len(self._samples) > 1 and self._samples[1][0] <= now - max(SILENT_S, FOLLOW_S):
            self._samples.popleft()
        if not 0 <= chosen < len(counts):
            return chosen
        lately = self._since(counts, now - SILENT_S)
        if lately is not None and lately[chosen] == 0:
            liveliest = max(range(len(counts)), key=lambda link: lately[link])
            if lately[liveliest] >= _LIVING:
                return self._move(liveliest)
        longer = self._since(counts, now - FOLLOW_S)
        if longer is not None:
            busiest = max(range(len(counts)), key=lambda link: longer[link])
            if longer[busiest] >= max(2 * longer[chosen], longer[chosen] + _MORE):
                return self._move(busiest)
        return chosen

    def _since(self, counts: tuple[int, ...], begin: float) -> list[int] | None:
        """Frames by each link since then; None if counting began later."""
        before = [sample for at, sample in self._samples if at <= begin]
        return [now - then for now, then in zip(counts, before[-1], strict=True)] if before else None

    def _move(self, link: int) -> int:
        self._samples.clear()
        return link
