# SPDX-License-Identifier: GPL-3.0-or-later

"""What both MAVProxy modules need: nothing of theirs raises into MAVProxy, and what stops them is said in one line."""

from __future__ import annotations

import traceback
from collections.abc import Callable

from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.link.devices import LinkError
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.store.keys import KeysError
from mavproxy_handover.store.lock import LockError

__all__ = ["guarded", "why"]


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


def why(error: Exception) -> str:
    """Why a module is not loaded, in one line for people."""
    if isinstance(error, (ConfigError, KeysError, LinkError, LockError, MissionError)):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}"
    return f"internal fault: {type(error).__name__}: {error}"
