# SPDX-License-Identifier: GPL-3.0-or-later

"""Leaves out MAVProxy's line for a refused command where the vehicle says why.

MAVProxy writes `Got COMMAND_ACK: DO_SET_MODE: NOT_IN_CONTROL` for each answer. The vehicle's own text follows:
`mode RTL refused: GCSA commands ('handover request')`. The first line says less and comes first, so it waits until the
text is there, and is then left out. If no text comes within WAIT_S, it is written: an autopilot may refuse without one,
and the vehicle does not repeat a text at once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Final

__all__ = ["AnswerLines"]

#: how MAVProxy begins the line of an answer to a command (mavproxy_link.py)
_ANSWER: Final = "Got COMMAND_ACK: "
#: the results that refuse nothing, as that line ends with them
_GOES_ON: Final = (": ACCEPTED", ": IN_PROGRESS")
#: what each text of the vehicle about a refusal has in it
_REFUSED: Final = " refused"
#: time (s) that the line waits for such a text
WAIT_S: Final = 1.0


class AnswerLines:
    """Times are monotonic seconds. `console` returns MAVProxy's console of now, which its modules replace."""

    #: so many lines wait at most; further ones are written at once
    WAITING: Final = 8

    def __init__(self, console: Callable[[], Any], clock: Callable[[], float]) -> None:
        self._find = console
        self._clock = clock
        self._console: Any = None
        self._write: Callable[..., None] | None = None
        #: lines that wait, and until when
        self._waiting: deque[tuple[float, str, tuple[Any, ...], dict[str, Any]]] = deque()

    def tick(self) -> None:
        """Find a new console, and write the lines that have waited long enough."""
        console = self._find()
        if console is not self._console:
            self.release()
            self._console, self._write = console, console.writeln
            console.writeln = self._writeln
        now = self._clock()
        while self._waiting and self._waiting[0][0] <= now:
            self._write_next()

    def said(self, text: str) -> None:
        """The vehicle has said something (STATUSTEXT)."""
        if _REFUSED in text and self._waiting:
            self._waiting.popleft()

    def release(self) -> None:
        """Write what waits, and restore the console."""
        while self._waiting:
            self._write_next()
        if self._console is not None:
            if vars(self._console).get("writeln") == self._writeln:  # else another module has replaced it since
                del self._console.writeln
            self._console = self._write = None

    def _writeln(self, text: Any, *more: Any, **named: Any) -> None:
        line = str(text)
        waits = line.startswith(_ANSWER) and not line.endswith(_GOES_ON) and len(self._waiting) < self.WAITING
        if waits:
            self._waiting.append((self._clock() + WAIT_S, line, more, named))
        elif self._write is not None:
            self._write(text, *more, **named)

    def _write_next(self) -> None:
        _until, line, more, named = self._waiting.popleft()
        if self._write is not None:
            self._write(line, *more, **named)
