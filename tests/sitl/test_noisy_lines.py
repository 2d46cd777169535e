# SPDX-License-Identifier: GPL-3.0-or-later

"""Serial lines with noise: the noise that was asked for, the bytes in between, and a link that is not deaf for long."""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
import serial

from mavproxy_handover.link.devices import open_device
from mavproxy_handover.tools.schedule import TICK_S
from mavproxy_handover.wire.frames import Frame, FrameSplitter
from sitl.run.noise import LineNoise
from sitl.run.noisy_lines import main
from sitl.run.processes import Child, Processes
from sitl.script.weather import NoiseLevel, WeatherError
from tests.link.frames import Clock, answer, command, heartbeat, read_frames, read_until
from tests.link.test_link_serial import Cable

CLEAN = NoiseLevel()


# ---- what noise is ------------------------------------------------------------------------------------------------


def test_a_clean_line_changes_nothing() -> None:
    noise = LineNoise(1, CLEAN, 0.0)
    assert noise.carry(bytes(range(256)), 1e9) == bytes(range(256))
    assert (noise.damaged, noise.bursts) == (0, 0)


@pytest.mark.parametrize("piece", [1, 7, 10_000])
def test_bytes_are_damaged_as_often_as_asked_for_by_one_bit_whatever_pieces_they_come_in(piece: int) -> None:
    noise = LineNoise(3, NoiseLevel(damage=0.01), 0.0)
    found = b"".join(noise.carry(bytes(piece), 0.0) for _ in range(100_000 // piece))
    assert sum(byte != 0 for byte in found) == noise.damaged == pytest.approx(1000, abs=100)
    assert {byte.bit_count() for byte in found} == {0, 1}
    assert found == LineNoise(3, NoiseLevel(damage=0.01), 0.0).carry(bytes(100_000 // piece * piece), 0.0)


def test_every_byte_may_be_damaged() -> None:
    assert 0 not in LineNoise(1, NoiseLevel(damage=1.0), 0.0).carry(bytes(100), 0.0)


def test_bursts_come_as_often_as_asked_for_whether_anything_is_sent_or_not() -> None:
    noise = LineNoise(3, NoiseLevel(bursts_per_s=2.0), 0.0)
    arrived = b"".join(noise.carry(b"", second / 10) for second in range(10_000))
    assert noise.bursts == pytest.approx(2000, abs=140)
    assert len(arrived) > 10_000
    assert arrived.count(b"\xfd\xff\x00") > 100  # what makes a parser wait


def test_the_luck_of_a_seed_is_the_same_on_every_machine() -> None:
    # written down once: if it changes, scenarios of the past do not repeat
    noise = LineNoise(1, NoiseLevel(damage=0.2, bursts_per_s=1.0), 0.0)
    assert noise.burst_at == pytest.approx(0.277647, abs=1e-6)
    assert noise.carry(bytes(12), 0.2).hex() == "000000000200404000000000"


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"damage": 1.1}, "damage = 1.1: must be 0 to 1"),
        ({"damage": -0.1}, "damage = -0.1: must be 0 to 1"),
        ({"damage": True}, "damage = True: must be 0 to 1"),
        ({"bursts_per_s": float("nan")}, "bursts_per_s = nan: must be 0 to 1000"),
    ],
)
def test_a_noise_that_no_line_has_is_refused(values: dict[str, float], line: str) -> None:
    with pytest.raises(WeatherError, match=line):
        NoiseLevel(**values)


# ---- a link that is not deaf --------------------------------------------------------------------------------------


def test_a_station_on_a_noisy_line_is_heard_within_a_third_of_a_second(tmp_path: Path) -> None:
    """Heartbeats and answers to probes, once a second each, for ten minutes, and the device that ships. A splitter that
    waits for the end of whatever has begun gets the same bytes."""
    clock, cable = Clock(), Cable(tmp_path / "ttyRADIO")
    line = open_device(f"serial:{cable.name}:57600", clock)
    noise = LineNoise(5, NoiseLevel(damage=0.0005, bursts_per_s=2.0), clock.now)
    patient = FrameSplitter()
    on_their_way: dict[str, dict[bytes, float]] = {"ours": {}, "patient": {}}
    late_s: dict[str, list[float]] = {"ours": [], "patient": []}

    def heard(who: str, frames: list[Frame]) -> None:
        for frame in frames:
            sent_at = on_their_way[who].pop(frame.raw, None)
            if sent_at is not None:
                late_s[who].append(clock.now - sent_at)

    sent = 0
    for tick in range(round(600 / TICK_S)):
        clock.now += TICK_S
        data = b""
        if tick % 10 == 0:
            seq = tick // 10 % 256
            data = heartbeat(seq).raw if tick % 20 else answer(tick, seq).raw
        damaged = noise.damaged
        arrived = noise.carry(data, clock.now)
        if data and noise.damaged == damaged:
            sent += 1
            for waiting in on_their_way.values():
                waiting[data] = clock.now
        if arrived:
            os.write(cable.far, arrived)
            wanted = line.counters.bytes_in + len(arrived)
            heard("ours", read_until(line, partial(lambda wanted: line.counters.bytes_in == wanted, wanted)))
        elif line.unfinished:
            heard("ours", line.read())
        heard("patient", patient.feed(arrived))
    line.close()
    cable.unplug()
    assert (sent > 1150, noise.bursts > 1100, noise.damaged > 5) == (True, True, True)
    assert len(late_s["ours"]) >= 0.99 * sent
    assert max(late_s["ours"]) <= 0.3 + 1e-6
    assert max(late_s["patient"]) > 2.0


# ---- the program that stands in the line --------------------------------------------------------------------------


LINE = """
[[line]]
name = "GCSA"
near = "{folder}/vehicle-GCSA"
{far}
baud = 921600
{more}
"""


@pytest.fixture
def processes() -> Iterator[Processes]:
    with Processes() as running:
        yield running


def started(processes: Processes, folder: Path, more: str = "", port: int | None = None) -> Child:
    config = folder / "lines.toml"
    far = f'far = "{folder}/GCSA"' if port is None else ""
    config.write_text(LINE.format(folder=folder, far=far, more=more))
    argv = [sys.executable, "-m", "sitl.run.noisy_lines", "--config", str(config)]
    argv += [] if port is None else ["--autopilot", str(port)]
    child = processes.start("lines", argv, folder)
    until = time.monotonic() + 60.0
    while "ready" not in child.console():
        assert child.alive(), child.console()
        assert time.monotonic() < until
        time.sleep(0.02)
    return child


@pytest.mark.process
def test_bytes_go_both_ways_between_the_companions_device_and_the_stations(
    processes: Processes, tmp_path: Path
) -> None:
    child = started(processes, tmp_path)
    device = open_device(f"serial:{tmp_path}/vehicle-GCSA:921600")
    station = serial.Serial(str(tmp_path / "GCSA"), 921600, timeout=30.0)
    assert device.write(command(1).raw)
    assert station.read(len(command(1).raw)) == command(1).raw
    station.write(heartbeat(2).raw + command(3).raw)
    assert read_frames(device, 2) == [heartbeat(2), command(3)]
    station.close()
    device.close()
    child.stop()
    *_, down, up = child.console()
    assert down == f"GCSA down: {len(command(1).raw)} bytes, 0 lost, 0 damaged, 0 bursts"
    assert up.startswith("GCSA up: ")


@pytest.mark.process
def test_to_be_told_to_end_in_the_midst_of_the_end_costs_no_summary(processes: Processes, tmp_path: Path) -> None:
    child = started(processes, tmp_path)
    until = time.monotonic() + 60.0
    while child.alive():
        child.ask_to_end()  # standard input ends at the first, a signal comes with each
        assert time.monotonic() < until
    # behind its last word Python gives the signal back to the system: how the process ends may be by it
    assert [line.split(":")[0] for line in child.console()] == ["ready", "GCSA down", "GCSA up"]


@pytest.mark.process
def test_noise_comes_though_nobody_speaks(processes: Processes, tmp_path: Path) -> None:
    started(processes, tmp_path, "bursts_per_s = 200.0")
    device = open_device(f"serial:{tmp_path}/vehicle-GCSA:921600")
    read_until(device, lambda: device.counters.garbage_bytes > 100)
    device.close()


@pytest.mark.process
def test_the_autopilots_line_ends_at_its_tcp_port(processes: Processes, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        started(processes, tmp_path, port=server.getsockname()[1])
        autopilot, _address = server.accept()
    with autopilot:
        autopilot.settimeout(10.0)
        device = open_device(f"serial:{tmp_path}/vehicle-GCSA:921600")
        assert device.write(heartbeat(1).raw)
        assert autopilot.recv(100) == heartbeat(1).raw
        autopilot.sendall(command(2).raw)
        assert read_frames(device, 1) == [command(2)]
        device.close()


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "[[line]] must be there at least once"),
        ("[[lines]]\n", "lines: must be one of line"),
        ("[[line]]\nname = 3\n", "name and near must be texts"),
        ('[[line]]\nname = "A"\nnear = "/x"\nbaud = 300\n', "baud = 300: must be 1200 to 4000000"),
        ('[[line]]\nname = "A"\nnear = "/x"\nbaud = 9600\ndamage = 2\n', "damage = 2: must be 0 to 1"),
        ("[[line]\n", "lines.toml: "),
    ],
)
def test_a_configuration_that_makes_no_lines_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, part: str
) -> None:
    path = tmp_path / "lines.toml"
    path.write_text(text)
    assert main(["--config", str(path)]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(f"lines: {path}: ")
    assert part in said
