# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle and the stations as numbered states, and what an event does to each.

Both cores depend on nothing but their state and the event. So what an event does to a state is worked out once, by the
real object and under the eyes of `checks.py`, and looked up from then on: that makes an exploration fast.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from gcs_module import core as gcs
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.common.events import (
    Action,
    BeginStart,
    ControlAnswer,
    Event,
    Fly,
    NotifyOwner,
    Record,
    Send,
    StationHeard,
    StationMessage,
    Tick,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import (
    AuthorityView,
    LeaseState,
    Phase,
    StandingConsent,
    Station,
)
from mavproxy_handover.core.common.snapshot import Snapshot
from tests.model.canonical import EPOCH, GAP_S, MEMORY, NOW, NUMBER, STILL, Packed, Packer, Shift, shifted
from tests.model.checks import Books, Violation, check_vehicle, is_old
from tests.model.setting import PARENT
from tests.model.station_checks import StationBefore, StationBooks, check_station

__all__ = ["DIGEST", "Belief", "Names", "Parcel", "Stations", "VehicleState", "Vehicles", "too_old"]

DIGEST = b"mission"


class Names:
    """Numbers for equal values."""

    def __init__(self) -> None:
        self._number: dict[Hashable, int] = {}
        self.values: list[Any] = []

    def __call__(self, value: Hashable) -> int:
        number = self._number.setdefault(value, len(self.values))
        if number == len(self.values):
            self.values.append(value)
        return number


class Parcel(NamedTuple):
    """A message on its way: from and to a station's index, -1 for the vehicle; the number of its event."""

    sender: int
    receiver: int
    event: int


class Belief(NamedTuple):
    """What one state of a station shows. `commander`: as it believes; `asked`: a question waits for its operator."""

    station: int
    commander: int | None
    epoch: int
    asked: bool


class VehicleState(NamedTuple):
    """One state of the companion. `packed` None: it is down, and `snapshot` is what its state file holds."""

    packed: Packed | None
    snapshot: Snapshot | None
    view: AuthorityView
    books: Books
    #: it knows the mission
    loaded: bool = False


class Vehicles:
    """All states of the companion that have been seen."""

    def __init__(
        self,
        stations: tuple[Station, ...],
        limits: Limits,
        packer: Packer,
        events: Names,
        make_arbiter: Callable[..., Arbiter] = Arbiter,
    ) -> None:
        self._stations = stations
        self._standard = frozenset(station.sysid for station in stations if station.standard)
        self._automatic = frozenset(s.sysid for s in stations if s.consent is StandingConsent.AUTOMATIC)
        self._limits, self._packer, self._events, self._make = limits, packer, events, make_arbiter
        self._identity = Identity("drone", stations, PARENT)
        self._index = {station.sysid: index for index, station in enumerate(stations)}
        self._states = Names()
        self._steps: dict[tuple[int, int], tuple[int, tuple[Parcel, ...], Shift]] = {}
        self._laters: dict[int, int] = {}
        self._tick = events(Tick())
        #: what a person reads of the step that is being made; None: nobody does
        self.story: list[str] | None = None
        #: how often an arbiter has worked
        self.handled = 0

    def __getitem__(self, number: int) -> VehicleState:
        state: VehicleState = self._states.values[number]
        return state

    def __len__(self) -> int:
        return len(self._states.values)

    def new(self) -> int:
        """A companion that has never run before."""
        return self._number(self._make(self._identity, self._limits), Books(), EPOCH, NUMBER)[0]

    def _number(self, arbiter: Arbiter, books: Books, epoch: int = 0, number: int = 0) -> tuple[int, Shift]:
        """The number of this state, and how far the frame has moved. `epoch`, `number`: where its own count from."""
        snapshot = arbiter.snapshot()
        shift = Shift(0.0, snapshot.epoch - EPOCH, snapshot.handover_id - NUMBER)
        packed = self._packer.pack_arbiter(arbiter, shift)
        return self._states(
            VehicleState(packed, None, shifted(arbiter.view, shift), books, bool(arbiter.mission_digest))
        ), shift

    def later(self, number: int) -> int:
        """The same, one tick later."""
        result = self._laters.get(number)
        if result is None:
            state = self[number]
            packed, snapshot = state.packed, state.snapshot
            if packed is not None:
                packed = self._packer.pack_arbiter(self._packer.unpack_arbiter(packed), Shift(1.0))
            elif snapshot is not None:
                gap_since, held_since = snapshot.gap_since, snapshot.held_since
                snapshot = replace(
                    snapshot,
                    gap_since=None if gap_since is None else max(gap_since - 1.0, NOW - GAP_S),
                    held_since=None if held_since is None else max(held_since - 1.0, NOW - self._limits.hold_s),
                )
            books = state.books.later(self._limits)
            result = self._states(state._replace(packed=packed, snapshot=snapshot, books=books))
            self._laters[number] = result
        return result

    def down(self, number: int) -> int:
        """The companion dies: its state file is left."""
        state = self[number]
        if state.packed is None:
            return number
        snapshot = self._packer.unpack_arbiter(state.packed).snapshot()
        books = state.books.restarted(snapshot.phase, blank=False)
        return self._states(VehicleState(None, snapshot, AuthorityView(epoch=EPOCH, handover_id=NUMBER), books))

    def up(self, number: int, *, blank: bool = False) -> tuple[int, Shift]:
        """The companion starts from its state file, or without it."""
        state = self[number]
        arbiter = self._make(self._identity, self._limits, None if blank else state.snapshot)
        books = state.books.restarted(Phase.ON_LOAD, blank=True) if blank else state.books
        result, shift = self._number(arbiter, books)
        view = self[result].view
        if view.commander is not None:
            raise Violation(f"the restart itself grants authority to station {view.commander}")
        if not blank and shift.epoch != 1:
            raise Violation(f"the restart raises the epoch by {shift.epoch}")
        if self.story is not None:
            self.story.append(f"vehicle: {_of_view(arbiter.view)}")
        return result, shift

    def step(self, number: int, event: int) -> tuple[int, tuple[Parcel, ...], Shift]:
        """What the event does: the state after it, what is sent, how far the frame has moved."""
        result = self._steps.get((number, event))
        if result is None or self.story is not None:
            result = self._steps[number, event] = self._work(number, self._events.values[event])
        return result

    def _work(self, number: int, event: Event) -> tuple[int, tuple[Parcel, ...], Shift]:
        before = self[number]
        assert before.packed is not None
        arbiter = self._packer.unpack_arbiter(before.packed)
        actions = self._handle(arbiter, event)
        if self.story is not None:
            self._tell(actions)
        known = self._limits, self._standard, self._automatic
        books = check_vehicle(before.books, before.view, event, actions, arbiter.view, *known)
        if is_old(event, before.view, before.books):
            self._no_more_than_a_heartbeat(before, event, arbiter)
        after, shift = self._number(arbiter, books)
        if isinstance(event, StationMessage) and not getattr(event.message, "nonce", 0):
            self._twice_is_once(event, arbiter)
        return after, tuple(self._parcels(actions, shift)), shift

    def _handle(self, arbiter: Arbiter, event: Event) -> list[Action]:
        """One event, and what is due at once."""
        self.handled += 1
        actions = arbiter.handle(event, NOW)
        for _ in range(3):
            deadline = arbiter.next_deadline()
            if deadline is None or deadline > NOW:
                return actions
            actions += arbiter.handle(Tick(), NOW)
        raise Violation(f"what is due does not get done: the deadline stays at {deadline}")

    def _no_more_than_a_heartbeat(self, before: VehicleState, event: Event, arbiter: Arbiter) -> None:
        assert before.packed is not None
        assert isinstance(event, StationMessage)
        other = self._packer.unpack_arbiter(before.packed)
        self._handle(other, StationHeard(event.station))
        if self._packer.pack_arbiter(arbiter) != self._packer.pack_arbiter(other):
            raise Violation(f"{type(event.message).__name__} of another epoch or transfer changed something")

    def _twice_is_once(self, event: StationMessage, arbiter: Arbiter) -> None:
        once = self._packer.pack_arbiter(arbiter)
        self._handle(arbiter, event)
        if self._packer.pack_arbiter(arbiter) != once:
            raise Violation(f"{type(event.message).__name__} doubled changed something")

    def _parcels(self, actions: list[Action], shift: Shift) -> list[Parcel]:
        parcels = []
        for action in actions:
            if isinstance(action, Send):
                event: gcs.Event = gcs.FromVehicle(shifted(action.message, shift))
                parcels.append(Parcel(-1, self._index[action.station], self._events(event)))
            elif isinstance(action, ViewChanged):
                event = self.status(shifted(action.view, shift))
                parcels += [
                    Parcel(-1, index, self._events(event))
                    for index, station in enumerate(self._stations)
                    if not station.standard
                ]
        return parcels

    @staticmethod
    def status(view: AuthorityView) -> gcs.AuthorityHeard:
        """AUTHORITY_STATUS as a station hears it."""
        recovering = view.lease is LeaseState.RECOVERING
        return gcs.AuthorityHeard(
            view.phase, view.commander, view.partner, view.epoch, view.handover_id, recovering, view.why
        )

    def _tell(self, actions: list[Action]) -> None:
        assert self.story is not None
        for action in actions:
            if isinstance(action, Record):
                self.story.append(f"vehicle: {action.text}")
            elif isinstance(action, ViewChanged):
                self.story.append(f"vehicle: {_of_view(action.view)}")
            elif isinstance(action, (Fly, BeginStart, NotifyOwner, ControlAnswer)):
                self.story.append(f"vehicle: {action}")


def _of_view(view: AuthorityView) -> str:
    partner = f", partner {view.partner}" if view.partner else ""
    who = view.commander or "nobody"
    return f"gate: {who} commands, epoch {view.epoch}{partner}, {view.phase.name}, lease {view.lease.name}"


class Stations:
    """All states that stations have been seen in."""

    def __init__(
        self,
        stations: tuple[Station, ...],
        automatic: Mapping[int, Collection[str]],
        packer: Packer,
        events: Names,
        make_station: Callable[..., gcs.StationCore] = gcs.StationCore,
    ) -> None:
        self._stations, self._automatic, self._packer, self._events = stations, automatic, packer, events
        self._make = make_station
        self._index = {station.sysid: index for index, station in enumerate(stations)}
        self._states = Names()
        self._steps: dict[tuple[int, int], tuple[int, tuple[Parcel, ...]]] = {}
        self._laters: dict[int, int] = {}
        self._rebased: dict[tuple[int, Shift], int] = {}
        #: by number of the state
        self.beliefs: list[Belief] = []
        self.story: list[str] | None = None
        self.handled = 0

    def __len__(self) -> int:
        return len(self._states.values)

    def new(self, index: int) -> int:
        """A station that has just started, with the mission package."""
        station = self._stations[index]
        peers = tuple(other for other in self._stations if other is not station)
        core = self._make(station, "drone", peers, automatic=self._automatic[station.sysid])
        core.handle(gcs.MissionHeld(DIGEST), NOW)
        return self._number(index, core, StationBooks())

    def _number(self, index: int, core: gcs.StationCore, books: StationBooks, shift: Shift = STILL) -> int:
        number = self._states((index, self._packer.pack_station(core, shift), shifted(books, shift)))
        if number == len(self.beliefs):
            sysid = self._stations[index].sysid
            self.beliefs.append(Belief(sysid, core.commander, core.epoch - shift.epoch, core.question is not None))
        return number

    def _core(self, number: int) -> tuple[int, gcs.StationCore, StationBooks]:
        index, packed, books = self._states.values[number]
        return index, self._packer.unpack_station(packed), books

    def later(self, number: int) -> int:
        """The same, one tick later."""
        result = self._laters.get(number)
        if result is None:
            index, core, books = self._core(number)
            core.tick(NOW + 1.0)
            result = self._laters[number] = self._number(index, core, books, Shift(1.0))
        return result

    def rebased(self, number: int, shift: Shift) -> int:
        """The same, in a frame moved by `shift`."""
        result = self._rebased.get((number, shift))
        if result is None:
            index, core, books = self._core(number)
            result = self._rebased[number, shift] = self._number(index, core, books, shift)
        return result

    def step(self, number: int, event: int) -> tuple[int, tuple[Parcel, ...]]:
        """What the event does: the state after it, and what is sent."""
        result = self._steps.get((number, event))
        if result is None or self.story is not None:
            result = self._steps[number, event] = self._work(number, self._events.values[event])
        return result

    def _work(self, number: int, event: gcs.Event) -> tuple[int, tuple[Parcel, ...]]:
        self.handled += 1
        index, core, books = self._core(number)
        sysid = self._stations[index].sysid
        before = StationBefore(sysid, self._automatic[sysid], core.epoch, core.question)
        actions = core.handle(event, NOW)
        if self.story is not None:
            self.story += [
                f"{self._stations[index].name}: {action.text}" for action in actions if isinstance(action, gcs.Notice)
            ]
        books = check_station(books, before, event, actions, core)
        parcels = []
        for action in actions:
            if isinstance(action, gcs.ToVehicle):
                parcels.append(Parcel(index, -1, self._events(StationMessage(sysid, action.message))))
            elif isinstance(action, gcs.ToPeer):
                heard = gcs.FromPeer(sysid, action.message)
                parcels.append(Parcel(index, self._index[action.peer], self._events(heard)))
        return self._number(index, core, books), tuple(parcels)


def too_old(event: Any) -> bool:
    """Whether a message is older than the exploration remembers."""
    message = getattr(event, "message", event)
    key = getattr(message, "key", None)
    epoch = key.epoch if key is not None else getattr(message, "epoch", EPOCH)
    number = key.handover_id if key is not None else NUMBER
    return epoch < EPOCH - MEMORY or number < NUMBER - MEMORY
