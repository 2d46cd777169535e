# SPDX-License-Identifier: GPL-3.0-or-later

"""What is looked at: the machine below a root, its configuration, its unit, who runs it, and what was found so far.

All paths of a configuration are those of that machine: below another root they lie there (`at`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from pathlib import Path, PurePosixPath
from typing import Final

from mavproxy_handover.cli.machine import CONFIGURATION, below
from mavproxy_handover.clocks import Clocks
from mavproxy_handover.config.files import ConfigError, load_station
from mavproxy_handover.config.station import StationConfig
from mavproxy_handover.config.vehicle import VehicleConfig, load_vehicle
from mavproxy_handover.doctor.accounts import Account, account_of, myself
from mavproxy_handover.doctor.processes import Process, companion_of, lock_holder
from mavproxy_handover.doctor.units import Unit, read_unit
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["CompanionStarted", "Patient", "admit"]

#: whose files `handover install` lays out, whatever runs them
_USER: Final = "handover"


#: how often (s) it is looked whether a companion has been started
_LOOK_S: Final = 0.2


class CompanionStarted(Exception):
    """A companion has been started: what is open here belongs to it."""


@dataclass(slots=True)
class Patient:
    """A companion's machine or a station's."""

    #: "companion" or "station"
    kind: str
    root: Path
    #: its configuration file, and what that says: one of the two, or neither and why
    path: Path
    vehicle: VehicleConfig | None
    station: StationConfig | None
    config_error: str
    #: what has systemd run it, or why that cannot be read
    unit: Unit | None
    unit_error: str
    #: who runs it: the service's user, where the configuration is the installed one
    account: Account
    #: the user that the unit names does not exist
    account_missing: str
    #: the companion that runs already
    running: Process | None
    #: the autopilot's line, or a station's link, if it was named
    device: str | None
    #: whether stations may be asked for round trips
    links: bool
    clocks: Clocks
    #: told what takes a while
    tell: Callable[[str], None]
    # ---- what the checks have found out, for those behind them
    #: nothing may be signed with such a clock
    clock_wrong: bool = False
    #: the mission package that is on board
    package: MissionPackage | None = None
    #: of a station: vehicle -> digest of its package here
    digests: dict[int, bytes] = field(default_factory=dict)
    #: what the autopilot says of itself
    aircraft: VehicleState = field(default_factory=VehicleState)

    looked_at: float = -inf

    def look_out(self) -> None:
        """To be called often while a link, a port or a line is open here. Raises CompanionStarted as soon as a
        companion of this vehicle runs: it must find them free."""
        now = self.clocks.monotonic()
        if self.vehicle is None or now - self.looked_at < _LOOK_S:
            return
        self.looked_at = now
        self.running = self._who_runs()
        if self.running is not None:
            raise CompanionStarted

    def look_again(self) -> None:
        """Whether a companion of this vehicle runs by now."""
        self.running = self._who_runs()

    def _who_runs(self) -> Process | None:
        if self.vehicle is None:
            return None
        folder = self.vehicle.state or self.vehicle.journal.parent
        holder = lock_holder(self.at(folder) / f"{self.vehicle.name}.lock")
        return companion_of(self.path) if holder is None else holder

    def at(self, path: Path | PurePosixPath) -> Path:
        """Where a path of that machine lies on this one."""
        path = Path(path)
        inside = self.root == Path("/") or path.is_relative_to(self.root)
        return path if inside or not path.is_absolute() else below(self.root, PurePosixPath(path))

    @property
    def installed(self) -> bool:
        """Whether the configuration is the one that `handover install` writes."""
        return self.path == below(self.root, CONFIGURATION[self.kind])

    @property
    def master(self) -> str | None:
        """The autopilot's line, or a station's link: as named, else as the unit has it."""
        if self.device is not None or self.unit is None or not self.installed:
            return self.device
        return self.unit.option("--master")


def admit(
    kind: str, root: Path, path: Path, device: str | None, links: bool, clocks: Clocks, tell: Callable[[str], None]
) -> Patient:
    """Read what every check needs. Raises OSError where the configuration may not be read."""
    vehicle, station, config_error = _config(kind, path)
    unit, unit_error = None, ""
    try:
        unit = read_unit(kind, root)
    except (OSError, ValueError) as error:
        unit_error = str(error)
    patient = Patient(
        kind=kind,
        root=root,
        path=path,
        vehicle=vehicle,
        station=station,
        config_error=config_error,
        unit=unit,
        unit_error=unit_error,
        account=myself(),
        account_missing="",
        running=None,
        device=device,
        links=links,
        clocks=clocks,
        tell=tell,
    )
    if patient.installed:
        user = _USER if unit is None else unit.user
        named = account_of(user, root)
        # a system that was never started has no such user yet: systemd-sysusers makes it
        patient.account = named or patient.account
        patient.account_missing = "" if named is not None or unit is None else user
    patient.look_again()
    return patient


def _config(kind: str, path: Path) -> tuple[VehicleConfig | None, StationConfig | None, str]:
    with path.open("rb"):  # who may not read it shall hear that, and not that it is wrong
        pass
    try:
        if kind == "companion":
            return load_vehicle(path), None, ""
        return None, load_station(path), ""
    except ConfigError as error:
        return None, None, str(error)
