# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of sending the vehicle's stream to the stations: processor time a second, idle loop included.

The baseline is a stock MAVProxy with one `--out` a station: with the few modules that ours has and, for two stations,
also with its default modules. Ours does more in one respect (zone check at every position, lease, authority and control
status) and less in another (an observer gets a part of the stream). Both are in the numbers, and the frames that each
station got stand beside them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

from sitl.bench.numbers import Pair, abba, compare, median, settled
from sitl.bench.results import Measurement, from_comparison
from sitl.bench.rig import Proxy, Rig

__all__ = ["Plan", "Study"]

CPU_RATIO = 1.1
PAIRS_A_START = 2
UNCERTAINTY = 0.03
_SETTLE_S = 0.4


@dataclass(frozen=True, slots=True)
class Plan:
    """Streams (frames a second), and seconds for each turn."""

    streams: tuple[int, ...]
    seconds: float


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


class Study:
    """All streams of the plan, in turns, over several starts of the processes."""

    def __init__(self, plan: Plan, stations: int, as_it_comes: bool = False) -> None:
        """`as_it_comes`: the rigs' stock MAVProxy is."""
        self._plan = plan
        self._stock = "as it comes" if as_it_comes else "our modules"
        self._stations = stations
        self._turns: dict[int, list[tuple[_Turn, _Turn]]] = {stream: [] for stream in plan.streams}

    def measure(self, rig: Rig) -> str:
        """Add the pairs of one start of the processes; the ratios so far, for people."""
        for stream, turns in self._turns.items():
            for order in islice(abba(), PAIRS_A_START):
                seconds = self._plan.seconds
                found = {ours: _turn(rig, rig.ours if ours else rig.baseline, stream, seconds) for ours in order}
                turns.append((found[True], found[False]))
        ratios = ", ".join(f"{compare(self.pairs(stream)).ratio:.2f}" for stream in self._turns)
        return f"{self._stations} stations, stock {self._stock}, CPU ratio so far: {ratios}"

    def pairs(self, stream: int) -> list[Pair]:
        """All pairs of one stream, milliseconds a second."""
        return [Pair(ours.cpu_ms, baseline.cpu_ms) for ours, baseline in self._turns[stream]]

    def settled(self) -> bool:
        """Whether more starts would hardly change the ratios."""
        return all(settled(self.pairs(stream), 2 * PAIRS_A_START, UNCERTAINTY) for stream in self._turns)

    def results(self) -> Iterator[Measurement]:
        """One line a stream."""
        for stream, turns in self._turns.items():
            delivered = _delivered(turns)
            yield from_comparison(
                "downlink",
                "CPU per second",
                "ms/s",
                {"stations": self._stations, "frames_per_s": stream, "stock": self._stock},
                compare(self.pairs(stream)),
                limit=CPU_RATIO if self._stations == 2 else None,
                details={"frames_per_s_delivered": delivered},
                note=f"{self._stations} stations, {stream} frames/s: to commander and each observer come "
                f"{_told(delivered['ours'])} frames/s, to stock MAVProxy's outputs {_told(delivered['baseline'])}",
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


def _told(side: dict[str, float]) -> str:
    return f"{side['commander_or_first_output']:.0f} and {side['each_observer_or_output']:.0f}"
