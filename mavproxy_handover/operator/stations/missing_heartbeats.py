# SPDX-License-Identifier: GPL-3.0-or-later

"""Tells a station whose frames are taken, and whose heartbeat does not come, why it cannot command.

A program without heartbeats is no station to the vehicle: it gets no authority and is asked nothing. Nothing else would
tell its operator. Programs whose frames are not taken at all are told by `operator/stations/port.py`.

A station whose heartbeat never came is told after a single frame: its operator pressed one button and waits. If it came
before, frames must keep coming: a weak link may have lost the heartbeats since.
"""

from __future__ import annotations

from math import inf
from typing import Final

from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.stations.sender import MessageSender

__all__ = ["MissingHeartbeats", "without_heartbeat"]

#: frames that came within this time (s) are frames of now
_FRAMES_S: Final = 2.5
#: after this time (s) without one, the heartbeat is missing
_MISSING_S: Final = 5.0
#: time (s) from then until the station is told, and time until it is told again
_WAIT_S: Final = 3.0
_AGAIN_S: Final = 60.0


def without_heartbeat(port: StationPort, now: float) -> bool:
    """Whether frames of a station come, and its heartbeat does not."""
    return now - port.frames_at <= _FRAMES_S and now - port.heartbeat_at > _MISSING_S


class MissingHeartbeats:
    """Of one vehicle's stations. Times are monotonic seconds."""

    def __init__(self, message_sender: MessageSender) -> None:
        self._message_sender = message_sender
        #: since when frames of a station come without a heartbeat, and when it was told
        self._since: dict[int, float] = {}
        self._told_at: dict[int, float] = {}

    def each_second(self, now: float) -> None:
        """To be called each second."""
        for sysid, port in self._message_sender.ports.items():
            if without_heartbeat(port, now):
                self._since.setdefault(sysid, now)
            elif port.heartbeat_at > -inf:
                self._since.pop(sysid, None)
            waited_s = now - self._since.get(sysid, inf)
            told_at = self._told_at.get(sysid, -inf)
            if waited_s >= _WAIT_S and now - told_at >= _AGAIN_S and port.frames_at > told_at:
                self._told_at[sysid] = now
                text = f"{port.name} sends no heartbeat, so it cannot command."
                self._message_sender.say(port, f"{text} Send HEARTBEAT each second as system {sysid}.")
