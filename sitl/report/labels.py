# SPDX-License-Identifier: GPL-3.0-or-later

"""Puts the labels of a picture where they cover the least.

For each label some dozens of places around its point are tried; a place costs what it covers (other labels and marks
much, lines a little, leaving the picture most) and how far it is from its point. Labels are placed in the order in
which they came, so the important ones come first. Simple, and good enough for a few dozen labels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from sitl.report.palette import INK

__all__ = ["LabelPlacer"]

Box = tuple[float, float, float, float]
Point = tuple[float, float]

_COVER_COST, _LINE_COST, _OUTSIDE_COST, _ZONE_COST = 1000.0, 40.0, 5000.0, 3000.0
_NEAR_PX, _LEADER_PX = 16.0, 24.0


@dataclass(frozen=True, slots=True)
class _Label:
    text: str
    at: Point
    size: float
    colour: str
    bold: bool
    boxed: bool
    inside: Sequence[Point]


class LabelPlacer:
    """Collects labels and what they must not cover, then places them."""

    def __init__(self, figure: Any, axes: Any) -> None:
        self._figure, self._axes = figure, axes
        self._labels: list[_Label] = []
        self._marks: list[tuple[Point, float]] = []
        self._lines: list[Sequence[Point]] = []

    def add(
        self,
        text: str,
        at: Point,
        *,
        size: float = 9,
        colour: str = INK,
        bold: bool = False,
        boxed: bool = False,
        inside: Sequence[Point] = (),
    ) -> None:
        """A label for a point (data coordinates); with `inside` it stands anywhere in that ring instead."""
        self._labels.append(_Label(text, at, size, colour, bold, boxed, inside))

    def block(self, at: Point, radius_pt: float) -> None:
        """A mark that labels must not cover."""
        self._marks.append((at, radius_pt))

    def avoid(self, line: Sequence[Point]) -> None:
        """A line that labels should not cover."""
        self._lines.append(line)

    def place(self) -> None:
        """Put every label; the limits of the axes must be final."""
        import numpy as np
        from matplotlib.path import Path

        renderer = self._figure.canvas.get_renderer()
        self._figure.draw_without_rendering()
        to_px = self._axes.transData.transform
        frame = self._axes.get_window_extent(renderer)
        scale = self._figure.dpi / 72.0
        taken: list[Box] = []
        for at, radius in self._marks:
            x, y = to_px(at)
            r = radius * scale
            taken.append((x - r, y - r, x + r, y + r))
        points = np.array([point for line in self._lines for point in _dense(to_px(line), 6.0)]).reshape(-1, 2)
        for label in sorted(self._labels, key=lambda label: bool(label.inside)):
            width, height = self._measure(label, renderer)
            ring = Path(to_px(label.inside)) if label.inside else None
            best: tuple[float, Point] | None = None
            for centre, distance in _places(to_px(label.at), width, height, ring):
                box = (centre[0] - width / 2, centre[1] - height / 2, centre[0] + width / 2, centre[1] + height / 2)
                cost = distance + _cost(box, taken, points, (frame.x0, frame.y0, frame.x1, frame.y1))
                if ring is not None and not all(ring.contains_point(corner) for corner in _corners(box)):
                    cost += _ZONE_COST
                if best is None or cost < best[0]:
                    best = (cost, centre)
            assert best is not None
            centre = best[1]
            taken.append((centre[0] - width / 2, centre[1] - height / 2, centre[0] + width / 2, centre[1] + height / 2))
            self._put(label, centre, width, height)

    def _measure(self, label: _Label, renderer: Any) -> tuple[float, float]:
        text = self._axes.text(0, 0, label.text, **self._style(label))
        box = text.get_window_extent(renderer)
        text.remove()
        pad = 10.0 if label.boxed else 4.0
        return box.width + pad, box.height + pad

    def _put(self, label: _Label, centre: Point, width: float, height: float) -> None:
        from matplotlib.patheffects import Normal, Stroke

        back = self._axes.transData.inverted().transform
        at = back(centre)
        if not label.inside:
            x, y = self._axes.transData.transform(label.at)
            edge = (
                min(max(x, centre[0] - width / 2), centre[0] + width / 2),
                min(max(y, centre[1] - height / 2), centre[1] + height / 2),
            )
            if label.boxed or math.hypot(x - edge[0], y - edge[1]) > _LEADER_PX * self._figure.dpi / 72.0:
                end = back(edge)
                self._axes.plot([label.at[0], end[0]], [label.at[1], end[1]], color=INK, linewidth=0.7, zorder=5.5)
        text = self._axes.text(at[0], at[1], label.text, ha="center", va="center", **self._style(label))
        if label.boxed:
            text.set_bbox(
                {"facecolor": "white", "edgecolor": "#999999", "boxstyle": "round,pad=0.25", "linewidth": 0.7}
            )
        else:
            text.set_path_effects([Stroke(linewidth=3, foreground="white"), Normal()])

    @staticmethod
    def _style(label: _Label) -> dict[str, Any]:
        return {
            "fontsize": label.size,
            "color": label.colour,
            "fontweight": "bold" if label.bold else "normal",
            "zorder": 11,
            "linespacing": 1.15,
        }


def _places(at: Sequence[float], width: float, height: float, ring: Any) -> list[tuple[Point, float]]:
    """Centres to try, with what the distance costs."""
    if ring is not None:
        low, high = ring.vertices.min(axis=0), ring.vertices.max(axis=0)
        steps = 24
        return [
            (
                (low[0] + (high[0] - low[0]) * i / steps, low[1] + (high[1] - low[1]) * j / steps),
                (steps - j) * 0.5 + i * 0.2,
            )
            for i in range(1, steps)
            for j in range(1, steps)
        ]
    found = []
    for reach in (_NEAR_PX, 34.0, 60.0, 95.0, 140.0):
        for step in range(16):
            turn = 2.0 * math.pi * step / 16
            dx, dy = math.cos(turn), math.sin(turn)
            # from the mark to the label's edge, whatever the direction
            edge = min(width / 2 / max(abs(dx), 1e-6), height / 2 / max(abs(dy), 1e-6))
            found.append(((at[0] + dx * (reach + edge), at[1] + dy * (reach + edge)), reach))
    return found


def _cost(box: Box, taken: Sequence[Box], points: Any, frame: Box) -> float:
    cost = 0.0
    for other in taken:
        wide = min(box[2], other[2]) - max(box[0], other[0])
        high = min(box[3], other[3]) - max(box[1], other[1])
        if wide > 0 and high > 0:
            cost += _COVER_COST
    xs, ys = points[:, 0], points[:, 1]
    covered = int(((xs > box[0]) & (xs < box[2]) & (ys > box[1]) & (ys < box[3])).sum())
    # many labels cross some line; the second point of it costs less than the first
    cost += _LINE_COST * min(covered, 3) + covered
    if box[0] < frame[0] or box[1] < frame[1] or box[2] > frame[2] or box[3] > frame[3]:
        cost += _OUTSIDE_COST
    return cost


def _corners(box: Box) -> tuple[Point, Point, Point, Point]:
    return (box[0], box[1]), (box[2], box[1]), (box[2], box[3]), (box[0], box[3])


def _dense(line: Any, step_px: float) -> list[Point]:
    """Points along a line, no further apart than `step_px`, no closer than a pixel."""
    found: list[Point] = []
    for start, end in pairwise(line):
        length = math.hypot(end[0] - start[0], end[1] - start[1])
        if found and length < 1.0 and math.hypot(end[0] - found[-1][0], end[1] - found[-1][1]) < step_px:
            continue
        count = max(1, math.ceil(length / step_px))
        found += [
            (start[0] + (end[0] - start[0]) * k / count, start[1] + (end[1] - start[1]) * k / count)
            for k in range(count)
        ]
    return found
