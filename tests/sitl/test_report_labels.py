# SPDX-License-Identifier: GPL-3.0-or-later

"""Labels of the pictures: they stand clear of each other, of marks, and inside the picture."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import pytest

from sitl.report.labels import LabelPlacer

pytest.importorskip("matplotlib")

from matplotlib.path import Path as Ring
from matplotlib.text import Text

from sitl.report.pictures import figure


@pytest.fixture
def canvas() -> tuple[Any, Any, LabelPlacer]:
    made, axes = figure(8, 6)
    axes.set_position((0.1, 0.1, 0.8, 0.8))
    axes.set_xlim(0, 100)
    axes.set_ylim(0, 100)
    return made, axes, LabelPlacer(made, axes)


def boxes(made: Any, axes: Any) -> dict[str, Any]:
    renderer = made.canvas.get_renderer()
    texts = [child for child in axes.texts if isinstance(child, Text)]
    return {text.get_text(): text.get_window_extent(renderer) for text in texts}


def test_labels_of_one_point_do_not_cover_each_other(canvas: tuple[Any, Any, LabelPlacer]) -> None:
    made, axes, placer = canvas
    for number in range(8):
        placer.add(f"handover {number}: GCSA to GCSB\n12 ms", (50, 50), boxed=True)
    placer.place()
    found = boxes(made, axes)
    assert len(found) == 8
    for first, second in combinations(found.values(), 2):
        assert not first.overlaps(second)


def test_a_label_at_the_edge_stays_in_the_picture(canvas: tuple[Any, Any, LabelPlacer]) -> None:
    made, axes, placer = canvas
    for corner in ((0, 0), (100, 0), (0, 100), (100, 100)):
        placer.add(f"rally point {corner}", corner)
    placer.place()
    frame = axes.get_window_extent()
    for box in boxes(made, axes).values():
        assert frame.x0 <= box.x0
        assert box.x1 <= frame.x1
        assert frame.y0 <= box.y0
        assert box.y1 <= frame.y1


def test_a_label_does_not_cover_a_mark(canvas: tuple[Any, Any, LabelPlacer]) -> None:
    made, axes, placer = canvas
    marks = [(50, 50), (56, 50), (44, 50), (50, 56)]
    for mark in marks:
        placer.block(mark, 9)
    placer.add("delivery", (50, 50))
    placer.place()
    (box,) = boxes(made, axes).values()
    for mark in marks:
        assert not box.contains(*axes.transData.transform(mark))


def test_the_name_of_a_zone_stands_inside_it(canvas: tuple[Any, Any, LabelPlacer]) -> None:
    made, axes, placer = canvas
    ring = [(5, 5), (60, 5), (60, 40), (30, 40), (30, 95), (5, 95)]
    placer.add("zone of GCSA", ring[0], size=11, bold=True, inside=ring)
    placer.place()
    (box,) = boxes(made, axes).values()
    outline = Ring(axes.transData.transform(ring))
    assert all(outline.contains_point(corner) for corner in box.corners())
