# SPDX-License-Identifier: GPL-3.0-or-later

"""Facts of authority for the safety rules: the owner, and how far coverage goes.

Which coverage counts
---------------------
Coverage counts only where a station could take the aircraft: in the zone of the owner, and in zones of stations that
may be asked now, here or where the owner's zone ends. A station that dies is noticed only seconds later. By then the
aircraft would have left that station's zone. So a partner that is asked already has `answer_s`:

* A partner that has not answered by then does not count here, until it answers.
* A partner that has not taken the aircraft by then does not count after the border. The reason plays no part: its
  operator thinks, or a message is on its way. The transfer goes on meanwhile.

Coverage ends ahead `hold_lead_s` before the aircraft leaves it. An aircraft with wings circles where it is held, so it
needs room ahead (`circles_s`) and on both sides (`circle_m`).

The words of `words` have the figures that people hear of a cause.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import Final

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.candidates import Candidates
from mavproxy_handover.core.common.authority_facts import CoverageFacts
from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.flight import Flight
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import Reason

__all__ = ["Coverage"]

_NOTHING: Final = CoverageFacts()


class Coverage:
    """`AuthorityFacts` of one vehicle. It keeps no state of its own. Times are monotonic seconds."""

    __slots__ = ("_authority", "_candidates", "_flight", "_limits")

    def __init__(self, authority: Authority, flight: Flight, candidates: Candidates, limits: Limits) -> None:
        self._authority = authority
        self._flight = flight
        self._candidates = candidates
        self._limits = limits

    # ---- who commands -----------------------------------------------------------------------------------------------

    @property
    def owner(self) -> int | None:
        """System id of the station that has authority, heard or not; None: no station has it."""
        return self._authority.owner

    @property
    def lost(self) -> bool:
        """The owner is not heard."""
        return self._authority.lost

    @property
    def recovering(self) -> bool:
        """The companion restarted, and the owner of the run before may still come back."""
        return self._authority.recovering

    @property
    def owner_name(self) -> str:
        """The owner's name, for people."""
        return self._authority.name(self._authority.owner)

    @property
    def attacked(self) -> bool:
        """Another sender signs in the owner's name, and signs badly."""
        owner = self._authority.owner
        return owner is not None and self._candidates.links.attacked(owner)

    def successor_awaited(self, now: float) -> bool:
        """The owner is lost, and it or another station may have authority in a moment."""
        authority, transfer = self._authority, self._authority.transfer
        if not authority.lost:
            return False
        hurried = now < authority.hurry_until(self._limits.forced_timeout_s)
        soon = transfer is not None and transfer.forced and not transfer.hurry_over and hurried
        return authority.recovering or soon

    # ---- coverage ---------------------------------------------------------------------------------------------------

    @property
    def covered(self) -> bool:
        """The owner's zone holds the aircraft."""
        return self._candidates.zones.holds(self._authority.owner)

    @property
    def out_of_coverage(self) -> bool:
        """No zone holds the aircraft."""
        return self._candidates.zones.out_since is not None

    def margin_m(self, station: int) -> float:
        """How far inside its border (m) the station's zone holds the aircraft; less than 0 outside."""
        return self._candidates.zones.margin_m(station)

    def coverage(self, now: float) -> CoverageFacts:
        """What the last position shows of coverage; nothing while no station has authority."""
        owner, zones, links = self._authority.owner, self._candidates.zones, self._candidates.links
        if owner is None:
            return _NOTHING
        others = self._candidates.ready(zones.inside(), owner, Reason.ZONE_ENDS, now)
        partner, answers, _quick = self._asked(now)
        others = [station for station in others if station != partner or answers]
        return CoverageFacts(
            no_station=bool(zones.inside()) and not zones.holds(owner) and not others,
            links_weak=links.weak(owner) and not links.better(owner, others, now),
            ends_ahead=not self._authority.lost and self._ends_ahead(owner, others, now),
        )

    def _ends_ahead(self, owner: int, others: Sequence[int], now: float) -> bool:
        """Whether the last coverage that counts ends ahead. `others`: stations that could take the aircraft here."""
        zones = self._candidates.zones
        left_s = zones.ends_s(owner)
        if not zones.holds(owner) or left_s == inf:
            return False
        room = zones.margin_m(owner) >= self._flight.circle_m
        if room and left_s > max(self._limits.hold_lead_s, self._flight.circles_s):
            return False
        partner, _answers, quick = self._asked(now)
        if any(zones.ends_s(station) > left_s for station in others if station != partner or quick):
            return False
        beyond = zones.beyond(owner) if quick else zones.beyond(owner) - {partner}
        return not self._candidates.ready(beyond, owner, Reason.ZONE_ENDS, now)

    def _asked(self, now: float) -> tuple[int | None, bool, bool]:
        """The partner of the transfer under way, whether it answers, and whether it may take the aircraft in time.

        None, True, True without a transfer. A partner that did not answer in the last transfer has to answer first.
        """
        transfer = self._authority.transfer
        if transfer is None:
            return None, True, True
        partner = transfer.key.to_station
        answers = not (transfer.unanswered(now) or self._candidates.mute(partner))
        return partner, answers, answers and not transfer.slow(now)

    # ---- words ------------------------------------------------------------------------------------------------------

    def words(self, cause: Cause, now: float) -> str:
        """A cause of authority, links or coverage with its figures, for people; "" without figures."""
        words = _WORDS.get(cause)
        return "" if words is None else words(self, now)

    def _commander(self, now: float) -> str:
        owner = self._authority.owner
        deaf = "" if owner is None else self._candidates.deaf_words(owner, now)
        if deaf:
            return f"{self.owner_name} {deaf}"
        silent_s = inf if owner is None else self._candidates.silent_s(owner, now)
        return f"{self.owner_name} silent for {silent_s:.0f} s" if silent_s < inf else ""

    def _outside(self, _now: float) -> str:
        nearest = self._candidates.zones.nearest()
        if nearest is None:
            return ""
        station, margin_m = nearest
        return f"out of coverage, {-margin_m:.0f} m outside the zone of {self._authority.name(station)}"

    def _no_station(self, _now: float) -> str:
        names = ", ".join(self._authority.name(station) for station in self._candidates.zones.inside())
        return f"no station whose zone holds the aircraft can take it: {names}" if names else ""

    def _ends(self, _now: float) -> str:
        owner = self._authority.owner
        left_s = inf if owner is None else self._candidates.zones.ends_s(owner)
        return (
            f"the zone of {self.owner_name} ends in {left_s:.0f} s, and no station is ready beyond it"
            if left_s < inf
            else ""
        )

    def _attacked_words(self, _now: float) -> str:
        return f"a sender without the key of {self.owner_name} speaks in its name"

    def _weak(self, _now: float) -> str:
        return f"the links of {self.owner_name} are weak, and no station has better ones"


_WORDS: Final[Mapping[Cause, Callable[[Coverage, float], str]]] = {
    Cause.COMMANDER_LOST: Coverage._commander,
    Cause.OUT_OF_COVERAGE: Coverage._outside,
    Cause.NO_STATION: Coverage._no_station,
    Cause.COVERAGE_ENDS: Coverage._ends,
    Cause.AUTHENTICATION: Coverage._attacked_words,
    Cause.LINKS_WEAK: Coverage._weak,
}
