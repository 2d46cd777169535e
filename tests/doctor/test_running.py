# SPDX-License-Identifier: GPL-3.0-or-later

"""A companion that runs: nothing that it holds is opened, and what it knows itself is told by its journal and state."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.core.common.snapshot import Snapshot
from mavproxy_handover.doctor import ports
from mavproxy_handover.doctor.processes import command_line, companion_of, lock_holder
from mavproxy_handover.doctor.processes import listens as listens_now
from mavproxy_handover.mission.package import load
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.store.lock import VehicleLock
from mavproxy_handover.store.state_file import StateFile
from mavproxy_handover.tools.resources import shipped
from tests.doctor.machine import Machine, Speaker, companion, free_port, heartbeat

STATE = "var/lib/handover/state"
JOURNAL = "var/lib/handover/flights/latest/drone-1.jsonl"
LINK = "udpout:127.0.0.1:9"


@pytest.fixture
def speaker() -> Iterator[Speaker]:
    made = Speaker(heartbeat)
    yield made
    made.close()


@pytest.fixture
def machine(tmp_path: Path, speaker: Speaker) -> Iterator[Machine]:
    """With the lock of its vehicle held by this very process."""
    made = companion(tmp_path, speaker.device, {"GCSA": 9, "GCSB": 10})
    lock = VehicleLock(made.path(STATE), "drone-1")
    yield made
    lock.release()


def journal(machine: Machine, *entries: tuple[str, dict[str, object]]) -> None:
    written = Journal(machine.path(JOURNAL), "drone-1")
    for event, values in entries:
        written.write(event, **values)  # type: ignore[arg-type]
    assert written.wait_until_written(10.0)
    written.close()


def kept(machine: Machine, digest: bytes) -> None:
    snapshot = Snapshot(owner=251, epoch=7, handover_id=0, phase=Phase.ON_LOAD, route_at=0, digest=digest, route=())
    StateFile(machine.path(STATE), "drone-1").save(snapshot)


HEARD = [("station_heard", {"station": name}) for name in ("GCSA", "GCSB")]
LOADED = ("loaded", {"text": "handover"})
FITS = ("preflight", {"text": "guard, parameters and firmware fit", "fits": True})


def test_the_holder_of_a_lock_is_told_without_taking_it(tmp_path: Path) -> None:
    assert lock_holder(tmp_path / "none.lock") is None
    lock = VehicleLock(tmp_path, "drone-1")
    holder = lock_holder(tmp_path / "drone-1.lock")
    assert holder is not None
    assert holder.pid == os.getpid()
    lock.release()
    assert lock_holder(tmp_path / "drone-1.lock") is None


def test_what_it_holds_is_left_alone(machine: Machine, speaker: Speaker, capsys: pytest.CaptureFixture[str]) -> None:
    journal(machine, LOADED, *HEARD, FITS)
    kept(machine, load(shipped("missions") / "delivery").digest)
    found = machine.doctor(capsys)
    assert found.lines("error") == []
    assert found.lines("warning") == []
    assert found.code == 0
    assert speaker.visits == 0
    (runs,) = [each for each in found.of("service") if "runs: " in each]
    assert f"(process {os.getpid()}); what it holds is not opened here" in runs
    (said,) = found.of("autopilot")
    assert said.startswith("autopilot: guard, parameters and firmware fit (journal, ")
    assert all("no trouble, by the companion that runs" in each for each in found.of("stations"))


def test_what_its_own_checks_found(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    text = "FS_OPTIONS is 2: bit 1 lets a mission go on without a ground station"
    journal(machine, FITS, LOADED, *HEARD, ("preflight", {"text": text, "parameter": "FS_OPTIONS", "fits": False}))
    found = machine.doctor(capsys)
    (said,) = found.lines("error")
    assert said.startswith("autopilot: FS_OPTIONS: is 2: bit 1 lets a mission go on")
    assert "-> Set FS_OPTIONS to 8;" in said


def test_how_its_links_are(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    silent = {"station": "GCSA", "link": LINK, "measure": "silence", "text": "link is degraded: silence 3.00 s"}
    lossy = {"station": "GCSA", "link": LINK, "measure": "loss", "text": "loss 40%"}
    journal(
        machine,
        LOADED,
        HEARD[0],
        FITS,
        ("link", {**lossy, "change": "degraded"}),
        ("link", {**lossy, "change": "restored"}),
        ("link", {**silent, "change": "degraded"}),
    )
    found = machine.doctor(capsys)
    assert [each.partition(" (")[0] for each in found.of("stations", "error")] == [
        f"GCSA, {LINK}: link is degraded: silence 3.00 s",
        "GCSB: was not heard since the companion began",
    ]
    assert found.code == 1


def test_a_journal_with_no_end(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    """Cut, damaged, or not there: it is said, and nothing is guessed."""
    assert machine.doctor(capsys).code == 2
    machine.path(JOURNAL).parent.mkdir(parents=True)
    machine.path(JOURNAL).write_bytes(b'\xff\xfe{"event": "loaded"\n[1]\n"x"\n{"event": "preflight", "te')
    found = machine.doctor(capsys)
    assert [each for each in found.lines("warning") if "has not checked it yet" in each]
    assert found.code == 2


def test_another_mission_than_the_one_on_board_is_flown(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    journal(machine, LOADED, *HEARD, FITS)
    kept(machine, bytes(range(32)))
    found = machine.doctor(capsys)
    (said,) = found.lines("error")
    assert said.startswith(
        "mission: state: epoch 7, mission digest 000102030405, of this run: the companion flies another"
    )
    assert "-> Restart the companion on the ground" in said


def test_its_own_ports_are_no_trouble(tmp_path: Path, speaker: Speaker, capsys: pytest.CaptureFixture[str]) -> None:
    import socket

    listens = free_port()
    machine = companion(tmp_path, speaker.device, {"GCSA": 9, "GCSB": 10}, listens)
    journal(machine, LOADED, *HEARD, FITS)
    lock = VehicleLock(machine.path(STATE), "drone-1")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as held:
        held.bind(("127.0.0.1", listens))
        found = machine.doctor(capsys)
    lock.release()
    assert found.of("ports") == [f"link of GCSB: udpin:127.0.0.1:{listens} is held by the companion that runs"]


def test_a_state_file_that_is_damaged(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    journal(machine, LOADED, *HEARD, FITS)
    kept(machine, b"")
    (path,) = machine.path(STATE).glob("*.json")
    path.write_bytes(path.read_bytes()[:-20])
    (said,) = machine.doctor(capsys).lines("error")
    assert "mission: state: " in said
    assert "not to be trusted" in said


# ---- the position box -----------------------------------------------------------------------------------------------


def with_box(machine: Machine, port: int) -> None:
    text = f'\n[position]\nsource = "box"\nbox = "tcp:127.0.0.1:{port}"\n'
    machine.config.write_text(machine.config.read_text() + text)


@pytest.mark.parametrize(
    ("standing", "level"), [("sound", "ok"), ("apart", "error"), ("silent", "error"), ("", "warning")]
)
def test_the_position_box_is_told_by_the_journal_and_not_connected_to(
    machine: Machine, standing: str, level: str, capsys: pytest.CaptureFixture[str]
) -> None:
    box = Speaker(lambda: b"")
    try:
        with_box(machine, int(box.device.rpartition(":")[2]))
        told = ("position_source", {"text": "position box as it stands", "standing": standing, "source": "box"})
        before = ("position_source", {"text": "position box as it stood", "standing": "late", "source": "box"})
        journal(machine, LOADED, FITS, *([before, told] if standing else []))
        (said,) = machine.doctor(capsys).of("position box", level)
        assert ("position box: as it stands (journal, " if standing else "has not told of it yet") in said
        assert box.visits == 0
    finally:
        box.close()


# ---- one that is being started --------------------------------------------------------------------------------------


def started(*words: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)", *words])


@pytest.mark.parametrize(
    ("words", "is_one"),
    [
        (["/opt/handover/bin/handover", "companion", "--config", "{config}", "--master", "x"], True),
        (["handover", "companion", "--master", "x", "--config={config}"], True),
        (["handover", "companion", "--master", "x"], True),
        (["handover", "companion", "--config", "/etc/handover/other.toml"], False),
        (["handover", "doctor", "companion", "--config", "{config}"], False),
        (["handover", "station", "--config", "{config}"], False),
    ],
)
def test_a_companion_that_has_no_lock_yet_is_known_by_its_command_line(
    tmp_path: Path, words: list[str], is_one: bool
) -> None:
    config = tmp_path / "handover.toml"
    process = started(*(word.format(config=config) for word in words))
    try:
        end = time.monotonic() + 10.0
        while not command_line(process.pid).endswith(words[-1].format(config=config)) and time.monotonic() < end:
            time.sleep(0.01)
        found = companion_of(config)
        assert (found is not None and found.pid == process.pid) is is_one
    finally:
        process.kill()
        process.wait()


def test_when_a_companion_starts_meanwhile_its_links_are_let_go_at_once(
    tmp_path: Path, speaker: Speaker, capsys: pytest.CaptureFixture[str]
) -> None:
    listens = free_port()
    made = companion(tmp_path, speaker.device, {"GCSA": 9, "GCSB": 10}, listens)
    free_after_s: list[float] = []

    def start() -> None:
        while not listens_now(True, "127.0.0.1", listens):  # until the doctor has opened it
            time.sleep(0.01)
        lock = VehicleLock(made.path(STATE), "drone-1")
        begun = time.monotonic()
        while listens_now(True, "127.0.0.1", listens):
            time.sleep(0.01)
        free_after_s.append(time.monotonic() - begun)
        time.sleep(0.5)
        lock.release()

    thread = threading.Thread(target=start)
    thread.start()
    found = made.doctor(capsys)
    thread.join()
    assert free_after_s[0] < 1.0
    (said,) = found.of("stations", "warning")
    assert said.endswith(": a companion has just been started: what was open here was let go at once")


def test_to_look_at_a_port_does_not_take_it(
    tmp_path: Path, speaker: Speaker, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    listens = free_port()
    made = companion(tmp_path, speaker.device, {"GCSA": 9, "GCSB": 10}, listens)
    bound: list[int] = []
    monkeypatch.setattr(ports, "_bind", lambda spec: bound.append(spec.port))
    found = made.doctor(capsys, "--no-links")
    assert bound == [0]
    assert found.of("ports") == [f"link of GCSB: udpin:127.0.0.1:{listens} is free"]
