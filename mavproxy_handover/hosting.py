# SPDX-License-Identifier: GPL-3.0-or-later

"""What both MAVProxy modules need: nothing of theirs raises into MAVProxy, and what stops them is said in one line."""

from __future__ import annotations

import fcntl
import traceback
from collections.abc import Callable
from typing import Any

from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.link.devices import LinkError
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.store.keys import KeysError
from mavproxy_handover.store.lock import LockError
from mavproxy_handover.watchdog_pipe import Refusal

__all__ = ["SharedLog", "guarded", "refusal", "why"]


def guarded(
    where: str, job: Callable[[], object], fault: Callable[[str, str], None], show: Callable[[], None] | None = None
) -> None:
    """Run `job`; if it breaks, `fault` is told where and what, and `show` is called.

    MAVProxy would swallow an exception, or drop the socket it came from, without a word.
    """
    try:
        job()
    except Exception:
        fault(where, traceback.format_exc(limit=-3))
        if show is not None:
            show()


#: each is one line for people
_EXPECTED = (ConfigError, KeysError, LinkError, LockError, MissionError)


def refusal(error: Exception) -> Refusal:
    """What kind of error keeps a module from being loaded."""
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
    """Whether MAVProxy's tlog is another MAVProxy's too: started in one folder they all write `mav.tlog`.

    Each of ours locks the one that it has, for as long as it has it. `show` takes the line for people.
    """

    def __init__(self, mpstate: Any, show: Callable[[str], None]) -> None:
        self._mpstate, self._show = mpstate, show
        self._known = False

    def look(self, _now: float) -> None:
        """To be called each second: MAVProxy opens it behind the modules."""
        file = getattr(self._mpstate, "logfile", None)
        if self._known or file is None:
            return
        self._known = True
        try:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            text = f"{file.name} is written by another MAVProxy as well, and is of no use to either: start each with a "
            self._show(f"handover: {text}--logfile of its own")
        except (OSError, ValueError, AttributeError):  # no file, or of a kind that cannot be locked
            return
