# SPDX-License-Identifier: GPL-3.0-or-later

"""An onboard program of a simulation: `python -m sitl.run.onboard OPTIONS`.

    --journal FILE
    --vehicle ID      the vehicle's system id
    --component ID    its own component
    --port PORT       the companion listens here

It sends a heartbeat each second, and takes orders, a line each, on standard input:

    send MESSAGE RATE SECONDS [FIELD=VALUE ...]   RATE messages a second; fields without a value are 0,
                                                  a list has VALUE in each place
    target LAT LON HEIGHT RATE SECONDS            guided targets, HEIGHT above home
    beacon LAT LON RATE SECONDS                   LANDING_TARGET as a camera sees it that looks straight down
    vision DRIFT RATE SECONDS                     VISION_POSITION_ESTIMATE, off by DRIFT m/s to the north
    command NUMBER [P1 ... P7]                    COMMAND_LONG once, to the autopilot
    silent                                        end what it sends, but for heartbeats

Its journal has what it was told (`said`) and what its commands were answered (`ack`). It ends when its input does. It
uses no code of the vehicle except the dialect.
"""

from __future__ import annotations

import argparse
import json
import math
import select
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Final, TextIO

from pymavlink.dialects.v20 import handover as mavlink

from sitl.run.ending import Orders
from sitl.vehicles.ports import LOOPBACK

__all__ = ["Program", "main", "message_of"]

_AUTOPILOT: Final = mavlink.MAV_COMP_ID_AUTOPILOT1
_BEAT_S: Final = 1.0
_WAIT_S: Final = 0.02
#: metres of a degree of latitude
_DEGREE_M: Final = 111_319.5
#: a camera sees nothing nearer than this
_LOWEST_M: Final = 0.3
#: only the place counts
_PLACE: Final = 0b1101_1111_1000


def message_of(name: str, vehicle: int, values: Sequence[str]) -> Any:
    """The message of this name with these fields, FIELD=VALUE; the others are 0. Raises ValueError."""
    kind = next((each for each in mavlink.mavlink_map.values() if each.msgname == name), None)
    if kind is None:
        raise ValueError(f"no message {name!r}")
    fields: dict[str, Any] = {}
    for field, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        fields[field] = [0] * length if length else 0
    for field, own in (("target_system", vehicle), ("target_component", _AUTOPILOT)):
        if field in fields:
            fields[field] = own
    for value in values:
        field, _, number = value.partition("=")
        if field not in fields:
            raise ValueError(f"{name} has no field {field!r}")
        whole = float(number) == int(float(number))
        one = int(float(number)) if whole else float(number)
        fields[field] = [one] * len(fields[field]) if isinstance(fields[field], list) else one
    return kind(**fields)


def _timed(message: Any) -> Any:
    """The message with the time of now: an autopilot takes a sensor's message of the same time once."""
    for field in ("time_usec", "usec"):
        if field in message.fieldnames:
            setattr(message, field, round(time.monotonic() * 1e6))
    return message


@dataclass(slots=True)
class _Stream:
    """A message that goes out at a rate. `make` gives it."""

    make: Callable[[], Any]
    rate: float
    total: int
    began: float
    sent: int = 0


class Program:
    """One program. Times are monotonic seconds."""

    def __init__(self, vehicle: int, component: int, port: int, journal: TextIO) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((LOOPBACK, 0))
        self.socket.setblocking(False)
        self._vehicle = vehicle
        self._to = (LOOPBACK, port)
        self._journal = journal
        self._own = mavlink.MAVLink(None, srcSystem=vehicle, srcComponent=component)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._streams: list[_Stream] = []
        self._beat_at = 0.0
        #: the last GLOBAL_POSITION_INT
        self._position: Any = None
        #: the last GPS_RAW_INT with a fix and when it came, and the first one
        self._receiver: Any = None
        self._receiver_at = 0.0
        self._origin: Any = None
        self.note("loaded", f"component {component}")

    def note(self, event: str, text: str, **values: object) -> None:
        """Write to the journal."""
        utc = datetime.now(timezone.utc).isoformat(timespec="milliseconds")
        entry = {"t": round(time.monotonic(), 4), "utc": utc, "who": "onboard", "event": event, "text": text, **values}
        self._journal.write(json.dumps(entry) + "\n")

    def order(self, line: str, now: float) -> None:
        """Carry out a line; what cannot be understood is journalled as a fault."""
        word, *rest = line.split() or [""]
        try:
            if word == "send":
                message = message_of(rest[0], self._vehicle, rest[3:])
                self._begin(lambda: _timed(message), float(rest[1]), float(rest[2]), now)
            elif word == "target":
                message = self._target(*map(float, rest[:3]))
                self._begin(lambda: message, float(rest[3]), float(rest[4]), now)
            elif word == "beacon":
                lat, lon, rate, seconds = map(float, rest)
                self._begin(lambda: self._seen(lat, lon), rate, seconds, now)
            elif word == "vision":
                drift, rate, seconds = map(float, rest)
                self._begin(lambda: self._vision(drift * (time.monotonic() - now)), rate, seconds, now)
            elif word == "command":
                values = [*map(float, rest[1:]), *[0.0] * (8 - len(rest))]
                self._send(mavlink.MAVLink_command_long_message(self._vehicle, _AUTOPILOT, int(rest[0]), 0, *values))
            elif word == "silent":
                self._streams.clear()
            else:
                raise ValueError(f"not understood: {line!r}")
        except (ValueError, IndexError, TypeError) as error:
            self.note("fault", str(error))
        else:
            self.note("order", line)

    def _begin(self, make: Callable[[], Any], rate: float, seconds: float, now: float) -> None:
        self._streams.append(_Stream(make, rate, round(rate * seconds), now))

    def _seen(self, lat: float, lon: float) -> Any:
        """LANDING_TARGET of a beacon on the ground, from where the aircraft says that it is; None: not known yet."""
        here = self._position
        if here is None:
            return None
        north = (lat - here.lat / 1e7) * _DEGREE_M
        east = (lon - here.lon / 1e7) * _DEGREE_M * math.cos(math.radians(lat))
        heading, down = math.radians(here.hdg / 100.0), max(here.relative_alt / 1000.0, _LOWEST_M)
        forward = north * math.cos(heading) + east * math.sin(heading)
        right = east * math.cos(heading) - north * math.sin(heading)
        angles = math.atan2(right, down), math.atan2(-forward, down)
        distance = math.hypot(north, east, down)
        return _timed(mavlink.MAVLink_landing_target_message(0, 0, mavlink.MAV_FRAME_BODY_FRD, *angles, distance, 0, 0))

    def _vision(self, off_m: float) -> Any:
        """VISION_POSITION_ESTIMATE, `off_m` north of where the receiver is; None: it has no fix yet."""
        here, first = self._receiver, self._origin
        if here is None:
            return None
        moved = here.vel / 100.0 * (time.monotonic() - self._receiver_at)
        course = math.radians(here.cog / 100.0)
        north = (here.lat - first.lat) / 1e7 * _DEGREE_M + moved * math.cos(course)
        east = (here.lon - first.lon) / 1e7 * _DEGREE_M * math.cos(math.radians(here.lat / 1e7))
        place = north + off_m, east + moved * math.sin(course), (first.alt - here.alt) / 1000.0
        return _timed(mavlink.MAVLink_vision_position_estimate_message(0, *place, 0.0, 0.0, 0.0))

    def _target(self, lat: float, lon: float, height_m: float) -> Any:
        place = round(lat * 1e7), round(lon * 1e7), height_m
        frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        return mavlink.MAVLink_set_position_target_global_int_message(
            0, self._vehicle, _AUTOPILOT, frame, _PLACE, *place, *[0.0] * 8
        )

    def _send(self, message: Any) -> None:
        if message is None:
            return
        data = message.pack(self._own)
        self._own.seq = (self._own.seq + 1) & 0xFF
        try:
            self.socket.sendto(data, self._to)
        except OSError:  # no receiver, or the system is full
            pass

    def tick(self, now: float) -> None:
        """Send what is due."""
        if now >= self._beat_at:
            self._beat_at = now + _BEAT_S
            kind, none = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID
            self._send(mavlink.MAVLink_heartbeat_message(kind, none, 0, 0, mavlink.MAV_STATE_ACTIVE, 3))
        for stream in list(self._streams):
            due = min(stream.total, int((now - stream.began) * stream.rate) + 1)
            while stream.sent < due:
                self._send(stream.make())
                stream.sent += 1
            if stream.sent >= stream.total:
                self._streams.remove(stream)

    def listen(self) -> None:
        """Read what has come."""
        while True:
            try:
                data = self.socket.recv(65536)
            except OSError:
                return
            for message in self._parser.parse_buffer(data) or []:
                if message.get_type() == "STATUSTEXT":
                    self.note("said", message.text, component=message.get_srcComponent())
                elif message.get_type() == "GLOBAL_POSITION_INT":
                    self._position = message
                elif message.get_type() == "GPS_RAW_INT" and message.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX:
                    self._receiver, self._receiver_at = message, time.monotonic()
                    self._origin = self._origin or message
                elif message.get_type() == "COMMAND_ACK":
                    self.note("ack", f"{message.command}: {message.result}", what=message.command, value=message.result)


def main(argv: Sequence[str] | None = None) -> int:
    """Run until the input ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--journal", type=Path, required=True)
    for option in ("--vehicle", "--component", "--port"):
        parser.add_argument(option, type=int, required=True)
    options = parser.parse_args(argv)
    orders = Orders()
    with options.journal.open("w", encoding="utf-8", buffering=1) as journal:
        program = Program(options.vehicle, options.component, options.port, journal)
        while True:
            link = program.socket.fileno()
            ready, _, _ = select.select([link, *orders.descriptors], [], [], _WAIT_S)
            now = time.monotonic()
            for readable in ready:
                if readable == link:
                    program.listen()
                    continue
                lines = orders.read(readable)
                if lines is None:
                    return 0
                for line in lines:
                    program.order(line, now)
            program.tick(now)


if __name__ == "__main__":
    raise SystemExit(main())
