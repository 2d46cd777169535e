# SPDX-License-Identifier: GPL-3.0-or-later

"""The event log of a flight: entries of the journal and lines of the console.

Every sentence of the vehicle's journal is here. Each kind of entry has one method, which takes names and values, so the
words are always the same. The log decides nothing, and only copies as text what arrived in a frame.

Entries that a station's frames cause are sampled for each station (`store/sampling.py`), so that no sender can fill the
journal. Unproven senders get less room than the station itself. In one hour, a station and a stranger in its name
together fill less than an eighth of the journal at worst. Frames without a valid signature have a journal of their own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Any

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.authority.steps import StepWords
from mavproxy_handover.core.common.events import Announce, Record, RehearsalMoved
from mavproxy_handover.core.common.messages import TransferMessage
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, Phase, Reason
from mavproxy_handover.core.safety.commands import Ruling
from mavproxy_handover.core.safety.energy import EnergyFact
from mavproxy_handover.core.safety.route import RouteNews
from mavproxy_handover.gate.feeds import FeedNews
from mavproxy_handover.gate.flush import Closing
from mavproxy_handover.gate.stale_streams import News, State
from mavproxy_handover.link.quality import LinkEvent
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.plan import FencePart
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.store.sampling import Sampler
from mavproxy_handover.wire import codec

__all__ = ["EventLog"]

_DISPLAY_MODE = {phase: phase.name.replace("_", "") for phase in Phase}
_CLOCK_STEP_S = 1.0
#: at most this many senders that use the companion's identity are named
_MOST_SENDERS = 8
#: refused frames: entries at once, and the interval (s) from then on; of an unproven sender, and of the station
_UNPROVEN, _PROVEN = (60, 2.0), (200, 0.5)
_ITS_OWN, _ANYBODYS = "refused frames", "refused frames without proof of their sender"
_STRANGERS = "refused frames in its name without a valid signature"
#: transfer messages, and requests without a result: far more than the worst handover needs
_SAID = (5000, 0.1)
#: texts about the sticks and setpoints of a station
_STREAMS = {
    State.REFUSED: "{kind} of {station} refused: it does not command",
    State.RAN_BEFORE: "{kind} of {station} refused: it ran before {station} had control",
    State.OBEYED: "{kind} of {station} has ended: obeyed from now on",
    State.ENDED: "{kind} of {station} has ended",
}
#: entries of the arbiter that a station can cause as often as it asks
_ANSWERS = ("control", "start_refused", "rehearsal_refused", "operator")
#: entries of the arbiter that name the operator on duty at their station
_OF_OPERATORS = ("operator", "control", "foreseen_answer", "start", "rehearsal_refused", "start_refused")
#: entries only for the journal: steps of a transfer, and entries that the sentence of a decision repeats
_UNSPOKEN = ("step", "emergency", "would", "emergency_over", "warning", "warning_over", "order", "helm")


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 2)


class EventLog:
    """The event log of one vehicle.

    `show` prints a console line. `phase` returns the phase in force. `strangers`: the journal of frames from unknown
    senders.
    """

    def __init__(
        self,
        vehicle: str,
        journal: Journal,
        strangers: Journal,
        arbiter: Arbiter,
        show: Callable[[str], None],
        phase: Callable[[], Phase],
    ) -> None:
        self._vehicle = vehicle
        self._journal = journal
        self._strangers = strangers
        self._arbiter = arbiter
        self._show = show
        self._phase = phase
        #: senders on the vehicle's side that used the companion's identity: system, component
        self._in_our_name: set[tuple[int, int]] = set()
        #: by station, and subject of the entries
        self._samplers: dict[tuple[str, str], Sampler] = {}
        self._clock_offset_s: float | None = None
        self._zones = (0, 0)
        self._steps = StepWords(arbiter.name)
        #: the commander that got the last telemetry
        self._telemetry_to = ""

    def tell(self, text: str) -> None:
        """Print a line on the console, in the form of the thesis."""
        stamp = time.strftime("%H:%M:%S")
        self._show(f"[{stamp}|{self._vehicle}][{_DISPLAY_MODE[self._phase()]}]: {text}")

    def _tell_sentence(self, text: str) -> None:
        self.tell(f"{text[:1].upper()}{text[1:].rstrip('.')}.")

    def _write_and_tell(self, event: str, text: str, **values: Any) -> None:
        """An entry of the journal, and its sentence on the console."""
        self._journal.write(event, text, **values)
        self._tell_sentence(text)

    # ---- the module -----------------------------------------------------------------------------------------------

    def loaded(self, version: str, configuration: str) -> None:
        """The module is loaded."""
        self._journal.write("loaded", f"handover {version}, configuration {configuration}", version=version)

    def started_again(self, why: str) -> None:
        """The supervisor has started the companion again. `why`: how the previous run ended."""
        self._journal.write("started_again", f"started again by the supervisor: {why}")
        self.tell(f"Started again by the supervisor: {why}.")

    def running_by(self, note: str) -> None:
        """What a restart continues with, and what it lacks."""
        self._journal.write("restart", note)
        self.tell(f"{note}.")

    def unloaded(self) -> None:
        """The module is unloaded."""
        self.sum_up(math.inf)
        self._journal.write("unloaded")

    def unsigned_allowed(self, names: str) -> None:
        """Stations without a key."""
        self._journal.write("unsigned_allowed", f"frames of {names} are taken unsigned")

    def replay_state(self, text: str) -> None:
        """A remark about the replay state that was found."""
        self._journal.write("replay_state", text)

    def fault(self, where: str, text: str) -> None:
        """A fault that costs one frame or one tick."""
        self._journal.write("fault", f"{where}: {text}")

    def failed_closed(self, text: str) -> None:
        """A fault that ends authority."""
        self._journal.write("failed_closed", text, reason="fault")

    def authority_ends(self, text: str) -> None:
        """Print on the console that a fault ends authority, after all that helps the aircraft is done."""
        self.tell(f"INTERNAL FAULT, authority ends here: {text.strip().splitlines()[-1]}")

    def clock(self, now: float) -> None:
        """Note in the journal that the wall clock was set. No rule uses that clock. `now`: monotonic seconds."""
        offset_s = time.time() - now
        if self._clock_offset_s is not None and abs(offset_s - self._clock_offset_s) > _CLOCK_STEP_S:
            step_s = offset_s - self._clock_offset_s
            self._journal.write("clock_step", f"the clock was set by {step_s:+.1f} s", step_s=round(step_s, 3))
        self._clock_offset_s = offset_s

    def sum_up(self, now: float) -> None:
        """Note how many entries were left out, once a minute; to be called each second."""
        for (station, what), sampler in self._samplers.items():
            count = sampler.left_out(now)
            if count:
                text = f"{count} more entries of {station} left out: {what}"
                journal = self._strangers if what == _STRANGERS else self._journal
                journal.write("left_out", text, station=station, what=what, count=count)

    def _sampler(self, station: str, what: str, bounds: tuple[int, float]) -> Sampler:
        sampler = self._samplers.get((station, what))
        if sampler is None:
            sampler = self._samplers[station, what] = Sampler(*bounds)
        return sampler

    def _has_room(self, station: str, now: float) -> bool:
        """Whether there is room for another entry that a station causes."""
        return self._sampler(station, "what it said and was told", _SAID).admit(now) is not None

    # ---- authority ------------------------------------------------------------------------------------------------

    def record(self, action: Record, now: float) -> None:
        """An entry that the arbiter asks for."""
        station = self._name(action.station)
        if action.event in _ANSWERS and station is not None and not self._has_room(station, now):
            return
        self._journal.write(
            action.event,
            action.text,
            reason=action.reason.name.lower() if action.reason is not Reason.NONE else None,
            station=station,
            duration_s=None if action.duration_s is None else round(action.duration_s, 4),
            handover_id=self._arbiter.view.handover_id if action.event.startswith(("transfer", "step")) else None,
            epoch=self._arbiter.view.epoch if action.event in ("transfer_committed", "authority") else None,
            operator=self._operator(action.station) if action.event in _OF_OPERATORS else None,
        )
        if action.event not in _UNSPOKEN:
            self._tell_sentence(action.text)
        if action.event == "zone_entered":
            self.zones(self._arbiter.zones())

    def decision(self, told: Announce) -> None:
        """A safety decision, or its end: the sentence that all stations get."""
        self._write_and_tell(
            "decision",
            told.text,
            action="none" if told.action is None else told.action.name.lower(),
            reason=told.reason.name.lower(),
            figures=told.figures or None,
            place=told.place or None,
        )

    def rehearsal(self, moved: RehearsalMoved) -> None:
        """A rehearsal has begun, or is over."""
        self._write_and_tell("rehearsal", moved.text, on=moved.on, reason=moved.reason.name.lower())

    def rehearsal_report(self, lines: Sequence[str], values: Mapping[str, Any]) -> None:
        """The results of a rehearsal, so far or at its end; `lines`: for the console."""
        self._journal.write("rehearsal_report", **values)
        for line in lines:
            self._show(line)

    def view(self, view: AuthorityView, reason: Reason) -> None:
        """A new view is in force."""
        self._journal.write(
            "view",
            phase=view.phase.name.lower(),
            commander=self._name(view.commander),
            partner=self._name(view.partner),
            epoch=view.epoch,
            lease=view.lease.name.lower(),
            reason=reason.name.lower(),
            rehearsal=view.rehearsal or None,
        )

    def message(
        self, direction: str, station: int, message: TransferMessage, now: float, attempt: int | None = None
    ) -> None:
        """A message of a transfer: "in", before it is handled, or "out"."""
        name = self._arbiter.name(station)
        if self._has_room(name, now):
            values = codec.values_of(message)
            operator = self._operator(station) if direction == "in" and values["consent"] is not None else None
            self._journal.write(
                "message", direction=direction, station=name, attempt=attempt, operator=operator, **values
            )
        if direction == "out":
            line = self._steps.sent(station, message, awaits_commander=self._arbiter.awaits_commander)
        else:
            line = self._steps.received(station, message, self._arbiter.view)
        if line:
            self.tell(line)

    def senseless(self, kind: str, station: str, now: float) -> None:
        """A message of a transfer with values that are not allowed, or about another vehicle."""
        if self._has_room(station, now):
            self._journal.write("dropped", f"{kind} of {station} is not valid", station=station)

    def request_not_understood(self, station: str, why: str, now: float) -> None:
        """A request of operator control that is not valid."""
        if self._has_room(station, now):
            self._journal.write("control", f"request of {station} not understood: {why}", station=station)

    def owner_asked(self, station: str, requester: str) -> None:
        """The commander is asked by the standard's command."""
        self._journal.write("notified", f"{station} is asked: may {requester} have control?", station=station)

    def restarted(self, owner: int | None, epoch: int, where: str, *, proven: bool) -> None:
        """A restart continues where the previous run ended. `where`: in flight, or in a rehearsal."""
        name = self._arbiter.name(owner)
        self._journal.write("restarted", f"restarted in {where}; {name} had authority", epoch=epoch, proven=proven)
        waits = f"waiting for {name}" if proven else f"{name} has to show that it still has authority"
        if owner is None:
            waits = "no station had authority"
        self.tell(f"Restarted in {where}, epoch {epoch}: {waits}.")

    def kept_elsewhere(self, text: str) -> None:
        """The state is not saved where it should be."""
        self._write_and_tell("state_kept", text)

    def state_lost(self, trouble: str) -> None:
        """The state file exists, but cannot be trusted."""
        self._journal.write("state_lost", trouble, reason="fault")
        self.tell(f"State file: {trouble}: no station commands.")

    def package_lost(self) -> None:
        """The mission package that was saved with the state is missing."""
        self._journal.write(
            "state_lost", "the mission package of the previous run is missing: no zones", reason="fault"
        )

    # ---- the gate -------------------------------------------------------------------------------------------------

    def accepted(self, station: str, what: str, word: str = "") -> None:
        """A command of the commander was accepted. Such entries are frequent, so they reach the file a moment later.

        `word`: START, STOP or CONTINUE, which the console shows; "": another command.
        """
        self._journal.note("accepted", station=station, what=what)
        if word:
            self.tell(f"{word} accepted from {station}.")

    def refused(
        self,
        station: str,
        kind: tuple[int, Enum],
        what: str,
        named: Callable[[], str],
        reason: str,
        answered: bool,
        proven: bool,
        now: float,
        word: str = "",
    ) -> None:
        """A frame was refused. `kind`: message and reason; `proven`: the station certainly sent it; `word`: as in
        `accepted`.

        `named` adds to `what`, for example the mode. It is called only if an entry is written.
        """
        sampler = self._samplers.get((station, _ITS_OWN if proven else _ANYBODYS))  # it may come to this very often
        if sampler is None:
            sampler = self._sampler(station, *((_ITS_OWN, _PROVEN) if proven else (_ANYBODYS, _UNPROVEN)))
        told = self._refused(self._journal, sampler, kind, station, what, named, reason, answered, now)
        if told and word:
            self.tell(f"{word} rejected from {station}: {reason}.")

    def rejected(self, station: str, kind: tuple[int, Enum], what: str, reason: str, now: float) -> None:
        """A frame in a station's name has no valid signature of that station."""
        sampler = self._sampler(station, _STRANGERS, _UNPROVEN)
        self._refused(self._strangers, sampler, kind, station, what, str, reason, False, now)

    @staticmethod
    def _refused(
        journal: Journal,
        sampler: Sampler,
        kind: tuple[int, Enum],
        station: str,
        what: str,
        named: Callable[[], str],
        reason: str,
        answered: bool,
        now: float,
    ) -> bool:
        """Whether an entry is written: of frames that come again and again few are."""
        kept_back = sampler.admit(now, kind)
        if kept_back is None:
            return False
        name = named()
        text = f"{f'{name} ({what})' if name else what} of {station} refused: {reason}"
        fields = {"station": station, "what": what, "named": name or None, "reason": reason, "answered": answered}
        journal.write("refused", text, **fields, also=kept_back or None)
        return True

    def told(self, station: str, text: str, now: float) -> None:
        """A station was told why something is refused."""
        if self._has_room(station, now):
            self._journal.write("told", text, station=station)

    def payload(self, holder: str, kinds: list[str], text: str) -> None:
        """Payload authority has moved; `holder`: a station or an onboard program, "" for none."""
        self._write_and_tell("payload", text, holder=holder or None, kinds=kinds)

    def onboard(self, program: str, text: str, **values: Any) -> None:
        """What concerns an onboard program: its link, and what is delegated to it."""
        self._write_and_tell("onboard", text, program=program, **values)

    def stream(self, station: str, news: News, now: float) -> None:
        """A station was told about its sticks or setpoints."""
        if self._has_room(station, now):
            text = _STREAMS[news.state].format(kind=news.kind, station=station)
            self._journal.write("stream", text, station=station, stream=news.kind, state=news.state.value)

    def feed(self, news: FeedNews) -> None:
        """A feed has another source, or a station's does not pass."""
        self._write_and_tell("feed", news.text, kind=news.kind.value, station=news.about, change=news.change.value)

    def remote_id(self, station: str, lat_deg: float, lon_deg: float, operator_id: str) -> None:
        """Remote ID has another operator."""
        self._journal.write(
            "remote_id", station=station, lat=round(lat_deg, 6), lon=round(lon_deg, 6), operator_id=operator_id or None
        )

    def remote_id_missing(self, station: str, text: str) -> None:
        """The place of the commander's operator is not known."""
        self._journal.write("remote_id", text, station=station)

    def terrain_refused(self, text: str) -> None:
        """The mission's heights of the ground are not sent to the autopilot."""
        self._write_and_tell("terrain", text)

    def command_refused(self, station: str, word: str, ruling: Ruling) -> None:
        """A command of the commander would leave energy, fence or coverage."""
        limits = [limit.value for limit in ruling.limits]
        text = f"{word} of {station} refused: {ruling.words}"
        self._write_and_tell("command_refused", text, station=station, limits=limits)

    def command_passed(self, station: str, word: str, ruling: Ruling) -> None:
        """A command that leaves a limit is carried out: an operator has lifted the limit, or its policy only warns."""
        limits = [limit.value for limit in ruling.limits]
        text = f"{word} of {station} {ruling.outcome.value}: {ruling.words}"
        self._write_and_tell(
            "command_passed", text, station=station, limits=limits, outcome=ruling.outcome.name.lower()
        )

    def override(self, limit: str, by: str, for_s: float) -> None:
        """An operator lifts a limit."""
        station = self._arbiter.view.commander
        operator = self._operator(station) if self._name(station) == by else None
        on_duty = f", on duty: {operator}" if operator else ""
        text = f"{by} lifts {limit} for {for_s:g} s{on_duty}"
        self._write_and_tell("override", text, by=by, limit=limit, for_s=for_s, operator=operator)

    def upload_refused(self, station: str, what: str, why: str, now: float) -> bool:
        """An upload of a station in flight was rejected, or is incomplete. Returns whether people are told.

        A program that repeats the upload without end causes one message each second.
        """
        kept_back = self._sampler(station, "rejected lists", _PROVEN).admit(now, (what, why))
        if kept_back is None:
            return False
        also = kept_back or None
        self._journal.write("upload_refused", f"{what} of {station}: {why}", station=station, also=also)
        self._tell_sentence(f"{what} of {station} rejected: {why}")
        return True

    def rerouted(self, station: str, items: int, commanders: Sequence[int]) -> None:
        """The commander has replaced the mission in flight."""
        names = " ".join(self._arbiter.name(each) for each in commanders)
        text = f"mission of {station} written in flight, read back, equal: {items} items"
        self._write_and_tell("rerouted", text, station=station, items=items, commanders=names)

    def found_in_flight(self, items: int, commanders: Sequence[int]) -> None:
        """After a restart in flight, the mission on the autopilot was read back. It is not the package's mission."""
        names = " ".join(self._arbiter.name(each) for each in commanders)
        text = f"the mission that is flown was read back: {items} items, not the package's"
        self._write_and_tell("found_in_flight", text, items=items, commanders=names)

    def closed(self, station: int, closing: Closing) -> None:
        """A transaction that `station` had open at the autopilot was closed."""
        name, incomplete = self._arbiter.name(station), closing.incomplete or None
        self._journal.write("flush", f"{closing.what} ({name})", station=name, incomplete=incomplete)

    def link(self, station: str, change: LinkEvent) -> None:
        """A change that the measurement of a link has found."""
        self._journal.write(
            "link",
            change.text,
            station=station,
            link=change.device,
            change=change.kind.value,
            measure=None if change.measure is None else change.measure.value,
            value=None if change.value is None else round(change.value, 3),
        )

    # ---- the aircraft ---------------------------------------------------------------------------------------------

    def mode(self, name: str) -> None:
        """The autopilot flies another mode."""
        self._journal.write("mode", f"mode {name}", mode=name)

    def waypoint(self, number: int) -> None:
        """The autopilot flies to another waypoint."""
        self._journal.write("waypoint", f"flying to waypoint {number}", number=number)

    def reached(self, number: int, owner: int | None, delivery: int | None) -> None:
        """A waypoint was reached. `owner`: the station that it belongs to; None: none. `delivery`: the delivery
        waypoint, if it is reached now."""
        station = self._name(owner)
        of = "" if station is None else f" of {station}"
        self._journal.write("reached", f"waypoint {number}{of} reached", number=number, station=station)
        if delivery is not None:
            self._journal.write("delivery", f"delivery point (waypoint {delivery}) reached", number=delivery)
            self.tell(f"Delivery point reached, waypoint {delivery}.")

    def zones(self, zones: tuple[int, int]) -> None:
        """The zones that hold the aircraft, as `Arbiter.zones`. The handover zone is told when it is entered."""
        before, self._zones = self._zones, zones
        if set(zones) == set(before):
            return
        zone, other = map(self._name, zones)
        if other is not None:
            text = f"Handover Zone ({zone} and {other})"
            self._write_and_tell("handover_zone", text, zone=zone, other_zone=other)

    def telemetry(self, commander: str) -> None:
        """The aircraft's telemetry goes to this commander; told when the commander changes."""
        if commander != self._telemetry_to:
            self._telemetry_to = commander
            text = f"telemetry goes to {commander}, once a second"
            self._write_and_tell("telemetry_to", text, station=commander)

    def position(
        self, where: tuple[float, float, float], zones: tuple[int, int], commander: int | None, waypoint: int
    ) -> None:
        """Where the aircraft is: latitude and longitude (degrees), height above home (m)."""
        lat_deg, lon_deg, alt_m = where
        self._journal.write(
            "position",
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=alt_m,
            zone=self._name(zones[0]),
            other_zone=self._name(zones[1]),
            commander=self._name(commander),
            waypoint=waypoint,
        )

    def position_source(self, text: str, source: str, standing: str) -> None:
        """The state of the position box. `source`: the position source that counts."""
        self._write_and_tell("position_source", text, source=source, standing=standing)

    def energy(self, fact: EnergyFact, *, aloud: bool) -> None:
        """Energy left, and the energy that flying costs. `aloud`: a trouble is new, so the console shows it."""
        model = fact.model
        wind = None if model is None else model.wind
        self._journal.write(
            "energy",
            fact.words(),
            left_wh=_rounded(fact.left_wh),
            power_w=_rounded(fact.power_w),
            hover_w=None if model is None else _rounded(model.hover_w),
            cruise_w=None if model is None else _rounded(model.cruise_w),
            airspeed_mps=None if model is None else _rounded(model.airspeed_mps),
            wind_mps=None if wind is None else _rounded(wind.speed_mps),
            wind_from_deg=None if wind is None else _rounded(wind.from_deg),
            wind_source=fact.wind_source or None,
            learned=fact.learned,
            trouble=list(fact.trouble) or None,
        )
        if aloud:
            self._tell_sentence(f"energy: {', '.join(fact.trouble)}")

    def energy_warning(self, shortfall: str) -> None:
        """The energy is too little for the mission, and START only warns of it; "": it is enough again."""
        text = f"energy: {shortfall}" if shortfall else "energy: the budget of the mission closes"
        self._write_and_tell("energy_budget", text, closes=not shortfall)

    def route(self, news: RouteNews) -> None:
        """The aircraft is off its route, or on it again."""
        fact = news.fact
        values = {} if fact is None else {"waypoint": fact.seq, "cross_track_m": round(fact.cross_track_m, 1)}
        course = None if fact is None or fact.course_off_deg is None else round(fact.course_off_deg)
        self._journal.write("off_route" if news.off else "on_route", news.text, course_off_deg=course, **values)

    def place(self, text: str, name: str, reachable: bool) -> None:
        """The autopilot's rally list holds another return site."""
        self._write_and_tell("place", text, place=name, reachable=reachable)

    def place_failed(self, why: str) -> None:
        """The return site could not be written to the autopilot's rally list."""
        text = f"the return site could not be written to the autopilot's rally list: {why}. The companion tries again"
        self._journal.write("place_failed", text)
        self._tell_sentence(f"WARNING: {text}")

    def rally_overwritten(self) -> None:
        """Another program has written the autopilot's rally list."""
        text = "another program has written the autopilot's rally list. The companion restores the return site"
        self._journal.write("rally_overwritten", text)
        self._tell_sentence(f"WARNING: {text}")

    def rally_list(self, count: int, station: str, now: float) -> None:
        """The commander has replaced the mission's rally points."""
        if not self._has_room(station, now):
            return
        text = f"{count} rally points of {station} replace the mission's for this flight"
        self._write_and_tell("rally_list", text, station=station, count=count)

    def bounced(self, name: str) -> None:
        """A return begins again, to another return site."""
        text = f"the return goes to {name} instead: GUIDED, then RTL again"
        self._write_and_tell("bounce", text, place=name)

    def autopilot_restarted(self, text: str) -> None:
        """The autopilot has started again."""
        self._write_and_tell("autopilot_restarted", text)

    def second_manager(self, component: int) -> None:
        """Another component of the vehicle claims to manage operator control."""
        text = f"component {component} also claims to be the system manager: switch its operator control off"
        self._write_and_tell("second_manager", text)

    def in_our_name(self, sender: tuple[int, int], what: str) -> None:
        """A sender on the vehicle's side uses the companion's identity.

        It is told once for each system and component, and for `_MOST_SENDERS` of them.
        """
        if sender in self._in_our_name or len(self._in_our_name) >= _MOST_SENDERS:
            return
        self._in_our_name.add(sender)
        system, component = sender
        text = f"{what} of {system}/{component} on the vehicle's side uses the companion's identity: not forwarded"
        self._write_and_tell("in_our_name", text, system=system, component=component, what=what)

    def preflight(self, text: str, parameter: str, fits: bool) -> None:
        """A finding of the check before flight. `parameter`: the parameter to change, "" if there is none."""
        self._journal.write("preflight", text, parameter=parameter or None, fits=fits)
        self.tell(f"Preflight: {text}." if fits else f"Preflight WARNING: {text}.")

    # ---- missions and orders of the companion ---------------------------------------------------------------------

    def package_received(self, mission: str, station: str) -> None:
        """A mission package is complete and valid."""
        self._journal.write("package_received", f"mission {mission!r} from {station}", station=station)
        self.tell(f"Mission {mission!r} received from {station}.")

    def package_returned(self, station: str, what: str) -> None:
        """In flight, the vehicle sends its package to a station that has none; `what`: the progress."""
        self._journal.write("package_returned", f"mission package for {station}: {what}", station=station)
        self.tell(f"Mission package for {station}: {what}.")

    def mission_written(self, package: MissionPackage, fence: Sequence[FencePart], cruise_mps: float) -> None:
        """The autopilot holds the plan of the package. `fence`, `cruise_mps`: in force, from the plan or not."""
        lists = "mission, return site and geofence" if package.route.fence else "mission and return site"
        self._journal.write("mission_written", f"{lists} written, read back, equal", cruise_mps=round(cruise_mps, 3))
        if fence and not package.route.fence:
            text = f"the plan has no geofence: the autopilot keeps the one that it has ({len(fence)} areas)"
            self._write_and_tell("own_fence", text, areas=len(fence))
        if not package.cruise_speed_named:
            checked = f"checked at {package.cruise_speed_mps:g}"
            text = f"the plan names no cruise speed: flown at {cruise_mps:g} m/s, {checked}"
            self._write_and_tell("own_speed", text)

    def list_changed(self, station: str, what: str, *, counted: bool) -> None:
        """A station's message changes a list of the autopilot on the ground. `what`: mission or geofence; `counted`: a
        mission was loaded until then."""
        text = f"{station} changes the {what} on the autopilot" + (". The companion judges it again" if counted else "")
        self._write_and_tell("list_changed", text, station=station, list=what)

    def changed_past(self, how: str) -> None:
        """The autopilot's mission or geofence was changed without the companion; `how` they differ."""
        text = f"the mission on the autopilot was changed without the companion: {how}"
        self._write_and_tell("changed_past", text)

    def mission_judged(self, station: str, items: int, commanders: Sequence[int], *, own: bool) -> None:
        """START flies a mission that a station wrote on the ground.

        `station`: "" if it is not known any more; `own`: the mission is the package's.
        """
        names = " ".join(self._arbiter.name(each) for each in commanders)
        text = f"mission of {items} items on the autopilot read back and judged: START flies it"
        self._write_and_tell(
            "mission_judged", text, station=station or None, items=items, commanders=names, own=own or None
        )

    def mission_rejected(self, station: str, what: str, why: str) -> None:
        """START does not fly the mission or geofence (`what`) that a station wrote on the ground."""
        self._journal.write("mission_rejected", why, station=station or None, list=what)
        self._tell_sentence(f"{what} on the autopilot is not flown: {why}")

    def mission_failed(self, why: str, source: str) -> None:
        """A mission package was not loaded. `source`: its sender, or "on board"."""
        self._journal.write("mission_failed", why, station=source)
        self.tell(f"mission not loaded: {why}")

    def start_asked(self, station: str, what: str, now: float) -> None:
        """The commander's START, which the companion itself carries out."""
        if self._has_room(station, now):
            self._journal.write("accepted", station=station, what=what)

    def start_begun(self, station: str, starts_by: str) -> None:
        """START is under way."""
        self._journal.write("start_sequence", starts_by, station=station)
        self.tell(f"START accepted from {station}.")

    def speed(self, speed_mps: float, failure: str | None) -> None:
        """The result of the order to fly at the mission's speed again."""
        text = failure or f"mission speed restored: {speed_mps:g} m/s"
        self._write_and_tell("speed", text, speed_mps=speed_mps, obeyed=failure is None)

    def flown(self, action: FlightAction, mode: str | None, failure: str | None) -> None:
        """The result of a safety order: the mode that the autopilot flies, or the reason why it does not."""
        text = failure or f"the autopilot flies {mode}"
        self._write_and_tell("fly", text, action=action.name.lower(), obeyed=failure is None)

    def _operator(self, station: int | None) -> str | None:
        """The operator on duty at a station, as it last said; None: it has named none."""
        return (self._arbiter.operator(station) or None) if station else None

    def _name(self, station: int | None) -> str | None:
        return self._arbiter.name(station) if station else None
