# SPDX-License-Identifier: GPL-3.0-or-later

"""The menu "Handover" of MAVProxy's console and map: each entry types a command that the operator could type.

The console calls from its own thread, so the receiver of commands must expect that.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from typing import Any, Final

from MAVProxy.modules.lib import mp_menu, mp_util

from mavproxy_handover.wire.ids import LIMITS, PAYLOAD_COMPIDS

__all__ = ["ENTRIES", "TYPED_ONLY", "Menu"]

#: label in the menu, and the words after `handover` in its command; "give", "override" and "payload" have submenus
ENTRIES: Final = (
    ("Accept", "accept"),
    ("Deny", "deny"),
    ("Start", "start"),
    ("Stop", "stop"),
    ("Continue", "continue"),
    ("Return", "return"),
    ("Resume after a return", "resume"),
    ("Request", "request"),
    ("Give to", "give"),
    ("Release", "release"),
    ("Override for 60 s", "override"),
    ("Payload", "payload"),
    ("Acknowledge alarms", "ack"),
    ("Briefing", "briefing"),
    ("Telemetry", "telemetry"),
    ("Share the mission", "share"),
    ("Rehearse on the ground", "rehearse"),
    ("Report of the rehearsal", "rehearse report"),
    ("End rehearsal", "rehearse end"),
    ("Addresses of the vehicle", "connect"),
    ("Forget the vehicle's address", "disconnect"),
    ("Operator on duty", "operator"),
    ("Operator signs off", "operator off"),
    ("Status", "status"),
)
#: commands that need a word which only the operator knows
TYPED_ONLY: Final = ("delegate", "take")
_PAYLOAD: Final = tuple(
    f"{word}{kind}" for word in ("request", "release") for kind in ("", *(f" {kind}" for kind in PAYLOAD_COMPIDS))
)
_NAME, _WHERE = "Handover", "menu"
#: the modules that have menus
_HOSTS: Final = ("console", "map")


class Menu:
    """One station's menu. `stations`: names of the stations that can get the aircraft."""

    def __init__(self, mpstate: Any, stations: Sequence[str], fault: Callable[[str, str], None]) -> None:
        self._mpstate = mpstate
        self._stations = tuple(stations)
        self._fault = fault
        #: the modules that have the menu, by name
        self._hosts: dict[str, Any] = {}

    def tick(self) -> None:
        """Add the menu where it is missing; to be called each second."""
        # not from MAVProxy's public modules: they still contain a module whose loading failed
        loaded = {module.name: module for module, _package in list(self._mpstate.modules)}
        for name in _HOSTS:
            host = loaded.get(name)
            # without wx MAVProxy's console has no menus, and there are no maps
            if host is not self._hosts.get(name) and (host is None or mp_util.has_wxpython):
                self._hosts[name] = host  # noted before the attempt, so that a failure is not repeated each second
                if host is not None:
                    self._attempt(host.add_menu, self._menu())

    def remove(self) -> None:
        """Remove the menu."""
        loaded = [module for module, _package in list(self._mpstate.modules)]
        for host in self._hosts.values():
            if any(host is module for module in loaded):
                self._attempt(host.remove_menu, self._menu())
        self._hosts.clear()

    def _menu(self) -> Any:
        choices = {"give": self._stations, "override": tuple(LIMITS.values()), "payload": _PAYLOAD}
        items = [
            mp_menu.MPMenuSubMenu(label, [_entry(word, f"{words} {word}") for word in choices[words]])
            if words in choices
            else _entry(label, words)
            for label, words in ENTRIES
            if choices.get(words) != ()
        ]
        return mp_menu.MPMenuSubMenu(_NAME, items)

    def _attempt(self, job: Callable[[Any], None], menu: Any) -> None:
        try:
            job(menu)
        except Exception:
            self._fault(_WHERE, traceback.format_exc(limit=-3))


def _entry(label: str, words: str) -> Any:
    return mp_menu.MPMenuItem(label, f"handover {words}", f"# handover {words}")
