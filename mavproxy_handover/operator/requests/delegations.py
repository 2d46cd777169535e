# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover delegate`: the commander lets an onboard program lead the aircraft in GUIDED, or takes that back.

A station sends HANDOVER_DELEGATE, and repeats it until the companion answers with the same message. A copy (the same
station and nonce) gets the answer of the first one: a late copy begins no delegation that has ended since. The last
`_REMEMBERED` requests of a station are known: a copy by a slower link may come after the next request.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.operator.stations.port import StationPort

__all__ = ["Delegations"]

_REMEMBERED: Final = 32


class Delegations:
    """Of vehicle `vehicle` (system id). Times are monotonic seconds."""

    def __init__(
        self,
        vehicle: int,
        give: Callable[[int, str, float], str],
        take_back: Callable[[int, float], str],
        say: Callable[[StationPort, str], None],
    ) -> None:
        """`give` and `take_back` do it for a station, and return why not; `say` tells a station a text."""
        self._vehicle = vehicle
        self._give = give
        self._take_back = take_back
        self._say = say
        #: station -> nonces of its last requests, the oldest first, and the answers
        self._answers: dict[int, dict[int, bool]] = {}

    def on_message(self, port: StationPort, message: Any, now: float) -> Any:
        """A HANDOVER_DELEGATE of any station; returns the answer."""
        answers = self._answers.setdefault(port.sysid, {})
        accepted = answers.get(message.nonce)
        if accepted is None:
            lacks = self._asked(port, message, now)
            accepted = answers[message.nonce] = not lacks
            if len(answers) > _REMEMBERED:
                del answers[next(iter(answers))]
            if lacks:
                self._say(port, f"DELEGATE {_shown(message)} refused: {lacks}")
        program = message.program.encode("ascii", "replace")
        return mavlink.MAVLink_handover_delegate_message(
            *port.target, self._vehicle, message.wish, message.nonce, int(accepted), program
        )

    def _asked(self, port: StationPort, message: Any, now: float) -> str:
        if message.wish == mavlink.HANDOVER_DELEGATION_WISH_BEGIN:
            return self._give(port.sysid, _shown(message), now)
        return self._take_back(port.sysid, now)


def _shown(message: Any) -> str:
    """The name of the program, as it is told to people."""
    if message.wish != mavlink.HANDOVER_DELEGATION_WISH_BEGIN:
        return "END"
    name: str = message.program
    return name if name.isascii() and name.isprintable() and name else "?"
