# SPDX-License-Identifier: GPL-3.0-or-later

"""Orders of the companion to the autopilot: START, STOP and CONTINUE for a station, and safety orders.

* START is here from the station's command to its last answer: which program asked, what a repetition gets, and the
  result. The arbiter decides whether the aircraft may take off.
* A return or landing ends a START that is under way, and the station that asked is told so.
* If the autopilot has no STOP and CONTINUE (`takes_over`), the companion changes the mode instead, and answers the
  command as an autopilot would.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.authority.start import refused
from mavproxy_handover.core.common.events import ModeSourceSeen, OrderRefused, StartFinished, StartRequested
from mavproxy_handover.core.common.model import FlightAction, ModeClass, ModeSource
from mavproxy_handover.core.safety.commands import QUIET_S, Kind, Limit
from mavproxy_handover.gate.intent import Intent
from mavproxy_handover.gate.policy.switches import SWITCH_NUMBERS
from mavproxy_handover.gate.refusal_text import called, how_to_lift, subject_of
from mavproxy_handover.gate.refusals import OncePerCause
from mavproxy_handover.monitors.energy import FAULT
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.checks.read_back import WITHDRAWN, NotHeldError, ReadBack
from mavproxy_handover.operator.return_site.return_site import ReturnSite
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.wire.conversation import Ask, Asking, Conversation, NoAnswer, RefusedError
from mavproxy_handover.wire.frames import Frame, field_float, field_int
from mavproxy_handover.wire.ids import MISSION_START
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES

__all__ = ["UNDOING", "Orders", "commanded", "disarms"]

#: why a command that arms is refused while a cancelled START is being undone
UNDOING: Final = ("the previous START is still being undone: send it again",)

#: messages that carry a MAV_CMD
#: names of the conversations
_START: Final = "start"
_CALLED_OFF: Final = "start called off"
_HOME: Final = "home"
_SPEED: Final = "speed"
_PAUSE: Final = "pause"
_STAND: Final = "stand"
_DISARM: Final = "disarm"
_PAUSE_CONTINUE: Final[int] = mavlink.MAV_CMD_DO_PAUSE_CONTINUE
#: its first parameter
_STOP, _CONTINUE = 0.0, 1.0
_ARM: Final[int] = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
#: switches that disarm or stop the motors, and the position in which they do
_LOW, _HIGH = 0, 2
_DISARMING: Final = {
    SWITCH_NUMBERS[name]: position
    for name, position in (
        ("ARMDISARM_UNUSED", _LOW),
        ("ARMDISARM", _LOW),
        ("ARMDISARM_AIRMODE", _LOW),
        ("ARM_EMERGENCY_STOP", _LOW),
        ("DISARM", _HIGH),
        ("MOTOR_ESTOP", _HIGH),
        ("MOTOR_INTERLOCK", _LOW),
    )
}
#: the bits that the autopilot keeps of a switch's number, and of its position
_SWITCH_MASK, _POSITION_MASK = 0xFFFF, 0xFF
#: above this DO_FLIGHTTERMINATION ends the flight
_TERMINATES: Final = 0.5
#: a command to continue the mission had no effect if the autopilot reports within this time (s) that it is disarmed; it
#: reports every second
_NO_EFFECT_S: Final = 2.0
#: START waits this long (s) for the answer to a disarm
_ANSWER_S: Final = 1.0
#: a return waits this long (s) for its site to be in the autopilot's rally list
_PLACE_S: Final = 1.0


def commanded(frame: Frame) -> int | None:
    """The MAV_CMD of a frame that begins a flight; None for the older message SET_MODE."""
    return None if frame.msgid == mavlink.MAVLINK_MSG_ID_SET_MODE else field_int(frame, "command")


def disarms(frame: Frame) -> bool:
    """Whether a frame that passes on the ground disarms, stops the motors, or ends the flight."""
    if frame.msgid not in COMMAND_MESSAGES:
        return False
    command, first, second = commanded(frame), field_float(frame, "param1"), field_float(frame, "param2")
    if command == mavlink.MAV_CMD_DO_AUX_FUNCTION:
        position = _DISARMING.get(int(first) & _SWITCH_MASK) if isfinite(first) else None
        # NaN may be any position
        return position is not None and (not isfinite(second) or int(second) & _POSITION_MASK == position)
    if command == mavlink.MAV_CMD_DO_FLIGHTTERMINATION:
        return not first <= _TERMINATES
    return command == _ARM and first == 0.0


def _answer_to(frame: Frame) -> Asking:
    """Wait for the autopilot's answer to a station's command; returns its result."""
    number = commanded(frame)

    def answer(m: Any) -> int | None:
        if m.get_type() != "COMMAND_ACK" or m.command != number or m.result == mavlink.MAV_RESULT_IN_PROGRESS:
            return None
        return int(m.result)

    return (yield Ask("the answer to the disarm", (), answer, _ANSWER_S, tries=1))


@dataclass(frozen=True, slots=True)
class _Asker:
    """The program that asked for START or STOP: its station, its system and its component."""

    port: StationPort
    sender: tuple[int, int]


class Orders:
    """Carries out START, STOP and safety orders, one of each at a time."""

    def __init__(self, context: Context, read_back: ReadBack, return_site: ReturnSite) -> None:
        self._read_back = read_back
        self._return_site = return_site
        self._state = context.state
        self._procedures = context.procedures
        self._conversations = context.conversations
        self._authority = context.authority
        self._reports = context.reports
        #: by station: the program whose START the rules have not answered yet
        self._asked: dict[int, _Asker] = {}
        #: the program that asked for the current or last START
        self._starter: _Asker | None = None
        #: the program that asked for the current STOP or CONTINUE, and whether for STOP
        self._stopper: tuple[_Asker, bool] | None = None
        self._needs = OncePerCause()
        #: the last command to continue the mission: station, name and time
        self._went_on: tuple[StationPort, str, float] | None = None
        #: the disarm that the commander sent last
        self._disarm: Frame | None = None
        #: the autopilot returns by an order of the companion
        self.returning = False
        #: the order that `begin` gives to the autopilot
        self.ordered: tuple[FlightAction, Asking] | None = None
        #: the last order that the autopilot was given
        self._given: FlightAction | None = None

    @property
    def starting(self) -> bool:
        """A START is under way."""
        return _START in self._conversations

    @property
    def undoing(self) -> bool:
        """A cancelled START is being undone."""
        return _CALLED_OFF in self._conversations

    # ---- START ----------------------------------------------------------------------------------------------------

    def start_asked(self, port: StationPort, frame: Frame, what: str, now: float) -> None:
        """The commander's START, on the ground; `what`: the frame in words."""
        asker = _Asker(port, (frame.sysid, frame.compid))
        if self.starting:  # a repetition
            mine = asker == self._starter
            result = mavlink.MAV_RESULT_IN_PROGRESS if mine else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            self._reports.message_sender.acknowledge(port, asker.sender, MISSION_START, result)
            return
        self._reports.event_log.start_asked(port.name, what, now)
        self._asked[port.sysid] = asker
        self._authority.handle(StartRequested(port.sysid), now)

    def start(self, station: int, now: float) -> None:
        """Read the mission back, arm and fly it. The program at `station` that asked is told the result."""
        self._starter = asker = self._asked.pop(station)
        self._answer(asker, mavlink.MAV_RESULT_IN_PROGRESS)

        def done(talk: Conversation, now: float) -> None:
            text = talk.failure or ""
            self._authority.handle(StartFinished(talk.failure is None, text), now)
            if isinstance(talk.error, NotHeldError):
                self._answer(asker, mavlink.MAV_RESULT_TEMPORARILY_REJECTED, f"START refused: {text}")
                return
            result = mavlink.MAV_RESULT_ACCEPTED if talk.failure is None else mavlink.MAV_RESULT_FAILED
            self._answer(asker, result, f"START failed: {text}" if text else "")

        procedures = self._procedures().flight
        undoing = self._conversations.drop(_CALLED_OFF)

        def steps() -> Asking:
            if undoing:  # first undo all of it: in parallel it would change the mode of this START
                yield from procedures.call_off_start()
            yield from self._read_back.asking()
            yield from procedures.start()

        self._reports.event_log.start_begun(asker.port.name, procedures.firmware.starts_by)
        self._conversations.begin(_START, steps(), done, now)

    def refuse_start(self, station: int, needs: tuple[str, ...], now: float) -> None:
        """The START that `station` asked for is refused: tell it what START still needs."""
        asker = self._asked.pop(station)
        self._answer(asker, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
        self._tell_needs(asker.port, "START", needs, now)

    def refuse_take_off(self, port: StationPort, frame: Frame, needs: tuple[str, ...], now: float) -> None:
        """A command that arms or takes off is refused: tell the station what START still needs."""
        message_sender, sender = self._reports.message_sender, (frame.sysid, frame.compid)
        command = commanded(frame)
        if command is not None and not (needs == (WITHDRAWN,) and self._answered_by_disarm(frame)):
            message_sender.acknowledge(port, sender, command, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
        modes = self._procedures().profile.gate
        self._tell_needs(port, called(subject_of(frame), modes=modes), needs, now)

    def _answered_by_disarm(self, frame: Frame) -> bool:
        """Whether the autopilot's answer to the disarm also answers this command for its sender.

        It does if the same program sent both, and both have the same number.
        """
        disarm = self._disarm
        if disarm is None or (disarm.sysid, disarm.compid) != (frame.sysid, frame.compid):
            return False
        return commanded(disarm) == commanded(frame)

    def _tell_needs(self, port: StationPort, what: str, needs: tuple[str, ...], now: float) -> None:
        """Tell all needs in one text. Figures follow a colon; they may change while the need stays the same."""
        if self._needs.allow(port.sysid, (what, *(need.partition(":")[0] for need in needs)), now):
            by_hand = len(needs) == 1 and needs[0].startswith("energy: ")
            again_in_s = None if needs == (f"energy: {FAULT}",) else QUIET_S
            lifts = f". {how_to_lift(Limit.ENERGY, again_in_s)}" if by_hand else ""
            self._reports.message_sender.say(port, f"{refused(what, needs)}{lifts}")

    def give_start_up(self, why: str, now: float) -> None:
        """End the START that is under way, if there is one."""
        asker = self._starter
        if self._conversations.drop(_START) and asker is not None:
            self._authority.handle(StartFinished(False, why), now)
            self._answer(asker, mavlink.MAV_RESULT_FAILED, f"START failed: {why}")
            asking = self._procedures().flight.call_off_start()
            self._conversations.begin(_CALLED_OFF, asking, lambda _talk, _now: None, now)

    def disarmed(self, port: StationPort, frame: Frame, armed: bool, now: float) -> None:
        """The commander's disarm went to the autopilot. It ends a START. `armed`: by the autopilot's heartbeat.

        An autopilot that is armed may refuse, because it has taken off: START waits for its answer then. One that is
        not armed may still get the arm of this START, and a plane refuses to disarm what is disarmed.
        """
        self._disarm, self._went_on = frame, None
        why = f"{port.name} disarmed"
        if not self.starting or not armed:
            self.give_start_up(why, now)
            return

        def done(talk: Conversation, now: float) -> None:
            if talk.result in (None, mavlink.MAV_RESULT_ACCEPTED):
                self.give_start_up(why, now)

        self._conversations.begin(_DISARM, _answer_to(frame), done, now)

    def passed(self, port: StationPort, intent: Intent, now: float) -> None:
        """A command of the commander in flight went to the autopilot."""
        if intent.kind is Kind.GO_ON:
            self._went_on = port, intent.word, now

    def flight_over(self, now: float) -> None:
        """The autopilot says that it is disarmed: every station is told.

        A command that the autopilot got between its disarm and its report of it had no effect. Its sender is told if it
        still has authority, because it can send START again.
        """
        on_ground = self._state.telemetry.landed.state == mavlink.MAV_LANDED_STATE_ON_GROUND
        text = f"{'landed' if on_ground else 'disarmed'}: the flight is over"
        self._reports.message_sender.say_to_all(text, mavlink.MAV_SEVERITY_NOTICE)
        went_on, self._went_on = self._went_on, None
        if went_on is None or not self._authority.commands(went_on[0].sysid):
            return
        if now - went_on[2] <= _NO_EFFECT_S:
            text = f"{went_on[1]} had no effect: the vehicle had landed and disarmed. Send START again."
            self._reports.message_sender.say(went_on[0], text)

    def _answer(self, asker: _Asker, result: int, why: str = "") -> None:
        self._reply(asker, MISSION_START, result, why)

    def _reply(self, asker: _Asker, command: int, result: int, why: str = "") -> None:
        self._reports.message_sender.acknowledge(asker.port, asker.sender, command, result)
        if why:
            self._reports.message_sender.say(asker.port, why)

    # ---- STOP and CONTINUE ----------------------------------------------------------------------------------------

    def takes_over(self, frame: Frame) -> bool:
        """Whether the companion carries out this command of the commander in flight, instead of the autopilot."""
        pauses = frame.msgid in COMMAND_MESSAGES and commanded(frame) == _PAUSE_CONTINUE
        return pauses and self._procedures().flight.holds_by(pause=True) is not None

    def pause_asked(self, port: StationPort, frame: Frame, now: float) -> None:
        """The commander's STOP or CONTINUE, which the autopilot does not know."""
        asker, which = _Asker(port, (frame.sysid, frame.compid)), field_float(frame, "param1")
        if which not in (_STOP, _CONTINUE):
            self._reply(asker, _PAUSE_CONTINUE, mavlink.MAV_RESULT_DENIED)
            return
        pause, procedures = which == _STOP, self._procedures().flight
        if self._stopper == (asker, pause):  # asked again: it is on its way
            self._reply(asker, _PAUSE_CONTINUE, mavlink.MAV_RESULT_IN_PROGRESS)
            return
        if _HOME in self._conversations:
            self._reply(asker, _PAUSE_CONTINUE, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
            return
        self._give_stop_up("another one was requested")
        self._stopper = asker, pause

        def done(talk: Conversation, _now: float) -> None:
            self._stopper = None
            result = mavlink.MAV_RESULT_ACCEPTED if talk.failure is None else mavlink.MAV_RESULT_FAILED
            self._reply(
                asker,
                _PAUSE_CONTINUE,
                result,
                f"{called(subject_of(frame))} failed: {talk.failure}" if talk.failure else "",
            )

        self._authority.handle(ModeSourceSeen(ModeSource.COMMANDER, procedures.holds_by(pause)), now)
        self._conversations.begin(_PAUSE, procedures.hold(pause), done, now)

    def _give_stop_up(self, why: str) -> None:
        """End the STOP or CONTINUE that is under way, if there is one."""
        stopper, self._stopper = self._stopper, None
        if self._conversations.drop(_PAUSE) and stopper is not None:
            asker, pause = stopper
            word = "STOP" if pause else "CONTINUE"
            self._reply(asker, _PAUSE_CONTINUE, mavlink.MAV_RESULT_FAILED, f"{word} cancelled: {why}")

    # ---- the end of guided targets of an onboard program ----------------------------------------------------------

    def stand(self, told: Callable[[str], None], now: float) -> None:
        """Stop the aircraft where it is: nothing leads it in GUIDED any more.

        `told` gets why the stop was not confirmed, "" if it was.
        """
        if _HOME in self._conversations:
            told("the companion brings it home")
            return

        def done(talk: Conversation, _now: float) -> None:
            told(talk.failure or "")

        procedures = self._procedures().flight
        self._authority.handle(ModeSourceSeen(ModeSource.COMPANION, ModeClass.STOP), now)
        self._conversations.begin(_STAND, procedures.stand(), done, now)

    def give_stand_up(self) -> None:
        """The commander, a pilot or the companion leads the aircraft elsewhere: the stop is not repeated."""
        self._conversations.drop(_STAND)

    # ---- the mission's speed --------------------------------------------------------------------------------------

    def resume_speed(self, speed_mps: float | None, now: float) -> None:
        """The aircraft flies its mission again: restore the speed that the mission has set so far.

        None: the aircraft does not fly its mission, or the mission has set no speed.
        """
        self._conversations.drop(_SPEED)
        if speed_mps is None:
            return

        def done(talk: Conversation, _now: float) -> None:
            self._reports.event_log.speed(speed_mps, talk.failure)

        self._conversations.begin(_SPEED, self._procedures().flight.set_speed(speed_mps), done, now)

    # ---- safety orders --------------------------------------------------------------------------------------------

    def order(self, action: FlightAction, now: float) -> None:
        """Take the order to hold, to continue, to return or to land. `begin` gives it to the autopilot.

        The return site is judged once more here. By that event the rules may decide for a landing: then the landing
        replaces the return, and the autopilot never gets the return.
        """
        pauses = action in (FlightAction.HOLD, FlightAction.CONTINUE)
        self._give_stop_up("the companion commands")
        self.give_stand_up()
        if not pauses:
            self.give_start_up("the aircraft is brought home", now)
        if action is not FlightAction.RETURN:  # from here on, `tick` must not begin a return again
            self.returning = False
        written = self._place(now) if action is FlightAction.RETURN else lambda: True
        asking = self._holding(action is FlightAction.HOLD, now) if pauses else self._way_home(action, written)
        self.ordered = action, asking

    def begin(self, now: float) -> None:
        """Give the last order to the autopilot, if the autopilot has not got it yet."""
        ordered, self.ordered = self.ordered, None
        if ordered is not None:
            self._begin_home(*ordered, now)

    def fly(self, action: FlightAction, now: float) -> None:
        """Take an order and give it to the autopilot at once."""
        self.order(action, now)
        self.begin(now)

    @property
    def landing(self) -> bool:
        """The autopilot was ordered to land, or is about to be, and has not answered yet."""
        waits = self.ordered is not None and self.ordered[0] is FlightAction.LAND
        return waits or (self._given is FlightAction.LAND and _HOME in self._conversations)

    def _holding(self, pause: bool, now: float) -> Asking:
        procedures = self._procedures().flight
        flown = procedures.holds_by(pause)
        if flown is not None:  # nothing else shows that the companion chose this mode
            self._authority.handle(ModeSourceSeen(ModeSource.COMPANION, flown), now)
        return procedures.hold(pause)

    def tick(self, now: float) -> None:
        """Begin a return again if its site was changed in the rally list; to be called often.

        The autopilot reads the list only when a return begins.
        """
        if self._return_site.bounces(now, returning=self.returning):
            self._begin_again(now)

    def _begin_again(self, now: float) -> None:
        self._begin_home(FlightAction.RETURN, self._procedures().flight.return_anew(), now)

    def mode_changed(self) -> None:
        """The autopilot flies another mode than before.

        If it is flown by hand, a pilot may have taken over, and the rules need a moment to know. Until then no copy of
        a command may change the mode: the order ends, and the rules order again if they must.
        """
        if self._state.flown is ModeClass.HANDS:
            why = f"the autopilot is in {self._procedures().profile.mode_name(self._state.custom_mode)} now"
            self._conversations.break_off(_HOME, f"not commanded again: {why}")
            self._give_stop_up(why)
            self.give_stand_up()
        if _HOME not in self._conversations:
            self.returning = False

    def _begin_home(self, action: FlightAction, asking: Asking, now: float) -> None:
        def done(talk: Conversation, now: float) -> None:
            profile = self._procedures().profile
            to_place = {profile.mode_name(mode) for mode in profile.to_place}
            self.returning = action is FlightAction.RETURN and talk.result in to_place
            self._reports.event_log.flown(action, talk.result, talk.failure)
            if isinstance(talk.error, RefusedError):
                self._authority.handle(OrderRefused(action), now)

        self._given = action
        self._conversations.begin(_HOME, asking, done, now)

    def _way_home(self, action: FlightAction, written: Callable[[], bool]) -> Asking:
        """Wait a moment until the rally list holds the return site, then return."""
        if not written():
            with suppress(NoAnswer):
                yield Ask("the return site to be written", (), lambda _m: written() or None, _PLACE_S, tries=1)
        return (yield from self._procedures().flight.bring_home(action))

    def _place(self, now: float) -> Callable[[], bool]:
        try:
            return self._return_site.before_return(now, returning=self.returning)
        except Exception:
            self._reports.fault("return site", traceback.format_exc(limit=-3))
            return lambda: True
