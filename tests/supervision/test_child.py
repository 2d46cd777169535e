# SPDX-License-Identifier: GPL-3.0-or-later

"""The supervised process ends in time, and closes what must be closed, if MAVProxy cannot end by itself."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

#: in place of MAVProxy: its main loop never ends
STUCK = """
import time
from pathlib import Path
from types import SimpleNamespace

class Module:
    name = "handover"
    def close_journal(self):
        Path("closed").touch()
        if Path("broken").exists():
            raise OSError("no disk")

class Other:
    name = "link"

mpstate = SimpleNamespace(status=SimpleNamespace(exit=False), modules=[(Other(), None), (Module(), None)])
print("runs", flush=True)
while True:
    time.sleep(0.05)
"""
CHILD = """
import sys
from pathlib import Path
from mavproxy_handover.supervision.child import Companion
from mavproxy_handover.supervision.script import Script
from mavproxy_handover.supervision.watchdog_pipe import Told, WatchdogPipe

Companion(Script(Path("stuck.py")), ["--non-interactive"])(WatchdogPipe(int(sys.argv[1]), Told()))
"""


@pytest.mark.parametrize("broken", [False, True])
def test_a_process_whose_main_loop_is_stuck_closes_the_journal_and_ends(tmp_path: Path, broken: bool) -> None:
    (tmp_path / "stuck.py").write_text(STUCK)
    if broken:
        (tmp_path / "broken").touch()
    reader, writer = os.pipe()
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(writer)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        pass_fds=[writer],
    )
    try:
        os.close(writer)
        assert child.stdout is not None
        assert child.stdout.readline() == b"runs\n"
        child.send_signal(signal.SIGTERM)
        assert child.wait(20.0) == 0
    finally:
        child.kill()
        child.wait()
        child.stdout.close()
    assert os.read(reader, 10) == b"e"
    os.close(reader)
    assert (tmp_path / "closed").is_file()
