# SPDX-License-Identifier: GPL-3.0-or-later

"""What the tutorial and "By hand" have typed in four terminals runs: the very lines, with free ports in their place.

The vehicle, the companion and both stations start, GCSA commands, and `handover share` brings the mission aboard.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from mavproxy_handover import cli
from sitl.vehicles.ports import PortPicker

ROOT = Path(__file__).resolve().parents[2]
#: first words of what is started and goes on, in the order of the pages
GOES_ON = ("python", "handover companion", "handover station", "mavproxy.py")

pytestmark = pytest.mark.process


def started(page: str) -> list[str]:
    """The lines of that page which start something that goes on; of two vehicles the one that ships."""
    lines = []
    for token in MarkdownIt().parse((ROOT / "docs" / page).read_text(encoding="utf-8")):
        if token.type == "fence" and not token.info.strip():
            lines += [line.strip() for line in token.content.replace("\\\n", " ").splitlines()]
    return [line for line in lines if line.startswith(GOES_ON)]


@pytest.mark.parametrize("page", ["tutorial.md", "by-hand.md"])
def test_four_terminals_are_a_vehicle_a_companion_and_two_stations(page: str, tmp_path: Path) -> None:
    lines = started(page)
    assert len(lines) == 4
    folder = tmp_path / "handover-demo"
    assert cli.main(["init", "demo", str(folder)]) == 0
    picker = PortPicker()
    ports = {5762: picker.tcp(), **{port: picker.udp() for port in (14551, 14552, 15551, 15552)}}

    def moved(text: str) -> str:
        return re.sub(r"\b(5762|14551|14552|15551|15552)\b", lambda port: str(ports[int(port[1])]), text)

    for config in folder.glob("*.toml"):
        config.write_text(moved(config.read_text(encoding="utf-8")), encoding="utf-8")
    here = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{here}{os.pathsep}{os.environ['PATH']}"}
    programs: list[subprocess.Popen[bytes]] = []
    outputs = [folder / f"{number}.out" for number in range(4)]
    try:
        for line, output in zip(lines, outputs, strict=True):
            with output.open("wb") as file:
                programs.append(
                    subprocess.Popen(
                        shlex.split(moved(line)),
                        cwd=folder,
                        env=environment,
                        stdin=subprocess.PIPE,
                        stdout=file,
                        stderr=subprocess.STDOUT,
                        start_new_session=True,
                    )
                )
            time.sleep(1.0)  # as somebody who goes from one terminal to the next
        _wait(outputs[2], "I have drone-1: GCSA is the commander now", programs)
        station = programs[2].stdin
        assert station is not None
        station.write(b"handover share\n")
        station.flush()
        _wait(outputs[2], "Mission loaded: written to the autopilot, read back, equal.", programs)
    finally:
        for program in programs:
            if program.poll() is None:
                os.killpg(program.pid, signal.SIGKILL)
            program.wait(10)
            if program.stdin is not None:
                program.stdin.close()


def _wait(output: Path, text: str, programs: list[subprocess.Popen[bytes]]) -> None:
    until = time.monotonic() + 90.0
    while time.monotonic() < until:
        shown = output.read_text(encoding="utf-8", errors="replace")
        if text in shown:
            return
        assert all(program.poll() is None for program in programs), shown[-2000:]
        time.sleep(0.2)
    raise AssertionError(f"never shown: {text}\n{shown[-2000:]}")
