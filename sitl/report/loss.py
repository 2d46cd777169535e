# SPDX-License-Identifier: GPL-3.0-or-later

"""How many frames a ground station's log says were lost, by pymavlink's own count: what `mavloss.py` prints, and what
MAVProxy's console shows of a link.

pymavlink takes every hole in the sequence numbers of a sender (system, component) for lost frames. Messages that its
dialect lacks it does not count, so that they are holes to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pymavlink import mavutil

__all__ = ["Sender", "losses"]


@dataclass(slots=True)
class Sender:
    """What was heard of one sender, and how many of its frames are missing in between."""

    heard: int = 0
    lost: int = 0

    def __str__(self) -> str:
        return f"{self.lost} of {self.heard + self.lost}"


def losses(log: Path) -> Mapping[tuple[int, int], Sender]:
    """The senders (system, component) in a telemetry log. Raises OSError; what is no frame in it is passed over."""
    reader = mavutil.mavlink_connection(str(log), robust_parsing=True)
    # it has read the beginning of the file already, to see what kind it is
    reader.last_seq.clear()
    reader.mav_count = reader.mav_loss = 0
    senders: dict[tuple[int, int], Sender] = {}
    while (message := reader.recv_match()) is not None:
        if message.get_type() == "BAD_DATA":
            continue
        sender = senders.setdefault((message.get_srcSystem(), message.get_srcComponent()), Sender())
        sender.heard += reader.mav_count
        sender.lost += reader.mav_loss
        reader.mav_count = reader.mav_loss = 0
    reader.close()
    return senders
