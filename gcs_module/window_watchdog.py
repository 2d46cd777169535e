# SPDX-License-Identifier: GPL-3.0-or-later

"""Ends the windows of a station that dies: `python -m gcs_module.window_watchdog STATION`.

MAVProxy's console and map run in their own processes. If MAVProxy is killed, they stay open and show the station's last
values. So a small process watches the station: after its parent, process STATION, has ended, it ends the windows and
then itself. It reads the ids of their processes from standard input, a line for each change.

It ends them by SIGKILL: they have inherited MAVProxy's handlers of the other signals, which end nothing there. Linux
gives a handle to a process, so another process with the same id is never ended.

The windows of a station that hangs stay open. The map itself marks old values (`map_drawing.py`).
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
    """The station's side. `fault` gets the place of a fault, and its text."""

    def __init__(self, fault: Callable[[str, str], None]) -> None:
        self._fault = fault
        self._process: subprocess.Popen[bytes] | None = None
        self._told: tuple[int, ...] = ()
        #: not on Windows, where a window ends with its station's pipe
        self._off = sys.platform == "win32"

    @property
    def pid(self) -> int | None:
        """The watching process; None: there is none, as while no window is open."""
        return None if self._process is None else self._process.pid

    def tick(self) -> None:
        """Tell the process which windows there are; to be called each second."""
        if self._off:
            return
        windows = tuple(sorted(child.pid for child in multiprocessing.active_children() if child.pid is not None))
        try:
            self._start_or_close(windows)
            if self._process is not None and windows != self._told:
                assert self._process.stdin is not None
                self._process.stdin.write(" ".join(map(str, windows)).encode() + b"\n")
                self._told = windows
        except OSError as error:
            self._fault(_WHERE, f"windows would stay if this program died: {error}")
            self._off = self._process is None  # the process cannot be started on this computer
            self.close()

    def _start_or_close(self, windows: tuple[int, ...]) -> None:
        if self._process is not None and self._process.poll() is not None:
            self.close()
        if self._process is None and windows:
            argv = [sys.executable, "-m", "gcs_module.window_watchdog", str(os.getpid())]
            # its own session: the terminal's Ctrl-C is for the station only
            self._process = subprocess.Popen(argv, stdin=subprocess.PIPE, bufsize=0, start_new_session=True)

    def close(self) -> None:
        """End the process; the windows stay open."""
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
        """Raises OSError if there is no such process."""
        self._pid = pid
        self._handle = os.pidfd_open(pid) if hasattr(os, "pidfd_open") else None

    def end(self) -> None:
        with suppress(OSError):
            if self._handle is None:
                os.kill(self._pid, signal.SIGKILL)
            else:
                signal.pidfd_send_signal(self._handle, signal.SIGKILL)

    def close_handle(self) -> None:
        if self._handle is not None:
            os.close(self._handle)


def main(argv: list[str]) -> int:
    """Watch until the parent has ended. `argv`: its process id."""
    station = int(argv[0])
    windows: dict[int, _Window] = {}
    rest = b""
    hears = True
    while True:
        wait_s = _LOOK_S if os.getppid() == station else 0.0
        if hears and select.select([0], [], [], wait_s)[0]:  # read what the station wrote before it died
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
        windows.pop(pid).close_handle()
    for pid in told - windows.keys():
        with suppress(OSError):  # it was closed meanwhile
            windows[pid] = _Window(pid)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
