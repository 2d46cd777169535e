# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover rehearse` typed at a station, and how a station shows a rehearsal."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.alarms import Level
from gcs_module.banner import Situation, banner
from gcs_module.decisions import Decisions, Who
from mavproxy_handover.core.common.model import FlightAction, Phase
from tests.module.test_station_control import bench  # noqa: F401 - the fixture
from tests.module.test_station_module import StationBench

REPORT, BEGIN, END = (
    mavlink.HANDOVER_REHEARSAL_WISH_REPORT,
    mavlink.HANDOVER_REHEARSAL_WISH_BEGIN,
    mavlink.HANDOVER_REHEARSAL_WISH_END,
)


def asked(bench: StationBench) -> list[Any]:  # noqa: F811
    return [m for m in bench.sent() if m.get_type() == "HANDOVER_REHEARSE"]


def answer(bench: StationBench, question: Any, accepted: int, *lines: tuple[int, str], count: int = 0) -> None:  # noqa: F811
    for line, text in lines or ((0, ""),):
        values = 251, 190, 1, question.wish, question.nonce, accepted, line, count, text.encode()
        bench.hear(mavlink.MAVLink_handover_rehearsal_message(*values))
    bench.run(0.1)


def status(bench: StationBench, rehearsal: int) -> None:  # noqa: F811
    values = 1, 251, 0, 251, 1, 0, 1, 2, 0, 0, 0, 0, 0, 0, 0, 0, b"", rehearsal
    bench.hear(mavlink.MAVLink_authority_status_message(*values))


@pytest.mark.parametrize(("typed", "wish", "word"), [("", BEGIN, "REHEARSE"), (" end", END, "REHEARSE END")])
def test_it_goes_to_the_companion_and_its_answer_is_shown(
    bench: StationBench,  # noqa: F811
    typed: str,
    wish: int,
    word: str,
) -> None:
    bench.mpstate.type(f"handover rehearse{typed}")
    (question,) = asked(bench)
    assert (question.target_system, question.target_component, question.vehicle) == (1, 191, 1)
    assert question.wish == wish
    answer(bench, question, 1)
    assert bench.mpstate.console.said(f"{word} accepted.")
    bench.run(5.0)
    assert asked(bench) == []


def test_a_refusal_is_shown_with_its_reason(bench: StationBench) -> None:  # noqa: F811
    bench.mpstate.type("handover rehearse")
    (question,) = asked(bench)
    answer(bench, question, 0)
    bench.run(1.0)
    assert bench.mpstate.console.said("REHEARSE refused: denied.")


def test_the_report_is_shown_when_all_of_it_is_here(bench: StationBench) -> None:  # noqa: F811
    shown = bench.mpstate.console.lines
    bench.mpstate.type("handover rehearse report")
    (question,) = asked(bench)
    assert question.wish == REPORT
    answer(bench, question, 1, (1, "rehearsal under way, 60 s"), (3, "nothing would have been commanded"), count=3)
    assert not any("under way" in line for line in shown)
    bench.run(1.0)
    (again,) = asked(bench)
    assert again.nonce == question.nonce, "what is missing is asked for again"
    answer(bench, again, 1, (2, "handovers 1, 1 of 4 that the check has"), count=3)
    found = [
        line for line in shown if "rehearsal under way" in line or "handovers 1" in line or "nothing would" in line
    ]
    assert len(found) == 3
    assert "under way" in found[0]
    assert "handovers 1" in found[1]


def test_without_an_answer_it_says_so(bench: StationBench) -> None:  # noqa: F811
    bench.mpstate.type("handover rehearse report")
    bench.run(8.0)
    assert bench.mpstate.console.said("no report of the rehearsal: no answer of the vehicle")


def test_typed_again_while_one_is_under_way_it_asks_for_the_report(bench: StationBench) -> None:  # noqa: F811
    status(bench, 1)
    bench.mpstate.type("handover rehearse")
    assert [m.wish for m in asked(bench)] == [REPORT]
    assert any(line.startswith("rehearsal ") for line in bench.mpstate.type("handover status"))


def test_when_it_is_over_the_report_comes_by_itself(bench: StationBench) -> None:  # noqa: F811
    status(bench, 1)
    status(bench, 1)
    assert asked(bench) == []
    status(bench, 0)
    bench.run(0.1)
    assert [m.wish for m in asked(bench)] == [REPORT]
    status(bench, 0)
    bench.run(0.1)
    assert asked(bench) == []


def test_another_word_is_told_and_nothing_sent(bench: StationBench) -> None:  # noqa: F811
    known = "there are end, report"
    assert bench.mpstate.type("handover rehearse now") == [f"handover rehearse: no 'now'; {known}"]
    assert asked(bench) == []


def test_the_banner_says_that_it_is_one() -> None:
    now = Situation("drone-1", Phase.ON_MISSION, "GCSA", own=True, heard_s=0.5, rehearsal=True)
    assert banner(now) == ("REHEARSAL - CONTROL: GCSA (you)", Level.ADVISORY)


def test_an_emergency_in_it_is_shown_as_one_and_says_that_nothing_is_done() -> None:
    now = Situation("drone-1", Phase.EMERGENCY, heard_s=0.5, action=FlightAction.RETURN, rehearsal=True)
    words, level = banner(now)
    assert (words.endswith("REHEARSAL - NO COMMANDER"), level) == (True, Level.EMERGENCY)
    text = "REHEARSAL: would RETURN to home. GCSA silent for 5 s"
    message = mavlink.MAVLink_handover_decision_message(1, 4, 5, b"home", b"GCSA silent for 5 s", text.encode())
    notice = Decisions(lambda _beginning: "").on_message(message, Who.NOBODY)
    assert notice is not None
    assert notice.text == text
