# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of frames: a station's frame on its way to the autopilot, and the vehicle's stream to the stations.

They are measured on two MAVProxy processes under the same load: the companion, and a stock MAVProxy with one `--out`
a station. Both are the installed MAVProxy with the same options (those of `handover companion`), the stock one without
our module and with its own heartbeat; if it is to be as it comes, with the modules that it loads by itself, too. Each
has an autopilot at a serial line (a pseudo-terminal) and stations of its own; the companion's parent commands, its
mission is loaded, and its aircraft is in the air, in the parent's zone.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, islice
from pathlib import Path
from statistics import mean, median
from typing import Any, Final, TypeVar

from mavproxy_handover.cli.launch import companion_argv
from mavproxy_handover.core.common.model import Phase
from sitl.bench.autopilot import STREAM, A, Place, SerialAutopilot
from sitl.bench.results import Measurement, Pair, Say, both, compare, from_comparison, in_turns, quantile, settled
from sitl.bench.rig import BenchError, Rig, Timer, companion_config, cpu_s, frame_key, shipped_mission
from sitl.bench.stations import load_mission, make_stations, uplink_message

__all__ = ["DOWNLINK", "DOWNLINK_QUICK", "UPLINK", "UPLINK_QUICK", "downlink", "uplink"]

T = TypeVar("T")

# ---- two processes --------------------------------------------------------------------------------------------------


#: in the delivery mission, inside the zone of GCSA and of no other; flying along
IN_ZONE_A: Final = Place(52.6792, 5.9240, 30.0, 3.0, 4.0)
#: pairs of turns with each start of the processes: A B, B A
PAIRS_A_START: Final = 2
_SIDES: Final = ("ours", "baseline")


class Proxy:
    """One MAVProxy process under test, its autopilot and its stations."""

    def __init__(self, rig: Rig, name: str, stations: int, signing: bool) -> None:
        self.name = name
        self.autopilot = SerialAutopilot(rig.loop, IN_ZONE_A)
        self.model = self.autopilot.model
        self.stations = make_stations(rig.loop, stations, signing=signing)
        self._rig = rig
        self._pid = 0

    def start(self, argv: list[str]) -> None:
        """Start the process and wait until it has connected to the autopilot. Raises BenchError."""
        self._pid = self._rig.run(self.name, argv).pid
        self.model.stream(0)
        self._rig.wait(lambda: self.autopilot.connected, f"{self.name} connects")
        self._rig.wait(lambda: all(station.heard for station in self.stations), "every station hears the vehicle")

    def establish(self) -> None:
        """Make the companion fly: parent in command, mission loaded, armed and airborne. Raises BenchError."""
        parent = self.stations[0]
        self.model.stream(STREAM)
        self._rig.wait(lambda: parent.commander == A, "the parent commands")
        package = shipped_mission("delivery")
        load_mission(self._rig, parent, package)
        for station in self.stations:
            station.digest = package.digest
        self.model.take_off()
        self._rig.wait(lambda: parent.phase == Phase.ON_MISSION, "the aircraft is on its mission")

    def cpu_s(self) -> float:
        """Processor time so far. Raises BenchError when the process is gone."""
        return cpu_s(self._pid)

    def close(self) -> None:
        """Close all sockets; the owner of the process ends it."""
        for station in self.stations:
            station.close()
        self.autopilot.close()


class SideBySide(Rig):
    """Ours and the baseline, started and ready."""

    def __init__(self, folder: Path, stations: int, *, signing: bool = False, as_it_comes: bool = False) -> None:
        """`signing`: every station signs with a key of its own; the companion checks, and signs what it gets.
        `as_it_comes`: the stock MAVProxy loads its default modules."""
        super().__init__(folder)
        self._signing = signing
        #: options of ours that the stock one does without
        self._ours_alone = ("--cmd=", "--heartbeat=", *(("--default-modules=",) if as_it_comes else ()))
        self.ours = Proxy(self, "companion", stations, signing)
        self.baseline = Proxy(self, "stock", stations, signing)
        self.sides = (self.ours, self.baseline)
        self._number = 0

    def set_up(self) -> None:
        home = self.folder / "companion"
        keys = self.folder / "keys" if self._signing else None
        config = companion_config(home, [station.entry(keys) for station in self.ours.stations])
        argv = [
            companion_argv(config, side.autopilot.device, self.folder / side.name / "mav.tlog") for side in self.sides
        ]
        self.ours.start(argv[0])
        self.ours.establish()
        outs = [f"--out=udp:127.0.0.1:{station.port}" for station in self.baseline.stations]
        self.baseline.start([*(word for word in argv[1] if not word.startswith(self._ours_alone)), *outs])
        self.baseline.model.take_off()  # which a stock MAVProxy ignores
        self.rest()
        self.loop.run(1.0)

    def side(self, ours: bool) -> Proxy:
        """One of the two."""
        return self.ours if ours else self.baseline

    def rest(self) -> None:
        """Both autopilots send a heartbeat and a position a second."""
        for side in self.sides:
            side.model.stream(0)

    def check(self) -> None:
        """Raises BenchError if a process has ended, or another station than the parent commands."""
        super().check()
        commander = self.ours.stations[0].commander
        if commander not in (None, A):
            raise BenchError(f"station {commander} commands in the middle of a measurement")

    def next_number(self) -> int:
        """A number for the next uplink frame, never given before."""
        self._number += 1
        return self._number

    def close(self) -> None:
        super().close()
        for side in self.sides:
            side.close()


def _starts(
    limits: tuple[int, int], make: Callable[[int], SideBySide], enough: Callable[[], bool]
) -> Iterator[SideBySide]:
    """The two processes, started again and again: least and most times, in between until there is enough."""
    least, most = limits
    for start in range(most):
        with make(start) as rig:
            yield rig
        if start + 1 >= least and enough():
            return


def _stock(as_it_comes: bool) -> str:
    return "as it comes" if as_it_comes else "our modules"


def _ratios(studies: list[list[Pair]]) -> str:
    return ", ".join(f"{compare(pairs).ratio:.2f}" for pairs in studies)


# ---- a station's frame up -------------------------------------------------------------------------------------------
#
# Processor time a frame is the process's time under the mix, less its time on the downlink only, by the frames that
# were sent. Both are taken in many short slices one after the other: the time of an idle process drifts by more than
# the frames cost. Ours and the baseline take turns. Delay is from the station's `sendto` to the autopilot's `recv`,
# both in this process, for every frame. Ours and the baseline run at the same time, frame by frame, so other load of
# the machine affects both. It contains the time of sockets and of this process, on both sides alike. The effect of a
# frame on a busy loop is in both numbers: the aircraft's stream continues, fifty frames a second.

#: "Numbers that are held to" in docs/architecture.md, and the target of the gate
UPLINK_CPU_RATIO, DELAY_RATIO = 0.5, 1.0
#: of a turn or a window that frames got lost in
TRIES: Final = 4
UPLINK_UNCERTAINTY: Final = 0.04
_UPLINK_SETTLE_S: Final = 0.3
#: of each rate, and of the downlink alone before each of them
_SLICES: Final = 6
_DRAIN_S: Final = 0.05
#: of the frames, how many may get lost before a measurement is void: UDP on a busy machine
_LOSS_LIMIT: Final = 0.01


@dataclass(frozen=True, slots=True)
class UplinkPlan:
    """How long, for each start of the two processes.

    `rates`: frames a second -> seconds; `idle_s`: seconds of the downlink alone, all together. `windows`: stretches of
    `window_s` in which delays are compared. `cases`: whether the stations sign, and whether the stock MAVProxy is as it
    comes. `starts`: least and most starts of the processes.
    """

    starts: tuple[int, int]
    rates: dict[int, float]
    idle_s: float
    windows: int
    cases: tuple[tuple[bool, bool], ...]
    window_s: float = 2.0


UPLINK = UplinkPlan((2, 3), {200: 4.2, 1000: 1.8}, 3.6, 2, ((False, False), (True, False), (True, True)))
UPLINK_QUICK = UplinkPlan((1, 1), {1000: 0.9}, 0.9, 1, ((False, False), (True, False)))


class Disturbed(BenchError):
    """Frames got lost on `side`: the machine stood still for longer than sockets bridge, or the side was too slow."""

    def __init__(self, text: str, side: str) -> None:
        super().__init__(text)
        self.side = side


def _undisturbed(job: Callable[[], T], disturbed: Counter[str]) -> T:
    """Do the job again if frames got lost, and count that by side. Raises Disturbed after the last of the tries."""
    for _ in range(TRIES):
        try:
            return job()
        except Disturbed as trouble:
            last = trouble
            disturbed[trouble.side] += 1
    raise last


def _check(proxy: Proxy, frames: int, arrived: int) -> None:
    lost = frames - arrived
    if lost > frames * _LOSS_LIMIT:
        raise Disturbed(f"{proxy.name}: {lost} of {frames} frames did not arrive", proxy.name)


class Sender:
    """A station that sends the mix, and the results of its frames."""

    def __init__(self, rig: SideBySide, proxy: Proxy, station: int) -> None:
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
        self.proxy.model.on_frame = self._arrived
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


@dataclass(slots=True)
class _Visit:
    """One turn of one side."""

    idle_per_s: float = 0.0
    cpu_us: dict[int, float] = field(default_factory=dict)
    passed: dict[int, float] = field(default_factory=dict)


class CpuStudy:
    """Processor time a frame, of the commander's frames or of an observer's (no target), in turns."""

    def __init__(self, plan: UplinkPlan, case: dict[str, Any], *, observer: bool = False) -> None:
        self._plan = plan
        self._case = case
        self._observer = observer
        self._visits: list[tuple[_Visit, _Visit]] = []
        #: turns that were made again because frames got lost, by side
        self._disturbed: Counter[str] = Counter()

    def measure(self, rig: SideBySide) -> str:
        """Add the pairs of one start of the processes; the ratios so far, for people."""
        for ours_first in (True, False):
            job = partial(both, partial(self._visit, rig), ours_first)
            self._visits.append(_undisturbed(job, self._disturbed))
        ratios = _ratios([self.pairs(rate) for rate in self._plan.rates])
        return f"CPU ratio{' (observer)' if self._observer else ''} after {len(self._visits)} pairs: {ratios}"

    def _visit(self, rig: SideBySide, ours: bool) -> _Visit:
        """Slices of the mix at every rate, and of the downlink alone between them."""
        proxy = rig.side(ours)
        proxy.model.stream(STREAM)
        try:
            rig.loop.run(_UPLINK_SETTLE_S)
            visit = self._slices(rig, proxy)
        finally:
            rig.rest()
        rig.check()
        return visit

    def _slices(self, rig: SideBySide, proxy: Proxy) -> _Visit:
        plan = self._plan
        idle_s = plan.idle_s / len(plan.rates) / _SLICES
        idle: list[float] = []
        spent = dict.fromkeys(plan.rates, 0.0)
        frames: Counter[int] = Counter()
        arrived: Counter[int] = Counter()
        for _ in range(_SLICES):
            for rate, seconds in plan.rates.items():
                before = proxy.cpu_s()
                rig.loop.run(idle_s)
                idle.append((proxy.cpu_s() - before) / idle_s)
                sender = Sender(rig, proxy, 1 if self._observer else 0)
                before = proxy.cpu_s()
                sender.begin(rate)
                rig.loop.run(seconds / _SLICES)
                sender.end()
                rig.loop.run(_DRAIN_S)
                spent[rate] += proxy.cpu_s() - before
                frames[rate] += sender.frames
                arrived[rate] += len(sender.delays_s)
        visit = _Visit(mean(idle))
        for rate, seconds in plan.rates.items():
            if not self._observer:
                _check(proxy, frames[rate], arrived[rate])
            visit.passed[rate] = arrived[rate] / frames[rate]
            alone = visit.idle_per_s * (seconds + _SLICES * _DRAIN_S)
            visit.cpu_us[rate] = (spent[rate] - alone) / frames[rate] * 1e6
        return visit

    def pairs(self, rate: int) -> list[Pair]:
        """All pairs of one rate, microseconds a frame."""
        return [Pair(ours.cpu_us[rate], baseline.cpu_us[rate]) for ours, baseline in self._visits]

    def settled(self) -> bool:
        """Whether more starts would hardly change the ratios."""
        return all(settled(self.pairs(rate), 2 * PAIRS_A_START, UPLINK_UNCERTAINTY) for rate in self._plan.rates)

    def results(self) -> Iterator[Measurement]:
        """One line a rate."""
        note = "an observer's frames: ours judges and refuses what steers, stock MAVProxy passes all of it"
        for rate in self._plan.rates:
            yield from_comparison(
                "uplink",
                "CPU per frame of an observer" if self._observer else "CPU per frame",
                "us",
                {"frames_per_s": rate, **self._case},
                compare(self.pairs(rate)),
                limit=None if self._observer else UPLINK_CPU_RATIO,
                details={
                    "idle_ms_per_s": self._medians(lambda visit: visit.idle_per_s * 1e3),
                    "part_that_passed": self._medians(lambda visit, rate=rate: visit.passed[rate]),  # type: ignore[misc]
                    "turns_repeated_for_lost_frames": dict(self._disturbed),
                },
                note=note if self._observer else "",
            )

    def _medians(self, value: Callable[[_Visit], float]) -> dict[str, float]:
        sides = zip(*self._visits, strict=True)
        return {side: median(map(value, visits)) for side, visits in zip(_SIDES, sides, strict=True)}


class DelayStudy:
    """Delay of the commander's frames, through both processes at the same time, frame by frame."""

    def __init__(self, plan: UplinkPlan, case: dict[str, Any]) -> None:
        self._plan = plan
        self._case = case
        #: of each window the delays (s), ours and the baseline's
        self._delays: dict[int, list[tuple[list[float], list[float]]]] = {rate: [] for rate in plan.rates}
        #: windows that were made again because frames got lost, by side
        self._disturbed: Counter[str] = Counter()

    def measure(self, rig: SideBySide) -> str:
        """Add the windows of one start of the processes; the ratios so far, for people."""
        senders = [Sender(rig, side, 0) for side in rig.sides]
        for side in rig.sides:
            side.model.stream(STREAM)
        for rate, delays in self._delays.items():
            for window in range(self._plan.windows):
                # the first sender in each period changes with the window
                order = senders if window % 2 else senders[::-1]
                _undisturbed(partial(self._window, rig, order, rate), self._disturbed)
                delays.append((senders[0].delays_s, senders[1].delays_s))
        rig.rest()
        rig.check()
        both_parts = ([compare(self._pairs(rate, part)).ratio for part in (0.5, 0.99)] for rate in self._delays)
        return "delay ratio: " + ", ".join(f"{middle:.2f} (99 %: {late:.2f})" for middle, late in both_parts)

    def _pairs(self, rate: int, part: float) -> list[Pair]:
        """A pair a window: that quantile of both sides, milliseconds."""
        return [Pair(*(quantile(side, part) * 1e3 for side in window)) for window in self._delays[rate]]

    def _window(self, rig: SideBySide, senders: list[Sender], rate: int) -> None:
        for place, sender in enumerate(senders):
            sender.begin(rate, place * 0.5 / rate)
        rig.loop.run(self._plan.window_s)
        for sender in senders:
            sender.end()
        rig.loop.run(_DRAIN_S)
        for sender in senders:
            sender.check()

    def results(self) -> Iterator[Measurement]:
        """Median and 99 % for each rate."""
        for rate, windows in self._delays.items():
            every = {side: list(chain(*found)) for side, found in zip(_SIDES, zip(*windows, strict=True), strict=True)}
            for what, part in (("delay, median", 0.5), ("delay, 99 %", 0.99)):
                details = {
                    "frames": {side: len(found) for side, found in every.items()},
                    "windows_repeated_for_lost_frames": dict(self._disturbed),
                    "of_all_frames_ms": {side: quantile(found, part) * 1e3 for side, found in every.items()},
                }
                case = {"frames_per_s": rate, **self._case}
                compared = compare(self._pairs(rate, part))
                yield from_comparison("uplink", what, "ms", case, compared, limit=DELAY_RATIO, details=details)


def uplink(plan: UplinkPlan, folder: Path, say: Say) -> Iterator[Measurement]:
    """Frames of the commander; once, at the fastest rate, those of an observer."""
    fastest = max(plan.rates)
    alone = replace(plan, rates={fastest: plan.rates[fastest]})
    for signing, as_it_comes in plan.cases:
        case = {"signing": "on" if signing else "off", "stock": _stock(as_it_comes)}
        name = f"uplink-signing-{case['signing']}{'-as-it-comes' if as_it_comes else ''}"
        cpu, delay, observer = CpuStudy(plan, case), DelayStudy(plan, case), CpuStudy(alone, case, observer=True)

        def make(start: int, name: str = name, signing: bool = signing, stock: bool = as_it_comes) -> SideBySide:
            return SideBySide(folder / f"{name}-{start}", 2, signing=signing, as_it_comes=stock)

        for start, rig in enumerate(_starts(plan.starts, make, cpu.settled)):
            say(f"signing {case['signing']}, stock {case['stock']}, {cpu.measure(rig)}; {delay.measure(rig)}")
            if start == 0 and not as_it_comes:
                say(f"signing {case['signing']}, {observer.measure(rig)}")
        yield from cpu.results()
        yield from delay.results()
        if not as_it_comes:
            yield from observer.results()


# ---- the vehicle's stream down --------------------------------------------------------------------------------------
#
# Processor time a second, idle loop included. Ours does more in one respect (zone check at every position, lease,
# authority and control status) and less in another (an observer gets a part of the stream). Both are in the numbers,
# and the frames that each station got stand beside them.

DOWNLINK_CPU_RATIO: Final = 1.1
DOWNLINK_UNCERTAINTY: Final = 0.03
_DOWNLINK_SETTLE_S: Final = 0.4


@dataclass(frozen=True, slots=True)
class DownlinkPlan:
    """Least and most starts of the processes, streams (frames a second), and seconds for each turn.

    `cases`: number of stations, and whether the stock MAVProxy is as it comes.
    """

    starts: tuple[int, int]
    streams: tuple[int, ...]
    seconds: float
    cases: tuple[tuple[int, bool], ...]


DOWNLINK = DownlinkPlan((2, 3), (50, 200), 2.5, ((2, False), (2, True), (10, False)))
DOWNLINK_QUICK = DownlinkPlan((1, 1), (50,), 1.0, ((2, False),))


@dataclass(frozen=True, slots=True)
class _Turn:
    """One stream on one side, all per second."""

    cpu_ms: float
    sent: float
    commander_got: float
    observers_got: float


class StreamStudy:
    """All streams of the plan, in turns, over several starts of the processes."""

    def __init__(self, plan: DownlinkPlan, case: dict[str, Any]) -> None:
        self._plan = plan
        self._case = case
        self._turns: dict[int, list[tuple[_Turn, _Turn]]] = {stream: [] for stream in plan.streams}

    def measure(self, rig: SideBySide) -> str:
        """Add the pairs of one start of the processes; the ratios so far, for people."""
        for stream, turns in self._turns.items():
            turns.extend(islice(in_turns(partial(self._turn, rig, stream)), PAIRS_A_START))
        ratios = _ratios([self.pairs(stream) for stream in self._turns])
        return f"{self._case['stations']} stations, stock {self._case['stock']}, CPU ratio so far: {ratios}"

    def _turn(self, rig: SideBySide, stream: int, ours: bool) -> _Turn:
        proxy, seconds = rig.side(ours), self._plan.seconds
        proxy.model.stream(stream)
        rig.loop.run(_DOWNLINK_SETTLE_S)
        cpu, sent = proxy.cpu_s(), proxy.model.frames_out
        heard = [station.heard.total() for station in proxy.stations]
        rig.loop.run(seconds)
        spent = proxy.cpu_s() - cpu
        got = [(station.heard.total() - n) / seconds for station, n in zip(proxy.stations, heard, strict=True)]
        turn = _Turn(spent / seconds * 1e3, (proxy.model.frames_out - sent) / seconds, got[0], median(got[1:]))
        rig.rest()
        rig.check()
        return turn

    def pairs(self, stream: int) -> list[Pair]:
        """All pairs of one stream, milliseconds a second."""
        return [Pair(ours.cpu_ms, baseline.cpu_ms) for ours, baseline in self._turns[stream]]

    def settled(self) -> bool:
        """Whether more starts would hardly change the ratios."""
        return all(settled(self.pairs(stream), 2 * PAIRS_A_START, DOWNLINK_UNCERTAINTY) for stream in self._turns)

    def results(self) -> Iterator[Measurement]:
        """One line a stream."""
        stations = self._case["stations"]
        for stream, turns in self._turns.items():
            sides = zip(_SIDES, zip(*turns, strict=True), strict=True)
            delivered = {side: _delivered(of_side) for side, of_side in sides}
            told = {
                side: " and ".join(f"{rate:.0f}" for rate in [*got.values()][1:]) for side, got in delivered.items()
            }
            yield from_comparison(
                "downlink",
                "CPU per second",
                "ms/s",
                {"stations": stations, "frames_per_s": stream, "stock": self._case["stock"]},
                compare(self.pairs(stream)),
                limit=DOWNLINK_CPU_RATIO if stations == 2 else None,
                details={"frames_per_s_delivered": delivered},
                note=f"{stations} stations, {stream} frames/s: to commander and each observer come "
                f"{told['ours']} frames/s, to stock MAVProxy's outputs {told['baseline']}",
            )


def _delivered(turns: tuple[_Turn, ...]) -> dict[str, float]:
    return {
        "from_autopilot": median(turn.sent for turn in turns),
        "commander_or_first_output": median(turn.commander_got for turn in turns),
        "each_observer_or_output": median(turn.observers_got for turn in turns),
    }


def downlink(plan: DownlinkPlan, folder: Path, say: Say) -> Iterator[Measurement]:
    """Every stream with each number of stations."""
    for stations, as_it_comes in plan.cases:
        study = StreamStudy(plan, {"stations": stations, "stock": _stock(as_it_comes)})
        name = f"downlink-{stations}{'-as-it-comes' if as_it_comes else ''}"

        def make(start: int, name: str = name, stations: int = stations, stock: bool = as_it_comes) -> SideBySide:
            return SideBySide(folder / f"{name}-{start}", stations, as_it_comes=stock)

        for rig in _starts(plan.starts, make, study.settled):
            say(study.measure(rig))
        yield from study.results()
