# SPDX-License-Identifier: GPL-3.0-or-later

"""Layouts of a position box's record: place, type and unit of each field.

A layout is data. `THESIS` is listing 5.7 of the thesis, and the default. `FULL` is the record that this project had
before the listing was available. A user's layout comes from a file (`config/box_layouts.py`). Decoding, packing, ranges
and the page for users (`docs/position-box.md`) follow from these tables.

`MEANINGS` are the possible meanings of a field. A range is what a box can send at all, in the base unit (s, rad, m,
m/s, V). A field has the range of its meaning.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Final

__all__ = [
    "FULL",
    "LAYOUTS",
    "MEANINGS",
    "REQUIRED",
    "THESIS",
    "TYPES",
    "UNITS",
    "BoxField",
    "BoxLayout",
    "BoxRecord",
    "Meaning",
]

#: type -> struct's code; only a float or a double can be unknown (NaN)
TYPES: Final[Mapping[str, str]] = {
    "double": "d",
    "float": "f",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
}
#: quantity -> its units, each with the factor to the base unit, which is the first
UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "angle": {"rad": 1.0, "deg": math.pi / 180.0, "1e-7 deg": math.pi / 180e7},
    "length": {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048},
    "speed": {"m/s": 1.0, "cm/s": 0.01, "mm/s": 0.001, "km/h": 1.0 / 3.6, "kn": 1852.0 / 3600.0},
    "voltage": {"V": 1.0, "mV": 0.001},
}


@dataclass(frozen=True, slots=True)
class Meaning:
    """Meaning of a field. `into`: attribute of `BoxRecord`. `times`: factor from the base unit to that attribute."""

    quantity: str
    low: float
    high: float
    into: str
    says: str
    times: float = 1.0


_DEG: Final = 180.0 / math.pi
_TURN: Final = 6.3
_FAST: Final = 200.0
MEANINGS: Final[Mapping[str, Meaning]] = {
    "time": Meaning("time", 0.0, 1e11, "time_s", "a clock that only goes forward"),
    "lat": Meaning("angle", -math.pi / 2, math.pi / 2, "lat_deg", "latitude, north is positive (WGS84)", _DEG),
    "lon": Meaning("angle", -math.pi, math.pi, "lon_deg", "longitude, east is positive (WGS84)", _DEG),
    "alt": Meaning("length", -500.0, 20_000.0, "alt_m", "height above sea level"),
    "baro_height": Meaning("length", -1000.0, 20_000.0, "baro_m", "ISA pressure altitude"),
    "agl_height": Meaning("length", -1000.0, 20_000.0, "agl_m", "height above ground"),
    "track": Meaning("angle", -_TURN, _TURN, "track_deg", "course over ground, clockwise from true north", _DEG),
    "heading": Meaning("angle", -_TURN, _TURN, "heading_deg", "heading, clockwise from true north", _DEG),
    "ground_speed": Meaning("speed", 0.0, _FAST, "speed_mps", "speed over ground"),
    "vel_north": Meaning("speed", -_FAST, _FAST, "north_mps", "velocity over ground, to the north"),
    "vel_east": Meaning("speed", -_FAST, _FAST, "east_mps", "velocity over ground, to the east"),
    "vel_up": Meaning("speed", -_FAST, _FAST, "down_mps", "velocity upwards", -1.0),
    "vel_down": Meaning("speed", -_FAST, _FAST, "down_mps", "velocity downwards"),
    "roll": Meaning("angle", -_TURN, _TURN, "roll_rad", "right side down is positive"),
    "pitch": Meaning("angle", -_TURN, _TURN, "pitch_rad", "nose up is positive"),
    "battery": Meaning("voltage", 0.0, 1000.0, "battery_v", "voltage of the battery"),
}
#: every layout must have these
REQUIRED: Final = ("time", "lat", "lon", "vel_north", "vel_east")
#: if a layout has one of these, a position must have a value for it
_NEEDED: Final = ("lat", "lon", "alt", "vel_north", "vel_east", "vel_up", "vel_down")
_TURNS: Final = ("track", "heading")


@dataclass(frozen=True, slots=True)
class BoxField:
    """One field: `name` for people, meaning, type, unit, and offset of its first byte."""

    name: str
    meaning: str
    type: str
    unit: str
    offset: int
    says: str = ""

    @property
    def bytes(self) -> int:
        """Length of the field."""
        return struct.calcsize(f"<{TYPES[self.type]}")

    @property
    def factor(self) -> float:
        """Factor from its unit to the base unit."""
        return UNITS[MEANINGS[self.meaning].quantity][self.unit]

    @property
    def low(self) -> float:
        """The lowest value allowed, in its unit."""
        return MEANINGS[self.meaning].low / self.factor

    @property
    def high(self) -> float:
        """The highest value allowed, in its unit."""
        return MEANINGS[self.meaning].high / self.factor


@dataclass(frozen=True, slots=True)
class BoxRecord:
    """A decoded record, in this project's units. NaN: the box does not know the value, or the layout lacks it."""

    time_s: float
    lat_deg: float
    lon_deg: float
    #: above sea level
    alt_m: float = math.nan
    north_mps: float = math.nan
    east_mps: float = math.nan
    down_mps: float = math.nan
    roll_rad: float = math.nan
    pitch_rad: float = math.nan
    #: 0 to 360
    heading_deg: float = math.nan
    battery_v: float = math.nan
    #: pressure altitude of the standard atmosphere; it differs from the height above sea level by the day's pressure
    baro_m: float = math.nan
    #: from the pressure too: height above the ground on which the box was set to zero
    agl_m: float = math.nan
    #: 0 to 360
    track_deg: float = math.nan
    speed_mps: float = math.nan

    @property
    def placed(self) -> bool:
        """True if it has a latitude and a longitude."""
        unknown = math.isnan(self.lat_deg) or math.isnan(self.lon_deg)
        return not unknown and (self.lat_deg != 0.0 or self.lon_deg != 0.0)


@dataclass(frozen=True)
class BoxLayout:
    """One layout. `fields` are in the order of their bytes and do not overlap (`config/box_layouts.py` checks that).

    `size`: bytes of a record; bytes outside all fields are ignored. `utc`: its time is UTC, in seconds since 1970.
    """

    name: str
    fields: tuple[BoxField, ...]
    size: int
    big_endian: bool = False
    utc: bool = False

    @cached_property
    def format(self) -> str:
        """Format string of struct."""
        codes, at = [">" if self.big_endian else "<"], 0
        for field in self.fields:
            codes.append(f"{field.offset - at}x" if field.offset > at else "")
            codes.append(TYPES[field.type])
            at = field.offset + field.bytes
        return "".join([*codes, f"{self.size - at}x" if self.size > at else ""])

    @cached_property
    def struct(self) -> struct.Struct:
        """Unpacks a record: one value for each field."""
        made = struct.Struct(self.format)
        assert made.size == self.size, f"{self.name}: {made.size} bytes"
        return made

    @cached_property
    def _into(self) -> tuple[tuple[str, float, bool], ...]:
        """For each field: attribute of the record, factor, and True if it is an angle from 0 to 360."""
        return tuple(
            (MEANINGS[field.meaning].into, field.factor * MEANINGS[field.meaning].times, field.meaning in _TURNS)
            for field in self.fields
        )

    @cached_property
    def _time(self) -> tuple[int, float]:
        """Index of the time in the values, and its factor to seconds."""
        index = [field.meaning for field in self.fields].index("time")
        return index, self.fields[index].factor

    @cached_property
    def _ranges(self) -> tuple[tuple[BoxField, float, float], ...]:
        return tuple((field, field.low, field.high) for field in self.fields)

    @cached_property
    def needed(self) -> tuple[str, ...]:
        """Attributes that a record needs to be a position."""
        return tuple(MEANINGS[field.meaning].into for field in self.fields if field.meaning in _NEEDED)

    def time_s(self, values: tuple[float, ...]) -> float:
        """Time of the record (s)."""
        index, factor = self._time
        return values[index] * factor

    def wrong(self, values: tuple[float, ...]) -> str:
        """Text of the first impossible value, "" if there is none. The time must be known; other values may be NaN."""
        for (field, low, high), value in zip(self._ranges, values, strict=True):
            if not low <= value <= high and (field.meaning == "time" or not math.isnan(value)):
                return f"{field.name} {value:g} must be {low:g} to {high:g} {field.unit}"
        return ""

    def record(self, values: tuple[float, ...]) -> BoxRecord:
        """Decode values that are valid."""
        known = {}
        for (into, times, turns), value in zip(self._into, values, strict=True):
            known[into] = value * times % 360.0 if turns else value * times
        return BoxRecord(**known)

    def locates(self, record: BoxRecord) -> bool:
        """True if a record has position and velocity over ground."""
        return record.placed and not any(math.isnan(getattr(record, name)) for name in self.needed)

    def pack(self, record: BoxRecord) -> bytes:
        """Encode a record, as a box sends it."""
        values = []
        for field, (into, times, turns) in zip(self.fields, self._into, strict=True):
            value = getattr(record, into)
            value = (math.remainder(value, 360.0) if turns else value) / times
            values.append(value if field.type in ("double", "float") else 0 if math.isnan(value) else round(value))
        return self.struct.pack(*values)


def _layout(name: str, rows: tuple[tuple[str, str, str, str, str], ...], *, utc: bool) -> BoxLayout:
    """Make a layout without gaps from rows of name, meaning, type, unit and text."""
    made: list[BoxField] = []
    for field, meaning, kind, unit, says in rows:
        offset = made[-1].offset + made[-1].bytes if made else 0
        made.append(BoxField(field, meaning, kind, unit, offset, says))
    return BoxLayout(name, tuple(made), made[-1].offset + made[-1].bytes, utc=utc)


#: listing 5.7 of the thesis, with its names and texts
THESIS: Final = _layout(
    "thesis",
    (
        ("Time", "time", "double", "s", "UTC time, seconds since 1970 with nanoseconds as decimals"),
        ("Latitude", "lat", "double", "rad", "latitude, north is positive"),
        ("Longitude", "lon", "double", "rad", "longitude, east is positive"),
        ("BaroHeight", "baro_height", "float", "m", "ISA-barometric height; not above sea level"),
        ("AglHeight", "agl_height", "float", "m", "height above ground, barometric"),
        ("TrueTrack", "track", "float", "rad", "true track: course over ground, clockwise from north"),
        ("TrueHeading", "heading", "float", "rad", "true heading, clockwise from north"),
        ("GroundSpeed", "ground_speed", "float", "m/s", "ground speed"),
        ("EastVelocity", "vel_east", "float", "m/s", "velocity from west to east"),
        ("NorthVelocity", "vel_north", "float", "m/s", "velocity from south to north"),
        ("UpVelocity", "vel_up", "float", "m/s", "velocity upwards"),
    ),
    utc=True,
)
FULL: Final = _layout(
    "full",
    (
        ("time", "time", "double", "s", "the box's own clock, from any beginning; it only goes forward"),
        ("lat", "lat", "double", "rad", "latitude, north is positive (WGS84)"),
        ("lon", "lon", "double", "rad", "longitude, east is positive (WGS84)"),
        ("alt", "alt", "float", "m", "height above sea level"),
        ("vel_north", "vel_north", "float", "m/s", "velocity over ground, to the north"),
        ("vel_east", "vel_east", "float", "m/s", "that speed, to the east"),
        ("vel_up", "vel_up", "float", "m/s", "that speed, upwards"),
        ("roll", "roll", "float", "rad", "right side down is positive"),
        ("pitch", "pitch", "float", "rad", "nose up is positive"),
        ("yaw", "heading", "float", "rad", "heading, clockwise from true north"),
        ("battery", "battery", "float", "V", "voltage of the battery"),
    ),
    utc=False,
)
LAYOUTS: Final[Mapping[str, BoxLayout]] = {layout.name: layout for layout in (THESIS, FULL)}
assert {meaning.into for meaning in MEANINGS.values()} == {field.name for field in fields(BoxRecord)}
