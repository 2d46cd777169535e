# SPDX-License-Identifier: GPL-3.0-or-later

"""Command lines of MAVProxy for companion and station.

Used by `handover companion`, `handover station`, the simulation and the README.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from mavproxy_handover.config.files import ConfigError, FleetVehicle, load_station
from mavproxy_handover.config.served import parse_served
from mavproxy_handover.link.forms import Kind, LinkError, parse_device
from mavproxy_handover.wire.ids import COMPANION_COMPID, STATION_COMPID
from mavproxy_handover.wire.vehicle_address import WAITING_LINK

__all__ = ["companion_argv", "mavproxy", "station_argv", "supervised_argv"]

#: modules of MAVProxy that request nothing from the vehicle
_COMPANION_MODULES = "link,signing"
#: time (s) for which MAVProxy waits for frames before it checks its timers. Its own 0.01 is for maps and joysticks, and
#: costs a tenth of the companion's processor time; the module's ticks need no more than this
_SELECT_TIMEOUT_S = 0.02
_STATION_MODULES = "link,signing,mode,arm,cmdlong,misc,rc,wp,relay"


def mavproxy() -> list[str]:
    """Command of the MAVProxy that belongs to this Python. Raises ConfigError if it is not installed."""
    beside = Path(sys.executable).parent / "mavproxy.py"
    found = str(beside) if beside.is_file() else shutil.which("mavproxy.py")
    if found is None:
        raise ConfigError("mavproxy.py is not installed: pip install MAVProxy")
    return [sys.executable, found]


def _load(module: str, config: Path, journal: Path | None, serve: str | None = None) -> str:
    """The `module load` line. MAVProxy splits at spaces and `;`, so such a path cannot be given this way."""
    paths: dict[str, Path | str] = {"config": config.resolve()}
    if journal is not None:
        paths["journal"] = journal.resolve()
    if serve is not None:
        paths["serve"] = serve
    for path in map(str, paths.values()):
        if any(character in path for character in " ;'\"\\"):
            raise ConfigError(f"{path}: MAVProxy cannot take a path with spaces, quotes or ';': move the file")
    return f"module load {module}:{json.dumps(paths, default=str, separators=(',', ':'))}"


def companion_argv(config: Path, master: str, logfile: Path, journal: Path | None = None) -> list[str]:
    """MAVProxy with `handover`. Raises ConfigError.

    `master`: the autopilot's device. `logfile`: the tlog. `journal`: replaces the configuration's.
    """
    # it imports numerical libraries, and `few_threads` in `supervision/script.py` must come first
    from mavproxy_handover.config.running import start_of

    vehicle = start_of(config).config
    return [
        *mavproxy(),
        f"--master={_of_mavproxy(master)}",
        f"--source-system={vehicle.sysid}",
        f"--source-component={COMPANION_COMPID}",
        f"--target-system={vehicle.sysid}",
        "--streamrate=-1",
        "--heartbeat=0",
        "--nowait",
        f"--default-modules={_COMPANION_MODULES}",
        f"--logfile={logfile}",
        f"--cmd=set select_timeout {_SELECT_TIMEOUT_S};{_load('handover', config, journal)}",
    ]


def supervised_argv(config: Path, master: str, logfile: Path) -> list[str]:
    """The command of users, `handover companion`, which runs `companion_argv` in a child process."""
    words = ["companion", f"--config={config}", f"--master={master}", f"--logfile={logfile}"]
    return [sys.executable, "-m", "mavproxy_handover.cli", *words]


def station_argv(
    config: Path, master: str | None, logfile: Path, journal: Path | None = None, serve: str | None = None
) -> list[str]:
    """MAVProxy with `handover_gcs`. Raises ConfigError.

    `master`: link to the vehicle; None if [[vehicle]] tables name the links or another station will send the vehicle's
    address. `logfile`: the tlog. `journal`, `serve`: replace the configuration's.
    """
    _check_served(serve)
    station = load_station(config)
    labelled = [link for vehicle in station.vehicles for link in _labelled(vehicle)]
    links = labelled if master is None else [_of_mavproxy(master)]
    if labelled and master is not None:
        raise ConfigError(f"{station.path}: [[vehicle]] names the links: --master does not go together with it")
    if not links and not (station.peers and station.offered_addresses):
        text = "--master is missing: there is no [[vehicle]] that names the links"
        other = 'no [[peer]] that may send the vehicle\'s address (offered_addresses = "ask")'
        raise ConfigError(f"{station.path}: {text}, and {other}")
    if not links:
        links = [WAITING_LINK]
    return [
        *mavproxy(),
        *(f"--master={link}" for link in links),
        f"--source-system={station.station.sysid}",
        f"--source-component={STATION_COMPID}",
        f"--target-system={station.vehicles[0].sysid}",
        "--dialect=handover",  # unknown messages would count as lost
        "--streamrate=-1",
        "--nowait",
        f"--default-modules={_STATION_MODULES}",
        f"--logfile={logfile}",
        f"--cmd={_load('handover_gcs', config, journal, serve)}",
    ]


def _check_served(serve: str | None) -> None:
    """Raises ConfigError if no program can be served by that link."""
    if serve is not None:
        try:
            parse_served(serve)
        except LinkError as error:
            raise ConfigError(f"--serve: {error}") from None


def _of_mavproxy(link: str) -> str:
    """Check that MAVProxy can open the link, and return it. Raises ConfigError if it cannot."""
    if "[" in link.partition("{")[0]:
        raise ConfigError(f"link {link}: MAVProxy opens this one, and knows no IPv6: give an IPv4 address")
    return link


def _labelled(vehicle: FleetVehicle) -> list[str]:
    """The vehicle's links for MAVProxy, each with a label by which the station's module finds it."""
    found = []
    for number, link in enumerate(vehicle.links, 1):
        device = parse_device(link)
        if device.way:
            raise ConfigError(f"link {link}: MAVProxy opens this one, and knows no @{device.way}")
        _of_mavproxy(link)
        where = f"{device.host},{device.port}" if device.kind is Kind.SERIAL else device.text
        label = vehicle.name if len(vehicle.links) == 1 else f"{vehicle.name}/{number}"
        found.append(f"{where}:{json.dumps({'label': label}, separators=(',', ':'))}")
    return found
