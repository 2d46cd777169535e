# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion: turns frames and ticks into events, and gives them to the rules one at a time.

The rules decide about authority (`core/`), the gate decides which frames pass (`gate/`). The companion decides what to
do when something breaks. A fault of the rules ends authority for the rest of the run (`fail_closed.py`). So does 5 s of
flight in which positions cannot be compared with the zones. A fault in one frame costs that frame.

MAVProxy is not known here: `module.py` hands in a function that writes to the autopilot, the messages that come from
there, and the time.
"""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable
from math import inf
from typing import Any, Final, TypeVar

from pymavlink import mavutil
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.companion.assembly import Hub, base_of, parts_of
from mavproxy_handover.companion.beacons import BEAT_S
from mavproxy_handover.companion.edge import Edge
from mavproxy_handover.companion.event_queue import EventQueue
from mavproxy_handover.config.running import Running
from mavproxy_handover.core.common import events
from mavproxy_handover.core.common.model import AuthorityView
from mavproxy_handover.gate.judge import Fate
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.rows import classify
from mavproxy_handover.link.quality import LinkEvent
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.tools.schedule import Schedule, attempt
from mavproxy_handover.wire import status
from mavproxy_handover.wire.frames import Frame, checked_types, parse_one
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID

__all__ = ["Companion"]

T = TypeVar("T")

#: accepted commands are in the journal this much later (s) at most, while the main loop runs
_JOURNAL_S: Final = 0.2
_HEARTBEAT: Final = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_CONTROL_STATUS: Final = mavlink.MAVLINK_MSG_ID_CONTROL_STATUS
#: classes whose frames change something: they are in the journal
_CHANGES: Final = frozenset((Access.COMMAND, Access.SAFEGUARD))
#: the longest time (s) in flight in which positions cannot be compared with the zones
_UNJUDGED_S: Final = 5.0
#: no time: the rules must be asked
_UNKNOWN: Final = -inf


class Companion:
    """One vehicle's companion. Times are monotonic seconds; not safe for threads."""

    def __init__(self, running: Running, ports: dict[int, StationPort], edge: Edge) -> None:
        """Raises OSError: the journal cannot be written, and it is no restart."""
        self.config = running.config
        self.ports = ports
        #: since when positions cannot be compared with the zones
        self._unjudged_at = inf
        self.failed = False
        #: the next deadline of the rules, inf: none; only events change it
        self._due_at = _UNKNOWN
        #: MAVProxy's messages whose CRC is checked already: MAVProxy may have loaded another dialect
        self._checked = checked_types(mavutil.mavlink) | checked_types(mavlink)
        self._queue: EventQueue[float] = EventQueue(self._apply_event, self._begin_order)
        self._base = base = base_of(running, ports, edge)
        self.journal, self.arbiter, self.event_log = base.journal, base.arbiter, base.event_log
        hub = Hub(self.handle, self.fail_closed, self._send_lease, self._grounded)
        self._parts = parts = parts_of(running, base, edge, hub)
        self.autopilot, self.gate, self.operator = parts.autopilot, parts.gate, parts.operator
        self.onboard = parts.onboard.programs
        self.rehearsal = parts.operator.rehearsal
        jobs = [
            ("send_lease", self._send_lease, status.LEASE_INTERVAL_S),
            ("send_authority_status", parts.beacons.send_authority_status, 0.5),
            ("each_second", parts.each_second.run, 1.0),
            ("payload", parts.operator.payload.each_second, 1.0),
            ("onboard programs", self.onboard.each_second, 1.0),
            ("journal", lambda _now: self.journal.flush(), _JOURNAL_S),
            ("package_return", self._return_packages, 0.25),
        ]
        self._schedule = Schedule(jobs, self.fault)
        self._resume(edge.clocks.monotonic())

    def _resume(self, now: float) -> None:
        """Go on where the previous run ended, if this is a restart in flight."""
        restart, mission = self._base.restart, self.autopilot.mission
        package = restart.resume(self.arbiter, self.event_log)
        if package is not None:
            mission.restore(package, now)
            self._base.packages.lay_beside_journal(package)
        if restart.restored is not None:
            self.autopilot.energy.resume(restart.restored.packs, now)
            if restart.restored.kept:
                mission.restore_upload(restart.kept_by(), now)

    @property
    def view(self) -> AuthorityView:
        """The authority in force, by which the gate judges."""
        return self.gate.view

    @property
    def decision(self) -> str:
        """What is done about what is wrong, in one sentence; "": nothing is wrong."""
        return self._parts.news.announcer.text

    @property
    def faults(self) -> Counter[str]:
        """The number of internal faults, by where they happened."""
        return self._base.faults.counts

    # ---- from the stations ----------------------------------------------------------------------------------------

    def on_station(self, port: StationPort, frames: list[Frame], now: float) -> None:
        """Frames that came in on a link of `port`; the journal has those that were rejected there."""
        while port.rejected:
            frame, signature = port.rejected.popleft()
            what = classify(frame).what  # the text of a sender that is not known to be the station
            self.event_log.rejected(port.name, (frame.msgid, signature), what, signature.value, now)
        # after a stall, authority that has run out ends first. In nearly all cases the first comparison is the only one
        if now >= self._due_at and self._is_due(now):
            if self.autopilot.aircraft.uncompared:  # the position came before the frames
                self.check_zones(now)
            self.handle(events.Tick(), now)
        gate = self.gate
        for frame in frames:
            try:
                if gate.sign_of_life(port, frame):
                    port.record_heartbeat(frame, now)
                    self.handle(events.StationHeard(port.sysid), now)
                verdict = gate.up(port, frame, now)
                if verdict.fate is not Fate.FORWARD or verdict.access in _CHANGES:
                    self.operator.services.follow_up(port, frame, verdict, now)
            except Exception:
                self.fault("frame of a station", traceback.format_exc(limit=-3))

    def on_links(self, port: StationPort, changes: list[LinkEvent], now: float) -> None:
        """What was measured on a station's links."""
        for change in changes:
            self.event_log.link(port.name, change)
            self.handle(events.LinkJudged(port.sysid, port.weak, port.attacked, change.text), now)

    # ---- from the autopilot ---------------------------------------------------------------------------------------

    def on_autopilot(self, message: Any, now: float) -> None:
        """A message that MAVProxy received from the vehicle's side."""
        frame = parse_one(message.get_msgbuf(), proven=type(message) in self._checked)
        if frame is None:
            return
        if frame.sysid == self.config.sysid and frame.known:
            if frame.compid == AUTOPILOT_COMPID:
                self.autopilot.messages.on_message(message, now)
                if self.autopilot.guard.asks:
                    self._send_lease(now)
            if frame.msgid == _CONTROL_STATUS:
                self.autopilot.messages.second_manager(frame)
        self.onboard.hear(frame, now)
        if self._parts.terrain.takes(frame, now):
            return
        if not self.gate.down(frame, now):
            self.event_log.in_our_name((frame.sysid, frame.compid), classify(frame).what)
        elif (frame.msgid, frame.sysid, frame.compid) == (_HEARTBEAT, self.config.sysid, AUTOPILOT_COMPID):
            self._parts.beacons.beat_stations(now, BEAT_S)

    def check_zones(self, now: float) -> None:
        """Compare the newest position with the zones; to be called soon after it came.

        Not at once: this is the longest job, and stations' frames that came meanwhile go first.
        """
        try:
            self.autopilot.zones.update(now)
        except Exception:
            self._not_checked(traceback.format_exc(limit=-3), now)
        else:
            self._unjudged_at = inf

    def _not_checked(self, text: str, now: float) -> None:
        """One fault costs a position. If it goes on in flight, the end of coverage would not be noticed."""
        self.fault("zone check", text)
        self._unjudged_at = min(self._unjudged_at, now)
        if now - self._unjudged_at >= _UNJUDGED_S and self.autopilot.aircraft.flying and not self.failed:
            self.fail_closed(f"positions cannot be compared to the zones: {text}", now)

    # ---- time -----------------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """To be called often (the module: 20 times a second). A fault in one job costs that job only."""
        self._attempt("gate", self.gate.tick, now)
        self._attempt("autopilot", self.autopilot.rounds.tick, now)
        if self._is_due(now):
            self.handle(events.Tick(), now)
        self._attempt("remote id", self._parts.remote_id.tick, now)
        self._attempt("delegation", self._parts.onboard.delegating.tick, now)
        self._attempt("terrain", self._parts.terrain.tick, now)
        self._attempt("briefing", self.operator.briefing.tick, now)
        self._attempt("rehearsal", self.rehearsal.tick, now)
        self._schedule.run(now)

    def _is_due(self, now: float) -> bool:
        if self.failed:
            return False
        if self._due_at == _UNKNOWN:
            deadline = self._asked("its deadline", self.arbiter.next_deadline, None, now)
            self._due_at = inf if deadline is None else deadline
        return now >= self._due_at

    def _asked(self, what: str, ask: Callable[[], T], otherwise: T, now: float) -> T:
        """An answer of the rules; `otherwise` if they fail: then they do not judge any more."""
        if self.failed:
            return otherwise
        try:
            return ask()
        except Exception:
            self.fail_closed(f"arbiter failed on {what}: {traceback.format_exc(limit=-3)}", now)
            return otherwise

    def _return_packages(self, now: float) -> None:
        package, flying = self.autopilot.mission.flown.package, self.autopilot.aircraft.flying
        self.operator.package_return.tick(None if self.failed else package, flying, now)

    def _send_lease(self, now: float) -> None:
        alone_s = self._asked("the way alone", lambda: self.arbiter.alone_s(now), 0.0, now)
        if not self.failed:
            self._parts.beacons.send_lease(alone_s)

    def _grounded(self, now: float) -> bool:
        return self._asked("whether it is on the ground", lambda: self.arbiter.grounded(now), False, now)

    # ---- the rules ------------------------------------------------------------------------------------------------

    def handle(self, event: events.Event, now: float) -> None:
        """Append an event to the queue, and handle all that wait (`EventQueue` has the order).

        While an event is handled, this only appends. After `fail_closed` no event is handled.
        """
        if not self.failed:
            self._queue.put(event, now)

    def _apply_event(self, event: events.Event, now: float) -> None:
        """Give one event to the rules and carry out their actions."""
        self._due_at = _UNKNOWN
        try:
            actions = self.arbiter.handle(event, now)
        except Exception:
            self.fail_closed(f"arbiter failed on {type(event).__name__}: {traceback.format_exc(limit=-3)}", now)
            return
        for action in actions:
            if self.failed:
                return
            self._attempt(f"action {type(action).__name__}", self._parts.actions.perform, action, now)

    def _begin_order(self, now: float) -> None:
        """All events are handled: the autopilot gets the last order, if there is one."""
        orders = self.autopilot.orders
        if orders.ordered is not None:  # after most events there is none
            self._attempt("action Fly", orders.begin, now)

    def fail_closed(self, text: str, now: float) -> None:
        """End authority (`fail_closed.py`). Events that wait are dropped, and no event is handled afterwards."""
        self.failed = True
        self._queue.clear()
        self._parts.closing.end_authority(text, now)

    def fault(self, where: str, text: str) -> None:
        """Something broke that costs one frame or one tick."""
        self._base.faults.report(where, text)

    def _attempt(self, where: str, job: Callable[..., None], *arguments: Any) -> None:
        """Do a job. A fault is reported, and the next job is still done."""
        attempt(self.fault, where, job, *arguments)

    def wait_until_written(self, within_s: float) -> bool:
        """Wait (s) until journal and state are on the disk; whether they are. Not for the main loop."""
        return all(
            each.wait_until_written(within_s) for each in (self.journal, self._base.strangers, self._base.restart)
        )

    def close(self) -> None:
        """Close links, state and journals."""
        for port in self.ports.values():
            self._attempt("closing links", port.close)
        self._attempt("closing links", self.onboard.close)
        self._attempt("closing the state", self._base.restart.close)
        self.event_log.unloaded()
        self.journal.close()
        self._base.strangers.close()
