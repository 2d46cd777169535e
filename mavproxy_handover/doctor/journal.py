# SPDX-License-Identifier: GPL-3.0-or-later

"""Findings from the journal of a running companion, whose ports and lines must not be opened.

The end of the journal is read, from the last load of the module on.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.cli.machine import STATE
from mavproxy_handover.doctor.advice import ONBOARD, SENSORS, advice
from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok, unseen, warning
from mavproxy_handover.store.flights import LATEST

__all__ = ["autopilot_by_journal", "entries_of_run", "links_by_journal", "position_box_by_journal"]

_TAIL_BYTES: Final = 8 << 20
_DO: Final = "Type 'handover status' in the companion, or look at its journal."


def autopilot_by_journal(context: CheckContext) -> Iterator[Finding]:
    """Results of the companion's own checks before flight."""
    path, entries = entries_of_run(context)
    if path is None:
        yield unseen("autopilot", "the companion runs, and its journal is not found", _DO)
        return
    said: dict[str, Mapping[str, Any]] = {}
    fits = None
    for entry in entries:
        if entry.get("event") == "preflight":
            fits = entry.get("fits") is True
            if fits:
                said.clear()
            else:
                said[str(entry.get("text", ""))] = entry
    for text, entry in said.items():
        parameter = str(entry.get("parameter") or "")
        found = f"{text.removeprefix(f'{parameter} ')} (journal, {path})"
        if ONBOARD in text:
            yield warning(SENSORS, found, advice(parameter, text))
            continue
        yield error(parameter or "guard and firmware", found, advice(parameter, text))
    if fits is None:
        yield unseen("autopilot", f"the companion runs and has not checked it yet ({path})", _DO)
    elif fits:
        yield ok("autopilot", f"guard, parameters and firmware fit (journal, {path})")


def links_by_journal(context: CheckContext) -> Iterator[Finding]:
    """State of the companion's links, by its own measurements."""
    path, entries = entries_of_run(context)
    assert context.vehicle is not None
    if path is None:
        yield unseen("links", "the companion runs, and its journal is not found", _DO)
        return
    whole = any(entry.get("event") == "loaded" for entry in entries)
    heard = {str(entry.get("station")) for entry in entries if entry.get("event") == "station_heard"}
    bad: dict[tuple[str, str], dict[str, str]] = {}
    for entry in entries:
        if entry.get("event") != "link":
            continue
        over = bad.setdefault((str(entry.get("station")), str(entry.get("link"))), {})
        if entry.get("change") == "degraded":
            over[str(entry.get("measure"))] = str(entry.get("text"))
        elif entry.get("change") == "restored":
            over.pop(str(entry.get("measure")), None)
    for station in context.vehicle.stations:
        name = station.station.name
        if whole and name not in heard:
            do = f"Look whether {name} runs, then at address, firewall and link."
            yield error(name, f"was not heard since the companion began (journal, {path})", do)
            continue
        for link in station.links:
            what, over = f"{name}, {link}", bad.get((name, link), {})
            if over:
                do = f"Look whether {name} runs, and at that link; 'handover stations' in the companion measures it."
                yield error(what, f"{'; '.join(over.values())} (journal, {path})", do)
            else:
                yield ok(what, f"no trouble, by the companion that runs (journal, {path})")


def position_box_by_journal(context: CheckContext) -> Iterator[Finding]:
    """Last state of the position box, as the companion reported it."""
    path, entries = entries_of_run(context)
    said = [entry for entry in entries if entry.get("event") == "position_source"]
    if path is None or not said:
        why = "its journal is not found" if path is None else f"has not told of it yet ({path})"
        yield unseen("position box", f"the companion runs, and {why}", _DO)
        return
    found = f"{str(said[-1].get('text', '')).removeprefix('position box ')} (journal, {path})"
    if said[-1].get("standing") == "sound":
        yield ok("position box", found)
    else:
        yield error(
            "position box", found, "Type 'handover status' in the companion; docs/position-box.md has the rest."
        )


def entries_of_run(context: CheckContext) -> tuple[Path | None, list[Mapping[str, Any]]]:
    """The newest possible journal, and its entries of the current run."""
    assert context.vehicle is not None
    logs = context.at(STATE) / "flights"
    if context.unit is not None and (named := context.unit.option("--logs")) is not None:
        logs = context.at(Path(named))
    name = f"{context.vehicle.name}.jsonl"
    places = [
        logs / LATEST / name,
        context.path.parent / "flights" / LATEST / name,
        context.at(context.vehicle.journal),
    ]
    found = [path for path in places if path.is_file()]
    if not found:
        return None, []
    path = max(found, key=lambda each: each.stat().st_mtime)
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - _TAIL_BYTES))
            lines = file.read(_TAIL_BYTES).splitlines()
    except OSError:
        return None, []
    entries: list[Mapping[str, Any]] = []
    for line in lines:
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError):  # cut, or damaged
            continue
        if isinstance(entry, dict):
            entries = [entry] if entry.get("event") == "loaded" else [*entries, entry]
    return path, entries
