# SPDX-License-Identifier: GPL-3.0-or-later

"""A vehicle, its stations and the links between them as a graph: states, and all that can happen in each.

The vehicle is a shipping `Arbiter`, the stations are shipping `StationCore`s; nothing of them is modelled. What is
modelled is what lies between and around:

* Time goes in ticks of one second, and every limit is a whole number of them. A tick brings heartbeats, answers to
  CONNECT, position and AUTHORITY_STATUS, to and from all who live and are linked.
* The messages of a transfer, and AUTHORITY_STATUS when it changes, travel one by one through a queue for each
  direction between two. The heads of the queues arrive in every possible order. Before the next tick every message has
  arrived, or a fault has befallen it.
* Faults: `setting.Fault`. What is dead may come back, what is cut may heal, at any time, for nothing.
* The aircraft flies its path, one position after the other, at any time.
* Operators answer yes or no, at any time or never, and make requests of their own.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

from gcs_module import core as gcs
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common.events import (
    AutopilotState,
    GuardSeen,
    MissionLoaded,
    OperatorControlShown,
    PositionSeen,
    StationHeard,
    Tick,
)
from mavproxy_handover.core.common.messages import (
    Connect,
    ConnectAck,
)
from mavproxy_handover.core.common.model import AUTOMATIC, UNASKED, GapFact, GuardState, Station, ZoneFact
from tests.model.canonical import EPOCH, GAP_S, Packer, Shift, shifted
from tests.model.nodes import DIGEST, Names, Parcel, Stations, Vehicles, too_old
from tests.model.setting import PARENT, Setting
from tests.model.station_checks import check_beliefs

__all__ = ["DEAD", "Draft", "State", "World"]

LETTERS = "ABCDEF"
#: when a zone that is about to end does, along the track
SOON_S = 3.0
DEAD = -1


class State(NamedTuple):
    """Everything there is, as small numbers."""

    vehicle: int
    #: of each station, or DEAD
    stations: tuple[int, ...]
    #: events under way, by channel, oldest first
    queues: tuple[tuple[int, ...], ...]
    #: events held back: channel, event
    held: tuple[tuple[int, int], ...]
    position: int
    #: channels that are cut
    cuts: tuple[int, ...]
    #: what may still go wrong, and how many requests operators may still make
    faults: int
    requests: int


class Draft:
    """A state in the making."""

    __slots__ = (
        "cuts",
        "epochs",
        "faults",
        "held",
        "numbers",
        "position",
        "queues",
        "requests",
        "stations",
        "vehicle",
        "work",
    )

    def __init__(self, state: State) -> None:
        self.vehicle = state.vehicle
        self.stations = list(state.stations)
        self.queues = list(state.queues)
        self.held = list(state.held)
        self.position = state.position
        self.cuts = state.cuts
        self.faults = state.faults
        self.requests = state.requests
        #: parcels that have still to be put on their way
        self.work: deque[Parcel] = deque()
        #: how far the vehicle's numbers have moved
        self.epochs = 0
        self.numbers = 0

    def done(self) -> State:
        return State(
            self.vehicle,
            tuple(self.stations),
            tuple(self.queues),
            tuple(sorted(self.held)) if len(self.held) > 1 else tuple(self.held),
            self.position,
            self.cuts,
            self.faults,
            self.requests,
        )


def _gap(place: str) -> GapFact | None:
    return GapFact(GAP_S, "GCSA -> GCSB") if place.startswith("=") else None


class World:
    """The graph of one setting. `make_arbiter`, `make_station`: for planted faults."""

    def __init__(
        self,
        setting: Setting,
        make_arbiter: Callable[..., Arbiter] = Arbiter,
        make_station: Callable[..., gcs.StationCore] = gcs.StationCore,
    ) -> None:
        self.setting = setting
        self.count = count = setting.stations
        self.sysids = tuple(PARENT + index for index in range(count))
        self.stations = tuple(
            Station(sysid, f"GCS{letter}", True, setting.consent)
            if letter in setting.standard
            else Station(sysid, f"GCS{letter}")
            for letter, sysid in zip(LETTERS, self.sysids, strict=False)
        )
        automatic = {
            sysid: () if letter in setting.forced else UNASKED if letter in setting.operators else AUTOMATIC
            for letter, sysid in zip(LETTERS, self.sysids, strict=False)
        }
        packer = Packer(setting.limits, {station.sysid: station.name for station in self.stations})
        self.events = Names()
        self.vehicles = Vehicles(self.stations, setting.limits, packer, self.events, make_arbiter)
        self.cores = Stations(self.stations, automatic, packer, self.events, make_station)
        self._lay_channels()
        self._fresh = tuple(DEAD if s.standard else self.cores.new(i) for i, s in enumerate(self.stations))
        self._tick = self.events(Tick())
        self._heard = [self.events(StationHeard(sysid)) for sysid in self.sysids]
        self._vehicle_heard = self.events(gcs.VehicleHeard())
        self._peer_heard = [self.events(gcs.PeerHeard(sysid)) for sysid in self.sysids]
        self._places = [
            self.events(PositionSeen(self._facts(place, following), _gap(place)))
            for place, following in zip(setting.path, (*setting.path[1:], ""), strict=True)
        ]
        self._autopilot = [
            self.events(AutopilotState(not place.startswith("_"), not place.startswith("_"))) for place in setting.path
        ]
        #: programs of the standard show in each run that they know it
        self._shown = [self.events(OperatorControlShown(s.sysid)) for s in self.stations if s.standard]
        self._guard = self.events(GuardSeen(GuardState.LIVE, ours=True))
        self._mission = self.events(MissionLoaded(DIGEST, self.sysids))
        self._routine: dict[tuple[int, tuple[int, ...], int, tuple[int, ...]], tuple[State, Shift]] = {}
        self._connects: dict[int, bool] = {}
        self._agreeing: set[tuple[int, tuple[int, ...]]] = set()
        self._rebased: dict[tuple[int, Shift], int] = {}

    # ---- channels ---------------------------------------------------------------------------------------------------

    def _lay_channels(self) -> None:
        pairs = [(index, -1) for index in range(self.count)] + [(-1, index) for index in range(self.count)]
        pairs += [(a, b) for a in range(self.count) for b in range(self.count) if a != b]
        pairs = [
            pair for pair in pairs if not any(end >= 0 and self.stations[end].standard for end in pair) or pair[1] == -1
        ]
        #: channel -> sender, receiver
        self.channels = tuple(pairs)
        self._channel = {pair: number for number, pair in enumerate(pairs)}

    def _name(self, index: int) -> str:
        return "vehicle" if index < 0 else self.stations[index].name

    def _facts(self, place: str, following: str) -> tuple[ZoneFact, ...]:
        """Behind a border that is ahead are the zones of the `following` place."""
        facts = []
        beyond = frozenset(sysid for letter, sysid in zip(LETTERS, self.sysids, strict=False) if letter in following)
        for letter, sysid in zip(LETTERS, self.sysids, strict=False):
            ending = letter.lower() in place.lstrip("_")
            holds = ending or letter in place
            margin_m = 50.0 if holds else -50.0
            fact = ZoneFact(sysid, margin_m, SOON_S, SOON_S, beyond) if ending else ZoneFact(sysid, margin_m, None)
            facts.append(replace(fact, awaits=f"{letter}?" in place))
        return tuple(facts)

    def _cut(self, draft: Draft, sender: int, receiver: int) -> bool:
        return self._channel.get((sender, receiver)) in draft.cuts

    @property
    def story(self) -> list[str] | None:
        """What a person reads of the steps that are made; None: nobody does."""
        return self.vehicles.story

    @story.setter
    def story(self, story: list[str] | None) -> None:
        self.vehicles.story = self.cores.story = story

    def alive(self, state: State | Draft, index: int) -> bool:
        """Whether a station lives; one of the standard always does, its link may be cut."""
        return index < 0 or self.stations[index].standard or state.stations[index] != DEAD

    # ---- what an event does -----------------------------------------------------------------------------------------

    def _to_vehicle(self, draft: Draft, event: int) -> None:
        """An event for the companion, and all that follows at once."""
        if self.vehicles[draft.vehicle].packed is None:
            return
        draft.vehicle, parcels, shift = self.vehicles.step(draft.vehicle, event)
        self._rebase(draft, shift)
        draft.work.extendleft(reversed(parcels))
        self._send_off(draft)

    def _to_station(self, draft: Draft, index: int, event: int) -> None:
        if draft.stations[index] == DEAD:
            return
        draft.stations[index], parcels = self.cores.step(draft.stations[index], event)
        draft.work.extendleft(reversed(parcels))
        self._send_off(draft)

    def _send_off(self, draft: Draft) -> None:
        while draft.work:
            sender, receiver, event = draft.work.popleft()
            channel = self._channel.get((sender, receiver))
            if channel is None or channel in draft.cuts:
                continue
            if receiver < 0:
                if self.vehicles[draft.vehicle].packed is None:
                    continue
            elif draft.stations[receiver] == DEAD:
                continue
            if not self._at_once(event):
                draft.queues[channel] = (*draft.queues[channel], event)
            elif receiver < 0:
                self._to_vehicle(draft, event)
            elif not draft.queues[channel]:
                self._to_station(draft, receiver, event)

    def _at_once(self, event: int) -> bool:
        """Questions and answers of CONNECT are the tick's, not the transfer's."""
        known = self._connects.get(event)
        if known is None:
            message = getattr(self.events.values[event], "message", None)
            asked = isinstance(message, Connect) or (isinstance(message, ConnectAck) and message.nonce != 0)
            known = self._connects[event] = asked
        return known

    def _rebase(self, draft: Draft, shift: Shift) -> None:
        """The vehicle's numbers have moved: everything that carries them moves along."""
        if not (shift.epoch or shift.number):
            return
        draft.epochs += shift.epoch
        draft.numbers += shift.number
        rebased = self.cores.rebased
        draft.stations = [each if each == DEAD else rebased(each, shift) for each in draft.stations]
        draft.queues = [
            tuple(new for new in (self._moved(event, shift) for event in queue) if new >= 0) if queue else queue
            for queue in draft.queues
        ]
        held = ((channel, self._moved(event, shift)) for channel, event in draft.held)
        draft.held = [(channel, event) for channel, event in held if event >= 0]
        work = (parcel._replace(event=self._moved(parcel.event, shift)) for parcel in draft.work)
        draft.work = deque(parcel for parcel in work if parcel.event >= 0)

    def _moved(self, event: int, shift: Shift) -> int:
        number = self._rebased.get((event, shift))
        if number is None:
            value = shifted(self.events.values[event], shift)
            number = self._rebased[event, shift] = -1 if too_old(value) else self.events(value)
        return number

    # ---- time -------------------------------------------------------------------------------------------------------

    def _later(self, state: State) -> State:
        """One tick later. All queues are empty."""
        key = (state.vehicle, state.stations, state.position, state.cuts)
        known = self._routine.get(key)
        if known is None or self.story is not None:
            draft = Draft(state)
            draft.held = []
            self._routinely(draft)
            known = self._routine[key] = draft.done(), Shift(0.0, draft.epochs, draft.numbers)
        after, shift = known
        held: Iterable[tuple[int, int]] = state.held
        if held and (shift.epoch or shift.number):
            moved = ((channel, self._moved(event, shift)) for channel, event in held)
            held = (pair for pair in moved if pair[1] >= 0)
        return after._replace(held=tuple(sorted(held)), faults=state.faults, requests=state.requests)

    def _routinely(self, draft: Draft) -> None:
        """What a tick brings, in this order: status and heartbeats down, over the ground, and up; position."""
        draft.vehicle = self.vehicles.later(draft.vehicle)
        draft.stations = [each if each == DEAD else self.cores.later(each) for each in draft.stations]
        state = self.vehicles[draft.vehicle]
        living = [index for index, each in enumerate(draft.stations) if each != DEAD]
        if state.packed is not None:
            status = self.events(self.vehicles.status(state.view))
            for index in living:
                if not self._cut(draft, -1, index):
                    self._to_station(draft, index, self._vehicle_heard)
                    self._to_station(draft, index, status)
        for source in living:
            for target in living:
                if source != target and not self._cut(draft, source, target):
                    self._to_station(draft, target, self._peer_heard[source])
        for index, station in enumerate(self.stations):
            if (station.standard or index in living) and not self._cut(draft, index, -1):
                self._to_vehicle(draft, self._heard[index])
        self._to_vehicle(draft, self._autopilot[draft.position])
        self._to_vehicle(draft, self._places[draft.position])
        self._to_vehicle(draft, self._tick)

    def check(self, state: State) -> None:
        """What must hold between vehicle and stations."""
        key = (state.vehicle, state.stations)
        if key in self._agreeing:
            return
        vehicle = self.vehicles[state.vehicle]
        beliefs = [self.cores.beliefs[each] for each in state.stations if each != DEAD]
        check_beliefs(vehicle.view.commander, EPOCH, vehicle.books.blank, beliefs)
        self._agreeing.add(key)
