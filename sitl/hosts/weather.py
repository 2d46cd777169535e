# SPDX-License-Identifier: GPL-3.0-or-later

"""Delay and loss of the LTE path: netem of the kernel, or a program that does the same.

`python -m sitl.hosts.weather` runs on the host of the path. Rules lead what the other hosts send there through a TUN
device to this program. It delays packets and drops some (`sitl.run.impairment`), and writes the rest back to the
kernel, which forwards them. When the device is ready it prints `ready`. It ends when its input does.
"""

from __future__ import annotations

import argparse
import heapq
import itertools
import os
import select
import shutil
import struct
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from sitl.hosts.namespaces import Namespaces, inside, is_inside, run
from sitl.hosts.plan import LTE
from sitl.run.ending import Orders
from sitl.run.impairment import Impairment
from sitl.run.wiring import Program
from sitl.script.places import SetupError
from sitl.script.weather import Weather

__all__ = ["WEATHER", "can", "main", "netem", "program"]

#: of the LTE path, one way: a good cell, and what a moving aircraft makes of it
WEATHER: Final = Weather(delay_s=0.04, jitter_s=0.01, loss=0.01)
_NETEM: Final = ("delay", "45ms", "5ms", "loss", "1%")
_DEVICE: Final = "weather0"
_TABLE: Final = 100
_TUN: Final = Path("/dev/net/tun")
_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
_PACKET_BYTES: Final = 65536
_IN_FLIGHT: Final = 20_000


def netem(namespaces: Namespaces) -> str:
    """Give the LTE network's interfaces delay and loss by netem; returns why that cannot be, "" if it is done."""
    if shutil.which("tc") is None:
        return "the program tc is missing"
    names = [each.name for each in namespaces.plan.host(LTE).interfaces]
    for name in names:
        try:
            run([*inside(LTE), "tc", "qdisc", "add", "dev", name, "root", "netem", *_NETEM])
        except SetupError:
            return "this kernel has no netem"
    return ""


def can() -> bool:
    """Whether the program can take the place of netem here."""
    return _TUN.exists()


def program(interfaces: Sequence[str], folder: Path) -> Program:
    """The program that takes the place of netem, for what comes in by these interfaces of the LTE network."""
    argv = (*inside(LTE), sys.executable, "-m", "sitl.hosts.weather", *interfaces)
    return Program("lte-weather", argv, folder)


def _open() -> int:
    """The TUN device. Raises OSError."""
    import fcntl  # not on every system that the command is tried on

    device = os.open(_TUN, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH22x", _DEVICE.encode(), _IFF_TUN | _IFF_NO_PI))
    return device


def _lead(names: Sequence[str]) -> None:
    """Lead packets that arrive by these interfaces to the device. Raises SetupError."""
    for name in ("all", "default", _DEVICE):  # a packet comes back by another interface than its answer leaves by
        Path(f"/proc/sys/net/ipv4/conf/{name}/rp_filter").write_text("0", encoding="ascii")
    run(["ip", "link", "set", _DEVICE, "up"])
    run(["ip", "route", "add", "100.64.0.0/16", "dev", _DEVICE, "table", str(_TABLE)])
    for name in names:
        run(["ip", "rule", "add", "iif", name, "lookup", str(_TABLE)])


def main(argv: Sequence[str] | None = None) -> int:
    """Run until the input ends. Exit code 2: the device cannot be made, or this is no host of the bench."""
    parser = argparse.ArgumentParser(prog="python -m sitl.hosts.weather", description="Delay and loss of a path.")
    parser.add_argument("interfaces", nargs="+", help="what comes in by these has the weather")
    arguments = parser.parse_args(argv)
    if not is_inside(LTE):
        print("weather: this is no host of the bench: its rules would be this machine's", file=sys.stderr)
        return 2
    orders = Orders()
    try:
        device = _open()
        _lead(arguments.interfaces)
    except (OSError, SetupError) as error:
        print(f"weather: {error}", file=sys.stderr)
        return 2
    print("ready", flush=True)
    _serve(device, orders)
    return 0


def _serve(device: int, orders: Orders) -> None:
    #: pair of addresses -> that direction
    directions: dict[bytes, Impairment] = {}
    heap: list[tuple[float, int, bytes]] = []
    number = itertools.count()
    while True:
        wait_s = max(0.0, heap[0][0] - time.monotonic()) if heap else None
        readable, _, _ = select.select([device, *orders.descriptors], [], [], wait_s)
        if any(each != device and orders.read(each) is None for each in readable):
            return
        now = time.monotonic()
        if device in readable:
            try:
                packet = os.read(device, _PACKET_BYTES)
            except BlockingIOError:
                packet = b""
            if len(packet) >= 20 and packet[0] >> 4 == 4 and len(heap) < _IN_FLIGHT:
                pair = packet[12:20]
                direction = directions.setdefault(pair, Impairment(f"lte/{pair.hex()}", WEATHER))
                for at, copy in direction.plan(packet, now):
                    heapq.heappush(heap, (at, next(number), copy))
        while heap and heap[0][0] <= now:
            try:
                os.write(device, heapq.heappop(heap)[2])
            except OSError:  # the device is full: a packet is lost
                pass


if __name__ == "__main__":
    raise SystemExit(main())
