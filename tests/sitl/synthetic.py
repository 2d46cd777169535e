# SPDX-License-Identifier: GPL-3.0-or-later

"""A run's journals made by hand: the test package `round` flown as planned, without any process.

The track is the planned walk at cruise speed; authority moves where the walk says. Handover 1 is by the book,
handover 2 loses its request once, handover 3 goes without a ground link (the vehicle passes steps 2 and 5 on),
handover 4 is by the book again. Simulated time runs five times as fast as the wall clock.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mavproxy_handover.mission import package as packages
from sitl.report.evidence import Evidence, RunNotes
from sitl.report.journal_reader import Entry
from tests.packages import ROUND

VEHICLE_NAME = "drone-1"
SPEEDUP = 5.0
BEGUN_T = 1000.0
BOOT_S = 50.0
#: durations of the four handovers, seconds
DURATIONS = (0.0124, 0.2218, 0.0151, 0.0098)


@dataclass
class Script:
    """Entries of every journal as they are written down."""

    entries: list[Entry] = field(default_factory=list)

    def note(self, t: float, who: str, event: str, text: str = "", **values: Any) -> None:
        self.entries.append(Entry(t, who, event, text, values))

    def message(
        self, t: float, sender: str, receiver: str, name: str, number: int, took: float = 0.0011, **more: Any
    ) -> None:
        """A message that arrives; `lost=True`: one that does not."""
        lost = more.pop("lost", False)
        ground = VEHICLE_NAME not in (sender, receiver)
        values = {"name": name, "handover_id": number, "epoch": number, **({"via": "ground"} if ground else {}), **more}
        self.note(t, sender, "message", direction="out", station=receiver, **values)
        if not lost:
            values.pop("attempt", None)
            self.note(t + took, receiver, "message", direction="in", station=sender, **values)


def wall(sim_s: float) -> float:
    """Monotonic time at a simulated time."""
    return BEGUN_T + sim_s / SPEEDUP


def nominal() -> list[Entry]:
    """Every entry of the flight, sorted."""
    package = packages.load(ROUND)
    names = {station.sysid: station.name for station in package.stations}
    script = Script()
    _ground(script)
    walk = package.simulate()
    start_t = wall(BOOT_S)
    commander, number = 251, 0
    reached = 0
    for sample in walk.samples:
        t = start_t + sample.time_s / SPEEDUP
        script.note(
            t, "vehicle", "sample", sim_s=BOOT_S + sample.time_s, lat_deg=sample.lat_deg, lon_deg=sample.lon_deg,
            alt_m=sample.alt_m, heading_deg=0.0, speed_mps=10.0,
        )  # fmt: skip
        script.note(t, VEHICLE_NAME, "position", lat_deg=sample.lat_deg, lon_deg=sample.lon_deg)
        if sample.seq - 1 > reached:
            reached = sample.seq - 1
            script.note(t, "vehicle", "reached", f"item {reached} reached", number=reached)
        if sample.commander != commander:
            number += 1
            _transfer(script, t, number, names[commander], names[sample.commander])
            commander = sample.commander
    last = walk.samples[-1]
    end_t = start_t + last.time_s / SPEEDUP
    script.note(end_t, "vehicle", "landed", "landed", lat_deg=last.lat_deg, lon_deg=last.lon_deg)
    script.note(end_t + 0.1, "vehicle", "disarmed", "disarmed")
    script.note(end_t + 0.1, VEHICLE_NAME, "landed", "disarmed: the flight is over", reason="landed")
    return sorted(script.entries, key=lambda entry: entry.t)


def _ground(script: Script) -> None:
    who = VEHICLE_NAME
    script.note(wall(1), "vehicle", "mode", "mode STABILIZE", mode="STABILIZE")
    script.note(wall(4), who, "connected", "GCSA is connected", station="GCSA")
    _view(script, wall(4), "on_load", "GCSA", 1, "held")
    script.note(wall(4), who, "authority", "GCSA commands, epoch 1", station="GCSA", epoch=1)
    script.note(wall(5), who, "guard", "guard: silent -> live")
    script.note(wall(48), who, "accepted", station="GCSA", what="COMMAND_LONG/MAV_CMD_MISSION_START")
    script.note(wall(48), who, "start", "START from GCSA", station="GCSA")
    script.note(wall(48.5), "vehicle", "mode", "mode GUIDED", mode="GUIDED")
    script.note(wall(49), "vehicle", "armed", "armed")
    script.note(wall(49.5), "vehicle", "mode", "mode AUTO", mode="AUTO")
    script.note(wall(49.6), who, "started", "on mission: START", station="GCSA", reason="started")
    _view(script, wall(49.6), "on_mission", "GCSA", 1, "held")
    script.note(
        wall(60), who, "refused", "COMMAND_LONG/MAV_CMD_DO_SET_MODE of GCSB refused: not in control", station="GCSB",
        what="COMMAND_LONG/MAV_CMD_DO_SET_MODE", reason="not_in_control", answered=True,
    )  # fmt: skip


def _view(script: Script, t: float, phase: str, commander: str | None, epoch: int, lease: str) -> None:
    values = {"phase": phase, "epoch": epoch, "lease": lease, **({"commander": commander} if commander else {})}
    script.note(t, VEHICLE_NAME, "view", **values)


def _transfer(script: Script, t: float, number: int, old: str, new: str) -> None:
    who, took = VEHICLE_NAME, DURATIONS[number - 1]
    end = t + took
    script.note(t, who, "transfer_begun", f"handover {number}: {old} -> {new}", station=new, handover_id=number)
    _view(script, t, "on_handover", old, number, "transfer")
    at = t + 0.0004
    if number == 2:
        script.message(at, who, new, "HANDOVER_REQUEST", number, attempt=1, lost=True)
        at += 0.2
        script.message(at, who, new, "HANDOVER_REQUEST", number, attempt=2)
    else:
        script.message(at, who, new, "HANDOVER_REQUEST", number, attempt=1)
    step = (end - at) / 6
    if number == 3:
        script.message(at + step, new, who, "ON_HANDOVER", number, consent="granted")
        script.message(at + 1.6 * step, who, old, "ON_HANDOVER", number, relayed=True, consent="granted")
    else:
        script.message(at + step, new, old, "ON_HANDOVER", number, consent="granted")
        script.message(at + step, new, who, "ON_HANDOVER", number, consent="granted")
    script.message(at + 2.2 * step, old, who, "OK_HANDOVER", number, took=step / 3, consent="granted")
    script.message(at + 3 * step, who, new, "CONNECT_HANDOVER", number, took=step / 3)
    if number == 3:
        script.message(at + 4 * step, new, who, "DRONE_CONNECTED", number, took=step / 3)
        script.message(at + 4.5 * step, who, old, "DRONE_CONNECTED", number, took=step / 3, relayed=True)
    else:
        script.message(at + 4 * step, new, old, "DRONE_CONNECTED", number, took=step / 3)
        script.message(at + 4 * step, new, who, "DRONE_CONNECTED", number, took=step / 3)
    script.message(at + 5 * step, old, who, "DISCONNECT_HANDOVER", number, took=step * 0.9)
    script.note(
        end, who, "transfer_committed", f"handover {number} committed", station=new, handover_id=number,
        duration_s=took, epoch=number + 1,
    )  # fmt: skip
    _view(script, end, "on_mission", new, number + 1, "held")
    for station in (old, new):
        script.message(end + 0.0002, who, station, "HANDOVER_RESULT", number)


def evidence(entries: list[Entry] | None = None, **values: Any) -> Evidence:
    """Evidence of the flight, or of other entries."""
    package = packages.load(ROUND)
    return Evidence(nominal() if entries is None else entries, package, RunNotes(SPEEDUP, **values))


def write_folder(
    folder: Path, entries: list[Entry] | None = None, *, verdicts: list[dict[str, Any]] | None = None
) -> Path:
    """The flight as the folder of a run; `entries`: instead of the flight as planned."""
    shutil.copytree(ROUND, folder / "mission")
    entries = entries or nominal()
    places = {"vehicle": "vehicle.jsonl", VEHICLE_NAME: "companion/companion.jsonl"}
    files: dict[str, list[str]] = {}
    for entry in entries:
        place = places.get(entry.who, f"{entry.who}/{entry.who}.jsonl")
        files.setdefault(place, []).append(entry.to_line())
    for place, lines in files.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text("\n".join(lines) + "\n", encoding="utf-8")
    run = {
        "scenario": "nominal",
        "description": "the delivery as planned",
        "vehicle": "builtin",
        "firmware": "4.7.0",
        "speedup": SPEEDUP,
        "begun_utc": "2026-11-20T10:00:00+00:00",
        "ended_t": entries[-1].t + 1.0,
        "duration_wall_s": 66.0,
        "duration_sim_s": 327.0,
        "marks": {"stopped": wall(180)},
        "deaths": {},
        "verdicts": verdicts or [{"held": True, "wanted": "4 handovers committed", "seen": "4 committed"}],
    }
    (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")
    return folder
