# SPDX-License-Identifier: GPL-3.0-or-later

"""A bench for the companion's module: MAVProxy, autopilot and two stations around it, in time that the test moves."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import ceil
from pathlib import Path
from typing import Any

import pytest

from gcs_module import module as gcs_module
from mavproxy_handover.companion import commands as vehicle_commands
from mavproxy_handover.companion import module as vehicle_module
from mavproxy_handover.companion.companion import Companion
from mavproxy_handover.core.common.events import Action, Event, Tick
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.uploads import package_reader
from mavproxy_handover.operator.uploads.prepared import Prepared, prepare
from mavproxy_handover.supervision.main_loop import readable
from mavproxy_handover.wire.package_transfer import PackageSender
from mavproxy_handover.wire.vehicle_address import pack_addresses
from tests.module import said
from tests.module.proxy import MPState
from tests.module.vehicle import Autopilot, Station
from tests.packages import ROUND

STEP_S = 0.05
#: where time only has to pass; a position that is older than 0.2 s is compared with no zone
WAIT_STEP_S = 0.19


class Clock:
    """Stands in for the module `time` where a module of ours asks for the time."""

    strftime = staticmethod(time.strftime)

    def __init__(self) -> None:
        self.now = 1000.0
        #: the time of day is this much later; signatures have to be of today
        self.utc_offset_s = time.time() - self.now

    def monotonic(self) -> float:
        return self.now

    def time(self) -> float:
        return self.now + self.utc_offset_s


#: what a mistake of ours raises; a fault that a test plants raises something else
MISTAKES = ("AssertionError", "AttributeError", "IndexError", "KeyError", "NameError", "TypeError", "ValueError")


class Bench:
    """The vehicle's module and everything around it."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self.clock = clock
        self.folder = folder
        self.mpstate = MPState()
        self.autopilot = Autopilot()
        self.a, self.b = Station("GCSA", 251), Station("GCSB", 252)
        self.config = folder / "handover.toml"
        self.configure()
        self.module: Any = None
        #: the test gives it what nobody can make sense of, and an internal fault is what comes of it
        self.breaks = False
        #: the autopilot answers until nothing more is written to it, all within one round
        self.answers_at_once = False
        #: done once in every round, besides
        self.each_round: Callable[[], None] = lambda: None

    def configure(self, guard: bool = True, more: str = "") -> None:
        """Write the configuration; `more` goes into [vehicle]."""
        self.config.write_text(
            f"""
            [vehicle]
            name = "drone-1"
            sysid = 1
            parent = "GCSA"
            journal = "companion.jsonl"
            guard = {str(guard).lower()}
            allow_unsigned = true
            {more}
            [[station]]
            name = "GCSA"
            sysid = 251
            sysids = [241]
            links = ["udpout:127.0.0.1:{self.a.port}"]
            [[station]]
            name = "GCSB"
            sysid = 252
            links = ["udpout:127.0.0.1:{self.b.port}"]
            """
        )

    def load(self, **kwargs: Any) -> Any:
        self.module = self.mpstate.load("handover", vehicle_module, config=str(self.config), **kwargs)
        return self.module

    @property
    def companion(self) -> Any:
        return self.module.companion

    def loop(self) -> None:
        """One round of MAVProxy's main loop, and what the others make of it."""
        self.each_round()
        self.mpstate.loop()
        for message in self.autopilot.step(self._written(), self.clock.now):
            self.mpstate.deliver(message)
        while self.answers_at_once and (written := self._written()):
            for message in self.autopilot.answers(written):
                self.mpstate.deliver(message)
        for station in (self.a, self.b):
            station.step(self.clock.now)

    def _written(self) -> list[bytes]:
        """What was written to the autopilot since this was last asked."""
        written: list[bytes] = []
        for master in self.mpstate.mav_master:
            written += master.written
            master.written.clear()
        return written

    def run(self, seconds: float, step_s: float = STEP_S) -> None:
        for _ in range(round(seconds / step_s)):
            self.clock.now += step_s
            self.loop()

    def wait(self, seconds: float) -> None:
        """So much time passes, in longer steps: what happens meanwhile is not looked at."""
        self.run(seconds, seconds / ceil(seconds / WAIT_STEP_S))

    def until(self, condition: Callable[[], Any], limit_s: float = 20.0) -> None:
        for _ in range(round(limit_s / STEP_S)):
            if condition():
                return
            self.run(STEP_S)
        raise AssertionError("it never came to that; " + "; ".join(self.mpstate.console.lines[-5:]))

    def decide(self, *actions: Action) -> None:
        """The arbiter gets one event and asks for these actions, and for nothing else."""
        arbiter = self.companion.arbiter
        handle = arbiter.handle

        def decided(_event: Event, _now: float) -> list[Action]:
            arbiter.handle = handle
            return list(actions)

        arbiter.handle = decided
        self.companion.handle(Tick(), self.clock.now)

    def connect(self) -> None:
        """Load, and wait until the parent commands and every need of START but the mission is met."""
        if self.module is None:
            assert self.load() is not None, self.mpstate.console.lines
        self.until(lambda: self.companion.view.commander == 251)
        self.wait(1.5)

    def share(self, package: MissionPackage, station: Station | None = None, *, at_once: bool = False) -> PackageSender:
        """Send a package from a station (GCSA) until the vehicle has said its last word of it. `at_once`: meanwhile
        the autopilot answers at once."""
        station = station or self.a
        addresses = pack_addresses(package.addresses)
        sender = PackageSender(
            package.to_bytes(), package.digest, package.name, (1, 191), until_loaded=True, addresses=addresses
        )
        seen = len(station.received)

        def done() -> bool:
            nonlocal seen
            for message in sender.tick(self.clock.now):
                station.send(message)
            while seen < len(station.received):
                message = station.received[seen]
                seen += 1
                if message.get_type() == "MISSION_PACKAGE_ACK":
                    for answer in sender.on_ack(message, self.clock.now):
                        station.send(answer)
            return sender.finished

        self.answers_at_once = at_once
        self.until(done)
        self.answers_at_once = False
        for holder in (self.a, self.b):
            holder.digest = package.digest
        return sender

    def journal(self, event: str | None = None) -> list[dict[str, Any]]:
        """Entries of the journal, of one event or all."""
        assert self.module is None or self.companion.wait_until_written(10.0)
        paths = (self.folder / "companion.jsonl", self.folder / "companion-strangers.jsonl")
        lines = [line for path in paths for line in path.read_text().splitlines()]
        entries = sorted((json.loads(line) for line in lines), key=lambda entry: entry["t"])
        return [entry for entry in entries if event in (None, entry["event"])]

    def needs(self) -> tuple[str, ...]:
        """What START of the parent still needs."""
        needs: tuple[str, ...] = self.companion.arbiter.start_needs(251, self.clock.now)
        return needs

    def faults(self) -> list[str]:
        """What broke inside, each by the last line of its traceback."""
        path = self.folder / "companion.jsonl"
        entries = [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []
        return [e["text"].strip().splitlines()[-1] for e in entries if e["event"] in ("fault", "failed_closed")]

    def close(self) -> None:
        if any(module.name == "handover" for module, _package in self.mpstate.modules):
            self.mpstate.unload("handover")
        self.a.close()
        self.b.close()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(vehicle_module, "time", clock)
    monkeypatch.setattr(vehicle_commands, "time", clock)
    return clock


@pytest.fixture(autouse=True)
def no_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """What runs beside the main loop is done at once: it is not the bench's clock that it takes its time by."""
    monkeypatch.setattr("mavproxy_handover.tools.worker.in_thread", lambda run: run())


@pytest.fixture(autouse=True)
def sentences(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every sentence that the companion says in a test is in the table of all sentences."""
    heard = said.listen(monkeypatch)
    yield
    assert said.unknown(heard) == []


@pytest.fixture(autouse=True)
def first_load(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Every test is the first in its process, and nothing outside it is found."""
    monkeypatch.setattr(vehicle_module, "_last", {})
    monkeypatch.setattr(gcs_module, "_last", {})
    monkeypatch.delenv("HANDOVER_CONFIG", raising=False)
    monkeypatch.chdir(tmp_path)


@pytest.fixture(autouse=True)
def nested_events(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """No event is handled inside another one: those that are, are listed here, and the test fails."""
    take = Companion._apply_event
    handled: list[str] = []
    nested: list[str] = []

    def counted(companion: Companion, event: Event, now: float) -> None:
        name = type(event).__name__
        if handled:
            nested.append(f"{name} inside {handled[-1]}")
        handled.append(name)
        try:
            take(companion, event, now)
        finally:
            handled.pop()

    monkeypatch.setattr(Companion, "_apply_event", counted)
    yield nested
    assert nested == []


@pytest.fixture(autouse=True)
def prepared_once(monkeypatch: pytest.MonkeyPatch, prepared: dict[object, Prepared]) -> None:
    """The route of a mission is walked once, not in every test. The results never change."""

    def once(package: MissionPackage) -> Prepared:
        key = package.digest, repr(package.addresses)
        if key not in prepared:
            prepared[key] = prepare(package)
        # a finder remembers where it was asked last
        return replace(prepared[key], finder=package.zone_finder())

    monkeypatch.setattr(package_reader, "prepare", once)


@pytest.fixture(scope="session")
def prepared() -> dict[object, Prepared]:
    """What was prepared of packages, by digest and addresses."""
    return {}


@pytest.fixture
def bench(clock: Clock, tmp_path: Path) -> Iterator[Bench]:
    """Not loaded yet. At the end nothing may have escaped from a callback, and nothing broken that was not planted."""
    bench = Bench(tmp_path, clock)
    yield bench
    bench.close()
    assert bench.mpstate.escaped == []
    assert bench.breaks or [text for text in bench.faults() if text.startswith(MISTAKES)] == []


@pytest.fixture(scope="session")
def delivery() -> MissionPackage:
    return mission_package.load(ROUND)


@pytest.fixture
def ready(bench: Bench, delivery: MissionPackage) -> Bench:
    """The parent commands, the mission is loaded, the guard answers."""
    bench.connect()
    bench.share(delivery, at_once=True)
    bench.wait(1.0)
    return bench


@pytest.fixture
def waited_for_far(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """Both stations are connected, and MAVProxy can wait for its link to the autopilot: this is that link's other end.

    Waiting in MAVProxy's place moves the clock of the test.
    """

    def wait_by_the_clock(waiting: Any, ours: list[int], seconds: float) -> tuple[list[int], bool]:
        found, others = readable(waiting, ours, min(seconds, 1e-4))
        if not found and not others:
            bench.clock.now += max(seconds, 0.0)
        return found, others

    bench.connect()
    monkeypatch.setattr("mavproxy_handover.companion.module.readable", wait_by_the_clock)
    near, far = socket.socketpair()
    master: Any = bench.mpstate.mav_master[0]
    master.fd, master.portdead = near.fileno(), False
    yield far
    near.close()
    far.close()
