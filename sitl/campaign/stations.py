# SPDX-License-Identifier: GPL-3.0-or-later

"""The edge of the stations' rules: one real `StationCore` for each, its operator, and its life."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gcs_module import core as gcs
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.core.common.model import AUTOMATIC, UNASKED, Station
from mavproxy_handover.core.common.never import assert_never
from sitl.campaign.companion import DIGEST
from sitl.campaign.log import FlightLog
from sitl.campaign.plan import FlightPlan, StationPlan

__all__ = ["Ground", "GroundTies"]


@dataclass(frozen=True, slots=True)
class GroundTies:
    """How what a station says travels, and how an operator's answer comes: yes or no, and after how long (ticks)."""

    to_vehicle: Callable[[int, Message, int], None]
    to_peer: Callable[[int, int, Message, int], None]
    answer: Callable[[int, object, tuple[bool, int] | None, int], None]


class Ground:
    """One station. Times are ticks; `core_s`: the same as the rules count them."""

    def __init__(
        self, plan: FlightPlan, station: StationPlan, log: FlightLog, ties: GroundTies, core_s: Callable[[int], float]
    ) -> None:
        self._plan, self._station, self._log, self._ties, self._core_s = plan, station, log, ties, core_s
        self.sysid = station.sysid
        self._asked: object = None
        self.core: gcs.StationCore | None = None
        self.starts(0)

    def starts(self, now: int) -> None:
        """Its program begins, and knows nothing."""
        station = Station(self._station.sysid, self._station.name)
        peers = tuple(Station(each.sysid, each.name) for each in self._plan.stations if each is not self._station)
        automatic: tuple[str, ...] = UNASKED if self._station.asked else AUTOMATIC
        if self._station.asked_when_lost:
            automatic = tuple(question for question in automatic if question not in UNASKED)
        self.core = gcs.StationCore(station, "drone", peers, automatic=automatic)
        self.core.handle(gcs.MissionHeld(DIGEST), self._core_s(now))

    def dies(self, now: int) -> None:
        """Its program is gone."""
        self.core = None
        self._log.believes[self.sysid].set(now, None)

    def give(self, event: gcs.Event, now: int) -> None:
        """Something reaches it."""
        core = self.core
        if core is None:
            return
        actions = core.handle(event, self._core_s(now))
        if actions:
            self._perform(actions, now)
        elif isinstance(event, (gcs.PeerHeard, gcs.VehicleHeard)):
            return  # it changes no belief
        self._log.believes[self.sysid].set(now, core.epoch if core.role is gcs.Role.COMMANDER else None)
        question = core.question
        if question is not None and question != self._asked:
            self._asked = question
            self._ties.answer(self.sysid, question, self._station.answer, now)

    def answer(self, question: object, yes: bool, now: int) -> None:
        """The operator has decided."""
        if self.core is not None and self.core.question == question:
            self.give(gcs.Answer(yes), now)

    def tick(self, now: int) -> None:
        """Time has passed."""
        if self.core is not None:
            self._perform(self.core.tick(self._core_s(now)), now)

    def _perform(self, actions: list[gcs.Action], now: int) -> None:
        for action in actions:
            match action:
                case gcs.ToVehicle():
                    self._ties.to_vehicle(self.sysid, action.message, now)
                case gcs.ToPeer():
                    self._ties.to_peer(self.sysid, action.peer, action.message, now)
                case gcs.Notice():
                    if action.gravity:
                        self._log.note(now, f"{self._station.name}: {action.text}")
                case gcs.AskManager() | gcs.AcknowledgeManager():
                    pass  # the campaign's vehicles have our companion: the standard is never used
                case _:
                    assert_never(action)
