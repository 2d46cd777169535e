# SPDX-License-Identifier: GPL-3.0-or-later

"""ArduPilot's SITL program: where it is, and its command line. ArduPlane's (`arduplane.py`) takes the same one.

Facts that shape it: ports are given explicitly, because other programs use the defaults too (5760 and up) and SERIAL0
would wait for a client. The program flies whatever arrives on its radio-control port as stick positions, and two
programs may bind the same number there without an error: port 0 lets the kernel pick one that no other program has.
Relative paths (scripts, eeprom, logs, terrain) follow the working directory; `--defaults` splits its list at commas.
The program listens on every interface, not only on loopback. Clients here use 127.0.0.1; a host for which that matters
should have a firewall.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from sitl.vehicles.fetched import here
from sitl.vehicles.spec import LaunchError, VehicleSpec

__all__ = ["arguments_of", "command", "find_arducopter", "find_program"]


def find_arducopter(explicit: str | None = None) -> Path | None:
    """The SITL program: `explicit`, `$ARDUCOPTER`, `arducopter` on PATH, ~/ardupilot/build/sitl/bin, the one that was
    fetched (`fetched.py`); None if nowhere.

    Raises:
        LaunchError: `explicit` or `$ARDUCOPTER` names something that cannot be run.
    """
    return find_program("arducopter", explicit) or here()


def find_program(program: str, explicit: str | None) -> Path | None:
    """One of ArduPilot's SITL programs: `explicit`, the environment variable of its name, PATH, ~/ardupilot.

    Raises:
        LaunchError: `explicit` or the variable names something that cannot be run.
    """
    variable = program.upper()
    for source, name in ((f"--{program}", explicit), (f"${variable}", os.environ.get(variable))):
        if name:
            path = Path(name).expanduser()
            if not path.is_file() or not os.access(path, os.X_OK):
                raise LaunchError(f"{source}: {path} is not a program that can be run")
            return path.resolve()
    found = shutil.which(program)
    if found:
        return Path(found).resolve()
    built = Path.home() / "ardupilot" / "build" / "sitl" / "bin" / program
    return built if os.access(built, os.X_OK) else None


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
    return arguments_of(program, spec, spec.model or "quad", ports, parameters), {}


def arguments_of(
    program: Path, spec: VehicleSpec, model: str, ports: Mapping[int, int], parameters: list[Path]
) -> list[str]:
    """The command line of one of ArduPilot's SITL programs."""
    latitude, longitude, altitude, heading = spec.home
    arguments = [
        str(program),
        "--model",
        model,
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
    return arguments
