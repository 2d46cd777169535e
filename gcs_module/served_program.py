# SPDX-License-Identifier: GPL-3.0-or-later

"""A ground station program that flies through this station: QGroundControl, Mission Planner, MAVSDK, another MAVProxy.

The program connects to a port of this computer. The station's module keeps identity, signing, consent and links; the
program flies. `served_ids.py` has the rules about system ids. Rules that live here:

1. The station's heartbeat is the program's: each one of the program leaves as one of the station, and MAVProxy sends
   none of its own. After MUTE_S without one, the module answers nothing in the program's name: every answer counts as
   life at the vehicle. So a station whose program is silent is lost for the vehicle, however alive this module is.
2. Programs on this computer are trusted: what reaches the port commands with the station's key. So the port is one of
   this computer only.
3. One program commands by the port, after its first heartbeat. Frames of a second one are dropped and counted, until
   the first one is silent.
4. Frames beyond MOST_FRAMES a second, and heartbeats beyond MOST_BEATS, are dropped and counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from enum import Enum
from typing import Final

from gcs_module.served_ids import Kind, Program, for_program, kind_of
from mavproxy_handover.link.base import Device
from mavproxy_handover.wire.frames import Frame

__all__ = ["LOST_S", "MOST_BEATS", "MOST_FRAMES", "MUTE_S", "SILENT_S", "UNANSWERED", "Change", "ServedProgram"]

#: time (s) without a heartbeat of the program after which nothing is answered in its name; programs send one a second
MUTE_S: Final = 1.5

#: why no answer of the operator is taken meanwhile: none would be sent
UNANSWERED: Final = "the program served by this station is silent. Start it, then answer."

#: time (s) without a heartbeat of the program after which the operator is told
SILENT_S: Final = 3.0
#: time (s) without one after which the vehicle counts the station as lost at the latest: 5 s after the last answer
LOST_S: Final = MUTE_S + 5.0
#: frames passed on in a second; a program that uploads a mission sends some hundreds
MOST_FRAMES: Final = 1000
#: heartbeats passed on in a second. Each goes out on every link; programs send one, and one more for each component
MOST_BEATS: Final = 10
_MOST: Final = {Kind.HEARTBEAT: MOST_BEATS, Kind.PASSED: MOST_FRAMES}


class Change(Enum):
    """News about a served program."""

    NONE = "none"
    HEARD = "heard"
    SILENT = "silent"


class ServedProgram:
    """One served program. `opened`: its device; `station`: the station's system id; `vehicles`: those of its vehicles.

    `told`: gets a line about a refused frame, once for each kind. Times are monotonic seconds.
    """

    def __init__(self, opened: Device, station: int, vehicles: Collection[int], told: Callable[[str], None]) -> None:
        self.device = opened
        #: frames that were not passed on, by kind
        self.dropped: Counter[str] = Counter()
        self._station = station
        self._vehicles = frozenset(vehicles)
        self._told = told
        self._program: Program | None = None
        self._heard_at: float | None = None
        self._told_last = Change.NONE
        self._second, self._left = 0, dict(_MOST)

    @property
    def program(self) -> Program | None:
        """The ids of the program; None: it was not heard yet."""
        return self._program

    def read(self, now: float) -> Iterator[tuple[Kind, Frame]]:
        """The frames that have arrived and go to the vehicle: heartbeats, and frames to pass on."""
        if int(now) != self._second:
            self._second, self._left = int(now), dict(_MOST)
        for frame in self.device.read():
            kind = kind_of(frame, self._vehicles)
            if kind not in (Kind.HEARTBEAT, Kind.PASSED):
                self._drop(kind)
            elif kind is Kind.PASSED and self._program is None:
                self.dropped["before a heartbeat"] += 1
            elif not self.device.accept_sender(frame):
                self.dropped["of a second program"] += 1
            else:
                if kind is Kind.HEARTBEAT:
                    self._program, self._heard_at = Program(frame.sysid, frame.compid), now
                if self._left[kind] <= 0:
                    self.dropped["too many"] += 1
                else:
                    self._left[kind] -= 1
                    yield kind, frame

    def change(self, now: float) -> Change:
        """News about the program. To be called often."""
        if self._heard_at is None:
            return Change.NONE
        found = Change.SILENT if now - self._heard_at >= SILENT_S else Change.HEARD
        if found is self._told_last:
            return Change.NONE
        self._told_last = found
        return found

    def is_there(self, now: float) -> bool:
        """Whether the module may answer in the program's name."""
        return self._heard_at is not None and now - self._heard_at < MUTE_S

    def to_program(self, frame: Frame) -> None:
        """A frame of the vehicle."""
        data = for_program(frame, self._station, self._program)
        if data is not None:
            self.device.write(data)

    def _drop(self, kind: Kind) -> None:
        if not self.dropped[kind.value] and kind in _TOLD:
            self._told(f"The served program sent {_TOLD[kind]}")
        self.dropped[kind.value] += 1

    def close(self) -> None:
        """Close the port."""
        self.device.close()


_TOLD: Final = {
    Kind.SIGNING: "SETUP_SIGNING, which carries a key in the clear: not passed on. This station signs by itself.",
    Kind.VEHICLE: "frames in the name of a vehicle: not passed on. Give it another system id.",
    Kind.ELSEWHERE: "frames to a system that is not a vehicle of this station: not passed on.",
}
