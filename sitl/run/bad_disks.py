# SPDX-License-Identifier: GPL-3.0-or-later

"""Bad disks, for one program of a run: slow, full, read-only.

A slow disk makes a program wait: `slow_disk.c` is compiled and loaded in front of the C library. The program and the
call are the real ones; only the duration is not. Nothing else on the machine notices.

Small file systems fill up or turn read-only, visible only to this process and its children. They live in memory, in a
mount namespace of this process, so they always end with it. Making one needs root (CAP_SYS_ADMIN); without it the error
says so.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from sitl.script.places import SetupError

__all__ = ["SmallDisk", "on_slow_disk", "small_disk"]

_SOURCE = Path(__file__).with_name("slow_disk.c")
_COMPILE_S = 60.0
_NEW_NAMESPACE: Final = 0x0002_0000
_READ_ONLY, _REMOUNT, _RECURSIVE, _PRIVATE = 1, 1 << 5, 1 << 14, 1 << 18
#: longest wait (s) for a moment in which no program writes
_PATIENCE_S = 5.0
_separate = False


def on_slow_disk(folder: Path, fsync_s: float) -> tuple[str, ...]:
    """Words to put before a command line: each fsync of that program takes `fsync_s`. `folder`: for what is compiled.

    Raises SetupError with one line, as where there is no C compiler.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise SetupError("a slow disk needs a C compiler (Debian: gcc), and there is none")
    folder.mkdir(parents=True, exist_ok=True)
    library = (folder / "slow_disk.so").resolve()
    command = [compiler, "-shared", "-fPIC", "-O2", "-o", str(library), str(_SOURCE), "-ldl"]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=_COMPILE_S)
    except subprocess.CalledProcessError as error:
        raise SetupError(f"slow_disk.c was not compiled: {' '.join(error.stderr.split())[:200]}") from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SetupError(f"slow_disk.c was not compiled: {error}") from None
    return ("/usr/bin/env", f"LD_PRELOAD={library}", f"SLOW_DISK_S={fsync_s:g}")


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _mount(source: str, target: str, kind: str, flags: int, data: str = "") -> None:
    """mount(2). Raises OSError."""
    if _libc().mount(source.encode(), target.encode(), kind.encode(), flags, data.encode()) != 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


def _separate_from_others() -> None:
    global _separate  # noqa: PLW0603 (a process has one namespace)
    if _separate:
        return
    if _libc().unshare(_NEW_NAMESPACE) != 0:
        code = ctypes.get_errno()
        raise SetupError(f"a file system of our own needs root (unshare: {os.strerror(code)})")
    try:
        _mount("none", "/", "none", _RECURSIVE | _PRIVATE)
    except OSError as error:
        raise SetupError(f"a file system of our own cannot be kept from others: {error.strerror}") from None
    _separate = True


class SmallDisk:
    """A file system of a few hundred kilobytes at `path`."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fill(self) -> None:
        """From now on it is full to the last byte."""
        with (self.path / "filling").open("wb", buffering=0) as file, suppress(OSError):
            while True:
                file.write(bytes(4096))
        if os.statvfs(self.path).f_bavail:
            raise SetupError(f"{self.path} does not get full")

    def turn_read_only(self) -> None:
        """Refuse writes from now on. Raises SetupError if a program never stops writing."""
        until = time.monotonic() + _PATIENCE_S
        while True:
            try:
                _mount("none", str(self.path), "none", _REMOUNT | _READ_ONLY)
            except OSError as error:
                if error.errno != errno.EBUSY or time.monotonic() > until:
                    raise SetupError(f"{self.path} does not turn read-only: {error.strerror}") from None
                time.sleep(0.01)
            else:
                return


@contextmanager
def small_disk(path: Path, size: str = "512k") -> Iterator[SmallDisk]:
    """Mount one at `path`. Raises SetupError where that is not allowed."""
    _separate_from_others()
    path.mkdir(parents=True, exist_ok=True)
    try:
        _mount("none", str(path), "tmpfs", 0, f"size={size}")
    except OSError as error:
        raise SetupError(f"a small file system cannot be mounted: {error.strerror}") from None
    try:
        yield SmallDisk(path)
    finally:
        _libc().umount2(str(path).encode(), 2)  # lazily: a process that has a file open there ends soon
