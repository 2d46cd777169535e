# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion's console: output that waits for nobody, and input whose end is not the companion's.

A terminal can be stopped by a key, and a pipe may have nobody who reads it. MAVProxy prints in its main loop, where
the lease goes out, and would wait. So what is printed is only put down here, and a thread takes it to where it is read.
What nobody reads in time is thrown away and counted; the count is printed when there is room again.

A thread of its own reads lines, too: MAVProxy itself ends with its input.
"""

from __future__ import annotations

import io
import os
import sys
import threading
import time
from collections import deque
from typing import Any, Final

__all__ = ["Console", "read_lines"]

#: characters that wait to be read
_MOST: Final = 64 * 1024
_AGAIN_S: Final = 0.05


class Console:
    """Standard output and error output, in the order in which they were written."""

    def __init__(self, most: int = _MOST) -> None:
        self._most = most
        self._waiting: deque[tuple[int, str]] = deque()
        self._size = 0
        self._dropped = 0
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="console", daemon=True)

    def take_over(self) -> None:
        """From now on what this process prints goes through here."""
        sys.stdout, sys.stderr = _Stream(self, 1), _Stream(self, 2)
        self._thread.start()

    def put(self, descriptor: int, text: str) -> None:
        """Put text down for `descriptor`; returns at once."""
        with self._change:
            if self._size + len(text) > self._most:
                self._dropped += text.count("\n") or 1
                return
            if self._dropped:
                text = f"[{self._dropped} lines left out: nobody read them]\n{text}"
                self._dropped = 0
            self._waiting.append((descriptor, text))
            self._size += len(text)
            self._change.notify_all()

    def drain(self, limit_s: float) -> None:
        """Wait until everything is read, but no longer than `limit_s`."""
        with self._change:
            self._change.wait_for(lambda: not self._size, limit_s)

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: bool(self._waiting))
                descriptor, text = self._waiting.popleft()
            _write(descriptor, text.encode("utf-8", "backslashreplace"))
            with self._change:
                self._size -= len(text)
                self._change.notify_all()


class _Stream(io.TextIOBase):
    """In the place of sys.stdout or sys.stderr."""

    encoding = "utf-8"
    errors = "backslashreplace"

    def __init__(self, console: Console, descriptor: int) -> None:
        self._console = console
        self._descriptor = descriptor

    def writable(self) -> bool:
        """As of any stream to write to."""
        return True

    def fileno(self) -> int:
        """Where it goes in the end."""
        return self._descriptor

    def isatty(self) -> bool:
        """Whether that is a terminal."""
        return os.isatty(self._descriptor)

    def write(self, text: str) -> int:
        """Put it down; returns at once."""
        self._console.put(self._descriptor, text)
        return len(text)


def _write(descriptor: int, data: bytes) -> None:
    """Wait until all of it is taken. What nobody can take any more is gone."""
    while data:
        try:
            data = data[os.write(descriptor, data) :]
        except BlockingIOError:  # somebody who shares it has made it so
            time.sleep(_AGAIN_S)
        except OSError:  # the reader is gone
            return


def read_lines(mpstate: Any) -> None:
    """Hand lines of the console to MAVProxy's main loop, until there are no more; to be run in a thread."""
    try:
        while True:
            mpstate.input_queue.put(mpstate.rl.input())
    except (EOFError, OSError, ValueError, RuntimeError):  # ended, closed, or none from the start ("lost sys.stdin")
        return
