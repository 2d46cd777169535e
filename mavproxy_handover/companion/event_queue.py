# SPDX-License-Identifier: GPL-3.0-or-later

"""The queue of events: one is handled at a time, and handling never nests.

The order:

1. Each event is handled wholly before the next one: the rules take it, then all actions that they ask for are done.
2. An event that is appended while another one is handled comes after it, in the order of appending.
3. `put` returns when the queue is empty, unless an event is being handled: then it returns at once. So a caller from
   outside sees all that follows from its event.
4. Each event keeps its own time. A time before that of the event handled last counts as that time: time never goes
   back.
5. When the queue is empty, `emptied` is called: what must wait for all events is done then. It may append events.

An exception of `handle` leaves `put`. The events that wait then are handled by the next `put`, before its own event.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from mavproxy_handover.core.common.events import Event

__all__ = ["EventQueue"]

#: a time: seconds, or whole ticks
Time = TypeVar("Time", bound=float)


class EventQueue(Generic[Time]):
    """Gives events to `handle`, one at a time. Times are monotonic; not safe for threads."""

    def __init__(self, handle: Callable[[Event, Time], None], emptied: Callable[[Time], None]) -> None:
        self._handle = handle
        self._emptied = emptied
        self._waiting: deque[tuple[Event, Time]] = deque()
        self._handling = False
        #: the time of the event handled last
        self._now: Time | None = None

    def put(self, event: Event, now: Time) -> None:
        """Append an event. Unless one is being handled, handle all that wait."""
        waiting = self._waiting
        waiting.append((event, now))
        if self._handling:
            return
        self._handling = True
        try:
            while waiting:
                event, now = waiting.popleft()
                if self._now is not None and now < self._now:
                    now = self._now
                self._now = now
                try:
                    self._handle(event, now)
                finally:
                    if not waiting:
                        self._emptied(now)
        finally:
            self._handling = False

    def clear(self) -> None:
        """Drop the events that wait."""
        self._waiting.clear()
