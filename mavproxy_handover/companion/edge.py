# SPDX-License-Identifier: GPL-3.0-or-later

"""Means that the companion gets from the program that it runs in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from mavproxy_handover.gate.line_budget import LineBudget
from mavproxy_handover.monitors.position.source import Box
from mavproxy_handover.operator.onboard.port import OnboardPort
from mavproxy_handover.tools.clocks import Clocks

__all__ = ["Edge"]


@dataclass(frozen=True, slots=True)
class Edge:
    """Of one run."""

    #: writes a whole frame to the autopilot
    write_autopilot: Callable[[bytes], None]
    #: shows a line on the console
    show: Callable[[str], None]
    clocks: Clocks
    #: identifies this run; never 0
    nonce: int
    #: the position box, if there is one
    box: Box | None = None
    #: the onboard programs, each with its open link
    onboard: tuple[OnboardPort, ...] = ()
    #: what others than the commander may send on the line to the autopilot
    budget: LineBudget = field(default_factory=LineBudget)
