# SPDX-License-Identifier: GPL-3.0-or-later

"""The properties of a link in one direction.

A scenario's `[impair]` or `[serial]` and the configuration of a proxy or line may set these values. Their effect on a
datagram is in `sitl.run.impairment`, their effect on the bytes of a serial line in `sitl.run.noise`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Final

__all__ = ["NoiseLevel", "Weather", "WeatherError"]

_SHARES: Final = ("loss", "bad_loss", "to_bad", "to_good", "reorder", "duplicate")
_MOST_S: Final = 60.0
_MOST_PER_S: Final = 1000.0


class WeatherError(ValueError):
    """A value that no link has. One line that names the value and what is allowed."""


@dataclass(frozen=True, slots=True)
class Weather:
    """State of one direction of a link; the default is a perfect one. Raises WeatherError."""

    loss: float = 0.0
    bad_loss: float = 1.0  #: loss while the link is in its bad state
    to_bad: float = 0.0  #: probability, before each datagram, that a good link turns bad
    to_good: float = 0.25  #: and that a bad one turns good: bursts of 4 on average
    delay_s: float = 0.0
    jitter_s: float = 0.0
    reorder: float = 0.0
    reorder_s: float = 0.02
    duplicate: float = 0.0
    rate_bytes_per_s: float = 0.0  #: 0: no limit
    queue_s: float = 1.0
    cut: bool = False
    on_s: float = 0.0  #: a rhythm: the link works for this time (s),
    off_s: float = 0.0  #: and loses everything for this time (s); 0: no rhythm

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name == "cut":
                if not isinstance(value, bool):
                    raise WeatherError(f"cut = {value!r}: must be true or false")
                continue
            most = 1.0 if entry.name in _SHARES else 1e9 if entry.name == "rate_bytes_per_s" else _MOST_S
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= most:
                raise WeatherError(f"{entry.name} = {value!r}: must be 0 to {most:g}")

    def changed(self, **changes: object) -> Weather:
        """A copy of this weather with some values changed. Raises WeatherError, for unknown names too."""
        known = [entry.name for entry in fields(self)]
        for name in changes:
            if name not in known:
                raise WeatherError(f"{name}: must be one of {', '.join(known)}")
        return replace(self, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True)
class NoiseLevel:
    """How noisy a line is, each way; the default is a clean one. Raises WeatherError."""

    damage: float = 0.0
    bursts_per_s: float = 0.0

    def __post_init__(self) -> None:
        for name, most in (("damage", 1.0), ("bursts_per_s", _MOST_PER_S)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= most:
                raise WeatherError(f"{name} = {value!r}: must be 0 to {most:g}")
