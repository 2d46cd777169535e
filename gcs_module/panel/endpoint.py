# SPDX-License-Identifier: GPL-3.0-or-later

"""Where a station's panel socket is, so that `handover panel` finds it by the station's name.

Rules that live here
--------------------
* The socket is in a folder that only this user can enter. A panel looks in no other folder: another user's program
  there could show it any aircraft. Where the system has Unix sockets, it is one. Elsewhere it is
  a TCP port of this computer, and a file in that folder holds the port and a token.
* If another running station of this user has the same name, the number of the process is added to the name.
* What a station that was killed has left is removed by the next one.
* $HANDOVER_PANELS names another folder.
"""

from __future__ import annotations

import contextlib
import getpass
import json
import os
import secrets
import socket
import stat
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import quote, unquote

__all__ = ["FOLDER_VARIABLE", "Endpoint", "EndpointError", "connect", "find", "foreign", "open_endpoint", "running"]

#: names the folder of the sockets, in place of the usual ones
FOLDER_VARIABLE: Final = "HANDOVER_PANELS"
_UNIX_END, _TCP_END = ".socket", ".tcp"
#: longest path of a Unix socket on every system, in bytes
_LONGEST: Final = 100
#: time (s) to find out whether a port of this computer answers
_TRIED_S: Final = 0.3
_MOST_WAITING: Final = 4


class EndpointError(Exception):
    """No socket can be opened or found. The message is one line."""


@dataclass(slots=True)
class Endpoint:
    """A listening socket. `token`: a reader's first line must hold it, "" for a Unix socket; `path`: its file."""

    listener: socket.socket
    token: str
    path: Path
    name: str

    def close(self) -> None:
        """Close it and remove its file."""
        self.listener.close()
        with contextlib.suppress(OSError):
            self.path.unlink()


def _folders() -> list[Path]:
    """Where sockets may be, the usual place first."""
    named = os.environ.get(FOLDER_VARIABLE, "")
    if named:
        return [Path(named)]
    owner = str(os.getuid()) if hasattr(os, "getuid") else getpass.getuser()
    found = [Path(tempfile.gettempdir()) / f"handover-{quote(owner, safe='')}"]
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and Path(runtime).is_dir():
        found.insert(0, Path(runtime) / "handover")
    return found


def _private(folder: Path) -> None:
    """Make the folder if it is missing. Raises EndpointError if others can enter it, OSError."""
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    _check_private(folder)


def _check_private(folder: Path) -> None:
    """Raises EndpointError if others can enter the folder, OSError."""
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode):
        raise EndpointError(f"{folder}: is no folder. Remove it.")
    if hasattr(os, "getuid") and (found.st_uid != os.getuid() or found.st_mode & 0o077):
        raise EndpointError(f"{folder}: other users can enter it. Remove it, or make it yours: chmod 700 {folder}")


def _unix() -> bool:
    return hasattr(socket, "AF_UNIX")


def open_endpoint(name: str) -> Endpoint:
    """Listen for panels of the station with this name. Raises EndpointError."""
    problem = ""
    for folder in _folders():
        try:
            _private(folder)
            _remove_left(folder)
            for called in (name, f"{name}-{os.getpid()}"):
                if not any(map(os.path.lexists, _files(folder, called))):
                    return _listen(folder, called)
            raise EndpointError(f"{folder}: another station has the name {name}")
        except (OSError, EndpointError) as error:
            problem = problem or str(error)
    raise EndpointError(problem)


def _files(folder: Path, name: str) -> tuple[Path, Path]:
    plain = quote(name, safe="")
    return folder / f"{plain}{_UNIX_END}", folder / f"{plain}{_TCP_END}"


def _remove_left(folder: Path) -> None:
    """Remove the files of stations that have ended."""
    for path in folder.iterdir():
        if path.suffix in (_UNIX_END, _TCP_END) and not _answers(path):
            path.unlink(missing_ok=True)


def _answers(path: Path) -> bool:
    try:
        connect(path)[0].close()
    except BlockingIOError:  # it listens, and is busy
        return True
    except (OSError, EndpointError):
        return False
    return True


def _listen(folder: Path, name: str) -> Endpoint:
    unix, tcp = _files(folder, name)
    hidden = folder / f".{os.getpid()}"
    is_unix = _unix() and len(os.fsencode(unix)) <= _LONGEST
    path, token = (unix, "") if is_unix else (tcp, secrets.token_urlsafe(24))
    listener = socket.socket(socket.AF_UNIX if is_unix else socket.AF_INET, socket.SOCK_STREAM)
    hidden.unlink(missing_ok=True)
    try:
        listener.setblocking(False)
        listener.bind(str(hidden) if is_unix else ("127.0.0.1", 0))
        listener.listen(_MOST_WAITING)
        if not is_unix:
            _write(hidden, json.dumps({"port": listener.getsockname()[1], "token": token}))
        os.rename(hidden, path)  # only now it can be found: a socket that is not listened to looks left behind
    except OSError:
        listener.close()
        raise
    return Endpoint(listener, token, path, name)


def _write(path: Path, text: str) -> None:
    """Write a new file that only this user can read."""
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as stream:
        stream.write(text)


def _searched() -> Iterator[Path]:
    """The folders in which sockets of this user's stations may be. Those that others can enter are left out."""
    for folder in _folders():
        with contextlib.suppress(OSError, EndpointError):
            _check_private(folder)
            yield folder


def foreign() -> list[str]:
    """A line about each folder that is not searched, because others can enter it."""
    found = []
    for folder in _folders():
        try:
            _check_private(folder)
        except EndpointError as error:
            found.append(str(error))
        except OSError:  # it is missing
            continue
    return found


def running() -> list[str]:
    """The names of the stations that run and have a socket, of this user."""
    names = set()
    for folder in _searched():
        for path in folder.iterdir():
            if path.suffix in (_UNIX_END, _TCP_END) and _answers(path):
                names.add(unquote(path.stem))
    return sorted(names)


def find(name: str) -> Path | None:
    """The file of the socket of a station, by its name or by the path itself; None: there is none."""
    given = Path(name)
    if given.suffix in (_UNIX_END, _TCP_END) and given.exists():
        return given
    for folder in _searched():
        for path in _files(folder, name):
            if path.exists():
                return path
    return None


def connect(path: Path) -> tuple[socket.socket, str]:
    """A non-blocking socket to a station, and the token for its first line. Raises OSError, EndpointError."""
    if path.suffix == _TCP_END:
        try:
            given = json.loads(path.read_text(encoding="utf-8"))
            port, token = int(given["port"]), str(given["token"])
        except (ValueError, KeyError, TypeError):
            raise EndpointError(f"{path}: holds no port and token") from None
        opened = socket.create_connection(("127.0.0.1", port), timeout=_TRIED_S)
        opened.setblocking(False)
        return opened, token
    if not _unix():
        raise EndpointError(f"{path}: this system has no Unix sockets")
    opened = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        opened.setblocking(False)
        opened.connect(str(path))
    except OSError:
        opened.close()
        raise
    return opened, ""
