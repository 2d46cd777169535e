# SPDX-License-Identifier: GPL-3.0-or-later

"""Plain values that tell the rules how an aircraft carries out an order.

The profile of each kind of aircraft (`vehicle/profiles/`) has one `Handling`. The event `AutopilotState` brings it, so
no rule asks what kind of aircraft it commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from mavproxy_handover.core.common.model import FlightAction, ModeClass

__all__ = ["CIRCLES", "COMES_DOWN", "STANDS_STILL", "Follow", "Handling"]


@dataclass(frozen=True, slots=True)
class Follow:
    """How an action shows: the modes of it (none: any), and the name of the motion ("": none is looked at)."""

    modes: frozenset[ModeClass]
    motion: str


@dataclass(frozen=True, slots=True, eq=False)
class Handling:
    """Properties of an aircraft that the rules need. Two are the same only if they are one object."""

    #: how each order shows: HOLD, CONTINUE, RETURN and LAND
    shows: Mapping[FlightAction, Follow]
    #: orders that the autopilot carries out by a mode of their own, with that mode; the others keep the mode
    by_mode: Mapping[FlightAction, ModeClass] = field(default_factory=dict)
    #: the return site is reached at this distance from it (m)
    at_place_m: float = 15.0


#: A landing is more than a return: what cannot return is landed by it.
_COMES_BACK: Final = Follow(frozenset({ModeClass.RETURN, ModeClass.LAND}), "gets nearer to the place, or climbs")
COMES_DOWN: Final = Follow(frozenset({ModeClass.LAND}), "comes down")

#: It stops within its mode and shows that by rest. This counts until the autopilot has said what it is.
STANDS_STILL: Final = Handling(
    shows={
        FlightAction.HOLD: Follow(frozenset(), "comes to rest"),
        FlightAction.CONTINUE: Follow(frozenset(), "moves"),
        FlightAction.RETURN: _COMES_BACK,
        FlightAction.LAND: COMES_DOWN,
    },
)
#: It never rests: it holds by circling, in a mode for that, and circles above the return site.
CIRCLES: Final = Handling(
    shows={
        FlightAction.HOLD: Follow(frozenset({ModeClass.STOP}), ""),
        FlightAction.CONTINUE: Follow(frozenset({ModeClass.MISSION, ModeClass.GUIDED}), ""),
        FlightAction.RETURN: _COMES_BACK,
        FlightAction.LAND: COMES_DOWN,
    },
    by_mode={FlightAction.HOLD: ModeClass.STOP, FlightAction.CONTINUE: ModeClass.MISSION},
    at_place_m=250.0,
)
