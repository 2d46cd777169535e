# SPDX-License-Identifier: GPL-3.0-or-later

"""The objects on MAVProxy's map: which pixels they are drawn at. OpenCV is a fake that keeps what it is to draw."""

from __future__ import annotations

import importlib
import pickle
import sys
from collections.abc import Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from gcs_module.map_items import Item, Mark, Paths, Place, Plate, Row, Sign

BLUE, RED, WHITE = (0, 0, 255), (255, 0, 0), (255, 255, 255)
IMAGE = SimpleNamespace(shape=(600, 800, 3))


class Drawing:
    """What was drawn."""

    def __init__(self) -> None:
        self.lines: list[tuple[Any, ...]] = []
        self.words: list[tuple[str, tuple[int, int]]] = []
        self.boxes: list[tuple[tuple[int, int], tuple[int, int], Any]] = []
        self.marks: list[tuple[int, int]] = []

    def module(self) -> ModuleType:
        cv2: Any = ModuleType("cv2")
        for number, name in enumerate(
            ("FONT_HERSHEY_DUPLEX", "FONT_HERSHEY_SIMPLEX", "LINE_AA", "MARKER_DIAMOND", "MARKER_STAR")
        ):
            setattr(cv2, name, number)
        cv2.clipLine = lambda _frame, start, end: (min(*start, *end) >= 0, start, end)
        cv2.line = lambda _img, start, end, colour, width, _kind: self.lines.append((start, end, colour, width))
        cv2.getTextSize = lambda words, *_: ((10 * len(words), 10), 2)
        cv2.putText = lambda _img, words, at, *_: self.words.append((words, at))
        cv2.rectangle = lambda _img, first, second, colour, _width: self.boxes.append((first, second, colour))
        cv2.drawMarker = lambda _img, at, *_: self.marks.append(at)
        return cv2  # type: ignore[no-any-return]


@pytest.fixture
def drawing(monkeypatch: pytest.MonkeyPatch) -> Iterator[Drawing]:
    found = Drawing()
    for name in [name for name in sys.modules if name == "gcs_module.map_drawing" or "mavproxy_map" in name]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "cv2", found.module())
    yield found
    for name in [name for name in sys.modules if name == "gcs_module.map_drawing" or "mavproxy_map" in name]:
        del sys.modules[name]


def draw(item: Item, west: float = 0.0, bounds: tuple[float, float, float, float] | None = None) -> None:
    """On a map of 8 by 6 degrees with its north-west corner at latitude 6 and `west`, 100 pixels a degree."""
    from gcs_module.map_drawing import map_object

    def pixels(place: Place) -> tuple[int, int]:
        return round((place[1] - west) * 100.0), round((6.0 - place[0]) * 100.0)

    slip = map_object("handover 1 x", "1 handover 1", item)
    assert pickle.loads(pickle.dumps(slip)).item == item, "it travels to another process"
    assert slip.clicked(5, 5) is None, "it is in nobody's way"
    slip.draw(IMAGE, pixels, bounds or (0.0, west, 6.0, 8.0))


def test_lines_join_their_places(drawing: Drawing) -> None:
    draw(Paths((((6.0, 0.0), (5.0, 1.0), (5.0, 2.0)), ((4.0, 4.0), (3.0, 4.0))), BLUE, 2))
    assert drawing.lines == [
        ((0, 0), (100, 100), BLUE, 2),
        ((100, 100), (200, 100), BLUE, 2),
        ((400, 200), (400, 300), BLUE, 2),
    ]


def test_an_edge_is_drawn_below_all_of_its_lines(drawing: Drawing) -> None:
    draw(Paths((((6.0, 0.0), (5.0, 1.0), (5.0, 2.0)),), BLUE, 5, edged=True))
    assert [(colour, width) for _start, _end, colour, width in drawing.lines] == [
        (WHITE, 8), (WHITE, 8), (BLUE, 5), (BLUE, 5),
    ]  # fmt: skip


@pytest.mark.parametrize(("west", "first"), [(179.0, 100), (-180.0, 0)])
def test_over_the_180th_meridian_a_line_takes_the_short_way(drawing: Drawing, west: float, first: int) -> None:
    draw(Paths((((5.0, 180.0), (5.0, -179.0)),), BLUE, 2), west)
    assert drawing.lines == [((first, 100), (first + 100, 100), BLUE, 2)]


def test_what_is_out_of_sight_or_out_of_all_bounds_is_left_out(drawing: Drawing) -> None:
    draw(Paths((((7.0, 0.0), (8.0, 0.0)), ((5.0, 1.0), (5.0, 1e9)), ()), BLUE, 2))
    draw(Sign((5.0, 1e9), ("far",), BLUE, Mark.STAR), 0.0, (0.0, 1e9, 6.0, 8.0))
    assert (drawing.lines, drawing.words, drawing.marks) == ([], [], [])


def test_words_stand_below_their_mark_in_the_middle(drawing: Drawing) -> None:
    draw(Sign((3.0, 4.0), ("GCSA", "x"), BLUE, Mark.DIAMOND))
    assert drawing.marks == [(400, 300), (400, 300)]
    assert drawing.words == [("GCSA", (380, 325)), ("x", (395, 344))]
    assert drawing.boxes == [((376, 311), (424, 329), WHITE), ((391, 330), (409, 348), WHITE)]


def test_words_on_a_plate_have_its_colour_behind_them(drawing: Drawing) -> None:
    draw(Sign((3.0, 4.0), ("GCSA",), WHITE, plate=RED))
    assert drawing.boxes == [((376, 296), (424, 314), RED)]
    assert drawing.words == [("GCSA", (380, 310))]


def test_plates_stand_below_each_other_wherever_the_map_is(drawing: Drawing) -> None:
    draw(Plate((Row("CONTROL", WHITE, RED), Row("a", BLUE, WHITE))), 77.0)
    draw(Plate((Row("b", BLUE, WHITE),), 1), 77.0)
    assert drawing.boxes == [
        ((8, 8), (86, 28), RED), ((8, 28), (86, 48), WHITE), ((8, 118), (26, 138), WHITE),
    ]  # fmt: skip
    assert [at for _words, at in drawing.words] == [(12, 22), (12, 42), (12, 132)]


def test_an_empty_plate_is_none(drawing: Drawing) -> None:
    draw(Plate(()))
    assert drawing.boxes == []


def test_a_plate_that_its_station_has_not_renewed_for_three_seconds_is_grey_and_says_so(
    drawing: Drawing, monkeypatch: pytest.MonkeyPatch
) -> None:
    slip = importlib.import_module("gcs_module.map_drawing")
    monkeypatch.setattr(slip, "time", SimpleNamespace(monotonic=lambda: 500.0))
    draw(Plate((Row("CONTROL: GCSB (you)", WHITE, RED),), at=497.0))
    assert [words for words, _at in drawing.words] == ["CONTROL: GCSB (you)"]
    assert drawing.boxes[-1][2] == RED
    drawing.words.clear()
    drawing.boxes.clear()
    draw(Plate((Row("CONTROL: GCSB (you)", WHITE, RED),), at=488.0))
    assert [words for words, _at in drawing.words] == [
        "OLD: 12 s. THIS STATION'S PROGRAM STANDS STILL.",
        "CONTROL: GCSB (you)",
    ]
    assert [colour for _first, _second, colour in drawing.boxes] == [(150, 150, 150), WHITE]
