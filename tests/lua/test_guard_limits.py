# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard's limits, exactly: what it does at the end of a time or count, and a millisecond or one call earlier."""

from __future__ import annotations

import pytest

from tests.lua.stub import (
    ALONE,
    AUTO,
    BRAKE,
    BY_AVOIDANCE,
    BY_AVOIDANCE_END,
    BY_FENCE,
    BY_GCS,
    BY_RC,
    LIVE_STATE,
    LOITER,
    LOST,
    PILOT,
    RTL,
    STABILIZE,
    Bench,
    command_frame,
)
from tests.lua.test_guard_arming import BREAKER

EXPIRED_STATE, LOST_STATE = 3, 4
DO_AUX_FUNCTION = 218
NONE: list[int] = []


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def unblocked() -> Bench:
    """Firmware that leaves no command to a script."""
    return Bench(absent=["mavlink.block_command"])


def call_at(bench: Bench, instant_ms: int) -> None:
    """Let time pass so that the guard is called exactly then."""
    bench.until(lambda: instant_ms - 50 < (bench.scripting.next_run_ms() or 0) <= instant_ms, 20_000)
    bench.vehicle.now_ms = instant_ms
    bench.run(0)


def call_soon(bench: Bench) -> int:
    """Let the guard be called; the time of the call."""
    call_at(bench, bench.vehicle.now_ms + 100)
    return bench.vehicle.now_ms


def going_home(bench: Bench) -> int:
    """The lease is lost in flight and the guard has set RTL; the time of that."""
    bench.fly(AUTO)
    bench.lose_lease()
    acted_ms = bench.until(lambda: bench.vehicle.mode == RTL)
    bench.vehicle.mode_requests.clear()
    return acted_ms


def read_all(bench: Bench, frames: int) -> int:
    """So many frames come in at once; the time at which the guard has read them."""
    for _ in range(frames):
        bench.hear()
    queue = bench.scripting._calls.queue
    assert queue is not None
    assert len(queue) == frames
    return bench.until(lambda: not queue)


def is_believed(bench: Bench) -> bool:
    """Whether a pilot who chooses a mode now has it."""
    bench.pilot_chooses(STABILIZE)
    bench.run(200)
    assert (bench.enforcement == PILOT) == (bench.vehicle.mode == STABILIZE)
    return bench.enforcement == PILOT


class TestAuthority:
    @pytest.mark.parametrize(("age_ms", "state"), [(999, LIVE_STATE), (1000, EXPIRED_STATE)])
    def test_a_lease_lives_as_long_as_it_says(self, bench: Bench, age_ms: int, state: int) -> None:
        bench.with_lease().sending = False
        bench.receive(bench.companion.lease(ttl_ms=1000))
        call_at(bench, bench.vehicle.now_ms + age_ms)
        assert bench.status.state == state

    @pytest.mark.parametrize(("after_ms", "requests"), [(2999, NONE), (3000, [RTL])])
    def test_after_a_start_in_flight_the_companion_has_the_timeout(self, after_ms: int, requests: list[int]) -> None:
        bench = Bench(boot_ms=10_000)
        bench.vehicle.armed = bench.vehicle.flying = True
        bench.vehicle.mode, bench.vehicle.reason = AUTO, BY_GCS
        call_at(bench, 10_000 + after_ms)
        assert bench.vehicle.mode_requests == requests

    @pytest.mark.parametrize(("after_ms", "requests"), [(999, NONE), (1000, [RTL])])
    def test_a_loss_that_the_companion_tells_has_the_lost_time(
        self, bench: Bench, after_ms: int, requests: list[int]
    ) -> None:
        bench.vehicle.parameters["HNDO_LOST_T"] = 1.0
        bench.fly().sending = False
        bench.receive(bench.companion.lease(state=LOST, commander=0))
        call_at(bench, bench.until(lambda: bench.status.state == LOST_STATE) + after_ms)
        assert bench.vehicle.mode_requests == requests

    @pytest.mark.parametrize(("after_ms", "state"), [(999, LIVE_STATE), (1000, LOST_STATE)])
    def test_alone_for_as_long_as_the_lease_says(self, bench: Bench, after_ms: int, state: int) -> None:
        bench.vehicle.parameters["HNDO_ALONE_MAX"] = 600.0
        bench.fly().sending = False
        bench.receive(bench.companion.lease(state=ALONE, commander=0, left_s=1))
        call_at(bench, bench.vehicle.now_ms + after_ms)
        assert bench.status.state == state

    @pytest.mark.parametrize(("slept_ms", "requests"), [(500, [RTL]), (501, NONE)])
    def test_only_after_a_stall_it_reads_before_it_judges(
        self, bench: Bench, slept_ms: int, requests: list[int]
    ) -> None:
        bench.fly().run(3000)
        bench.sending = False
        bench.receive(bench.companion.lease(ttl_ms=400))
        called_ms = call_soon(bench)
        bench.vehicle.now_ms = called_ms + 450
        bench.receive(bench.companion.lease())
        bench.vehicle.now_ms = called_ms + slept_ms
        bench.run(0)
        assert bench.vehicle.mode_requests == requests

    def test_after_a_stall_thirteen_calls_read_the_queue_before_the_lease_is_judged(self, bench: Bench) -> None:
        bench.fly()
        bench.lose_lease()
        bench.vehicle.now_ms += 5000
        requests = []
        for number in range(15):
            for _ in range(25):
                bench.hear()
            bench.run(10 if number else 0)
            requests.append(len(bench.vehicle.mode_requests))
        assert requests == [0] * 12 + [1] * 3


class TestArming:
    @pytest.mark.parametrize(("after_ms", "refusal"), [(9999, "HNDO: another script tampers"), (10_000, None)])
    def test_tampering_is_held_against_the_vehicle_for_ten_seconds(
        self, bench: Bench, after_ms: int, refusal: str | None
    ) -> None:
        bench.with_lease()
        bench.scripting.load_text("mavlink:init(1, 1) return", "wiper.lua")
        told_ms = bench.until(lambda: "HNDO: MAVLink rx was reset by a script" in bench.texts)
        call_at(bench, told_ms + after_ms)
        assert bench.refusal == refusal

    @pytest.mark.parametrize(("after_ms", "refusal"), [(9999, "HNDO: guard fault, see messages"), (10_000, None)])
    def test_a_fault_of_the_guard_is_held_against_it_for_ten_seconds(self, after_ms: int, refusal: str | None) -> None:
        bench = Bench(earlier_script=BREAKER, parameters={"BREAKS": 0.0}).with_lease()
        bench.vehicle.parameters["BREAKS"] = 1.0
        failed_ms = call_soon(bench)
        bench.vehicle.parameters["BREAKS"] = 0.0
        call_at(bench, failed_ms + after_ms)
        assert bench.refusal == refusal

    @pytest.mark.parametrize(("value", "refusal"), [(0.49, None), (0.5, "HNDO: no lease from companion")])
    def test_one_half_is_on(self, value: float, refusal: str | None) -> None:
        bench = Bench(parameters={"HNDO_ENABLE": value})
        bench.run(500)
        assert bench.refusal == refusal

    @pytest.mark.parametrize(("value", "gcs_id"), [(0.49, 255.0), (0.5, 251.0)])
    def test_one_half_lets_the_gcs_id_follow(self, value: float, gcs_id: float) -> None:
        bench = Bench(parameters={"HNDO_SYSID_SW": value}).with_lease()
        bench.run(2000)
        assert bench.vehicle.parameters["MAV_GCS_SYSID"] == gcs_id

    @pytest.mark.parametrize(("after_ms", "disarms"), [(2999, 0), (3000, 1)])
    def test_landed_for_three_seconds_the_motors_are_stopped(self, bench: Bench, after_ms: int, disarms: int) -> None:
        going_home(bench)
        flown_ms = call_soon(bench)
        bench.vehicle.flying = False
        call_at(bench, flown_ms + after_ms)
        assert bench.vehicle.disarms == disarms


class TestPatience:
    @pytest.mark.parametrize(("after_ms", "requests"), [(1999, NONE), (2000, [RTL])])
    def test_a_pilot_without_a_radio_has_two_seconds(self, bench: Bench, after_ms: int, requests: list[int]) -> None:
        bench.vehicle.rc = True
        bench.fly(LOITER, BY_RC)
        bench.lose_lease()
        bench.run(4000)
        heard_ms = call_soon(bench)
        bench.vehicle.rc = False
        call_at(bench, heard_ms + after_ms)
        assert bench.vehicle.mode_requests == requests

    @pytest.mark.parametrize(("after_ms", "requests"), [(9999, NONE), (10_000, [RTL])])
    def test_a_failsafe_that_holds_has_ten_seconds(self, bench: Bench, after_ms: int, requests: list[int]) -> None:
        bench.fly(BRAKE, BY_FENCE)
        bench.lose_lease()
        call_at(bench, bench.until(lambda: "HNDO: lease lost, failsafe acts" in bench.texts) + after_ms)
        assert bench.vehicle.mode_requests == requests

    @pytest.mark.parametrize(("after_ms", "requests"), [(9999, NONE), (10_000, [RTL])])
    def test_what_follows_traffic_avoidance_has_ten_seconds(
        self, bench: Bench, after_ms: int, requests: list[int]
    ) -> None:
        bench.fly(BRAKE, BY_AVOIDANCE)
        bench.lose_lease()
        bench.run(20_000)
        avoided_ms = call_soon(bench)
        bench.vehicle.reason = BY_AVOIDANCE_END
        call_at(bench, avoided_ms + after_ms)
        assert bench.vehicle.mode_requests == requests


class TestPilot:
    """Whether the mode of a switch is the pilot's."""

    @pytest.mark.parametrize(("after_ms", "believed"), [(999, False), (1000, True)])
    def test_not_within_a_second_after_do_aux_function(self, unblocked: Bench, after_ms: int, believed: bool) -> None:
        going_home(unblocked)
        unblocked.receive(command_frame(DO_AUX_FUNCTION), channel=2)
        call_at(unblocked, unblocked.vehicle.now_ms + after_ms)
        assert is_believed(unblocked) == believed

    @pytest.mark.parametrize(("after_ms", "believed"), [(999, False), (1000, True)])
    def test_not_within_a_second_after_a_full_queue(self, unblocked: Bench, after_ms: int, believed: bool) -> None:
        going_home(unblocked)
        call_at(unblocked, read_all(unblocked, 25) + after_ms)
        assert is_believed(unblocked) == believed

    @pytest.mark.parametrize(("frames", "believed"), [(24, True), (25, False)])
    def test_a_queue_of_twenty_five_is_full(self, unblocked: Bench, frames: int, believed: bool) -> None:
        going_home(unblocked)
        read_all(unblocked, frames)
        assert is_believed(unblocked) == believed

    @pytest.mark.parametrize(("after_ms", "believed"), [(999, False), (1000, True)])
    def test_a_full_queue_is_no_matter_a_second_after_the_firmware_left_the_command_to_the_guard(
        self, bench: Bench, after_ms: int, believed: bool
    ) -> None:
        left_ms = going_home(bench)
        call_at(bench, left_ms + 800)
        read_all(bench, 25)
        call_at(bench, left_ms + after_ms)
        assert is_believed(bench) == believed

    def test_six_calls_read_on_before_a_switch_is_judged(self, unblocked: Bench) -> None:
        """A flood never lets the queue end: the switch is undone in the sixth call after the one that saw it."""
        going_home(unblocked)
        requests = []
        for number in range(20):
            if number == 10:
                unblocked.pilot_chooses(STABILIZE)
            for _ in range(25):
                unblocked.hear()
            unblocked.run(10)
            requests.append(len(unblocked.vehicle.mode_requests))
        assert requests == [0] * 16 + [1] * 4
