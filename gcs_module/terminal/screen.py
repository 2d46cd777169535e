# SPDX-License-Identifier: GPL-3.0-or-later

"""The control sequences of a terminal with a status line: a reserved last row, and lines above the input.

The last row is kept out of the scrolling region. A line of the program is inserted above the row of the input, so that
half a command and its cursor stay as they are. Readline does not notice. The sequence: index and cursor up (makes room
below), save the cursor, insert a line, write, restore the cursor, cursor down. All are sequences of the VT220. Linux's
console, xterm and its many relatives, Terminal.app, tmux and screen know them.

Nothing here reads or writes: each function returns what to write.
"""

from __future__ import annotations

import re
from typing import Final

__all__ = ["Screen", "cells", "plain", "without_commands"]

_SAVE, _RESTORE, _RESET = "\x1b7", "\x1b8", "\x1b[0m"
#: a free row below the cursor; the cursor stays in its row of text
_ROOM: Final = "\x1bD\x1b[A"
_COLOURS: Final = re.compile(r"\x1b\[[\d;]*m")
#: what a line may not have: it would move the cursor. Terminals take U+0080 to U+009F for control characters too
_CONTROL: Final = re.compile(r"\x1b(?!\[[\d;]*m)|[\x00-\x06\x08\x0b-\x1a\x1c-\x1f\x7f-\x9f]")
#: and what a text from outside may not have: colours and the bell are the station's, and these letters change the order
#: in which others are shown
_FOREIGN: Final = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
#: rows without which there is no status line
LEAST_ROWS: Final = 4


def plain(text: str) -> str:
    """A text from outside, without what would command the terminal. Tabs and ends of lines stay."""
    return _FOREIGN.sub("", text)


def without_commands(line: str) -> str:
    """A line without what would move the cursor. Colours and the bell stay."""
    return _CONTROL.sub("", line.expandtabs())


def cells(text: str) -> int:
    """The number of cells that a text takes."""
    return len(_COLOURS.sub("", text))


def _rows(line: str, width: int) -> list[str]:
    """A line cut into rows; colours go on in each."""
    colour = "".join(_COLOURS.findall(line)[:1])
    plain = _COLOURS.sub("", line)
    rows = [plain[at : at + width] for at in range(0, len(plain), width)] or [""]
    return [f"{colour}{row}{_RESET}" if colour else row for row in rows]


class Screen:
    """Of one terminal. `columns`, `rows`: its size now."""

    def __init__(self) -> None:
        self.columns, self.rows = 80, 24
        self._reserved = False

    def begin(self, columns: int, rows: int) -> str:
        """Reserve the last row of a terminal of this size; also after its size has changed."""
        self.columns, self.rows = columns, rows
        self._reserved = rows >= LEAST_ROWS
        last = rows - 1 if self._reserved else rows
        return f"{_ROOM}{_SAVE}\x1b[1;{last}r{_RESTORE}"

    def end(self) -> str:
        """Give the last row back."""
        cleared = f"\x1b[{self.rows};1H\x1b[2K" if self._reserved else ""
        self._reserved = False
        return f"{_SAVE}\x1b[r{cleared}{_RESTORE}"

    def status(self, text: str, colour: str) -> str:
        """Write the status line."""
        if not self._reserved:
            return ""
        shown = text[: self.columns - 1].ljust(self.columns - 1)
        return f"{_SAVE}\x1b[{self.rows};1H{colour}{shown}\x1b[K{_RESET}{_RESTORE}"

    def above(self, line: str) -> str:
        """Write a line above the row of the input."""
        clean = without_commands(line)
        bell = "\a" if "\a" in clean else ""
        rows = _rows(clean.replace("\a", ""), self.columns)
        return bell + "".join(f"{_ROOM}{_SAVE}\r\x1b[L{row}{_RESTORE}\x1b[B" for row in rows)

    def prompt(self, text: str) -> str:
        """Write another prompt of the same width over the present one."""
        return f"{_SAVE}\r{text}{_RESTORE}"
