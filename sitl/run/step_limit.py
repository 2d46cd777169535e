# SPDX-License-Identifier: GPL-3.0-or-later

"""How long a step of the timeline may take.

1. `timeout_s` is measured in simulated seconds, `timeout_wall_s` on the wall clock.
2. No run hangs, even if the vehicle stops simulating. If the clocks of all programs follow the vehicle's, a step ends
   when simulated time has stood still for `STALLED_S` of the wall clock: a busy machine simulates slowly, but it goes
   on. If the programs go by the wall clock, a step ends after `SLACK_FACTOR` times its limit plus `SLACK_S`.
"""

from __future__ import annotations

from typing import Final

from sitl.script.scenario import Step

__all__ = ["SLACK_FACTOR", "SLACK_S", "STALLED_S", "StepLimit"]

STALLED_S: Final = 60.0
SLACK_FACTOR: Final = 2.5
SLACK_S: Final = 15.0


class StepLimit:
    """The limit of one step, from the moment at which it begins."""

    def __init__(self, step: Step, sim_s: float, wall_s: float, *, follows: bool) -> None:
        """`sim_s`, `wall_s`: both clocks now; `follows`: the clocks of all programs follow the vehicle's."""
        self._limit_s, self._limit_wall_s, self._follows = step.timeout_s, step.timeout_wall_s, follows
        self._begun_s, self._begun_wall_s = sim_s, wall_s
        #: simulated time when it went on last, and the wall clock then
        self._moved_s, self._moved_wall_s = sim_s, wall_s
        if self._limit_s is not None and not follows:
            self._limit_wall_s = self._limit_s * SLACK_FACTOR + SLACK_S

    def passed(self, sim_s: float, wall_s: float) -> str:
        """Which limit the step has passed, in words; nothing while it has time."""
        if self._limit_s is not None and sim_s - self._begun_s > self._limit_s:
            return f"not within {self._limit_s:g} s"
        if self._limit_wall_s is not None and wall_s - self._begun_wall_s > self._limit_wall_s:
            return f"not within {self._limit_wall_s:.0f} s of the wall clock"
        if sim_s > self._moved_s:
            self._moved_s, self._moved_wall_s = sim_s, wall_s
        if self._follows and wall_s - self._moved_wall_s > STALLED_S:
            return f"simulated time has stood still for {STALLED_S:.0f} s"
        return ""
