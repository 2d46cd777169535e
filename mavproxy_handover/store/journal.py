# SPDX-License-Identifier: GPL-3.0-or-later

"""The journal: a file of JSON lines, one object for each entry, for people and programs after the flight.

Every entry has `t` (monotonic seconds, so differences are correct even if the clock is set), `utc`, `who` and `event`;
`text` is the sentence for people. The file has a maximum size. When it is full it is renamed to `NAME.1` and a new one
begins, so the newest events are always there. An entry that was cut by a full disk or a power failure stays on a line
of its own.

Writing never raises and never waits, because a full, slow or missing disk must not end a flight or delay the lease. A
thread (`background_writer.py`) writes the entries in their order, a moment later. Entries that find no room in memory
or on the disk are counted. The next entry that can be written is preceded by the number of lost ones.

`note` is for frequent entries without consequences. A single write costs as much as a write of several entries if the
processor is otherwise idle. A noted entry keeps its own time and position, and reaches the file a moment later.

`lay_beside` stores files that the entries refer to, for example the mission package. Without them the entries cannot be
understood.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections import deque
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.store.background_writer import CLOSE_S, BackgroundWriter
from mavproxy_handover.store.portable import CLOSED_ON_EXEC

__all__ = ["Journal", "strangers_path"]

_MAX_BYTES = 64 * 1024 * 1024
#: at this number of entries `note` does not wait for `flush`
_MOST_WAITING: Final = 256
#: most entries that wait for the disk: those of the worst minute of a flight, a few megabytes
_MOST_BEHIND: Final = 4096

#: monotonic and UTC time (s), event, text, values
_Entry = tuple[float, float, str, str, dict[str, Any]]
#: made once, because making an encoder takes as long as using it
_encode = json.JSONEncoder(ensure_ascii=False, default=str).encode


def strangers_path(path: Path) -> Path:
    """Path of the second journal, for entries caused by senders that are not authenticated.

    It has its own maximum size, so such a sender cannot push an entry of the flight out of the journal.
    """
    return path.with_name(f"{path.stem}-strangers{path.suffix}")


class Journal:
    """An append-only event log."""

    def __init__(self, path: Path, who: str, max_bytes: int = _MAX_BYTES, *, strict: bool = True) -> None:
        """Open `path` for appending. Raises OSError if it cannot be opened, so that the fault shows before the flight.

        `strict` False: do not raise. Each entry tries again to open the file.
        """
        self.path = path
        self._who = who
        self._max_bytes = max_bytes
        self._descriptor: int | None = None
        self._closed = False
        #: the file ends in the middle of a line
        self._cut = False
        #: entries that are not yet given to the thread, and entries that wait for the disk
        self._waiting: list[_Entry] = []
        self._handed: deque[_Entry] = deque()
        #: entries dropped for lack of room (counted in the main loop), entries that could not be written (counted by
        #: the thread), and the number of both that the file already reports
        self._dropped = self._failed = self._told = 0
        self._writer = BackgroundWriter("journal")
        with nullcontext() if strict else suppress(OSError):
            self._open()

    @property
    def lost(self) -> int:
        """Number of entries that were lost."""
        return self._dropped + self._failed

    def write(self, event: str, text: str = "", **values: Any) -> None:
        """Write an entry, and those that wait. Values that are None are left out. The caller must not change the values
        later.
        """
        self.note(event, text, **values)
        self.flush()

    def note(self, event: str, text: str = "", **values: Any) -> None:
        """Add an entry that is written with the next `write` or `flush`, whichever comes first."""
        self._waiting.append((time.monotonic(), time.time(), event, text, values))
        if len(self._waiting) >= _MOST_WAITING:
            self.flush()

    def flush(self) -> None:
        """Write the waiting entries. Call it a few times a second."""
        waiting, self._waiting = self._waiting, []
        if not waiting:
            return
        taken = 0 if self._closed else min(len(waiting), max(0, _MOST_BEHIND - len(self._handed)))
        self._dropped += len(waiting) - taken
        self._handed.extend(waiting[:taken])
        self._writer.put("entries", self._write_down)

    def lay_beside(self, name: str, files: Mapping[str, bytes]) -> None:
        """Store these files in a new folder `STEM-NAME` beside the journal. An existing folder stays unchanged.

        If that fails, an entry reports it.
        """
        folder = self.path.with_name(f"{self.path.stem}-{name}")
        self._writer.put(f"folder {name}", partial(self._lay, folder, dict(files)))

    def wait_until_written(self, within_s: float) -> bool:
        """Wait at most `within_s` until all entries are written or lost. Returns True if they are."""
        self.flush()
        return self._writer.wait_until_written(within_s)

    def close(self, within_s: float = CLOSE_S) -> None:
        """Write the waiting entries, at most for `within_s`, and close the file. Later entries are lost and counted."""
        self.flush()
        self._closed = True
        if self._writer.close(within_s):
            self._release()
        # otherwise the thread may still be writing, so do not close the file: its descriptor could become another
        # file's
        self._dropped += len(self._handed)
        self._handed.clear()

    # ---- in the thread --------------------------------------------------------------------------------------------

    def _write_down(self) -> None:
        while True:
            try:
                entry = self._handed.popleft()
            except IndexError:
                return
            missing = self.lost - self._told
            if missing:
                text = f"{missing} entries are missing here: the disk was full or too slow"
                if self._put(time.monotonic(), time.time(), "journal_lost", text, {"count": missing}):
                    self._told += missing
            if not self._put(*entry):
                self._failed += 1

    def _put(self, at: float, utc: float, event: str, text: str, values: dict[str, Any]) -> bool:
        entry: dict[str, Any] = {"t": round(at, 4), "utc": "", "who": self._who, "event": event}
        if text:
            entry["text"] = text
        entry.update((key, value) for key, value in values.items() if value is not None)
        try:
            entry["utc"] = datetime.fromtimestamp(utc, timezone.utc).isoformat(timespec="milliseconds")
            self._append((_encode(entry) + "\n").encode("utf-8", "backslashreplace"))
        except Exception:  # a value in an entry may raise anything when it is encoded
            return False
        return True

    def _lay(self, folder: Path, files: Mapping[str, bytes]) -> None:
        if folder.exists():
            return
        draft = folder.with_name(f".{folder.name}.draft")  # a reader that finds the folder finds all its files
        try:
            shutil.rmtree(draft, ignore_errors=True)
            draft.mkdir()
            for name, data in files.items():
                (draft / name).write_bytes(data)
            draft.rename(folder)
        except OSError as error:
            shutil.rmtree(draft, ignore_errors=True)
            text = f"{folder.name} cannot be kept: {error.strerror or error}"
            self._put(time.monotonic(), time.time(), "not_kept", text, {"folder": str(folder)})

    def _open(self) -> int:
        if self._descriptor is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | CLOSED_ON_EXEC
            self._descriptor = os.open(self.path, flags, 0o644)
            size = os.fstat(self._descriptor).st_size
            self._cut = size > 0 and os.pread(self._descriptor, 1, size - 1) != b"\n"
        return self._descriptor

    def _append(self, line: bytes) -> None:
        descriptor = self._open()
        size = os.fstat(descriptor).st_size
        if size > 0 and size + len(line) > self._max_bytes:
            self._release()
            with suppress(OSError):  # a journal that is too long is better than none
                os.replace(self.path, self.path.with_name(self.path.name + ".1"))
            descriptor = self._open()
        data = b"\n" + line if self._cut else line
        written = os.write(descriptor, data)
        if written:
            self._cut = data[written - 1] != ord("\n")
        if written != len(data):
            raise OSError("no room for the whole line")

    def _release(self) -> None:
        if self._descriptor is not None:
            descriptor, self._descriptor = self._descriptor, None
            with suppress(OSError):
                os.close(descriptor)
