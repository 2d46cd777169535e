# SPDX-License-Identifier: GPL-3.0-or-later

"""The terminal of a station's MAVProxy: status line, prompt and colour.

Rules that live here:

1. A terminal with control sequences gets a status line in its last row. Lines of the program come above the row in
   which the operator types. A thread of its own writes them: a terminal that stands still (Ctrl-S, a lost connection)
   never stops the main loop.
2. Any other output is left as MAVProxy writes it: a pipe, a file, TERM=dumb. There the prompt still says which station
   commands, if there is a terminal at all.
3. On Windows MAVProxy's prompt draws the status line (prompt_toolkit).
4. `NO_COLOR` takes the colours away, not the status line.
5. A status line that the main loop has not updated for OLD_S says so.
6. A fault here switches the terminal back to plain output.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from enum import Enum
from typing import Any, Final, TextIO

from gcs_module.alarms import Level
from gcs_module.banner import OLD_S, Situation
from gcs_module.terminal.look import line_colour, prompt, status_colour
from gcs_module.terminal.screen import Screen, cells, without_commands

__all__ = ["Kind", "Terminal", "kind_of"]

#: interval (s) at which the status line is drawn again, and at which the thread looks for lines
_AGAIN_S: Final = 1.0
_TURN_S: Final = 0.1
#: a line without an end is shown after this time (s)
_UNFINISHED_S: Final = 0.3
#: time (s) in which the last lines are written at the end
_END_S: Final = 1.0
#: lines that wait for a terminal that stands still; older ones are lost
_MOST: Final = 1000
#: styles of prompt_toolkit for the levels
_STYLES: Final[Mapping[Level, str]] = {
    Level.INFO: "reverse",
    Level.ADVISORY: "noreverse bg:ansiblue fg:ansiwhite",
    Level.WARNING: "noreverse bg:ansiyellow fg:ansiblack",
    Level.EMERGENCY: "noreverse bold bg:ansired fg:ansiwhite",
}


class Kind(Enum):
    """Kinds of the station's input and output."""

    PIPE = "no terminal"
    PLAIN = "a terminal without control sequences"
    FULL = "a terminal with control sequences"
    WINDOWS = "MAVProxy's prompt on Windows"


def kind_of(platform: str, environment: Mapping[str, str], *terminals: bool) -> Kind:
    """The kind of terminal. `terminals`: whether input and output are terminals."""
    if not all(terminals):
        return Kind.PIPE
    if platform == "win32":
        return Kind.WINDOWS
    return Kind.PLAIN if environment.get("TERM", "dumb") in ("", "dumb", "unknown") else Kind.FULL


def _is_terminal(stream: Any) -> bool:
    try:
        return bool(stream.isatty())
    except (AttributeError, ValueError):  # closed, or none
        return False


class _Output:
    """In place of standard output: complete lines go to `line`, everything else is the stream's own."""

    def __init__(self, stream: TextIO, line: Callable[[str], None]) -> None:
        self._stream = stream
        self._line = line
        self._lock = threading.Lock()
        self._unfinished, self._since = "", 0.0

    def write(self, text: str) -> int:
        """Take a text; what ends a line is passed on."""
        with self._lock:
            *lines, rest = f"{self._unfinished}{text}".split("\n")
            if rest and not self._unfinished:
                self._since = time.monotonic()
            self._unfinished = rest
            if rest and not rest.strip("\a"):  # a bell needs no line
                self._unfinished = ""
                lines.append(rest)
            for line in lines:
                self._line(line.rsplit("\r", 1)[-1] if not line.endswith("\r") else line.rstrip("\r"))
        return len(text)

    def flush(self) -> None:
        """Lines are written by the terminal's thread."""

    def push(self, *, everything: bool = False) -> None:
        """Pass on a text that has had no end for a while."""
        with self._lock:
            if self._unfinished and (everything or time.monotonic() - self._since > _UNFINISHED_S):
                line, self._unfinished = self._unfinished, ""
                self._line(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class Terminal:
    """Of one station, from `install` to `restore`. `situation`: of the chosen aircraft, for the prompt; `fault` gets
    the place of a fault, and its text."""

    def __init__(
        self,
        mpstate: Any,
        situation: Callable[[], Situation | None],
        fault: Callable[[str, str], None],
        kind: Kind | None = None,
    ) -> None:
        self._mpstate = mpstate
        self._situation = situation
        self._fault = fault
        terminals = _is_terminal(sys.stdin), _is_terminal(sys.stdout)
        self.kind = kind_of(sys.platform, os.environ, *terminals) if kind is None else kind
        self.colour = not os.environ.get("NO_COLOR")
        self._screen = Screen()
        #: MAVProxy's own prompt, and the one that readline has; "": the program waits for no line
        self._mavproxys = ""
        self._readlines = ""
        self._kept: dict[str, Any] = {}
        self._output: _Output | None = None
        self._stream: TextIO = sys.stdout
        self._lines: deque[str] = deque(maxlen=_MOST)
        self._status = ("", Level.INFO)
        self._updated_at = time.monotonic()
        self._ends = threading.Event()
        self._wakes = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def width(self) -> int:
        """The number of columns for the status line."""
        return self._screen.columns

    def install(self) -> None:
        """Begin; does nothing without a terminal."""
        rl = self._mpstate.rl
        if self.kind is Kind.PIPE or not hasattr(rl, "get_prompt"):
            return
        self._mavproxys = str(getattr(rl, "prompt", ""))
        for name, ours in (("get_prompt", self._get_prompt), ("set_prompt", self._set_prompt)):
            self._kept[name] = getattr(rl, name)
            setattr(rl, name, ours)
        if self.kind is Kind.WINDOWS and hasattr(rl, "session"):
            rl.session.bottom_toolbar = self._toolbar
        if self.kind is Kind.FULL:
            self._stream = sys.stdout
            self._output = _Output(self._stream, self._add)
            sys.stdout = self._output
            self._thread = threading.Thread(target=self._run, name="handover-terminal", daemon=True)
            self._thread.start()

    def restore(self) -> None:
        """End, with everything as before. What waits is written, if the terminal takes it in time."""
        for name in self._kept:
            with suppress(AttributeError):
                delattr(self._mpstate.rl, name)
        if self.kind is Kind.WINDOWS and self._kept and hasattr(self._mpstate.rl, "session"):
            self._mpstate.rl.session.bottom_toolbar = None
        self._kept.clear()
        self._ends.set()
        self._wakes.set()
        if self._thread is not None:
            self._thread.join(_END_S)
        if self._output is not None and sys.stdout is self._output:
            sys.stdout = self._stream
        self._output = self._thread = None

    def update(self, text: str, level: Level) -> None:
        """The status line from now on; to be called each second."""
        self._status, self._updated_at = (text, level), time.monotonic()
        self._wakes.set()

    def painted(self, line: str, fg: Any, bg: Any) -> str:
        """A line of MAVProxy's text console, with its colours if the terminal has any."""
        return line_colour(line, fg, bg) if self.colour and self.kind is Kind.FULL and self._output else line

    # ---- the prompt -----------------------------------------------------------------------------------------------

    def _get_prompt(self) -> str:
        """The prompt with which MAVProxy waits for the next line."""
        self._readlines = self._words(0)
        return self._readlines

    def _words(self, width: int) -> str:
        fixed = self.kind is Kind.FULL
        try:
            return prompt(self._mavproxys, self._situation(), width, fixed=fixed)
        except Exception as error:
            self._fault("prompt", repr(error))
            return self._mavproxys

    def _set_prompt(self, text: str) -> None:
        """In place of MAVProxy's: it would write the prompt wherever the cursor is."""
        changed, self._mavproxys = text != self._mavproxys, text
        self._mpstate.rl.prompt = text
        if changed and self.kind is Kind.PLAIN:
            self._stream.write(self._words(0))
            self._stream.flush()
        self._wakes.set()

    def _toolbar(self) -> list[tuple[str, str]]:
        text, level = self._told()
        return [(_STYLES[level] if self.colour else "reverse", text)]

    # ---- the thread -----------------------------------------------------------------------------------------------

    def _add(self, line: str) -> None:
        self._lines.append(line)
        self._wakes.set()

    def _told(self) -> tuple[str, Level]:
        """The status line; one that is not updated says so."""
        text, level = self._status
        old_s = time.monotonic() - self._updated_at
        if text and old_s > OLD_S:
            return f" OLD: {old_s:.0f} s. THIS STATION'S PROGRAM STANDS STILL. |{text}", Level.EMERGENCY
        return text, level

    def _run(self) -> None:
        try:
            self._write(self._screen.begin(*_size(self._stream)))
            drawn_at = 0.0
            while not self._ends.is_set():
                self._wakes.wait(_TURN_S)
                self._wakes.clear()
                if self._output is not None:
                    self._output.push()
                self._write_lines()
                if time.monotonic() - drawn_at >= _AGAIN_S:
                    drawn_at = time.monotonic()
                    self._draw()
            if self._output is not None:
                self._output.push(everything=True)
            self._write_lines()
            self._write(self._screen.end())
        except Exception as error:  # the terminal is gone, or does not take our characters
            if self._output is not None and sys.stdout is self._output:
                sys.stdout = self._stream
            self._fault("terminal", repr(error))

    def _write_lines(self) -> None:
        while self._lines:
            line = self._lines.popleft()
            self._write(f"\r\n{without_commands(line)}\r\n" if self._wraps() else self._screen.above(line))

    def _draw(self) -> None:
        """Draw the status line, and a prompt that has changed."""
        size = _size(self._stream)
        if size != (self._screen.columns, self._screen.rows):
            self._write(self._screen.begin(*size))
        text, level = self._told()
        self._write(self._screen.status(text, status_colour(level, colour=self.colour)))
        held = self._readlines
        words = self._words(len(held)) if held else held
        if words != held and len(words) == len(held) and not self._wraps():
            self._write(self._screen.prompt(words))

    def _wraps(self) -> bool:
        """Whether the operator's line takes more than one row."""
        from MAVProxy.modules.lib import rline

        buffer = getattr(getattr(rline, "readline", None), "get_line_buffer", str)()
        return cells(self._readlines) + len(buffer) >= self._screen.columns

    def _write(self, text: str) -> None:
        if text:
            self._stream.write(text)
            self._stream.flush()


def _size(stream: TextIO) -> tuple[int, int]:
    """Columns and rows of a terminal."""
    try:
        size = os.get_terminal_size(stream.fileno())
    except (OSError, ValueError):
        return 80, 24
    return (size.columns, size.lines) if size.columns and size.lines else (80, 24)
