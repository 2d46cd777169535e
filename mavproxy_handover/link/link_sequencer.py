# SPDX-License-Identifier: GPL-3.0-or-later

"""What leaves by one link: numbered for it, sealed for its station, and only then sent.

Whoever receives a link tells frames that were lost by holes in the sequence numbers of each sender (system, component).
What comes from the vehicle's side has none of its own any more when it gets here: the gate leaves frames out, the
companion speaks in the autopilot's name between them, and of several links each gets a part. So, rules:

1. The frames of one sender are numbered anew for each link, one after the other, whoever made them: the holes that are
   seen at the other end are what this link lost. (What was lost on the autopilot's line is MAVProxy's `link` to tell.)
2. A frame that the link did not take has not been sent: the next one gets its number.
3. The number comes before the signature, which is over it. A frame has one stamp on all links: by that its copies,
   which are not the same bytes, are known (`gcs_module/signing.py`).
4. A signature that we do not replace, because the station has no key, is not broken: its frame goes out as it is, and
   counting goes on behind its number.
5. What is no whole frame goes out as it is, but not where it would have to be signed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from mavproxy_handover.wire.numbers import is_signed, number_place, renumber

__all__ = ["NO_STAMP", "Outlet", "Seal"]

NO_STAMP: Final = -1

#: senders there can be: a byte for the system, one for the component
_SENDERS: Final = 1 << 16


class Seal(Protocol):
    """The station's key."""

    def stamp(self) -> int:
        """A stamp for the next frame; NO_STAMP: there are none left."""

    def sealed(self, data: bytes, stamp: int) -> bytes | None:
        """The frame as the station gets it, signed; None: it cannot be."""


class Outlet:
    """One link's way out. `write` sends bytes, and tells whether they are sent; `seal` None: nothing is signed."""

    def __init__(
        self,
        write: Callable[[bytes], bool],
        seal: Seal | None = None,
        write_more: Callable[[bytes], bool] | None = None,
    ) -> None:
        """`write_more`: the same for a frame of which more follow; None: `write`."""
        self._write = write
        self._write_more = write if write_more is None else write_more
        self._seal = seal
        #: the number of each sender's next frame
        self._next = bytearray(_SENDERS)

    def send(self, data: bytes, stamp: int = 0, more: bool = False) -> bool:
        """Send a whole frame; False if it was not. `stamp`: what it is sealed with; `more`: others follow at once."""
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
