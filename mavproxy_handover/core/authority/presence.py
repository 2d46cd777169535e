# SPDX-License-Identifier: GPL-3.0-or-later

"""State of each station: whether it is there, both ways, and agrees with the vehicle.

A heartbeat proves only that the station reaches the vehicle. An answer to CONNECT proves the way there as well, and
says which protocol, mission package and epoch the station has. A partner must be proven in both (make before break).
A station that speaks only the MAVLink standard can prove no more than its heartbeat.

Whether the operator of such a station can be asked, the vehicle knows only from what the program shows in this run
(`shows_control`): it has sent a well-formed MAV_CMD_REQUEST_OPERATOR_CONTROL, it has accepted one that asked its
operator, or it has sent a message of ours. A program that knows the command shows its operator the question; nothing
else proves that. A heartbeat proves nothing, and neither does a refusal: programs answer UNSUPPORTED to what they do
not know.

A commander must answer too. A commander that is heard and does not answer hears nothing of the aircraft: its operator
does not see what happens. It is lost after `deaf_lost_s` without an answer, or when it has answered too few questions
in that time (`hearing.py`). An answer to a question older than `connect_lost_s` does not count.
"""

from __future__ import annotations

from collections import deque
from math import ceil, inf

from mavproxy_handover.core.authority.hearing import Hearing
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import ConnectAck
from mavproxy_handover.core.common.model import PROTOCOL_VERSION, Reason, StandingConsent, Station

__all__ = ["Presence"]


class Presence:
    """Liveness and agreement of one station. Times are monotonic seconds."""

    __slots__ = (
        "_limits",
        "answer",
        "answered_at",
        "ask_at",
        "asked",
        "heard_at",
        "hearing",
        "shows_control",
        "station",
        "told_why",
    )

    def __init__(self, station: Station, limits: Limits) -> None:
        self._limits = limits
        self.station = station
        self.heard_at = -inf
        self.answered_at = -inf
        self.answer: ConnectAck | None = None
        #: when to ask CONNECT next; never for a station that does not know it
        self.ask_at = inf if station.standard else -inf
        #: nonces of the questions that may still be answered, and when they were asked, oldest first: the way there and
        #: back may take longer than the pause between two questions, the shortest pause that there is (`contacts.py`)
        pause_s = min(limits.connect_interval_s, limits.retry_first_s)
        self.asked: deque[tuple[int, float]] = deque(maxlen=max(1, ceil(limits.connect_lost_s / pause_s)))
        #: how much of its questions it answers
        self.hearing = Hearing(limits)
        #: why the station was last journalled as no partner, in words; None while it could be one
        self.told_why: str | None = None
        #: its program has shown in this run that it knows operator control
        self.shows_control = False

    # ---- what happens -----------------------------------------------------------------------------------------------

    def note_heard(self, now: float) -> None:
        """The station is heard."""
        self.heard_at = now

    def ask_at_once(self, now: float) -> None:
        """The next question is due now, if the station knows the question at all."""
        if not self.station.standard:
            self.ask_at = now

    def ask(self, nonce: int, now: float, next_at: float) -> None:
        """A question goes out. `next_at`: when the next one is due."""
        self.asked.append((nonce, now))
        if self.alive(now):
            self.hearing.asked(now)
        self.ask_at = next_at

    def answer_counts(self, answer: ConnectAck, asked_at: float, now: float, *, at_once: bool) -> None:
        """The station has answered the question of `asked_at`. `at_once`: as in `Hearing.answered`."""
        self.answered_at, self.answer = now, answer
        self.hearing.answered(asked_at, now, at_once=at_once)

    def control_shown(self) -> None:
        """Its program has shown that it knows operator control."""
        self.shows_control = True

    def unfit_told(self, words: str | None) -> bool:
        """Note why it is no partner, in words; None: it could be one. Returns whether that is news."""
        news = words is not None and words != self.told_why
        self.told_why = words
        return news

    # ---- what is known ----------------------------------------------------------------------------------------------

    def alive(self, now: float) -> bool:
        """Heard within the heartbeat limit."""
        return now < self.lost_at()

    def lost_at(self) -> float:
        """When the station counts as lost if it stays silent."""
        return self.heard_at + self._limits.heartbeat_lost_s

    def deaf_at(self, since: float) -> float:
        """Time at which it counts as deaf without an answer, or since when it is. `since`: it commands from then on."""
        if self.station.standard:
            return inf
        mute_at = max(self.answered_at + self._limits.deaf_lost_s, since + self._limits.connect_lost_s)
        return min(mute_at, self.hearing.barred_at)

    def judge(self, now: float) -> bool:
        """Look at its answers if its next question is due, and it is heard. Returns whether it is deaf from now on."""
        return now >= self.ask_at and self.alive(now) and self.hearing.judge(now)

    def overdue(self, now: float) -> bool:
        """Heard, and an answer that should have come by now has not: it is to be asked more often."""
        limits = self._limits
        waits_s = min(2.0 * limits.connect_interval_s, limits.connect_lost_s / 2.0)
        return self.alive(now) and now - self.answered_at >= waits_s

    def pause_s(self, now: float, *, owner: bool) -> float:
        """The pause before its next question. `owner`: it is asked often also when it answers none any more.

        A station that is not heard is asked at the usual pace, whatever it answered before.
        """
        if not self.alive(now):
            return self._limits.connect_interval_s
        share = self.hearing.share
        if self.overdue(now) and (owner or share is None or share > 0.0):
            return self.hearing.short_pause_s
        return self.hearing.pause_s

    def answers(self, nonce: int, now: float) -> float | None:
        """When the open question with this `nonce` was asked, None without one; it and the older ones are closed."""
        asked_at = next((at for asked, at in self.asked if asked == nonce), None)
        if asked_at is None or now - asked_at >= self._limits.connect_lost_s:
            return None
        while self.asked.popleft()[0] != nonce:
            pass
        return asked_at

    def connected(self, now: float) -> bool:
        """Alive, and its answers to CONNECT come back; of a station that knows no CONNECT, alive."""
        if self.station.standard:
            return self.alive(now)
        return self.alive(now) and now - self.answered_at < self._limits.connect_lost_s

    @property
    def can_be_asked(self) -> bool:
        """Whether its program can ask its operator, as far as this run has shown."""
        return self.shows_control or not self.station.standard

    def unfit(self, mission_digest: bytes, now: float) -> Reason | None:
        """Reason why it cannot be a partner now; None if it can."""
        if self.station.consent is StandingConsent.REFUSE:
            return Reason.CONSENT_REFUSED
        if self.station.standard:
            return None if self.alive(now) else Reason.PARTNER_SILENT
        if not self.connected(now) or self.answer is None or not self.hearing.enough:
            return Reason.PARTNER_SILENT
        if self.answer.protocol_version != PROTOCOL_VERSION or not self.answer.accepted:
            return Reason.VERSION_DIFFERS
        if self.answer.mission_digest != mission_digest:
            return Reason.MISSION_DIFFERS if any(self.answer.mission_digest) else Reason.MISSION_MISSING
        return None if self.answer.manned else Reason.UNMANNED
