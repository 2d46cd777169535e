# SPDX-License-Identifier: GPL-3.0-or-later

"""The simulated position box: what it sends, and each way in which it breaks. Its client is the companion's own."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavproxy_handover.link.box_line import BoxLine, Fix
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.wire.box_layout import FULL, THESIS, BoxLayout
from sitl.run.data_box import LOW_PRESSURE_M, DataBox
from sitl.script.box_orders import parse_order
from sitl.vehicles import VehicleSpec, launch
from sitl.vehicles.ports import PortPicker

HOME = (52.679, 5.924)


class Bench:
    """A box and its client, in time that the test moves."""

    def __init__(self, layout: BoxLayout = THESIS) -> None:
        self.now = 50.0
        self.box = DataBox("127.0.0.1", 0, self.clock, layout)
        self.line = BoxLine(f"tcp:127.0.0.1:{self.box.port}", self.clock, layout=layout)

    def clock(self) -> float:
        return self.now

    def state(self, lat: float, lon: float) -> mavlink.MAVLink_sim_state_message:
        place = round(lat * 1e7), round(lon * 1e7)
        turn = (0.0, 0.0, -math.pi / 2)
        return mavlink.MAVLink_sim_state_message(*[0.0] * 4, *turn, *[0.0] * 8, 12.0, 0.0, 0.0, 1.0, 2.0, -0.5, *place)

    def run(self, seconds: float) -> Fix | None:
        """The newest fix of so long, with a record every 0.04 s."""
        last = None
        for _ in range(round(seconds / 0.04)):
            self.now += 0.04
            self.box.turn()
            self.box.readable()
            self.box.on_message(self.state(*HOME))
            time.sleep(0.0005)
            last = self.line.read() or last
        return last

    def close(self) -> None:
        self.line.close()
        self.box.close()


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


@pytest.fixture
def full() -> Iterator[Bench]:
    made = Bench(FULL)
    yield made
    made.close()


def test_it_sends_where_the_simulation_has_the_aircraft(bench: Bench) -> None:
    """In the thesis's record, with a barometer on a day of low pressure, and UTC."""
    fix = bench.run(3.0)
    assert fix is not None
    record = fix.record
    assert (record.lat_deg, record.lon_deg) == pytest.approx(HOME, abs=1e-7)
    assert (record.north_mps, record.east_mps, record.down_mps) == (1.0, 2.0, -0.5)
    assert (record.baro_m, record.agl_m) == (12.0 + LOW_PRESSURE_M, 0.0)
    assert (record.track_deg, record.speed_mps) == pytest.approx((63.4349, 2.23607), abs=1e-4)
    assert record.heading_deg == pytest.approx(270.0)
    assert record.time_s == pytest.approx(time.time(), abs=30.0)
    assert math.isnan(record.alt_m)
    assert fix.late_s < 0.1
    assert bench.line.counters.connects == 1, "cut at every byte, and never in doubt"
    assert bench.line.counters.records >= 70


def test_states_that_were_waiting_together_are_one_record(bench: Bench) -> None:
    """The fault: on a busy machine two were read within 0.1 ms; the second record ended the stream as out of time."""
    bench.run(1.0)
    for _ in range(5):
        bench.now += 0.00005
        bench.box.on_message(bench.state(*HOME))
    assert bench.run(1.0) is not None
    assert bench.line.counters.connects == 1


def test_it_sends_the_other_layout_as_well(full: Bench) -> None:
    fix = full.run(1.0)
    assert fix is not None
    record = fix.record
    assert (record.alt_m, record.north_mps, record.east_mps, record.down_mps) == (12.0, 1.0, 2.0, -0.5)
    assert record.time_s == pytest.approx(1.0, abs=0.1)
    assert math.isnan(record.battery_v)


def test_its_layout_is_changed(bench: Bench) -> None:
    bench.run(1.0)
    assert bench.box.order("full") == "ok full"
    fix = bench.run(2.0)
    assert fix is not None
    assert bench.line.counters.connects == 2
    assert fix.record.agl_m == 1.0, "read as before: the velocity to the north"
    assert fix.record.time_s < 5.0


def test_it_stalls_and_goes_on(bench: Bench) -> None:
    bench.run(1.0)
    assert bench.box.order("stall") == "ok stall"
    assert bench.run(1.0) is None
    assert bench.line.open
    assert bench.box.order("resume") == "ok resume"
    assert bench.run(0.5) is not None


def test_it_cuts_connections(bench: Bench) -> None:
    bench.run(1.0)
    bench.box.order("cut")
    assert bench.run(1.5) is not None
    assert bench.line.counters.connects == 2


def test_utc_goes_on_over_a_restart(bench: Bench) -> None:
    before = bench.run(1.0)
    bench.box.order("restart 2")
    bench.run(1.5)
    fix = bench.run(4.0)
    assert before is not None
    assert fix is not None
    assert fix.record.time_s - before.record.time_s == pytest.approx(5.5, abs=0.2)


def test_it_restarts_with_a_clock_of_its_own(full: Bench) -> None:
    bench = full
    bench.run(1.0)
    bench.box.order("restart 2")
    assert bench.run(1.5) is None
    assert "refused" in bench.line.trouble.lower()
    fix = bench.run(4.0)
    assert fix is not None
    assert fix.record.time_s == pytest.approx(3.5, abs=0.2)


def test_it_drifts_and_finds_back(bench: Bench) -> None:
    bench.run(1.0)
    bench.box.order("drift 3 -4")
    fix = bench.run(2.0)
    assert fix is not None
    record = fix.record
    assert distance_m(*HOME, record.lat_deg, record.lon_deg) == pytest.approx(10.0, abs=0.5)
    assert record.lat_deg > HOME[0]
    assert record.lon_deg < HOME[1]
    assert (record.north_mps, record.east_mps) == (4.0, -2.0)
    bench.box.order("drift 0 0")
    stays = bench.run(2.0)
    assert stays is not None
    assert distance_m(*HOME, stays.record.lat_deg, stays.record.lon_deg) == pytest.approx(10.0, abs=0.5)
    bench.box.order("true")
    fix = bench.run(0.5)
    assert fix is not None
    assert (fix.record.lat_deg, fix.record.lon_deg) == pytest.approx(HOME, abs=1e-7)


def test_it_is_carried_to_a_place_at_a_pace_and_stays_there(bench: Bench) -> None:
    bench.run(1.0)
    assert bench.box.order("carry 30 -40 5") == "ok carry 30 -40 5"
    fix = bench.run(4.0)
    assert fix is not None
    assert distance_m(*HOME, fix.record.lat_deg, fix.record.lon_deg) == pytest.approx(20.0, abs=0.5)
    assert (fix.record.north_mps, fix.record.east_mps) == pytest.approx((4.0, -2.0))
    fix = bench.run(8.0)
    assert fix is not None
    assert distance_m(*HOME, fix.record.lat_deg, fix.record.lon_deg) == pytest.approx(50.0, abs=0.01)
    assert (fix.record.north_mps, fix.record.east_mps) == (1.0, 2.0)
    bench.box.order("carry 30 0 10")
    fix = bench.run(2.0)
    assert fix is not None
    assert distance_m(*HOME, fix.record.lat_deg, fix.record.lon_deg) == pytest.approx((30**2 + 20**2) ** 0.5, abs=0.7)


def test_it_babbles(bench: Bench) -> None:
    bench.run(1.0)
    bench.box.order("garbage")
    assert bench.run(1.5) is not None
    assert bench.line.counters.connects == 2
    assert bench.line.counters.errors == 1


def test_a_client_that_does_not_read_is_left_behind(bench: Bench) -> None:
    bench.run(0.5)
    for _ in range(200_000):
        bench.now += 0.04
        bench.box.on_message(bench.state(*HOME))
        if len(bench.box.descriptors) == 1:
            break
    assert len(bench.box.descriptors) == 1


@pytest.mark.parametrize(
    "line",
    ["", "fly", "drift", "drift 1", "drift a b", "drift nan 1", "stall 3", "restart -1", "carry 1 2", "carry 1 2 0"],
)
def test_what_is_no_order_is_told_and_changes_nothing(bench: Bench, line: str) -> None:
    assert bench.box.order(line).startswith("error: ")
    with pytest.raises(ValueError, match=r"must be|takes"):
        parse_order(line)
    assert bench.run(1.0) is not None


# ---- as a program ---------------------------------------------------------------------------------------------------


def test_it_serves_a_simulated_vehicle_until_its_input_ends(tmp_path: Path) -> None:
    vehicle = launch("builtin", VehicleSpec(home=(*HOME, 10.0, 90.0)), tmp_path)
    port = PortPicker().tcp()
    argv = [sys.executable, "-m", "sitl.run.data_box", "--vehicle", vehicle.address(0), "--listen", f"127.0.0.1:{port}"]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            line = BoxLine(f"tcp:127.0.0.1:{port}")
            fix = within(10.0, line.read)
            line.close()
            assert distance_m(*HOME, fix.record.lat_deg, fix.record.lon_deg) < 0.1
            assert fix.record.baro_m == pytest.approx(10.0 + LOW_PRESSURE_M, abs=0.1)
            assert fix.record.agl_m == pytest.approx(0.0, abs=0.1)
            assert fix.record.heading_deg == pytest.approx(90.0, abs=1.0)
            process.stdin.write("stall\nnonsense\n")
            process.stdin.flush()
            assert process.stdout.readline() == "ok stall\n"
            assert process.stdout.readline().startswith("error: 'nonsense' must be one of")
            process.stdin.close()
            assert "records sent, to 1 connections" in process.stdout.readline()
            assert process.wait(10) == 0
        finally:
            process.kill()
            vehicle.stop()


def within(seconds: float, what: Callable[[], Fix | None]) -> Fix:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = what()
        if found is not None:
            return found
        time.sleep(0.02)
    raise AssertionError(f"nothing within {seconds} s")


def test_without_a_vehicle_there_is_no_box() -> None:
    port = PortPicker().tcp()
    argv = [sys.executable, "-m", "sitl.run.data_box", "--vehicle", f"tcp:127.0.0.1:{port}", "--listen", "127.0.0.1:9"]
    ended = subprocess.run(argv, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=30, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith("data box: ")
    assert ended.stderr.count("\n") == 1
