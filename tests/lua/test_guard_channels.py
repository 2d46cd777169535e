# SPDX-License-Identifier: GPL-3.0-or-later

"""Where the guard answers: only on channels that it has heard.

A message to a channel without a port ends the process of firmware before the end of 2025, one past the firmware's
buffers raises; neither must happen, whatever HNDO_CHAN says.
"""

from __future__ import annotations

import pytest

from tests.lua.stub import AUTO, RTL, Bench, command_frame

#: the last one is the release that does not die any more
FIRMWARE = [(4, 5, 7), (4, 6, 3), (4, 7, 0), (4, 7, 1)]


@pytest.fixture(params=FIRMWARE, ids=lambda version: ".".join(map(str, version)))
def firmware(request: pytest.FixtureRequest) -> tuple[int, int, int]:
    version: tuple[int, int, int] = request.param
    return version


@pytest.mark.parametrize("channel", range(-1, 16))
def test_where_nothing_was_heard_nothing_is_sent(firmware: tuple[int, int, int], channel: int) -> None:
    bench = Bench(parameters={"HNDO_CHAN": float(channel)}, firmware=firmware, heard=False)
    bench.vehicle.ports = {0}
    bench.run(5000)
    assert bench.vehicle.messages == []
    assert bench.refusal == "HNDO: no lease from companion"
    assert len(bench.vehicle.records) >= 4


@pytest.mark.parametrize("channel", [3, 4, 6, 7, 8, 15])
def test_another_channel_in_flight_is_a_lost_lease_and_no_more(firmware: tuple[int, int, int], channel: int) -> None:
    """PARAM_SET of anybody who reaches the autopilot."""
    bench = Bench(firmware=firmware).fly(AUTO)
    bench.vehicle.parameters["HNDO_CHAN"] = float(channel)
    bench.vehicle.records.clear()
    bench.run(5000)
    assert bench.vehicle.mode == RTL
    assert len(bench.vehicle.records) >= 5
    assert not any("fault" in text for text in bench.texts)


@pytest.mark.parametrize("frame", [command_frame(400), command_frame(400, as_int=True)], ids=["long", "int"])
def test_any_frame_of_the_queue_is_a_sign_of_a_port(frame: bytes) -> None:
    bench = Bench(heard=False)
    bench.run(1000)
    bench.receive(frame)
    bench.run(600)
    assert bench.status.state == 1


def test_channel_0_is_answered_before_any_lease() -> None:
    bench = Bench(parameters={"HNDO_CHAN": 0.0}, heard=False)
    bench.hear(0)
    bench.run(600)
    assert bench.statuses(channel=0)[-1].state == 1


def test_a_frame_on_another_channel_is_none() -> None:
    bench = Bench(heard=False)
    bench.hear(2)
    bench.run(2000)
    assert bench.vehicle.messages == []


def test_on_a_channel_that_cannot_be_sent_to_no_companion_learns_the_nonce() -> None:
    """It is said once, and the vehicle does not arm; the log goes on."""
    bench = Bench(firmware=(4, 5, 7), parameters={"HNDO_CHAN": 9.0})
    for _ in range(300):
        bench.receive(bench.companion.lease(), channel=9)
        bench.run(200)
    assert bench.refusal == "HNDO: no lease from companion"
    assert bench.texts.count("HNDO: no answer on channel 9") == 1
    assert not any("fault" in text for text in bench.texts)
    assert len(bench.vehicle.records) >= 59


def test_a_denied_scripting_command_is_answered_where_it_came_from() -> None:
    bench = Bench(heard=False)
    bench.vehicle.ports = {0, 1}
    bench.receive(command_frame(42701), channel=5)
    bench.run(200)
    assert [channel for channel, _, _ in bench.vehicle.messages] == [5]
