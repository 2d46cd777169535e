# SPDX-License-Identifier: GPL-3.0-or-later

"""Two bad links and a station, in virtual time: the bundle keeps its promises on links as the simulation makes them."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable
from functools import partial

import pytest

from mavproxy_handover.link.bundle import LinkBundle
from mavproxy_handover.link.quality import LinkEventKind
from mavproxy_handover.link.timesync import TIMESYNC, probe_answer, probe_message
from mavproxy_handover.wire.frames import Frame, parse_one
from sitl.run.impairment import Impairment
from sitl.script.weather import Weather
from tests.link.frames import Draw, FakeDevice, command, frame_of, heartbeat

TICK_S = 0.01
TELEMETRY_S = 0.02


class Air:
    """Companion and station with a wifi and an lte link between them, and nothing else."""

    def __init__(self, seed: int, wifi: Weather, lte: Weather, *, answers: bool = True) -> None:
        self.now = 1000.0
        self.answers = answers
        self.down = {"wifi": Impairment(f"{seed}/wifi/down", wifi), "lte": Impairment(f"{seed}/lte/down", lte)}
        self.up = {"wifi": Impairment(f"{seed}/wifi/up", wifi), "lte": Impairment(f"{seed}/lte/up", lte)}
        self.devices = {name: FakeDevice(name, self._sender(name)) for name in self.down}
        self.bundle = LinkBundle(list(self.devices.values()), self._probe, Draw())
        self.at_station: list[tuple[float, str, bytes]] = []  #: telemetry: when, on what link
        self.at_vehicle: list[Frame] = []  #: what the bundle passed on
        self.events: list[str] = []
        self._heap: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._seq = dict.fromkeys(self.down, 0)
        self._telemetry_at = self.now
        self._sent = 0

    def _probe(self, stamp: int) -> bytes:
        return frame_of(probe_message(stamp), sysid=1, compid=240).raw

    def _sender(self, name: str) -> Callable[[bytes], None]:
        def send(data: bytes) -> None:
            for at, copy in self.down[name].plan(data, self.now):
                self._later(at, partial(self._reach_station, name, copy))

        return send

    def _later(self, at: float, job: Callable[[], None]) -> None:
        heapq.heappush(self._heap, (at, next(self._order), job))

    def _reach_station(self, name: str, data: bytes) -> None:
        frame = parse_one(data)
        if frame is None:
            self.at_station.append((self.now, name, data))
        elif frame.msgid == TIMESYNC and self.answers:
            reply = probe_answer(frame, 1)
            for link in self.up:  # as a station's module does: on all its links, each with its own numbers
                self.send(link, frame_of(reply, self.next_seq(link)))

    def next_seq(self, name: str) -> int:
        self._seq[name] = (self._seq[name] + 1) & 0xFF
        return self._seq[name]

    def send(self, name: str, frame: Frame) -> None:
        """The station sends a frame on a link."""
        for at, data in self.up[name].plan(frame.raw, self.now):
            self._later(at, partial(self._reach_vehicle, name, data))

    def _reach_vehicle(self, name: str, data: bytes) -> None:
        frame = parse_one(data)
        assert frame is not None
        self.devices[name].inbox.append(frame)

    def run(self, seconds: float) -> None:
        """Time goes on, with telemetry down fifty times a second."""
        until = self.now + seconds
        while self.now < until - 1e-9:
            self.now += TICK_S
            while self._heap and self._heap[0][0] <= self.now:
                heapq.heappop(self._heap)[2]()
            for device in self.devices.values():
                for frame in self.bundle.read(device, self.now):
                    if self.bundle.accept(device, frame, self.now):
                        self.at_vehicle.append(frame)
            self.events += [event.text for event in self.bundle.tick(self.now) if event.kind is LinkEventKind.SWITCHED]
            if self.now >= self._telemetry_at:
                self._telemetry_at += TELEMETRY_S
                self._sent += 1
                self.bundle.write(b"telemetry %d" % self._sent)

    def longest_gap_s(self, since: float) -> float:
        """The longest time the station was without telemetry that was sent after `since`."""
        times = [since, *(at for at, _name, _data in self.at_station if at > since), self.now]
        return max(after - before for before, after in itertools.pairwise(times))


WIFI = Weather(delay_s=0.005, jitter_s=0.005)
LTE = Weather(delay_s=0.05, jitter_s=0.03)


@pytest.mark.parametrize("seed", range(5))
def test_when_wifi_is_cut_telemetry_is_missing_for_less_than_a_second(seed: int) -> None:
    air = Air(seed, WIFI, LTE)
    air.run(5.0)
    assert {name for at, name, _data in air.at_station if at > 1002.0} == {"wifi"}
    for way in (air.up, air.down):
        way["wifi"].change(cut=True)
    cut_at = air.now
    air.run(5.0)
    assert 0.5 < air.longest_gap_s(cut_at) < 1.0
    assert air.events[-1] == "downlink on lte now: wifi does not answer"


@pytest.mark.parametrize("seed", range(5))
def test_when_only_the_way_down_is_cut_it_takes_no_longer(seed: int) -> None:
    air = Air(seed, WIFI, LTE)
    air.run(5.0)
    air.down["wifi"].change(cut=True)
    cut_at = air.now
    air.run(5.0)
    assert air.longest_gap_s(cut_at) < 1.0
    assert air.at_station[-1][1] == "lte"


def test_a_station_that_answers_no_probes_has_no_gap_of_a_second_either() -> None:
    air = Air(1, WIFI, LTE, answers=False)
    for second in range(20):
        for link in air.up:
            air.send(link, heartbeat(air.next_seq(link)))
        if second == 10:
            for way in (air.up, air.down):
                way["wifi"].change(cut=True)
        air.run(1.0)
    assert air.longest_gap_s(1000.0) < 1.0


@pytest.mark.parametrize("seed", range(5))
def test_no_command_is_lost_or_doubled_while_wifi_is_cut_and_heals(seed: int) -> None:
    """The station sends each command by both links, as a router does."""
    air = Air(seed, WIFI, LTE)
    for number in range(400):
        for link in air.up:
            air.send(link, command(number & 0xFF, 1000 + number))
        if number == 100:
            air.up["wifi"].change(cut=True)
        if number == 300:
            air.up["wifi"].change(cut=False)
        air.run(0.05)
    air.run(1.0)
    passed = [int.from_bytes(frame.payload[28:30], "little") for frame in air.at_vehicle]
    assert sorted(passed) == list(range(1000, 1400))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_fifth_lost_each_way_moves_the_downlink_rarely_and_never_stops_it(seed: int) -> None:
    bad = {"loss": 0.2}
    air = Air(seed, WIFI.changed(**bad), LTE.changed(**bad))
    air.run(120.0)
    assert air.longest_gap_s(1005.0) < 1.0
    assert len(air.events) <= 20


def test_bursts_jitter_reordering_and_duplicates_leave_every_command_single() -> None:
    weather = Weather(
        loss=0.05, to_bad=0.02, to_good=0.3, delay_s=0.02, jitter_s=0.04, reorder=0.05, reorder_s=0.1, duplicate=0.0
    )
    air = Air(4, weather, weather.changed(delay_s=0.3))
    for number in range(1000):
        for link in air.up:
            air.send(link, command(number & 0xFF, number))
        air.run(0.02)
    air.run(2.0)
    passed = [int.from_bytes(frame.payload[28:30], "little") for frame in air.at_vehicle]
    assert len(passed) == len(set(passed))
    assert len(passed) > 950


def test_both_links_cut_and_healed_work_again() -> None:
    air = Air(2, WIFI, LTE)
    air.run(5.0)
    for way in (air.up, air.down):
        for link in way.values():
            link.change(cut=True)
    air.run(10.0)
    healed_at = air.now
    for way in (air.up, air.down):
        for link in way.values():
            link.change(cut=False)
    air.run(5.0)
    assert air.longest_gap_s(healed_at) < 0.2
    assert air.at_station[-1][1] == "wifi"
