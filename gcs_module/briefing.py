# SPDX-License-Identifier: GPL-3.0-or-later

"""The briefing with the question whether this station takes the aircraft: lines of HANDOVER_BRIEFING. Pure.

Lines with the same number belong together; a briefing counts when it is complete. It is shown once for each question,
and again if the operator asks for it.
"""

from __future__ import annotations

from math import inf
from typing import Final

__all__ = ["NAMES", "Briefing"]

#: the label of each line
NAMES: Final = ("leg", "battery", "wind", "links", "alerts", "next")


class Briefing:
    """The last briefing. Times are monotonic seconds."""

    def __init__(self) -> None:
        self._number: int | None = None
        self._parts: dict[int, str] = {}
        #: the lines of the last complete briefing, and when it was complete
        self.lines: tuple[str, ...] = ()
        #: label and text of each line
        self.pairs: tuple[tuple[str, str], ...] = ()
        self.at = -inf
        #: the question with which it was last shown
        self._shown_for: object = None

    def add_line(self, number: int, line: int, lines: int, text: str, now: float) -> None:
        """One line has arrived."""
        if number != self._number:
            self._number, self._parts = number, {}
        if 1 <= line <= lines:
            self._parts[line] = text
        if len(self._parts) == lines:
            texts = [self._parts[each] for each in range(1, lines + 1)]
            self.pairs = tuple((_name(at), words) for at, words in enumerate(texts))
            self.lines = tuple(f"{name:9} {words}" for name, words in self.pairs)
            self.at, self._parts = now, {}

    def due(self, question: object, asked_at: float) -> tuple[str, ...]:
        """The lines to show with this question, asked at `asked_at`.

        None if they were shown, or if no briefing has come since.
        """
        if question is None or question == self._shown_for or self.at < asked_at:
            return ()
        self._shown_for = question
        return self.lines


def _name(at: int) -> str:
    return NAMES[at] if at < len(NAMES) else ""
