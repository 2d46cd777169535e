# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults planted one by one in a machine that all is well with: each is found, with what to do, and nothing else is.

The autopilot here says that it is armed, so it is listened to only: without a fault the exit code is 2, for what could
not be looked at, and with one 1. What the autopilot itself may have is in `test_well.py` and `test_autopilot.py`.
"""

from __future__ import annotations

import os
import shutil
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mavproxy_handover import cli
from mavproxy_handover.doctor import command
from mavproxy_handover.tools.clocks import Clocks
from tests.doctor.machine import (
    KEYS,
    ROOT_RUNS,
    SERVICE_UID,
    Machine,
    Speaker,
    companion,
    free_port,
    heartbeat,
)

Plant = Callable[[Machine], None]


@pytest.fixture(scope="module")
def armed() -> Iterator[Speaker]:
    speaker = Speaker(lambda: heartbeat(armed=True))
    yield speaker
    speaker.close()


@pytest.fixture
def listens() -> int:
    return free_port()


@pytest.fixture
def machine(tmp_path: Path, armed: Speaker, listens: int) -> Machine:
    return companion(tmp_path, armed.device, {"GCSA": 9, "GCSB": 10}, listens)


def test_without_a_fault_only_what_is_in_flight_is_not_looked_at(
    machine: Machine, armed: Speaker, capsys: pytest.CaptureFixture[str]
) -> None:
    found = machine.doctor(capsys, "--no-links")
    assert found.lines("error") == []
    (unseen,) = found.lines("warning")
    assert unseen.startswith("autopilot: parameters: not looked at: the vehicle is armed")
    assert found.code == 2
    assert armed.received == b"", "who is armed is asked nothing"


def key(machine: Machine, name: str = "GCSA") -> Path:
    return machine.path(f"etc/handover/keys/{name}.key")


def replaced(machine: Machine, old: str, new: str) -> None:
    text = machine.config.read_text()
    assert old in text
    machine.config.write_text(text.replace(old, new))


def same_key(machine: Machine) -> None:
    key(machine, "GCSB").write_bytes(key(machine).read_bytes())


def shut_keys(machine: Machine) -> None:
    """The service is in its group, or it is the owner."""
    key(machine).parent.chmod(0o700 if ROOT_RUNS else 0o600)


def foreign(machine: Machine) -> None:
    os.chown(key(machine), 1, 1)


def no_program(machine: Machine) -> None:
    machine.path("opt/handover/bin/handover").unlink()


def no_shim(machine: Machine) -> None:
    (machine.packages / "handover.py").unlink()


def no_dialect(machine: Machine) -> None:
    (machine.packages / "mavproxy_handover/data/dialect/handover.py").unlink()


def no_start_up_file(machine: Machine) -> None:
    (machine.packages / "handover_dialect.pth").unlink()


def module_of_another(machine: Machine) -> None:
    (machine.packages / "handover.py").write_text("def init(mpstate): ...\n")


def closed_state(machine: Machine) -> None:
    machine.path("var/lib/handover").chmod(0o550)


def no_state(machine: Machine) -> None:
    machine.path("var/lib/handover").rmdir()


def broken_mission(machine: Machine) -> None:
    machine.path("srv/delivery/zones.geojson").write_text("{")


PLANTED: list[tuple[str, Plant, str, str]] = [
    (
        "key mode",
        lambda m: key(m).chmod(0o644),
        "keys: key of GCSA: ",
        "mode 0644 must be 0600, because only its owner may read a key -> Run: chmod 600 ",
    ),
    ("key missing", lambda m: key(m).unlink(), "keys: key of GCSA: ", "no such file -> Run 'handover keys make'"),
    ("no key in it", lambda m: key(m).write_text("x"), "keys: key of GCSA: ", "must hold 64 hexadecimal digits"),
    ("one key for two", same_key, "keys: keys: ", "GCSA and GCSB have the same key"),
    (
        "folder of keys open",
        lambda m: key(m).parent.chmod(0o755),
        "keys: ",
        "mode 0755: others may look into it -> Run: chmod 0750 ",
    ),
    (
        "folder of keys shut",
        shut_keys,
        "keys: ",
        "handover may not enter ",
    ),
    (
        "unknown key in the configuration",
        lambda m: replaced(m, "parent =", "parnet ="),
        "configuration: ",
        "[vehicle] parnet: unknown key; did you mean 'parent'?",
    ),
    (
        "an address that stands in for another",
        lambda m: replaced(m, "udpout:127.0.0.1:9", "udpout:192.0.2.11:9"),
        "configuration: link of GCSA: ",
        "udpout:192.0.2.11:9 has an address that no computer has -> Put the real address in its place in ",
    ),
    ("no TOML", lambda m: m.config.write_text("[vehicle"), "configuration: ", "not valid TOML"),
    (
        "MAVProxy too old",
        lambda m: m.has_package("MAVProxy", "1.8.70"),
        "programs: MAVProxy: ",
        "1.8.70, but <1.8.75,>=1.8.71 is needed -> Run ",
    ),
    (
        "no pymavlink",
        lambda m: shutil.rmtree(next(m.packages.glob("pymavlink-*.dist-info"))),
        "programs: pymavlink: ",
        "is not installed, but >=2.4.42 is needed",
    ),
    ("no module for MAVProxy", no_shim, "programs: module load: ", "handover.py is in no folder"),
    ("another's module", module_of_another, "programs: module load: ", "handover.py is another program's"),
    ("no dialect", no_dialect, "programs: dialect: ", "data/dialect/handover.py is in no folder"),
    ("no start-up file", no_start_up_file, "programs: dialect: ", "handover_dialect.pth is in no folder"),
    ("no program", no_program, "service: handover-companion: ", "the unit starts /opt/handover/bin/handover"),
    ("no folder for the state", no_state, "disk: ", "no such folder -> Run: systemd-tmpfiles --create"),
    ("state not to be written", closed_state, "disk: ", "handover may not write to "),
    ("mission broken", broken_mission, "mission: mission: ", "-> Run: handover check "),
]


@pytest.mark.parametrize(
    ("plant", "begins", "words"), [each[1:] for each in PLANTED], ids=[each[0] for each in PLANTED]
)
def test_a_planted_fault_is_found(
    plant: Plant, begins: str, words: str, machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    plant(machine)
    found = machine.doctor(capsys, "--no-links")
    (said,) = found.lines("error")
    assert said.startswith(begins)
    assert words in said
    assert found.code == 1


@pytest.mark.skipif(not ROOT_RUNS, reason="only root gives files away: whose a key is was NOT tried")
def test_a_key_of_somebody_else_is_found(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    foreign(machine)
    found = machine.doctor(capsys, "--no-links")
    (said,) = found.lines("error")
    assert f"belongs to user 1, must belong to {SERVICE_UID}, who is to use it -> Run: chown handover: " in said


def test_a_port_in_use_is_found_and_who_has_it(
    machine: Machine, listens: int, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", listens))
        found = machine.doctor(capsys, "--no-links")
    (said,) = found.lines("error")
    assert said.startswith(f"ports: link of GCSB: udpin:127.0.0.1:{listens} is in use by ")
    assert f"(process {os.getpid()}) -> Stop process {os.getpid()}" in said
    assert found.code == 1
    assert f"link of GCSB: udpin:127.0.0.1:{listens} is free" in machine.doctor(capsys, "--no-links").of("ports", "ok")


def test_a_clock_of_1970_is_found_and_nothing_is_signed_by_it(
    machine: Machine, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.setblocking(False)
        replaced(machine, "127.0.0.1:9", f"127.0.0.1:{station.getsockname()[1]}")
        ours = command._context
        monkeypatch.setattr(
            command, "_context", lambda arguments, clocks: ours(arguments, Clocks(lambda: 60.0, clocks.monotonic))
        )
        found = machine.doctor(capsys)
        with pytest.raises(BlockingIOError):
            station.recv(100)
    (said,) = found.lines("error")
    assert said.startswith("clock: time of day: 1970-01-01 00:01:00 UTC, which is before this program was installed")
    assert [each for each in found.lines("warning") if "stations: not looked at: the clock is wrong" in each]
    assert found.code == 1


def test_a_clock_that_nobody_keeps_is_a_warning(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    machine.path("run/systemd/timesync/synchronized").unlink()
    found = machine.doctor(capsys, "--no-links")
    assert [each for each in found.lines("warning") if each.startswith("clock: ") and "timedatectl set-ntp" in each]


def test_a_full_disk_is_found(
    machine: Machine, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.statvfs

    def nearly_full(path: Path) -> os.statvfs_result:
        numbers = list(real(path))
        numbers[4] = 50_000_000 // numbers[1]  # f_bavail, in blocks of f_frsize
        return os.statvfs_result(numbers)

    monkeypatch.setattr(os, "statvfs", nearly_full)
    found = machine.doctor(capsys, "--no-links")
    (said,) = found.lines("error")
    assert said.startswith("disk: ")
    assert "50.0 MB free" in said or "49." in said
    assert "-> Make room: handover logs prune" in said


def test_a_disk_that_takes_no_block_is_found(
    machine: Machine, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    (said,) = machine.doctor(capsys, "--no-links").lines("error")
    assert "writing: No space left on device -> Make room" in said


def test_silent_stations_are_found(
    machine: Machine, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # for what the autopilot is asked and never answers nobody waits here
    monkeypatch.setattr("mavproxy_handover.doctor.flight_controller._Visit._asked", lambda _visit: iter(()))
    disarmed = Speaker(heartbeat)
    try:
        found = machine.doctor(capsys, "--device", disarmed.device)
    finally:
        disarmed.close()
    silent = found.of("stations", "error")
    assert [each.partition(",")[0] for each in silent] == ["GCSA", "GCSB", "GCSB"]
    assert all("silent for 4 s" in each for each in silent)
    assert [each for each in found.lines("error") if "-> Start 'handover station' there" in each]


def test_a_unit_that_is_not_enabled_is_a_warning(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    machine.path("etc/systemd/system/multi-user.target.wants/handover-companion.service").unlink()
    found = machine.doctor(capsys, "--no-links")
    assert [each for each in found.lines("warning") if "-> Run: systemctl enable --now handover-companion." in each]


def test_a_station_that_cannot_be_asked_and_has_no_consent_is_a_warning(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    replaced(machine, 'name = "GCSB"', 'name = "GCSB"\nmodule = false')
    found = machine.doctor(capsys, "--no-links")
    (said,) = [each for each in found.lines("warning") if each.startswith("mission: consent: ")]
    assert said == (
        'mission: consent: GCSB cannot be asked for consent: write consent = "automatic" or consent = "refuse" in its '
        f"[[station]] of the vehicle's file -> Write the line in {machine.config}. Else START needs its program to "
        "show operator control first."
    )
    replaced(machine, "module = false", 'module = false\nconsent = "automatic"')
    assert machine.doctor(capsys, "--no-links").of("mission", "warning") == []


def test_consent_that_is_refused_where_the_route_needs_it_is_found(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    replaced(machine, 'name = "GCSB"', 'name = "GCSB"\nmodule = false\nconsent = "refuse"')
    found = machine.doctor(capsys, "--no-links")
    assert found.of("mission", "error")[0] == ('consent: GCSB has consent = "refuse", and the route needs GCSA -> GCSB')
    assert found.code == 1


def test_an_address_of_the_mission_at_which_the_vehicle_does_not_listen_is_a_warning(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    machine.path("srv/delivery/addresses.toml").write_text('[vehicle]\nGCSB = ["udpout:10.0.0.2:14552"]\n')
    found = machine.doctor(capsys, "--no-links")
    (said,) = [each for each in found.lines("warning") if each.startswith("mission: addresses: ")]
    assert said == (
        "mission: addresses: addresses.toml tells GCSB udpout:10.0.0.2:14552, and nothing listens there for it -> Add "
        '"udpin:0.0.0.0:14552" to links of that [[station]], or put the file right.'
    )
    text = machine.config.read_text()
    machine.config.write_text(text.replace('", "udpin:127.0.0.1:', '", "udpin:0.0.0.0:14552", "udpin:127.0.0.1:'))
    found = machine.doctor(capsys, "--no-links")
    assert [each for each in found.lines("warning") if each.startswith("mission: addresses: ")] == []


def test_a_damaged_file_of_the_addresses_is_an_error_and_the_mission_is_there(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    machine.path("srv/delivery/addresses.toml").write_text("[vehicle]\nGCSX = []\n")
    (said,) = machine.doctor(capsys, "--no-links").of("mission", "error")
    assert "delivery/addresses.toml: [vehicle]: unknown key 'GCSX'" in said


def test_a_drop_in_says_who_runs_it_and_how(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    folder = machine.path("etc/systemd/system/handover-companion.service.d")
    folder.mkdir()
    (folder / "own.conf").write_text("[Service]\nExecStart=\nExecStart=/srv/other/bin/handover companion\nUser=pi\n")
    found = machine.doctor(capsys, "--no-links")
    assert [each for each in found.of("service") if "starts /srv/other/bin/handover, which is no program" in each]
    assert [each for each in found.of("service") if "its user 'pi' does not exist yet" in each]


def test_what_a_check_breaks_on_hides_nothing(
    machine: Machine, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_context: object) -> Iterator[object]:
        raise RuntimeError("two\nlines")

    monkeypatch.setitem(command.CHECKS, "clock", broken)  # type: ignore[arg-type]
    key(machine).chmod(0o644)
    found = machine.doctor(capsys, "--no-links")
    assert [each for each in found.lines("warning") if "the check itself broke: RuntimeError: two lines" in each]
    assert len(found.lines("error")) == 1
    assert found.code == 1


def test_all_that_is_wrong_says_what_to_do(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    for _name, plant, _begins, _words in PLANTED:
        if plant not in (no_state, same_key):
            try:
                plant(machine)
            except FileNotFoundError:  # another fault has taken it away
                continue
    found = machine.doctor(capsys)
    assert len(found.lines("error")) >= 5
    for each in found.report["findings"]:
        assert set(each) == {"check", "level", "looked", "what", "found", "do"}
        assert bool(each["do"]) == (each["level"] != "ok")
        assert each["looked"] or each["level"] == "warning"
        if each["do"]:
            assert each["do"][0].isupper()
            assert each["do"].endswith(".")


# ---- the command ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--root", "/nowhere/at/all"], "no such folder"),
        (["pilot"], "invalid choice"),
        (["companion", "--config", "/nowhere.toml"], "/nowhere.toml: no such file"),
        (["--config", "/nowhere.toml"], "say what /nowhere.toml is of"),
    ],
)
def test_wrong_usage(words: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", *words]) == 2
    assert says in capsys.readouterr().err


def test_which_of_the_two_is_found_out(machine: Machine, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert cli.main(["doctor", "--root", str(machine.root), "--no-links"]) == 2
    shown = capsys.readouterr()
    assert "drone-1, loads" in shown.out
    assert shown.out.rstrip().endswith("0 errors, 0 warnings, 1 not looked at.")
    assert "... listening to the autopilot" in shown.err
    machine.path("etc/handover/station.toml").write_text("")
    assert cli.main(["doctor", "--root", str(machine.root)]) == 2
    assert "companion or station? both have" in capsys.readouterr().err
    (tmp_path / "empty").mkdir()
    assert cli.main(["doctor", "--root", str(tmp_path / "empty")]) == 2
    assert "companion or station? neither has" in capsys.readouterr().err


def test_nothing_is_changed(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    def everything() -> dict[str, tuple[int, int, int, int]]:
        return {
            str(path): (status.st_mode, status.st_uid, status.st_size, status.st_mtime_ns)
            for path in sorted(machine.root.rglob("*"))
            if (status := path.lstat())
        }

    before = everything()
    machine.doctor(capsys, "--no-links")
    assert everything() == before


def test_no_key_is_shown(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    cli.main(["doctor", "companion", "--root", str(machine.root), "--no-links"])
    shown = capsys.readouterr()
    for secret in KEYS.values():
        assert secret.hex() not in shown.out + shown.err
