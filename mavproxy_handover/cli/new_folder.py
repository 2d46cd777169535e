# SPDX-License-Identifier: GPL-3.0-or-later

"""Writes a folder completely or not at all, and keeps the folder that was there before.

The files are written to a temporary folder beside the target, which is then renamed. If a write fails, the temporary
folder is removed and the target is as it was.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from mavproxy_handover.store.durable import sync_folder

__all__ = ["is_free", "write_folder"]


def is_free(target: Path) -> bool:
    """True if nothing is there, or an empty folder."""
    return not os.path.lexists(target) or (target.is_dir() and not any(target.iterdir()))


def write_folder(
    target: Path, files: Mapping[str, str], carried: Sequence[str], judge: Callable[[Path], None]
) -> Path | None:
    """Write `files` (path below the target -> text). Returns where the folder that was there is kept; None: none was.

    `carried`: files and folders that are copied from the folder that was there. `judge` looks at the temporary folder,
    and raises if it is not as it must be. Raises OSError, and what `judge` raises.
    """
    target = target.absolute()
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    try:
        _write(temporary, files)
        for name in carried:
            _carry(target / name, temporary / name)
        judge(temporary)
        return _swap(temporary, target)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def _write(folder: Path, files: Mapping[str, str]) -> None:
    umask = os.umask(0)
    os.umask(umask)
    folder.chmod(0o777 & ~umask)  # the temporary folder was made for one user
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())


def _carry(there: Path, here: Path) -> None:
    if there.is_dir():
        shutil.copytree(there, here, symlinks=True)
    elif there.is_file():
        shutil.copy2(there, here)


def _swap(temporary: Path, target: Path) -> Path | None:
    """Rename the temporary folder to the target. Raises OSError: then the target is as it was."""
    kept = None
    if is_free(target):
        if target.is_dir() and not target.is_symlink():
            target.rmdir()
    else:
        numbers = (f".old-{number}" for number in range(1, 10_000))
        kept = next(path for each in numbers if not os.path.lexists(path := target.with_name(target.name + each)))
        target.rename(kept)
    try:
        temporary.rename(target)
    except OSError:
        if kept is not None:
            kept.rename(target)
        raise
    sync_folder(target)
    return kept
