# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover override`: an operator lifts one limit of commands for a minute, at the commander's station or on board.

A station sends HANDOVER_OVERRIDE, and repeats it until the companion answers with the same message. A copy (the same
station, limit and nonce) is answered again, but does not lift the limit again. A station that does not command is
refused. What a lifted limit changes is in `core/safety/commands.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.safety.commands import Limit
from mavproxy_handover.operator.checks.command_check import CommandCheck
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.wire.ids import LIMITS

__all__ = ["CONSOLE", "Overrides"]

#: name of the vehicle's own console, for people
CONSOLE: Final = "the vehicle's console"


class Overrides:
    """The overrides of one vehicle. `commander` returns the system id of the station that may lift limits; None: no
    station may."""

    def __init__(self, command_check: CommandCheck, commander: Callable[[], int | None], vehicle: int) -> None:
        self._command_check = command_check
        self._commander = commander
        self._vehicle = vehicle
        #: station and limit -> nonce of the last override that was carried out
        self._last: dict[tuple[int, Limit], int] = {}

    def on_message(self, port: StationPort, message: Any, now: float) -> Any:
        """A HANDOVER_OVERRIDE of any station; returns the answer."""
        name = LIMITS.get(message.limit)
        limit = None if name is None else Limit(name)
        commands = port.sysid == self._commander()
        if limit is not None and commands and self._last.get((port.sysid, limit)) != message.nonce:
            self._last[port.sysid, limit] = message.nonce
            self._command_check.lift(limit, port.name, now)
        left_s = self._command_check.rules.lifted_s(now).get(limit, 0.0) if limit is not None and commands else 0.0
        return mavlink.MAVLink_handover_override_message(
            *port.target, self._vehicle, message.limit, message.nonce, round(left_s)
        )
