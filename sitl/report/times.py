# SPDX-License-Identifier: GPL-3.0-or-later

"""The two times that a report says: T+ since take-off, and UTC.

T+ counts the aircraft's own seconds: in a simulation at another speed those are not the wall clock's. UTC there is
the time of day at which it was simulated.
"""

from __future__ import annotations

from datetime import datetime, timezone

from sitl.report.evidence import Evidence
from sitl.report.watch import VEHICLE

__all__ = ["Times", "duration"]


class Times:
    """Both times of a flight, for moments as its entries have them."""

    def __init__(self, evidence: Evidence) -> None:
        self._evidence = evidence
        begun, self.zero_is = evidence.entries[0].t if evidence.entries else 0.0, "the first entry"
        for event, words in (("airborne", "take-off"), ("armed", "arming")):
            found = evidence.of(VEHICLE, event)
            if found and not evidence.begins_in_air:
                #: what T+0 is
                begun, self.zero_is = found[0].t, words
                break
        self.zero_s = evidence.sim_at(begun)

    def plus_s(self, t: float) -> float:
        """Seconds since T+0."""
        return self._evidence.sim_at(t) - self.zero_s

    def plus(self, t: float) -> str:
        """T+ for people, "T+1:23.4"."""
        seconds = self.plus_s(t)
        sign = "-" if round(seconds, 1) < 0 else "+"
        tenths = round(abs(seconds) * 10)
        hours, rest = divmod(tenths, 36_000)
        minutes, tenths = divmod(rest, 600)
        clock = f"{hours}:{minutes:02d}" if hours else f"{minutes}"
        return f"T{sign}{clock}:{tenths // 10:02d}.{tenths % 10}"

    def at(self, t: float) -> datetime | None:
        """UTC; None if it is not known."""
        offset_s = self._evidence.notes.utc_offset_s
        try:
            return None if offset_s is None else datetime.fromtimestamp(t + offset_s, timezone.utc)
        except (OverflowError, ValueError, OSError):  # a time that no calendar has
            return None

    def utc(self, t: float) -> str:
        """The time of day by UTC, "14:07:28.6"; "" if it is not known."""
        at = self.at(t)
        return "" if at is None else f"{at:%H:%M:%S}.{at.microsecond // 100_000}"


def duration(seconds: float) -> str:
    """How long something took, in the unit that fits: "12.4 ms", "2.97 s", "5 min 27 s"."""
    if seconds < 1.0:
        return f"{seconds * 1000:.1f} ms"
    if seconds < 60.0:
        return f"{seconds:.2f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"
