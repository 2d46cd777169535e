# SPDX-License-Identifier: GPL-3.0-or-later

"""Parts of files that are made from tables: reasons in the dialect, the tables of `docs/safety.md` and
`docs/authority.md`. The rest of these files is written by hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from mavproxy_handover.cli import explain
from mavproxy_handover.core.common.model import Reason
from mavproxy_handover.gate.explain import markdown_table, summary
from reference import ROOT

__all__ = ["blocks"]

_DIALECT: Final = ROOT / "mavproxy_handover" / "wire" / "handover.xml"


def blocks() -> dict[Path, str]:
    """Path and content of each file."""
    safety, authority = ROOT / "docs" / "safety.md", ROOT / "docs" / "authority.md"
    return {
        _DIALECT: _dialect(_DIALECT.read_text(encoding="utf-8")),
        safety: _between(safety.read_text(encoding="utf-8"), "explain", explain.markdown()),
        authority: _between(authority.read_text(encoding="utf-8"), "policy", markdown_table(summary())),
    }


def _between(text: str, name: str, content: str) -> str:
    """The page with this content between the two markers of that name."""
    before, begin, rest = text.partition(f"<!-- {name}:begin -->\n")
    _old, end, behind = rest.partition(f"\n<!-- {name}:end -->")
    return f"{before}{begin}{content}{end}{behind}"


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
