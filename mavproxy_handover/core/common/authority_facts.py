# SPDX-License-Identifier: GPL-3.0-or-later

"""Facts of authority that the safety rules use.

The safety rules import nothing of `core/authority/`. They get an object of this shape from the arbiter:
`authority/coverage.py` in flight, a small fake in unit tests. Every answer is a fact. The object decides nothing and
changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from mavproxy_handover.core.common.causes import Cause

__all__ = ["AuthorityFacts", "CoverageFacts"]


@dataclass(frozen=True, slots=True)
class CoverageFacts:
    """Coverage at a position. Only zones of stations that could take the aircraft count.

    `no_station`: the aircraft is inside zones, and no station of theirs could take it.
    `links_weak`: the owner's links are weak, and no other station has better ones.
    `ends_ahead`: the last coverage that counts ends so soon that the aircraft is to stop.
    """

    no_station: bool = False
    links_weak: bool = False
    ends_ahead: bool = False


class AuthorityFacts(Protocol):
    """Owner of authority, and coverage. Times are monotonic seconds."""

    @property
    def owner(self) -> int | None:
        """System id of the station that has authority, heard or not; None: no station has it."""

    @property
    def lost(self) -> bool:
        """The owner is not heard."""

    @property
    def recovering(self) -> bool:
        """The companion restarted, and the owner of the run before may still come back."""

    @property
    def covered(self) -> bool:
        """The owner's zone holds the aircraft. False does not mean `out_of_coverage`: another zone may hold it."""

    @property
    def out_of_coverage(self) -> bool:
        """No zone of any station holds the aircraft."""

    @property
    def attacked(self) -> bool:
        """Another sender signs in the owner's name, and signs badly."""

    @property
    def owner_name(self) -> str:
        """The owner's name, for people."""

    def successor_awaited(self, now: float) -> bool:
        """The owner is lost, and it or another station may have authority in a moment."""

    def coverage(self, now: float) -> CoverageFacts:
        """What the last position shows of coverage; nothing while no station has authority."""

    def margin_m(self, station: int) -> float:
        """How far inside its border (m) the station's zone holds the aircraft; less than 0 outside."""

    def words(self, cause: Cause, now: float) -> str:
        """A cause of authority, links or coverage with its figures, for people; "" without figures."""
