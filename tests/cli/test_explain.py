# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover explain` and docs/safety.md say what is decided, and say it of the table that decides."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest

from mavproxy_handover.cli.explain import main, markdown
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.safety.explain import story
from mavproxy_handover.core.safety.strategy import Fact, decide

DOCUMENT = Path(__file__).parents[2] / "docs" / "safety.md"
CONFIG = """
[vehicle]
name = "drone-1"
parent = "GCSA"
allow_unsigned = true
[[station]]
name = "GCSA"
sysid = 251
links = ["udpin:127.0.0.1:14550"]
[policy]
fence = "land"
off_route = "off"
[hold_off]
fence = 4.5
[clear]
fence = 7.0
"""


def printed(capsys: pytest.CaptureFixture[str], *argv: str) -> str:
    assert main(argv) == 0
    return capsys.readouterr().out


def test_the_document_has_the_tables() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    _before, begin, rest = text.partition("<!-- explain:begin -->\n")
    tables, end, _behind = rest.partition("\n<!-- explain:end -->")
    assert (begin, end) != ("", ""), "the markers are missing"
    assert tables == markdown(), "make it anew: make reference"


def test_the_readme_leads_there() -> None:
    assert "docs/safety.md" in (DOCUMENT.parents[1] / "README.md").read_text(encoding="utf-8")


def test_every_cause_has_its_line(capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(capsys).splitlines()
    assert [line.split()[0] for line in lines[1 : len(Cause) + 1]] == [cause.value for cause in Cause]
    fence = next(line for line in lines if line.startswith("fence"))
    assert fence.split("  ")[0] == "fence"
    assert "outside the fence" in fence
    assert fence.split()[-5:] == ["warn", "(return,", "land,", "off)", "warn"]


def test_a_configuration_is_heeded(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    config = tmp_path / "handover.toml"
    config.write_text(CONFIG)
    lines = printed(capsys, "--config", str(config)).splitlines()
    (fence,) = [line.split() for line in lines if line.startswith("fence")]
    assert fence[4:6] == ["4.5", "s"]
    assert fence[6:10] == ["gone", "for", "7", "s"]
    assert fence[10] == "land"
    assert fence[-1] == "land"
    (route,) = [line for line in lines if line.startswith("off_route")]
    assert route.endswith("nothing")


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (
            "commander_lost place=no",
            [
                "commander_lost (commander lost), policy return:",
                "  no transfer: not so that a station is about to take the aircraft",
                "  no continue: not so that the mission declares this gap",
                "  no return: not so that a place can be reached",
                "  asks for land",
                "decision: LAND, for commander_lost",
            ],
        ),
        (
            "energy pilot",
            [
                "energy (energy only for the way back), policy return:",
                "  asks for return: a place can be reached",
                "  not commanded, a warning: a pilot steers",
                "decision: WARN, for energy",
            ],
        ),
        (
            "coverage_ends flying=no",
            [
                "coverage_ends (coverage ends ahead), policy hold:",
                "  no continue: not so that the mission declares this gap",
                "  asks for hold: it can stand still here",
                "  not commanded, a warning: not so that it is flying",
                "decision: WARN, for coverage_ends",
            ],
        ),
        (
            "off_route fence policy.off_route=off policy.fence=land",
            [
                "off_route: off, not looked at",
                "fence (outside the fence), policy land:",
                "  asks for land",
                "decision: LAND, for fence",
            ],
        ),
        (
            "no_station policy.no_station=hold",
            [
                "no_station (no station here could take the aircraft), policy hold:",
                "  no transfer: not so that a station is about to take the aircraft",
                "  no continue: not so that the mission declares this gap",
                "  no hold: not so that it can stand still here",
                "  asks for return: a place can be reached",
                "decision: RETURN, for no_station",
            ],
        ),
        (
            "no_station policy.no_station=hold may_hold",
            [
                "no_station (no station here could take the aircraft), policy hold:",
                "  no transfer: not so that a station is about to take the aircraft",
                "  no continue: not so that the mission declares this gap",
                "  asks for hold: it can stand still here",
                "decision: HOLD, for no_station",
            ],
        ),
        ("landing", ["decision: none, nothing is wrong"]),
    ],
)
def test_a_state_is_decided_and_explained(capsys: pytest.CaptureFixture[str], state: str, expected: list[str]) -> None:
    assert printed(capsys, "--state", *state.split()).splitlines() == expected


@pytest.mark.parametrize("wrong", ["commander_lost", "out_of_coverage", "position_stale"])
def test_where_nothing_is_held_no_room_for_it_is_taken_for_granted(
    capsys: pytest.CaptureFixture[str], wrong: str
) -> None:
    """The fault: it said HOLD of an aircraft that had left its commander's zone, and the companion returned."""
    state = f"off_route policy.off_route=hold {wrong} policy.{wrong}=warn"
    for words in (state, f"may_hold=no {state}", f"may_hold {state} may_hold=no"):
        assert printed(capsys, "--state", *words.split()).splitlines()[-1] == "decision: RETURN, for off_route"
    for words in (f"{state} may_hold", f"{state} {wrong}=no"):
        assert printed(capsys, "--state", *words.split()).splitlines()[-1] == "decision: HOLD, for off_route"


def test_an_autopilot_that_is_not_heard_is_not_taken_for_heard(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, "--state", "energy", "autopilot_lost").splitlines() == [
        "energy (energy only for the way back), policy return:",
        "  asks for return: a place can be reached",
        "  not commanded, a warning: the autopilot is not heard",
        "autopilot_lost (autopilot not heard), policy warn:",
        "  asks for warn",
        "decision: WARN, for energy",
    ]


def test_what_it_says_is_what_is_decided() -> None:
    policies = {cause: row.policies[0] for cause, row in CAUSES.items()}
    for causes in product(Cause, repeat=2):
        for facts in (set(), set(Fact), {Fact.FLYING, Fact.AUTOPILOT}, {Fact.FLYING, Fact.AUTOPILOT, Fact.MAY_HOLD}):
            decision = decide(set(causes), facts, policies)
            assert decision is not None
            said = story(set(causes), facts, Limits())[-1]
            assert said == f"decision: {decision.action.name}, for {decision.cause.value}"


@pytest.mark.parametrize(
    ("argv", "error"),
    [
        (["--state", "moon"], "moon: 'moon' must be a cause (energy, "),
        (["--state", "kind=plane"], "kind=plane: 'kind' must be a cause (energy, "),
        (["--state", "fence=maybe"], "fence=maybe: 'maybe' must be yes or no"),
        (["--state", "fence="], "fence=: '' must be yes or no"),
        (["--state", "policy.moon=warn"], "policy.moon: 'moon' must be one of energy, "),
        (["--state", "policy.fence=hold"], "policy.fence: 'hold' must be one of warn, return, land, off"),
        (["--config", "nowhere.toml"], "nowhere.toml"),
    ],
)
def test_what_makes_no_sense_is_said_in_one_line(
    capsys: pytest.CaptureFixture[str], argv: list[str], error: str
) -> None:
    assert main(argv) == 2
    said = capsys.readouterr().err
    assert said.startswith("handover explain: ")
    assert error in said
    assert said.count("\n") == 1


def test_it_says_how_each_kind_of_aircraft_does_what_is_decided(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    lines = [line.split("  ") for line in capsys.readouterr().out.splitlines()]
    rows = {line[0]: [cell.strip() for cell in line[1:] if cell.strip()] for line in lines}
    assert rows["action"] == ["copter", "plane", "quadplane"]
    assert rows["hold"] == ["stops, its mission paused", "circles, in LOITER", "circles, in LOITER"]
    assert rows["land"] == [
        "LAND, where it is",
        "the next landing sequence: it cannot come down where it is",
        "QLAND, where it is",
    ]
