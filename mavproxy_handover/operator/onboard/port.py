# SPDX-License-Identifier: GPL-3.0-or-later

"""An onboard program as the companion reaches it: one link, one identity, counters.

* A link that floods costs a bounded time: after `_FRAMES_PER_S` frames a second it is not waited for, and the system
  drops or holds what comes.
* `drop` closes the link for the rest of the run. Nothing else of the companion depends on it.
"""

from __future__ import annotations

import time
from collections import Counter
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config.onboard import OnboardProgram
from mavproxy_handover.gate.judge import GateReason
from mavproxy_handover.gate.rate_limit import RateLimit
from mavproxy_handover.link.base import Clock
from mavproxy_handover.link.devices import Device, LinkError, open_link
from mavproxy_handover.link.names import Names
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import COMPANION_COMPID
from mavproxy_handover.wire.texts import MOST_IDS, status_texts

__all__ = ["OnboardLink", "OnboardPort", "open_onboard"]

#: frames that are read in a second, and at once
_FRAMES_PER_S: Final = 1000.0
_FRAMES: Final = 500.0


class OnboardLink(Device):
    """The link of a program, which is not waited for while its program sends too much."""

    def __init__(self, device: Device, clock: Clock = time.monotonic) -> None:
        super().__init__(device.device, clock)
        self.counters = device.counters
        self._device = device
        self._room = RateLimit(_FRAMES_PER_S, _FRAMES)
        #: more has come than is read
        self.flooded = False

    def read(self, once: bool = False) -> list[Frame]:
        """Frames of any sender that have arrived; none while there is no room."""
        now = self._clock()
        if self._closed or (self.flooded and not self._room.allow(now)):
            return []
        frames = self._device.read(once)
        self.trouble = self._device.trouble
        self.flooded = bool(frames) and not self._room.allow(now, len(frames))
        if self.flooded:
            self._room.empty()
        return frames

    def write(self, data: bytes) -> bool:
        """Send a whole frame, if the link takes it now."""
        return not self._closed and self._device.write(data)

    def accept_sender(self, frame: Frame) -> bool:
        """Note that a frame of the last `read` is genuine: its sender gets what the program hears."""
        return self._device.accept_sender(frame)

    def fileno(self) -> int:
        """The descriptor to wait for; -1: none."""
        return -1 if self._closed or self.flooded else self._device.fileno()

    def descriptors(self) -> list[int]:
        """All open descriptors."""
        return [] if self._closed else self._device.descriptors()

    @property
    def open(self) -> bool:
        """Whether a frame that is written now would leave."""
        return not self._closed and self._device.open

    @property
    def unfinished(self) -> bool:
        """Whether a frame is incomplete (`link/base.py`)."""
        return not self._closed and not self.flooded and self._device.unfinished

    def _shut(self) -> None:
        self._device.close()


class OnboardPort:
    """One program: its identity, its link, its counters. Times are monotonic seconds."""

    def __init__(self, program: OnboardProgram, device: Device, vehicle: int) -> None:
        """`vehicle`: the vehicle's system id."""
        self.name = program.name
        self.rights = program.rights
        self.link = OnboardLink(device)
        #: the number of its frames, by the reason of their verdict
        self.counts: Counter[GateReason] = Counter()
        #: when a frame of it was last taken
        self.heard_at: float | None = None
        #: why its link was closed; "": it is open
        self.dropped = ""
        self._vehicle = vehicle
        self._own = mavlink.MAVLink(None, srcSystem=vehicle, srcComponent=COMPANION_COMPID)
        self._text_id = 0

    def read(self, now: float, once: bool = False) -> list[Frame]:
        """Frames that arrived. Those with other ids than the program's are included: the gate drops them."""
        frames = self.link.read(once)
        for frame in frames:
            if frame.sysid == self._vehicle and frame.compid == self.rights.component:
                self.link.accept_sender(frame)
                self.heard_at = now
        return frames

    def write(self, data: bytes) -> None:
        """Send it a whole frame."""
        self.link.write(data)

    def send(self, message: Any) -> None:
        """Send it a message of the companion."""
        self.link.write(codec.pack(message, self._own))

    def say(self, text: str, severity: int = mavlink.MAV_SEVERITY_WARNING) -> None:
        """Send it a text, in pieces if it is long."""
        self._text_id = self._text_id % MOST_IDS + 1
        for message in status_texts(text, severity, self._text_id):
            self.send(message)

    @property
    def own(self) -> mavlink.MAVLink:
        """Packs answers to it."""
        return self._own

    def drop(self, why: str) -> None:
        """Close its link for the rest of the run."""
        self.dropped = why
        self.link.close()

    def close(self) -> None:
        """Close its link."""
        self.link.close()


def open_onboard(
    programs: tuple[OnboardProgram, ...], vehicle: int, names: Names, *, strict: bool = True
) -> tuple[OnboardPort, ...]:
    """Open the link of every program, or none. Raises LinkError.

    `strict` False: a link that cannot be opened is no error; it is opened later.
    """
    ports: list[OnboardPort] = []
    try:
        for program in programs:
            ports.append(OnboardPort(program, open_link(program.link, names, strict=strict), vehicle))
    except LinkError:
        for port in ports:
            port.close()
        raise
    return tuple(ports)
