# SPDX-License-Identifier: GPL-3.0-or-later

"""Vehicles that the guard does not know: their modes have other numbers, so it lets none arm and sets no mode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from sitl.vehicles import VehicleSpec, launch
from tests.sitl.firmware import Firmware
from tests.sitl.flown import recorded
from tests.sitl.guard_cases import said
from tests.sitl.guard_flight import ACCEPTED, FAILED, FORCE, GUARD, HOME, PARAMETERS, SPEEDUP, Flight
from tests.sitl.guard_log import SCRIPTING, records


@dataclass(frozen=True, slots=True)
class Case:
    """A vehicle that neither flies like a copter nor has wings."""

    name: str
    model: str
    """What the simulation flies or drives."""
    mode: int
    """One in which it may arm."""
    parameters: Mapping[str, float]


ROVER = Case("Rover", "rover", 0, {"FS_THR_ENABLE": 0})
CASES = (ROVER,)
pytestmark = pytest.mark.sitl


def test_rover(ardurover: Firmware, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    stays_where_it_is(ROVER, ardurover, tmp_path, request)


def stays_where_it_is(case: Case, firmware: Firmware, directory: Path, request: pytest.FixtureRequest) -> None:
    recorded(request, case.name, firmware)
    spec = VehicleSpec(
        home=HOME,
        speedup=SPEEDUP,
        scripts=(GUARD,),
        defaults=(PARAMETERS,),
        parameters={**case.parameters, "SR2_POSITION": 10},
        arducopter=str(firmware.program),
        model=case.model,
    )
    vehicle = launch("arducopter", spec, directory)
    try:
        flight = Flight(vehicle, firmware, directory)
        try:
            outcome = _refused(flight, case)
        finally:
            flight.close()
    finally:
        vehicle.stop()
    chosen = [(record.Mode, record.Rsn) for record in records(directory, "MODE")]
    assert SCRIPTING not in [reason for _, reason in chosen], chosen
    recorded(request, case.name, firmware, outcome)


def _refused(flight: Flight, case: Case) -> str:
    """Everything is ready and the lease is live; then it is armed by force, and the lease is lost."""
    flight.sending = True
    flight.until(lambda: flight.now_ms > 5000, 30, "the autopilot lives")
    flight.pace(20)
    flight.run(60)
    assert flight.set_mode(case.mode) == ACCEPTED
    flight.texts.clear()
    assert flight.arm() == FAILED, f"it arms; {flight.texts}"
    said(flight, "HNDO: ")
    told = next(text for text in flight.texts if "HNDO: " in text)
    assert f"HNDO: {case.name} not supported" in told, told
    flight.arm(FORCE)
    flight.run(3)
    mode = flight.mode
    flight.cut()
    flight.run(15)
    assert flight.mode == mode, f"mode {flight.mode} instead of {mode}"
    return f"arming refused ({told[told.index('HNDO: ') :]}), no mode set"
