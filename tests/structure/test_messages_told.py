# SPDX-License-Identifier: GPL-3.0-or-later

"""The messages that docs/troubleshooting.md explains are rows of the page about messages."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from gcs_module.notices import NOTICES
from reference.doctor import findings
from reference.sentences import COMPANION, GUARD, OF_GUARD, VEHICLE
from reference.sentences.errors import FAMILIES, SHOWN, texts_of

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "troubleshooting.md"
#: what stands for something that changes, in the document and in a row
VARIES = re.compile(r"\b[A-Z][A-Z]+\b|\{\w+\}")
#: words in capitals that are a part of a message
FIXED = ("START", "HEARTBEAT", "TERRAIN_ENABLE", "RETURN", "GROUNDSPEED", "THROTTLE")


def quoted() -> list[str]:
    table = DOCUMENT.read_text(encoding="utf-8").split("<!-- messages:begin -->")[1].split("<!-- messages:end -->")[0]
    first_cells = re.findall(r"^\| (.*?) \|", table, re.MULTILINE)
    return [message for cell in first_cells for message in re.findall(r"`([^`]+)`", cell) if " " in message]


@cache
def rows() -> tuple[str, ...]:
    """The texts of all rows of the page."""
    texts = [row.template for row in NOTICES.values()]
    texts += [row.template for group in (*VEHICLE, *GUARD) for row in group.rows]
    texts += [text for family in (*FAMILIES, *SHOWN) for text in texts_of(family)]
    texts += [f"{each.found}" for each in findings()]
    return tuple(re.sub(r"\{\w+\}", "\0", text).lower() for text in texts)


def pieces(message: str) -> list[str]:
    """The parts of a message that never change, and have a word."""
    kept = re.sub(r"\b[A-Z][A-Z]+\b", lambda word: word[0] if word[0] in FIXED else "\0", message)
    return [piece.lower() for part in kept.split("\0") if re.search(r"[a-z]{3}", piece := part.strip(" :,.'()"))]


def is_row(message: str) -> bool:
    """Whether a message matches a row, or its parts are in rows: all in one, or each reason in a row of its own."""
    said = re.sub(r"\bNUMBER\b", "7", message)
    if COMPANION.find(said) or OF_GUARD.find(said):
        return True
    parts = [part for whole in pieces(message) for part in re.split(r": |; ", whole) if re.search(r"[a-z]{3}", part)]
    parts = [re.sub(r"^[\w -]+ refused$", "refused", part) for part in parts]  # COMMAND refused
    return all(any(part.strip(" :,.'") in row for row in rows()) for part in parts)


def test_there_are_messages() -> None:
    assert len(quoted()) > 90
    assert all(pieces(message) for message in quoted())


@pytest.mark.parametrize("message", sorted(set(quoted())))
def test_it_is_a_row_of_the_page_about_messages(message: str) -> None:
    assert is_row(message), pieces(message)


def test_a_message_that_no_program_prints_is_noticed() -> None:
    assert not is_row("the moon is in the way of NAME")
    assert not is_row("energy: the moon is in the way")
    assert is_row("START refused: no mission loaded")


def test_what_start_needs_is_all_there() -> None:
    source = (ROOT / "mavproxy_handover/core/authority/start.py").read_text(encoding="utf-8")
    needs = re.findall(r'needs\.append\(f?"([^"]+)"\)', source)
    assert len(needs) > 8
    shown = DOCUMENT.read_text(encoding="utf-8")
    parts = [re.sub(r"\{[^}]*\}", "\0", need).split("\0") for need in needs]
    assert [part for each in parts for part in each if part.strip(" :") not in shown] == []
