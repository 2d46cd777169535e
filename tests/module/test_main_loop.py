# SPDX-License-Identifier: GPL-3.0-or-later

"""While only stations speak, the module serves them itself; for anything else MAVProxy's loop goes on at once."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.supervision import main_loop
from mavproxy_handover.supervision.main_loop import poller, readable, waited_for
from tests.module.conftest import Bench

WAIT_S = 5.0


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    yield ends
    for end in ends:
        try:
            os.close(end)
        except OSError:
            pass


def proxy(masters: list[Any], outputs: tuple[Any, ...] = (), extra: tuple[int, ...] = ()) -> Any:
    return SimpleNamespace(
        mav_master=masters, mav_outputs=list(outputs), sysid_outputs={}, select_extra=dict.fromkeys(extra)
    )


def link(fd: int | None, dead: bool = False) -> Any:
    return SimpleNamespace(fd=fd, portdead=dead)


class TestWhatMavproxyWaitsFor:
    def test_is_every_link_and_every_module_s_descriptor(self) -> None:
        state = proxy([link(3), link(4)], (link(5), link(None)), (6, 7))
        state.sysid_outputs = {9: link(8)}
        assert waited_for(state) == [3, 4, 5, 8, 6, 7]

    @pytest.mark.parametrize("polled", [link(None), link(3, dead=True)], ids=["no descriptor", "dead"])
    def test_is_nothing_when_a_link_is_polled(self, polled: Any) -> None:
        assert waited_for(proxy([link(4), polled], extra=(6,))) == []

    def test_is_nothing_without_a_link(self) -> None:
        assert waited_for(proxy([], extra=(6,))) == []


class TestReadable:
    def test_names_what_is_ours(self, pipe: tuple[int, int]) -> None:
        os.write(pipe[1], b"x")
        assert readable(poller([pipe[0]]), [pipe[0]], WAIT_S) == ([pipe[0]], False)

    def test_anything_else_is_for_mavproxy_and_ours_is_named_all_the_same(self, pipe: tuple[int, int]) -> None:
        other = os.pipe()
        for _end, entry in (pipe, other):
            os.write(entry, b"x")
        assert readable(poller([pipe[0], other[0]]), [pipe[0]], WAIT_S) == ([pipe[0]], True)
        assert readable(poller([other[0]]), [pipe[0]], WAIT_S) == ([], True)
        for end in other:
            os.close(end)

    def test_waits_no_longer_than_it_may(self, pipe: tuple[int, int]) -> None:
        assert readable(poller([pipe[0]]), [pipe[0]], 0.001) == ([], False)

    @pytest.mark.parametrize("seconds", [0.0, -1.0])
    def test_looks_without_waiting_when_time_is_up(self, pipe: tuple[int, int], seconds: float) -> None:
        assert readable(poller([pipe[0]]), [pipe[0]], seconds) == ([], False)
        os.write(pipe[1], b"x")
        assert readable(poller([pipe[0]]), [pipe[0]], seconds) == ([pipe[0]], False)

    @pytest.mark.parametrize("descriptor", [-1, 1 << 20], ids=["none", "beyond select"])
    def test_a_descriptor_that_is_none_raises_nothing(self, descriptor: int) -> None:
        assert readable(poller([descriptor]), [descriptor], 0.001) == ([], True)

    def test_nor_does_one_that_is_closed(self, pipe: tuple[int, int]) -> None:
        os.close(pipe[0])
        assert readable(poller([pipe[0]]), [pipe[0]], 0.001) == ([], True)

    def test_is_told_in_seconds_and_waits_in_milliseconds(self) -> None:
        told: list[float] = []
        waiting: Any = SimpleNamespace(poll=lambda milliseconds: told.append(milliseconds) or [])
        assert readable(waiting, [], 0.05) == ([], False)
        assert told == [50.0]

    def test_without_anything_to_wait_for_it_does_not_wait(self) -> None:
        assert readable(poller([]), [], WAIT_S) == ([], True)


class TestTheModule:
    @pytest.fixture
    def busy(self, bench: Bench, waited_for_far: socket.socket) -> tuple[Bench, socket.socket]:
        """GCSA commands, and MAVProxy has a link to the autopilot that it can wait for: `far` is its other end."""
        bench.run(0.1)
        bench.mpstate.mav_master[0].written.clear()
        return bench, waited_for_far

    @staticmethod
    def handler(bench: Bench) -> Any:
        link = bench.companion.ports[251].links[0]
        return bench.mpstate.select_extra[link.fileno()]

    @staticmethod
    def talk(bench: Bench) -> None:
        """Two frames, one shortly after the other."""
        for number in (1, 2):
            bench.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", number))
            bench.mpstate.loop()

    @staticmethod
    def requests(bench: Bench) -> int:
        return sum(raw[7:10] == bytes([20, 0, 0]) for raw in bench.mpstate.mav_master[0].written)

    def test_serves_what_comes_while_it_is_there(
        self, busy: tuple[Bench, socket.socket], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench, _far = busy
        read = bench.module._serve
        to_send = 3

        def read_and_send_the_next(port: Any, link: Any, once: bool = False) -> None:
            nonlocal to_send
            read(port, link, once)
            if to_send:
                to_send -= 1
                bench.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", to_send))

        monkeypatch.setattr(bench.module, "_serve", read_and_send_the_next)
        function, argument = self.handler(bench)
        function(argument)  # MAVProxy calls once
        assert self.requests(bench) == 3
        assert bench.mpstate.escaped == []

    def test_goes_back_when_the_autopilot_speaks_with_what_waits_served_before(
        self, busy: tuple[Bench, socket.socket], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench, far = busy
        far.send(b"x")
        bench.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 1))
        read = bench.module._serve
        calls = []

        def read_and_send_another(port: Any, link: Any, once: bool = False) -> None:
            calls.append(port.name)
            read(port, link, once)
            bench.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 2))

        monkeypatch.setattr(bench.module, "_serve", read_and_send_another)
        function, argument = self.handler(bench)
        function(argument)
        assert calls == ["GCSA", "GCSA"]  # the one that MAVProxy called for, and the one that came meanwhile
        assert self.requests(bench) == 2

    def test_goes_back_after_a_twentieth_of_a_second_however_much_comes_and_its_ticks_go_on(
        self, busy: tuple[Bench, socket.socket], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench, _far = busy
        read = bench.module._serve
        calls = []

        def read_and_let_time_pass(port: Any, link: Any, once: bool = False) -> None:
            calls.append(bench.clock.now)
            bench.clock.now += 0.008
            read(port, link, once)
            bench.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", len(calls)))

        def tick(now: float) -> None:
            ticks.append(now)
            companion_tick(now)

        companion_tick, ticks = bench.companion.tick, []
        bench.module.idle_task()
        monkeypatch.setattr(bench.module, "_serve", read_and_let_time_pass)
        monkeypatch.setattr(bench.companion, "tick", tick)
        began = bench.clock.now
        function, argument = self.handler(bench)
        function(argument)
        assert 0.05 <= bench.clock.now - began <= 0.07
        assert len(ticks) == 1  # one every 50 ms
        assert len(calls) > 5

    @staticmethod
    def position(bench: Bench) -> None:
        message = mavlink.MAVLink_global_position_int_message(0, *[1] * 8)
        message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
        bench.mpstate.deliver(message)

    def test_a_frame_that_waits_goes_before_the_zone_check(
        self, busy: tuple[Bench, socket.socket], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench, far = busy
        self.talk(bench)
        steps: list[str] = []
        check, up = bench.companion.autopilot.zones.update, bench.companion.gate.up
        monkeypatch.setattr(bench.companion.autopilot.zones, "update", lambda now: (steps.append("zones"), check(now)))
        monkeypatch.setattr(bench.companion.gate, "up", lambda *frame: (steps.append("frame"), up(*frame))[1])
        bench.module._idle_at = bench.clock.now + 0.03
        self.position(bench)
        assert steps == []
        bench.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 3))
        began = bench.clock.now
        serve = bench.module._serve

        def serve_and_let_the_autopilot_speak(port: Any, link: Any, once: bool = False) -> None:
            serve(port, link, once)
            far.send(b"x")

        monkeypatch.setattr(bench.module, "_serve", serve_and_let_the_autopilot_speak)
        bench.module.idle_task()
        assert steps == ["frame", "zones"]
        assert bench.clock.now == began

    def test_without_talk_the_zone_check_comes_in_the_next_round(self, busy: tuple[Bench, socket.socket]) -> None:
        bench, _far = busy
        bench.module._idle_at = bench.clock.now + 0.03
        for _ in range(2):  # once for each position
            self.position(bench)
            assert bench.companion.autopilot.aircraft.uncompared
            bench.module.idle_task()
            assert not bench.companion.autopilot.aircraft.uncompared
            bench.clock.now += 0.04

    def test_several_busy_links_together_keep_mavproxy_no_longer_than_one(
        self, busy: tuple[Bench, socket.socket], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench, _far = busy
        serve = bench.module._serve

        def serve_and_let_time_pass(port: Any, link: Any, once: bool = False) -> None:
            bench.clock.now += 0.008
            serve(port, link, once)
            for station in (bench.a, bench.b):
                station.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 1))

        self.talk(bench)
        handlers = [bench.mpstate.select_extra[port.links[0].fileno()] for port in bench.companion.ports.values()]
        monkeypatch.setattr(bench.module, "_serve", serve_and_let_time_pass)
        began = bench.clock.now
        bench.module.idle_task()
        for function, argument in handlers:  # both are readable when MAVProxy looks
            function(argument)
        assert 0.05 <= bench.clock.now - began <= 0.1  # not 50 ms each

    def test_in_a_quiet_moment_ticks_go_on_and_mavproxy_gets_its_turn(
        self, busy: tuple[Bench, socket.socket], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench, _far = busy
        self.talk(bench)
        ticks: list[float] = []
        monkeypatch.setattr(bench.companion, "tick", ticks.append)
        began = bench.clock.now
        bench.module.idle_task()
        assert bench.clock.now - began == pytest.approx(0.05)
        assert 1 <= len(ticks) <= 2

    def test_where_no_station_speaks_mavproxy_waits_itself(self, busy: tuple[Bench, socket.socket]) -> None:
        bench, _far = busy
        bench.a.alive = bench.b.alive = False
        bench.run(0.5)
        began = bench.clock.now
        bench.module.idle_task()
        assert bench.clock.now == began

    def test_an_idle_round_goes_back_at_once_when_the_autopilot_speaks(self, busy: tuple[Bench, socket.socket]) -> None:
        bench, far = busy
        self.talk(bench)
        far.send(b"x")
        began = bench.clock.now
        bench.module.idle_task()
        assert bench.clock.now == began

    def test_a_download_that_waits_is_offered_to_its_link_every_two_milliseconds(
        self, busy: tuple[Bench, socket.socket], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """MAVProxy's own loop waits for up to 20 ms: at 1 MB/s a station's buffer is empty sooner."""
        bench, _far = busy
        bench.a.alive = bench.b.alive = False
        bench.run(0.5)
        offered: list[float] = []
        monkeypatch.setattr(bench.companion.gate.downloads, "wait", True)
        monkeypatch.setattr(bench.companion.gate.downloads, "send", offered.append)
        began = bench.clock.now
        bench.module.idle_task()
        assert bench.clock.now - began == pytest.approx(0.05)
        assert 25 <= len(set(offered)) <= 27

    def test_mavproxy_waits_itself_as_soon_as_the_download_is_sent(
        self, busy: tuple[Bench, socket.socket], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench, _far = busy
        bench.a.alive = bench.b.alive = False
        bench.run(0.5)
        bench.companion.gate.downloads.wait = True  # of which there is nothing
        began = bench.clock.now
        bench.module.idle_task()
        assert bench.clock.now == began

    @pytest.mark.parametrize("name", ["read", "fileno"])
    def test_whatever_a_link_raises_reaches_nobody(
        self, busy: tuple[Bench, socket.socket], monkeypatch: pytest.MonkeyPatch, name: str
    ) -> None:
        bench, _far = busy
        function, argument = self.handler(bench)
        link = bench.companion.ports[251].links[0]
        with monkeypatch.context() as broken:
            broken.setattr(link, "settled", False)
            broken.setattr(link, name, lambda *_: 1 / 0)
            function(argument)
        assert bench.companion.faults["link"] >= 1
        bench.run(1.0)
        assert bench.companion.view.commander == 251

    def test_a_fault_in_there_reaches_nobody(
        self, busy: tuple[Bench, socket.socket], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench, _far = busy
        monkeypatch.setattr("mavproxy_handover.companion.module.waited_for", lambda state: 1 / 0)
        bench.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 1))
        function, argument = self.handler(bench)
        function(argument)
        assert self.requests(bench) == 1
        assert bench.companion.faults["link"] == 1
        bench.run(1.0)
        assert bench.companion.view.commander == 251


@pytest.mark.parametrize("status", [SimpleNamespace(exit=False), SimpleNamespace(stop_event=threading.Event())])
def test_mavproxy_is_ended_as_its_version_has_it(status: SimpleNamespace) -> None:
    """Up to 1.8.74, and from 1.8.75 on."""
    mpstate = SimpleNamespace(status=status)
    assert not main_loop.is_ending(mpstate)
    main_loop.end(mpstate)
    assert main_loop.is_ending(mpstate)
    assert status.stop_event.is_set() if hasattr(status, "stop_event") else status.exit is True
