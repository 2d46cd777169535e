# SPDX-License-Identifier: GPL-3.0-or-later

"""The border ahead where this station will be asked, and what its operator has said of it beforehand. Pure.

Rules that live here
--------------------
* The vehicle says each second which border, between which two stations, and in how many seconds (HANDOVER_AHEAD); the
  same question gets the same answer (OK_AHEAD). Consent is automatic where it would be at the border.
* What was said counts for that border alone: number, two stations, epoch. It ends with the epoch, with an emergency,
  and with another border. Until then it may be taken back, and given after all.
* A question that the vehicle does not repeat is over: another route is flown, or the border is not expected any more.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Final

from mavproxy_handover.core.authority.foresight import FORESEEN
from mavproxy_handover.core.common.messages import CrossingKey, HandoverAhead, TransferKey
from mavproxy_handover.core.common.model import Consent, Reason

__all__ = ["Ahead", "EarlyConsent"]

#: a question that was not repeated for so long is over (s)
_SILENT_S: Final = 5.0
#: so long behind the moment when the border should have been reached nobody waits for it (s)
_LATE_S: Final = 20.0


@dataclass(slots=True)
class Ahead:
    """A border ahead. `at`: when it is reached (monotonic s); `other`: what the other station has said, None: nothing
    yet."""

    key: CrossingKey
    as_partner: bool
    consent: Consent
    at: float
    heard_at: float
    other: Consent | None = None
    #: the operator was told last that so much time is left (s)
    told_left_s: float = inf

    @property
    def waits(self) -> bool:
        """For this station's operator."""
        return self.consent is Consent.WAITING


class EarlyConsent:
    """What one station knows of the border ahead. Times are monotonic seconds; not safe for threads."""

    __slots__ = ("_own", "ahead")

    def __init__(self, own: int) -> None:
        self._own = own
        self.ahead: Ahead | None = None

    @property
    def waits(self) -> bool:
        """This station's operator is asked."""
        return self.ahead is not None and self.ahead.waits

    def fits(self, message: HandoverAhead, epoch: int, commander: int | None) -> bool:
        """Whether it concerns this station now, and is no older than what it has heard of."""
        key, ahead = message.key, self.ahead
        if self._own not in (key.from_station, key.to_station) or (key.epoch, key.from_station) != (epoch, commander):
            return False
        older = ahead is not None and ahead.key.epoch == epoch and (ahead.key.crossing - key.crossing) % 0x10000
        return not (older and older < 0x8000)

    def heard(self, message: HandoverAhead, now: float, *, agrees: bool) -> bool:
        """The vehicle's word, which `fits`; whether it is news. `agrees`: its operator need not be asked."""
        as_partner, known = message.key.to_station == self._own, self.ahead
        other = message.commander if as_partner else message.partner
        if known is None or known.key != message.key:
            consent = Consent.GRANTED if agrees else Consent.WAITING
            self.ahead = Ahead(message.key, as_partner, consent, now + message.in_s, now, other)
            return True
        if known.waits and agrees:
            known.consent = Consent.GRANTED
        known.at, known.heard_at, known.other = now + message.in_s, now, other
        return False

    def said(self, key: TransferKey, why: Reason, crossing: int, *, as_partner: bool) -> Consent | None:
        """What was said beforehand of this transfer; None: nothing, or nothing that counts for it."""
        ahead = self.ahead
        if ahead is None or why not in FORESEEN or ahead.waits or as_partner is not ahead.as_partner:
            return None
        named = CrossingKey(key.from_station, key.to_station, crossing, key.epoch)
        return ahead.consent if named == ahead.key else None

    def used(self, key: TransferKey, crossing: int) -> None:
        """The question is asked at the border itself. Consent stays, for a try that comes to nothing is made again; who
        has denied is asked again then, as everybody is who denies."""
        ahead = self.ahead
        named = CrossingKey(key.from_station, key.to_station, crossing, key.epoch)
        if ahead is not None and ahead.key == named and ahead.consent is not Consent.GRANTED:
            self.ahead = None

    def over(self) -> bool:
        """The border is not ahead any more, or not for this commander; whether an operator was still being asked."""
        waited, self.ahead = self.waits, None
        return waited

    def lapsed(self, now: float) -> bool:
        """Whether a question is over because nobody repeats it. What was said stays, but not for ever."""
        ahead = self.ahead
        if ahead is None:
            return False
        if ahead.waits and now >= ahead.heard_at + _SILENT_S:
            return self.over()
        if now >= ahead.at + _LATE_S:
            self.ahead = None
        return False
