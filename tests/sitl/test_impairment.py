# SPDX-License-Identifier: GPL-3.0-or-later

"""Bad links: each effect alone in virtual time, the same on every run; then the proxies as a process on loopback."""

from __future__ import annotations

import itertools
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from sitl.run.bad_links import BadLinks, LinkPlan, load_plans, main
from sitl.run.impairment import Impairment
from sitl.script.weather import Weather, WeatherError
from sitl.vehicles.ports import LOOPBACK, PortPicker

ROOT = Path(__file__).resolve().parents[2]


def fates(link: Impairment, count: int, every_s: float = 0.01) -> list[list[float]]:
    """Delays of the arrivals of datagrams sent one after the other."""
    return [
        [round(at - number * every_s, 9) for at, _data in link.plan(b"%d" % number, number * every_s)]
        for number in range(count)
    ]


def lost(link: Impairment, count: int) -> list[int]:
    return [number for number, fate in enumerate(fates(link, count)) if not fate]


# ---- the model ----------------------------------------------------------------------------------------------------


def test_a_perfect_link_changes_nothing() -> None:
    assert Impairment(1).plan(b"frame", 7.0) == [(7.0, b"frame")]


def test_the_same_seed_gives_the_same_fate_and_another_seed_another() -> None:
    weather = Weather(loss=0.1, to_bad=0.05, delay_s=0.1, jitter_s=0.05, reorder=0.1, duplicate=0.1)
    first, again, other = (fates(Impairment(seed, weather), 500) for seed in ("7/up", "7/up", "7/down"))
    assert first == again
    assert first != other


def test_the_luck_of_a_seed_is_the_same_on_every_machine() -> None:
    # written down once: if it changes, scenarios of the past do not repeat
    assert lost(Impairment(1, Weather(loss=0.2)), 30) == [2, 4, 7, 9, 15, 21, 24]


def test_loss_is_as_frequent_as_asked_for() -> None:
    assert len(lost(Impairment(3, Weather(loss=0.2)), 10_000)) == pytest.approx(2000, abs=120)


def test_turning_one_knob_does_not_change_the_luck_of_the_others() -> None:
    plain = lost(Impairment(5, Weather(loss=0.2)), 300)
    more = Weather(loss=0.2, delay_s=0.2, jitter_s=0.1, reorder=0.3, duplicate=0.3)
    assert lost(Impairment(5, more), 300) == plain


def test_bursts_are_as_long_and_as_frequent_as_asked_for() -> None:
    gone = lost(Impairment(2, Weather(to_bad=0.02, to_good=0.25)), 20_000)
    bursts = 1 + sum(after - before > 1 for before, after in itertools.pairwise(gone))
    # a share of 0.02 / (0.02 + 0.25) of the time is bad, in bursts of 4 on average
    assert len(gone) / 20_000 == pytest.approx(0.074, abs=0.015)
    assert len(gone) / bursts == pytest.approx(4.0, abs=0.5)


def test_a_cut_link_lets_nothing_through_and_heals() -> None:
    link = Impairment(1)
    link.change(cut=True)
    assert fates(link, 20) == [[]] * 20
    link.change(cut=False)
    assert link.plan(b"frame", 1.0) == [(1.0, b"frame")]
    assert (link.passed, link.lost) == (1, 20)


def test_a_rhythm_lets_through_for_a_while_and_then_not_again_and_again() -> None:
    link = Impairment(4, Weather(on_s=0.5, off_s=1.5))
    assert [now for now in (0.0, 0.25, 0.5, 1.0, 1.75, 2.0, 2.25, 2.5) if link.plan(b"frame", now)] == [
        0.0,
        0.25,
        2.0,
        2.25,
    ]
    link.change(off_s=0.0)
    assert link.plan(b"frame", 3.0) == [(3.0, b"frame")]


def test_delay_and_jitter_are_added_and_the_order_is_kept() -> None:
    link = Impairment(1, Weather(delay_s=0.1, jitter_s=0.05))
    delays = [delay for (delay,) in fates(link, 500)]
    assert min(delays) >= 0.1
    assert max(delays) <= 0.15
    assert max(delays) - min(delays) > 0.04
    arrivals = [round(delay + number * 0.01, 6) for number, delay in enumerate(delays)]
    assert arrivals == sorted(arrivals)


def test_a_reordered_datagram_is_passed_by_those_behind_it() -> None:
    link = Impairment(4, Weather(reorder=0.1, reorder_s=0.025))
    delays = [delay for (delay,) in fates(link, 200)]
    assert set(delays) == {0.0, 0.025}
    assert delays.count(0.025) == pytest.approx(20, abs=12)


def test_a_duplicate_is_the_same_datagram_twice() -> None:
    link = Impairment(1, Weather(duplicate=1.0, delay_s=0.1))
    assert link.plan(b"frame", 1.0) == [(1.1, b"frame"), (1.1, b"frame")]


def test_a_slow_link_sends_one_datagram_after_the_other_and_loses_what_does_not_fit() -> None:
    link = Impairment(1, Weather(rate_bytes_per_s=1000, queue_s=0.25))
    arrivals = [link.plan(bytes(100), 0.0) for _ in range(5)]
    assert [[round(at, 6) for at, _data in plan] for plan in arrivals] == [[0.1], [0.2], [0.3], [], []]
    assert [round(at, 6) for at, _data in link.plan(bytes(100), 10.0)] == [10.1]


def test_the_weather_changes_at_the_times_set_beforehand() -> None:
    link = Impairment(1)
    link.schedule(20.0, cut=False, delay_s=0.5)
    link.schedule(10.0, cut=True)
    assert [link.plan(b"frame", now) for now in (9.9, 10.0, 19.9, 20.0)] == [
        [(9.9, b"frame")],
        [],
        [],
        [(20.5, b"frame")],
    ]


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"loss": 1.5}, "loss = 1.5: must be 0 to 1"),
        ({"delay_s": -0.1}, "delay_s = -0.1: must be 0 to 60"),
        ({"duplicate": float("nan")}, "duplicate = nan: must be 0 to 1"),
        ({"jitter_s": True}, "jitter_s = True: must be 0 to 60"),
        ({"off_s": -1.0}, "off_s = -1.0: must be 0 to 60"),
        ({"cut": 1}, "cut = 1: must be true or false"),
        ({"los": 0.1}, "los: must be one of loss, "),
    ],
)
def test_a_value_that_no_link_has_is_named(changes: dict[str, object], line: str) -> None:
    link = Impairment(1)
    with pytest.raises(WeatherError) as error:
        link.change(**changes)
    assert str(error.value).startswith(line)
    with pytest.raises(WeatherError):
        link.schedule(1.0, **changes)
    assert link.weather == Weather()


# ---- configuration and orders -------------------------------------------------------------------------------------

CONFIG = """
seed = 7
[[link]]
name = "wifi"
listen = 14560
target = 14550
[link.up]
loss = 0.1
[link.down]
delay_s = 0.05
[[link.timeline]]
at_s = 20
direction = "down"
cut = true
[[link]]
name = "lte"
listen = 14561
target = 14551
vehicle = "target"
[[link.timeline]]
at_s = 5.5
jitter_s = 0.1
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "links.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_configuration_is_read_as_written(tmp_path: Path) -> None:
    assert load_plans(written(tmp_path, CONFIG)) == (
        "7",
        [
            LinkPlan(
                "wifi",
                14560,
                14550,
                False,
                Weather(loss=0.1),
                Weather(delay_s=0.05),
                ((20.0, ("down",), {"cut": True}),),
            ),
            LinkPlan("lte", 14561, 14551, True, timeline=((5.5, ("up", "down"), {"jitter_s": 0.1}),)),
        ],
    )


@pytest.mark.parametrize(
    ("before", "after", "line"),
    [
        ("loss = 0.1", "loss = 2", "loss = 2: must be 0 to 1"),
        ("loss = 0.1", "lost = 0.1", "lost: must be one of loss, "),
        ("listen = 14560", "listen = 0", "link wifi: listen = 0: must be a port, 1 to 65535"),
        ("target = 14550", "", "link wifi: target = None: must be a port, 1 to 65535"),
        ('name = "lte"', 'name = "wifi"', "[[link]] must be there at least once, each with a name of its own"),
        ('name = "lte"', 'name = "l te"', "link name = 'l te': must be a word, and not 'all'"),
        ('vehicle = "target"', 'vehicle = "air"', "link lte: vehicle = 'air': must be listen or target"),
        ('direction = "down"', 'direction = "left"', "direction 'left': must be up or down"),
        ("at_s = 5.5", "at_s = -1", "link lte: timeline at_s = -1: must be 0 or more"),
        ("seed = 7", "seeds = 7", "seeds: must be one of seed, link"),
        ("seed = 7", "seed = ", ""),
    ],
)
def test_a_configuration_error_is_one_line_that_names_file_and_value(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], before: str, after: str, line: str
) -> None:
    assert before in CONFIG
    path = written(tmp_path, CONFIG.replace(before, after, 1))
    assert main(["--config", str(path)]) == 2
    (shown,) = capsys.readouterr().err.splitlines()
    assert shown.startswith(f"impairment: {path}: {line}")


@pytest.fixture
def links() -> Iterator[BadLinks]:
    ports = PortPicker()
    plans = [LinkPlan(name, ports.udp(), ports.udp()) for name in ("wifi", "lte")]
    made = BadLinks("1", plans, 0.0)
    yield made
    made.close()


def weather(links: BadLinks, name: str, way: str) -> Weather:
    return links._proxies[name].weather[way].weather


def test_orders_change_the_weather_of_the_link_and_direction_they_name(links: BadLinks) -> None:
    assert links.order("cut wifi") == "ok cut wifi"
    assert links.order("loss lte 0.2 up") == "ok loss lte 0.2 up"
    assert links.order("delay all 0.3 down") == "ok delay all 0.3 down"
    assert weather(links, "wifi", "up") == Weather(cut=True)
    assert weather(links, "wifi", "down") == Weather(cut=True, delay_s=0.3)
    assert weather(links, "lte", "up") == Weather(loss=0.2)
    assert weather(links, "lte", "down") == Weather(delay_s=0.3)
    assert links.order("on_s lte 0.3 down") == "ok on_s lte 0.3 down"
    assert links.order("off_s lte 4.7 down") == "ok off_s lte 4.7 down"
    assert weather(links, "lte", "down") == Weather(delay_s=0.3, on_s=0.3, off_s=4.7)
    assert links.order("heal wifi down") == "ok heal wifi down"
    assert weather(links, "wifi", "down") == Weather(delay_s=0.3)
    assert links.order("clear all") == "ok clear all"
    assert {weather(links, name, way) for name in ("wifi", "lte") for way in ("up", "down")} == {Weather()}
    assert links.order("show").startswith("ok wifi up: 0 passed, 0 lost; wifi down: ")


@pytest.mark.parametrize(
    "line",
    [
        "",
        "cut",
        "cut sea",
        "loss wifi",
        "loss wifi much",
        "loss wifi 2",
        "luck wifi 1",
        "cut wifi left",
        "cut wifi up 1",
    ],
)
def test_an_order_that_makes_no_sense_is_answered_and_changes_nothing(links: BadLinks, line: str) -> None:
    answer = links.order(line)
    assert answer.startswith("error: ")
    assert "\n" not in answer
    assert {weather(links, name, way) for name in ("wifi", "lte") for way in ("up", "down")} == {Weather()}


# ---- the process --------------------------------------------------------------------------------------------------


class Running:
    """`python -m sitl.run.bad_links` with one link, and a program on either side of it."""

    def __init__(self, folder: Path) -> None:
        ports = PortPicker()
        self.listen = ports.udp()
        self.station = self._socket()
        target = self.station.getsockname()[1]
        text = f'[[link]]\nname = "wifi"\nlisten = {self.listen}\ntarget = {target}\n'
        self.process = subprocess.Popen(
            [sys.executable, "-m", "sitl.run.bad_links", "--config", str(written(folder, text))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=ROOT,
            text=True,
        )
        self.vehicle = self._socket()
        assert self.line() == "ready"

    @staticmethod
    def _socket() -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind((LOOPBACK, 0))
        sock.settimeout(10)
        return sock

    def line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().rstrip("\n")

    def order(self, text: str) -> str:
        assert self.process.stdin is not None
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()
        return self.line()

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()
        self.station.close()
        self.vehicle.close()


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    made = Running(tmp_path)
    yield made
    made.close()


@pytest.mark.process
def test_datagrams_pass_both_ways_and_cut_delay_and_duplicates_work_on_real_sockets(running: Running) -> None:
    running.vehicle.sendto(b"telemetry", (LOOPBACK, running.listen))
    data, proxy = running.station.recvfrom(100)
    assert data == b"telemetry"
    running.station.sendto(b"command", proxy)
    assert running.vehicle.recv(100) == b"command"

    assert running.order("cut wifi up") == "ok cut wifi up"
    running.station.sendto(b"lost", proxy)
    running.vehicle.sendto(b"still passes", (LOOPBACK, running.listen))
    assert running.station.recv(100) == b"still passes"
    assert running.order("heal wifi") == "ok heal wifi"

    assert running.order("delay wifi 0.2 up") == "ok delay wifi 0.2 up"
    assert running.order("duplicate wifi 1 up") == "ok duplicate wifi 1 up"
    sent_at = time.monotonic()
    running.station.sendto(b"late", proxy)
    assert running.vehicle.recv(100) == b"late"  # and not b"lost"
    assert time.monotonic() - sent_at >= 0.2
    assert running.vehicle.recv(100) == b"late"


@pytest.mark.process
def test_strangers_do_not_get_in_from_behind(running: Running) -> None:
    running.vehicle.sendto(b"telemetry", (LOOPBACK, running.listen))
    _data, proxy = running.station.recvfrom(100)
    stranger = running._socket()
    stranger.sendto(b"forged", proxy)
    running.station.sendto(b"command", proxy)
    assert running.vehicle.recv(100) == b"command"
    stranger.close()


@pytest.mark.process
def test_it_ends_when_its_input_does(running: Running) -> None:
    assert running.process.stdin is not None
    running.process.stdin.close()
    assert running.process.wait(10) == 0
    running.process.stdin = None


@pytest.mark.process
def test_a_port_in_use_is_told_and_ends_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Running._socket() as taken:
        port = taken.getsockname()[1]
        path = written(tmp_path, f'[[link]]\nname = "wifi"\nlisten = {port}\ntarget = 14550\n')
        assert main(["--config", str(path)]) == 2
    assert "Address already in use" in capsys.readouterr().err
