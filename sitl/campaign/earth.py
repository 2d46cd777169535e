# SPDX-License-Identifier: GPL-3.0-or-later

"""Where on the earth the plane of a campaign lies.

On the equator: there a plane of tens of kilometres is one to within millimetres for all that asks in degrees, so that
what is worked out on the plane (`pace.py`, `places.py`) holds for the rules.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.mission.geodesy import LocalPlane

__all__ = ["on_earth"]

_PLANE: Final = LocalPlane(0.0, 5.92)


def on_earth(x_m: float, y_m: float) -> tuple[float, float]:
    """Latitude and longitude of a place on the plane."""
    return _PLANE.to_earth(x_m, y_m)
