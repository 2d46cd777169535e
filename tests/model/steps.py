# SPDX-License-Identifier: GPL-3.0-or-later

"""All that can happen in a state of the world, and where it leads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from gcs_module import core as gcs
from mavproxy_handover.core.common.events import (
    AutopilotState,
    Cancel,
    ConditionsSeen,
    ControlRequested,
    LinkJudged,
    StartFinished,
    StartRequested,
    StationMessage,
)
from mavproxy_handover.core.common.messages import (
    DisconnectHandover,
    DroneConnected,
    OkHandover,
    OnHandover,
    TransferKey,
)
from tests.model.nodes import Parcel
from tests.model.setting import PARENT, Fault, Request
from tests.model.world import DEAD, Draft, State, World

__all__ = ["Graph", "Label"]

#: words that a confused station may say of the present transfer
LIES: dict[str, Callable[[TransferKey], Any]] = {
    "ON_HANDOVER": OnHandover,
    "OK_HANDOVER": OkHandover,
    "DRONE_CONNECTED": DroneConnected,
    "DISCONNECT_HANDOVER": DisconnectHandover,
}
GROUND_LIES = ("ON_HANDOVER", "DRONE_CONNECTED")

#: What happens between two states: a word, and what it happens to.
Label = tuple[Any, ...]


class Graph(World):
    """The world of a setting as a graph: from each state the steps that can be made."""

    # ---- how it begins ----------------------------------------------------------------------------------------------

    def root(self) -> State:
        """GCSA commands, the mission is loaded; in the air unless the path begins on the ground."""
        setting = self.setting
        queues: tuple[tuple[int, ...], ...] = ((),) * len(self.channels)
        state = State(self.vehicles.new(), self._fresh, queues, (), 0, (), 0, 0)
        aloft, self._autopilot[0] = self._autopilot[0], self.events(AutopilotState(armed=False, flying=False))
        state = self._quiet(state, 2)
        draft = Draft(state)
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

    def _start(self, draft: Draft) -> None:
        """The commander brings the mission, if need be, and sends START; the autopilot plays along."""
        if not self.vehicles[draft.vehicle].loaded:
            self._to_vehicle(draft, self._mission)
        commander = self.vehicles[draft.vehicle].view.commander
        self._to_vehicle(draft, self._guard)
        for shown in self._shown:
            self._to_vehicle(draft, shown)
        self._to_vehicle(draft, self.events(StartRequested(commander or 0)))
        self._to_vehicle(draft, self.events(AutopilotState(armed=True, flying=False)))
        self._to_vehicle(draft, self.events(StartFinished(ok=True)))
        if self._on_ground(draft) and draft.position + 1 < len(self.setting.path):
            draft.position += 1
            self._to_vehicle(draft, self._autopilot[draft.position])
            self._to_vehicle(draft, self._places[draft.position])

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
        for sysid in sorted(self.vehicles[state.vehicle].books.weak):
            yield "links good", sysid - PARENT

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

    def _on_ground(self, state: State | Draft) -> bool:
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
        if Fault.DEAF in kinds:
            downlinks = [n for n, (sender, _receiver) in enumerate(self.channels) if sender < 0]
            yield from (("fault", Fault.DEAF, n) for n in downlinks if n not in state.cuts)
        if Fault.WEAK in kinds and up:
            weak = self.vehicles[state.vehicle].books.weak
            yield from (("fault", Fault.WEAK, n) for n, sysid in enumerate(self.sysids) if sysid not in weak)
        if Fault.SHORT in kinds and up:
            books = self.vehicles[state.vehicle].books
            if books.flying and books.short is None:
                yield "fault", Fault.SHORT, -1
        if Fault.LIE in kinds and up and self.vehicles[state.vehicle].view.partner is not None:
            for index, each in enumerate(state.stations):
                if each != DEAD:
                    yield from (("fault", Fault.LIE, index, word, -1) for word in LIES)
                    others = (other for other, each in enumerate(state.stations) if other != index and each != DEAD)
                    yield from (("fault", Fault.LIE, index, word, other) for other in others for word in GROUND_LIES)

    # ---- one step ---------------------------------------------------------------------------------------------------

    def follow(self, state: State, label: Label) -> State:
        """Where this step leads."""
        what = label[0]
        if what == "tick":
            return self._later(state)
        draft = Draft(state)
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
        elif what == "links good":
            self._links(draft, label[1], weak=False)
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

    def _arrive(self, draft: Draft, channel: int, event: int) -> None:
        receiver = self.channels[channel][1]
        if channel in draft.cuts:
            return
        if receiver < 0:
            self._to_vehicle(draft, event)
        else:
            self._to_station(draft, receiver, event)

    def _revive(self, draft: Draft, *, blank: bool = False) -> None:
        draft.vehicle, shift = self.vehicles.up(draft.vehicle, blank=blank)
        self._rebase(draft, shift)

    def _request(self, draft: Draft, index: int, wish: Request, other: int) -> None:
        sysid = self.sysids[index]
        if wish in (Request.WISH, Request.REFUSED):
            self._to_station(draft, index, self.events(gcs.Wish(sysid)))
            self._to_station(draft, index, self.events(gcs.WishAnswered(sysid, accepted=wish is Request.WISH)))
        elif self._cut(draft, index, -1):
            return
        elif wish is Request.CANCEL:
            self._to_vehicle(draft, self.events(Cancel(sysid)))
        else:
            asks, allows = wish is not Request.RELEASE, wish is Request.ALLOW
            self._to_vehicle(draft, self.events(ControlRequested(sysid, asks, allows, 10.0, self.sysids[other])))

    def _befall(self, draft: Draft, kind: Fault, which: int, word: str = "", to: int = -1) -> None:
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
        elif kind in (Fault.CUT, Fault.DEAF):
            draft.cuts = tuple(sorted((*draft.cuts, which)))
            draft.queues[which] = ()
        elif kind is Fault.WEAK:
            self._links(draft, which, weak=True)
        elif kind is Fault.SHORT:
            self._to_vehicle(draft, self.events(ConditionsSeen(energy=True)))
        else:
            self._lie(draft, which, LIES[word], to)

    def _links(self, draft: Draft, index: int, *, weak: bool) -> None:
        self._to_vehicle(draft, self.events(LinkJudged(self.sysids[index], weak, False, "loss")))

    def _clear(self, draft: Draft, receiver: int) -> None:
        """What is on its way to somebody dead is lost."""
        for channel, (_sender, to) in enumerate(self.channels):
            if to == receiver:
                draft.queues[channel] = ()

    def _lie(self, draft: Draft, index: int, word: Callable[[TransferKey], Any], to: int) -> None:
        state = self.vehicles[draft.vehicle]
        view, had = state.view, state.books.had
        if view.partner is None or had is None:
            return
        message, sysid = word(TransferKey(had, view.partner, view.handover_id, view.epoch)), self.sysids[index]
        event = StationMessage(sysid, message) if to < 0 else gcs.FromPeer(sysid, message)
        draft.work.append(Parcel(index, to, self.events(event)))
        self._send_off(draft)

    # ---- after the last fault ---------------------------------------------------------------------------------------

    def healed(self, state: State, *, revived: bool) -> State:
        """Nothing is cut any more, the companion runs, nothing more goes wrong; `revived`: stations live again."""
        draft = Draft(state)
        draft.cuts, draft.faults, draft.requests = (), 0, 0
        if self.vehicles[draft.vehicle].packed is None:
            self._revive(draft)
        if revived:
            draft.stations = [self._fresh[n] if each == DEAD else each for n, each in enumerate(draft.stations)]
        return draft.done()

    def next_quietly(self, state: State) -> Label:
        """The one step that comes next when nothing goes wrong: what is late, what waits, operators' yes, a tick.

        A yes that is taken for no answer, because the question is new, is said again after a tick.
        """
        for channel, event in state.held:
            return "deliver late", channel, event
        for channel, queue in enumerate(state.queues):
            if queue:
                return "deliver", channel
        for index, each in enumerate(state.stations):
            label: Label = ("answer", index, True)
            if each != DEAD and self.cores.beliefs[each].asked and self.follow(state, label) != state:
                return label
        for sysid in sorted(self.vehicles[state.vehicle].books.weak):
            return "links good", sysid - PARENT
        label = ("consents", self._standard_in_charge(state))
        return ("tick",) if label[1] is None or self.follow(state, label) == state else label

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
            on_channel = kind in (Fault.LOSE, Fault.DOUBLE, Fault.HOLD, Fault.CUT, Fault.DEAF)
            ends = self.channels[which] if on_channel else (which,)
            said = (word[0], "to", self._name(word[1])) if word else ()
            return " ".join((f"FAULT {kind.name}", " -> ".join(self._name(end) for end in ends), *said))
        if what == "request":
            index, wish, other = rest
            return f"request of {self._name(index)}: {wish.value}" + ("" if other == index else f" {self._name(other)}")
        return " ".join((what, *(self._name(each) if each.__class__ is int else str(each) for each in rest)))
