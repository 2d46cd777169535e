# SPDX-License-Identifier: GPL-3.0-or-later

"""Which files fly the guard, in the order of the table "Flown", and which of their flights every test run makes.

`make flights` makes all of them, and has to whenever script or parameters change: the page says by a digest what it
was flown with.
"""

from __future__ import annotations

from importlib import import_module

FILES = (
    "test_guard_losses",
    "test_guard_failsafes",
    "test_guard_pilots",
    "test_guard_strangers",
    "test_guard_authority",
    "test_guard_gaps",
    "test_guard_channels",
    "test_guard_floods",
    "test_guard_scripting",
    "test_guard_arming",
    "test_guard_plane",
    "test_guard_quadplane",
    "test_guard_vehicles",
)


#: flown in every test run: of each kind of situation what is likeliest, and what is worst
EVERY_TIME = frozenset(
    {
        "take-off climb",
        "AUTO",
        "AUTO, its own RTL in final descent",
        "AUTO, NAV_LAND at 7 m",
        "SMART_RTL, companion dead",
        "GUIDED, the companion's targets go on",
        "GUIDED, HNDO_ACTION 3",
        "battery LAND with the loss",
        "battery LAND after the guard's RTL",
        "fence BRAKE with the loss",
        "GPS lost with the lease",
        "radio failsafe with the loss",
        "pilot in LOITER",
        "pilot in LOITER, companion dead",
        "LOITER by the commander's RC override, no radio",
        "LOITER by a station; then the pilot takes over",
        "a stranger's DO_AUX_FUNCTION 18, LAND",
        "forged, damaged and recorded leases after the last real one",
        "forged leases on another channel, while real ones flow",
        "lease lost, back, and lost again",
        "lease says for 3 s that no station commands",
        "GCS id and epoch follow the commander",
        "companion restarts; the commander falls silent while the lease goes on",
        "leases with a key",
        "script memory",
        "handover.parm",
        "gap crossed alone",
        "companion dies in a gap",
        "gap of 600 s, HNDO_ALONE_MAX 10",
        "arming while it says ALONE",
        "only SERIAL0 speaks MAVLink, HNDO_CHAN 1",
        "flood, TUNNEL 2000/s",
        "the pilot's switch under a flood",
        "command to stop or restart scripting",
        "SCR_ENABLE 0, companion dead",
        "arming with a live lease, by every way",
        "arming without a lease",
        "arming while the lease says LOST",
        "forced arming without a lease",
        "armed, lease lost on the ground",
        "Plane: take-off",
        "Plane: AUTO",
        "Plane: final approach",
        "Plane: landing sequence led back to the route during it",
        "Plane: pilot in FBWA, transmitter falters",
        "Plane: arming without a lease, and lost on the ground",
        "Plane: handover_plane.parm",
        "QuadPlane: hover 600 m from home",
        "QuadPlane: transition",
        "QuadPlane: on wings, rally point",
        "QuadPlane: QLAND ordered during the loss",
        "Rover",
    }
)


def case_names() -> list[str]:
    """Every case of the suite, in the order of the table."""
    return [case.name for file in FILES for case in import_module(f"tests.sitl.{file}").CASES]
