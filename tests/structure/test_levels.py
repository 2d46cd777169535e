# SPDX-License-Identifier: GPL-3.0-or-later

"""A decision has one level: as STATUSTEXT, at a station, on the watch page, in the report, in the page of messages."""

from __future__ import annotations

import re

import pytest

from gcs_module import alarms
from gcs_module.texts import SEVERITIES as LEVEL_OF
from gcs_module.watch import journals, link_reader
from mavproxy_handover.core.common.levels import DECISION_LEVELS, Level
from mavproxy_handover.core.common.model import FlightAction
from mavproxy_handover.operator.stations.announcer import SEVERITIES
from mavproxy_handover.wire.texts import SEVERITY
from reference.sentences import COMPANION
from sitl.report.journal_reader import Entry
from sitl.report.outcome import level_of


def test_the_levels_of_decisions_written_out() -> None:
    assert {getattr(action, "name", None): level.name for action, level in DECISION_LEVELS.items()} == {
        None: "ADVISORY",
        "WARN": "WARNING",
        "TRANSFER": "WARNING",
        "CONTINUE": "WARNING",
        "HOLD": "WARNING",
        "RETURN": "EMERGENCY",
        "LAND": "EMERGENCY",
    }


@pytest.mark.parametrize("action", FlightAction)
def test_a_decision_has_one_level_everywhere(action: FlightAction) -> None:
    word = {FlightAction.WARN: "WARNING"}.get(action, action.name)
    text = f"{word}. GCSB silent for 5 s"
    if action is FlightAction.CONTINUE:
        text += ". It crosses the mission's gap GCSA -> GCSB, 40 s left"
    row = COMPANION.find(text)
    assert row is not None
    entry = Entry(1.0, "drone-1", "emergency", f"links weak: {action.name.lower()}", {})
    levels = {
        "STATUSTEXT": LEVEL_OF[SEVERITIES[action]],
        "station": alarms.DECISIONS[action],
        "watch page, from journals": journals.DECISIONS[action],
        "watch page, live": link_reader.DECISIONS[action],
        "report": level_of(entry),
        "page of messages": row.level,
    }
    assert levels == dict.fromkeys(levels, DECISION_LEVELS[action])


def test_a_severity_that_is_sent_arrives_as_its_level() -> None:
    assert {level: LEVEL_OF.get(severity, Level.INFO) for level, severity in SEVERITY.items()} == {
        level: level for level in Level
    }


def test_a_sentence_that_begins_with_warning_is_one() -> None:
    for group in COMPANION.groups:
        for row in group.rows:
            if group.whole and re.match(r"WARNING\b|preflight WARNING", row.template) and row.level is not Level.INFO:
                assert row.level is Level.WARNING, row.template
