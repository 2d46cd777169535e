# SPDX-License-Identifier: GPL-3.0-or-later

"""Ctrl-C and SIGTERM at a station's MAVProxy.

MAVProxy itself ends at the first Ctrl-C without unloading its modules. While it waits for a line at its prompt, SIGTERM
does not end it. Rules:

1. Ctrl-C at a station that commands an aircraft in flight asks first. A second Ctrl-C within AGAIN_S ends the station.
2. Any other Ctrl-C, and SIGTERM always, ends the station in order: every module is unloaded.
3. A fault here never keeps the station from ending.

Python runs signal handlers in the main thread, where MAVProxy waits for input. Only this thread can install them. On
Windows MAVProxy's prompt reads Ctrl-C as a key, so it ends the station at once there.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, Final

from mavproxy_handover.supervision.main_loop import end

__all__ = ["AGAIN_S", "Interrupts"]

#: a second Ctrl-C within so many seconds ends the station
AGAIN_S: Final = 3.0
#: MAVProxy's function that waits for a line; it takes an EOFError for the end of its input
_WAITS: Final = "input_loop"
_ERROR_OUTPUT: Final = 2
_Handler = Callable[[int, FrameType | None], Any] | int | None


class Interrupts:
    """The handlers of both signals, from `install` to `restore`. Times are monotonic seconds.

    `flying`: returns the names of the aircraft in flight that this station commands; "" if there is none.
    """

    def __init__(self, mpstate: Any, flying: Callable[[], str], clock: Callable[[], float]) -> None:
        self._mpstate = mpstate
        self._flying = flying
        self._clock = clock
        self._asked_at = -AGAIN_S
        self._before: dict[int, _Handler] = {}

    def install(self) -> None:
        """Handle both signals from now on. Nothing changes in another thread than the main one, or in another program
        than MAVProxy, which has no handler for SIGTERM."""
        ours = threading.current_thread() is threading.main_thread()
        if ours and callable(signal.getsignal(signal.SIGTERM)):
            for number, handler in ((signal.SIGINT, self._interrupted), (signal.SIGTERM, self._terminated)):
                self._before[number] = signal.signal(number, handler)

    def restore(self) -> None:
        """Restore both signals. Outside the main thread the handlers stay, and no longer ask."""
        self._flying = str
        if threading.current_thread() is threading.main_thread():
            for number, handler in self._before.items():
                signal.signal(number, signal.SIG_DFL if handler is None else handler)
            self._before.clear()

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        if getattr(self._mpstate.settings, "requireexit", False):
            raise KeyboardInterrupt  # MAVProxy then says that only 'exit' ends it
        now = self._clock()
        names = self._names()
        if names and now - self._asked_at >= AGAIN_S:
            self._asked_at = now
            text = (
                f"\nYou command {names} in flight. 'handover give STATION' hands it over. "
                f"Press Ctrl-C again within {AGAIN_S:.0f} s to end this station.\n"
            )
            os.write(_ERROR_OUTPUT, text.encode())  # the interrupted thread may be inside print()
            return
        self._end(number, frame)

    def _terminated(self, number: int, frame: FrameType | None) -> None:
        self._end(number, frame)

    def _names(self) -> str:
        try:
            return self._flying()
        except Exception:  # a fault there must not keep the station from ending
            return ""

    def _end(self, number: int, frame: FrameType | None) -> None:
        before = self._before.get(number)
        if callable(before) and before is not signal.default_int_handler:
            before(number, frame)  # MAVProxy's own: the second SIGTERM forces an exit
        else:
            end(self._mpstate)
        while frame is not None:
            if frame.f_code.co_name == _WAITS:
                raise EOFError
            frame = frame.f_back
