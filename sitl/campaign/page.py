# SPDX-License-Identifier: GPL-3.0-or-later

"""The page of a campaign: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from itertools import combinations
from pathlib import Path

from mavproxy_handover.core.common.causes import Cause
from mavproxy_handover.core.common.model import Phase
from sitl.campaign.figures import ENOUGH, WHOLE_HANDOVERS, WHOLE_S, Figures, figures, wilson
from sitl.campaign.judge import UNSAFE
from sitl.campaign.outcome import Outcome
from sitl.campaign.pictures import histograms, maps
from sitl.campaign.rules import rules
from sitl.campaign.steering import CELLS, NEVER_IN, NEVER_MEET, PHASES, Cell, never
from sitl.report.page import STYLE

__all__ = ["summary", "write_page"]

#: flights on the map, and seeds that are named
_MAPS, _NAMED = 3, 12


def summary(found: Figures) -> str:
    """The figures in a few lines, for a terminal."""
    lines = [
        f"{found.flights} flights, {found.hours:.1f} hours in the air, {found.whole} of them of {WHOLE_S / 60:.0f} "
        f"minutes and {WHOLE_HANDOVERS} handovers at least",
        f"{found.hours_per_cpu_s:.2f} flight hours a second of processor time, under rules {rules()}",
    ]
    lines += [f"  {text}" for text in _classes(found)]
    low, high = wilson(found.unsafe_flights, found.flights)
    lines.append(f"unsafe: {found.unsafe_flights} flights ({low:.2%} to {high:.2%})")
    for row in UNSAFE:
        seeds = found.examples.get(row.name, [])
        if seeds:
            lines.append(f"  {row.name}: {len(seeds)}, as in {', '.join(map(str, seeds[:_NAMED]))}")
    lines.append(f"pairs of causes in a phase: {len(found.short)} came up in fewer than {ENOUGH} flights")
    if found.against_the_rules:
        lines.append(f"  and these, which never meet, did: {', '.join(found.against_the_rules)}")
    return "\n".join(lines)


def _classes(found: Figures) -> Iterable[str]:
    for name, count in found.ended.most_common():
        low, high = wilson(count, found.flights)
        yield f"{name}: {count} ({low:.1%} to {high:.1%})"


def write_page(folder: Path, outcomes: Sequence[Outcome]) -> Path:
    """Write `campaign.html`; returns its path. Raises OSError."""
    ordered = sorted(outcomes, key=lambda each: each.seed)
    found = figures(ordered)
    bad = [seed for seeds in found.examples.values() for seed in seeds[:1]]
    shown = (bad + [outcome.seed for outcome in ordered if outcome.handovers])[:_MAPS]
    parts = [
        f"<h1>Campaign: {found.flights} flights</h1>",
        f"<p>{found.hours:.1f} hours in the air, {found.whole} flights of {WHOLE_S / 60:.0f} minutes and "
        f"{WHOLE_HANDOVERS} handovers at least. {found.hours_per_cpu_s:.2f} flight hours a second of processor "
        f"time. The rules (digest of all that decides and judges a flight): {rules()}.</p>",
        "<h2>What is unsafe</h2>",
        _table(("", "what must not be", "limit", "excused by a milder policy of", "flights", "seeds"), _unsafe(found)),
        "<h2>How flights ended</h2>",
        _table(("", "flights", "95 of 100 times between"), _ended(found)),
    ]
    if _can_draw():
        parts.append(f'<h2>Flights</h2><img alt="histograms" src="{histograms(ordered)}">')
        if shown:
            parts.append(f'<img alt="maps of flights" src="{maps(shown)}">')
            parts.append(
                '<p class="small">blue AUTO, violet held, orange RTL, red LAND, green a pilot; triangles: '
                "places to return to</p>"
            )
    parts += [_cells(found)]
    page = (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>Campaign</title>'
        f"<style>{STYLE}</style></head><body>{''.join(parts)}</body></html>\n"
    )
    path = folder / "campaign.html"
    path.write_text(page, encoding="utf-8")
    return path


def _can_draw() -> bool:
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        return False
    return True


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    cells = "".join(f"<th>{escape(text)}</th>" for text in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{body}</table>"


def _unsafe(found: Figures) -> Iterable[Sequence[object]]:
    for row in UNSAFE:
        seeds = found.examples.get(row.name, [])
        excuses = ", ".join(sorted(cause.value for cause in row.excused_by)) or "-"
        yield row.name, row.words, row.limit, excuses, len(seeds), " ".join(map(str, seeds[:_NAMED]))


def _ended(found: Figures) -> Iterable[Sequence[object]]:
    for name, count in found.ended.most_common():
        low, high = wilson(count, found.flights)
        yield name, count, f"{low:.2%} and {high:.2%}"


def _cells(found: Figures) -> str:
    head = ("causes at once", *(phase.name.lower() for phase in PHASES))
    rows = []
    for pair in combinations(Cause, 2):
        name = "+".join(sorted(cause.value for cause in pair))
        counts = [_count(found, pair, phase) for phase in PHASES]
        rows.append((name, *counts))
    text = f"{len(found.short)} of {len(CELLS)} came up in fewer than {ENOUGH} flights."
    if found.against_the_rules:
        text += f" These never meet, and did: {', '.join(found.against_the_rules)}."
    why = _table(("what never meets", "in", "why"), _never())
    return f"<h2>What was tried</h2><p>{text}</p>{_table(head, rows)}<h2>What never meets</h2>{why}"


def _count(found: Figures, pair: tuple[Cause, Cause], phase: Phase) -> object:
    """How often they came up; what never does, and did not, is named so."""
    count = found.cells[Cell(*pair, phase).name]
    return count if count or never(*pair, phase) is None else "never"


def _never() -> Iterable[Sequence[object]]:
    for pair, why in NEVER_MEET.items():
        yield "+".join(sorted(cause.value for cause in pair)), "every phase", why
    for (cause, phase), why in NEVER_IN.items():
        yield f"{cause.value} with anything", phase.name.lower(), why
