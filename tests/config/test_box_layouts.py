# SPDX-License-Identifier: GPL-3.0-or-later

"""A file that says how the record of a position box is laid out: what it gives, and each mistake in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from mavproxy_handover.config.box_layouts import parse_layout
from mavproxy_handover.config.position import position_settings
from mavproxy_handover.config.toml import ConfigError
from mavproxy_handover.wire.box_layout import FULL, THESIS, BoxField

GOOD = """\
name = "acme"
size = 26
byte_order = "big"

[[field]]
field = "vel_east"
type = "int16"
unit = "cm/s"
offset = 22

[[field]]
field = "time"
type = "double"
unit = "s"
offset = 0

[[field]]
field = "lat"
type = "int32"
unit = "1e-7 deg"
offset = 8

[[field]]
field = "lon"
type = "int32"
unit = "1e-7 deg"
offset = 12

[[field]]
field = "vel_north"
type = "float"
unit = "kn"
offset = 16
"""
FILE = Path("acme.toml")


def mistake(text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_layout(text.encode(), FILE)
    return str(caught.value)


def test_what_such_a_file_gives() -> None:
    layout = parse_layout(GOOD.encode(), FILE)
    assert (layout.name, layout.size, layout.format) == ("acme", 26, ">diif2xh2x")
    assert [field.meaning for field in layout.fields] == ["time", "lat", "lon", "vel_north", "vel_east"]
    assert layout.fields[4] == BoxField(
        "vel_east", "vel_east", "int16", "cm/s", 22, "velocity over ground, to the east"
    )
    assert layout.needed == ("lat_deg", "lon_deg", "north_mps", "east_mps")
    shorter = GOOD.replace('name = "acme"\nsize = 26\nbyte_order = "big"\n', "")
    assert parse_layout(shorter.encode(), FILE).format == "<diif2xh"
    assert parse_layout(shorter.encode(), FILE).name == "acme", "of the file"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('name = "acme"', 'name = "full"', "[layout] name: 'full' is the name of a known layout: choose another one"),
        ('name = "acme"', 'name = ""', "[layout] name: '' must be 1 to 20 printable ASCII characters"),
        ('name = "acme"', "nam = 1", "[layout] nam: unknown key; did you mean 'name'?"),
        ("size = 26", "size = 20", "[layout] size: 20 must be 24 to 512 bytes: vel_east ends at 24"),
        ("size = 26", "size = 513", "[layout] size: 513 must be 24 to 512 bytes: vel_east ends at 24"),
        ("size = 26", "size = 24.5", "[layout] size: 24.5 must be a whole number"),
        (
            'byte_order = "big"',
            'byte_order = "middle"',
            "[layout] byte_order: 'middle': it must be one of little, big",
        ),
        (
            'field = "lat"',
            'field = "latt"',
            "[field 3] field: 'latt': did you mean 'lat'? it must be one of time, lat,",
        ),
        ('field = "lat"', "", "[field 3] field: is missing; it must be a text"),
        ('unit = "kn"', "", "[field 5] unit: is missing; it must be a text"),
        (
            'unit = "kn"',
            'unit = "knots"',
            "[field 5] unit: 'knots': it must be one of m/s, cm/s, mm/s, km/h, kn",
        ),
        ('unit = "kn"', 'unit = "rad"', "[field 5] unit: 'rad': it must be one of m/s, cm/s, mm/s, km/h, kn"),
        ('type = "int16"', 'type = "short"', "[field 1] type: 'short': it must be one of double, float, int8,"),
        ('type = "double"', 'type = "float"', "[field 2] type: 'float' is too coarse for the time; it must be double,"),
        ("offset = 12", "offset = 10", "[field 4] offset: 10 of lon overlaps: lat takes bytes 8 to 11"),
        ("offset = 12", "offset = 11", "[field 4] offset: 11 of lon overlaps: lat takes bytes 8 to 11"),
        ("offset = 0", "offset = -1", "[field 2] offset: -1 must be 0 to 504"),
        ("offset = 22", "offset = 511", "[field 1] offset: 511 must be 0 to 510"),
        ("offset = 0", "", "[field 2] offset: is missing; it must be a whole number"),
        ("offset = 0", "ofset = 0", "[field 2] ofset: unknown key; did you mean 'offset'?"),
        ('field = "lon"', 'field = "lat"', "[field 4] field: 'lat': there is 'lat' already; delete one of the two"),
        ('field = "lon"', 'field = "alt"\nunit = "m"', "not valid TOML"),
        ("[[field]]", "[field]", "not valid TOML"),
    ],
)
def test_a_mistake_is_one_line_that_names_file_place_and_next_step(old: str, new: str, says: str) -> None:
    assert old in GOOD
    said = mistake(GOOD.replace(old, new, 1))
    assert said.startswith(f"acme.toml: {says}")
    assert "\n" not in said


@pytest.mark.parametrize("meaning", ["time", "lat", "lon", "vel_north", "vel_east"])
def test_what_is_missing_is_named_with_what_to_add(meaning: str) -> None:
    parts = GOOD.split("[[field]]\n")
    text = "[[field]]\n".join(part for part in parts if f'field = "{meaning}"' not in part)
    assert mistake(text.replace("size = 26\n", "")) == (
        f'acme.toml: {meaning} is missing: add a [[field]] with field = "{meaning}"; docs/position-box.md has a sample'
    )


def test_up_and_down_are_the_same_thing_twice() -> None:
    one = '\n[[field]]\nfield = "{}"\ntype = "float"\nunit = "m/s"\noffset = {}\n'
    text = GOOD.replace("size = 26", "size = 40") + one.format("vel_up", 26) + one.format("vel_down", 30)
    assert mistake(text) == "acme.toml: [field 7] field: 'vel_down': there is 'vel_up' already; delete one of the two"


def test_an_empty_file_says_what_is_missing() -> None:
    assert mistake("").startswith("acme.toml: time is missing: add a [[field]]")
    assert mistake("field = 3").startswith("acme.toml: [field] must be written [[field]], once for each")


# ---- the vehicle's file names it ------------------------------------------------------------------------------------


def test_the_layout_is_the_thesiss_unless_another_one_is_named(tmp_path: Path) -> None:
    path = tmp_path / "vehicle.toml"
    assert position_settings({}, path).layout is THESIS
    assert position_settings({"position": {"layout": "thesis"}}, path).layout is THESIS
    assert position_settings({"position": {"layout": "full"}}, path).layout is FULL
    assert position_settings({}, path).layout_file is None


def test_a_layouts_file_is_relative_to_the_vehicles(tmp_path: Path) -> None:
    (tmp_path / "acme.toml").write_text(GOOD)
    settings = position_settings({"position": {"layout": "acme.toml"}}, tmp_path / "vehicle.toml")
    assert (settings.layout.name, settings.layout_file) == ("acme", tmp_path / "acme.toml")
    assert settings.layout_text == GOOD.encode()


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("none.toml", "none.toml: no such file"),
        (
            "Thesis",
            "[position] layout: 'Thesis' must be one of thesis, full, or a layout's file, which ends with .toml",
        ),
        (3, "[position] layout: 3 must be a text"),
    ],
)
def test_a_layout_that_is_nowhere_is_told(tmp_path: Path, word: object, says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        position_settings({"position": {"layout": word}}, tmp_path / "vehicle.toml")
    assert says in str(caught.value)


def test_the_sample_of_the_page_is_a_layout() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "position-box.md").read_text(encoding="utf-8")
    (sample,) = [
        part.partition("```")[0] for part in page.split("```toml\n") if "[[field]]" in part.partition("```")[0]
    ]
    assert parse_layout(sample.encode(), Path("box-layout.toml")).name == "box-layout"
