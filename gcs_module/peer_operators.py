# SPDX-License-Identifier: GPL-3.0-or-later

"""Which operators are on duty at the other stations: STATION_OPERATOR, each second by the ground link. Pure.

The name is text from another program: control characters are left out, and it is cut to MOST_LETTERS. It is for people
to read, and decides nothing. An older station does not send it: then the name is not known.
"""

from __future__ import annotations

from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.duty import Duty
from gcs_module.flight_values import Stamped
from mavproxy_handover.wire.ids import STATION_COMPID

__all__ = ["MOST_LETTERS", "PeerOperators", "operator_message"]

#: letters of a name that are shown; bytes of it in the message
MOST_LETTERS: Final = 30
_BYTES: Final = 60


def operator_message(peer: int, duty: Duty) -> Any:
    """The message to another station about the operator on duty here."""
    name = duty.name.encode()[:_BYTES].decode("utf-8", "ignore").encode().ljust(_BYTES, b"\0")
    return mavlink.MAVLink_station_operator_message(peer, STATION_COMPID, int(duty.manned), list(name))


class PeerOperators:
    """The last word of each of these stations. `peers`: their system ids; times are monotonic seconds."""

    def __init__(self, peers: tuple[int, ...]) -> None:
        self._peers = peers
        self._known: dict[int, Stamped] = {}

    def on_message(self, sender: int, message: Any, now: float) -> None:
        """A STATION_OPERATOR has arrived; that of a stranger is not used."""
        if sender in self._peers:
            text = bytes(message.name).decode("utf-8", "replace")
            name = "".join(letter for letter in text if letter.isprintable())[:MOST_LETTERS].strip()
            self._known[sender] = Stamped(name, now)

    def of(self, peer: int) -> Stamped | None:
        """The name of the operator at a station, "" if none has signed on; None: not known."""
        return self._known.get(peer)
