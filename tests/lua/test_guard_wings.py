# SPDX-License-Identifier: GPL-3.0-or-later

"""What is different on wings: ladders, the ground, take-offs, landing sequences, failsafes that are over."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest

from tests.lua.numbers import PLANE_NUMBERS
from tests.lua.stub import (
    BY_BATTERY,
    BY_EKF,
    BY_FENCE,
    BY_GCS,
    BY_RC,
    BY_SCRIPT,
    FAILSAFE,
    LANDING,
    LOST,
    ORDERING,
    PILOT,
    PLANE,
    RETURNING,
    Bench,
)

CIRCLE, FBWA, AUTO, RTL, LOITER, TAKEOFF, GUIDED = 1, 5, 10, 11, 12, 13, 15
QHOVER, QLOITER, QLAND, QRTL, LOITER_ALT_QLAND, AUTOLAND = 18, 19, 20, 21, 25, 26
BY_RADIO, ARRIVED_VTOL, ARRIVED, FENCE_OVER, QRTL_AT_ONCE, AT_HEIGHT, RADIO_BACK, QLAND_AT_ONCE = (
    *(3, 39, 40, 43, 44, 46, 48, 49),
)
ENFORCING, ARMED, FLYING = 1, 2, 4


@pytest.fixture
def bench() -> Bench:
    return Bench(kind=PLANE)


def lost(bench: Bench, mode: int = AUTO, reason: int = BY_GCS) -> Bench:
    """In flight, three seconds and a bit after the last lease."""
    bench.fly(mode, reason)
    bench.lose_lease()
    bench.run(3100)
    return bench


class TestLadder:
    def test_on_wings_it_is_rtl(self, bench: Bench) -> None:
        lost(bench)
        assert (bench.vehicle.mode, bench.vehicle.mode_requests) == (RTL, [RTL])
        assert bench.texts == ["HNDO: lease lost, RTL"]
        assert bench.status.action == 1

    @pytest.mark.parametrize("action", [1.0, 2.0, 3.0])
    def test_whatever_is_asked_for(self, action: float) -> None:
        bench = Bench(kind=PLANE, parameters={"HNDO_ACTION": action})
        assert lost(bench).vehicle.mode_requests == [RTL]

    def test_refused_it_is_asked_for_for_ever_and_never_lands_in_place(self, bench: Bench) -> None:
        bench.vehicle.refused_modes = {RTL}
        lost(bench)
        bench.run(60_000)
        assert set(bench.vehicle.mode_requests) == {RTL}
        assert 29 <= len(bench.vehicle.mode_requests) <= 33
        bench.vehicle.refused_modes = set()
        bench.run(2100)
        assert bench.vehicle.mode == RTL

    def test_the_second_try_comes_after_a_second_the_next_ones_after_two(self, bench: Bench) -> None:
        bench.vehicle.refused_modes = {RTL}
        assert all(gap == 2000 for gap in self.gaps_ms(bench, AUTO, 1000))

    def gaps_ms(self, bench: Bench, mode: int, *begin_with: int) -> list[int]:
        """Times between the tries, once they began in time and with these (ms); each may be a call of 50 ms longer."""
        bench.fly(mode)
        lost_ms = bench.lose_lease()
        tries: list[int] = []
        for _ in range(1200):
            bench.run(10)
            if len(bench.vehicle.mode_requests) > len(tries):
                tries.append(bench.vehicle.now_ms - lost_ms)
        assert 3000 <= tries[0] <= 3060
        gaps = [b - a for a, b in pairwise(tries)]
        for gap, wanted in zip(gaps, begin_with, strict=False):
            assert wanted <= gap <= wanted + 60
        return gaps[len(begin_with) :]

    def test_in_hover_the_landing_comes_with_the_third_refusal_and_then_every_two_seconds(self, bench: Bench) -> None:
        bench.vehicle.hovering, bench.vehicle.refused_modes = True, {QRTL, QLAND}
        gaps = self.gaps_ms(bench, GUIDED, 1000, 2000, 0)
        assert bench.vehicle.mode_requests[:5] == [QRTL, QRTL, QRTL, QLAND, QLAND]
        assert len(gaps) >= 2
        assert all(2000 <= gap <= 2050 for gap in gaps)

    @pytest.mark.parametrize(("action", "mode", "told"), [(1.0, QRTL, 1), (2.0, QRTL, 1), (3.0, QLAND, 3)])
    def test_in_hover(self, action: float, mode: int, told: int) -> None:
        bench = Bench(kind=PLANE, parameters={"HNDO_ACTION": action})
        bench.vehicle.hovering = True
        lost(bench, GUIDED)
        assert (bench.vehicle.mode_requests, bench.status.action) == ([mode], told)

    def test_in_hover_a_refused_return_ends_as_a_landing(self, bench: Bench) -> None:
        bench.vehicle.hovering, bench.vehicle.refused_modes = True, {QRTL}
        lost(bench, GUIDED)
        bench.run(4000)
        assert bench.vehicle.mode_requests == [QRTL, QRTL, QRTL, QLAND]
        assert (bench.enforcement, bench.status.action) == (LANDING, 3)

    def test_it_asks_for_what_fits_where_the_wings_carry_it_meanwhile(self, bench: Bench) -> None:
        bench.vehicle.hovering, bench.vehicle.refused_modes = True, {QRTL, RTL}
        lost(bench, GUIDED)
        bench.vehicle.hovering = False
        bench.run(1200)
        assert bench.vehicle.mode_requests == [QRTL, RTL]

    def test_firmware_without_vtol_never_hovers(self) -> None:
        bench = Bench(kind=PLANE, absent=["quadplane"])
        assert lost(bench, GUIDED).vehicle.mode == RTL
        assert not any("fault" in text for text in bench.texts)

    def test_there_is_no_smart_rtl_and_that_is_said(self) -> None:
        bench = Bench(kind=PLANE, parameters={"HNDO_ACTION": 2.0})
        bench.run(10_000)
        assert bench.texts.count("HNDO: no SmartRTL here, HNDO_ACTION 2 is RTL") == 1
        bench.vehicle.parameters["HNDO_ACTION"] = 3.0
        bench.run(100)
        bench.vehicle.parameters["HNDO_ACTION"] = 2.0
        bench.run(100)
        assert bench.texts.count("HNDO: no SmartRTL here, HNDO_ACTION 2 is RTL") == 2

    @pytest.mark.parametrize("action", [1.0, 3.0])
    def test_of_what_there_is_nothing_is_said(self, action: float) -> None:
        bench = Bench(kind=PLANE, parameters={"HNDO_ACTION": action})
        bench.run(10_000)
        assert not any("HNDO_ACTION" in text for text in bench.texts)

    def test_when_a_binding_is_missing_it_is_one_rtl(self, bench: Bench) -> None:
        bench.fly(AUTO)
        bench.scripting.load_text("vehicle.get_likely_flying = nil return", "breaker.lua")
        bench.lose_lease()
        bench.run(10_000)
        assert bench.vehicle.mode_requests == [RTL]

    @pytest.mark.parametrize("mode", [RTL, QRTL])
    def test_when_a_binding_is_missing_a_return_is_left(self, bench: Bench, mode: int) -> None:
        bench.fly(mode)
        bench.scripting.load_text("vehicle.get_likely_flying = nil return", "breaker.lua")
        bench.lose_lease()
        bench.run(10_000)
        assert bench.vehicle.mode_requests == []


class TestWhatTheAutopilotMakesOfAReturn:
    """Each of these is its own doing, and no reason to ask again."""

    @pytest.mark.parametrize(
        ("mode", "reason", "state", "name"),
        [
            (QRTL, ARRIVED_VTOL, RETURNING, "QRTL"),
            (QRTL, QRTL_AT_ONCE, RETURNING, "QRTL"),
            (AUTO, ARRIVED, RETURNING, "AUTO, landing"),
            (AUTO, BY_BATTERY, RETURNING, "AUTO, landing"),
            (QLAND, QLAND_AT_ONCE, LANDING, "QLAND"),
            (QLAND, AT_HEIGHT, LANDING, "QLAND"),
            (LOITER_ALT_QLAND, BY_BATTERY, LANDING, "LOITER_ALT_QLAND"),
            (AUTOLAND, BY_BATTERY, LANDING, "AUTOLAND"),
        ],
    )
    def test_is_left_to_its_end(self, bench: Bench, mode: int, reason: int, state: int, name: str) -> None:
        lost(bench)
        bench.run(3000)
        bench.vehicle.texts.clear()
        bench.vehicle.mode, bench.vehicle.reason = mode, reason
        bench.run(120_000)
        assert (bench.vehicle.mode_requests, bench.enforcement) == ([RTL], state)
        assert bench.texts == [f"HNDO: lease lost, in {name}"]

    def test_a_return_that_is_another_mode_at_once(self, bench: Bench) -> None:
        """Q_RTL_MODE 3: the mode that was asked for is never seen."""
        bench.fly(AUTO)
        bench.lose_lease()
        original = bench.vehicle.set_mode

        def as_qrtl(mode: int, reason: int) -> bool:
            accepted = original(mode, reason)
            bench.vehicle.mode, bench.vehicle.reason = QRTL, QRTL_AT_ONCE
            return accepted

        bench.vehicle.set_mode = as_qrtl  # type: ignore[method-assign]
        bench.run(10_000)
        assert (bench.vehicle.mode_requests, bench.enforcement) == ([RTL], RETURNING)

    @pytest.mark.parametrize("reason", [BY_GCS, BY_RADIO, 5, BY_RC, FENCE_OVER, RADIO_BACK])
    def test_auto_for_any_other_reason_is_the_mission(self, bench: Bench, reason: int) -> None:
        lost(bench)
        bench.vehicle.mode, bench.vehicle.reason = AUTO, reason
        bench.run(11_000)
        assert bench.vehicle.mode == RTL


class TestLandingSequence:
    """AUTO with the reason of RTL's own landing sequence stays so when somebody leads the mission elsewhere."""

    def in_sequence(self, bench: Bench, item: int = 7) -> Bench:
        bench.fly(RTL)
        bench.vehicle.mode, bench.vehicle.reason, bench.vehicle.item = AUTO, ARRIVED, item
        bench.run(1500)
        return bench

    def test_begun_before_the_loss_it_is_flown_to_its_end(self, bench: Bench) -> None:
        self.in_sequence(bench)
        bench.lose_lease()
        for item in (8, 9):
            bench.run(20_000)
            bench.vehicle.item = item
        bench.run(20_000)
        assert bench.vehicle.mode_requests == []

    def test_led_back_by_the_commander_it_is_the_mission_again(self, bench: Bench) -> None:
        self.in_sequence(bench)
        bench.vehicle.item = 2
        bench.run(500)
        bench.lose_lease()
        bench.run(3100)
        assert bench.vehicle.mode == RTL

    def test_led_back_during_the_loss_it_is_undone(self, bench: Bench) -> None:
        self.in_sequence(bench)
        bench.lose_lease()
        bench.run(5000)
        bench.vehicle.texts.clear()
        bench.vehicle.item = 6
        bench.run(100)
        assert bench.vehicle.mode_requests == [RTL]
        assert bench.texts == ["HNDO: lease lost, landing left, RTL"]

    def test_the_next_one_begins_anew(self, bench: Bench) -> None:
        self.in_sequence(bench)
        bench.lose_lease()
        bench.run(5000)
        bench.vehicle.item = 2
        bench.run(3000)
        bench.vehicle.mode, bench.vehicle.reason, bench.vehicle.item = AUTO, ARRIVED, 1
        bench.run(60_000)
        assert bench.vehicle.mode_requests == [RTL]

    @pytest.mark.parametrize("delay_ms", [0, 100, 700])
    def test_in_the_first_second_the_item_may_still_be_that_of_before(self, bench: Bench, delay_ms: int) -> None:
        bench.fly(RTL)
        bench.lose_lease()
        bench.run(4000)
        bench.vehicle.mode, bench.vehicle.reason, bench.vehicle.item = AUTO, ARRIVED, 20
        bench.run(delay_ms)
        bench.vehicle.item = 7
        bench.run(30_000)
        assert bench.vehicle.mode_requests == []

    def test_a_second_later_it_counts(self, bench: Bench) -> None:
        bench.fly(RTL)
        bench.lose_lease()
        bench.run(4000)
        bench.vehicle.mode, bench.vehicle.reason, bench.vehicle.item = AUTO, ARRIVED, 20
        bench.run(1150)
        bench.vehicle.item = 7
        bench.run(100)
        assert bench.vehicle.mode_requests == [RTL]

    def test_firmware_that_does_not_tell_the_item_has_it_flown_to_its_end(self) -> None:
        bench = Bench(kind=PLANE, absent=["mission"])
        self.in_sequence(bench)
        bench.lose_lease()
        bench.run(10_000)
        assert bench.vehicle.mode_requests == []
        assert not any("fault" in text for text in bench.texts)

    def test_items_of_an_ordinary_mission_do_not_matter(self, bench: Bench) -> None:
        bench.fly(AUTO)
        bench.vehicle.item = 9
        bench.run(2000)
        bench.vehicle.item = 2
        bench.run(2000)
        bench.vehicle.mode, bench.vehicle.reason, bench.vehicle.item = AUTO, BY_BATTERY, 12
        bench.lose_lease()
        bench.run(20_000)
        assert bench.vehicle.mode_requests == []


class TestTakeOff:
    """A turn towards home may not end well near the ground."""

    def climbing(self, bench: Bench, mode: int = TAKEOFF) -> Bench:
        bench.vehicle.taking_off = True
        return lost(bench, mode)

    @pytest.mark.parametrize("mode", [TAKEOFF, AUTO])
    def test_is_let_climb_and_told(self, bench: Bench, mode: int) -> None:
        self.climbing(bench, mode)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (FAILSAFE, [])
        assert bench.texts == ["HNDO: lease lost, taking off"]

    def test_is_over_when_the_autopilot_says_so(self, bench: Bench) -> None:
        self.climbing(bench)
        bench.run(4000)
        assert bench.vehicle.mode_requests == []
        bench.vehicle.taking_off = False
        bench.run(60)
        assert bench.vehicle.mode_requests == [RTL]
        assert bench.texts[-1] == "HNDO: lease lost, taken off, RTL"

    def test_it_is_no_reason_of_a_later_order(self, bench: Bench) -> None:
        self.climbing(bench)
        bench.vehicle.taking_off = False
        bench.run(60)
        bench.pilot_chooses(FBWA)
        bench.run(2000)
        assert bench.enforcement == PILOT
        bench.vehicle.rc = False
        bench.run(2100)
        assert bench.vehicle.mode == RTL
        assert bench.texts[-1] == "HNDO: lease lost, radio gone, RTL"

    def test_is_over_after_ten_seconds(self, bench: Bench) -> None:
        self.climbing(bench)
        bench.run(9700)
        assert bench.vehicle.mode_requests == []
        bench.run(400)
        assert bench.vehicle.mode_requests == [RTL]

    def test_refused_a_return_is_asked_for_again_and_the_take_off_has_no_second_time(self, bench: Bench) -> None:
        self.climbing(bench)
        bench.vehicle.refused_modes = {RTL}
        bench.run(20_000)
        assert len(bench.vehicle.mode_requests) > 4

    def test_a_station_cannot_begin_one_during_the_loss(self, bench: Bench) -> None:
        lost(bench)
        bench.vehicle.mode, bench.vehicle.reason, bench.vehicle.taking_off = TAKEOFF, BY_GCS, True
        bench.run(100)
        assert bench.vehicle.mode_requests == [RTL, RTL]

    def test_a_return_under_way_is_one(self, bench: Bench) -> None:
        bench.vehicle.taking_off = True
        assert lost(bench, RTL).enforcement == RETURNING

    def test_in_hover_there_is_nothing_to_wait_for(self, bench: Bench) -> None:
        bench.vehicle.hovering = True
        assert self.climbing(bench, AUTO).vehicle.mode_requests == [QRTL]

    def test_of_a_failsafe_it_is_the_failsafes(self, bench: Bench) -> None:
        """The ten seconds are then those of any failsafe, and not over with the take-off."""
        bench.vehicle.taking_off = True
        lost(bench, CIRCLE, BY_RADIO)
        bench.vehicle.taking_off = False
        bench.run(5000)
        assert bench.vehicle.mode_requests == []
        assert bench.texts == ["HNDO: lease lost, failsafe acts"]

    def test_firmware_that_cannot_tell_returns_at_once(self) -> None:
        bench = Bench(kind=PLANE, absent=["vehicle.is_taking_off"])
        assert self.climbing(bench).vehicle.mode_requests == [RTL]

    def test_another_loss_finds_no_take_off_of_before(self, bench: Bench) -> None:
        self.climbing(bench)
        bench.sending = True
        bench.run(1000)
        bench.vehicle.texts.clear()
        bench.vehicle.mode, bench.vehicle.reason = CIRCLE, BY_FENCE
        bench.lose_lease()
        bench.vehicle.taking_off = False
        bench.run(8000)
        assert bench.texts[-1] == "HNDO: lease lost, failsafe acts"
        bench.run(6000)
        assert bench.texts[-1] == "HNDO: lease lost, held 10 s, RTL"

    def test_a_copter_has_no_such_time(self) -> None:
        bench = Bench()
        bench.vehicle.taking_off = True
        assert lost(bench, 3).vehicle.mode_requests == [6]


class TestGround:
    """That it does not fly is an estimate on wings, and a script's disarm works in the air."""

    def test_what_never_flew_is_disarmed(self, bench: Bench) -> None:
        bench.vehicle.armed = True
        bench.run(4000)
        assert bench.vehicle.disarms == 1
        assert "HNDO: no lease, disarmed" in bench.texts

    def test_what_has_flown_is_not(self, bench: Bench) -> None:
        lost(bench)
        bench.vehicle.flying = False
        bench.run(120_000)
        assert (bench.vehicle.disarms, bench.vehicle.mode_requests) == (0, [RTL])

    def test_a_moment_of_taxiing_is_enough(self, bench: Bench) -> None:
        bench.with_lease()
        bench.vehicle.armed = bench.vehicle.flying = True
        bench.run(100)
        bench.vehicle.flying = False
        bench.lose_lease()
        bench.run(60_000)
        assert bench.vehicle.disarms == 0

    def test_the_next_arming_begins_anew(self, bench: Bench) -> None:
        lost(bench)
        bench.vehicle.armed = bench.vehicle.flying = False
        bench.run(1000)
        bench.vehicle.armed = True
        bench.run(1000)
        assert bench.vehicle.disarms == 1

    def test_a_landed_one_that_is_carried_is_sent_nowhere_out_of_its_return(self, bench: Bench) -> None:
        """Moved at a walk it counts as flying again."""
        lost(bench)
        bench.vehicle.mode, bench.vehicle.reason = AUTO, ARRIVED
        bench.run(5000)
        for flying in (False, True, False, True):
            bench.vehicle.flying = flying
            bench.run(5000)
        assert bench.vehicle.mode_requests == [RTL]


class TestResumed:
    """A failsafe that is over gives back what it took: the pilot's mode is the pilot's again."""

    def flown_by_hand(self, bench: Bench, mode: int = FBWA) -> Bench:
        bench.vehicle.rc = True
        lost(bench, mode, BY_RC)
        assert bench.enforcement == PILOT
        return bench

    def failsafe(self, bench: Bench, mode: int, reason: int, resumed: int, back: int) -> None:
        bench.vehicle.mode, bench.vehicle.reason = mode, reason
        bench.run(2000)
        assert bench.enforcement == FAILSAFE
        bench.vehicle.mode, bench.vehicle.reason = back, resumed
        bench.run(500)

    @pytest.mark.parametrize(("mode", "reason", "resumed"), [(CIRCLE, 3, RADIO_BACK), (GUIDED, BY_FENCE, FENCE_OVER)])
    @pytest.mark.parametrize("hand", PLANE_NUMBERS.by_hand.values(), ids=PLANE_NUMBERS.by_hand)
    def test_the_pilots_again(self, bench: Bench, hand: int, mode: int, reason: int, resumed: int) -> None:
        self.flown_by_hand(bench, hand)
        self.failsafe(bench, mode, reason, resumed, hand)
        bench.run(20_000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])

    def test_again_and_again(self, bench: Bench) -> None:
        self.flown_by_hand(bench)
        for _ in range(3):
            self.failsafe(bench, CIRCLE, BY_RADIO, RADIO_BACK, FBWA)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])

    def test_when_the_loss_comes_during_the_failsafe(self, bench: Bench) -> None:
        bench.vehicle.rc = True
        bench.fly(FBWA, BY_RC)
        bench.vehicle.mode, bench.vehicle.reason = CIRCLE, BY_RADIO
        bench.lose_lease()
        bench.run(4000)
        bench.vehicle.mode, bench.vehicle.reason = FBWA, RADIO_BACK
        bench.run(5000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])

    def test_without_a_radio_nobody_has_it(self, bench: Bench) -> None:
        self.flown_by_hand(bench)
        bench.vehicle.rc = False
        bench.vehicle.mode, bench.vehicle.reason = CIRCLE, BY_RADIO
        bench.run(2000)
        bench.vehicle.mode, bench.vehicle.reason = FBWA, RADIO_BACK
        bench.run(100)
        assert bench.vehicle.mode == RTL

    def test_another_mode_than_the_pilots_is_not(self, bench: Bench) -> None:
        self.flown_by_hand(bench)
        bench.vehicle.mode, bench.vehicle.reason = CIRCLE, BY_RADIO
        bench.run(2000)
        bench.vehicle.mode, bench.vehicle.reason = GUIDED, RADIO_BACK
        bench.run(100)
        assert bench.vehicle.mode == RTL
        assert bench.texts[-1] == "HNDO: lease lost, mode change undone"

    def test_a_mission_that_the_pilot_had_started_goes_on_without_authority_no_more_than_before(
        self, bench: Bench
    ) -> None:
        bench.vehicle.rc = True
        bench.fly(AUTO, BY_RC)
        bench.vehicle.mode, bench.vehicle.reason = CIRCLE, BY_RADIO
        bench.lose_lease()
        bench.run(4000)
        bench.vehicle.mode, bench.vehicle.reason = AUTO, RADIO_BACK
        bench.run(100)
        assert bench.vehicle.mode == RTL

    @pytest.mark.parametrize("between", [BY_GCS, BY_SCRIPT])
    def test_what_somebody_else_had_chosen_meanwhile_is_not_the_pilots(self, bench: Bench, between: int) -> None:
        bench.vehicle.rc = True
        bench.fly(FBWA, BY_RC)
        bench.vehicle.mode, bench.vehicle.reason = GUIDED, between
        bench.run(500)
        bench.vehicle.mode, bench.vehicle.reason = CIRCLE, BY_RADIO
        bench.lose_lease()
        bench.run(4000)
        bench.vehicle.mode, bench.vehicle.reason = FBWA, RADIO_BACK
        bench.run(100)
        assert bench.vehicle.mode == RTL


class TestFailsafes:
    @pytest.mark.parametrize("reason", PLANE_NUMBERS.failsafes.values(), ids=PLANE_NUMBERS.failsafes)
    @pytest.mark.parametrize("mode", [CIRCLE, LOITER, GUIDED, FBWA])
    def test_one_that_only_holds_has_ten_seconds(self, bench: Bench, mode: int, reason: int) -> None:
        lost(bench, mode, reason)
        bench.run(9700)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (FAILSAFE, [])
        bench.run(400)
        assert bench.vehicle.mode_requests == ([] if reason in (BY_EKF, 14) else [RTL])

    def test_whether_the_ekf_is_well_is_not_told_so_its_failsafe_is_never_left(self, bench: Bench) -> None:
        bench.vehicle.hovering = True
        lost(bench, QHOVER, BY_EKF)
        bench.run(300_000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (FAILSAFE, [])

    def test_but_by_a_pilot(self, bench: Bench) -> None:
        bench.vehicle.hovering = True
        lost(bench, QHOVER, BY_EKF)
        bench.run(20_000)
        bench.pilot_chooses(QLOITER)
        bench.run(20_000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])

    def test_and_no_station(self, bench: Bench) -> None:
        bench.vehicle.hovering = True
        lost(bench, QHOVER, BY_EKF)
        bench.vehicle.mode, bench.vehicle.reason = GUIDED, BY_GCS
        bench.run(100)
        assert bench.vehicle.mode == QRTL

    @pytest.mark.parametrize("reason", [23, 24, 51])
    @pytest.mark.parametrize(("mode", "state"), [(QLAND, LANDING), (QRTL, RETURNING), (RTL, RETURNING)])
    def test_one_that_lands_or_returns_wins(self, bench: Bench, mode: int, state: int, reason: int) -> None:
        lost(bench)
        bench.vehicle.mode, bench.vehicle.reason = mode, reason
        bench.run(60_000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (state, [RTL])


class TestLandingModes:
    @pytest.mark.parametrize("mode", PLANE_NUMBERS.landings.values(), ids=PLANE_NUMBERS.landings)
    def test_begun_before_the_loss_it_is_left(self, bench: Bench, mode: int) -> None:
        lost(bench, mode)
        bench.run(60_000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (LANDING, [])

    @pytest.mark.parametrize("mode", PLANE_NUMBERS.landings.values(), ids=PLANE_NUMBERS.landings)
    def test_ordered_during_it_it_is_undone(self, bench: Bench, mode: int) -> None:
        lost(bench)
        bench.vehicle.mode, bench.vehicle.reason = mode, BY_GCS
        bench.run(100)
        assert bench.vehicle.mode_requests == [RTL, RTL]
        assert bench.texts[-1] == "HNDO: lease lost, command undone"

    @pytest.mark.parametrize("mode", PLANE_NUMBERS.landings.values(), ids=PLANE_NUMBERS.landings)
    def test_ordered_by_the_companion_that_says_lost_it_is_left(self, bench: Bench, mode: int) -> None:
        bench.fly(AUTO)
        bench.companion.state, bench.companion.commander = LOST, 0
        bench.run(1000)
        bench.vehicle.mode, bench.vehicle.reason = mode, BY_GCS
        bench.run(60_000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (LANDING, [])

    def test_final_approach_is_left_and_when_it_is_broken_off_it_returns(self, bench: Bench) -> None:
        bench.vehicle.landing = True
        lost(bench)
        bench.run(20_000)
        assert bench.vehicle.mode_requests == []
        bench.vehicle.landing = False
        bench.run(100)
        assert bench.vehicle.mode_requests == [RTL]
        assert bench.texts[-1] == "HNDO: lease lost, landing left, RTL"

    @pytest.mark.parametrize(("mode", "name"), [*((v, k) for k, v in PLANE_NUMBERS.landings.items()), (QRTL, "QRTL")])
    def test_with_authority_back_it_is_named(self, bench: Bench, mode: int, name: str) -> None:
        lost(bench, mode)
        bench.sending = True
        bench.run(500)
        assert f"HNDO: authority back, staying in {name}" in bench.texts


class TestPilot:
    @pytest.mark.parametrize("mode", PLANE_NUMBERS.by_hand.values(), ids=PLANE_NUMBERS.by_hand)
    def test_who_steers_by_hand_keeps_it(self, bench: Bench, mode: int) -> None:
        bench.vehicle.rc = True
        lost(bench, mode, BY_RC)
        bench.run(20_000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [])
        assert bench.status.flags == ARMED | FLYING

    @pytest.mark.parametrize("reason", PLANE_NUMBERS.pilots.values(), ids=PLANE_NUMBERS.pilots)
    def test_whichever_way_he_takes_over(self, bench: Bench, reason: int) -> None:
        lost(bench)
        bench.pilot_chooses(FBWA, reason)
        bench.run(5000)
        assert (bench.enforcement, bench.vehicle.mode_requests) == (PILOT, [RTL])

    @pytest.mark.parametrize("reason", [9, 18])
    def test_the_copters_ways_are_none_here(self, bench: Bench, reason: int) -> None:
        lost(bench)
        bench.pilot_chooses(FBWA, reason)
        bench.run(100)
        assert bench.vehicle.mode_requests == [RTL, RTL]

    def test_without_a_radio_failsafe_nobody_is_believed(self) -> None:
        bench = Bench(kind=PLANE, parameters={"THR_FAILSAFE": 0.0})
        bench.vehicle.rc = True
        lost(bench, FBWA, BY_RC)
        assert bench.vehicle.mode == RTL
        bench.vehicle.texts.clear()
        bench.pilot_chooses(FBWA)
        bench.run(200)
        assert bench.texts == ["HNDO: lease lost, switch undone, THR_FAILSAFE 0"]

    def test_one_that_only_notices_is_enough(self) -> None:
        """THR_FAILSAFE 2, of an aircraft that flies out of the transmitter's range."""
        bench = Bench(kind=PLANE, parameters={"THR_FAILSAFE": 2.0})
        bench.vehicle.rc = True
        assert lost(bench, FBWA, BY_RC).enforcement == PILOT

    def test_the_copters_parameter_is_not_asked(self) -> None:
        bench = Bench(kind=PLANE, parameters={"FS_THR_ENABLE": 0.0})
        bench.vehicle.rc = True
        assert lost(bench, FBWA, BY_RC).enforcement == PILOT

    def test_a_mission_started_by_switch_is_no_pilot_at_the_sticks(self) -> None:
        for mode in (CIRCLE, AUTO, LOITER, TAKEOFF, GUIDED):
            fresh = Bench(kind=PLANE)
            fresh.vehicle.rc = True
            assert lost(fresh, mode, BY_RC).vehicle.mode == RTL, mode


STATION = [GUIDED, LOITER, FBWA, CIRCLE, AUTO, TAKEOFF, QLOITER, 0]


@pytest.mark.parametrize("mode", STATION)
def test_a_station_does_not_lead_out_of_a_return(bench: Bench, mode: int) -> None:
    lost(bench)
    bench.vehicle.mode, bench.vehicle.reason = mode, BY_GCS
    bench.run(100)
    assert (bench.vehicle.mode, bench.enforcement) == (RTL, RETURNING)
    assert bench.texts[-1] == "HNDO: lease lost, command undone"


def test_the_id_of_the_station_follows_the_commander(bench: Bench) -> None:
    bench.with_lease()
    assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 251.0
    assert bench.may_arm
    assert bench.status.flags & 16 == 0


def test_no_call_takes_more_instructions_than_a_copters() -> None:
    def worst(situation: Callable[[Bench], None]) -> int:
        bench = Bench(kind=PLANE, count_instructions=True)
        situation(bench)
        return bench.most_instructions

    def sequence(bench: Bench) -> None:
        lost(bench)
        bench.vehicle.mode, bench.vehicle.reason, bench.vehicle.item = AUTO, ARRIVED, 7
        bench.run(3000)
        bench.vehicle.item = 2
        bench.run(3000)

    def take_off(bench: Bench) -> None:
        bench.vehicle.taking_off = True
        lost(bench)
        bench.run(12_000)

    assert 500 < max(worst(sequence), worst(take_off)) < 2500


def test_orders_begin_with_missing_and_end_with_a_return(bench: Bench) -> None:
    bench.vehicle.refused_modes = {RTL}
    assert lost(bench).enforcement == ORDERING
    bench.vehicle.refused_modes = set()
    bench.run(2100)
    assert bench.enforcement == RETURNING
