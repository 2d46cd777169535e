# SPDX-License-Identifier: GPL-3.0-or-later

"""Parts of files that are made from tables: causes in the sample of a vehicle's file, reasons in the dialect, and the
tables of `docs/safety.md` and `docs/authority.md`. The rest of these files is written by hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from textwrap import wrap
from typing import Final

from mavproxy_handover.cli import explain
from mavproxy_handover.config import meanings
from mavproxy_handover.core.common.causes import CAUSES, Ends
from mavproxy_handover.core.common.model import Reason
from mavproxy_handover.gate.explain import markdown_table, summary
from tests.structure.imports import ROOT

__all__ = ["blocks"]

_SAMPLE: Final = ROOT / "mavproxy_handover" / "deploy" / "vehicle.toml"
_DIALECT: Final = ROOT / "mavproxy_handover" / "wire" / "handover.xml"
#: the column in which a comment of the sample begins, and the longest line
_COLUMN, _WIDTH = 40, 120


def blocks() -> dict[Path, str]:
    """Path and content of each file."""
    safety, authority = ROOT / "docs" / "safety.md", ROOT / "docs" / "authority.md"
    return {
        _SAMPLE: _sample(_SAMPLE.read_text(encoding="utf-8")),
        _DIALECT: _dialect(_DIALECT.read_text(encoding="utf-8")),
        safety: _between(safety.read_text(encoding="utf-8"), "explain", explain.markdown()),
        authority: _between(authority.read_text(encoding="utf-8"), "policy", markdown_table(summary())),
    }


def _between(text: str, name: str, content: str) -> str:
    """The page with this content between the two markers of that name."""
    before, begin, rest = text.partition(f"<!-- {name}:begin -->\n")
    _old, end, behind = rest.partition(f"\n<!-- {name}:end -->")
    return f"{before}{begin}{content}{end}{behind}"


def _sample(text: str) -> str:
    """The sample with a line for each cause in its three tables."""
    means = meanings.VEHICLE["policy"]
    for table, lines in (
        ("policy", [_line(f'{c.value} = "{row.policies[0]}"', means[c.value]) for c, row in CAUSES.items()]),
        ("hold_off", [_line(f"{c.value} = {row.hold_off_s}") for c, row in CAUSES.items()]),
        ("clear", [_line(f"{c.value} = {row.clear_s}", _ending(row.ends)) for c, row in CAUSES.items()]),
    ):
        before, head, rest = text.partition(f"\n[{table}]\n")
        _old, gap, behind = rest.partition("\n\n")
        text = f"{before}{head}{chr(10).join(lines)}{gap}{behind}"
    return text


def _ending(ends: Ends) -> str:
    return "it lasts as long as the flight" if ends is Ends.WITH_THE_FLIGHT else ""


def _line(entry: str, meaning: str = "") -> str:
    """A key that is commented out, and what it means."""
    first, *others = wrap(meaning, _WIDTH - _COLUMN - 4) or [""]
    head = f"# {entry}".ljust(_COLUMN) + f"# {first}" if first else f"# {entry}"
    return "\n".join([head, *("#".ljust(_COLUMN) + f"#   {more}" for more in others)])


def _dialect(text: str) -> str:
    """The dialect with an entry for each reason. An entry that is there stays: it may have a description."""
    before, head, rest = text.partition('    <enum name="HANDOVER_REASON">\n')
    inside, end, behind = rest.partition("    </enum>\n")
    return f"{before}{head}{''.join(_entries(inside))}{end}{behind}"


def _entries(inside: str) -> Iterator[str]:
    lines = inside.splitlines(keepends=True)
    known = {found[1]: line for line in lines if (found := re.search(r'name="(HANDOVER_REASON_\w+)"', line))}
    yield from (line for line in lines if "<entry" not in line)
    for reason in Reason:
        name = f"HANDOVER_REASON_{reason.name}"
        yield known.get(name, f'      <entry value="{reason.value}" name="{name}"/>\n')
