# SPDX-License-Identifier: GPL-3.0-or-later

"""Which sensor messages of onboard programs the autopilot uses."""

from __future__ import annotations

import pytest

from mavproxy_handover.gate.policy.onboard import SENSORS
from mavproxy_handover.monitors.preflight.onboard_sensors import SENSOR_PARAMETERS, sensor_findings


@pytest.mark.parametrize(
    ("sensor", "parameters", "text"),
    [
        (
            "LANDING_TARGET",
            {"PLND_ENABLED": 1.0, "PLND_TYPE": 1.0},
            "LANDING_TARGET of an onboard program moves the place of the landing (PLND_ENABLED, PLND_TYPE)",
        ),
        ("LANDING_TARGET", {"PLND_ENABLED": 1.0, "PLND_TYPE": 4.0}, "is not used: PLND_TYPE is 4"),
        ("LANDING_TARGET", {}, "is not used: PLND_ENABLED is 0"),
        (
            "ODOMETRY",
            {"VISO_TYPE": 1.0, "EK3_SRC1_POSXY": 3.0, "EK3_SRC2_POSXY": 6.0, "EK3_SRC2_YAW": 6.0},
            "ODOMETRY of an onboard program moves the position estimate (EK3_SRC2_POSXY, EK3_SRC2_YAW)",
        ),
        ("ODOMETRY", {"VISO_TYPE": 1.0, "EK3_SRC1_POSXY": 3.0}, "is not used: EK3_SRC1_POSXY is 3"),
        ("GPS_INPUT", {"GPS2_TYPE": 14.0, "GPS1_TYPE": 1.0}, "moves the position estimate (GPS2_TYPE)"),
        ("DISTANCE_SENSOR", {"RNGFND1_TYPE": 10.0}, "moves avoidance, which can block a return (RNGFND1_TYPE)"),
        ("OBSTACLE_DISTANCE", {"PRX1_TYPE": 0.0}, "is not used: PRX1_TYPE is 0"),
    ],
)
def test_a_sensor_is_used_by_its_parameters(sensor: str, parameters: dict[str, float], text: str) -> None:
    (found,) = sensor_findings(parameters, [sensor])
    assert text in found


def test_every_sensor_has_its_parameters() -> None:
    assert all(sensor_findings({}, [sensor]) for sensor in SENSORS)
    assert len(SENSOR_PARAMETERS) == len(set(SENSOR_PARAMETERS)) > 20


@pytest.mark.parametrize(("strict", "enabled", "found"), [(2.0, 1.0, 1), (1.0, 1.0, 0), (2.0, 0.0, 0)])
def test_a_landing_that_waits_for_its_target_forever_is_found(strict: float, enabled: float, found: int) -> None:
    parameters = {"PLND_ENABLED": enabled, "PLND_TYPE": 1.0, "PLND_STRICT": strict}
    texts = [text for text in sensor_findings(parameters, ["LANDING_TARGET"]) if text.startswith("PLND_STRICT 2")]
    assert len(texts) == found
    assert "PLND_STRICT" in SENSOR_PARAMETERS


@pytest.mark.parametrize(
    ("parameters", "sensors", "texts"),
    [
        ({"PRX1_TYPE": 2.0}, [], ["PRX1_TYPE is 2, and no onboard program may send OBSTACLE_DISTANCE or its like"]),
        ({"PRX1_TYPE": 4.0}, [], []),
        ({"GPS1_TYPE": 1.0, "GPS2_TYPE": 14.0}, [], ["GPS2_TYPE is 14, and no onboard program may send GPS_INPUT"]),
        ({"PLND_TYPE": 1.0, "PLND_ENABLED": 0.0}, [], []),
        (
            {"PLND_TYPE": 1.0, "PLND_ENABLED": 1.0},
            [],
            ["PLND_TYPE is 1, and no onboard program may send LANDING_TARGET"],
        ),
        (
            {"VISO_TYPE": 1.0, "EK3_SRC1_POSXY": 6.0},
            ["VISION_POSITION_ESTIMATE"],
            ["VISION_POSITION_ESTIMATE of an onboard program moves the position estimate (EK3_SRC1_POSXY)"],
        ),
        (
            {"PRX1_TYPE": 2.0},
            ["DISTANCE_SENSOR"],
            ["DISTANCE_SENSOR of an onboard program moves avoidance, which can block a return (PRX1_TYPE)"],
        ),
    ],
)
def test_a_sensor_that_is_expected_and_that_no_program_may_send(
    parameters: dict[str, float], sensors: list[str], texts: list[str]
) -> None:
    assert list(sensor_findings(parameters, sensors)) == texts


def test_every_vision_message_counts_for_vision() -> None:
    vision = {"VISO_TYPE": 1.0}
    (found,) = sensor_findings(vision, [])
    assert found == "VISO_TYPE is 1, and no onboard program may send ATT_POS_MOCAP or its like"
