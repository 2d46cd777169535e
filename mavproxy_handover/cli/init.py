# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover init`: writes a commented configuration to start from. The samples are files, and tests load them."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from mavproxy_handover.cli.keys import GROUND
from mavproxy_handover.resources import DEPLOY, shipped
from mavproxy_handover.store.keys import key_of, key_path, make_passphrase, write_key

__all__ = ["main"]

#: kind -> (sample, usual name of the target, what to type next)
_SAMPLES = {
    "vehicle": (DEPLOY / "vehicle.toml", "handover.toml", "edit it, then: handover companion --master DEVICE"),
    "station": (DEPLOY / "station.toml", "station.toml", "edit it, then: handover station --master DEVICE"),
    "service": (DEPLOY / "handover.service", "handover.service", "edit it, it says where it goes"),
    "demo": (DEPLOY / "demo", "demo", "README.md, 'By hand', tells what to start"),
}


def main(argv: Sequence[str]) -> int:
    """Write the sample of the given kind; never over something that exists."""
    parser = argparse.ArgumentParser(
        prog="handover init",
        description="Write a commented configuration: for a vehicle's companion, for a station, a unit of systemd that "
        "runs the companion, or a folder with those of the delivery mission (one vehicle, two stations, all here).",
    )
    parser.add_argument("kind", choices=list(_SAMPLES))
    parser.add_argument("target", nargs="?", type=Path, help="default: the usual name, here")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    sample, usual, following = _SAMPLES[arguments.kind]
    target: Path = arguments.target or Path(usual)
    try:
        if target.exists():
            raise FileExistsError
        if sample.is_dir():
            _write_demo(sample, target)
        else:
            shutil.copy(sample, target)
    except FileExistsError:
        print(f"handover init: {target} exists already: nothing written", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"handover init: {target}: {error.strerror}", file=sys.stderr)
        return 2
    print(f"{target} written; {following}")
    return 0


def _write_demo(sample: Path, target: Path) -> None:
    """Everything that a flight by hand needs, in one folder that MAVProxy and both vehicles can be started in."""
    guard = shipped("ardupilot_lua")
    shutil.copytree(sample, target)
    shutil.copytree(shipped("missions") / "delivery", target / "delivery")
    (target / "keys").mkdir(mode=0o700)
    for name in ("GCSA", "GCSB", GROUND):
        write_key(key_path(target / "keys", name), key_of(make_passphrase()))
    (target / "scripts").mkdir()
    shutil.copy(guard / "handover_guard.lua", target / "scripts")
    shutil.copy(guard / "handover.parm", target)
