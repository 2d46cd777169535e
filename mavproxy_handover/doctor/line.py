# SPDX-License-Identifier: GPL-3.0-or-later

"""A serial line, before it is opened: is it there, who may use it, who uses it. And which baud rate fits it."""

from __future__ import annotations

import stat
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from mavproxy_handover.cli.machine import LINE
from mavproxy_handover.doctor.accounts import READ, WRITE, may
from mavproxy_handover.doctor.check_context import Patient
from mavproxy_handover.doctor.finding import Finding, error, ok
from mavproxy_handover.doctor.processes import users_of
from mavproxy_handover.link.forms import DeviceSpec

__all__ = ["RATES", "here", "line_findings", "usable"]

#: what autopilots and radios are set to, the likely first
RATES: Final = (921600, 115200, 57600, 460800, 230400, 500000, 1500000, 38400)


def line_findings(patient: Patient, spec: DeviceSpec, whose: str) -> Iterator[Finding]:
    """What can be said of it without opening it. It may be opened when none of this is an error (`usable`)."""
    what, path = f"line of {whose}", patient.at(Path(spec.host))
    try:
        status = path.stat()
    except FileNotFoundError:
        yield error(what, f"{spec.host}: no such line", _missing(patient, spec))
        return
    except OSError as fault:
        yield error(what, f"{spec.host}: {fault.strerror}", f"Look at {spec.host}: ls -lL {spec.host}.")
        return
    if not stat.S_ISCHR(status.st_mode):
        yield error(what, f"{spec.host}: is no serial line", "Name the line that the other end is plugged into.")
        return
    if not may(status, patient.account, READ | WRITE):
        mode = stat.S_IMODE(status.st_mode)
        found = f"{spec.host}: {patient.account.name} may not use it (mode {mode:04o}, group {status.st_gid})"
        do = (
            "Run: udevadm control --reload; udevadm trigger."
            if _rules(patient).exists()
            else f"Add {patient.account.name} to its group (usermod -aG dialout {patient.account.name}), log in anew."
        )
        yield error(what, found, do)
        return
    others = [each for each in users_of(path) if patient.running is None or each.pid != patient.running.pid]
    if others and patient.running is None:
        names = ", ".join(map(str, others))
        yield error(
            what, f"{spec.host}: is in use by {names}", f"Stop {names}: two on a line take bytes from each other."
        )
        return
    yield ok(what, f"{spec.host}: there, {patient.account.name} may use it, nobody else does")


def usable(findings: list[Finding]) -> bool:
    """Whether the line may be opened after these."""
    return all(not finding.do for finding in findings)


def here(patient: Patient, spec: DeviceSpec, baud: int = 0) -> DeviceSpec:
    """A line of that machine, as this one opens it; with another baud rate, if one is given."""
    path, rate = str(patient.at(Path(spec.host))), baud or spec.port
    return replace(spec, text=f"serial:{path}:{rate}", host=path, port=rate)


def _missing(patient: Patient, spec: DeviceSpec) -> str:
    rules = _rules(patient)
    if spec.host == str(LINE) and rules.exists():
        return f"Plug the autopilot in and run: udevadm trigger; see which line {rules} is for."
    return "Plug it in, switch the UART on, or name the right line (ls /dev/serial/by-id /dev/tty*)."


def _rules(patient: Patient) -> Path:
    """What tells udev whose the lines are, as `handover install` writes it."""
    return patient.root / f"etc/udev/rules.d/70-handover-{patient.kind}.rules"
