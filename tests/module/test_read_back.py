# SPDX-License-Identifier: GPL-3.0-or-later

"""Before a flight begins the mission is read back: what was written past the companion is not flown."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import FenceCircle
from mavproxy_handover.mission.protocol_items import item_message, item_of
from mavproxy_handover.vehicle.mission_protocol import fence_items
from tests.module.conftest import Bench
from tests.module.test_flight_uploads import ACCEPTED, Program
from tests.module.test_ground_upload import SAFE
from tests.module.test_ground_writes import needs, told
from tests.module.test_mission_upload import LOADED
from tests.module.vehicle import AUTO
from tests.packages import ROUND

VEHICLE = (1, 1)
START, ARM = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
TERMINATE, AUX = mavlink.MAV_CMD_DO_FLIGHTTERMINATION, mavlink.MAV_CMD_DO_AUX_FUNCTION
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED


@pytest.fixture
def loaded(bench: Bench, delivery: MissionPackage) -> Bench:
    bench.connect()
    assert bench.share(delivery, at_once=True).result == LOADED
    bench.wait(11.0)
    bench.autopilot.items = {kind: list(items) for kind, items in bench.autopilot.items.items()}
    bench.a.received.clear()
    bench.b.received.clear()
    return bench


def move_item(bench: Bench, seq: int = 3) -> None:
    """A program at USB writes another place."""
    item = item_of(bench.autopilot.items[0][seq])
    bench.autopilot.items[0][seq] = item_message(replace(item, lat_deg=item.lat_deg + 0.002), VEHICLE, 0)


def test_start_reads_the_mission_back_before_it_arms(loaded: Bench) -> None:
    loaded.autopilot.received.clear()
    loaded.a.command(START)
    loaded.run(4.0)
    assert loaded.a.acks(START)[-1] == 0
    kinds = [m.get_type() for m in loaded.autopilot.received if m.get_type() in ("MISSION_REQUEST_INT", "COMMAND_LONG")]
    asked = [m.seq for m in loaded.autopilot.got("MISSION_REQUEST_INT", 1) if m.mission_type == 0]
    assert [seq for seq in asked if seq] == list(range(1, 12)), "and 0, home, which is asked for by itself too"
    assert kinds.index("MISSION_REQUEST_INT") == 0, "before anything is commanded"


def test_a_mission_written_past_the_companion_is_not_started(loaded: Bench) -> None:
    """The fault: START armed and flew it."""
    move_item(loaded)
    loaded.a.command(START)
    loaded.run(4.0)
    assert loaded.a.acks(START) == [mavlink.MAV_RESULT_IN_PROGRESS, REJECTED]
    assert ARM not in loaded.autopilot.commands()
    assert "START refused: item 3: latitude" in loaded.a.texts()
    assert loaded.companion.arbiter.mission_digest == b""
    (text,) = told(loaded.b)
    assert text.startswith(
        "The mission does not count any more: it was changed without the companion (item 3: latitude "
    )
    assert text.endswith("START needs 'handover share'.")
    assert "no mission loaded, because it was changed without the companion (item 3: latitude" in needs(loaded)
    (entry,) = loaded.journal("changed_past")
    assert "item 3: latitude" in entry["text"]


def test_it_is_not_armed_by_hand_either(loaded: Bench) -> None:
    move_item(loaded)
    loaded.a.command(ARM, 1)
    loaded.run(2.0)
    assert loaded.a.acks(ARM) == [REJECTED]
    assert not loaded.autopilot.armed
    assert "changed without the companion" in loaded.a.texts()


def test_after_that_the_package_can_be_shared_again(loaded: Bench, delivery: MissionPackage) -> None:
    move_item(loaded)
    loaded.a.command(START)
    loaded.run(2.0)
    assert loaded.share(delivery).result == LOADED
    assert needs(loaded) == ""


def test_the_package_on_board_does_not_overwrite_it(bench: Bench, delivery: MissionPackage) -> None:
    bench.configure(more=f'mission = "{ROUND}"')
    bench.a.digest = bench.b.digest = delivery.digest
    bench.connect()
    bench.until(lambda: bench.companion.arbiter.mission_digest)
    bench.wait(6.0)
    bench.autopilot.items = {kind: list(items) for kind, items in bench.autopilot.items.items()}
    bench.autopilot.items[0] = bench.autopilot.items[0][:6]
    bench.a.command(START)
    bench.wait(30.0)
    assert len(bench.autopilot.items[0]) == 6
    assert bench.companion.arbiter.mission_digest == b""
    assert "Or clear the mission: then the package on board is loaded" in bench.b.texts()


def test_a_geofence_written_past_the_companion_is_not_started(loaded: Bench) -> None:
    wide = fence_items([FenceCircle(True, 52.679, 5.93, 30000.0)])
    loaded.autopilot.items[1] = [item_message(item, VEHICLE, 1) for item in wide]
    loaded.a.command(START)
    loaded.run(4.0)
    assert loaded.a.acks(START)[-1] == REJECTED
    assert "geofence" in loaded.a.texts()


def test_an_uploaded_mission_is_read_back_too(loaded: Bench) -> None:
    assert Program(loaded, SAFE).send() == ACCEPTED
    loaded.wait(3.0)
    assert needs(loaded) == ""
    loaded.autopilot.items[0] = loaded.autopilot.items[0][:4]
    loaded.a.command(START)
    loaded.run(4.0)
    assert loaded.a.acks(START)[-1] == REJECTED
    assert loaded.companion.arbiter.mission_digest == b""


def test_armed_by_hand_auto_takes_off_without_another_wait(loaded: Bench) -> None:
    loaded.a.command(ARM, 1)
    loaded.run(1.5)
    assert loaded.a.acks(ARM) == [0]
    loaded.autopilot.received.clear()
    loaded.a.command(mavlink.MAV_CMD_DO_SET_MODE, 1, AUTO)
    loaded.run(0.3)
    assert loaded.autopilot.mode == AUTO
    assert loaded.autopilot.got("MISSION_REQUEST_INT", 1) == []


def test_motors_do_not_start_long_after_somebody_asked_for_it(loaded: Bench) -> None:
    loaded.autopilot.silent_lists = True
    loaded.a.command(ARM, 1)
    loaded.wait(3.5)
    assert loaded.a.acks(ARM) == [REJECTED]
    assert "the mission is still being read back: send it again" in loaded.a.texts()
    loaded.autopilot.silent_lists = False
    loaded.wait(3.0)
    assert not loaded.autopilot.armed
    loaded.a.command(ARM, 1)
    loaded.run(0.3)
    assert loaded.a.acks(ARM) == [REJECTED, 0], "the reading went on, and is done"


@pytest.mark.parametrize("disarm", [(ARM, 0), (ARM, 0, 21196), (TERMINATE, 1), (AUX, 81, 2), (AUX, 153, 0)], ids=str)
def test_a_later_disarm_withdraws_an_arm_that_waits(loaded: Bench, disarm: tuple[int, ...]) -> None:
    """The fault: the motors started up to 3 s after the operator had disarmed."""
    lists = loaded.autopilot.silent_lists = True
    loaded.a.command(ARM, 1)
    loaded.run(0.5)
    loaded.a.command(*disarm)
    loaded.run(0.5)
    loaded.autopilot.silent_lists = not lists
    loaded.wait(6.0)
    assert disarm[0] in loaded.autopilot.commands()
    assert not any(m.command == ARM and m.param1 for m in loaded.autopilot.got("COMMAND_LONG"))
    assert "arm refused: withdrawn by a later disarm" in loaded.a.texts()
    # of the same command a station could not tell it from the answer to the disarm
    assert loaded.a.acks(ARM) == ([ACCEPTED] if disarm[0] == ARM else [REJECTED])
    loaded.a.command(ARM, 1)
    loaded.run(0.5)
    assert loaded.autopilot.armed


def test_a_program_whose_arm_another_program_of_the_station_withdraws_is_answered(loaded: Bench) -> None:
    """The fault: the autopilot answers the disarm to the program that sent it, and the arm had no answer at all."""
    loaded.autopilot.silent_lists = True
    tablet = mavlink.MAVLink(None, srcSystem=loaded.a.sysid, srcComponent=230)
    arm = mavlink.MAVLink_command_long_message(*VEHICLE, ARM, 0, 1, 0, 0, 0, 0, 0, 0)
    loaded.a.send_bytes(arm.pack(tablet))
    loaded.run(0.5)
    loaded.a.command(ARM, 0)
    loaded.run(0.5)
    answers = [(m.target_component, m.result) for m in loaded.a.got("COMMAND_ACK") if m.command == ARM]
    assert sorted(answers) == [(190, ACCEPTED), (230, REJECTED)]


def test_another_command_that_waits_is_withdrawn_too_and_answered(loaded: Bench) -> None:
    loaded.autopilot.silent_lists = True
    loaded.a.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10)
    loaded.run(0.5)
    loaded.a.command(ARM, 0)
    loaded.run(0.5)
    assert loaded.a.acks(mavlink.MAV_CMD_NAV_TAKEOFF) == [REJECTED]
    assert "take-off refused: withdrawn by a later disarm" in loaded.a.texts()


def test_nobody_else_withdraws_it(loaded: Bench) -> None:
    loaded.autopilot.silent_lists = True
    loaded.a.command(ARM, 1)
    loaded.run(0.5)
    loaded.b.command(ARM, 0)
    loaded.run(0.3)
    loaded.autopilot.silent_lists = False
    loaded.run(2.0)
    assert loaded.autopilot.armed


def test_an_autopilot_that_does_not_give_its_mission_is_not_started(loaded: Bench, delivery: MissionPackage) -> None:
    loaded.autopilot.silent_lists = True
    loaded.a.command(START)
    loaded.wait(8.0)
    assert loaded.a.acks(START)[-1] == mavlink.MAV_RESULT_FAILED
    assert "START failed: no answer to MISSION_REQUEST_LIST (mission)" in loaded.a.texts()
    assert loaded.companion.arbiter.mission_digest == delivery.digest, "nothing says that it is another one"


def test_an_item_that_is_lost_on_its_way_is_asked_for_again(loaded: Bench) -> None:
    lost = [4, 5]
    give = loaded.autopilot._give_item

    def give_or_lose(m: object) -> None:
        if getattr(m, "seq", None) in lost:
            lost.remove(m.seq)  # type: ignore[attr-defined]
        else:
            give(m)

    loaded.autopilot._give_item = give_or_lose  # type: ignore[method-assign]
    loaded.autopilot.received.clear()
    loaded.a.command(START)
    loaded.run(6.0)
    assert loaded.a.acks(START)[-1] == 0
    asked = [m.seq for m in loaded.autopilot.got("MISSION_REQUEST_INT", 1) if m.mission_type == 0]
    assert [asked.count(seq) for seq in range(1, 6)] == [1, 1, 1, 2, 2], "those that came are not asked for again"
