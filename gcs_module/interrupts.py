# SPDX-License-Identifier: GPL-3.0-or-later

"""How a station's MAVProxy ends: Ctrl-C, the end of its input, the word `exit`, SIGTERM, SIGHUP.

MAVProxy itself ends at the first Ctrl-C or Ctrl-D without unloading its modules, ignores SIGHUP, and does not know
`exit`. While it waits for a line at its prompt, SIGTERM does not end it. Rules:

1. At a terminal, Ctrl-C, Ctrl-D and `exit` ask first if the station commands an aircraft in flight. The same a second
   time within AGAIN_S (`exit`: EXIT_AGAIN_S) ends the station.
2. In a pipe, and by SIGTERM or SIGHUP, no operator can be asked.
3. A station that ends while it commands an aircraft in flight offers it to the other stations first (`closing`), in
   bounded time. Another signal meanwhile ends it at once.
4. It ends in order: every module is unloaded.
5. A fault here never keeps the station from ending.
6. A station without an input (`--daemon`, `--non-interactive`) ignores SIGHUP, as before: its terminal may go.

Python runs signal handlers in the main thread, where MAVProxy waits for input. Only this thread can install them. On
Windows MAVProxy's prompt reads Ctrl-C as a key, so it ends the station at once there, without rules 1 to 3.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Any, Final

from gcs_module.closing import Closing
from mavproxy_handover.supervision.main_loop import end, is_ending

__all__ = ["AGAIN_S", "Interrupts"]

#: the same a second time within so many seconds ends the station
AGAIN_S: Final = 3.0
#: the same for a word, which takes longer to type
EXIT_AGAIN_S: Final = 15.0
#: MAVProxy's function that waits for a line; it takes an EOFError for the end of its input
_WAITS: Final = "input_loop"
_ERROR_OUTPUT: Final = 2
_NO_INPUT: Final = frozenset(("--daemon", "--non-interactive"))
#: MAVProxy's threads that write the tlog; the end of the program interrupts them
_LOG_WRITER: Final = "log_writer"
_Handler = Callable[[int, FrameType | None], Any] | int | None


class Interrupts:
    """All ways to end, from `install` to `restore`. Times are monotonic seconds. `terminal`: whether an operator sits
    at the input."""

    def __init__(
        self, mpstate: Any, closing: Closing, clock: Callable[[], float], *, terminal: bool | None = None
    ) -> None:
        self._mpstate = mpstate
        self._closing = closing
        self._clock = clock
        self._terminal = _is_terminal() if terminal is None else terminal
        self._asked_at = -EXIT_AGAIN_S
        self._asks = True
        self._leaves = False
        #: the next SIGTERM is this station's own, to end the wait for a line
        self._woken = False
        self._before: dict[int, _Handler] = {}
        self._input: Callable[[], str] | None = None

    def install(self) -> None:
        """Handle them from now on. Nothing changes in another thread than the main one, or in another program than
        MAVProxy, which has no handler for SIGTERM."""
        ours = threading.current_thread() is threading.main_thread()
        if not ours or not callable(signal.getsignal(signal.SIGTERM)):
            return
        handlers = [(signal.SIGINT, self._interrupted), (signal.SIGTERM, self._terminated)]
        if hasattr(signal, "SIGHUP") and not _NO_INPUT & set(sys.argv):
            handlers.append((signal.SIGHUP, self._terminated))
        for number, handler in handlers:
            self._before[number] = signal.signal(number, handler)
        rl: Any = getattr(self._mpstate, "rl", None)
        if hasattr(rl, "input"):
            self._input, rl.input = rl.input, self._read_line
        _quiet_log_writer(self._mpstate)

    def restore(self) -> None:
        """Restore everything. Outside the main thread the handlers stay, and no longer ask."""
        self._asks = False
        if self._input is not None:
            with suppress(AttributeError):
                del self._mpstate.rl.input
            self._input = None
        if threading.current_thread() is threading.main_thread():
            for number, handler in self._before.items():
                signal.signal(number, signal.SIG_DFL if handler is None else handler)
            self._before.clear()

    def on_exit(self) -> None:
        """The operator has typed `exit`; called by the main loop."""
        if not self._must_ask("Type 'exit' again", EXIT_AGAIN_S):
            self._closing.ask(self._wake)

    def _wake(self) -> None:
        """End the main thread's wait for a line, by the signal that ends the station."""
        self._leaves = True
        end(self._mpstate)
        if sys.platform == "win32":
            with suppress(Exception):  # MAVProxy's prompt is not waiting
                application = self._mpstate.rl.session.app
                application.loop.call_soon_threadsafe(lambda: application.exit(exception=EOFError()))
        elif signal.SIGTERM in self._before:
            self._woken = True
            os.kill(os.getpid(), signal.SIGTERM)

    def _read_line(self) -> str:
        """In place of MAVProxy's function that reads a line."""
        assert self._input is not None
        try:
            return self._input()
        except (EOFError, OSError):
            if is_ending(self._mpstate):
                raise
            if self._must_ask("Press Ctrl-D again"):
                return ""
            self._leave()
            raise

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        if getattr(self._mpstate.settings, "requireexit", False):
            raise KeyboardInterrupt  # MAVProxy then says that only 'exit' ends it
        if not self._leaves and self._must_ask("Press Ctrl-C again"):
            return
        self._end(number, frame)

    def _terminated(self, number: int, frame: FrameType | None) -> None:
        self._end(number, frame)

    def _must_ask(self, again: str, within_s: float = AGAIN_S) -> bool:
        """Whether the operator has to confirm; then the question is written. `again`: what confirms it."""
        names = self._names() if self._terminal else ""
        now = self._clock()
        if not names or now - self._asked_at < within_s:
            return False
        self._asked_at = now
        self._say(f"You command {names} in flight. 'handover give STATION' hands it over. "
                  f"{again} within {within_s:.0f} s to end this station.")  # fmt: skip
        return True

    @staticmethod
    def _say(text: str) -> None:
        with suppress(OSError):  # the terminal is gone
            os.write(_ERROR_OUTPUT, f"\n{text}\n".encode())  # the interrupted thread may be inside print()

    def _names(self) -> str:
        try:
            return self._closing.flown if self._asks else ""
        except Exception:  # a fault there must not keep the station from ending
            return ""

    def _leave(self) -> None:
        """Offer what is flown from here to the others, before the station ends."""
        if self._leaves or not self._names():
            return
        self._leaves = True
        self._closing.wait()

    def _end(self, number: int, frame: FrameType | None) -> None:
        self._leave()
        before = self._before.get(number)
        if self._woken:
            self._woken = False
        elif callable(before) and before is not signal.default_int_handler:
            before(number, frame)  # MAVProxy's own: the second SIGTERM forces an exit
        else:
            end(self._mpstate)
        while frame is not None:
            if frame.f_code.co_name == _WAITS:
                raise EOFError
            frame = frame.f_back


def _is_terminal() -> bool:
    try:
        return sys.stdin.isatty()
    except (AttributeError, ValueError):  # closed, or none
        return False


def _quiet_log_writer(mpstate: Any) -> None:
    """No traceback of MAVProxy's log writer when the program ends: its queue is closed under it then."""
    before = threading.excepthook

    def hook(arguments: Any) -> None:
        named = arguments.thread is not None and arguments.thread.name == _LOG_WRITER
        if named and is_ending(mpstate) and issubclass(arguments.exc_type, (EOFError, OSError)):
            return
        before(arguments)

    threading.excepthook = hook
