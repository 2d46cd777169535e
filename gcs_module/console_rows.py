# SPDX-License-Identifier: GPL-3.0-or-later

"""Marks old values in MAVProxy's own rows of its console.

MAVProxy writes a value when a message brings it, and leaves it there. A station that does not command gets fewer
messages, so its values would stand still without a mark. Here every write is noted. A value that was not written for
OLD_S is shown grey in brackets, and a row below tells the age of the oldest one.

Only values that messages bring are watched (`_VALUES`); what is written once, such as the count of parameters, is never
old. A console cannot be read, so its `set_status` is replaced by one that notes and writes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from gcs_module.banner import OLD_S

__all__ = ["ConsoleRows"]

#: names of the values in MAVProxy's console that telemetry updates (mavproxy_console.py)
_VALUES: Final = frozenset(
    (
        *("Mode", "ARM", "GPS", "GPS2", "Vcc", "PWR", "Srv", "Radio"),
        *("INS", "MAG", "AS", "RNG", "AHRS", "EKF", "TERR", "RC", "PRE", "LOG", "Fence"),
        *("Heading", "Alt", "AGL", "AirSpeed", "GPSSpeed", "Thr", "Roll", "Pitch", "Wind"),
        *("WP", "WPDist", "WPBearing", "AltError", "AspdError", "FlightTime", "ETR"),
    )
)
_LINK: Final = "Link"
#: a value that is written together with another one, and only if it changes: it has the age of the other
_WITH: Final = {"FlightTime": "Alt", "ETR": "WP"}
#: our row below MAVProxy's
_NOTE, _NOTE_ROW = "HANDOVER OLD", 4


@dataclass(slots=True)
class _Value:
    """A value as MAVProxy wrote it last, and when (monotonic s)."""

    text: str
    row: int
    fg: str
    bg: str
    at: float
    marked: bool = False


class ConsoleRows:
    """Times are monotonic seconds.

    `console` returns MAVProxy's present console; `why` returns why values are missing, "" if that is not known.
    """

    def __init__(self, console: Callable[[], Any], clock: Callable[[], float], why: Callable[[], str]) -> None:
        self._find = console
        self._clock = clock
        self._why = why
        self._console: Any = None
        #: the console's own `set_status`
        self._write: Callable[..., None]
        #: ours, in its place
        self._ours: Any = None
        self._values: dict[str, _Value] = {}
        self._note = ""

    def tick(self, now: float) -> None:
        """Mark old values; to be called each second. Raises what the console raises."""
        if self._find() is not self._console:
            self._restore()
            self._install()
        oldest_s = 0.0
        values = dict(self._values)  # a copy: the console's menus have their own thread
        for name, value in values.items():
            age_s = now - values.get(_WITH.get(name, name), value).at
            if age_s <= OLD_S:
                continue
            oldest_s = max(oldest_s, age_s)
            if not value.marked:
                value.marked = True
                self._write(name, f"[{value.text}]", row=value.row, fg="grey", bg=value.bg)
        self._write_note(f"Values in [ ] are old: {oldest_s:.0f} s. {self._why()}".rstrip() if oldest_s else "")

    def release(self) -> None:
        """Restore the console, with its values as MAVProxy wrote them."""
        if self._console is None:
            return
        for name, value in dict(self._values).items():
            if value.marked:
                self._write(name, value.text, row=value.row, fg=value.fg, bg=value.bg)
        self._write_note("")
        self._restore()

    def _write_note(self, text: str) -> None:
        if text != self._note:
            self._note = text
            self._write(_NOTE, text, row=_NOTE_ROW, fg="black", bg="yellow" if text else "white")

    def _install(self) -> None:
        self._console = self._find()
        self._write = self._console.set_status
        self._values, self._note = {}, ""
        self._ours = self._console.set_status = self._note_and_write

    def _restore(self) -> None:
        if (
            self._console is not None and vars(self._console).get("set_status") is self._ours
        ):  # else another module has replaced it since
            del self._console.set_status

    def _note_and_write(self, name: str, text: str = "", row: int = 0, fg: str = "black", bg: str = "white") -> None:
        """In place of the console's `set_status`: note the value, then write it."""
        known = text and ("--" not in text or any(letter.isdigit() for letter in text))
        if known and (name in _VALUES or name.startswith(_LINK)):
            self._values[name] = _Value(text, row, fg, bg, self._clock())
        else:
            self._values.pop(name, None)
        self._write(name, text, row=row, fg=fg, bg=bg)
