# SPDX-License-Identifier: GPL-3.0-or-later

"""A machine that all is well with, the embedded vehicle with the guard on its line, and two stations: exit code 0."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from mavproxy_handover.doctor import flight_controller
from mavproxy_handover.link.timesync import TIMESYNC
from mavproxy_handover.tools.resources import shipped
from mavproxy_handover.wire.conversation import Asking
from mavproxy_handover.wire.ids import PROBE_COMPID
from sitl.vehicles import RunningVehicle, VehicleSpec, launch
from tests.doctor.machine import KEYS, Station, companion, free_port

pytestmark = pytest.mark.process

GUARD = shipped("ardupilot_lua") / "handover_guard.lua"
RECOMMENDED = shipped("ardupilot_lua") / "handover.parm"
HOME = (52.6767, 5.9222, 10.0, 0.0)
#: what the vehicle's own files leave to decide
OWN = {"FS_THR_ENABLE": 1, "FENCE_ENABLE": 1, "FENCE_TYPE": 4}


def start(folder: Path, *, guard: bool = True, **changed: float) -> RunningVehicle:
    scripts = (GUARD,) if guard else ()
    spec = VehicleSpec(home=HOME, scripts=scripts, defaults=(RECOMMENDED,), parameters={**OWN, **changed})
    return launch("builtin", spec, folder)


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningVehicle]:
    pytest.importorskip("lupa.lua53", reason="the guard runs in Lua 5.3, by lupa")
    running = start(tmp_path_factory.mktemp("vehicle"))
    yield running
    running.stop()


def test_all_is_well(vehicle: RunningVehicle, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    listens = free_port()
    ports = {"GCSA": free_port(), "GCSB": free_port()}
    machine = companion(tmp_path, vehicle.companion_master, ports, listens)
    stations = [
        Station(251, KEYS["GCSA"], ports["GCSA"]),
        Station(252, KEYS["GCSB"], ports["GCSB"], to=listens),
    ]
    try:
        found = machine.doctor(capsys)
    finally:
        for station in stations:
            station.close()
    assert found.lines("error") == []
    assert found.lines("warning") == []
    assert found.code == 0
    assert [each for each in found.of("autopilot") if "4.7" in each and each.startswith("firmware")]
    assert [each for each in found.of("autopilot") if each.startswith("guard: waiting")]
    trips = [each for each in found.of("stations") if "there and back in" in each]
    assert len(trips) == 3
    for station in stations:
        assert station.heard == {(TIMESYNC, PROBE_COMPID)}, "nothing but the companion's probes is sent to a station"


#: what does not fit, and what is said of it: parameters, the finding, what to do
UNFIT = (
    ({"FS_OPTIONS": 2}, "FS_OPTIONS: is 2: bit 1 lets a mission go on", "Set FS_OPTIONS to 8;"),
    ({"HNDO_LOST_T": 1}, "HNDO_LOST_T: is 1 s: the guard acts while", "Set HNDO_LOST_T to 3;"),
    ({"RALLY_LIMIT_KM": 0.3}, "RALLY_LIMIT_KM: is 0.3", "Set RALLY_LIMIT_KM to 0;"),
)
NO_GUARD = ({}, "guard and firmware: the guard is not loaded", "'handover guard CARD'")


@pytest.mark.parametrize("unfit", [(NO_GUARD,), UNFIT], ids=["no guard", "parameters"])
def test_what_does_not_fit_in_the_autopilot(
    unfit: tuple[tuple[dict[str, float], str, str], ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("lupa.lua53", reason="the guard runs in Lua 5.3, by lupa")
    changed = {name: value for values, _words, _do in unfit for name, value in values.items()}
    running = start(tmp_path / "vehicle", guard=NO_GUARD not in unfit, **changed)
    try:
        machine = companion(tmp_path, running.companion_master, {"GCSA": 9, "GCSB": 10})
        found = machine.doctor(capsys, "--no-links")
    finally:
        running.stop()
    errors = found.lines("error")
    assert len(errors) == len(unfit)
    for _values, words, do in unfit:
        (said,) = (each for each in errors if each.startswith(f"autopilot: {words}"))
        assert do in said
    assert found.code == 1


def test_of_two_batteries_that_fly_it_both_are_looked_at(
    vehicle: RunningVehicle, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The embedded vehicle has one, so what its second monitor would answer is put to what it answers."""
    second = {"BATT2_MONITOR": 4.0, "BATT2_FS_LOW_ACT": 3.0, "BATT2_LOW_VOLT": 10.5}
    reading = flight_controller.reading

    def with_second(sysid: int, names: tuple[str, ...]) -> Asking:
        values = yield from reading(sysid, names)
        return values | {name: value for name, value in second.items() if name in names}

    monkeypatch.setattr(flight_controller, "reading", with_second)
    machine = companion(tmp_path, vehicle.companion_master, {"GCSA": 9, "GCSB": 10})
    assert machine.doctor(capsys, "--no-links").lines("error") == []
    machine.config.write_text(machine.config.read_text() + "\n[energy]\nbatteries = 2\n")
    (said,) = machine.doctor(capsys, "--no-links").lines("error")
    smart = "is 3: SMART_RTL flies back the way it came, not to the return site"
    do = "Set BATT2_FS_LOW_ACT to 2; handover.parm and handover_guard.md say why."
    assert said == f"autopilot: BATT2_FS_LOW_ACT: {smart} -> {do}"


def test_a_position_box_is_where_the_autopilot_is(
    vehicle: RunningVehicle, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_port(socket.SOCK_STREAM)
    machine = companion(tmp_path, vehicle.companion_master, {"GCSA": 9, "GCSB": 10})
    position = f'\n[position]\nsource = "box"\nbox = "tcp:127.0.0.1:{port}"\n'
    machine.config.write_text(machine.config.read_text() + position)
    argv = [sys.executable, "-m", "sitl.run.data_box", "--vehicle", vehicle.address(0), "--listen", f"127.0.0.1:{port}"]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as box:
        try:
            assert box.stdout is not None
            assert box.stdout.readline() == "ready\n"
            until = time.monotonic() + 40.0
            while True:  # until the receiver has a fix
                found = machine.doctor(capsys, "--no-links")
                if not [each for each in found.of("position box", "warning") if "the autopilot has told none" in each]:
                    break
                assert time.monotonic() < until
        finally:
            box.kill()
    layout, sends, place = [line for line in found.of("position box", "ok") if not line.startswith("record ")]
    assert layout == "its layout: 'thesis', as it is configured"
    assert " records a second, " in sends
    assert place.endswith("73 m pressure altitude, 0 m above ground by pressure: 0.0 m from the autopilot's")
