# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover share`: an offer has an end, and is made again when its receiver is heard."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import commands as station_commands
from gcs_module import module as station_module
from gcs_module.mission_transfer import NO_ANSWER_S, MissionTransfer
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire.package_transfer import PackageReceiver
from mavproxy_handover.wire.vehicle_address import parse_address
from tests.module.conftest import Clock
from tests.module.test_station_module import StationBench, connect_message, receive
from tests.packages import MISSIONS, ROUND

VEHICLE, PEER = 1, 252
RECEIVED, LOADED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED, mavlink.HANDOVER_PACKAGE_RESULT_LOADED
NOT_HEARD = "Mission 'delivery' not shared: not heard. It will be offered when it is."
NO_ANSWER = "Mission 'delivery' not shared: no answer. 'handover share' tries again."
AGAIN = "Heard again: offering mission 'delivery'."


@pytest.fixture(scope="module")
def delivery() -> MissionPackage:
    return mission_package.load(ROUND)


@pytest.fixture(scope="module")
def linear() -> MissionPackage:
    return mission_package.load(MISSIONS / "linear")


class Run:
    """A transfer that shares a package with GCSB, in time that the test moves."""

    def __init__(self, package: MissionPackage) -> None:
        self.transfer = MissionTransfer(package)
        self.package = package
        self.now = 100.0
        self.alive: set[int] = set()
        self.lines: list[str] = []
        self.transfer.offer(PEER, 0, self.now)

    def run(self, seconds: float) -> int:
        """How many offers were made."""
        offers = 0
        for _ in range(round(seconds / 0.1)):
            self.now = round(self.now + 0.1, 3)
            messages, lines = self.transfer.tick(self.now, self.alive.__contains__)
            offers += sum(message.get_type() == "MISSION_PACKAGE" for _receiver, message in messages)
            self.lines += [line for _receiver, line in lines]
        return offers

    def hear(self, result: int, *, offset: int = 0, digest: bytes | None = None, text: str = "") -> str:
        """An answer of GCSB; the line for the operator."""
        short = int.from_bytes((digest or self.package.digest)[:4], "little")
        ack = mavlink.MAVLink_mission_package_ack_message(251, 190, short, offset, result, text.encode())
        return self.transfer.on_message(PEER, 0, ack, self.now)[1]


def test_fifteen_seconds_without_an_answer_are_enough() -> None:
    assert NO_ANSWER_S == 15.0


def test_nobody_there_ends_the_offer_and_is_told_once(delivery: MissionPackage) -> None:
    run = Run(delivery)
    assert run.run(14.8) == 30
    assert run.lines == []
    assert run.run(0.4) <= 1
    assert run.lines == [NOT_HEARD]
    assert run.run(600.0) == 0
    assert run.lines == [NOT_HEARD]


def test_who_is_heard_again_is_offered_it_again(delivery: MissionPackage) -> None:
    run = Run(delivery)
    run.run(60.0)
    run.alive.add(PEER)
    assert run.run(2.0) == 4
    assert run.lines == [NOT_HEARD, AGAIN]
    assert run.hear(RECEIVED) == "Mission received."
    assert run.run(60.0) == 0
    assert run.lines == [NOT_HEARD, AGAIN]


def test_who_is_there_and_does_not_answer_is_the_operators_to_ask(delivery: MissionPackage) -> None:
    run = Run(delivery)
    run.alive.add(PEER)
    assert 29 <= run.run(20.0) <= 31
    assert run.lines == [NO_ANSWER]
    assert run.run(60.0) == 0
    assert run.lines == [NO_ANSWER]
    run.transfer.offer(PEER, 0, run.now)
    assert run.run(1.0) == 2


def test_who_was_there_went_and_came_is_offered_it_again(delivery: MissionPackage) -> None:
    """It had just died when the offer ended; it took a few seconds to be missed."""
    run = Run(delivery)
    run.alive.add(PEER)
    run.run(20.0)
    run.alive.clear()
    assert run.run(5.0) == 0
    run.alive.add(PEER)
    assert run.run(1.0) == 2
    assert run.lines == [NO_ANSWER, AGAIN]


def test_a_share_in_flight_does_not_claim_that_anything_was_written(delivery: MissionPackage) -> None:
    run = Run(delivery)
    line = run.hear(LOADED, text="held already, nothing was written")
    assert line == "The vehicle has this mission: held already, nothing was written."


def test_each_time_it_is_heard_the_offer_ends_again(delivery: MissionPackage) -> None:
    run = Run(delivery)
    run.run(20.0)
    run.alive.add(PEER)
    assert 29 <= run.run(300.0) <= 31
    assert run.lines == [NOT_HEARD, AGAIN, NO_ANSWER]


def test_every_answer_starts_the_time_anew(delivery: MissionPackage) -> None:
    """A slow link, and a vehicle that takes its time to load the mission."""
    run = Run(delivery)
    for _ in range(10):
        run.run(14.0)
        assert run.hear(mavlink.HANDOVER_PACKAGE_RESULT_RECEIVING, offset=200) == ""
    assert run.lines == []
    assert run.run(14.0) > 0
    run.run(1.5)
    assert run.lines == [NOT_HEARD]


def test_answers_about_another_package_do_not(delivery: MissionPackage) -> None:
    run = Run(delivery)
    for _ in range(20):
        run.run(1.0)
        run.hear(mavlink.HANDOVER_PACKAGE_RESULT_RECEIVING, digest=bytes(32))
    assert run.lines == [NOT_HEARD]


def test_a_late_answer_takes_the_offer_up_again(delivery: MissionPackage) -> None:
    run = Run(delivery)
    run.run(20.0)
    run.hear(mavlink.HANDOVER_PACKAGE_RESULT_RECEIVING, offset=200)
    assert run.run(2.0) > 0
    assert run.hear(RECEIVED) == "Mission received."


def test_a_mission_that_another_has_replaced_is_not_offered_any_more(
    delivery: MissionPackage, linear: MissionPackage
) -> None:
    run = Run(delivery)
    run.run(20.0)
    run.transfer.inbox.held = linear
    run.alive.add(PEER)
    assert run.run(60.0) == 0
    assert run.lines == [NOT_HEARD]


def test_one_that_does_not_answer_takes_nothing_from_the_others(delivery: MissionPackage) -> None:
    run = Run(delivery)
    run.run(10.0)
    run.transfer.offer(VEHICLE, 191, run.now, until_loaded=True)
    run.run(10.0)
    assert run.lines == [NOT_HEARD]
    assert run.run(2.0) == 4, "the vehicle's has five seconds left"


# ---- the module ---------------------------------------------------------------------------------------------------


@pytest.fixture
def station(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[StationBench]:
    clock = Clock()
    monkeypatch.setattr(station_module, "time", clock)
    monkeypatch.setattr(station_commands, "time", clock)
    monkeypatch.setattr(station_module, "_last", {})
    bench = StationBench(tmp_path, clock)
    assert bench.load() is not None
    yield bench
    bench.close()
    assert bench.mpstate.escaped == []


def offers(messages: list[Any]) -> int:
    return sum(message.get_type() == "MISSION_PACKAGE" for message in messages)


def test_the_operator_is_told_of_each_that_is_absent(station: StationBench) -> None:
    station.mpstate.type("handover share")
    station.run(16.0)
    assert 25 <= offers(station.sent()) <= 31
    assert 25 <= offers(station.peer.received()) <= 31
    assert station.mpstate.console.said(f"vehicle: {NOT_HEARD}")
    assert station.mpstate.console.said(f"GCSB: {NOT_HEARD}")
    assert [entry["station"] for entry in station.journal("package_offer")] == ["vehicle", "GCSB"]
    station.run(60.0)
    assert (offers(station.sent()), offers(station.peer.received())) == (0, 0)


def test_a_peer_that_is_started_later_gets_it(station: StationBench, delivery: MissionPackage) -> None:
    station.mpstate.type("handover share")
    station.run(20.0)
    station.peer.received()
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(station.peer.own)
    receiver, got = PackageReceiver(), dict[str, bytes]()
    for number in range(60):
        if number % 20 == 0:
            station.peer.socket.sendto(beat, ("127.0.0.1", station.listens))
        station.run(0.05)
        for message in station.peer.received():
            for answer in receive(receiver, message, "peer", got):
                station.peer.socket.sendto(answer.pack(station.peer.own), ("127.0.0.1", station.listens))
    assert got == {"peer": delivery.to_bytes()}
    assert station.mpstate.console.said(f"GCSB: {AGAIN}")
    assert station.mpstate.console.said("GCSB: Mission received.")


def test_a_vehicle_that_is_started_later_is_offered_it(station: StationBench) -> None:
    station.mpstate.type("handover share")
    station.run(20.0)
    station.sent()
    station.hear(connect_message())
    station.run(1.0)
    assert offers(station.sent()) == 2
    assert station.mpstate.console.said(f"vehicle: {AGAIN}")


def test_each_station_is_sent_its_own_addresses_of_the_vehicle_and_the_vehicle_those_of_all(
    delivery: MissionPackage,
) -> None:
    addresses = {251: (parse_address("udpout:10.0.0.2:5760"),), PEER: (parse_address("udpout:10.0.0.2:14552"),)}
    transfer = MissionTransfer(replace(delivery, addresses=addresses))
    transfer.offer(PEER, 0, 100.0)
    transfer.offer(VEHICLE, 191, 100.0, until_loaded=True)
    messages, _lines = transfer.tick(100.0, lambda _receiver: True)
    sent = {receiver: bytes(message.addresses) for receiver, message in messages}
    own, all_of_them = bytes.fromhex("fc0138d80a000002"), bytes.fromhex("fb0116800a000002fc0138d80a000002")
    assert sent == {PEER: own + bytes(168), VEHICLE: all_of_them + bytes(160)}
