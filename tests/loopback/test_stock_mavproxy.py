# SPDX-License-Identifier: GPL-3.0-or-later

"""Stock MAVProxy processes and our modules, as installed: what a user types and sees."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from mavproxy_handover.cli.launch import companion_argv, station_argv
from mavproxy_handover.tools.version import VERSION
from tests.loopback.conftest import Autopilot, MavProxy, vehicle_file, wait_for

pytestmark = pytest.mark.process


def station_file(path: Path) -> Path:
    path.write_text('[station]\nname = "GCSA"\nsysid = 251\njournal = "GCSA.jsonl"\n')
    return path


NO_CONFIGURATION = (
    'handover is not loaded: no configuration: looked for module load handover:{"config":"FILE"} (no spaces in it), '
    "$HANDOVER_CONFIG, ./handover.toml, /etc/handover/vehicle.toml; the shell's 'handover init vehicle' writes one"
)


def test_what_cannot_be_loaded_is_told_in_one_line_and_mavproxy_lives(
    start: Callable[..., MavProxy], autopilot: Autopilot, station_port: int, tmp_path: Path
) -> None:
    if Path("/etc/handover/vehicle.toml").exists():
        pytest.skip("this machine has a configuration in /etc/handover")
    console = start()
    head = "handover is not loaded: "
    assert console.answer("module load handover", head) == NO_CONFIGURATION

    spaces = vehicle_file(tmp_path / "x y.toml", station_port)
    assert console.answer(f'module load handover:{{"config":"{spaces}"}}', head) == NO_CONFIGURATION

    broken = tmp_path / "broken.toml"
    broken.write_text("[vehicle\n")
    line = console.answer(f'module load handover:{{"config":"{broken}"}}', head)
    assert line.startswith(f"{head}{broken}: not valid TOML: ")

    misspelt = vehicle_file(tmp_path / "misspelt.toml", station_port, more="gaurd = true")
    line = console.answer(f'module load handover:{{"config":"{misspelt}"}}', head)
    assert line == f"{head}{misspelt}: [vehicle] gaurd: unknown key; did you mean 'guard'?"

    taken = vehicle_file(tmp_path / "taken.toml", station_port, kind="udpin")
    line = console.answer(f'module load handover:{{"config":"{taken}"}}', head)
    assert line == f"{head}link udpin:127.0.0.1:{station_port} cannot be opened: Address already in use"

    assert console.answer('module load handover:{"config":5}', head).startswith(f"{head}argument config: 5 must be")
    assert console.answer('module load handover:{"cfg":"x"}', head).startswith(f"{head}unknown argument cfg; ")
    console.alive()
    assert autopilot.leases() == 0
    shown = console.end()
    assert "Traceback" not in shown.split("Unloading module")[0]


def test_load_unload_reload_and_load_again(
    start: Callable[..., MavProxy], autopilot: Autopilot, station_port: int, tmp_path: Path
) -> None:
    file = vehicle_file(tmp_path / "handover.toml", station_port)
    console = start()
    assert console.answer("module load handover", f"handover {VERSION}: ") == (
        f"handover {VERSION}: drone-1, stations GCSA (parent), configuration {file}"
    )
    console.shows("Loaded module handover")
    wait_for(lambda: autopilot.leases() > 3, lambda: "no leases came")
    assert console.answer("set mavfwd", "mavfwd ") == "mavfwd False"
    assert console.answer("set heartbeat", "heartbeat ") == "heartbeat 0"

    start_of_status = console.type("handover status")
    assert console.shows("commander", start_of_status) == "commander no station, epoch 0, lease LOST"
    assert console.answer("handover foo", "handover: ") == "handover: unknown command 'foo'"
    assert console.answer("help", "handover ").startswith("handover        : authority handover")
    assert console.answer("output add 127.0.0.1:9", "handover: output ") == (
        "handover: output 127.0.0.1:9 is closed: stations belong in the configuration"
    )

    console.answer("module reload handover", "Reloaded module handover")
    reloaded = autopilot.leases()
    wait_for(lambda: autopilot.leases() > reloaded + 3, lambda: "no leases came after reload")

    console.answer("module unload handover", "Unloaded module handover")
    assert console.answer("set mavfwd", "mavfwd ") == "mavfwd True"
    assert console.answer("set heartbeat", "heartbeat ") in ("heartbeat 1", "heartbeat 1.0")
    console.answer("handover", "Unknown command 'handover'")
    unloaded = autopilot.leases()
    wait_for(
        lambda: sum(m.get_type() == "HEARTBEAT" and m.get_srcSystem() == 255 for m in list(autopilot.received)) > 1,
        lambda: "MAVProxy's own heartbeat did not come back",
    )
    assert autopilot.leases() == unloaded

    console.answer("module load handover", "Loaded module handover")
    wait_for(lambda: autopilot.leases() > unloaded + 3, lambda: "no leases came after the second load")
    console.end()
    events = [json.loads(line)["event"] for line in (tmp_path / "companion.jsonl").read_text().splitlines()]
    assert (events.count("loaded"), events.count("unloaded")) == (3, 3), "the end of MAVProxy unloads it too"
    assert "fault" not in events


def test_it_loads_from_the_command_line_with_the_configuration_named_by_the_environment(
    start: Callable[..., MavProxy], autopilot: Autopilot, station_port: int, tmp_path: Path
) -> None:
    file = vehicle_file(tmp_path / "named.toml", station_port)
    console = start("--load-module=handover", HANDOVER_CONFIG=str(file))
    console.shows(f"configuration {file}")
    wait_for(lambda: autopilot.leases() > 3, lambda: "no leases came")


def test_a_default_module_that_cannot_be_loaded_does_not_end_mavproxy(
    start: Callable[..., MavProxy], tmp_path: Path
) -> None:
    """MAVProxy loads its default modules without a net: an exception there ends it."""
    console = start("--default-modules=link,handover,handover_gcs", HANDOVER_CONFIG=str(tmp_path / "missing.toml"))
    console.shows(f"handover is not loaded: {tmp_path / 'missing.toml'}: no such file")
    console.shows("handover_gcs is not loaded: no configuration: ")
    console.alive()


def test_it_does_not_load_beside_an_output(start: Callable[..., MavProxy], station_port: int, tmp_path: Path) -> None:
    vehicle_file(tmp_path / "handover.toml", station_port)
    console = start("--out=127.0.0.1:9")
    line = console.answer("module load handover", "handover is not loaded: ")
    assert line.startswith("handover is not loaded: MAVProxy has outputs (127.0.0.1:9): ")


def test_the_stations_module_loads_unloads_and_reloads(start: Callable[..., MavProxy], tmp_path: Path) -> None:
    console = start()
    assert console.answer("module load handover_gcs", "handover_gcs is not loaded: ").startswith(
        'handover_gcs is not loaded: no configuration: looked for module load handover_gcs:{"config":"FILE"} '
    )
    file = station_file(tmp_path / "station.toml")
    assert console.answer("module load handover_gcs", f"handover_gcs {VERSION}: ").endswith(f"configuration {file}")
    assert console.answer("set source_system", "source_system 2") == "source_system 251"
    console.answer("handover status", "vehicle   not heard, ON_LOAD")
    assert console.answer("module load handover", "handover is not loaded: ").endswith(
        "vehicle and station need a MAVProxy each"
    )
    console.answer("module reload handover_gcs", "Reloaded module handover_gcs")
    console.answer("module unload handover_gcs", "Unloaded module handover_gcs")
    assert console.answer("set source_system", "source_system 2") == "source_system 255"
    console.alive()


def test_the_command_line_of_the_companion_works(
    start: Callable[..., MavProxy], autopilot: Autopilot, station_port: int, tmp_path: Path
) -> None:
    file = vehicle_file(tmp_path / "vehicle.toml", station_port)
    console = start(command=companion_argv(file, autopilot.master, tmp_path / "companion.tlog"))
    console.shows("Loaded module handover")
    wait_for(lambda: autopilot.leases() > 3, lambda: "no leases came")
    senders = {(m.get_srcSystem(), m.get_srcComponent()) for m in autopilot.received if m.get_type() != "BAD_DATA"}
    assert senders == {(1, 191)}, "everything is said as the vehicle's companion"
    assert not any(m.get_type() == "REQUEST_DATA_STREAM" for m in autopilot.received)
    console.end()
    assert (tmp_path / "companion.tlog").exists()


def test_two_that_write_one_log_are_told(
    start: Callable[..., MavProxy], autopilot: Autopilot, station_port: int, tmp_path: Path
) -> None:
    """As when they are started by hand in one folder."""
    log = tmp_path / "mav.tlog"
    first = start(command=companion_argv(vehicle_file(tmp_path / "v.toml", station_port), autopilot.master, log))
    first.shows("Loaded module handover")
    wait_for(lambda: autopilot.leases() > 8, lambda: "no leases came")
    other = Autopilot()
    try:
        second = start(command=station_argv(station_file(tmp_path / "s.toml"), other.master, log))
        second.shows(f"handover: {log} is written by another MAVProxy as well")
        second.end()
    finally:
        other.close()
    first.end()
    assert not [line for line in first.lines if "another MAVProxy" in line], "it was there first"


def test_the_command_line_of_a_station_works(
    start: Callable[..., MavProxy], autopilot: Autopilot, tmp_path: Path
) -> None:
    file = station_file(tmp_path / "station.toml")
    command = station_argv(file, autopilot.master, tmp_path / "station.tlog")
    assert "--dialect=handover" in command, "what it does not know would be lost frames to it"
    console = start(command=command)
    console.shows("Loaded module handover_gcs")
    console.answer("handover status", "this station is observer")
    wait_for(
        lambda: any(m.get_type() == "HEARTBEAT" for m in list(autopilot.received)),
        lambda: "no heartbeat of the station came",
    )
    beats = {(m.get_srcSystem(), m.get_srcComponent()) for m in autopilot.received if m.get_type() == "HEARTBEAT"}
    assert beats == {(251, 190)}
