# SPDX-License-Identifier: GPL-3.0-or-later

"""One script for firmware 4.5, 4.6 and 4.7: what differs is asked for, never assumed; and what a firmware refuses the
script at its start is seen on the ground."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from tests.lua.stub import AUTO, BY_GCS, GUIDED, LIVE_STATE, LOITER, RTL, Bench

OLD_NAMES: dict[str, Any] = {
    "parameters": {"SYSID_THISMAV": 1.0, "SYSID_MYGCS": 255.0},
    "without": ["MAV_SYSID", "MAV_GCS_SYSID"],
}
#: what a firmware has and lacks; 4.5 in its poorest form, without the bindings that the guard can do without
FIRMWARE: dict[str, dict[str, Any]] = {
    "4.5": {**OLD_NAMES, "firmware": (4, 5, 7), "absent": ["mavlink.block_command", "FWVersion.patch"]},
    "4.6": {**OLD_NAMES, "firmware": (4, 6, 3)},
    "4.7-dev": {"firmware": (4, 7, 0)},
    "4.7": {"firmware": (4, 7, 1), "parameters": {"MAV_GCS_SYSID_HI": 0.0}},
}
GCS_ID = {"4.5": "SYSID_MYGCS", "4.6": "SYSID_MYGCS", "4.7-dev": "MAV_GCS_SYSID", "4.7": "MAV_GCS_SYSID"}


@pytest.fixture(params=FIRMWARE)
def version(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_a_whole_flight(version: str) -> None:
    """Refused without a lease, armed with one, its id followed, home when the lease is lost, not let out of it."""
    bench = Bench(**FIRMWARE[version])
    bench.run(500)
    assert bench.refusal == "HNDO: no lease from companion"
    bench.vehicle.armed = True
    bench.run(4000)
    assert not bench.vehicle.armed
    bench.with_lease()
    assert bench.may_arm
    bench.fly(AUTO)
    bench.companion.commander, bench.companion.epoch = 252, 8
    bench.run(1000)
    assert bench.vehicle.parameters[GCS_ID[version]] == 252.0
    bench.lose_lease()
    bench.run(3500)
    assert bench.vehicle.mode == RTL
    bench.vehicle.mode, bench.vehicle.reason = GUIDED, BY_GCS
    bench.run(100)
    assert bench.vehicle.mode == RTL
    bench.sending = True
    bench.run(1000)
    assert bench.vehicle.mode == RTL
    status = bench.status
    assert (status.state, status.fw_major, status.fw_minor) == (LIVE_STATE, *FIRMWARE[version]["firmware"][:2])
    assert bench.vehicle.removed == []
    assert not any("fault" in text for text in bench.texts)


def test_no_parameter_of_another_firmware_is_made_up(version: str) -> None:
    bench = Bench(**FIRMWARE[version])
    before = {name for name in bench.vehicle.parameters if not name.startswith("HNDO_")}
    bench.fly(AUTO)
    bench.run(3000)
    assert {name for name in bench.vehicle.parameters if not name.startswith("HNDO_")} == before
    assert "cannot be set" not in " ".join(bench.texts)
    assert "was changed" not in " ".join(bench.texts)


def test_only_messages_that_every_firmware_knows() -> None:
    """One that a firmware does not know is dropped by 4.5, and from 4.6 on reaches scripts past the signature check."""
    bench = Bench().with_lease()
    bench.run(3000)
    for message in (common.MAVLINK_MSG_ID_TUNNEL, common.MAVLINK_MSG_ID_COMMAND_LONG):
        assert message in common.mavlink_map
    assert {msgid for _, msgid, _ in bench.vehicle.messages} == {common.MAVLINK_MSG_ID_TUNNEL}


class TestStart:
    """What ArduPilot's parameter tables refuse."""

    @pytest.mark.parametrize(
        ("earlier", "said"),
        [
            ("param:add_table(147, 'MINE_', 7)", "could not add param table"),
            ("param:add_table(147, 'HNDO_', 3)", "could not add param table"),
        ],
    )
    def test_a_table_key_that_is_taken_is_said_and_the_vehicle_does_not_arm(self, earlier: str, said: str) -> None:
        bench = Bench(earlier_script=f"{earlier} return")
        assert said in bench.vehicle.removed[0]
        assert any(said in text for text in bench.texts)
        assert "HNDO" in (bench.refusal or "")

    @pytest.mark.parametrize("name", ["param.get", "gcs.send_text", "mavlink.init"])
    def test_what_no_guard_can_do_without_is_missed_at_the_start_and_the_vehicle_does_not_arm(self, name: str) -> None:
        bench = Bench(absent=[name])
        assert bench.vehicle.removed[0].startswith("handover_guard.lua")
        assert (bench.refusal or "").startswith("Scripting: handover_guard.lua")

    def test_values_of_an_earlier_boot_are_kept(self) -> None:
        bench = Bench(parameters={"HNDO_TIMEOUT": 7.0, "HNDO_CHAN": 2.0})
        bench.run(1000)
        assert (bench.vehicle.parameters["HNDO_TIMEOUT"], bench.vehicle.parameters["HNDO_CHAN"]) == (7.0, 2.0)
        bench.ask(channel=2)
        bench.receive(bench.companion.lease(ttl_ms=60_000), channel=2)
        bench.run(6500)
        assert bench.statuses(channel=2)[-1].state == LIVE_STATE


def test_no_mode_is_set_on_the_ground(version: str) -> None:
    """Disarmed, the firmware would take any; armed and landed, RTL and LAND are of no use and disarming is."""
    bench = Bench(**FIRMWARE[version])
    bench.vehicle.mode, bench.vehicle.reason = LOITER, BY_GCS
    bench.run(10_000)
    bench.with_lease()
    bench.lose_lease()
    bench.run(10_000)
    for _ in range(3):
        bench.vehicle.armed = True
        bench.run(2000)
    assert bench.vehicle.mode_requests == []
    assert bench.vehicle.disarms == 3
