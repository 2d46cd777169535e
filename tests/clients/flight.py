# SPDX-License-Identifier: GPL-3.0-or-later

"""Gives a program its jobs, through the companion and directly, and says what was not as expected."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tests.clients.site import Done, Site, SiteError
from tests.clients.table import COMMANDER, Client, Expects, Job, Outcome, outcome_of

__all__ = ["Flown", "Row", "fly", "table_of"]

_JOB_S = 120.0
#: until aircraft and texts show it
_SHOWS_S, _LANDS_S = 15.0, 90.0
_UP_M = 5.0
#: a program that is refused must be told within this time: most ask again after it
AT_ONCE_S = 1.0
#: what the aircraft must do, and how long it may take
CONDITIONS: Mapping[str, tuple[Callable[[Site], bool], float]] = {
    "ready": (lambda site: site.ready, _LANDS_S),
    "armed": (lambda site: site.watch.armed, _SHOWS_S),
    "disarmed": (lambda site: not site.watch.armed, _SHOWS_S),
    "up": (lambda site: site.watch.armed and site.watch.sample.alt_m > _UP_M, _LANDS_S),
    "landed": (lambda site: site.watch.landed and not site.watch.armed, _LANDS_S),
    "GUIDED": (lambda site: site.watch.mode == "GUIDED", _SHOWS_S),
    "RTL": (lambda site: site.watch.mode == "RTL", _SHOWS_S),
    "holding": (lambda site: site.watch.mode in ("LOITER", "BRAKE"), _SHOWS_S),
}


@dataclass(frozen=True, slots=True)
class Row:
    """A job of one station: what came of it through the companion and directly. None: not done there."""

    job: Job
    gate: Done | None
    direct: Done | None


@dataclass(slots=True)
class Flown:
    """What came of a client's jobs."""

    client: Client
    version: str = ""
    rows: list[Row] = field(default_factory=list)
    #: what was not as expected, in sentences
    faults: list[str] = field(default_factory=list)


def fly(client: Client, environments: Path, arducopter: Path | None, folder: Path) -> Flown:
    """Do all jobs. Never raises for what a program or the gate does."""
    flown = Flown(client)
    jobs = [job for job in client.jobs if job.word in client.words and not (job.arducopter and arducopter is None)]
    given: dict[bool, dict[int, Done]] = {}
    for guarded in (False, True):
        where = "through the companion" if guarded else "directly"
        here = {
            number: job for number, job in enumerate(jobs) if guarded or (job.station == COMMANDER and not job.gate)
        }
        home = folder / ("companion" if guarded else "direct")
        home.mkdir(parents=True)
        given[guarded] = {}
        try:
            with Site(home, client, environments, arducopter, guarded=guarded) as site:
                _do_all(site, client, here, given[guarded], flown.faults, where)
                flown.version = site.version(COMMANDER)
        except SiteError as error:
            flown.faults.append(f"{where}: {error}")
    flown.rows = [
        Row(job, given[True].get(number), given[False].get(number))
        for number, job in enumerate(jobs)
        if number in given[True] or number in given[False]
    ]
    return flown


def _do_all(
    site: Site, client: Client, jobs: Mapping[int, Job], given: dict[int, Done], faults: list[str], where: str
) -> None:
    before: dict[tuple[str, str], int | None] = {}
    for number, job in jobs.items():
        site.rest(job.pause_s)
        began = time.monotonic()
        done = given[number] = site.type(job.station, job.word, _JOB_S)
        found = [*_answered(job, done, client), *_seen(site, job, began)]
        read = before.get((job.station, job.word))
        if job.same and read != done.count:
            found.append(f"{read} items before, {done.count} now")
        before[job.station, job.word] = done.count
        faults += [f"{where}, {job.station} {job.word}: {fault}" for fault in found]


def _answered(job: Job, done: Done, client: Client) -> list[str]:
    """What is wrong with the answer."""
    outcome = outcome_of(done.result)
    if job.expects == Expects.DONE:
        return [] if outcome == Outcome.DONE else [f"expected to pass, the program says {done.result!r}"]
    wanted = (Outcome.REFUSED,) if job.expects == Expects.REFUSED else (Outcome.REFUSED, Outcome.DONE)
    if job.word in client.untold:
        return [] if outcome != Outcome.DONE or Outcome.DONE in wanted else ["expected to be refused, it passed"]
    if outcome not in wanted:
        return [f"expected to be {job.expects}, the program says {done.result!r}"]
    if done.took_s > AT_ONCE_S:
        return [f"{done.result} only after {done.took_s:.1f} s"]
    return []


def _seen(site: Site, job: Job, began: float) -> list[str]:
    """What the aircraft or the texts do not show."""
    found = []
    if job.aircraft:
        holds, timeout_s = CONDITIONS[job.aircraft]
        if not site.shows(lambda: holds(site), timeout_s):
            watch = site.watch
            armed = "armed" if watch.armed else "disarmed"
            found.append(f"the aircraft is not {job.aircraft}: {armed}, {watch.mode}, {watch.sample.alt_m:.1f} m")
    if job.text and not site.shows(lambda: _heard(site, job, began), _SHOWS_S):
        found.append(f"no text {job.text!r}")
    return found


def _heard(site: Site, job: Job, began: float) -> bool:
    return any(entry.t >= began and job.text in entry.text for entry in site.entries(job.station, "said"))


def table_of(flown: Flown) -> list[str]:
    """The times side by side, as a table of Markdown."""
    lines = [
        f"{flown.client.name} ({flown.version})",
        "",
        "| job | station | direct | through the companion | expected |",
    ]
    lines.append("|---|---|---|---|---|")
    lines += [
        f"| {row.job.word} | {row.job.station} | {_told(row.direct)} | "
        f"{_told(row.gate)}{_rates(row)} | {row.job.expects} |"
        for row in flown.rows
    ]
    return [*lines, *(f"NOT AS EXPECTED: {fault}" for fault in flown.faults)]


def _rates(row: Row) -> str:
    """The rate through the companion, and what part of the direct rate it is."""
    if not row.job.rate or row.gate is None or row.direct is None:
        return ""
    rates = [(done.count or 0) / max(done.took_s, 1e-3) for done in (row.direct, row.gate)]
    if not all(rates):
        return ""
    return f", {rates[1] / 1000:.0f} kB/s of {rates[0] / 1000:.0f} ({rates[1] / rates[0]:.2f})"


def _told(done: Done | None) -> str:
    if done is None:
        return ""
    count = "" if done.count is None else f" {done.count}"
    return f"{done.result}{count}, {done.took_s:.3f} s"
