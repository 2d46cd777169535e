# SPDX-License-Identifier: GPL-3.0-or-later

"""The findings of a check on the map of a mission: marked items, and the list below the map."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from mavproxy_handover.mission.check import Finding, Severity
from mavproxy_handover.mission.colours import ALARM, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["colours_of_items", "list_findings"]

#: colours of errors and warnings; others are not on the map
COLOURS: Final = {Severity.ERROR: ALARM, Severity.WARNING: "#a36a00"}
#: lines of the list, and characters of a line
_MOST_LINES: Final = 20
_LINE: Final = 125
#: size of the words, and distance of two lines (points)
_SIZE, _STEP = 9, 13.0


def colours_of_items(findings: Sequence[Finding]) -> dict[int, str]:
    """The items that errors and warnings name, each with the colour of its gravest one."""
    found: dict[int, str] = {}
    for finding in sorted(findings, key=lambda each: list(Severity).index(each.severity)):
        if finding.item is not None and finding.severity in COLOURS:
            found.setdefault(finding.item, COLOURS[finding.severity])
    return found


def list_findings(axes: Axes, findings: Sequence[Finding], below_points: float) -> None:
    """Write errors and warnings below the axes, so many points lower, in the order of the check."""
    lines: list[tuple[str, str]] = []
    told = [finding for finding in findings if finding.severity in COLOURS]
    for number, finding in enumerate(told):
        wrapped = textwrap.wrap(f"{finding.severity.value}: {finding.text}", _LINE, subsequent_indent="    ")
        if lines and len(lines) + len(wrapped) > _MOST_LINES:
            lines.append((f"and {len(told) - number} more, which the check prints", INK))
            break
        lines += [(line, COLOURS[finding.severity]) for line in wrapped]
    for number, (line, colour) in enumerate(lines):
        axes.annotate(
            line,
            (0.0, 0.0),
            (0.0, -below_points - _STEP * number),
            xycoords="axes fraction",
            textcoords="offset points",
            fontsize=_SIZE,
            color=colour,
            va="top",
            annotation_clip=False,
        )
