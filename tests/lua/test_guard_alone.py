# SPDX-License-Identifier: GPL-3.0-or-later

"""A gap that the mission declares is flown alone: in flight, for the shorter of two limits, and never longer."""

from __future__ import annotations

import pytest

from tests.lua.stub import (
    ALONE,
    AUTO,
    CALM,
    HELD,
    LIVE_STATE,
    LOST,
    MISSING,
    RECOVERING,
    RTL,
    TRANSFER,
    Bench,
)

LOST_STATE, EXPIRED_STATE = 4, 3


@pytest.fixture
def bench() -> Bench:
    """In AUTO under 251, with a guard that allows a minute."""
    return Bench(parameters={"HNDO_ALONE_MAX": 60.0}).fly(AUTO)


def alone(bench: Bench, left_s: int = 30) -> int:
    """The commander is lost in a gap: from here on leases say so. Returns the time of the first."""
    bench.companion.state, bench.companion.commander, bench.companion.left_s = ALONE, 0, left_s
    sequence = bench.companion.sequence
    return bench.until(lambda: bench.companion.sequence != sequence)


def returned_at(bench: Bench, limit_ms: int = 200_000) -> int:
    return bench.until(lambda: RTL in bench.vehicle.mode_requests, limit_ms)


def test_it_flies_on_and_the_companion_is_watched_meanwhile(bench: Bench) -> None:
    assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 251
    alone(bench)
    bench.run(20_000)
    assert (bench.vehicle.mode, bench.enforcement, bench.status.state) == (AUTO, CALM, LIVE_STATE)
    assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 1
    assert bench.texts == ["HNDO: lease live, nobody commands"]
    _, record = bench.vehicle.records[-1]
    assert (record["LSt"], record["Cmd"]) == (ALONE, 1)


@pytest.mark.parametrize(("left_s", "most_s", "seconds"), [(30, 60, 30), (60, 20, 20), (600, 600, 600), (5, 5, 5)])
def test_it_ends_with_the_shorter_of_both_limits_and_then_counts_as_lost(
    left_s: int, most_s: int, seconds: int
) -> None:
    bench = Bench(parameters={"HNDO_ALONE_MAX": float(most_s)}).fly(AUTO)
    first_ms = alone(bench, left_s)
    over_ms = bench.until(lambda: bench.status.state == LOST_STATE, 700_000)
    assert 0 <= over_ms - first_ms - 1000 * seconds <= 100
    assert bench.vehicle.mode_requests == []
    bench.until(lambda: RTL in bench.vehicle.mode_requests)
    assert 3000 <= bench.vehicle.now_ms - over_ms <= 3100  # HNDO_LOST_T
    assert bench.texts[-1] == "HNDO: no authority, RTL"


def test_no_later_lease_of_the_same_loss_makes_it_longer(bench: Bench) -> None:
    first_ms = alone(bench, 10)
    for left_s in (600, 10, 65535):
        bench.run(2000)
        bench.companion.left_s = left_s
    # nor does a word between them that names no commander, nor a companion that starts anew
    for state in (LOST, RECOVERING, ALONE):
        bench.companion.state = state
        bench.run(400)
    bench.companion.nonce, bench.companion.sequence = 77, 0
    bench.companion.epoch += 1
    bench.until(lambda: bench.status.state == LOST_STATE and bench.companion.state == ALONE, 10_000)
    assert 10_000 <= bench.vehicle.now_ms - first_ms <= 10_100
    assert returned_at(bench) - first_ms <= 13_100


def test_with_a_commander_again_the_next_gap_has_its_own_time(bench: Bench) -> None:
    alone(bench, 10)
    bench.run(8000)
    bench.companion.state, bench.companion.commander, bench.companion.epoch = TRANSFER, 252, 8
    bench.run(1000)
    assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 252
    first_ms = alone(bench, 10)
    assert 13_000 <= returned_at(bench) - first_ms <= 13_100


def test_a_commander_of_number_none_gives_no_new_time(bench: Bench) -> None:
    first_ms = alone(bench, 10)
    bench.run(5000)
    bench.companion.state = HELD  # by nobody
    bench.run(1000)
    bench.companion.state = ALONE
    assert 13_000 <= returned_at(bench) - first_ms <= 13_100


def test_without_the_parameter_there_is_no_gap() -> None:
    bench = Bench().fly(AUTO)
    assert bench.vehicle.parameters["HNDO_ALONE_MAX"] == 0.0
    first_ms = alone(bench, 600)
    assert 3000 <= returned_at(bench) - first_ms <= 3100
    assert bench.vehicle.parameters["MAV_GCS_SYSID"] == 251


@pytest.mark.parametrize("nonsense", [-5.0, float("nan")])
def test_nonsense_is_no_gap(nonsense: float) -> None:
    bench = Bench(parameters={"HNDO_ALONE_MAX": nonsense}).fly(AUTO)
    first_ms = alone(bench, 600)
    assert 3000 <= returned_at(bench) - first_ms <= 3100


def test_ten_minutes_are_the_most() -> None:
    bench = Bench(parameters={"HNDO_ALONE_MAX": 1e9}).fly(AUTO)
    first_ms = alone(bench, 65_535)
    assert 603_000 <= returned_at(bench, 700_000) - first_ms <= 603_100


def test_a_companion_that_dies_in_the_gap_is_a_loss_like_any(bench: Bench) -> None:
    alone(bench)
    bench.run(5000)
    last_ms = bench.lose_lease()
    bench.run(100)
    assert 3000 <= returned_at(bench) - last_ms <= 3100
    assert bench.status.state == EXPIRED_STATE
    assert bench.texts[-1] == "HNDO: lease lost, RTL"


def test_a_loss_that_is_acted_on_is_not_ended_by_it(bench: Bench) -> None:
    bench.lose_lease()
    bench.run(3300)
    assert bench.vehicle.mode == RTL
    bench.sending = True
    alone(bench)
    bench.run(2000)
    assert (bench.vehicle.mode, bench.status.state) == (RTL, LOST_STATE)
    assert not any("authority back" in text for text in bench.texts)


def test_it_gives_no_arming() -> None:
    bench = Bench(parameters={"HNDO_ALONE_MAX": 60.0}).with_lease()
    assert bench.may_arm
    alone(bench)
    bench.run(100)
    assert bench.refusal == "HNDO: no station has authority"


def test_on_the_ground_it_is_no_authority() -> None:
    bench = Bench(parameters={"HNDO_ALONE_MAX": 60.0}).with_lease()
    bench.vehicle.armed = True
    alone(bench)
    bench.run(2900)
    assert bench.vehicle.armed
    bench.run(500)
    assert not bench.vehicle.armed
    assert bench.enforcement == MISSING


def test_a_forced_arm_under_it_is_answered() -> None:
    bench = Bench(parameters={"HNDO_ALONE_MAX": 60.0}).with_lease()
    alone(bench)
    bench.run(5000)
    bench.vehicle.armed = True
    bench.run(100)
    assert not bench.vehicle.armed


def test_after_the_landing_there_is_none(bench: Bench) -> None:
    alone(bench)
    bench.run(3000)
    bench.vehicle.armed = bench.vehicle.flying = False
    bench.run(100)
    assert bench.refusal == "HNDO: no station has authority"


@pytest.mark.parametrize("tag", [None, bytes(range(32))])
def test_the_seconds_stand_behind_the_life_of_the_lease(bench: Bench, tag: bytes | None) -> None:
    """Layout of docs/architecture.md: the last two bytes of the twenty."""
    bench.companion.key = tag
    payload = bench.companion.lease(state=ALONE, commander=0, left_s=0x0102)[15:43]
    assert payload[18:20] == b"\x02\x01"


class TestRecordings:
    """Somebody plays back leases of a gap that was crossed before; each still says 600 s."""

    @pytest.fixture
    def recorded(self, bench: Bench) -> list[bytes]:
        """Ten of them; the commander is back since."""
        alone(bench, 600)
        frames = []
        for _ in range(10):
            frames.append(bench.companion.lease())
            bench.receive(frames[-1])
            bench.run(100)
        bench.companion.state, bench.companion.commander, bench.companion.left_s = HELD, 251, 0
        bench.run(2000)
        return frames

    def play(self, bench: Bench, frames: list[bytes]) -> None:
        for frame in frames:
            bench.receive(frame)
            bench.run(500)

    def test_after_the_death_of_the_companion_they_hold_up_nothing(self, bench: Bench, recorded: list[bytes]) -> None:
        last_ms = bench.lose_lease()
        self.play(bench, recorded)
        assert RTL in bench.vehicle.mode_requests
        assert bench.vehicle.now_ms - last_ms < 6000

    def test_between_true_leases_they_change_nothing(self, bench: Bench, recorded: list[bytes]) -> None:
        bench.companion.state, bench.companion.commander = LOST, 0
        self.play(bench, recorded[:5])
        assert bench.vehicle.mode_requests == []
        self.play(bench, recorded[5:7])
        assert bench.vehicle.mode_requests == [RTL]

    def test_a_guard_that_starts_again_in_flight_takes_none(self, bench: Bench, recorded: list[bytes]) -> None:
        bench.sending = False
        bench.scripting.restart()
        self.play(bench, recorded)
        assert bench.vehicle.mode == RTL
        assert bench.status.nonce == 0

    def test_a_guard_that_starts_again_in_the_gap_gives_no_more_than_the_companion_has_left(self, bench: Bench) -> None:
        first_ms = alone(bench, 30)
        bench.run(10_000)
        bench.scripting.restart()
        bench.companion.left_s = 20
        bench.run(1000)
        assert bench.status.state == LIVE_STATE
        assert 30_000 <= returned_at(bench) - first_ms <= 34_000
