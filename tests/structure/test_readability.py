# SPDX-License-Identifier: GPL-3.0-or-later

"""Documents have short sentences: the bounds of the house rules, and what is counted."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.structure.language import ROOT
from tests.structure.readability import Readability, pages, read_page, sentences

#: mean words in a sentence of a tutorial or a how-to guide
MEAN = 16
#: share of sentences over 25 words, on all pages together
LONG_SHARE = 0.08
#: page of the site -> where it lies, for guides that are not in docs/
ELSEWHERE = {"guard-install.md": "ardupilot_lua/handover_guard_install.md"}


def guides() -> list[Path]:
    """The pages under "Tutorial" and "How to" in the navigation of the site."""
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    found: list[Path] = []
    for section in re.split(r"^  - (?=\S)", nav, flags=re.MULTILINE):
        if section.startswith(("Tutorial", '"How to')):
            found += [ROOT / ELSEWHERE.get(page, f"docs/{page}") for page in re.findall(r": (\S+\.md)$", section, re.M)]
    return found


def test_the_guides_are_found() -> None:
    assert len(guides()) > 15
    assert [path for path in guides() if not path.is_file()] == []


@pytest.mark.parametrize("path", guides(), ids=lambda path: path.name)
def test_sentences_of_a_guide_are_short(path: Path) -> None:
    assert read_page(path).mean <= MEAN


def test_few_sentences_are_long() -> None:
    lengths = tuple(length for path in pages() for length in read_page(path).lengths)
    assert len(lengths) > 1000
    assert Readability(lengths).long_share <= LONG_SHARE


def test_tables_headings_and_code_are_not_counted() -> None:
    prose = "One two three. Four `x y z` five six: seven\neight."
    text = f"# One two three four\n\n{prose}\n\n| a | b c d e |\n\n```\na b c\n```\n"
    assert [*sentences(text)] == ["One two three", "Four X five six: seven eight."]


def test_a_list_item_is_a_sentence_of_its_own() -> None:
    assert Readability(tuple(len(one.split()) for one in sentences("- one two three\n- four five six seven\n"))) == (
        Readability((3, 4))
    )
