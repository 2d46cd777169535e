# SPDX-License-Identifier: GPL-3.0-or-later

"""Missions that the commander uploads in flight: whole and judged, or not at all. The delivery mission, in zone A."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.items import MissionItem
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.protocol_items import item_message, older_item_message
from mavproxy_handover.vehicle.mission_protocol import fence_items
from tests.module.conftest import Bench
from tests.module.test_commands_in_flight import override, take_off
from tests.module.vehicle import Station

ACCEPTED, ERROR, DENIED, INVALID, UNSUPPORTED, NO_SPACE = 0, 1, 14, 5, 3, 4
VEHICLE = (1, 1)
#: 1e-7 degrees
HOME_LAT, HOME_LON = 526790000, 59240000


@pytest.fixture
def flown(bench: Bench, delivery: MissionPackage) -> Bench:
    flown = take_off(bench, delivery)
    flown.autopilot.items = {kind: list(items) for kind, items in flown.autopilot.items.items()}
    return flown


class Program:
    """A ground station program that uploads a list as it should; what it hears is in `acks`."""

    def __init__(self, bench: Bench, items: Sequence[MissionItem], kind: int = 0, older: bool = False) -> None:
        self.bench, self.items, self.kind = bench, items, kind
        self.pack = older_item_message if older else item_message
        self.station: Station = bench.a
        self._seen = len(self.station.received)
        self.acks: list[int] = []
        self.asked: list[int] = []
        #: requests for an item that are answered by nothing
        self.deaf = 0

    def begin(self) -> None:
        self.station.send(mavlink.MAVLink_mission_count_message(*VEHICLE, len(self.items), self.kind))

    def turn(self) -> None:
        """Answer what came."""
        while self._seen < len(self.station.received):
            message = self.station.received[self._seen]
            self._seen += 1
            if getattr(message, "mission_type", None) != self.kind or message.target_system != self.station.sysid:
                continue
            if message.get_type() == "MISSION_ACK":
                self.acks.append(message.type)
            elif message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                self.asked.append(message.seq)
                if self.deaf:
                    self.deaf -= 1
                    continue
                self.station.send(self.pack(self.items[message.seq], VEHICLE, self.kind))

    def send(self, limit_s: float = 20.0) -> int:
        """All of it; the answer."""
        self.begin()
        before = len(self.acks)

        def answered() -> bool:
            self.turn()
            return len(self.acks) > before

        self.bench.until(answered, limit_s)
        return self.acks[-1]


def waypoint(seq: int, lat: int, lon: int, alt_m: float = 40.0, command: int = 16) -> MissionItem:
    return MissionItem(seq, command, 3, 0.0, 0.0, 0.0, 0.0, lat / 1e7, lon / 1e7, alt_m)


#: home, two places in zone A, a landing
INSIDE = (
    waypoint(0, HOME_LAT, HOME_LON, 0.0),
    waypoint(1, 526781460, 59250350),
    waypoint(2, 526790000, 59250000),
    waypoint(3, HOME_LAT, HOME_LON, 0.0, command=21),
)
#: the same by way of a place north of both zones, inside the fence
OUTSIDE = (*INSIDE[:2], replace(INSIDE[2], lat_deg=52.6828), INSIDE[3])


def held(bench: Bench) -> list[tuple[int, int, int]]:
    """The mission that the autopilot holds."""
    return [(item.command, item.x, item.y) for item in bench.autopilot.items[0]]


NEW = [(16, HOME_LAT, HOME_LON), (16, 526781460, 59250350), (16, 526790000, 59250000), (21, HOME_LAT, HOME_LON)]


@pytest.mark.parametrize("older", [False, True], ids=["MISSION_ITEM_INT", "MISSION_ITEM"])
def test_a_mission_inside_everything_is_written_read_back_and_then_accepted(flown: Bench, older: bool) -> None:
    program = Program(flown, INSIDE, older=older)
    assert program.send() == ACCEPTED
    assert program.asked[:4] == [0, 1, 2, 3]
    if not older:
        assert held(flown) == NEW
    assert [(m.seq, m.get_srcComponent()) for m in flown.autopilot.got("MISSION_ITEM_INT", 1)] == [
        (number, 191) for number in range(4)
    ], "by the companion, once"
    assert flown.autopilot.got("MISSION_COUNT", 251) == []
    assert flown.autopilot.got("MISSION_REQUEST_INT", 1), "it was read back"
    (entry,) = flown.journal("rerouted")
    assert (entry["station"], entry["items"], entry["commanders"]) == ("GCSA", 3, "GCSA")


def test_the_companion_goes_by_the_new_mission(flown: Bench, delivery: MissionPackage) -> None:
    digest = delivery.digest
    flown.run(0.6)
    assert Program(flown, INSIDE).send() == ACCEPTED
    assert flown.companion.arbiter.mission_digest == digest, "or no station could take the aircraft"
    assert flown.companion.arbiter.snapshot().route == (251,)
    flown.run(1.0)
    assert flown.a.got("AUTHORITY_STATUS")[-1].route_changed == 1
    assert flown.a.got("AUTHORITY_STATUS")[0].route_changed == 0
    assert flown.companion.autopilot.command_check.ahead.route.items[0].seq == 1
    assert len(flown.companion.autopilot.command_check.ahead.route.items) == 3


def test_the_delivery_point_of_the_package_is_none_of_a_mission_that_is_sent_in_flight(flown: Bench) -> None:
    assert Program(flown, INSIDE).send() == ACCEPTED
    flown.autopilot.say(mavlink.MAVLink_mission_item_reached_message(8))
    flown.mpstate.deliver(flown.autopilot._out[-1])
    assert flown.journal("reached")[-1]["number"] == 8
    assert flown.journal("delivery") == []


def test_on_the_ground_again_the_mission_is_unknown_and_start_needs_a_package(flown: Bench) -> None:
    assert Program(flown, INSIDE).send() == ACCEPTED
    flown.autopilot.armed = flown.autopilot.airborne = False
    flown.wait(3.0)
    assert flown.companion.arbiter.mission_digest == b""
    assert "no mission loaded" in ", ".join(flown.companion.arbiter.start_needs(251, flown.clock.now))
    flown.run(1.0)
    assert flown.a.got("AUTHORITY_STATUS")[-1].route_changed == 0


def test_a_mission_that_leaves_coverage_is_denied_in_words_and_nothing_of_it_is_written(flown: Bench) -> None:
    before = held(flown)
    assert Program(flown, OUTSIDE).send() == DENIED
    assert held(flown) == before
    assert flown.autopilot.got("MISSION_COUNT") == []
    assert "mission refused: leaves coverage in" in flown.a.texts()
    assert "handover override coverage" in flown.a.texts()
    (entry,) = flown.journal("command_refused")
    assert entry["limits"] == ["coverage"]


def test_sent_again_after_ten_seconds_it_is_written(flown: Bench) -> None:
    assert Program(flown, OUTSIDE).send() == DENIED
    flown.wait(3.5)
    assert Program(flown, OUTSIDE).send() == DENIED
    flown.wait(10.0)
    assert Program(flown, OUTSIDE).send() == ACCEPTED
    assert held(flown)[2] == (16, 526828000, 59250000)
    (entry,) = flown.journal("command_passed")
    assert (entry["limits"], entry["outcome"]) == (["coverage"], "lifted")


def test_the_override_lets_it_through(flown: Bench) -> None:
    override(flown, mavlink.HANDOVER_LIMIT_COVERAGE)
    assert Program(flown, OUTSIDE).send() == ACCEPTED


def test_a_part_of_a_mission_is_judged_as_the_whole_that_it_makes(flown: Bench) -> None:
    before = held(flown)
    program = Program(flown, {3: waypoint(3, 526828000, 59299100)})  # type: ignore[arg-type]
    flown.a.send(mavlink.MAVLink_mission_write_partial_list_message(*VEHICLE, 3, 3, 0))
    flown.until(lambda: [program.turn()] and program.acks)
    assert program.acks == [DENIED]
    assert held(flown) == before
    inside = Program(flown, {3: waypoint(3, 526780600, 59299000)})  # type: ignore[arg-type]
    flown.a.send(mavlink.MAVLink_mission_write_partial_list_message(*VEHICLE, 3, 3, 0))
    flown.until(lambda: [inside.turn()] and inside.acks)
    assert inside.acks == [ACCEPTED]
    assert len(held(flown)) == len(before)
    assert held(flown)[3] == (16, 526780600, 59299000)
    assert [one for number, one in enumerate(held(flown)) if number != 3] == [
        one for number, one in enumerate(before) if number != 3
    ]


@pytest.mark.parametrize(
    ("item", "result", "words"),
    [
        (
            waypoint(2, 526790000, 59250000, command=177),
            UNSUPPORTED,
            "item 2: command 177 is not one that can be judged",
        ),
        (
            waypoint(2, 526790000, 59250000, command=179),
            UNSUPPORTED,
            "item 2: command 179 is not one that can be judged",
        ),
        (waypoint(2, 910000000, 59250000), mavlink.MAV_MISSION_INVALID_PARAM5_X, "item 2: latitude out of range"),
        (replace(INSIDE[2], alt_m=float("nan")), mavlink.MAV_MISSION_INVALID_PARAM7, "item 2: altitude out of range"),
        (replace(INSIDE[2], frame=1), INVALID, "frame of NAV_WAYPOINT is not one with a place"),
        (replace(INSIDE[2], alt_m=20000.0), INVALID, "altitude is 20000"),
    ],
    ids=["jump", "set home", "no place", "no altitude", "local frame", "too high"],
)
def test_an_item_that_is_none_is_answered_as_such(flown: Bench, item: MissionItem, result: int, words: str) -> None:
    before = held(flown)
    assert Program(flown, (*INSIDE[:2], item, INSIDE[3])).send() == result
    assert words in flown.a.texts()
    assert held(flown) == before
    assert flown.companion.faults == {}


def test_a_mission_of_nothing_and_a_clear_are_denied(flown: Bench) -> None:
    before = held(flown)
    program = Program(flown, ())
    assert program.send() == DENIED
    flown.wait(3.0)
    for kind, result in ((255, mavlink.MAV_MISSION_UNSUPPORTED), (0, DENIED)):  # all lists: as ArduPilot has it
        flown.a.received.clear()
        flown.a.send(mavlink.MAVLink_mission_clear_all_message(*VEHICLE, kind))
        flown.run(0.5)
        acks = [(m.type, m.mission_type) for m in flown.a.got("MISSION_ACK")]
        assert acks == [(result, kind)]
        flown.wait(3.0)
    assert held(flown) == before
    assert flown.autopilot.got("MISSION_CLEAR_ALL") == []
    assert "it cannot be cleared in flight, only replaced" in flown.a.texts()


@pytest.mark.parametrize("number", [702, 65535])
def test_too_many_items_are_refused_at_once(flown: Bench, number: int) -> None:
    flown.a.send(mavlink.MAVLink_mission_count_message(*VEHICLE, number, 0))
    flown.run(0.3)
    assert [m.type for m in flown.a.got("MISSION_ACK")] == [NO_SPACE]


def test_the_program_is_kept_waiting_while_the_autopilot_is_slow(flown: Bench) -> None:
    """QGroundControl waits 1.5 s for the last answer, and takes another request for one."""
    flown.autopilot.silent = True
    program = Program(flown, INSIDE)
    program.begin()
    flown.until(lambda: [program.turn()] and 3 in program.asked)
    for _ in range(3):
        before = len(program.asked)
        flown.run(1.2)
        program.turn()
        assert program.asked[before:] == [3, 3]
        assert program.acks == []
    flown.autopilot.silent = False
    flown.until(lambda: [program.turn()] and program.acks)
    assert program.acks == [ACCEPTED]


def test_a_mission_that_comes_back_changed_is_an_error_and_then_unknown(flown: Bench) -> None:
    def spoil(item: Any) -> Any:
        if item.mission_type == 0 and item.seq == 2:
            item.x += 1000
        return item

    flown.autopilot.spoil = spoil
    assert Program(flown, INSIDE).send() == ERROR
    assert "what the autopilot holds is not known" in flown.a.texts()
    assert flown.companion.autopilot.command_check.ahead is None
    assert flown.companion.arbiter.mission_digest != b"", "handovers go on"
    flown.autopilot.spoil = lambda item: item
    assert Program(flown, INSIDE).send() == ACCEPTED


def test_an_observers_upload_is_refused_at_the_gate_and_disturbs_no_other(flown: Bench) -> None:
    program = Program(flown, INSIDE)
    program.begin()
    flown.run(0.1)
    for _ in range(20):
        flown.b.send(mavlink.MAVLink_mission_count_message(*VEHICLE, 700, 0))
        flown.b.send(mavlink.MAVLink_mission_item_int_message(*VEHICLE, 1, 3, 16, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0))
    flown.until(lambda: [program.turn()] and program.acks)
    assert program.acks == [ACCEPTED]
    assert held(flown) == NEW
    assert {m.type for m in flown.b.got("MISSION_ACK")} == {DENIED}


def test_an_upload_ends_with_the_authority_of_its_sender(flown: Bench) -> None:
    program = Program(flown, INSIDE)
    program.deaf = 10**6
    program.begin()
    flown.run(0.2)
    flown.a.alive = False
    flown.until(lambda: flown.companion.view.commander != 251)
    flown.run(0.2)
    program.turn()
    assert mavlink.MAV_MISSION_OPERATION_CANCELLED in program.acks
    assert flown.companion.autopilot.mission.flight_uploads._servers[0].sender is None
    assert [m for m in flown.autopilot.got("MISSION_COUNT") if m.mission_type == 0] == []


def test_its_sender_may_call_it_off(flown: Bench) -> None:
    program = Program(flown, INSIDE)
    program.deaf = 10**6
    program.begin()
    flown.run(0.2)
    cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
    flown.a.send(mavlink.MAVLink_mission_ack_message(*VEHICLE, cancelled, 0))
    flown.run(0.2)
    flown.a.received.clear()
    flown.wait(3.0)
    assert flown.a.got("MISSION_REQUEST_INT") == []


def test_reading_goes_to_the_autopilot_as_ever(flown: Bench) -> None:
    flown.a.send(mavlink.MAVLink_mission_request_list_message(*VEHICLE, 0))
    flown.run(0.3)
    assert [m.count for m in flown.a.got("MISSION_COUNT")] == [12]


@pytest.mark.parametrize("changed", [False, True], ids=["the package's", "another one"])
def test_after_a_restart_in_flight_the_mission_is_read_back(flown: Bench, changed: bool) -> None:
    """The package is kept over a restart, and not what the commander has sent since: nobody knows that one then."""
    if changed:
        assert Program(flown, INSIDE).send() == ACCEPTED
    flown.mpstate.unload("handover")
    flown.load()
    flown.until(lambda: flown.companion.view.commander == 251)
    flown.run(2.0)
    assert flown.companion.autopilot.mission.flown.changed is changed
    assert (flown.companion.autopilot.command_check.ahead is None) is changed


# ---- the geofence ----------------------------------------------------------------------------------------------------


def test_the_geofence_that_is_held_is_taken_again_and_not_written(flown: Bench, delivery: MissionPackage) -> None:
    assert Program(flown, fence_items(delivery.route.fence), kind=1).send() == ACCEPTED
    assert flown.autopilot.got("MISSION_COUNT") == []


def test_another_geofence_is_denied_in_flight(flown: Bench, delivery: MissionPackage) -> None:
    items = fence_items(delivery.route.fence)
    before = list(flown.autopilot.items[1])
    for other in ((replace(items[0], lat_deg=52.7), *items[1:]), items[:3], ()):
        assert Program(flown, other, kind=1).send() == DENIED
        flown.wait(3.0)
    assert flown.autopilot.items[1] == before
    assert "it cannot be changed in flight" in flown.a.texts()


def test_a_whole_plan_is_taken_list_by_list(flown: Bench, delivery: MissionPackage) -> None:
    """As QGroundControl sends it: mission, fence, rally points."""
    assert Program(flown, INSIDE).send() == ACCEPTED
    assert Program(flown, fence_items(delivery.route.fence), kind=1).send() == ACCEPTED


def test_on_the_ground_uploads_go_to_the_autopilot_as_ever(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    bench.share(delivery)
    bench.run(1.0)
    bench.a.send(mavlink.MAVLink_mission_count_message(*VEHICLE, 3, 0))
    bench.run(0.3)
    assert len(bench.autopilot.got("MISSION_COUNT", 251)) == 1
    assert bench.companion.arbiter.mission_digest == b""
