# SPDX-License-Identifier: GPL-3.0-or-later

"""A limit of a rate, as a bucket that fills with time."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

__all__ = ["RateLimit"]


@dataclass(slots=True)
class RateLimit:
    """Allows `per_s` units a second, and `most` at once. Times are monotonic seconds."""

    per_s: float
    most: float
    _left: float = field(init=False)
    _counted_at: float = field(init=False, default=-inf)

    def __post_init__(self) -> None:
        self._left = self.most

    def allow(self, now: float, units: float = 1.0) -> bool:
        """Whether so many units may pass now. If so, they count."""
        if now > self._counted_at:
            passed_s = now - self._counted_at
            self._left = min(self.most, self._left + passed_s * self.per_s)
            self._counted_at = now
        if self._left < units:
            return False
        self._left -= units
        return True

    def empty(self) -> None:
        """Nothing may pass until the bucket has filled again."""
        self._left = 0.0
