# SPDX-License-Identifier: GPL-3.0-or-later

"""Measures time-outs in the journals of runs, in simulated seconds:

    python -m tests.sitl.time_outs FOLDER ...         (each a run of `handover sim`, or a folder of runs)

It prints a table: each time-out, its setting, and what was measured at real time, at a speed-up with the embedded
vehicle, and at a speed-up with ArduPilot. A time-out is measured from the last heartbeat, lease or message to the event
that ends it. `ROWS` says how far a measurement may be from the setting. Exit code 1 if one is farther.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from pymavlink import mavutil

from mavproxy_handover.config.vehicle import load_vehicle
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.link.quality import LinkLimits

__all__ = ["ROWS", "Run", "TimeOut", "main", "runs_in", "table"]

Entry = dict[str, Any]


class Run:
    """What a run of `handover sim` has left in its folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.facts: Entry = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        self.marks: dict[str, float] = self.facts["marks"]

    @cached_property
    def limits(self) -> Limits:
        return load_vehicle(self.folder / "companion" / "companion.toml").limits

    @cached_property
    def companion(self) -> list[Entry]:
        return _entries(self.folder / "companion" / "companion.jsonl")

    @cached_property
    def vehicle(self) -> list[Entry]:
        return _entries(self.folder / "vehicle.jsonl")

    def heartbeats_before(self, sysid: int, utc_s: float) -> list[float]:
        """When the companion received heartbeats of a station before a time, in (negative) seconds from it."""
        log = mavutil.mavlink_connection(str(self.folder / "companion" / "companion.tlog"))
        found = []
        while (message := log.recv_match(type="HEARTBEAT")) is not None:
            if message.get_srcSystem() == sysid and message._timestamp < utc_s:
                found.append(float(message._timestamp) - utc_s)
        return found


def _entries(path: Path) -> list[Entry]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def _first(entries: Iterable[Entry], event: str, text: str = "", after: float = 0.0) -> Entry | None:
    """The first of these events after that time with this in its text."""
    for entry in entries:
        if entry["event"] == event and text in entry.get("text", "") and entry["t"] > after:
            return entry
    return None


def _between(begun: Entry | None, ended: Entry | None) -> list[float]:
    return [] if begun is None or ended is None else [ended["t"] - begun["t"]]


def _since(run: Run, mark: str, ended: Callable[[float], Entry | None]) -> list[float]:
    """From a mark of the scenario to an event after it."""
    if mark not in run.marks:
        return []
    entry = ended(run.marks[mark])
    return [] if entry is None else [entry["t"] - run.marks[mark]]


# ---- what is measured ----------------------------------------------------------------------------------------------


def commander_silent(run: Run) -> list[float]:
    """From the last heartbeat or transfer message of the commander to the loss of authority."""
    lost = _first(run.companion, "authority_lost", "is lost")
    if lost is None or lost["station"] not in run.facts["kills"]:
        return []
    lost_s = datetime.fromisoformat(lost["utc"]).timestamp()
    stations = load_vehicle(run.folder / "companion" / "companion.toml").stations
    (sysid,) = (each.station.sysid for each in stations if each.station.name == lost["station"])
    beats = run.heartbeats_before(sysid, lost_s)
    said = [
        entry["t"] - lost["t"]
        for entry in run.companion
        if entry["event"] == "message"
        and (entry["direction"], entry["station"]) == ("in", lost["station"])
        and entry["t"] < lost["t"]
    ]
    return [-max(beats + said)] if beats else []


def commander_deaf(run: Run) -> list[float]:
    return _since(run, "deaf", lambda t: _first(run.companion, "authority_lost", "answers no more", t))


def no_fix(run: Run) -> list[float]:
    return _since(run, "no fix", lambda t: _first(run.companion, "position_stale", after=t))


def stale_to_landing(run: Run) -> list[float]:
    stale = _first(run.companion, "position_stale")
    return _between(stale, _first(run.companion, "emergency", "no fresh position: land"))


def autopilot_silent(run: Run) -> list[float]:
    return _since(run, "cut", lambda t: _first(run.companion, "warning", "autopilot not heard", t))


def guard_silent(run: Run) -> list[float]:
    return _since(run, "cut", lambda t: _first(run.companion, "warning", "guard lost", t))


def no_lease(run: Run) -> list[float]:
    return _since(run, "cut", lambda t: _first(run.vehicle, "said", "HNDO: lease lost", t))


def lease_says_lost(run: Run) -> list[float]:
    lost = _first(run.companion, "authority_lost")
    if lost is None or any(entry["event"] == "transfer_committed" for entry in _within(run, lost["t"], 3.5)):
        return []
    return _between(lost, _first(run.vehicle, "said", "HNDO: no authority", lost["t"]))


def _within(run: Run, begun: float, duration_s: float) -> Iterator[Entry]:
    return (entry for entry in run.companion if begun <= entry["t"] <= begun + duration_s)


def result_repeated(run: Run) -> list[float]:
    given_up = _first(run.companion, "result_unacknowledged")
    if given_up is None:
        return []
    handover = f"handover {given_up['text'].split()[-2]} "
    ended = [
        entry
        for entry in run.companion
        if entry["event"] in ("transfer_committed", "transfer_aborted") and entry["text"].startswith(handover)
    ]
    return _between(ended[0] if ended else None, given_up)


def held(run: Run) -> list[float]:
    hold = _first(run.companion, "emergency", "coverage ends ahead: hold")
    return _between(hold, _first(run.companion, "emergency", "coverage ends ahead: return", hold["t"] if hold else 0.0))


def denied_pause(run: Run) -> list[float]:
    """From a denial to the next transfer between the same stations for the same reason."""
    denied = _first(run.companion, "transfer_aborted", "_denied")
    if denied is None:
        return []
    begun = [entry for entry in run.companion if entry["event"] == "transfer_begun"]
    last = [entry for entry in begun if entry["t"] <= denied["t"]][-1]
    following = _first(begun, "transfer_begun", last["text"].partition(": ")[2], denied["t"])
    return _between(denied, following) if following is not None and following["reason"] == last["reason"] else []


def link_silent(run: Run) -> list[float]:
    """As the companion says it: "silence 3.02 s, limit 3.00 s"."""
    said = _first(run.companion, "link", "degraded: silence ")
    return [] if said is None else [float(said["text"].partition("silence ")[2].split()[0])]


def _waits(run: Run, which: Callable[[int], bool]) -> list[float]:
    """Between the attempts to send one message of a transfer to a station that says nothing meanwhile."""
    waits = []
    sent: dict[str, Entry] = {}
    for entry in run.companion:
        if entry["event"] != "message":
            continue
        before = sent.pop(entry["station"], None)
        if entry["direction"] == "in":
            continue
        sent[entry["station"]] = entry
        again = before is not None and all(before[key] == entry[key] for key in ("name", "handover_id", "epoch"))
        if before is not None and again and entry["attempt"] == before["attempt"] + 1 and which(entry["attempt"]):
            waits.append(entry["t"] - before["t"])
    return waits


def first_wait(run: Run) -> list[float]:
    return _waits(run, lambda attempt: attempt == 2)


def longest_wait(run: Run) -> list[float]:
    return _waits(run, lambda attempt: attempt >= 7)


@dataclass(frozen=True, slots=True)
class TimeOut:
    """`set_to`: what a run has set it to. `early_s`, `late_s`: how much less and more a measurement may be."""

    name: str
    setting: str
    set_to: Callable[[Run], float]
    measure: Callable[[Run], list[float]]
    early_s: float
    late_s: float


def _hold_off_s(run: Run, cause: Cause) -> float:
    return run.limits.hold_off_s.get(cause, CAUSES[cause].hold_off_s)


#: Heartbeats and answers come once a second, a position every 0.2 s; a busy program writes its journal 0.1 s late. An
#: answer to CONNECT counts as a heartbeat, and no log has it. The time of ArduPilot goes on in steps of 0.05 s, and is
#: up to 0.4 s ahead of the companion's on a busy computer: what begins there and ends here is off by as much.
ROWS = (
    TimeOut("commander lost", "heartbeat_lost_s", lambda r: r.limits.heartbeat_lost_s, commander_silent, 0.05, 1.1),
    TimeOut("commander receives nothing", "deaf_lost_s", lambda r: r.limits.deaf_lost_s, commander_deaf, 1.1, 0.5),
    TimeOut("autopilot lost, warning", "autopilot_lost_s", lambda r: r.limits.autopilot_lost_s,
            autopilot_silent, 1.1, 0.2),
    TimeOut("guard lost, warning", "guard_lost_s, hold-off",
            lambda r: r.limits.guard_lost_s + _hold_off_s(r, Cause.GUARD_LOST), guard_silent, 0.6, 0.3),
    TimeOut("position lost", "position_stale_s", lambda r: r.limits.position_stale_s, no_fix, 0.3, 0.5),
    TimeOut("position lost, then landing", "hold-off",
            lambda r: _hold_off_s(r, Cause.POSITION_STALE), stale_to_landing, 0.1, 0.2),
    TimeOut("hold at the border, then return", "hold_s", lambda r: r.limits.hold_s, held, 0.1, 0.2),
    TimeOut("denial, then the next handover", "denied_pause_s", lambda r: r.limits.denied_pause_s,
            denied_pause, 0.1, 0.2),
    TimeOut("first retransmission", "retry_first_s", lambda r: r.limits.retry_first_s, first_wait, 0.15, 0.15),
    TimeOut("later retransmissions", "retry_max_s", lambda r: r.limits.retry_max_s, longest_wait, 0.1, 0.15),
    TimeOut("result not acknowledged", "result_timeout_s", lambda r: r.limits.result_timeout_s,
            result_repeated, 0.1, 0.2),
    TimeOut("no frame on a link", "silence_s of a link", lambda _: LinkLimits().silence_s, link_silent, 0.0, 1.1),
    TimeOut("guard: no lease, RTL", "HNDO_TIMEOUT", lambda _: 3.0, no_lease, 0.5, 0.5),
    TimeOut("guard: lease says LOST, RTL", "HNDO_LOST_T", lambda _: 3.0, lease_says_lost, 0.5, 0.5),
)  # fmt: skip


# ---- the table -----------------------------------------------------------------------------------------------------


def runs_in(folder: Path) -> list[Run]:
    """The run in this folder, or the runs in its folders."""
    found = [folder] if (folder / "run.json").exists() else [path.parent for path in folder.glob("*/run.json")]
    return [Run(path) for path in sorted(found)]


def _range(values: list[float]) -> str:
    if not values:
        return "-"
    low, high = f"{min(values):.2f}", f"{max(values):.2f}"
    return f"{low} ({len(values)})" if low == high else f"{low} to {high} ({len(values)})"


def _column(run: Run) -> int:
    return 0 if run.facts["speedup"] <= 1.0 else 1 if run.facts["vehicle"] == "builtin" else 2


def table(runs: Iterable[Run]) -> tuple[list[str], list[str]]:
    """The lines of the table, and what is outside of its bounds. A time-out has a line for each of its settings."""
    runs = list(runs)
    lines = [
        "| time-out | setting | s | real time | speed-up, embedded | speed-up, ArduPilot |",
        "|---|---|--:|--:|--:|--:|",
    ]
    wrong = []
    for row in ROWS:
        found: dict[float, tuple[list[float], ...]] = {}
        for run in runs:
            for value in row.measure(run):
                set_to = row.set_to(run)
                found.setdefault(set_to, ([], [], []))[_column(run)].append(value)
                if not set_to - row.early_s <= value <= set_to + row.late_s:
                    wrong.append(f"{row.name}: {value:.2f} s instead of {set_to:.2f} s in {run.folder}")
        for set_to, columns in sorted(found.items()):
            lines.append(f"| {row.name} | `{row.setting}` | {set_to:g} | {' | '.join(map(_range, columns))} |")
        if not found:
            lines.append(f"| {row.name} | `{row.setting}` | | - | - | - |")
    return lines, wrong


def main(arguments: list[str] | None = None) -> int:
    """Print the table of these runs."""
    parser = argparse.ArgumentParser(description="time-outs measured in the journals of runs")
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="a run, or a folder of runs")
    options = parser.parse_args(arguments)
    runs = [run for folder in options.folders for run in runs_in(folder)]
    lines, wrong = table(runs)
    speeds = sorted({run.facts["speedup"] for run in runs})
    print(
        f"{len(runs)} runs, speed-up {', '.join(f'{speed:g}' for speed in speeds)}. Seconds; in brackets: how often.\n"
    )
    print("\n".join([*lines, *(f"OUTSIDE: {what}" for what in wrong)]))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
