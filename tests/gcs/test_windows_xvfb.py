# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's real windows with our contents, on a virtual screen.

It needs wxPython and OpenCV as docs/station-display.md installs them, and Xvfb and xwininfo (Debian: xvfb, x11-utils).
$HANDOVER_WX_PYTHON names the Python of an environment that has wxPython; else it is this one.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

PYTHON = os.environ.get("HANDOVER_WX_PYTHON", sys.executable)
TITLES = ("GCSA: vehicle 1 - Console", "GCSA: vehicle 1 - Map")
STATION = """
[station]
name = "GCSA"
sysid = 251
vehicle = 1
"""
WITHIN_S = 90.0


@pytest.fixture
def display() -> Iterator[str]:
    """A virtual screen."""
    for program in ("Xvfb", "xwininfo"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed: the station's windows were NOT tried")
    found = subprocess.run([PYTHON, "-c", "import wx, cv2, matplotlib"], capture_output=True, check=False)
    if found.returncode:
        pytest.skip(f"{PYTHON} has no wxPython, OpenCV or matplotlib: the station's windows were NOT tried")
    reader, writer = os.pipe()
    words = ["Xvfb", "-displayfd", str(writer), "-screen", "0", "1400x900x24", "-nolisten", "tcp"]
    server = subprocess.Popen(words, pass_fds=(writer,), stderr=subprocess.DEVNULL)
    os.close(writer)
    with os.fdopen(reader) as number:
        name = f":{number.readline().strip()}"
    yield name
    server.terminate()
    server.wait(10.0)


def windows(display: str) -> str:
    listed = subprocess.run(
        ["xwininfo", "-root", "-tree", "-display", display], capture_output=True, text=True, check=False
    )
    return listed.stdout


def until(holds: Callable[[], bool], what: Callable[[], str]) -> None:
    end = time.monotonic() + WITHIN_S
    while not holds():
        assert time.monotonic() < end, what()
        time.sleep(0.5)


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_both_windows_have_their_titles_and_close_with_the_station(
    how: signal.Signals, display: str, tmp_path: Path
) -> None:
    config = tmp_path / "station.toml"
    config.write_text(STATION)
    words = ["station", f"--config={config}", "--master=udpin:127.0.0.1:0", "--", "--console", "--map"]
    log = tmp_path / "log"
    with log.open("wb") as output:
        station = subprocess.Popen(
            [PYTHON, "-m", "mavproxy_handover.cli", *words],
            cwd=tmp_path,
            env={**os.environ, "DISPLAY": display, "HOME": str(tmp_path), "WXSUPPRESS_SIZER_FLAGS_CHECK": "1"},
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        until(lambda: all(title in windows(display) for title in TITLES), lambda: windows(display) + log.read_text())
        station.send_signal(how)
        until(lambda: not any(title in windows(display) for title in TITLES), lambda: windows(display))
    finally:
        if station.poll() is None:
            os.killpg(station.pid, signal.SIGKILL)
        station.wait()
        assert station.stdin is not None
        station.stdin.close()
