# SPDX-License-Identifier: GPL-3.0-or-later

"""The results of a run on several hosts, as values: for `hosts.json`, for the table, and for tests.

Everything comes from journals, the stations' telemetry logs and the meter's file. Times of the flight are simulated
seconds, as in the story and the report; how long a link was without frames is in seconds of the wall clock.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.wire.ids import AUTOPILOT_COMPID
from sitl.hosts.flight import CUT, HEALED
from sitl.hosts.network import METER_FILE
from sitl.hosts.plan import MISSION_COMPUTER, PATHS, Plan
from sitl.report.evidence import Evidence
from sitl.report.tlog import frames
from sitl.run.fleet import FIRST
from sitl.run.runner import Result

__all__ = ["costs_of", "longest_gap_s", "results_of"]

#: the effect of the cut is looked for within this time after it (s of the wall clock)
_AFTER_S: Final = 15.0


def results_of(result: Result, plan: Plan, lte_says: str, tunnel_says: str) -> dict[str, Any]:
    """All values. `tunnel_says`: what makes the tunnels, "" for none."""
    evidence = result.evidence
    assert evidence is not None
    found: dict[str, Any] = {
        "hosts": [
            {
                "name": host.name,
                "says": host.says,
                "addresses": {each.name: each.address for each in host.interfaces},
                "routes": [str(route) for route in host.routes],
            }
            for host in plan.hosts
        ],
        "paths": {"wired": "Ethernet, through the gateway", "lte": lte_says},
        "links": {station: {path: "@".join(plan.reach(station, path)) for path in PATHS} for station in plan.stations},
        "handovers": _handovers(evidence),
        "cut": _cut(evidence, result.order.folder, plan),
        "tunnel": None,
        "held": result.held,
    }
    if tunnel_says:
        found["tunnel"] = {
            "made_by": tunnel_says,
            "stations": list(plan.tunnelled),
            "ends": {f"{end.host} {end.interface}": f"{end.address}, MTU {end.mtu}" for end in plan.tunnels},
            "paths": costs_of(result.order.folder / "meter" / METER_FILE, _pairs(plan)),
        }
    return found


def _handovers(evidence: Evidence) -> list[dict[str, Any]]:
    marks, found = evidence.notes.marks, []
    for entry in evidence.of(event="transfer_committed"):
        cut = CUT in marks and marks[CUT] <= entry.t <= marks.get(HEALED, entry.t)
        found.append(
            {
                "to": entry.get("station"),
                "epoch": entry.get("epoch"),
                "at_s": round(evidence.sim_at(entry.t), 1),
                "duration_s": entry.get("duration_s"),
                "while_cut": cut,
            }
        )
    return found


def _cut(evidence: Evidence, folder: Path, plan: Plan) -> dict[str, Any] | None:
    marks = evidence.notes.marks
    if CUT not in marks:
        return None
    begun = marks[CUT]
    stations: dict[str, Any] = {}
    offset_s = time.time() - time.monotonic()
    for station in plan.stations:
        changes = [
            entry
            for entry in evidence.entries
            if entry.who == FIRST[0]
            and entry.event == "link"
            and entry.get("station") == station
            and begun <= entry.t <= min(begun + _AFTER_S, marks.get(HEALED, entry.t))
        ]
        switched = next((entry for entry in changes if entry.get("change") == "switched"), None)
        log = folder / station / f"{station}.tlog"
        stations[station] = {
            "switched_s": None if switched is None else round(switched.t - begun, 3),
            "companion": [entry.text for entry in changes],
            "silent_s": longest_gap_s(log, begun + offset_s, begun + offset_s + _AFTER_S),
        }
    return {
        "at_s": round(evidence.sim_at(begun), 1),
        "healed_s": round(evidence.sim_at(marks[HEALED]), 1) if HEALED in marks else None,
        "stations": stations,
    }


def longest_gap_s(log: Path, begin_utc: float, end_utc: float) -> float | None:
    """The longest time between two frames of the autopilot's telemetry in a station's log, around these moments.

    Heartbeats do not count: they come by all links. None: the log is not there, or has no frame of that time."""
    try:
        data = log.read_bytes()
    except OSError:
        return None
    sender = (FIRST[1], AUTOPILOT_COMPID)
    times = [
        at
        for at, frame in frames(data)
        if (frame.sysid, frame.compid) == sender and frame.msgid != mavlink.MAVLINK_MSG_ID_HEARTBEAT
    ]
    gaps = [later - earlier for earlier, later in pairwise(times) if begin_utc <= later and earlier <= end_utc]
    return round(max(gaps), 3) if gaps else None


def _pairs(plan: Plan) -> dict[str, tuple[str, str]]:
    """Path -> the tunnel's interface on the mission computer, and the one below it."""
    station = plan.tunnelled[0]
    return {
        end.path: (end.interface, plan.reach(station, end.path, inside=False)[1])
        for end in plan.tunnels
        if end.host == MISSION_COMPUTER
    }


def _almost_all(values: list[float]) -> float:
    """99 % of them are not above this one."""
    return sorted(values)[-(-99 * len(values) // 100) - 1]


def costs_of(meter: Path, interfaces: Mapping[str, tuple[str, str]]) -> dict[str, Any]:
    """The cost of the tunnel on each path, by the meter's file. A path without packets is left out."""
    trips: dict[str, list[float]] = {}
    last: dict[str, Any] = {}
    try:
        lines = meter.read_text(encoding="utf-8").splitlines()
    except OSError:
        return {}
    for line in lines:
        try:
            last = json.loads(line)
        except ValueError:  # cut at the end
            continue
        for name, asked in last["asked"].items():
            trips.setdefault(name, []).extend(asked["round_trips"])
    found = {}
    for path, (through, below) in interfaces.items():
        plain, tunnel = trips.get(f"{path}/plain", []), trips.get(f"{path}/tunnel", [])
        inner, outer = last.get("seen", {}).get(through), last.get("seen", {}).get(below)
        if not plain or not tunnel or not inner or not outer or not inner["packets"] or not outer["packets"]:
            continue
        inside, outside = inner["bytes"] / inner["packets"], outer["bytes"] / outer["packets"]
        found[path] = {
            "plain_ms": round(median(plain) * 1000, 2),
            "tunnel_ms": round(median(tunnel) * 1000, 2),
            "added_ms": round((median(tunnel) - median(plain)) * 1000, 2),
            "plain_99_ms": round(_almost_all(plain) * 1000, 2),
            "tunnel_99_ms": round(_almost_all(tunnel) * 1000, 2),
            "round_trips": [len(plain), len(tunnel)],
            "packets": inner["packets"],
            "packet_bytes": round(inside, 1),
            "packet_bytes_in_tunnel": round(outside, 1),
            "added_bytes": round(outside - inside, 1),
            "own_packets": outer["own_packets"],
            "own_bytes": outer["own_bytes"],
        }
    return found
