# SPDX-License-Identifier: GPL-3.0-or-later

"""How often links are measured, which of MAVProxy's the module writes to, and how it reads and ticks while it waits."""

from __future__ import annotations

import socket
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from tests.module.conftest import Bench
from tests.module.proxy import Master


def measured_in(bench: Bench, monkeypatch: pytest.MonkeyPatch, seconds: float, station: int = 251) -> int:
    """How often the links of a station are measured."""
    port = bench.companion.ports[station]
    tick, times = port.tick, []

    def counted(now: float) -> Any:
        times.append(now)
        return tick(now)

    monkeypatch.setattr(port, "tick", counted)
    bench.run(seconds)
    return len(times)


def test_single_links_are_measured_twice_a_second(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.connect()
    assert 3 <= measured_in(bench, monkeypatch, 2.0) <= 5


def test_several_links_of_one_station_are_measured_twenty_times_a_second(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = f'["udpout:127.0.0.1:{bench.b.port}"]'
    several = f'["udpout:127.0.0.1:{bench.b.port}", "udpout:127.0.0.1:9"]'
    text = bench.config.read_text()
    assert one in text
    bench.config.write_text(text.replace(one, several))
    bench.connect()
    assert 36 <= measured_in(bench, monkeypatch, 2.0, station=252) <= 41
    assert 3 <= measured_in(bench, monkeypatch, 2.0, station=251) <= 5


def test_frames_follow_mavproxy_to_another_link_though_the_former_is_still_there(bench: Bench) -> None:
    bench.connect()
    former, other = bench.mpstate.mav_master[0], Master()
    bench.mpstate.mav_master.append(other)
    bench.mpstate.settings.link = 2
    bench.clock.now += 0.25
    bench.mpstate.loop()
    former.written.clear()
    speed = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_CHANGE_SPEED, 0, 1, 7, -1, 0, 0, 0, 0)
    bench.a.send(speed)
    bench.clock.now += 0.05
    bench.mpstate.loop()
    assert any(speed.get_msgbuf()[10:-2] in raw for raw in other.written)
    assert former.written == []


class TestReading:
    """One datagram at a time where MAVProxy or we wait for the next, all there is where a link is only polled."""

    @staticmethod
    def readings(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> list[bool]:
        port = bench.companion.ports[251]
        read, seen = port.read, []

        def noted(link: Any, now: float, once: bool = False) -> Any:
            seen.append(once)
            return read(link, now, once)

        monkeypatch.setattr(port, "read", noted)
        return seen

    def test_is_one_at_a_time_when_mavproxy_calls_and_while_the_module_waits(
        self, bench: Bench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench.connect()
        link = bench.companion.ports[251].links[0]
        seen = self.readings(bench, monkeypatch)
        rounds = iter([([link.fileno()], False), ([], True)])
        monkeypatch.setattr("mavproxy_handover.companion.module.readable", lambda *_: next(rounds))
        function, argument = bench.mpstate.select_extra[link.fileno()]
        function(argument)
        assert seen == [True, True]

    def test_is_all_there_is_when_links_are_polled(self, bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
        bench.connect()
        bench.mpstate.select_extra.clear()
        seen = self.readings(bench, monkeypatch)
        requests = [mavlink.MAVLink_param_request_read_message(1, 1, b"", number) for number in range(5)]
        for request in requests:
            bench.a.send(request)
        bench.mpstate.mav_master[0].written.clear()
        bench.clock.now += 0.25
        bench.module.idle_task()
        assert seen
        assert not any(seen)
        written = bench.mpstate.mav_master[0].written
        asked = [
            raw for raw in written if raw[5] == 251 and raw[7:10] == bytes([20, 0, 0])
        ]  # others are the preflight's
        assert len(asked) == 5


class TestWaiting:
    @pytest.fixture
    def selected(self, bench: Bench, waited_for_far: socket.socket) -> Bench:
        """MAVProxy has a silent link to the autopilot that can be waited for; waiting moves the clock of the test."""
        bench.a.alive = bench.b.alive = False
        bench.run(1.0)
        bench.mpstate.mav_master[0].written.clear()
        return bench

    @staticmethod
    def talk(bench: Bench) -> None:
        for number in (1, 2):
            bench.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", number))
            bench.mpstate.loop()

    def test_ticks_come_when_they_are_due_and_not_at_its_end(
        self, selected: Bench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        self.talk(selected)
        ticks: list[float] = []
        monkeypatch.setattr(selected.companion, "tick", ticks.append)
        began = selected.clock.now
        selected.module._idle_at = began + 0.02
        selected.module.idle_task()
        assert ticks == [pytest.approx(began + 0.02)]

    def test_every_station_is_served(self, selected: Bench) -> None:
        self.talk(selected)
        selected.mpstate.mav_master[0].written.clear()
        request = mavlink.MAVLink_param_request_read_message(1, 1, b"", 77)
        selected.b.send(request)
        selected.module.idle_task()
        assert any(request.get_msgbuf()[10:-2] in raw for raw in selected.mpstate.mav_master[0].written)

    def test_a_single_frame_is_no_talk(self, selected: Bench) -> None:
        selected.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 1))
        selected.mpstate.loop()
        began = selected.clock.now
        selected.module.idle_task()
        assert selected.clock.now == began
