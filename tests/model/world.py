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
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from gcs_module import core as gcs
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.events import (
    AutopilotState,
    Cancel,
    ControlRequested,
    GuardSeen,
    GuardState,
    MissionLoaded,
    PositionSeen,
    StartFinished,
    StartRequested,
    StationHeard,
    StationMessage,
    Tick,
)
from mavproxy_handover.core.facts import ZoneFact
from mavproxy_handover.core.messages import (
    Connect,
    ConnectAck,
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.model import Station
from tests.model.canonical import EPOCH, Packer, Shift, shifted
from tests.model.checks import check_beliefs
from tests.model.nodes import DIGEST, Names, Parcel, Stations, Vehicles, too_old
from tests.model.setting import PARENT, Fault, Request, Setting

__all__ = ["Label", "State", "World"]

LETTERS = "ABCDEF"
DEAD = -1
#: words that a confused station may say of the present transfer
LIES: dict[str, Callable[[TransferKey], Any]] = {
    "ON_HANDOVER": OnHandover,
    "OK_HANDOVER": OkHandover,
    "DRONE_CONNECTED": DroneConnected,
    "DISCONNECT_HANDOVER": DisconnectHandover,
}

#: What happens between two states: a word, and what it happens to.
Label = tuple[Any, ...]


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


class _Draft:
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
            Station(sysid, f"GCS{letter}", letter in setting.standard)
            for letter, sysid in zip(LETTERS, self.sysids, strict=False)
        )
        asked = frozenset(PARENT + LETTERS.index(letter) for letter in setting.operators)
        packer = Packer(setting.limits, {station.sysid: station.name for station in self.stations})
        self.events = Names()
        self.vehicles = Vehicles(self.stations, setting.limits, packer, self.events, make_arbiter)
        self.cores = Stations(self.stations, asked, packer, self.events, make_station)
        self._lay_channels()
        self._fresh = tuple(DEAD if s.standard else self.cores.new(i) for i, s in enumerate(self.stations))
        self._tick = self.events(Tick())
        self._heard = [self.events(StationHeard(sysid)) for sysid in self.sysids]
        self._vehicle_heard = self.events(gcs.VehicleHeard())
        self._peer_heard = [self.events(gcs.PeerHeard(sysid)) for sysid in self.sysids]
        self._places = [self.events(PositionSeen(self._facts(place))) for place in setting.path]
        self._autopilot = [
            self.events(AutopilotState(not place.startswith("_"), not place.startswith("_"))) for place in setting.path
        ]
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

    def _facts(self, place: str) -> tuple[ZoneFact, ...]:
        return tuple(
            ZoneFact(sysid, 50.0 if letter in place else -50.0, None)
            for letter, sysid in zip(LETTERS, self.sysids, strict=False)
        )

    def _cut(self, draft: _Draft, sender: int, receiver: int) -> bool:
        return self._channel.get((sender, receiver)) in draft.cuts

    @property
    def story(self) -> list[str] | None:
        """What a person reads of the steps that are made; None: nobody does."""
        return self.vehicles.story

    @story.setter
    def story(self, story: list[str] | None) -> None:
        self.vehicles.story = self.cores.story = story

    def alive(self, state: State | _Draft, index: int) -> bool:
        """Whether a station lives; one of the standard always does, its link may be cut."""
        return index < 0 or self.stations[index].standard or state.stations[index] != DEAD

    # ---- what an event does -----------------------------------------------------------------------------------------

    def _to_vehicle(self, draft: _Draft, event: int) -> None:
        """An event for the companion, and all that follows at once."""
        if self.vehicles[draft.vehicle].packed is None:
            return
        draft.vehicle, parcels, shift = self.vehicles.step(draft.vehicle, event)
        self._rebase(draft, shift)
        draft.work.extendleft(reversed(parcels))
        self._send_off(draft)

    def _to_station(self, draft: _Draft, index: int, event: int) -> None:
        if draft.stations[index] == DEAD:
            return
        draft.stations[index], parcels = self.cores.step(draft.stations[index], event)
        draft.work.extendleft(reversed(parcels))
        self._send_off(draft)

    def _send_off(self, draft: _Draft) -> None:
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

    def _rebase(self, draft: _Draft, shift: Shift) -> None:
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

    # ---- how it begins ----------------------------------------------------------------------------------------------

    def root(self) -> State:
        """GCSA commands, the mission is loaded; in the air unless the path begins on the ground."""
        setting = self.setting
        queues: tuple[tuple[int, ...], ...] = ((),) * len(self.channels)
        state = State(self.vehicles.new(), self._fresh, queues, (), 0, (), 0, 0)
        aloft, self._autopilot[0] = self._autopilot[0], self.events(AutopilotState(armed=False, flying=False))
        state = self._quiet(state, 2)
        draft = _Draft(state)
        self._to_vehicle(draft, self._mission)
        state = self._quiet(draft.done(), 2)
        if not self._on_ground(state):
            state = self.follow(state, ("start",))
            self._autopilot[0] = aloft
            self._routine.clear()
            state = self._quiet(state, int(setting.limits.dwell_s) + 3)
        assert self.vehicles[state.vehicle].view.commander == PARENT
        return state._replace(faults=setting.faults, requests=setting.requests)

    def _quiet(self, state: State, ticks: int) -> State:
        """So many ticks of a time in which nothing goes wrong."""
        while ticks:
            label = self.next_quietly(state)
            state = self.follow(state, label)
            ticks -= label == ("tick",)
        return state

    def _start(self, draft: _Draft) -> None:
        """The commander brings the mission, if need be, and sends START; the autopilot plays along."""
        if not self.vehicles[draft.vehicle].loaded:
            self._to_vehicle(draft, self._mission)
        commander = self.vehicles[draft.vehicle].view.commander
        self._to_vehicle(draft, self._guard)
        self._to_vehicle(draft, self.events(StartRequested(commander)))
        self._to_vehicle(draft, self.events(AutopilotState(armed=True, flying=False)))
        self._to_vehicle(draft, self.events(StartFinished(ok=True)))
        if self._on_ground(draft) and draft.position + 1 < len(self.setting.path):
            draft.position += 1
            self._to_vehicle(draft, self._autopilot[draft.position])
            self._to_vehicle(draft, self._places[draft.position])

    # ---- time -------------------------------------------------------------------------------------------------------

    def _later(self, state: State) -> State:
        """One tick later. All queues are empty."""
        key = (state.vehicle, state.stations, state.position, state.cuts)
        known = self._routine.get(key)
        if known is None or self.story is not None:
            draft = _Draft(state)
            draft.held = []
            self._routinely(draft)
            known = self._routine[key] = draft.done(), Shift(0.0, draft.epochs, draft.numbers)
        after, shift = known
        held: Iterable[tuple[int, int]] = state.held
        if held and (shift.epoch or shift.number):
            moved = ((channel, self._moved(event, shift)) for channel, event in held)
            held = (pair for pair in moved if pair[1] >= 0)
        return after._replace(held=tuple(sorted(held)), faults=state.faults, requests=state.requests)

    def _routinely(self, draft: _Draft) -> None:
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

    # ---- all that can happen ----------------------------------------------------------------------------------------

    def labels(self, state: State) -> Iterator[Label]:
        """Every step that can be made from here."""
        waiting = [channel for channel, queue in enumerate(state.queues) if queue]
        for channel in waiting:
            yield "deliver", channel
        if not waiting:
            yield ("tick",)
        for place, pair in enumerate(state.held):
            if place == 0 or state.held[place - 1] != pair:
                yield "deliver late", *pair
        if state.position + 1 < len(self.setting.path):
            yield ("move",)
        yield from self._returns(state)
        yield from self._words_of_operators(state)
        if state.faults:
            yield from self._faults(state, waiting)

    def _returns(self, state: State) -> Iterator[Label]:
        for index, each in enumerate(state.stations):
            if each == DEAD and not self.stations[index].standard:
                yield "station returns", index
        if self.vehicles[state.vehicle].packed is None:
            yield ("vehicle returns",)
        for channel in state.cuts:
            yield "heal", channel

    def _words_of_operators(self, state: State) -> Iterator[Label]:
        for index, each in enumerate(state.stations):
            if each != DEAD and self.cores.beliefs[each].asked:
                yield "answer", index, True
                yield "answer", index, False
        commander = self._standard_in_charge(state)
        if commander is not None:
            yield "consents", commander
        if self._on_ground(state) and self.vehicles[state.vehicle].view.commander is not None:
            yield ("start",)
        if not state.requests:
            return
        for wish in Request:
            if wish not in self.setting.wishes:
                continue
            for index in range(self.count):
                if self.alive(state, index):
                    if wish is Request.GIVE:
                        yield from (("request", index, wish, to) for to in range(self.count) if to != index)
                    else:
                        yield "request", index, wish, index

    def _standard_in_charge(self, state: State) -> int | None:
        """The commander, if it speaks the standard only and is asked for its consent."""
        vehicle = self.vehicles[state.vehicle]
        view = vehicle.view
        if view.partner is None or view.commander is None or vehicle.packed is None or vehicle.books.agreed:
            return None
        index = self.sysids.index(view.commander)
        return index if self.stations[index].standard else None

    def _on_ground(self, state: State | _Draft) -> bool:
        return self.setting.path[state.position].startswith("_")

    def _faults(self, state: State, waiting: list[int]) -> Iterator[Label]:
        kinds = self.setting.kinds
        for kind in (Fault.LOSE, Fault.DOUBLE, Fault.HOLD):
            if kind in kinds:
                yield from (("fault", kind, channel) for channel in waiting)
        for kind in (Fault.RESTART_STATION, Fault.KILL_STATION):
            if kind in kinds:
                yield from (("fault", kind, index) for index, each in enumerate(state.stations) if each != DEAD)
        up = self.vehicles[state.vehicle].packed is not None
        for kind in (Fault.RESTART_VEHICLE, Fault.KILL_VEHICLE, Fault.BLANK_VEHICLE):
            if kind in kinds and up:
                yield "fault", kind, -1
        if Fault.CUT in kinds:
            yield from (("fault", Fault.CUT, n) for n in range(len(self.channels)) if n not in state.cuts)
        if Fault.LIE in kinds and up and self.vehicles[state.vehicle].view.partner is not None:
            for index, each in enumerate(state.stations):
                if each != DEAD:
                    yield from (("fault", Fault.LIE, index, word) for word in LIES)

    # ---- one step ---------------------------------------------------------------------------------------------------

    def follow(self, state: State, label: Label) -> State:
        """Where this step leads."""
        what = label[0]
        if what == "tick":
            return self._later(state)
        draft = _Draft(state)
        if what == "deliver":
            channel = label[1]
            event, *rest = draft.queues[channel]
            draft.queues[channel] = tuple(rest)
            self._arrive(draft, channel, event)
        elif what == "deliver late":
            draft.held.remove(label[1:])
            self._arrive(draft, *label[1:])
        elif what == "move":
            draft.position += 1
            self._to_vehicle(draft, self._autopilot[draft.position])
            self._to_vehicle(draft, self._places[draft.position])
        elif what == "station returns":
            draft.stations[label[1]] = self._fresh[label[1]]
        elif what == "vehicle returns":
            self._revive(draft)
        elif what == "heal":
            draft.cuts = tuple(channel for channel in draft.cuts if channel != label[1])
        elif what == "answer":
            self._to_station(draft, label[1], self.events(gcs.Answer(label[2])))
        elif what == "consents":
            self._request(draft, label[1], Request.ALLOW, label[1])
        elif what == "start":
            self._start(draft)
        elif what == "request":
            draft.requests -= 1
            self._request(draft, *label[1:])
        else:
            draft.faults -= 1
            self._befall(draft, *label[1:])
        return draft.done()

    def _arrive(self, draft: _Draft, channel: int, event: int) -> None:
        receiver = self.channels[channel][1]
        if channel in draft.cuts:
            return
        if receiver < 0:
            self._to_vehicle(draft, event)
        else:
            self._to_station(draft, receiver, event)

    def _revive(self, draft: _Draft, *, blank: bool = False) -> None:
        draft.vehicle, shift = self.vehicles.up(draft.vehicle, blank=blank)
        self._rebase(draft, shift)

    def _request(self, draft: _Draft, index: int, wish: Request, other: int) -> None:
        sysid = self.sysids[index]
        if wish is Request.WISH:
            self._to_station(draft, index, self.events(gcs.Wish(sysid)))
        elif self._cut(draft, index, -1):
            return
        elif wish is Request.CANCEL:
            self._to_vehicle(draft, self.events(Cancel(sysid)))
        else:
            asks, allows = wish is not Request.RELEASE, wish is Request.ALLOW
            self._to_vehicle(draft, self.events(ControlRequested(sysid, asks, allows, 10.0, self.sysids[other])))

    def _befall(self, draft: _Draft, kind: Fault, which: int, word: str = "") -> None:
        if kind in (Fault.LOSE, Fault.DOUBLE, Fault.HOLD):
            event, *rest = draft.queues[which]
            draft.queues[which] = tuple(rest)
            if kind is not Fault.LOSE:
                draft.held.append((which, event))
            if kind is Fault.DOUBLE:
                self._arrive(draft, which, event)
        elif kind is Fault.RESTART_STATION:
            draft.stations[which] = self._fresh[which]
        elif kind is Fault.KILL_STATION:
            draft.stations[which] = DEAD
            self._clear(draft, which)
        elif kind is Fault.KILL_VEHICLE:
            draft.vehicle = self.vehicles.down(draft.vehicle)
            self._clear(draft, -1)
        elif kind in (Fault.RESTART_VEHICLE, Fault.BLANK_VEHICLE):
            draft.vehicle = self.vehicles.down(draft.vehicle)
            self._revive(draft, blank=kind is Fault.BLANK_VEHICLE)
        elif kind is Fault.CUT:
            draft.cuts = tuple(sorted((*draft.cuts, which)))
            draft.queues[which] = ()
        else:
            self._lie(draft, which, LIES[word])

    def _clear(self, draft: _Draft, receiver: int) -> None:
        """What is on its way to somebody dead is lost."""
        for channel, (_sender, to) in enumerate(self.channels):
            if to == receiver:
                draft.queues[channel] = ()

    def _lie(self, draft: _Draft, index: int, word: Callable[[TransferKey], Any]) -> None:
        state = self.vehicles[draft.vehicle]
        view, had = state.view, state.books.had
        if view.partner is None or had is None:
            return
        key = TransferKey(had, view.partner, view.handover_id, view.epoch)
        draft.work.append(Parcel(index, -1, self.events(StationMessage(self.sysids[index], word(key)))))
        self._send_off(draft)

    # ---- after the last fault ---------------------------------------------------------------------------------------

    def healed(self, state: State, *, revived: bool) -> State:
        """Nothing is cut any more, the companion runs, nothing more goes wrong; `revived`: stations live again."""
        draft = _Draft(state)
        draft.cuts, draft.faults, draft.requests = (), 0, 0
        if self.vehicles[draft.vehicle].packed is None:
            self._revive(draft)
        if revived:
            draft.stations = [fresh if each == DEAD else each for each, fresh in zip(draft.stations, self._fresh)]
        return draft.done()

    def next_quietly(self, state: State) -> Label:
        """The one step that comes next when nothing goes wrong: what is late, what waits, operators' yes, a tick."""
        for channel, event in state.held:
            return "deliver late", channel, event
        for channel, queue in enumerate(state.queues):
            if queue:
                return "deliver", channel
        for index, each in enumerate(state.stations):
            if each != DEAD and self.cores.beliefs[each].asked:
                return "answer", index, True
        commander = self._standard_in_charge(state)
        return ("tick",) if commander is None else ("consents", commander)

    def check(self, state: State) -> None:
        """What must hold between vehicle and stations."""
        key = (state.vehicle, state.stations)
        if key in self._agreeing:
            return
        vehicle = self.vehicles[state.vehicle]
        beliefs = [self.cores.beliefs[each] for each in state.stations if each != DEAD]
        check_beliefs(vehicle.view.commander, EPOCH, vehicle.books.blank, beliefs)
        self._agreeing.add(key)

    # ---- for people -------------------------------------------------------------------------------------------------

    def describe(self, label: Label) -> str:
        """One step in words."""
        what, *rest = label
        if what == "deliver late":
            sender, receiver = (self._name(end) for end in self.channels[rest[0]])
            return f"late {sender} -> {receiver}: {self.events.values[rest[1]]}"
        if what in ("deliver", "heal"):
            sender, receiver = (self._name(end) for end in self.channels[rest[0]])
            return f"{what} {sender} -> {receiver}"
        if what == "fault":
            kind, which, *word = rest
            on_channel = kind in (Fault.LOSE, Fault.DOUBLE, Fault.HOLD, Fault.CUT)
            ends = self.channels[which] if on_channel else (which,)
            return " ".join((f"FAULT {kind.name}", " -> ".join(self._name(end) for end in ends), *word))
        if what == "request":
            index, wish, other = rest
            return f"request of {self._name(index)}: {wish.value}" + ("" if other == index else f" {self._name(other)}")
        return " ".join((what, *(self._name(each) if each.__class__ is int else str(each) for each in rest)))
