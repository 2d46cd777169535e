# SPDX-License-Identifier: GPL-3.0-or-later

"""The 56-byte record of a position box: layout, units, cuts of the stream, and what makes a stream unbelievable."""

from __future__ import annotations

import math
import struct
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.wire.box_layout import FULL, BoxField, BoxRecord
from mavproxy_handover.wire.box_record import LEAP_S, BoxStream, Lateness

HERE = BoxRecord(100.0, 52.679, 5.924, 42.0, 3.0, -4.0, -1.5, 0.1, -0.2, 350.0, 12.5)


def raw(**changed: float) -> bytes:
    """A record packed by hand: time, position at 45 north and 90 east, nothing moves; changed by field name."""
    values = {field.name: 0.0 for field in FULL.fields} | {"time": 1.0, "lat": math.pi / 4, "lon": math.pi / 2}
    assert changed.keys() <= values.keys()
    return struct.pack("<3d8f", *(values | changed).values())


def begun() -> BoxStream:
    """A stream whose first record, at the time 0.5, has come."""
    stream = BoxStream(FULL)
    assert stream.feed(raw(time=0.5)) == []
    return stream


def times(records: list[BoxRecord]) -> list[float]:
    return [record.time_s for record in records]


def flight(count: int, step_s: float = 0.1) -> bytes:
    return b"".join(FULL.pack(replace(HERE, time_s=100.0 + number * step_s)) for number in range(count))


# ---- layout and units -----------------------------------------------------------------------------------------------


def test_three_doubles_and_eight_floats_make_56_bytes() -> None:
    assert (FULL.format, FULL.size) == ("<dddffffffff", 56)


def test_radians_and_up_become_degrees_and_down() -> None:
    (record,) = begun().feed(raw(vel_north=1.0, vel_east=2.0, vel_up=3.0, yaw=-math.pi / 2, alt=7.0, battery=24.0))
    assert record.lat_deg == pytest.approx(45.0)
    assert record.lon_deg == pytest.approx(90.0)
    assert (record.north_mps, record.east_mps, record.down_mps) == (1.0, 2.0, -3.0)
    assert record.heading_deg == pytest.approx(270.0)
    assert (record.alt_m, record.battery_v, record.time_s) == (7.0, 24.0, 1.0)


def test_what_is_packed_is_read_back() -> None:
    (record,) = begun().feed(FULL.pack(replace(HERE, time_s=1.5)))
    for name in ("lat_deg", "lon_deg", "alt_m", "north_mps", "east_mps", "down_mps", "heading_deg"):
        assert getattr(record, name) == pytest.approx(getattr(HERE, name), rel=1e-6), name
    # a double of radians: far better than a millimetre
    assert record.lat_deg == pytest.approx(HERE.lat_deg, abs=1e-12)


# ---- cut anywhere ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cut", range(3 * FULL.size + 1))
def test_a_cut_at_every_byte(cut: int) -> None:
    data, stream = flight(3), BoxStream(FULL)
    found = stream.feed(data[:cut])
    assert len(found) == max(0, cut // FULL.size - 1)
    assert times(found + stream.feed(data[cut:])) == pytest.approx([100.1, 100.2])


def test_byte_by_byte() -> None:
    stream = BoxStream(FULL)
    found = [record for byte in flight(3) for record in stream.feed(bytes([byte]))]
    assert times(found) == pytest.approx([100.1, 100.2])


@given(st.lists(st.integers(1, 300), max_size=40))
def test_however_it_is_cut_the_same_comes_out(lengths: list[int]) -> None:
    data, stream, found, at = flight(20), BoxStream(FULL), [], 0
    for length in lengths:
        found += stream.feed(data[at : at + length])
        at += length
    found += stream.feed(data[at:])
    assert found == BoxStream(FULL).feed(data)
    assert len(found) == 19


def test_no_more_than_a_part_of_a_record_waits() -> None:
    stream = BoxStream(FULL)
    for _ in range(1000):
        stream.feed(b"\0" * (FULL.size - 1))
        assert stream.waiting < FULL.size


def test_the_first_record_of_a_connection_only_sets_the_time() -> None:
    stream = BoxStream(FULL)
    assert stream.feed(raw(time=1.0)) == []
    assert times(stream.feed(raw(time=1.1))) == [1.1]


# ---- what is not believed -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("field", FULL.fields, ids=lambda field: field.name)
def test_a_value_out_of_its_range_ends_the_stream(field: BoxField) -> None:
    name, low, high = field.name, field.low, field.high
    margin = 1e-3 * max(1.0, abs(high))
    for value in (low - margin, high + margin, math.inf, -math.inf):
        stream = begun()
        assert stream.feed(raw(**{name: value})) == []
        assert stream.broken.startswith(f"record 2: {name} ")
        assert stream.feed(raw(time=2.0)) == [], "nothing behind it is believed"


@pytest.mark.parametrize("field", FULL.fields, ids=lambda field: field.name)
def test_the_ends_of_a_range_are_allowed(field: BoxField) -> None:
    for value in (field.low, field.high):
        stream = BoxStream(FULL)
        just_inside = value * (1.0 - 1e-6)  # a float may round the end itself outwards
        stream.feed(raw(**{field.name: just_inside}))
        assert stream.records == 1
        assert stream.broken == ""


def test_degrees_in_place_of_radians_are_told() -> None:
    stream = BoxStream(FULL)
    assert stream.feed(raw(lat=52.679)) == []
    assert stream.broken == "record 1: lat 52.679 must be -1.5708 to 1.5708 rad"


def test_without_a_time_nothing_is_believed() -> None:
    stream = BoxStream(FULL)
    assert stream.feed(raw(time=math.nan)) == []
    assert "time nan" in stream.broken


@pytest.mark.parametrize("name", [field.name for field in FULL.fields[1:]])
def test_what_the_box_does_not_know_breaks_nothing(name: str) -> None:
    stream = begun()
    (record,) = stream.feed(raw(**{name: math.nan}))
    assert FULL.locates(record) == (name in ("roll", "pitch", "yaw", "battery"))
    assert stream.broken == ""


def test_a_box_without_a_fix_says_no_position() -> None:
    stream = begun()
    (record,) = stream.feed(raw(lat=0.0, lon=0.0))
    assert not FULL.locates(record)
    assert stream.broken == ""
    assert FULL.locates(stream.feed(raw(time=1.1))[0])


@pytest.mark.parametrize(
    ("second", "says"),
    [
        (99.9, "runs backwards"),
        (0.0, "runs backwards"),
        (100.0 + LEAP_S + 0.1, "must go on by"),
        (100.0 + 1e-5, "must go on by"),
    ],
)
def test_time_that_does_not_go_on_ends_the_stream(second: float, says: str) -> None:
    stream = BoxStream(FULL)
    found = stream.feed(raw(time=99.95) + raw(time=100.0) + raw(time=second) + raw(time=second + 0.1))
    assert times(found) == [100.0], "what came before is sound"
    assert says in stream.broken
    assert stream.broken.startswith("record 3: ")


def test_the_same_record_again_is_no_news() -> None:
    stream = begun()
    assert len(stream.feed(raw(time=5.0) * 3)) == 1
    assert (stream.records, stream.repeated, stream.broken) == (4, 2, "")


@pytest.mark.parametrize("shift", range(1, FULL.size))
def test_a_stream_that_begins_within_a_record_is_not_believed_for_long(shift: int) -> None:
    data = flight(30, 0.05)[shift:]
    stream = BoxStream(FULL)
    found = stream.feed(data)
    assert stream.broken
    assert found == []


@given(st.binary(max_size=600))
def test_garbage_never_raises(data: bytes) -> None:
    stream = BoxStream(FULL)
    for record in stream.feed(data):
        assert 0.0 <= record.time_s <= 1e11
        assert not abs(record.lat_deg) > 90.0
        assert not abs(record.lon_deg) > 180.0
    stream.feed(data)


def test_noise_in_one_record_ends_the_stream_sooner_or_later() -> None:
    """A byte too many, or too few: from there on nothing fits."""
    for at in range(0, 4 * FULL.size, 7):
        for changed in (flight(40)[:at] + b"\x5a" + flight(40)[at:], flight(40)[:at] + flight(40)[at + 1 :]):
            stream = BoxStream(FULL)
            found = stream.feed(changed)
            assert stream.broken, at
            assert len(found) <= at // FULL.size + 3


# ---- lateness -------------------------------------------------------------------------------------------------------


def test_what_comes_evenly_is_not_late_whatever_the_clocks_say() -> None:
    for offset_s in (-5e9, 0.0, 1000.0):
        lateness = Lateness()
        assert all(lateness.of(number * 0.1, number * 0.1 - offset_s) < 1e-5 for number in range(100))


def test_what_has_waited_is_late() -> None:
    lateness = Lateness()
    for number in range(50):
        lateness.of(10.0 + number * 0.1, 500.0 + number * 0.1)
    # two seconds in a buffer, and then all at once
    late = [lateness.of(15.0 + number * 0.1, 507.0) for number in range(21)]
    assert late[0] == pytest.approx(2.0, abs=0.05)
    assert late[-1] == pytest.approx(0.0, abs=0.05)


def test_clocks_that_go_apart_slowly_make_nothing_late() -> None:
    lateness = Lateness()
    for number in range(36_000):  # an hour, at a clock that is slow by 200 parts in a million
        late = lateness.of(number * 0.1, number * 0.1 * 1.0002)
        assert late < 0.01


def test_a_slow_drain_is_late_for_as_long_as_it_lasts() -> None:
    lateness = Lateness()
    lateness.of(0.0, 100.0)
    late = [lateness.of(0.1 * number, 100.0 + 0.2 * number) for number in range(1, 51)]
    assert late[-1] == pytest.approx(5.0, abs=0.05)
