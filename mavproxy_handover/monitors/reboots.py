# SPDX-License-Identifier: GPL-3.0-or-later

"""Notices that the autopilot has started again: its time since its start goes back.

After a restart in flight the autopilot may say that it is disarmed, in another mode, or both. Operators must hear the
reason, because "disarmed" alone reads like a landing.
"""

from __future__ import annotations

from math import inf
from typing import Final

__all__ = ["RebootMonitor"]

#: messages may overtake each other by less than this (ms)
_DISORDER_MS: Final = 2_000
#: the time wraps at 2^32 ms; that late it is no restart
_WRAPS_MS: Final = 0x1_0000_0000 - 600_000
#: an aircraft that flew this short a time (s) before the restart was noticed restarted in flight
_FLEW_S: Final = 60.0


class RebootMonitor:
    """Notices restarts of one autopilot. Times are monotonic seconds."""

    def __init__(self) -> None:
        self._boot_ms = 0
        self._flew_at = -inf

    def seen(self, message: object, flying: bool, now: float) -> bool:
        """A message of the autopilot; `flying`: what was known before it. Returns whether it has started again."""
        if flying:
            self._flew_at = now
        boot_ms = getattr(message, "time_boot_ms", None)
        if boot_ms is None:
            return False
        restarted = self._boot_ms < _WRAPS_MS and boot_ms + _DISORDER_MS < self._boot_ms
        if restarted or boot_ms > self._boot_ms or self._boot_ms >= _WRAPS_MS:
            self._boot_ms = boot_ms
        return restarted

    def in_flight(self, now: float) -> bool:
        """Whether the aircraft flew until just now."""
        return now - self._flew_at < _FLEW_S
