# SPDX-License-Identifier: GPL-3.0-or-later

"""The faults that others have chosen have a place in the rules too, are none of the first ten, and are flown when asked
for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.sitl import plant_in_strategy
from tests.sitl.plant_in_strategy import CORE, PLANTED, ROOT, Planted
from tests.sitl.planted_by_others import PLANTED_BY_OTHERS


def test_there_are_ten_others_each_in_a_file_of_its_own() -> None:
    assert len({planted.file for planted in PLANTED_BY_OTHERS}) == len(PLANTED_BY_OTHERS) == 10
    first = {(planted.file, planted.right, planted.wrong) for planted in PLANTED}
    assert first.isdisjoint((planted.file, planted.right, planted.wrong) for planted in PLANTED_BY_OTHERS)
    assert {planted.name for planted in PLANTED}.isdisjoint(planted.name for planted in PLANTED_BY_OTHERS)


@pytest.mark.parametrize("planted", PLANTED_BY_OTHERS, ids=lambda planted: planted.name)
def test_a_fault_of_others_has_a_place_and_is_one_that_can_be_run(planted: Planted) -> None:
    path: Path = ROOT / CORE / planted.file
    source = path.read_text(encoding="utf-8")
    assert source.count(planted.right) == 1
    assert planted.wrong != planted.right
    compile(source.replace(planted.right, planted.wrong), str(path), "exec")


def test_they_are_flown_when_they_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    flown: list[Planted | None] = []

    def fly(folder: Path, planted: Planted | None, options: Sequence[str]) -> tuple[int, Counter[str], str]:
        flown.append(planted)
        rows = Counter[str]() if planted is None else Counter({"unsafe": 1})
        return 1, rows, ""

    monkeypatch.setattr(plant_in_strategy, "unsafe_flights", fly)
    assert plant_in_strategy.main(["--by-others"]) == 0
    assert flown == [None, *PLANTED_BY_OTHERS]
    flown.clear()
    assert plant_in_strategy.main([]) == 0
    assert flown == [None, *PLANTED]
