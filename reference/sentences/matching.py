# SPDX-License-Identifier: GPL-3.0-or-later

"""Finds the row of a text, and the texts of the sources that no row has."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Final

from reference.sentences.row import LISTS, VALUES, Group, Sentence

__all__ = ["Matcher", "normal", "pieces"]

_VALUE: Final = re.compile(r"\{(\w+)\}")
#: before a sentence in a rehearsal, and in the autopilot's name
_BEFORE: Final = re.compile(r"^(Handover: )?(REHEARSAL: (would )?)?")
_GAP: Final = "\0"


def normal(template: str) -> str:
    """A template with each value as one character."""
    return _VALUE.sub(_GAP, template)


def pieces(text: str) -> list[str]:
    """The parts of a normal text that never change, if they have a word."""
    return [piece for part in text.split(_GAP) if re.search(r"[A-Za-z]{2}", piece := part.strip(" .,:;()'\""))]


class Matcher:
    """The rows of some groups. `words`: further values, name -> pattern."""

    def __init__(self, groups: tuple[Group, ...], words: Mapping[str, str]) -> None:
        self.groups = groups
        self._groups = {group.name: group for group in groups}
        self._words = {**VALUES, **words}
        self.sentence = cache(self._pattern)

    def find(self, text: str) -> Sentence | None:
        """The row of a whole sentence; None: it has none."""
        return next(self.all(text), None)

    def all(self, text: str) -> Iterator[Sentence]:
        """Every row that a whole sentence matches."""
        bare = _BEFORE.sub("", text).rstrip(".")
        for group in self._groups.values():
            if group.whole:
                for row in group.rows:
                    pattern = self.sentence(row.template)
                    if pattern.fullmatch(bare) or pattern.fullmatch(text.rstrip(".")):
                        yield row

    def _pattern(self, template: str) -> re.Pattern[str]:
        return re.compile(self._regexp(template.rstrip("."), ()), re.IGNORECASE)

    def _regexp(self, template: str, within: tuple[str, ...]) -> str:
        """`within`: the groups that are being written out."""
        parts, end = [], 0
        for value in _VALUE.finditer(template):
            parts += [re.escape(template[end : value.start()]), self._value(value[1], within)]
            end = value.end()
        return "".join([*parts, re.escape(template[end:])])

    def _value(self, name: str, within: tuple[str, ...]) -> str:
        if name in LISTS:
            group, between = LISTS[name]
            one = self._value(group, within)
            return f"{one}(?:{re.escape(between)}{one})*"
        if name in within:
            raise ValueError(f"{name}: stands in itself")
        if name in self._groups:
            inner = (self._regexp(row.template, (*within, name)) for row in self._groups[name].rows)
            return f"(?:{'|'.join(inner)})"
        return f"(?:{self._words[name]})"
