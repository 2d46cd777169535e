# SPDX-License-Identifier: GPL-3.0-or-later

"""A link that will not open is told with what to do, before MAVProxy's own words."""

from __future__ import annotations

import os
import pty
import socket
from pathlib import Path

import pytest

from mavproxy_handover.cli.reach import trouble
from mavproxy_handover.cli.run import companion, station


def test_a_line_that_is_missing_is_named_with_those_that_are_there(tmp_path: Path) -> None:
    (tmp_path / "ttyACM0").touch()
    (tmp_path / "ttyUSB1").touch()
    assert trouble(f"{tmp_path}/ttyNOPE", tmp_path) is None, "only a path below /dev is a line without a word before it"
    assert trouble(f"serial:{tmp_path}/ttyNOPE:57600", tmp_path) == (
        f"There is no serial line {tmp_path}/ttyNOPE. Plug it in, or name another one. "
        f"Lines here: {tmp_path}/ttyACM0, {tmp_path}/ttyUSB1."
    )
    assert trouble("/dev/ttyNOPE,57600", tmp_path / "empty") == (
        "There is no serial line /dev/ttyNOPE. Plug it in, or name another one. Lines here: none."
    )


def test_a_line_that_may_not_be_opened_names_the_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line = tmp_path / "ttyACM0"
    line.touch()
    monkeypatch.setattr(os, "access", lambda _path, _how: False)  # root may open every line
    monkeypatch.setenv("LOGNAME", "pilot")
    assert trouble(f"serial:{line}:57600", tmp_path) == (
        f"pilot may not open {line}. Run 'sudo usermod -aG dialout pilot' and log in again."
    )


def test_a_line_that_is_there_and_a_form_of_mavproxy_alone_are_left_to_it(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    try:
        assert trouble(f"{os.ttyname(theirs)},57600", tmp_path) is None
    finally:
        os.close(ours)
        os.close(theirs)
    assert trouble("mcast:", tmp_path) is None
    assert trouble("udpin:127.0.0.1:14550", tmp_path) is None


def test_a_name_without_an_address_is_told() -> None:
    assert trouble("tcp:no-such-host.invalid:5762") == (
        "No address is known for the name no-such-host.invalid. Look at its spelling, and at this machine's network."
    )


def test_a_port_of_this_machine_that_nobody_has_is_told_and_nobody_is_connected_to() -> None:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        port = listener.getsockname()[1]
        listener.listen()
        listener.settimeout(0.0)
        assert trouble(f"tcp:127.0.0.1:{port}") is None
        with pytest.raises(BlockingIOError):
            listener.accept()
    assert trouble(f'tcp:127.0.0.1:{port}:{{"label":"drone-1"}}') == (
        f"Nothing listens at 127.0.0.1:{port} (TCP). Start the program there first, or give another port."
    )


@pytest.mark.parametrize("program", [companion, station])
def test_it_is_told_before_mavproxy_runs(
    program: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from mavproxy_handover import cli
    from mavproxy_handover.cli import run

    monkeypatch.chdir(tmp_path)
    assert cli.main(["init", "demo", "demo"]) == 0
    ran: list[list[str]] = []
    monkeypatch.setattr(run, "_station", lambda command, _arguments: ran.append(command) or 0)
    monkeypatch.setattr(run, "_supervise", lambda command, _arguments: ran.append(command) or 0)
    config = "demo/handover.toml" if program is companion else "demo/GCSA.toml"
    assert program(["--config", config, "--master", "/dev/ttyNOPE,57600"]) == 0  # type: ignore[operator]
    assert len(ran) == 1
    assert f"handover {program.__name__}: WARNING: There is no serial line /dev/ttyNOPE." in capfd.readouterr().err  # type: ignore[attr-defined]
