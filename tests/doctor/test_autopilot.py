# SPDX-License-Identifier: GPL-3.0-or-later

"""The autopilot's line: what is wrong with it is told apart. Lines are pseudo-terminals: their rate can be read."""

from __future__ import annotations

import os
import termios
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.doctor.machine import Machine, Server, Speaker, companion, heartbeat

LINE = "/dev/ttyTHS1,921600"
RATES = {57600: termios.B57600, 921600: termios.B921600, 115200: termios.B115200}


class Line(Server):
    """The other end of a serial line: who listens at another rate than `baud` reads noise. 0: it says nothing."""

    def __init__(self, baud: int, *, armed: bool = True) -> None:
        super().__init__()
        self._speed = RATES.get(baud)
        self._frame = heartbeat(armed=armed)
        self._ours, self.theirs = os.openpty()
        tty.setraw(self.theirs)
        self.received = b""
        self.path = os.ttyname(self.theirs)
        os.set_blocking(self._ours, False)
        self._wake = threading.Event()
        self.start()

    def _once(self) -> None:
        self._wake.wait(0.05)
        try:
            self.received += os.read(self._ours, 4096)
        except BlockingIOError:
            pass
        if self._speed is not None:
            fits = termios.tcgetattr(self._ours)[4] == self._speed
            try:
                os.write(self._ours, self._frame if fits else bytes(byte ^ 0xA5 for byte in self._frame))
            except BlockingIOError:  # nobody reads
                termios.tcflush(self.theirs, termios.TCIFLUSH)

    def close(self) -> None:
        super().close()
        os.close(self._ours)
        os.close(self.theirs)


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    made = companion(tmp_path, LINE, {"GCSA": 9, "GCSB": 10})
    made.path("dev").mkdir()
    return made


def plug(machine: Machine, line: Line) -> None:
    machine.path("dev/handover-autopilot").symlink_to(line.path)
    os.chmod(line.path, 0o666)


@pytest.fixture
def lines() -> Iterator[list[Line]]:
    opened: list[Line] = []
    yield opened
    for line in opened:
        line.close()


def test_a_line_that_is_not_there(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    found = machine.doctor(capsys, "--no-links")
    (said,) = found.lines("error")
    assert said.startswith(
        "autopilot: line of the autopilot: /dev/handover-autopilot: no such line -> Plug the autopilot"
    )
    assert found.code == 1


def test_a_line_at_the_right_rate(machine: Machine, lines: list[Line], capsys: pytest.CaptureFixture[str]) -> None:
    lines.append(Line(921600))
    plug(machine, lines[0])
    found = machine.doctor(capsys, "--no-links")
    assert found.lines("error") == []
    assert found.of("autopilot", "ok")[0].endswith("handover may use it, no other program does")
    assert "heartbeat of system 1" in found.of("autopilot", "ok")[1]
    assert lines[0].received == b"", "who is armed is asked nothing"


def test_a_wrong_baud_rate_is_found_and_the_right_one_too(
    machine: Machine, lines: list[Line], capsys: pytest.CaptureFixture[str]
) -> None:
    lines.append(Line(57600))
    plug(machine, lines[0])
    found = machine.doctor(capsys, "--no-links")
    (said,) = found.lines("error")
    assert "no frame at 921600 baud: the baud rate is wrong, 57600 works" in said
    assert "-> Change the baud rate to 57600: handover install companion --device LINE,57600." in said
    assert found.code == 1
    assert lines[0].received == b"", "to find a rate nothing is sent"


def test_limits_that_do_not_fit_the_line(
    machine: Machine, lines: list[Line], capsys: pytest.CaptureFixture[str]
) -> None:
    lines.append(Line(921600))
    plug(machine, lines[0])
    more = "".join(
        f"""
        [[onboard]]
        name = "program-{number}"
        link = "udpin:127.0.0.1:{14600 + number}"
        component = {25 + number}
        bytes_per_s = 30000
        """
        for number in range(2)
    )
    machine.config.write_text(machine.config.read_text() + more)
    found = machine.doctor(capsys, "--no-links").lines("warning")
    assert [line for line in found if "room for 46080 bytes/s at 921600 baud, limits sum to 60000" in line]


def test_noise_at_every_rate(
    machine: Machine, lines: list[Line], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mavproxy_handover.doctor.flight_controller.RATES", (115200,))
    lines.append(Line(57600))
    plug(machine, lines[0])
    (said,) = machine.doctor(capsys, "--no-links").lines("error")
    assert "nor at any other usual rate -> Set SERIALn_PROTOCOL of its port to 2" in said


def test_a_silent_line(machine: Machine, lines: list[Line], capsys: pytest.CaptureFixture[str]) -> None:
    lines.append(Line(0))
    plug(machine, lines[0])
    (said,) = machine.doctor(capsys, "--no-links").lines("error")
    assert said.startswith("autopilot: autopilot: no heartbeat: nothing arrives in 3 s -> Look whether it has power")


def test_a_line_that_the_service_may_not_use(
    machine: Machine, lines: list[Line], capsys: pytest.CaptureFixture[str]
) -> None:
    lines.append(Line(921600))
    plug(machine, lines[0])
    if os.geteuid() != 0:
        pytest.skip("whoever made the line may use it: NOT tried, as only root is somebody else than the service")
    os.chmod(lines[0].path, 0o660)
    (said,) = machine.doctor(capsys, "--no-links").lines("error")
    assert "/dev/handover-autopilot: handover may not use it (mode 0660" in said
    assert "-> Run: udevadm control --reload; udevadm trigger." in said


def test_a_line_that_another_program_uses(
    machine: Machine, lines: list[Line], capsys: pytest.CaptureFixture[str]
) -> None:
    lines.append(Line(921600))
    plug(machine, lines[0])
    # another process, with the line open until its input ends
    ours, theirs = os.pipe()
    other = os.fork()
    if other == 0:
        os.close(theirs)
        os.read(ours, 1)
        os._exit(0)
    os.close(ours)
    try:
        (said,) = machine.doctor(capsys, "--no-links").lines("error")
    finally:
        os.close(theirs)
        os.waitpid(other, 0)
    assert "is in use by " in said
    assert f"(process {other}) -> Stop " in said


def test_something_that_is_no_line(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    machine.path("dev/handover-autopilot").write_text("")
    (said,) = machine.doctor(capsys, "--no-links").lines("error")
    assert "is no serial line -> Name the line" in said


# ---- by TCP ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no heartbeat: nothing arrives in 3 s"),
        (b"this is no MAVLink", "bytes and no frame of MAVLink in 3 s -> Name the link"),
        (heartbeat(7), "no heartbeat of system 1, but frames of system 7 -> Set [vehicle] sysid"),
    ],
    ids=["silent", "noise", "another system"],
)
def test_no_heartbeat(data: bytes, words: str, machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    speaker = Speaker(lambda: data)
    try:
        found = machine.doctor(capsys, "--no-links", "--device", speaker.device)
    finally:
        speaker.close()
    (said,) = found.lines("error")
    assert words in said
    assert found.code == 1
    assert speaker.received == b""


def test_an_autopilot_that_answers_nothing(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    speaker = Speaker(heartbeat)
    try:
        found = machine.doctor(capsys, "--no-links", "--device", speaker.device)
    finally:
        speaker.close()
    (said,) = found.lines("error")
    assert "the autopilot answers no request for parameters" in said
    assert "-> Set the port's SERIALn_PROTOCOL to 2" in said
    assert [each for each in found.lines("warning") if "firmware: it does not tell its version" in each]


def test_once_it_is_armed_it_is_asked_nothing_more(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    speaker = Speaker(lambda: heartbeat(armed=bool(speaker.received)))
    try:
        found = machine.doctor(capsys, "--no-links", "--device", speaker.device)
    finally:
        speaker.close()
    assert [each for each in found.lines("warning") if "the vehicle is armed, so it is listened to only" in each]
    assert found.code == 2
    names = [name for name in (b"HNDO_ENABLE", b"FS_GCS_ENABLE") if name in speaker.received]
    assert names == [], "parameters are not asked for any more"


def test_nobody_says_where_it_is(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    machine.path("etc/systemd/system/handover-companion.service").unlink()
    found = machine.doctor(capsys, "--no-links")
    assert [each for each in found.lines("warning") if "its line is not given -> Give --device LINE,BAUD" in each]
    assert [each for each in found.lines("warning") if "there is no unit" in each]
    assert found.code == 2
