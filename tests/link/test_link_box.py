# SPDX-License-Identifier: GPL-3.0-or-later

"""The client of the position box on loopback: the newest record; what ends, stalls or is not believed."""

from __future__ import annotations

import contextlib
import math
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import pytest

from mavproxy_handover.link.box_line import MOST_WAIT_S, SILENT_S, BoxLine, Fix
from mavproxy_handover.link.forms import LinkError
from mavproxy_handover.wire.box_layout import THESIS, BoxRecord
from tests.link.frames import Clock
from tests.link.test_link_tcp import LOOPBACK, free_port, listener

HERE = BoxRecord(100.0, 52.679, 5.924, 42.0, 3.0, -4.0, -1.5, 0.1, -0.2, 350.0, 12.5, 50.0, 10.0, 307.0, 5.0)


class Bench:
    """A box's end and the client's, in time that the test moves."""

    def __init__(self, closing: contextlib.ExitStack) -> None:
        self.clock = Clock()
        self._closing = closing
        self.server = listener(closing)
        self.port: int = self.server.getsockname()[1]
        self.line = BoxLine(f"tcp:{LOOPBACK}:{self.port}", self.clock)
        closing.callback(self.line.close)
        self.box: socket.socket | None = None
        #: the box's own clock runs beside ours, from a beginning of its own
        self.began = self.clock() - 7.0

    def accept(self) -> socket.socket:
        """Take the connection, and send the record that only sets the time."""
        self.box = self._closing.enter_context(self.server.accept()[0])
        self.until(lambda: self.line.open)
        self.comes(self.record())
        self.clock.now += 0.01
        return self.box

    def record(self, late_s: float = 0.0, **changed: float) -> bytes:
        return THESIS.pack(replace(HERE, time_s=self.clock() - self.began - late_s, **changed))

    def send(self, data: bytes) -> None:
        assert self.box is not None
        self.box.sendall(data)

    def until(self, condition: Callable[[], bool]) -> Fix | None:
        """Read until it is so, in a bounded time of the real clock; the last fix."""
        last = None
        end = time.monotonic() + 10.0
        while True:
            last = self.line.read() or last
            if condition():
                return last
            assert time.monotonic() < end, self.line.trouble
            time.sleep(0.001)

    def comes(self, data: bytes) -> Fix | None:
        """Send this, and read until all of it is there."""
        wanted = self.line.counters.bytes_in + len(data)
        self.send(data)
        return self.until(lambda: self.line.counters.bytes_in >= wanted)


@pytest.fixture
def bench() -> Iterator[Bench]:
    with contextlib.ExitStack() as stack:
        yield Bench(stack)


def test_it_connects_and_hands_out_the_newest(bench: Bench) -> None:
    bench.accept()
    data = b""
    for _ in range(5):
        bench.clock.now += 0.02
        data += bench.record()
    fix = bench.comes(data)
    assert fix is not None
    assert fix.record.time_s == pytest.approx(bench.clock() - bench.began)
    assert fix.record.lat_deg == pytest.approx(52.679)
    assert bench.line.counters.records == 5
    assert bench.line.read() is None, "each record once"


@pytest.mark.parametrize("cut", [1, 8, 55])
def test_a_record_in_two_pieces(bench: Bench, cut: int) -> None:
    bench.accept()
    data = bench.record()
    assert bench.comes(data[:cut]) is None
    assert bench.comes(data[cut:]) is not None


def test_nobody_listens_and_later_somebody_does() -> None:
    with contextlib.ExitStack() as closing:
        clock, port = Clock(), free_port()
        line = BoxLine(f"tcp:{LOOPBACK}:{port}", clock)
        closing.callback(line.close)
        attempts = []
        for _ in range(400):  # 20 s
            clock.now += 0.05
            before = line.counters.errors
            line.read()
            if line.counters.errors > before:
                attempts.append(clock.now)
        assert "refused" in line.trouble.lower()
        waits = [later - earlier for earlier, later in pairwise(attempts)]
        assert max(waits) <= MOST_WAIT_S + 0.11
        assert min(waits[-4:]) >= MOST_WAIT_S - 0.11, "they grow rarer"
        server = listener(closing, port)
        clock.now += MOST_WAIT_S
        line.read()
        box = closing.enter_context(server.accept()[0])
        box.sendall(THESIS.pack(HERE) + THESIS.pack(replace(HERE, time_s=100.1)))
        end = time.monotonic() + 10.0
        while line.read() is None:
            assert time.monotonic() < end
            clock.now += 0.001
        assert line.trouble == ""


def test_an_unknown_host_is_a_fault_of_this_machine() -> None:
    with pytest.raises(LinkError, match=r"link tcp:no\.such\.host\.invalid:1 cannot be opened"):
        BoxLine("tcp:no.such.host.invalid:1")


@pytest.mark.parametrize("text", ["udpin:127.0.0.1:4001", "tcpin:127.0.0.1:4001", "/dev/ttyS0", "tcp:127.0.0.1", 4001])
def test_what_is_no_tcp_server_is_refused(text: object) -> None:
    with pytest.raises(LinkError, match="tcp:HOST:PORT"):
        BoxLine(text)  # type: ignore[arg-type]


def test_what_came_before_the_end_counts(bench: Bench) -> None:
    bench.accept().sendall(bench.record())
    assert bench.box is not None
    bench.box.close()
    fix = bench.until(lambda: not bench.line.open)
    assert fix is not None
    assert bench.line.trouble == "closed by the other side"


def test_it_comes_back_after_a_restart_of_the_box(bench: Bench) -> None:
    bench.accept()
    assert bench.comes(bench.record()) is not None
    assert bench.box is not None
    bench.box.close()
    bench.until(lambda: not bench.line.open)
    bench.clock.now += 0.5
    bench.began = bench.clock()  # its clock begins anew
    bench.line.read()
    bench.accept()
    fix = bench.comes(bench.record())
    assert fix is not None
    assert fix.record.time_s == pytest.approx(0.01)
    assert fix.late_s == pytest.approx(0.0, abs=1e-3)
    assert bench.line.counters.connects == 2


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"\xff" * 200, "Time nan"),
        (THESIS.pack(replace(HERE, lat_deg=math.nan, time_s=math.nan)), "Time nan"),
        (b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\nConnection: close\r\n\r\n", "must be"),
    ],
    ids=["noise", "NaN", "a web server"],
)
def test_what_is_not_believed_ends_the_connection(bench: Bench, data: bytes, says: str) -> None:
    bench.accept()
    bench.send(data)
    assert bench.until(lambda: not bench.line.open) is None
    assert says in bench.line.trouble
    bench.clock.now += 1.0
    bench.line.read()
    bench.accept()
    assert bench.comes(bench.record()) is not None, "the next connection begins anew"


def test_who_sends_nonsense_is_asked_ever_more_rarely(bench: Bench) -> None:
    for _ in range(600):  # 30 s
        bench.clock.now += 0.05
        bench.server.settimeout(0.0)
        with contextlib.suppress(BlockingIOError):
            accepted, _ = bench.server.accept()
            accepted.sendall(b"\xff" * THESIS.size)
            accepted.close()
        bench.line.read()
    assert 8 <= bench.line.counters.connects <= 20
    assert bench.line.counters.records == 0


def test_time_that_runs_backwards_ends_the_connection(bench: Bench) -> None:
    bench.accept()
    assert bench.comes(bench.record()) is not None
    bench.send(bench.record(late_s=1.0))
    bench.until(lambda: not bench.line.open)
    assert "backwards" in bench.line.trouble


def test_a_box_that_stalls_is_connected_to_anew(bench: Bench) -> None:
    bench.accept()
    assert bench.comes(bench.record()) is not None
    bench.clock.now += SILENT_S - 0.1
    assert bench.line.read() is None
    assert bench.line.open
    bench.clock.now += 0.2
    assert bench.line.read() is None
    assert not bench.line.open
    assert bench.line.trouble == "nothing new for 3 s"


def test_a_box_that_says_the_same_without_end_stalls_as_well(bench: Bench) -> None:
    bench.accept()
    same = bench.record()
    assert bench.comes(same) is not None
    for _ in range(70):
        bench.clock.now += 0.05
        if not bench.line.open:
            break
        bench.comes(same)
    assert not bench.line.open


def test_what_waited_in_a_buffer_is_late(bench: Bench) -> None:
    bench.accept()
    for _ in range(10):
        bench.clock.now += 0.1
        fix = bench.comes(bench.record())
        assert fix is not None
        assert fix.late_s == pytest.approx(0.0, abs=0.01)
    bench.clock.now += 2.0
    fix = bench.comes(bench.record(late_s=1.5))
    assert fix is not None
    assert fix.late_s == pytest.approx(1.5, abs=0.01)


def test_a_flood_is_read_in_bounded_bites_and_makes_itself_late(bench: Bench) -> None:
    box = bench.accept()
    box.setblocking(False)
    flood = memoryview(b"".join(THESIS.pack(replace(HERE, time_s=8.0 + step * 1e-3)) for step in range(20_000)))
    most, latest = 0, 0.0
    while bench.line.counters.records < 20_000:
        with contextlib.suppress(BlockingIOError):
            flood = flood[box.send(flood) :]
        bench.clock.now += 1.0  # a thousand records, and fewer are read
        before = bench.line.counters.bytes_in
        fix = bench.line.read()
        most = max(most, bench.line.counters.bytes_in - before)
        latest = latest if fix is None else max(latest, fix.late_s)
        assert bench.line.trouble == ""
    assert 0 < most <= 4 * 8192
    assert latest > 1.0


def test_after_closing_nothing_is_open(bench: Bench) -> None:
    bench.accept()
    assert len(bench.line.descriptors()) == 1
    bench.line.close()
    bench.line.close()
    assert bench.line.read() is None
    assert bench.line.descriptors() == []
