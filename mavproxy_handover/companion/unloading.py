# SPDX-License-Identifier: GPL-3.0-or-later

"""Asks for confirmation before `module unload handover` in flight.

Unloading in flight removes authority and gate, and the guard brings the aircraft home, so the command must be typed
twice. MAVProxy does not ask a module whether it may be unloaded. So its command `module` is redirected to here while
our module is loaded.
"""

from __future__ import annotations

import os.path
from collections.abc import Callable
from typing import Any, Final

__all__ = ["AGAIN_S", "UnloadQuestion"]

#: a repetition within this time (s) confirms it
AGAIN_S: Final = 10.0
_WORDS: Final = ("unload", "reload")


class UnloadQuestion:
    """Replaces `module` in MAVProxy's table of commands, from `install` to `give_back`. Times are monotonic seconds."""

    def __init__(
        self,
        command_map: dict[str, Any],
        module: str,
        *,
        flies: Callable[[], bool],
        show: Callable[[str], None],
        clock: Callable[[], float],
    ) -> None:
        self._command_map = command_map
        self._module = module
        self._flies = flies
        self._show = show
        self._clock = clock
        self._asked_at = -AGAIN_S
        self._inner: tuple[Callable[[list[str]], None], str] | None = None
        self._own: tuple[Callable[[list[str]], None], str] | None = None

    def install(self) -> None:
        """Redirect the command to here."""
        self._inner = self._command_map.get("module")
        if self._inner is not None:
            self._own = self._command_map["module"] = (self._run, self._inner[1])

    def give_back(self) -> None:
        """Restore the command, unless another program has replaced it since."""
        if self._inner is not None and self._command_map.get("module") is self._own:
            self._command_map["module"] = self._inner
        self._inner = None

    def _run(self, args: list[str]) -> None:
        inner = self._inner
        if inner is None or (self._is_ours(args) and self._must_be_asked()):
            return
        inner[0](args)

    def _is_ours(self, args: list[str]) -> bool:
        named = args[1].partition(":")[0] if len(args) > 1 else ""
        return args[:1] != [] and args[0] in _WORDS and os.path.basename(named) == self._module

    def _must_be_asked(self) -> bool:
        now = self._clock()
        if not self._flies() or now - self._asked_at < AGAIN_S:
            return False
        self._asked_at = now
        self._show(
            f"{self._module}: the aircraft is in flight. Without this module no station commands it, and the guard "
            f"brings it home. Type it again within {AGAIN_S:.0f} s if that is meant."
        )
        return True
