# SPDX-License-Identifier: GPL-3.0-or-later

"""The authority rules, as the parts that talk to the autopilot use them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common.events import Event

__all__ = ["Authority"]


@dataclass(frozen=True, slots=True)
class Authority:
    """The authority rules of one vehicle. Times are monotonic seconds."""

    #: only to be read; events go through `handle`
    arbiter: Arbiter
    #: puts an event into the queue
    handle: Callable[[Event, float], None]
    #: whether a station commands, by the view that is in force
    commands: Callable[[int], bool]
