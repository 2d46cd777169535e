# SPDX-License-Identifier: GPL-3.0-or-later

"""The corpus of plans (`corpus.py`) through package loading and `handover check`: each is taken, or refused as said."""

from __future__ import annotations

import re
from collections import Counter

import pytest

from mavproxy_handover.mission import MissionError
from mavproxy_handover.mission.check import Severity, check
from mavproxy_handover.mission.items import COMMANDS, difference
from mavproxy_handover.mission.protocol_items import item_message, item_of
from mavproxy_handover.mission.refused_items import NOT_JUDGED, SAFEGUARDS
from tests.mission.corpus import ITEMS, KINDS, OK, REASONS, STORED, Case, cases
from tests.mission.corpus_package import package_of

ALL = tuple(cases())


def test_there_are_as_many_as_promised_and_no_two_have_one_name() -> None:
    assert len(ALL) >= 200
    assert [name for name, count in Counter(case.name for case in ALL).items() if count > 1] == []
    forms = Counter(case.file for case in ALL)
    assert min(forms.values()) > 100


def test_every_item_that_ardupilot_stores_is_there_for_every_kind() -> None:
    assert {row.item.command for row in ITEMS} >= STORED
    kinds = Counter(case.kind for case in ALL)
    assert min(kinds[kind] for kind in KINDS) >= len(ITEMS)


def test_what_is_taken_and_what_is_refused_together_are_what_ardupilot_stores() -> None:
    """185 (flight termination) is refused by name, though ArduPilot would not store it."""
    assert COMMANDS.keys() | SAFEGUARDS.keys() | NOT_JUDGED.keys() == STORED | {185}


def test_every_reason_is_used() -> None:
    assert {case.verdict for case in ALL} == {OK, *REASONS}


@pytest.mark.parametrize("case", [case for case in ALL if case.verdict == OK], ids=lambda case: case.name)
def test_a_plan_that_ardupilot_flies_is_taken(case: Case) -> None:
    package = package_of(case)
    report = check(package)
    assert [finding.text for finding in report.findings if finding.severity is Severity.ERROR] == []
    assert report.energy is not None
    assert report.energy.need_wh > 0.0
    assert report.simulation.length_m > 0.0
    for item in package.route.items:
        assert difference(item, item_of(item_message(item, (1, 1), 0)), package.profile) is None


@pytest.mark.parametrize("case", [case for case in ALL if case.verdict != OK], ids=lambda case: case.name)
def test_a_plan_that_is_refused_says_why(case: Case) -> None:
    with pytest.raises(MissionError) as caught:
        package_of(case)
    words, _planner = REASONS[case.verdict]
    assert [fault for fault in caught.value.faults if not re.search(words, fault)] == []
    assert "\n" not in str(caught.value)
