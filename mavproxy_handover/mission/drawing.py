# SPDX-License-Identifier: GPL-3.0-or-later

"""Small helps for drawing with matplotlib and labelling its axes; `picture.py` says what is drawn.

matplotlib is an extra: it is loaded inside the functions that need it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from mavproxy_handover.mission.colours import INK, PAPER
from mavproxy_handover.mission.geodesy import wrap_longitude_deg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from shapely.geometry import Polygon

__all__ = ["Points", "columns", "degrees", "halo", "note", "patch", "round_down", "ticks"]

Points = list[tuple[float, float]]


def patch(part: Polygon, **style: Any) -> Any:
    """A shapely polygon, holes and all, as a matplotlib patch."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    rings = [Outline(list(ring.coords), closed=True) for ring in (part.exterior, *part.interiors)]
    return PathPatch(Outline.make_compound_path(*rings), **style)


def note(axes: Axes, text: str, place: tuple[float, float], shift: tuple[int, int], **style: Any) -> None:
    """Words beside a place, `shift` in points, readable on any ground."""
    axes.annotate(
        text,
        place,
        shift,
        textcoords="offset points",
        fontsize=8.5,
        color=INK,
        zorder=9,
        path_effects=halo(),
        **style,
    )


def halo() -> list[Any]:
    """The white edge that keeps words readable."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.8, foreground=PAPER)]


def columns(points: Points) -> tuple[list[float], list[float]]:
    """All x and all y, as matplotlib plots them."""
    return [x for x, _ in points], [y for _, y in points]


def round_down(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `value`."""
    power: float = 10.0 ** math.floor(math.log10(value))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * 1.000001)


def ticks(low: float, high: float) -> list[float]:
    """Round values between two limits, about four of them."""
    step = round_down((high - low) / 4.0)
    return [n * step for n in range(math.ceil(low / step), math.floor(high / step) + 1)]


def degrees(values: list[float], letters: str) -> list[str]:
    """Labels with as many digits as the steps between them need; longitudes may go on beyond 180."""
    digits = max(0, -math.floor(math.log10(values[1] - values[0]) + 1e-6)) if len(values) > 1 else 5
    shown = [wrap_longitude_deg(value) for value in values]
    return [f"{abs(value):.{digits}f}\N{DEGREE SIGN} {letters[value < 0]}" for value in shown]
