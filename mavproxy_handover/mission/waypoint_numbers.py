# SPDX-License-Identifier: GPL-3.0-or-later

"""The item numbers of a waypoint file (QGC WPL 110).

MAVProxy, Mission Planner and QGroundControl count the items by their order and pass over the numbers in the file. So
does this package, and says where a number is another one. A file whose first number is 1 has no home. It refuses a
file that begins with another number. It also refuses a DO_JUMP in a file with other numbers, which counts by them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mavproxy_handover.mission.errors import Where
from mavproxy_handover.mission.items import JUMP

__all__ = ["has_home", "odd_numbers"]

#: a line of the file: where it is, and its fields
_Line = tuple[Where, Sequence[str]]


def has_home(lines: Sequence[_Line]) -> bool:
    """True if the first line is home, item 0."""
    return lines[0][1][0] != "1"


def odd_numbers(lines: Sequence[_Line]) -> tuple[str, ...]:
    """A warning if the items of a file do not count up. Raises MissionError if their order cannot be known."""
    where, first = lines[0]
    if first[0] not in ("0", "1"):
        raise where.error(f"item number is '{first[0][:20]}' (allowed here: 0, home, or 1, the first one flown)")
    odd = next(_odd(lines, int(first[0])), None)
    if odd is None:
        return ()
    inside, found, seq = odd
    jump = next((fields for _inside, fields in lines if len(fields) > 3 and fields[3] == str(JUMP)), None)
    if jump is not None or not found.isdecimal():
        because = ", and DO_JUMP counts by it" if found.isdecimal() else ""
        raise inside.error(f"item number is '{found[:20]}'{because} (allowed here: {seq}, items count up from 0)")
    return (
        f"{inside.place} has item number {int(found)} (expected: {seq}): items count by their order, as in ground "
        "station programs. See that no line is missing, and number them from 0",
    )


def _odd(lines: Sequence[_Line], begin: int) -> Iterator[tuple[Where, str, int]]:
    """The lines with another number than their order says; first those whose number is none."""
    odd = [(where, fields[0], seq) for seq, (where, fields) in enumerate(lines, begin) if fields[0] != str(seq)]
    yield from sorted(odd, key=lambda line: line[1].isdecimal())
