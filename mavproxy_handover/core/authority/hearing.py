# SPDX-License-Identifier: GPL-3.0-or-later

"""How much of what the vehicle sends a station hears, judged by the questions that the station answers.

The share
---------
Each question (CONNECT) stands for the time until the next one, `connect_interval_s` at most. So it does not matter how
often the vehicle asks. The share is the answered part of the last `deaf_lost_s / (1 - deaf_share)`, 11.8 s. With that
window a good link that ends all at once is lost after `deaf_lost_s` without an answer, and not before. An answer counts
at once, a missing one after `answer_s`. Questions to a station that is not heard do not count: that station is silent,
not deaf.

A share below `deaf_share` bars the station: it can neither command nor take the aircraft nor count as coverage. One
lucky answer in ten seconds is 2 to 10 % of the time and lifts nothing. To be given the aircraft a station needs
`deaf_back_share`, so that it is not lost again at once. A station that is heard for the first time, or again after a
silence, is not barred before it was asked for `deaf_lost_s`. So a station that comes into range does not wait
`deaf_back_s`. A station that has just taken the aircraft starts as one that answers all.

The share is that of the round trip. An answer that is lost on its way up lowers it as a lost question does, on purpose:
a station whose answers do not arrive cannot take the aircraft either, and the transfer needs both ways. The limit is so
low that the uplink alone does not reach it: with 20 % lost each way 64 % of the questions are answered, with a third
lost each way 45 %. The loss of the downlink apart from that of the uplink is measured on each link
(`link/monitor.py`), and makes the link weak.

The pause between two questions follows from the share (`pause_s`): the usual one while the station answers all or
none, short below one half, twice that between.

Chance
------
Where chance decides what is heard, lucky answers count until they leave the window. Trials of this rule alone, 40,000
each, with a good uplink, gave the following times. A commander that hears 3 % is lost within 18 s in all
trials except one. A commander that hears 5 % is lost by then in 99.87 %, one that hears 6 % in 99.5 %. The longest
trials took 19.1, 22.4 and 28.1 s. In 400 trials of ten minutes a commander that hears 50 % was never lost. One that
hears 40 % was lost in 2 trials, and one that hears 30 % in 164. A longer window or a higher limit shortens these times
and loses more commanders that hear 30 or 40 %, so both are as they are.

Coming back
-----------
A barred station counts again when its share has been `deaf_back_share` or more, at every question, for `deaf_back_s`.
Each loss of command in the same flight makes that time `_GROWTH` times as long, up to `_LONGEST_S`. So a station that
falls in and out of deafness is lost at most five times in ten minutes, whatever the rhythm: after 10, 35, 84, 205 and
530 s at the earliest. The first loss by silence needs no such time: the first answer brings that commander back. A
silence lifts the bar of no station that has lost command in this flight, also where another station commands by now.
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import Final

from mavproxy_handover.core.common.limits import Limits

__all__ = ["Hearing"]

#: below this share the vehicle asks more often, so that few questions never decide
_DOUBT: Final = 0.5
#: the pause between two questions then is at least this part of `deaf_lost_s`: a share has 50 questions, and no more
_FINE: Final = 0.02
#: how much longer a station has to answer well after each further loss of command, and the longest (s)
_GROWTH, _LONGEST_S = 3.0, 300.0


class Hearing:
    """The answers of one station. Times are monotonic seconds."""

    __slots__ = ("_asked_s", "_fates", "_good_since", "_limits", "barred_at", "losses", "share")

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        #: questions of the time that counts, oldest first: when each was asked, and whether it was answered
        self._fates: deque[tuple[float, bool]] = deque()
        #: since when the share of a barred station has been good enough to come back; inf: it is not
        self._good_since = inf
        #: for how long (s) there were questions in the time that counts
        self._asked_s = 0.0
        #: the answered part of the time that counted when it was looked at last; None: no question counted yet
        self.share: float | None = None
        #: since when the station is barred; inf: it is not
        self.barred_at = inf
        #: how often it has lost command in this flight
        self.losses = 0

    @property
    def barred(self) -> bool:
        """Whether the station hears too little, or has not shown for long enough that it hears again."""
        return self.barred_at < inf

    @property
    def wavering(self) -> bool:
        """Whether the next question may change what counts: it answers some of them, or has to show that it hears."""
        between = self.share is not None and 0.0 < self.share < 1.0
        return between or self._good_since < inf or (self.share == 0.0 and not self.barred)

    @property
    def settled(self) -> bool:
        """Whether another while of the same changes nothing."""
        return not self.wavering and self._asked_s >= self._window_s - self._limits.connect_interval_s

    @property
    def short_pause_s(self) -> float:
        """The pause between two questions while few of them are answered."""
        limits = self._limits
        return min(limits.connect_interval_s, max(limits.retry_first_s, _FINE * limits.deaf_lost_s))

    @property
    def pause_s(self) -> float:
        """The pause between two questions: that of the limits while it answers all of them, or none."""
        if self.share is None or self.share in (0.0, 1.0):
            return self._limits.connect_interval_s
        return min(self._limits.connect_interval_s, self.short_pause_s * (1.0 if self.share < _DOUBT else 2.0))

    @property
    def enough(self) -> bool:
        """Whether the station hears enough to be given the aircraft: more than what bars it."""
        return not self.barred and (self.share is None or self.share >= self._limits.deaf_back_share)

    @property
    def _window_s(self) -> float:
        return self._limits.deaf_lost_s / (1.0 - self._limits.deaf_share)

    def _measure(self, now: float) -> tuple[float | None, float]:
        """The share, and for how long (s) there were questions in that time."""
        limits = self._limits
        until = now - limits.answer_s
        since = until - self._window_s
        answered_s = asked_s = 0.0
        next_at = now
        for at, answered in reversed(self._fates):
            ends = min(next_at, at + limits.connect_interval_s)
            lasts_s = (ends if answered else min(ends, until)) - max(at, since)
            next_at = at
            if lasts_s > 0.0:
                asked_s += lasts_s
                answered_s += lasts_s if answered else 0.0
            if at <= since:
                break
        return (answered_s / asked_s if asked_s > 0.0 else None), asked_s

    # ---- what happens -----------------------------------------------------------------------------------------------

    def asked(self, now: float) -> None:
        """A question goes to the station, which is heard."""
        oldest = now - self._limits.answer_s - self._window_s - self._limits.connect_interval_s
        while self._fates and self._fates[0][0] < oldest:
            self._fates.popleft()
        self._fates.append((now, False))

    def answered(self, asked_at: float, now: float, *, at_once: bool = False) -> None:
        """The question of that moment is answered. `at_once`: on the ground, an answer is enough to come back."""
        for number in range(len(self._fates) - 1, -1, -1):
            if self._fates[number][0] <= asked_at:
                if self._fates[number][0] == asked_at:
                    self._fates[number] = (asked_at, True)
                break
        if at_once and self.barred:
            self.forgive()
        self.judge(now)
        if self.barred and now - self._good_since >= self._back_s:
            self.barred_at = self._good_since = inf

    def judge(self, now: float) -> bool:
        """Look at the share: before each question, and at each answer. Returns whether the station is barred by it."""
        limits = self._limits
        share, asked_s = self._measure(now)
        self.share, self._asked_s = share, asked_s
        known = asked_s >= limits.deaf_lost_s  # few questions say little
        bars = known and share is not None and share < limits.deaf_share and not self.barred
        if bars:
            self.barred_at = now
        if not self.barred or share is None or share < limits.deaf_back_share:
            self._good_since = inf
        else:
            self._good_since = min(self._good_since, now)
        return bars

    @property
    def _back_s(self) -> float:
        longer = _GROWTH ** max(0, min(self.losses, 10) - 1)
        return max(self._limits.deaf_back_s, min(self._limits.deaf_back_s * longer, _LONGEST_S))

    def begin(self, *, commanded: bool = False) -> None:
        """Judge it from now on only: it was silent and is heard again.

        It stays barred if it has lost command in this flight, or waits for it (`commanded`).
        """
        self._fates.clear()
        self.share, self._asked_s, self._good_since = None, 0.0, inf
        if not commanded and not self.losses:
            self.barred_at = inf

    def trust(self, now: float) -> None:
        """The station takes the aircraft. It has just shown both ways, so what it did not answer is forgotten.

        What it has just shown stands until the next question, as each answer does.
        """
        self.begin()
        self.barred_at = inf
        pause_s = self._limits.connect_interval_s
        count = int((self._window_s + self._limits.answer_s) / pause_s) + 1
        self._fates.extend((now - number * pause_s, True) for number in range(count, -1, -1))
        self.judge(now)

    def lost(self, now: float, *, deaf: bool) -> None:
        """The station has lost command: it did not answer (`deaf`), or was not heard."""
        self.losses += 1
        if deaf or self.losses > 1:
            self.barred_at, self._good_since = min(self.barred_at, now), inf

    def forgive(self) -> None:
        """The flight is over, or none is under way: nothing that was counts."""
        self._fates.clear()
        self.share, self._asked_s = None, 0.0
        self.barred_at = self._good_since = inf
        self.losses = 0
