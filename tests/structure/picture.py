# SPDX-License-Identifier: GPL-3.0-or-later

"""Draws `docs/architecture.svg`: the floors of `docs/architecture.md` and the imports between them, as they are.

`python -m tests.structure.picture` (or `make picture`) writes it anew; a test says when it is out of date. What is left
out the document says. The parts of a floor stand where their arrows are short.
"""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from itertools import groupby

from tests.structure.imports import DOCUMENT, Part, edges, floors, part_of

__all__ = ["PICTURE", "arrows", "svg"]

PICTURE = DOCUMENT.with_name("architecture.svg")

_WIDTH, _BOX, _HEIGHT, _STEP, _MARGIN = 1180, 268, 46, 92, 20
_COLOURS = {"core/": "#cfe8d5", "gate/": "#f6d5c3", "companion.py": "#d6e4f5"}


def _shown() -> list[Part]:
    """The parts that get a box of their own: all but the small tools, files on the ground floor."""
    return [part for part in floors() if part.floor > 1 or part.name.endswith("/")]


def arrows() -> set[tuple[str, str]]:
    """Part and part that it imports, of those shown; those that follow from others left out."""
    direct: dict[str, set[str]] = {part.name: set() for part in _shown()}
    for module, others in edges().items():
        for other in others:
            if part_of(module) != part_of(other) and {part_of(module), part_of(other)} <= set(direct):
                direct[part_of(module)].add(part_of(other))
    beyond: dict[str, set[str]] = {}
    for part in reversed(_shown()):  # from the ground up: what is below is known already
        beyond[part.name] = set().union(*({below} | beyond.get(below, set()) for below in direct[part.name]))
    return {
        (part, below)
        for part, others in direct.items()
        for below in others
        if not any(below in beyond.get(other, set()) for other in others)
    }


def _places(drawn: set[tuple[str, str]]) -> Mapping[str, tuple[float, float]]:
    """Where the middle of each box is."""
    rows = [list(row) for _floor, row in groupby(_shown(), key=lambda part: part.floor)]
    places: dict[str, tuple[float, float]] = {}
    for number, row in enumerate(rows):
        above = {part.name: [places[a][0] for a, b in sorted(drawn) if b == part.name and a in places] for part in row}

        def wish(part: Part, above: Mapping[str, list[float]] = above) -> float:
            return sum(above[part.name]) / len(above[part.name]) if above[part.name] else _WIDTH / 2

        ordered = sorted(row, key=lambda part: (wish(part), part.name))
        gap = (_WIDTH - 2 * _MARGIN) / len(ordered)
        for place, part in enumerate(ordered):
            places[part.name] = (_MARGIN + gap * (place + 0.5), _MARGIN + number * _STEP + _HEIGHT / 2)
    return places


def _box(name: str, says: str, middle: tuple[float, float], width: float) -> list[str]:
    (x, y), colour = middle, _COLOURS.get(name, "#f3f5f7")
    return [
        f'<rect x="{x - width / 2:.0f}" y="{y - _HEIGHT / 2:.0f}" width="{width:.0f}" height="{_HEIGHT}" rx="6" '
        f'fill="{colour}" stroke="#7a8590"/>',
        f'<text x="{x:.0f}" y="{y - 4:.0f}" text-anchor="middle" font-size="15" font-weight="bold">'
        f"{escape(name)}</text>",
        f'<text x="{x:.0f}" y="{y + 14:.0f}" text-anchor="middle" font-size="10.5" fill="#333b42">'
        f"{escape(says.replace('`', ''))}</text>",
    ]


def svg() -> str:
    """The picture as text; the same every time."""
    drawn = arrows()
    places = _places(drawn)
    tools = " ".join(part.name for part in floors() if part not in _shown())
    bottom = max(y for _x, y in places.values())
    height = bottom + _STEP + _HEIGHT / 2 + _MARGIN
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height:.0f}" font-family="sans-serif">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#5a6570"/></marker></defs>',
        f'<rect width="{_WIDTH}" height="{height:.0f}" fill="#ffffff"/>',
    ]
    for above, below in sorted(drawn):
        (x1, y1), (x2, y2) = places[above], places[below]
        y1, y2 = y1 + _HEIGHT / 2, y2 - _HEIGHT / 2 - 1
        bend = min(60.0, (y2 - y1) / 2)
        curve = f"M{x1:.0f} {y1:.0f} C{x1:.0f} {y1 + bend:.0f} {x2:.0f} {y2 - bend:.0f} {x2:.0f} {y2:.0f}"
        lines.append(f'<path d="{curve}" fill="none" stroke="#5a6570" stroke-width="1.3" marker-end="url(#tip)"/>')
    for part in _shown():
        lines += _box(part.name, part.says, places[part.name], _BOX)
    lines += _box("small tools", tools, (_WIDTH / 2, bottom + _STEP), 2 * _BOX)
    return "\n".join([*lines, "</svg>"]) + "\n"


if __name__ == "__main__":
    PICTURE.write_text(svg(), encoding="utf-8")
    print(f"{PICTURE} written")
