# SPDX-License-Identifier: GPL-3.0-or-later

"""In flight the main loop touches no file: a disk may hang for seconds, and the lease goes out from there.

Python tells of every file that is opened, renamed or removed (audit events); what it does not tell of is wrapped. The
copy of the state in memory is no disk.
"""

from __future__ import annotations

import gc
import os
import stat
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.mission.package import MissionPackage
from tests.module.conftest import Bench
from tests.module.test_handover import IN_A, IN_BOTH
from tests.module.test_restart import with_rules
from tests.module.test_station_module import StationBench, station
from tests.module.vehicle import AUTO
from tests.packages import ROUND

__all__ = ["station"]

START, LAND = mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_NAV_LAND
_TOLD = ("open", "os.rename", "os.remove", "os.link", "os.mkdir", "os.listdir", "os.scandir", "os.truncate", "os.chmod")


class Touched:
    """What the main thread does to files while `on`."""

    def __init__(self) -> None:
        self.on = False
        self.what: list[tuple[Any, ...]] = []

    def hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.on and event in _TOLD and threading.current_thread() is threading.main_thread():
            self.what.append((event, *arguments[:2]))

    def descriptor(self, call: str, descriptor: int) -> None:
        ours = self.on and threading.current_thread() is threading.main_thread()
        if ours and stat.S_ISREG(os.fstat(descriptor).st_mode):
            self.what.append((call, os.readlink(f"/proc/self/fd/{descriptor}")))


_TOUCHED = Touched()
sys.addaudithook(_TOUCHED.hook)  # there is no way to take one away again


@pytest.fixture
def touched(monkeypatch: pytest.MonkeyPatch) -> Iterator[Touched]:
    for call in ("fsync", "fdatasync", "write"):
        real = getattr(os, call)

        def watched(descriptor: int, *data: Any, call: str = call, real: Any = real) -> Any:
            _TOUCHED.descriptor(call, descriptor)
            return real(descriptor, *data)

        monkeypatch.setattr(os, call, watched)
    _TOUCHED.what.clear()
    yield _TOUCHED
    _TOUCHED.on = False


def test_what_is_watched_is_noticed(touched: Touched, tmp_path: Any) -> None:
    """Or the tests below would prove nothing."""
    touched.on = True
    descriptor = os.open(tmp_path / "a", os.O_WRONLY | os.O_CREAT)
    os.write(descriptor, b"x")
    os.fsync(descriptor)
    os.close(descriptor)
    os.replace(tmp_path / "a", tmp_path / "b")
    (tmp_path / "b").unlink()
    touched.on = False
    assert [what[0] for what in touched.what] == ["open", "write", "fsync", "os.rename", "os.remove"]


def test_a_handover_touches_no_file(bench: Bench, delivery: MissionPackage, touched: Touched) -> None:
    bench.connect()
    touched.on = True
    bench.share(delivery)
    with_rules(bench, delivery)
    bench.run(1.5)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    bench.autopilot.position = IN_BOTH
    bench.until(lambda: bench.companion.view.commander == 252)
    bench.a.command(LAND)  # refused
    bench.run(5.0)
    touched.on = False
    assert touched.what == []
    assert bench.companion.faults == {}
    assert bench.autopilot.mode == AUTO


@pytest.mark.parametrize(
    "line", ["status", "stations", "zones", "help", "release", "stop", "nonsense", "give GCSB", "set"]
)
def test_no_command_touches_a_file(bench: Bench, delivery: MissionPackage, touched: Touched, line: str) -> None:
    bench.connect()
    bench.share(delivery)
    touched.on = True
    bench.mpstate.type(f"handover {line}")
    bench.run(0.5)
    touched.on = False
    assert touched.what == []


def test_a_station_going_about_its_work_touches_no_file(station: StationBench, touched: Touched) -> None:
    station.configure(ROUND)
    station.load()
    station.run(1.0)
    touched.on = True
    for line in ("status", "share", "request", "stop", "accept", "nonsense"):
        station.mpstate.type(f"handover {line}")
        station.run(1.5)
    touched.on = False
    assert touched.what == []


def test_a_disk_that_hangs_holds_up_no_lease_and_no_handover(
    bench: Bench, delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Issue: with 1.6 s for each fsync 3.2 s went by between two leases, and the guard flew home."""
    free, fsync = threading.Event(), os.fsync

    def hangs(descriptor: int) -> None:
        assert threading.current_thread() is not threading.main_thread(), "the disk is waited for"
        assert free.wait(30.0)
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", hangs)
    bench.connect()
    bench.share(delivery)
    with_rules(bench, delivery)
    bench.run(1.5)
    bench.a.command(START)
    bench.until(lambda: bench.companion.view.phase is Phase.ON_MISSION)
    for position, commander in ((IN_BOTH, 252), (IN_A, 251)):
        bench.autopilot.position = position
        bench.until(lambda commander=commander: bench.companion.view.commander == commander, limit_s=60.0)  # type: ignore[misc]
    free.set()
    assert bench.companion.faults == {}
    assert bench.companion.wait_until_written(10.0)


def test_what_is_loaded_is_not_looked_through_for_garbage_in_flight(bench: Bench) -> None:
    before = gc.get_freeze_count()
    bench.load()
    assert gc.get_freeze_count() > before
    bench.mpstate.unload("handover")
    assert gc.get_freeze_count() == 0
