# SPDX-License-Identifier: GPL-3.0-or-later

"""What a busy station costs in MAVProxy: a round of its main loop for every frame, or a look at the sockets.

A round looks at queues, timers and modules, which costs several times what the gate spends on a frame. So while
stations speak, the module waits in MAVProxy's place (`HandoverModule._stay`), for all that MAVProxy would wait for, and
serves its own links as long as nothing else has anything to read. Its own ticks go on meanwhile, the lease among them.
MAVProxy's timers and what the operator types get their turn after `STAY_S` at the latest.
"""

from __future__ import annotations

import select
from collections.abc import Collection
from typing import Any

__all__ = ["STAY_S", "TALKING_S", "readable", "waited_for"]

#: MAVProxy's fastest timers run ten times a second
STAY_S = 0.05
#: frames that follow each other as fast as this are expected to go on
TALKING_S = 0.1


def waited_for(mpstate: Any) -> list[int]:
    """The descriptors that MAVProxy's main loop selects on; empty if there is something that it polls instead."""
    found: list[int] = []
    for master in mpstate.mav_master:
        if getattr(master, "fd", None) is None or master.portdead:
            return []
        found.append(master.fd)
    for output in (*mpstate.mav_outputs, *mpstate.sysid_outputs.values()):
        if output.fd is not None:
            found.append(output.fd)
    return [*found, *(descriptor for descriptor in mpstate.select_extra if descriptor is not None)] if found else []


def readable(descriptors: Collection[int], ours: Collection[int], seconds: float) -> tuple[list[int], bool]:
    """Wait for something to read, not at all if `seconds` is not above 0. Never raises.

    What of `ours` can be read, and whether it is MAVProxy's turn: something else can be read, or nothing can be waited
    for.
    """
    if not descriptors:
        return [], True
    try:
        ready = select.select(descriptors, [], [], seconds if seconds > 0.0 else 0.0)[0]
    except (OSError, ValueError):  # one was closed: MAVProxy finds out which
        return [], True
    found = [descriptor for descriptor in ready if descriptor in ours]
    return found, len(found) != len(ready)
