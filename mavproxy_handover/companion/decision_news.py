# SPDX-License-Identifier: GPL-3.0-or-later

"""Decisions of the rules, as people hear of them: journal, stations, briefing, rehearsal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.core.common.events import Announce
from mavproxy_handover.operator.briefing import Briefing
from mavproxy_handover.operator.rehearsal.rehearsal import RehearsalManager
from mavproxy_handover.operator.stations.announcer import Announcer
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.tools.schedule import attempt

__all__ = ["DecisionNews"]


@dataclass(frozen=True, slots=True)
class DecisionNews:
    """Of one vehicle."""

    event_log: EventLog
    announcer: Announcer
    briefing: Briefing
    rehearsal: RehearsalManager
    fault: Callable[[str, str], None]

    def tell(self, told: Announce, now: float) -> None:
        """A decision, or that nothing is wrong any more."""
        attempt(self.fault, "journal", self.event_log.decision, told)
        self.announcer.tell(told, now)
        self.briefing.decided(told.text, now, over=told.action is None)
        self.rehearsal.told(told, now)
