# SPDX-License-Identifier: GPL-3.0-or-later

"""The clocks of those who have to put a time on what they send: handed to them, so that a test can move them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

__all__ = ["Clocks"]


class Clocks(NamedTuple):
    """Both in seconds: the time of day, which may be set, and the time that only goes on."""

    utc: Callable[[], float]
    monotonic: Callable[[], float]
