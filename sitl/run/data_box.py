# SPDX-License-Identifier: GPL-3.0-or-later

"""A position box for a simulated vehicle: a TCP server that sends records of the aircraft's true position.

Started as `python -m sitl.run.data_box --vehicle tcp:HOST:PORT --listen HOST:PORT [--sysid N] [--layout LAYOUT]`. The
layout is the thesis's (listing 5.7), `full`, or a file as `[position] layout` takes it. It asks the vehicle for
SIM_STATE, which is the simulation's own state and not the autopilot's estimate. It sends a record for each that comes,
and one for several that were waiting together.
Records leave in two pieces, cut at another byte each time. Its clock is UTC where the layout's is, else the wall's from
its own beginning. Its barometer has a day of low pressure: BaroHeight is LOW_PRESSURE_M above the height above sea
level. AglHeight counts from where the aircraft stood at first.

Commands on standard input, each answered by `ok` and the same, or by `error:` and why:

    stall               nothing is sent any more; connections stay
    resume              it sends again
    cut                 all connections are closed; a new one is served
    restart SECONDS     the box is gone for that time; a clock that is not UTC starts at 0

    drift NORTH EAST    its position drifts away, m/s; 0 0: it stays where it has drifted to

    carry NORTH EAST PACE
                        its position goes straight to so many metres from the true one, at so many m/s, and stays

    true                it sends the true position again
    garbage             a hundred bytes that are no record, to every client, in the middle of the stream
    thesis, full        its records are in this layout from now on, in new connections

When it listens and has heard the vehicle it prints `ready`. At the end, which is the end of its standard input, it
prints what it has sent.
"""

from __future__ import annotations

import argparse
import math
import select
import socket
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavproxy_handover.config.box_layouts import parse_layout
from mavproxy_handover.config.toml import ConfigError, read_file
from mavproxy_handover.mission.geodesy import offset
from mavproxy_handover.wire.box_layout import LAYOUTS, THESIS, BoxLayout, BoxRecord
from sitl.run.ending import Orders
from sitl.script.box_orders import parse_order

__all__ = ["LOW_PRESSURE_M", "DataBox", "main"]

_INTERVAL_US: Final = 40_000
#: States that were heard nearer to each other were waiting together: one record is sent. A box that measures sends none
#: in between.
_LEAST_S: Final = 0.001
_ASK_S: Final = 1.0
_COMPONENT: Final = mavlink.MAV_COMP_ID_USER2
#: a client that does not read is left behind
_MOST_WAITING: Final = 4096
#: 1005.7 hPa at sea level
LOW_PRESSURE_M: Final = 63.0
_GARBAGE: Final = bytes(range(0x80, 0xE4))
_BAD_USAGE: Final = 2


class DataBox:
    """The server. `clock` gives monotonic seconds."""

    def __init__(
        self, host: str, port: int, clock: Callable[[], float] = time.monotonic, layout: BoxLayout = THESIS
    ) -> None:
        """Listen. Raises OSError."""
        self._address = (host, port)
        self._clock = clock
        self._send_in(layout)
        #: where the aircraft stood at first, above sea level
        self._ground_m: float | None = None
        self._listener: socket.socket | None = self._listen()
        self._address = self._listener.getsockname() if self._listener is not None else self._address
        self._clients: dict[socket.socket, bytearray] = {}
        self._stalls = False
        self._back_at: float | None = None
        #: north, east: what has come together, and how fast it grows
        self._off_m = (0.0, 0.0)
        self._drift_mps = (0.0, 0.0)
        #: the place where that ends, for `carry`; None: it does not end
        self._carried_to: tuple[float, float] | None = None
        self._moved_at = clock()
        self._sent_at = -math.inf
        self._cut = 0
        self.sent = self.clients = 0

    def _send_in(self, layout: BoxLayout) -> None:
        """Its records are in this layout."""
        self._layout = layout
        #: when its own clock was zero
        self._began = self._clock() - time.time() if layout.utc else self._clock()

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._address[1])

    @property
    def descriptors(self) -> list[int]:
        """Descriptors to wait for: the listener's, and those of the clients."""
        listening = [] if self._listener is None else [self._listener.fileno()]
        return listening + [client.fileno() for client in self._clients]

    def _listen(self) -> socket.socket:
        listener = socket.create_server(self._address)
        listener.setblocking(False)
        return listener

    def readable(self) -> None:
        """A client connects, or closes."""
        if self._listener is not None:
            try:
                client, _ = self._listener.accept()
            except (BlockingIOError, InterruptedError, ConnectionError):
                pass
            else:
                client.setblocking(False)
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._clients[client] = bytearray()
                self.clients += 1
        for client in list(self._clients):
            try:
                gone = not client.recv(4096)
            except (BlockingIOError, InterruptedError):
                continue
            except OSError:
                gone = True
            if gone:
                self._part(client)

    def turn(self) -> None:
        """Time has passed: it may be back."""
        if self._back_at is not None and self._clock() >= self._back_at:
            self._back_at = None
            self._began = self._began if self._layout.utc else self._clock()
            self._listener = self._listen()

    def on_message(self, message: Any) -> None:
        """The simulation's state: send it."""
        now = self._clock()
        passed_s, self._moved_at = now - self._moved_at, now
        self._move(passed_s)
        north, east = self._off_m
        if self._stalls or self._listener is None or now - self._sent_at < _LEAST_S:
            return
        self._sent_at = now
        lat, lon = offset(message.lat_int / 1e7, message.lon_int / 1e7, east, north)
        north_mps, east_mps = message.vn + self._drift_mps[0], message.ve + self._drift_mps[1]
        self._ground_m = message.alt if self._ground_m is None else self._ground_m
        record = BoxRecord(
            now - self._began,
            lat,
            lon,
            alt_m=message.alt,
            baro_m=message.alt + LOW_PRESSURE_M,
            agl_m=message.alt - self._ground_m,
            north_mps=north_mps,
            east_mps=east_mps,
            down_mps=message.vd,
            track_deg=math.degrees(math.atan2(east_mps, north_mps)) % 360.0,
            speed_mps=math.hypot(north_mps, east_mps),
            roll_rad=message.roll,
            pitch_rad=message.pitch,
            heading_deg=math.degrees(message.yaw) % 360.0,
        )
        data = self._layout.pack(record)
        self._cut = (self._cut + 1) % len(data)
        for piece in (data[: self._cut], data[self._cut :]):
            self._send(piece)
        self.sent += 1

    def _move(self, passed_s: float) -> None:
        to, (north, east) = self._carried_to, self._off_m
        if to is not None and math.dist(to, self._off_m) <= math.hypot(*self._drift_mps) * passed_s:
            self._off_m, self._drift_mps, self._carried_to = to, (0.0, 0.0), None
            return
        self._off_m = (north + self._drift_mps[0] * passed_s, east + self._drift_mps[1] * passed_s)

    def _carry(self, to: tuple[float, float], pace_mps: float) -> None:
        away_m = math.dist(to, self._off_m)
        self._carried_to = to
        towards = (
            [(there - here) / away_m for there, here in zip(to, self._off_m, strict=True)] if away_m else [0.0, 0.0]
        )
        self._drift_mps = (towards[0] * pace_mps, towards[1] * pace_mps)

    def _send(self, data: bytes) -> None:
        for client, waiting in list(self._clients.items()):
            waiting.extend(data)
            try:
                del waiting[: client.send(waiting)]
            except (BlockingIOError, InterruptedError):
                pass
            except OSError:
                self._part(client)
                continue
            if len(waiting) > _MOST_WAITING:
                self._part(client)

    def _part(self, client: socket.socket) -> None:
        client.close()
        del self._clients[client]

    def order(self, line: str) -> str:
        """Carry out a line that was typed; returns the answer."""
        try:
            word, numbers = parse_order(line)
        except ValueError as error:
            return f"error: {error}"
        match word:
            case "stall" | "resume":
                self._stalls = word == "stall"
            case "cut":
                self._part_with_all()
            case "restart":
                self._part_with_all()
                if self._listener is not None:
                    self._listener.close()
                    self._listener = None
                self._back_at = self._clock() + numbers[0]
            case "drift":
                self._drift_mps, self._carried_to = (numbers[0], numbers[1]), None
            case "carry":
                self._carry((numbers[0], numbers[1]), numbers[2])
            case "true":
                self._drift_mps = self._off_m = (0.0, 0.0)
                self._carried_to = None
            case "garbage":
                self._send(_GARBAGE)
            case "thesis" | "full":
                self._part_with_all()
                self._send_in(LAYOUTS[word])
        return f"ok {line}"

    def _part_with_all(self) -> None:
        for client in list(self._clients):
            self._part(client)

    def close(self) -> None:
        """Give everything back."""
        self._part_with_all()
        if self._listener is not None:
            self._listener.close()


class _Vehicle:
    """The vehicle's port, from which the simulation's state comes. It must not disturb what it looks at, so it sends no
    heartbeat, and asks the autopilot alone."""

    def __init__(self, address: tuple[str, int], sysid: int) -> None:
        """Raises OSError."""
        self._sysid = sysid
        self._socket = socket.create_connection(address, timeout=10.0)
        self._socket.setblocking(False)
        self._mav: Any = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=_COMPONENT)
        self._mav.robust_parsing = True
        self._ask_at = -math.inf
        self.heard = False

    def fileno(self) -> int:
        return self._socket.fileno()

    def ask(self, now: float) -> None:
        """Ask for the state, until it comes."""
        if self.heard or now < self._ask_at:
            return
        self._ask_at = now + _ASK_S
        wish = (mavlink.MAVLINK_MSG_ID_SIM_STATE, _INTERVAL_US, 0, 0, 0, 0, 0)
        target = (self._sysid, mavlink.MAV_COMP_ID_AUTOPILOT1)
        message = mavlink.MAVLink_command_long_message(*target, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, *wish)
        self._socket.send(message.pack(self._mav))

    def read(self) -> list[Any]:
        """The states that have come. Raises OSError, also at the vehicle's end."""
        try:
            data = self._socket.recv(65536)
        except (BlockingIOError, InterruptedError):
            return []
        if not data:
            raise ConnectionError("the vehicle has gone")
        found = [m for m in self._mav.parse_buffer(data) or () if m.get_type() == "SIM_STATE"]
        self.heard = self.heard or bool(found)
        return found

    def close(self) -> None:
        self._socket.close()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the box until standard input ends. Exit codes: 2, wrong usage or an address that cannot be used; 1, the
    vehicle has gone."""
    parser = argparse.ArgumentParser(prog="python -m sitl.run.data_box", description="A position box, simulated.")
    parser.add_argument("--vehicle", type=_address, required=True, metavar="tcp:HOST:PORT", help="of the simulation")
    parser.add_argument("--listen", type=_address, required=True, metavar="HOST:PORT", help="where clients connect")
    parser.add_argument("--sysid", type=int, default=1, metavar="N", help="the vehicle's system id (default: 1)")
    parser.add_argument(
        "--layout", type=_layout, default=THESIS, metavar="LAYOUT", help="thesis (default), full, or a layout's file"
    )
    arguments = parser.parse_args(argv)
    try:
        vehicle = _Vehicle(arguments.vehicle, arguments.sysid)
        host, port = arguments.listen
        box = DataBox(host, port, layout=arguments.layout)
    except OSError as error:
        print(f"data box: {error}", file=sys.stderr)
        return _BAD_USAGE
    orders = Orders()
    try:
        _serve(vehicle, box, orders)
    except OSError as error:
        print(f"data box: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        pass
    finally:
        box.close()
        vehicle.close()
        print(f"{box.sent} records sent, to {box.clients} connections", flush=True)
    return 0


def _address(text: str) -> tuple[str, int]:
    """Raises ArgumentTypeError."""
    host, _, port = text.removeprefix("tcp:").partition(":")
    if not host or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise argparse.ArgumentTypeError(f"{text!r} must be HOST:PORT")
    return host, int(port)


def _layout(text: str) -> BoxLayout:
    """Raises ArgumentTypeError."""
    if text in LAYOUTS:
        return LAYOUTS[text]
    try:
        return parse_layout(read_file(Path(text)), Path(text))
    except ConfigError as error:
        raise argparse.ArgumentTypeError(f"{error} (known layouts: {', '.join(LAYOUTS)})") from None


def _serve(vehicle: _Vehicle, box: DataBox, orders: Orders) -> None:
    told = False
    while True:
        vehicle.ask(time.monotonic())
        box.turn()
        waited_for = [*orders.descriptors, vehicle.fileno(), *box.descriptors]
        readable, _, _ = select.select(waited_for, [], [], 0.2)
        for message in vehicle.read()[-1:]:  # of those that come at once the newest: a box has no two at one time
            box.on_message(message)
        if vehicle.heard and not told:
            told = True
            print("ready", flush=True)
        box.readable()
        for descriptor in readable:
            if descriptor in orders.descriptors:
                typed = orders.read(descriptor)
                if typed is None:
                    return
                for line in typed:
                    print(box.order(line), flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
