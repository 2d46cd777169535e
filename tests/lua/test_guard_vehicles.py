# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard knows the modes of ArduCopter and ArduPlane.

On any other vehicle the numbers mean something else (6 is FOLLOW on Rover): it says so, keeps it on the ground by the
arming check, and touches nothing.
"""

from __future__ import annotations

import pytest

from tests.lua.stub import AUTO, BLIMP, BY_GCS, COPTER, GUIDED, HELI, ROVER, RTL, SUB, TRACKER, Bench

ARMED, FLYING, UNKNOWN_VEHICLE = 2, 4, 16
#: by its name, where the number is known
REFUSAL = {
    ROVER: "HNDO: Rover not supported",
    TRACKER: "HNDO: Tracker not supported",
    SUB: "HNDO: Sub not supported",
    BLIMP: "HNDO: Blimp not supported",
    HELI: "HNDO: Heli not supported",
    0: "HNDO: vehicle type 0 not supported",
    255: "HNDO: vehicle type 255 not supported",
}


def vehicle(kind: int) -> Bench:
    """The firmware's type is asked for once, at the start of the script."""
    bench = Bench()
    bench.vehicle.type = kind
    bench.scripting.restart()
    bench.run(0)
    bench.hear()
    return bench


@pytest.mark.parametrize("kind", REFUSAL)
class TestUnknown:
    def test_does_not_arm_and_says_why(self, kind: int) -> None:
        bench = vehicle(kind).with_lease()
        bench.run(500)
        assert bench.refusal == REFUSAL[kind]

    def test_is_said_once_a_minute(self, kind: int) -> None:
        bench = vehicle(kind)
        bench.vehicle.texts.clear()
        bench.run(150_000)
        assert bench.texts == [REFUSAL[kind]] * 3

    def test_no_mode_is_set_and_nothing_disarmed(self, kind: int) -> None:
        """Armed by force. What it takes for flying is an estimate, and a script's disarm is not checked in the air."""
        bench = vehicle(kind).fly(AUTO)
        bench.lose_lease()
        bench.run(20_000)
        bench.vehicle.mode, bench.vehicle.reason = GUIDED, BY_GCS
        bench.run(5000)
        bench.vehicle.flying = False
        bench.run(10_000)
        assert (bench.vehicle.mode_requests, bench.vehicle.disarms) == ([], 0)
        assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 255.0

    def test_not_even_when_a_binding_fails(self, kind: int) -> None:
        bench = vehicle(kind).fly(AUTO)
        bench.scripting.load_text("vehicle.get_likely_flying = nil return", "breaker.lua")
        bench.lose_lease()
        bench.run(10_000)
        assert bench.vehicle.mode_requests == []

    def test_the_companion_is_told(self, kind: int) -> None:
        bench = vehicle(kind).fly(AUTO)
        assert bench.status.flags == UNKNOWN_VEHICLE | ARMED | FLYING
        assert (bench.status.fw_major, bench.status.fw_minor) == (4, 7)

    def test_a_guard_that_is_switched_off_keeps_nothing_on_the_ground(self, kind: int) -> None:
        bench = vehicle(kind)
        bench.vehicle.parameters["HNDO_ENABLE"] = 0.0
        bench.run(500)
        assert bench.may_arm


@pytest.mark.parametrize("absent", ["FWVersion", "FWVersion.type"])
def test_firmware_that_cannot_tell_its_type_is_of_none(absent: str) -> None:
    bench = Bench(absent=[absent]).with_lease()
    assert bench.refusal == "HNDO: vehicle type ? not supported"
    bench.run(600)
    assert bench.status.flags == UNKNOWN_VEHICLE
    assert (bench.status.fw_major == 4) == (absent == "FWVersion.type")


def test_a_copter_flies_home() -> None:
    bench = vehicle(COPTER).fly(AUTO)
    assert bench.status.flags == ARMED | FLYING
    bench.lose_lease()
    bench.run(4000)
    assert bench.vehicle.mode == RTL
