# SPDX-License-Identifier: GPL-3.0-or-later

"""Waits in place of MAVProxy's main loop, because a round of that loop for every frame is expensive.

A round checks queues, timers and modules, which costs several times what the gate needs for a frame. So while stations
send, the module waits in MAVProxy's place (`HandoverModule._stay`). It waits for all that MAVProxy would wait for, and
serves its own links until another descriptor is readable. Its own ticks go on meanwhile, the lease among them.
MAVProxy's timers and typed commands run after `STAY_S` at the latest.

The module also waits like this while frames of a download wait for their link. It offers them every `DOWNLOAD_S`.

This module also ends MAVProxy's loop: up to 1.8.74 by a variable, from 1.8.75 on by an event.
"""

from __future__ import annotations

import select
from collections.abc import Collection, Iterable
from typing import Any

__all__ = ["DOWNLOAD_S", "STAY_S", "TALKING_S", "end", "is_ending", "poller", "readable", "waited_for"]

#: MAVProxy's fastest timers run ten times a second
STAY_S = 0.05
#: interval (s) of offering download frames to a link: 20 kB at 10 MB/s
DOWNLOAD_S = 0.002
#: if the last two arrivals were less than this (s) apart, the station is sending: the module waits for more frames
#: (`companion/module.py`)
TALKING_S = 0.1


def is_ending(mpstate: Any) -> bool:
    """True if MAVProxy is about to end."""
    event = getattr(mpstate.status, "stop_event", None)
    return bool(mpstate.status.exit if event is None else event.is_set())


def end(mpstate: Any) -> None:
    """End MAVProxy, as the word `exit` does."""
    event = getattr(mpstate.status, "stop_event", None)
    if event is None:
        mpstate.status.exit = True
    else:
        event.set()


def waited_for(mpstate: Any) -> list[int]:
    """Descriptors that MAVProxy's main loop selects on; empty if it polls some source instead."""
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
    """A poll object for these; None if there are none, or one is closed. It is cheaper than select."""
    found = select.poll()
    last = None
    try:
        for last in descriptors:
            found.register(last, select.POLLIN)
    except (OverflowError, ValueError):
        return None
    return None if last is None else found


def readable(waiting: select.poll | None, ours: Collection[int], seconds: float) -> tuple[list[int], bool]:
    """Wait for readable descriptors, at most `seconds` and a millisecond; not at all if that is 0 or less.

    `waiting`: see `poller`. Never raises.

    Returns the readable ones of `ours`, and True if it is MAVProxy's turn: another one is readable, or there is nothing
    to wait for.
    """
    if waiting is None:
        return [], True
    try:
        ready = waiting.poll(seconds * 1000.0 if seconds > 0.0 else 0)
    except OSError:
        return [], True
    # a closed descriptor is left to MAVProxy
    found = [descriptor for descriptor, what in ready if descriptor in ours and not what & select.POLLNVAL]
    return found, len(found) != len(ready)
