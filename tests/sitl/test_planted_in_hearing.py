# SPDX-License-Identifier: GPL-3.0-or-later

"""The faults that are planted in the judgement of the downlink have a place in the rules, and change them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sitl.plant_in_strategy import CORE, ROOT, Planted
from tests.sitl.planted_in_hearing import PLANTED_IN_HEARING


@pytest.mark.parametrize("planted", PLANTED_IN_HEARING, ids=lambda planted: planted.name)
def test_a_fault_of_hearing_has_a_place_and_is_one_that_can_be_run(planted: Planted) -> None:
    path: Path = ROOT / CORE / planted.file
    source = path.read_text(encoding="utf-8")
    assert source.count(planted.right) == 1
    assert planted.wrong != planted.right
    compile(source.replace(planted.right, planted.wrong), str(path), "exec")
