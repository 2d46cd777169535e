# SPDX-License-Identifier: GPL-3.0-or-later

"""The end of a `match` that handles every kind: the type checker refuses a kind that is missing."""

from __future__ import annotations

from typing import NoReturn

__all__ = ["assert_never"]


def assert_never(value: NoReturn) -> NoReturn:
    """As `typing.assert_never`, which Python 3.10 lacks. Raises AssertionError where the type checker was not asked."""
    raise AssertionError(f"no case for {value!r}")
