# SPDX-License-Identifier: GPL-3.0-or-later

"""A station without a link to the vehicle, in MAVProxy: from another station's mission to a link that is open.

The bench's station is GCSA here, and GCSB sends; who is parent does not matter for it.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import commands as station_commands
from gcs_module import module as gcs_module
from mavproxy_handover.wire.vehicle_address import WAITING_LABEL, WAITING_LINK, pack_addresses, parse_address
from tests.module.conftest import Clock
from tests.module.proxy import LinkModule, Master
from tests.module.test_station_module import StationBench, heartbeat
from tests.packages import ROUND

WIFI = "udpout:10.0.0.2:14551"
ASKED = "GCSB sends the vehicle's address udpout:10.0.0.2:14551. This station has no link to the vehicle."


class Bench(StationBench):
    """`link`: MAVProxy's module."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        super().__init__(folder, clock)
        self.configure(mission=None)
        self.mpstate.mav_master[:] = [Master(WAITING_LABEL, "127.0.0.1:0")]
        self.link = LinkModule(self.mpstate)
        self.mpstate.public_modules["link"] = self.link

    def offer(self, *addresses: str, digest: bytes = bytes(range(32)), sysid: int = 252, vehicle: int = 1) -> None:
        """GCSB offers a mission."""
        packed = pack_addresses({251: tuple(map(parse_address, addresses))}).ljust(176, b"\0")
        message = mavlink.MAVLink_mission_package_message(251, 0, 400, list(digest), b"delivery", vehicle, list(packed))
        self.peer.own.srcSystem = sysid
        self.peer.socket.sendto(message.pack(self.peer.own), ("127.0.0.1", self.listens))

    def said(self, part: str) -> bool:
        return self.mpstate.console.said(part)

    def addresses(self) -> list[str]:
        return [master.address for master in self.mpstate.mav_master]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, clock: Clock, tmp_path: Path) -> Iterator[Bench]:
    monkeypatch.setattr(gcs_module, "time", clock)
    monkeypatch.setattr(station_commands, "time", clock)
    bench = Bench(tmp_path, clock)
    bench.load()
    bench.run(2.0)
    yield bench
    bench.close()
    assert bench.mpstate.escaped == []


def test_from_the_mission_to_the_open_link_and_back(bench: Bench) -> None:
    assert bench.said("This station has no link to the vehicle. It waits until another station shares a mission")
    bench.offer(WIFI)
    bench.run(2.0)
    assert bench.said(ASKED)
    assert bench.said("Without a key any program there can pose as the vehicle.")
    assert bench.mpstate.type("handover status").count(
        f"address   {WIFI} from GCSB with mission 'delivery': 'handover connect 1' opens it"
    )
    assert bench.addresses() == ["127.0.0.1:0"]
    (line,) = bench.mpstate.type("handover connect 1")
    assert line.endswith(f"Connecting to the vehicle at {WIFI}, the address from GCSB.")
    bench.run(3.0)
    assert bench.said(f"Link to the vehicle opened: {WIFI}.")
    assert (bench.addresses(), bench.link.added) == (["10.0.0.2:14551"], [WIFI])
    assert [entry["text"] for entry in bench.journal("address")][-1] == f"Link to the vehicle opened: {WIFI}."
    bench.hear(heartbeat(armed=True), autopilot=True)
    assert bench.mpstate.type("handover disconnect")[-1].endswith(
        "Not while the vehicle is armed. Type 'handover disconnect' after it has disarmed, or after 60 s of silence."
    )
    bench.hear(heartbeat(armed=False), autopilot=True)
    bench.mpstate.type("handover disconnect")
    assert bench.addresses() == ["127.0.0.1:0"]


def test_a_vehicle_that_said_armed_and_fell_silent_keeps_no_link_for_ever(bench: Bench) -> None:
    """Its battery was pulled, or another program at that address sent one heartbeat."""
    bench.offer(WIFI)
    bench.run(2.0)
    bench.mpstate.type("handover connect 1")
    bench.run(3.0)
    bench.hear(heartbeat(armed=True), autopilot=True)
    bench.run(55.0)
    assert bench.mpstate.type("handover disconnect")[-1].endswith(
        "Not while the vehicle is armed. Type 'handover disconnect' after it has disarmed, or after 60 s of silence."
    )
    bench.offer("udpout:10.0.0.9:14551")
    bench.run(0.5)
    assert bench.mpstate.type("handover connect")[-1].endswith("shows them when the vehicle is disarmed or silent")
    bench.run(10.0)
    assert bench.said("This station uses udpout:10.0.0.2:14551, from GCSB. Without a key")
    bench.mpstate.type("handover connect 2")
    bench.run(3.0)
    assert bench.addresses() == ["10.0.0.9:14551"]
    bench.mpstate.type("handover disconnect")
    assert bench.addresses() == ["127.0.0.1:0"]


def test_while_the_companion_is_heard_the_vehicle_stays_armed(bench: Bench) -> None:
    """The autopilot's heartbeats may be lost, or MAVProxy may show another vehicle's."""
    bench.offer(WIFI)
    bench.run(2.0)
    bench.mpstate.type("handover connect 1")
    bench.run(3.0)
    bench.hear(heartbeat(armed=True), autopilot=True)
    bench.run(50.0)
    bench.hear(heartbeat(armed=True))
    bench.run(50.0)
    assert "Not while the vehicle is armed." in bench.mpstate.type("handover disconnect")[-1]


def test_a_link_that_the_operator_has_removed_is_not_called_in_use(bench: Bench) -> None:
    bench.offer(WIFI)
    bench.run(2.0)
    bench.mpstate.type("handover connect 1")
    bench.run(3.0)
    bench.mpstate.mav_master.append(Master(None, "0.0.0.0:14550"))
    bench.link.cmd_link_remove(["0"])
    (line,) = [line for line in bench.mpstate.type("handover connect") if line.startswith("address")]
    assert "; not in use: its link was removed ('handover disconnect' withdraws it)" in line
    bench.run(30.0)
    assert bench.addresses() == ["0.0.0.0:14550"]


def test_after_a_restart_the_link_is_there_again(bench: Bench) -> None:
    bench.offer(WIFI)
    bench.run(2.0)
    bench.mpstate.type("handover connect 1")
    bench.run(3.0)
    bench.mpstate.unload("handover_gcs")
    assert (bench.addresses(), bench.link.added[-1]) == (["127.0.0.1:0"], WAITING_LINK)
    bench.load()
    bench.run(3.0)
    assert bench.addresses() == ["10.0.0.2:14551"]
    (line,) = [line for line in bench.mpstate.type("handover connect") if line.startswith("address")]
    assert line.startswith(f"address   {WIFI} from GCSB with mission 'delivery', confirmed ")


def test_a_new_link_is_signed_before_anything_is_sent_by_it(bench: Bench) -> None:
    """The companion refuses what is not signed, and tells the operator of it."""
    order: list[str] = []
    aircraft = bench.module.aircraft[0]
    aircraft.addresses.tick = lambda *_now: order.append("link") or []
    aircraft.connection.refresh = lambda: order.append("signed")
    bench.run(1.1)
    assert order == ["link", "signed"]


def test_without_an_address_the_list_is_empty(bench: Bench) -> None:
    assert bench.mpstate.type("handover connect") == ["address   no station has sent an address of the vehicle"]
    assert bench.mpstate.type("handover disconnect")[-1].endswith(
        "This station uses no address of the vehicle that another station sent."
    )


def test_a_program_that_is_no_station_of_the_configuration_is_not_heard(bench: Bench) -> None:
    bench.offer(WIFI, sysid=99)
    bench.run(2.0)
    assert not bench.said("sends the vehicle's address")
    assert bench.mpstate.type("handover connect 1")[-1].find("No question 1.") >= 0


def test_an_address_of_another_vehicle_is_not_this_ones(bench: Bench) -> None:
    bench.offer(WIFI, vehicle=9)
    bench.run(2.0)
    assert not bench.said("sends the vehicle's address")


def test_while_the_vehicle_is_heard_and_armed_nothing_is_asked(bench: Bench) -> None:
    bench.hear(heartbeat(armed=True), autopilot=True)
    bench.offer(WIFI)
    bench.run(60.0)
    assert not bench.said("sends the vehicle's address")
    bench.hear(heartbeat(armed=False), autopilot=True)
    bench.run(2.0)
    assert bench.said(ASKED)


def test_a_flood_of_offers_is_two_lines_in_a_minute_and_no_link(bench: Bench) -> None:
    for number in range(600):
        bench.offer(f"udpout:10.0.{number // 200}.{number % 200 + 1}:14551", digest=bytes([number % 256]) * 32)
        bench.run(0.1)
    lines = [line for line in bench.mpstate.console.lines if "sends the vehicle's address" in line]
    assert len(lines) == 2
    assert bench.link.added == []


def test_a_station_with_a_mission_and_a_link_of_its_own_keeps_both(bench: Bench) -> None:
    """The refusal of the mission keeps nothing from being told."""
    bench.mpstate.unload("handover_gcs")
    bench.mpstate.mav_master[:] = [Master(None, "0.0.0.0:14550")]
    bench.configure(mission=ROUND)
    bench.load()
    bench.offer(WIFI)
    bench.run(2.0)
    assert bench.said(f"GCSB sends the vehicle's address {WIFI}. This station keeps its own link: 0.0.0.0:14550.")
    assert bench.addresses() == ["0.0.0.0:14550"]


def test_a_mission_that_the_vehicle_sends_back_may_carry_its_address_and_no_other_mission(bench: Bench) -> None:
    packed = list(pack_addresses({251: (parse_address(WIFI),)}).ljust(176, b"\0"))
    offer = mavlink.MAVLink_mission_package_message(251, 190, 400, [7] * 32, b"delivery", 0, packed)
    bench.hear(offer)
    bench.run(2.0)
    assert not bench.said("The vehicle sends its address")
    connect: Any = mavlink.MAVLink_connect_message(251, 190, 1, 251, 1, 7, 1, 251, b"drone-1", [7] * 32)
    bench.hear(connect)
    bench.hear(offer)
    bench.run(2.0)
    assert bench.said(f"The vehicle sends its address {WIFI}. This station has no link to the vehicle.")


def test_a_station_starts_with_a_mission_whose_addresses_are_damaged(bench: Bench, tmp_path: Path) -> None:
    """The fault: a station that was restarted in flight did not start."""
    folder = Path(shutil.copytree(ROUND, tmp_path / "mission"))
    (folder / "addresses.toml").write_text("x =")
    bench.mpstate.unload("handover_gcs")
    bench.configure(mission=folder)
    bench.load()
    words = f"{folder}/addresses.toml: not TOML: "
    assert bench.said(words)
    assert bench.said("The mission is used without addresses of the vehicle. Put the file right, or remove it.")
    assert "The mission is used without addresses" in bench.mpstate.type("handover share")[-1]
