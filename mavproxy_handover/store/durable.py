# SPDX-License-Identifier: GPL-3.0-or-later

"""Small private files that are on the disk whole, or not there at all.

The caller writes a temporary file beside the target and then links or renames it: who reads the target sees all of it
or nothing of it, whenever the power fails.
"""

from __future__ import annotations

import os
import secrets
from contextlib import suppress
from pathlib import Path

__all__ = ["discard", "sync_folder", "write_beside"]

_MODE = 0o600


def write_beside(path: Path, data: bytes, *, sync: bool = True) -> Path:
    """A new file in the folder of `path`: holds `data`, mode 0600 from the start, on the disk. Raises OSError.

    `sync` False: of storage in memory, where there is no disk to wait for.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, _MODE)
    try:
        with os.fdopen(descriptor, "wb") as file:
            os.fchmod(file.fileno(), _MODE)  # the umask may have taken away more
            file.write(data)
            file.flush()
            if sync:
                os.fsync(file.fileno())
    except OSError:
        discard(temporary)
        raise
    return temporary


def discard(path: Path) -> None:
    """Remove a file if it is there."""
    with suppress(OSError):
        os.unlink(path)


def sync_folder(path: Path) -> None:
    """Put the name of `path` on the disk: names are there only when their folder is. As far as the disk can do it."""
    with suppress(OSError):
        descriptor = os.open(path.parent, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
