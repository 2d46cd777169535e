# SPDX-License-Identifier: GPL-3.0-or-later

"""Requests by the operator-control standard, from many stations at once: any program can send them to the manager."""

from __future__ import annotations

from collections.abc import Collection

import pytest

from gcs_module.core import StationCore
from gcs_module.events import (
    AcknowledgeManager,
    Action,
    AskManager,
    AutopilotHeard,
    ControlAsked,
    ControlStatusHeard,
    Notice,
)
from mavproxy_handover.core.common.model import QUESTIONS, Reason, Station

MANAGER, OWN = 191, 201


def station(automatic: Collection[str] = ()) -> StationCore:
    """A station in control of a vehicle whose manager speaks the standard."""
    core = StationCore(Station(OWN, "GCSA"), "drone-1", (Station(202, "GCSB"),), automatic=automatic)
    core.handle(AutopilotHeard(True), 90.0)
    for second in range(8):
        core.handle(ControlStatusHeard(component=MANAGER, manager=True, takeover=False, main=OWN), 90.0 + second)
    assert core.control.in_use
    return core


def flood(core: StationCore, begin: float) -> list[Action]:
    """A second of it: 1,000 requests of stations in turn."""
    actions: list[Action] = []
    for number in range(1000):
        actions += core.handle(ControlAsked(MANAGER, 210 + number % 40, 10.0), begin + number / 1000.0)
    return actions


def test_a_flood_of_requests_does_not_flood_the_operator() -> None:
    core = station()
    core.handle(ControlAsked(MANAGER, 202, 10.0), 100.0)
    asked = core.open_question
    actions = flood(core, 100.1)
    assert core.open_question == asked
    assert sum(isinstance(each, AcknowledgeManager) for each in actions) == 1000
    assert sum(isinstance(each, Notice) for each in actions) == 1


@pytest.mark.parametrize("asks", [1, 2])
def test_a_flood_of_requests_is_allowed_once(asks: int) -> None:
    core = station((QUESTIONS[Reason.REQUESTED],))
    actions = [each for second in range(asks) for each in flood(core, 100.0 + 2.0 * second)]
    assert [each.word for each in actions if isinstance(each, AskManager)] == ["ALLOW"]
    assert sum(isinstance(each, Notice) for each in actions) == 2
