# SPDX-License-Identifier: GPL-3.0-or-later

"""The faults that others have chosen have a place in the rules too, are none of the first ten, and are flown when asked
for."""

from __future__ import annotations

from collections import Counter
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

    def fly(_folder: Path, planted: Planted | None, *_: int, until_found: bool) -> tuple[int, Counter[str], str]:
        assert not until_found
        flown.append(planted)
        rows = Counter[str]() if planted is None else Counter({"unsafe": 1})
        return 1, rows, ""

    monkeypatch.setattr(plant_in_strategy, "unsafe_flights", fly)
    assert plant_in_strategy.main(["--by-others"]) == 0
    assert flown == [None, *PLANTED_BY_OTHERS]
    flown.clear()
    assert plant_in_strategy.main([]) == 0
    assert flown == [None, *PLANTED]


def test_no_more_is_flown_than_it_takes_to_find_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pieces: list[tuple[int, int]] = []

    def fly(_home: Path, _out: Path, first: int, runs: int, _jobs: int) -> list[dict[str, object]]:
        pieces.append((first, runs))
        unsafe = [["battery empty", 1.0, "it was"]]
        return [{"seed": seed, "unsafe": unsafe if seed == 7130 else []} for seed in range(first, first + runs)]

    monkeypatch.setattr(plant_in_strategy, "planted_copy", lambda folder, planted: folder)
    monkeypatch.setattr(plant_in_strategy, "_flown", fly)
    found = plant_in_strategy.unsafe_flights(tmp_path, None, 7000, 350, 1, until_found=True)
    assert found == (200, Counter({"battery empty": 1}), "first in flight 131; battery empty: 1, as in 7130")
    assert pieces == [(7000, 100), (7100, 100)]
    pieces.clear()
    assert plant_in_strategy.unsafe_flights(tmp_path, None, 7131, 350, 1, until_found=True) == (350, Counter(), "")
    assert pieces == [(7131, 100), (7231, 100), (7331, 100), (7431, 50)]
    pieces.clear()
    assert plant_in_strategy.unsafe_flights(tmp_path, None, 7000, 350, 1)[0] == 350
    assert pieces == [(7000, 350)]
