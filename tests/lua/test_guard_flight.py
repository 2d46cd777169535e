# SPDX-License-Identifier: GPL-3.0-or-later

"""Guard rules 3 and 4: authority lost in flight brings the aircraft home; authority back leaves it in RTL."""

from __future__ import annotations

import pytest

from tests.lua.numbers import COPTER_NUMBERS
from tests.lua.stub import (
    AUTO,
    AUTO_RTL,
    BRAKE,
    BY_AVOIDANCE,
    BY_AVOIDANCE_END,
    BY_EKF,
    BY_FENCE,
    BY_GCS,
    BY_RC,
    BY_SCRIPT,
    GUIDED,
    LAND,
    LOITER,
    LOST,
    RECOVERING,
    RETURNING,
    RTL,
    SMART_RTL,
    STABILIZE,
    Bench,
)

EXPIRED_STATE, LOST_STATE, LIVE_STATE = 3, 4, 2
ALT_HOLD, AVOID_ADSB = 2, 19
BY_HAND = COPTER_NUMBERS.by_hand
#: those in which nobody does: AUTO, GUIDED, CIRCLE, BRAKE, THROW, AVOID_ADSB, GUIDED_NOGPS, FOLLOW, ZIGZAG
BY_ITSELF = (3, 4, 7, 17, 18, 19, 20, 23, 24)
PILOT, FAILSAFE, COMMAND = COPTER_NUMBERS.pilots, COPTER_NUMBERS.failsafes, COPTER_NUMBERS.commands
UNDONE = {2: "command", 32: "script", 52: "DDS command"}
ENFORCING, ARMED, FLYING = 1, 2, 4


@pytest.fixture
def bench() -> Bench:
    return Bench()


def in_rtl(bench: Bench) -> bool:
    return bench.vehicle.mode == RTL


def lost_in_flight(bench: Bench, mode: int = AUTO) -> Bench:
    """Flying, lease lost, the guard has set RTL."""
    bench.fly(mode)
    bench.lose_lease()
    bench.run(4000)
    assert bench.vehicle.mode == RTL
    bench.vehicle.mode_requests.clear()
    bench.vehicle.texts.clear()
    return bench


@pytest.mark.parametrize("mode", [AUTO, GUIDED, LOITER, STABILIZE, BRAKE])
def test_lease_lost_in_flight_is_rtl_within_the_timeout(bench: Bench, mode: int) -> None:
    bench.fly(mode)
    last_lease_ms = bench.lose_lease()
    acted_ms = bench.until(lambda: in_rtl(bench))
    assert 3000 <= acted_ms - last_lease_ms <= 3200
    assert bench.vehicle.reason == BY_SCRIPT
    assert bench.texts == ["HNDO: lease lost, RTL"]
    bench.run(100)
    status = bench.status
    assert (status.state, status.action, status.flags) == (EXPIRED_STATE, 1, ENFORCING | ARMED | FLYING)


def test_rtl_is_set_once(bench: Bench) -> None:
    bench.fly()
    bench.lose_lease()
    bench.run(60_000)
    assert bench.vehicle.mode_requests == [RTL]
    assert bench.texts == ["HNDO: lease lost, RTL"]


def test_lost_state_is_tolerated_for_a_while(bench: Bench) -> None:
    bench.fly()
    bench.companion.state, bench.companion.commander = LOST, 0
    started_ms = bench.until(lambda: bench.status.state == LOST_STATE)
    acted_ms = bench.until(lambda: in_rtl(bench))
    assert 2950 <= acted_ms - started_ms <= 3100
    assert bench.texts == ["HNDO: no authority, RTL"]


def test_short_lost_state_passes(bench: Bench) -> None:
    bench.fly()
    for _ in range(5):
        bench.companion.state, bench.companion.commander = LOST, 0
        bench.run(2700)
        bench.companion.state, bench.companion.commander = 1, 252
        bench.run(400)
    assert bench.vehicle.mode == AUTO
    assert bench.vehicle.mode_requests == []


def test_lost_time_follows_the_parameter(bench: Bench) -> None:
    bench.vehicle.parameters["HNDO_LOST_T"] = 20.0
    bench.fly()
    bench.companion.state = LOST
    bench.run(19_500)
    assert bench.vehicle.mode == AUTO
    bench.run(1000)
    assert bench.vehicle.mode == RTL


def test_recovering_companion_is_not_a_loss(bench: Bench) -> None:
    bench.fly()
    bench.companion.state = RECOVERING
    bench.run(10_000)
    assert bench.vehicle.mode == AUTO


@pytest.mark.parametrize(("parameter", "mode", "action"), [(1.0, RTL, 1), (2.0, SMART_RTL, 2), (3.0, LAND, 3)])
def test_action_parameter(bench: Bench, parameter: float, mode: int, action: int) -> None:
    bench.vehicle.parameters["HNDO_ACTION"] = parameter
    bench.fly()
    bench.lose_lease()
    bench.run(4000)
    assert bench.vehicle.mode == mode
    assert bench.status.action == action


@pytest.mark.parametrize("nonsense", [0.0, -3.0, 17.0, 1.5, float("nan")])
def test_nonsense_action_still_acts(bench: Bench, nonsense: float) -> None:
    bench.vehicle.parameters["HNDO_ACTION"] = nonsense
    bench.fly()
    bench.lose_lease()
    bench.run(4000)
    assert bench.vehicle.mode in (RTL, LAND)


@pytest.mark.parametrize("nonsense", [0.0, -1.0, float("nan"), 1e9])
def test_nonsense_timeout_is_bounded(bench: Bench, nonsense: float) -> None:
    bench.vehicle.parameters["HNDO_TIMEOUT"] = nonsense
    bench.companion.ttl_ms = 65535
    bench.fly()
    bench.lose_lease()
    bench.run(61_000)
    assert bench.vehicle.mode == RTL


@pytest.mark.parametrize(("value", "seconds"), [(0.2, 1), (1.0, 1), (30.0, 30), (60.0, 30)])
def test_timeout_is_one_to_thirty_seconds(bench: Bench, value: float, seconds: int) -> None:
    bench.vehicle.parameters["HNDO_TIMEOUT"] = value
    bench.companion.ttl_ms = 65535
    bench.fly()
    last_lease_ms = bench.lose_lease()
    acted_ms = bench.until(lambda: in_rtl(bench), 61_000)
    assert 1000 * seconds <= acted_ms - last_lease_ms <= 1000 * seconds + 200


class TestRefusedMode:
    def test_rtl_refused_is_retried_with_growing_pauses_then_land(self, bench: Bench) -> None:
        bench.vehicle.refused_modes = {RTL}
        bench.fly()
        bench.lose_lease()
        requests: list[tuple[int, int]] = []
        for _ in range(800):
            bench.run(10)
            if len(bench.vehicle.mode_requests) > len(requests):
                requests.append((bench.vehicle.now_ms, bench.vehicle.mode_requests[-1]))
        first_ms = requests[0][0]
        assert [mode for _, mode in requests] == [RTL, RTL, RTL, LAND]
        assert [round((at - first_ms) / 100) * 100 for at, _ in requests] == [0, 1000, 3000, 3000]
        assert bench.vehicle.mode == LAND
        assert bench.texts[-1] == "HNDO: lease lost, LAND"
        assert "HNDO: lease lost, RTL refused" in bench.texts

    def test_rtl_possible_again_between_the_tries(self, bench: Bench) -> None:
        bench.vehicle.refused_modes = {RTL}
        bench.fly()
        bench.lose_lease()
        bench.until(lambda: len(bench.vehicle.mode_requests) == 1)
        bench.vehicle.refused_modes = set()
        bench.run(1200)
        assert bench.vehicle.mode_requests == [RTL, RTL]
        assert bench.vehicle.mode == RTL

    def test_smart_rtl_without_a_path_is_rtl_at_once(self, bench: Bench) -> None:
        bench.vehicle.parameters["HNDO_ACTION"] = 2.0
        bench.vehicle.refused_modes = {SMART_RTL}
        bench.fly()
        bench.lose_lease()
        bench.until(lambda: bool(bench.vehicle.mode_requests))
        bench.run(200)
        assert bench.vehicle.mode_requests == [SMART_RTL, RTL]
        assert bench.status.action == 1

    def test_everything_refused_goes_on_trying_land_every_two_seconds(self, bench: Bench) -> None:
        bench.vehicle.refused_modes = {RTL, LAND}
        bench.fly()
        bench.lose_lease()
        bench.run(6200)
        bench.vehicle.mode_requests.clear()
        bench.run(10_000)
        assert bench.vehicle.mode_requests == [LAND] * 5

    def test_after_a_pilot_the_tries_begin_anew(self, bench: Bench) -> None:
        """What a station does then is undone at once, whatever pause the last refusal has asked for."""
        bench.vehicle.refused_modes = {RTL}
        bench.fly()
        bench.lose_lease()
        bench.until(lambda: len(bench.vehicle.mode_requests) == 2)
        bench.pilot_chooses(LOITER)
        bench.run(200)
        bench.vehicle.refused_modes = set()
        bench.vehicle.mode, bench.vehicle.reason = GUIDED, BY_GCS
        bench.run(100)
        assert bench.vehicle.mode == RTL

    @pytest.mark.parametrize("landed", [True, False])
    def test_in_the_next_loss_the_tries_begin_anew(self, bench: Bench, landed: bool) -> None:
        bench.vehicle.refused_modes = {RTL, LAND}
        bench.fly()
        bench.lose_lease()
        bench.run(20_000)
        if landed:
            bench.vehicle.armed = bench.vehicle.flying = False
            bench.run(100)
        else:
            bench.sending = True
            bench.run(1000)
        bench.fly()
        bench.vehicle.mode_requests.clear()
        bench.lose_lease()
        bench.run(7000)
        assert bench.vehicle.mode_requests[:4] == [RTL, RTL, RTL, LAND]

    def test_pilot_who_takes_over_between_the_tries_is_not_fought(self, bench: Bench) -> None:
        bench.vehicle.refused_modes = {RTL, LAND}
        bench.fly()
        bench.lose_lease()
        bench.until(lambda: bool(bench.vehicle.mode_requests))
        bench.pilot_chooses(LOITER)
        bench.vehicle.mode_requests.clear()
        bench.run(10_000)
        assert bench.vehicle.mode_requests == []


class TestNothingToDo:
    @pytest.mark.parametrize(
        ("mode", "name"), [(RTL, "RTL"), (SMART_RTL, "SMART_RTL"), (AUTO_RTL, "AUTO_RTL"), (LAND, "LAND")]
    )
    def test_already_on_the_way_home_or_landing(self, bench: Bench, mode: int, name: str) -> None:
        bench.fly(mode)
        bench.lose_lease()
        bench.run(20_000)
        assert bench.vehicle.mode_requests == []
        assert bench.texts == [f"HNDO: lease lost, in {name}"]
        # it watches over the return, it has not set it
        assert (bench.status.action, bench.status.flags) == (0, ENFORCING | ARMED | FLYING)

    @pytest.mark.parametrize("reason", FAILSAFE.values(), ids=FAILSAFE)
    def test_a_failsafe_that_acted_before_wins(self, bench: Bench, reason: int) -> None:
        bench.fly(BRAKE, reason)
        bench.lose_lease()
        bench.run(12_500)
        assert bench.vehicle.mode_requests == []
        assert bench.texts == [f"HNDO: lease lost, {'traffic avoidance' if reason == 14 else 'failsafe acts'}"]
        assert bench.status.flags == ARMED | FLYING

    @pytest.mark.parametrize(("mode", "run_ms"), [(LAND, 60_000), (BRAKE, 9500)])
    @pytest.mark.parametrize("reason", FAILSAFE.values(), ids=FAILSAFE)
    def test_a_failsafe_that_acts_afterwards_wins(self, bench: Bench, reason: int, mode: int, run_ms: int) -> None:
        lost_in_flight(bench)
        bench.vehicle.mode, bench.vehicle.reason = mode, reason
        bench.run(run_ms)
        assert bench.vehicle.mode_requests == []

    @pytest.mark.parametrize("reason", sorted({*range(56)} - {*FAILSAFE.values(), *PILOT.values()}))
    def test_no_other_reason_is_a_failsafe_or_a_pilot(self, bench: Bench, reason: int) -> None:
        """The end of a mission, of a brake, of an avoidance long ago, a fence that gives the mode back, ..."""
        lost_in_flight(bench)
        bench.vehicle.mode, bench.vehicle.reason = AUTO, reason
        bench.run(100)
        assert bench.vehicle.mode == RTL


class TestFailsafeThatOnlyHolds:
    """Fence BRAKE, EKF ALT_HOLD, traffic avoidance: what neither returns nor lands is left after ten seconds."""

    @pytest.mark.parametrize("reason", sorted(set(FAILSAFE.values()) - {14}))
    @pytest.mark.parametrize("mode", [BRAKE, ALT_HOLD, LOITER, AUTO])
    def test_home_after_ten_seconds(self, bench: Bench, mode: int, reason: int) -> None:
        lost_in_flight(bench)
        bench.vehicle.mode, bench.vehicle.reason = mode, reason
        held_ms = bench.vehicle.now_ms
        acted_ms = bench.until(lambda: in_rtl(bench), 11_000)
        assert 10_000 <= acted_ms - held_ms <= 10_110

    def test_found_at_the_loss_the_ten_seconds_begin_there(self, bench: Bench) -> None:
        bench.fly(BRAKE, BY_FENCE)
        bench.run(60_000)
        lost_ms = bench.lose_lease()
        acted_ms = bench.until(lambda: in_rtl(bench), 20_000)
        assert 13_000 <= acted_ms - lost_ms <= 13_200

    def test_another_one_has_ten_seconds_of_its_own(self, bench: Bench) -> None:
        bench.fly(BRAKE, BY_FENCE)
        bench.lose_lease()
        bench.run(11_000)
        bench.vehicle.mode, bench.vehicle.reason = ALT_HOLD, BY_EKF
        bench.run(9500)
        assert bench.vehicle.mode_requests == []
        bench.run(1000)
        assert bench.vehicle.mode_requests == [RTL]

    def test_ordered_again_by_a_station_it_gains_no_time(self, bench: Bench) -> None:
        bench.fly(BRAKE, BY_FENCE)
        bench.lose_lease()
        bench.run(11_000)
        bench.vehicle.reason = BY_GCS
        bench.run(2500)
        assert bench.vehicle.mode == RTL

    def test_with_a_failed_ekf_it_is_not_left(self, bench: Bench) -> None:
        bench.vehicle.ekf_failed = True
        bench.fly(ALT_HOLD, BY_EKF)
        bench.lose_lease()
        bench.run(60_000)
        assert bench.vehicle.mode_requests == []
        bench.vehicle.ekf_failed = False
        bench.run(100)
        assert bench.vehicle.mode == RTL

    def test_a_fence_that_refuses_every_mode_is_asked_again(self, bench: Bench) -> None:
        """FENCE_OPTIONS bit 0, until the breach is over."""
        bench.fly(BRAKE, BY_FENCE)
        bench.vehicle.refused_modes = {RTL, LAND}
        bench.lose_lease()
        bench.run(30_000)
        assert len(bench.vehicle.mode_requests) > 8
        bench.vehicle.refused_modes = set()
        bench.run(2100)
        assert bench.vehicle.mode == LAND

    @pytest.mark.parametrize("mode", [LOITER, AVOID_ADSB])
    def test_traffic_avoidance_is_never_left(self, bench: Bench, mode: int) -> None:
        bench.fly(mode, BY_AVOIDANCE)
        bench.lose_lease()
        bench.run(300_000)
        assert bench.vehicle.mode_requests == []
        assert bench.texts == ["HNDO: lease lost, traffic avoidance"]

    @pytest.mark.parametrize("mode", [AUTO, AVOID_ADSB, LOITER])
    def test_what_follows_it_is_left_ten_seconds_after_its_end(self, bench: Bench, mode: int) -> None:
        """AVD_F_RCVRY: the mode of before, or the same one."""
        bench.fly(AVOID_ADSB, BY_AVOIDANCE)
        bench.lose_lease()
        bench.run(30_000)
        bench.vehicle.mode, bench.vehicle.reason = mode, BY_AVOIDANCE_END
        ended_ms = bench.vehicle.now_ms
        acted_ms = bench.until(lambda: in_rtl(bench), 11_000)
        assert 9900 <= acted_ms - ended_ms <= 10_110

    def test_over_before_the_loss_it_has_the_rest_of_the_ten_seconds(self, bench: Bench) -> None:
        bench.fly(AVOID_ADSB, BY_AVOIDANCE)
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_AVOIDANCE_END
        bench.run(3000)
        bench.lose_lease()
        bench.run(3500)
        assert bench.vehicle.mode_requests == []
        bench.run(10_000)
        assert bench.vehicle.mode == RTL

    def test_over_long_before_the_loss_it_is_no_reason_to_wait(self, bench: Bench) -> None:
        bench.fly(AVOID_ADSB, BY_AVOIDANCE)
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_AVOIDANCE_END
        bench.run(15_000)
        bench.lose_lease()
        bench.run(3300)
        assert bench.vehicle.mode == RTL

    def test_its_mode_by_command_is_none(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.vehicle.mode, bench.vehicle.reason = AVOID_ADSB, BY_GCS
        bench.run(100)
        assert bench.vehicle.mode == RTL

    def test_a_station_may_not_use_the_time(self, bench: Bench) -> None:
        bench.fly(BRAKE, BY_FENCE)
        bench.lose_lease()
        bench.run(5000)
        bench.vehicle.mode, bench.vehicle.reason = GUIDED, BY_GCS
        bench.run(100)
        assert bench.vehicle.mode == RTL


class TestLandingOfAuto:
    """NAV_LAND is not broken off to climb and fly home; the flight to its place is no landing yet."""

    def test_is_left_alone(self, bench: Bench) -> None:
        bench.fly(AUTO)
        bench.vehicle.landing = True
        bench.lose_lease()
        bench.run(60_000)
        assert bench.vehicle.mode_requests == []
        assert bench.texts == ["HNDO: lease lost, in AUTO, landing"]
        assert (bench.status.action, bench.status.flags) == (0, ENFORCING | ARMED | FLYING)

    def test_on_the_ground_the_motors_are_stopped(self, bench: Bench) -> None:
        """Whatever the mission holds behind it."""
        bench.fly(AUTO)
        bench.vehicle.landing = True
        bench.lose_lease()
        bench.run(6000)
        bench.vehicle.flying = bench.vehicle.landing = False
        bench.run(2900)
        assert bench.vehicle.armed
        bench.run(300)
        assert not bench.vehicle.armed

    def test_a_mission_that_takes_off_again_is_left(self, bench: Bench) -> None:
        bench.fly(AUTO)
        bench.vehicle.landing = True
        bench.lose_lease()
        bench.run(6000)
        bench.vehicle.flying = bench.vehicle.landing = False
        bench.run(1000)
        bench.vehicle.flying = True
        bench.run(100)
        assert bench.vehicle.mode == RTL

    def test_begun_by_a_station_during_the_loss_it_is_undone(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.vehicle.landing = True
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_GCS
        bench.run(100)
        assert bench.vehicle.mode == RTL

    def test_of_other_modes_says_nothing(self, bench: Bench) -> None:
        bench.fly(GUIDED)
        bench.vehicle.landing = True
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL

    def test_with_authority_back_the_mission_goes_on(self, bench: Bench) -> None:
        bench.fly(AUTO)
        bench.vehicle.landing = True
        bench.lose_lease()
        bench.run(5000)
        bench.sending = True
        bench.run(1000)
        assert "HNDO: authority back" in bench.texts
        assert bench.vehicle.mode_requests == []


class TestPilot:
    def test_pilot_takes_over_after_rtl_and_keeps_it(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.pilot_chooses(LOITER)
        bench.run(60_000)
        assert bench.vehicle.mode_requests == []
        assert bench.texts == ["HNDO: lease lost, pilot flies"]
        assert bench.status.flags == ARMED | FLYING

    def test_pilot_may_choose_an_automatic_mode_after_rtl(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.pilot_chooses(AUTO)
        bench.run(10_000)
        assert bench.vehicle.mode == AUTO

    def test_a_station_may_not_take_it_from_the_pilot(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.pilot_chooses(LOITER)
        bench.run(1000)
        bench.vehicle.mode, bench.vehicle.reason = GUIDED, BY_GCS
        bench.run(100)
        assert bench.vehicle.mode == RTL
        assert bench.status.flags == ENFORCING | ARMED | FLYING

    def test_the_next_flight_is_another_matter(self, bench: Bench) -> None:
        """A mode that was a take-over once is what any aircraft may be found in."""
        lost_in_flight(bench)
        bench.pilot_chooses(AUTO)
        bench.run(1000)
        assert bench.vehicle.mode == AUTO
        bench.vehicle.armed = bench.vehicle.flying = False
        bench.run(1000)
        bench.vehicle.armed = bench.vehicle.flying = True
        bench.run(100)
        assert bench.vehicle.mode == RTL

    @pytest.mark.parametrize("reason", PILOT.values(), ids=PILOT)
    def test_whichever_way_the_pilot_takes_over(self, bench: Bench, reason: int) -> None:
        lost_in_flight(bench)
        bench.pilot_chooses(LOITER, reason)
        bench.run(10_000)
        assert bench.vehicle.mode_requests == []

    @pytest.mark.parametrize("mode", BY_HAND.values(), ids=BY_HAND)
    def test_pilot_who_steers_by_hand_when_authority_is_lost_keeps_it(self, bench: Bench, mode: int) -> None:
        bench.vehicle.rc = True
        bench.fly(mode, BY_RC)
        bench.lose_lease()
        bench.run(10_000)
        assert bench.vehicle.mode_requests == []
        assert bench.texts == ["HNDO: lease lost, pilot flies"]

    def test_manual_mode_without_a_radio_is_no_pilot(self, bench: Bench) -> None:
        bench.fly(LOITER, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL

    @pytest.mark.parametrize("mode", BY_ITSELF)
    def test_mission_started_by_switch_is_no_pilot_at_the_sticks(self, bench: Bench, mode: int) -> None:
        bench.vehicle.rc = True
        bench.fly(mode, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL


class TestStationDuringTheLoss:
    @pytest.mark.parametrize("reason", COMMAND.values(), ids=COMMAND)
    @pytest.mark.parametrize("mode", [AUTO, GUIDED, LOITER, STABILIZE, BRAKE])
    def test_command_that_leaves_rtl_is_undone(self, bench: Bench, mode: int, reason: int) -> None:
        lost_in_flight(bench)
        bench.vehicle.mode, bench.vehicle.reason = mode, reason
        bench.run(60)
        assert bench.vehicle.mode == RTL
        assert bench.texts == [f"HNDO: lease lost, {UNDONE[reason]} undone"]
        bench.run(1000)
        assert {record["En"] for _, record in bench.vehicle.records[-2:]} == {RETURNING}

    def test_and_is_a_return_in_the_same_call(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.vehicle.mode, bench.vehicle.reason = GUIDED, BY_GCS
        bench.until(lambda: in_rtl(bench))
        assert bench.enforcement == RETURNING

    def test_in_the_moment_after_rtl_was_set_as_well(self, bench: Bench) -> None:
        bench.fly()
        bench.lose_lease()
        bench.until(lambda: in_rtl(bench))
        bench.vehicle.mode, bench.vehicle.reason = LOITER, BY_GCS
        bench.run(60)
        assert bench.vehicle.mode == RTL
        assert bench.texts == ["HNDO: lease lost, RTL", "HNDO: lease lost, command undone"]

    def test_what_cannot_be_undone_is_not_called_undone(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.vehicle.refused_modes = {RTL, LAND}
        bench.vehicle.mode, bench.vehicle.reason = GUIDED, BY_GCS
        bench.run(2000)
        assert bench.texts == ["HNDO: lease lost, RTL refused"] * 2

    def test_it_is_undone_as_often_as_it_is_sent(self, bench: Bench) -> None:
        lost_in_flight(bench)
        for _ in range(20):
            bench.vehicle.mode, bench.vehicle.reason = GUIDED, BY_GCS
            bench.run(100)
            assert bench.vehicle.mode == RTL
        assert len(bench.texts) <= 2

    def test_another_script_is_undone_too(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.vehicle.mode, bench.vehicle.reason = GUIDED, BY_SCRIPT
        bench.run(60)
        assert bench.vehicle.mode == RTL

    @pytest.mark.parametrize("reason", COMMAND.values(), ids=COMMAND)
    def test_land_by_command_is_undone_without_a_companion(self, bench: Bench, reason: int) -> None:
        lost_in_flight(bench)
        bench.vehicle.mode, bench.vehicle.reason = LAND, reason
        bench.run(60)
        assert bench.vehicle.mode == RTL

    def test_a_landing_by_the_pilot_or_the_companion_is_watched(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.pilot_chooses(LAND)
        bench.run(3000)
        assert bench.texts == ["HNDO: lease lost, in LAND"]
        assert bench.status.flags == ENFORCING | ARMED | FLYING

    def test_the_companion_that_says_lost_may_land(self, bench: Bench) -> None:
        """Return or land is the companion's decision while it lives; its commands look like a station's."""
        bench.fly()
        bench.companion.state, bench.companion.commander = LOST, 0
        bench.run(4000)
        assert bench.vehicle.mode == RTL
        bench.vehicle.mode, bench.vehicle.reason = LAND, BY_GCS
        bench.run(10_000)
        assert bench.vehicle.mode == LAND

    def test_rtl_commanded_again_is_left_alone(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.vehicle.reason = BY_GCS
        bench.run(1000)
        bench.vehicle.mode = SMART_RTL
        bench.run(1000)
        assert bench.vehicle.mode_requests == []


class TestAuthorityBack:
    def test_stays_in_rtl_and_says_so(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.sending = True
        bench.run(5000)
        assert bench.vehicle.mode == RTL
        assert bench.vehicle.mode_requests == []
        assert "HNDO: authority back, staying in RTL" in bench.texts
        assert (bench.status.state, bench.status.action, bench.status.flags) == (LIVE_STATE, 0, ARMED | FLYING)

    def test_then_the_commander_may_continue(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.sending = True
        bench.run(500)
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_GCS
        bench.run(10_000)
        assert bench.vehicle.mode == AUTO

    def test_a_second_loss_is_acted_on_again(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.sending = True
        bench.run(500)
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_GCS
        bench.run(3000)
        bench.vehicle.texts.clear()
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL
        assert bench.texts == ["HNDO: lease lost, RTL"]

    def test_a_second_loss_knows_nothing_of_the_first_one(self, bench: Bench) -> None:
        """After the guard's RTL a mode by the pilot's switch is a take-over; at a new loss it is a mission like any."""
        bench.vehicle.rc = True
        lost_in_flight(bench)
        bench.sending = True
        bench.run(500)
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_RC
        bench.run(3000)
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL

    def test_stays_in_land_and_says_so(self, bench: Bench) -> None:
        bench.vehicle.parameters["HNDO_ACTION"] = 3.0
        bench.fly()
        bench.lose_lease()
        bench.run(4000)
        bench.sending = True
        bench.run(1000)
        assert bench.vehicle.mode == LAND
        assert "HNDO: authority back, staying in LAND" in bench.texts

    def test_a_pilot_is_told_without_a_mode(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.pilot_chooses(LOITER)
        bench.run(1000)
        bench.sending = True
        bench.run(1000)
        assert "HNDO: authority back" in bench.texts

    def test_on_the_ground_there_is_nothing_to_stay_in(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.vehicle.armed = bench.vehicle.flying = False
        bench.run(1000)
        bench.sending = True
        bench.run(1000)
        assert not any("authority back" in text for text in bench.texts)

    def test_a_guard_that_is_switched_off_says_no_more_than_that(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.vehicle.parameters["HNDO_ENABLE"] = 0.0
        bench.run(3000)
        bench.vehicle.parameters["HNDO_ENABLE"] = 1.0
        bench.run(1000)
        assert bench.texts == ["HNDO: guard disabled"]

    def test_a_lease_that_says_lost_does_not_end_the_loss(self, bench: Bench) -> None:
        lost_in_flight(bench)
        bench.companion.state, bench.companion.commander = LOST, 0
        bench.sending = True
        bench.run(500)
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_GCS
        bench.run(60)
        assert bench.vehicle.mode == RTL


class TestRestartInFlight:
    """Scripting was restarted, or the guard enabled, with the aircraft in the air."""

    def test_the_companion_has_the_timeout_to_appear(self, bench: Bench) -> None:
        bench.fly()
        bench.vehicle.parameters["SCR_ENABLE"] = 1.0
        bench.scripting.restart()
        bench.run(3000)
        assert bench.vehicle.mode == AUTO
        assert bench.status.state == LIVE_STATE

    def test_without_companion_it_goes_home(self, bench: Bench) -> None:
        bench.fly()
        bench.lose_lease()
        bench.scripting.restart()
        bench.run(2800)
        assert bench.vehicle.mode == AUTO
        bench.run(400)
        assert bench.vehicle.mode == RTL
        assert "HNDO: no lease, RTL" in bench.texts


def test_disabled_guard_does_nothing_in_flight(bench: Bench) -> None:
    bench.fly()
    bench.vehicle.parameters["HNDO_ENABLE"] = 0.0
    bench.lose_lease()
    bench.run(20_000)
    assert bench.vehicle.mode == AUTO
    assert "HNDO: guard disabled" in bench.texts


def test_landed_but_armed_is_not_sent_anywhere(bench: Bench) -> None:
    bench.fly()
    bench.vehicle.flying = False
    bench.vehicle.disarm_works = False
    bench.lose_lease()
    bench.run(10_000)
    assert bench.vehicle.mode_requests == []


class TestOlderFirmware:
    """Bindings that a firmware does not have are not assumed."""

    def test_without_mode_reason_it_returns_but_does_not_fight(self) -> None:
        bench = Bench(absent=["vehicle.get_control_mode_reason"])
        bench.fly()
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL
        bench.pilot_chooses(LOITER)
        bench.run(5000)
        assert bench.vehicle.mode == LOITER
        assert not any("fault" in text for text in bench.texts)
        bench.vehicle.rc = False  # there is no pilot whom it could be
        bench.run(2100)
        assert bench.vehicle.mode == RTL
        bench.vehicle.mode = LOITER
        bench.run(100)
        assert bench.vehicle.mode == RTL
        assert bench.texts[-1] == "HNDO: lease lost, mode change undone"

    def test_without_mode_reason_a_change_out_of_a_return_that_was_found_is_not_fought_either(self) -> None:
        bench = Bench(absent=["vehicle.get_control_mode_reason"])
        bench.fly(RTL)
        bench.lose_lease()
        bench.run(6000)
        bench.pilot_chooses(AUTO)
        bench.run(5000)
        assert bench.vehicle.mode == AUTO
        assert bench.texts == ["HNDO: lease lost, in RTL", "HNDO: lease lost, pilot flies"]

    def test_without_flying_estimate_it_still_returns(self) -> None:
        bench = Bench(absent=["vehicle.get_likely_flying"])
        bench.with_lease()
        bench.vehicle.armed = True
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_GCS
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL
        assert any(text.startswith("HNDO: fault") for text in bench.texts)
        bench.sending = True
        bench.run(1000)
        bench.vehicle.mode = AUTO
        bench.run(2000)
        assert bench.vehicle.mode == AUTO
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL
        bench.vehicle.mode = LOITER
        bench.run(4000)
        assert bench.vehicle.mode == LOITER

    def test_without_flying_estimate_a_return_that_is_refused_is_asked_for_each_second(self) -> None:
        """The fault: it was asked for once, and a refusal was the end of it."""
        bench = Bench(absent=["vehicle.get_likely_flying"])
        bench.with_lease()
        bench.vehicle.armed = True
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_GCS
        bench.vehicle.refused_modes = {RTL}
        bench.lose_lease()
        bench.until(lambda: bool(bench.vehicle.mode_requests))
        bench.run(30_000)
        assert bench.vehicle.mode == AUTO
        assert bench.vehicle.mode_requests == [RTL] * 31
        bench.vehicle.refused_modes = set()
        bench.run(1100)
        assert bench.vehicle.mode == RTL

    def test_without_flying_estimate_a_return_under_way_is_left_alone(self) -> None:
        bench = Bench(absent=["vehicle.get_likely_flying"])
        bench.with_lease()
        bench.vehicle.armed = True
        bench.vehicle.mode, bench.vehicle.reason = SMART_RTL, BY_GCS
        bench.lose_lease()
        bench.run(10_000)
        assert bench.vehicle.mode_requests == []

    @pytest.mark.parametrize(
        "name",
        ["logger", "logger.write", "mavlink.block_command", "rc", "vehicle.is_landing", "vehicle.has_ekf_failsafed"],
    )
    def test_it_works_without(self, name: str) -> None:
        bench = Bench(absent=[name])
        bench.fly()
        bench.lose_lease()
        bench.run(4000)
        assert bench.vehicle.mode == RTL
        assert bench.vehicle.removed == []
