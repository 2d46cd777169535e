# SPDX-License-Identifier: GPL-3.0-or-later

"""A program that was started for our module ends where that cannot be loaded: code 2, and one line that says why."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from mavproxy_handover.supervision import must_load

TIMEOUT_S = 60.0
STATION = """
[station]
name = "GCSA"
sysid = 251
vehicle = 1
"""
GROUND = """
[ground]
listen = "udpin:127.0.0.1:{port}"
allow_unsigned = true
"""


@pytest.fixture
def taken() -> Iterator[int]:
    """A port that somebody else has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        yield other.getsockname()[1]


def station(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    """`handover station` with this configuration, to its end."""
    config = folder / "station.toml"
    config.write_text(text)
    words = ["station", f"--config={config}", "--master=udpin:127.0.0.1:0"]
    return subprocess.run(
        [sys.executable, "-m", "mavproxy_handover.cli", *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )


def test_a_station_whose_port_is_taken_ends(tmp_path: Path, taken: int) -> None:
    ended = station(tmp_path, STATION + GROUND.format(port=taken))
    assert ended.returncode == 2, ended.stdout[-1000:] + ended.stderr[-1000:]
    (line,) = [line for line in ended.stderr.splitlines() if line.startswith("handover station:")]
    assert line.startswith("handover station: module handover_gcs is not loaded: ")
    assert str(taken) in line


def test_a_station_whose_key_others_may_read_ends(tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_text("0" * 64 + "\n")
    key.chmod(0o644)
    ended = station(tmp_path, f'{STATION}key = "{key}"')
    assert ended.returncode == 2, ended.stdout[-1000:] + ended.stderr[-1000:]
    assert f"{key}" in ended.stderr


class Console:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def writeln(self, line: str) -> None:
        self.lines.append(line)


class State:
    """As much of MAVProxy's state as a module that is not loaded needs."""

    def __init__(self) -> None:
        self.console = Console()


def test_a_module_that_is_loaded_by_hand_only_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "_exit", lambda code: pytest.fail(f"ended with {code}"))
    monkeypatch.delenv(must_load.MUST_LOAD, raising=False)
    state = State()
    must_load.refused(state, "handover_gcs", "why")
    assert state.console.lines == ["handover_gcs is not loaded: why"]


def test_only_the_first_load_has_to_succeed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "_exit", lambda code: pytest.fail(f"ended with {code}"))
    monkeypatch.setenv(must_load.MUST_LOAD, "handover station")
    must_load.loaded()
    must_load.refused(State(), "handover_gcs", "why")


def test_what_it_ends_with(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    codes: list[int] = []
    monkeypatch.setattr(os, "_exit", codes.append)
    monkeypatch.delenv(must_load.MUST_LOAD, raising=False)
    must_load.must_load("handover station")
    must_load.refused(State(), "handover_gcs", "the port is taken")
    assert codes == [2]
    assert capsys.readouterr().err == "handover station: module handover_gcs is not loaded: the port is taken\n"
    must_load.refused(State(), "handover_gcs", "again")
    assert codes == [2], "said once"


def test_a_module_that_cannot_be_imported_is_refused_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(must_load.MUST_LOAD, raising=False)
    state = State()
    assert must_load.starter("handover", "a_module_that_is_not_there.module")(state, config="x") is None
    (line,) = state.console.lines
    assert line.startswith("handover is not loaded: a_module_that_is_not_there is not installed. Run: ")
