# SPDX-License-Identifier: GPL-3.0-or-later

"""The invariants of authority, checked after every single event.

1. At most one commander: the view names one station or none, and every change of it is announced.
2. The commander changes in three ways only. To nobody, when its heartbeat has run out. From nobody, to the one that
   had authority and is heard again, or on the ground and disarmed to the parent. From one station to another by a
   transfer: under way until then, the partner has said DRONE_CONNECTED, the commander has consented.
3. The epoch grows by one with every station that gets authority, and never otherwise.
4. Phase, lease and partner of a view say the same.
"""

from __future__ import annotations

from math import inf

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.events import (
    Action,
    AutopilotState,
    Event,
    Flush,
    StationHeard,
    StationMessage,
    ViewChanged,
)
from mavproxy_handover.core.limits import Limits
from mavproxy_handover.core.messages import Connect, ConnectAck, DroneConnected, Message, OkHandover, TransferKey
from mavproxy_handover.core.model import AuthorityView, Consent, LeaseState, Phase

__all__ = ["Watch"]


class Watch:
    """Looks over an arbiter's shoulder. Keeps books of its own: nothing is asked of the arbiter but its view."""

    def __init__(self, arbiter: Arbiter, parent: int, limits: Limits) -> None:
        self._arbiter = arbiter
        self._parent = parent
        self._limits = limits
        self._view = arbiter.view
        self._heard: dict[int, float] = {}
        self._words: set[tuple[int, Message]] = set()
        self._had_authority: int | None = None
        self._armed = True  # until the autopilot says otherwise
        #: every change of commander: time, from, to, epoch
        self.moves: list[tuple[float, int | None, int | None, int]] = []

    def saw(self, event: Event, actions: list[Action], now: float) -> None:
        """Check what `event` has led to."""
        if isinstance(event, AutopilotState):
            self._armed = event.armed
        heard_before = dict(self._heard)
        if isinstance(event, (StationHeard, StationMessage)):
            self._heard[event.station] = now
        if isinstance(event, StationMessage) and not isinstance(event.message, (Connect, ConnectAck)):
            self._words.add((event.station, event.message))
        for action in actions:
            if isinstance(action, ViewChanged):
                self._check_view(action.view)
                if action.view.commander != self._view.commander:
                    self._check_move(self._view, action.view, event, heard_before, now)
                    self.moves.append((now, self._view.commander, action.view.commander, action.view.epoch))
                else:
                    assert action.view.epoch == self._view.epoch
                self._view = action.view
        assert self._arbiter.view == self._view, "a change that was not announced"
        flushed = [action.station for action in actions if isinstance(action, Flush)]
        moved = [old for at, old, new, _epoch in self.moves if at == now and old is not None and new is not None]
        assert set(flushed) <= set(moved)

    @staticmethod
    def _check_view(view: AuthorityView) -> None:
        assert (view.lease is LeaseState.LOST) is (view.commander is None)
        assert (view.lease is LeaseState.TRANSFER) is (view.partner is not None)
        assert (view.phase is Phase.ON_HANDOVER) is (view.partner is not None)
        assert view.partner is None or view.partner != view.commander
        assert 0 <= view.handover_id <= 0xFFFF

    def _check_move(
        self, old: AuthorityView, new: AuthorityView, event: Event, heard: dict[int, float], now: float
    ) -> None:
        if new.commander is None:
            assert old.commander is not None
            assert now - heard[old.commander] >= self._limits.heartbeat_lost_s - 1e-9
            assert new.epoch == old.epoch
            return
        assert new.epoch == old.epoch + 1
        if old.commander is None:
            if self._had_authority is None:
                assert new.commander == self._parent
                assert not self._armed
                assert new.phase is Phase.ON_LOAD
            else:
                assert new.commander == self._had_authority
                assert isinstance(event, (StationHeard, StationMessage))
                assert event.station == new.commander
        else:
            assert old.partner == new.commander
            assert old.phase is Phase.ON_HANDOVER
            key = TransferKey(old.commander, new.commander, old.handover_id, old.epoch)
            assert self._said(new.commander, DroneConnected, key)
            assert self._said(old.commander, OkHandover, key)
            assert now - heard.get(new.commander, -inf) < self._limits.heartbeat_lost_s + 1e-9
        self._had_authority = new.commander

    def _said(self, station: int, kind: type, key: TransferKey) -> bool:
        return any(
            who == station
            and isinstance(word, kind)
            and getattr(word, "key", None) == key
            and getattr(word, "consent", Consent.GRANTED) is Consent.GRANTED
            for who, word in self._words
        )
