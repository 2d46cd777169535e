# SPDX-License-Identifier: GPL-3.0-or-later

"""Which files fly the guard, in the order of the table "Flown"."""

from __future__ import annotations

from importlib import import_module

FILES = (
    "test_guard_losses",
    "test_guard_failsafes",
    "test_guard_pilots",
    "test_guard_strangers",
    "test_guard_authority",
    "test_guard_gaps",
    "test_guard_channels",
    "test_guard_floods",
    "test_guard_scripting",
    "test_guard_arming",
    "test_guard_vehicles",
)


def case_names() -> list[str]:
    """Every case of the suite, in the order of the table."""
    return [case.name for file in FILES for case in import_module(f"tests.sitl.{file}").CASES]
