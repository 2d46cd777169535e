# SPDX-License-Identifier: GPL-3.0-or-later

"""The journal: JSON lines, one object an entry, for people and programs after the flight.

Every entry carries `t` (monotonic seconds: differences are true even when the clock is set), `utc`, `who` and `event`;
`text` is the sentence for people. The file is size-capped: when full it moves to `NAME.1` and a new one begins, so the
newest events are always there. An entry that was cut (full disk, power failure) stays a line by itself.

Writing never raises and never waits: a disk that is full, slow or gone must not end a flight, nor hold up the lease.
Entries are written by a thread (`background_writer.py`), in their order, a moment after they were given; those that
find no room there, or none on the disk, are counted, and once an entry can be written again the journal says how many
are missing.

`note` is for what comes often and changes nothing: a single entry costs as much as several that are written together,
when little else runs on the processor. Its entries have their own time and place, and are in the file a moment later.

`lay_beside` is for what the entries speak of and do not hold, as the mission package: without it nobody can read them.
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

from mavproxy_handover.store.background_writer import CLOSE_S, Behind

__all__ = ["Journal", "strangers_path"]

_MAX_BYTES = 64 * 1024 * 1024
#: so many entries are not left waiting for `flush`
_MOST_WAITING: Final = 256
#: and so many wait for the disk: the worst minute of a flight, in a few megabytes
_MOST_BEHIND: Final = 4096

#: both times (monotonic and UTC s), event, text, values
_Entry = tuple[float, float, str, str, dict[str, Any]]
#: made once: to make an encoder takes as long as to use it
_encode = json.JSONEncoder(ensure_ascii=False, default=str).encode


def strangers_path(path: Path) -> Path:
    """Beside a journal: what those make us write who have not proven to be anybody.

    It has a size of its own, so nothing that they do can push an entry of the flight out of the journal.
    """
    return path.with_name(f"{path.stem}-strangers{path.suffix}")


class Journal:
    """An append-only event log."""

    def __init__(self, path: Path, who: str, max_bytes: int = _MAX_BYTES, *, strict: bool = True) -> None:
        """Open `path` for appending. Raises OSError if that cannot be done: better before the flight than in it.

        `strict` False: that is no error. It is tried again with each entry.
        """
        self.path = path
        self._who = who
        self._max_bytes = max_bytes
        self._descriptor: int | None = None
        self._closed = False
        #: the file ends in the middle of a line
        self._cut = False
        #: entries that are not handed over yet, and those that wait for the disk
        self._waiting: list[_Entry] = []
        self._handed: deque[_Entry] = deque()
        #: entries that found no room, counted here, and that could not be written, counted by the thread; and how many
        #: of all these the file tells of
        self._dropped = self._failed = self._told = 0
        self._behind = Behind("journal")
        with nullcontext() if strict else suppress(OSError):
            self._open()

    @property
    def lost(self) -> int:
        """Entries that are not in the file and will not be."""
        return self._dropped + self._failed

    def write(self, event: str, text: str = "", **values: Any) -> None:
        """Add an entry, and those that wait. Values that are None are left out; nobody changes the others any more."""
        self.note(event, text, **values)
        self.flush()

    def note(self, event: str, text: str = "", **values: Any) -> None:
        """The same, but with the next `write` or `flush`, whichever comes first."""
        self._waiting.append((time.monotonic(), time.time(), event, text, values))
        if len(self._waiting) >= _MOST_WAITING:
            self.flush()

    def flush(self) -> None:
        """Have written what waits; to be called a few times a second."""
        waiting, self._waiting = self._waiting, []
        if not waiting:
            return
        taken = 0 if self._closed else min(len(waiting), max(0, _MOST_BEHIND - len(self._handed)))
        self._dropped += len(waiting) - taken
        self._handed.extend(waiting[:taken])
        self._behind.put("entries", self._write_down)

    def lay_beside(self, name: str, files: Mapping[str, bytes]) -> None:
        """Have a folder with these files made beside the file, `STEM-NAME`; one that is there stays as it is.

        If that cannot be done an entry says so.
        """
        folder = self.path.with_name(f"{self.path.stem}-{name}")
        self._behind.put(f"folder {name}", partial(self._lay, folder, dict(files)))

    def settle(self, within_s: float) -> bool:
        """Wait, so long at most, until all that was given is in the file, or lost; whether it is."""
        self.flush()
        return self._behind.settle(within_s)

    def close(self, within_s: float = CLOSE_S) -> None:
        """Write what waits, for so long at most, and close the file; entries after this are lost and counted."""
        self.flush()
        self._closed = True
        if self._behind.close(within_s):
            self._release()
        # else the file is left to the thread, which may be writing: its number must not become another file's
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
        except Exception:  # what stands in an entry may break in any way
            return False
        return True

    def _lay(self, folder: Path, files: Mapping[str, bytes]) -> None:
        if folder.exists():
            return
        draft = folder.with_name(f".{folder.name}.draft")  # whoever finds the folder finds all of it
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
            flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC
            self._descriptor = os.open(self.path, flags, 0o644)
            size = os.fstat(self._descriptor).st_size
            self._cut = size > 0 and os.pread(self._descriptor, 1, size - 1) != b"\n"
        return self._descriptor

    def _append(self, line: bytes) -> None:
        descriptor = self._open()
        size = os.fstat(descriptor).st_size
        if size > 0 and size + len(line) > self._max_bytes:
            self._release()
            with suppress(OSError):  # too long a journal is better than none
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
