# SPDX-License-Identifier: GPL-3.0-or-later

"""What a busy station costs in MAVProxy: a round of its main loop for every frame, or a look at the sockets.

A round looks at queues, timers and modules, which costs several times what the gate spends on a frame. So while
stations speak, the module waits in MAVProxy's place (`HandoverModule._stay`), for all that MAVProxy would wait for, and
serves its own links as long as nothing else has anything to read. Its own ticks go on meanwhile, the lease among them.
MAVProxy's timers and what the operator types get their turn after `STAY_S` at the latest.

The module waits like this, too, while frames of a download wait for their link. It offers them every `DOWNLOAD_S`.

How that loop is ended is here too: up to 1.8.74 by a variable, from 1.8.75 on by an event.
"""

from __future__ import annotations

import select
from collections.abc import Collection, Iterable
from typing import Any

__all__ = ["DOWNLOAD_S", "STAY_S", "TALKING_S", "end", "ends", "poller", "readable", "waited_for"]

#: MAVProxy's fastest timers run ten times a second
STAY_S = 0.05
#: how often a link is offered what waits of a download: 20 kB of 10 MB/s
DOWNLOAD_S = 0.002
#: frames that follow each other as fast as this are expected to go on
TALKING_S = 0.1


def ends(mpstate: Any) -> bool:
    """Whether MAVProxy is about to end."""
    event = getattr(mpstate.status, "stop_event", None)
    return bool(mpstate.status.exit if event is None else event.is_set())


def end(mpstate: Any) -> None:
    """Have MAVProxy end, as the word `exit` does."""
    event = getattr(mpstate.status, "stop_event", None)
    if event is None:
        mpstate.status.exit = True
    else:
        event.set()


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


def poller(descriptors: Iterable[int]) -> select.poll | None:
    """Waits for these; None if there are none, or one is closed. A poll object costs less to wait with than select."""
    found = select.poll()
    last = None
    try:
        for last in descriptors:
            found.register(last, select.POLLIN)
    except (OverflowError, ValueError):
        return None
    return None if last is None else found


def readable(waiting: select.poll | None, ours: Collection[int], seconds: float) -> tuple[list[int], bool]:
    """Wait for something to read, not at all if `seconds` is not above 0, and a millisecond too long at most.

    `waiting`: see `poller`. Never raises.

    What of `ours` can be read, and whether it is MAVProxy's turn: something else can be read, or nothing can be waited
    for.
    """
    if waiting is None:
        return [], True
    try:
        ready = waiting.poll(seconds * 1000.0 if seconds > 0.0 else 0)
    except OSError:
        return [], True
    # one that was closed: MAVProxy finds out
    found = [descriptor for descriptor, what in ready if descriptor in ours and not what & select.POLLNVAL]
    return found, len(found) != len(ready)
