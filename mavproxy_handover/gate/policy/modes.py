# SPDX-License-Identifier: GPL-3.0-or-later

"""What the number of a flight mode means, by the firmware that takes it, as far as the policy rests on it: its name for
people, which one flies the mission on, and which ones begin a flight on the ground.

A plane that is armed takes off by a mode alone: AUTO begins its mission, TAKEOFF climbs. A copter does so by TURTLE,
which arms. Of a vehicle that is neither nothing is known, and the copter's numbers are judged as ever.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.ids import COPTER_AUTO

__all__ = ["COPTER", "PLANE", "TURTLE", "UNKNOWN", "Modes"]

#: ArduCopter's flight mode TURTLE: it arms with hardly a check, and switches the failsafes off.
TURTLE: Final = 28
#: ArduCopter's flight mode FOLLOW; a plane has none
_FOLLOW: Final = 23
#: ArduPlane's AUTO and TAKEOFF, and the auxiliary switches of the same (RCn_OPTION)
_PLANE_AUTO, _PLANE_TAKEOFF = 10, 13
_AUTO_SWITCH, _TAKEOFF_SWITCH = 16, 77


@dataclass(frozen=True, slots=True)
class Modes:
    """The flight modes of one firmware."""

    #: number -> name; what is not here is just a mode
    names: Mapping[int, str]
    #: the one that flies the mission on
    auto: int
    #: those that arm or take off on the ground, and the auxiliary functions of such
    take_off: tuple[int, ...]
    take_off_switches: tuple[int, ...] = ()
    #: the one that flies after another system
    follow: int | None = None
    #: it has wings: the place of a target is the middle of a circle, and a height alone is a target
    wings: bool = False


def _names(enum: str) -> dict[int, str]:
    return {
        number: entry.name.removeprefix(f"{enum}_")
        for number, entry in mavlink.enums[enum].items()
        if not entry.name.endswith("_ENUM_END")
    }


COPTER: Final = Modes(_names("COPTER_MODE"), COPTER_AUTO, (TURTLE,), follow=_FOLLOW)
#: a dialect may not have the newest one yet
PLANE: Final = Modes(
    {26: "AUTOLAND", **_names("PLANE_MODE")},
    _PLANE_AUTO,
    (_PLANE_AUTO, _PLANE_TAKEOFF),
    (_AUTO_SWITCH, _TAKEOFF_SWITCH),
    wings=True,
)
UNKNOWN: Final = Modes({}, COPTER_AUTO, (TURTLE,), follow=_FOLLOW)
