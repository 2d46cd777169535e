# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover companion` and `handover station`: build the MAVProxy command line, print it and run it.

The station becomes MAVProxy. The companion stays, and supervises the process that runs MAVProxy.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Final

from mavproxy_handover.cli.launch import companion_argv, station_argv
from mavproxy_handover.cli.reach import trouble
from mavproxy_handover.config.files import ConfigError, find_vehicle_config, load_station
from mavproxy_handover.store.flights import LATEST, begin
from mavproxy_handover.supervision.must_load import import_fault, module_fault, must_load
from mavproxy_handover.tools.command_line import CommandParser
from mavproxy_handover.tools.version import VERSION

__all__ = ["companion", "station"]

_NO_WX: Final = (
    "wxPython is not installed: the station runs without this window, and MAVProxy says 'Failed to load module'. On "
    "Debian and Ubuntu: apt install python3-wxgtk4.0, and an environment made with --system-site-packages"
)


def companion(argv: Sequence[str]) -> int:
    """MAVProxy on the companion computer, supervised."""
    parser = CommandParser(
        prog="handover companion",
        examples=(
            ("handover companion --master /dev/ttyTHS1,921600", "with ./handover.toml, or that of /etc/handover"),
            (
                "handover companion --config handover.toml --master tcp:127.0.0.1:5762",
                "with ArduPilot SITL on this machine",
            ),
        ),
        codes={
            0: "ended as asked for",
            1: "MAVProxy did not start, or failed",
            2: "wrong usage or configuration: nothing was started",
        },
        description="Run MAVProxy with `module load handover` (the command line is printed), and start it again at "
        "once when it dies, or its main loop stands still. It lives on without a terminal.",
    )
    parser.add_argument("--config", help="vehicle configuration (else $HANDOVER_CONFIG, ./handover.toml, /etc/...)")
    parser.add_argument("--master", required=True, help="the autopilot, e.g. /dev/ttyTHS1,921600 or tcp:127.0.0.1:5762")
    parser.add_argument(
        "--restarts-within",
        type=_seconds,
        default=60.0,
        metavar="S",
        help="the third restart in so many seconds sends no more leases: no station commands (default: 60)",
    )
    _fill_standard_streams()
    return _run(parser, argv, _companion_argv, _vehicle_config, _supervise)


def station(argv: Sequence[str]) -> int:
    """MAVProxy at a ground station."""
    parser = CommandParser(
        prog="handover station",
        examples=(
            ("handover station --master udpin:0.0.0.0:14550", "with ./station.toml; the vehicle sends to this machine"),
            (
                "handover station --config GCSA.toml --master udpin:0.0.0.0:14550 -- --console --map",
                "with MAVProxy's windows",
            ),
            (
                "handover station --master udpin:0.0.0.0:14550 --serve udp:127.0.0.1:14550",
                "QGroundControl on this computer flies through the station",
            ),
        ),
        codes={
            0: "ended as asked for",
            1: "MAVProxy did not start, or failed",
            2: "wrong usage or configuration: nothing was started",
        },
        description="Run MAVProxy with `module load handover_gcs` (the command line is printed).",
    )
    parser.add_argument("--config", default="station.toml", help="station configuration (default: ./station.toml)")
    parser.add_argument(
        "--master",
        help="the link to the vehicle, e.g. udpin:0.0.0.0:14550; not where [[vehicle]] tables name the links; without "
        "it the station waits for the vehicle's address with a mission",
    )
    parser.add_argument(
        "--serve",
        metavar="LINK",
        help="a program on this computer that flies through this station, for example udp:127.0.0.1:14550 for "
        "QGroundControl (else `serve` of the configuration)",
    )
    return _run(parser, argv, _station_argv, lambda named: Path(named or "").expanduser().resolve(), _station)


def _run(
    parser: argparse.ArgumentParser,
    argv: Sequence[str],
    build: Callable[[Path, argparse.Namespace, _Logs], list[str]],
    find: Callable[[str | None], Path],
    start: Callable[[list[str], argparse.Namespace], int],
) -> int:
    parser.add_argument(
        "--logs", type=Path, default=Path("flights"), metavar="DIR", help="a folder for each run in it (./flights)"
    )
    parser.add_argument("--logfile", type=Path, help="tlog, in place of all that; one that is there is added to")
    parser.add_argument("--print", action="store_true", help="print the MAVProxy command line and end")
    parser.add_argument("more", nargs="*", help="more options for MAVProxy, after --")
    try:
        arguments = parser.parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        config = find(arguments.config)
        logs = _Logs(arguments.logfile) if arguments.logfile is not None else _logs_of(parser.prog, config, arguments)
        command = [*build(config, arguments, logs), *arguments.more, *logs.options]
    except ConfigError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    print(shlex.join(command), flush=True)
    if arguments.print:
        return 0
    for master in (word.partition("=")[2] for word in command if word.startswith("--master=")):
        found = trouble(master)
        if found:
            print(f"{parser.prog}: WARNING: {found}", file=sys.stderr, flush=True)
    return start(command, arguments)


@dataclass(frozen=True, slots=True)
class _Logs:
    """Paths of a run's logs. `journal` None: as the configuration says. `options`: further options of MAVProxy."""

    tlog: Path
    journal: Path | None = None
    options: tuple[str, ...] = ("--append-log",)


def _companion_argv(config: Path, arguments: argparse.Namespace, logs: _Logs) -> list[str]:
    return companion_argv(config, arguments.master, logs.tlog, logs.journal)


def _station_argv(config: Path, arguments: argparse.Namespace, logs: _Logs) -> list[str]:
    return station_argv(config, arguments.master, logs.tlog, logs.journal, arguments.serve)


def _logs_of(program: str, config: Path, arguments: argparse.Namespace) -> _Logs:
    """Make a folder for this run. A full or missing disk does not prevent a flight. Raises ConfigError."""
    content: bytes | None = None
    if program.endswith("companion"):
        from mavproxy_handover.config.running import start_of  # `handover station` does not need it

        found = start_of(config)
        name, content = found.config.name, found.text
    else:
        name = load_station(config).station.name
    base = arguments.logs.expanduser().absolute()
    folder = base / LATEST
    if not arguments.print:
        versions = {each: metadata.version(each) for each in ("MAVProxy", "pymavlink")}
        about = {"who": name, "command": program, "version": VERSION, "python": platform.python_version(), **versions}
        try:
            folder = begin(base, name, datetime.now(timezone.utc), about, config, content)
        except OSError as error:
            lacks = "no tlog, and the journal where the configuration has it"
            text = f"WARNING: {error.filename or base}: {error.strerror}: {lacks}"
            print(f"{program}: {text}", file=sys.stderr, flush=True)
            return _Logs(base / f"{name}.tlog", None, ("--no-state",))
    return _Logs(folder / f"{name}.tlog", folder / f"{name}.jsonl")


def _vehicle_config(named: str | None) -> Path:
    """Path of the configuration. Raises ConfigError if there is none, or if an import fails."""
    try:
        importlib.import_module("numpy")  # before shapely, which prints a traceback of its own without it
        importlib.import_module("mavproxy_handover.config.running")
    except Exception as error:
        raise ConfigError(import_fault(error)) from None
    return find_vehicle_config(named)


def _station(command: list[str], arguments: argparse.Namespace) -> int:
    fault = module_fault("handover_gcs")
    if fault:
        print(f"handover station: {fault}", file=sys.stderr)
        return 2
    windows = [word for word in ("--console", "--map") if word in arguments.more]
    if windows and importlib.util.find_spec("wx") is None:
        print(f"handover station: {' and '.join(windows)}: {_NO_WX}", file=sys.stderr, flush=True)
    return _become(command, "handover station")


def _become(command: list[str], name: str) -> int:
    must_load(name)
    if sys.platform != "win32":
        os.execv(command[0], command)
    # there `exec` starts another process and ends this one, and the shell would take the terminal back
    with subprocess.Popen(command) as program:
        while True:
            try:
                return program.wait()
            except KeyboardInterrupt:
                continue  # Ctrl-C is for MAVProxy, which has got it too


def _supervise(command: list[str], arguments: argparse.Namespace) -> int:
    """Run the command in a child. If that is not safe, become it, and report what is lost."""
    fault = module_fault("handover")
    if fault:
        print(f"handover companion: {fault}", file=sys.stderr)
        return 2
    if sys.platform != "linux":
        return _unsupervised(command, "only Linux ends a child with its parent")
    # imported here, because `handover station` does not need it
    from mavproxy_handover.config.running import start_of
    from mavproxy_handover.supervision.child import Companion
    from mavproxy_handover.supervision.manager import service_manager
    from mavproxy_handover.supervision.rules import Limits
    from mavproxy_handover.supervision.script import Script
    from mavproxy_handover.supervision.supervisor import Supervisor, single_threaded

    script = Script(Path(command[1]))
    try:
        script.prepare()
    except Exception as error:
        print(f"handover companion: {import_fault(error)}", file=sys.stderr)
        return 2
    if not single_threaded():
        return _unsupervised(command, "something that Python imports here starts threads")
    limits = Limits(window_s=arguments.restarts_within)
    in_flight = start_of(find_vehicle_config(arguments.config)).in_flight
    return Supervisor(Companion(script, command[2:]), limits, service_manager(), in_flight=in_flight).run()


def _unsupervised(command: list[str], why: str) -> int:
    text = (
        f"handover companion: WARNING: not supervised: {why}. It will not be started again, and ends with its terminal"
    )
    print(text, file=sys.stderr, flush=True)
    return _become(command, "handover companion")


def _seconds(text: str) -> float:
    """Raises ValueError, as argparse wants it."""
    value = float(text)
    if not 0.0 <= value <= 3600.0:
        raise ValueError(text)
    return value


def _fill_standard_streams() -> None:
    """Open the first three descriptors if the parent closed them, because a link must not become one of them."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
