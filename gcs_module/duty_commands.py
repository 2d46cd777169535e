# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover operator ...`: connects the rules of `duty.py` with the console, the journal and the vehicles."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from gcs_module.aircraft import Aircraft
from gcs_module.duty import NEEDS_OPERATOR, Change, Duty, Outcome
from gcs_module.duty_file import DutyFile
from gcs_module.event_log import StationEventLog

__all__ = ["DutyCommands"]


class DutyCommands:
    """`flown`: names of the aircraft in flight that are commanded from here, "" without one."""

    def __init__(
        self,
        duty: Duty,
        aircraft: Sequence[Aircraft],
        event_log: StationEventLog,
        show: Callable[[str], None],
        flown: Callable[[], str],
        file: DutyFile,
    ) -> None:
        self._file = file
        self._duty = duty
        self._aircraft = aircraft
        self._event_log = event_log
        self._show = show
        self._flown = flown

    @property
    def name(self) -> str:
        """The operator on duty; "" if none is."""
        return self._duty.name

    def next_name(self) -> str:
        """The next operator, who has to confirm the briefing; "" if there is none."""
        return self._duty.next_one(time.monotonic())[0]

    def run(self, args: Sequence[str]) -> Outcome:
        """The command. `args`: what follows `operator`."""
        outcome = self._duty.command(" ".join(args), time.monotonic(), self._flown())
        for aircraft in self._aircraft:
            aircraft.core.manned, aircraft.core.operator = self._duty.manned, self._duty.name
        if outcome.change is Change.BRIEFED:
            for aircraft in self._aircraft:
                aircraft.commands.run(["status"])
        if outcome.change in (Change.TOLD, Change.BRIEFED):
            self._show(outcome.text)
            return outcome
        self._file.keep(self._duty.name)
        self._event_log.duty(outcome, self._duty.name)
        if not self._duty.manned:
            self._event_log.unmanned()
        return outcome

    def refuses(self, word: str) -> bool:
        """Whether the operator's command is refused, because no operator is on duty. Then it is told."""
        if self._duty.manned or word not in NEEDS_OPERATOR:
            return False
        self._show(f"handover {word}: no operator is on duty. Sign on first: 'handover operator NAME'")
        return True
