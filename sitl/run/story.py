# SPDX-License-Identifier: GPL-3.0-or-later

"""The story of a run in the terminal: a line for each event, and a line of progress.

Each line has simulated time. On a terminal, lines have the colour of the station they are about and the progress line
is rewritten in place. Elsewhere there is no colour, and progress is a plain line every few seconds, so that a log of a
build machine shows activity too.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import TextIO

from sitl.report.journal_reader import Entry
from sitl.report.matching import last_line
from sitl.report.watch import VEHICLE

__all__ = ["Story", "sentence"]

#: events that are told, by their own text; from the vehicle's programs and the stations'
_TOLD = {
    "connected", "authority", "authority_lost", "package_received", "mission_loaded", "mission_failed", "start",
    "start_refused", "start_failed", "started", "zone_entered", "zone_left", "transfer_begun", "transfer_aborted",
    "partner_unfit", "emergency", "emergency_over", "warning", "gap", "gap_over",
    "warning_over", "fly", "guard", "refused", "delivery", "landed", "fault",
    "failed_closed", "position_stale", "off_route", "on_route", "flush", "consent", "lost", "result_unacknowledged",
    "dropped",
}  # fmt: skip
#: events of the aircraft itself
_TOLD_OF_VEHICLE = {"mode", "armed", "disarmed", "airborne", "landed", "reached", "firmware", "position_ready"}
_WARNING = 4
#: as in the pictures: told apart by the colour-blind as well
_STATION_COLOURS = ("38;5;33", "38;5;208", "38;5;35", "38;5;176", "38;5;179", "38;5;45")
_GREY, _BOLD, _RED, _GREEN, _RESET = "\033[90m", "\033[1m", "\033[31m", "\033[32m", "\033[0m"
_LIVE_INTERVAL_S, _QUIET_INTERVAL_S = 0.3, 10.0


def sentence(entry: Entry) -> str | None:
    """The story's line for an entry; None: none."""
    if entry.who == VEHICLE:
        if entry.event == "said" and (entry.get("severity", 7) <= _WARNING or "andover" in entry.text):
            return f"says: {entry.text}"
        return entry.text if entry.event in _TOLD_OF_VEHICLE else None
    if entry.event == "transfer_committed":
        took = entry.get("duration_s")
        time_text = f" in {took * 1000:.0f} ms" if isinstance(took, (int, float)) else ""
        return f"handover {entry.get('handover_id', '')} committed{time_text}: {entry.get('station')} commands"
    if entry.event == "accepted":
        return f"{entry.get('what')} of {entry.get('station')} accepted"
    if entry.event == "command":
        result = entry.get("result")
        return f"{entry.get('what', entry.text)}: {str(result).replace('_', ' ')}" if result else None
    if entry.event == "fault":
        return f"FAULT: {last_line(entry.text)}"
    return (entry.text or entry.event) if entry.event in _TOLD else None


class Story:
    """Tells a run on a stream."""

    def __init__(self, stream: TextIO, stations: Sequence[str] = ()) -> None:
        self._stream = stream
        self._live = stream.isatty()
        #: https://no-color.org
        self._coloured = self._live and not os.environ.get("NO_COLOR")
        self._colours = dict(zip(stations, _STATION_COLOURS, strict=False))
        self._progress_at = time.monotonic() + (0.0 if self._live else _QUIET_INTERVAL_S)
        self._shown = False

    def stations(self, names: Sequence[str]) -> None:
        """The stations whose lines wear a colour."""
        self._colours = dict(zip(names, _STATION_COLOURS, strict=False))

    def entry(self, entry: Entry, sim_s: float) -> None:
        """Tell of an entry, if it is worth telling."""
        text = sentence(entry)
        if text:
            about = str(entry.get("station") or entry.who)
            self.line(text, entry.who, sim_s, colour=self._colours.get(about, ""))

    def line(self, text: str, who: str = "", sim_s: float | None = None, *, colour: str = "") -> None:
        """Tell something."""
        self._clear()
        clock = " " * 9 if sim_s is None else f"{sim_s:7.1f} s"
        whole = f"{clock}  {who:<9} {text}".rstrip()
        if self._coloured and colour:
            whole = f"\033[{colour}m{whole}{_RESET}"
        self._put(whole + "\n")

    def verdict(self, held: bool, text: str) -> None:
        """An expectation and its result."""
        self._clear()
        word = "holds" if held else "FAILS"
        if self._coloured:
            word = f"{_GREEN if held else _RED}{word}{_RESET}"
        self._put(f"  {word}  {text}\n")

    def heading(self, text: str) -> None:
        """A line that stands out."""
        self._clear()
        self._put(f"{_BOLD}{text}{_RESET}\n" if self._coloured else f"{text}\n")

    def progress(self, text: str, sim_s: float) -> None:
        """A line of progress, shown at times while nothing happens."""
        now = time.monotonic()
        if now < self._progress_at:
            return
        self._progress_at = now + (_LIVE_INTERVAL_S if self._live else _QUIET_INTERVAL_S)
        whole = f"{sim_s:7.1f} s  ... {text}"
        if self._live:
            shown = f"{_GREY}{whole[:118]}{_RESET}" if self._coloured else whole[:118]
            self._put(f"\r\033[K{shown}")
            self._shown = True
        else:
            self._put(whole + "\n")

    def _clear(self) -> None:
        if self._shown:
            self._put("\r\033[K")
            self._shown = False

    def _put(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()
