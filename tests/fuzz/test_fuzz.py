# SPDX-License-Identifier: GPL-3.0-or-later

"""Bytes in any cut never raise, and never get past the gate what the policy refuses (what holds: `harness`)."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mavproxy_handover.wire.frames import FrameSplitter
from tests.fuzz.harness import (
    CUT,
    DAMAGED,
    FRAME,
    GARBAGE,
    INTERESTING,
    SWITCH,
    VEHICLE_SAYS,
    check_forwarded,
    instruction,
    run,
    seeds,
)
from tests.gate.frames import make_frame
from tests.gate.ledger import ALL_COMMANDS, VIEWS, A

ANY_BYTE = st.integers(0, 255)
NAME = st.sampled_from([b"FS_OPTIONS", b"SCR_ENABLE", b"RTL_ALT", b"fs_gcs_enable"]) | st.binary(max_size=16)
PATH = st.sampled_from(
    [b"scripts/x.lua", b"\\APM\\Scripts\\x", b"@PARAM/param.pck", b"@MISSION/mission.dat", b"a\0scripts/b", b"x"]
) | st.binary(max_size=30)
OPCODE = st.sampled_from([6, 11, 13]) | st.integers(0, 17)
COMMAND = st.sampled_from([245, 300, 400, 511, 32100, 42701]) | st.sampled_from(ALL_COMMANDS) | st.integers(0, 65535)
#: Message and contents that belong together: where each message has what the gate looks at.
PAYLOADS = st.one_of(
    st.tuples(
        st.sampled_from(["COMMAND_LONG", "COMMAND_INT"]), COMMAND.map(lambda n: bytes(28) + n.to_bytes(2, "little"))
    ),
    st.tuples(st.just("PARAM_SET"), NAME.map(lambda name: bytes(6) + name)),
    st.tuples(
        st.just("FILE_TRANSFER_PROTOCOL"),
        st.builds(lambda opcode, path: bytes([0] * 6 + [opcode] + [0] * 8) + path, OPCODE, PATH),
    ),
    st.tuples(st.sampled_from(INTERESTING), st.binary(max_size=60)),
    st.tuples(st.none(), st.binary(max_size=60)),
)


def _length_first(data: bytes) -> bytes:
    return bytes([len(data)]) + data


@st.composite
def frames(draw: st.DrawFn, instruction: int) -> bytes:
    name, contents = draw(PAYLOADS)
    choice = draw(st.integers(128, 255)) if name is None else INTERESTING.index(name)
    sender = draw(st.sampled_from([0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7]))
    body = bytes([choice, draw(ANY_BYTE), sender, draw(ANY_BYTE), draw(ANY_BYTE)]) + _length_first(contents)
    damage = bytes(draw(st.tuples(ANY_BYTE, ANY_BYTE))) if instruction == DAMAGED else b""
    return bytes([instruction]) + body + damage


PLANS = st.lists(
    frames(FRAME)
    | frames(DAMAGED)
    | frames(VEHICLE_SAYS)
    | st.binary(max_size=40).map(lambda data: bytes([GARBAGE]) + _length_first(data))
    | ANY_BYTE.map(lambda length: bytes([CUT, length]))
    | ANY_BYTE.map(lambda choice: bytes([SWITCH, choice])),
    max_size=40,
).map(b"".join)


@settings(max_examples=500, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(PLANS)
def test_no_plan_gets_past_the_gate_what_the_policy_refuses(plan: bytes) -> None:
    run(plan)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=2000))
def test_no_bytes_do(plan: bytes) -> None:
    run(plan)


@given(st.binary(max_size=700), st.lists(st.integers(0, 700), max_size=6))
def test_any_cut_of_any_bytes_gives_the_same_frames(data: bytes, cuts: list[int]) -> None:
    whole, cut = FrameSplitter(), FrameSplitter()
    edges = [0, *sorted(min(edge, len(data)) for edge in cuts), len(data)]
    pieces = [frame for start, end in pairwise(edges) for frame in cut.feed(data[start:end])]
    assert pieces == whole.feed(data)


def test_the_plans_that_fuzzing_begins_with_hold() -> None:
    plans = list(seeds())
    assert sum(run(plan).forwarded for plan in plans) > 100
    run(b"".join(plans))


def test_the_harness_lets_something_through_and_would_notice() -> None:
    """A harness that forwards nothing, or checks nothing, proves nothing."""
    open_parameter = bytes(6) + b"LOG_BITMASK"
    assert run(instruction(FRAME, "PARAM_SET", open_parameter) * 3).forwarded == 3  # of the commander
    assert run(instruction(FRAME, "MISSION_COUNT", b"") * 3).forwarded == 0, "in flight it ends at the companion"
    b_commands = VIEWS[6]
    with pytest.raises(AssertionError):
        check_forwarded(make_frame("MISSION_COUNT"), A, b_commands)
