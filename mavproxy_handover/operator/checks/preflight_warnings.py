# SPDX-License-Identifier: GPL-3.0-or-later

"""The findings of the check before flight, told to the station that starts the flight."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.operator.checks.preflight import Preflight
from mavproxy_handover.operator.stations.sender import MessageSender

__all__ = ["PreflightWarnings"]

#: the most findings that are told
_MOST: Final = 6


class PreflightWarnings:
    """Of one vehicle."""

    def __init__(self, in_force: AuthorityInForce, preflight: Preflight, message_sender: MessageSender) -> None:
        self._in_force = in_force
        self._preflight = preflight
        self._message_sender = message_sender
        #: for each station: the findings that it was told last
        self._told: dict[int, tuple[str, ...]] = {}

    def tell(self) -> None:
        """Tell the commander what does not fit, unless it was told the same before."""
        found = tuple(finding.text for finding in self._preflight.findings or ())
        commander = self._in_force.view.commander
        if commander is None or found == self._told.get(commander, ()):
            return
        self._told[commander] = found
        port = self._message_sender.ports[commander]
        more = len(found) - _MOST
        for text in found[:_MOST]:
            self._message_sender.say(port, f"preflight: {text}")
        if more > 0:
            self._message_sender.say(port, f"preflight: {more} more are in the companion's journal")
