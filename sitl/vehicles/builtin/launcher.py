# SPDX-License-Identifier: GPL-3.0-or-later

"""Command line of the built-in vehicle, for `sitl.vehicles.launch`."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from sitl.sim_time import in_sim_time
from sitl.vehicles.spec import VehicleSpec

__all__ = ["command"]


def command(spec: VehicleSpec, ports: Mapping[int, int], parameters: list[Path]) -> tuple[list[str], dict[str, str]]:
    """Arguments and extra environment that start the model; it runs from the same installation as the caller."""
    page = None if spec.leads else spec.clock
    arguments = [
        sys.executable,
        "-m",
        "sitl.vehicles.builtin",
        "--home=" + ",".join(f"{value:.8f}" for value in spec.home),
        "--sysid",
        str(spec.sysid),
        "--speedup",
        f"{1.0 if page is not None else spec.speedup:g}",
        "--scripts",
        "scripts",
        "--defaults",
        ",".join(path.name for path in parameters),
    ]
    if page is not None:  # its steps go by the page, as they go by the wall clock else
        arguments = list(in_sim_time(page, arguments))
    elif spec.clock is not None:
        arguments.append(f"--clock={spec.clock}")
    for serial, port in ports.items():
        arguments += [f"--serial{serial}", f"tcp:{port}"]
    root = str(Path(__file__).resolve().parents[3])
    search = os.pathsep.join(part for part in (root, os.environ.get("PYTHONPATH", "")) if part)
    return arguments, {"PYTHONPATH": search, "PYTHONUNBUFFERED": "1"}
