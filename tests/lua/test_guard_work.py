# SPDX-License-Identifier: GPL-3.0-or-later

"""How many frames one call reads: twelve, or up to three sums (CRCs and tags). A frame that costs no sum counts none.

A call that read less would let a flood drown the leases; one that read more would reach the limit of instructions.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.lua.stub import Bench, Companion, command_frame
from tests.lua.test_guard_tag import keyed_bench

SCRIPTING, AUX_FUNCTION, ANOTHER = 42701, 218, 400
#: bits of the status
TAMPERED, TAGGED = 8, 32
#: a script that was there before receives HEARTBEAT, too: all scripts share one queue
NEIGHBOUR = "mavlink:init(25, 10) mavlink:register_rx_msgid(0)"


def damaged(frame: bytes) -> bytes:
    """The frame with a wrong CRC."""
    return frame[:-1] + bytes([frame[-1] ^ 1])


def left_by_calls(bench: Bench, frame: Callable[[], bytes], count: int = 10) -> list[int]:
    """How many of so many frames are in the queue after each call."""
    queue = bench.scripting._calls.queue
    assert queue is not None
    bench.sending = False
    bench.until(lambda: not queue)
    for _ in range(count):
        assert bench.receive(frame())
    left = [count]
    while queue:
        bench.until(lambda: len(queue) < left[-1])
        left.append(len(queue))
    return left[1:]


Frames = Callable[[Companion], bytes]
ONE_SUM: dict[str, Frames] = {
    "lease": lambda companion: companion.lease(),
    "lease with a wrong CRC": lambda companion: damaged(companion.lease()),
    "lease for all vehicles": lambda companion: companion.lease(target_system=0),
    "lease of another version": lambda companion: companion.lease(version=1),
    "lease of another state": lambda companion: companion.lease(state=9),
    "lease for another guard": lambda companion: companion.lease(guard_nonce=5),
    "lease that came before": lambda companion: companion.frame(),
    "command that would stop the guard": lambda _companion: command_frame(SCRIPTING),
    "the same with a wrong CRC": lambda _companion: damaged(command_frame(SCRIPTING)),
    "command that the firmware carries out": lambda _companion: command_frame(AUX_FUNCTION),
}
NO_SUM: dict[str, Frames] = {
    "TUNNEL that is no lease": lambda companion: companion.tunnel(b"", kind=0),
    "lease of another companion": lambda companion: Companion(component=9).lease(),
    "lease with bytes behind its tag": lambda companion: companion.tunnel(bytes([1]) * 33),
    "another command": lambda _companion: command_frame(ANOTHER),
    "message that another script receives": lambda companion: bytes(
        companion.packer.heartbeat_encode(6, 8, 0, 0, 0).pack(companion.packer)
    ),
}


@pytest.mark.parametrize("kind", ONE_SUM)
def test_three_frames_that_cost_a_crc(kind: str) -> None:
    bench = Bench().with_lease()
    assert left_by_calls(bench, lambda: ONE_SUM[kind](bench.companion)) == [7, 4, 1, 0]


@pytest.mark.parametrize("kind", NO_SUM)
def test_twelve_frames_that_cost_nothing(kind: str) -> None:
    bench = Bench(earlier_script=NEIGHBOUR).with_lease()
    assert left_by_calls(bench, lambda: NO_SUM[kind](bench.companion), 20) == [8, 0]


@pytest.mark.parametrize("changes", [{}, {"guard_nonce": 5}])
def test_two_leases_with_a_tag(tmp_path: Path, changes: dict[str, int]) -> None:
    """CRC and tag are two sums, and the frame that reaches the limit is still read completely."""
    bench = keyed_bench(tmp_path).with_lease()
    assert left_by_calls(bench, lambda: bench.companion.lease(**changes))[0] == 8


def test_with_a_key_a_status_that_is_due_has_the_next_call_almost_for_itself(tmp_path: Path) -> None:
    """It has a tag, too. The first command makes it due, and it is sent and logged once."""
    bench = keyed_bench(tmp_path).with_lease()
    bench.vehicle.records.clear()
    before = len(bench.statuses())
    assert left_by_calls(bench, lambda: command_frame(SCRIPTING)) == [7, 6, 3, 0]
    assert [record["Fl"] for _, record in bench.vehicle.records] == [TAMPERED]
    assert [status.flags for status in bench.statuses()[before:]] == [TAMPERED | TAGGED]


def test_commands_beyond_ten_in_a_second_cost_nothing() -> None:
    bench = Bench().with_lease()
    assert left_by_calls(bench, lambda: command_frame(SCRIPTING), 25) == [22, 19, 16, 4, 0]


def test_a_message_of_another_kind_is_no_command() -> None:
    """Its bytes are those of the command that would stop the guard, where a command has its number."""
    bench = Bench(earlier_script="mavlink:init(25, 10) mavlink:register_rx_msgid(253)").with_lease()
    packer = bench.companion.packer
    text = b"x" * 27 + SCRIPTING.to_bytes(2, "little")
    assert bench.receive(bytes(packer.statustext_encode(6, text).pack(packer)))
    bench.run(100)
    assert not any("denied" in said or "fault" in said for said in bench.texts)
    assert bench.may_arm
