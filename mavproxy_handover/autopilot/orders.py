# SPDX-License-Identifier: GPL-3.0-or-later

"""What the companion itself has the autopilot fly: START for a station that waits for the answer, and the way home.

The way home comes first: it ends a START that is under way, and the station that asked is told so.
"""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.copter import Copter
from mavproxy_handover.core import events
from mavproxy_handover.core.model import FlightAction
from mavproxy_handover.narrator import Narrator
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.stations.voice import Voice
from mavproxy_handover.wire.conversation import Conversation, Conversations

__all__ = ["FlightOrders"]

_START = mavlink.MAV_CMD_MISSION_START
_Answer = Callable[[int, str], None]


class FlightOrders:
    """`handle` gives an event to the arbiter: the end of a START is one."""

    def __init__(
        self,
        copter: Copter,
        conversations: Conversations,
        voice: Voice,
        narrator: Narrator,
        handle: Callable[[events.Event, float], None],
    ) -> None:
        self._copter = copter
        self._conversations = conversations
        self._voice = voice
        self._narrator = narrator
        self._handle = handle
        #: answers the station whose START is under way: result, and why
        self._answer: _Answer = lambda _result, _why: None

    def start(self, port: StationPort, asker: tuple[int, int], now: float) -> None:
        """Arm and fly the mission; `asker` (system, component) of the station is told what comes of it."""
        answer = self._answer = self._answers(port, asker)
        answer(mavlink.MAV_RESULT_IN_PROGRESS, "")

        def done(talk: Conversation, now: float) -> None:
            text = talk.failure or ""
            self._handle(events.StartFinished(talk.failure is None, text), now)
            result = mavlink.MAV_RESULT_ACCEPTED if talk.failure is None else mavlink.MAV_RESULT_FAILED
            answer(result, f"START failed: {text}" if text else "")

        self._narrator.journal.write("start_sequence", "GUIDED, arm, AUTO", station=port.name)
        self._conversations.begin("start", self._copter.start(), done, now)

    def refuse_start(self, port: StationPort, asker: tuple[int, int], needs: tuple[str, ...]) -> None:
        """START cannot be: what it still needs."""
        text = "START refused: " + ", ".join(needs)
        self._answers(port, asker)(mavlink.MAV_RESULT_TEMPORARILY_REJECTED, text)

    def give_start_up(self, why: str, now: float) -> None:
        """End a START that is under way, if one is."""
        if self._conversations.drop("start"):
            self._handle(events.StartFinished(False, why), now)
            self._answer(mavlink.MAV_RESULT_FAILED, f"START failed: {why}")

    def bring_home(self, action: FlightAction, now: float) -> None:
        """Have the autopilot fly home, or land."""
        self.give_start_up("the aircraft is brought home", now)

        def done(talk: Conversation, now: float) -> None:
            text = talk.failure or f"the autopilot flies {talk.result}"
            self._narrator.journal.write("fly", text, action=action.name.lower(), obeyed=talk.failure is None)
            self._narrator.tell(text[:1].upper() + text[1:] + ".")

        self._conversations.begin("home", self._copter.bring_home(action), done, now)

    def _answers(self, port: StationPort, asker: tuple[int, int]) -> _Answer:
        def answer(result: int, why: str) -> None:
            self._voice.acknowledge(port, asker, _START, result)
            if why:
                self._voice.say(port, why)

        return answer
