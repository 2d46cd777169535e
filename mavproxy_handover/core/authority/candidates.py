# SPDX-License-Identifier: GPL-3.0-or-later

"""Stations that could take the aircraft, and the one that should.

A station could take the aircraft if its zone holds it, if it is there both ways with the same mission package
(`presence.py`), and if no attempt at it has just failed. Zones (`zones.py`) and links (`links.py`) say which one
should.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import inf

from mavproxy_handover.core.authority.consent_lines import refused_on_route, without_consent
from mavproxy_handover.core.authority.cures import cure, ended
from mavproxy_handover.core.authority.links import Links
from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.authority.zones import ZoneTracker
from mavproxy_handover.core.common.events import Action, Advise, Record
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import NO_MISSION, RANKS, Mission, Reason, StandingConsent, in_words

__all__ = ["Candidates"]

#: reasons of a transfer that ended because a person or the configuration did not want it
_OPERATORS_WORD = (Reason.COMMANDER_DENIED, Reason.PARTNER_REFUSED, Reason.CANCELLED, Reason.CONSENT_REFUSED)


class Candidates:
    """The stations that may be partner. Times are monotonic seconds."""

    __slots__ = ("_failed", "_limits", "_mute", "_presence", "_retry_after", "links", "mission", "zones")

    def __init__(self, presence: dict[int, Presence], limits: Limits) -> None:
        self._presence = presence
        self._limits = limits
        #: station and rank -> until when no transfer of this rank or a lower one goes to the station
        self._retry_after: dict[tuple[int, int], float] = {}
        #: stations that let a transfer fail since authority last moved
        self._failed: set[int] = set()
        #: those of them that have not said anything in a transfer since
        self._mute: set[int] = set()
        self.zones = ZoneTracker(limits)
        self.links = Links(limits)
        self.mission: Mission = NO_MISSION

    def hold(self, mission: Mission) -> None:
        """The mission that the autopilot holds now."""
        self.mission = mission

    def unfit(self, station: int, now: float) -> Reason | None:
        """Why this station could not be a partner now; None if it could."""
        return self._presence[station].unfit(self.mission.digest, now)

    def consent_lacks(self) -> tuple[str, ...]:
        """Why the handovers of the route cannot have consent, in words that say what to write where; empty: they can.

        With one station there is no handover, and nothing to consent to.
        """
        stations = [presence.station for presence in self._presence.values()]
        shown = [sysid for sysid, presence in self._presence.items() if presence.can_be_asked]
        return without_consent(stations, shown) + refused_on_route(stations, self.mission.route)

    def _name(self, station: int) -> str:
        presence = self._presence.get(station)
        return f"station {station}" if presence is None else presence.station.name

    def silent_s(self, station: int, now: float) -> float:
        """For how long the station has not been heard; inf if it never was."""
        return now - self._presence[station].heard_at

    def deaf_words(self, station: int, now: float) -> str:
        """Words for a station that is heard and hears nothing, or too little; "" if it is not so."""
        presence = self._presence[station]
        if not presence.alive(now):
            return ""
        if not presence.connected(now):
            silent_s = now - presence.answered_at
            return "hears nothing" + (f" for {silent_s:.0f} s" if silent_s < inf else "")
        return self.hears_little if presence.hearing.barred else ""

    @property
    def hears_little(self) -> str:
        """What is said of a station whose answers are too few."""
        return f"hears less than {self._limits.deaf_share:.0%} of what the aircraft sends".replace("%", " %")

    def unable(self, station: int, now: float, flying: bool) -> Reason | None:
        """Why authority must not go to this station in this moment, whatever was agreed; None if it may."""
        presence = self._presence[station]
        if not presence.alive(now) or not presence.hearing.enough:
            return Reason.PARTNER_SILENT
        if not flying:
            return None
        if self.zones.known and not self.zones.holds(station):
            return Reason.LEFT_REGION
        why = presence.unfit(self.mission.digest, now)
        return None if why is Reason.PARTNER_SILENT else why  # the station has just spoken

    def _fit(self, owner: int | None, now: float, actions: list[Action]) -> Sequence[int]:
        """Stations whose zone holds the aircraft and that could take it; says once why another could not."""
        others = [station for station in self.zones.inside() if station in self._presence and station != owner]
        return [station for station in others if self.could_be_partner(station, owner, now, actions)]

    def could_be_partner(self, station: int, owner: int | None, now: float, actions: list[Action]) -> bool:
        """Whether this station could be partner now. If not, tells both operators once why, and what to do."""
        presence = self._presence[station]
        why = self.unfit(station, now)
        words = None if why is None else in_words(why)
        # a station that comes into range: in a few seconds it answers enough, or it is barred and both operators hear
        # it
        comes = False
        if why is Reason.PARTNER_SILENT and presence.connected(now) and not presence.hearing.enough:
            comes = not presence.hearing.barred
            words = "it has answered too few questions" if comes else f"it {self.hears_little}"
        news = presence.unfit_told(words)
        if why is not None and news:
            name = presence.station.name
            actions.append(Record("partner_unfit", f"{name} cannot be partner: {words}", why, station))
            told = (station,) if owner is None else (owner, station)
            if not comes:
                actions.append(Advise(told, cure(name, why)))
        return why is None

    def usable(self, owner: int | None, reason: Reason, now: float, actions: list[Action]) -> Sequence[int]:
        """Stations whose zone holds the aircraft, and that may be asked for this reason now."""
        return [station for station in self._fit(owner, now, actions) if self.paused_s(station, reason, now) <= 0.0]

    def ready(self, stations: Iterable[int], owner: int, reason: Reason, now: float) -> list[int]:
        """Those of `stations` that could take the aircraft from `owner` and may be asked for this reason now."""
        if self._keeps(owner):
            return []
        return [
            station
            for station in stations
            if station != owner
            and station in self._presence
            and self.unfit(station, now) is None
            and self.paused_s(station, reason, now) <= 0.0
        ]

    def reasons(self, owner: int, now: float, actions: list[Action]) -> dict[int, Reason]:
        """The stations that authority could move to now, and why it should."""
        fit = self._fit(owner, now, actions)
        reasons = self.zones.reasons(owner, fit, now, self.links.better(owner, fit, now), self.links.worse(owner, fit))
        if reasons and self._keeps(owner):
            self._tell_kept(owner, next(iter(reasons)), actions)
            return {}
        return {station: why for station, why in reasons.items() if self.paused_s(station, why, now) <= 0.0}

    def _keeps(self, owner: int) -> bool:
        """Whether the vehicle's file refuses planned handovers away from this commander."""
        presence = self._presence.get(owner)
        return presence is not None and presence.station.consent is StandingConsent.REFUSE

    def _tell_kept(self, owner: int, partner: int, actions: list[Action]) -> None:
        """Tell both operators, once, that no handover begins because of that."""
        presence, why = self._presence[owner], Reason.CONSENT_REFUSED
        if presence.unfit_told(in_words(why)):
            text = f"No handover: {ended(why, presence.station.name, self._name(partner))}"
            actions.append(Record("handover_refused", text, why, owner))
            actions.append(Advise((owner, partner), text))

    def wanted(self, owner: int, now: float, actions: list[Action]) -> tuple[int, Reason] | None:
        """The station that authority should move to now, and why; None if it should stay. The gravest reason first."""
        open_to = self.reasons(owner, now, actions)
        if not open_to:
            return None
        gravest = max(open_to.values(), key=RANKS.__getitem__)
        return self.best([station for station, why in open_to.items() if why is gravest]), gravest

    def best(self, stations: Sequence[int]) -> int:
        """Of these, at least one, the next one on the route, then the one whose zone keeps the aircraft longest.

        A station that has let a transfer fail since authority last moved comes after the others. So a station that
        answers and then does not take the aircraft does not keep it from the next one.
        """
        untried = [station for station in stations if station not in self._failed]
        if not untried:
            self._failed.difference_update(stations)
        return self.zones.best(untried or stations, self.mission.following)

    def pause(self, station: int, reason: Reason, why: Reason, now: float) -> None:
        """A transfer to the station for `reason` failed, and why: not again at once, unless for a graver reason."""
        pause_s = self._limits.denied_pause_s if why in _OPERATORS_WORD else self._limits.retry_pause_s
        self._retry_after[station, RANKS[reason]] = now + pause_s
        if why in (Reason.PARTNER_SILENT, Reason.PARTNER_UNANSWERED):
            self._failed.add(station)
            if not self._presence[station].station.standard:  # a standard station sends no messages of a transfer
                self._mute.add(station)

    def spoke(self, station: int) -> None:
        """The station has spoken in a transfer."""
        self._mute.discard(station)

    def mute(self, station: int) -> bool:
        """Whether the station has let a transfer fail by its silence, and has not spoken in one since."""
        return station in self._mute

    def paused_s(self, station: int, reason: Reason, now: float) -> float:
        """How long no transfer for this reason goes to the station; 0 if one may."""
        pauses = (
            until - now
            for (paused, rank), until in self._retry_after.items()
            if paused == station and rank >= RANKS[reason]
        )
        return max((0.0, *pauses))

    def forget_pauses(self) -> None:
        """What failed before does not count any more."""
        self._retry_after.clear()
        self._failed.clear()
        self._mute.clear()

    def moved(self, station: int, now: float, *, flying: bool) -> None:
        """Authority has moved to this station."""
        self._presence[station].hearing.trust(now)
        self.zones.moved(now)
        self.forget_pauses()
        if flying:
            self.mission = self.mission.advanced(station)
