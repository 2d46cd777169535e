# SPDX-License-Identifier: GPL-3.0-or-later

"""What it costs to give the vehicle's stream to the stations: processor time a second, idle loop and all.

The baseline is a stock MAVProxy with one `--out` a station. Ours does more in one respect (zone check at every
position, lease, authority and control status) and less in another (an observer gets a part of the stream): both are in
the numbers, and what each station got stands beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from sitl.bench.numbers import Pair, abba, compare, median, settled
from sitl.bench.results import Measurement, from_comparison
from sitl.bench.rig import Proxy, Rig

__all__ = ["Plan", "measure"]

CPU_RATIO = 1.1
_SETTLE_S = 0.4


@dataclass(frozen=True, slots=True)
class Plan:
    """Streams (frames a second), seconds for each, and how many pairs (see `uplink.Plan`)."""

    streams: tuple[int, ...]
    seconds: float
    least: int
    most: int
    uncertainty: float = 0.02


@dataclass(frozen=True, slots=True)
class _Turn:
    """One stream on one side, all per second."""

    cpu_ms: float
    sent: float
    commander_got: float
    observers_got: float


def _heard(proxy: Proxy) -> list[int]:
    return [station.heard.total() for station in proxy.stations]


def _turn(rig: Rig, proxy: Proxy, stream: int, seconds: float) -> _Turn:
    model = proxy.autopilot.model
    model.stream(stream)
    rig.loop.run(_SETTLE_S)
    cpu, sent, heard = proxy.cpu_s(), model.frames_out, _heard(proxy)
    rig.loop.run(seconds)
    spent = proxy.cpu_s() - cpu
    got = [(now - before) / seconds for now, before in zip(_heard(proxy), heard, strict=True)]
    turn = _Turn(spent / seconds * 1e3, (model.frames_out - sent) / seconds, got[0], median(got[1:]))
    model.stream(0)
    proxy.check()
    return turn


def measure(rig: Rig, plan: Plan, say: Callable[[str], None]) -> Iterator[Measurement]:
    """All streams of the plan, in turns."""
    stations = len(rig.ours.stations)
    for stream in plan.streams:
        turns: list[tuple[_Turn, _Turn]] = []
        for order in abba():
            found = {ours: _turn(rig, rig.ours if ours else rig.baseline, stream, plan.seconds) for ours in order}
            turns.append((found[True], found[False]))
            pairs = [Pair(ours.cpu_ms, baseline.cpu_ms) for ours, baseline in turns]
            if settled(pairs, plan.least, plan.uncertainty) or len(turns) >= plan.most:
                break
        comparison = compare(pairs)
        say(f"{stations} stations, {stream} frames/s: CPU ratio {comparison.ratio:.2f}")
        yield from_comparison(
            "downlink",
            "CPU per second",
            "ms/s",
            {"stations": stations, "frames_per_s": stream},
            comparison,
            limit=CPU_RATIO if stations == 2 else None,
            details={"frames_per_s_delivered": _delivered(turns)},
        )


def _delivered(turns: list[tuple[_Turn, _Turn]]) -> dict[str, Any]:
    return {
        side: {
            "from_autopilot": median([turn[index].sent for turn in turns]),
            "commander_or_first_output": median([turn[index].commander_got for turn in turns]),
            "each_observer_or_output": median([turn[index].observers_got for turn in turns]),
        }
        for index, side in enumerate(("ours", "baseline"))
    }
