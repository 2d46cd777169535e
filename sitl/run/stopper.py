# SPDX-License-Identifier: GPL-3.0-or-later

"""Stops ArduPilot's SITL program while the runner gets no processor: `python -m sitl.run.stopper PAGE PID`.

The runner itself holds the program where others are late (`pacing.py`). On a busy computer the runner may get no
processor for 0.4 s. At 8 times real time ArduPilot flies 3 s meanwhile, its guard finds no lease and commands RTL. This
process sleeps nearly always, so the kernel lets it run at once: it stops the program when the runner has not written
simulated time for `UNTENDED_S` of the wall clock. Only the runner lets it go on again, each time that it writes.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from sitl.sim_time import Page

__all__ = ["UNTENDED_S", "Stopper", "main"]

UNTENDED_S: Final = 0.05
_LOOK_S: Final = 0.01


class Stopper:
    """The process. `page`: of the run; `pid`: of the program that is stopped."""

    def __init__(self, page: Page, pid: int) -> None:
        root = str(Path(__file__).resolve().parents[2])
        search = os.pathsep.join(part for part in (root, os.environ.get("PYTHONPATH", "")) if part)
        argv = [sys.executable, "-m", "sitl.run.stopper", str(page.path), str(pid)]
        self._process = subprocess.Popen(argv, env={**os.environ, "PYTHONPATH": search}, stdin=subprocess.DEVNULL)

    def end(self) -> None:
        """From now on it stops nothing. Safe to call twice."""
        self._process.kill()
        self._process.wait()


def main(argv: Sequence[str]) -> int:
    """Look until the program, or who started this process, has ended; returns the exit code."""
    page, pid, runner = Page(Path(argv[0])), int(argv[1]), os.getppid()
    try:
        while os.getppid() == runner:
            os.kill(pid, signal.SIGSTOP if page.silence_s > UNTENDED_S else 0)  # 0: only asks whether it is there
            time.sleep(_LOOK_S)
        os.kill(pid, signal.SIGCONT)
    except ProcessLookupError:
        pass
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
