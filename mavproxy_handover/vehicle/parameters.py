# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's parameters, as far as it has told them: the only copy that the companion keeps.

Rules:

1. Every PARAM_VALUE of the autopilot counts, whoever asked for it: the autopilot also sends one for each parameter that
   is set. A value that is not a finite number is ignored.
2. A value stays until another one comes. Each has the time at which the autopilot told it last.
3. The check before flight reads them all (`autopilot/preflight.py`) and says when a reading has ended. `read` has what
   was told since that reading began: a parameter that the autopilot no longer has is missing there.
4. Only `VehicleState` takes values in. No other part keeps a parameter; each reads it when it needs it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, Final

__all__ = ["Parameter", "Parameters", "Values"]

#: more names than any firmware has; further ones are ignored
_MOST: Final = 5000


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter as the autopilot told it: its value, its MAV_PARAM_TYPE, and when (monotonic s)."""

    value: float
    type: int
    at: float


class Values(Mapping[str, float]):
    """The values that the autopilot has told since a time; a view, so what it tells later shows here as well."""

    __slots__ = ("_since", "_told")

    def __init__(self, told: Mapping[str, Parameter], since: float) -> None:
        self._told = told
        self._since = since

    def __getitem__(self, name: str) -> float:
        parameter = self._told[name]
        if parameter.at < self._since:
            raise KeyError(name)
        return parameter.value

    def __iter__(self) -> Iterator[str]:
        return (name for name, parameter in self._told.items() if parameter.at >= self._since)

    def __len__(self) -> int:
        return sum(1 for _name in self)


class Parameters:
    """The parameters of one autopilot."""

    def __init__(self) -> None:
        self._told: dict[str, Parameter] = {}
        #: counts the values that were new or different, and the readings that have ended
        self.changes = 0
        #: when the reading that ended last began; None: no reading has ended
        self._read_at: float | None = None

    def take(self, message: Any, now: float) -> None:
        """A PARAM_VALUE of the autopilot."""
        name, value = message.param_id, float(message.param_value)
        before = self._told.get(name)
        if not isfinite(value) or (before is None and len(self._told) >= _MOST):
            return
        if before is None or before.value != value:
            self.changes += 1
        self._told[name] = Parameter(value, message.param_type, now)

    def get(self, name: str) -> Parameter | None:
        """What the autopilot told last of this parameter; None: nothing."""
        return self._told.get(name)

    def reading_ended(self, began_at: float) -> None:
        """A reading of all that the check before flight needs has ended; it began then (monotonic s)."""
        self._read_at = began_at
        self.changes += 1

    @property
    def read(self) -> Values | None:
        """What was told since the reading began that ended last; None before a reading has ended."""
        return None if self._read_at is None else self.since(self._read_at)

    def since(self, at: float = -inf) -> Values:
        """The values that it has told since `at` (monotonic s)."""
        return Values(self._told, at)
