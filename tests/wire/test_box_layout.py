# SPDX-License-Identifier: GPL-3.0-or-later

"""Layouts of a position box's record: the two known ones byte by byte, one of a user's own, and the page."""

from __future__ import annotations

import ctypes
import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.wire.box_layout import FULL, LAYOUTS, MEANINGS, REQUIRED, THESIS, UNITS, BoxField, BoxLayout
from mavproxy_handover.wire.box_record import BoxStream

#: listing 5.7, written out by hand: 2023-11-14 22:13:20.25 UTC; 52.596 N 5.931 E; 4 m/s to the east, 3 to the north
LISTING_5_7 = bytes.fromhex(
    "00 00 10 40 fc 54 d9 41"  # Time 1700000000.25 s
    "00 00 00 00 00 60 ed 3f"  # Latitude 0.91796875 rad
    "00 00 00 00 00 80 ba 3f"  # Longitude 0.103515625 rad
    "00 00 e1 42"  # BaroHeight 112.5 m
    "00 00 21 42"  # AglHeight 40.25 m
    "38 63 6d 3f"  # TrueTrack 0.9272952 rad
    "00 00 a0 3f"  # TrueHeading 1.25 rad
    "00 00 a0 40"  # GroundSpeed 5 m/s
    "00 00 80 40"  # EastVelocity 4 m/s
    "00 00 40 40"  # NorthVelocity 3 m/s
    "00 00 00 bf"  # UpVelocity -0.5 m/s
)
#: the record of before the listing was at hand
BEFORE = bytes.fromhex(
    "00 00 00 00 80 00 b0 40"  # time 4096.5 s
    "00 00 00 00 00 60 ed 3f"  # lat 0.91796875 rad
    "00 00 00 00 00 80 ba 3f"  # lon 0.103515625 rad
    "00 00 28 42"  # alt 42 m
    "00 00 40 40"  # vel_north 3 m/s
    "00 00 80 40"  # vel_east 4 m/s
    "00 00 00 bf"  # vel_up -0.5 m/s
    "00 00 00 3e"  # roll 0.125 rad
    "00 00 80 be"  # pitch -0.25 rad
    "00 00 a0 3f"  # yaw 1.25 rad
    "00 00 48 41"  # battery 12.5 V
)
#: whole numbers, the other order of bytes, bytes that nobody looks at, and the fewest fields
OWN = BoxLayout(
    "own",
    (
        BoxField("time", "time", "uint64", "ms", 2),
        BoxField("lat", "lat", "int32", "1e-7 deg", 10),
        BoxField("lon", "lon", "int32", "1e-7 deg", 14),
        BoxField("vel_north", "vel_north", "int16", "cm/s", 20),
        BoxField("vel_east", "vel_east", "int16", "cm/s", 22),
        BoxField("vel_down", "vel_down", "int16", "cm/s", 24),
        BoxField("heading", "heading", "uint16", "deg", 26),
    ),
    30,
    big_endian=True,
)


class DroneData(ctypes.LittleEndianStructure):
    """The structure of the listing, laid out by the compiler's rules, with padding where these want it."""

    _fields_ = (
        ("Time", ctypes.c_double),
        ("Latitude", ctypes.c_double),
        ("Longitude", ctypes.c_double),
        ("BaroHeight", ctypes.c_float),
        ("AglHeight", ctypes.c_float),
        ("TrueTrack", ctypes.c_float),
        ("TrueHeading", ctypes.c_float),
        ("GroundSpeed", ctypes.c_float),
        ("EastVelocity", ctypes.c_float),
        ("NorthVelocity", ctypes.c_float),
        ("UpVelocity", ctypes.c_float),
    )


# ---- byte by byte ---------------------------------------------------------------------------------------------------


def test_the_record_of_listing_5_7() -> None:
    assert (len(LISTING_5_7), THESIS.size, THESIS.format) == (56, 56, "<dddffffffff")
    record = THESIS.record(THESIS.struct.unpack(LISTING_5_7))
    assert record.time_s == 1700000000.25
    assert record.lat_deg == pytest.approx(52.59573509989979, abs=1e-12)
    assert record.lon_deg == pytest.approx(5.931008426158912, abs=1e-12)
    assert (record.baro_m, record.agl_m) == (112.5, 40.25)
    assert record.track_deg == pytest.approx(53.1301, abs=1e-4)
    assert record.heading_deg == pytest.approx(71.6197, abs=1e-4)
    assert (record.speed_mps, record.east_mps, record.north_mps, record.down_mps) == (5.0, 4.0, 3.0, 0.5)
    assert all(map(math.isnan, (record.alt_m, record.roll_rad, record.pitch_rad, record.battery_v)))
    assert THESIS.locates(record)


def test_listing_5_7_is_packed_byte_for_byte() -> None:
    assert THESIS.pack(THESIS.record(THESIS.struct.unpack(LISTING_5_7))) == LISTING_5_7


def test_the_structure_in_c_has_the_same_bytes() -> None:
    data = DroneData.from_buffer_copy(LISTING_5_7)
    assert ctypes.sizeof(DroneData) == THESIS.size
    assert [name for name, _ in DroneData._fields_] == [field.name for field in THESIS.fields]
    assert [getattr(DroneData, name).offset for name, _ in DroneData._fields_] == [f.offset for f in THESIS.fields]
    assert (data.Time, data.AglHeight, data.GroundSpeed, data.UpVelocity) == (1700000000.25, 40.25, 5.0, -0.5)


def test_the_record_of_before() -> None:
    assert (len(BEFORE), FULL.size, FULL.format) == (56, 56, "<dddffffffff")
    record = FULL.record(FULL.struct.unpack(BEFORE))
    assert (record.time_s, record.alt_m) == (4096.5, 42.0)
    assert (record.north_mps, record.east_mps, record.down_mps) == (3.0, 4.0, 0.5)
    assert (record.roll_rad, record.pitch_rad, record.battery_v) == (0.125, -0.25, 12.5)
    assert record.heading_deg == pytest.approx(71.6197, abs=1e-4)
    assert all(map(math.isnan, (record.baro_m, record.agl_m, record.track_deg, record.speed_mps)))
    assert FULL.locates(record)
    assert FULL.pack(record) == BEFORE


def test_a_layout_of_ones_own() -> None:
    raw = bytes.fromhex(
        "ee ee"  # nobody looks at these
        "00 00 01 8b cf e5 68 fa"  # 1700000000250 ms
        "1f 59 83 f8"  # 52.5960184 degrees
        "ff ff ff ff"  # -0.0000001 degrees
        "ee ee"
        "01 2c"  # 3 m/s to the north
        "fe 70"  # -4 m/s to the east
        "00 32"  # 0.5 m/s downwards
        "01 5e"  # 350 degrees
        "ee ee"
    )
    record = OWN.record(OWN.struct.unpack(raw))
    assert OWN.size == len(raw) == 30
    assert record.time_s == pytest.approx(1700000000.25, abs=1e-6)
    assert (record.lat_deg, record.lon_deg) == pytest.approx((52.5960184, -1e-7), abs=1e-12)
    assert (record.north_mps, record.east_mps, record.down_mps) == pytest.approx((3.0, -4.0, 0.5))
    assert record.heading_deg == pytest.approx(350.0)
    assert math.isnan(record.alt_m)
    assert OWN.locates(record)


# ---- what is no position --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("field", THESIS.fields, ids=lambda field: field.name)
def test_what_the_partners_box_may_leave_out(field: BoxField) -> None:
    whole = THESIS.record(THESIS.struct.unpack(LISTING_5_7))
    record = replace(whole, **{MEANINGS[field.meaning].into: math.nan})
    may = field.name in ("Time", "BaroHeight", "AglHeight", "TrueTrack", "TrueHeading", "GroundSpeed")
    assert THESIS.locates(record) == may  # without a time the stream is broken before


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"speed_mps": -0.01}, "GroundSpeed -0.01 must be 0 to 200 m/s"),
        ({"baro_m": -1001.0}, "BaroHeight -1001 must be -1000 to 20000 m"),
        ({"agl_m": 20_001.0}, "AglHeight 20001 must be -1000 to 20000 m"),
        ({"lat_deg": 91.0}, "Latitude 1.58825 must be -1.5708 to 1.5708 rad"),
        ({"down_mps": -201.0}, "UpVelocity 201 must be -200 to 200 m/s"),
    ],
)
def test_what_no_partners_box_can_mean(changed: dict[str, float], says: str) -> None:
    whole = THESIS.record(THESIS.struct.unpack(LISTING_5_7))
    assert THESIS.wrong(THESIS.struct.unpack(THESIS.pack(replace(whole, **changed)))) == says


@pytest.mark.parametrize("layout", [THESIS, FULL, OWN], ids=lambda layout: layout.name)
@given(data=st.binary(max_size=600))
def test_anything_is_read_or_breaks_the_stream_and_never_raises(layout: BoxLayout, data: bytes) -> None:
    stream = BoxStream(layout)
    for record in stream.feed(data):
        assert 0.0 <= record.time_s <= 1e11
        layout.locates(record)
    assert len(stream.last) in (0, layout.size)
    assert stream.waiting < layout.size


# ---- tables ---------------------------------------------------------------------------------------------------------


def test_every_layout_has_what_is_required() -> None:
    for layout in LAYOUTS.values():
        assert set(REQUIRED) <= {field.meaning for field in layout.fields}


# ---- the page for users ---------------------------------------------------------------------------------------------

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "position-box.md").read_text(encoding="utf-8")


def part(name: str) -> list[str]:
    return PAGE.partition(f"<!-- {name}:begin -->\n")[2].partition(f"<!-- {name}:end -->")[0].splitlines()


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=lambda layout: layout.name)
def test_the_page_has_the_table_of_each_layout(layout: BoxLayout) -> None:
    rows = ["| byte | field | type | unit | from | to | what it is |", "|---|---|---|---|---|---|---|"]
    for field in layout.fields:
        ends = f"{field.low:g} | {field.high:g}"
        rows.append(f"| {field.offset} | `{field.name}` | {field.type} | {field.unit} | {ends} | {field.says} |")
    assert part(layout.name) == rows
    assert f'"{layout.format}"' in PAGE


def test_the_page_has_what_a_field_of_ones_own_can_mean() -> None:
    rows = ["| field | units | from | to | what it is |", "|---|---|---|---|---|"]
    for name, meaning in MEANINGS.items():
        units = ", ".join(UNITS[meaning.quantity])
        needed = "; **required**" if name in REQUIRED else ""
        rows.append(f"| `{name}` | {units} | {meaning.low:g} | {meaning.high:g} | {meaning.says}{needed} |")
    assert part("fields") == rows


def test_the_page_has_the_listing_in_its_own_words() -> None:
    listing = [
        "    double Time;           // UTC Time [sec.nanosecs]",
        "    double Latitude;       // Latitude [rad]",
        "    double Longitude;      // Longitude [rad]",
        "    float BaroHeight;      // ISA-barometric height [m]",
        "    float AglHeight;       // AGL height (barometric) [m]",
        "    float TrueTrack;       // True track [rad]",
        "    float TrueHeading;     // True heading [rad]",
        "    float GroundSpeed;     // Ground speed [m/s]",
        "    float EastVelocity;    // West->east velocity [m/s]",
        "    float NorthVelocity;   // South->north velocity [m/s]",
        "    float UpVelocity;      // Down->up velocity [m/s]",
    ]
    assert "\n".join(listing) in PAGE
