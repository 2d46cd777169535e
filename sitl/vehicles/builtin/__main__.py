# SPDX-License-Identifier: GPL-3.0-or-later

"""The built-in vehicle as a process: TCP ports on 127.0.0.1, paced by the wall clock.

One client at a time per port, like a serial line; a new one takes the place of the old. Simulated time runs at
`--speedup` times the wall clock in steps of 10 ms; between steps the process sleeps in select, and input is
handled when it comes. If the machine cannot keep up, simulated time falls behind rather than jumping.
"""

from __future__ import annotations

import argparse
import select
import signal
import socket
import sys
import time
from pathlib import Path

from sitl.sim_time import Pace, Page
from sitl.vehicles.builtin import NOT_MODELLED
from sitl.vehicles.builtin.vehicle import STEP_S, Vehicle, VehicleConfig

__all__ = ["main"]

#: Sleep at least this long between bursts of steps, so that high speed-ups do not spin.
_MIN_SLEEP_S = 0.004
#: Furthest that simulated time may catch up at once.
_MAX_BURST_S = 0.5
#: The same where the clocks of others go on with each burst.
_FOLLOWED_BURST_S = 0.05
_CHUNK = 65536
_SPEEDUPS = (0.1, 100)
_SERIALS = (0, 1, 2)


class Port:
    """A listening TCP port and its client."""

    def __init__(self, serial: int, number: int) -> None:
        self.serial = serial
        self.listener = socket.create_server(("127.0.0.1", number), backlog=2)
        self.listener.setblocking(False)
        self.client: socket.socket | None = None
        print(f"SERIAL{serial} on TCP port {self.listener.getsockname()[1]}", flush=True)

    def accept(self, vehicle: Vehicle) -> None:
        try:
            client, _ = self.listener.accept()
        except OSError:
            return
        self.drop(vehicle)
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.client = client
        vehicle.links[self.serial].attach()
        print(f"New connection on SERIAL{self.serial}", flush=True)

    def read(self, vehicle: Vehicle) -> None:
        if self.client is None:
            return
        try:
            data = self.client.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            vehicle.receive(self.serial, data)
        else:
            self.drop(vehicle)
            print(f"Closed connection on SERIAL{self.serial}", flush=True)

    def write(self, vehicle: Vehicle) -> None:
        link = vehicle.links[self.serial]
        if self.client is None or not link.pending:
            return
        data = link.take()
        try:
            sent = self.client.send(data)
        except BlockingIOError:
            sent = 0
        except OSError:
            self.drop(vehicle)
            return
        if sent < len(data):
            link.give_back(data[sent:])

    def drop(self, vehicle: Vehicle) -> None:
        if self.client is not None:
            self.client.close()
            self.client = None
            vehicle.links[self.serial].detach()


def run(vehicle: Vehicle, ports: list[Port], radio: socket.socket, page: Page | None = None) -> None:
    """Serve until SIGTERM or SIGINT, at the pace of SIM_SPEEDUP, which may change on the way.

    `page`: where the programs of the simulation read their time; the vehicle waits for those that are late.
    """
    pace = None if page is None else Pace(page)
    running = [True]
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: running.clear())
    behind_s, last_s = 0.0, time.monotonic()
    while running:
        speedup = min(max(vehicle.parameters["SIM_SPEEDUP"], _SPEEDUPS[0]), _SPEEDUPS[1])
        sockets = [radio, *(s for port in ports for s in (port.listener, port.client) if s is not None)]
        wait_s = max(_MIN_SLEEP_S, (STEP_S - behind_s) / speedup)
        try:
            readable, _, _ = select.select(sockets, [], [], wait_s)
        except InterruptedError:
            continue
        if radio in readable:
            vehicle.radio.receive(radio.recv(_CHUNK))
        for port in ports:
            if port.listener in readable:
                port.accept(vehicle)
            elif port.client in readable:
                port.read(vehicle)
        now_s = time.monotonic()
        behind_s = min(behind_s + (now_s - last_s) * speedup, max(_MAX_BURST_S, 4 * _MIN_SLEEP_S * speedup))
        last_s = now_s
        if pace is not None and not pace.may_go_on(vehicle.copter.time_s):
            behind_s = 0.0
        if pace is not None:
            behind_s = min(behind_s, _FOLLOWED_BURST_S)
        while behind_s >= STEP_S:
            behind_s -= STEP_S
            vehicle.step(STEP_S)
        for port in ports:
            port.write(vehicle)
        if page is not None:
            page.write(vehicle.copter.time_s, speedup)


def _home(text: str) -> tuple[float, float, float, float]:
    parts = tuple(float(part) for part in text.split(","))
    if len(parts) != 4 or not abs(parts[0]) <= 90 or not abs(parts[1]) <= 180:
        raise argparse.ArgumentTypeError(f"'{text}' is not LAT,LON,ALT,HEADING")
    return parts[0], parts[1], parts[2], parts[3]


def _port(text: str) -> int:
    kind, _, number = text.partition(":")
    if kind != "tcp" or not number.isdigit() or not 0 <= int(number) < 65536:
        raise argparse.ArgumentTypeError(f"'{text}' is not tcp:PORT")
    return int(number)


def _speedup(text: str) -> float:
    value = float(text)
    if not _SPEEDUPS[0] <= value <= _SPEEDUPS[1]:
        raise argparse.ArgumentTypeError(f"speed-up {text} is not between {_SPEEDUPS[0]} and {_SPEEDUPS[1]}")
    return value


def _joined(arguments: list[str]) -> list[str]:
    """`--home X` as `--home=X`: argparse takes a place south of the equator for an option, ArduPilot's program not."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--home":
            joined[-1] = f"--home={argument}"
        else:
            joined.append(argument)
    return joined


def parse(arguments: list[str]) -> argparse.Namespace:
    """The command line; options as ArduPilot's SITL program names them, values in both of its spellings."""
    parser = argparse.ArgumentParser(
        prog="python -m sitl.vehicles.builtin",
        description="A small copter model that speaks what ArduCopter speaks here, and runs its Lua scripts.",
        epilog="Not modelled:\n" + "\n".join(f"  - {line}" for line in NOT_MODELLED),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for serial in _SERIALS:
        parser.add_argument(
            f"--serial{serial}", type=_port, metavar="tcp:PORT", help=f"MAVLink channel {serial}, on 127.0.0.1"
        )
    parser.add_argument("--home", type=_home, required=True, metavar="LAT,LON,ALT,HEADING")
    parser.add_argument("--defaults", default="", metavar="FILE,...", help="parameter files, the last word wins")
    parser.add_argument("--speedup", type=_speedup, default=1.0, metavar="N")
    parser.add_argument("--clock", type=Path, metavar="PAGE", help="page of simulated time for others")
    parser.add_argument("--sysid", type=int, default=1, choices=range(1, 256), metavar="ID")
    parser.add_argument(
        "--rc-in-port", type=int, default=0, metavar="PORT", help="UDP port for pulse widths of a transmitter, 0: any"
    )
    parser.add_argument("--scripts", type=Path, metavar="DIR", help="run the Lua scripts in this directory")
    options = parser.parse_args(_joined(arguments))
    if all(getattr(options, f"serial{serial}") is None for serial in _SERIALS):
        parser.error("give at least one of --serial0 to --serial2")
    return options


def _print(line: str) -> None:
    print(line, flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Run the process; returns its exit code."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    numbers = {serial: getattr(options, f"serial{serial}") for serial in _SERIALS}
    numbers = {serial: number for serial, number in numbers.items() if number is not None}
    scripts = tuple(sorted(options.scripts.glob("*.lua"))) if options.scripts is not None else ()
    try:
        vehicle = Vehicle(
            VehicleConfig(
                home=options.home,
                sysid=options.sysid,
                defaults=tuple(Path(name) for name in options.defaults.split(",") if name),
                scripts=scripts,
                channels=tuple(numbers),
                speedup=options.speedup,
                unix_start_us=round(time.time() * 1e6),
                record=_print,
            )
        )
        ports = [Port(serial, number) for serial, number in numbers.items()]
        page = None if options.clock is None else Page(options.clock)
        radio = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        radio.bind(("127.0.0.1", options.rc_in_port))
    except (OSError, ValueError) as error:
        print(f"builtin vehicle: {error}", file=sys.stderr)
        return 2
    if vehicle.unknown_parameters:
        print(f"{vehicle.unknown_parameters} parameters of the files are not modelled", flush=True)
    run(vehicle, ports, radio, page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
