# SPDX-License-Identifier: GPL-3.0-or-later

"""The next change of authority on the mission's way: both stations may answer before the border.

Theory of operation
-------------------
An operator who is asked at the border of a zone may answer after the aircraft has left the overlap. If the way of the
mission is known, the border at which authority should move is known too, by the rules of `zones.py`. So both stations
are told of it each second (HANDOVER_AHEAD), beginning `operator_timeout_s` before it. Both may answer at once
(OK_AHEAD).

These answers move nothing. At the border the transfer goes through all its steps. A station then repeats the answer
that its operator gave before, if the vehicle asks for that border: its number travels with the questions of the
transfer. A number is never used twice within an epoch. A foreseen border ends

* with the commander, and with an emergency;
* with another route or mission;
* if the aircraft leaves the partner's zone;
* if another border comes up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf
from typing import Final

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.common.events import Action, BordersSeen, Record, Send
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import CrossingKey, HandoverAhead, OkAhead
from mavproxy_handover.core.common.model import BorderFact, Consent, Phase, Reason

__all__ = ["FORESEEN", "Foresight"]

#: reasons of transfers that can be foreseen
FORESEEN: Final = frozenset({Reason.ZONE, Reason.ZONE_ENDS})
#: how often the stations are told (s)
_AGAIN_S: Final = 1.0
#: an aircraft that does not fly on its mission's way has left it, or waits. The border is still told for the first time
#: (s). It is still the same border if the way is taken up again within the second (s)
_FLOWN_S, _SAME_S = 2.5, 60.0
#: time (s) after a border until the zone there counts as entered, some metres inside
_PASSED_S: Final = 5.0
_IN_WORDS: Final = {
    Consent.GRANTED: "agrees to it beforehand",
    Consent.DENIED: "will not have it",
    Consent.WAITING: "asks its operator",
}


@dataclass(frozen=True, slots=True)
class _Ahead:
    """A border ahead. `border`, `route`, `digest`: its number, way and mission; `at`: when it is reached,
    `seen_at`: when it was on the way last (monotonic s); `reached`: the partner's zone holds the aircraft."""

    key: CrossingKey
    border: int
    route: int
    digest: bytes
    at: float
    seen_at: float
    reached: bool = False


class Foresight:
    """Of one vehicle. Times are monotonic seconds; not safe for threads."""

    __slots__ = (
        "_ahead",
        "_authority",
        "_candidates",
        "_flight",
        "_limits",
        "_number",
        "_presence",
        "_said",
        "_say_at",
    )

    def __init__(
        self,
        authority: Authority,
        flight: Flight,
        presence: dict[int, Presence],
        candidates: Candidates,
        limits: Limits,
    ) -> None:
        self._authority = authority
        self._flight = flight
        self._presence = presence
        self._candidates = candidates
        self._limits = limits
        #: number of the last border that was told
        self._number = 0
        self._ahead: _Ahead | None = None
        #: answers of the two stations, and when they are told next
        self._said: dict[int, Consent] = {}
        self._say_at = inf

    @property
    def key(self) -> CrossingKey | None:
        """The border that the stations know of; None: none."""
        return None if self._ahead is None else self._ahead.key

    def left_s(self, now: float) -> float:
        """Seconds until that border is reached; inf: there is none."""
        return inf if self._ahead is None else self._ahead.at - now

    def number_for(self, partner: int, reason: Reason, now: float) -> int:
        """The border for which a transfer to this partner begins now; 0: for none that the stations know of."""
        self._update(now)
        ahead = self._ahead
        if ahead is None or reason not in FORESEEN or ahead.key.to_station != partner:
            return 0
        return ahead.key.crossing

    # ---- what is seen ---------------------------------------------------------------------------------------------

    def seen(self, event: BordersSeen, now: float, actions: list[Action]) -> None:
        """The borders on the way ahead."""
        if self._ahead is not None and event.route != self._ahead.route:
            self._over()
        found = self._expected(event.borders)
        if found is None or not self._may_ask():
            return
        partner, border, in_s = found
        owner, digest, ahead = self._authority.owner, self._candidates.mission.digest, self._ahead
        assert owner is not None
        if in_s <= self._limits.operator_timeout_s:  # before the border there is time to mend it
            self._candidates.could_be_partner(partner, owner, now, actions)
        if ahead is not None and (ahead.border, ahead.key.to_station) == (border, partner):
            self._ahead = replace(ahead, at=now + in_s, seen_at=now)
            return
        if in_s > self._limits.operator_timeout_s or self._in_use() or self._still(partner, now):
            return
        self._number = self._number % 0xFFFF + 1
        key = CrossingKey(owner, partner, self._number, self._authority.epoch)
        self._ahead = _Ahead(key, border, event.route, digest, now + in_s, now)
        self._said, self._say_at = {}, now
        names = f"{self._authority.name(owner)} -> {self._authority.name(partner)}"
        text = f"{names} is expected in {max(0.0, in_s):.0f} s: both may answer now"
        actions.append(Record("foreseen", text, Reason.ZONE, partner))

    def _still(self, partner: int, now: float) -> bool:
        """Whether the border that the stations know of still counts.

        The aircraft has only just passed it. Or the zone there holds the aircraft, and the next border has the same
        partner.
        """
        ahead = self._ahead
        if ahead is None:
            return False
        return ahead.key.to_station == partner if ahead.reached else now < ahead.at + _PASSED_S

    def _may_ask(self) -> bool:
        authority = self._authority
        flown = self._flight.flying and authority.phase in (Phase.ON_MISSION, Phase.ON_HANDOVER)
        return flown and authority.owner is not None and not authority.lost

    def _in_use(self) -> bool:
        """A transfer is under way for the border that is known."""
        transfer, ahead = self._authority.transfer, self._ahead
        return transfer is not None and ahead is not None and transfer.crossing == ahead.key.crossing

    def _expected(self, borders: tuple[BorderFact, ...]) -> tuple[int, int, float] | None:
        """The first border at which authority should move: to whom, which one, and how soon (s)."""
        owner = self._authority.owner
        if owner is None:
            return None
        zones = self._candidates.zones
        holding = frozenset(station for station in zones.inside() if zones.open(station))
        for border in borders:
            if owner in border.holding:
                partners, soon_s = border.holding - holding - {owner}, 0.0
            else:  # first a station whose zone holds the aircraft before that; else one whose zone begins there
                partners, soon_s = border.holding & holding - {owner}, self._limits.exit_soon_s
                if not partners:
                    partners, soon_s = border.holding - {owner}, 0.0
            found = min(self._able(partners), default=None)
            if found is not None:
                return found[1], border.number, border.in_s - soon_s
            if owner not in border.holding:
                return None
            holding = border.holding
        return None

    def _able(self, stations: frozenset[int]) -> Iterator[tuple[bool, int]]:
        """The stations that can be told, the next one on the route first."""
        following = self._candidates.mission.following
        for station in stations:
            presence = self._presence.get(station)
            if presence is not None and not presence.station.standard:
                yield station != following, station

    def _update(self, now: float) -> None:
        """Whether it is still the same border, for the same commander."""
        ahead, authority = self._ahead, self._authority
        if ahead is None or self._in_use():
            return
        holds = self._candidates.zones.open(ahead.key.to_station)
        same = (ahead.key.from_station, ahead.key.epoch) == (authority.owner, authority.epoch)
        same = same and ahead.digest == self._candidates.mission.digest
        late = now >= ahead.seen_at + _SAME_S
        if not self._may_ask() or not same or (not holds and (late or ahead.reached)):
            self._over()
        elif holds and not ahead.reached and now >= ahead.at - self._limits.exit_soon_s:
            self._ahead = replace(ahead, reached=True)

    def _over(self) -> None:
        self._ahead, self._said, self._say_at = None, {}, inf

    # ---- what is said ---------------------------------------------------------------------------------------------

    def accept_answer(self, station: int, answer: OkAhead, actions: list[Action]) -> str | None:
        """A station's answer; returns why it was dropped, None if it counts."""
        ahead = self._ahead
        if ahead is None or answer.key != ahead.key:
            return "no such border ahead"
        if station not in (ahead.key.from_station, ahead.key.to_station):
            return "not the sender's to say"
        if self._said.get(station) is not answer.consent:
            self._said[station] = answer.consent
            text = f"{self._authority.name(station)} {_IN_WORDS[answer.consent]}"
            actions.append(Record("foreseen_answer", text, Reason.ZONE, station))
        return None

    def speak(self, now: float, actions: list[Action]) -> None:
        """Tell both stations, each second until the transfer begins."""
        self._update(now)
        ahead = self._ahead
        if ahead is None or now < self._say_at:
            return
        self._say_at = now + _AGAIN_S
        if self._authority.transfer is not None or ahead.reached:  # the stations are asked, or were
            return
        if now >= ahead.seen_at + _FLOWN_S:
            return
        key = ahead.key
        said = self._said.get(key.from_station), self._said.get(key.to_station)
        for station in (key.to_station, key.from_station):
            if not self._presence[station].station.standard:
                actions.append(Send(station, HandoverAhead(key, max(0.0, ahead.at - now), *said)))

    def deadlines(self) -> list[float]:
        """When there is something to say."""
        return [] if self._ahead is None else [self._say_at]
