# SPDX-License-Identifier: GPL-3.0-or-later

"""Serial lines that take nothing: the main loop waits for none of them. Real processes, pseudo terminals."""

from __future__ import annotations

import os
import select
import sys
import threading
import time
import tty
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from tests.loopback.conftest import Autopilot, wait_for
from tests.loopback.test_restart_in_flight import Flight, SignedStation

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform != "linux", reason="only on Linux does the companion run supervised"),
]

#: between two leases: 0.4 s as docs/architecture.md promises, and what a busy computer adds. A write that blocks would
#: hold them up for as long as nobody reads
GAP_S = 2.0


@pytest.fixture
def station() -> Iterator[SignedStation]:
    made = SignedStation()
    yield made
    made.close()


@pytest.fixture
def flight(tmp_path: Path, autopilot: Autopilot, station: SignedStation) -> Iterator[Flight]:
    made = Flight(tmp_path, autopilot, station)
    yield made
    made.close()


def line(name: Path) -> tuple[int, int]:
    """Both ends of a pseudo terminal, raw; the near one is called `name`."""
    far, near = os.openpty()
    tty.setraw(far)
    tty.setraw(near)
    name.symlink_to(os.ttyname(near))
    return far, near


def is_full(near: int) -> bool:
    return not select.select([], [near], [], 0)[1]


def test_a_station_s_line_that_nobody_reads_holds_up_no_lease(flight: Flight, autopilot: Autopilot) -> None:
    far, near = line(flight.folder / "ttyRadio")
    flight.links.append(f"serial:{flight.folder / 'ttyRadio'}:921600")
    flight.fly()
    own = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    autopilot.flood = b"".join(mavlink.MAVLink_attitude_message(n, 0, 0, 0, 0, 0, 0).pack(own) for n in range(20))
    wait_for(lambda: is_full(near), lambda: "the line takes everything")
    begun = len(autopilot.held)
    time.sleep(6.0)
    times = [at for at, _nonce in autopilot.held[begun:]]
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert len(gaps) >= 15
    assert max(gaps) <= GAP_S
    # the kernel moves what it holds now and then, and has room for a moment
    wait_for(lambda: is_full(near), lambda: "the line has taken more")
    assert flight.events().count("loaded") == 1
    os.close(far)
    os.close(near)


class SerialAutopilot:
    """An autopilot at a serial line: it beats, and reads only while it is to."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.reads = True
        self.received: list[mavlink.MAVLink_message] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        own, parser = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), mavlink.MAVLink(None)
        parser.robust_parsing = True
        beat_at = 0.0
        while not self._done.is_set():
            if time.monotonic() >= beat_at:
                beat_at = time.monotonic() + 0.25
                os.write(self._descriptor, mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3).pack(own))
            if self.reads and select.select([self._descriptor], [], [], 0.02)[0]:
                self.received += parser.parse_buffer(os.read(self._descriptor, 65536)) or []
            else:
                time.sleep(0.02)

    def leases(self) -> list[int]:
        """The nonces of the leases."""
        return [
            int.from_bytes(m.payload[4:8], "little")
            for m in list(self.received)
            if m.get_type() == "TUNNEL" and m.payload_type == 47116
        ]

    def close(self) -> None:
        self._done.set()
        self._thread.join()


def test_an_autopilot_s_line_that_takes_nothing_stops_nothing_else(flight: Flight, station: SignedStation) -> None:
    """The stations hear who commands all the while, nobody is started again, and afterwards leases go on."""
    far, near = line(flight.folder / "ttyFC")
    aboard = SerialAutopilot(far)
    try:
        flight.autopilot.master = f"{flight.folder / 'ttyFC'},921600"
        flight.configure()
        flight.start()
        wait_for(lambda: len(aboard.leases()) > 5, flight.console)
        aboard.reads = False
        end = time.monotonic() + 30.0
        while not is_full(near):  # the commander asks more than the line takes
            for _ in range(40):
                station.send(mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0))
            assert time.monotonic() < end, "the line takes everything"
            time.sleep(0.05)
        begun = len(station.received)
        before = time.monotonic()
        heard: list[float] = []
        while time.monotonic() < before + 5.0:
            new = station.received[begun:]
            begun += len(new)
            heard += [time.monotonic()] * sum(m.get_type() == "AUTHORITY_STATUS" for m in new)
            time.sleep(0.01)
        assert len(heard) >= 5
        assert max(later - earlier for earlier, later in pairwise(heard)) < 0.5 + GAP_S
        assert is_full(near)
        leases = len(aboard.leases())
        aboard.reads = True
        wait_for(lambda: len(aboard.leases()) > leases + 5, flight.console)
        assert len(set(aboard.leases())) == 1
        assert flight.events().count("loaded") == 1
    finally:
        aboard.close()
        os.close(far)
        os.close(near)
