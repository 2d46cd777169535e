# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover companion` and `handover station`: build the MAVProxy command line, print it, become it."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from mavproxy_handover.cli.launch import companion_argv, station_argv
from mavproxy_handover.config.files import ConfigError, find_vehicle_config

__all__ = ["companion", "station"]


def companion(argv: Sequence[str]) -> int:
    """MAVProxy on the companion computer."""
    parser = argparse.ArgumentParser(
        prog="handover companion", description="Run MAVProxy with `module load handover` (the command line is printed)."
    )
    parser.add_argument("--config", help="vehicle configuration (else $HANDOVER_CONFIG, ./handover.toml, /etc/...)")
    parser.add_argument("--master", required=True, help="the autopilot, e.g. /dev/ttyTHS1,921600 or tcp:127.0.0.1:5762")
    return _become(parser, argv, companion_argv, find_vehicle_config)


def station(argv: Sequence[str]) -> int:
    """MAVProxy at a ground station."""
    parser = argparse.ArgumentParser(
        prog="handover station",
        description="Run MAVProxy with `module load handover_gcs` (the command line is printed).",
    )
    parser.add_argument("--config", default="station.toml", help="station configuration (default: ./station.toml)")
    parser.add_argument("--master", required=True, help="the link to the vehicle, e.g. udpin:0.0.0.0:14550")
    return _become(parser, argv, station_argv, lambda named: Path(named or "").expanduser().resolve())


def _become(
    parser: argparse.ArgumentParser,
    argv: Sequence[str],
    build: Callable[[Path, str, Path], list[str]],
    find: Callable[[str | None], Path],
) -> int:
    parser.add_argument("--logfile", type=Path, default=Path("handover.tlog"), help="tlog (default: ./handover.tlog)")
    parser.add_argument("--print", action="store_true", help="print the MAVProxy command line and end")
    parser.add_argument("more", nargs="*", help="more options for MAVProxy, after --")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        command = [*build(find(arguments.config), arguments.master, arguments.logfile), *arguments.more]
    except ConfigError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    print(shlex.join(command), flush=True)
    if not arguments.print:
        os.execv(command[0], command)
    return 0
