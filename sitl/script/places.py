# SPDX-License-Identifier: GPL-3.0-or-later

"""Where missions, guard and scenarios lie, and what is wrong when they are not there."""

from __future__ import annotations

from pathlib import Path

import sitl
from mavproxy_handover.tools import resources
from mavproxy_handover.vehicle.profiles import ASSUMED, Profile

__all__ = ["SCENARIOS", "SetupError", "guard_files", "mission_folder"]

SCENARIOS = Path(sitl.__file__).resolve().parent / "scenarios"


class SetupError(Exception):
    """A simulation cannot be set up. The message is one line for people."""


def mission_folder(name: str) -> Path:
    """The folder of a mission that ships, or any folder named by its path. Raises SetupError."""
    shipped = resources.shipped("missions")
    for folder in (shipped / name, Path(name).expanduser()):
        if (folder / "mission.toml").is_file():
            return folder.resolve()
    known = ", ".join(sorted(path.parent.name for path in shipped.glob("*/mission.toml"))) or "none"
    raise SetupError(f"no mission {name!r} (known: {known}; or the path of a folder with a mission.toml)")


def guard_files(profile: Profile = ASSUMED) -> tuple[Path, tuple[Path, ...]]:
    """The guard's script and its parameter files for an aircraft of that profile. Raises SetupError."""
    folder = resources.shipped("ardupilot_lua")
    script = folder / "handover_guard.lua"
    parameters = folder / profile.parameter_file
    for path in (script, parameters):
        if not path.is_file():
            raise SetupError(f"{path} is missing: the guard cannot be put on the vehicle")
    return script, (parameters,)
