# SPDX-License-Identifier: GPL-3.0-or-later

"""The gap monitor: is the aircraft in a declared gap, and is everything ready that a crossing needs?

Only gaps of the package count that the companion has written to the autopilot on the ground. They end as soon as
another program begins to write a mission. They count only in AUTO.

START needs a guard that lets the gaps be crossed for long enough. The guard must also make the autopilot's GCS failsafe
watch the companion meanwhile. START is refused if crossing a gap against the wind takes longer than its limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Final

from mavproxy_handover.core.common.events import Event, GapsJudged
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GapFact
from mavproxy_handover.mission.gaps import Stretch
from mavproxy_handover.vehicle.state import VehicleState

__all__ = ["ALONE_MAX", "GapMonitor", "lacking"]

#: the guard's parameter for the time (s) that the aircraft may fly without a commander
ALONE_MAX: Final = "HNDO_ALONE_MAX"
_FOLLOWS: Final = "HNDO_SYSID_SW"
#: for the rules a gap begins this time (s) plus their look-ahead before its border
_EARLIER_S: Final = 3.0
#: after the far border this time (s) is left to regain contact
_CONTACT_S: Final = 5.0
#: parameters have 24 bits
_ROUNDED_S: Final = 1e-3


def lacking(stretches: Sequence[Stretch], parameters: Mapping[str, float] | None, guarded: bool) -> str:
    """Why these gaps cannot be crossed, in words; "" if they can. `parameters` None: not read yet."""
    if not stretches:
        return ""
    for stretch in stretches:
        declared = stretch.declared
        if not isfinite(stretch.time_s) or stretch.time_s > declared.limit_s:
            takes = f"{stretch.time_s:.0f} s against the wind" if isfinite(stretch.time_s) else "for ever in the wind"
            return f"{declared.words} takes {takes}, its limit is {declared.limit_s:g} s"
    if not guarded:
        return "without a guard nothing brings the aircraft home out of one"
    if parameters is None:
        return "the guard's parameters are not read yet"
    longest = max((stretch.declared for stretch in stretches), key=lambda declared: declared.limit_s)
    most_s = parameters.get(ALONE_MAX)
    if most_s is None:
        return f"the guard has no {ALONE_MAX}: it knows no gaps"
    if not most_s >= longest.limit_s - _ROUNDED_S:
        return f"{ALONE_MAX} is {most_s:g} s, {longest.words} may take {longest.limit_s:g} s"
    if parameters.get(_FOLLOWS, 1.0) < 0.5:
        return f"{_FOLLOWS} is 0: the autopilot's GCS failsafe would end them"
    return ""


class GapMonitor:
    """The gaps of one vehicle's mission. Times are monotonic seconds."""

    def __init__(self, limits: Limits) -> None:
        self._lead_s = limits.hold_lead_s + _EARLIER_S
        self._guarded = limits.guard_required
        self._stretches: tuple[Stretch, ...] = ()
        self._lacking = ""

    @property
    def longest_s(self) -> float:
        """The longest limit (s) of a gap of the mission; 0 without one."""
        return max((stretch.declared.limit_s for stretch in self._stretches), default=0.0)

    def set_gaps(self, stretches: Sequence[Stretch]) -> None:
        """Set the gaps of the autopilot's mission; empty: none, or the mission is not known."""
        self._stretches = tuple(stretches)

    def fact(self, state: VehicleState) -> GapFact | None:
        """The gap that holds the last position, or that the aircraft enters soon; None: none."""
        where = state.where
        if not self._stretches or where is None or not state.flies_mission:
            return None
        if state.foreign or not state.flying:
            return None
        for stretch in self._stretches:
            along_m = stretch.along_m(state.waypoint, *where[:2])
            speed_mps = max(stretch.speed_mps, state.track[1])
            if along_m is None or along_m > stretch.found.length_m + speed_mps * _CONTACT_S:
                continue
            if along_m >= -speed_mps * self._lead_s:
                return GapFact(stretch.declared.limit_s, stretch.declared.words, ahead=along_m < 0.0)
        return None

    def update(self, state: VehicleState, _now: float) -> list[Event]:
        """Returns what START lacks for the gaps, when that changes."""
        found = lacking(self._stretches, state.parameters.read, self._guarded)
        if found == self._lacking:
            return []
        self._lacking = found
        return [GapsJudged(found)]
