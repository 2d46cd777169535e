# SPDX-License-Identifier: GPL-3.0-or-later

"""The run record: what a run of the companion has loaded, kept for a restart in flight.

Rules that live here
--------------------
* It lies in memory-backed storage, in the folder that is this user's alone (`memory.py`), mode 0600. It holds keys: it
  is on no disk, and in no environment variable or argument. Where there is no such storage nothing is kept.
* It is found by the path of the configuration file: that is what a start knows before it has read anything.
* It counts in the boot that wrote it, for the user that wrote it, and only whole: it has a checksum.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.store.durable import discard, discard_unfinished, replace_whole
from mavproxy_handover.store.memory import boot_id, memory_folder

__all__ = ["RunRecord"]

_FORMAT: Final = 1
#: more than a configuration and the largest mission package come to
_MOST_BYTES: Final = 4 * 1024 * 1024


class RunRecord:
    """The record of one configuration file. Nothing here raises but `save`."""

    def __init__(self, config: Path) -> None:
        """`config`: path of the configuration file, resolved."""
        place = memory_folder(os.environ)
        name = hashlib.sha256(f"run\0{config}".encode("utf-8", "surrogateescape")).hexdigest()[:32]
        #: None: there is no storage for it
        self.path = None if place is None else place / f"{name}.run"

    def load(self) -> Mapping[str, Any] | None:
        """What was saved last; None if nothing was, or if it does not count."""
        raw = None if self.path is None else _read(self.path)
        if raw is None:
            return None
        try:
            whole = json.loads(raw)
            body = whole["body"]
            fits = whole["sha256"] == _checksum(body) and body["format"] == _FORMAT
            return body["run"] if fits and body["boot"] == boot_id() and isinstance(body["run"], dict) else None
        except (ValueError, KeyError, TypeError, RecursionError):
            return None

    def save(self, run: Mapping[str, Any]) -> None:
        """Keep this in place of what was saved before. Raises OSError: then what was before stays."""
        if self.path is None:
            raise OSError("there is no storage in memory")
        body = {"format": _FORMAT, "boot": boot_id(), "run": run}
        data = json.dumps({"body": body, "sha256": _checksum(body)}).encode("ascii")
        if len(data) > _MOST_BYTES:
            raise OSError(f"it has {len(data)} bytes, more than {_MOST_BYTES}")
        replace_whole(self.path, data, sync=False)

    def remove(self) -> None:
        """Keep nothing any more."""
        if self.path is not None:
            discard(self.path)
            discard_unfinished(self.path)


def _read(path: Path) -> bytes | None:
    """The file's content if it is a file of this user's alone."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    with os.fdopen(descriptor, "rb") as file:
        try:
            found = os.fstat(descriptor)
            alone = stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o077
            return file.read(_MOST_BYTES + 1) if alone and found.st_size <= _MOST_BYTES else None
        except OSError:
            return None


def _checksum(body: object) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode("ascii")).hexdigest()
