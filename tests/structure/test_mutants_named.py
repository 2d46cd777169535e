# SPDX-License-Identifier: GPL-3.0-or-later

"""Where faults are planted in the rules: every module is named, and no module or fault that does not exist."""

from __future__ import annotations

from tests.mutation.core import out_of_date
from tests.mutation.run import in_child


def test_every_module_of_the_rules_has_its_tests_named_and_every_listed_survivor_exists() -> None:
    assert in_child(out_of_date) == []
