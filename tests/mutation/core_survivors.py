# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults that tests and exploration need not notice, by module of the core, each with the reason."""

from __future__ import annotations

__all__ = ["KNOWN_SURVIVORS"]

KNOWN_SURVIVORS: dict[str, dict[str, str]] = {}
