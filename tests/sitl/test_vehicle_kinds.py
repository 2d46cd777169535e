# SPDX-License-Identifier: GPL-3.0-or-later

"""Which vehicle flies which mission: a copter no wings, wings no copter; and where ArduPlane's program is found."""

from __future__ import annotations

from pathlib import Path

import pytest

from mavproxy_handover.vehicle.profiles import COPTER, PLANE, QUADPLANE
from sitl import fly_all, main
from sitl.run.runner import Order, Result
from sitl.script.places import guard_files
from sitl.script.scenario import known_scenarios, load_scenario
from sitl.vehicles import KINDS, LaunchError, VehicleSpec, find_arduplane, flies, launch
from sitl.vehicles.arduplane import flying

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def nowhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """No ArduPlane on this machine."""
    monkeypatch.delenv("ARDUPLANE", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


@pytest.fixture
def program(nowhere: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One that the environment names."""
    path = nowhere / "arduplane"
    path.write_text("#!/bin/sh\n", encoding="utf-8")
    path.chmod(0o755)
    monkeypatch.setenv("ARDUPLANE", str(path))
    return path


def refusal(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    assert main.main(list(argv)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_what_kind_of_aircraft_each_vehicle_is() -> None:
    assert {kind: flies(kind) for kind in KINDS} == {
        "builtin": COPTER,
        "arducopter": COPTER,
        "quadplane": QUADPLANE,
        "plane": PLANE,
    }


def test_the_embedded_vehicle_flies_no_mission_of_wings(capsys: pytest.CaptureFixture[str]) -> None:
    assert refusal(capsys, "--scenario", "ferry") == (
        "handover sim: mission ferry is for a quadplane, and --vehicle builtin is a copter: take --vehicle quadplane"
    )


def test_wings_fly_no_mission_of_a_copter(capsys: pytest.CaptureFixture[str]) -> None:
    assert refusal(capsys, "--scenario", "corridor", "--vehicle", "quadplane") == (
        "handover sim: mission corridor is for a copter, and --vehicle quadplane is a quadplane: take --vehicle "
        "builtin or arducopter"
    )


@pytest.mark.usefixtures("program")
@pytest.mark.parametrize(
    ("vehicle", "scenario"),
    [("builtin", "nominal"), ("auto", "nominal"), ("quadplane", "ferry"), ("plane", "dike")],
)
def test_without_a_scenario_each_vehicle_flies_one_that_is_for_it(
    vehicle: str, scenario: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[str] = []

    def fly(order: Order, _stream: object) -> Result:
        flown.append(order.scenario.name)
        raise LaunchError("seen enough")

    monkeypatch.setattr(main, "fly", fly)
    assert main.main(["--vehicle", vehicle]) == 2
    assert flown == [scenario]


@pytest.mark.usefixtures("nowhere")
@pytest.mark.parametrize("vehicle", ["quadplane", "auto"])
def test_without_arduplane_there_is_no_flight_and_it_is_said_how_to_get_it(
    vehicle: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refusal(capsys, "--scenario", "ferry", "--vehicle", vehicle) == (
        "handover sim: no arduplane found: give --arduplane PATH, set $ARDUPLANE, or build it in ~/ardupilot"
    )


def test_the_environment_names_the_arduplane(program: Path) -> None:
    assert find_arduplane() == program.resolve()


def test_a_named_arduplane_that_is_none_is_an_error(nowhere: Path) -> None:
    with pytest.raises(LaunchError, match=r"--arduplane: .*kite is not a program that can be run"):
        find_arduplane(str(nowhere / "kite"))


def test_the_command_line_says_what_is_simulated(program: Path) -> None:
    spec = VehicleSpec(home=(52.705, 5.3, 0.0, 90.0), sysid=3, speedup=4.0)
    arguments, environment = flying("quadplane")(spec, {1: 5001}, [Path("0_plane_base.parm"), Path("1_x.parm")])
    assert arguments == [
        *(str(program.resolve()), "--model", "quadplane", "--wipe", "--speedup", "4"),
        *("--home", "52.70500000,5.30000000,0.00,90.0", "--sysid", "3"),
        *("--defaults", "0_plane_base.parm,1_x.parm", "--rc-in-port", "0", "--serial1", "tcp:5001"),
    ]
    assert environment == {}


def test_the_guard_of_wings_has_parameters_of_its_own() -> None:
    script, parameters = guard_files(QUADPLANE)
    assert script.name == "handover_guard.lua"
    assert [path.name for path in parameters] == ["handover_plane.parm"]
    assert [path.name for path in guard_files()[1]] == ["handover.parm"]


def test_the_base_parameters_of_wings_are_those_that_the_ferry_is_checked_with() -> None:
    values = {}
    for name in ("plane_base.parm", "quadplane_base.parm"):
        text = (ROOT / "mavproxy_handover" / "deploy" / "demo" / name).read_text(encoding="utf-8")
        values |= dict(line.split() for line in text.splitlines() if line and not line.startswith("#"))
    wanted = {"ROLL_LIMIT_DEG": 45, "WP_RADIUS": 90, "WP_LOITER_RAD": 80, "AIRSPEED_CRUISE": 22, "Q_RTL_MODE": 1}
    assert {name: float(values[name]) for name in wanted} == wanted
    assert values["SCR_ENABLE"] == values["Q_ENABLE"] == "1"


def test_the_ferry_is_a_scenario_that_says_what_it_needs() -> None:
    assert "needs ArduPlane" in load_scenario(known_scenarios()["ferry"]).description


def test_all_flights_leave_wings_out_where_there_is_no_arduplane(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    flown = []

    def fly(name: str, vehicle: str, _folder: Path, programs: list[str]) -> fly_all.Flight:
        flown.append((name, vehicle, programs))
        return fly_all.Flight(name, vehicle, 0, 1.0, ("GCSA",))

    monkeypatch.setattr(fly_all, "_fly", fly)
    monkeypatch.setattr(fly_all, "find_arducopter", lambda _explicit: Path("/bin/true"))
    monkeypatch.setattr(fly_all, "find_arduplane", lambda _explicit: None)
    assert fly_all.main(["ferry", "linear", "--out", str(tmp_path)]) == 0
    assert flown == [("linear", "builtin", []), ("linear", "arducopter", [])]
    line = capsys.readouterr().out.splitlines()[0]
    assert line.split(maxsplit=1) == ["ferry", "skipped: it is flown by a quadplane, and no arduplane is found"]
    flown.clear()
    monkeypatch.setattr(fly_all, "find_arduplane", lambda _explicit: Path("/bin/true"))
    assert fly_all.main(["ferry", "--arduplane", "/bin/true", "--out", str(tmp_path)]) == 0
    assert flown == [("ferry", "quadplane", ["--arduplane", "/bin/true"])]


@pytest.mark.sitl
def test_a_quadplane_comes_up(tmp_path: Path) -> None:
    if find_arduplane() is None:
        pytest.skip("no arduplane SITL program")
    vehicle = launch("quadplane", VehicleSpec(home=(52.705, 5.3, 0.0, 90.0)), tmp_path)
    try:
        assert vehicle.alive()
        assert {"0_plane_base.parm", "1_quadplane_base.parm"} <= {path.name for path in tmp_path.iterdir()}
    finally:
        vehicle.stop()


def test_what_only_arducopter_can_show_is_flown_there_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    flown = []

    def fly(name: str, vehicle: str, _folder: Path, _programs: list[str]) -> fly_all.Flight:
        flown.append((name, vehicle))
        return fly_all.Flight(name, vehicle, 0, 1.0, ("GCSA",))

    monkeypatch.setattr(fly_all, "_fly", fly)
    monkeypatch.setattr(fly_all, "find_arducopter", lambda _explicit: Path("/bin/true"))
    assert fly_all.main(["onboard-vision-lies", "onboard-sensors", "--out", str(tmp_path)]) == 0
    assert flown == [
        ("onboard-vision-lies", "arducopter"),
        ("onboard-sensors", "builtin"),
        ("onboard-sensors", "arducopter"),
    ]
    assert main.main(["--scenario", "onboard-vision-lies", "--vehicle", "builtin"]) == 2
    assert "scenario onboard-vision-lies needs --vehicle arducopter" in capsys.readouterr().err
