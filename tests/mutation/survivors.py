# SPDX-License-Identifier: GPL-3.0-or-later

"""Mutants that the tests need not notice, by part of the gate, each with the reason."""

from __future__ import annotations

__all__ = ["KNOWN_SURVIVORS"]

KNOWN_SURVIVORS: dict[str, dict[str, str]] = {
    "passed": {"note_for: number one more: 3": "how much of a trace people get to read"},
    "judge": dict.fromkeys(
        (
            "usual: return dropped: return commander if station.sysid == view.commander else others",
            "usual: comparison turned: len(payload) >= length",
            "usual: and/or swapped: payload[system] == vehicle_sysid or not payload[system]",
        ),
        "more frames than need be are judged by `decide`, which finds the same",
    ),
    "explain": {"markdown_table: number one more: 0": "every line of a table has as many cells as the first"},
}
