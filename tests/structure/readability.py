# SPDX-License-Identifier: GPL-3.0-or-later

"""How long the sentences of the documents are.

    python -m tests.structure.readability [--long] [PAGE ...]

It prints a row for each page, and one for all: words, sentences, mean words in a sentence, share of sentences over 25
words. `--long` prints the sentences over 25 words instead.

A sentence ends with a full stop, a question mark or an exclamation mark. A colon or a semicolon ends none, unlike in
`language.py`: this is the stricter count. Paragraphs and list items are counted; tables, headings, code blocks and
sentences of up to two words are not. Code in backticks is one word.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.structure.language import ROOT, plain, words

__all__ = ["LONGEST", "Readability", "pages", "read_page", "sentences"]

LONGEST: Final = 25
_END: Final = re.compile(r"(?<!\be\.g)(?<!\bi\.e)[.!?][)\"'”*]*\s+(?=[\"'(“]?[A-Z0-9])")
_ITEM: Final = re.compile(r"([*+-]|\d+\.|>) *(?=\S)")
_NO_PROSE: Final = ("|", "#", "<", "!")
_SHORTEST: Final = 3


@dataclass(frozen=True, slots=True)
class Readability:
    """Sentences of one page, or of several."""

    lengths: tuple[int, ...]

    @property
    def mean(self) -> float:
        return sum(self.lengths) / len(self.lengths) if self.lengths else 0.0

    @property
    def long_share(self) -> float:
        """Share of sentences with more than `LONGEST` words, 0 to 1."""
        return sum(length > LONGEST for length in self.lengths) / len(self.lengths) if self.lengths else 0.0

    def __str__(self) -> str:
        figures = f"{sum(self.lengths):6d} words {len(self.lengths):5d} sentences"
        return f"{figures}  mean {self.mean:4.1f}  over {LONGEST}: {self.long_share:6.1%}"


def pages() -> list[Path]:
    """The documents that people read from the beginning: no reference that is made, no list of changes."""
    return [
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "missions/README.md")),
        *sorted((ROOT / "docs").glob("*.md")),
        *sorted((ROOT / "ardupilot_lua").glob("*.md")),
    ]


def sentences(text: str) -> Iterator[str]:
    """The sentences of the paragraphs and list items of a page in Markdown."""
    for paragraph in _paragraphs(text):
        yield from (sentence for sentence in _END.split(paragraph) if words(sentence) >= _SHORTEST)


def read_page(path: Path) -> Readability:
    return Readability(tuple(words(sentence) for sentence in sentences(path.read_text(encoding="utf-8"))))


def _paragraphs(text: str) -> Iterator[str]:
    block: list[str] = []
    fenced = False
    for raw in [*text.split("\n"), ""]:
        line = raw.strip()
        if line.startswith(("```", "~~~")):
            fenced, line = not fenced, ""
        if fenced:
            continue
        item = _ITEM.match(line)
        if (not line or line.startswith(_NO_PROSE) or item) and block:
            yield plain("\n".join(block)).replace("\n", " ")
            block = []
        if line and not line.startswith(_NO_PROSE):
            block.append(line[item.end() :] if item else line)


def main(arguments: list[str]) -> int:
    chosen = [Path(argument).resolve() for argument in arguments if argument != "--long"] or pages()
    lengths: list[int] = []
    for path in chosen:
        name = path.relative_to(ROOT)
        if "--long" in arguments:
            long = [one for one in sentences(path.read_text(encoding="utf-8")) if words(one) > LONGEST]
            print("".join(f"{name}: {words(one)} words: {one}\n" for one in long), end="")
            continue
        page = read_page(path)
        lengths.extend(page.lengths)
        print(f"{name!s:45s} {page}")
    if "--long" not in arguments:
        print(f"{'all':45s} {Readability(tuple(lengths))}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
