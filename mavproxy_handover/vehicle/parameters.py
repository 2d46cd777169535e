# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's parameters that have arrived: the only copy in the companion.

Rules:

1. Every PARAM_VALUE of the autopilot counts, for any request: the autopilot also sends one for each parameter that is
   set. A value that is not a finite number is ignored.
2. A value stays until another one arrives. Each value has the time of its last arrival.
3. `operator/checks/preflight.py` reads all of them before flight, and reports the end of each reading. `read`
   has only values since that reading began, so a parameter that the autopilot no longer has is missing there.
4. Only `VehicleState` adds values. No other part keeps a parameter; each part reads it when it needs it.
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
    """A parameter: its value, its MAV_PARAM_TYPE, and its last arrival (monotonic s)."""

    value: float
    type: int
    at: float


class Values(Mapping[str, float]):
    """A view of the values that have arrived since a time; later values also show here."""

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
        #: counts new or changed values, and finished readings
        self.changes = 0
        #: when the last finished reading began; None: no reading has ended
        self._read_at: float | None = None

    def on_value(self, message: Any, now: float) -> None:
        """A PARAM_VALUE of the autopilot arrived."""
        name, value = message.param_id, float(message.param_value)
        before = self._told.get(name)
        if not isfinite(value) or (before is None and len(self._told) >= _MOST):
            return
        if before is None or before.value != value:
            self.changes += 1
        self._told[name] = Parameter(value, message.param_type, now)

    def get(self, name: str) -> Parameter | None:
        """The last value of this parameter; None: it has not arrived."""
        return self._told.get(name)

    def reading_ended(self, began_at: float) -> None:
        """A reading of all parameters for the check before flight has ended; `began_at` in monotonic seconds."""
        self._read_at = began_at
        self.changes += 1

    @property
    def read(self) -> Values | None:
        """The values since the last finished reading began; None before a reading has ended."""
        return None if self._read_at is None else self.since(self._read_at)

    def since(self, at: float = -inf) -> Values:
        """The values that have arrived since `at` (monotonic s)."""
        return Values(self._told, at)
