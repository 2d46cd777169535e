# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks feeds and onboard programs: what is configured, and what of it comes, by the journal of a running companion.

Without a running companion only the configuration is told: a source shows only in its frames, and the companion's ports
are its own. Sensors of onboard programs are compared with the autopilot's parameters where these are read
(`flight_controller.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from mavproxy_handover.config.onboard import OnboardProgram
from mavproxy_handover.config.vehicle import VehicleConfig
from mavproxy_handover.core.feeds import NAMES, FeedChange, FeedKind, FeedRule
from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok, unseen, warning
from mavproxy_handover.doctor.journal import entries_of_run

__all__ = ["feeds", "onboard_programs"]

_Entries = Sequence[Mapping[str, Any]]
#: a receiver without traffic sends nothing, and terrain and weather come now and then
_SILENT_OFTEN: Final = frozenset((FeedKind.ADSB, FeedKind.TERRAIN, FeedKind.WEATHER))
_DO_BASE: Final = "Start the base and its program at one of these stations."
_DO_PLACE: Final = "Switch on RTCM 1005 or 1006 at the base; docs/feeds.md has the rest."


def feeds(context: CheckContext) -> Iterator[Finding]:
    """The findings about feeds that the configuration names."""
    vehicle = context.vehicle
    named = [] if vehicle is None else [(kind, rule) for kind, rule in vehicle.feeds.rules.items() if rule.named]
    if vehicle is None or not named:
        return
    context.find_companion()
    if context.running is None:
        for kind, rule in named:
            yield ok(NAMES[kind], f"{_order(vehicle, rule)}; whether one sends shows while the companion runs")
        return
    path, entries = entries_of_run(context)
    if path is None:
        yield unseen("feeds", "the companion runs, and its journal is not found", "Look at its journal.")
        return
    for kind, rule in named:
        yield from _feed(kind, _order(vehicle, rule), [e for e in _of(entries, "feed") if e.get("kind") == kind.value])


def _feed(kind: FeedKind, order: str, entries: _Entries) -> Iterator[Finding]:
    """The source of a feed, and what is wrong with stations that are not."""
    name = NAMES[kind]
    changes = [e for e in entries if e.get("change") in (FeedChange.SOURCE.value, FeedChange.SILENT.value)]
    if changes and changes[-1].get("change") == FeedChange.SOURCE.value:
        yield ok(name, f"from {changes[-1].get('station')}, by the companion that runs")
    elif changes:
        yield warning(name, str(changes[-1].get("text")).partition(": ")[2].rstrip("."), _DO_BASE)
    elif kind in _SILENT_OFTEN:
        yield ok(name, f"{order}; nothing has come since the companion began, which may be right")
    else:
        yield warning(name, f"none since the companion began; may come from {order}", _DO_BASE)
    others = (FeedChange.NOT_USED.value, FeedChange.NO_PLACE.value)
    told = {str(e.get("text")): str(e.get("station")) for e in entries if e.get("change") in others}
    for text, station in told.items():
        yield warning(f"{name} of {station}", text.rstrip("."), _DO_PLACE if "1005" in text else "Read docs/feeds.md.")


def _order(vehicle: VehicleConfig, rule: FeedRule) -> str:
    names = {entry.station.sysid: entry.station.name for entry in vehicle.stations}
    return ", then ".join(names[station] for station in rule.order) or "no station"


def onboard_programs(context: CheckContext) -> Iterator[Finding]:
    """The findings about onboard programs."""
    vehicle = context.vehicle
    if vehicle is None or not vehicle.onboard:
        return
    context.find_companion()
    path, entries = (None, []) if context.running is None else entries_of_run(context)
    for program in vehicle.onboard:
        if context.running is None:
            yield ok(program.name, f"{_identity(vehicle, program)}; whether it sends shows while the companion runs")
        else:
            yield _program(vehicle, program, path, _of(entries, "onboard"))


def _program(vehicle: VehicleConfig, program: OnboardProgram, path: Path | None, entries: _Entries) -> Finding:
    name = program.name
    if path is None:
        return unseen(name, "the companion runs, and its journal is not found", "Look at its journal.")
    own = [entry for entry in entries if entry.get("program") == name]
    if any("closed after an internal fault" in str(entry.get("text")) for entry in own):
        do = "Restart the companion on the ground, and send its journal to the developers."
        return error(name, "its link was closed after an internal fault", do)
    heard = [entry.get("heard") for entry in own if "heard" in entry]
    if heard and heard[-1] is True:
        return ok(name, "heard, by the companion that runs")
    found = "is silent" if heard else "was not heard since the companion began"
    return warning(name, found, f"Start it: {_identity(vehicle, program)}.")


def _identity(vehicle: VehicleConfig, program: OnboardProgram) -> str:
    return f"system {vehicle.sysid}, component {program.rights.component}, to {program.link}"


def _of(entries: _Entries, event: str) -> _Entries:
    return [entry for entry in entries if entry.get("event") == event]
