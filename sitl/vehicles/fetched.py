# SPDX-License-Identifier: GPL-3.0-or-later

"""ArduPilot's published build of ArduCopter's SITL program, brought by `handover sim --fetch-arducopter`.

One release, identified by its SHA-256: a download that differs is deleted, from any server and by any route. The
program goes into the user's cache, whole or not at all, and `--vehicle arducopter` finds it there.
"""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from http.client import HTTPException
from pathlib import Path
from typing import Final

from sitl.vehicles.spec import LaunchError

__all__ = ["PUBLISHED", "Published", "cached", "fetch", "here"]

_CHUNK: Final = 64 * 1024
#: between two lines of progress (s)
_TELLS_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class Published:
    """A program that is published at `url`: its size in bytes, and its SHA-256 in hexadecimal digits."""

    version: str
    url: str
    size: int
    sha256: str


#: a stable release that the guard was flown on; its commit is 3fc7011a
PUBLISHED: Final = Published(
    "4.6.3",
    "https://firmware.ardupilot.org/Copter/stable-4.6.3/SITL_x86_64_linux_gnu/arducopter",
    7_023_152,
    "7862662092edc2861fc03da3d6fb2f0136d1670e563ca324eb52c1a324d1e14b",
)


def cached(published: Published = PUBLISHED) -> Path:
    """Where the program is kept, whether it is there or not: under $XDG_CACHE_HOME, or ~/.cache."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "mavproxy-handover" / f"arducopter-{published.version}"


def here(published: Published = PUBLISHED) -> Path | None:
    """The program, if it was brought. Its file has been checked, and only this module writes it."""
    path = cached(published)
    return path if path.is_file() and os.access(path, os.X_OK) else None


def fetch(tell: Callable[[str], None], published: Published = PUBLISHED, timeout_s: float = 20.0) -> Path:
    """Bring the program, unless it is there; returns its path. `tell` gets lines of progress.

    Raises LaunchError: it cannot be had, is not what was published, or does not run here.
    """
    target = cached(published)
    if (sys.platform, platform.machine()) != ("linux", "x86_64"):
        raise LaunchError(
            f"ArduPilot's program is published for Linux on x86_64, this is {sys.platform} on {platform.machine()}: "
            "build it, or take --vehicle builtin"
        )
    try:
        if target.is_file() and hashlib.sha256(target.read_bytes()).hexdigest() == published.sha256:
            target.chmod(0o755)
            tell(f"ArduCopter {published.version} is there already: {target}")
            return target
        target.parent.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    except OSError as error:
        raise LaunchError(f"{target}: {error.strerror}") from None
    draft = Path(name)
    try:
        with os.fdopen(descriptor, "wb") as file:
            _download(published, timeout_s, file.write, tell)
        draft.chmod(0o755)
        _try(draft)
        draft.replace(target)
    except OSError as error:
        raise LaunchError(f"{target}: {error.strerror or error}") from None
    finally:
        with suppress(FileNotFoundError):
            draft.unlink()
    tell(f"ArduCopter {published.version} is in {target}: --vehicle arducopter flies it")
    return target


def _download(
    published: Published, timeout_s: float, write: Callable[[bytes], object], tell: Callable[[str], None]
) -> None:
    """Raises LaunchError, and OSError of `write`."""
    digest, got, told = hashlib.sha256(), 0, time.monotonic()
    tell(f"bringing ArduCopter {published.version}, {published.size / 1e6:.1f} MB, from {published.url}")
    try:
        answer = urllib.request.urlopen(published.url, timeout=timeout_s)
    except (OSError, HTTPException, ValueError) as error:
        if isinstance(error, urllib.error.HTTPError):
            error.close()
        raise LaunchError(f"{published.url}: {_why(error)}; --vehicle builtin needs no download") from None
    with answer:
        while True:
            try:
                data = answer.read(_CHUNK)
            except (OSError, HTTPException) as error:
                raise LaunchError(f"{published.url}: broke off after {got} bytes: {_why(error)}") from None
            if not data:
                break
            got += len(data)
            if got > published.size:
                raise LaunchError(f"{published.url}: more than the {published.size} bytes of {published.version}")
            digest.update(data)
            write(data)
            if time.monotonic() - told >= _TELLS_S:
                told = time.monotonic()
                tell(f"{100 * got // published.size} %")
    if got < published.size:
        raise LaunchError(f"{published.url}: cut short: {got} of {published.size} bytes")
    if digest.hexdigest() != published.sha256:
        raise LaunchError(
            f"{published.url}: not what was published as {published.version}: its SHA-256 is {digest.hexdigest()}"
        )


def _try(program: Path) -> None:
    """Raises LaunchError if it does not run on this system."""
    try:
        tried = subprocess.run([program, "--help"], capture_output=True, text=True, timeout=20.0, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise LaunchError(f"ArduCopter does not run here: {error}") from None
    if tried.returncode in (126, 127):  # of the loader: a library is missing, or too old
        last = (tried.stderr.strip().splitlines() or ["no word of it"])[-1]
        raise LaunchError(f"ArduCopter does not run here: {last}")


def _why(error: Exception) -> str:
    if isinstance(error, urllib.error.HTTPError):
        return f"the server answers {error.code} {error.reason}"
    reason = getattr(error, "reason", None) or error
    return str(getattr(reason, "strerror", None) or reason) or type(error).__name__
