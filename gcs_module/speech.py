# SPDX-License-Identifier: GPL-3.0-or-later

"""The spoken form of a line: what happens and why, in about four seconds; the rest is read. Pure.

A line says first what happens, then why, then what to do, each in a sentence. Speech has the first sentences that fit.
"""

from __future__ import annotations

import re
from typing import Final

__all__ = ["LONGEST_FIRST", "spoken"]

#: as many characters of a line are spoken, or of its first sentence: 4 s at the rate of usual speech programs
LONGEST, LONGEST_FIRST = 40, 46
_SENTENCE: Final = re.compile(r"(?<=[.!?]) (?=\S)")
_CLAUSE: Final = re.compile(r"[,;:(] | \(")
#: what is written short -> what is said
_SAID: Final = (
    (re.compile(r"^Handover \S+ -> (\S+) of \S+ in "), r"Handover to \1 in "),
    (re.compile(r", epoch \d+"), ""),
    (re.compile(r" -> "), " to "),
    (re.compile(r"(?<=\d) s\b"), " seconds"),
    (re.compile(r"(?<=\d) km\b"), " kilometres"),
    (re.compile(r"(?<=\d) m\b"), " metres"),
    (re.compile(r"(?<=\d) %"), " percent"),
)


def spoken(text: str) -> str:
    """What is said of a line."""
    said = ""
    for sentence in _SENTENCE.split(text):
        part = _shortened(sentence, LONGEST - len(said) - 1 if said else LONGEST_FIRST, whole=bool(said))
        said = f"{said} {part}".strip()
        if part != sentence:
            break
    for written, words in _SAID:
        said = written.sub(words, said)
    return said


def _shortened(sentence: str, most: int, *, whole: bool) -> str:
    """The sentence up to its last clause, or else its last word, that fits; `whole`: no clause is cut."""
    if len(sentence) <= most:
        return sentence
    ends = [found.start() for found in _CLAUSE.finditer(sentence) if 0 < found.start() < most]
    if ends:
        return sentence[: ends[-1]]
    return "" if whole else sentence[:most].rpartition(" ")[0]
