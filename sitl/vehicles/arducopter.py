# SPDX-License-Identifier: GPL-3.0-or-later

"""ArduPilot's SITL program: where it is, and its command line.

Facts that shape it: ports are given explicitly, because the defaults (5760 and up) are everybody's and SERIAL0
would wait for a client. Whatever arrives on its radio-control port is flown as stick positions, and two
programs may bind the same number there without an error: port 0 lets the kernel pick one that nobody else has.
Relative paths (scripts, eeprom, logs, terrain) follow the working directory; `--defaults` splits its list at
commas. The program listens on every interface, not only on loopback; clients here use 127.0.0.1, and a host
that minds should have a firewall.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from sitl.vehicles.fetched import here
from sitl.vehicles.spec import LaunchError, VehicleSpec

__all__ = ["command", "find_arducopter"]


def find_arducopter(explicit: str | None = None) -> Path | None:
    """The SITL program: `explicit`, `$ARDUCOPTER`, `arducopter` on PATH, ~/ardupilot/build/sitl/bin, the one that was
    fetched (`fetched.py`); None if nowhere.

    Raises:
        LaunchError: `explicit` or `$ARDUCOPTER` names something that cannot be run.
    """
    for source, name in (("--arducopter", explicit), ("$ARDUCOPTER", os.environ.get("ARDUCOPTER"))):
        if name:
            path = Path(name).expanduser()
            if not path.is_file() or not os.access(path, os.X_OK):
                raise LaunchError(f"{source}: {path} is not a program that can be run")
            return path.resolve()
    found = shutil.which("arducopter")
    if found:
        return Path(found).resolve()
    built = Path.home() / "ardupilot" / "build" / "sitl" / "bin" / "arducopter"
    return built if os.access(built, os.X_OK) else here()


def command(spec: VehicleSpec, ports: Mapping[int, int], parameters: list[Path]) -> tuple[list[str], dict[str, str]]:
    """Arguments and extra environment that start the program.

    Raises:
        LaunchError: no program found.
    """
    program = find_arducopter(spec.arducopter)
    if program is None:
        raise LaunchError(
            "no arducopter found: give --arducopter PATH, set $ARDUCOPTER, build it in ~/ardupilot (waf copter), or "
            "bring it with handover sim --fetch-arducopter"
        )
    latitude, longitude, altitude, heading = spec.home
    arguments = [
        str(program),
        "--model",
        spec.model,
        "--wipe",
        "--speedup",
        f"{spec.speedup:g}",
        "--home",
        f"{latitude:.8f},{longitude:.8f},{altitude:.2f},{heading:.1f}",
        "--sysid",
        str(spec.sysid),
        "--defaults",
        ",".join(path.name for path in parameters),
        "--rc-in-port",
        "0",
    ]
    for serial, port in ports.items():
        arguments += [f"--serial{serial}", f"tcp:{port}"]
    return arguments, {}
