# SPDX-License-Identifier: GPL-3.0-or-later

"""Operators' names in the vehicle's journal: sign-on, shift, sign-off, consent, override."""

from __future__ import annotations

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.messages import ConnectAck
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire import codec
from tests.module.conftest import Bench
from tests.module.test_handover import begin_flight, hand_over


def duty(bench: Bench, name: str) -> None:
    bench.a.operator = name
    bench.wait(3.0)


def test_sign_on_shift_and_sign_off_are_told_once_each(bench: Bench) -> None:
    bench.connect()
    for name in ("Jansen", "Jansen", "Bakker", ""):
        duty(bench, name)
    assert [(entry["text"], entry["station"], entry.get("operator")) for entry in bench.journal("operator")] == [
        ("Jansen is on duty at GCSA", "GCSA", "Jansen"),
        ("Bakker is on duty at GCSA, after Jansen", "GCSA", "Bakker"),
        ("Bakker has signed off at GCSA", "GCSA", None),
    ]
    assert bench.mpstate.console.said("Bakker is on duty at GCSA, after Jansen.")


def test_without_a_name_nothing_is_told(bench: Bench) -> None:
    bench.connect()
    bench.wait(3.0)
    assert bench.journal("operator") == []


def test_consents_carry_the_name(bench: Bench, delivery: MissionPackage) -> None:
    flight = begin_flight(bench, delivery, operators={"GCSA": "Jansen", "GCSB": "Bakker"})
    hand_over(flight)
    consents = {
        (entry["name"], entry["station"], entry.get("operator"))
        for entry in flight.journal("message")
        if entry["direction"] == "in" and entry.get("consent") == "granted"
    }
    assert consents == {("ON_HANDOVER", "GCSB", "Bakker"), ("OK_HANDOVER", "GCSA", "Jansen")}


def test_an_override_carries_the_name(bench: Bench) -> None:
    bench.connect()
    duty(bench, "Jansen")
    bench.a.send(mavlink.MAVLink_handover_override_message(1, 191, 1, mavlink.HANDOVER_LIMIT_FENCE, 7, 0))
    bench.run(0.3)
    (entry,) = bench.journal("override")
    assert (entry["by"], entry["operator"]) == ("GCSA", "Jansen")
    assert entry["text"] == "GCSA lifts fence for 60 s, on duty: Jansen"


def test_a_name_is_cut_at_a_letter_and_never_breaks_a_line() -> None:
    def passed_on(name: str) -> str:
        answer = ConnectAck(251, 1, 1, 1, None, "GCSA", bytes(32), operator=name)
        found = codec.decode(codec.encode(answer, (1, 191), 1))
        assert isinstance(found, ConnectAck)
        return found.operator

    assert passed_on("Jansen") == "Jansen"
    assert passed_on("\u00e9" * 30) == "\u00e9" * 15
    assert passed_on("a\nb") == "a?b"


def test_a_station_of_an_older_version_names_no_operator() -> None:
    values = (1, 191, 1, 251, 1, 7, 1, 0, b"GCSA", list(bytes(32)), 0)
    found = codec.decode(mavlink.MAVLink_connect_ack_message(*values))
    assert isinstance(found, ConnectAck)
    assert (found.operator, found.manned) == ("", True)
