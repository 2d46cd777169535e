# SPDX-License-Identifier: GPL-3.0-or-later

"""Which layout a box sends: each known one taken for the other, at a standstill and in motion, and what stays open."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.monitors.position.box_layout_watch import LayoutWatch, Verdict, rivals
from mavproxy_handover.monitors.position.cross_check import Place
from mavproxy_handover.wire.box_layout import FULL, THESIS, BoxField, BoxLayout, BoxRecord

NOISE = random.Random(5)
KNOWN = [(THESIS, FULL), (FULL, THESIS)]
NAMES = ["thesis", "full"]


def truth(
    heading_deg: float = 90.0,
    speed_mps: float = 0.0,
    *,
    climb_mps: float = 0.0,
    agl_m: float = 0.0,
    battery_v: float = 12.4,
    noise: float = 0.0,
) -> BoxRecord:
    """What a good box of any layout measures; it flies where it points to."""

    def measured(value: float) -> float:
        return value + NOISE.gauss(0.0, noise)

    north = measured(speed_mps * math.cos(math.radians(heading_deg)))
    east = measured(speed_mps * math.sin(math.radians(heading_deg)))
    return BoxRecord(
        1700000000.0,
        52.679,
        5.924,
        alt_m=12.0 + agl_m,
        north_mps=north,
        east_mps=east,
        down_mps=measured(-climb_mps),
        roll_rad=measured(0.0),
        pitch_rad=measured(-0.02 * speed_mps),
        heading_deg=measured(heading_deg) % 360.0,
        battery_v=battery_v,
        baro_m=75.0 + agl_m,
        agl_m=agl_m,
        track_deg=math.degrees(math.atan2(east, north)) % 360.0,
        speed_mps=math.hypot(north, east),
    )


def autopilots(record: BoxRecord) -> Place:
    """The autopilot's word of the same moment."""
    return Place(
        record.lat_deg,
        record.lon_deg,
        record.alt_m,
        record.north_mps,
        record.east_mps,
        record.down_mps,
        record.heading_deg,
    )


def watched(
    configured: BoxLayout, sent: BoxLayout, records: list[BoxRecord], *, own: bool = True, armed: bool = False
) -> LayoutWatch:
    watch = LayoutWatch(configured)
    for record in records:
        watch.judge(sent.pack(record), autopilots(record) if own else None, armed=armed)
    return watch


#: standing still, standing in noise, hovering, flying
SITUATIONS = {
    "standing, to the east": [truth(90.0)] * 20,
    "standing, to the south west": [truth(225.0)] * 20,
    "standing, in noise": [truth(100.0, noise=0.02) for _ in range(20)],
    "hovering at 30 m": [truth(40.0, agl_m=30.0, noise=0.05) for _ in range(20)],
    "flying at 10 m/s": [truth(200.0, 10.0, agl_m=40.0, noise=0.05) for _ in range(20)],
    "flying to the north": [truth(0.0, 5.0, agl_m=30.0, noise=0.02) for _ in range(20)],
    "climbing": [truth(10.0, climb_mps=2.5, agl_m=15.0, noise=0.05) for _ in range(20)],
    "flying at 80 m/s": [truth(135.0, 80.0, agl_m=300.0, noise=0.3) for _ in range(20)],
}
#: these the box alone can tell, too
CLEAR = [name for name in SITUATIONS if name not in ("flying to the north", "climbing")]


@pytest.mark.parametrize(("configured", "other"), KNOWN, ids=NAMES)
@pytest.mark.parametrize("situation", SITUATIONS)
@pytest.mark.parametrize("battery_v", [12.4, math.nan], ids=["battery", "no battery"])
def test_the_configured_layout_is_recognised_and_the_other_one_named(
    configured: BoxLayout, other: BoxLayout, situation: str, battery_v: float
) -> None:
    records = [replace(record, battery_v=battery_v) for record in SITUATIONS[situation]]
    right = watched(configured, configured, records)
    assert (right.verdict, right.known, right.words) == (Verdict.RECOGNISED, True, "")
    wrong = watched(configured, other, records)
    assert (wrong.verdict, wrong.known, wrong.likely) == (Verdict.OTHER, False, other)


@pytest.mark.parametrize(("configured", "other"), KNOWN, ids=NAMES)
@pytest.mark.parametrize("situation", CLEAR)
def test_without_the_autopilots_word_the_record_itself_tells(
    configured: BoxLayout, other: BoxLayout, situation: str
) -> None:
    assert watched(configured, configured, SITUATIONS[situation], own=False).verdict is Verdict.RECOGNISED
    assert watched(configured, other, SITUATIONS[situation], own=False).likely is other


def test_the_words_name_the_likely_layout_and_what_to_write() -> None:
    watch = watched(THESIS, FULL, SITUATIONS["standing, to the east"])
    assert watch.words == "sends layout 'full', not 'thesis' (set layout = \"full\" in [position])"
    watch = watched(FULL, THESIS, SITUATIONS["standing, to the east"])
    assert watch.words == "sends layout 'thesis', not 'full' (set layout = \"thesis\" in [position])"


def test_records_of_another_layout_are_counted_in_flight() -> None:
    watch = watched(THESIS, FULL, [truth()] * 30, armed=True)
    assert watch.counted == 26, "the first verdict takes five records"
    assert watch.count_words == " (26 records of another layout in flight)"
    assert watched(THESIS, THESIS, [truth()] * 30, armed=True).count_words == ""


def test_a_few_records_decide_nothing() -> None:
    watch = watched(THESIS, FULL, [truth()] * 4)
    assert (watch.verdict, watch.known) == (Verdict.UNDECIDED, False)
    assert watch.words == (
        "layout 'thesis' not recognised yet (the autopilot needs a position; or turn or move the aircraft)"
    )
    assert watched(THESIS, THESIS, [truth()] * 5).verdict is Verdict.RECOGNISED


def test_zeros_fit_every_layout_until_the_autopilot_knows_better_or_the_aircraft_is_turned() -> None:
    """Read as the thesis's, 12.4 V is a climb; nothing in the record says that there is none."""
    north = [truth(0.0)] * 20
    for configured in (THESIS, FULL):
        watch = watched(configured, FULL, north, own=False)
        assert (watch.verdict, watch.known, watch.misfit) == (Verdict.UNDECIDED, False, False)
    assert watched(FULL, FULL, north).verdict is Verdict.RECOGNISED
    assert watched(THESIS, FULL, north).likely is FULL
    turned = [*north, *[truth(30.0)] * 20]
    assert watched(FULL, FULL, turned, own=False).verdict is Verdict.RECOGNISED
    assert watched(THESIS, FULL, turned, own=False).likely is FULL


@pytest.mark.parametrize("own", [False, True])
def test_a_place_with_an_unknown_climb_is_a_voltage_that_is_not_known(own: bool) -> None:
    north = [truth(0.0, battery_v=math.nan)] * 5
    assert watched(FULL, FULL, north, own=own).verdict is Verdict.RECOGNISED
    assert watched(THESIS, FULL, north, own=own).likely is FULL


@pytest.mark.parametrize("configured", [THESIS, FULL], ids=NAMES)
def test_a_box_without_a_fix_is_no_other_layout(configured: BoxLayout) -> None:
    blind = BoxRecord(1700000000.0, 0.0, 0.0, heading_deg=90.0)
    for record in (blind, replace(blind, lat_deg=math.nan, lon_deg=math.nan)):
        assert watched(configured, configured, [record] * 20).verdict is not Verdict.OTHER


def test_the_partners_box_pointing_to_the_north_is_recognised_at_once() -> None:
    """No battery is empty: zeros where `full` has the voltage are a climb of nothing."""
    assert watched(THESIS, THESIS, [truth(0.0)] * 5).verdict is Verdict.RECOGNISED
    assert watched(FULL, THESIS, [truth(0.0)] * 5).likely is THESIS


def test_what_was_recognised_stays_so_until_another_one_fits() -> None:
    watch = watched(FULL, FULL, [*[truth(90.0)] * 20, *[truth(0.0)] * 40], own=False)
    assert (watch.verdict, watch.known, watch.words) == (Verdict.UNDECIDED, True, "")
    for _ in range(20):
        watch.judge(THESIS.pack(truth(90.0)), autopilots(truth(90.0)), armed=True)
    assert (watch.verdict, watch.known, watch.likely) == (Verdict.OTHER, False, THESIS)
    for _ in range(20):
        watch.judge(FULL.pack(truth(90.0)), autopilots(truth(90.0)), armed=True)
    assert (watch.verdict, watch.known, watch.likely) == (Verdict.RECOGNISED, True, None)


@pytest.mark.parametrize(("configured", "other"), KNOWN, ids=NAMES)
def test_a_few_bad_records_among_good_ones_change_nothing(configured: BoxLayout, other: BoxLayout) -> None:
    records = [truth(90.0)] * 20
    watch = watched(configured, configured, records)
    for raw in (other.pack(records[0]), b"\xff" * 56, b"\x5a" * 56):
        watch.judge(raw, autopilots(records[0]), armed=False)
        assert watch.known
        assert watch.likely is None


def test_another_layout_is_told_after_ten_records_in_flight() -> None:
    """A box whose records break the rules brings one record a connection: ten of them take some seconds."""
    flies = truth(200.0, 10.0, agl_m=40.0)
    watch = watched(THESIS, THESIS, [flies] * 100, armed=True)
    for _ in range(10):
        watch.judge(FULL.pack(flies), autopilots(flies), armed=True)
    assert watch.likely is FULL
    assert 1 <= watch.counted <= 4


def test_a_box_that_drifts_is_no_other_layout() -> None:
    """The autopilot flies at 5 m/s, and the box says 4 m/s more."""
    flies, says = truth(90.0, 5.0, agl_m=30.0), truth(90.0, 9.0, agl_m=30.0)
    watch = LayoutWatch(THESIS)
    for _ in range(40):
        watch.judge(THESIS.pack(says), autopilots(flies), armed=True)
        assert watch.verdict is not Verdict.OTHER
    assert watch.known


def test_a_compass_that_is_wrong_is_no_other_layout() -> None:
    says = replace(truth(90.0), heading_deg=270.0)
    watch = LayoutWatch(THESIS)
    for _ in range(20):
        watch.judge(THESIS.pack(says), autopilots(truth(90.0)), armed=False)
    assert watch.known


def test_a_record_that_fits_no_layout_is_told_so() -> None:
    """Ground speed in kilometres an hour, and nothing else wrong."""
    flies = truth(200.0, 10.0, agl_m=40.0)
    watch = watched(THESIS, THESIS, [replace(flies, speed_mps=36.0)] * 20)
    assert (watch.verdict, watch.known, watch.misfit) == (Verdict.UNDECIDED, False, True)
    assert watch.words == "sends neither layout 'thesis' nor another known one (compare with docs/position-box.md)"


# ---- a layout of one's own ------------------------------------------------------------------------------------------


def changed(name: str, **new: object) -> BoxLayout:
    """The thesis's layout with one field changed."""
    fields = (replace(field, **new) if field.name == name else field for field in THESIS.fields)  # type: ignore[arg-type]
    return BoxLayout("own", tuple(fields), 56)


def test_known_layouts_are_rivals_only_where_time_place_or_velocity_lie_elsewhere() -> None:
    assert rivals(THESIS) == (FULL,)
    assert rivals(FULL) == (THESIS,)
    assert rivals(changed("BaroHeight", meaning="alt")) == (FULL,), "a height cannot be told from another one"
    assert rivals(changed("EastVelocity", unit="kn")) == (THESIS, FULL)
    assert rivals(BoxLayout("longer", THESIS.fields, 60)) == ()


def test_a_layout_without_rivals_is_recognised_when_it_fits() -> None:
    longer = BoxLayout("longer", THESIS.fields, 60)
    assert watched(longer, longer, [truth()] * 5).known
    wrong = replace(truth(), speed_mps=30.0)
    assert not watched(longer, longer, [wrong] * 20).known


def test_a_box_of_the_thesis_with_a_layout_file_for_knots_is_found_out() -> None:
    knots = changed("EastVelocity", unit="kn")
    flies = [truth(90.0, 10.0, agl_m=40.0)] * 20
    assert watched(knots, THESIS, flies).likely is THESIS
    assert watched(THESIS, THESIS, flies).known


def test_a_field_that_is_not_there_costs_nothing() -> None:
    few = BoxLayout("few", tuple(field for field in THESIS.fields if field.meaning in ("time", "lat", "lon")), 56)
    more = (*few.fields, BoxField("vel_north", "vel_north", "float", "m/s", 24))
    own = BoxLayout("few", (*more, BoxField("vel_east", "vel_east", "float", "m/s", 28)), 56)
    flies = [truth(90.0, 10.0, agl_m=40.0)] * 20
    assert watched(own, own, [replace(each, heading_deg=math.nan) for each in flies]).verdict is not Verdict.OTHER


@given(st.lists(st.binary(min_size=56, max_size=56), max_size=40), st.booleans())
def test_any_bytes_are_judged_and_never_raise(records: list[bytes], own: bool) -> None:
    for layout in (THESIS, FULL):
        watch = LayoutWatch(layout)
        for raw in records:
            watch.judge(raw, autopilots(truth()) if own else None, armed=True)
        assert isinstance(watch.words, str)
        assert (watch.verdict is Verdict.OTHER) == (watch.likely is not None)
