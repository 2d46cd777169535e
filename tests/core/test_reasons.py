# SPDX-License-Identifier: GPL-3.0-or-later

"""Reasons in words: an operator who did not answer, a program that cannot ask, a denial and a silent station differ."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.authority.cures import ended
from mavproxy_handover.core.common.model import Reason, journal_in_words


@pytest.mark.parametrize(
    ("journal", "words"),
    [
        ("partner_silent", "partner silent"),
        ("partner_refused", "the partner's operator denied"),
        ("partner_unanswered", "the partner's operator did not answer"),
        ("commander_denied", "the commander's operator denied"),
        ("commander_unanswered", "the commander's operator did not answer"),
        ("cannot_be_asked", "the commander's program cannot ask its operator"),
        ("commander_lost", "commander lost"),
        ("a_word_of_another_version", "a word of another version"),
        ("", ""),
    ],
)
def test_as_a_report_says_them(journal: str, words: str) -> None:
    assert journal_in_words(journal) == words


@pytest.mark.parametrize(
    ("why", "text"),
    [
        (Reason.PARTNER_SILENT, "GCSB does not answer. Check its program and its link."),
        (Reason.PARTNER_REFUSED, "GCSB's operator denied it."),
        (Reason.PARTNER_UNANSWERED, "GCSB's operator did not answer."),
        (Reason.COMMANDER_SILENT, "GCSA does not answer. Check its program and its link."),
        (Reason.COMMANDER_DENIED, "GCSA's operator denied it."),
        (Reason.COMMANDER_UNANSWERED, "GCSA's operator did not answer."),
        (
            Reason.CANNOT_BE_ASKED,
            "GCSA's program cannot ask its operator. Set its consent in the vehicle's file.",
        ),
        (Reason.LEFT_REGION, "left region."),
    ],
)
def test_as_both_operators_hear_them(why: Reason, text: str) -> None:
    assert ended(why, "GCSA", "GCSB") == text
