# SPDX-License-Identifier: GPL-3.0-or-later

"""The number of a question, as the panel shows it and sends it back with the answer. Pure.

The question at a border has the number that it had ahead of the border: it is the same question.
"""

from __future__ import annotations

from gcs_module.ahead import Ahead

__all__ = ["border_number", "number_of"]


def number_of(question: tuple[int, ...] | None) -> str:
    """The number of `StationCore.open_question`; "": there is none."""
    return "" if question is None else ".".join(str(part) for part in question)


def border_number(ahead: Ahead | None) -> str:
    """The number of the question about a border ahead, answered or not; "": no border is ahead."""
    return "" if ahead is None else number_of(ahead.question)
