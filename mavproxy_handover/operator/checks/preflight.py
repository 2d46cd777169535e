# SPDX-License-Identifier: GPL-3.0-or-later

"""The check before flight: reads the autopilot's parameters on the ground, judges them, and reports findings.

The rules are in `monitors/preflight/rules.py`, the conversation in `vehicle/parameter_reading.py`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Final

from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import GuardState
from mavproxy_handover.core.safety.energy_prior import EnergySettings
from mavproxy_handover.monitors.preflight.onboard_sensors import SENSOR_PARAMETERS, sensor_findings
from mavproxy_handover.monitors.preflight.own_failsafes import PlanFacts
from mavproxy_handover.monitors.preflight.rules import KNOWN, Finding, Found, judge, names_of
from mavproxy_handover.vehicle.parameter_reading import reading
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Conversation, Conversations

__all__ = ["Preflight"]

#: scripts start a few seconds after the autopilot's first heartbeat; a guard that speaks has its parameters
_SETTLE_S = 8.0
_AGAIN_S = 30.0
_REBOOT_S = 3.0
_WRONG_CHANNEL = re.compile(r"HNDO: lease refused, channel (\d+) not (-?\d+)")


_UNSAID: Final = EnergySettings()


def _batteries(energy: EnergySettings) -> int:
    return int(energy.batteries or 1)


class Preflight:
    """Reads once when the autopilot runs and is on the ground; a START does not stop the reading.

    It reads again every half minute while there are findings, and after a restart of the autopilot. `report` gets each
    new finding (text, parameter to change, False), and once that there is no finding (True).
    """

    def __init__(
        self,
        sysid: int,
        aircraft: VehicleState,
        limits: Limits,
        conversations: Conversations,
        report: Callable[[str, str, bool], None],
        energy: EnergySettings = _UNSAID,
        sensors: frozenset[str] | None = None,
        line: Callable[[], str] = str,
    ) -> None:
        """`energy`: the vehicle's own settings, with the number of batteries if the mission does not set it. `sensors`:
        the sensor messages that onboard programs may send. `line`: what does not fit the line to the autopilot; "":
        all fits."""
        self._line = line
        self._sensors = sensors
        self._sysid = sysid
        self._aircraft = aircraft
        self._limits = limits
        self._conversations = conversations
        self._report = report
        #: None: not read yet
        self.findings: tuple[Finding, ...] | None = None
        self._heard_at = -math.inf
        self._due_at = math.inf
        self._unread = True
        self._heard_on: int | None = None
        self._misfit = ""
        self._plan: PlanFacts | None = None
        self._gap_s = 0.0
        self._own_energy = energy
        self._batteries = _batteries(energy)
        self._replanned = False

    def planned(self, plan: PlanFacts | None, gap_s: float = 0.0, energy: EnergySettings | None = None) -> None:
        """The autopilot holds another mission, or none. For a mission, the parameters are read again.

        `gap_s`: the longest limit of its gaps. `energy`: the mission's settings, which override the vehicle's; None:
        unchanged.
        """
        self._plan, self._replanned = plan, plan is not None
        self._gap_s = gap_s
        if energy is not None:
            self._batteries = _batteries(energy.over(self._own_energy))

    def text(self, text: str) -> None:
        """A STATUSTEXT of the autopilot: the guard names the channel that it refuses leases from."""
        match = _WRONG_CHANNEL.fullmatch(text)
        if match is not None:
            self._heard_on = int(match[1])

    def each_second(
        self,
        grounded: bool,
        guard: GuardState,
        firmware: tuple[int, int] | None,
        now: float,
        misfit: str = "",
    ) -> None:
        """Time has passed. `grounded`: neither armed nor flying, or on the ground and always armed. `misfit`: why
        leases and guard do not fit."""
        aircraft, heartbeat_at = self._aircraft, self._aircraft.telemetry.heartbeat.at
        if heartbeat_at - self._heard_at > _REBOOT_S:  # it may be another autopilot
            self._due_at = now + _SETTLE_S
            self._heard_on, self._unread = None, True
        self._heard_at = heartbeat_at
        if self._unread and guard is not GuardState.SILENT:
            self._due_at = now
        if misfit != self._misfit:
            self._misfit, self._due_at = misfit, now
        if self._replanned and self.findings is not None and "preflight" not in self._conversations:
            self._replanned, self._due_at = False, now
        if now < self._due_at or not grounded or now - heartbeat_at > _REBOOT_S or "preflight" in self._conversations:
            return
        self._due_at, self._unread = math.inf, False
        batteries, asked_at = self._batteries, now

        def done(_talk: Conversation, now: float) -> None:
            aircraft.parameters.reading_ended(asked_at)
            values = aircraft.parameters.since(asked_at)
            parameters = {name: values[name] for name in KNOWN if name in values}
            told = aircraft.foreign, self._heard_on, self._plan, self._gap_s, aircraft.profile, batteries
            found = Found(parameters, guard, firmware, *told, aircraft.home_alt_m, self._misfit)
            used = sensor_findings(values, self._sensors) if parameters and self._sensors is not None else ()
            others = tuple(Finding("", text) for text in (self._line(), *used) if text)
            self._conclude((*judge(found, self._limits), *others), now)

        names = names_of(aircraft.profile, batteries)
        names += tuple(name for name in SENSOR_PARAMETERS if self._sensors is not None and name not in names)
        self._conversations.begin("preflight", reading(self._sysid, names), done, now)

    def _conclude(self, findings: tuple[Finding, ...], now: float) -> None:
        before, self.findings = self.findings, findings
        if findings:
            self._due_at = now + _AGAIN_S
        for finding in findings:
            if finding not in (before or ()):
                self._report(finding.text, finding.parameter, False)
        if not findings and before != ():
            self._report("guard, parameters and firmware fit", "", True)
