# SPDX-License-Identifier: GPL-3.0-or-later

"""Writes the time of ArduPilot's SITL program into the page of simulated time; stops the program while others are late.

The program does not know the page (`sim_time.py`). Its time is read from its messages on the observer's port. If a
program of the run is late, or this vehicle is ahead of the first one, SIGSTOP stops it until they have caught up. It
does not catch up itself: its pace is that of `--speedup` from then on. While the caller gets no processor, another
process stops it (`stopper.py`).
"""

from __future__ import annotations

import os
import signal
from typing import Any, Final

from sitl.run.stopper import Stopper
from sitl.sim_time import LATE_S, Pace, Page

__all__ = ["BOOT_INTERVAL_S", "STEP_S", "Pacing"]

#: the program is asked for its time so often (simulated seconds)
BOOT_INTERVAL_S: Final = 0.02
#: time goes on by this much at once. If the caller was busy, the vehicle is further: a larger step would
#: look to every program as if it had stood still itself
STEP_S: Final = 0.05


class Pacing:
    """One vehicle. `page`: of the run; `leads`: its time is the time of the run; `stopper`: stops it as well."""

    def __init__(self, page: Page, pid: int, speedup: float, *, leads: bool, stopper: Stopper | None = None) -> None:
        self._page, self._pid, self._speedup, self._leads = page, pid, speedup, leads
        self._pace = Pace(page)
        self._sim_s = self._written_s = 0.0
        #: simulated seconds before the autopilot was restarted
        self._before_s = 0.0
        self._last_boot_s = 0.0
        self._held = False
        self._stopper = stopper

    def on_message(self, message: Any) -> None:
        """A message of the vehicle."""
        boot_ms = getattr(message, "time_boot_ms", None)
        if boot_ms is None:
            return
        boot_s = boot_ms / 1000.0
        if boot_s < self._last_boot_s - 1.0:  # it was restarted
            self._before_s = self._sim_s
            self._last_boot_s = boot_s
        self._last_boot_s = max(self._last_boot_s, boot_s)
        self._sim_s = max(self._sim_s, self._before_s + self._last_boot_s)

    def tick(self) -> None:
        """To be called often: every few milliseconds."""
        if self._leads:
            if self._written_s == 0.0:
                self._written_s = self._sim_s
            elif self._pace.may_go_on(self._written_s):
                self._written_s = min(self._sim_s, self._written_s + STEP_S)
            self._page.write(self._written_s, self._speedup)
            hold = self._sim_s > self._written_s or not self._pace.may_go_on(self._written_s)
        else:
            hold = self._sim_s > self._page.read()[0] + LATE_S
        if hold != self._held or (self._stopper is not None and not hold):  # it may have been stopped at any moment
            self._held = hold
            self._signal(signal.SIGSTOP if hold else signal.SIGCONT)

    def release(self) -> None:
        """Let the program run in any case, so that it can end."""
        if self._held or self._stopper is not None:
            self._held = False
            if self._stopper is not None:
                self._stopper.end()
                self._stopper = None
            self._signal(signal.SIGCONT)

    def _signal(self, number: signal.Signals) -> None:
        try:
            os.kill(self._pid, number)
        except ProcessLookupError:
            pass
