# SPDX-License-Identifier: GPL-3.0-or-later

"""Questions to the autopilot about a return: its home, its parameters of a return, and its geofence.

Each question is repeated until it is answered, but not while a mission is being written. The vehicle's state keeps the
answers; the candidates keep the geofence. `return_site.py` chooses; `rally_writer.py` reads and writes the rally list.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from mavproxy_handover.monitors.return_site.candidates import Candidates
from mavproxy_handover.vehicle.mission_protocol import LOADING, MissionProtocol
from mavproxy_handover.vehicle.parameter_reading import reading
from mavproxy_handover.vehicle.return_limits import NAMES
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Conversation, Conversations

__all__ = ["ReturnQuestions"]

_AGAIN_S: Final = 10.0
#: names of conversations
_WHERE_HOME_IS, _PARAMETERS, _OWN_FENCE = "where home is", "parameters of a return", "fence of a return"


class ReturnQuestions:
    """The questions of one vehicle. `home_told` is called when the autopilot's home is known. Times are monotonic
    seconds."""

    def __init__(
        self,
        sysid: int,
        state: VehicleState,
        candidates: Candidates,
        conversations: Conversations,
        home_told: Callable[[], None],
    ) -> None:
        self._sysid = sysid
        self._state = state
        self._candidates = candidates
        self._conversations = conversations
        self._home_told = home_told
        self._lists = MissionProtocol(sysid)
        #: when each question is due
        self._home_at = self._parameters_at = self._fence_at = math.inf
        #: until then `ReturnSite` does not choose unless the rally list has been read
        self.unread_until = -math.inf

    def set_mission(self, fence: bool, now: float) -> None:
        """The autopilot holds another mission. `fence`: the mission
        brings its own geofence, so that the one in the autopilot need not be read."""
        self._home_at = self._parameters_at = now
        self._fence_at = math.inf if fence else now
        self.unread_until = now + _AGAIN_S

    def armed(self, now: float) -> None:
        """The autopilot moves home to where it arms."""
        self._home_at = now

    def hurry(self, now: float) -> None:
        """A return is about to be ordered: the choice does not wait for the list."""
        self.unread_until = now

    def ask(self, now: float) -> None:
        """Ask the questions that are due."""
        if LOADING in self._conversations:
            return
        if now >= self._home_at and _WHERE_HOME_IS not in self._conversations:
            self._home_at = now + _AGAIN_S

            def home(talk: Conversation, now: float) -> None:
                if talk.failure is None:
                    self._home_at = math.inf
                    lat_deg, lon_deg = talk.result
                    self._state.has_home(lat_deg, lon_deg, now)
                    self._home_told()

            self._conversations.begin(_WHERE_HOME_IS, self._lists.home(), home, now)
        if now >= self._parameters_at and _PARAMETERS not in self._conversations:
            self._parameters_at = now + _AGAIN_S

            def read(talk: Conversation, _now: float) -> None:
                if talk.result:
                    self._parameters_at = math.inf

            self._conversations.begin(_PARAMETERS, reading(self._sysid, NAMES), read, now)
        if now >= self._fence_at and _OWN_FENCE not in self._conversations:
            self._fence_at = now + _AGAIN_S

            def own(talk: Conversation, _now: float) -> None:
                if talk.failure is None and self._candidates.package is not None:
                    self._fence_at = math.inf
                    self._candidates.fence_read(talk.result)

            self._conversations.begin(_OWN_FENCE, self._lists.held_fence(), own, now)
