# SPDX-License-Identifier: GPL-3.0-or-later

"""The picture of one handover's messages, as an SVG inside the page.

A row for each message in the order in which they were sent, not to scale: a handover takes milliseconds, and its
messages come in bursts. The time stands on the left, how long the message took beside its head; pauses are told. It is
as wide as a telephone, so nothing is scaled down there, and its colours are the page's (`style.py`), light or dark.
"""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from mavproxy_handover.core.common.model import journal_in_words
from sitl.report.exchange import Exchange, Flight, lanes
from sitl.report.kinds import Row, rows
from sitl.report.times import duration

__all__ = ["STEPS", "draw"]

#: the numbers of the messages, as README.md has them
STEPS = {
    "HANDOVER_REQUEST": "1",
    "ON_HANDOVER": "2",
    "OK_HANDOVER": "3",
    "CONNECT_HANDOVER": "4",
    "DRONE_CONNECTED": "5",
    "DISCONNECT_HANDOVER": "6",
    "HANDOVER_RESULT": "7",
}
_WIDTH, _HEAD, _ROW, _PAUSE = 380, 46, 32, 18
_LANES = (100, 210, 320)
_CLOCK_X = 50


def draw(transfer: Exchange, classes: Mapping[str, str]) -> str:
    """The SVG; `classes` gives each station's class of colour in the page."""
    parts: list[str] = []
    y = _HEAD
    for row in rows(transfer):
        if row.pause_s is not None:
            parts.append(
                f'<text x="{_LANES[1]}" y="{y + 12}" class="mid soft halo">{escape(duration(row.pause_s))} later</text>'
            )
            y += _PAUSE
        parts.append(_end(transfer, y) if row.flight is None else _arrow(transfer, row, row.flight, y))
        y += _ROW
    height = y + 8
    lines = "".join(
        f'<line x1="{x}" x2="{x}" y1="34" y2="{height - 4}" class="lane {classes.get(name, "")}"/>'
        f'<text x="{x}" y="14" class="mid name {classes.get(name, "")}">{escape(name)}</text>'
        f'<text x="{x}" y="28" class="mid soft">{role}</text>'
        for x, name, role in zip(_LANES, lanes(transfer), ("commander", "vehicle", "partner"), strict=True)
    )
    words = f"Messages of handover {transfer.handover_id}, {transfer.commander} to {transfer.partner}"
    return (
        f'<svg class="sequence" viewBox="0 0 {_WIDTH} {height}" role="img" aria-label="{escape(words)}">'
        f"{lines}{''.join(parts)}</svg>"
    )


def _arrow(transfer: Exchange, row: Row, flight: Flight, y: int) -> str:
    places = dict(zip(lanes(transfer), _LANES, strict=True))
    start, end = places.get(flight.sender), places.get(flight.receiver)
    if start is None or end is None:
        return ""
    line = y + 22
    way = 1 if end > start else -1
    stop = start + (end - start) * 0.7 if flight.lost else end - 2 * way
    kind = "lost" if flight.lost else "again" if flight.relayed else ""
    middle = _LANES[1]
    jump = f"H{middle - 5 * way}q{5 * way},-9 {10 * way},0" if min(start, end) < middle < max(start, end) else ""
    words = " ".join(word for word in (STEPS.get(flight.name, ""), flight.name) if word)
    label = ", ".join(word for word in (words, *_notes(row, flight)) if word)
    left = min(start, end) + 4
    anchor = f'x="{left}"' if left < middle else f'x="{_WIDTH - 2}" style="text-anchor:end"'
    parts = [f'<text {anchor} y="{line - 6}" class="halo {"bad" if flight.lost else ""}">{escape(label)}</text>']
    parts.append(f'<path d="M{start},{line}{jump}H{stop:.0f}" class="way {kind}"/>')
    if flight.lost:
        parts.append(f'<path d="M{stop - 4:.0f},{line - 4}l8,8m0,-8l-8,8" class="way lost"/>')
    else:
        parts.append(f'<path d="M{stop},{line}l{-7 * way},-4v8z" class="head"/>')
    parts.append(f'<text x="{_CLOCK_X}" y="{line + 4}" class="end soft">{escape(_clock(transfer, flight.t))}</text>')
    if flight.sent_t is not None and flight.received_t is not None:
        x, side = (end + 4, "") if way > 0 else (end - 4, ' style="text-anchor:end"')
        took = _short(flight.received_t - flight.sent_t)
        parts.append(f'<text x="{x}" y="{line + 4}"{side} class="tiny soft halo">{escape(took)}</text>')
    return "".join(parts)


def _notes(row: Row, flight: Flight) -> list[str]:
    return [
        f"{row.times}×" + (f" in {_short(row.last.t - flight.t)}" if row.last else "") if row.times > 1 else "",
        f"try {flight.attempt}" if flight.attempt > 1 and row.times == 1 else "",
        "passed on" if flight.relayed else "",
        flight.consent if flight.consent not in ("", "granted") else "",
        "lost" if flight.lost else "",
    ]


def _end(transfer: Exchange, y: int) -> str:
    if transfer.committed:
        text = f"{transfer.partner} commands" + (f", epoch {transfer.epoch}" if transfer.epoch is not None else "")
    else:
        text = f"aborted, {transfer.commander} stays: {journal_in_words(transfer.reason)}"
    kind = "held" if transfer.committed else "failed"
    clock = "" if transfer.ended_t is None else _clock(transfer, transfer.ended_t)
    return (
        f'<rect x="{_CLOCK_X + 6}" y="{y + 6}" width="{_WIDTH - _CLOCK_X - 12}" height="22" rx="4" class="{kind}"/>'
        f'<text x="{_LANES[1]}" y="{y + 21}" class="mid name">{escape(text)}</text>'
        f'<text x="{_CLOCK_X}" y="{y + 21}" class="end soft">{escape(clock)}</text>'
    )


def _clock(transfer: Exchange, t: float) -> str:
    """Since it began, short enough for the margin."""
    return _short(t - transfer.begun_t)


def _short(seconds: float) -> str:
    if abs(seconds) >= 1.0:
        return f"{seconds:.2f} s"
    return f"{seconds * 1000:.0f} ms" if abs(seconds) >= 0.1 else f"{seconds * 1000:.1f} ms"
