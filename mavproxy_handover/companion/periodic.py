# SPDX-License-Identifier: GPL-3.0-or-later

"""Jobs of each second. A fault in one job costs that job only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mavproxy_handover.companion.autopilot_parts import Autopilot
from mavproxy_handover.companion.beacons import BEAT_ALONE_S, Beacons
from mavproxy_handover.companion.decision_news import DecisionNews
from mavproxy_handover.companion.faults import FaultNews
from mavproxy_handover.companion.onboard_parts import OnboardParts
from mavproxy_handover.companion.state_saver import StateSaver
from mavproxy_handover.operator.stations.missing_heartbeats import MissingHeartbeats
from mavproxy_handover.tools.schedule import attempt

__all__ = ["EachSecond"]


@dataclass(frozen=True, slots=True)
class EachSecond:
    """Of one vehicle. `grounded`: whether the aircraft is neither armed nor about to be, by the rules. Times are
    monotonic seconds."""

    autopilot: Autopilot
    beacons: Beacons
    news: DecisionNews
    saver: StateSaver
    faults: FaultNews
    heartbeats: MissingHeartbeats
    onboard: OnboardParts
    grounded: Callable[[float], bool]

    def run(self, now: float) -> None:
        """Do all jobs."""
        event_log, beacons = self.news.event_log, self.beacons
        self._attempt("heartbeat", beacons.beat_autopilot)
        self._attempt("heartbeat", beacons.beat_stations, now, BEAT_ALONE_S)
        self._attempt("control status", beacons.send_control_status)
        self._attempt("word of a decision", self.news.announcer.tick, now)
        self._attempt("clock", event_log.clock, now)
        self._attempt("journal", event_log.sum_up, now)
        self._attempt("state", self.saver.each_second)
        grounded = self.grounded(now)
        self._attempt("each second", self.autopilot.rounds.each_second, beacons.view, grounded, now)
        self._attempt("onboard programs", self.onboard.estimate.each_second, now)
        self._attempt("onboard programs", self.onboard.returns.each_second, now)
        self._attempt("word of a fault", self.faults.each_second, now)
        self._attempt("word of heartbeats", self.heartbeats.each_second, now)

    def _attempt(self, where: str, job: Callable[..., None], *arguments: Any) -> None:
        attempt(self.news.fault, where, job, *arguments)
