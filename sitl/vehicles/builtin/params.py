# SPDX-License-Identifier: GPL-3.0-or-later

"""The parameter table: the names, defaults and types that ArduCopter 4.7 has and this system uses.

Rules, as in ArduPilot: integers are cut, not rounded; a name that does not exist is ignored; a script adds
parameters under its own prefix, and values for them that a parameter file gave earlier apply then. Files hold
one NAME VALUE pair a line, separated by blanks or a comma, `#` starts a comment. Parameters in files that the
model does not have are ArduPilot's concern (sensor calibration and the like); they are counted and left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

__all__ = ["MAX_NAME_LENGTH", "INT8", "INT16", "INT32", "REAL32", "Parameter", "ParameterTable"]

#: MAV_PARAM_TYPE values.
INT8, INT16, INT32, REAL32 = 2, 4, 6, 9
MAX_NAME_LENGTH = 16
_RANGES = {INT8: (-128, 127), INT16: (-32768, 32767), INT32: (-(2**31), 2**31 - 1)}

_DEFAULTS: dict[int, dict[str, float]] = {
    INT8: {
        "BATT_FS_CRT_ACT": 0,
        "BATT_FS_LOW_ACT": 0,
        "BATT_LOW_TIMER": 10,
        "BATT_MONITOR": 0,
        "DISARM_DELAY": 10,
        "FENCE_ACTION": 1,
        "FENCE_ENABLE": 0,
        "FENCE_TOTAL": 0,
        "FENCE_TYPE": 7,
        "FLTMODE1": 0,
        "FLTMODE2": 0,
        "FLTMODE3": 0,
        "FLTMODE4": 0,
        "FLTMODE5": 0,
        "FLTMODE6": 0,
        "FLTMODE_CH": 5,
        "FS_EKF_ACTION": 1,
        "FS_GCS_ENABLE": 0,
        "FS_THR_ENABLE": 1,
        "INITIAL_MODE": 0,
        "MIS_RESTART": 0,
        "RALLY_INCL_HOME": 1,
        "RALLY_TOTAL": 0,
        "SCR_ENABLE": 0,
        "SIM_GPS1_ENABLE": 1,
        "SIM_WIND_T": 0,
        "WP_YAW_BEHAVIOR": 2,
    },
    INT16: {
        "FORMAT_VERSION": 120,
        "LAND_ALT_LOW": 1000,
        "LAND_SPEED": 50,
        "LAND_SPEED_HIGH": 0,
        "MAV_GCS_SYSID": 255,
        "MAV_OPTIONS": 0,
        "MAV_SYSID": 1,
        "MIS_TOTAL": 0,
        "RTL_ALT_FINAL": 0,
        "RTL_CLIMB_MIN": 0,
        "RTL_SPEED": 0,
        "SRTL_POINTS": 300,
    },
    INT32: {
        "ARMING_CHECK": 1,
        "AUTO_OPTIONS": 0,
        "BATT_ARM_MAH": 0,
        "BATT_CAPACITY": 3300,
        "FS_OPTIONS": 16,
        "RTL_ALT": 1500,
        "PLND_ENABLED": 0,
        "PLND_TYPE": 0,
        "RTL_LOIT_TIME": 5000,
        "STAT_RUNTIME": 0,
    },
    REAL32: {
        "BATT_ARM_VOLT": 0,
        "BATT_CRT_MAH": 0,
        "BATT_CRT_VOLT": 0,
        "BATT_LOW_MAH": 0,
        "BATT_LOW_VOLT": 10.5,
        "FENCE_ALT_MAX": 100,
        "FENCE_RADIUS": 300,
        "FS_GCS_TIMEOUT": 5,
        "GUID_TIMEOUT": 3,
        "LOIT_BRK_ACCEL": 250,
        "RALLY_LIMIT_KM": 0.3,
        "RC_OVERRIDE_TIME": 3,
        "RTL_CONE_SLOPE": 3,
        "SIM_BATT_VOLTAGE": 12.6,
        "SIM_SPEEDUP": 1,
        "SIM_WIND_DIR": 180,
        "SIM_WIND_SPD": 0,
        "SIM_WIND_T_ALT": 60,
        "SRTL_ACCURACY": 2,
        "WPNAV_ACCEL": 250,
        "WPNAV_ACCEL_C": 0,
        "WPNAV_ACCEL_Z": 100,
        "WPNAV_RADIUS": 200,
        "WPNAV_SPEED": 1000,
        "WPNAV_SPEED_DN": 150,
        "WPNAV_SPEED_UP": 250,
    },
}
_STREAMS = ("RAW_SENS", "EXT_STAT", "RC_CHAN", "RAW_CTRL", "POSITION", "EXTRA1", "EXTRA2", "EXTRA3", "OPTIONS")
_DEFAULTS[INT16].update({f"MAV{channel}_{stream}": 0 for channel in range(1, 4) for stream in _STREAMS})


@dataclass(slots=True)
class Parameter:
    """One parameter: name, value and MAV_PARAM_TYPE."""

    name: str
    value: float
    type: int


class ParameterTable:
    """All parameters, in name order."""

    def __init__(self) -> None:
        self._rows: dict[str, Parameter] = {}
        for kind, values in _DEFAULTS.items():
            for name, value in values.items():
                self._rows[name] = Parameter(name, float(value), kind)
        self._rows = dict(sorted(self._rows.items()))
        self._names = list(self._rows)
        self._pending: dict[str, float] = {}
        self._scripted: set[str] = set()

    def __len__(self) -> int:
        return len(self._names)

    def __iter__(self) -> Iterator[Parameter]:
        return (self._rows[name] for name in self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._rows

    def __getitem__(self, name: str) -> float:
        return self._rows[name].value

    def find(self, name: str) -> Parameter | None:
        return self._rows.get(name)

    def at(self, index: int) -> Parameter | None:
        """The parameter at `index` of the list, None outside it."""
        return self._rows[self._names[index]] if 0 <= index < len(self._names) else None

    def index(self, name: str) -> int:
        return self._names.index(name)

    def set(self, name: str, value: float) -> bool:
        """Set a value, cut to the parameter's type. False: no such parameter, or not a number."""
        row = self._rows.get(name)
        if row is None or not math.isfinite(value):
            return False
        if row.type == REAL32:
            row.value = float(value)
        else:
            low, high = _RANGES[row.type]
            row.value = float(max(low, min(high, int(value + math.copysign(0.01, value)))))
        return True

    def load(self, path: Path) -> int:
        """Apply a parameter file; returns how many names the model does not have (kept for scripts).

        Raises:
            ValueError: a line is not a name and a number.
            OSError: the file cannot be read.
        """
        unknown = 0
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            words = line.split("#")[0].replace(",", " ").split()
            if not words:
                continue
            try:
                name, value = words[0], float(words[1])
            except (IndexError, ValueError):
                raise ValueError(f"{path}:{number}: expected NAME VALUE, found '{line.strip()}'") from None
            unknown += not self.preset(name, value)
        return unknown

    def preset(self, name: str, value: float) -> bool:
        """Set a value before the start; one that no parameter takes waits for a script's. False: waits."""
        if self.set(name, value):
            return True
        self._pending[name] = value
        return False

    def waits(self, name: str) -> bool:
        """Whether a file gave a value to a parameter that there is not yet."""
        return name in self._pending

    def define(self, name: str, default: float) -> bool:
        """A script adds a float parameter; a value that a file gave earlier wins over `default`. False: name taken."""
        if name in self._rows:
            return name in self._scripted
        if len(name) > MAX_NAME_LENGTH:
            return False
        self._rows[name] = Parameter(name, float(self._pending.pop(name, default)), REAL32)
        self._scripted.add(name)
        self._names = sorted(self._rows)
        return True
