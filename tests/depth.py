# SPDX-License-Identifier: GPL-3.0-or-later

"""How deep a test goes: a part of its seeds in each test run, all of them with `--long`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

__all__ = ["first", "seeds"]


def first(count: int, values: Iterable[Any]) -> list[Any]:
    """These parameters; those after the first `count` are skipped, saying so, without `--long`."""
    return [
        value
        if number < count
        else pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.long)
        for number, value in enumerate(values)
    ]


def seeds(config: pytest.Config, count: int, all_of_them: int) -> range:
    """The seeds of a test: `count`, and with `--long` `all_of_them`."""
    return range(all_of_them if config.getoption("--long") else count)
