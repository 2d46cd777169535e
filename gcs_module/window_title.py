# SPDX-License-Identifier: GPL-3.0-or-later

"""Titles of MAVProxy's windows: "GCSA: drone-1 - Map". All stations' windows are called "Map" and "Console" else.

MAVProxy gives a window its title when it opens it, in a process of its own. So a title is sent there by the way of the
window's own contents. It is an object that calls `set_title` when that process unpacks it, and is nothing afterwards.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any, Final

from gcs_module.map_view import loaded_maps

__all__ = ["WindowTitles", "set_title"]

_WHERE: Final = "window title"


def set_title(text: str) -> None:
    """In the process of a window: set its title."""
    with suppress(Exception):  # a window without a title is no reason to end it
        from MAVProxy.modules.lib.wx_loader import wx

        for window in wx.GetTopLevelWindows():
            window.SetTitle(text)


class _Title:
    """A title on its way to a window."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return set_title, (self.text,)


class WindowTitles:
    """`names` returns the names of the aircraft; `fault` gets the place of a fault, and its text."""

    def __init__(
        self, mpstate: Any, station: str, names: Callable[[], Iterable[str]], fault: Callable[[str, str], None]
    ) -> None:
        self._mpstate = mpstate
        self._station = station
        self._names = names
        self._fault = fault
        #: window -> its last title
        self._told: dict[int, str] = {}

    def tick(self) -> None:
        """Give every window its title; to be called each second."""
        whose = f"{self._station}: {', '.join(self._names())}"
        pipe = getattr(self._mpstate.console, "parent_pipe_send", None)
        windows: list[tuple[Any, str, Callable[[Any], None]]] = []
        if pipe is not None and self._mpstate.console.is_alive():
            windows.append((self._mpstate.console, f"{whose} - Console", pipe.send))
        for number, each in enumerate(loaded_maps(self._mpstate), 1):
            title = f"{whose} - Map{f' {number}' if number > 1 else ''}"
            if hasattr(each, "object_queue"):
                windows.append((each, title, each.object_queue.put))
        known, self._told = self._told, {}
        for window, title, send in windows:
            self._told[id(window)] = title
            if known.get(id(window)) != title:
                try:
                    send(_Title(title))
                except Exception:
                    self._fault(_WHERE, traceback.format_exc(limit=-3))
