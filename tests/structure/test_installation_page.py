# SPDX-License-Identifier: GPL-3.0-or-later

"""The installation page begins with a checklist, and says what differs between the systems."""

from __future__ import annotations

import re

import pytest

from tests.structure.language import ROOT, check, read

PAGE = ROOT / "docs" / "installation.md"
TEXT = PAGE.read_text(encoding="utf-8")
STEPS = re.findall(r"^(\d+)\. \*\*", TEXT.partition("\n## Twelve steps\n")[2].partition("\n## ")[0], re.MULTILINE)
SYSTEMS = ("Raspberry Pi OS", "Ubuntu", "JetPack")


def section(heading: str) -> str:
    return TEXT.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def test_there_are_twelve_steps_in_order_and_nothing_before_them() -> None:
    assert [str(number) for number in range(1, 13)] == STEPS
    assert TEXT.index("\n## ") == TEXT.index("\n## Twelve steps\n")


@pytest.mark.parametrize("row", ["Python", "UART", "clock without a network", "networks"])
def test_a_difference_has_a_cell_for_each_system(row: str) -> None:
    table = section("What differs between the systems")
    assert re.search(r"^\| \| " + r" \| ".join(SYSTEMS) + r" \|$", table, re.MULTILINE)
    (cells,) = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith(f"| {row} |")]
    assert len(cells) == 1 + len(SYSTEMS)
    assert all(cells)


def test_each_system_is_named_as_supported_or_not() -> None:
    rows = [line for line in section("Supported systems").splitlines() if line.startswith("| ")]
    assert [name for name in SYSTEMS if not any(name in row for row in rows)] == []


def test_the_page_is_in_plain_english() -> None:
    assert [finding for text in read(PAGE) for finding in check(text)] == []
