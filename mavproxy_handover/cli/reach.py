# SPDX-License-Identifier: GPL-3.0-or-later

"""Why a link of MAVProxy will not open, in one line: what is wrong, and what to do.

MAVProxy opens `--master` itself and says little when that fails. So this looks first: at the file of a serial line, at
the address of a name, and whether a program on this machine has the port. It opens no line and connects to nothing.
What is found is only told: MAVProxy still tries, because the other end may be on its way.
"""

from __future__ import annotations

import getpass
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Final

from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError, parse_device

__all__ = ["trouble"]

#: where Linux lists serial lines: those with a name of their own, then USB devices, then UARTs
_LINES: Final = ("serial/by-id/*", "ttyACM*", "ttyUSB*", "ttyTHS*", "ttyAMA*")


def trouble(master: str, devices: Path = Path("/dev")) -> str | None:
    """What is wrong with a link that MAVProxy is to open, and what to do; None: nothing that shows.

    `master`: a device string of MAVProxy, perhaps with a label in braces after it. `devices`: where serial lines are.
    """
    try:
        spec = parse_device(master.partition(":{")[0].partition("{")[0])
    except LinkError:
        return None  # MAVProxy has more forms than we have
    if spec.kind is Kind.SERIAL:
        return _serial(Path(spec.host), devices)
    return _host(spec)


def _serial(line: Path, devices: Path) -> str | None:
    if not line.exists():
        there = ", ".join(_lines(devices)) or "none"
        return f"There is no serial line {line}. Plug it in, or name another one. Lines here: {there}."
    if not os.access(line, os.R_OK | os.W_OK):
        user = getpass.getuser()
        return f"{user} may not open {line}. Run 'sudo usermod -aG dialout {user}' and log in again."
    return None


def _lines(devices: Path) -> Iterator[str]:
    for pattern in _LINES:
        yield from map(str, sorted(devices.glob(pattern)))


def _host(spec: DeviceSpec) -> str | None:
    try:
        found = socket.getaddrinfo(spec.host, spec.port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return f"No address is known for the name {spec.host}. Look at its spelling, and at this machine's network."
    host = found[0][4][0]
    if spec.kind is Kind.TCP_OUT and _refuses(str(host), spec.port):
        return f"Nothing listens at {spec.host}:{spec.port} (TCP). Start the program there first, or give another port."
    return None


def _refuses(host: str, port: int) -> bool:
    """Whether no program of this machine has that port. Another machine is not asked: it may take one connection."""
    if not host.startswith(("127.", "::1")) or sys.platform != "linux":
        return False
    with closing(socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)) as probe:
        try:
            probe.bind((host, port))
        except OSError:
            return False
        return True
