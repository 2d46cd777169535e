# SPDX-License-Identifier: GPL-3.0-or-later

"""The description of a vehicle to be started, for every kind.

It also has the form in which each kind describes its start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

__all__ = ["Command", "LaunchError", "VehicleSpec"]


class LaunchError(RuntimeError):
    """The vehicle did not come up; the message names the program and carries the end of its log."""


@dataclass(frozen=True, slots=True)
class VehicleSpec:
    """The vehicle to start: place, identity, pace and parameters."""

    home: tuple[float, float, float, float]
    """Latitude and longitude (degrees), altitude above sea level (m), heading (degrees)."""
    sysid: int = 1
    speedup: float = 1.0
    """Simulated seconds per second of the wall clock."""
    clock: Path | None = None
    """The page of simulated time (`sitl.sim_time`), for the kind `builtin`."""
    leads: bool = True
    """Its time is that of the page; else it follows the page."""
    scripts: tuple[Path, ...] = ()
    """Lua scripts, copied into the directory's `scripts/`."""
    defaults: tuple[Path, ...] = ()
    """Parameter files (NAME VALUE lines), applied after the base file."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Single parameters, applied last."""
    arducopter: str | None = None
    """Explicit path of the SITL program, for kind `arducopter`."""
    arduplane: str | None = None
    """Explicit path of ArduPlane's program, for kinds `quadplane` and `plane`."""
    model: str = ""
    """What that program simulates, `--model`, where it is not what the kind is for: rover wants another program too."""


#: What to start, the TCP port of each serial port and the parameter files in order -> arguments and extra environment
Command: TypeAlias = Callable[[VehicleSpec, Mapping[int, int], list[Path]], tuple[list[str], dict[str, str]]]
