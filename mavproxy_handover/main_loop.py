# SPDX-License-Identifier: GPL-3.0-or-later

"""What a busy station costs in MAVProxy: a round of its main loop for every frame, or a look at the sockets.

A round looks at queues, timers and modules, which costs several times what the gate spends on a frame. So after a frame
the module stays with its own links (`HandoverModule._stay`) as long as nothing else has anything to read, and no longer
than until its own tick is due: neither MAVProxy's timers nor the lease wait for a station to fall silent.
"""

from __future__ import annotations

import select
from collections.abc import Collection
from typing import Any

__all__ = ["readable", "waited_for"]


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
    return [*found, *mpstate.select_extra] if found else []


def readable(descriptors: Collection[int], ours: Collection[int], seconds: float) -> list[int]:
    """Wait for something to read; what can be read if all of it is `ours`, else nothing. Never raises."""
    if not descriptors or seconds <= 0.0:
        return []
    try:
        ready = select.select(descriptors, [], [], seconds)[0]
    except (OSError, ValueError):  # one was closed: MAVProxy finds out which
        return []
    return ready if all(descriptor in ours for descriptor in ready) else []
