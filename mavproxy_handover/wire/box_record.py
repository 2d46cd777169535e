# SPDX-License-Identifier: GPL-3.0-or-later

"""The record of a position box aboard: 56 bytes, packed, little-endian, one after the other in a stream of TCP.

`FIELDS` is the layout, and all there is of it: the format, the ranges and the page for users (`docs/position-box.md`)
follow from it. Whatever the box has in radians and upwards is in degrees and downwards behind `BoxRecord`.

A record has neither a mark at its beginning nor a check sum. Rules that come of that:

1. Where records begin is known at the beginning of a connection, and only there. TCP neither loses nor reorders bytes,
   so it stays known, wherever the stream is cut. Once it is in doubt nothing can make it certain again: what looks
   like a record may be the end of one and the beginning of the next. So nothing is searched for; the rest of that
   connection is not believed (`BoxStream.broken`), and the next one begins anew.
2. In doubt it is as soon as a field has a value that none can have, or time does not go on as it does in a box that
   counts: not back, and by no more than LEAP_S. The first record of a connection has none before it to go by: it only
   sets the time, and is not handed out.
3. NaN is a value that the box does not know, in every field but time; and so are latitude and longitude 0, both, as
   receivers have them before their first fix. Such a record is sound, and no position.
4. The same time once more is the same record once more: it is not news.
5. How late a record is, compared to the quickest of its connection, shows by its time (`Lateness`): what has waited in
   a buffer is old, though it has only just arrived.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Final

__all__ = ["FIELDS", "FORMAT", "LEAP_S", "SIZE", "BoxField", "BoxRecord", "BoxStream", "Lateness", "pack_record"]


@dataclass(frozen=True, slots=True)
class BoxField:
    """One field of the record: `code` is struct's, d for eight bytes and f for four; `low` and `high` are allowed."""

    name: str
    code: str
    unit: str
    low: float
    high: float
    says: str


#: in the order in which they lie in the record
FIELDS: Final = (
    BoxField("time", "d", "s", 0.0, 1e11, "the box's own clock, from any beginning; it only goes forward"),
    BoxField("lat", "d", "rad", -math.pi / 2, math.pi / 2, "latitude, north is positive (WGS84)"),
    BoxField("lon", "d", "rad", -math.pi, math.pi, "longitude, east is positive (WGS84)"),
    BoxField("alt", "f", "m", -500.0, 20_000.0, "altitude above sea level"),
    BoxField("vel_north", "f", "m/s", -200.0, 200.0, "velocity over ground, to the north"),
    BoxField("vel_east", "f", "m/s", -200.0, 200.0, "the same, to the east"),
    BoxField("vel_up", "f", "m/s", -200.0, 200.0, "the same, upwards"),
    BoxField("roll", "f", "rad", -6.3, 6.3, "right side down is positive"),
    BoxField("pitch", "f", "rad", -6.3, 6.3, "nose up is positive"),
    BoxField("yaw", "f", "rad", -6.3, 6.3, "heading, clockwise from true north"),
    BoxField("battery", "f", "V", 0.0, 1000.0, "voltage of the battery"),
)
#: struct's format of a record
FORMAT: Final = "<" + "".join(field.code for field in FIELDS)
_RECORD: Final = struct.Struct(FORMAT)
#: bytes
SIZE: Final = _RECORD.size
assert SIZE == 56, "three doubles and eight floats"

#: time goes on by no more than this (s) from one record to the next: a box that was silent for so long is connected to
#: anew before (`link/box_line.py`)
LEAP_S: Final = 10.0
#: and by no less, or it is not new: bytes that are no time at all are rarely so close together
_LEAST_S: Final = 1e-4
#: clocks of two computers go apart by no more than this (s in a second)
_DRIFT: Final = 1e-3


@dataclass(frozen=True, slots=True)
class BoxRecord:
    """What one record says, in this project's units. Angles of the airframe in radians; NaN: the box does not know."""

    time_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    north_mps: float
    east_mps: float
    down_mps: float
    roll_rad: float
    pitch_rad: float
    #: 0 to 360
    heading_deg: float
    battery_v: float

    @property
    def position_known(self) -> bool:
        """Whether it says where the aircraft is, and how it moves over ground."""
        needed = (self.lat_deg, self.lon_deg, self.alt_m, self.north_mps, self.east_mps, self.down_mps)
        return not any(map(math.isnan, needed)) and (self.lat_deg != 0.0 or self.lon_deg != 0.0)


def pack_record(record: BoxRecord) -> bytes:
    """The 56 bytes of a record, as a box sends them."""
    return _RECORD.pack(
        record.time_s,
        math.radians(record.lat_deg),
        math.radians(record.lon_deg),
        record.alt_m,
        record.north_mps,
        record.east_mps,
        -record.down_mps,
        record.roll_rad,
        record.pitch_rad,
        math.remainder(math.radians(record.heading_deg), math.tau),
        record.battery_v,
    )


def _record(values: tuple[float, ...]) -> BoxRecord:
    time_s, lat, lon, alt_m, north, east, up, roll, pitch, yaw, battery = values
    heading_deg = math.degrees(yaw) % 360.0
    return BoxRecord(
        time_s,
        math.degrees(lat),
        math.degrees(lon),
        alt_m,
        north,
        east,
        -up,
        roll,
        pitch,
        heading_deg,
        battery,
    )


def _wrong(values: tuple[float, ...]) -> str:
    """What no box can mean, in words; "" if nothing. The time must be there, everything else may be NaN."""
    for field, value in zip(FIELDS, values, strict=True):
        if not field.low <= value <= field.high and (field.name == "time" or not math.isnan(value)):
            return f"{field.name} {value:g} must be {field.low:g} to {field.high:g} {field.unit}"
    return ""


class BoxStream:
    """The records of one connection, out of bytes cut anywhere. See the module's rules. It never raises."""

    def __init__(self) -> None:
        #: why nothing that comes is believed any more; "" while the stream is sound
        self.broken = ""
        #: sound records, news or not
        self.records = 0
        #: those that were the one before once more
        self.repeated = 0
        self._waiting = b""
        self._time_s: float | None = None

    @property
    def waiting(self) -> int:
        """Bytes of a record that has begun; always fewer than a record has."""
        return len(self._waiting)

    def feed(self, data: bytes) -> list[BoxRecord]:
        """The new records that `data` completes, in order, but for the first; those before a break are among them."""
        if self.broken:
            return []
        data = self._waiting + data
        whole = len(data) - len(data) % SIZE
        self._waiting = data[whole:]
        found = []
        for values in _RECORD.iter_unpack(memoryview(data)[:whole]):
            self.broken = _wrong(values) or self._out_of_time(values[0])
            if self.broken:
                self.broken = f"record {self.records + 1}: {self.broken}"
                self._waiting = b""
                break
            self.records += 1
            if self._time_s == values[0]:
                self.repeated += 1
                continue
            if self._time_s is not None:
                found.append(_record(values))
            self._time_s = values[0]
        return found

    def _out_of_time(self, time_s: float) -> str:
        """What is wrong with a time after the one before, in words; "" if nothing is."""
        if self._time_s is None or time_s == self._time_s:
            return ""
        step_s = time_s - self._time_s
        if step_s < 0.0:
            return f"time {time_s:g} s after {self._time_s:g} s: it runs backwards"
        if not _LEAST_S <= step_s <= LEAP_S:
            return f"time {time_s:g} s after {self._time_s:g} s: must go on by {_LEAST_S:g} to {LEAP_S:g} s"
        return ""


class Lateness:
    """How much longer a record was under way than the quickest of its connection, whose delay nobody knows.

    The two clocks need not agree, and may go apart slowly: what counts is the difference between them. It can only be
    too large, by the delay of a record, so the least that was seen is nearest to the truth.
    """

    def __init__(self) -> None:
        self._least_s = math.inf
        self._time_s = 0.0

    def of(self, time_s: float, now: float) -> float:
        """How late (s, 0 and more) a record of this time is that arrives now."""
        if self._least_s < math.inf:
            self._least_s += _DRIFT * max(0.0, time_s - self._time_s)
        self._time_s = time_s
        self._least_s = min(self._least_s, now - time_s)
        return now - time_s - self._least_s
