# SPDX-License-Identifier: GPL-3.0-or-later

"""The messages that docs/troubleshooting.md explains are those that the programs print."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "troubleshooting.md"
SOURCES = ("mavproxy_handover/**/*.py", "gcs_module/**/*.py", "ardupilot_lua/*.lua")
#: what stands for something that changes, and what is glued together where the message is made
VARIES = re.compile(r"\b[A-Z][A-Z]+\b|\brefused: |\benergy: (?=[a-z])|: $")


def quoted() -> list[str]:
    table = DOCUMENT.read_text(encoding="utf-8").split("<!-- messages:begin -->")[1].split("<!-- messages:end -->")[0]
    return re.findall(r"^\| `([^`]+)` \|", table, re.MULTILINE)


@cache
def said() -> str:
    """Every text of the sources, with what is formatted into it left out."""
    texts = []
    for pattern in SOURCES:
        for path in sorted(ROOT.glob(pattern)):
            texts.append(path.read_text(encoding="utf-8"))
    return "\n".join(texts)


def pieces(message: str) -> list[str]:
    """The parts of a message that never change."""
    return [piece for part in VARIES.split(message) if (piece := part.strip(" :,'")) and len(piece) > 3]


def test_there_are_messages() -> None:
    assert len(quoted()) > 35
    assert all(pieces(message) for message in quoted())


@pytest.mark.parametrize("message", quoted())
def test_it_is_printed_by_a_program(message: str) -> None:
    missing = [piece for piece in pieces(message) if piece not in said()]
    assert missing == []


def test_a_message_that_nobody_prints_is_noticed() -> None:
    assert [piece for piece in pieces("the moon is in the way of NAME") if piece not in said()] == [
        "the moon is in the way of"
    ]


def test_what_start_needs_is_all_there() -> None:
    source = (ROOT / "mavproxy_handover/core/authority/start.py").read_text(encoding="utf-8")
    needs = re.findall(r'needs\.append\(f?"([^"]+)"\)', source)
    assert len(needs) > 8
    shown = DOCUMENT.read_text(encoding="utf-8")
    parts = [re.sub(r"\{[^}]*\}", "\0", need).split("\0") for need in needs]
    assert [part for each in parts for part in each if part.strip(" :") not in shown] == []
