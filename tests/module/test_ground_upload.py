# SPDX-License-Identifier: GPL-3.0-or-later

"""A mission that the commander uploads on the ground: read back, judged, and flown if it is safe."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import FenceCircle
from mavproxy_handover.mission.protocol_items import item_message
from mavproxy_handover.mission.route_simulation import legs_of
from mavproxy_handover.vehicle.mission_protocol import fence_items
from tests.module.conftest import Bench
from tests.module.test_commands_in_flight import override
from tests.module.test_flight_uploads import ACCEPTED, HOME_LAT, HOME_LON, Program, waypoint
from tests.module.test_ground_writes import needs, told
from tests.module.test_mission_upload import LOADED
from tests.module.test_restart import restart
from tests.module.vehicle import AUTO
from tests.packages import ROUND

VEHICLE = (1, 1)
START = mavlink.MAV_CMD_MISSION_START
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
REJECTED, FAILED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED, mavlink.MAV_RESULT_FAILED

#: home, take-off, two places in zone A, a landing
SAFE = (
    waypoint(0, HOME_LAT, HOME_LON, 0.0),
    replace(waypoint(1, 0, 0, 40.0), command=22),
    waypoint(2, 526781460, 59250350),
    waypoint(3, 526790000, 59250000),
    waypoint(4, HOME_LAT, HOME_LON, 0.0, command=21),
)
#: the same by way of a place north of both zones, inside the fence
OUTSIDE = (*SAFE[:3], replace(SAFE[3], lat_deg=52.6828), SAFE[4])
TAKEN = (
    "The mission of GCSA on the autopilot was read back and judged. START flies it (4 items). Zones and stations stay "
    "those of package delivery."
)


@pytest.fixture
def loaded(bench: Bench, delivery: MissionPackage) -> Bench:
    bench.connect()
    assert bench.share(delivery, at_once=True).result == LOADED
    bench.wait(6.0)
    bench.autopilot.items = {kind: list(items) for kind, items in bench.autopilot.items.items()}
    bench.a.received.clear()
    bench.b.received.clear()
    return bench


@pytest.fixture
def on_board(bench: Bench, delivery: MissionPackage) -> Bench:
    """The package is named in the vehicle's configuration, and loaded."""
    bench.configure(more=f'mission = "{ROUND}"')
    bench.a.digest = bench.b.digest = delivery.digest
    bench.connect()
    bench.until(lambda: bench.companion.arbiter.mission_digest)
    bench.wait(12.0)
    bench.autopilot.items = {kind: list(items) for kind, items in bench.autopilot.items.items()}
    bench.a.received.clear()
    bench.b.received.clear()
    return bench


# ---- what is flown ------------------------------------------------------------------------------------------------


def test_a_safe_mission_uploaded_on_the_ground_is_flown_by_start(loaded: Bench, delivery: MissionPackage) -> None:
    """The fault: START was refused until a package was shared."""
    assert Program(loaded, SAFE).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == delivery.digest, "or no station could take the aircraft"
    assert needs(loaded) == ""
    loaded.a.command(START)
    loaded.wait(4.0)
    assert loaded.a.acks(START)[-1] == 0
    assert (loaded.autopilot.mode, loaded.autopilot.armed) == (AUTO, True)
    assert len(loaded.autopilot.items[0]) == 5, "nothing was written over it"


def test_every_station_is_told_in_words_and_that_the_route_is_another(loaded: Bench) -> None:
    assert Program(loaded, SAFE).send() == ACCEPTED
    loaded.wait(3.0)
    assert told(loaded.a) == told(loaded.b) == [TAKEN]
    assert loaded.b.got("AUTHORITY_STATUS")[-1].route_changed == 1
    (entry,) = loaded.journal("mission_judged")
    assert (entry["station"], entry["items"], entry["commanders"]) == ("GCSA", 4, "GCSA")


def test_arming_goes_by_the_uploaded_mission(on_board: Bench) -> None:
    assert Program(on_board, SAFE).send() == ACCEPTED
    on_board.wait(3.0)
    on_board.a.command(ARM, 1)
    on_board.run(1.0)
    assert on_board.a.acks(ARM) == [0]
    assert on_board.autopilot.armed


def test_the_companion_flies_by_the_uploaded_mission(loaded: Bench) -> None:
    assert Program(loaded, SAFE).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.companion.autopilot.command_check.ahead is not None
    assert len(loaded.companion.autopilot.command_check.ahead.route.items) == 4
    assert loaded.companion.arbiter.snapshot().route == (251,)


def test_the_packages_own_mission_sent_again_is_the_package(loaded: Bench, delivery: MissionPackage) -> None:
    assert Program(loaded, delivery.route.upload_items()).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == delivery.digest
    assert loaded.companion.arbiter.snapshot().route == (251, 252, 251, 252, 251)
    loaded.run(1.0)
    assert loaded.b.got("AUTHORITY_STATUS")[-1].route_changed == 0
    assert told(loaded.b) == ["The mission of GCSA on the autopilot is that of package delivery. START flies it."]


def test_a_package_can_be_shared_over_an_uploaded_mission(loaded: Bench, delivery: MissionPackage) -> None:
    assert Program(loaded, SAFE).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.share(delivery).result == LOADED
    assert len(loaded.autopilot.items[0]) == 12, "it was written"
    loaded.run(1.0)
    assert loaded.b.got("AUTHORITY_STATUS")[-1].route_changed == 0


def test_after_a_flight_by_an_uploaded_mission_it_still_counts(loaded: Bench, delivery: MissionPackage) -> None:
    assert Program(loaded, SAFE).send() == ACCEPTED
    loaded.wait(3.0)
    loaded.a.command(START)
    loaded.wait(4.0)
    loaded.autopilot.armed = loaded.autopilot.airborne = False
    loaded.autopilot.mode = 0
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == delivery.digest
    assert needs(loaded) == ""


def test_while_it_is_read_start_says_so(loaded: Bench) -> None:
    loaded.a.send(mavlink.MAVLink_mission_count_message(*VEHICLE, 5, 0))
    loaded.run(0.3)
    assert needs(loaded) == "no mission loaded, because the mission of GCSA is being judged"


def test_a_geofence_uploaded_on_the_ground_counts_for_the_mission(loaded: Bench, delivery: MissionPackage) -> None:
    """The package's own mission, within another geofence around it."""
    assert Program(loaded, fence_items([FenceCircle(True, 52.679, 5.93, 3000.0)]), kind=1).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == delivery.digest
    (fence,) = loaded.companion.autopilot.command_check.ahead.route.fence
    assert fence.radius_m == 3000.0
    assert told(loaded.b) == [
        "The geofence of GCSA on the autopilot was read back and judged. START flies the mission within it (11 items). "
        "Zones and stations stay those of package delivery."
    ]


#: take-off, two places, and once more to both: 2 and 3 are flown twice
JUMPING = (
    *SAFE[:4],
    replace(waypoint(4, 0, 0, 0.0, command=177), param1=2.0, param2=1.0),
    replace(SAFE[4], seq=5),
)


def test_a_mission_with_a_jump_is_walked_as_it_is_flown(loaded: Bench, delivery: MissionPackage) -> None:
    """The fault: ArduPilot's own CopterMission was refused for its DO_JUMP."""
    assert Program(loaded, JUMPING).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == delivery.digest
    route = loaded.companion.autopilot.command_check.ahead.route
    assert [leg.seq for leg in legs_of(route) if leg.length_m > 1.0] == [2, 3, 2, 3, 5]
    assert needs(loaded) == ""


def test_a_jump_without_end_is_not_flown(loaded: Bench) -> None:
    endless = (*JUMPING[:4], replace(JUMPING[4], param2=-1.0), JUMPING[5])
    assert Program(loaded, endless).send() == ACCEPTED
    loaded.wait(3.0)
    assert "item 4: DO_JUMP repeats without end: its energy cannot be judged" in needs(loaded)


# ---- what is not --------------------------------------------------------------------------------------------------


def rejected(why: str, cure: str = "") -> str:
    cure = cure or "START needs another mission or 'handover share'."
    return f"The mission of GCSA is on the autopilot and is not flown: {why}. {cure}"


def test_a_mission_that_leaves_coverage_is_kept_and_not_flown(loaded: Bench) -> None:
    assert Program(loaded, OUTSIDE).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == b""
    assert len(loaded.autopilot.items[0]) == 5, "it is kept"
    (text,) = told(loaded.b)
    assert text.startswith("The mission of GCSA is on the autopilot and is not flown: leaves coverage in ")
    assert "handover override coverage" in text
    assert "leaves coverage in" in needs(loaded)


def test_the_same_mission_sent_again_to_insist_is_flown(loaded: Bench, delivery: MissionPackage) -> None:
    assert Program(loaded, OUTSIDE).send() == ACCEPTED
    loaded.wait(14.0)
    assert Program(loaded, OUTSIDE).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == delivery.digest


def test_after_the_override_it_is_flown(loaded: Bench, delivery: MissionPackage) -> None:
    assert Program(loaded, OUTSIDE).send() == ACCEPTED
    loaded.wait(3.0)
    override(loaded, mavlink.HANDOVER_LIMIT_COVERAGE)
    assert Program(loaded, OUTSIDE).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == delivery.digest


@pytest.mark.parametrize(
    ("items", "why"),
    [
        ((SAFE[0], replace(SAFE[2], seq=1), replace(SAFE[4], seq=2)), "the first flown item is NAV_WAYPOINT"),
        ((*SAFE[:3], waypoint(3, 0, 0, command=179), SAFE[4]), "item 3: DO_SET_HOME takes away a safeguard"),
    ],
    ids=["no take-off", "DO_SET_HOME"],
)
def test_what_cannot_be_judged_is_kept_and_named(loaded: Bench, items: Any, why: str) -> None:
    assert Program(loaded, items).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == b""
    (text,) = told(loaded.a)
    assert text.startswith(f"The mission of GCSA is on the autopilot and is not flown: {why}")
    assert text.endswith("START needs another mission or 'handover share'.")
    assert why in needs(loaded)


def test_before_the_autopilot_has_a_home_the_mission_waits(loaded: Bench, delivery: MissionPackage) -> None:
    """The fault: ArduPilot's autotest uploads before the position is known, and was refused for good."""
    assert Program(loaded, (replace(SAFE[0], lat_deg=0.0, lon_deg=0.0), *SAFE[1:])).send() == ACCEPTED
    loaded.run(5.0)
    words = "the mission of GCSA waits to be judged: the autopilot has no home yet"
    assert needs(loaded) == f"no mission loaded, because {words}"
    assert told(loaded.a) == []
    loaded.autopilot.items[0][0] = item_message(SAFE[0], VEHICLE, 0)
    loaded.run(4.0)
    assert loaded.companion.arbiter.mission_digest == delivery.digest
    assert needs(loaded) == ""


def test_a_mission_outside_the_geofence_is_not_flown(loaded: Bench) -> None:
    assert Program(loaded, fence_items([FenceCircle(True, 52.679, 5.924, 60.0)]), kind=1).send() == ACCEPTED
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == b""
    (text,) = told(loaded.b)
    assert text.startswith("The geofence of GCSA is on the autopilot and the mission is not flown: breaks the geofence")


def test_a_cleared_geofence_of_the_package_is_named(loaded: Bench) -> None:
    loaded.a.send(mavlink.MAVLink_mission_clear_all_message(*VEHICLE, 1))
    loaded.wait(3.0)
    assert loaded.companion.arbiter.mission_digest == b""
    (text,) = told(loaded.b)
    assert "the geofence of package delivery was cleared" in text


def test_without_any_package_the_upload_is_not_called_a_package_that_does_not_count(bench: Bench) -> None:
    bench.connect()
    assert Program(bench, SAFE).send() == ACCEPTED
    bench.wait(3.0)
    assert told(bench.a) == [
        rejected("without a mission package no zones are known", "START needs a mission package: 'handover share'.")
    ]
    assert "counts" not in " ".join(entry.get("text", "") for entry in bench.journal("list_changed"))


def test_a_mission_that_does_not_come_back_is_read_again_and_then_named(loaded: Bench) -> None:
    loaded.autopilot.silent_lists = True
    assert Program(loaded, SAFE).send() == ACCEPTED
    loaded.wait(10.0)
    assert "being judged" in needs(loaded)
    loaded.wait(15.0)
    assert "it could not be read back: no answer to MISSION_REQUEST_LIST (mission)" in needs(loaded)
    assert [text for text in told(loaded.a) if "could not be read back" in text] != []


# ---- cleared ------------------------------------------------------------------------------------------------------


def test_after_clear_arming_is_refused_at_once_with_the_reason(on_board: Bench) -> None:
    on_board.a.send(mavlink.MAVLink_mission_clear_all_message(*VEHICLE, 0))
    on_board.run(0.3)
    on_board.a.command(ARM, 1)
    on_board.run(0.3)
    assert on_board.a.acks(ARM) == [REJECTED]
    assert (
        "no mission loaded, because GCSA cleared it. The package on board is loaded within 10 s" in on_board.a.texts()
    )


def test_after_clear_without_a_package_on_board_the_reason_is_the_cleared_mission(loaded: Bench) -> None:
    loaded.a.send(mavlink.MAVLink_mission_clear_all_message(*VEHICLE, 0))
    loaded.wait(3.0)
    assert needs(loaded) == "no mission loaded, because GCSA cleared it"
    assert told(loaded.b) == ["GCSA cleared the mission on the autopilot. START needs a mission or 'handover share'."]


# ---- over a restart of the companion ------------------------------------------------------------------------------


@pytest.fixture
def kept_state(bench: Bench, delivery: MissionPackage) -> Bench:
    """With a package on board, and a mission that a station has uploaded over it."""
    bench.configure(more=f'mission = "{ROUND}"\nstate = "state"')
    bench.a.digest = bench.b.digest = delivery.digest
    bench.connect()
    bench.until(lambda: bench.companion.arbiter.mission_digest)
    bench.wait(2.0)
    bench.autopilot.items = {kind: list(items) for kind, items in bench.autopilot.items.items()}
    return bench


def test_a_restart_on_the_ground_does_not_overwrite_an_upload_that_was_flown(
    kept_state: Bench, delivery: MissionPackage
) -> None:
    """The fault: fifteen seconds later the package on board was written over it."""
    assert Program(kept_state, SAFE).send() == ACCEPTED
    kept_state.wait(3.0)
    restart(kept_state)
    kept_state.until(lambda: kept_state.companion.view.commander == 251)
    kept_state.wait(40.0)
    assert len(kept_state.autopilot.items[0]) == 5
    assert kept_state.companion.arbiter.mission_digest == delivery.digest, "it was read back and judged anew"
    assert kept_state.b.got("AUTHORITY_STATUS")[-1].route_changed == 1
    assert "The mission on the autopilot was read back and judged. START flies it (4 items)" in kept_state.b.texts()


def test_a_restart_on_the_ground_does_not_overwrite_an_upload_that_did_not_pass(kept_state: Bench) -> None:
    assert Program(kept_state, OUTSIDE).send() == ACCEPTED
    kept_state.wait(3.0)
    for _ in range(2):
        restart(kept_state)
        kept_state.until(lambda: kept_state.companion.view.commander == 251)
        kept_state.wait(20.0)
        assert len(kept_state.autopilot.items[0]) == 5
        assert kept_state.companion.arbiter.mission_digest == b""
        assert "leaves coverage in" in needs(kept_state)


def test_after_a_restart_the_package_counts_that_a_station_had_shared(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    assert bench.share(delivery).result == LOADED
    bench.run(2.0)
    bench.autopilot.items = {kind: list(items) for kind, items in bench.autopilot.items.items()}
    assert Program(bench, SAFE).send() == ACCEPTED
    bench.wait(3.0)
    for _ in range(2):
        restart(bench)
        bench.until(lambda: bench.companion.view.commander == 251)
        bench.wait(8.0)
        assert bench.companion.arbiter.mission_digest == delivery.digest
        assert len(bench.autopilot.items[0]) == 5


def test_a_restart_in_flight_knows_the_uploaded_mission(kept_state: Bench) -> None:
    """The fault: its route was unknown from then on, and commands were not judged by it."""
    assert Program(kept_state, SAFE).send() == ACCEPTED
    kept_state.wait(3.0)
    kept_state.a.command(START)
    kept_state.wait(5.0)
    assert kept_state.autopilot.mode == AUTO
    restart(kept_state)
    kept_state.until(lambda: kept_state.companion.view.commander == 251)
    kept_state.wait(15.0)
    assert kept_state.companion.autopilot.command_check.ahead is not None
    assert len(kept_state.companion.autopilot.command_check.ahead.route.items) == 4
    kept_state.autopilot.armed = kept_state.autopilot.airborne = False
    kept_state.autopilot.mode = 0
    kept_state.wait(15.0)
    assert len(kept_state.autopilot.items[0]) == 5, "nothing is written over it after the landing"
    assert needs(kept_state) == ""
