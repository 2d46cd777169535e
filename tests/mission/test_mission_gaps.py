# SPDX-License-Identifier: GPL-3.0-or-later

"""Declared gaps: what is read and refused, where they are on the route, how long they take, what the check says."""

from __future__ import annotations

import math

import pytest

from mavproxy_handover.core.safety.energy import Wind
from mavproxy_handover.mission import MissionError, load
from mavproxy_handover.mission.check import Severity, check
from mavproxy_handover.mission.check_text import report_text
from mavproxy_handover.mission.picture import draw

#: between the zones of A (to 10.002) and B (from 10.003): 111.3 m, 22 s at 5 m/s
DECLARED = '\n[[gap]]\nfrom = "A"\nto = "B"\nlimit_s = 60\nnote = "behind the ridge"\n'


def move_zones(small, *bounds):
    for feature, (west, east) in zip(small.zones["features"], bounds, strict=True):
        feature["geometry"]["coordinates"] = [small.box(west, east)]


@pytest.fixture
def gappy(small):
    """The small mission with a hole in the middle of its leg, which it declares."""
    move_zones(small, (10.0, 10.002), (10.003, 10.006))
    small.toml += DECLARED
    return small


def refusal(small) -> str:
    with pytest.raises(MissionError) as caught:
        load(small.write())
    return str(caught.value)


def texts(small, severity, **options):
    report = check(load(small.write()), **options)
    return [finding.text for finding in report.findings if finding.severity is severity]


# --- reading ---


def test_what_is_declared_is_read(gappy):
    (gap,) = load(gappy.write()).gaps
    assert (gap.from_station, gap.to_station, gap.to_item, gap.limit_s) == (251, 252, None, 60.0)
    assert (gap.words, gap.note) == ("A -> B", "behind the ridge")


def test_a_mission_without_gaps_has_none(small):
    package = load(small.write())
    assert (package.gaps, package.stretches(package.simulate())) == ((), ())


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('from = "A"\n', "", "mission.toml: gap 1: key 'from' is missing"),
        ('to = "B"\n', "", "mission.toml: gap 1: key 'to' is missing"),
        ("limit_s = 60\n", "", "mission.toml: gap 1: key 'limit_s' is missing"),
        ('from = "A"', 'from = "C"', "mission.toml: gap 1: from is 'C' (allowed: A, B)"),
        ('from = "A"', "from = 3", "mission.toml: gap 1: from is 3 (allowed: A, B)"),
        ('to = "B"', 'to = "b"', "mission.toml: gap 1: to is 'b' (allowed: A, B)"),
        ('to = "B"', "to = 4", "mission.toml: gap 1: to is 4 (allowed: a whole number from 1 to 3)"),
        ('to = "B"', "to = true", "mission.toml: gap 1: to is true (allowed: a whole number from 1 to 3)"),
        ("limit_s = 60", "limit_s = 0", "mission.toml: gap 1: limit_s is 0 (allowed: a number from 1 to 600)"),
        ("limit_s = 60", "limit_s = 601", "mission.toml: gap 1: limit_s is 601 (allowed: a number from 1 to 600)"),
        ("limit_s = 60", "limit_s = nan", "mission.toml: gap 1: limit_s is nan (allowed: a number from 1 to 600)"),
        ("limit_s = 60", "limit = 60", "mission.toml: gap 1: unknown key 'limit', did you mean 'limit_s'?"),
        ("[[gap]]", "[gap]", "mission.toml: gap is a table (allowed: a list)"),
        ('note = "behind the ridge"', 'note = ""', "mission.toml: gap 1: note is ''"),
    ],
)
def test_what_is_wrong_is_named(gappy, old, new, text):
    gappy.toml = gappy.toml.replace(old, new)
    assert refusal(gappy).startswith(text)


def test_an_item_that_is_not_flown_to_is_no_end(gappy):
    gappy.items.insert(2, gappy.item(3, 178, 0, 0, 0, 1))
    gappy.toml = gappy.toml.replace('to = "B"', "to = 3")
    assert "gap 1: to 3 is DO_CHANGE_SPEED (allowed: a station's name, or an item that is flown to)" in refusal(gappy)


def test_twice_the_same_is_one_too_many(gappy):
    gappy.toml += DECLARED
    assert refusal(gappy) == "mission.toml: gap 2: the gap A -> B is declared twice"


# --- on the route ---


def stretch(small, **options):
    package = load(small.write())
    (found,) = package.stretches(package.simulate(), **options)
    return found


def test_along_the_way_the_place_is_counted_from_the_border(gappy):
    found = stretch(gappy)
    assert found.found.length_m == pytest.approx(111.3, abs=0.2)
    assert found.along_m(2, 0.0, 10.002) == pytest.approx(0.0, abs=0.2)
    assert found.along_m(2, 0.0, 10.0025) == pytest.approx(55.7, abs=0.2)
    assert found.along_m(2, 0.0, 10.0015) == pytest.approx(-55.7, abs=0.2)
    assert found.along_m(2, 0.0, 10.0035) == pytest.approx(167.0, abs=0.3)


def test_who_is_beside_the_way_or_flies_to_another_item_is_not_in_it(gappy):
    found = stretch(gappy)
    assert found.along_m(2, 0.0004, 10.0025) == pytest.approx(55.7, abs=0.2)  # 44 m
    assert found.along_m(2, 0.0005, 10.0025) is None  # 55 m
    assert found.along_m(1, 0.0, 10.0025) is None
    assert found.along_m(3, 0.0, 10.0025) is None
    assert found.along_m(2, math.nan, 10.0025) is None


def test_a_corner_in_the_gap_is_part_of_it(gappy):
    gappy.items.insert(1, gappy.item(2, 16, 0.0005, 10.0025, 30))
    gappy.items[2]["doJumpId"], gappy.items[3]["doJumpId"] = 3, 4
    found = stretch(gappy)
    corner = found.along_m(2, 0.0005, 10.0025)
    assert corner is not None
    assert found.along_m(3, 0.0005, 10.0025) == pytest.approx(corner)
    behind = found.along_m(3, 0.0004, 10.0026)
    assert behind is not None
    assert corner < behind < found.found.length_m


def test_the_time_is_counted_against_the_wind_that_is_not_known(gappy):
    # told 5 m/s; 10 m/s of airspeed and 3 m/s from ahead leave 7
    assert stretch(gappy).time_s == pytest.approx(111.3 / 5.0, abs=0.1)
    gappy.toml = gappy.toml.replace("[[stations]]", "cruise_speed_mps = 9.0\n\n[[stations]]", 1)
    assert stretch(gappy).time_s == pytest.approx(111.3 / 7.0, abs=0.1)
    assert stretch(gappy, wind=Wind(8.0, 90.0)).time_s == pytest.approx(111.3 / 2.0, abs=0.2)
    assert stretch(gappy, wind=Wind(8.0, 270.0)).time_s == pytest.approx(111.3 / 9.0, abs=0.1)
    assert stretch(gappy, wind=Wind(11.0, 90.0)).time_s == math.inf


def test_a_gap_to_an_item_is_the_one_that_ends_on_the_way_there(gappy):
    gappy.toml = gappy.toml.replace('to = "B"', "to = 2")
    assert stretch(gappy).declared.words == "A -> item 2"
    gappy.toml = gappy.toml.replace("to = 2", "to = 3")
    assert texts(gappy, Severity.ERROR)[0].startswith("no coverage for 111 m")


def test_a_landing_outside_every_zone_can_be_the_end(small):
    move_zones(small, (10.0, 10.004), (9.999, 10.001))
    small.toml = small.toml.replace("expected_handovers = 1", "expected_handovers = 0")
    small.toml += '\n[[gap]]\nfrom = "A"\nto = 3\nlimit_s = 120\n'
    found = stretch(small)
    assert found.found.length_m == pytest.approx(111.3, abs=0.2)
    assert found.along_m(3, 0.0, 10.005) == pytest.approx(111.3, abs=0.2)
    assert [text for text in texts(small, Severity.ERROR) if "gap" in text or "coverage" in text] == []


# --- the check ---


def test_a_declared_gap_is_no_error(gappy):
    report = check(load(gappy.write()))
    assert [f.text for f in report.findings if f.severity is not Severity.INFO] == []
    assert report.exit_code == 0
    assert [f.text for f in report.findings if f.text.startswith("gap")] == [
        "gap A -> B, alone for 111 m (22 s) from 0.00000 N 10.00200 E at 30 m, 111 m along the route, on the way to 2, "
        "at most 60 s: behind the ridge"
    ]
    assert "of the route; 1 gap crossed alone: HNDO_ALONE_MAX 60 or more\n" in report_text(report)


def test_one_that_takes_longer_than_its_limit_is_refused(gappy):
    gappy.toml = gappy.toml.replace("limit_s = 60", "limit_s = 20")
    assert texts(gappy, Severity.ERROR) == ["gap A -> B: it takes 22 s against the wind, its limit is 20 s"]
    gappy.toml = gappy.toml.replace("limit_s = 20", "limit_s = 23")
    assert texts(gappy, Severity.ERROR) == []
    assert texts(gappy, Severity.ERROR, wind=Wind(8.0, 90.0)) == [
        "gap A -> B: it takes 56 s against the wind, its limit is 23 s"
    ]
    assert texts(gappy, Severity.ERROR, wind=Wind(11.0, 90.0)) == ["gap A -> B: the wind does not let it be crossed"]


def test_one_that_is_not_there_is_an_error(small):
    small.toml += DECLARED
    assert texts(small, Severity.ERROR) == ["gap A -> B is declared, and the route has none there"]


def test_another_one_stays_an_error(gappy):
    gappy.toml = gappy.toml.replace('from = "A"\nto = "B"', 'from = "B"\nto = "A"')
    found = texts(gappy, Severity.ERROR)
    assert found[0].startswith("no coverage for 111 m")
    assert "gap B -> A is declared, and the route has none there" in found


def test_the_map_shows_it(gappy, tmp_path):
    path = tmp_path / "map.png"
    draw(load(gappy.write()), path)
    assert path.read_bytes().startswith(b"\x89PNG")
