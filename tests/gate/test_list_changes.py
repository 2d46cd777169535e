# SPDX-License-Identifier: GPL-3.0-or-later

"""Which frames change the mission or the geofence at the autopilot."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from mavproxy_handover.gate.list_changes import ListChange, list_change
from mavproxy_handover.wire.frames import Frame
from tests.gate.frames import ftp_request

Make = Callable[..., Frame]
MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255


@pytest.mark.parametrize(
    ("name", "fields", "change"),
    [
        ("MISSION_COUNT", {"count": 3, "mission_type": MISSION}, ListChange("mission")),
        ("MISSION_COUNT", {"count": 0, "mission_type": MISSION}, ListChange("mission", clears=True)),
        ("MISSION_COUNT", {"count": 3, "mission_type": FENCE}, ListChange("geofence")),
        ("MISSION_COUNT", {"count": 3, "mission_type": RALLY}, None),
        ("MISSION_CLEAR_ALL", {"mission_type": MISSION}, ListChange("mission", clears=True)),
        ("MISSION_CLEAR_ALL", {"mission_type": FENCE}, ListChange("geofence", clears=True)),
        ("MISSION_CLEAR_ALL", {"mission_type": ALL}, None),
        ("MISSION_WRITE_PARTIAL_LIST", {"mission_type": MISSION}, ListChange("mission")),
        ("MISSION_REQUEST_LIST", {"mission_type": MISSION}, None),
        ("MISSION_SET_CURRENT", {"seq": 2}, None),
        ("FENCE_POINT", {}, ListChange("geofence")),
        ("PARAM_SET", {"param_id": b"MIS_TOTAL"}, ListChange("mission")),
        ("PARAM_SET", {"param_id": b"fence_total"}, ListChange("geofence")),
        ("PARAM_SET", {"param_id": b"MIS_OPTIONS"}, None),
        ("COMMAND_LONG", {"command": 218, "param1": 7.0}, ListChange("mission")),
        ("COMMAND_LONG", {"command": 218, "param1": 58.7}, ListChange("mission")),
        ("COMMAND_INT", {"command": 218, "param1": 65594.0}, ListChange("mission")),
        ("COMMAND_LONG", {"command": 218, "param1": float("nan")}, ListChange("mission")),
        ("COMMAND_LONG", {"command": 218, "param1": 9.0}, None),
        ("COMMAND_LONG", {"command": 300, "param1": 7.0}, None),
        ("HEARTBEAT", {}, None),
    ],
)
def test_messages(make: Make, name: str, fields: dict[str, object], change: ListChange | None) -> None:
    assert list_change(make(name, **fields)) == change


@pytest.mark.parametrize(
    ("opcode", "path", "change"),
    [
        (6, b"@MISSION/mission.dat", "mission"),
        (11, b"@mission/MISSION.dat", "mission"),
        (11, b"/@MISSION//fence.dat", "geofence"),
        (12, b"@MISSION/other", "mission"),
        (13, b"a\0@MISSION/fence.dat", "geofence"),
        (13, b"@MISSION/fence.dat\0@MISSION/mission.dat", "mission"),
        (4, b"@MISSION/mission.dat", None),
        (14, b"@MISSION/mission.dat", None),
        (6, b"@PARAM/param.pck", None),
        (8, b"/APM/LOGS/1.BIN", None),
        (1, b"", None),
        (2, b"", None),
        (7, b"@MISSION/mission.dat", None),
    ],
)
def test_files(make: Make, opcode: int, path: bytes, change: str | None) -> None:
    frame = make("FILE_TRANSFER_PROTOCOL", payload=ftp_request(opcode, path))
    assert list_change(frame) == (None if change is None else ListChange(change))
