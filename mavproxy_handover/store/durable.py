# SPDX-License-Identifier: GPL-3.0-or-later

"""Small private files that are written completely or not at all, and records with a checksum.

A temporary file is written beside the target, then linked or renamed. So a reader sees the whole new content or none of
it, even if the power fails at any time. If the write fails, the temporary file is removed, because it may hold keys.

A sealed record is JSON with a checksum over all of it. A damaged record is not repaired.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from contextlib import suppress
from pathlib import Path
from typing import Any

from mavproxy_handover.store.portable import CLOSED_ON_EXEC, restrict

__all__ = [
    "checksum",
    "discard",
    "discard_unfinished",
    "opened",
    "replace_whole",
    "sealed",
    "sync_folder",
    "write_beside",
]

_MODE = 0o600
_TOKEN_BYTES = 4


def write_beside(path: Path, data: bytes, *, sync: bool = True) -> Path:
    """Write `data` to a new file in the folder of `path` and return its path. Raises OSError.

    The file has mode 0600 from the start. `sync` False: do not wait for the disk, because the storage is in memory.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(_TOKEN_BYTES)}")
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | CLOSED_ON_EXEC, _MODE)
    try:
        with os.fdopen(descriptor, "wb") as file:
            restrict(file.fileno(), _MODE)  # the umask may have removed more bits
            file.write(data)
            file.flush()
            if sync:
                os.fsync(file.fileno())
    except BaseException:
        discard(temporary)
        raise
    return temporary


def replace_whole(path: Path, data: bytes, *, sync: bool = True) -> None:
    """Replace the content of the file by `data`, mode 0600. Raises OSError: then the old content stays.

    `sync` False: do not wait for the disk, because the storage is in memory.
    """
    temporary = write_beside(path, data, sync=sync)
    try:
        os.replace(temporary, path)
    except BaseException:
        discard(temporary)
        raise


def discard_unfinished(path: Path) -> None:
    """Remove temporary files of `path` that a killed process left."""
    with suppress(OSError):
        for left in list(path.parent.iterdir()):
            if _is_temporary(left.name, path.name):
                discard(left)


def _is_temporary(name: str, of: str) -> bool:
    prefix = f".{of}."
    return name.startswith(prefix) and len(name) == len(prefix) + 2 * _TOKEN_BYTES


def discard(path: Path) -> None:
    """Remove a file if it is there."""
    with suppress(OSError):
        os.unlink(path)


def sync_folder(path: Path) -> None:
    """Sync the folder of `path`, because a name is on the disk only when its folder is. Errors are ignored."""
    with suppress(OSError):
        descriptor = os.open(path.parent, os.O_RDONLY | CLOSED_ON_EXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def checksum(value: object) -> str:
    """The checksum of what JSON can hold, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode("ascii")).hexdigest()


def sealed(body: object, *, indent: int | None = None) -> bytes:
    """Encode a record with its checksum."""
    return json.dumps({"body": body, "sha256": checksum(body)}, indent=indent).encode("ascii")


def opened(raw: bytes) -> Any:
    """Decode what `sealed` made. Raises ValueError, KeyError, TypeError, OverflowError, RecursionError."""
    whole = json.loads(raw)
    body = whole["body"]
    if whole["sha256"] != checksum(body):
        raise ValueError("its checksum does not fit")
    return body
