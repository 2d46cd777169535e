# SPDX-License-Identifier: GPL-3.0-or-later

"""The little Markdown that the pages need."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

__all__ = ["cell", "code", "page", "table"]

#: the first line of each page; not seen where it is read
_NOTE = "<!-- Made from the code (reference/): do not edit. -->"


def page(title: str, *parts: str) -> str:
    """A whole page of paragraphs, tables and headings."""
    return "\n\n".join([_NOTE, f"# {title}", *(part.strip("\n") for part in parts if part.strip("\n"))]) + "\n"


def cell(text: str) -> str:
    """Text as it may stand in a table: one line, no borders, no tags."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def code(text: str) -> str:
    """Something that is typed, for a table. A forge and the site read a `|` in backticks differently, a tag alike."""
    line = " ".join(text.split())
    if "|" not in line:
        return f"`{line}`" if line else ""
    for sign, entity in (("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ("|", "&#124;")):
        line = line.replace(sign, entity)
    return f"<code>{line}</code>"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table. The cells are made by `cell` and `code`."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])
