# SPDX-License-Identifier: GPL-3.0-or-later

"""What one recorded file tells, in the clock of that file: a strand. `flight.py` makes one flight of all of them.

Whatever the file was, a strand speaks in entries of a journal, so that everything behind it knows one language:

* `seen`, by the vehicle's system id: what the aircraft did, as `watch.py` tells it (`who` is "vehicle"), and besides
  `battery` (volts, percent), `radio` (what a telemetry radio says of itself) and `energy`;
* `told`, by the vehicle's system id: who commanded and why, as the vehicle's companion tells it;
* `own`: the entries of a journal, as they stand in it.

`ticks` are what the file says of the vehicle's clocks; `clocks.py` lays the files on one axis by them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from sitl.report.journal_reader import Entry

__all__ = ["Kind", "Strand", "Tick"]


class Kind(Enum):
    """What kind of file a strand is from; the value is said to people."""

    JOURNAL = "journal"
    TLOG = "telemetry log"
    DATAFLASH = "dataflash log"


@dataclass(frozen=True, slots=True)
class Tick:
    """At `t` of the file it was `boot_s` by the clock of that vehicle, and `gps_s` (UTC) by GPS; None: not said."""

    t: float
    sysid: int
    boot_s: float | None = None
    gps_s: float | None = None


@dataclass(slots=True)
class Strand:
    """One file. Times are seconds of its own clock: the writer's UTC, of a dataflash log that of the autopilot."""

    path: Path
    kind: Kind
    #: whose file it is, as far as it says: a station, or a vehicle; "" where that is not known
    who: str = ""
    #: the companion wrote it, beside the autopilot
    on_board: bool = False
    seen: dict[int, list[Entry]] = field(default_factory=dict)
    told: dict[int, list[Entry]] = field(default_factory=dict)
    own: list[Entry] = field(default_factory=list)
    #: of a journal: UTC less the monotonic time of its entries (s); None: it has no UTC, and monotonic times
    offset_s: float | None = None
    ticks: list[Tick] = field(default_factory=list)
    #: system id -> name
    stations: dict[int, str] = field(default_factory=dict)
    vehicles: dict[int, str] = field(default_factory=dict)
    #: the route that was in the autopilot, by the vehicle's system id: item -> latitude, longitude (degrees)
    items: dict[int, dict[int, tuple[float, float]]] = field(default_factory=dict)
    #: by the vehicle's system id: from when to when nothing of it was heard
    silences: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    #: bytes, or lines, that were nothing
    broken: int = 0

    def span(self) -> tuple[float, float] | None:
        """The first and the last moment of which it tells."""
        groups = [*self.seen.values(), *self.told.values(), self.own]
        ends = [t for group in groups if group for t in (group[0].t, group[-1].t)]
        return (min(ends), max(ends)) if ends else None
