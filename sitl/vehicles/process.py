# SPDX-License-Identifier: GPL-3.0-or-later

"""A simulated vehicle as a process: starting and stopping it.

Rules: the vehicle's working directory is the one given, and everything it writes (parameters, logs, scripts,
console) lands there, so that one directory is one flight; parameters come from the base files of its kind
(`*_base.parm` of the demo folder), then the files of the specification in order, then its single overrides, the last
word winning; `launch` returns when the ports listen.
"""

from __future__ import annotations

import atexit
import os
import shutil
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mavproxy_handover.tools.resources import DEPLOY
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, QUADPLANE, Profile
from sitl.vehicles import arducopter, arduplane
from sitl.vehicles.builtin import launcher
from sitl.vehicles.parent_death import die_with_parent
from sitl.vehicles.ports import PortPicker
from sitl.vehicles.spec import Command, LaunchError, VehicleSpec

__all__ = ["BASE_PARAMETERS", "KINDS", "RunningVehicle", "flies", "launch"]

#: What a copter without radio control needs to arm in GUIDED and fly AUTO, for both kinds of it.
BASE_PARAMETERS = DEPLOY / "demo" / "copter_base.parm"
#: What wings need for the same, and what hovers besides.
_PLANE_BASE, _QUADPLANE_BASE = DEPLOY / "demo" / "plane_base.parm", DEPLOY / "demo" / "quadplane_base.parm"


@dataclass(frozen=True, slots=True)
class _Kind:
    """The function for its command line, its kind of aircraft, and its parameters before all others."""

    command: Command
    aircraft: Profile
    base: tuple[Path, ...]


_KINDS: Mapping[str, _Kind] = {
    "builtin": _Kind(launcher.command, COPTER, (BASE_PARAMETERS,)),
    "arducopter": _Kind(arducopter.command, COPTER, (BASE_PARAMETERS,)),
    "quadplane": _Kind(arduplane.flying("quadplane"), QUADPLANE, (_PLANE_BASE, _QUADPLANE_BASE)),
    "plane": _Kind(arduplane.flying("plane"), PLANE, (_PLANE_BASE,)),
}
KINDS = tuple(_KINDS)

LOG_NAME = "vehicle.log"
_START_TIMEOUT_S = 30.0
_STOP_TIMEOUT_S = 3.0
_SERIALS = (0, 1, 2)


class RunningVehicle:
    """A vehicle process and the addresses it listens on (all on 127.0.0.1)."""

    def __init__(self, kind: str, process: subprocess.Popen[bytes], ports: Mapping[int, int], log_path: Path) -> None:
        self.kind = kind
        self.log_path = log_path
        self._process = process
        self._ports = dict(ports)
        atexit.register(self.stop)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def companion_master(self) -> str:
        """pymavlink address for the companion's MAVProxy (SERIAL1, channel 1)."""
        return self.address(1)

    @property
    def monitor(self) -> str:
        """pymavlink address for one passive observer (SERIAL2, channel 2)."""
        return self.address(2)

    def address(self, serial: int) -> str:
        """pymavlink address of SERIAL`serial`; SERIAL0 stands for a radio wired straight to the autopilot."""
        return f"tcp:127.0.0.1:{self._ports[serial]}"

    def alive(self) -> bool:
        return self._process.poll() is None

    def stop(self) -> None:
        """End the process (terminate, then kill). Safe to call twice."""
        atexit.unregister(self.stop)
        if not self.alive():
            return
        self._process.terminate()
        try:
            self._process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def flies(kind: str) -> Profile:
    """The profile of the aircraft that a vehicle of `kind` is."""
    return _KINDS[kind].aircraft


def launch(kind: str, spec: VehicleSpec, directory: Path) -> RunningVehicle:
    """Start a vehicle of `kind` in `directory` (made if absent) and wait until it listens.

    Raises:
        LaunchError: unknown kind, no program found, or the process ended or did not listen in time.
    """
    if kind not in _KINDS:
        raise LaunchError(f"vehicle kind '{kind}' is unknown; the kinds are {', '.join(KINDS)}")
    directory = directory.resolve()
    directory.mkdir(parents=True, exist_ok=True)
    _install_scripts(spec, directory)
    picker = PortPicker()
    ports = {serial: picker.tcp() for serial in _SERIALS}
    arguments, environment = _KINDS[kind].command(spec, ports, _parameter_files(kind, spec, directory))
    log_path = directory / LOG_NAME
    with log_path.open("wb") as log:
        process = subprocess.Popen(
            arguments,
            cwd=directory,
            env={**os.environ, **environment},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=die_with_parent,  # noqa: PLW1509 (launched from the main thread only)
        )
    vehicle = RunningVehicle(kind, process, ports, log_path)
    try:
        _wait_for_ports(vehicle)
    except LaunchError:
        vehicle.stop()
        raise
    return vehicle


def _install_scripts(spec: VehicleSpec, directory: Path) -> None:
    scripts = directory / "scripts"
    scripts.mkdir(exist_ok=True)
    for stale in scripts.glob("*.lua"):
        stale.unlink()
    for script in spec.scripts:
        shutil.copy(script, scripts / script.name)


def _parameter_files(kind: str, spec: VehicleSpec, directory: Path) -> list[Path]:
    files = [*_KINDS[kind].base, *(path.resolve() for path in spec.defaults)]
    copies = []
    for index, source in enumerate(files):
        copies.append(directory / f"{index}_{source.name}")
        shutil.copy(source, copies[-1])
    if spec.parameters:
        overrides = directory / f"{len(files)}_overrides.parm"
        overrides.write_text(
            "".join(f"{name} {value:.9g}\n" for name, value in spec.parameters.items()), encoding="utf-8"
        )
        copies.append(overrides)
    return copies


def _wait_for_ports(vehicle: RunningVehicle) -> None:
    """Wait until the log says that every port listens; all kinds print ArduPilot's line for it."""
    deadline = time.monotonic() + _START_TIMEOUT_S
    while True:
        log = vehicle.log_path.read_text(encoding="utf-8", errors="replace")
        if all(f"SERIAL{serial} on TCP port" in log for serial in _SERIALS):
            return
        if not vehicle.alive():
            raise LaunchError(f"{vehicle.kind} ended while starting:\n{log[-2000:]}")
        if time.monotonic() > deadline:
            raise LaunchError(f"{vehicle.kind} does not listen after {_START_TIMEOUT_S:.0f} s:\n{log[-2000:]}")
        time.sleep(0.02)
