# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's telemetry log for a companion: it never delays the main loop, and it is complete at the end.

MAVProxy passes frames to the thread that writes them through queues for processes. Each frame is pickled and goes
through a pipe, which another thread fills. If the writer is too slow or dies (full disk), those threads wait for ever,
memory grows, and the program hangs at its end. Queues between threads avoid that. They are bounded here: entries
without room are counted and not written.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from MAVProxy.modules.lib import multiproc

__all__ = ["LogQueue", "close_logs", "log_options", "replace_queues"]

#: most entries: some minutes of a busy link
_MOST: Final = 50_000
#: with less free space MAVProxy ends at its start (it says 200 MB and means 200 MiB)
_ROOM_BYTES: Final = 209_715_200
#: MAVProxy's name for the thread that writes both files
_WRITER: Final = "log_writer"


class LogQueue:
    """The methods of a `multiprocessing.Queue` that MAVProxy uses, between threads."""

    def __init__(self, most: int = _MOST) -> None:
        self._most = most
        self._entries: queue.SimpleQueue[Any] = queue.SimpleQueue()
        #: number of entries without room
        self.lost = 0

    def put(self, entry: Any) -> None:
        """Add an entry, or drop it; returns at once."""
        if self._entries.qsize() < self._most:
            self._entries.put(entry)
        else:
            self.lost += 1

    def get(self, block: bool = True) -> Any:
        """The next entry; `block`: wait for it. Raises queue.Empty."""
        return self._entries.get(block)

    def empty(self) -> bool:
        """True if the queue is empty now."""
        return self._entries.empty()


def replace_queues(script: str) -> None:
    """Give such queues to the module named `script` (MAVProxy). Other modules, which use processes, keep theirs."""
    original = multiproc.Queue

    def make(*arguments: Any) -> Any:
        caller = sys._getframe(1).f_globals.get("__name__")
        return LogQueue() if caller == script else original(*arguments)

    multiproc.Queue = make


def log_options(argv: list[str]) -> list[str]:
    """Options that a start in flight needs too.

    MAVProxy must append to the tlog and not end for lack of space.
    """
    named = [word.partition("=")[2] for word in argv if word.startswith("--logfile=")]
    path = Path(named[-1]) if named else Path("mav.tlog")
    try:
        room = os.statvfs(path.parent)
        for file in (path, path.with_name(path.name + ".raw")):
            with file.open("ab"):
                pass
    except OSError:
        return ["--no-state"]
    return ["--append-log"] if room.f_bfree * room.f_bsize >= _ROOM_BYTES else ["--no-state"]


def close_logs(mpstate: Any, limit_s: float) -> None:
    """Write the waiting entries, and close both files. MAVProxy is ending; its writer ends too once it is woken up."""
    writers = [thread for thread in threading.enumerate() if thread.name == _WRITER]
    for name in ("logqueue_raw", "logqueue"):
        entries, file = getattr(mpstate, name, None), getattr(mpstate, name.replace("queue", "file"), None)
        if entries is None or file is None:
            continue
        for writer in writers:
            entries.put(b"")
            writer.join(limit_s)
        with suppress(OSError, ValueError):  # no room: the log ends here
            while not entries.empty():
                file.write(entries.get())
        with suppress(OSError, ValueError):
            file.close()
