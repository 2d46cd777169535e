# SPDX-License-Identifier: GPL-3.0-or-later

"""The restart copy: everything that a run of the companion has loaded, kept for a restart in flight.

Rules that live here
--------------------
* It is in memory-backed storage, in the folder that only this user can access (`memory.py`), with mode 0600. It holds
  keys, so it is on no disk, and in no environment variable or argument. Without such storage nothing is kept.
* Its file name follows from the path of the configuration file. A start knows that path before it has read any file.
* It is valid only in the boot and for the user that wrote it, and only if its checksum is correct.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.store.durable import discard, discard_unfinished, opened, replace_whole, sealed
from mavproxy_handover.store.memory import boot_id, memory_folder

__all__ = ["RestartCopy"]

_FORMAT: Final = 1
#: more than a configuration and the largest mission package need
_MOST_BYTES: Final = 4 * 1024 * 1024


class RestartCopy:
    """The restart copy of one configuration file. Only `save` raises."""

    def __init__(self, config: Path) -> None:
        """`config`: path of the configuration file, resolved."""
        folder = memory_folder(os.environ)
        name = hashlib.sha256(f"run\0{config}".encode("utf-8", "surrogateescape")).hexdigest()[:32]
        #: None if there is no storage for it
        self.path = None if folder is None else folder / f"{name}.run"

    def load(self) -> Mapping[str, Any] | None:
        """The last saved copy; None if there is none, or if it is not valid."""
        raw = None if self.path is None else _read(self.path)
        if raw is None:
            return None
        try:
            body = opened(raw)
            fits = body["format"] == _FORMAT and body["boot"] == boot_id()
            return body["run"] if fits and isinstance(body["run"], dict) else None
        except (ValueError, KeyError, TypeError, RecursionError):
            return None

    def save(self, run: Mapping[str, Any]) -> None:
        """Replace the saved copy. Raises OSError: then the old one stays."""
        if self.path is None:
            raise OSError("there is no storage in memory")
        body = {"format": _FORMAT, "boot": boot_id(), "run": run}
        data = sealed(body)
        if len(data) > _MOST_BYTES:
            raise OSError(f"it has {len(data)} bytes, more than {_MOST_BYTES}")
        replace_whole(self.path, data, sync=False)

    def remove(self) -> None:
        """Remove the saved copy."""
        if self.path is not None:
            discard(self.path)
            discard_unfinished(self.path)


def _read(path: Path) -> bytes | None:
    """The file's content if only this user can access the file, else None."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    with os.fdopen(descriptor, "rb") as file:
        try:
            found = os.fstat(descriptor)
            private = stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o077
            return file.read(_MOST_BYTES + 1) if private and found.st_size <= _MOST_BYTES else None
        except OSError:
            return None
