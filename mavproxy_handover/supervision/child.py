# SPDX-License-Identifier: GPL-3.0-or-later

"""The supervised process: runs MAVProxy so that neither its terminal nor its end can delay it.

* Its console never waits for a reader (`console.py`), and the end of its input does not end it.
* Signals to end go to a thread that waits for them. MAVProxy's own handlers run in a thread that may be waiting for
  typed input. That thread makes MAVProxy end as the word `exit` does: modules unloaded, tlog written. If it has not
  ended within END_S, the process is ended once journal and tlog are closed. The state file is already written by then.
"""

from __future__ import annotations

import os
import signal
import threading
import time
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from mavproxy_handover.supervision.console import Console, read_lines
from mavproxy_handover.supervision.main_loop import end, is_ending
from mavproxy_handover.supervision.rules import LOCKED, REFUSED
from mavproxy_handover.supervision.script import MAIN, Script, mpstate_of
from mavproxy_handover.supervision.supervisor import ENDS
from mavproxy_handover.supervision.tlog import close_logs, log_options, replace_queues
from mavproxy_handover.supervision.watchdog_pipe import Refusal, WatchdogPipe, hold

__all__ = ["Companion", "close_journal"]

#: time (s) that MAVProxy has to end. With the steps after it, this is less than the supervisor's time-out
END_S: Final = 1.4
_LOOK_S: Final = 0.1
#: times (s) for closing the tlog and for the last lines of the console
_LOGS_S, _LAST_S, _CONSOLE_S = 0.5, 0.1, 0.2
#: the name of our module in MAVProxy
_MODULE: Final = "handover"
#: an internal fault (EX_SOFTWARE)
_FAULT: Final = 70
#: no prompt, so signals reach the main thread, and `exit` as a word, because the end of the input ends nothing
_ALWAYS: Final = ("--non-interactive", "--cmd=set requireexit True")
#: options with which MAVProxy has no prompt
_NO_PROMPT: Final = ("--daemon", "--non-interactive")


_CODES: Final = {Refusal.MACHINE: REFUSED, Refusal.LOCKED: LOCKED, Refusal.FAULT: _FAULT}


@dataclass(frozen=True, slots=True)
class Companion:
    """MAVProxy with these options. The supervisor runs it as its child."""

    script: Script
    argv: Sequence[str]

    def __call__(self, line: WatchdogPipe) -> int:
        """Returns the exit code, or ends the process."""
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDS)  # inherited by all threads
        hold(line)
        console = Console()
        console.redirect_output()
        threading.Thread(target=_end_on_time, args=(line,), name="ending", daemon=True).start()
        if not any(option in self.argv for option in _NO_PROMPT):
            threading.Thread(target=_read_console, name="input", daemon=True).start()
        replace_queues(MAIN)
        more = log_options(list(self.argv))
        try:
            code = self.script.run([*self.argv, *more, *_ALWAYS])
        except Exception:  # a fault of MAVProxy, which must be printed before the console closes
            traceback.print_exc()
            code = 1
        mpstate = mpstate_of()
        if mpstate is not None:
            close_logs(mpstate, _LOGS_S)
            if line.lived and is_ending(mpstate):  # MAVProxy always ends with 1
                code = 0
        if line.refused is not None:
            code = _CODES[line.refused]
        console.drain(_CONSOLE_S)
        return code


def _read_console() -> None:
    mpstate: Any = None
    while mpstate is None or getattr(mpstate.status, "thread", None) is None:  # wait for its main loop
        time.sleep(_LOOK_S)
        mpstate = mpstate_of()
    read_lines(mpstate)


def _end_on_time(line: WatchdogPipe) -> None:
    """Wait for a signal to end, or for `exit`; then make sure that the process ends in time."""
    asked = False
    while True:
        asked = asked or signal.sigtimedwait(ENDS, _LOOK_S) is not None
        mpstate = mpstate_of()
        if mpstate is not None and asked:
            end(mpstate)
        if asked or (mpstate is not None and is_ending(mpstate)):
            break
    wanted = asked or line.lived  # otherwise MAVProxy could not start
    if wanted:
        line.ending()
    time.sleep(END_S)
    try:
        if mpstate is not None:
            with suppress(Exception):  # the module reports its faults itself; here the process has to end
                close_journal(mpstate)
            close_logs(mpstate, _LAST_S)
    finally:
        os._exit(int(not wanted))


def close_journal(mpstate: Any) -> None:
    """Let our module close its journal. MAVProxy lists a module after it has loaded it."""
    for module, _package in list(mpstate.modules):
        if module.name == _MODULE:
            module.close_journal()
