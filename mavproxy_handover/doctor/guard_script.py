# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks that the guard on the autopilot's card is the shipped one, by its checksum over file transfer.

No file on the card is read or opened. An autopilot without file transfer does not answer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from mavproxy_handover.tools.resources import shipped
from mavproxy_handover.wire.conversation import Ask, Asking, NoAnswer
from mavproxy_handover.wire.file_transfer import DATA, Head, head_of
from mavproxy_handover.wire.file_transfer import message as file_message
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, FTP_ACK, FTP_CHECKSUM, FTP_NAK

__all__ = ["card_checksum", "shipped_script"]

#: path on a flight controller, and in simulation
_PLACES: Final = ("/APM/scripts/handover_guard.lua", "scripts/handover_guard.lua")


def shipped_script() -> bytes:
    """The guard of this installation. Raises OSError."""
    return (shipped("ardupilot_lua") / "handover_guard.lua").read_bytes()


def card_checksum(sysid: int) -> Asking:
    """Ask for the checksum of the guard on the card; None if there is none, or no answer."""
    for sequence, place in enumerate(_PLACES, 1):
        name = place.encode("ascii")
        request = file_message((sysid, AUTOPILOT_COMPID), Head(sequence, 0, FTP_CHECKSUM, len(name)), name)
        try:
            found = yield Ask("checksum of the guard", (request,), _answer(sequence + 1), timeout_s=1.5, tries=1)
        except NoAnswer:
            return None
        if found is not False:
            return found
    return None


def _answer(sequence: int) -> Callable[[Any], Any]:
    """The checksum, False if the autopilot has no such file."""

    def answer(message: Any) -> Any:
        if message.get_type() != "FILE_TRANSFER_PROTOCOL":
            return None
        payload = bytes(message.payload)
        head = head_of(payload)
        if head.sequence != sequence or head.answered != FTP_CHECKSUM or head.opcode not in (FTP_ACK, FTP_NAK):
            return None
        if head.opcode == FTP_NAK or head.size != 4:
            return False
        return int.from_bytes(payload[DATA][:4], "little")

    return answer
