# SPDX-License-Identifier: GPL-3.0-or-later

"""The module under a supervisor: its signs of life, what it is told at its start, and its lock."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import serial

from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.lock import LockError, VehicleLock, lock_line
from mavproxy_handover.supervision.child import close_journal
from mavproxy_handover.supervision.watchdog_pipe import Told, WatchdogPipe, hold
from tests.module.conftest import Bench
from tests.module.test_restart import kill

Hold = Callable[..., Callable[[], bytes]]


@pytest.fixture
def held() -> Iterator[Hold]:
    """Gives this process a watchdog pipe; what it returns reads the signs so far."""
    descriptors: list[int] = []

    def give(why: str = "", leases: bool = True) -> Callable[[], bytes]:
        reader, writer = os.pipe()
        os.set_blocking(reader, False)
        descriptors.extend((reader, writer))
        hold(WatchdogPipe(writer, Told(why, leases)))

        def signs() -> bytes:
            try:
                return os.read(reader, 65536)
            except BlockingIOError:
                return b""

        return signs

    yield give
    hold(None)
    for descriptor in descriptors:
        os.close(descriptor)


def test_the_main_loop_gives_ten_signs_a_second(bench: Bench, held: Hold) -> None:
    signs = held()
    bench.load()
    assert signs() == b"", "to be loaded is no life yet"
    bench.run(2.0)
    assert signs() == b"." * 20


@pytest.fixture
def service_manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], list[bytes]]]:
    """A service manager with a watchdog of nine seconds; what it returns are the words so far."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "9000000")
        monkeypatch.delenv("WATCHDOG_PID", raising=False)

        def words() -> list[bytes]:
            found = []
            with suppress(BlockingIOError):
                while True:
                    found.append(listening.recv(4096))
            return found

        yield words


def test_without_a_supervisor_the_service_manager_hears_of_the_main_loop_itself(
    bench: Bench, service_manager: Callable[[], list[bytes]]
) -> None:
    """`handover companion` becomes MAVProxy where it cannot supervise it: the unit is the same."""
    bench.load()
    assert service_manager() == [], "to be loaded is no life yet"
    bench.run(1.0)
    assert service_manager() == [b"READY=1", b"WATCHDOG=1"]
    bench.wait(9.0)
    assert service_manager() == [b"WATCHDOG=1"] * 3
    bench.clock.now += 100.0
    assert service_manager() == [], "no round of the main loop, no word"
    bench.mpstate.unload("handover")
    assert service_manager() == [], "MAVProxy goes on without the module: it is silent, and started anew"
    bench.load()
    bench.run(1.0)
    assert service_manager() == [b"READY=1", b"WATCHDOG=1"]
    bench.mpstate.status.exit = True
    bench.mpstate.unload("handover")
    assert service_manager() == [b"STOPPING=1"]


def test_under_a_supervisor_that_one_alone_tells_the_service_manager(
    bench: Bench, held: Hold, service_manager: Callable[[], list[bytes]]
) -> None:
    held()
    bench.load()
    bench.wait(10.0)
    bench.mpstate.unload("handover")
    assert service_manager() == []


def test_no_round_of_the_main_loop_no_sign(bench: Bench, held: Hold) -> None:
    signs = held()
    bench.load()
    bench.run(1.0)
    signs()
    bench.clock.now += 5.0
    assert signs() == b""


def test_unloaded_by_an_operator_its_silence_means_nothing_and_at_the_end_of_mavproxy_it_is_the_end(
    bench: Bench, held: Hold
) -> None:
    signs = held()
    bench.load()
    bench.run(0.5)
    bench.mpstate.unload("handover")
    assert signs().lstrip(b".") == b"-"
    bench.load()
    bench.run(0.5)
    bench.mpstate.status.exit = True
    bench.mpstate.unload("handover")
    assert signs().lstrip(b".") == b"e"


def test_a_process_that_cannot_unload_it_has_its_journal_closed(bench: Bench, held: Hold) -> None:
    held()
    bench.load()
    bench.companion.journal.note("last", "an entry that waits")
    close_journal(bench.mpstate)
    journal = bench.companion.journal.path
    lines = journal.read_text().splitlines()
    assert '"event": "last"' in lines[-1]
    bench.companion.journal.write("after")
    assert journal.read_text().splitlines() == lines


def test_a_process_without_the_module_has_no_journal_to_close(bench: Bench) -> None:
    close_journal(bench.mpstate)


def test_why_it_was_started_again_is_told(bench: Bench, held: Hold) -> None:
    held("it was killed by SIGKILL")
    bench.load()
    (entry,) = bench.journal("started_again")
    assert entry["text"] == "started again by the supervisor: it was killed by SIGKILL"
    assert bench.mpstate.console.said("Started again by the supervisor: it was killed by SIGKILL.")
    bench.run(1.0)
    assert bench.autopilot.leases() != []


def test_one_restart_too_many_sends_no_lease_and_nobody_commands(
    bench: Bench, held: Hold, delivery: MissionPackage
) -> None:
    bench.connect()
    bench.share(delivery)
    kill(bench)
    signs = held("it was killed by SIGSEGV", leases=False)
    bench.load()
    bench.wait(10.0)
    assert bench.autopilot.leases() == []
    assert bench.companion.view.commander is None
    (entry,) = bench.journal("failed_closed")
    assert entry["text"] == (
        "restarted too often: no leases, no station commands, the guard brings the aircraft home. Find out why in the "
        "journal, then start `handover companion` again"
    )
    assert bench.a.got("AUTHORITY_STATUS")[-1].commander == 0
    assert signs() != b"", "it stays, to say so"


@pytest.mark.parametrize("supervised", [True, False])
def test_it_does_not_load_beside_another_companion(bench: Bench, held: Hold, supervised: bool) -> None:
    if supervised:
        held()
    lock = VehicleLock(bench.folder / "state", "drone-1")
    assert bench.load() is None
    assert bench.mpstate.console.said(
        f"handover is not loaded: {bench.folder}/state/drone-1.lock is locked: another companion of drone-1 is running"
    )
    assert bench.mpstate.status.exit is supervised, "a supervised companion without its module is none"
    lock.release()
    bench.mpstate.status.exit = False
    assert bench.load() is not None


def test_it_does_not_load_where_another_program_holds_the_serial_line(bench: Bench) -> None:
    near, far = os.openpty()
    name = os.ttyname(far)
    lock_line(far, name)
    line = serial.Serial(name)
    bench.mpstate.mav_master[0].port = line
    assert bench.load() is None
    assert bench.mpstate.console.said(
        f"handover is not loaded: {name} is locked: another program uses this line, maybe another companion"
    )
    os.close(far)
    assert bench.load() is not None, "the vehicle's own lock was given back"
    other = os.open(name, os.O_RDWR | os.O_NOCTTY)
    with pytest.raises(LockError):
        lock_line(other, name)
    bench.close()
    line.close()
    lock_line(other, name)
    os.close(other)
    os.close(near)


def test_a_reload_that_fails_in_a_supervised_companion_leaves_mavproxy_to_the_operator(
    bench: Bench, held: Hold
) -> None:
    held()
    bench.load()
    bench.run(0.5)
    bench.mpstate.unload("handover")
    bench.config.write_text("[vehicle\n")
    assert bench.load() is None
    assert not bench.mpstate.status.exit
