# SPDX-License-Identifier: GPL-3.0-or-later

"""The onboard programs of one vehicle: what they send, what they hear, and what they are told.

An internal fault in a link closes that link for the rest of the run, and is told. It costs nothing else. The journal
says when a program is heard, and when it is silent for `_SILENT_S`.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.downlink import stays_aboard
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.onboard import OnboardFilters, OnboardMatters, judge_onboard, says
from mavproxy_handover.gate.policy.onboard import GUIDED, Right
from mavproxy_handover.gate.refusal_text import called, subject_of, unsaid
from mavproxy_handover.gate.refusals import OncePerCause, RefusalLimiter, refusal
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.operator.onboard.port import OnboardPort
from mavproxy_handover.wire.frames import Frame, target
from mavproxy_handover.wire.ids import OUR_MESSAGES
from mavproxy_handover.wire.message_ids import message_ids

__all__ = ["OnboardPrograms", "OnboardSurroundings"]

#: the same refusal is told once in this time (s)
_TOLD_S: Final = 60.0
#: a program that has sent nothing for this long (s) is silent; its heartbeat comes once a second
_SILENT_S: Final = 5.0
_HEARTBEAT: Final = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_GUIDED: Final = message_ids(*GUIDED)
#: what the autopilot needs of a camera, to carry out camera items of a mission by it (CAM1_TYPE 6)
_FOR_AUTOPILOT: Final = message_ids("CAMERA_INFORMATION")
_WHY: Final = {
    GateReason.NO_RIGHT: "its rights in [[onboard]] do not have it",
    GateReason.NOT_DELEGATED: "no targets are delegated. The commander types 'handover delegate {name}' in GUIDED",
    GateReason.TOO_OFTEN: "it comes more often than its limit",
    GateReason.LANDING_AWAY: "it leads the landing more than {landing_m:g} m away",
    GateReason.LANDING_HELD: "the aircraft stands and has not landed",
    GateReason.ESTIMATE: "position estimate and GPS receiver disagree",
    GateReason.LINE_FULL: "the line to the autopilot has no more room",
    GateReason.NOT_PAYLOADS: "another has payload authority",
    GateReason.SITUATION: "it would leave energy, fence or coverage",
    GateReason.NO_NUMBER: "a number in it is none",
    GateReason.COMPANION_TARGET: "the companion takes none, ask the autopilot",
    GateReason.SPOOFED_STATION: "system id must be {vehicle}, the vehicle's",
    GateReason.COMPONENT: "component must be {component}, as in [[onboard]]",
}

#: refusals that the operators must know of
_FOR_ALL: Final = frozenset((GateReason.LANDING_AWAY, GateReason.LANDING_HELD))


@dataclass(frozen=True, slots=True)
class OnboardSurroundings:
    """Parts of the companion that the programs need."""

    matters: OnboardMatters
    #: writes a whole frame to the autopilot
    to_autopilot: Callable[[bytes], None]
    #: gives what a payload manager says to the stations
    to_stations: Callable[[Frame, float], None]
    #: a guided target of the program of this name went to the autopilot
    target_passed: Callable[[str, float], None]
    #: the link of the program of this name was closed after a fault
    link_closed: Callable[[str, float], None]


class OnboardPrograms:
    """Of vehicle `vehicle` (system id). Times are monotonic seconds."""

    def __init__(
        self, vehicle: int, ports: Collection[OnboardPort], around: OnboardSurroundings, reports: Reports
    ) -> None:
        self.ports = tuple(ports)
        self._vehicle = vehicle
        self._around = around
        self._reports = reports
        self._by_component = {port.rights.component: port for port in self.ports}
        #: the components of the payload managers
        self.managers = managers_of(self.ports)
        self._filters = {port.name: OnboardFilters(port.rights, around.matters) for port in self.ports}
        self._answers = RefusalLimiter()
        self._words = OncePerCause(_TOLD_S)
        #: the programs that the journal says are heard
        self._heard: set[str] = set()

    # ---- up -------------------------------------------------------------------------------------------------------

    def serve(self, port: OnboardPort, now: float, once: bool = False) -> None:
        """Read the link of a program, and judge what came."""
        if port.dropped:
            return
        try:
            for frame in port.read(now, once):
                self._judge(port, frame, now)
        except Exception:
            self._drop(port, traceback.format_exc(limit=-3), now)

    def _judge(self, port: OnboardPort, frame: Frame, now: float) -> None:
        verdict = judge_onboard(frame, port.rights, self._vehicle)
        verdict = self._filters[port.name].limit(frame, verdict, now)
        port.counts[verdict.reason] += 1
        if verdict.fate is Fate.FORWARD:
            self._pass_on(port, frame, now)
        elif not _beats_as_second(port, frame, verdict, now):
            self._refused(port, frame, verdict, now)

    def _pass_on(self, port: OnboardPort, frame: Frame, now: float) -> None:
        """Send a frame of a program where it belongs: to another program, to the stations, or to the autopilot."""
        aim, told = target(frame), says(frame, port.rights)
        component = 0 if aim is None or aim[0] not in (0, self._vehicle) else aim[1]
        if component in self.managers or (told and component):
            other = self._by_component.get(component)
            if other is not None:  # what a manager answers to the autopilot is of no use there
                self._write(other, frame.raw, now)
            return
        if told or (frame.msgid == _HEARTBEAT and port.rights.component in self.managers):
            self._around.to_stations(frame, now)
            self._tell(frame, now, port)
        if not told or frame.msgid in _FOR_AUTOPILOT:
            self._around.to_autopilot(frame.raw)
        if frame.msgid in _GUIDED:
            self._around.target_passed(port.name, now)

    def to_manager(self, frame: Frame, now: float) -> None:
        """A frame of a station for a payload manager."""
        aim = target(frame)
        if aim is not None:
            self._write(self._by_component[aim[1]], frame.raw, now)

    def _refused(self, port: OnboardPort, frame: Frame, verdict: Verdict, now: float) -> None:
        component = port.rights.component
        if verdict.fate is Fate.REFUSE and self._answers.allow(component, frame.msgid, now):
            for answer in refusal(frame, verdict, port.own, _unchanged):
                port.write(answer)
        kind, named = (frame.msgid, verdict.reason), partial(self._named, frame)
        answered = verdict.fate is Fate.REFUSE
        self._reports.event_log.refused(port.name, kind, verdict.what, named, verdict.reason.value, answered, True, now)
        why = _WHY.get(verdict.reason)
        if why is None or not frame.known:
            return
        subject = subject_of(frame)
        if self._words.allow(component, (subject, verdict.reason), now):
            modes = self._around.matters.modes()
            landing_m = port.rights.landing_m
            text = why.format(name=port.name, vehicle=self._vehicle, component=component, landing_m=landing_m)
            text = f"{called(subject, modes=modes)} of {port.name} refused: {text}"
            port.say(text)
            self._reports.event_log.told(port.name, text, now)
            if verdict.reason in _FOR_ALL:
                self._reports.message_sender.say_to_all(text)

    def _named(self, frame: Frame) -> str:
        return unsaid(frame, modes=self._around.matters.modes())

    def _drop(self, port: OnboardPort, trouble: str, now: float) -> None:
        """Close the link of a program after a fault. Each step for itself: another fault is likely."""
        for step in (
            partial(port.drop, trouble),
            partial(self._around.link_closed, port.name, now),
            partial(self._reports.fault, f"onboard program {port.name}", trouble),
            partial(self._tell_drop, port.name),
        ):
            try:
                step()
            except Exception:
                self._reports.fault(f"closing links: {port.name}", traceback.format_exc(limit=-3))

    def _tell_drop(self, name: str) -> None:
        text = f"Link of {name} closed after an internal fault. Restart the companion on the ground."
        self._reports.event_log.onboard(name, text)
        self._reports.message_sender.say_to_all(text)

    def each_second(self, now: float) -> None:
        """Time has passed: note which programs are heard, and which are silent now."""
        for port in self.ports:
            heard = port.heard_at is not None and now - port.heard_at <= _SILENT_S
            if heard is (port.name in self._heard):
                continue
            self._heard ^= {port.name}
            text = f"{port.name} is heard" if heard else f"{port.name} is silent for {_SILENT_S:g} s"
            self._reports.event_log.onboard(port.name, text, heard=heard)

    # ---- down -----------------------------------------------------------------------------------------------------

    def hear(self, frame: Frame, now: float) -> None:
        """A frame of the vehicle's side: every program hears it, unless it is addressed to another.

        A program hears telemetry, answers to it, and what is addressed to all.
        """
        if not self.ports or frame.msgid in OUR_MESSAGES:
            return
        if not stays_aboard(frame, None, ()):  # lease and guard status
            self._tell(frame, now)

    def _tell(self, frame: Frame, now: float, sender: OnboardPort | None = None) -> None:
        """Send a frame to the programs that may hear it, but not to its sender."""
        aim = target(frame)
        for port in self.ports:
            if port is not sender and _hears(port, aim, self._vehicle):
                self._write(port, frame.raw, now)

    def _write(self, port: OnboardPort, raw: bytes, now: float) -> None:
        if port.dropped:
            return
        try:
            port.write(raw)
        except Exception:
            self._drop(port, traceback.format_exc(limit=-3), now)

    def close(self) -> None:
        """Close every link."""
        for port in self.ports:
            port.close()


def _beats_as_second(port: OnboardPort, frame: Frame, verdict: Verdict, now: float) -> bool:
    """Whether a program that is heard sends a heartbeat as another component, too. MAVSDK 3 does, as 190."""
    beats = verdict.reason is GateReason.COMPONENT and frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT
    return beats and port.heard_at is not None and now - port.heard_at <= _SILENT_S


def _hears(port: OnboardPort, aim: tuple[int, int] | None, vehicle: int) -> bool:
    """Whether a frame with this address is for a program."""
    if aim is None or aim == (0, 0):
        return True
    return aim[0] in (0, vehicle) and aim[1] in (0, port.rights.component)


def managers_of(ports: Iterable[OnboardPort]) -> frozenset[int]:
    """The components of the programs that are payload managers."""
    return frozenset(port.rights.component for port in ports if Right.MANAGER in port.rights.rights)


def _unchanged(result: int) -> int:
    return result
