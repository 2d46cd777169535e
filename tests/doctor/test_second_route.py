# SPDX-License-Identifier: GPL-3.0-or-later

"""A program on another port of the autopilot is a door without a gate: the doctor names it."""

from __future__ import annotations

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.doctor.second_route import second_routes
from tests.doctor.machine import Speaker, companion, free_port, heartbeat

GCS, ONBOARD, GIMBAL, ADSB, COPTER = 6, 18, 26, 27, 2


def beat(sysid: int, compid: int, kind: int) -> bytes:
    message = mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3)
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)))


@pytest.mark.parametrize(
    ("sysid", "compid", "kind", "named"),
    [
        (255, 190, GCS, "a ground station, system 255, component 190"),
        (1, 191, ONBOARD, "an onboard computer, system 1, component 191"),
        (7, 1, COPTER, "another vehicle or program, system 7, component 1"),
        (1, 154, GIMBAL, None),
        (1, 156, ADSB, None),
    ],
)
def test_what_counts_as_one(sysid: int, compid: int, kind: int, named: str | None) -> None:
    found = list(second_routes(1, {(sysid, compid): kind}))
    assert len(found) == (named is not None)
    if named is not None:
        assert f"a second MAVLink route: {named}, is heard through the autopilot" in found[0].found
        assert "docs/neighbours.md" in found[0].do


def test_the_doctor_hears_it_through_the_autopilot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    speaker = Speaker(lambda: heartbeat(armed=True) + beat(255, 190, GCS) + beat(1, 154, GIMBAL))
    try:
        machine = companion(tmp_path, speaker.device, {"GCSA": 9, "GCSB": 10}, free_port())
        found = machine.doctor(capsys, "--no-links")
    finally:
        speaker.close()
    lines = [line for line in found.lines("warning") if "second route" in line]
    assert len(lines) == 1
    assert "a ground station, system 255, component 190" in lines[0]
    assert speaker.received == b"", "an armed vehicle is asked nothing"
