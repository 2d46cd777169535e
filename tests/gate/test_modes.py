# SPDX-License-Identifier: GPL-3.0-or-later

"""The number of a flight mode, by the firmware that takes it: what flies the mission on, and what begins a flight."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.judge import Fate, judge
from mavproxy_handover.gate.policy.parameters import parameter_rule
from mavproxy_handover.gate.policy.tables import Access
from mavproxy_handover.vehicle.profiles import COPTER, PLANE, UNKNOWN_MODES, Modes
from mavproxy_handover.wire.frames import Frame
from tests.gate.ledger import GCSA, VEHICLE, A

Make = Callable[..., Frame]
ON_GROUND = AuthorityView(Phase.ON_LOAD, GCSA, None, 1, LeaseState.HELD)
IN_FLIGHT = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True)
#: every number that a mode can have -> whether the companion looks at it first
ALL = range(256)


def looked_at(make: Make, view: AuthorityView, modes: Modes) -> tuple[set[int], set[int]]:
    """The modes that are the companion's matter, as SET_MODE and as a command."""
    found: tuple[set[int], set[int]] = set(), set()
    for number in ALL:
        frames = (
            make("SET_MODE", sysid=GCSA, custom_mode=number),
            make("COMMAND_LONG", sysid=GCSA, command=176, param1=1.0, param2=float(number)),
        )
        for frame, numbers in zip(frames, found, strict=True):
            fate = judge(frame, A, view, VEHICLE, modes).fate
            assert fate in (Fate.FORWARD, Fate.CONSUME)
            if fate is Fate.CONSUME:
                numbers.add(number)
    return found


@pytest.mark.parametrize(
    ("modes", "in_flight", "on_ground"),
    [(COPTER.gate, {3, 23}, {28}), (PLANE.gate, {10}, {10, 13}), (UNKNOWN_MODES, {3, 23}, {28})],
    ids=["copter", "plane", "unknown"],
)
def test_of_every_mode_the_companion_looks_at_those_that_fly_on_follow_or_take_off(
    make: Make, modes: Modes, in_flight: set[int], on_ground: set[int]
) -> None:
    assert looked_at(make, IN_FLIGHT, modes) == (in_flight, in_flight)
    assert looked_at(make, ON_GROUND, modes) == (on_ground, on_ground)


@pytest.mark.parametrize(
    ("modes", "switches"),
    [(COPTER.gate, {41, 151, 153, 154, 165}), (PLANE.gate, {16, 41, 77, 151, 153, 154, 165})],
    ids=["copter", "plane"],
)
def test_of_every_switch_it_looks_at_those_that_arm_or_take_off(make: Make, modes: Modes, switches: set[int]) -> None:
    found = set()
    for number in range(400):
        frame = make("COMMAND_LONG", sysid=GCSA, command=218, param1=float(number), param2=2.0)
        if judge(frame, A, ON_GROUND, VEHICLE, modes).fate is Fate.CONSUME:
            found.add(number)
    assert found == switches


@pytest.mark.parametrize(
    "name",
    [
        "FS_SHORT_ACTN",
        "FS_SHORT_TIMEOUT",
        "FS_LONG_ACTN",
        "FS_LONG_TIMEOUT",
        "FS_GCS_ENABL",
        "THR_FAILSAFE",
        "THR_FS_VALUE",
        "Q_RTL_MODE",
        "Q_RTL_ALT",
        "Q_OPTIONS",
        "Q_ENABLE",
        "Q_LAND_FINAL_SPD",
        "Q_ASSIST_SPEED",
        "Q_TRANS_FAIL",
        "Q_TRANS_FAIL_ACT",
        "RTL_AUTOLAND",
        "RTL_RADIUS",
        "RTL_ALTITUDE",
        "ALT_HOLD_RTL",
        "ARMING_REQUIRE",
        "AUTOLAND_WP_ALT",
        "TECS_LAND_SINK",
        "RALLY_LIMIT_KM",
        "FENCE_ACTION",
        "FLIGHT_OPTIONS",
        "TERRAIN_FOLLOW",
        "WP_LOITER_RAD",
        "Q_MAV_TYPE",
    ],
)
def test_what_a_planes_safety_rests_on_is_locked_while_armed(name: str) -> None:
    assert parameter_rule(name).access is Access.SAFEGUARD


@pytest.mark.parametrize("name", ["AIRSPEED_CRUISE", "WP_RADIUS", "TKOFF_ALT", "Q_WP_SPEED", "MIS_RESTART"])
def test_what_shapes_a_planes_return_is_locked_while_armed(name: str) -> None:
    assert parameter_rule(name).access is Access.SAFEGUARD


@pytest.mark.parametrize("name", ["RLL_RATE_P", "Q_A_RAT_PIT_P", "MNT1_TYPE"])
def test_gains_and_payload_stay_the_commanders(name: str) -> None:
    assert parameter_rule(name).access is Access.COMMAND
