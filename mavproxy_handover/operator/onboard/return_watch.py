# SPDX-License-Identifier: GPL-3.0-or-later

"""Tells the stations of a return that comes no nearer, while onboard programs may report obstacles.

With OA_TYPE set, ArduCopter flies around obstacles in a return too, and around ones that are not there it flies on and
on. Obstacles are not stopped here: they may be real. A return that the companion ordered is verified by its motion,
and ends as a landing (`core/safety/command_verification.py`). A commander's return is not, so the stations are told.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from mavproxy_handover.core.common.model import ModeClass
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["NEARER_M", "PATIENCE_S", "ReturnWatch"]

#: so much nearer (m) in so much time (s) is progress; a climb to the height of the return takes no longer
NEARER_M: Final = 5.0
PATIENCE_S: Final = 45.0
_REMIND_S: Final = 60.0
#: so near to its site (m) and so slow it waits before it lands; around false obstacles it flew there at 2 m/s
_AT_SITE_M: Final = 5.0
_WAITS_MPS: Final = 1.0


class ReturnWatch:
    """Of one aircraft. `site` returns latitude and longitude (degrees) of the return site; None: not known. Times are
    monotonic seconds."""

    def __init__(
        self, used: bool, aircraft: VehicleState, site: Callable[[], tuple[float, float] | None], reports: Reports
    ) -> None:
        """`used`: whether an onboard program may report obstacles."""
        self._used = used
        self._aircraft = aircraft
        self._site = site
        self._reports = reports
        #: the least distance (m) in this return, and when it was reached
        self._least_m = math.inf
        self._nearer_at = -math.inf
        self._told_at = -math.inf

    def each_second(self, now: float) -> None:
        """Time has passed."""
        aircraft, here, site = self._aircraft, self._aircraft.where, self._site()
        returns = aircraft.flying and aircraft.flown is ModeClass.RETURN and not aircraft.lands
        if not self._used or not returns or here is None or site is None:
            self._least_m, self._told_at = math.inf, -math.inf
            return
        away_m = distance_m(*here[:2], *site)
        waits = away_m < _AT_SITE_M and aircraft.own_speed_mps < _WAITS_MPS
        if away_m < self._least_m - NEARER_M or waits:
            self._least_m, self._nearer_at = away_m, now
        if now - self._nearer_at < PATIENCE_S or now - self._told_at < _REMIND_S:
            return
        self._told_at = now
        text = f"Return comes no nearer, {away_m:.0f} m from its site. Order LAND, or end the obstacle program."
        self._reports.event_log.onboard("obstacles", text)
        self._reports.message_sender.say_to_all(text)
