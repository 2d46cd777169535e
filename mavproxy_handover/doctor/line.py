# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks a serial line before it is opened: existence, rights, other users. It also tries baud rates."""

from __future__ import annotations

import stat
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from mavproxy_handover.cli.machine import LINE
from mavproxy_handover.doctor.accounts import READ, WRITE, may
from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok
from mavproxy_handover.doctor.processes import users_of
from mavproxy_handover.link.forms import DeviceSpec

__all__ = ["RATES", "here", "line_findings", "usable"]

#: usual rates of autopilots and radios, the likely ones first
RATES: Final = (921600, 115200, 57600, 460800, 230400, 500000, 1500000, 38400)


def line_findings(context: CheckContext, spec: DeviceSpec, owner: str) -> Iterator[Finding]:
    """Findings that do not open it. It may be opened if none of them is an error (`usable`)."""
    what, path = f"line of {owner}", context.at(Path(spec.host))
    try:
        status = path.stat()
    except FileNotFoundError:
        yield error(what, f"{spec.host}: no such line", _missing(context, spec))
        return
    except OSError as fault:
        yield error(what, f"{spec.host}: {fault.strerror}", f"Look at {spec.host}: ls -lL {spec.host}.")
        return
    if not stat.S_ISCHR(status.st_mode):
        yield error(what, f"{spec.host}: is no serial line", "Name the line that the other end is plugged into.")
        return
    if not may(status, context.account, READ | WRITE):
        mode = stat.S_IMODE(status.st_mode)
        found = f"{spec.host}: {context.account.name} may not use it (mode {mode:04o}, group {status.st_gid})"
        do = (
            "Run: udevadm control --reload; udevadm trigger."
            if _rules(context).exists()
            else f"Add {context.account.name} to its group (usermod -aG dialout {context.account.name}), log in again."
        )
        yield error(what, found, do)
        return
    others = [each for each in users_of(path) if context.running is None or each.pid != context.running.pid]
    if others and context.running is None:
        names = ", ".join(map(str, others))
        yield error(
            what, f"{spec.host}: is in use by {names}", f"Stop {names}: two on a line take bytes from each other."
        )
        return
    yield ok(what, f"{spec.host}: there, {context.account.name} may use it, no other program does")


def usable(findings: list[Finding]) -> bool:
    """True if the line may be opened after these findings."""
    return all(not finding.do for finding in findings)


def here(context: CheckContext, spec: DeviceSpec, baud: int = 0) -> DeviceSpec:
    """A line of that machine as a device of this one; with another baud rate, if one is given."""
    path, rate = str(context.at(Path(spec.host))), baud or spec.port
    return replace(spec, text=f"serial:{path}:{rate}", host=path, port=rate)


def _missing(context: CheckContext, spec: DeviceSpec) -> str:
    rules = _rules(context)
    if spec.host == str(LINE) and rules.exists():
        return f"Plug the autopilot in and run: udevadm trigger; see which line {rules} is for."
    return "Plug it in, switch the UART on, or name the right line (ls /dev/serial/by-id /dev/tty*)."


def _rules(context: CheckContext) -> Path:
    """The udev rules that set the owner of the lines, as `handover install` writes them."""
    return context.root / f"etc/udev/rules.d/70-handover-{context.kind}.rules"
