# SPDX-License-Identifier: GPL-3.0-or-later

"""Ctrl-C and SIGTERM at a station's MAVProxy.

MAVProxy itself ends at the first Ctrl-C without unloading its modules, and a SIGTERM does not end it while it waits for
a line at its prompt. Rules:

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

from mavproxy_handover.main_loop import end

__all__ = ["AGAIN_S", "Interrupts"]

#: a second Ctrl-C within so many seconds ends the station
AGAIN_S: Final = 3.0
#: MAVProxy's function that waits for a line; it takes an EOFError for the end of its input
_WAITS: Final = "input_loop"
_ERROR_OUTPUT: Final = 2
_Handler = Callable[[int, FrameType | None], Any] | int | None


class Interrupts:
    """The handlers of both signals, from `take` to `give_back`. Times are monotonic seconds.

    `flying`: names of the aircraft in flight that this station commands; "" if there is none.
    """

    def __init__(self, mpstate: Any, flying: Callable[[], str], clock: Callable[[], float]) -> None:
        self._mpstate = mpstate
        self._flying = flying
        self._clock = clock
        self._asked_at = -AGAIN_S
        self._before: dict[int, _Handler] = {}

    def take(self) -> None:
        """Handle both signals from now on. Nothing changes in another thread than the main one, or in a program that is
        not MAVProxy's: that has no handler for SIGTERM."""
        ours = threading.current_thread() is threading.main_thread()
        if ours and callable(signal.getsignal(signal.SIGTERM)):
            for number, handler in ((signal.SIGINT, self._interrupted), (signal.SIGTERM, self._terminated)):
                self._before[number] = signal.signal(number, handler)

    def give_back(self) -> None:
        """Leave both signals as they were. Outside the main thread the handlers stay, and ask no more."""
        self._flying = str
        if threading.current_thread() is threading.main_thread():
            for number, handler in self._before.items():
                signal.signal(number, signal.SIG_DFL if handler is None else handler)
            self._before.clear()

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        if getattr(self._mpstate.settings, "requireexit", False):
            raise KeyboardInterrupt  # MAVProxy then says that it ends by 'exit' only
        now = self._clock()
        names = self._names()
        if names and now - self._asked_at >= AGAIN_S:
            self._asked_at = now
            text = (
                f"\nYou command {names} in flight. 'handover give STATION' hands it over. "
                f"Press Ctrl-C again within {AGAIN_S:.0f} s to end this station.\n"
            )
            os.write(_ERROR_OUTPUT, text.encode())  # print() may be at work in the thread that was interrupted
            return
        self._end(number, frame)

    def _terminated(self, number: int, frame: FrameType | None) -> None:
        self._end(number, frame)

    def _names(self) -> str:
        try:
            return self._flying()
        except Exception:  # whatever is broken there: the station can be ended
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
