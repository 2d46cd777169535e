# SPDX-License-Identifier: GPL-3.0-or-later

"""Programs of ArduPilot's SITL that tests are given: which vehicle and which version each of them is."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

#: what every ArduPilot program calls itself, and says when it starts
_BANNER = re.compile(rb"Ardu(Copter|Plane|Rover) V(\d+\.\d+\.\d+[-\w]*)")


class NotFirmware(ValueError):
    """The file is not a program of ArduPilot's SITL; the message names it."""


@dataclass(frozen=True, slots=True)
class Firmware:
    """One program."""

    vehicle: str
    """Copter, Plane or Rover."""
    version: str
    """As it says itself: 4.6.3, 4.7.0-dev."""
    program: Path

    @property
    def numbers(self) -> tuple[int, int]:
        """Major and minor version."""
        major, minor, *_ = self.version.split(".")
        return int(major), int(minor)

    @property
    def gcs_id(self) -> str:
        """The parameter that names the autopilot's ground station."""
        return "MAV_GCS_SYSID" if self.numbers >= (4, 7) else "SYSID_MYGCS"

    def __str__(self) -> str:
        return f"{self.vehicle} {self.version}"


def firmware_of(program: Path) -> Firmware:
    """Reads the version out of the program itself.

    Raises:
        NotFirmware: there is no such file, or no vehicle's banner in it.
    """
    try:
        banner = _BANNER.search(program.read_bytes())
    except OSError as error:
        raise NotFirmware(f"{program} cannot be read: {error.strerror}") from error
    if banner is None:
        raise NotFirmware(f"{program} is no ArduCopter, ArduPlane or ArduRover")
    return Firmware(banner[1].decode(), banner[2].decode(), program.resolve())
