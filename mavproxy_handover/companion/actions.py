# SPDX-License-Identifier: GPL-3.0-or-later

"""Carries out the actions of the rules."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass

from mavproxy_handover.companion.autopilot_parts import Autopilot
from mavproxy_handover.companion.beacons import Beacons
from mavproxy_handover.companion.decision_news import DecisionNews
from mavproxy_handover.companion.fail_closed import FailClosed
from mavproxy_handover.companion.faults import FaultNews
from mavproxy_handover.companion.state_saver import StateSaver
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common import events
from mavproxy_handover.core.common.messages import TransferMessage
from mavproxy_handover.core.common.model import AuthorityView, Reason
from mavproxy_handover.core.common.never import assert_never
from mavproxy_handover.operator.checks.preflight_warnings import PreflightWarnings
from mavproxy_handover.operator.requests.operator_control import OperatorControl
from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.wire import codec

__all__ = ["ActionParts", "Actions"]


@dataclass(frozen=True, slots=True)
class ActionParts:
    """The parts that carry out actions."""

    arbiter: Arbiter
    autopilot: Autopilot
    message_sender: MessageSender
    news: DecisionNews
    control: OperatorControl
    warnings: PreflightWarnings
    saver: StateSaver
    beacons: Beacons
    faults: FaultNews
    closing: FailClosed


class Actions:
    """Of vehicle `vehicle` (system id). Times are monotonic seconds."""

    def __init__(
        self,
        vehicle: int,
        parts: ActionParts,
        fail_closed: Callable[[str, float], None],
        send_lease: Callable[[float], None],
        fault: Callable[[str, str], None],
    ) -> None:
        """`fail_closed` ends authority; `send_lease` sends one now; `fault` is told what broke, and where."""
        self._vehicle = vehicle
        self._parts = parts
        self._fail_closed = fail_closed
        self._send_lease = send_lease
        self._fault = fault

    def perform(self, action: events.Action, now: float) -> None:
        """Carry out one action."""
        parts = self._parts
        match action:
            case events.Send():
                self._send(action, now)
            case events.ViewChanged():
                self._change_view(action, now)
            case events.Record():
                parts.news.event_log.record(action, now)
                if action.reason is Reason.LANDED:
                    parts.autopilot.orders.flight_over(now)
                parts.news.rehearsal.record(action, now)
            case events.Fly():
                self._fly(action, now)
            case events.Announce():
                parts.news.tell(action, now)
            case events.BeginStart():
                parts.autopilot.orders.start(action.station, now)
                parts.warnings.tell()
            case events.StartRefused():
                parts.autopilot.orders.refuse_start(action.station, action.needs, now)
            case events.RehearsalMoved():
                parts.news.rehearsal.moved(action, now)
            case events.Advise():
                parts.news.announcer.advise(action)
            case events.RehearsalRefused():
                parts.news.rehearsal.refused(action, now)
            case events.ControlAnswer():
                parts.control.answer(parts.message_sender.ports[action.station], action.result, action.text, now)
            case events.NotifyOwner():
                name, view = parts.arbiter.name(action.requester), parts.closing.gate.view
                parts.control.ask_owner(parts.message_sender.ports[action.station], action, name, view.handover_id)
            case _:
                assert_never(action)

    def _fly(self, action: events.Fly, now: float) -> None:
        parts = self._parts
        if parts.closing.gate.view.rehearsal:  # people carry the aircraft; the rules order nothing in a rehearsal
            self._fault("order in a rehearsal", f"{action.action.name} is not commanded")
            return
        # saved before it is ordered, so that a restart can end a hold
        attempt(self._fault, "state", parts.saver.save)
        parts.autopilot.orders.order(action.action, now)

    def _send(self, action: events.Send, now: float) -> None:
        parts = self._parts
        port = parts.message_sender.ports[action.station]
        if isinstance(action.message, TransferMessage):
            told = "out", port.sysid, action.message, now, action.attempt
            attempt(self._fault, "journal", parts.news.event_log.message, *told)
        state = parts.autopilot.aircraft.state()
        port.send(codec.encode(action.message, port.target, self._vehicle, state), everywhere=True)
        parts.news.briefing.asked(action.station, action.message)

    def _change_view(self, action: events.ViewChanged, now: float) -> None:
        parts, gate = self._parts, self._parts.closing.gate
        before, view = gate.view, action.view
        parts.beacons.reason = action.reason
        if view.armed and not before.armed:
            parts.faults.flight_begins()
        try:
            parts.saver.save()
            parts.closing.put_in_force(view, now)
        except Exception:
            if gate.view is not view:  # else the former view would stay in force, and its leases would be sent
                self._fail_closed(f"a new view could not be put in force: {traceback.format_exc(limit=-3)}", now)
                return
            self._fault("what follows from a new view", traceback.format_exc(limit=-3))
        if view.commander != before.commander:
            parts.autopilot.authority_moved(before, now)
            parts.autopilot.orders.give_start_up("its commander no longer has authority", now)
            attempt(self._fault, "word of it", self._tell_commander, before, view)
        attempt(self._fault, "journal", parts.news.event_log.view, view, action.reason)
        self._send_lease(now)
        parts.beacons.send_authority_status(now)
        parts.beacons.send_control_status()

    def _tell_commander(self, before: AuthorityView, view: AuthorityView) -> None:
        """Tell every station the name of the commander, with the number of the transfer if there was one."""
        announcer = self._parts.news.announcer
        if view.commander is None:
            announcer.commander("", None)
            return
        transferred = view.commander == before.partner and view.handover_id == before.handover_id
        announcer.commander(self._parts.arbiter.name(view.commander), view.handover_id if transferred else None)
