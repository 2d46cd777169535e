# SPDX-License-Identifier: GPL-3.0-or-later

"""The budget of the line to the autopilot: what feeds, onboard programs and payload stations may send together.

Each of them has a limit of its own, but only their sum decides whether a serial line is full. Rules:

1. They get half of what the line carries. The other half is for the lease, the commander, and terrain of the companion.
2. A link without a baud rate (UDP, TCP, USB) has no budget: each limit counts alone.
3. The limits of the configuration are compared with the budget (`finding`). What goes beyond the budget is dropped, in
   the order in which it comes.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from mavproxy_handover.gate.rate_limit import RateLimit

__all__ = ["LineBudget", "budget_finding"]

_BITS_OF_BYTE: Final = 10
_SHARE: Final = 0.5
#: bytes at once, in seconds of the rate: corrections of one second come together
_BURST_S: Final = 1.0
#: a longest frame always passes
_LONGEST: Final = 280.0
_NO_CLAIMS: Final[Mapping[str, float]] = MappingProxyType({})


def budget_finding(claims: Mapping[str, float], baud: int | None) -> str:
    """Compare the limits with the line: the finding, or "" if all fit. `claims`: bytes a second, by name."""
    most = sum(claims.values())
    if baud is None or most <= _per_s(baud):
        return ""
    named = ", ".join(f"{name} {limit:g}" for name, limit in claims.items())
    return f"line to the autopilot: room for {_per_s(baud):g} bytes/s at {baud} baud, limits sum to {most:g} ({named})"


def _per_s(baud: int) -> float:
    return baud / _BITS_OF_BYTE * _SHARE


class LineBudget:
    """Of the one line to the autopilot. Times are monotonic seconds."""

    def __init__(self, claims: Mapping[str, float] = _NO_CLAIMS) -> None:
        """`claims`: the limits of the configuration, bytes a second, by the name of their sender."""
        self._claims = claims
        self._baud: int | None = None
        self._room: RateLimit | None = None

    def line_opened(self, baud: int | None) -> None:
        """The link to the autopilot has this baud rate now; None: it has none that limits it."""
        if baud != self._baud:
            self._baud = baud
            self._room = None if baud is None else RateLimit(_per_s(baud), max(_LONGEST, _per_s(baud) * _BURST_S))

    def allow(self, now: float, size: int) -> bool:
        """Whether a frame of `size` bytes has room now. If so, it counts."""
        return self._room is None or self._room.allow(now, size)

    def finding(self) -> str:
        """What the check before flight says; "": the limits fit the line."""
        return budget_finding(self._claims, self._baud)
