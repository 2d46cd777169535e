# SPDX-License-Identifier: GPL-3.0-or-later

"""The contents of one recorded file, in the clock of that file: a strand. `flight.py` makes one flight of all of them.

A strand of any file has entries of a journal, so that the code after it needs one language:

* `seen`, by the vehicle's system id: what the aircraft did, as `watch.py` tells it (`who` is "vehicle"), and besides
  `battery` (volts, percent), `radio` (what a telemetry radio says of itself) and `energy`;
* `told`, by the vehicle's system id: the commander and the reason, as the vehicle's companion tells them;
* `own`: the entries of a journal, as they stand in it.

`ticks` are readings of the vehicle's clocks; `clocks.py` puts the files on one axis by them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from sitl.report.journal_reader import Entry

__all__ = ["CLOCK_SET_S", "Kind", "Stamps", "Strand", "Tick"]

#: UTC before the first (2001) is a clock that was never set; UTC after the second (2100) is not possible
CLOCK_SET_S, _LATEST_S = 978_307_200.0, 4_102_444_800.0
_FIRST_S = 0.0
#: so far (s) from the time before a time is doubted, and so many are needed to believe it
_FAR_S, _MOST_DOUBTS = 3600.0, 20


class Kind(Enum):
    """The kind of file that a strand is from; people read the value."""

    JOURNAL = "journal"
    TLOG = "telemetry log"
    DATAFLASH = "dataflash log"


@dataclass(frozen=True, slots=True)
class Tick:
    """At `t` of the file it was `boot_s` by the clock of that vehicle, and `gps_s` (UTC) by GPS.

    None: not known.
    """

    t: float
    sysid: int
    boot_s: float | None = None
    gps_s: float | None = None


class Stamps:
    """Which times of a file can be believed.

    The clock of a computer may be set, but no single reading is years away. A time far from the one before is believed
    once many in a row are there.
    """

    def __init__(self) -> None:
        self._last: float | None = None
        self._doubts = 0

    def believed(self, t: float) -> bool:
        """Whether `t` (s) is one; each time is to be asked about once, in the order of the file."""
        if not _FIRST_S <= t < _LATEST_S:
            return False
        if self._last is None or abs(t - self._last) < _FAR_S or self._doubts >= _MOST_DOUBTS:
            self._last, self._doubts = t, 0
            return True
        self._doubts += 1
        return False


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
