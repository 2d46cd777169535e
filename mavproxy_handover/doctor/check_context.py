# SPDX-License-Identifier: GPL-3.0-or-later

"""Context of all checks: the machine below a root, its configuration, its unit, its account, and results so far.

Paths of a configuration belong to that machine: below another root they are there (`at`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from pathlib import Path, PurePosixPath
from typing import Final

from mavproxy_handover.cli.machine import CONFIGURATION, below
from mavproxy_handover.config.files import ConfigError, load_station
from mavproxy_handover.config.station import StationConfig
from mavproxy_handover.config.vehicle import VehicleConfig, load_vehicle
from mavproxy_handover.doctor.accounts import Account, account_of, myself
from mavproxy_handover.doctor.processes import Process, companion_of, lock_holder
from mavproxy_handover.doctor.units import Unit, read_unit
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["CompanionStarted", "CheckContext", "admit"]

#: owner of the files of `handover install`
_USER: Final = "handover"


#: interval (s) of checking whether a companion has been started
_LOOK_S: Final = 0.2


class CompanionStarted(Exception):
    """A companion has been started: it needs the ports and lines that are open here."""


@dataclass(slots=True)
class CheckContext:
    """A companion's machine or a station's."""

    #: "companion" or "station"
    kind: str
    root: Path
    #: its configuration file, and its content: one of the two, or neither and the error
    path: Path
    vehicle: VehicleConfig | None
    station: StationConfig | None
    config_error: str
    #: its systemd unit, or why that cannot be read
    unit: Unit | None
    unit_error: str
    #: the user that runs it: the service's user, if the configuration is the installed one
    account: Account
    #: the unit's user, if it does not exist
    account_missing: str
    #: the running companion, if any
    running: Process | None
    #: the autopilot's line, or a station's link, if given as an option
    device: str | None
    #: True if stations may be probed for round trips
    links: bool
    clocks: Clocks
    #: gets texts about long steps
    tell: Callable[[str], None]
    # ---- results of checks, for later checks
    #: True if the clock is so wrong that nothing may be signed
    clock_wrong: bool = False
    #: the mission package that is on board
    package: MissionPackage | None = None
    #: of a station: digest of its package for each vehicle
    digests: dict[int, bytes] = field(default_factory=dict)
    #: the autopilot's telemetry
    aircraft: VehicleState = field(default_factory=VehicleState)

    looked_at: float = -inf

    def stop_if_companion_runs(self) -> None:
        """Check for a new companion. Call this often while a link, a port or a line is open here.

        Raises CompanionStarted as soon as a companion of this vehicle runs, because it needs them.
        """
        now = self.clocks.monotonic()
        if self.vehicle is None or now - self.looked_at < _LOOK_S:
            return
        self.looked_at = now
        self.running = self._who_runs()
        if self.running is not None:
            raise CompanionStarted

    def find_companion(self) -> None:
        """Check again whether a companion of this vehicle runs."""
        self.running = self._who_runs()

    def _who_runs(self) -> Process | None:
        if self.vehicle is None:
            return None
        folder = self.vehicle.state or self.vehicle.journal.parent
        holder = lock_holder(self.at(folder) / f"{self.vehicle.name}.lock")
        return companion_of(self.path) if holder is None else holder

    def at(self, path: Path | PurePosixPath) -> Path:
        """A path of that machine on this one."""
        path = Path(path)
        inside = self.root == Path("/") or path.is_relative_to(self.root)
        return path if inside or not path.is_absolute() else below(self.root, PurePosixPath(path))

    @property
    def installed(self) -> bool:
        """True if the configuration is the one that `handover install` writes."""
        return self.path == below(self.root, CONFIGURATION[self.kind])

    @property
    def master(self) -> str | None:
        """The autopilot's line, or a station's link: from the option, else from the unit."""
        if self.device is not None or self.unit is None or not self.installed:
            return self.device
        return self.unit.option("--master")


def admit(
    kind: str, root: Path, path: Path, device: str | None, links: bool, clocks: Clocks, tell: Callable[[str], None]
) -> CheckContext:
    """Read the data that every check needs. Raises OSError if the configuration may not be read."""
    vehicle, station, config_error = _config(kind, path)
    unit, unit_error = None, ""
    try:
        unit = read_unit(kind, root)
    except (OSError, ValueError) as error:
        unit_error = str(error)
    context = CheckContext(
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
    if context.installed:
        user = _USER if unit is None else unit.user
        named = account_of(user, root)
        # a system that was never started has no such user yet: systemd-sysusers makes it at the start
        context.account = named or context.account
        context.account_missing = "" if named is not None or unit is None else user
    context.find_companion()
    return context


def _config(kind: str, path: Path) -> tuple[VehicleConfig | None, StationConfig | None, str]:
    with path.open("rb"):  # if it cannot be read, report that and not a wrong content
        pass
    try:
        if kind == "companion":
            return load_vehicle(path), None, ""
        return None, load_station(path), ""
    except ConfigError as error:
        return None, None, str(error)
