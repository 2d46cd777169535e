# SPDX-License-Identifier: GPL-3.0-or-later

"""Beginning of a flight: by START, or by another way into the air. A restart of the companion: `companion/restart.py`.

`start_needs` is a pure and total function: from the state of the vehicle to the needs of START that are not met.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.authority.phases import PhaseCause
from mavproxy_handover.core.authority.transfer import Cause
from mavproxy_handover.core.authority.transfer_manager import TransferManager
from mavproxy_handover.core.common.events import Action, BeginStart, Record, StartFinished, StartRefused
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.model import Phase, Reason

__all__ = ["MIDWAY", "Start", "StartFacts", "refused", "start_needs"]

#: the refusal of a command that would begin the mission without START
MIDWAY: Final = ("on the ground a flight begins with START",)


@dataclass(frozen=True, slots=True)
class StartFacts:
    """State of the vehicle at a START. `station`: name of the station; `in_zone`: its zone holds the aircraft.

    `foreign`: what the autopilot says that it is, in words, if that is nothing that is flown here. `energy_short`: what
    the loaded mission lacks in energy, in words; `gaps_lack`: what its gaps do; `return_lacks`: why a return would not
    end on the ground; `aircraft_lacks`: why the mission is none for this aircraft; `heights_lack`: why it would not be
    flown at the heights that were checked; `guard_lacks`: why the guard does not watch over it; `box_lacks`: why the
    position box is not to be flown with. `rehearsing`: it is carried.
    """

    station: str
    commands: bool
    on_ground: bool
    mission_loaded: bool
    in_transfer: bool
    autopilot_alive: bool
    foreign: str
    guard_lacks: str
    position_known: bool
    in_zone: bool
    energy_short: str = ""
    gaps_lack: str = ""
    return_lacks: str = ""
    aircraft_lacks: str = ""
    #: why no mission is loaded, in words; "" if there is no more to say
    mission_lacks: str = ""
    heights_lack: str = ""
    box_lacks: str = ""
    rehearsing: bool = False
    #: why handovers of the route cannot have consent, in words
    consent_lacks: tuple[str, ...] = ()


def start_needs(facts: StartFacts) -> tuple[str, ...]:
    """What START still lacks, in words; empty when the aircraft may take off."""
    needs = []
    if not facts.commands:
        needs.append(f"{facts.station} does not command")
    if facts.rehearsing:
        needs.append("a rehearsal is under way: nothing arms")
    elif not facts.on_ground:
        needs.append("the vehicle is already flying or starting")
    if not facts.mission_loaded:
        needs.append(
            f"no mission loaded, because {facts.mission_lacks}" if facts.mission_lacks else "no mission loaded"
        )
    if facts.in_transfer:
        needs.append("a handover is under way")
    if not facts.autopilot_alive:
        needs.append("no autopilot")
    if facts.foreign:
        needs.append(f"{facts.foreign} is neither ArduCopter nor ArduPlane")
    if facts.aircraft_lacks:
        needs.append(facts.aircraft_lacks)
    if facts.guard_lacks:
        needs.append(facts.guard_lacks)
    if not facts.position_known:
        needs.append("no position")
    elif not facts.in_zone:
        needs.append(f"outside the zone of {facts.station}")
    if facts.box_lacks:
        needs.append(facts.box_lacks)
    needs += facts.consent_lacks
    if facts.energy_short:
        needs.append(f"energy: {facts.energy_short}")
    if facts.heights_lack:
        needs.append(f"heights: {facts.heights_lack}")
    if facts.return_lacks:
        needs.append(f"a return does not land: {facts.return_lacks}")
    if facts.gaps_lack:
        needs.append(f"gaps: {facts.gaps_lack}")
    return tuple(needs)


def refused(what: str, needs: tuple[str, ...]) -> str:
    """The words of a refusal of START, or of a command that is a part of it."""
    return f"{what} refused: {'; '.join(needs)}"


class Start:
    """START on its way, from the station's command to the edge's word that the aircraft is armed and in AUTO."""

    __slots__ = ("_authority", "_candidates", "_flight", "_transfer_manager")

    def __init__(
        self, authority: Authority, flight: Flight, candidates: Candidates, transfer_manager: TransferManager
    ) -> None:
        self._authority = authority
        self._flight = flight
        self._candidates = candidates
        self._transfer_manager = transfer_manager

    def needs(self, station: int, now: float, *, by_hand: bool = False, carried: bool = False) -> tuple[str, ...]:
        """What START from this station still lacks, in words; empty when the aircraft may take off.

        `by_hand`: not START, but a command that is a part of it; the one before may have armed already. `carried`: it
        is to be a rehearsal, which takes no energy, and no time of the guard's to cross a gap.
        """
        authority, flight = self._authority, self._flight
        loaded = bool(self._candidates.mission.digest)
        flown = loaded and not carried
        on_ground = authority.phase is Phase.ON_LOAD and not authority.starting
        return start_needs(
            StartFacts(
                station=authority.name(station),
                commands=authority.view.commander == station,
                on_ground=on_ground if by_hand else authority.waiting_for_start,
                mission_loaded=loaded,
                in_transfer=authority.transfer is not None and not authority.transfer.yields_to(Reason.GIVEN),
                autopilot_alive=flight.autopilot_alive(now),
                foreign=flight.foreign,
                guard_lacks="" if flight.guarded(now) else flight.guard_lacks(now),
                position_known=flight.position_known(now),
                in_zone=self._candidates.zones.holds(station),
                energy_short=flight.energy_short if flown else "",
                gaps_lack=flight.gaps_lack if flown else "",
                return_lacks=flight.return_lacks if flown else "",
                aircraft_lacks=flight.aircraft_lacks if flown else "",
                mission_lacks=flight.mission_lacks,
                heights_lack=flight.heights_lack if flown else "",
                box_lacks=flight.box_lacks,
                rehearsing=flight.rehearsing,
                consent_lacks=self._candidates.consent_lacks(),
            )
        )

    def requested(self, station: int, now: float, actions: list[Action]) -> None:
        """A station commands START."""
        needs = self.needs(station, now)
        if needs:
            actions.append(Record("start_refused", refused("START", needs), Reason.NOT_READY, station))
            actions.append(StartRefused(station, needs))
            return
        self._transfer_manager.move(Cause.PREEMPTED, now, actions)  # a request of another station: the commander flies
        self._authority.start_begun()
        actions.append(Record("start", f"START from {self._authority.name(station)}", station=station))
        actions.append(BeginStart(station))

    def by_hand(self, now: float, actions: list[Action]) -> None:
        """A part of START goes to the autopilot as a command of its own."""
        self._transfer_manager.move(Cause.PREEMPTED, now, actions)

    def finished(self, event: StartFinished, now: float, actions: list[Action]) -> None:
        """The edge went through the START sequence; what was given up meanwhile is over already."""
        if not self._authority.starting:
            return
        self._authority.start_over()
        if event.ok:
            self.enter_mission("armed and in AUTO", now, actions)
        else:
            text = f"START failed: {event.text}"
            actions.append(Record("start_failed", text, Reason.NOT_READY, self._authority.owner))

    def enter_mission(
        self, how: str, now: float, actions: list[Action], cause: PhaseCause = PhaseCause.STARTED
    ) -> None:
        """The aircraft flies, or is about to; or it is carried."""
        authority = self._authority
        self._transfer_manager.take_off(now, actions)
        authority.move_phase(cause)
        authority.resume_transfer_phase()
        self._candidates.zones.forget_entries()
        actions.append(Record("started", f"on mission: {how}", Reason.STARTED, authority.owner))
        authority.refresh(Reason.STARTED, actions)
