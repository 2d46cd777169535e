# SPDX-License-Identifier: GPL-3.0-or-later

"""What a station tells its panel comes back as it was, and what is no snapshot is refused in one line."""

from __future__ import annotations

import json
from dataclasses import replace
from math import inf, nan
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_module.flight_values import FlightValues, Stamped
from gcs_module.panel.snapshot import LineSeen, SnapshotError, from_values, to_line
from tests.gcs.panel_states import BORDER, LOST, NOW, TAKE, craft, station


def test_a_snapshot_comes_back_as_it_was() -> None:
    full = station(
        craft(question=TAKE, border=BORDER, alarms=(LOST,), lines=(LineSeen(7, NOW, 2, "a\nline"),)),
        craft(sysid=2, position=None, briefing=(("leg", "to waypoint 1"),), briefing_at=NOW),
    )
    line = to_line(full)
    assert line.count(b"\n") == 1
    values = json.loads(line)
    back = from_values(values)
    place = back.aircraft[0].position
    assert place is not None
    assert place.value == [52.679, 5.9245]
    given = replace(back.aircraft[0], position=full.aircraft[0].position)
    assert (given, back.aircraft[1], back.peers) == (full.aircraft[0], full.aircraft[1], full.peers)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda values: values.update(version=99),
        lambda values: values.pop("station"),
        lambda values: values.update(station=[]),
        lambda values: values["station"].pop("at"),
        lambda values: values["station"].update(more=1),
        lambda values: values["station"].update(aircraft={}),
        lambda values: values["station"]["aircraft"][0].update(question=3),
        lambda values: values["station"]["aircraft"][0].update(links=[[]]),
    ],
)
def test_what_is_no_snapshot_of_this_version_is_refused(spoil: Any) -> None:
    values = json.loads(to_line(station()))
    spoil(values)
    with pytest.raises(SnapshotError):
        from_values(values)


def message(kind: str, **values: Any) -> Any:
    return SimpleNamespace(get_type=lambda: kind, **values)


def test_values_have_the_time_when_they_were_heard() -> None:
    values = FlightValues()
    place = {"lat": 526790000, "lon": 59240000, "relative_alt": 30500}
    values.on_autopilot(message("GLOBAL_POSITION_INT", vx=300, vy=400, hdg=9000, **place), 10.0)
    values.on_autopilot(message("SYS_STATUS", battery_remaining=94, voltage_battery=12400), 11.0)
    values.on_autopilot(message("BATTERY_STATUS", id=0, time_remaining=600), 12.0)
    assert values.position == Stamped((52.679, 5.924), 10.0)
    assert values.height_m == Stamped(30.5, 10.0)
    assert values.speed_mps == Stamped(5.0, 10.0)
    assert values.heading_deg == Stamped(90.0, 10.0)
    assert values.battery_percent == Stamped(94.0, 11.0)
    assert values.battery_v == Stamped(12.4, 11.0)
    assert values.battery_left_s == Stamped(600.0, 12.0)


def test_what_is_not_known_changes_no_value() -> None:
    values = FlightValues()
    unknown = {"lat": 0, "lon": 0, "relative_alt": 0, "heading": 0xFFFF}
    for speed in (nan, inf):
        values.on_telemetry(
            message("X", groundspeed=speed, battery_remaining=-1, battery_voltage=0xFFFF, **unknown), 5.0
        )
    values.on_autopilot(message("BATTERY_STATUS", id=1, time_remaining=600), 5.0)
    values.on_autopilot(message("BATTERY_STATUS", id=0, time_remaining=0), 5.0)
    assert values.height_m == Stamped(0.0, 5.0)
    others = (values.position, values.speed_mps, values.heading_deg, values.battery_percent, values.battery_left_s)
    assert others == (None,) * 5
