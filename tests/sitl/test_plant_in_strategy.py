# SPDX-License-Identifier: GPL-3.0-or-later

"""The faults that are planted under the campaign still have a place in the rules, and change them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sitl.plant_in_strategy import CORE, PLANTED, ROOT, Planted


def test_there_are_ten() -> None:
    assert len({planted.name for planted in PLANTED}) == len(PLANTED) == 10


@pytest.mark.parametrize("planted", PLANTED, ids=lambda planted: planted.name)
def test_a_fault_has_a_place_and_is_one_that_can_be_run(planted: Planted) -> None:
    path: Path = ROOT / CORE / planted.file
    source = path.read_text(encoding="utf-8")
    assert source.count(planted.right) == 1
    assert planted.wrong != planted.right
    compile(source.replace(planted.right, planted.wrong), str(path), "exec")
