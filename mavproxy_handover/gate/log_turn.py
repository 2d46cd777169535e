# SPDX-License-Identifier: GPL-3.0-or-later

"""Which station reads flight logs now: one at a time, by LOG_REQUEST_* or by file transfer.

The autopilot serves one download. While the vehicle is disarmed any station may have it, so the stations take turns:

1. The first request takes the turn. It lasts until the station ends the download, or for `QUIET_S` after its last
   request or the last answer to it.
2. Meanwhile the requests of other stations are refused, also those that would end the download. They are told whose
   turn it is. Only the station with authority takes the turn from another, by a list, a log or a file.
3. The answers go to the station whose turn it is, and to no other.

Time is an argument (monotonic seconds).
"""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

__all__ = ["QUIET_S", "LogTurn"]

#: MAVProxy asks again after 0.7 s, QGroundControl after 3 s at the latest
QUIET_S: Final = 5.0

_END: Final[int] = mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END
_FTP: Final[int] = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL


class LogTurn:
    """Of one vehicle. Stations are system ids."""

    def __init__(self) -> None:
        self._station: int | None = None
        self._by_file = False
        self._until = -math.inf

    def station(self, now: float) -> int | None:
        """The station whose turn it is; None: the logs are free."""
        return self._station if now < self._until else None

    def reader(self, now: float) -> int | None:
        """The station that LOG_ENTRY and LOG_DATA are for; None: no station has asked for them."""
        return None if self._by_file else self.station(now)

    def takes(self, station: int, msgid: int, commands: bool, now: float) -> bool:
        """Whether a request of the station may pass. If so, the station has the turn, or has ended it. `commands`: it
        has authority."""
        if self.station(now) not in (None, station) and (not commands or msgid == _END):
            return False
        if msgid == _END:
            self.ends()
        else:
            self._station, self._by_file, self._until = station, msgid == _FTP, now + QUIET_S
        return True

    def goes_on(self, station: int, now: float) -> None:
        """The station reads on in a file that it has opened."""
        if self._by_file and self.station(now) == station:
            self._until = now + QUIET_S

    def answered(self, now: float) -> None:
        """The autopilot has sent a part of a log, or of the list."""
        if self.reader(now) is not None:
            self._until = now + QUIET_S

    def ends(self) -> None:
        """The logs are free."""
        self._station, self._until = None, -math.inf
