# SPDX-License-Identifier: GPL-3.0-or-later

"""The place of an RTK base in corrections: whole, in fragments, cut anywhere, and in garbage."""

from __future__ import annotations

import random

import pytest

from mavproxy_handover.wire.rtcm import BaseReader, crc24q
from tests.wire.rtcm_frames import base, message

PLACE = (-2694045.6905, -4266532.4375, 3888310.3602)
OBSERVATIONS = message(bytes([0x43, 0x50]) + bytes(range(250)))


def near(found: tuple[float, float, float] | None, place: tuple[float, float, float] = PLACE) -> bool:
    return found is not None and max(abs(a - b) for a, b in zip(found, place, strict=True)) < 1e-4


def test_the_check_sum_is_that_of_the_standard() -> None:
    """The example of RTKLIB's and other readers: a message 1005 of a base."""
    known = bytes.fromhex("D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98")
    assert crc24q(known[:-3]) == int.from_bytes(known[-3:], "big")
    found = BaseReader().stream(known)
    assert found is not None
    assert found == pytest.approx((1114104.5999, -4850729.7108, 3975521.4643), abs=1e-3)


@pytest.mark.parametrize("number", [1005, 1006])
def test_a_base_in_one_piece(number: int) -> None:
    assert near(BaseReader().stream(OBSERVATIONS + base(*PLACE, number)))


@pytest.mark.parametrize("cut", range(1, 26))
def test_a_base_that_is_cut_anywhere(cut: int) -> None:
    reader, data = BaseReader(), base(*PLACE)
    assert len(data) == 25
    first = reader.stream(OBSERVATIONS + data[:cut])
    assert near(first) if cut == 25 else first is None
    if cut < 25:
        assert near(reader.stream(data[cut:] + OBSERVATIONS))


def fragments(data: bytes, sequence: int) -> list[tuple[int, bytes]]:
    pieces = [data[start : start + 180] for start in range(0, len(data), 180)]
    if len(pieces[-1]) == 180 and len(pieces) < 4:
        pieces.append(b"")
    return [(1 | part << 1 | sequence << 3, piece) for part, piece in enumerate(pieces)]


@pytest.mark.parametrize("before", [0, 170, 335, 336, 500, 695])
def test_a_base_in_fragments_in_any_order(before: int) -> None:
    pieces = fragments(bytes(before) + base(*PLACE), 9)
    for order in (pieces, pieces[::-1]):
        reader = BaseReader()
        found = [reader.fragment(flags, data) for flags, data in order]
        assert near(found[-1])
        assert found[:-1] == [None] * (len(pieces) - 1)


def test_a_lost_fragment_costs_its_message_alone() -> None:
    reader = BaseReader()
    pieces = fragments(bytes(350) + base(*PLACE), 1)
    assert [reader.fragment(*piece) for piece in pieces[:1]] == [None]
    again = fragments(bytes(350) + base(*PLACE), 2)
    assert near([reader.fragment(*piece) for piece in again][-1])


def test_a_damaged_base_and_one_that_is_not_on_earth_have_no_place() -> None:
    data = bytearray(base(*PLACE))
    for at in range(len(data)):
        damaged = bytearray(data)
        damaged[at] ^= 1
        assert BaseReader().stream(bytes(damaged)) is None
    assert BaseReader().stream(base(0.0, 0.0, 0.0)) is None
    assert BaseReader().stream(base(1e7, 1e7, 1e7)) is None


def test_garbage_raises_nothing_and_takes_no_memory() -> None:
    chance, reader = random.Random(7), BaseReader()
    for _piece in range(3000):
        data = chance.randbytes(chance.randrange(0, 256))
        if chance.random() < 0.5:
            data = (b"\xd3\x00\x13\x3e" * 64)[: chance.randrange(1, 256)]
        assert reader.fragment(chance.randrange(256), data) is None
        assert reader.stream(data) is None
    assert len(reader._tail) < 30
    assert near(reader.stream(base(*PLACE)))
