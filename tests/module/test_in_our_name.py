# SPDX-License-Identifier: GPL-3.0-or-later

"""Somebody on the vehicle's side speaks as the companion: another program on board, or a radio on a second port."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as stock

from tests.gate.frames import make_frame
from tests.module.conftest import Bench

#: what made a station disbelieve the vehicle from then on
FORGED_EPOCH = 0xFFFFFFFE


def say(bench: Bench, name: str, component: int, system: int = 1, **fields: Any) -> None:
    """MAVProxy receives a message from the vehicle's side."""
    raw = make_frame(name, system, component, **fields).raw
    bench.mpstate.deliver(stock.MAVLink(None).decode(bytearray(raw)))


@pytest.fixture
def ground(bench: Bench) -> Bench:
    """On the ground, GCSA in command; what came before is forgotten."""
    bench.connect()
    for station in (bench.a, bench.b):
        station.received.clear()
    return bench


@pytest.mark.parametrize("component", [1, 42, 191, 198, 240])
def test_a_forged_epoch_reaches_no_station(ground: Bench, component: int) -> None:
    say(ground, "AUTHORITY_STATUS", component, epoch=FORGED_EPOCH)
    ground.run(1.5)
    for station in (ground.a, ground.b):
        assert {m.epoch for m in station.got("AUTHORITY_STATUS")} == {1}
    assert ground.companion.gate.in_our_name == {(1, component): 1}
    assert ground.companion.faults == {}


@pytest.mark.parametrize("component", [191, 198, 240])
def test_nor_does_anything_else_in_the_companions_name(ground: Bench, component: int) -> None:
    say(ground, "STATUSTEXT", component, text=b"all is well")
    say(ground, "COMMAND_ACK", component, command=32100, target_system=251, target_component=190)
    ground.run(1.5)
    for station in (ground.a, ground.b):
        assert "all is well" not in station.texts()
        assert station.got("COMMAND_ACK") == []
        heard = {m.get_type() for m in station.received if m.get_srcComponent() in (191, 198)}
        assert {"HEARTBEAT", "AUTHORITY_STATUS", "CONTROL_STATUS"} <= heard, "the companion's own are heard as ever"


def test_it_is_told_once_of_each_who_does_it_and_counted(ground: Bench) -> None:
    for _ in range(20):
        say(ground, "HEARTBEAT", 191)
        say(ground, "CONNECT", 154, target_system=251)
        ground.run(0.5)
    entries = ground.journal("in_our_name")
    assert [entry["text"] for entry in entries] == [
        "HEARTBEAT of 1/191 on the vehicle's side uses the companion's identity: not forwarded",
        "CONNECT of 1/154 on the vehicle's side uses the companion's identity: not forwarded",
    ]
    assert [(entry["system"], entry["component"], entry["what"]) for entry in entries] == [
        (1, 191, "HEARTBEAT"),
        (1, 154, "CONNECT"),
    ]
    assert ground.mpstate.console.said(entries[0]["text"])
    assert ground.companion.gate.in_our_name == {(1, 191): 20, (1, 154): 20}


def test_who_changes_its_name_each_time_does_not_fill_the_journal(ground: Bench) -> None:
    for component in range(1, 100):
        say(ground, "CONNECT", component, system=7)
    assert len(ground.journal("in_our_name")) == 8
    assert sum(ground.companion.gate.in_our_name.values()) == 99
