# SPDX-License-Identifier: GPL-3.0-or-later

"""A station that lost its mission package in flight gets it back from the vehicle, slowly, and one at a time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Reason
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage, from_bytes
from mavproxy_handover.operator.uploads.package_return import PackageReturn
from mavproxy_handover.wire.package_transfer import PackageReceiver
from mavproxy_handover.wire.vehicle_address import parse_address
from tests.packages import ROUND

A, B = 251, 252
REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED
VEHICLE = (1, 191)


@pytest.fixture(scope="module")
def package() -> MissionPackage:
    return mission_package.load(ROUND)


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mavproxy_handover.tools.worker.in_thread", lambda run: run())


class Port:
    """A station as the vehicle sees it, and its receiver."""

    def __init__(self, sysid: int) -> None:
        self.sysid, self.name, self.target = sysid, f"GCS{'AB'[sysid - A]}", (sysid, 190)
        self.receiver = PackageReceiver()
        self.inbox: list[Any] = []
        #: what it was sent: kind
        self.got: list[str] = []
        #: the addresses in the last offer
        self.addresses = b""
        self.data = b""

    def send(self, message: Any) -> None:
        self.got.append(message.get_type())
        self.inbox.append(message)

    def step(self) -> list[Any]:
        """Its answers to what has come."""
        waiting, self.inbox = self.inbox, []
        answers: list[Any] = []
        for message in waiting:
            if message.get_type() == "MISSION_PACKAGE":
                self.addresses = bytes(message.addresses)
                answers += self.receiver.on_offer(message, VEHICLE)
                continue
            more, whole = self.receiver.on_chunk(message, VEHICLE)
            answers += more
            if whole is not None:
                self.data = whole[1]
                answers.append(self.receiver.conclude(whole[0], mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED, "", VEHICLE))
        return answers


class Told:
    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []

    def package_returned(self, station: str, what: str) -> None:
        self.lines.append((station, what))


class Bench:
    def __init__(self, package: MissionPackage) -> None:
        self.package: MissionPackage | None = package
        self.ports = {A: Port(A), B: Port(B)}
        self.why: dict[int, Reason | None] = {A: None, B: Reason.MISSION_MISSING}
        self.told = Told()
        self.flying = True
        self.deaf: set[int] = set()
        self.now = 100.0
        self.made = PackageReturn(self.ports, lambda sysid, _now: self.why[sysid], self.told)  # type: ignore[arg-type]

    def run(self, duration_s: float) -> None:
        until = self.now + duration_s
        while self.now < until:
            self.now += 0.25
            self.made.tick(self.package, self.flying, self.now)
            for port in self.ports.values():
                for answer in port.step() if port.sysid not in self.deaf else ():
                    self.made.on_ack(port, answer, self.now)  # type: ignore[arg-type]
                if port.data and self.package is not None and from_bytes(port.data).digest == self.package.digest:
                    self.why[port.sysid] = None


def test_it_gets_the_package_whole(package: MissionPackage) -> None:
    bench = Bench(package)
    bench.run(60.0)
    assert from_bytes(bench.ports[B].data).digest == package.digest
    assert bench.ports[A].got == []
    assert bench.told.lines == [("GCSB", "sent"), ("GCSB", "the station has it")]


def test_it_gets_its_own_addresses_of_the_vehicle_with_it(package: MissionPackage) -> None:
    addresses = {A: (parse_address("udpout:10.0.0.2:1"),), B: (parse_address("udpout:10.0.0.2:14552"),)}
    bench = Bench(replace(package, addresses=addresses))
    bench.run(5.0)
    assert bench.ports[B].addresses == bytes.fromhex("fc0138d80a000002") + bytes(168)


def test_no_more_than_eight_chunks_in_a_second(package: MissionPackage) -> None:
    bench = Bench(package)
    for _ in range(20):
        before = bench.ports[B].got.count("MISSION_CHUNK")
        bench.run(1.0)
        assert bench.ports[B].got.count("MISSION_CHUNK") - before <= 8


@pytest.mark.parametrize("why", [None, Reason.MISSION_DIFFERS, Reason.PARTNER_SILENT, Reason.VERSION_DIFFERS])
def test_only_a_station_without_a_mission_is_sent_one(package: MissionPackage, why: Reason | None) -> None:
    bench = Bench(package)
    bench.why[B] = why
    bench.run(20.0)
    assert bench.ports[B].got == []


def test_on_the_ground_nothing_is_sent(package: MissionPackage) -> None:
    bench = Bench(package)
    bench.flying = False
    bench.run(20.0)
    assert bench.ports[B].got == []


def test_without_a_package_nothing_is_sent(package: MissionPackage) -> None:
    bench = Bench(package)
    bench.package = None
    bench.run(20.0)
    assert bench.ports[B].got == []


@pytest.mark.slow
def test_one_after_the_other(package: MissionPackage) -> None:
    bench = Bench(package)
    bench.why[A] = Reason.MISSION_MISSING
    bench.run(120.0)
    assert [line for line in bench.told.lines if line[1] != "sent"] == [
        ("GCSA", "the station has it"),
        ("GCSB", "the station has it"),
    ]


def test_one_that_does_not_answer_keeps_the_next_waiting_for_fifteen_seconds(package: MissionPackage) -> None:
    bench = Bench(package)
    bench.why[A] = Reason.MISSION_MISSING
    bench.deaf = {A}
    bench.run(14.0)
    assert bench.ports[B].got == []
    bench.run(60.0)
    assert bench.told.lines[:3] == [("GCSA", "sent"), ("GCSA", "no answer"), ("GCSB", "sent")]
    assert ("GCSB", "the station has it") in bench.told.lines


def test_one_that_refuses_is_left_alone_for_a_minute(package: MissionPackage) -> None:
    bench = Bench(package)
    port = bench.ports[B]
    bench.deaf = {B}
    bench.run(1.0)
    bench.made.on_ack(port, port.receiver.refuse(package.digest, "no room", VEHICLE), bench.now)  # type: ignore[arg-type]
    bench.run(58.0)
    assert bench.told.lines == [("GCSB", "sent"), ("GCSB", "refused: no room")]
    bench.run(3.0)
    assert bench.told.lines[2:] == [("GCSB", "sent")]


def test_an_answer_of_another_station_changes_nothing(package: MissionPackage) -> None:
    bench = Bench(package)
    bench.deaf = {B}
    bench.run(1.0)
    stranger = bench.ports[A]
    bench.made.on_ack(stranger, stranger.receiver.refuse(package.digest, "", VEHICLE), bench.now)  # type: ignore[arg-type]
    assert bench.told.lines == [("GCSB", "sent")]
