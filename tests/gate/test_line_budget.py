# SPDX-License-Identifier: GPL-3.0-or-later

"""The budget of the line to the autopilot: feeds, onboard programs and payload stations together leave half of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from mavproxy_handover.config.line_claims import line_claims
from mavproxy_handover.config.vehicle import VehicleConfig, load_vehicle
from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.core.feeds import FeedKind
from mavproxy_handover.gate.judge import Fate, GateReason
from mavproxy_handover.gate.line_budget import LineBudget, budget_finding
from mavproxy_handover.gate.onboard import OnboardFilters, OnboardRights, judge_onboard
from mavproxy_handover.gate.policy.onboard import SENSORS, Right
from mavproxy_handover.wire.frames import Frame
from tests.gate.door import Door
from tests.gate.ledger import GCSA, GCSB, VEHICLE, A, B
from tests.gate.test_feeds import rtcm, settings
from tests.gate.test_onboard import COMPONENT, Matters

FLYING = AuthorityView(Phase.ON_MISSION, GCSA, None, 1, LeaseState.HELD, armed=True)
FULL = "the line to the autopilot has no more room"


def budget_at(baud: int | None) -> LineBudget:
    budget = LineBudget()
    budget.line_opened(baud)
    return budget


def test_all_together_leave_half_of_the_line(make: Callable[..., Frame]) -> None:
    """57600 baud are 5760 bytes a second. RTK, two programs and the payload of an observer want 17,000."""
    budget = budget_at(57600)
    door = Door(feeds=settings(GCSB, kinds=[FeedKind.RTK]), step_s=0.0, budget=budget)
    door.change(FLYING)
    door.payload = GCSB
    rights = OnboardRights("mavros", COMPONENT, frozenset(Right), frozenset(SENSORS), 5000.0)
    programs = [OnboardFilters(rights, Matters(budget.allow).matters()) for _number in range(2)]
    odometry = make("ODOMETRY", sysid=VEHICLE, compid=COMPONENT, x=1.0)
    corrections = rtcm(make, GCSB, bytes([255] * 180))
    gimbal = make("GIMBAL_MANAGER_SET_PITCHYAW", sysid=GCSB, target_component=154)
    of_programs = 0
    for _round in range(2000):
        door.now += 0.01
        door.up(B, corrections)
        door.up(B, gimbal)
        for filters in programs:
            verdict = filters.limit(odometry, judge_onboard(odometry, rights, VEHICLE), door.now)
            of_programs += len(odometry.raw) * (verdict.fate is Fate.FORWARD)
    passed = of_programs + sum(len(raw) for raw in door.passed)
    assert passed <= 2880 * (20 + 1)
    assert passed > 2880 * 19, "what there is room for is used"
    assert of_programs > 0
    kept_out = door.frames.counts[GCSB]
    assert kept_out[GateReason.LINE_FULL] > 0
    assert [news.text for news in door.frames.feeds.untold if FULL in news.text] == [
        f"RTK corrections of GCSB are not used: {FULL}."
    ]


def test_the_commander_has_no_part_in_the_budget(make: Callable[..., Frame]) -> None:
    budget = budget_at(9600)
    door = Door(step_s=0.001, budget=budget)
    door.change(FLYING)
    while budget.allow(door.now, 20):
        pass
    sticks = make("MANUAL_CONTROL", sysid=GCSA, target=VEHICLE)
    assert all(door.up(A, sticks).verdict.fate is Fate.FORWARD for _number in range(50))


def test_a_link_without_a_rate_has_no_budget() -> None:
    budget = budget_at(57600)
    assert not all(budget.allow(1.0, 280) for _number in range(100))
    budget.line_opened(None)
    assert all(budget.allow(1.0, 280) for _number in range(100))


@pytest.mark.parametrize(
    ("baud", "expected"),
    [
        (None, ""),
        (115200, ""),
        (
            57600,
            "line to the autopilot: room for 2880 bytes/s at 57600 baud, limits sum to 5500 "
            "(mavros 1500, RTK corrections 4000)",
        ),
    ],
)
def test_limits_that_do_not_fit_the_line_are_found(baud: int | None, expected: str) -> None:
    assert budget_finding({"mavros": 1500.0, "RTK corrections": 4000.0}, baud) == expected


def config_of(more: str, tmp_path: Path) -> VehicleConfig:
    text = f"""
        [vehicle]
        name = "drone-1"
        sysid = 1
        parent = "GCSA"
        journal = "drone-1.jsonl"
        allow_unsigned = true
        [[station]]
        name = "GCSA"
        sysid = 251
        links = ["udpin:127.0.0.1:14551"]
        [[station]]
        name = "GCSB"
        sysid = 252
        links = ["udpin:127.0.0.1:14552"]
        {more}
        """
    path = tmp_path / "handover.toml"
    path.write_text(text)
    return load_vehicle(path)


def test_what_the_file_lets_send(tmp_path: Path) -> None:
    assert line_claims(config_of("", tmp_path)) == {}
    more = """
        [[onboard]]
        name = "precland"
        link = "udpin:127.0.0.1:14600"
        component = 25
        [feeds]
        rtk = ["GCSA", "GCSB"]
        adsb = []
        weather = ["GCSA"]
        [payload]
        control = "GCSB"
        """
    assert line_claims(config_of(more, tmp_path)) == {
        "precland": 2500.0,
        "RTK corrections": 4000.0,
        "weather": 200.0,
        "payload": 3000.0,
    }
