# SPDX-License-Identifier: GPL-3.0-or-later

"""Numbers, signs and sends all frames of one link.

A receiver counts lost frames by gaps in the sequence numbers of each sender (system, component). Frames from the
vehicle have gaps when they get here. The gate drops frames, the companion sends in the autopilot's name between them,
and each of several links gets a part. So the rules are:

1. The frames of each sender get consecutive numbers for each link, whichever program made them. So the gaps at the
   other end are the loss of this link. (MAVProxy's `link` shows the loss of the autopilot's line.)
2. A frame that the link refused is not sent: the next frame gets its number.
3. The number is set before the signature, which covers it. A frame has one stamp on all links. By the stamp its copies
   are recognised, which are not the same bytes (`gcs_module/signing.py`).
4. If the station has no key, a signature is not replaced, so the frame goes out unchanged, and counting continues from
   its number.
5. Data that is no complete frame goes out unchanged, except if it would have to be signed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from mavproxy_handover.wire.numbers import is_signed, number_place, renumber

__all__ = ["NO_STAMP", "LinkSequencer", "Seal"]

NO_STAMP: Final = -1

#: number of possible senders: a byte for the system, one for the component
_SENDERS: Final = 1 << 16


class Seal(Protocol):
    """Signs with the station's key."""

    def stamp(self) -> int:
        """A stamp for the next frame; NO_STAMP if there are none left."""

    def sealed(self, data: bytes, stamp: int) -> bytes | None:
        """The signed frame for the station; None if it cannot be signed."""


class LinkSequencer:
    """The sequencer of one link. `write` sends bytes and returns True if they are sent. `seal` None: do not sign."""

    def __init__(
        self,
        write: Callable[[bytes], bool],
        seal: Seal | None = None,
        write_more: Callable[[bytes], bool] | None = None,
    ) -> None:
        """`write_more`: sends a frame that more frames follow; None: use `write`."""
        self._write = write
        self._write_more = write if write_more is None else write_more
        self._seal = seal
        #: number of the next frame of each sender
        self._next = bytearray(_SENDERS)

    def send(self, data: bytes, stamp: int = 0, more: bool = False) -> bool:
        """Send a complete frame; False if it was refused. `stamp`: stamp of its signature. `more`: more frames follow
        at once.
        """
        seal, write = self._seal, self._write_more if more else self._write
        place = number_place(data)
        if not place:
            return seal is None and write(data)
        sender = data[place + 1] << 8 | data[place + 2]
        number = self._next[sender]
        if seal is not None:
            sealed = None if stamp == NO_STAMP else seal.sealed(renumber(data, place, number), stamp)
            if sealed is None or not write(sealed):
                return False
        elif is_signed(data):
            number = data[place]
            if not write(data):
                return False
        elif not write(renumber(data, place, number)):
            return False
        self._next[sender] = (number + 1) & 0xFF
        return True
