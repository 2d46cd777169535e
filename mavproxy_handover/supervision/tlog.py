# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's telemetry log, as a companion can have it: it keeps nobody waiting, and its end is in the file.

MAVProxy hands frames to the thread that writes them through queues for processes: each frame is pickled and goes
through a pipe, and a thread behind each queue fills that pipe. When the writer falls behind or dies (a full disk),
those threads wait for ever, memory grows, and the program hangs at its end. Queues between threads do without all this.
These are bounded: what does not fit any more is counted and not written.
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

__all__ = ["LogQueue", "close_logs", "log_options", "take_queues"]

#: entries; some minutes of a busy link
_MOST: Final = 50_000
#: below this MAVProxy ends at its start (it says 200 MB and means 200 MiB)
_ROOM_BYTES: Final = 209_715_200
#: MAVProxy's name for the thread that writes both files
_WRITER: Final = "log_writer"


class LogQueue:
    """What MAVProxy uses of a `multiprocessing.Queue`, between threads."""

    def __init__(self, most: int = _MOST) -> None:
        self._most = most
        self._entries: queue.SimpleQueue[Any] = queue.SimpleQueue()
        #: entries that did not fit
        self.lost = 0

    def put(self, entry: Any) -> None:
        """Add an entry, or lose it; returns at once."""
        if self._entries.qsize() < self._most:
            self._entries.put(entry)
        else:
            self.lost += 1

    def get(self, block: bool = True) -> Any:
        """The next entry; `block`: wait for it. Raises queue.Empty."""
        return self._entries.get(block)

    def empty(self) -> bool:
        """Nothing to get now."""
        return self._entries.empty()


def take_queues(script: str) -> None:
    """The module named `script` (MAVProxy's own) gets such queues; others, which talk to processes, theirs."""
    original = multiproc.Queue

    def make(*arguments: Any) -> Any:
        caller = sys._getframe(1).f_globals.get("__name__")
        return LogQueue() if caller == script else original(*arguments)

    multiproc.Queue = make


def log_options(argv: list[str]) -> list[str]:
    """What a start needs besides, for it may be in flight: MAVProxy must not begin the tlog anew, nor end for want of
    room."""
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
    """Write what waits, and close both files. MAVProxy ends, and so does their writer once it is woken up."""
    writers = [thread for thread in threading.enumerate() if thread.name == _WRITER]
    for name in ("logqueue_raw", "logqueue"):
        entries, file = getattr(mpstate, name, None), getattr(mpstate, name.replace("queue", "file"), None)
        if entries is None or file is None:
            continue
        for writer in writers:
            entries.put(b"")
            writer.join(limit_s)
        with suppress(OSError, ValueError):  # no room: then it ends here
            while not entries.empty():
                file.write(entries.get())
        with suppress(OSError, ValueError):
            file.close()
