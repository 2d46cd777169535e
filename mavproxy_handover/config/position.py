# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads `[position]`: source of the position, address of the box, layout of its record, limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.box_layouts import ENDING, parse_layout
from mavproxy_handover.config.toml import Table, one_table, read_file
from mavproxy_handover.link.box_line import box_address
from mavproxy_handover.link.forms import LinkError
from mavproxy_handover.tools.key_table import KeyTable, numbers, text, word
from mavproxy_handover.wire.box_layout import LAYOUTS, THESIS, BoxLayout

__all__ = ["ALWAYS", "ARMED", "AUTOPILOT", "BOX", "POSITION", "PositionSettings", "position_settings"]

AUTOPILOT, BOX = _SOURCES = ("autopilot", "box")
#: when the two positions are compared: always, or once the aircraft is armed
ALWAYS, ARMED = _CHECKS = ("always", "armed")


@dataclass(frozen=True, slots=True)
class PositionSettings:
    """Source of the position, and limits outside which it does not count."""

    source: str = AUTOPILOT
    #: address of the box, tcp:HOST:PORT; "": there is none
    box: str = ""
    check: str = ALWAYS
    #: a record that is later than this is not used (s)
    box_age_s: float = 0.5
    #: limits: metres over ground, metres of height, difference of the speeds over ground
    apart_m: float = 25.0
    apart_height_m: float = 30.0
    apart_mps: float = 8.0
    #: time (s) above a limit until they disagree
    apart_s: float = 2.0
    #: time (s) well within all limits until they agree again
    agree_s: float = 5.0
    #: time (s) for which the box counts without a position to compare
    unchecked_s: float = 10.0
    #: layout of the box's record
    layout: BoxLayout = THESIS
    #: the file that the layout comes from; None: it is a known one
    layout_file: Path | None = None
    layout_text: bytes | None = field(default=None, repr=False)


#: Upper limits are so low that a position in another zone never passes. Lower limits are so high that two good
#: receivers never disagree. 0 s unchecked: the box never counts without the autopilot's position
POSITION: Final = KeyTable(
    "position",
    (
        word("source", _SOURCES, "whose position counts: the autopilot's own, or that of the box", AUTOPILOT),
        text(
            "box",
            "where the box is, tcp:HOST:PORT; with source autopilot it only checks; needed with source box",
            "",
            example="tcp:192.0.2.30:4001",
        ),
        text(
            "layout",
            "how the box's record is laid out: thesis (listing 5.7 of the thesis), full, or a file that names its "
            "fields (the name ends with .toml and is relative to this file)",
            THESIS.name,
            rule=f"one of {', '.join(LAYOUTS)}, or a layout's file, which ends with {ENDING}",
        ),
        word("check", _CHECKS, "when the two are compared: always, or while the autopilot is armed", ALWAYS),
        *numbers(
            """
            box_age_s       0.1 to 5   a record that is later than this is not used
            apart_m         2 to 1000  farther apart than this over ground the position is not used
            apart_height_m  2 to 1000  limit of the difference in height
            apart_mps       1 to 50    limit of the difference in speed over ground
            apart_s         0.2 to 30  after this long above a limit a disagreement is reported
            agree_s         0.5 to 60  after this long within two thirds of all three limits they agree again
            unchecked_s     0 to 600   how long the box counts while the autopilot has no position of its own
            """,
            PositionSettings(),
        ),
    ),
    "Whose position of the aircraft counts: the autopilot's, or that of a box on board (docs/position-box.md). If the "
    "source fails, the other one does not replace it: the cause is position_stale.",
)


def position_settings(data: Mapping[str, Any], path: Path, layout_text: bytes | None = None) -> PositionSettings:
    """Parse `[position]`, if it is there. `layout_text`: content of the layout's file; None: read it.

    Raises ConfigError.
    """
    table = one_table(data, POSITION, path)
    given = table.given()
    if given.get("box"):
        try:
            given["box"] = box_address(given["box"])
        except LinkError as error:
            raise table.error("box", str(error).removeprefix("link ")) from None
    elif table["source"] == BOX:
        raise table.error("box", "is missing: where is the box? It must be tcp:HOST:PORT")
    given["layout"], file, content = _layout(table, path, layout_text)
    return PositionSettings(**given, layout_file=file, layout_text=content)


def _layout(table: Table, path: Path, content: bytes | None) -> tuple[BoxLayout, Path | None, bytes | None]:
    """The layout, and the file that it comes from with its text. Raises ConfigError."""
    name: str = table["layout"]
    if name in LAYOUTS:
        return LAYOUTS[name], None, None
    if not name.endswith(ENDING):
        raise table.error("layout", f"{name!r} must be {POSITION['layout'].allowed}")
    file = path.parent / name
    content = read_file(file) if content is None else content
    return parse_layout(content, file), file, content
