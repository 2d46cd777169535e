# SPDX-License-Identifier: GPL-3.0-or-later

"""Makes this process as poor as Python on Windows: what only POSIX has is missing for our packages.

`python -m tests.platforms.without_posix FILE WORDS...` runs a file so. Modules are refused to importers of our packages
only, because packages of others have branches of their own for each system. Attributes are removed for all, after those
packages are loaded.
"""

from __future__ import annotations

import importlib
import os
import runpy
import select
import signal
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import FrameType, ModuleType
from typing import Final

__all__ = ["ATTRIBUTES", "MODULES", "take_away"]

#: modules that Windows does not have
MODULES: Final = frozenset(
    ("crypt", "fcntl", "grp", "nis", "posix", "pty", "pwd", "readline", "resource", "spwd", "syslog", "termios", "tty")
)
#: attributes that Windows does not have
ATTRIBUTES: Final[dict[ModuleType, tuple[str, ...]]] = {
    os: (
        *("O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK"),
        *("chown", "fchmod", "fchown", "fork", "forkpty", "getegid", "geteuid", "getgid", "getgrouplist", "getgroups"),
        *("getloadavg", "getpgid", "getuid", "killpg", "major", "minor", "mkfifo", "openpty", "pidfd_open"),
        *("posix_fallocate", "posix_spawn", "sched_getaffinity", "setsid", "setuid", "statvfs", "uname", "wait3"),
    ),
    signal: (
        *("SIGALRM", "SIGCHLD", "SIGHUP", "SIGKILL", "SIGQUIT", "SIGTSTP", "SIGUSR1", "SIGUSR2", "SIGWINCH"),
        *("alarm", "pidfd_send_signal", "pthread_kill", "pthread_sigmask", "setitimer", "sigwait"),
    ),
    select: ("epoll", "poll", "POLLIN", "POLLOUT", "POLLERR", "POLLHUP", "POLLNVAL"),
    socket: ("AF_NETLINK", "AF_PACKET", "AF_UNIX", "SO_BINDTODEVICE", "SO_REUSEPORT", "socketpair_unix"),
}
#: packages whose importers find no such module
_OURS: Final = ("gcs_module", "mavproxy_handover")
#: packages of others that a station loads
_OTHERS: Final = (
    *("asyncio", "ctypes", "multiprocessing", "numpy", "serial", "shapely", "shutil", "subprocess", "tempfile"),
    *("MAVProxy.modules.lib.mp_module", "MAVProxy.modules.lib.mp_menu", "pymavlink.mavutil", "uvicorn", "nicegui"),
)


class _Refuses(MetaPathFinder):
    """Refuses the modules to our packages."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname in MODULES and _is_ours(sys._getframe(1)):
            raise ModuleNotFoundError(f"No module named {fullname!r}", name=fullname)
        return None


def _is_ours(frame: FrameType | None) -> bool:
    while frame is not None and frame.f_globals.get("__name__", "").startswith(("importlib", "_frozen")):
        frame = frame.f_back
    return frame is not None and frame.f_globals.get("__name__", "").startswith(_OURS)


def take_away() -> None:
    """Take all of it away, for the rest of this process."""
    for name in _OTHERS:
        with suppress(ImportError):
            importlib.import_module(name)
    for name in MODULES:
        sys.modules.pop(name, None)
    sys.meta_path.insert(0, _Refuses())
    for module, names in ATTRIBUTES.items():
        for name in names:
            if hasattr(module, name):
                delattr(module, name)


if __name__ == "__main__":
    sys.argv = sys.argv[1:]
    take_away()
    runpy.run_path(sys.argv[0], run_name="__main__")
