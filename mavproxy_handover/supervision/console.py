# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion's console: output that never waits for a reader, and input whose end does not end the companion.

A key can stop a terminal, and a pipe may have no reader. MAVProxy prints in its main loop, which sends the lease, and
would wait. So printed text is only queued here, and a thread writes it. Text that is not read in time is dropped and
counted. The count is printed when there is room again.

Another thread reads lines, because MAVProxy itself ends when its input ends.
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

#: most characters that wait to be written
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

    def redirect_output(self) -> None:
        """Redirect the output of this process to here."""
        sys.stdout, sys.stderr = _Stream(self, 1), _Stream(self, 2)
        self._thread.start()

    def put(self, descriptor: int, text: str) -> None:
        """Queue text for `descriptor`; returns at once."""
        with self._change:
            if self._size + len(text) > self._most:
                self._dropped += text.count("\n") or 1
                return
            if self._dropped:
                text = f"[{self._dropped} lines left out: no program read them]\n{text}"
                self._dropped = 0
            self._waiting.append((descriptor, text))
            self._size += len(text)
            self._change.notify_all()

    def drain(self, limit_s: float) -> None:
        """Wait until everything is written, at most `limit_s`."""
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
    """Replaces sys.stdout or sys.stderr."""

    encoding = "utf-8"
    errors = "backslashreplace"

    def __init__(self, console: Console, descriptor: int) -> None:
        self._console = console
        self._descriptor = descriptor

    def writable(self) -> bool:
        """Always true."""
        return True

    def fileno(self) -> int:
        """The descriptor that the text is written to."""
        return self._descriptor

    def isatty(self) -> bool:
        """True if that is a terminal."""
        return os.isatty(self._descriptor)

    def write(self, text: str) -> int:
        """Queue the text; returns at once."""
        self._console.put(self._descriptor, text)
        return len(text)


def _write(descriptor: int, data: bytes) -> None:
    """Write all of it, and wait for that. Text that cannot be written any more is dropped."""
    while data:
        try:
            data = data[os.write(descriptor, data) :]
        except BlockingIOError:  # another program that shares the descriptor has made it non-blocking
            time.sleep(_AGAIN_S)
        except OSError:  # the reader is gone
            return


def read_lines(mpstate: Any) -> None:
    """Pass lines of the console to MAVProxy's main loop until the input ends. Runs in a thread."""
    try:
        while True:
            mpstate.input_queue.put(mpstate.rl.input())
    except (EOFError, OSError, ValueError, RuntimeError):  # ended, closed, or missing from the start ("lost sys.stdin")
        return
