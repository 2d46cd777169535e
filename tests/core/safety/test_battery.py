# SPDX-License-Identifier: GPL-3.0-or-later

"""What is left in the batteries: the least of all that they say, and what they say wrongly is named.

One pack of 100 Wh, three cells, motors that never draw more than 3600 W, which is 1 Wh a second, and by the settings
720 W to fly with, 0.2 Wh a second.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavproxy_handover.core.common.snapshot import PackMemory
from mavproxy_handover.core.safety.battery import Batteries, PackReport, rest_part

FULL = PackReport(used_wh=0.0, used_mah=0.0, remaining=1.0, voltage_v=12.6, current_a=0.0)
#: in flight, a fifth drawn
FLYING = PackReport(used_wh=20.0, used_mah=1600.0, remaining=0.8, voltage_v=12.0, current_a=30.0)


def batteries(count: int = 1, cells: float | None = 3) -> Batteries:
    return Batteries(100.0, count, cells, 3600.0, 720.0)


def left(report: PackReport, *, cells: float | None = 3, on_ground: bool = True) -> float | None:
    """What is left by one report."""
    packs = batteries(cells=cells)
    packs.add_report(0, report, 10.0, on_ground)
    return packs.charge(10.0).left_wh


@pytest.mark.parametrize(
    ("cell_v", "part"),
    [(5.0, 1.0), (4.2, 1.0), (4.155, 0.95), (3.87, 0.6), (3.855, 0.55), (3.69, 0.1), (3.27, 0.0), (3.0, 0.0)],
)
def test_rest_voltage_of_a_cell(cell_v: float, part: float) -> None:
    assert rest_part(cell_v) == pytest.approx(part)


@pytest.mark.parametrize(
    ("report", "wh"),
    [
        (FULL, 100.0),
        (PackReport(used_wh=30.0), 70.0),
        (PackReport(used_mah=3000.0, voltage_v=12.0, current_a=30.0), 64.0),
        (PackReport(remaining=0.42), 42.0),
        # the lowest of them
        (PackReport(used_wh=30.0, remaining=0.65), 65.0),
        (PackReport(used_wh=40.0, remaining=0.65), 60.0),
        # the percentage stays at 0, the count goes on below it
        (PackReport(used_wh=120.0, remaining=0.0), 0.0),
        # half empty by its rest voltage of 3.84 V a cell, though it counts as full: good to a tenth of the pack
        (replace(FULL, voltage_v=11.52), 60.0),
        (replace(FULL, voltage_v=11.52, current_a=None), 60.0),
        # nothing that says it
        (PackReport(voltage_v=12.6, current_a=1.0), None),
        (PackReport(used_mah=100.0), None),
        (PackReport(), None),
        # what is no number, or none of a battery
        (PackReport(used_wh=nan, remaining=0.5), 50.0),
        (PackReport(used_wh=-1.0, remaining=0.5), 50.0),
        (PackReport(used_wh=inf, used_mah=-1.0, remaining=-0.01, voltage_v=0.0, current_a=-0.01), None),
        (PackReport(used_wh=10.0, remaining=1.01, voltage_v=65.535 * 99), 90.0),
    ],
)
def test_what_is_left_by_one_report(report: PackReport, wh: float | None) -> None:
    assert left(report) == (None if wh is None else pytest.approx(wh))


def test_without_the_number_of_cells_the_voltage_has_no_say() -> None:
    assert left(replace(FULL, voltage_v=9.0), cells=None) == 100.0


def test_a_pack_that_counts_as_full_and_is_not_is_seen_on_the_ground() -> None:
    packs = batteries()
    packs.add_report(0, replace(FULL, voltage_v=11.52), 1.0, True)
    assert packs.charge(1.0).trouble == ("battery 0 counts 100.0 Wh, its rest voltage 11.52 V says 60.0 Wh at most",)
    # what is drawn in flight is taken off what the voltage said
    packs.add_report(0, PackReport(used_wh=1.0, remaining=0.99, voltage_v=11.2, current_a=30.0), 4.0, False)
    assert packs.charge(4.0).left_wh == pytest.approx(59.0)


def test_under_load_the_voltage_is_made_up_for_by_the_resistance_that_the_take_off_showed() -> None:
    packs = batteries()
    packs.add_report(0, FULL, 0.0, True)
    # 0.6 V less at 30 A: 0.02 ohm
    packs.add_report(0, replace(FULL, used_wh=0.1, voltage_v=12.0, current_a=30.0), 1.0, False)
    assert packs.charge(1.0).trouble == ()
    # 10.71 V at 30 A is 11.31 V at rest, 3.77 V a cell: three tenths, and one for doubt
    for second in (100.0, 101.0, 102.0):
        packs.add_report(0, PackReport(used_wh=20.0, voltage_v=10.71, current_a=30.0), second, False)
    charge = packs.charge(102.0)
    assert charge.left_wh == pytest.approx(40.0)
    assert charge.trouble == ("battery 0 has 10.71 V under load: 40.0 Wh at most",)


@pytest.mark.parametrize(("volts", "wh"), [(10.0, 80.0), (9.8, 5.0)])
def test_with_no_resistance_known_only_an_empty_cell_has_a_say(volts: float, wh: float) -> None:
    assert left(replace(FLYING, voltage_v=volts), on_ground=False) == pytest.approx(wh)


def test_in_flight_nothing_grows_and_what_counts_back_is_named() -> None:
    packs = batteries(cells=None)
    packs.add_report(0, FLYING, 1.0, False)
    packs.add_report(0, replace(FLYING, used_wh=0.0, remaining=1.0), 2.0, False)
    charge = packs.charge(2.0)
    assert charge.left_wh == pytest.approx(80.0)
    assert charge.trouble == ("battery 0 counts back in flight",)
    # the new count is gone on with: 5 Wh more
    packs.add_report(0, replace(FLYING, used_wh=5.0, remaining=0.95), 62.0, False)
    assert packs.charge(62.0).left_wh == pytest.approx(75.0)


def test_on_the_ground_what_counts_back_is_another_pack() -> None:
    packs = batteries(cells=None)
    packs.add_report(0, replace(FLYING, current_a=0.0), 1.0, True)
    packs.add_report(0, FULL, 2.0, True)
    assert packs.charge(2.0).left_wh == 100.0
    assert packs.charge(2.0).trouble == ()


def test_a_new_pack_that_nobody_reset_the_count_for_holds_what_is_counted() -> None:
    packs = batteries()
    packs.add_report(0, replace(FLYING, current_a=0.0), 1.0, True)
    packs.add_report(0, replace(FLYING, current_a=0.0, voltage_v=12.6), 2.0, True)
    assert packs.charge(2.0).left_wh == pytest.approx(80.0)


def test_one_wild_value_is_not_believed_and_is_named() -> None:
    packs = batteries(cells=None)
    packs.add_report(0, FLYING, 1.0, False)
    packs.add_report(0, replace(FLYING, used_wh=20.1, remaining=0.1), 2.0, False)
    charge = packs.charge(2.0)
    # 12 V and 30 A for a second
    assert charge.left_wh == pytest.approx(79.9)
    assert charge.trouble == ("battery 0 says that 10.0 Wh are left after 80.0 Wh",)
    packs.add_report(0, replace(FLYING, used_wh=20.2), 3.0, False)
    assert packs.charge(3.0).left_wh == pytest.approx(79.8)
    assert packs.charge(3.0).trouble == ()


def test_what_is_said_three_times_is_believed() -> None:
    packs = batteries(cells=None)
    packs.add_report(0, FLYING, 1.0, False)
    found = []
    for second in (2.0, 3.0, 4.0):
        packs.add_report(0, replace(FLYING, remaining=0.1), second, False)
        found.append(packs.charge(second).left_wh)
    assert found == pytest.approx([79.9, 79.8, 10.0])


def test_a_fall_that_the_motors_can_cause_is_believed_at_once() -> None:
    packs = batteries(cells=None)
    packs.add_report(0, FLYING, 1.0, False)
    packs.add_report(0, replace(FLYING, used_wh=32.0, remaining=0.68), 11.0, False)
    assert packs.charge(11.0).left_wh == pytest.approx(68.0)
    assert packs.charge(11.0).trouble == ()


def test_a_silent_pack_draws_on_as_it_last_did_and_is_named() -> None:
    packs = batteries(cells=None)
    packs.add_report(0, FLYING, 0.0, False)
    # 360 W: 0.1 Wh a second
    assert packs.charge(5.0).left_wh == pytest.approx(79.5)
    assert packs.charge(5.0).trouble == ()
    assert packs.charge(100.0).left_wh == pytest.approx(70.0)
    assert packs.charge(100.0).trouble == ("battery 0 has been silent for 100 s",)
    assert packs.charge(1e6).left_wh == 0.0


def test_values_that_stop_coming_are_gone_on_with_by_the_power() -> None:
    packs = batteries(cells=None)
    packs.add_report(0, FLYING, 0.0, False)
    packs.add_report(0, PackReport(voltage_v=12.0, current_a=30.0), 10.0, False)
    assert packs.charge(10.0).left_wh == pytest.approx(79.0)
    packs.add_report(0, PackReport(), 20.0, False)
    assert packs.charge(20.0).left_wh == pytest.approx(78.0)


@pytest.mark.parametrize("amperes", [None, 0.0])
def test_a_last_report_without_a_current_is_none_of_a_pack_that_draws_nothing(amperes: float | None) -> None:
    """The fault: a silent pack drew nothing any more, because its last report had not said how much."""
    packs = batteries(cells=None)
    packs.add_report(0, FLYING, 0.0, False)
    packs.add_report(0, replace(FLYING, used_wh=20.1, current_a=amperes), 1.0, False)
    assert packs.charge(101.0).left_wh == pytest.approx(69.9)


def test_a_pack_that_never_said_what_it_draws_draws_what_flying_takes() -> None:
    packs = batteries(cells=None)
    packs.add_report(0, PackReport(remaining=0.8, voltage_v=12.0), 0.0, False)
    assert packs.charge(100.0).left_wh == pytest.approx(60.0)
    assert packs.charge(100.0, on_ground=True).left_wh == pytest.approx(80.0)


def test_two_silent_packs_share_what_flying_takes() -> None:
    packs = batteries(2, cells=None)
    for number in (0, 1):
        packs.add_report(number, PackReport(remaining=0.8), 0.0, False)
    assert packs.charge(100.0).left_wh == pytest.approx(60.0)


def test_what_it_drew_on_the_ground_is_not_what_it_draws_in_the_air() -> None:
    packs = batteries(cells=None)
    packs.add_report(0, replace(FULL, current_a=3.0), 0.0, True)
    assert packs.charge(100.0, on_ground=True).left_wh == pytest.approx(98.95)
    assert packs.charge(100.0).left_wh == pytest.approx(80.0)


def test_a_percentage_alone_is_counted_by_itself_and_gone_on_with_when_it_stops_coming() -> None:
    """The fault: with neither counters nor a current it stayed at the last percentage, and nobody was told."""
    packs = batteries(cells=None)
    for second, part in ((0.0, 0.8), (60.0, 0.79), (120.0, 0.8), (180.0, 0.78)):
        packs.add_report(0, PackReport(remaining=part), second, False)
    assert packs.charge(180.0).left_wh == pytest.approx(77.0)
    packs.add_report(0, PackReport(voltage_v=12.0), 190.0, False)
    assert packs.charge(190.0).left_wh == pytest.approx(75.0)


def test_of_two_packs_the_emptier_one_counts_for_both() -> None:
    packs = batteries(2)
    packs.add_report(0, replace(FULL, used_wh=5.0), 1.0, True)
    packs.add_report(1, replace(FULL, used_wh=20.0), 1.0, True)
    assert packs.charge(1.0).left_wh == pytest.approx(60.0)
    assert packs.charge(1.0).power_w == 0.0


def test_a_pack_that_nobody_hears_holds_nothing() -> None:
    packs = batteries(2)
    assert packs.charge(1.0).left_wh is None
    assert packs.charge(1.0).trouble == ("no battery is heard",)
    packs.add_report(1, FULL, 1.0, True)
    assert packs.charge(1.0).left_wh == 50.0
    assert packs.charge(1.0).trouble == ("1 of 2 batteries are not heard",)


def test_batteries_that_fly_nothing_are_not_counted() -> None:
    packs = batteries()
    for number in (1, 7, -1, 255):
        packs.add_report(number, FULL, 1.0, True)
    assert packs.charge(1.0).left_wh is None


def test_power_is_voltage_times_current_of_all_packs() -> None:
    packs = batteries(2)
    packs.add_report(0, FLYING, 1.0, False)
    packs.add_report(1, replace(FLYING, current_a=20.0), 1.0, False)
    assert packs.charge(1.0).power_w == pytest.approx(600.0)
    packs.add_report(1, replace(FLYING, current_a=None), 2.0, False)
    assert packs.charge(2.0).power_w is None, "half of it is not all of it"


# ---- a restart in flight ------------------------------------------------------------------------------------------

#: counts as full, half empty by its rest voltage; at 30 A it has 0.6 V less: 0.02 ohm
HALF = replace(FULL, voltage_v=11.52)
TOOK_OFF = PackReport(used_wh=1.0, remaining=0.99, voltage_v=10.92, current_a=30.0)


def aloft() -> Batteries:
    """In flight with a pack that is less full than it counts."""
    packs = batteries()
    packs.add_report(0, HALF, 1.0, True)
    packs.add_report(0, TOOK_OFF, 4.0, False)
    assert packs.charge(4.0).left_wh == pytest.approx(59.0)
    return packs


def restarted(before: Batteries, now: float) -> Batteries:
    packs = batteries()
    packs.resume(before.memory, now)
    return packs


def test_what_the_rest_voltage_said_outlives_a_restart_in_flight() -> None:
    """The fault: after it the pack held what it counted, 98 Wh."""
    before = aloft()
    packs = restarted(before, 10.0)
    later = replace(TOOK_OFF, used_wh=2.0, remaining=0.98, voltage_v=10.9)
    for each in (before, packs):
        each.add_report(0, later, 11.0, False)
        assert each.charge(11.0).left_wh == pytest.approx(58.0)
    assert packs.charge(11.0).trouble == ()


def test_and_so_does_the_resistance_that_the_take_off_showed() -> None:
    packs = batteries()
    packs.add_report(0, FULL, 0.0, True)
    packs.add_report(0, replace(FULL, used_wh=0.1, voltage_v=12.0, current_a=30.0), 1.0, False)
    # more of it shows a moment later, with next to nothing drawn meanwhile
    packs.add_report(0, replace(FULL, used_wh=0.2, voltage_v=11.7, current_a=30.0), 2.0, False)
    packs = restarted(packs, 100.0)
    packs.add_report(0, PackReport(used_wh=20.0, voltage_v=10.41, current_a=30.0), 101.0, False)
    assert packs.charge(101.0).left_wh == pytest.approx(40.0)


def test_what_has_been_drawn_meanwhile_is_no_jump() -> None:
    packs = restarted(aloft(), 300.0)
    packs.add_report(0, replace(TOOK_OFF, used_wh=31.0, remaining=0.69), 301.0, False)
    assert packs.charge(301.0).left_wh == pytest.approx(29.0)
    assert packs.charge(301.0).trouble == ()


def test_over_a_restart_what_is_left_does_not_grow_when_the_count_begins_anew() -> None:
    before = batteries(cells=None)
    before.add_report(0, replace(FLYING, used_wh=40.0, remaining=0.6), 1.0, False)
    packs = restarted(before, 2.0)
    packs.add_report(0, replace(FLYING, used_wh=0.5, remaining=1.0), 3.0, False)
    assert packs.charge(3.0).left_wh == pytest.approx(60.0)
    packs.add_report(0, replace(FLYING, used_wh=5.5, remaining=0.95), 63.0, False)
    assert packs.charge(63.0).left_wh == pytest.approx(55.0)


def test_until_it_is_heard_again_it_draws_what_flying_takes_and_is_named() -> None:
    packs = restarted(aloft(), 10.0)
    assert packs.charge(110.0).left_wh == pytest.approx(39.0)
    assert packs.charge(110.0).trouble == ("battery 0 has been silent for 100 s",)


def test_found_on_the_ground_it_is_another_flight() -> None:
    packs = restarted(aloft(), 10.0)
    packs.add_report(0, FULL, 11.0, False)
    assert packs.charge(11.0).left_wh == pytest.approx(59.0), "its first report came before it was known to be disarmed"
    packs.add_report(0, FULL, 12.0, True)
    assert packs.charge(12.0).left_wh == 100.0
    assert packs.memory == ()
    packs.add_report(0, replace(FULL, used_wh=1.0, voltage_v=12.4, current_a=30.0), 14.0, False)
    assert packs.charge(14.0).left_wh == pytest.approx(99.0)


def test_what_was_taken_up_is_there_for_the_next_restart_before_anything_is_heard() -> None:
    kept = (PackMemory(59.0, 1.0, 60.0, pytest.approx(0.02)),)
    assert aloft().memory == kept
    assert restarted(restarted(aloft(), 10.0), 11.0).memory == kept


@pytest.mark.parametrize("kept", [(), (PackMemory(),), (PackMemory(ohm=0.02, used_wh=50.0),)])
def test_of_a_pack_of_which_nothing_was_known_nothing_is_taken_up(kept: tuple[PackMemory, ...]) -> None:
    packs = batteries()
    packs.resume(kept, 1.0)
    assert packs.charge(1.0).trouble == ("no battery is heard",)
    packs.add_report(0, FLYING, 2.0, False)
    assert packs.charge(2.0).left_wh == pytest.approx(80.0)


def test_what_was_kept_of_more_or_fewer_packs_holds_for_those_there_are() -> None:
    memory = PackMemory(30.0, 10.0)
    for count, wh in ((1, 30.0), (2, 60.0)):
        packs = batteries(count)
        packs.resume((memory,) * 2 if count == 1 else (memory,), 1.0)
        for number in range(count):
            packs.add_report(number, PackReport(used_wh=10.0), 2.0, False)
        assert packs.charge(2.0).left_wh == pytest.approx(wh)


def test_it_is_kept_in_flight_alone_and_seldom_anew() -> None:
    """Each time is one of the disk's."""
    packs = batteries()
    packs.add_report(0, FULL, 0.0, True)
    assert packs.memory == ()
    kept = []
    for second in range(1, 901):
        drawn = second * 0.1
        volts = 12.6 - drawn * 0.02 - 0.6 - 0.05 * (second % 3)
        packs.add_report(0, PackReport(drawn, None, 1.0 - drawn / 100.0, volts, 30.0), float(second), False)
        if not kept or packs.memory != kept[-1]:
            kept.append(packs.memory)
    assert len(kept) <= 30
    left = packs.charge(900.0).left_wh
    assert left is not None
    assert kept[-1][0].left_wh is not None
    assert left <= kept[-1][0].left_wh <= left + 5.0
    packs.add_report(0, replace(FULL, used_wh=90.0, voltage_v=11.0), 901.0, True)
    assert packs.memory == ()


anything = st.one_of(st.none(), st.floats(), st.floats(0.0, 1.0), st.floats(0.0, 100.0))
reports = st.builds(PackReport, anything, anything, anything, anything, anything)


@pytest.mark.slow
@given(st.lists(st.tuples(reports, st.booleans(), st.floats(0.0, 100.0)), max_size=12))
def test_whatever_is_said_nothing_raises_and_nothing_is_negative_or_more_than_full(
    said: list[tuple[PackReport, bool, float]],
) -> None:
    packs = batteries()
    now = 0.0
    for report, on_ground, seconds in said:
        now += seconds
        packs.add_report(0, report, now, on_ground)
        wh = packs.charge(now).left_wh
        assert wh is None or 0.0 <= wh <= 100.0


@pytest.mark.slow
@given(st.lists(st.tuples(reports, st.floats(0.0, 100.0)), min_size=1, max_size=12))
def test_in_flight_what_is_left_never_grows(said: list[tuple[PackReport, float]]) -> None:
    packs = batteries()
    now, before = 0.0, 100.0
    for report, seconds in said:
        now += seconds
        packs.add_report(0, report, now, False)
        wh = packs.charge(now).left_wh
        if wh is not None:
            assert wh <= before
            before = wh


@pytest.mark.slow
@given(st.lists(st.tuples(reports, st.floats(0.0, 100.0), st.booleans()), min_size=1, max_size=12))
def test_nor_over_a_restart_by_more_than_a_twentieth(said: list[tuple[PackReport, float, bool]]) -> None:
    packs = batteries()
    now, before = 0.0, 100.0
    for report, seconds, restarts in said:
        now += seconds
        if restarts:
            packs = restarted(packs, now)
        packs.add_report(0, report, now, False)
        wh = packs.charge(now).left_wh
        if wh is not None:
            assert wh <= before + 5.0
            before = min(wh, before)
