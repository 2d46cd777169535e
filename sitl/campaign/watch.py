# SPDX-License-Identifier: GPL-3.0-or-later

"""The invariants of authority, checked after every single event.

1. At most one commander: the view names one station or none, and every change of it is announced.
2. The commander changes with one of these causes only:
   * lost: to no station, in the same epoch, when its heartbeat has run out, or it has not answered for too long: since
     its last answer, or since this epoch has been in this run (a station that commands on after a restart has commanded
     before it). Also when it has answered too few questions of late;
   * released: to no station, on the ground, by its own request;
   * back: from none to the station that had authority, when it is heard; in the air after a deaf time only after it has
     answered for `deaf_back_s`;
   * parent: from none to the parent, on the ground and disarmed, unless control was released;
   * granted: from none to the station that asks for control, on the ground and disarmed;
   * transfer: to the partner of a transfer that was under way until then. The partner has confirmed this very transfer
     and lives, and answers enough. The commander has consented, beforehand or in this transfer, or is lost.
3. The epoch grows by one with every other change than a loss. After a restart it has grown already when the commander
   of before comes back. While no station has authority, or had it, a station's memory may raise it; in a run that began
   without a state file each station's first answer may, outside transfers. Never otherwise, and it never falls.
4. Phase, lease and partner of a view say the same.
5. Without a commander the aircraft flies on alone only where the last position was in a declared gap, not before it.
6. Only one commander allows takeover: with another one it is not allowed.
"""

from __future__ import annotations

from collections.abc import Collection
from math import inf

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common.events import (
    Action,
    AutopilotState,
    ControlRequested,
    Event,
    PositionSeen,
    Send,
    StationHeard,
    StationMessage,
    ViewChanged,
)
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Connect, ConnectAck, DroneConnected, Message, OkHandover, TransferKey
from mavproxy_handover.core.common.model import AuthorityView, Consent, LeaseState, Phase, Reason
from mavproxy_handover.core.common.snapshot import Snapshot

__all__ = ["Watch"]

_ANYBODY = "anybody"
#: reasons of a planned handover: what the vehicle's file may consent to
_PLANNED = (Reason.ZONE, Reason.ZONE_ENDS, Reason.LINK_QUALITY)

#: how far the share that is counted here may be from the one of the rules: they count at other moments, and forget on
#: the ground what was asked before an answer that brings a commander back
_APART = 0.05


class Watch:
    """Looks over an arbiter's shoulder. Keeps books of its own: nothing is asked of the arbiter but its view.

    `standard`: stations that know only the MAVLink standard, so that the partner's words are not theirs to say.
    `automatic`: those of them whose consent to a planned handover the vehicle's file gives.
    `restored`: what the arbiter was started from.
    """

    def __init__(
        self,
        arbiter: Arbiter,
        parent: int,
        limits: Limits,
        *,
        standard: Collection[int] = (),
        automatic: Collection[int] = (),
        restored: Snapshot | None = None,
    ) -> None:
        self._arbiter = arbiter
        self._parent = parent
        self._limits = limits
        self._standard = frozenset(standard)
        self._automatic = frozenset(automatic)
        self._view = arbiter.view
        self._heard: dict[int, float] = {}
        #: questions to each station that may be answered, with when they were asked, and when one last was
        self._asked: dict[int, dict[int, float]] = {}
        self._answered: dict[int, float] = {}
        #: station -> when it was asked while it was heard -> whether it answered
        self._fates: dict[int, dict[float, bool]] = {}
        #: such answers, and those before a station was judged again: whether it could be lost is asked of these
        self._all_fates: dict[int, dict[float, bool]] = {}
        #: the commander was lost as one that hears too little, and when
        self._deaf_at: float | None = None
        #: since when this epoch has been, in this run; None before its first event
        self._since: float | None = None
        #: the last position was in a declared gap
        self._gap = False
        self._words: set[tuple[int, Message]] = set()
        self._had_authority: int | None = None
        #: the stations that the commander lets have control without being asked, or `_ANYBODY`
        self._allowed: set[int | str] = set()
        self._released = False
        self._armed = True  # until the autopilot says otherwise
        #: stations whose memory has counted
        self._learnt: set[int] = set()
        self._unaware = restored is None or not restored.proven
        #: the epoch of a state that may be old: its owner continues far above it, or loses it to a station's memory
        self._unproven: int | None = None
        #: every change of commander: time, from, to, epoch
        self.moves: list[tuple[float, int | None, int | None, int]] = []
        if restored is None:
            assert arbiter.view == AuthorityView(armed=True)
            return
        assert arbiter.view.commander is None, "a restart gives no station authority"
        assert arbiter.view.partner is None
        if not restored.proven and arbiter.view.lease is LeaseState.RECOVERING:
            self._unproven = restored.epoch
        assert arbiter.view.epoch == restored.epoch + (self._unproven is None)
        if restored.phase is not Phase.ON_LOAD:
            # a station that is not in the configuration any more has no authority
            self._had_authority = restored.owner if arbiter.view.lease is LeaseState.RECOVERING else None
            if restored.takeover_allowed:
                self._allowed.add(_ANYBODY)

    def saw(self, event: Event, actions: list[Action], now: float) -> None:
        """Check what `event` has led to."""
        if self._since is None:
            self._since = now
        if isinstance(event, AutopilotState):
            self._armed = event.armed
            if not event.armed:  # the flight is over: what it did not hear in it counts no more
                self._deaf_at = None
        in_gap = self._gap  # what runs out with this event ran out where the position before had it
        if isinstance(event, PositionSeen):
            self._gap = event.gap is not None and not event.gap.ahead
        heard_before = dict(self._heard)
        if isinstance(event, (StationHeard, StationMessage)):
            if now - self._heard.get(event.station, -inf) >= self._limits.heartbeat_lost_s:
                self._fates.pop(event.station, None)
            self._heard[event.station] = now
        epoch = self._view.epoch
        if isinstance(event, StationMessage) and not isinstance(event.message, (Connect, ConnectAck)):
            self._words.add((event.station, event.message))
        if isinstance(event, ControlRequested) and event.station == self._view.commander:
            self._note_consent(event)
        for action in actions:
            if isinstance(action, Send) and isinstance(action.message, Connect):
                self._asked.setdefault(action.station, {})[action.message.nonce] = now
                if now - self._heard.get(action.station, -inf) < self._limits.heartbeat_lost_s:
                    for fates in (self._fates, self._all_fates):
                        fates.setdefault(action.station, {})[now] = False
            if isinstance(action, ViewChanged):
                self._check_view(action.view)
                assert action.view.lease is not LeaseState.ALONE or self._gap or in_gap
                if action.view.commander != self._view.commander:
                    had = self._had_authority
                    self._check_move(self._view, action.view, event, heard_before, now)
                    if action.view.commander not in (None, had):  # it is judged again
                        self._fates.pop(action.view.commander, None)
                    self.moves.append((now, self._view.commander, action.view.commander, action.view.epoch))
                elif action.view.epoch != self._view.epoch:
                    self._check_memory(self._view, action.view, event)
                self._view = action.view
        assert self._arbiter.view == self._view, "a change that was not announced"
        if isinstance(event, StationMessage) and isinstance(event.message, ConnectAck):
            self._note_answer(event.station, event.message.nonce, now)
        if self._view.epoch != epoch:
            self._since = now

    def _note_answer(self, station: int, nonce: int, now: float) -> None:
        """An answer closes its question and the older ones."""
        asked = self._asked.get(station, {})
        if nonce in asked and now - asked[nonce] < self._limits.connect_lost_s:
            for fates in (self._fates.get(station, {}), self._all_fates.get(station, {})):
                if asked[nonce] in fates:
                    fates[asked[nonce]] = True
            while next(iter(asked)) != nonce:
                del asked[next(iter(asked))]
            del asked[nonce]
            self._answered[station] = now

    def _lost(self, station: int, heard: dict[int, float], now: float, *, could_be: bool = False) -> bool:
        """Whether that commander is silent, or answers no more. `could_be`: by the count of the rules, which may be a
        little apart from this one."""
        assert self._since is not None
        limits = self._limits
        silent = now - heard[station] >= limits.heartbeat_lost_s - 1e-9
        until = max(self._answered.get(station, -inf) + limits.deaf_lost_s, self._since + limits.connect_lost_s)
        fates, share = self._fates.get(station, {}), limits.deaf_share
        if could_be:
            fates, share = self._all_fates.get(station, {}), share + _APART
        deaf = now >= until - 1e-9 or self._hears_little(fates, now, share)
        return silent or (station not in self._standard and deaf)

    def _hears_little(self, times: dict[float, bool], now: float, share: float) -> bool:
        """Whether less than this share was answered of the time that questions to it stand for."""
        limits = self._limits
        since = now - limits.answer_s - limits.deaf_lost_s / (1.0 - limits.deaf_share)
        spans = {True: 0.0, False: 0.0}
        ends = [*times, now][1:]
        for (at, answered), end in zip(times.items(), ends, strict=True):
            until = min(end, at + limits.connect_interval_s, now if answered else now - limits.answer_s)
            spans[answered] += max(0.0, until - max(at, since))
        asked_s = spans[True] + spans[False]
        return asked_s >= limits.deaf_lost_s / 2.0 - 1e-9 and spans[True] < share * asked_s + 1e-9

    def _note_consent(self, event: ControlRequested) -> None:
        if event.request and event.for_station != event.station:
            self._allowed.add(event.for_station)
        elif event.request and not event.takeover:
            self._allowed.clear()
        else:
            self._allowed.add(_ANYBODY)

    @staticmethod
    def _check_view(view: AuthorityView) -> None:
        nobodys = (LeaseState.LOST, LeaseState.RECOVERING, LeaseState.ALONE)
        assert (view.lease in nobodys) is (view.commander is None)
        assert view.lease is not LeaseState.ALONE or view.phase in (Phase.ON_MISSION, Phase.ON_HANDOVER)
        assert (view.lease is LeaseState.TRANSFER) is (view.commander is not None and view.partner is not None)
        assert view.phase is not Phase.ON_HANDOVER or view.partner is not None
        if view.partner is not None:
            # on the ground a transfer is no phase; and one may begin on the way home
            assert view.phase in (Phase.ON_HANDOVER, Phase.ON_LOAD, Phase.EMERGENCY)
            assert view.lease is not LeaseState.RECOVERING
            assert view.partner != view.commander
        assert 0 <= view.handover_id <= 0xFFFF

    def _check_move(
        self, old: AuthorityView, new: AuthorityView, event: Event, heard: dict[int, float], now: float
    ) -> None:
        if new.commander is None:
            self._check_end(old, new, event, heard, now)
            return
        came_back = new.commander == self._had_authority
        if came_back and self._unproven == old.epoch:
            assert new.epoch == old.epoch + 1000
            assert now >= heard[new.commander] - 1e-9
            self._unproven = None
            return
        assert new.epoch == old.epoch + (0 if came_back and old.lease is LeaseState.RECOVERING else 1)
        if came_back:
            if self._deaf_at is not None and self._armed and old.lease is not LeaseState.RECOVERING:
                assert now - self._deaf_at >= self._limits.deaf_back_s - 1e-9, "back before it has shown that it hears"
            self._deaf_at = None
            assert old.commander is None
            assert isinstance(event, (StationHeard, StationMessage))
            assert event.station == new.commander
            assert event.station in self._standard or isinstance(getattr(event, "message", None), ConnectAck)
        else:
            if old.partner == new.commander:
                self._check_transfer(old, new, heard, now)
            else:
                assert old.commander is None
                assert not self._armed
                assert new.phase is Phase.ON_LOAD
                assert old.partner is None
                if isinstance(event, ControlRequested):
                    assert event.request
                    assert event.station == event.for_station == new.commander
                else:
                    assert new.commander == self._parent
                    assert not self._released
            assert not new.takeover_allowed
            self._allowed.clear()
        self._had_authority, self._released = new.commander, False

    def _check_memory(self, old: AuthorityView, new: AuthorityView, event: Event) -> None:
        assert new.epoch > old.epoch
        assert isinstance(event, StationMessage)
        assert isinstance(event.message, ConnectAck)
        if self._unproven is not None:
            assert new.commander is None
            assert new.lease is LeaseState.LOST
            self._unproven = self._had_authority = None
        if self._had_authority is None:
            assert event.message.epoch == new.epoch
            return
        assert self._unaware
        assert event.station not in self._learnt
        assert new.partner is None
        assert event.message.epoch + 1 == new.epoch
        self._learnt.add(event.station)

    def _check_end(
        self, old: AuthorityView, new: AuthorityView, event: Event, heard: dict[int, float], now: float
    ) -> None:
        assert old.commander is not None
        if new.epoch == old.epoch:
            assert self._lost(old.commander, heard, now, could_be=True)
            silent = now - heard[old.commander] >= self._limits.heartbeat_lost_s - 1e-9
            self._deaf_at = None if silent else now
            return
        assert new.epoch == old.epoch + 1
        assert isinstance(event, ControlRequested)
        assert event.station == old.commander
        assert not event.request
        assert not self._armed
        assert new.phase is Phase.ON_LOAD
        assert not new.takeover_allowed
        self._had_authority, self._released = None, True

    def _check_transfer(self, old: AuthorityView, new: AuthorityView, heard: dict[int, float], now: float) -> None:
        """The partner was asked in this very transfer, has confirmed it, and is alive; the commander let it go."""
        owner = self._had_authority
        assert owner is not None
        assert new.commander is not None
        assert old.commander in (owner, None)
        key = TransferKey(owner, new.commander, old.handover_id, old.epoch)
        if new.commander not in self._standard:
            assert self._said(new.commander, DroneConnected, key)
        assert now - heard.get(new.commander, -inf) < self._limits.heartbeat_lost_s + 1e-9
        # it is looked at whenever it is asked
        fates = self._fates.get(new.commander, {})
        assert not self._hears_little(fates, max(fates, default=now), self._limits.deaf_share - _APART)
        if old.commander is not None:
            lost = self._lost(owner, heard, now)
            beforehand = bool(self._allowed & {new.commander, _ANYBODY})
            standing = owner in self._automatic and old.why in _PLANNED
            assert lost or beforehand or standing or self._said(owner, OkHandover, key)

    def _said(self, station: int, kind: type, key: TransferKey) -> bool:
        return any(
            who == station
            and isinstance(word, kind)
            and getattr(word, "key", None) == key
            and getattr(word, "consent", Consent.GRANTED) is Consent.GRANTED
            for who, word in self._words
        )
