# SPDX-License-Identifier: GPL-3.0-or-later

"""Helpers of both MAVProxy modules: no exception reaches MAVProxy, and a failed load is reported in one line."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from typing import Any

from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.link.devices import LinkError
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.store.keys import KeysError
from mavproxy_handover.store.lock import LockError
from mavproxy_handover.store.portable import lock
from mavproxy_handover.supervision.watchdog_pipe import Refusal

__all__ = ["SharedLog", "guarded", "refusal", "why"]


def guarded(
    where: str, job: Callable[[], object], fault: Callable[[str, str], None], show: Callable[[], None] | None = None
) -> None:
    """Run `job`. If it raises, `fault` gets the place and the exception, and `show` is called.

    MAVProxy would swallow an exception without a report, or drop the socket that it came from.
    """
    try:
        job()
    except Exception:
        fault(where, traceback.format_exc(limit=-3))
        if show is not None:
            show()


#: errors whose text is one line for people
_EXPECTED = (ConfigError, KeysError, LinkError, LockError, MissionError)


def refusal(error: Exception) -> Refusal:
    """Kind of the error for which a module is not loaded."""
    if isinstance(error, LockError):
        return Refusal.LOCKED
    return Refusal.MACHINE if isinstance(error, (*_EXPECTED, OSError)) else Refusal.FAULT


def why(error: Exception) -> str:
    """Why a module is not loaded, in one line for people."""
    if isinstance(error, _EXPECTED):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}"
    return f"internal fault: {type(error).__name__}: {error}"


class SharedLog:
    """Detects that another MAVProxy writes to the same tlog: in one folder they all write `mav.tlog`.

    Each of our MAVProxys locks its tlog while it uses it. `show` takes the line for people.
    """

    def __init__(self, mpstate: Any, show: Callable[[str], None]) -> None:
        self._mpstate, self._show = mpstate, show
        self._known = False

    def check(self, _now: float) -> None:
        """Check the tlog. Call it each second, because MAVProxy opens it after the modules."""
        file = getattr(self._mpstate, "logfile", None)
        if self._known or file is None:
            return
        self._known = True
        try:
            free = sys.platform == "win32" or lock(file.fileno())  # a lock there would keep readers out
        except (OSError, ValueError, AttributeError):  # no file, or a kind of file that cannot be locked
            return
        if not free:
            text = f"{file.name} is written by another MAVProxy as well, and is of no use to either: start each with a "
            self._show(f"handover: {text}--logfile of its own")
