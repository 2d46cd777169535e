# SPDX-License-Identifier: GPL-3.0-or-later

"""The profile of a plane with rotors (QuadPlane).

It flies like a plane, and takes off and lands like a copter. The modes and all that is not replaced here are those of
`plane.py`.

ArduPlane gives it the MAV_TYPE of a plane. It shows itself by Q_ENABLE, or by the MAV_VTOL_STATE that it reports.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.handling import CIRCLES
from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.vehicle.profiles.plane import PLANE, PlaneProcedures
from mavproxy_handover.vehicle.profiles.profile import RuleGroup
from mavproxy_handover.wire.conversation import Asking

__all__ = ["QUADPLANE", "QuadPlaneProcedures"]

_VERTICAL: Final = (
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF,
    mavlink.MAV_CMD_NAV_VTOL_LAND,
    mavlink.MAV_CMD_DO_VTOL_TRANSITION,
)


@dataclass(frozen=True, slots=True)
class QuadPlaneProcedures(PlaneProcedures):
    """Those of ArduPlane, with QLAND to land."""

    def _ways_to_land(self) -> tuple[Callable[[], Asking], ...]:
        return (self._land,)

    def _land(self) -> Asking:
        yield from self._mode(PLANE.land)
        return self._flies


QUADPLANE: Final = replace(
    PLANE,
    name="quadplane",
    refines=PLANE,
    refined_by="",
    carried_out={
        **PLANE.carried_out,
        FlightAction.RETURN: "RTL to the return site, and down by its rotors",
        FlightAction.LAND: "QLAND, where it is",
    },
    handling=CIRCLES,
    procedures=QuadPlaneProcedures,
    vertical=True,
    lands_by_sequence=False,
    begins=("NAV_VTOL_TAKEOFF", frozenset((mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_TAKEOFF))),
    ends=("NAV_VTOL_LAND", frozenset((mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND))),
    takeoff_above_sea=False,
    takeoff_needs_place=False,
    not_flown={command: why for command, why in PLANE.not_flown.items() if command not in _VERTICAL},
    return_note="a return ends in a hovering landing at its place: it needs Q_RTL_MODE 1 to 3 (RTL alone circles for "
    "ever)",
    rules=PLANE.rules | {RuleGroup.ARDUPLANE_ROTORS},
)
