# SPDX-License-Identifier: GPL-3.0-or-later

"""Where faults are planted in the rules: every module of them is named, and nothing that is gone."""

from __future__ import annotations

from tests.mutation.core import misnamed


def test_every_module_of_the_rules_has_its_tests_named() -> None:
    assert misnamed() == []
