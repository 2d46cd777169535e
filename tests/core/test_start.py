# SPDX-License-Identifier: GPL-3.0-or-later

"""What START still lacks, as a table: each fact alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mavproxy_handover.core.authority.start import StartFacts, start_needs

READY = StartFacts(
    station="GCSA",
    commands=True,
    on_ground=True,
    mission_loaded=True,
    in_transfer=False,
    autopilot_alive=True,
    foreign="",
    guard_lacks="",
    position_known=True,
    in_zone=True,
)

NEEDS = {
    "commands": "GCSA does not command",
    "on_ground": "the vehicle is already flying or starting",
    "mission_loaded": "no mission loaded",
    "in_transfer": "a handover is under way",
    "autopilot_alive": "no autopilot",
    "position_known": "no position",
    "in_zone": "outside the zone of GCSA",
}


def test_with_everything_there_nothing_is_needed() -> None:
    assert start_needs(READY) == ()


@pytest.mark.parametrize("fact", NEEDS)
def test_each_fact_alone_is_named(fact: str) -> None:
    assert start_needs(replace(READY, **{fact: not getattr(READY, fact)})) == (NEEDS[fact],)


def test_what_the_guard_lacks_is_said_in_its_words() -> None:
    assert start_needs(replace(READY, guard_lacks="the guard is older than this companion")) == (
        "the guard is older than this companion",
    )


def test_what_the_position_box_lacks_is_said_in_its_words() -> None:
    says = "position box sends layout 'full', not 'thesis'"
    assert start_needs(replace(READY, box_lacks=says)) == (says,)


def test_what_is_no_arducopter_does_not_start() -> None:
    assert start_needs(replace(READY, foreign="ardupilotmega ground rover")) == (
        "ardupilotmega ground rover is neither ArduCopter nor ArduPlane",
    )


def test_without_a_position_nothing_is_said_about_the_zone() -> None:
    assert start_needs(replace(READY, position_known=False, in_zone=False)) == ("no position",)


def test_what_is_lacking_in_energy_is_said_in_its_words() -> None:
    assert start_needs(replace(READY, energy_short="41.0 Wh are needed, 12.0 Wh are left")) == (
        "energy: 41.0 Wh are needed, 12.0 Wh are left",
    )


@pytest.mark.parametrize(
    ("fact", "says"),
    [
        ("aircraft_lacks", "lacks something"),
        ("heights_lack", "heights: lacks something"),
        ("return_lacks", "a return does not land: lacks something"),
        ("gaps_lack", "gaps: lacks something"),
    ],
)
def test_what_a_monitor_finds_is_said_in_its_words(fact: str, says: str) -> None:
    assert start_needs(replace(READY, **{fact: "lacks something"})) == (says,)


def test_why_no_mission_is_loaded_and_what_consent_lacks_is_said_too() -> None:
    facts = replace(READY, mission_loaded=False, mission_lacks="it is for a plane", consent_lacks=("no consent",))
    assert start_needs(facts) == ("no mission loaded, because it is for a plane", "no consent")


@pytest.mark.parametrize("on_ground", [True, False])
def test_a_rehearsal_is_named_and_not_that_it_flies(on_ground: bool) -> None:
    facts = replace(READY, rehearsing=True, on_ground=on_ground)
    assert start_needs(facts) == ("a rehearsal is under way: nothing arms",)
