# SPDX-License-Identifier: GPL-3.0-or-later

"""Steps of the timeline against a stage made by hand: what they do, when they are done, when they fail."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest

from sitl.report.journal_reader import Entry
from sitl.report.matching import Match
from sitl.report.watch import Sample, Watch
from sitl.script.fault_steps import Box, Crash, Guard, Impair, Kill, Restart, Transmit, World
from sitl.script.steps import (
    Pause,
    Steady,
    StepFailed,
    Type,
    Wait,
    WaitArmed,
    WaitHeight,
    WaitLanded,
    WaitMode,
    WaitNear,
    WaitReached,
    WaitReady,
    WaitSpeed,
)


class FakeStage:
    """A stage without processes; the clock and the aircraft are set by hand."""

    def __init__(self) -> None:
        self.watch = Watch(1, 5.0)
        self.since = {"typed": 0, "last": 0, "begin": 0}
        self.taken: set[int] = set()
        self.journal: list[Entry] = []
        self.now_s = 0.0
        self.deeds: list[tuple[str, str]] = []

    def entries(self) -> list[Entry]:
        return self.journal

    def sim_s(self) -> float:
        return self.now_s

    def place(self, name: str) -> tuple[float, float]:
        return {"away": (52.68, 5.925)}[name]

    def type(self, process: str, line: str) -> None:
        self.since["typed"] = self.since["last"] = len(self.journal)
        self.deeds.append((process, line))

    def kill(self, process: str) -> None:
        self.deeds.append((process, "SIGKILL"))

    def crash(self, process: str) -> None:
        self.deeds.append((process, "its MAVProxy"))

    def restart(self, process: str) -> None:
        self.deeds.append((process, "started again"))

    def impair(self, orders: Sequence[str]) -> Callable[[], bool]:
        self.deeds += [("impairment", order) for order in orders]
        return lambda: len(self.journal) > 0

    def transmit(self, position: int | None) -> None:
        self.deeds.append(("pilot", str(position)))

    def change_world(self, name: str, value: float) -> Callable[[], bool]:
        self.deeds.append(("world", f"{name} {value:g}"))
        return lambda: len(self.journal) > 0

    def box(self, order: str) -> Callable[[], bool]:
        self.deeds.append(("box", order))
        return lambda: len(self.journal) > 0

    def note(self, event: str, **fields: object) -> None:
        self.journal.append(Entry(float(len(self.journal)), "drone-1", event, "", fields))

    def fly(self, speed_mps: float, *, mode: str = "AUTO", alt_m: float = 40.0, step_s: float = 0.5) -> None:
        self.now_s += step_s
        self.watch.mode = mode
        self.watch.sample = Sample(self.now_s / 5, self.now_s, 52.679, 5.924, alt_m, 0.0, speed_mps)


@pytest.fixture
def stage() -> FakeStage:
    return FakeStage()


def test_a_line_is_typed_with_the_coordinates_of_its_places(stage: FakeStage) -> None:
    assert Type("GCSA", "guided {away} 30").begin(stage).done()
    assert stage.deeds == [("GCSA", "guided 52.6800000 5.9250000 30")]


def test_a_kill_is_done_at_once(stage: FakeStage) -> None:
    assert Kill("companion").begin(stage).done()
    assert stage.deeds == [("companion", "SIGKILL")]


def test_a_crash_spares_the_supervisor(stage: FakeStage) -> None:
    assert Crash("companion").begin(stage).done()
    assert stage.deeds == [("companion", "its MAVProxy")]


def test_a_restart_is_done_at_once(stage: FakeStage) -> None:
    assert Restart("companion").begin(stage).done()
    assert stage.deeds == [("companion", "started again")]


def test_orders_to_the_links_are_done_when_the_proxy_says_so(stage: FakeStage) -> None:
    running = Impair(("cut ground-*", "loss air-GCSA 0.2")).begin(stage)
    assert stage.deeds == [("impairment", "cut ground-*"), ("impairment", "loss air-GCSA 0.2")]
    assert not running.done()
    stage.note("anything")
    assert running.done()


def test_the_world_has_changed_when_the_vehicle_says_so(stage: FakeStage) -> None:
    running = World("SIM_WIND_SPD", 17.0).begin(stage)
    assert stage.deeds == [("world", "SIM_WIND_SPD 17")]
    assert not running.done()
    stage.note("anything")
    assert running.done()


def test_the_position_box_has_done_it_when_it_says_so(stage: FakeStage) -> None:
    running = Box("drift 0 4").begin(stage)
    assert stage.deeds == [("box", "drift 0 4")]
    assert not running.done()
    stage.note("answered")
    assert running.done()


def test_what_is_somebody_s_to_command_is_not_the_world() -> None:
    with pytest.raises(ValueError, match="'RTL_ALT' must begin with SIM_ or HNDO_"):
        World("RTL_ALT", 0.0)


def test_an_order_to_no_link_is_refused() -> None:
    with pytest.raises(ValueError, match="'cut' must be an order and a link"):
        Impair(("cut",))


def test_a_wait_ends_with_the_entry_it_means_and_knows_its_time(stage: FakeStage) -> None:
    running = Wait("refused", "drone-1", match=Match((("station", "GCSB"), ("what", "*SET_MODE")))).begin(stage)
    stage.note("refused", station="GCSA", what="COMMAND_LONG/MAV_CMD_DO_SET_MODE")
    stage.note("accepted", station="GCSB", what="COMMAND_LONG/MAV_CMD_DO_SET_MODE")
    assert not running.done()
    stage.note("refused", station="GCSB", what="COMMAND_LONG/MAV_CMD_DO_SET_MODE")
    assert running.done()
    assert running.at == 2.0


def test_two_waits_for_the_same_event_mean_two_events(stage: FakeStage) -> None:
    stage.note("transfer_committed", station="GCSB")
    assert Wait("transfer_committed").begin(stage).done()
    second = Wait("transfer_committed").begin(stage)
    assert not second.done()
    stage.note("transfer_committed", station="GCSA")
    assert second.done()


def test_waits_in_a_row_do_not_mind_the_order_of_different_events(stage: FakeStage) -> None:
    stage.note("package_received")
    stage.note("mission_loaded")
    assert Wait("mission_loaded").begin(stage).done()
    assert Wait("package_received").begin(stage).done()


def test_a_wait_does_not_look_before_the_last_typed_line(stage: FakeStage) -> None:
    stage.note("refused")
    Type("GCSB", "mode RTL").begin(stage)
    assert not Wait("refused").begin(stage).done()
    assert Wait("refused", since="begin").begin(stage).done()


def test_a_wait_since_the_last_one_minds_the_order(stage: FakeStage) -> None:
    stage.note("zone_left")
    stage.note("transfer_committed")
    assert Wait("transfer_committed").begin(stage).done()
    assert not Wait("zone_left", since="last").begin(stage).done()


def test_waits_for_the_aircraft_end_when_it_shows_it(stage: FakeStage) -> None:
    waits = {
        "mode": WaitMode("RTL").begin(stage),
        "armed": WaitArmed(True).begin(stage),
        "ready": WaitReady(True).begin(stage),
        "item": WaitReached(3).begin(stage),
        "fast": WaitSpeed(above_mps=3).begin(stage),
        "high": WaitHeight(above_m=30).begin(stage),
    }
    assert {name for name, running in waits.items() if running.done()} == set()
    stage.fly(10.0, mode="RTL", alt_m=31.0)
    stage.watch.armed = stage.watch.position_ready = True
    stage.watch.reached = [1, 2, 3]
    assert {name for name, running in waits.items() if running.done()} == set(waits)


def test_landed_means_on_the_ground_and_disarmed(stage: FakeStage) -> None:
    running = WaitLanded(True).begin(stage)
    assert not running.done()
    stage.watch.landed, stage.watch.armed = True, True
    assert not running.done()
    stage.watch.armed = False
    assert running.done()


def test_near_a_place_is_measured_in_metres(stage: FakeStage) -> None:
    stage.fly(5.0)
    # 111.3 m of latitude and 67.6 m of longitude lie between: 130.2 m
    assert WaitNear("away", 131.0).begin(stage).done()
    assert not WaitNear("away", 129.0).begin(stage).done()


def test_a_pause_is_of_simulated_time(stage: FakeStage) -> None:
    running = Pause(5.0).begin(stage)
    stage.now_s = 4.9
    assert not running.done()
    stage.now_s = 5.0
    assert running.done()


def test_steady_holds_when_every_moment_does(stage: FakeStage) -> None:
    running = Steady(2.0, "flies on", mode="AUTO", above_mps=3.0).begin(stage)
    for speed in (9.0, 8.0, 7.0):
        stage.fly(speed)
        assert not running.done()
    stage.fly(6.0)
    assert running.done()
    assert running.seen() == "6.0 to 9.0 m/s, mode AUTO, over 2.0 s"


def test_steady_fails_at_the_first_moment_that_does_not(stage: FakeStage) -> None:
    running = Steady(2.0, "flies on", mode="AUTO", above_mps=3.0).begin(stage)
    stage.fly(9.0)
    assert not running.done()
    stage.fly(2.5)
    with pytest.raises(StepFailed, match=r"2\.5 to 9\.0 m/s"):
        running.done()


def test_steady_fails_when_the_mode_changes(stage: FakeStage) -> None:
    running = Steady(2.0, "flies on", mode="AUTO").begin(stage)
    stage.fly(9.0)
    running.done()
    stage.fly(9.0, mode="RTL")
    with pytest.raises(StepFailed, match="AUTO, RTL"):
        running.done()


def test_steady_does_not_judge_by_what_was_before_it(stage: FakeStage) -> None:
    stage.fly(0.0)
    stage.now_s += 0.1
    running = Steady(1.0, "flies on", above_mps=3.0).begin(stage)
    assert not running.done()
    assert running.seen() == "nothing was seen"


def test_the_guard_is_switched_past_everybody_who_commands(stage: FakeStage) -> None:
    Guard(False).begin(stage)
    Guard(True).begin(stage)
    assert stage.deeds == [("world", "HNDO_ENABLE 0"), ("world", "HNDO_ENABLE 1")]


def test_a_pilot_moves_his_switch_or_switches_off(stage: FakeStage) -> None:
    for position in (1, 6, 0):
        Transmit(position).begin(stage)
    assert stage.deeds == [("pilot", "1"), ("pilot", "6"), ("pilot", "None")]
    with pytest.raises(ValueError, match="7 must be 1 to 6, or 0: off"):
        Transmit(7)
