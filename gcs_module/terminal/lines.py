# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter in MAVProxy's console: leaves out noise, and lets each event be told once. The tables are in `noise`.

Three kinds of MAVProxy's lines do not come at once:

1. Noise is left out.
2. An event that the station tells itself waits WAIT_S for the station's line, and is left out then.
3. `Got COMMAND_ACK: DO_SET_MODE: NOT_IN_CONTROL` waits for the vehicle's own text, which gives the reason: `mode RTL
   refused: GCSA commands ('handover request')`. It is left out then.

Control characters in a line are left out: much of it is text from the vehicle or another station.

A line whose wait is over is written: nothing that a person did is refused without a word. The filter works on the
console's `writeln`, whichever console MAVProxy has at the moment.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from MAVProxy.modules.lib.textconsole import SimpleConsole

from gcs_module.terminal.noise import TWICE, is_noise
from gcs_module.terminal.screen import plain

__all__ = ["WAIT_S", "ConsoleLines"]

#: how MAVProxy begins the line of an answer to a command (mavproxy_link.py)
_ANSWER: Final = "Got COMMAND_ACK: "
#: the results that refuse nothing, as that line ends with them
_GOES_ON: Final = (": ACCEPTED", ": IN_PROGRESS")
#: what each text of the vehicle about a refusal has in it
_REFUSED: Final = (" refused", "Control denied: ")
#: how a line of the station begins: `[12:31:54|GCSA]`
_OWN: Final = re.compile(r"\[\d\d:\d\d:\d\d\|")
#: how MAVProxy begins a text of the vehicle
_VEHICLES: Final = "AP: "
#: time (s) that a line waits at most
WAIT_S: Final = 1.0
_REMEMBERED: Final = 12


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A line that waits until `until`. `own`: words of the station's line that make it needless, in lower case; empty:
    a text of the vehicle about a refusal does."""

    until: float
    own: tuple[str, ...]
    line: str
    more: tuple[Any, ...]
    named: dict[str, Any]


class ConsoleLines:
    """Times are monotonic seconds. `console` returns MAVProxy's console of now, which its modules replace; `shows_all`:
    whether the operator wants every line; `painted` gives a line of a text console its colours."""

    #: so many lines wait at most; further ones are written at once
    WAITING: Final = 8

    def __init__(
        self,
        console: Callable[[], Any],
        clock: Callable[[], float],
        shows_all: Callable[[], bool] = lambda: False,
        painted: Callable[[str, Any, Any], str] = lambda line, _fg, _bg: line,
    ) -> None:
        self._find = console
        self._clock = clock
        self._shows_all = shows_all
        self._painted = painted
        self._console: Any = None
        self._write: Callable[..., None] | None = None
        self._waiting: deque[_Waiting] = deque()
        #: the station's last lines in lower case, and their times
        self._told: deque[tuple[float, str]] = deque(maxlen=_REMEMBERED)

    def tick(self) -> None:
        """Find a new console, and write the lines that have waited long enough."""
        console = self._find()
        if console is not self._console:
            self.release()
            self._console, self._write = console, console.writeln
            console.writeln = self._writeln
        now = self._clock()
        while self._waiting and self._waiting[0].until <= now:
            self._write_waiting(self._waiting.popleft())

    def said(self, text: str) -> None:
        """The vehicle has said something (STATUSTEXT)."""
        if any(words in text for words in _REFUSED):
            first = next((each for each in self._waiting if not each.own), None)
            if first is not None:
                self._waiting.remove(first)

    def release(self) -> None:
        """Write what waits, and restore the console."""
        while self._waiting:
            self._write_waiting(self._waiting.popleft())
        if self._console is not None:
            if vars(self._console).get("writeln") == self._writeln:  # else another module has replaced it since
                del self._console.writeln
            self._console = self._write = None

    def _writeln(self, text: Any, *more: Any, **named: Any) -> None:
        line = plain(str(text))
        if line.startswith(_VEHICLES):  # what follows the end of a line could pass for a line of the station
            line = line.replace("\n", " ")
        if _OWN.match(line):
            self._on_own(line.lower())
        elif not self._shows_all():
            if is_noise(line):
                return
            own = self._awaited(line)
            if own is not None and self._is_told(own):
                return
            if own is not None and len(self._waiting) < self.WAITING:
                self._waiting.append(_Waiting(self._clock() + WAIT_S, own, line, more, named))
                return
        self._put(line, more, named)

    @staticmethod
    def _awaited(line: str) -> tuple[str, ...] | None:
        """The words that make this line needless; None: it does not wait."""
        if line.startswith(_ANSWER):
            return None if line.endswith(_GOES_ON) else ()
        for each in TWICE:
            found = each.pattern.fullmatch(line)
            if found is not None:
                what = found["what"].rstrip(".").lower()
                return tuple(words.replace("{what}", what).lower() for words in each.own)
        return None

    def _is_told(self, own: tuple[str, ...]) -> bool:
        since = self._clock() - WAIT_S
        return any(at >= since and words in line for at, line in self._told for words in own)

    def _on_own(self, line: str) -> None:
        self._told.append((self._clock(), line))
        for each in [each for each in self._waiting if any(words in line for words in each.own)]:
            self._waiting.remove(each)

    def _write_waiting(self, waiting: _Waiting) -> None:
        self._put(waiting.line, waiting.more, waiting.named)

    def _put(self, line: str, more: tuple[Any, ...], named: dict[str, Any]) -> None:
        if self._write is None:
            return
        if type(self._console) is SimpleConsole:  # MAVProxy's, without windows: it has no colours
            fg, bg = (*more, *(named[name] for name in ("fg", "bg") if name in named), None, None)[:2]
            line = self._painted(line, fg, bg)
        self._write(line, *more, **named)
