# SPDX-License-Identifier: GPL-3.0-or-later

"""What counts when it is not stated: of messages, events and facts, and the limits that no file sets."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any

import pytest

from mavproxy_handover.core.common import authority_facts, events, messages, model, snapshot
from mavproxy_handover.core.common.handling import Handling
from mavproxy_handover.core.common.limits import Limits

#: class -> its truths and numbers that may be left out
DEFAULTS: dict[type, dict[str, Any]] = {
    messages.ConnectAck: {"accepted": True, "manned": True},
    messages.HandoverRequest: {"crossing": 0},
    messages.OnHandover: {"relay": False, "relayed": False, "crossing": 0},
    messages.DroneConnected: {"relay": False, "relayed": False},
    events.BordersSeen: {"route": 0},
    events.AutopilotState: {"circles_s": 0.0, "circle_m": 0.0},
    events.ModeSeen: {"landing": False, "radio": False},
    events.ConditionsSeen: {"energy": False, "off_route": False, "fence": False},
    events.Send: {"attempt": 1},
    model.Station: {"standard": False},
    model.AuthorityView: {
        "epoch": 0,
        "armed": False,
        "handover_id": 0,
        "takeover_allowed": False,
        "crossing": 0,
        "rehearsal": False,
    },
    model.ZoneFact: {"awaits": False},
    model.GapFact: {"ahead": False},
    model.Mission: {"at": 0},
    snapshot.Snapshot: {
        "takeover_allowed": False,
        "proven": True,
        "rehearsal": False,
        "stands": False,
        "kept": False,
    },
    authority_facts.CoverageFacts: {"no_station": False, "links_weak": False, "ends_ahead": False},
    Handling: {"at_place_m": 15.0},
    Limits: {
        "heartbeat_lost_s": 5.0,
        "recovery_s": 2.5,
        "connect_interval_s": 1.0,
        "connect_lost_s": 5.0,
        "deaf_lost_s": 10.0,
        "deaf_share": 0.15,
        "deaf_back_share": 0.3,
        "deaf_back_s": 12.0,
        "retry_first_s": 0.2,
        "retry_growth": 1.5,
        "retry_max_s": 1.0,
        "step_timeout_s": 4.0,
        "operator_timeout_s": 30.0,
        "release_timeout_s": 2.0,
        "forced_timeout_s": 2.0,
        "reserve_timeout_s": 0.8,
        "retry_pause_s": 2.0,
        "denied_pause_s": 10.0,
        "result_timeout_s": 10.0,
        "enter_margin_m": 5.0,
        "leave_margin_m": 5.0,
        "dwell_s": 5.0,
        "exit_soon_s": 8.0,
        "link_weak_s": 3.0,
        "link_steady_s": 30.0,
        "hold_lead_s": 5.0,
        "answer_s": 1.0,
        "hold_s": 60.0,
        "obey_s": 6.0,
        "stuck_s": 30.0,
        "rehearsal_lost_s": 300.0,
        "position_stale_s": 2.0,
        "autopilot_lost_s": 3.0,
        "guard_lost_s": 2.0,
        "guard_required": True,
    },
}


def stated(of: type) -> dict[str, Any]:
    """The truths and numbers that a class has where nothing is stated; words of an enumeration are none."""
    return {
        each.name: each.default
        for each in fields(of)
        if each.default is not MISSING and type(each.default) in (bool, int, float)
    }


@pytest.mark.parametrize("of", DEFAULTS, ids=lambda of: of.__name__)
def test_what_counts_when_it_is_not_stated(of: type) -> None:
    assert stated(of) == DEFAULTS[of]


def test_the_largest_epoch_is_that_of_the_messages() -> None:
    assert messages.EPOCH_MAX == 0x7FFF_FFFF


def test_no_other_class_has_such_a_value() -> None:
    classes = [
        each for module in (authority_facts, events, messages, model, snapshot) for each in vars(module).values()
    ]
    found = {each for each in classes if isinstance(each, type) and hasattr(each, "__dataclass_fields__")}
    assert {each for each in found if stated(each)} <= DEFAULTS.keys()
