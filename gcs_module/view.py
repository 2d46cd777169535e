# SPDX-License-Identifier: GPL-3.0-or-later

"""The operator's view of a vehicle: lines, status row, bell, speech and telemetry.

Lines have the form of the thesis; the status row is in MAVProxy's console. The level of a line decides how it looks and
sounds (`alarms.py`).
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from math import hypot, inf, isfinite
from typing import Any, Final

from gcs_module.alarms import LOOKS, Level
from gcs_module.banner import Situation, age, banner, named, tag
from gcs_module.speech import spoken

__all__ = ["View", "alert", "plain_line", "telemetry_line", "telemetry_table"]

#: words before a line of this level, for a terminal without colours
_WORDS: Final = {Level.WARNING: "WARNING: ", Level.EMERGENCY: "EMERGENCY: "}
_BELL: Final = "\a"
#: the last lines that are kept
_RECENT: Final = 30


def telemetry_line(m: Any, zone_name: str) -> str:
    """HANDOVER_TELEMETRY as one line."""
    battery = "?" if m.battery_remaining < 0 else f"{m.battery_remaining}%"
    known = m.waypoint > 0 and isfinite(m.waypoint_distance)
    waypoint = f"{m.waypoint_distance:.0f} m to waypoint {m.waypoint}" if known else f"waypoint {m.waypoint}"
    return (
        f"{m.lat / 1e7:.6f} {m.lon / 1e7:.6f} {m.relative_alt / 1000:.0f} m, {m.groundspeed:.1f} m/s, "
        f"battery {battery}, {waypoint}, zone {zone_name}"
    )


def telemetry_table(m: Any, zone_name: str, mode: str) -> list[str]:
    """All values of HANDOVER_TELEMETRY, the telemetry of the thesis, each with its unit."""
    known = m.battery_voltage != 0xFFFF
    utc = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(m.time_usec / 1e6))
    distance = f"{m.waypoint_distance:.0f} m" if isfinite(m.waypoint_distance) else "not known"
    rows = (
        ("time", f"{utc} UTC, {m.time_boot_ms / 1000.0:.1f} s after the autopilot's start"),
        ("battery", f"{m.battery_voltage / 1000.0:.2f} V" if known else "voltage not known"),
        ("", f"{m.battery_remaining} % left" if m.battery_remaining >= 0 else "what is left is not known"),
        ("position", f"{m.lat / 1e7:.7f} {m.lon / 1e7:.7f} deg"),
        ("altitude", f"{m.alt / 1000.0:.1f} m above the sea, {m.relative_alt / 1000.0:.1f} m above home"),
        ("rates", f"roll {m.rollspeed:.3f}, pitch {m.pitchspeed:.3f}, yaw {m.yawspeed:.3f} rad/s"),
        ("velocity", f"north {m.vx:.1f}, east {m.vy:.1f}, down {m.vz:.1f} m/s"),
        ("heading", f"{m.heading / 100.0:.0f} deg" if m.heading != 0xFFFF else "not known"),
        ("speed", f"{m.groundspeed:.1f} m/s over ground"),
        ("waypoint", f"{m.waypoint}, {distance} away"),
        ("zone", zone_name),
        ("mode", f"{mode or m.custom_mode}, {'armed' if m.armed else 'disarmed'}"),
    )
    return [f"{name:9} {text}" for name, text in rows]


def plain_line(console: Any, who: str, text: str, level: Level) -> None:
    """One line in the form of the thesis. `who`: the text in its brackets, after the time."""
    look = LOOKS[level]
    prefix = _WORDS.get(level, "")
    said = text if prefix and text.startswith(prefix.rstrip(": ")) else f"{prefix}{text}"
    words = f"[{time.strftime('%H:%M:%S')}|{who}]: {said}"
    console.writeln(words, fg=look.colour, bg=look.ground)


def _named_commands(text: str, name: str) -> str:
    """A text with commands to type, changed so that they work with any vehicle chosen."""
    return text.replace("'handover ", f"'handover -v {name} ") if name else text


def alert(text: str, level: Level, speak: Callable[[str], None], ring: Callable[[str], None]) -> None:
    """Sound a line that is already shown, if its level says so."""
    look = LOOKS[level]
    if look.bell:
        ring(_BELL)
    if look.spoken:
        speak(spoken(text))


def _row_name(now: Situation) -> str:
    return f"HANDOVER {now.of}".rstrip()


def _values_name(now: Situation) -> str:
    return f"HANDOVER VALUES {now.of}".rstrip()


class Values:
    """The aircraft's values that the companion sends to every station, from the autopilot's own messages."""

    def __init__(self) -> None:
        self._motion = self._battery = ""
        #: latitude and longitude (degrees) of the last position
        self.place: tuple[float, float] | None = None
        #: time of the last position (monotonic s)
        self.at = -inf

    def update(self, m: Any, now: float) -> None:
        """A message of the autopilot."""
        kind = m.get_type()
        if kind == "GLOBAL_POSITION_INT":
            self._motion = f"{m.relative_alt / 1000:.0f} m, {hypot(m.vx, m.vy) / 100:.1f} m/s"
            self.at, self.place = now, (m.lat / 1e7, m.lon / 1e7)
        elif kind == "SYS_STATUS":
            self._battery = "" if m.battery_remaining < 0 else f", battery {m.battery_remaining}%"

    def words(self) -> str:
        """Height above home, ground speed and battery; "" before the first position."""
        return f"{self._motion}{self._battery}" if self._motion else ""

    def aged(self, now: float) -> str:
        """The same with the age of values that are old."""
        words, old = self.words(), age(now - self.at)
        return f"{words} ({old})" if words and old else words


class View:
    """Lines on the console, in the form `[time|GCSA][ONHANDOVER]: text`. `situation`: returns what is known now; `row`:
    of the console's status rows.

    With several vehicles every line, and every spoken text, names its vehicle.
    """

    def __init__(
        self,
        situation: Callable[[], Situation],
        name: str,
        console: Any,
        speak: Callable[[str], None],
        ring: Callable[[str], None],
        row: int = 6,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._situation = situation
        self._clock = clock
        self._name = name
        self._console = console
        self._speak = speak
        self._ring = ring
        self._row = row
        #: the last HANDOVER_TELEMETRY, and its time (monotonic s)
        self.last_telemetry: Any | None = None
        self.telemetry_at = -inf
        #: values that every station gets
        self.values = Values()
        #: the last lines: number, time (monotonic s), text, level; and how many there were
        self.recent: deque[tuple[int, float, str, Level]] = deque(maxlen=_RECENT)
        self.told = 0
        #: whether the status row has values
        self._has_values = False

    def line(self, text: str, level: Level = Level.INFO) -> None:
        """One line, which looks and sounds by its level."""
        now = self._situation()
        plain_line(self._console, f"{self._name}][{tag(now)}", _named_commands(text, now.of), level)
        self.alert(text, level)

    def alert(self, text: str, level: Level) -> None:
        """Sound a line that is already shown, if its level says so."""
        self.told += 1
        self.recent.append((self.told, self._clock(), text, level))
        alert(named(self._situation().of, text), level, self._speak, self._ring)

    def show(self, text: str, *, whose: bool = False) -> None:
        """A plain line: the answer to a command. `whose`: begin with the vehicle's name, if there are several."""
        of = self._situation().of
        words = _named_commands(text, of)
        self._console.writeln(f"{of}: {words}" if of and whose else words)

    def status(self, now: float) -> None:
        """The status row of MAVProxy's graphical console, the most important first.

        A station that does not command gets few messages, so MAVProxy's own rows show little there. The values that
        every station gets stand in this row.
        """
        known = self._situation()
        text, level = banner(known)
        look = LOOKS[level]
        self._console.set_status(_row_name(known), text, row=self._row, fg=look.colour, bg=look.ground)
        values = "" if known.own else named(known.of, self.values.words())
        if values or self._has_values:
            old = f" ({age(now - self.values.at)})" if values and age(now - self.values.at) else ""
            colour = "grey" if old else "black"
            self._console.set_status(_values_name(known), f"{values}{old}", row=self._row, fg=colour)
        self._has_values = bool(values)

    def clear(self) -> None:
        """Clear the status row, because it is not updated any more."""
        known = self._situation()
        self._console.set_status(_row_name(known), "", row=self._row)
        if self._has_values:
            self._console.set_status(_values_name(known), "", row=self._row)

    def telemetry(self, m: Any, now: float) -> None:
        """A HANDOVER_TELEMETRY has arrived."""
        self.last_telemetry, self.telemetry_at = m, now

    def telemetry_age(self, now: float) -> str:
        """The age of the last telemetry, " (12 s old)"; "" if it is fresh."""
        words = age(now - self.telemetry_at)
        return f" ({words})" if words else ""
