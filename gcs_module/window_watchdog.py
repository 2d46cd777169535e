# SPDX-License-Identifier: GPL-3.0-or-later

"""A station that dies takes its windows with it: `python -m gcs_module.window_watchdog STATION`.

MAVProxy's console and map are processes of their own. If MAVProxy is killed, they stay, and go on showing what the
station knew last. So a small process watches the station: when its parent, process STATION, is no more, it ends the
windows and then itself. It is told on standard input which processes those are: their ids, a line for each change.

It ends them by SIGKILL: they have inherited MAVProxy's handlers of the other signals, which end nothing there. Linux
gives a handle to a process, so no other process with the same id is ever ended.

A station that stands still is not dead: its windows stay. The map marks what is old by itself (`map_drawing.py`).
"""

from __future__ import annotations

import multiprocessing
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

__all__ = ["WindowWatchdog", "main"]

_WHERE: Final = "window watchdog"
_LOOK_S: Final = 0.2
_END_S: Final = 1.0


class WindowWatchdog:
    """The station's side. `fault` is told where something broke, and what."""

    def __init__(self, fault: Callable[[str, str], None]) -> None:
        self._fault = fault
        self._process: subprocess.Popen[bytes] | None = None
        self._told: tuple[int, ...] = ()
        #: on Windows a window ends with its station's pipe
        self._off = sys.platform == "win32"

    @property
    def pid(self) -> int | None:
        """The process that watches; None: there is none, as while there is no window."""
        return None if self._process is None else self._process.pid

    def tick(self) -> None:
        """Tell it which windows there are; to be called each second."""
        if self._off:
            return
        windows = tuple(sorted(child.pid for child in multiprocessing.active_children() if child.pid is not None))
        try:
            self._see_to_process(windows)
            if self._process is not None and windows != self._told:
                assert self._process.stdin is not None
                self._process.stdin.write(" ".join(map(str, windows)).encode() + b"\n")
                self._told = windows
        except OSError as error:
            self._fault(_WHERE, f"windows would stay if this program died: {error}")
            self._off = self._process is None  # it cannot be started here
            self.close()

    def _see_to_process(self, windows: tuple[int, ...]) -> None:
        if self._process is not None and self._process.poll() is not None:
            self.close()
        if self._process is None and windows:
            argv = [sys.executable, "-m", "gcs_module.window_watchdog", str(os.getpid())]
            # a session of its own: the terminal's Ctrl-C is the station's
            self._process = subprocess.Popen(argv, stdin=subprocess.PIPE, bufsize=0, start_new_session=True)

    def close(self) -> None:
        """End the watching; windows stay as they are."""
        process, self._process, self._told = self._process, None, ()
        if process is None:
            return
        with suppress(OSError):
            process.kill()
        process.wait(_END_S)
        if process.stdin is not None:
            process.stdin.close()


class _Window:
    """A process that is to end with the station."""

    def __init__(self, pid: int) -> None:
        """Raises OSError: there is no such process."""
        self._pid = pid
        self._handle = os.pidfd_open(pid) if hasattr(os, "pidfd_open") else None

    def end(self) -> None:
        with suppress(OSError):
            if self._handle is None:
                os.kill(self._pid, signal.SIGKILL)
            else:
                signal.pidfd_send_signal(self._handle, signal.SIGKILL)

    def let_go(self) -> None:
        if self._handle is not None:
            os.close(self._handle)


def main(argv: list[str]) -> int:
    """Watch until the parent is no more. `argv`: its process id."""
    station = int(argv[0])
    windows: dict[int, _Window] = {}
    rest = b""
    hears = True
    while True:
        wait_s = _LOOK_S if os.getppid() == station else 0.0
        if hears and select.select([0], [], [], wait_s)[0]:  # what a station said before it died counts
            data = os.read(0, 4096)
            hears = bool(data)
            *lines, rest = (rest + data).split(b"\n")
            if lines:
                _follow(windows, {int(word) for word in lines[-1].split()})
        elif not wait_s:
            break
        elif not hears:
            time.sleep(wait_s)
    for window in windows.values():
        window.end()
    return 0


def _follow(windows: dict[int, _Window], told: set[int]) -> None:
    for pid in windows.keys() - told:
        windows.pop(pid).let_go()
    for pid in told - windows.keys():
        with suppress(OSError):  # closed meanwhile
            windows[pid] = _Window(pid)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
