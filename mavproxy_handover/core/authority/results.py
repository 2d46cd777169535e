# SPDX-License-Identifier: GPL-3.0-or-later

"""Step 7: the outcome of a transfer, repeated until each station shows that it knows.

A station shows it by state: an answer to CONNECT, or an unasked CONNECT_ACK, with the epoch of the result. An abort
leaves the epoch as it was, so there only the unasked answer counts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mavproxy_handover.core.common.events import Action, Record, Send
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import ConnectAck, HandoverResult
from mavproxy_handover.core.common.model import Outcome

__all__ = ["Results"]


@dataclass(slots=True)
class _Pending:
    """A result that a station has not yet shown to know."""

    result: HandoverResult
    retry_at: float
    pause_s: float
    give_up_at: float
    attempt: int = 1

    def known_by(self, answer: ConnectAck) -> bool:
        unasked = answer.nonce == 0
        return answer.epoch >= self.result.key.epoch and (unasked or self.result.outcome is Outcome.COMMITTED)

    def repeated(self, now: float, limits: Limits) -> None:
        """The station is told once more; the next pause is longer."""
        self.attempt += 1
        self.pause_s = min(self.pause_s * limits.retry_growth, limits.retry_max_s)
        self.retry_at = now + self.pause_s


class Results:
    """The last result, and who has not acknowledged it. Times are monotonic seconds."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._pending: dict[int, _Pending] = {}
        self.last: HandoverResult | None = None
        self._told: frozenset[int] = frozenset()

    def announce(self, result: HandoverResult, stations: Iterable[int], now: float, actions: list[Action]) -> None:
        """Tell `stations`, and begin to wait for them."""
        stations = tuple(stations)
        self.last, self._told = result, frozenset(stations)
        first_s = self._limits.retry_first_s
        for station in stations:
            actions.append(Send(station, result))
            give_up_at = now + self._limits.result_timeout_s
            self._pending[station] = _Pending(result, now + first_s, first_s, give_up_at)

    def told(self, station: int) -> HandoverResult | None:
        """The last result, if it was this station's to hear; None before there was one."""
        return self.last if station in self._told else None

    def forget(self, stations: Iterable[int]) -> None:
        """A new transfer of these begins: they need not be told of the old one any more."""
        for station in stations:
            self._pending.pop(station, None)

    def acknowledged(self, station: int, answer: ConnectAck) -> None:
        """A station answered; if it shows the result, it is not told again."""
        pending = self._pending.get(station)
        if pending is not None and pending.known_by(answer):
            del self._pending[station]

    def deadlines(self) -> list[float]:
        """When `repeat` has something to do."""
        return [min(pending.retry_at, pending.give_up_at) for pending in self._pending.values()]

    def repeat(self, now: float, name_of: dict[int, str], actions: list[Action]) -> None:
        """Repeat the result where it is due; give up a station that was told for long enough."""
        for station, pending in list(self._pending.items()):
            if now >= pending.give_up_at:
                del self._pending[station]
                name = name_of.get(station, f"station {station}")
                text = f"{name} has not acknowledged how handover {pending.result.key.handover_id} ended"
                actions.append(Record("result_unacknowledged", text, station=station))
            elif now >= pending.retry_at:
                pending.repeated(now, self._limits)
                actions.append(Send(station, pending.result, pending.attempt))
