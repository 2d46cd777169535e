# SPDX-License-Identifier: GPL-3.0-or-later

"""Which station could take the aircraft, and which one should.

It could if its zone holds the aircraft, it is there both ways with the same mission package (`presence.py`), and no
attempt at it has just failed. Which of those should is for zones (`zones.py`) and links (`links.py`) to say.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from mavproxy_handover.core.events import Action, Record
from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.links import Links
from mavproxy_handover.core.model import NO_MISSION, Mission, Reason
from mavproxy_handover.core.presence import Presence
from mavproxy_handover.core.zones import ZoneTracker

__all__ = ["Candidates"]

#: a transfer that ended because somebody did not want it
_OPERATORS_WORD = (Reason.COMMANDER_DENIED, Reason.PARTNER_REFUSED, Reason.CANCELLED)


class Candidates:
    """The stations that may be partner. Times are monotonic seconds."""

    __slots__ = ("_limits", "_presence", "_retry_after", "links", "mission", "zones")

    def __init__(self, presence: dict[int, Presence], limits: Limits) -> None:
        self._presence = presence
        self._limits = limits
        self._retry_after: dict[int, float] = {}
        self.zones = ZoneTracker(limits)
        self.links = Links(limits)
        self.mission: Mission = NO_MISSION

    def hold(self, mission: Mission) -> None:
        """The mission that the autopilot holds now."""
        self.mission = mission

    def unfit(self, station: int, now: float) -> Reason | None:
        """Why this station could not be a partner now; None if it could."""
        return self._presence[station].unfit(self.mission.digest, now)

    def usable(self, owner: int | None, now: float, actions: list[Action]) -> Sequence[int]:
        """Stations whose zone holds the aircraft and that could take it; says once why another could not."""
        usable = []
        for station in self.zones.inside():
            presence = self._presence.get(station)
            if presence is None or station == owner or now < self._retry_after.get(station, -inf):
                continue
            why = self.unfit(station, now)
            if why is None:
                usable.append(station)
            elif why is not presence.told_why:
                text = f"{presence.station.name} cannot be partner: {why.name.lower().replace('_', ' ')}"
                actions.append(Record("partner_unfit", text, why, station))
            presence.told_why = why
        return usable

    def wanted(self, owner: int, now: float, actions: list[Action]) -> tuple[int, Reason] | None:
        """The station that authority should move to now, and why; None if it should stay."""
        usable = self.usable(owner, now, actions)
        better = self.links.better(owner, usable, now)
        partner = self.zones.next_commander(owner, usable, self.mission.following, now, better)
        if partner is None:
            return None
        return partner, Reason.LINK_QUALITY if partner in better else Reason.ZONE

    def best(self, owner: int | None, now: float, actions: list[Action]) -> int | None:
        """The station to take the aircraft if its owner will not have it any longer; None if there is none."""
        return self.zones.best(self.usable(owner, now, actions), self.mission.following)

    def pause(self, station: int, reason: Reason, now: float) -> None:
        """A transfer to the station failed for this reason: not again at once."""
        pause_s = self._limits.denied_pause_s if reason in _OPERATORS_WORD else self._limits.retry_pause_s
        self._retry_after[station] = now + pause_s

    def forget_pauses(self) -> None:
        """What failed before does not count any more."""
        self._retry_after.clear()

    def moved(self, station: int, now: float, *, flying: bool) -> None:
        """This station commands now."""
        self.zones.moved(now)
        self.forget_pauses()
        if flying:
            self.mission = self.mission.advanced(station)
