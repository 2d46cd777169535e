# SPDX-License-Identifier: GPL-3.0-or-later

"""The briefing with the question whether this station will take the aircraft: lines of HANDOVER_BRIEFING. Pure.

Lines of one number belong together; a briefing counts when all of them are there. It is shown once for each question,
and again when the operator asks for it.
"""

from __future__ import annotations

from math import inf
from typing import Final

__all__ = ["NAMES", "Briefing"]

#: what stands before each line
NAMES: Final = ("leg", "battery", "wind", "links", "alerts", "next")


class Briefing:
    """The last briefing. Times are monotonic seconds."""

    def __init__(self) -> None:
        self._number: int | None = None
        self._parts: dict[int, str] = {}
        #: whole, and when it came
        self.lines: tuple[str, ...] = ()
        self.at = -inf
        #: the question for which it was shown last
        self._shown_for: object = None

    def add_line(self, number: int, line: int, lines: int, text: str, now: float) -> None:
        """One line has come."""
        if number != self._number:
            self._number, self._parts = number, {}
        if 1 <= line <= lines:
            self._parts[line] = text
        if len(self._parts) == lines:
            texts = [self._parts[each] for each in range(1, lines + 1)]
            self.lines = tuple(f"{_name(at):9} {words}" for at, words in enumerate(texts))
            self.at, self._parts = now, {}

    def due(self, question: object, asked_at: float) -> tuple[str, ...]:
        """What is to be shown with this question, which was asked then; none if it was, or nothing has come since."""
        if question is None or question == self._shown_for or self.at < asked_at:
            return ()
        self._shown_for = question
        return self.lines


def _name(at: int) -> str:
    return NAMES[at] if at < len(NAMES) else ""
