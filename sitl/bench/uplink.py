# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of a station's frame on its way to the autopilot: processor time, and delay.

Processor time a frame is the process's time under the mix, less its time on the downlink only, by the frames that were
sent. Both are taken in many short slices one after the other: the time of an idle process drifts by more than the
frames cost. Ours and the baseline take turns. Delay is from the station's `sendto` to the autopilot's `recv`, both in
this process, for every frame. Ours and the baseline run at the same time, frame by frame, so other load of the machine
affects both. It contains the time of sockets and of this process, on both sides alike. The effect of a frame on a busy
loop is in both numbers: the aircraft's stream continues, fifty frames a second. The baseline has the few modules that
ours has; with signing it is also measured with its default modules.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from sitl.bench.loop import BenchError, Timer
from sitl.bench.numbers import Pair, abba, compare, median, quantile, settled
from sitl.bench.results import Measurement, from_comparison
from sitl.bench.rig import Proxy, Rig
from sitl.bench.traffic import frame_key, uplink_message

__all__ = ["CpuStudy", "DelayStudy", "Plan", "Sender"]

#: "Numbers that are held to" in docs/architecture.md, and the target of the gate
CPU_RATIO, DELAY_RATIO = 0.5, 1.0
#: A B, B A
PAIRS_A_START = 2
#: of a turn or a window that frames got lost in
TRIES = 4
UNCERTAINTY = 0.04
STREAM = 50
_SETTLE_S = 0.3
#: of each rate, and of the downlink alone before each of them
_SLICES = 6
_DRAIN_S = 0.05
#: of the frames, how many may get lost before a measurement is void: UDP on a busy machine
_LOSS_LIMIT = 0.01


@dataclass(frozen=True, slots=True)
class Plan:
    """How long, for each start of the two processes.

    `rates`: frames a second -> seconds; `idle_s`: seconds of the downlink alone, all together. `windows`: stretches of
    `window_s` in which delays are compared.
    """

    rates: dict[int, float]
    idle_s: float
    windows: int
    window_s: float = 2.0


class Disturbed(BenchError):
    """Frames got lost on `side`: the machine stood still for longer than sockets bridge, or the side was too slow."""

    def __init__(self, text: str, side: str) -> None:
        super().__init__(text)
        self.side = side


class Sender:
    """A station that sends the mix, and the results of its frames."""

    def __init__(self, rig: Rig, proxy: Proxy, station: int) -> None:
        self.proxy = proxy
        self.frames = 0
        self.delays_s: list[float] = []
        self._rig = rig
        self._station = proxy.stations[station]
        self._underway: dict[bytes, float] = {}
        self._timer: Timer | None = None

    def begin(self, rate: int, first_in_s: float = 0.0) -> None:
        """Send so many frames a second."""
        self.frames = 0
        self.delays_s = []
        self._underway.clear()
        self.proxy.autopilot.model.on_frame = self._arrived
        self._timer = self._rig.loop.every(1.0 / rate, self._send, first_in_s)

    def end(self) -> None:
        """Stop; frames under way may still arrive."""
        if self._timer is not None:
            self._timer.cancel()

    def _send(self) -> None:
        raw = self._station.pack(uplink_message(self._rig.next_number()))
        self.frames += 1
        self._underway[frame_key(raw)] = time.monotonic()
        self._station.put(raw)

    def _arrived(self, raw: bytes) -> None:
        began = self._underway.pop(frame_key(raw), None)
        if began is not None:
            self.delays_s.append(self.proxy.autopilot.received_at - began)

    def check(self) -> None:
        """Raises Disturbed if too many frames got lost."""
        _check(self.proxy, self.frames, len(self.delays_s))


def _check(proxy: Proxy, frames: int, arrived: int) -> None:
    lost = frames - arrived
    if lost > frames * _LOSS_LIMIT:
        raise Disturbed(f"{proxy.name}: {lost} of {frames} frames did not arrive", proxy.name)


@dataclass(slots=True)
class _Visit:
    """One turn of one side."""

    idle_per_s: float = 0.0
    cpu_us: dict[int, float] = field(default_factory=dict)
    passed: dict[int, float] = field(default_factory=dict)


def _spent(rig: Rig, proxy: Proxy, seconds: float) -> float:
    """Processor time in the next `seconds`."""
    before = proxy.cpu_s()
    rig.loop.run(seconds)
    return proxy.cpu_s() - before


def _visit(rig: Rig, proxy: Proxy, plan: Plan, station: int) -> _Visit:
    """Slices of the mix at every rate, and of the downlink alone between them."""
    proxy.autopilot.model.stream(STREAM)
    rig.loop.run(_SETTLE_S)
    idle_s = plan.idle_s / len(plan.rates) / _SLICES
    idle: list[float] = []
    spent = dict.fromkeys(plan.rates, 0.0)
    frames: Counter[int] = Counter()
    arrived: Counter[int] = Counter()
    for _ in range(_SLICES):
        for rate, seconds in plan.rates.items():
            idle.append(_spent(rig, proxy, idle_s) / idle_s)
            sender = Sender(rig, proxy, station)
            before = proxy.cpu_s()
            sender.begin(rate)
            rig.loop.run(seconds / _SLICES)
            sender.end()
            rig.loop.run(_DRAIN_S)
            spent[rate] += proxy.cpu_s() - before
            frames[rate] += sender.frames
            arrived[rate] += len(sender.delays_s)
    visit = _Visit(idle_per_s=sum(idle) / len(idle))
    for rate, seconds in plan.rates.items():
        if station == 0:
            _check(proxy, frames[rate], arrived[rate])
        visit.passed[rate] = arrived[rate] / frames[rate]
        alone = visit.idle_per_s * (seconds + _SLICES * _DRAIN_S)
        visit.cpu_us[rate] = (spent[rate] - alone) / frames[rate] * 1e6
    proxy.autopilot.model.stream(0)
    proxy.check()
    return visit


class CpuStudy:
    """Processor time a frame, of the commander's frames or of an observer's (no target), in turns."""

    def __init__(self, plan: Plan, case: dict[str, Any], *, observer: bool = False) -> None:
        self._plan = plan
        self._case = case
        self._observer = observer
        self._visits: list[tuple[_Visit, _Visit]] = []
        #: turns that were made again because frames got lost, by side
        self._disturbed: Counter[str] = Counter()

    def measure(self, rig: Rig) -> str:
        """Add the pairs of one start of the processes; the ratios so far, for people."""
        for order in islice(abba(), PAIRS_A_START):
            self._visits.append(self._pair(rig, order))
        ratios = ", ".join(f"{compare(self.pairs(rate)).ratio:.2f}" for rate in self._plan.rates)
        return f"CPU ratio{' (observer)' if self._observer else ''} after {len(self._visits)} pairs: {ratios}"

    def _pair(self, rig: Rig, order: tuple[bool, bool]) -> tuple[_Visit, _Visit]:
        station = 1 if self._observer else 0
        for _ in range(TRIES):
            try:
                found = {ours: _visit(rig, rig.ours if ours else rig.baseline, self._plan, station) for ours in order}
                return found[True], found[False]
            except Disturbed as trouble:
                last = trouble
                self._disturbed[trouble.side] += 1
                for proxy in (rig.ours, rig.baseline):
                    proxy.autopilot.model.stream(0)
        raise last

    def pairs(self, rate: int) -> list[Pair]:
        """All pairs of one rate, microseconds a frame."""
        return [Pair(ours.cpu_us[rate], baseline.cpu_us[rate]) for ours, baseline in self._visits]

    def settled(self) -> bool:
        """Whether more starts would hardly change the ratios."""
        return all(settled(self.pairs(rate), 2 * PAIRS_A_START, UNCERTAINTY) for rate in self._plan.rates)

    def results(self) -> Iterator[Measurement]:
        """One line a rate."""
        for rate in self._plan.rates:
            details: dict[str, Any] = {
                "idle_ms_per_s": _both([(a.idle_per_s * 1e3, b.idle_per_s * 1e3) for a, b in self._visits]),
                "part_that_passed": _both([(a.passed[rate], b.passed[rate]) for a, b in self._visits]),
                "turns_repeated_for_lost_frames": dict(self._disturbed),
            }
            yield from_comparison(
                "uplink",
                "CPU per frame of an observer" if self._observer else "CPU per frame",
                "us",
                {"frames_per_s": rate, **self._case},
                compare(self.pairs(rate)),
                limit=None if self._observer else CPU_RATIO,
                details=details,
                note="an observer's frames: ours judges and refuses what steers, stock MAVProxy passes all of it"
                if self._observer
                else "",
            )


def _both(values: list[tuple[float, float]]) -> dict[str, float]:
    return {"ours": median([a for a, _b in values]), "baseline": median([b for _a, b in values])}


@dataclass(slots=True)
class _Delays:
    """Delays at one rate: a pair a window, milliseconds, and every single one, seconds."""

    medians: list[Pair] = field(default_factory=list)
    lates: list[Pair] = field(default_factory=list)
    ours: list[float] = field(default_factory=list)
    baseline: list[float] = field(default_factory=list)


class DelayStudy:
    """Delay of the commander's frames, through both processes at the same time, frame by frame."""

    def __init__(self, plan: Plan, case: dict[str, Any]) -> None:
        self._plan = plan
        self._case = case
        self._delays = {rate: _Delays() for rate in plan.rates}
        #: windows that were made again because frames got lost, by side
        self._disturbed: Counter[str] = Counter()

    def measure(self, rig: Rig) -> str:
        """Add the windows of one start of the processes; the ratios so far, for people."""
        senders = (Sender(rig, rig.ours, 0), Sender(rig, rig.baseline, 0))
        for proxy in (rig.ours, rig.baseline):
            proxy.autopilot.model.stream(STREAM)
        for rate, delays in self._delays.items():
            for window in range(self._plan.windows):
                # the first sender in each period changes with the window
                self._window(rig, senders if window % 2 else senders[::-1], rate)
                ours, baseline = (sender.delays_s for sender in senders)
                delays.medians.append(Pair(median(ours) * 1e3, median(baseline) * 1e3))
                delays.lates.append(Pair(quantile(ours, 0.99) * 1e3, quantile(baseline, 0.99) * 1e3))
                delays.ours += ours
                delays.baseline += baseline
        for proxy in (rig.ours, rig.baseline):
            proxy.autopilot.model.stream(0)
            proxy.check()
        ratios = (
            f"{compare(delays.medians).ratio:.2f} (99 %: {compare(delays.lates).ratio:.2f})"
            for delays in self._delays.values()
        )
        return "delay ratio: " + ", ".join(ratios)

    def _window(self, rig: Rig, senders: tuple[Sender, Sender], rate: int) -> None:
        for _ in range(TRIES):
            for place, sender in enumerate(senders):
                sender.begin(rate, place * 0.5 / rate)
            rig.loop.run(self._plan.window_s)
            for sender in senders:
                sender.end()
            rig.loop.run(_DRAIN_S)
            try:
                for sender in senders:
                    sender.check()
                return
            except Disturbed as trouble:
                last = trouble
                self._disturbed[trouble.side] += 1
        raise last

    def results(self) -> Iterator[Measurement]:
        """Median and 99 % for each rate."""
        for rate, delays in self._delays.items():
            for what, pairs, part in (("delay, median", delays.medians, 0.5), ("delay, 99 %", delays.lates, 0.99)):
                details = {
                    "frames": {"ours": len(delays.ours), "baseline": len(delays.baseline)},
                    "windows_repeated_for_lost_frames": dict(self._disturbed),
                    "of_all_frames_ms": {
                        "ours": quantile(delays.ours, part) * 1e3,
                        "baseline": quantile(delays.baseline, part) * 1e3,
                    },
                }
                case = {"frames_per_s": rate, **self._case}
                yield from_comparison("uplink", what, "ms", case, compare(pairs), limit=DELAY_RATIO, details=details)
