# SPDX-License-Identifier: GPL-3.0-or-later

"""What monitors find: events for the rules, and news for people."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from mavproxy_handover.core.events import Event
from mavproxy_handover.core.safety.route import RouteNews
from mavproxy_handover.narrator import Narrator

__all__ = ["MonitorOutput", "Teller"]

MonitorOutput = Event | RouteNews


class Teller:
    """Hands on what monitors find: events to `handle`, news to the journal."""

    def __init__(self, handle: Callable[[Event, float], None], narrator: Narrator) -> None:
        self._handle = handle
        self._narrator = narrator

    def tell(self, outputs: Iterable[MonitorOutput], now: float) -> None:
        """In their order."""
        for output in outputs:
            if isinstance(output, RouteNews):
                self._narrator.route(output)
            else:
                self._handle(output, now)
