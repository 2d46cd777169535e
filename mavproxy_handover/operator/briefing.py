# SPDX-License-Identifier: GPL-3.0-or-later

"""The briefing: six lines about the aircraft for the partner's operator, sent with the question to take over.

The lines tell position and leg, battery and what the mission needs, wind, links, alerts with the last decision, and
what comes next. They are made when the operator is asked, and again every few seconds while the question is open. They
are made in the next round of the main loop, not within the exchange of messages: a station that answers by itself has
the aircraft by then, and gets no briefing.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Final

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common.causes import CAUSES
from mavproxy_handover.core.common.messages import HandoverAhead, HandoverRequest
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.monitors.route import RouteMonitor
from mavproxy_handover.operator.checks.command_check import CommandCheck
from mavproxy_handover.operator.return_site.return_site import ReturnSite
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire import status

__all__ = ["Briefing", "BriefingSources"]

#: interval of the briefings while the question is open (s)
_AGAIN_S: Final = 10.0
#: for this time (s) a decision that is over is told
_LATELY_S: Final = 300.0


@dataclass(slots=True)
class _Question:
    """An open question to a station, and the time of its last briefing (monotonic s)."""

    station: int
    matter: tuple[int, int]
    told_at: float = -inf


@dataclass(frozen=True, slots=True)
class BriefingSources:
    """The parts that know what the lines say."""

    aircraft: VehicleState
    #: the aircraft against its route
    route: RouteMonitor
    energy: EnergyMonitor
    command_check: CommandCheck
    return_site: ReturnSite


class Briefing:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(
        self,
        arbiter: Arbiter,
        sources: BriefingSources,
        ports: Mapping[int, StationPort],
        fault: Callable[[str, str], None],
    ) -> None:
        self._arbiter = arbiter
        self._sources = sources
        self._ports = ports
        self._fault = fault
        self._question: _Question | None = None
        self._number = 0
        #: the last decision, when it was told, and whether it is over
        self._decided: tuple[str, float, bool] = ("", -inf, True)

    def asked(self, station: int, message: object) -> None:
        """A message goes to a station. If it is a question to the partner, a briefing is due."""
        if isinstance(message, HandoverAhead) and station == message.key.to_station:
            matter = message.key.epoch, -message.key.crossing
        elif isinstance(message, HandoverRequest) and station == message.key.to_station:
            matter = message.key.epoch, -message.crossing if message.crossing else message.key.handover_id
        else:
            return
        if self._question is None or (self._question.station, self._question.matter) != (station, matter):
            self._question = _Question(station, matter)

    def decided(self, text: str, now: float, *, over: bool) -> None:
        """The last safety decision, in one sentence. `over`: its cause is gone."""
        self._decided = (self._decided[0] if over else text), now, over

    def tick(self, now: float) -> None:
        """Send the briefing if it is due; to be called in every round of the main loop."""
        question = self._question
        if question is None or now < question.told_at + _AGAIN_S:
            return
        if not self._open(question.station):
            self._question = None
            return
        question.told_at = now
        self._number = self._number % 0xFF + 1
        port = self._ports[question.station]
        for message in status.briefing(port.target, self._number, self.lines(question.station, now)):
            port.send(message)

    def _open(self, station: int) -> bool:
        """Whether the operator has not answered yet, as far as the vehicle knows."""
        key = self._arbiter.ahead
        return self._arbiter.view.partner == station or (key is not None and key.to_station == station)

    # ---- the lines ------------------------------------------------------------------------------------------------

    def lines(self, station: int, now: float) -> tuple[str, ...]:
        """The lines for this station. A fault in one line costs only that line."""
        made: tuple[Callable[[], str], ...] = (
            lambda: self._leg(now),
            self._battery,
            self._wind,
            lambda: self._links(station, now),
            lambda: self._alerts(now),
            lambda: self._next(now),
        )
        return tuple(self._line(make) for make in made)

    def _line(self, make: Callable[[], str]) -> str:
        try:
            return make()
        except Exception:
            self._fault("briefing", traceback.format_exc(limit=-3))
            return "not known (internal fault)"

    def _leg(self, now: float) -> str:
        aircraft = self._sources.aircraft
        if aircraft.where is None:
            return "position not known"
        lat, lon, alt = aircraft.where
        place = f"{lat:.5f} {lon:.5f}, {alt:.0f} m above home, {aircraft.track[1]:.1f} m/s"
        return f"{self._sources.route.words(now) or f'to waypoint {aircraft.waypoint}'}; {place}"

    def _battery(self) -> str:
        fact, need = self._sources.energy.fact, self._sources.command_check.way_on_wh()
        if fact.model is None or fact.left_wh is None:
            return f"what is left is not known{f': {fact.missing}' if fact.missing else ''}"
        whole = fact.model.battery_wh
        on = "what the mission needs is not known" if need is None else f"mission with reserve {need / whole:.0%}"
        place = self._sources.return_site.brief()
        return f"{fact.left_wh / whole:.0%} left; {on}{f'; return to {place}' if place else ''}"

    def _wind(self) -> str:
        fact = self._sources.energy.fact
        wind = None if fact.model is None else fact.model.wind
        if wind is None:
            return "not known"
        return f"{wind.speed_mps:.0f} m/s from {wind.from_deg:.0f} ({fact.wind_source})"

    def _links(self, station: int, now: float) -> str:
        commander = self._arbiter.view.commander
        both = [each for each in (commander, station) if each is not None]
        return "; ".join(f"{self._ports[each].name} {_link_words(self._ports[each], now)}" for each in both)

    def _alerts(self, now: float) -> str:
        wrong = "; ".join(CAUSES[cause].words for cause in sorted(self._arbiter.causes, key=lambda cause: cause.value))
        text, at, over = self._decided
        if not text or (over and now - at > _LATELY_S):
            return wrong or "none"
        last = f"{text}, over for {now - at:.0f} s" if over else text
        return f"{wrong or 'none'}; last decision: {last}"

    def _next(self, now: float) -> str:
        arbiter, key = self._arbiter, self._arbiter.ahead
        parts = []
        if key is not None:
            soon_s = max(0.0, arbiter.ahead_s(now))
            parts.append(f"{arbiter.name(key.from_station)} -> {arbiter.name(key.to_station)} in {soon_s:.0f} s")
        if arbiter.zone_ends_s < inf:
            parts.append(f"zone of {arbiter.name(arbiter.view.commander)} ends in {arbiter.zone_ends_s:.0f} s")
        return "; ".join(parts) or "no border in sight"


def _link_words(port: StationPort, now: float) -> str:
    """The best link of a station, in a few words."""
    found = [port.quality(link, now) for link in port.links]
    heard = [quality for quality in found if quality.heard_ago_s is not None]
    if not heard:
        return "not heard"
    best = min(heard, key=lambda quality: (quality.loss or 0.0, quality.round_trip_s or inf))
    loss = "" if best.loss is None else f"{best.loss:.0%} lost"
    trip = "" if best.round_trip_s is None else f"{best.round_trip_s * 1000:.0f} ms"
    weak = "WEAK" if port.weak else ""
    return ", ".join(part for part in (weak, loss, trip) if part) or f"heard {best.heard_ago_s:.0f} s ago"
