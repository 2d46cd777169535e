# SPDX-License-Identifier: GPL-3.0-or-later

"""Answers to the companion's own reads of parameters stay aboard; no change and no station's answer does."""

from __future__ import annotations

import struct

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView
from tests.gate.door import Door
from tests.gate.ledger import GCSA, VEHICLE, A
from tests.gate.test_log_download import packed

BY_NAME = 65535


class Bench:
    """GCSA commands on the ground; the autopilot has said FS_OPTIONS 8 in a download."""

    def __init__(self) -> None:
        self.door = Door(step_s=0.0)
        self.door.change(AuthorityView(commander=GCSA, armed=False))
        self.comes(8.0, index=700)
        self.heard()

    def reads(self) -> None:
        """The companion."""
        message = mavlink.MAVLink_param_request_read_message(VEHICLE, 1, b"FS_OPTIONS", -1)
        self.door.frames.companion_sent(packed(message, VEHICLE, 191).raw, self.door.now)

    def comes(self, value: float, name: bytes = b"FS_OPTIONS", index: int = BY_NAME, sender: int = VEHICLE) -> None:
        message = mavlink.MAVLink_param_value_message(name, value, 9, 1400, index)
        assert self.door.gate.down(packed(message, sender, 1), self.door.now)

    def heard(self) -> list[float]:
        """What GCSA was told since the last call."""
        port = self.door.ports[GCSA]
        found = [struct.unpack("<f", raw[10:14])[0] for raw in port.heard if raw[7] == 22]
        port.heard.clear()
        return found


def test_the_answer_to_the_companion_stays_aboard_and_the_next_value_does_not() -> None:
    bench = Bench()
    bench.reads()
    bench.comes(8.0)
    assert bench.heard() == []
    bench.comes(8.0)
    assert bench.heard() == [8.0]


def test_each_of_two_questions_keeps_its_answer_aboard() -> None:
    """The fault: the cruise speed is read for a load and before a flight; the second answer reached the stations."""
    bench = Bench()
    bench.reads()
    bench.door.now += 0.5
    bench.reads()
    bench.comes(8.0)
    bench.comes(8.0)
    assert bench.heard() == []
    bench.comes(8.0)
    assert bench.heard() == [8.0]
    bench.reads()
    bench.door.now += 0.6
    bench.reads()
    bench.door.now += 0.6
    bench.comes(8.0)
    bench.comes(8.0)
    assert bench.heard() == [8.0], "the first question is too old"


def test_questions_without_an_answer_fill_no_memory() -> None:
    bench = Bench()
    for _ in range(1000):
        bench.reads()
    (asked,) = bench.door.frames.own_reads._asked_at.values()
    assert len(asked) <= 8


def test_a_change_while_the_companion_asks_reaches_the_stations() -> None:
    """The autopilot announces a change as it answers a read by name: index 65535, to nobody."""
    bench = Bench()
    bench.reads()
    bench.comes(0.0)
    bench.comes(0.0)  # the answer
    assert bench.heard() == [0.0, 0.0]
    bench.reads()
    bench.comes(0.0)
    assert bench.heard() == []


def test_values_of_a_download_of_other_parameters_and_of_other_vehicles_pass() -> None:
    bench = Bench()
    bench.reads()
    bench.comes(8.0, index=700)
    bench.comes(3.0, name=b"BATT_MONITOR")
    bench.comes(8.0, sender=VEHICLE + 1)
    assert bench.heard() == [8.0, 3.0, 8.0]


def test_the_last_value_of_each_parameter_is_remembered() -> None:
    bench = Bench()
    bench.comes(3.0, name=b"BATT_MONITOR")
    bench.reads()
    bench.comes(0.0)
    assert bench.heard() == [3.0, 0.0]


def test_an_answer_that_is_late_passes() -> None:
    bench = Bench()
    bench.reads()
    bench.door.now += 1.0
    bench.comes(8.0)
    assert bench.heard() == [], "within a second it is the answer"
    bench.reads()
    bench.door.now += 1.1
    bench.comes(8.0)
    assert bench.heard() == [8.0]


def test_a_station_that_reads_or_sets_the_parameter_meanwhile_gets_its_answer() -> None:
    asks = [
        mavlink.MAVLink_param_request_read_message(VEHICLE, 1, b"FS_OPTIONS", -1),
        mavlink.MAVLink_param_set_message(VEHICLE, 1, b"FS_OPTIONS", 8.0, 9),
    ]
    for message in asks:
        bench = Bench()
        bench.reads()
        assert bench.door.up(A, packed(message)).passed
        bench.door.gate.tick(bench.door.now)
        bench.comes(8.0)
        assert bench.heard() == [8.0]


def test_a_station_that_asked_before_the_companion_gets_one_of_the_two_answers() -> None:
    bench = Bench()
    bench.door.up(A, packed(mavlink.MAVLink_param_request_read_message(VEHICLE, 1, b"FS_OPTIONS", -1)))
    bench.door.gate.tick(bench.door.now)
    bench.reads()
    bench.comes(8.0)
    bench.comes(8.0)
    assert bench.heard() == [8.0]


def test_the_memory_of_values_is_bounded() -> None:
    bench = Bench()
    sizes = []
    for number in range(9_000):
        bench.comes(1.0, name=f"P{number}".encode())
        sizes.append(len(bench.door.frames.own_reads._values))
    assert max(sizes) == 8192
