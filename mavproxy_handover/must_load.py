# SPDX-License-Identifier: GPL-3.0-or-later

"""A MAVProxy that was started for our module loads it, or ends: it would run on unsigned, ungated and quiet about it.

Imports nothing: the supervisor has to be single-threaded, and what our other parts import starts threads.
"""

from __future__ import annotations

import os
import sys
from typing import Final

__all__ = ["MUST_LOAD", "loaded", "must_load", "not_loaded"]

#: set by `handover station` and `handover companion` in the environment of the MAVProxy that they become. It holds the
#: command's name, and is taken out by the first load
MUST_LOAD: Final = "HANDOVER_MUST_LOAD"
#: what a command line that cannot be carried out ends with
_USAGE: Final = 2


def must_load(command: str) -> None:
    """MAVProxy is about to be run, by this process or the one that it becomes: it must load our module, or end."""
    os.environ[MUST_LOAD] = command


def loaded() -> None:
    """The module is loaded: a later load that fails is the operator's, who sees it."""
    os.environ.pop(MUST_LOAD, None)


def not_loaded(text: str) -> None:
    """The module cannot be loaded. Ends the process with code 2 and one line where it must be; else returns.

    MAVProxy would run on without it: unsigned, ungated, and quiet about it. Nothing is open yet that would have to be
    closed, and MAVProxy's threads would keep a plain exit from coming through.
    """
    command = os.environ.pop(MUST_LOAD, None)
    if command is not None:
        sys.stdout.flush()
        print(f"{command}: {text}", file=sys.stderr, flush=True)
        os._exit(_USAGE)
