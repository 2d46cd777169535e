# SPDX-License-Identifier: GPL-3.0-or-later

"""ArduPlane's SITL program, as a quadplane or as a plane: where it is, and its command line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from sitl.vehicles.arducopter import arguments_of, find_program
from sitl.vehicles.spec import Command, LaunchError, VehicleSpec

__all__ = ["find_arduplane", "flying"]


def find_arduplane(explicit: str | None = None) -> Path | None:
    """The SITL program: `explicit`, `$ARDUPLANE`, `arduplane` on PATH, ~/ardupilot/build/sitl/bin; None if nowhere.

    Raises:
        LaunchError: `explicit` or `$ARDUPLANE` names something that cannot be run.
    """
    return find_program("arduplane", explicit)


def flying(model: str) -> Command:
    """The function that makes the command line for that model, unless the specification names another."""

    def command(
        spec: VehicleSpec, ports: Mapping[int, int], parameters: list[Path]
    ) -> tuple[list[str], dict[str, str]]:
        program = find_arduplane(spec.arduplane)
        if program is None:
            raise LaunchError(
                "no arduplane found: give --arduplane PATH, set $ARDUPLANE, or build it in ~/ardupilot (waf plane)"
            )
        return arguments_of(program, spec, spec.model or model, ports, parameters), {}

    return command
