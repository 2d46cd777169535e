# SPDX-License-Identifier: GPL-3.0-or-later

"""Clocks as an argument, so that a test can set them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

__all__ = ["Clocks"]


class Clocks(NamedTuple):
    """Wall clock, which may be set, and monotonic clock, both in seconds."""

    utc: Callable[[], float]
    monotonic: Callable[[], float]
