# SPDX-License-Identifier: GPL-3.0-or-later

"""BATTERY_STATUS in the units of the rules, and what in it means that nobody knows."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.safety.battery import PackReport
from mavproxy_handover.monitors.energy import pack_report

NOTHING = [65535] * 10


def message(**changes: Any) -> Any:
    values: dict[str, Any] = {
        "id": 0,
        "battery_function": 0,
        "type": 0,
        "temperature": 32767,
        "voltages": [12_600, *[65535] * 9],
        "current_battery": 2810,
        "current_consumed": 1500,
        "energy_consumed": 680,
        "battery_remaining": 54,
    }
    return mavlink.MAVLink_battery_status_message(**{**values, **changes})


def test_the_units() -> None:
    # 680 hJ are 68,000 J, 18.89 Wh
    assert pack_report(message()) == PackReport(
        used_wh=pytest.approx(18.8889, abs=1e-4),
        used_mah=1500.0,
        remaining=pytest.approx(0.54),
        voltage_v=pytest.approx(12.6),
        current_a=pytest.approx(28.1),
    )


@pytest.mark.parametrize(
    ("changes", "name", "value"),
    [
        ({"energy_consumed": -1}, "used_wh", None),
        ({"energy_consumed": 0}, "used_wh", 0.0),
        ({"current_consumed": -1}, "used_mah", None),
        ({"battery_remaining": -1}, "remaining", None),
        ({"battery_remaining": 0}, "remaining", 0.0),
        ({"current_battery": -1}, "current_a", None),
        ({"voltages": NOTHING}, "voltage_v", None),
        ({"voltages": [0] * 10}, "voltage_v", None),
        # cell by cell, and a pack of more volts than one field can say
        ({"voltages": [4100, 4110, 4120, *[65535] * 7]}, "voltage_v", 12.33),
        ({"voltages": [65534, 14466, *[65535] * 8]}, "voltage_v", 80.0),
        ({"voltages": [4000] * 10, "voltages_ext": [4000, 4000, 0, 0]}, "voltage_v", 48.0),
    ],
)
def test_a_field_and_what_it_means(changes: dict[str, Any], name: str, value: float | None) -> None:
    found = getattr(pack_report(message(**changes)), name)
    assert found == (None if value is None else pytest.approx(value))
