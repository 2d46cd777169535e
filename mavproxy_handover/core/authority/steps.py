# SPDX-License-Identifier: GPL-3.0-or-later

"""The steps of a transfer in words, for the companion's console, as the thesis shows them (figures 6.3 and 6.14).

A step is told once in a transfer, however often its message is sent. A station's message is told only if it counts: it
names the transfer under way, and the station may say it (`cause_of` in `transfer.py`). Messages of a lost commander do
not count.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mavproxy_handover.core.authority.transfer import Cause, cause_of
from mavproxy_handover.core.common.messages import ConnectHandover, HandoverRequest, TransferKey, TransferMessage
from mavproxy_handover.core.common.model import AuthorityView

__all__ = ["StepWords"]

_SENT: Final = {HandoverRequest: "Handover request", ConnectHandover: "Connect handover"}
_RECEIVED: Final = {
    Cause.PARTNER_READY: "{} is ready.",
    Cause.PARTNER_ASKS: "{} asks its operator.",
    Cause.PARTNER_REFUSED: "{} denies the handover.",
    Cause.CONSENTED: "OK handover received from {}.",
    Cause.COMMANDER_ASKS: "{} asks its operator.",
    Cause.DENIED: "{} denies the handover.",
    Cause.CONNECTED: "Drone connected received from {}.",
    Cause.RELEASED: "Disconnect received from {}.",
}


class StepWords:
    """`name`: of a station, for people."""

    def __init__(self, name: Callable[[int], str]) -> None:
        self._name = name
        #: the transfer that the lines told are about: its number and epoch
        self._of = (0, 0)
        self._told: set[str] = set()

    def sent(self, station: int, message: TransferMessage, *, awaits_commander: bool) -> str:
        """The line for a message that goes to `station`; "": none. `awaits_commander`: its word is waited for too."""
        what = _SENT.get(type(message))
        if what is None:
            return ""
        commander = f" and {self._name(message.key.from_station)}" if awaits_commander else ""
        name = self._name(station)
        return self._once(message.key, f"{what} sent to {name}. Waiting for {name}{commander}.")

    def received(self, station: int, message: TransferMessage, view: AuthorityView) -> str:
        """The line for a message of `station`; "": none. `view`: the one in force before it is handled."""
        key, cause = message.key, cause_of(message, station)
        under_way = (key.to_station, key.handover_id, key.epoch) == (view.partner, view.handover_id, view.epoch)
        dropped = view.commander is None and station == key.from_station  # it is lost: it is asked nothing
        if cause is None or not under_way or dropped:
            return ""
        return self._once(key, _RECEIVED[cause].format(self._name(station)))

    def _once(self, key: TransferKey, line: str) -> str:
        if self._of != (key.handover_id, key.epoch):
            self._of = key.handover_id, key.epoch
            self._told.clear()
        if line in self._told:
            return ""
        self._told.add(line)
        return line
