# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover override` typed at a station, and what a station makes of a mission that was changed in flight."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.mission.package import MissionPackage
from tests.module.test_station_control import bench  # noqa: F401 - the fixture
from tests.module.test_station_module import StationBench, connect_message

LIMITS = {"energy": 1, "fence": 2, "coverage": 3}


def overrides(bench: StationBench) -> list[Any]:  # noqa: F811
    return [m for m in bench.sent() if m.get_type() == "HANDOVER_OVERRIDE"]


def answer(bench: StationBench, question: Any, seconds: int, **changed: int) -> None:  # noqa: F811
    fields = {"limit": question.limit, "nonce": question.nonce, **changed}
    bench.hear(mavlink.MAVLink_handover_override_message(251, 190, 1, fields["limit"], fields["nonce"], seconds))
    bench.run(0.1)


@pytest.mark.parametrize("word", LIMITS)
def test_it_goes_to_the_companion_and_its_answer_is_shown(bench: StationBench, word: str) -> None:  # noqa: F811
    bench.mpstate.type(f"handover override {word}")
    (question,) = overrides(bench)
    assert (question.target_system, question.target_component, question.vehicle) == (1, 191, 1)
    assert (question.limit, question.seconds) == (LIMITS[word], 0)
    answer(bench, question, 60)
    assert bench.mpstate.console.said(f"OVERRIDE {word} accepted.")
    assert bench.journal("command")[-1]["result"] == "accepted"
    bench.run(5.0)
    assert overrides(bench) == []


def test_it_is_asked_again_with_the_same_number_until_it_is_answered(bench: StationBench) -> None:  # noqa: F811
    bench.mpstate.type("handover override fence")
    bench.run(2.5)
    asked = overrides(bench)
    assert len(asked) == 3
    assert len({m.nonce for m in asked}) == 1
    answer(bench, asked[0], 60, nonce=asked[0].nonce ^ 1)
    bench.run(1.0)
    assert len(overrides(bench)) == 1, "somebody else's answer"
    answer(bench, asked[0], 0)
    bench.run(0.6)
    assert bench.mpstate.console.said("OVERRIDE fence refused: denied.")
    bench.mpstate.type("handover override fence")
    (again,) = overrides(bench)
    assert again.nonce != asked[0].nonce, "typed anew it is meant anew"


def test_two_limits_in_one_moment_are_two_questions(bench: StationBench) -> None:  # noqa: F811
    bench.mpstate.type("handover override fence")
    bench.mpstate.type("handover override coverage")
    fence, coverage = overrides(bench)
    assert (fence.limit, coverage.limit) == (2, 3)
    assert fence.nonce != coverage.nonce, "the vehicle would take the second for a copy of the first"


def test_an_answer_about_another_limit_is_none(bench: StationBench) -> None:  # noqa: F811
    bench.mpstate.type("handover override coverage")
    (question,) = overrides(bench)
    answer(bench, question, 60, limit=2)
    bench.run(0.3)
    assert not bench.mpstate.console.said("OVERRIDE coverage accepted.")
    answer(bench, question, 60)
    assert bench.mpstate.console.said("OVERRIDE coverage accepted.")


def test_without_an_answer_it_is_given_up(bench: StationBench) -> None:  # noqa: F811
    bench.mpstate.type("handover override energy")
    bench.run(8.0)
    assert len(overrides(bench)) == 5
    assert bench.mpstate.console.said("OVERRIDE energy: no answer of the vehicle.")


@pytest.mark.parametrize("word", ["all", "ENERGY", "1", "covérage"])
def test_a_limit_that_is_none_is_told_and_nothing_sent(bench: StationBench, word: str) -> None:  # noqa: F811
    known = "there are energy, fence, coverage"
    assert bench.mpstate.type(f"handover override {word}") == [f"handover override: no limit {word!r}; {known}"]
    assert overrides(bench) == []


def status(route_changed: int) -> Any:
    return mavlink.MAVLink_authority_status_message(1, 251, 0, 251, 1, 0, 1, 2, 0, 0, route_changed)


def test_the_route_check_rests_while_the_mission_is_not_the_package_s(
    bench: StationBench,  # noqa: F811
    delivery: MissionPackage,
) -> None:
    bench.hear(connect_message(digest=delivery.digest))
    route = bench.module.aircraft[0].route
    assert route._package is not None
    bench.hear(status(0))
    assert route._package is not None
    bench.hear(status(1))
    bench.hear(status(1))
    assert route._package is None
    bench.hear(connect_message(digest=delivery.digest))
    assert route._package is None
    said = [line for line in bench.mpstate.console.lines if "changed the mission in flight" in line]
    assert len(said) == 1
    bench.hear(status(0))
    assert route._package is not None
