# SPDX-License-Identifier: GPL-3.0-or-later

"""The border ahead at which this station will be asked, and its operator's early answer. Pure.

When the vehicle asks is in `mavproxy_handover/core/authority/foresight.py`; the sentence to the operator in `core.py`.

Rules that live here
--------------------
* The vehicle sends each second which border it foresees, between which two stations, and in how many seconds
  (HANDOVER_AHEAD). The same question gets the same answer (OK_AHEAD). Consent is automatic if it is at the border.
* An answer counts for one border only: number, two stations, epoch. It ends with the epoch, with an emergency, and with
  another border. Until then the operator may change it.
* A question that the vehicle does not repeat is over: the route has changed, or the border is not expected any more.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Final

from mavproxy_handover.core.authority.foresight import FORESEEN
from mavproxy_handover.core.common.messages import CrossingKey, HandoverAhead, TransferKey
from mavproxy_handover.core.common.model import Consent, Reason

__all__ = ["Ahead", "EarlyConsent"]

#: a question is over if the vehicle has not repeated it for this long (s)
_SILENT_S: Final = 5.0
#: an answer is forgotten this long (s) after the time at which the border was expected
_LATE_S: Final = 20.0


@dataclass(slots=True)
class Ahead:
    """A border ahead. `at`: expected time of reaching it (monotonic s); `other`: the other station's answer, None: none
    yet."""

    key: CrossingKey
    as_partner: bool
    consent: Consent
    at: float
    heard_at: float
    other: Consent | None = None
    #: the time left (s) that the operator was told last
    told_left_s: float = inf

    @property
    def waits(self) -> bool:
        """Whether it waits for this station's operator."""
        return self.consent is Consent.WAITING

    @property
    def question(self) -> tuple[int, ...]:
        """Identifies the question about this border, also after it is answered."""
        return self.key.from_station, self.key.to_station, self.key.epoch, self.key.crossing, -1


class EarlyConsent:
    """One station's knowledge of the border ahead. Times are monotonic seconds; not safe for threads."""

    __slots__ = ("_own", "ahead")

    def __init__(self, own: int) -> None:
        self._own = own
        self.ahead: Ahead | None = None

    @property
    def waits(self) -> bool:
        """Whether this station's operator is asked."""
        return self.ahead is not None and self.ahead.waits

    def fits(self, message: HandoverAhead, epoch: int, commander: int | None) -> bool:
        """Whether the message concerns this station now, and is not older than the known border."""
        key, ahead = message.key, self.ahead
        if self._own not in (key.from_station, key.to_station) or (key.epoch, key.from_station) != (epoch, commander):
            return False
        older = ahead is not None and ahead.key.epoch == epoch and (ahead.key.crossing - key.crossing) % 0x10000
        return not (older and older < 0x8000)

    def update(self, message: HandoverAhead, now: float, *, agrees: bool) -> bool:
        """Store a message for which `fits` is true; returns whether the border is new. `agrees`: the operator need not
        be asked."""
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

    def answer_for(self, key: TransferKey, why: Reason, crossing: int, *, as_partner: bool) -> Consent | None:
        """The early answer that counts for this transfer; None: there is none."""
        ahead = self.ahead
        if ahead is None or why not in FORESEEN or ahead.waits or as_partner is not ahead.as_partner:
            return None
        named = CrossingKey(key.from_station, key.to_station, crossing, key.epoch)
        return ahead.consent if named == ahead.key else None

    def on_asked_at_border(self, key: TransferKey, crossing: int) -> None:
        """The question is asked at the border itself. Consent stays, because a failed transfer is tried again. A denial
        is forgotten, so that the operator is asked again, as after any denial."""
        ahead = self.ahead
        named = CrossingKey(key.from_station, key.to_station, crossing, key.epoch)
        if ahead is not None and ahead.key == named and ahead.consent is not Consent.GRANTED:
            self.ahead = None

    def end(self) -> bool:
        """Forget the border; returns whether the operator was still being asked."""
        waited, self.ahead = self.waits, None
        return waited

    def expire(self, now: float) -> bool:
        """Forget an answer _LATE_S after its border; returns whether a question is over because the vehicle repeats it
        no more."""
        ahead = self.ahead
        if ahead is None:
            return False
        if ahead.waits and now >= ahead.heard_at + _SILENT_S:
            return self.end()
        if now >= ahead.at + _LATE_S:
            self.ahead = None
        return False
