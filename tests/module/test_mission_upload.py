# SPDX-License-Identifier: GPL-3.0-or-later

"""A mission package on its way into the autopilot: written, read back, compared; and what stands in its way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.uploads import package_reader
from mavproxy_handover.tools.worker import LONGEST_S
from mavproxy_handover.wire.package_transfer import PackageSender
from tests.module.conftest import Bench
from tests.module.test_faults import leases_in
from tests.packages import MISSIONS, ROUND

LOADED, REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_LOADED, mavlink.HANDOVER_PACKAGE_RESULT_REFUSED
START = mavlink.MAV_CMD_MISSION_START


def places(items: list[Any]) -> list[tuple[int, int, int, float]]:
    return [(item.command, item.x, item.y, item.z) for item in items]


def test_the_autopilot_holds_the_mission_of_the_package_and_one_place_to_return_to(
    bench: Bench, delivery: MissionPackage
) -> None:
    bench.connect()
    assert bench.share(delivery).result == LOADED
    mission = places(bench.autopilot.items[0])
    assert len(mission) == 12
    assert mission[0] == (16, 526790000, 59240000, 0.0), "item 0 is home"
    assert mission[1] == (22, 526790000, 59240000, 30.0)
    assert mission[2] == (16, 526781460, 59250350, 40.0)
    assert places(bench.autopilot.items[2]) == [(5100, 526790000, 59240000, 0.0)], "home, where it stands"
    corners = [(526760350, 59197120), (526760350, 59353840), (526832240, 59353850), (526832240, 59197120)]
    fence = [(item.command, item.param1, item.x, item.y) for item in bench.autopilot.items[1]]
    assert fence == [(5001, 4.0, x, y) for x, y in corners]
    assert bench.companion.arbiter.mission_digest == delivery.digest
    (written,) = bench.journal("mission_written")
    assert written["text"] == "mission, return site and geofence written, read back, equal"
    assert [entry["event"] for entry in bench.journal() if "mission" in entry["event"]] == [
        "mission_written",
        "mission_loaded",
    ]
    (loaded,) = bench.journal("mission_loaded")
    assert loaded["text"] == "mission loaded, commanders along the route: GCSA GCSB GCSA GCSB GCSA"


def test_the_mission_s_cruise_speed_is_the_autopilot_s(bench: Bench, delivery: MissionPackage) -> None:
    bench.autopilot.parameters["WPNAV_SPEED"] = 300.0
    bench.connect()
    assert bench.share(delivery).result == LOADED
    assert bench.autopilot.parameters["WPNAV_SPEED"] == 1000.0
    assert bench.journal("mission_written")[0]["cruise_mps"] == 10.0


@pytest.mark.parametrize(
    ("held", "written"),
    [
        ({"WPNAV_SPEED": 300.0, "RTL_SPEED": 0.0}, {"WPNAV_SPEED": 1000.0, "RTL_SPEED": 1000.0}),
        ({"WPNAV_SPEED": 1000.0, "RTL_SPEED": 100.0}, {"WPNAV_SPEED": 1000.0, "RTL_SPEED": 1000.0}),
        ({"WP_SPD": 3.0, "RTL_SPEED_MS": 2.0}, {"WP_SPD": 10.0, "RTL_SPEED_MS": 10.0}),
    ],
    ids=["up to 4.6", "one that is set", "from 4.7 on"],
)
def test_the_speed_of_a_return_is_written_with_the_mission(
    bench: Bench, delivery: MissionPackage, held: dict[str, float], written: dict[str, float]
) -> None:
    """The fault: RTL_SPEED 0 stayed, so a return was flown at whatever WPNAV_SPEED said by then."""
    bench.autopilot.parameters = dict(held)
    bench.connect()
    assert bench.share(delivery).result == LOADED
    assert bench.autopilot.parameters == written


def test_a_speed_of_a_return_that_the_autopilot_does_not_take_refuses_the_mission(
    bench: Bench, delivery: MissionPackage
) -> None:
    bench.autopilot.fixed.add("RTL_SPEED")
    bench.connect()
    sender = bench.share(delivery)
    text = "the autopilot does not take RTL_SPEED 1000, the speed of a return"
    assert (sender.result, sender.text) == (REFUSED, text[:50])


def test_a_fence_that_the_autopilot_refuses_is_a_mission_that_is_not_loaded(
    bench: Bench, delivery: MissionPackage
) -> None:
    bench.connect()
    bench.autopilot.results[1] = mavlink.MAV_MISSION_ERROR
    sender = bench.share(delivery)
    assert (sender.result, sender.text) == (REFUSED, "the autopilot refused the geofence: MAV_MISSION_ERROR"[:50])
    assert bench.companion.arbiter.mission_digest == b""


def test_a_plan_without_fence_and_speed_leaves_the_vehicle_its_own_and_says_so(bench: Bench) -> None:
    """`linear` has no geofence; its speed is taken out here."""
    linear = mission_package.load(MISSIONS / "linear")
    files = {name: text.decode() for name, text in linear.files.items()}
    files["mission.toml"] = files["mission.toml"].replace("cruise_speed_mps = 10.0", "")
    files["linear.plan"] = files["linear.plan"].replace('"hoverSpeed": 10,', "")
    silent = replace(linear, files={name: text.encode() for name, text in files.items()})
    package = mission_package.from_bytes(silent.to_bytes())
    assert not package.cruise_speed_named
    bench.connect()
    assert bench.share(mission_package.load(ROUND)).result == LOADED
    bench.autopilot.parameters["WPNAV_SPEED"] = 400.0
    assert bench.share(package).result == LOADED
    assert len(bench.autopilot.items[1]) == 4
    assert bench.autopilot.parameters["WPNAV_SPEED"] == 400.0
    (fence,) = bench.journal("own_fence")
    assert fence["text"] == "the plan has no geofence: the autopilot keeps the one that it has (1 areas)"
    (speed,) = bench.journal("own_speed")
    assert speed["text"] == "the plan names no cruise speed: flown at 4 m/s, checked at 10"
    assert bench.mpstate.console.said("The plan has no geofence: the autopilot keeps the one")


def test_an_item_that_comes_back_changed_refuses_the_mission(bench: Bench, delivery: MissionPackage) -> None:
    def spoil(item: Any) -> Any:
        if item.mission_type == 0 and item.seq == 5:
            item.x += 1000
        return item

    bench.connect()
    bench.autopilot.spoil = spoil
    sender = bench.share(delivery)
    assert sender.result == REFUSED
    assert sender.text.startswith("item 5: latitude 52.67")
    assert " came back as " in sender.text
    assert bench.companion.arbiter.mission_digest == b""
    assert [entry["event"] for entry in bench.journal() if entry["event"].startswith("mission_")] == ["mission_failed"]
    assert bench.mpstate.console.said("mission not loaded: item 5: latitude")


def test_a_rally_point_that_comes_back_elsewhere_refuses_the_mission(bench: Bench, delivery: MissionPackage) -> None:
    def spoil(item: Any) -> Any:
        if item.mission_type == 2:
            item.y = 59240300
        return item

    bench.connect()
    bench.autopilot.spoil = spoil
    sender = bench.share(delivery)
    assert (sender.result, sender.text) == (REFUSED, "rally point 0 came back at 52.6790000 5.9240300")


def test_a_mission_that_the_autopilot_refuses_is_refused_to_the_station(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    bench.autopilot.results[0] = mavlink.MAV_MISSION_NO_SPACE
    sender = bench.share(delivery)
    assert sender.result == REFUSED
    assert sender.text == "the autopilot refused the mission: MAV_MISSION_NO_"[:50]


def test_an_autopilot_that_falls_silent_ends_the_upload_and_it_can_be_tried_again(
    bench: Bench, delivery: MissionPackage
) -> None:
    bench.connect()
    bench.autopilot._take = lambda message: None  # type: ignore[method-assign]
    sender = bench.share(delivery)
    assert (sender.result, sender.text) == (REFUSED, "no answer to MISSION_COUNT")
    del bench.autopilot._take
    bench.run(2.0)
    assert bench.share(delivery).result == LOADED


def test_while_a_second_mission_is_written_the_first_is_no_longer_there(bench: Bench, delivery: MissionPackage) -> None:
    """From its first item on, the autopilot holds neither: a START in between would fly nobody's mission."""
    bench.connect()
    bench.share(delivery)
    bench.autopilot.spoil = lambda item: setattr(item, "command", 17) or item if item.seq == 3 else item
    assert bench.share(mission_package.load(MISSIONS / "linear")).result == REFUSED
    assert bench.companion.arbiter.mission_digest == b""
    bench.a.command(START)
    bench.run(0.5)
    assert bench.a.acks(START) == [mavlink.MAV_RESULT_TEMPORARILY_REJECTED]
    assert bench.autopilot.commands() == []
    assert "no mission loaded" in bench.a.texts()


def test_only_the_commander_may_load_a_mission(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    sender = bench.share(delivery, bench.b)
    assert (sender.result, sender.text) == (REFUSED, "only from the commander, on the ground, disarmed")
    assert bench.autopilot.got("MISSION_COUNT") == []


def test_an_armed_aircraft_takes_no_mission(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    bench.autopilot.armed = True
    bench.run(1.5)
    assert bench.share(delivery).result == REFUSED
    assert bench.autopilot.got("MISSION_COUNT") == []


def test_an_aircraft_that_is_armed_in_the_middle_of_a_package_takes_no_more_of_it(
    bench: Bench, delivery: MissionPackage
) -> None:
    bench.connect()
    sender = PackageSender(delivery.to_bytes(), delivery.digest, delivery.name, (1, 191))
    bench.a.send(sender.tick(bench.clock.now)[0])
    bench.run(0.2)
    bench.autopilot.armed = True
    bench.run(1.5)
    (ack,) = bench.a.got("MISSION_PACKAGE_ACK")
    for chunk in sender.on_ack(ack, bench.clock.now):
        bench.a.send(chunk)
    bench.run(1.0)
    assert bench.journal("package_received") == []
    assert bench.autopilot.got("MISSION_COUNT") == []


def test_a_package_of_another_parent_is_refused(bench: Bench, delivery: MissionPackage) -> None:
    bench.config.write_text(bench.config.read_text().replace('parent = "GCSA"', 'parent = "GCSB"'))
    bench.load()
    bench.until(lambda: bench.companion.view.commander == 252)
    sender = bench.share(delivery, bench.b)
    assert (sender.result, sender.text) == (REFUSED, "parent GCSA is not this vehicle's")


def test_a_package_with_strange_stations_is_refused(bench: Bench, delivery: MissionPackage) -> None:
    bench.config.write_text(bench.config.read_text().replace('"GCSB"', '"OTHER"'))
    bench.connect()
    sender = bench.share(delivery)
    assert (sender.result, sender.text) == (REFUSED, "station GCSB (252) is not one of this vehicle's")


def test_a_package_under_a_false_digest_is_refused(bench: Bench, delivery: MissionPackage) -> None:
    bench.connect()
    sender = bench.share(replace(delivery, digest=bytes(range(32))))
    assert sender.result == REFUSED
    assert sender.text == "the contents do not have the digest that was promi"


def test_a_package_of_garbage_is_refused_and_costs_no_lease(bench: Bench, delivery: MissionPackage) -> None:
    class Garbage:
        digest, name = bytes(range(32)), "garbage"
        addresses: ClassVar[dict[int, tuple[str, ...]]] = {}

        @staticmethod
        def to_bytes() -> bytes:
            return bytes(range(256)) * 3

    bench.connect()
    before = len(bench.autopilot.leases())
    assert bench.share(Garbage()).result == REFUSED  # type: ignore[arg-type]
    assert bench.companion.faults == {}
    bench.run(1.0)
    assert len(bench.autopilot.leases()) >= before + 4


def test_the_last_word_of_a_loaded_mission_is_said_again_even_in_flight(bench: Bench, delivery: MissionPackage) -> None:
    """A station that missed LOADED asks again; by then the aircraft may have been started."""
    bench.connect()
    bench.share(delivery)
    bench.autopilot.armed = bench.autopilot.airborne = True
    bench.run(1.5)
    assert bench.share(delivery).result == LOADED


def test_answers_that_the_autopilot_gives_to_others_do_not_disturb_the_upload(
    bench: Bench, delivery: MissionPackage
) -> None:
    bench.connect()
    sender = PackageSender(delivery.to_bytes(), delivery.digest, delivery.name, (1, 191), until_loaded=True)
    original = bench.autopilot._take

    def take(message: Any) -> None:
        if message.get_type().startswith("MISSION_"):
            for stranger in ((252, 191), (1, 100)):  # a station, and a camera of the vehicle
                bench.autopilot.say(mavlink.MAVLink_mission_ack_message(*stranger, mavlink.MAV_MISSION_DENIED, 0))
                bench.autopilot.say(mavlink.MAVLink_mission_count_message(*stranger, 3, 0))
        original(message)

    bench.autopilot._take = take  # type: ignore[method-assign]
    assert bench.share(delivery).result == LOADED
    assert sender.result is None


# ---- what takes time is done beside the main loop -----------------------------------------------------------------


class Slow:
    """Jobs that end when the test says so."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.jobs: list[Callable[[], None]] = []
        monkeypatch.setattr("mavproxy_handover.tools.worker.in_thread", self.jobs.append)

    def end(self) -> None:
        self.jobs.pop()()


def send(bench: Bench, package: MissionPackage) -> PackageSender:
    """A package goes to the vehicle in the bench's own time; what comes of it is for the test to see."""
    sender = PackageSender(package.to_bytes(), package.digest, package.name, (1, 191), until_loaded=True)
    seen = len(bench.a.received)

    def step() -> None:
        nonlocal seen
        for message in sender.tick(bench.clock.now):
            bench.a.send(message)
        while seen < len(bench.a.received):
            message = bench.a.received[seen]
            seen += 1
            if message.get_type() == "MISSION_PACKAGE_ACK":
                for answer in sender.on_ack(message, bench.clock.now):
                    bench.a.send(answer)

    bench.each_round = step
    return sender


def test_leases_go_on_while_a_package_is_read_and_its_route_walked(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A zone like a comb took 3.8 s; the guard flies home after three."""
    slow = Slow(monkeypatch)
    bench.connect()
    sender = send(bench, delivery)
    bench.until(lambda: slow.jobs)
    assert 24 <= leases_in(bench, 5.0) <= 26
    assert bench.companion.arbiter.mission_digest == b""
    assert not sender.finished
    slow.end()
    bench.until(lambda: sender.finished)
    assert sender.result == LOADED
    assert bench.companion.arbiter.mission_digest == delivery.digest


def test_a_package_that_is_read_when_its_sender_commands_no_more_is_not_loaded(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = Slow(monkeypatch)
    bench.connect()
    sender = send(bench, delivery)
    bench.until(lambda: slow.jobs)
    bench.companion.fail_closed("planted", bench.clock.now)
    slow.end()
    bench.until(lambda: sender.finished)
    assert (sender.result, sender.text) == (REFUSED, "too late: it has no authority, or START was given"[:50])
    assert bench.autopilot.items.get(0, []) == []


def test_a_second_package_is_not_taken_while_one_is_being_read(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = Slow(monkeypatch)
    bench.connect()
    send(bench, delivery)
    bench.until(lambda: slow.jobs)
    other = send(bench, mission_package.load(MISSIONS / "linear"))
    bench.until(lambda: other.finished)
    assert (other.result, other.text) == (REFUSED, "another package is being read: share it again"[:50])


def test_a_package_that_takes_for_ever_is_refused_and_keeps_no_other_one_out(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = Slow(monkeypatch)
    bench.connect()
    endless = send(bench, mission_package.load(MISSIONS / "linear"))
    bench.until(lambda: slow.jobs)
    bench.until(lambda: endless.finished, limit_s=LONGEST_S + 1.0)
    assert (endless.result, endless.text) == (REFUSED, "not done within 30 s")
    sender = send(bench, delivery)
    bench.until(lambda: len(slow.jobs) == 2)
    slow.end()
    bench.until(lambda: sender.finished)
    assert sender.result == LOADED
    slow.end()  # the first one, after all
    bench.run(1.0)
    assert bench.companion.arbiter.mission_digest == delivery.digest
    assert bench.companion.faults == {}


def test_a_fault_while_a_package_is_read_is_an_internal_fault_and_refuses_it(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(package_reader, "prepare", lambda _package: 1 / 0)
    bench.connect()
    sender = bench.share(delivery)
    assert (sender.result, sender.text) == (REFUSED, "internal fault")
    assert bench.companion.faults == {"mission package": 1}
