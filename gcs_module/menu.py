# SPDX-License-Identifier: GPL-3.0-or-later

"""The menu "Handover" of MAVProxy's console and map: each entry types a command that the operator could type.

The console calls from a thread of its own what was chosen there; whoever receives commands must reckon with it.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from typing import Any, Final

from MAVProxy.modules.lib import mp_menu, mp_util

__all__ = ["ENTRIES", "Menu"]

#: what stands in the menu, and behind `handover` in the command; "give" has the stations below it
ENTRIES: Final = (
    ("Accept", "accept"),
    ("Deny", "deny"),
    ("Request", "request"),
    ("Give to", "give"),
    ("Release", "release"),
    ("Acknowledge alarms", "ack"),
    ("Rehearse on the ground", "rehearse"),
    ("End rehearsal", "rehearse end"),
    ("Status", "status"),
)
_NAME, _WHERE = "Handover", "menu"
#: the modules that have menus
_HOSTS: Final = ("console", "map")


class Menu:
    """Of one station. `stations`: names of those to whom the aircraft can be given."""

    def __init__(self, mpstate: Any, stations: Sequence[str], fault: Callable[[str, str], None]) -> None:
        self._mpstate = mpstate
        self._stations = tuple(stations)
        self._fault = fault
        #: the module that has the menu, by its name
        self._hosts: dict[str, Any] = {}

    def tick(self) -> None:
        """Put the menu where there is none yet; to be called each second."""
        # not MAVProxy's public modules: one that broke while it was loaded stays among them, half made
        loaded = {module.name: module for module, _package in list(self._mpstate.modules)}
        for name in _HOSTS:
            host = loaded.get(name)
            # without wx MAVProxy's console has no menus, and no map can be
            if host is not self._hosts.get(name) and (host is None or mp_util.has_wxpython):
                self._hosts[name] = host  # whatever comes of it: it is not tried again each second
                if host is not None:
                    self._attempt(host.add_menu, self._menu())

    def remove(self) -> None:
        """Take it away again."""
        loaded = [module for module, _package in list(self._mpstate.modules)]
        for host in self._hosts.values():
            if any(host is module for module in loaded):
                self._attempt(host.remove_menu, self._menu())
        self._hosts.clear()

    def _menu(self) -> Any:
        items = [
            mp_menu.MPMenuSubMenu(label, [_entry(name, f"give {name}") for name in self._stations])
            if words == "give"
            else _entry(label, words)
            for label, words in ENTRIES
            if words != "give" or self._stations
        ]
        return mp_menu.MPMenuSubMenu(_NAME, items)

    def _attempt(self, job: Callable[[Any], None], menu: Any) -> None:
        try:
            job(menu)
        except Exception:
            self._fault(_WHERE, traceback.format_exc(limit=-3))


def _entry(label: str, words: str) -> Any:
    return mp_menu.MPMenuItem(label, f"handover {words}", f"# handover {words}")
