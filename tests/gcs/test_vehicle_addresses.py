# SPDX-License-Identifier: GPL-3.0-or-later

"""Addresses of the vehicle that another station sends: only the operator opens one, and a hostile sender gets nowhere.

GCSB (252) is this station; GCSA (251) and GCSC (253) send.
"""

from __future__ import annotations

import json
import random
import threading
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from gcs_module.vehicle_addresses import VehicleAddresses
from mavproxy_handover.wire.vehicle_address import VehicleAddress, pack_addresses

A, B, C, VEHICLE = 251, 252, 253, 1
WIFI = VehicleAddress("10.0.0.2", 14552)
LTE = VehicleAddress("100.64.3.7", 5762)
OTHER = VehicleAddress("10.0.0.9", 14552)
LOOPBACK = VehicleAddress("127.0.0.1", 14552)
ASKED = (
    "GCSA sends the vehicle's address udpout:10.0.0.2:14552. This station has no link to the vehicle. Check the "
    "address with the operator of GCSA. Then type 'handover connect 1', or 'handover connect no'."
)
WAITS = (
    "This station has no link to the vehicle. It waits until another station shares a mission with the vehicle's "
    "address."
)


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mavproxy_handover.tools.worker.in_thread", lambda run: run())


class FakeDoor:
    """MAVProxy's links."""

    def __init__(self, *own: str) -> None:
        self.own_links = own
        self.opened: list[VehicleAddress] = []
        self.closed = 0
        self.own_hosts: set[str] = set()
        self.own_ports: set[int] = set()
        self.fails = ""
        self.stays = ""

    def own(self) -> tuple[str, ...]:
        return self.own_links

    def is_open(self, address: VehicleAddress) -> bool:
        return address in self.opened

    def is_removed(self, address: VehicleAddress) -> bool:
        return False

    def leads_back(self, address: VehicleAddress) -> bool:
        return address.host in self.own_hosts

    def is_ours(self, address: VehicleAddress) -> bool:
        return address.port in self.own_ports

    def open(self, address: VehicleAddress) -> str:
        if not self.fails:
            self.opened.append(address)
        return self.fails

    def close(self) -> str:
        self.closed += 1
        if not self.stays:
            self.opened.clear()
        return self.stays


class Desk:
    """GCSB's, with time that the test moves."""

    def __init__(self, file: Path, door: FakeDoor | None = None, **settings: Any) -> None:
        self.door = door or FakeDoor()
        given = {"ask": True, "local": False, "keyed": True, "utc": lambda: 1_795_766_400.0, **settings}
        self.made = VehicleAddresses(self.door, B, file, **given)
        self.now = 100.0
        self.armed = False

    def run(self, seconds: float = 2.0) -> list[str]:
        lines = []
        for _ in range(max(1, round(seconds))):
            self.now += 1.0
            lines += self.made.tick(self.now, self.armed)
        return lines

    def send(self, sender: int, *addresses: VehicleAddress, to: int = B, mission: str = "delivery") -> None:
        names = {A: "GCSA", C: "GCSC", VEHICLE: "vehicle"}
        self.made.offered(sender, names[sender], mission, pack_addresses({to: addresses}).ljust(176, b"\0"))

    def connect(self, word: str) -> str:
        return self.made.connect(word, self.armed)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "GCSB-vehicle-1.address"


@pytest.fixture
def desk(file: Path) -> Desk:
    desk = Desk(file)
    assert desk.run() == [WAITS]
    return desk


# ---- the ordinary way ---------------------------------------------------------------------------------------------


def test_nothing_is_opened_before_the_operator_confirms(desk: Desk) -> None:
    desk.send(A, WIFI)
    assert desk.run() == [ASKED]
    assert desk.run(600) == []
    assert desk.door.opened == []
    assert desk.connect("1") == "Connecting to the vehicle at udpout:10.0.0.2:14552, the address from GCSA."
    assert desk.run() == ["Link to the vehicle opened: udpout:10.0.0.2:14552."]
    assert desk.door.opened == [WIFI]


def test_several_paths_are_one_question_and_several_links(desk: Desk) -> None:
    desk.send(A, WIFI, LTE)
    (line,) = desk.run()
    assert line.startswith(
        "GCSA sends the vehicle's address udpout:10.0.0.2:14552, udpout:100.64.3.7:5762. This station has no link"
    )
    desk.connect("1")
    desk.run()
    assert desk.door.opened == [WIFI, LTE]


def test_the_status_tells_what_is_asked_and_then_where_the_address_comes_from(desk: Desk) -> None:
    assert list(desk.made.status()) == []
    desk.send(A, WIFI)
    desk.run()
    assert list(desk.made.status()) == [
        "udpout:10.0.0.2:14552 from GCSA with mission 'delivery': 'handover connect 1' opens it"
    ]
    desk.connect("1")
    desk.run()
    assert list(desk.made.status()) == [
        "udpout:10.0.0.2:14552 from GCSA with mission 'delivery', confirmed 2026-11-27 08:00 UTC; in use "
        "('handover disconnect' withdraws it)"
    ]


def test_without_a_key_the_question_says_what_that_means(file: Path) -> None:
    desk = Desk(file, keyed=False)
    desk.send(A, WIFI)
    (line,) = desk.run()
    assert "Without a key any program there can pose as the vehicle." in line


def test_a_refused_address_is_not_asked_again_and_can_still_be_chosen(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    assert desk.connect("no") == "Refused: udpout:10.0.0.2:14552 from GCSA."
    assert desk.connect("no") == "No address waits for an answer."
    desk.send(A, WIFI)
    assert desk.run(100) == []
    assert list(desk.made.status()) == [
        "udpout:10.0.0.2:14552 from GCSA with mission 'delivery': refused; 'handover connect 1' opens it"
    ]
    desk.connect("1")
    desk.run()
    assert desk.door.opened == [WIFI]


def test_after_an_answer_the_next_address_of_that_station_is_shown_at_once(desk: Desk) -> None:
    desk.send(A, OTHER)
    desk.run()
    desk.connect("no")
    desk.send(A, WIFI)
    (line,) = desk.run()
    assert line.endswith("Then type 'handover connect 2', or 'handover connect no'.")


def test_a_mission_of_an_older_station_says_that_an_address_is_missing(desk: Desk) -> None:
    """Its offer has no addresses."""
    desk.made.offered(A, "GCSA", "delivery", bytes(176))
    assert desk.run() == [
        "GCSA sends mission 'delivery' without the vehicle's address for this station. This station has no link to the "
        "vehicle: restart it with --master, or ask for addresses.toml in the mission."
    ]


def test_addresses_for_other_stations_are_not_this_ones(desk: Desk) -> None:
    desk.send(A, WIFI, to=C)
    (line,) = desk.run()
    assert "without the vehicle's address for this station" in line


def test_another_address_than_the_one_in_use_is_asked_with_both(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.run(60)
    desk.send(C, OTHER)
    (line,) = desk.run()
    assert "This station uses udpout:10.0.0.2:14552, from GCSA." in line
    assert desk.door.opened == [WIFI]
    desk.connect("2")
    desk.run()
    assert desk.door.opened == [OTHER]


def test_the_address_in_use_is_not_asked_again(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.run()
    desk.send(C, WIFI)
    assert desk.run(100) == []


def test_withdrawn_it_is_closed_forgotten_and_can_be_chosen_again(desk: Desk, file: Path) -> None:
    assert desk.made.disconnect(False) == "This station uses no address of the vehicle that another station sent."
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.run()
    assert file.exists()
    assert desk.made.disconnect(False) == (
        "The link to the vehicle at udpout:10.0.0.2:14552 is closed, and its address is forgotten."
    )
    assert desk.run(100) == []
    assert (desk.door.opened, file.exists()) == ([], False)
    assert list(desk.made.status()) == [
        "udpout:10.0.0.2:14552 from GCSA with mission 'delivery': refused; 'handover connect 2' opens it"
    ]


def test_an_answer_is_on_the_disk_at_once(desk: Desk, file: Path) -> None:
    """The operator may end the program in the next moment."""
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    assert file.exists()
    desk.run()
    desk.made.disconnect(False)
    assert not file.exists()


# ---- the station's own links win ----------------------------------------------------------------------------------


def test_the_stations_own_link_wins_and_the_conflict_is_told_once(file: Path) -> None:
    desk = Desk(file, FakeDoor("0.0.0.0:14550"))
    desk.send(A, WIFI)
    assert desk.run() == [
        "GCSA sends the vehicle's address udpout:10.0.0.2:14552. This station keeps its own link: 0.0.0.0:14550."
    ]
    desk.send(A, WIFI)
    assert desk.run(3000) == []
    assert desk.connect("1") == "No question 1. 'handover connect' lists the addresses that other stations sent."
    assert desk.door.opened == []


def test_an_own_link_to_the_same_address_is_no_conflict(file: Path) -> None:
    desk = Desk(file, FakeDoor("10.0.0.2:14552", "100.64.3.7:5762"))
    desk.send(A, WIFI, LTE)
    assert desk.run() == []


def test_an_own_link_that_comes_after_the_question_wins_too(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.door.own_links = ("/dev/ttyUSB0",)
    assert desk.connect("1") == "This station keeps its own link: /dev/ttyUSB0."


def test_an_own_link_that_is_added_later_leaves_the_confirmed_one_open(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.run()
    desk.door.own_links = ("/dev/ttyUSB0",)
    desk.send(C, WIFI)
    assert desk.run(60) == []
    assert desk.door.opened == [WIFI]
    assert "; in use (" in next(desk.made.status())


def test_a_kept_address_is_not_used_by_a_station_that_has_its_own_link(desk: Desk, file: Path) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.run()
    again = Desk(file, FakeDoor("0.0.0.0:14550"))
    assert again.run() == [
        "udpout:10.0.0.2:14552, the vehicle's address from GCSA, confirmed 2026-11-27 08:00 UTC, is not used. This "
        "station keeps its own link: 0.0.0.0:14550."
    ]
    assert again.door.opened == []


# ---- while the vehicle is armed -----------------------------------------------------------------------------------


def test_while_the_vehicle_is_armed_nothing_is_asked_and_it_is_after(desk: Desk) -> None:
    desk.armed = True
    desk.send(A, WIFI)
    assert desk.run(100) == []
    assert list(desk.made.status()) == [
        "GCSA sends addresses: 'handover connect' shows them when the vehicle is disarmed or silent"
    ]
    desk.armed = False
    assert desk.run() == [ASKED]


def test_while_the_vehicle_is_armed_nothing_is_opened_and_nothing_withdrawn(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.armed = True
    assert (
        desk.connect("1")
        == "Not while the vehicle is armed. Type 'handover connect 1' after it has disarmed, or after 60 s of silence."
    )
    desk.armed = False
    desk.connect("1")
    desk.run()
    desk.armed = True
    assert desk.made.disconnect(True) == (
        "Not while the vehicle is armed. Type 'handover disconnect' after it has disarmed, or after 60 s of silence."
    )
    assert desk.door.opened == [WIFI]


# ---- what is no address of the vehicle ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("address", "why"),
    [
        (LOOPBACK, "127.0.0.1 is this computer itself (offered_addresses_local = true allows it)"),
        (VehicleAddress("127.7.7.7", 22), "127.7.7.7 is this computer itself (offered_addresses_local = true "),
        (VehicleAddress("0.0.0.0", 14552), "0.0.0.0 names no computer"),
        (
            VehicleAddress("239.255.145.50", 14550),
            "239.255.145.50 is a multicast address, and not one vehicle",
        ),
        (
            VehicleAddress("255.255.255.255", 14550),
            "255.255.255.255 is a broadcast or reserved address, and not one vehicle",
        ),
        (
            VehicleAddress("10.0.0.77", 14552),
            "10.0.0.77 is this computer itself (offered_addresses_local = true allows it)",
        ),
    ],
)
def test_an_address_that_no_vehicle_has_is_refused_and_spoils_the_others(
    desk: Desk, address: VehicleAddress, why: str
) -> None:
    desk.door.own_hosts.add("10.0.0.77")
    desk.send(A, WIFI, address)
    (line,) = desk.run()
    assert f"Refused: {why}" in line
    assert line.endswith("Ask the operator of GCSA for another one.")
    assert desk.connect("1").startswith("No question 1.")


def test_an_address_that_became_this_computers_since_the_question_is_refused(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.door.own_hosts.add("10.0.0.2")
    assert desk.connect("1").startswith("Refused: 10.0.0.2 is this computer itself")
    desk.run()
    assert desk.door.opened == []


def test_where_this_computer_is_allowed_the_stations_own_ports_are_not(file: Path) -> None:
    desk = Desk(file, local=True)
    desk.door.own_ports.add(15552)
    desk.send(A, VehicleAddress("127.0.0.1", 15552))
    assert desk.run()[-1].startswith(
        "GCSA sends the vehicle's address udpout:127.0.0.1:15552. Refused: this station itself listens at port 15552."
    )
    desk.send(C, LOOPBACK)
    (line,) = desk.run()
    assert line.endswith("Then type 'handover connect 1', or 'handover connect no'.")


def test_a_port_number_that_this_station_uses_is_free_on_another_computer(file: Path) -> None:
    desk = Desk(file, local=True)
    desk.door.own_ports.add(14552)
    desk.send(A, WIFI)
    assert desk.run()[-1].endswith("Then type 'handover connect 1', or 'handover connect no'.")


def test_five_paths_are_too_many(desk: Desk) -> None:
    desk.send(A, *(VehicleAddress("10.0.0.2", port) for port in range(1, 6)))
    (line,) = desk.run()
    assert "Refused: 5 addresses, allowed are 4." in line


def test_a_configuration_that_refuses_is_told_once(file: Path) -> None:
    desk = Desk(file, ask=False)
    desk.run()
    desk.send(A, WIFI)
    assert desk.run() == [
        "GCSA sends the vehicle's address udpout:10.0.0.2:14552. Refused: this station's configuration has "
        'offered_addresses = "refuse".'
    ]
    assert desk.run(1000) == []
    assert desk.connect("1").startswith("No question 1.")


# ---- a hostile sender ---------------------------------------------------------------------------------------------


def test_a_flood_of_addresses_is_few_lines_and_no_link(desk: Desk) -> None:
    """Ten thousand different addresses in an hour."""
    lines = []
    for number in range(3600):
        for part in range(3):
            desk.send(A, VehicleAddress(f"10.{part}.{number // 250}.{number % 250 + 1}", 14552))
        lines += desk.run(1)
    assert 5 <= len(lines) <= 12
    assert desk.door.opened == []
    assert "Question 1 does not count any more." in lines[1]
    assert len(list(desk.made.status())) <= 2


def test_the_operator_need_not_wait_for_what_came_in_a_flood(desk: Desk) -> None:
    for number in range(200):
        desk.send(A, VehicleAddress("10.0.0.2", number + 1))
        desk.run(1)
    desk.send(A, OTHER)
    assert desk.run(5) == []
    desk.made.asked_for()
    (line,) = desk.run(1)
    assert line.startswith("GCSA sends the vehicle's address udpout:10.0.0.9:14552.")


def test_long_after_a_flood_that_sender_is_heard_as_before(desk: Desk) -> None:
    for number in range(200):
        desk.send(A, VehicleAddress("10.0.0.2", number + 1))
        desk.run(1)
    desk.run(2000)
    desk.send(A, WIFI)
    assert len(desk.run(2)) == 1
    desk.send(A, OTHER)
    assert len(desk.run(31)) == 1


def test_who_floods_keeps_no_other_station_from_being_heard(desk: Desk) -> None:
    for number in range(200):
        desk.send(A, VehicleAddress("10.0.0.2", number + 1))
        desk.run(1)
    desk.send(C, OTHER)
    lines = desk.run(2)
    assert any(line.startswith("GCSC sends the vehicle's address udpout:10.0.0.9:14552.") for line in lines)


def test_an_answer_to_a_question_that_was_replaced_opens_nothing(desk: Desk) -> None:
    """The operator has read one address; another takes its place before the answer is typed."""
    desk.send(A, WIFI)
    desk.run()
    desk.send(A, OTHER)
    lines = desk.run(40)
    assert len(lines) == 1
    assert "Question 1 does not count any more." in lines[0]
    assert desk.connect("1") == (
        "Question 1 does not count any more. 'handover connect' lists the addresses that other stations sent."
    )
    desk.run()
    assert desk.door.opened == []


def test_what_is_confirmed_is_what_was_shown_though_another_came_since(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.send(A, OTHER)  # not shown yet
    desk.connect("1")
    desk.run()
    assert desk.door.opened == [WIFI]


@pytest.mark.parametrize("word", ["", "0", "2", "-1", "1.0", "١", "1 ", "yes", "udpout:10.0.0.2:14552", "9" * 40])
def test_anything_but_the_number_of_the_question_opens_nothing(desk: Desk, word: str) -> None:
    desk.send(A, WIFI)
    desk.run()
    assert "'handover connect' lists the addresses that other stations sent." in desk.connect(word)
    desk.run()
    assert desk.door.opened == []


def test_no_bytes_of_a_sender_raise_or_open_anything(desk: Desk) -> None:
    rng = random.Random(43)
    for _ in range(500):
        raw = bytes([rng.choice((B, rng.randrange(256))), rng.randrange(4), *rng.randbytes(174)])
        desk.made.offered(A, "GCSA", "\x1b[2Jx\n" + "m" * 500, raw)
        for line in desk.run(700):
            assert line.isprintable()
            assert len(line) < 600
    assert desk.door.opened == []


# ---- after a restart ----------------------------------------------------------------------------------------------


@pytest.fixture
def confirmed(desk: Desk, file: Path) -> Path:
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.run()
    return file


def test_a_confirmed_address_is_opened_again_after_a_restart_and_says_where_it_came_from(confirmed: Path) -> None:
    again = Desk(confirmed)
    assert again.run(3) == ["Link to the vehicle opened: udpout:10.0.0.2:14552."]
    assert again.door.opened == [WIFI]
    assert list(again.made.status()) == [
        "udpout:10.0.0.2:14552 from GCSA with mission 'delivery', confirmed 2026-11-27 08:00 UTC; in use "
        "('handover disconnect' withdraws it)"
    ]


def test_it_is_for_the_stations_user_alone(confirmed: Path) -> None:
    assert confirmed.stat().st_mode & 0o777 == 0o600


def test_a_station_that_was_restarted_in_flight_opens_it_too(confirmed: Path) -> None:
    """It has not heard the vehicle yet, and brings back what was there."""
    again = Desk(confirmed)
    again.run(1)
    again.armed = True
    again.run(5)
    assert again.door.opened == [WIFI]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b'"x"',
        b"\xff\xfe",
        b"[" * 4000,
        b'{"addresses": ["udpout:10.0.0.2:14552"], "from": "GCSA", "mission": "m", "confirmed": "t"}'.ljust(5000),
        json.dumps({"addresses": [], "from": "GCSA", "mission": "m", "confirmed": "t"}).encode(),
        json.dumps({"addresses": ["/dev/ttyUSB0"], "from": "GCSA", "mission": "m", "confirmed": "t"}).encode(),
        json.dumps({"addresses": ["udpin:0.0.0.0:1"], "from": "GCSA", "mission": "m", "confirmed": "t"}).encode(),
        json.dumps({"addresses": "udpout:10.0.0.2:1", "from": "GCSA", "mission": "m", "confirmed": "t"}).encode(),
        json.dumps({"addresses": ["udpout:10.0.0.2:1"]}).encode(),
        json.dumps({"addresses": {"a": 1}, "from": "GCSA", "mission": "m", "confirmed": "t"}).encode(),
    ],
)
def test_a_file_that_is_damaged_opens_nothing_and_is_told(file: Path, content: bytes) -> None:
    file.write_bytes(content)
    desk = Desk(file)
    (line,) = desk.run()
    assert line.startswith(f"The vehicle's address that was confirmed cannot be read: {file}: ")
    assert desk.door.opened == []


def test_a_file_with_an_address_that_is_not_allowed_any_more_opens_nothing(file: Path) -> None:
    kept = {"addresses": ["udpout:127.0.0.1:14552"], "from": "GCSA", "mission": "m", "confirmed": "then"}
    file.write_text(json.dumps(kept), encoding="utf-8")
    desk = Desk(file)
    (line,) = desk.run()
    assert line.endswith("is not used: 127.0.0.1 is this computer itself (offered_addresses_local = true allows it).")
    assert desk.door.opened == []


def test_a_file_with_too_many_addresses_opens_nothing(file: Path) -> None:
    five = [f"udpout:10.0.0.2:{port}" for port in range(1, 6)]
    file.write_text(json.dumps({"addresses": five, "from": "GCSA", "mission": "m", "confirmed": "then"}))
    desk = Desk(file)
    (line,) = desk.run()
    assert line.endswith("is not used: 5 addresses, allowed are 4.")
    assert desk.door.opened == []


def test_a_disk_that_takes_nothing_is_told(tmp_path: Path) -> None:
    desk = Desk(tmp_path / "nowhere" / "x.address")
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    lines = desk.run()
    assert any(line.startswith("The vehicle's address is not kept for a restart: ") for line in lines)
    assert desk.door.opened == [WIFI]


def test_nothing_is_asked_before_the_file_was_read(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs: list[Callable[[], None]] = []
    monkeypatch.setattr("mavproxy_handover.tools.worker.in_thread", jobs.append)
    desk = Desk(file)
    desk.send(A, WIFI)
    assert desk.run(5) == []
    jobs.pop()()
    assert desk.run(1)[-1] == ASKED


# ---- a link that cannot be opened ---------------------------------------------------------------------------------


def test_a_link_that_mavproxy_cannot_open_is_told_once_and_tried_again(desk: Desk) -> None:
    desk.door.fails = "MAVProxy cannot open it"
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    assert desk.run(60) == [
        "No link to the vehicle at udpout:10.0.0.2:14552: MAVProxy cannot open it. It is tried again."
    ]
    assert "not open yet" in next(desk.made.status())
    desk.door.fails = ""
    assert desk.run(12) == ["Link to the vehicle opened: udpout:10.0.0.2:14552."]
    assert desk.door.opened == [WIFI]


def test_one_that_is_withdrawn_is_not_tried_any_more(desk: Desk) -> None:
    desk.door.fails = "MAVProxy cannot open it"
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.run()
    desk.made.disconnect(False)
    desk.door.fails = ""
    assert desk.run(60) == []
    assert desk.door.opened == []


# ---- what a second reader found -----------------------------------------------------------------------------------


def test_a_question_ends_when_that_sender_sends_an_address_that_is_refused(desk: Desk) -> None:
    """Of each sender the newest addresses count."""
    desk.send(A, WIFI)
    desk.run()
    desk.send(A, LOOPBACK)
    (line,) = desk.run(40)
    assert line.endswith(
        "(offered_addresses_local = true allows it). Ask the operator of GCSA for another one. Question 1 does not "
        "count any more."
    )
    assert desk.connect("1").startswith("Question 1 does not count any more.")
    assert list(desk.made.status()) == []
    desk.run()
    assert desk.door.opened == []


def test_a_question_ends_when_that_sender_sends_a_mission_without_addresses(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.send(A)
    (line,) = desk.run(40)
    assert line.endswith("ask for addresses.toml in the mission. Question 1 does not count any more.")
    assert desk.connect("1").startswith("Question 1 does not count any more.")


def test_a_question_ends_when_that_sender_comes_back_to_the_address_in_use(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.run()
    desk.send(A, OTHER)
    desk.run()
    desk.send(A, WIFI)
    assert desk.run(40) == ["Question 2 does not count any more: what GCSA sends now needs no answer."]
    assert desk.connect("2").startswith("Question 2 does not count any more.")
    desk.run()
    assert desk.door.opened == [WIFI]


def test_two_vehicles_never_ask_by_the_same_number(tmp_path: Path) -> None:
    """The operator answers for the vehicle that is chosen: the number of another one's question opens nothing."""
    numbers = count(1)
    first = Desk(tmp_path / "1.address", numbers=numbers)
    second = Desk(tmp_path / "2.address", numbers=numbers)
    first.send(C, OTHER)
    second.send(A, WIFI)
    assert first.run()[-1].endswith("Then type 'handover connect 1', or 'handover connect no'.")
    assert second.run()[-1].endswith("Then type 'handover connect 2', or 'handover connect no'.")
    assert first.connect("2").startswith("No question 2.")
    first.run()
    assert first.door.opened == []


def test_a_link_that_cannot_be_closed_is_not_called_closed(desk: Desk, file: Path) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.run()
    desk.door.stays = "MAVProxy's module 'link' is not loaded"
    assert desk.made.disconnect(False) == (
        "The address udpout:10.0.0.2:14552 is forgotten. Its link is still open: MAVProxy's module 'link' is not "
        "loaded. End this station to close it."
    )
    assert not file.exists()


def test_no_second_address_is_opened_beside_a_link_that_cannot_be_closed(desk: Desk) -> None:
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.run()
    desk.send(C, OTHER)
    desk.run()
    desk.door.stays = "MAVProxy's module 'link' is not loaded"
    assert desk.connect("2") == (
        "The link in use cannot be closed: MAVProxy's module 'link' is not loaded. Nothing was changed."
    )
    desk.run()
    assert desk.door.opened == [WIFI]


def test_withdrawn_before_the_file_was_read_is_not_answered_with_there_is_none(
    confirmed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs: list[Callable[[], None]] = []
    monkeypatch.setattr("mavproxy_handover.tools.worker.in_thread", jobs.append)
    again = Desk(confirmed)
    again.run()
    assert again.made.disconnect(False) == (
        "The file of the address that was confirmed is still being read. Type 'handover disconnect' again."
    )


def test_a_configuration_that_refuses_opens_no_address_of_an_earlier_run(confirmed: Path) -> None:
    again = Desk(confirmed, ask=False)
    assert again.run() == [
        "udpout:10.0.0.2:14552, the vehicle's address from GCSA, confirmed 2026-11-27 08:00 UTC, is not used. This "
        'station\'s configuration has offered_addresses = "refuse".'
    ]
    assert again.door.opened == []


def test_a_withdrawal_is_on_the_disk_though_the_disk_was_busy_when_the_program_ended(
    desk: Desk, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk still writes what was confirmed while the operator withdraws it and ends the program."""
    monkeypatch.setattr("mavproxy_handover.tools.worker.in_thread", lambda run: threading.Timer(0.1, run).start())
    desk.send(A, WIFI)
    desk.run()
    desk.connect("1")
    desk.made.disconnect(False)
    desk.made.release()
    time.sleep(0.3)
    assert not file.exists()
