# SPDX-License-Identifier: GPL-3.0-or-later

"""One pack, report by report: counters, rest voltage, load, jumps, and silence. The numbers are as in test_battery.py:
100 Wh, three cells, motors of 3600 W at most (1 Wh a second), 720 W to fly with (0.2 Wh a second)."""

from __future__ import annotations

from itertools import pairwise
from math import inf, nan

import pytest

from mavproxy_handover.core.common.snapshot import PackMemory
from mavproxy_handover.core.safety.battery import Batteries, PackReport, rest_part

#: 360 W, 0.1 Wh a second
FLYING = PackReport(used_wh=20.0, remaining=0.8, voltage_v=12.0, current_a=30.0)
REST = {
    3.27: 0.0,
    3.61: 0.05,
    3.69: 0.1,
    3.73: 0.2,
    3.77: 0.3,
    3.80: 0.4,
    3.84: 0.5,
    3.87: 0.6,
    3.95: 0.7,
    4.02: 0.8,
    4.11: 0.9,
    4.20: 1.0,
}


class Bench:
    def __init__(self, cells: float | None = 3) -> None:
        self.packs = Batteries(100.0, 1, cells, 3600.0, 720.0)

    def flies(self, now: float, report: PackReport) -> Bench:
        self.packs.add_report(0, report, now, False)
        return self

    def stands(self, now: float, report: PackReport) -> Bench:
        self.packs.add_report(0, report, now, True)
        return self

    def left(self, now: float) -> float | None:
        return self.packs.charge(now).left_wh

    def trouble(self, now: float) -> tuple[str, ...]:
        return self.packs.charge(now).trouble

    @property
    def ohm(self) -> float | None:
        return self.packs._packs[0]._ohm


def about(wh: float) -> object:
    return pytest.approx(wh, rel=0.0, abs=1e-9)


class TestValues:
    def test_each_row_of_the_rest_voltages_and_half_way_to_the_next(self) -> None:
        rows = list(REST.items())
        for volts, part in rows:
            assert rest_part(volts) == pytest.approx(part)
        for (low_v, low), (high_v, high) in pairwise(rows):
            assert rest_part((low_v + high_v) / 2) == pytest.approx((low + high) / 2)

    @pytest.mark.parametrize(
        ("name", "least", "most"),
        [
            ("used_wh", 0.0, 1e6),
            ("used_mah", 0.0, 1e8),
            ("remaining", 0.0, 1.0),
            ("voltage_v", 0.5, 1000.0),
            ("current_a", 0.0, 10_000.0),
        ],
    )
    def test_a_value_that_no_battery_has_is_not_known(self, name: str, least: float, most: float) -> None:
        for value, known in (
            (least, True),
            (least + 0.25, True),
            (most, True),
            (least - 0.01, False),
            (most + 0.5, False),
            (nan, False),
            (inf, False),
        ):
            assert getattr(PackReport(**{name: value}).sane(), name) == (value if known else None)

    def test_without_voltage_or_current_there_is_no_power(self) -> None:
        assert PackReport(voltage_v=12.0, current_a=3.0).power_w == 36.0
        assert PackReport(current_a=3.0).power_w is None
        assert PackReport(voltage_v=12.0).power_w is None


class TestCounting:
    def test_time_and_power_where_nothing_counts(self) -> None:
        bench = Bench().flies(10.0, PackReport(remaining=1.0, voltage_v=12.0, current_a=30.0))
        bench.flies(10.5, PackReport(voltage_v=12.0, current_a=30.0))
        assert bench.left(10.5) == about(99.95)

    def test_milliampere_hours_at_the_voltage_of_now(self) -> None:
        bench = Bench().flies(10.0, PackReport(used_mah=1000.0, voltage_v=12.0))
        bench.flies(20.0, PackReport(used_mah=1100.0, voltage_v=12.0))
        assert bench.left(20.0) == about(100.0 - 12.0 - 1.2)

    def test_without_a_voltage_they_say_nothing_and_the_time_counts(self) -> None:
        bench = Bench().flies(10.0, PackReport(used_mah=1000.0, voltage_v=12.0))
        bench.flies(20.0, PackReport(used_mah=1100.0))
        assert bench.left(20.0) == about(100.0 - 12.0 - 2.0)

    def test_a_measured_power_counts_more_than_a_percentage(self) -> None:
        report = PackReport(remaining=0.8, voltage_v=12.0, current_a=30.0)
        assert Bench().flies(10.0, report).flies(46.0, report).left(46.0) == about(76.4)

    def test_it_is_the_power_of_now(self) -> None:
        bench = Bench().flies(10.0, PackReport(remaining=0.8, voltage_v=12.0, current_a=30.0))
        bench.flies(46.0, PackReport(voltage_v=12.0, current_a=60.0))
        assert bench.left(46.0) == about(80.0 - 7.2)

    @pytest.mark.parametrize(
        ("before", "after", "back"),
        [
            (PackReport(used_wh=20.0), PackReport(used_wh=19.0), True),
            (PackReport(used_wh=20.0), PackReport(used_wh=20.0), False),
            (PackReport(used_wh=20.0, remaining=0.0), PackReport(used_wh=20.1, remaining=0.03), True),
            (PackReport(used_wh=20.0, remaining=0.0), PackReport(used_wh=20.1, remaining=0.02), False),
        ],
    )
    def test_a_counter_that_goes_back_in_flight_is_odd(self, before: PackReport, after: PackReport, back: bool) -> None:
        bench = Bench().flies(10.0, before).flies(11.0, after)
        assert bench.trouble(11.0) == (("battery 0 counts back in flight",) if back else ())


class TestSilence:
    def test_a_report_without_a_word_of_the_charge_goes_on_with_the_last_power_in_flight(self) -> None:
        bench = Bench().flies(10.0, FLYING).flies(46.0, PackReport())
        assert bench.left(46.0) == about(76.4)
        assert "battery 0 does not say what is left" not in bench.trouble(46.0)

    def test_a_pack_whose_counters_were_never_known_says_so(self) -> None:
        bench = Bench(None).flies(10.0, PackReport())
        assert bench.trouble(10.0) == ("battery 0 does not say what is left",)
        assert bench.left(10.0) is None

    def test_a_resumed_pack_without_counters_goes_on_to_empty(self) -> None:
        bench = Bench(None)
        bench.packs.resume((PackMemory(50.0, None, None, None),), 10.0)
        bench.flies(20.0, PackReport())
        assert bench.left(20.0) == about(48.0)
        bench.flies(2000.0, PackReport())
        assert bench.left(2000.0) == 0.0

    @pytest.mark.parametrize(("now", "silent"), [(15.0, ()), (15.5, ("battery 0 has been silent for 6 s",))])
    def test_it_is_told_after_five_seconds(self, now: float, silent: tuple[str, ...]) -> None:
        assert Bench().flies(10.0, FLYING).trouble(now) == silent

    @pytest.mark.parametrize(("current_a", "flies_w"), [(2.0, 24.0), (1.9, 720.0)])
    def test_two_amperes_are_a_power_to_fly_with(self, current_a: float, flies_w: float) -> None:
        bench = Bench().flies(10.0, PackReport(used_wh=20.0, voltage_v=12.0, current_a=current_a))
        assert bench.left(46.0) == about(80.0 - flies_w * 36.0 / 3600.0)

    def test_a_current_without_a_voltage_is_none(self) -> None:
        bench = Bench().flies(10.0, PackReport(used_wh=20.0, current_a=30.0))
        assert bench.left(46.0) == about(80.0 - 7.2)


class TestRestart:
    def test_after_the_flight_that_it_was_resumed_in_it_counts_anew(self) -> None:
        bench = Bench(None)
        bench.packs.resume((PackMemory(50.0, 50.0, None, None),), 10.0)
        assert bench.left(10.0) == 50.0
        bench.stands(20.0, PackReport(used_wh=30.0))
        assert bench.left(20.0) == about(70.0)
        bench.stands(21.0, PackReport())
        assert bench.packs.charge(21.0, on_ground=True).left_wh == about(70.0)

    def test_what_this_run_has_counted_it_keeps_after_the_landing(self) -> None:
        bench = Bench(None).flies(10.0, PackReport(used_wh=30.0)).stands(11.0, PackReport())
        assert bench.packs.charge(11.0, on_ground=True).left_wh == about(70.0)

    def test_the_memory_of_a_flight_is_of_its_last_step(self) -> None:
        bench = Bench().flies(10.0, FLYING)
        assert bench.packs.memory == (PackMemory(80.0, 20.0, None, None),)
        bench.flies(11.0, PackReport(used_wh=21.0, remaining=0.8, voltage_v=12.0, current_a=30.0))
        bench.flies(12.0, PackReport(used_wh=22.0, remaining=0.8, voltage_v=12.0, current_a=30.0))
        assert bench.packs.memory == (PackMemory(79.0, 21.0, None, None),)
        bench.stands(13.0, FLYING)
        assert bench.packs.memory == ()

    def test_a_resistance_of_the_run_before_is_kept_without_a_number_of_cells(self) -> None:
        bench = Bench(None)
        bench.packs.resume((PackMemory(80.0, 20.0, None, 0.01),), 10.0)
        bench.flies(11.0, FLYING)
        assert bench.packs.memory[0].ohm == 0.01


class TestJumps:
    JUMP = PackReport(used_wh=70.0, voltage_v=12.0, current_a=30.0)

    def test_a_fall_that_no_motor_can_draw_is_believed_the_third_time(self) -> None:
        bench = Bench(None).flies(10.0, PackReport(used_wh=20.0, voltage_v=12.0, current_a=30.0))
        lefts = []
        for now in (11.0, 12.0, 13.0):
            bench.flies(now, self.JUMP)
            lefts.append(bench.left(now))
        assert lefts == [about(79.9), about(79.8), about(30.0)]

    def test_a_good_report_in_between_begins_the_count_anew(self) -> None:
        good = PackReport(used_wh=21.0, voltage_v=12.0, current_a=30.0)
        bench = Bench(None).flies(10.0, PackReport(used_wh=20.0, voltage_v=12.0, current_a=30.0))
        for now, report in ((11.0, self.JUMP), (12.0, self.JUMP), (13.0, good), (14.0, self.JUMP), (15.0, self.JUMP)):
            bench.flies(now, report)
        assert bench.trouble(15.0)[0].startswith("battery 0 says that 30.0 Wh are left after ")

    def test_what_is_left_meanwhile_is_kept_for_the_next_run(self) -> None:
        bench = Bench(None).flies(10.0, PackReport(used_wh=20.0, voltage_v=12.0, current_a=30.0))
        bench.flies(70.0, PackReport(used_wh=95.0, voltage_v=12.0, current_a=30.0))
        assert bench.packs.memory[0].left_wh == about(74.0)


class TestRest:
    """On the ground, without a load, the voltage limits what is left."""

    LOW_V = 11.52  # half of the charge, and a tenth more is believed

    @pytest.mark.parametrize(("current_a", "wh"), [(None, 60.0), (1.9, 60.0), (2.0, 100.0), (30.0, 100.0)])
    def test_a_voltage_at_rest_is_one_below_two_amperes(self, current_a: float | None, wh: float) -> None:
        bench = Bench().stands(10.0, PackReport(used_wh=0.0, voltage_v=self.LOW_V, current_a=current_a))
        assert bench.packs.charge(10.0, on_ground=True).left_wh == about(wh)

    def test_in_flight_no_voltage_is_one_at_rest(self) -> None:
        bench = Bench().flies(10.0, PackReport(used_wh=0.0, voltage_v=self.LOW_V, current_a=0.5))
        assert bench.left(10.0) == about(100.0)

    def test_a_full_pack_that_was_counted_before_is_not_odd(self) -> None:
        bench = Bench().stands(10.0, PackReport(used_wh=30.0, voltage_v=12.6, current_a=0.0))
        assert bench.trouble(10.0) == ()


class TestLoad:
    """The first load after a rest shows the resistance; with it, the voltage under load has a say."""

    def loaded(self, after_s: float, current_a: float | None, volts: float = 11.7) -> Bench:
        bench = Bench().stands(10.0, PackReport(used_wh=0.0, voltage_v=12.0, current_a=0.0))
        return bench.flies(10.0 + after_s, PackReport(used_wh=0.1, voltage_v=volts, current_a=current_a))

    @pytest.mark.parametrize(
        ("after_s", "current_a", "ohm"),
        [
            (1.0, 30.0, 0.01),
            (60.0, 30.0, 0.01),
            (60.5, 30.0, None),
            (1.0, 5.0, 0.06),
            (1.0, 4.9, None),
            (1.0, None, None),
        ],
    )
    def test_five_amperes_within_a_minute(self, after_s: float, current_a: float | None, ohm: float | None) -> None:
        assert self.loaded(after_s, current_a).ohm == (None if ohm is None else pytest.approx(ohm))

    def test_no_more_than_three_hundredths_a_cell_are_believed(self) -> None:
        assert self.loaded(1.0, 5.0, volts=10.0).ohm == pytest.approx(0.09)

    def test_an_empty_cell_limits_what_is_left_without_a_resistance_or_counters(self) -> None:
        bench = Bench().flies(10.0, PackReport(voltage_v=9.8))
        assert bench.left(10.0) == about(5.0)
        assert bench.trouble(10.0) == ()

    @pytest.mark.parametrize(("used_wh", "odd"), [(94.0, True), (95.0, False)])
    def test_that_is_odd_when_the_counters_say_more(self, used_wh: float, odd: bool) -> None:
        bench = Bench().flies(10.0, PackReport(used_wh=used_wh, voltage_v=9.8))
        assert bench.trouble(10.0) == (("battery 0 has 9.80 V under load: 5.0 Wh at most",) if odd else ())

    def test_a_voltage_at_rest_is_none_under_load(self) -> None:
        bench = Bench().stands(10.0, PackReport(used_wh=0.0, voltage_v=9.8, current_a=0.0))
        assert bench.packs.charge(10.0, on_ground=True).left_wh == about(10.0)

    def test_without_a_current_the_resistance_says_nothing(self) -> None:
        bench = self.loaded(1.0, 30.0).flies(12.0, PackReport(used_wh=0.2, voltage_v=11.7))
        assert bench.left(12.0) == pytest.approx(86.943, abs=1e-3)

    def test_a_full_pack_under_load_is_full_and_no_more(self) -> None:
        bench = Bench().stands(10.0, PackReport(voltage_v=12.6, current_a=0.0))
        assert bench.flies(11.0, PackReport(voltage_v=12.3, current_a=30.0)).left(11.0) == about(100.0)

    @pytest.mark.parametrize(("volts", "wh"), [(3.3, None), (3.29, 5.0)])
    def test_a_cell_is_empty_below_three_point_three_volts(self, volts: float, wh: float | None) -> None:
        assert Bench(1).flies(10.0, PackReport(voltage_v=volts)).left(10.0) == (None if wh is None else about(wh))


class TestBeginnings:
    def test_a_counter_that_comes_later_is_counted_from_then_on(self) -> None:
        bench = Bench(None).flies(10.0, PackReport(remaining=0.8, voltage_v=12.0, current_a=30.0))
        bench.flies(46.0, PackReport(used_wh=5.0, remaining=0.8, voltage_v=12.0, current_a=30.0))
        assert bench.left(46.0) == about(76.4)

    def test_before_a_report_no_power_is_known(self) -> None:
        charge = Bench().packs.charge(10.0)
        assert (charge.left_wh, charge.power_w, charge.trouble) == (None, None, ("no battery is heard",))

    def test_of_two_packs_the_one_without_a_report_has_an_empty_memory(self) -> None:
        packs = Batteries(100.0, 2, None, 3600.0, 720.0)
        packs.add_report(0, PackReport(used_wh=20.0), 10.0, False)
        assert packs.memory == (PackMemory(30.0, 20.0, None, None), PackMemory())

    @pytest.mark.parametrize(("ohm", "kept"), [(0.0104, 0.0091), (0.0106, 0.0106)])
    def test_a_resistance_is_kept_in_steps_for_each_cell(self, ohm: float, kept: float) -> None:
        bench = Bench().flies(10.0, FLYING)
        for value in (0.0091, ohm):
            bench.packs._packs[0]._ohm = value
            bench.flies(10.0, FLYING)
        assert bench.packs.memory[0].ohm == kept
