# SPDX-License-Identifier: GPL-3.0-or-later

"""Uses a station as an operator does, in this process: its commands in a shell, its module, its panel.

It needs no test framework, so that it runs on Windows and macOS as it is: `python tests/platforms/station_alone.py`.
It prints a line for each part, and raises at the first that fails.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import socket
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from gcs_module import module as station_module
from gcs_module.panel.endpoint import FOLDER_VARIABLE, find
from gcs_module.panel.reader import Reader
from mavproxy_handover.cli import main
from tests.module.proxy import MPState

MISSION: Final = Path(__file__).resolve().parents[2] / "missions" / "delivery"

CONFIGURATION: Final = """
[station]
name = "GCSA"
sysid = 251
vehicle = 1
mission = '{mission}'
key = "GCSA.key"
require_operator = true
[ground]
listen = "udpin:127.0.0.1:{port}"
key = "ground.key"
[[peer]]
name = "GCSB"
sysid = 252
link = "udpout:127.0.0.1:{other}"
"""


def free_port() -> int:
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def shell(*words: str, code: int = 0) -> str:
    """What a command prints."""
    printed, wrong = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(wrong):
        ended = main(list(words))
    assert ended == code, (words, ended, printed.getvalue(), wrong.getvalue())
    return printed.getvalue() + wrong.getvalue()


def the_commands(folder: Path) -> Iterator[str]:
    """Every command that a station's computer needs."""
    os.chdir(folder)
    assert "in flight:" in shell("--help")
    shell("keys", "make", "--dir", str(folder), "GCSA", "ground")
    shell("keys", "list", "--dir", str(folder))
    yield "keys"
    (folder / "station.toml").write_text(
        CONFIGURATION.format(mission=MISSION, port=free_port(), other=free_port()), encoding="utf-8"
    )
    assert "handover_gcs" in shell("station", "--print", "--master", "udpin:127.0.0.1:0")
    yield "station"
    shell("check", str(MISSION))
    yield "check"
    shell("init", "station", "--help")
    shell("init", "mission", "--help")
    yield "init"
    shell("logs", "--logs", str(folder))
    yield "logs"
    for word in ("policy", "explain", "completion", "panel", "watch", "keys"):
        shell(word, "--help")
    yield "help"


def the_module(folder: Path) -> Iterator[str]:
    """The module in a MAVProxy, and a panel that reads it."""
    mpstate = MPState()
    module: Any = mpstate.load("handover_gcs", station_module, config=str(folder / "station.toml"))
    assert module is not None, mpstate.console.lines
    yield "module loaded"
    mpstate.type("handover operator Jansen")
    assert mpstate.console.said("Jansen is on duty.")
    for _round in range(50):
        mpstate.loop()
        time.sleep(0.01)
    assert any("commander" in line for line in mpstate.type("handover status"))
    assert module.faults == {}, (module.faults, mpstate.escaped)
    yield "commands"
    reader = Reader(lambda: find("GCSA"))
    deadline = time.monotonic() + 10.0
    while reader.seen is None and time.monotonic() < deadline:
        reader.tick(time.monotonic())
        mpstate.loop()
        time.sleep(0.01)
    assert reader.seen is not None, reader.fault
    assert reader.seen.station == "GCSA"
    reader.close()
    yield "panel"
    mpstate.unload("handover_gcs")
    assert mpstate.escaped == []
    yield "module unloaded"


def run() -> None:
    """All of it."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        os.environ[FOLDER_VARIABLE] = str(folder / "panels")
        try:
            for part in itertools.chain(the_commands(folder), the_module(folder)):
                print(f"{sys.platform}: {part}: good", flush=True)
        finally:
            os.chdir(before)


if __name__ == "__main__":
    run()
