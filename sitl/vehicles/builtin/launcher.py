# SPDX-License-Identifier: GPL-3.0-or-later

"""Command line of the built-in vehicle, for `sitl.vehicles.launch`."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from sitl.vehicles.spec import VehicleSpec

__all__ = ["command"]


def command(spec: VehicleSpec, ports: Mapping[int, int], parameters: list[Path]) -> tuple[list[str], dict[str, str]]:
    """Arguments and extra environment that start the model; it runs from the same installation as the caller."""
    arguments = [
        sys.executable,
        "-m",
        "sitl.vehicles.builtin",
        "--verbose",
        "--home=" + ",".join(f"{value:.8f}" for value in spec.home),
        "--sysid",
        str(spec.sysid),
        "--speedup",
        f"{spec.speedup:g}",
        "--scripts",
        "scripts",
        "--defaults",
        ",".join(path.name for path in parameters),
    ]
    for serial, port in ports.items():
        arguments += [f"--serial{serial}", f"tcp:{port}"]
    root = str(Path(__file__).resolve().parents[3])
    search = os.pathsep.join(part for part in (root, os.environ.get("PYTHONPATH", "")) if part)
    return arguments, {"PYTHONPATH": search, "PYTHONUNBUFFERED": "1"}
